# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random ways of robot arms."""

from benchmarks.validation.entry import Measure, Validation, largest, smallest

ENTRY = Validation(
    name='random ways of Panda, UR5, Kinova j2s6s200',
    shows='found again from the way of the tool, from the present joints and without',
    against='the URDF multiplied out by hand',
    script='test/random_arms.py',
    arguments=('2',),
    extra='pinocchio',
    whole=('20',),
    measures=(Measure('fewest found, of 2', smallest(': {} and {} of'), 2, least=True),
              Measure('tool off by', largest('off by {} m'), 1e-4, 'm'),
              Measure('tool turned by', largest('m and {} rad'), 1e-4, 'rad')),
)
