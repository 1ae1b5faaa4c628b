# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cables of other engines, predicted for 5 s."""

from benchmarks.validation.entry import Measure, Validation, largest

ENTRY = Validation(
    name='cables of other engines, predicted for 5 s',
    shows='predicted from the markers on both grippers alone, with 1 mm of noise on each; mean '
          'absolute error over coordinates, free markers and frames',
    against='a discrete rod and MuJoCo, recorded as the DEFORM data set is',
    script='-m benchmarks.deform_surrogate',
    arguments=('--known', '--cables', '1', '3'),
    whole=('--output', 'docs/benchmarks'),
    measures=(Measure('largest of both', largest(r'of free markers {} mm'), 5.0, 'mm'),
              Measure('not predicted', largest(r'{} of \d+ not predicted'), 0)),
    extra='mujoco',
)
