# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Honesty of fits."""

from benchmarks.validation.entry import Measure, Validation, largest, smallest

ENTRY = Validation(
    name='honesty of `fit_rod`',
    shows='share of the errors within one and within 1.96 stated deviations (68 and 95 % expected; '
          'samples of 40 scatter by 5 and 3 points)',
    against='the rod that made the shapes, repeated experiments',
    script='test/fit_coverage.py',
    arguments=('40', 'with s', 'with s, gripper'),
    whole=('200',),
    measures=(Measure('within one, least', smallest(r'68 %: +{}'), 55, '%', least=True),
              Measure('within one, most', largest(r'68 %: +{}'), 81, '%'),
              Measure('within 1.96, least', smallest(r'95 %: +{}'), 88, '%', least=True)),
)
