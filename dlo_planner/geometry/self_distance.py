# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a curve of arcs comes to itself.

A point of the curve is no neighbour of an earlier one if the curve, on its way from there, heads
back towards that: before, the distance only grows. So a bend that is nowhere sharper than a radius
r comes back no nearer than 2 r (Schwarz's theorem), and a curve that turns by no more than a right
angle does not head back. Arcs are cut into chords that leave them by half the tolerance at most;
elements whose middles are too far apart are not looked at.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints

TOLERANCE = 1e-6   # of the length
_CHORDS, _MOST_CHORDS = 1000, 1000  # of the curve at least, of an element at most
_RIGHT = 0.5 * np.pi


@kernel
def may_head_back(nodes: Floats, strains: Floats) -> bool:
    """Return whether a curve turns enough to head back anywhere: a quick look.

    Args:
        nodes: (N + 1,), read-only, arc lengths, m; strains: (N, 3), read-only
    """
    turn = 0.0
    for e in range(strains.shape[0]):
        turn += np.hypot(strains[e, 1], strains[e, 2]) * (nodes[e + 1] - nodes[e])
    return turn > _RIGHT


@kernel
def self_distance(lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
                  radii: Floats, least: float, gap: float) -> tuple[float, float]:
    """Return the least distance, and the least less both radii, of two that are no neighbours.

    Args:
        lengths: (N,), strains: (N, 3), rotations: (N + 1, 3, 3), positions: (N + 1, 3)
        radii: (N,) of the elements, m
        least, gap: what is larger does not matter; both are returned then
    """
    n = lengths.size
    turns, chords = np.zeros(n + 1), np.ones(n, dtype=np.int64)
    length = np.sum(lengths)
    for e in range(n):
        bend = np.hypot(strains[e, 1], strains[e, 2])
        turns[e + 1] = turns[e] + bend * lengths[e]
        cut = lengths[e] * max(np.sqrt(bend / (4.0 * TOLERANCE * length)), _CHORDS / length)
        chords[e] = int(min(max(1.0, np.ceil(cut)), _MOST_CHORDS))
    if turns[n] <= _RIGHT or not _may_be_near(lengths, positions, turns, radii, least, gap):
        return least, gap
    bound, gap_bound = least, gap
    if least == np.inf:  # what the elements' chords tell spares most of the arcs
        first = np.arange(n + 1)
        bound, gap_bound = _nearest(positions.copy(), first, lengths, positions, turns, radii,
                                    least, gap)
        bound += np.max(lengths)
        gap_bound += np.max(lengths)
    points, first = _points(lengths, strains, rotations, positions, chords)
    found, room = _nearest(points, first, lengths, positions, turns, radii, bound, gap_bound)
    if least == np.inf and (found == bound or room == gap_bound):
        found, room = _nearest(points, first, lengths, positions, turns, radii, least, gap)
    return found, room


@kernel
def _far(lengths, positions, i, j):
    """Return a lower bound of the distance of two elements, m."""
    square = 0.0
    for k in range(3):
        away = (positions[i, k] + positions[i + 1, k] - positions[j, k] - positions[j + 1, k])
        square += 0.25 * away * away
    return np.sqrt(square) - 0.5 * (lengths[i] + lengths[j])


@kernel
def _may_be_near(lengths, positions, turns, radii, least, gap):
    """Return whether any two elements may be nearer than that."""
    if least == np.inf:
        return True
    n = lengths.size
    for i in range(n):
        for j in range(i, n):
            if turns[j + 1] - turns[i] > _RIGHT:
                far = _far(lengths, positions, i, j)
                if far < least or far - radii[i] - radii[j] < gap:
                    return True
    return False


@kernel
def _points(lengths, strains, rotations, positions, chords):
    """Return (M + 1, 3) ends of the chords, and (N + 1,) the first one of each element."""
    n = lengths.size
    first = np.zeros(n + 1, dtype=np.int64)
    for e in range(n):
        first[e + 1] = first[e] + chords[e]
    points, rotation = np.empty((first[n] + 1, 3)), np.empty((3, 3))
    for e in range(n):
        for k in range(chords[e]):
            point_inside(lengths, strains, rotations, positions, e, k / chords[e], rotation,
                         points[first[e] + k])
    points[first[n]] = positions[n]
    return points, first


@kernel
def _nearest(points: Floats, first: Ints, lengths: Floats, positions: Floats, turns: Floats,
             radii: Floats, least: float, gap: float) -> tuple[float, float]:
    """Return what `self_distance` does, of chords between points (M + 1, 3)."""
    n, m = lengths.size, points.shape[0] - 1
    looked = np.arange(1, m + 1)  # to where chords are known not to head back
    for i in range(n):
        for j in range(i, n):
            if turns[j + 1] - turns[i] <= _RIGHT:
                continue
            far, both = _far(lengths, positions, i, j), radii[i] + radii[j]
            if far >= least and far - both >= gap:
                continue
            for a in range(first[i], first[i + 1]):
                while looked[a] < first[j + 1] and not heads_back(points, a, looked[a]):
                    looked[a] += 1
                for b in range(max(looked[a], first[j]), first[j + 1]):
                    distance = _apart(points, a, b)
                    least, gap = min(least, distance), min(gap, distance - both)
    return least, gap


@kernel
def heads_back(points, a, b):
    """Return whether chord b leads towards the end of chord a, an earlier one, from its start."""
    along = 0.0
    for k in range(3):
        along += (points[b, k] - points[a + 1, k]) * (points[b + 1, k] - points[b, k])
    return along < 0.0


@kernel
def _apart(points, a, b):
    """Return the distance of two chords (Ericson, Real-Time Collision Detection, 5.1.9), m."""
    uu = vv = uv = uw = vw = 0.0
    for k in range(3):
        u, v = points[a + 1, k] - points[a, k], points[b + 1, k] - points[b, k]
        w = points[a, k] - points[b, k]
        uu, vv, uv, uw, vw = uu + u * u, vv + v * v, uv + u * v, uw + u * w, vw + v * w
    across = uu * vv - uv * uv
    s = min(max((uv * vw - uw * vv) / across, 0.0), 1.0) if across > 1e-14 * uu * vv else 0.0
    t = (uv * s + vw) / vv
    if t < 0.0:
        s, t = min(max(-uw / uu, 0.0), 1.0), 0.0
    elif t > 1.0:
        s, t = min(max((uv - uw) / uu, 0.0), 1.0), 1.0
    square = 0.0
    for k in range(3):
        away = (points[a, k] + s * (points[a + 1, k] - points[a, k])
                - points[b, k] - t * (points[b + 1, k] - points[b, k]))
        square += away * away
    return np.sqrt(square)
