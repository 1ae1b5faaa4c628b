# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a straight way may come to a body: lower bounds from what is known at both its ends.

The distance from a convex body is convex along a line: it stays above the tangents at both ends. A
sheet with holes is not convex, but what is left beside one hole alone is told by two numbers, the
height beyond the faces and the room to the hole's wall in the plane. Along a line the height is a
distance from a point, and the room is concave: it stays above its chord. So the distance stays
above that of a segment in the plane of both numbers from a quadrant, which is closed form. It may
be said of each hole, and of the sheet without any; the largest one counts.

Of a mesh the distance of the line from the triangles is known, where both its ends are outside.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.scene import Scene, from_faces, from_rectangle, in_its_frame
from dlo_planner.geometry.bvh import line_to_surface
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


@kernel
def lowest_of_tangents(first: float, slope: float, second: float, other: float) -> float:
    """Return the lowest value of a convex function on [0, 1] that its tangents allow.

    Args:
        first, slope: value and slope at 0; second, other: at 1
    """
    if slope >= 0.0:
        return first
    if other <= 0.0:
        return second
    return first + slope * min(max((second - other - first) / (slope - other), 0.0), 1.0)


@kernel
def sheet_bound(scene: Scene, o: int, x: Floats, y: Floats) -> float:
    """Return a lower bound in m of `signed_distance` from layer `o` between x and y (3,), world."""
    p, q = np.empty(3), np.empty(3)
    in_its_frame(scene, o, x, p)
    in_its_frame(scene, o, y, q)
    half = scene.size[o, 0]
    bound = _bound(scene, o, p, q, 0.0, half)
    if half > 0.0 and bound <= 2.0 * half:  # in the other layer's material both are as deep
        whole = _bound(scene, o, p, q, half, 2.0 * half)
        if whole <= 0.0:
            bound = min(bound, whole)
    return bound


@kernel
def mesh_bound(scene: Scene, o: int, x: Floats, away: float, y: Floats, other: float) -> float:
    """Return a lower bound in m of the exact distance from mesh `o` between x and y (3,), world.

    Args:
        away, other: the distances of x and y, m
    """
    p, q, length = np.empty(3), np.empty(3), 0.0
    for i in range(3):
        length += (y[i] - x[i]) ** 2
    bound = 0.5 * (away + other - np.sqrt(length))
    if away <= 0.0 or other <= 0.0:
        return bound
    in_its_frame(scene, o, x, p)
    in_its_frame(scene, o, y, q)
    line, _ = line_to_surface(scene.trees, scene.root[o], p, q, min(away, other))
    return max(bound, line) if line > 0.0 else bound  # 0: it is inside in between


@kernel
def _bound(scene, o, p, q, shift, half):
    """Return that of a plate `half` above and below the height -shift, on a line in its frame."""
    bound = -np.inf
    for hole in range(scene.hole_of.size):
        if scene.hole_of[hole] == o:
            bound = max(bound, _beside_hole(p[0] + shift, q[0] + shift, half,
                                            _room(scene, hole, p[1], p[2]),
                                            _room(scene, hole, q[1], q[2])))
    if bound == np.inf:
        return bound
    return max(bound, _from_plate(scene, o, p, q, shift, half))


@kernel
def _room(scene, hole, y, z):
    """Return how far in m (y, z) is from the wall of a hole, negative in the material."""
    away_y, away_z = y - scene.hole_center[hole, 0], z - scene.hole_center[hole, 1]
    if scene.hole_size[hole, 1] < 0:
        return scene.hole_size[hole, 0] - np.sqrt(away_y * away_y + away_z * away_z)
    c, s = scene.hole_axis[hole, 0], scene.hole_axis[hole, 1]
    out, _ = from_rectangle(c * away_y + s * away_z, c * away_z - s * away_y,
                            scene.hole_size[hole, 0], scene.hole_size[hole, 1], np.empty(2))
    return -out


@kernel
def _beside_hole(first, second, half, room, other):
    """Return the least distance from what is left beside a hole: its height goes first to second.

    And the room in the plane from `room` to `other`, at least.
    """
    if first * second >= 0.0:
        return _from_quadrant(room, abs(first) - half, other, abs(second) - half)
    middle = room + first / (first - second) * (other - room)
    return min(_from_quadrant(room, abs(first) - half, middle, -half),
               _from_quadrant(middle, -half, other, abs(second) - half))


@kernel
def _from_quadrant(a, b, c, d):
    """Return the least signed distance of the segment from (a, b) to (c, d) from both <= 0."""
    least = min(_corner_distance(a, b), _corner_distance(c, d))
    along, across = c - a, d - b
    if along * across < 0.0:  # else both ends are the nearest and the farthest
        foot = -(a * along + b * across) / (along * along + across * across)
        even = (b - a) / (along - across)
        for share in (foot, even):
            if 0.0 < share < 1.0:
                least = min(least, _corner_distance(a + share * along, b + share * across))
    return least


@kernel
def _corner_distance(a, b):
    """Return the signed distance of (a, b) from the quadrant where both are <= 0."""
    if a > 0.0 and b > 0.0:
        return np.sqrt(a * a + b * b)
    return max(a, b)


@kernel
def _from_plate(scene, o, p, q, shift, half):
    """Return the bound of `_bound` of the plate without holes, which is convex."""
    normal, hessian, slope, place = np.zeros(3), np.zeros((3, 3)), np.zeros(2), np.empty(3)
    values, slopes = np.empty(2), np.zeros(2)
    for end in range(2):
        for i in range(3):
            place[i] = p[i] if end == 0 else q[i]
            normal[i] = 0.0
        out, turn = from_rectangle(place[1], place[2], scene.size[o, 1], scene.size[o, 2], slope)
        place[0] += shift
        values[end] = from_faces(place, half, out, turn, slope, normal, hessian)
        for i in range(3):
            slopes[end] += normal[i] * (q[i] - p[i])
    return lowest_of_tangents(values[0], slopes[0], values[1], slopes[1])
