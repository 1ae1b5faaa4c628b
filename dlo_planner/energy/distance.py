# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a point is from an obstacle: signed distance with its first and second derivatives."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.scene import BOX, CAPSULE, CYLINDER, PLANE, SPHERE, Scene
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_CENTER = 1e-12  # of a radius: so near to the middle, no direction leads out


@kernel
def signed_distance(scene: Scene, o: int, x: Floats, normal: Floats, hessian: Floats) -> float:
    """Return the distance in m of the world point x (3,) from obstacle `o`, negative inside.

    Fills normal (3,), its gradient, and hessian (3, 3), its second derivative, in 1/m.
    """
    axes = scene.axes[o]
    kind = scene.kind[o]
    v = np.empty(3)
    for i in range(3):
        v[i] = x[i] - scene.center[o, i]
    p = np.empty(3)
    for i in range(3):
        p[i] = axes[0, i] * v[0] + axes[1, i] * v[1] + axes[2, i] * v[2]
    local, curved = np.zeros(3), np.zeros((3, 3))
    if kind == PLANE:
        local[0] = 1.0
        distance = p[0]
    elif kind in (SPHERE, CAPSULE):
        distance = _from_axis(p, scene.size[o, 0], scene.size[o, 2], local, curved)
    elif kind == BOX:
        distance = _from_box(p, scene.size[o], local, curved)
    elif kind == CYLINDER:
        distance = _from_cylinder(p, scene.size[o, 0], scene.size[o, 1], local, curved)
    else:
        distance = _from_sheet(scene, o, p, local, curved)
    for i in range(3):
        normal[i] = axes[i, 0] * local[0] + axes[i, 1] * local[1] + axes[i, 2] * local[2]
    if kind == PLANE:
        hessian[:] = 0.0
    else:
        for i in range(3):
            for k in range(3):
                v[k] = axes[i, 0] * curved[0, k] + axes[i, 1] * curved[1, k] + (
                    axes[i, 2] * curved[2, k])
            for j in range(3):
                hessian[i, j] = axes[j, 0] * v[0] + axes[j, 1] * v[1] + axes[j, 2] * v[2]
    return distance


@kernel
def _from_axis(p, half, radius, normal, hessian):
    """Distance from a capsule along x (half = 0: a sphere)."""
    beyond = abs(p[0]) - half
    sign = 1.0 if p[0] >= 0 else -1.0
    along = sign * beyond if beyond > 0 or half == 0.0 else 0.0
    rho = np.sqrt(along * along + p[1] * p[1] + p[2] * p[2])
    if rho <= _CENTER * radius:
        normal[2] = 1.0
        return -radius
    normal[0], normal[1], normal[2] = along / rho, p[1] / rho, p[2] / rho
    first = 0 if beyond > 0 or half == 0.0 else 1
    for i in range(first, 3):
        for j in range(first, 3):
            hessian[i, j] = ((i == j) - normal[i] * normal[j]) / rho
    return rho - radius


@kernel
def _from_box(p, half, normal, hessian):
    outside = 0.0
    deepest = 0
    for i in range(3):
        if abs(p[i]) - half[i] > abs(p[deepest]) - half[deepest]:
            deepest = i
        if abs(p[i]) > half[i]:
            outside += (abs(p[i]) - half[i]) ** 2
    if outside == 0.0:
        normal[deepest] = 1.0 if p[deepest] >= 0 else -1.0
        return abs(p[deepest]) - half[deepest]
    distance = np.sqrt(outside)
    for i in range(3):
        if abs(p[i]) > half[i]:
            normal[i] = (abs(p[i]) - half[i]) / distance * (1.0 if p[i] >= 0 else -1.0)
    for i in range(3):
        for j in range(3):
            if abs(p[i]) > half[i] and abs(p[j]) > half[j]:
                hessian[i, j] = ((i == j) - normal[i] * normal[j]) / distance
    return distance


@kernel
def _from_sheet(scene, o, p, normal, hessian):
    """Distance from a plate with holes."""
    slope = np.zeros(2)
    a, turn = in_plane(scene, o, p[1], p[2], slope)
    return _from_faces(p, scene.size[o, 0], a, turn, slope, normal, hessian)


