# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a curve passes through itself on the straight way of its nodes from here to there.

Two chords that move so are in one plane where a cubic of the way is zero; where they meet there,
one passes through the other. What turns by no more than a right angle before and after cannot: all
its points go on in the direction in which it begins, so do those of all shapes between.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_RIGHT = 0.5 * np.pi
_TOUCHES = 1e-9   # of the length: strands in one plane are as near, by rounding, all the time
_BESIDE = 1e-9    # of a chord: so far beyond its ends it is met, lest a node slips between two
_BISECTIONS = 60  # of a part of the way in which the cubic changes its sign once


@kernel
def turning(lengths: Floats, strains: Floats) -> float:
    """Return by how much a curve bends in all, rad; lengths (N,) m, strains (N, 3) 1/m."""
    turn = 0.0
    for e in range(lengths.size):
        turn += lengths[e] * np.hypot(strains[e, 1], strains[e, 2])
    return turn


@kernel
def bends_back(lengths: Floats, before: Floats, after: Floats) -> bool:
    """Return whether a curve bends by more than a right angle before or after a step.

    Args:
        lengths: (N,) m; before, after: (N, 3) strains, 1/m
    """
    return max(turning(lengths, before), turning(lengths, after)) > _RIGHT


@kernel
def passes_itself(before: Floats, after: Floats) -> bool:
    """Return whether the polygon through nodes (N + 1, 3) passes through itself between two places.

    Both are seen from where the curve is held: each node goes straight.
    """
    n = before.shape[0] - 1
    length = longest = farthest = 0.0
    for e in range(n):
        one, other = np.sqrt(_square(before, e, e + 1)), np.sqrt(_square(after, e, e + 1))
        length, longest = length + one, max(longest, one, other)
    for k in range(n + 1):
        way = 0.0
        for i in range(3):
            way += (after[k, i] - before[k, i]) ** 2
        farthest = max(farthest, np.sqrt(way))
    reach = 2.0 * farthest + longest  # middles that are farther apart before do not meet
    for i in range(n - 2):
        j = i + 2
        while j < n:
            square = 0.0
            for k in range(3):
                away = 0.5 * (before[i, k] + before[i + 1, k] - before[j, k] - before[j + 1, k])
                square += away * away
            far = np.sqrt(square) - reach
            if far > longest:  # so many chords on it is no nearer than that
                j += max(1, int(far / longest))
                continue
            if far <= 0.0 and _pass(before, after, i, j, _TOUCHES * length):
                return True
            j += 1
    return False


@kernel
def passes_ray(ray: Floats, later_ray: Floats, node: int, before: Floats, after: Floats) -> bool:
    """Return whether the polygon through nodes (N + 1, 3) passes through a straight line.

    The line leaves one of its ends, node 0 or N, by `ray` (3,), m, before, and by `later_ray`
    after; there is none if that is zero.
    """
    n = before.shape[0] - 1
    size = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    if size == 0.0:
        return False
    begin, end = np.empty((4, 3)), np.empty((4, 3))
    for k in range(3):
        begin[0, k], begin[1, k] = before[node, k], before[node, k] + ray[k]
        end[0, k], end[1, k] = after[node, k], after[node, k] + later_ray[k]
    for e in range(n):
        if e == node or e + 1 == node:
            continue
        for k in range(3):
            begin[2, k], begin[3, k] = before[e, k], before[e + 1, k]
            end[2, k], end[3, k] = after[e, k], after[e + 1, k]
        if _pass(begin, end, 0, 2, _TOUCHES * size):
            return True
    return False


@kernel
def passes_between(s: Floats, strains: Floats, frames: Floats, positions: Floats,
                   later_strains: Floats, later_frames: Floats, later_positions: Floats) -> bool:
    """Return whether a curve passes through itself from one shape to a later one.

    Args:
        s: (N + 1,) arc lengths of the nodes, m; strains: (N, 3) 1/m; frames: (k, 3, 3), the first
        of the first node; positions: (N + 1, 3) m, world; all read-only
    """
    lengths = np.empty(s.size - 1)
    for e in range(lengths.size):
        lengths[e] = s[e + 1] - s[e]
    return _passes(lengths, strains, frames[0], positions, later_strains, later_frames[0],
                   later_positions)


@kernel
def _passes(lengths, strains, frame, positions, later_strains, later_frame, later_positions):
    if not bends_back(lengths, strains, later_strains):
        return False
    before, after = np.empty(positions.shape), np.empty(positions.shape)
    _see(frame, positions, before)
    _see(later_frame, later_positions, after)
    return not _goes_one_way(before, after) and passes_itself(before, after)


@kernel
def _see(frame, positions, seen):
    """Fill places (N + 1, 3) as they are seen from the first node."""
    for m in range(positions.shape[0]):
        for i in range(3):
            seen[m, i] = 0.0
            for j in range(3):
                seen[m, i] += (positions[m, j] - positions[0, j]) * frame[j, i]


