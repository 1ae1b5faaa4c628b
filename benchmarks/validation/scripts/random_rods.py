# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rods of any weight in any pose: a minimum, and an honest error estimate."""

from benchmarks.validation.entry import Measure, Validation, others_than, smallest

ENTRY = Validation(
    name='random rods',
    shows='w L^3/EI from 0.1 to 1e5, stiffness ratio up to 1000, up to three natural turns, '
          'any pose: a minimum, within ten times the error estimate; of seven discretizations, '
          'too, the estimate is not below a tenth of the error',
    against="SciPy's boundary value solver on the Kirchhoff equations; Jacobi's condition for a "
            'minimum by its integrator',
    script='test/random_rods.py',
    arguments=('150', '0'),
    whole=('2000', '0'),
    measures=(Measure('rods that are no minimum', others_than('a minimum'), 0),
              Measure('smallest estimate / error', smallest('estimate / error {} to'), 0.1,
                      least=True)),
)
