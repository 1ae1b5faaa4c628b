# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cables held at both ends."""

from benchmarks.validation.entry import Measure, Validation, smallest

ENTRY = Validation(
    name='cables held at both ends',
    shows='w L^3/EI from 1 to 1e5, also with GJ = 1e-4 EI, free and over a peg: how many converge '
          '(what does not says so)',
    against='its own residual',
    script='test/random_holds.py',
    arguments=('4',),
    whole=('24',),
    measures=(Measure('fewest of 4 poses', smallest('converged {}, '), 4, least=True),),
)
