# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known of a function along a DLO without a look at it is what a look would find."""

import numpy as np
import pytest

from dlo_planner import Rod
from dlo_planner.model.varying import Expanded, resolved, smooth


@pytest.mark.parametrize('terms', [1, 6, 10])
def test_a_series_is_told_as_if_it_had_been_looked_at(rng, terms):
    for base, parts in (((0.1, -0.2), 2), (0.3, 1)):
        content = Expanded(base, rng.normal(size=(terms, parts)), 1.003)
        known, seen = smooth(content, 1.003), resolved('k', content, 1.003)
        assert known == seen


def test_a_long_series_is_looked_at(rng):
    content = Expanded((0.0, 0.0), 0.1 * rng.normal(size=(24, 2)), 1.0)
    rod = Rod(1.0, 1e-3, 1e-3, 0.02, natural_curvature=content)
    s = np.linspace(0, 1, 50)
    means = rod.natural_strains(s)[:, 1:]
    assert means == pytest.approx(np.array([content(one) for one in s]), abs=1e-9)
    assert len(rod._profiles['natural_curvature'].edges) > 257
