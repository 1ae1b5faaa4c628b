# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a grip is and how it moves on a spline through its poses, in a kernel."""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


@kernel
def along_spline(cubics: Floats, count: int, dt: float, places: Floats, frames: Floats,
                 centers: Floats) -> tuple[Floats, Floats, Floats]:
    """Return rotations (k, 3, 3), positions (k, 3), twists (k, 6) at `places` (k,).

    Args:
        cubics: (4, n - 1, 7) their coefficients, highest first, of position and quaternion; the
            latter has any size
        count: n poses, at the places 0, 1, 2 ...; dt: s between them
        frames, centers: (n, 3, 3), (n, 3) of the poses
    """
    rotations, positions = np.empty((places.size, 3, 3)), np.empty((places.size, 3))
    twists = np.empty((places.size, 6))
    value, rate = np.empty(7), np.empty(7)
    for k in range(places.size):
        nearest = int(np.rint(places[k]))
        _fill_cubic(cubics, count, places[k], dt, value, rate)
        _fill_twist(value, rate, twists[k])
        if places[k] == nearest and 0 <= nearest < count:
            for i in range(3):
                positions[k, i] = centers[nearest, i]
                for j in range(3):
                    rotations[k, i, j] = frames[nearest, i, j]
        else:
            for i in range(3):
                positions[k, i] = value[i]
            _fill_rotation(value, rotations[k])
    return rotations, positions, twists


@kernel
def _fill_cubic(cubics: Floats, count: int, place: float, dt: float, value: Floats,
                rate: Floats) -> None:
    """Fill value (7,) and rate (7,), 1/s, of the spline at a place, beyond its ends too."""
    piece = min(max(int(np.floor(place)), 0), count - 2)
    x = place - piece
    for i in range(7):
        a, b, c, d = (cubics[0, piece, i], cubics[1, piece, i], cubics[2, piece, i],
                      cubics[3, piece, i])
        value[i] = ((a * x + b) * x + c) * x + d
        rate[i] = ((3 * a * x + 2 * b) * x + c) / dt


@kernel
def _fill_twist(value: Floats, rate: Floats, twist: Floats) -> None:
    """Fill (6,) velocity and angular velocity, world, of a pose (7,) and its rate (7,)."""
    x, y, z, w = value[3], value[4], value[5], value[6]
    a, b, c, d = rate[3], rate[4], rate[5], rate[6]
    half = 0.5 * (x * x + y * y + z * z + w * w)
    for i in range(3):
        twist[i] = rate[i]
    twist[3] = (w * a - d * x + y * c - z * b) / half
    twist[4] = (w * b - d * y + z * a - x * c) / half
    twist[5] = (w * c - d * z + x * b - y * a) / half


@kernel
def _fill_rotation(value: Floats, rotation: Floats) -> None:
    """Fill (3, 3) of the quaternion, of any size, in a pose (7,) (Diebel 2006, eq. 125)."""
    x, y, z, w = value[3], value[4], value[5], value[6]
    s = 1 / (x * x + y * y + z * z + w * w)
    rotation[0, 0] = s * (x * x - y * y - z * z + w * w)
    rotation[1, 1] = s * (y * y - x * x - z * z + w * w)
    rotation[2, 2] = s * (z * z - x * x - y * y + w * w)
    rotation[0, 1], rotation[1, 0] = 2 * s * (x * y - z * w), 2 * s * (x * y + z * w)
    rotation[0, 2], rotation[2, 0] = 2 * s * (x * z + y * w), 2 * s * (x * z - y * w)
    rotation[1, 2], rotation[2, 1] = 2 * s * (y * z - x * w), 2 * s * (y * z + x * w)
