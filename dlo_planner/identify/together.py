# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far residuals that go together spread what is fitted to them.

What a model does not know, in a motion, lasts: residuals of one instant are like those of the next,
and like those of other points. Each instant then tells less than its points do. What a residual
pulls the unknowns by is summed over the points of an instant; the covariance of the sum over all
instants is a Bartlett estimate (Newey and West 1987, Econometrica 55), its width by Andrews (1991,
Econometrica 59, Eq. 5.3, 6.2 and 6.4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dlo_planner.model.arrays import Floats

_LARGEST = 0.97    # correlation of neighbors: more cannot be told from a drift
_WIDTH = 1.1447    # of Andrews, for Bartlett's kernel
_FREEDOM = 1.5     # degrees of freedom of Bartlett's kernel, per instants in its width
_LEAST_FREEDOM = 2.5
_NOTHING = 1e-12   # of the largest eigenvalue


def spread_together(series: Sequence[Floats], alone: Floats) -> Floats:
    """Return the covariance (n, n) of the sum of all pulls, not less than it is if each is alone.

    Shapes: alone (n, n).
    """
    values, vectors = np.linalg.eigh(alone)
    seen = values > _NOTHING * values[-1]
    root = np.sqrt(values[seen])
    units = [pulls @ vectors[:, seen] / root for pulls in series if len(pulls) > 1]
    if not units:
        return alone
    sizes, axes = np.linalg.eigh(_long_run(units))
    more = vectors[:, seen] * root @ axes
    result: Floats = alone + more * np.maximum(sizes - 1.0, 0.0) @ more.T
    return result


def _long_run(series: Sequence[Floats]) -> Floats:
    """Return the covariance (n, n) of the sum of all vectors (k, n), each like its neighbors."""
    shortest, instants = min(map(len, series)), sum(map(len, series))
    width = min(_andrews(series), shortest - 1.0)
    out = sum((one.T @ one for one in series), np.zeros((series[0].shape[1],) * 2))
    for lag in range(1, int(np.ceil(width)) + 1):
        between = sum((one[lag:].T @ one[:-lag] for one in series), np.zeros_like(out))
        out += max(1.0 - lag / (width + 1.0), 0.0) * (between + between.T)
    # at the minimum all pulls add up to nothing, which takes that from the estimate on the average
    share = (width + 1.0) / instants
    # and an estimate from few instants that are apart is uncertain itself: of Student's t
    freedom = max(_FREEDOM / share, _LEAST_FREEDOM)
    result: Floats = out / (1.0 - share + share**2 / 3) * freedom / (freedom - 2.0)
    return result


def _andrews(series: Sequence[Floats]) -> float:
    """Return the best width of Bartlett's kernel, from first-order autoregressions."""
    before = sum(np.sum(one[:-1] ** 2, axis=0) for one in series)
    both = sum(np.sum(one[1:] * one[:-1], axis=0) for one in series)
    rho = np.clip(np.divide(both, before, out=np.zeros_like(both), where=before > 0),
                  -_LARGEST, _LARGEST)
    power = before**2
    bend = np.sum(4 * rho**2 * power / ((1 - rho) ** 6 * (1 + rho) ** 2))
    size = np.sum(power / (1 - rho) ** 4)
    length = np.mean([len(one) for one in series])
    return float(_WIDTH * (bend / size * length) ** (1 / 3)) if size > 0 else 0.0
