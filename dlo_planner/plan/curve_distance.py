# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a DLO is from another one as a curve, and how much room its elements have: kernels."""

from __future__ import annotations

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.gap import node_gap, node_range, stretch, taper
from dlo_planner.energy.scene import NODE_FACE, Scene
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


def curve_distances(this: Shape, that: Shape) -> Floats:
    """Return (N + 1,) distances in m of the nodes of a Shape from another, prolonged, as curves."""
    ends = this.positions[[0, -1]] - that.positions[[0, -1]]
    reach = float(np.sqrt((ends**2).sum(axis=1).max()))
    result: Floats = _distances(np.array(this.s), this.for_kernels[3], np.array(that.s),
                                *that.for_kernels[1:], reach)
    return result


@kernel
def element_rooms(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats,
                  positions: Floats, least: float) -> Floats:
    """Return (N,) a lower bound in m of the room of each element, none below the `least` of all."""
    x, slope, bend, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    rooms = np.full(lengths.size, np.inf)
    for o in range(scene.kind.size):
        if scene.feature[o] == NODE_FACE:
            continue
        last = 0.0
        begin, end = node_range(scene, o, lengths.size)
        for k in range(begin, end + 1):
            gap = node_gap(scene, o, k, rotations, positions, offset, x, slope, bend)
            if k > begin:
                e = k - 1
                reach = lengths[e] * stretch(scene, o, strains[e]) + abs(taper(scene, o, e))
                rooms[e] = min(rooms[e], 0.5 * (gap + last - reach))
            last = gap
    return np.maximum(rooms, least)  # type: ignore[no-any-return]


@kernel
def _distances(at: Floats, points: Floats, s: Floats, strains: Floats, rotations: Floats,
               positions: Floats, reach: float) -> Floats:
    """Return distances (n,) in m, none too small, of points from a DLO prolonged by `reach`.

    The nearest place is sought on the chords of the elements whose arc length is within twice
    `reach` of the point's own, the distance is from the arc there.

    Args:
        at: (n,) arc lengths of the points, m; points: (n, 3) m
        s: (N + 1,) of the DLO's nodes, m; reach: m
    """
    n = s.size - 1
    lengths = np.diff(s)
    out = np.empty(points.shape[0])
    frame, x = np.empty((3, 3)), np.empty(3)
    first = 0
    for k in range(points.shape[0]):
        while first < n - 1 and s[first + 1] < at[k] - 2.0 * reach:
            first += 1
        nearest, element, share = np.inf, first, 0.0
        for e in range(first, n):
            if s[e] > at[k] + 2.0 * reach and e > first:
                break
            along = square = size = 0.0
            for i in range(3):
                way = positions[e + 1, i] - positions[e, i]
                away = points[k, i] - positions[e, i]
                along += way * away
                square += away * away
                size += way * way
            part = min(max(along / size, 0.0), 1.0)
            square += part * (part * size - 2.0 * along)
            if square < nearest:
                nearest, element, share = square, e, part
        point_inside(lengths, strains, rotations, positions, element, share, frame, x)
        square = 0.0
        for i in range(3):
            square += (points[k, i] - x[i]) ** 2
        for end, sign in ((0, -1.0), (n, 1.0)):
            square = min(square, _from_ray(points[k], positions[end], rotations[end], sign, reach))
        out[k] = np.sqrt(square)
    return out


@kernel
def _from_ray(point: Floats, end: Floats, rotation: Floats, sign: float, reach: float) -> float:
    """Return the squared distance of a point from where an end is prolonged to by `reach`."""
    along = away = 0.0
    for i in range(3):
        along += sign * rotation[i, 0] * (point[i] - end[i])
    along = min(max(along, 0.0), reach)
    for i in range(3):
        away += (point[i] - end[i] - sign * along * rotation[i, 0]) ** 2
    return away
