# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random DLOs drawn over obstacles."""

from benchmarks.validation.entry import Measure, Validation, others_than

ENTRY = Validation(
    name='random DLOs drawn over obstacles',
    shows='mu from 0.05 to 0.8: steps in contact that converge and keep the law of friction',
    against='mu N, within 1e-6 of it',
    script='test/random_friction.py',
    arguments=('30', '0'),
    whole=('127', '0'),
    measures=(Measure('steps in contact that do not converge',
                      others_than('converged', 'away'), 1),),
)
