# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rods whose properties jump."""

from benchmarks.validation.entry import Measure, Validation, others_than, smallest

ENTRY = Validation(
    name='rods whose properties jump',
    shows='mass, load, natural strains, stiffness: the accuracy asked for, an honest estimate',
    against='Runge-Kutta from jump to jump (SciPy)',
    script='test/random_stepped.py',
    arguments=('6', '0'),
    whole=('200', '0'),
    measures=(Measure('answers that are not good', others_than('good'), 0),
              Measure('smallest estimate / error', smallest('estimate / error {} to'), 0.1,
                      least=True)),
)
