# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Mistakes that a type checker has to find: one in each line that says which."""

from dlo_planner import CutOut, Limits, Plan, Pose, Rod, Sphere, replay


def mistakes(plan: Plan, rod: Rod) -> None:
    """Make them."""
    Pose((0.0, 0.0, 0.0))                          # E: call-arg
    Sphere((0.0, 0.0, 0.0), 'large')               # E: arg-type
    Limits(speed=0.1)                              # E: call-arg
    CutOut((0.0, 0.0, 0.5), radius=0.01)           # E: arg-type
    print(plan.gripers)                            # E: attr-defined
    rod.length = 0.5                               # E: misc
    replay(rod, plan)                              # E: arg-type
    Rod.circular(0.6, 1e-3, 8960, 110e9)           # E: call-arg
