# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random cut-outs."""

from benchmarks.validation.entry import Measure, Validation, others_than

ENTRY = Validation(
    name='random cut-outs',
    shows='rods round, flat, bent, twisted, w L^3/EI from 0.25 to 10: plans replay below 1e-6 m '
          'and rad, without a leap; refusals are confirmed',
    against='replay from the natural shape; all ways to hang',
    script='test/random_cutouts.py',
    arguments=('40', '0'),
    whole=('300', '0'),
    measures=(Measure('neither replayed nor confirmed', others_than('replayed', 'confirmed'), 0),),
)
