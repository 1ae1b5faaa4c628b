# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cables held at both ends."""

from benchmarks.validation.entry import Measure, Validation, largest, smallest

ENTRY = Validation(
    name='cables held at both ends',
    shows='w L^3/EI from 1 to 1e5, also with GJ = 1e-4 EI, free and over a peg: how many converge '
          'at spans of 0.65 to 0.95 L; up to 0.999 L what converges is right, the rest is refused',
    against="SciPy's boundary value solver on the Kirchhoff equations, within ten times the error "
            'estimate (free, usual torsion)',
    script='test/random_holds.py',
    arguments=('4',),
    whole=('24',),
    measures=(Measure('fewest of 4 poses', smallest('converged {}, '), 4, least=True),
              Measure('wrong', largest(', {} wrong'), 0),
              Measure('error / estimate', largest('at most {}$'), 10),
              Measure('refused to 0.99 L', largest(r'^(?:slack|tight).* refused \({} %'), 0, '%'),
              Measure('refused from 0.99 to 0.999 L', largest(r'^taut.* refused \({} %'), 30,
                      '%')),
)
