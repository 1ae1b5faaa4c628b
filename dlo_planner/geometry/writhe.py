# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How often a curve is wound about itself: its writhe, and with its twist its link.

The link of a closed ribbon is its twist plus its writhe (Calugareanu 1959, White 1969, Fuller
1971), and no motion changes it but one in which the ribbon passes through itself: by 2 each time,
for the crossing of two strands turns from -1 to 1. A DLO between two grips is closed by what holds
it: as far as the grips turn, so does the link; what they do not account for is a passage, of the
DLO through itself or through what closes it. Which one, other closures tell: it does not pass
through all of them at once.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_FAR = 1e7       # lengths that a DLO goes straight on at its ends: 1 / _FAR of a turn is left out
_FLAT = 1e-28    # of the square of an area: what is smaller spans no angle


@kernel
def writhe(points: Floats, closed: bool) -> float:
    """Return the writhe of the open polygon through points (n, 3).

    Pairs of chords add the solid angle under which they are seen to cross: method 1a of Klenin and
    Langowski 2000, exact for polygons. What lies in a plane has none. Where it is `closed` by its
    first chord and its last these do not count as a pair.
    """
    total, n = 0.0, points.shape[0] - 1
    for i in range(n):
        for j in range(i + 2, n):
            if closed and i == 0 and j == n - 1:
                continue
            total += _crossing(points[i], points[i + 1], points[j], points[j + 1])
    return total / (2.0 * np.pi)


@kernel
def link(lengths: Floats, strains: Floats, frames: Floats, positions: Floats,
         tilt: float) -> float:
    """Return twist plus writhe, in turns, of a DLO that goes straight on from both its ends.

    Or leaves them at an angle `tilt`, rad, towards its first normal. It is that of the polygon of
    the elements' chords, with the material frames in their middles: so it is kept exactly, however
    large elements are. How both straight ends are seen to cross each other is left out: it changes
    with the grips, by 2 where these ends pass through each other, which nothing of the DLO does.

    Args:
        lengths: (N,) m; strains: (N, 3) 1/m; frames: (N + 1, 3, 3); positions: (N + 1, 3) m
    """
    n, length = lengths.size, np.sum(lengths)
    points, along, beside = np.empty((n + 3, 3)), np.empty((n + 2, 3)), np.empty((n + 2, 3))
    rotation, place = np.empty((3, 3)), np.empty(3)
    points[1:n + 2] = positions
    c, s = np.cos(tilt), np.sin(tilt)
    for i in range(3):
        for k, end in ((0, 0), (n + 1, n)):
            along[k, i] = c * frames[end, i, 0] + s * frames[end, i, 1]
            beside[k, i] = c * frames[end, i, 1] - s * frames[end, i, 0]
        points[0, i] = positions[0, i] - _FAR * length * along[0, i]
        points[n + 2, i] = positions[n, i] + _FAR * length * along[n + 1, i]
    for e in range(n):
        point_inside(lengths, strains, frames, positions, e, 0.5, rotation, place)
        _put_directions(positions[e], positions[e + 1], rotation, along[e + 1], beside[e + 1])
    twist = 0.0
    for k in range(n + 1):
        expected = 0.0  # turns of an angle do not show in what it does
        for e in (k - 1, k):
            if 0 <= e < n:
                expected += 0.5 * lengths[e] * strains[e, 0]
        angle = _twist(along[k], along[k + 1], beside[k], beside[k + 1])
        twist += angle + 2.0 * np.pi * np.round((expected - angle) / (2.0 * np.pi))
    return twist / (2.0 * np.pi) + writhe(points, True)


@kernel
def _put_directions(begin, end, rotation, along, beside):
    """Fill the direction of a chord, and of a frame's normal across it."""
    square = inside = size = 0.0
    for i in range(3):
        along[i] = end[i] - begin[i]
        square += along[i] * along[i]
    for i in range(3):
        along[i] /= np.sqrt(square)
        inside += along[i] * rotation[i, 1]
    for i in range(3):
        beside[i] = rotation[i, 1] - inside * along[i]
        size += beside[i] * beside[i]
    for i in range(3):
        beside[i] /= np.sqrt(size)


@kernel
def _twist(u, v, d, e):
    """Return the angle, rad, from d across u to e across v, beside the least turn of u to v."""
    dv = uv = cosine = sine = 0.0
    for i in range(3):
        dv += d[i] * v[i]
        uv += u[i] * v[i]
    turned = np.empty(3)
    for i in range(3):
        turned[i] = d[i] - dv / (1.0 + uv) * (u[i] + v[i])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        cosine += turned[i] * e[i]
        sine += v[i] * (turned[j] * e[k] - turned[k] * e[j])
    return np.arctan2(sine, cosine)


@kernel
def _crossing(a, b, c, d):
    """Return the solid angle from which chord a b crosses chord c d, signed as they cross."""
    ac, ad, bc, bd = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        ac[i], ad[i], bc[i], bd[i] = c[i] - a[i], d[i] - a[i], c[i] - b[i], d[i] - b[i]
    one, two, three, four = (_normal(ac, ad), _normal(ad, bd), _normal(bd, bc), _normal(bc, ac))
    if one[3] == 0.0 or two[3] == 0.0 or three[3] == 0.0 or four[3] == 0.0:
        return 0.0
    angle = _sine(one, two) + _sine(two, three) + _sine(three, four) + _sine(four, one)
    sign = 0.0  # of (d - c) x (b - a) . (c - a)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        sign += ((d[j] - c[j]) * (b[k] - a[k]) - (d[k] - c[k]) * (b[j] - a[j])) * ac[i]
    return angle if sign > 0.0 else -angle if sign < 0.0 else 0.0


@kernel
def _normal(u, v):
    """Return the unit vector across two vectors, and whether there is one (1, else 0)."""
    x, y, z = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    square = x * x + y * y + z * z
    uu, vv = u[0] * u[0] + u[1] * u[1] + u[2] * u[2], v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if not square > _FLAT * uu * vv:
        return 0.0, 0.0, 0.0, 0.0
    size = np.sqrt(square)
    return x / size, y / size, z / size, 1.0


@kernel
def _sine(one, other):
    """Return the angle whose sine is the product of two unit vectors."""
    return np.arcsin(min(1.0, max(-1.0, one[0] * other[0] + one[1] * other[1]
                                  + one[2] * other[2])))
