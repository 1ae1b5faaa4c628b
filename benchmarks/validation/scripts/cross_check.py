# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Another engine."""

from benchmarks.validation.entry import Measure, Validation, largest


def _beyond(text: str) -> float:
    """Return how many scenes are farther apart than both engines say."""
    return float(text.count('| **no** |'))  # of the table, not of the lines before it


ENTRY = Validation(
    name='another engine: MuJoCo',
    shows='free wires and strips, contact with bar, plane, sphere, holes, motions: see below',
    against="MuJoCo's chains, extrapolated from four to seven refinements",
    script='-m benchmarks.cross_check',
    arguments=('{output}',),
    extra='mujoco',
    measures=(Measure('scenes beyond their limits', _beyond, 0),
              Measure("shown in contact, MuJoCo's own error included",
                      largest(r'^wire (?:on|in) (?:[^|]*\|){3} {} mm'), 1.0, 'mm')),
)
