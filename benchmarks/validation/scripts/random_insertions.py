# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random bores."""

from benchmarks.validation.entry import Measure, Validation, others_than

ENTRY = Validation(
    name='random bores',
    shows='inserted without a leap of the gripper, or refused at the first waypoint',
    against='rates of the gripper',
    script='test/random_insertions.py',
    arguments=('30', '1'),
    whole=('100', '1'),
    measures=(Measure('neither inserted nor refused', others_than('inserted', 'refused'), 0),),
)
