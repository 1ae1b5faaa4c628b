# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of three cut-outs."""

from benchmarks.validation.entry import Measure, Validation, others_than

ENTRY = Validation(
    name='random sequences of three cut-outs',
    shows='plans of 100 waypoints replay within 1e-6 m, no leap; refusals are confirmed',
    against='replay; all ways to hang',
    script='test/random_sequences.py',
    arguments=('3', '0', '100'),
    whole=('16', '0', '100'),
    measures=(Measure('neither replayed nor confirmed', others_than('replayed', 'confirmed'), 0),),
)
