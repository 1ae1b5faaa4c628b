# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random pairs of cut-outs."""

from benchmarks.validation.entry import Measure, Validation, others_than

ENTRY = Validation(
    name='random pairs of cut-outs',
    shows='both centers hit within 1e-6 m, no leap; refusals are confirmed',
    against='replay; all ways to hang',
    script='test/random_pairs.py',
    arguments=('20', '0'),
    whole=('300', '0'),
    measures=(Measure('neither replayed nor confirmed', others_than('replayed', 'confirmed'), 0),),
)
