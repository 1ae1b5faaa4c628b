# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random contacts that are held."""

from benchmarks.validation.entry import Measure, Validation, others_than

ENTRY = Validation(
    name='random contacts held',
    shows='spheres, bars, planes, boxes: held with the least energy, or refused and confirmed',
    against='Runge-Kutta over eight decades of the force; direct simulation',
    script='test/random_contacts.py',
    arguments=('20', '0'),
    whole=('100', '0'),
    measures=(Measure('neither held nor confirmed', others_than('held', 'confirmed', 'away'), 0),),
)
