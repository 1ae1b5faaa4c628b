# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rotations between two frames, in kernels: SciPy's take longer than the shape in between."""

from __future__ import annotations

from typing import cast

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arc import jacobians, rotation_and_chord
from dlo_planner.ritz.matrix3 import Matrix, Vector, put_matrix, times, times_transposed


@kernel
def rotation_vector(r: Matrix) -> Vector:
    """Return the vector (3 numbers) of a rotation (9 numbers), its angle at most pi.

    By the largest component of its quaternion (Shepperd 1978), which is exact at all angles.
    """
    trace = r[0] + r[4] + r[8]
    if trace >= max(r[0], r[4], r[8]):
        x, y, z, w = r[7] - r[5], r[2] - r[6], r[3] - r[1], 1 + trace
    elif r[0] >= r[4] and r[0] >= r[8]:
        x, y, z, w = 1 - trace + 2 * r[0], r[1] + r[3], r[2] + r[6], r[7] - r[5]
    elif r[4] >= r[8]:
        x, y, z, w = r[1] + r[3], 1 - trace + 2 * r[4], r[5] + r[7], r[2] - r[6]
    else:
        x, y, z, w = r[2] + r[6], r[5] + r[7], 1 - trace + 2 * r[8], r[3] - r[1]
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    size = np.sqrt(x * x + y * y + z * z)
    if size == 0.0:
        return 0.0, 0.0, 0.0
    angle = 2 * np.arctan2(size, w) / size
    return angle * x, angle * y, angle * z


@kernel
def partway(one: Floats, other: Floats, fraction: float) -> Floats:
    """Return the frame (3, 3) at a fraction of the turn about one axis between two frames.

    Args:
        one, other: (3, 3), read-only
    """
    begin = (one[0, 0], one[0, 1], one[0, 2], one[1, 0], one[1, 1], one[1, 2],
             one[2, 0], one[2, 1], one[2, 2])
    end = (other[0, 0], other[0, 1], other[0, 2], other[1, 0], other[1, 1], other[1, 2],
           other[2, 0], other[2, 1], other[2, 2])
    x, y, z = rotation_vector(times_transposed(end, begin))
    turn, _ = rotation_and_chord(fraction * x, fraction * y, fraction * z, 1.0)
    frame = np.empty((3, 3))
    put_matrix(times(turn, begin), frame)
    return frame


def turn_between(one: Floats, other: Floats) -> Floats:
    """Return the rotation vector (3,), rad, in world axes, from one frame (3, 3) to another."""
    turn = cast(Matrix, tuple((other @ one.T).ravel().tolist()))
    return np.array(rotation_vector(turn), dtype=float)


def left_jacobian(v: Floats) -> Floats:
    """Return (3, 3) the turn of exp(v) per change of v (3,), rad (Bullo and Murray 1995)."""
    turning, _ = jacobians(float(v[0]), float(v[1]), float(v[2]), 1.0)
    return np.reshape(turning, (3, 3))
