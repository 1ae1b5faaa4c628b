# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO, or the straight line on which it would go on, is nearest to a point."""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arc import dot
from dlo_planner.ritz.kinematics import point_inside

_STEPS = 60  # at most: as many halvings find any place to rounding


@kernel
def nearest_place(s: Floats, lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
                  point: Floats, after: float, place: Floats) -> float:
    """Return the arc length of the DLO's nearest place to a point, m; beyond L if it only aims.

    Args:
        s: (N + 1,), read-only, of the nodes, m
        lengths: (N,), strains: (N, 3), rotations: (N + 1, 3, 3), positions: (N + 1, 3): the shape
        point: (3,), m
        after: arc length beyond which the place is sought, m
        place: (3, 3) filled, by rows: the place less the point, the tangent, its change per m
    """
    n, k, least = lengths.size, lengths.size, np.inf
    for node in range(1, n + 1):
        if s[node] > after:
            away = 0.0
            for i in range(3):
                away += (positions[node, i] - point[i]) ** 2
            if away < least:
                k, least = node, away
    ahead = _put_node(rotations, positions, n, point, place)
    if ahead < 0.0:
        aside = 0.0
        for i in range(3):
            aside += (place[0, i] - ahead * place[1, i]) ** 2
        if aside <= least:
            for i in range(3):
                place[0, i] -= ahead * place[1, i]
            return s[n] - ahead
    slope = _put_node(rotations, positions, k, point, place)
    if slope > 0.0:
        low = min(max((after - s[k - 1]) / lengths[k - 1], 0.0), 1.0)
        return s[k - 1] + lengths[k - 1] * _nearest_inside(
            lengths, strains, rotations, positions, k - 1, low, point, place)
    if slope < 0.0 and k < n:
        return s[k] + lengths[k] * _nearest_inside(lengths, strains, rotations, positions, k, 0.0,
                                                   point, place)
    if k < n:
        _put(lengths, strains, rotations, positions, k, 0.0, point, place)
    return s[k]


@kernel
def _put_node(rotations, positions, k, point, place):
    """Fill `place` at node `k`, as if it went on straight; return half the square's slope."""
    for i in range(3):
        place[0, i] = positions[k, i] - point[i]
        place[1, i] = rotations[k, i, 0]
        place[2, i] = 0.0
    return dot(place[0], place[1])


@kernel
def _put(lengths, strains, rotations, positions, element, fraction, point, place):
    """Fill `place` at a fraction of an element; return half the slope of the square distance."""
    frame, x = np.empty((3, 3)), np.empty(3)
    point_inside(lengths, strains, rotations, positions, element, fraction, frame, x)
    for i in range(3):
        place[0, i] = x[i] - point[i]
        place[1, i] = frame[i, 0]
        place[2, i] = strains[element, 2] * frame[i, 1] - strains[element, 1] * frame[i, 2]
    return dot(place[0], place[1])


@kernel
def _nearest_inside(lengths, strains, rotations, positions, element, low, point, place):
    """Return the fraction of an element, `low` at least, at which it is nearest; fill `place`.

    Newton's method for where the distance does not change, inside an interval that shrinks.
    """
    if _put(lengths, strains, rotations, positions, element, low, point, place) >= 0.0:
        return low
    high, h = 1.0, lengths[element]
    slope = _put(lengths, strains, rotations, positions, element, high, point, place)
    if slope <= 0.0:
        return high
    fraction = high
    for _ in range(_STEPS):
        curvature = 1.0 + dot(place[0], place[2])
        last = fraction
        fraction = fraction - slope / (curvature * h) if curvature > 0.0 else 0.5 * (low + high)
        if not low < fraction < high:
            fraction = 0.5 * (low + high)
        slope = _put(lengths, strains, rotations, positions, element, fraction, point, place)
        if slope < 0.0:
            low = fraction
        else:
            high = fraction
        if slope == 0.0 or abs(fraction - last) < 1e-15:
            break
    return fraction
