# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading of DLOs that are not as stated."""

from benchmarks.validation.entry import Measure, Validation, largest, smallest

ENTRY = Validation(
    name='closed loop, direct simulator as the truth',
    shows='1.5 mm wire, stiffness 5 %, mass 2 %, length 1 mm, natural curvature 0.05 1/m and '
          'varying 0.03 1/m, gripper 0.5 mm and 0.2 degrees, 24 points of 1 mm noise, 10 % '
          'outliers, a third hidden: miss at the entry after looks at the start pose and at the '
          'standoff',
    against='the true DLO; chi-square of the predicted miss (2 expected)',
    script='test/closed_loops.py',
    arguments=('6',),
    whole=('40',),
    measures=(Measure('largest miss', largest(r'standoff +\S+ +\S+ +{} '), 1.0, 'mm'),
              Measure('chi-square, at most', largest('chi-square {} of 2'), 4.0),
              Measure('within the 95 % bound, at least', smallest('within the bound {}%'), 80, '%',
                      least=True)),
)