@kernel
def _from_cylinder(p, half, radius, normal, hessian):
    """Distance from a cylinder along x with flat ends."""
    slope = np.zeros(2)
    rho = np.sqrt(p[1] * p[1] + p[2] * p[2])
    turn = 0.0
    if rho <= _CENTER * radius:
        slope[1] = 1.0
    else:
        turn = 1.0 / rho
        slope[0], slope[1] = p[1] * turn, p[2] * turn
    return _from_faces(p, half, rho - radius, turn, slope, normal, hessian)


@kernel
def _from_faces(p, half, a, turn, slope, normal, hessian):
    """Distance from what lies between two faces `half` above and below: in the plane (a), both.

    Args:
        a: distance in the plane, its gradient `slope` (2,) and its curvature `turn`
    """
    side = 1.0 if p[0] >= 0 else -1.0
    b = abs(p[0]) - half
    if a > 0 and b > 0:
        d = np.sqrt(a * a + b * b)
        normal[0], normal[1], normal[2] = side * b / d, a / d * slope[0], a / d * slope[1]
        m0, m1, m2 = -side * a / d, b / d * slope[0], b / d * slope[1]
        hessian[0, 0] = m0 * m0 / d
        hessian[0, 1] = hessian[1, 0] = m0 * m1 / d
        hessian[0, 2] = hessian[2, 0] = m0 * m2 / d
        _add_turn(hessian, slope, turn * a / d)
        hessian[1, 1] += m1 * m1 / d
        hessian[1, 2] += m1 * m2 / d
        hessian[2, 1] += m1 * m2 / d
        hessian[2, 2] += m2 * m2 / d
        return d
    if b > 0 or (a <= 0 and b >= a):
        normal[0] = side
        return b
    normal[1], normal[2] = slope[0], slope[1]
    _add_turn(hessian, slope, turn)
    return a


@kernel
def _add_turn(hessian, slope, amount):
    hessian[1, 1] += amount * slope[1] * slope[1]
    hessian[2, 2] += amount * slope[0] * slope[0]
    hessian[1, 2] -= amount * slope[0] * slope[1]
    hessian[2, 1] -= amount * slope[0] * slope[1]


@kernel
def in_plane(scene, o, y, z, slope):
    """Return how far (y, z) is outside the sheet's material (in a hole, or beyond its border).

    Fills slope (2,), the gradient; also returns the curvature of that distance, 1/m.
    """
    a, turn = _from_rectangle(y, z, scene.size[o, 1], scene.size[o, 2], slope)
    other = np.empty(2)
    for hole in range(scene.hole_of.size):
        if scene.hole_of[hole] != o:
            continue
        away_y, away_z = y - scene.hole_center[hole, 0], z - scene.hole_center[hole, 1]
        if scene.hole_size[hole, 1] < 0:
            rho = max(np.sqrt(away_y * away_y + away_z * away_z),
                      _CENTER * scene.hole_size[hole, 0])
            inside = scene.hole_size[hole, 0] - rho
            if inside > a:
                a, turn = inside, -1.0 / rho
                slope[0], slope[1] = -away_y / rho, -away_z / rho
        else:
            c, s = scene.hole_axis[hole, 0], scene.hole_axis[hole, 1]
            outside, curved = _from_rectangle(c * away_y + s * away_z, c * away_z - s * away_y,
                                              scene.hole_size[hole, 0], scene.hole_size[hole, 1],
                                              other)
            if -outside > a:
                a, turn = -outside, -curved
                slope[0], slope[1] = s * other[1] - c * other[0], -s * other[0] - c * other[1]
    return a, turn


@kernel
def _from_rectangle(y, z, half_y, half_z, slope):
    b, c = abs(y) - half_y, abs(z) - half_z
    sign_y = 1.0 if y >= 0 else -1.0
    sign_z = 1.0 if z >= 0 else -1.0
    if b > 0 and c > 0:
        d = np.sqrt(b * b + c * c)
        slope[0], slope[1] = sign_y * b / d, sign_z * c / d
        return d, 1.0 / d
    if b >= c:
        slope[0], slope[1] = sign_y, 0.0
        return b, 0.0
    slope[0], slope[1] = 0.0, sign_z
    return c, 0.0