@kernel
def _goes_one_way(before, after):
    """Return whether all chords of two polygons go on along one direction.

    So do those of all polygons between, which cannot meet themselves. The direction is that from
    their first nodes to their last.
    """
    n = before.shape[0] - 1
    x = before[n, 0] - before[0, 0] + after[n, 0] - after[0, 0]
    y = before[n, 1] - before[0, 1] + after[n, 1] - after[0, 1]
    z = before[n, 2] - before[0, 2] + after[n, 2] - after[0, 2]
    for e in range(n):
        one = (x * (before[e + 1, 0] - before[e, 0]) + y * (before[e + 1, 1] - before[e, 1])
               + z * (before[e + 1, 2] - before[e, 2]))
        other = (x * (after[e + 1, 0] - after[e, 0]) + y * (after[e + 1, 1] - after[e, 1])
                 + z * (after[e + 1, 2] - after[e, 2]))
        if not (one > 0.0 and other > 0.0):
            return False
    return True


@kernel
def first_passage(lengths: Floats, strains: Floats, frames: Floats, positions: Floats) -> int:
    """Return after which of n shapes in a row a curve first passes through itself; -1: after none.

    Args:
        lengths: (N,) m; strains: (n, N, 3) 1/m; frames: (n, 3, 3) of the first node;
        positions: (n, N + 1, 3) m
    """
    for k in range(strains.shape[0] - 1):
        if _passes(lengths, strains[k], frames[k], positions[k], strains[k + 1],
                   frames[k + 1], positions[k + 1]):
            return k
    return -1


@kernel
def _square(points, k, m):
    """Return the squared distance of two points."""
    square = 0.0
    for i in range(3):
        square += (points[k, i] - points[m, i]) ** 2
    return square


@kernel
def _pass(before, after, i, j, touches):
    """Whether chord j passes through chord i."""
    c = np.empty(4)
    _cubic(before, after, i, j, c)
    bounds = np.zeros(4)  # parts of the way in which the cubic is monotonic
    count = 1
    a, b = 3.0 * c[3], 2.0 * c[2]
    roots = b * b - 4.0 * a * c[1]
    if abs(a) > 0.0 and roots > 0.0:
        q = -0.5 * (b + (np.sqrt(roots) if b >= 0.0 else -np.sqrt(roots)))
        first, second = q / a, (c[1] / q if q != 0.0 else 0.0)
        for t in (min(first, second), max(first, second)):
            if 0.0 < t < 1.0:
                bounds[count] = t
                count += 1
    elif a == 0.0 and b != 0.0 and 0.0 < -c[1] / b < 1.0:
        bounds[count] = -c[1] / b
        count += 1
    bounds[count] = 1.0
    for part in range(count):
        low, high = bounds[part], bounds[part + 1]
        begin, end = _value(c, low), _value(c, high)
        if (begin > 0.0) == (end > 0.0):
            continue
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if (_value(c, middle) > 0.0) == (begin > 0.0):
                low = middle
            else:
                high = middle
        if _meet(before, after, i, j, 0.5 * (low + high), c, touches):
            return True
    return False


@kernel
def _value(c, t):
    """Return the value of a cubic."""
    return c[0] + t * (c[1] + t * (c[2] + t * c[3]))


@kernel
def _cubic(before, after, i, j, out):
    """Fill (4,) the coefficients, by the part of the way, of six times the chords' volume."""
    u, v, w = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    for k in range(3):
        u[0, k], v[0, k] = before[i + 1, k] - before[i, k], before[j + 1, k] - before[j, k]
        w[0, k] = before[j, k] - before[i, k]
        u[1, k] = after[i + 1, k] - after[i, k] - u[0, k]
        v[1, k] = after[j + 1, k] - after[j, k] - v[0, k]
        w[1, k] = after[j, k] - after[i, k] - w[0, k]
    out[:] = 0.0
    for p in range(2):
        for q in range(2):
            for r in range(2):
                out[p + q + r] += _volume(u[p], v[q], w[r])


@kernel
def _volume(u, v, w):
    """Return u x v . w."""
    return (w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2])
            + w[2] * (u[0] * v[1] - u[1] * v[0]))


@kernel
def _meet(before, after, i, j, t, c, touches):
    """Whether two chords that are in one plane cross there, and go through it, not along it."""
    u, v, w = np.empty(3), np.empty(3), np.empty(3)
    uu = vv = uv = uw = vw = 0.0
    for k in range(3):
        start = (1.0 - t) * before[i, k] + t * after[i, k]
        u[k] = (1.0 - t) * before[i + 1, k] + t * after[i + 1, k] - start
        other = (1.0 - t) * before[j, k] + t * after[j, k]
        v[k] = (1.0 - t) * before[j + 1, k] + t * after[j + 1, k] - other
        w[k] = other - start
        uu, vv, uv, uw, vw = (uu + u[k] * u[k], vv + v[k] * v[k], uv + u[k] * v[k],
                              uw + u[k] * w[k], vw + v[k] * w[k])
    across = uu * vv - uv * uv  # square of u x v
    if not across > 1e-20 * uu * vv:
        return False  # along each other: they slide
    p, q = (uw * vv - vw * uv) / across, (uw * uv - vw * uu) / across
    if not (-_BESIDE <= p <= 1.0 + _BESIDE and -_BESIDE <= q <= 1.0 + _BESIDE):
        return False
    farthest = 0.0  # from the plane where they meet, before or after
    for at in (0.0, 1.0):
        farthest = max(farthest, abs(_value(c, at)))
    return farthest > touches * np.sqrt(across)
