# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which mesh shares out evenly the error of arcs of constant strain."""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


@kernel
def even_shares(lengths: Floats, strains: Floats) -> Floats:
    """Return (N + 1,) where the nodes of a known shape lie on the best mesh, as parts of it.

    An arc whose strain should change at the rate u' misplaces its far end by about h^3 |u'|, so
    the best density of elements goes with the cube root of |u'|; a floor keeps a third of the
    elements for where nothing seems to happen.

    Args:
        lengths: (N,) of its elements, m
        strains: (N, 3) of its elements, less what jumps in the natural ones, 1/m
    """
    n = lengths.size
    density, shares = np.zeros(n), np.zeros(n + 1)
    for e in range(1, n):
        square = 0.0
        for i in range(3):
            square += (strains[e, i] - strains[e - 1, i]) ** 2
        rate = np.sqrt(square) / (0.5 * (lengths[e] + lengths[e - 1]))
        density[e - 1] += rate if e == 1 else 0.5 * rate
        density[e] += rate if e == n - 1 else 0.5 * rate
    mean = 0.0
    for e in range(n):
        density[e] = np.cbrt(density[e])
        mean += density[e] * lengths[e]
    mean /= np.sum(lengths)
    for e in range(n):
        more = density[e] / mean if mean > 0.0 else 0.0
        shares[e + 1] = shares[e] + (more + 0.5) * lengths[e]
    for k in range(n + 1):
        shares[k] /= shares[n]
    return shares
