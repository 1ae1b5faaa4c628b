# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rotations and arcs: vectors and matrices as tuples, exp, log, the left Jacobian of SO(3)."""

from __future__ import annotations

from math import factorial
from typing import TypeAlias, cast

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

# ------------------------------------------------------------------------------------------------
# Vectors (3,) and matrices (3, 3) as tuples of 3 and 9 numbers, row after row.
#
# A compiler keeps tuples in registers, where it would go to memory for every entry of an array:
# the sweeps over the elements are twice as quick with them.


Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def vector(v):
    """Return the tuple of an array (3,)."""
    return v[0], v[1], v[2]


@kernel
def matrix(m: Floats) -> Matrix:
    """Return the tuple of an array (3, 3)."""
    return m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2]


@kernel
def put_vector(v, out):
    """Fill an array (3,)."""
    out[0], out[1], out[2] = v


@kernel
def put_matrix(m, out):
    """Fill an array (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = m[0], m[1], m[2]
    out[1, 0], out[1, 1], out[1, 2] = m[3], m[4], m[5]
    out[2, 0], out[2, 1], out[2, 2] = m[6], m[7], m[8]


@kernel
def plus(a, b):
    """Return the vector a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a, b):
    """Return the vector a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def added(a, b):
    """Return the matrix a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5],
            a[6] + b[6], a[7] + b[7], a[8] + b[8])


@kernel
def subtracted(a, b):
    """Return the matrix a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5],
            a[6] - b[6], a[7] - b[7], a[8] - b[8])


@kernel
def transposed(m):
    """Return the matrix m^T."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@kernel
def inner(a, b):
    """Return the number a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    """Return the vector a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def applied(m, v):
    """Return the vector m v."""
    return (m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
            m[6] * v[0] + m[7] * v[1] + m[8] * v[2])


@kernel
def transposed_applied(m, v):
    """Return the vector m^T v."""
    return (m[0] * v[0] + m[3] * v[1] + m[6] * v[2], m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
            m[2] * v[0] + m[5] * v[1] + m[8] * v[2])


@kernel
def times(a, b):
    """Return the matrix a b."""
    return (a[0] * b[0] + a[1] * b[3] + a[2] * b[6], a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
            a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[3] + a[5] * b[6], a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
            a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[3] + a[8] * b[6], a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
            a[6] * b[2] + a[7] * b[5] + a[8] * b[8])


@kernel
def transposed_times(a, b):
    """Return the matrix a^T b."""
    return (a[0] * b[0] + a[3] * b[3] + a[6] * b[6], a[0] * b[1] + a[3] * b[4] + a[6] * b[7],
            a[0] * b[2] + a[3] * b[5] + a[6] * b[8],
            a[1] * b[0] + a[4] * b[3] + a[7] * b[6], a[1] * b[1] + a[4] * b[4] + a[7] * b[7],
            a[1] * b[2] + a[4] * b[5] + a[7] * b[8],
            a[2] * b[0] + a[5] * b[3] + a[8] * b[6], a[2] * b[1] + a[5] * b[4] + a[8] * b[7],
            a[2] * b[2] + a[5] * b[5] + a[8] * b[8])


@kernel
def times_transposed(a, b):
    """Return the matrix a b^T."""
    return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2], a[0] * b[3] + a[1] * b[4] + a[2] * b[5],
            a[0] * b[6] + a[1] * b[7] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[1] + a[5] * b[2], a[3] * b[3] + a[4] * b[4] + a[5] * b[5],
            a[3] * b[6] + a[4] * b[7] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[1] + a[8] * b[2], a[6] * b[3] + a[7] * b[4] + a[8] * b[5],
            a[6] * b[6] + a[7] * b[7] + a[8] * b[8])


@kernel
def crossed_columns(v, m):
    """Return the matrix of the vectors v x (a column of m)."""
    return (v[1] * m[6] - v[2] * m[3], v[1] * m[7] - v[2] * m[4], v[1] * m[8] - v[2] * m[5],
            v[2] * m[0] - v[0] * m[6], v[2] * m[1] - v[0] * m[7], v[2] * m[2] - v[0] * m[8],
            v[0] * m[3] - v[1] * m[0], v[0] * m[4] - v[1] * m[1], v[0] * m[5] - v[1] * m[2])


@kernel
def columns_scaled(m, w0, w1, w2):
    """Return the matrix m with its columns times three numbers."""
    return (m[0] * w0, m[1] * w1, m[2] * w2, m[3] * w0, m[4] * w1, m[5] * w2,
            m[6] * w0, m[7] * w1, m[8] * w2)


@kernel
def outer(a, b):
    """Return the matrix a b^T."""
    return (a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[0], a[1] * b[1], a[1] * b[2],
            a[2] * b[0], a[2] * b[1], a[2] * b[2])


@kernel
def rows_scaled(w, m):
    """Return the matrix m with its rows times the numbers of a vector."""
    return (w[0] * m[0], w[0] * m[1], w[0] * m[2], w[1] * m[3], w[1] * m[4], w[1] * m[5],
            w[2] * m[6], w[2] * m[7], w[2] * m[8])


@kernel
def without_trace(m):
    """Return m - trace(m) I."""
    trace = m[0] + m[4] + m[8]
    return (m[0] - trace, m[1], m[2], m[3], m[4] - trace, m[5], m[6], m[7], m[8] - trace)


# ------------------------------------------------------------------------------------------------
# One element: an arc of constant strain, integrated exactly, with its derivatives.
#
# The strain u = (torsion, curvature about n, curvature about b) is constant over the element's
# length h, so that the frame turns by the rotation vector phi = h u and the element is a helix:
#
#     Q = exp(phi^),    p = h J(phi) e1,    J(phi) = I + c1 phi^ + c2 phi^ phi^
#
# with c1 = (1 - cos a) / a^2, c2 = (a - sin a) / a^3, a = |phi|. J is the left Jacobian of SO(3)
# (Bullo and Murray 1995): a change of phi turns all that lies beyond by J dphi, in this frame.


# Below this angle^2 the closed forms lose digits (up to eight of them in the second derivatives);
# seven terms of the power series in a^2 are exact to 1e-16 there, and need no sine.
_SMALL, _TERMS = 1.0, 7
_TINY = 1.5e-2  # of the usual element, up to seven degrees: four terms are enough
_1_6, _1_24, _1_120 = 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0
_S6, _S7 = (tuple((-1.0) ** n / factorial(2 * n + k) for n in range(_TERMS)) for k in (6, 7))


@kernel
def _power_series(c, a2):
    value = ((c[3] * a2 + c[2]) * a2 + c[1]) * a2 + c[0]
    if a2 >= _TINY:
        high = ((c[6] * a2 + c[5]) * a2 + c[4]) * a2 + c[3]
        value = ((high * a2 + c[2]) * a2 + c[1]) * a2 + c[0]
    return value


@kernel(error_model='numpy', forceinline=True)
def coefficients(a2):
    """Return S1 ... S7 of the angle squared `a2`: S1 = sin a / a, S2 = c1, S3 = c2 and so on.

    These are Stumpff's functions, S_k = 1 / k! - a^2 / (k + 2)! + a^4 / (k + 4)! - ... (Danby,
    Fundamentals of Celestial Mechanics, ch. 6.9). Each follows from the next but one,
    S_k = 1 / k! - a^2 S_(k + 2), and loses no digits on the way. Their derivatives are sums of
    them: D S_k = k S_(k + 2) - S_(k + 1) with D = (1 / a) d/da.
    """
    if a2 < _SMALL:
        s6, s7 = _power_series(_S6, a2), _power_series(_S7, a2)
        s4, s5 = _1_24 - a2 * s6, _1_120 - a2 * s7
        s2, s3 = 0.5 - a2 * s4, _1_6 - a2 * s5
        return 1.0 - a2 * s3, s2, s3, s4, s5, s6, s7
    a = np.sqrt(a2)
    s1, s2 = np.sin(a) / a, 2 * (np.sin(0.5 * a) / a) ** 2
    s3, s4 = (1 - s1) / a2, (0.5 - s2) / a2
    s5, s6 = (_1_6 - s3) / a2, (_1_24 - s4) / a2
    return s1, s2, s3, s4, s5, s6, (_1_120 - s5) / a2


@kernel
def coefficients_in(row):
    """Return the tuple of an array (7,) that `put_coefficients` has filled."""
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6]


@kernel
def put_coefficients(s, out):
    """Fill an array (7,): three sweeps over the same elements need their `coefficients`."""
    out[0], out[1], out[2], out[3], out[4], out[5], out[6] = s


@kernel
def first_slopes(s):
    """Return d1 = D c1 and d2 = D c2, with D = (1 / a) d/da, of s = `coefficients`."""
    return 2 * s[3] - s[2], 3 * s[4] - s[3]


@kernel
def second_slopes(s):
    """Return D d1 and D d2, with D = (1 / a) d/da, of s = `coefficients`."""
    return s[3] - 5 * s[4] + 8 * s[5], s[4] - 7 * s[5] + 15 * s[6]


@kernel(forceinline=True)
def rotation_and_chord(x, y, z, h):
    """Return exp(phi^) (9 numbers) and h J(phi) e1 (3 numbers) for the vector phi = (x, y, z)."""
    return rotation_and_chord_with(x, y, z, h, coefficients(x * x + y * y + z * z))


@kernel(forceinline=True)
def rotation_and_chord_with(x, y, z, h, c):
    """Return what `rotation_and_chord` does, of c = `coefficients`."""
    c0, c1, c2 = c[0], c[1], c[2]
    diagonal = 1 - c1 * (x * x + y * y + z * z)
    xy, xz, yz = c1 * x * y, c1 * x * z, c1 * y * z
    turn = (diagonal + c1 * x * x, xy - c0 * z, xz + c0 * y,
            xy + c0 * z, diagonal + c1 * y * y, yz - c0 * x,
            xz - c0 * y, yz + c0 * x, diagonal + c1 * z * z)
    chord = (h * (1 - c2 * (y * y + z * z)), h * (c1 * z + c2 * x * y), h * (c2 * x * z - c1 * y))
    return turn, chord


@kernel
def jacobians(x: float, y: float, z: float, h: float) -> tuple[Matrix, Matrix]:
    """Return J(phi) and d(h J(phi) e1) / dphi, 9 numbers each, for phi = (x, y, z)."""
    return jacobians_with(x, y, z, h, coefficients(x * x + y * y + z * z))


@kernel(forceinline=True)
def jacobians_with(x, y, z, h, c):
    """Return what `jacobians` does, of c = `coefficients`."""
    c1, c2, d = c[1], c[2], first_slopes(c)
    diagonal = 1 - c2 * (x * x + y * y + z * z)
    xy, xz, yz = c2 * x * y, c2 * x * z, c2 * y * z
    rotation_jacobian = (diagonal + c2 * x * x, xy - c1 * z, xz + c1 * y,
                         xy + c1 * z, diagonal + c2 * y * y, yz - c1 * x,
                         xz - c1 * y, yz + c1 * x, diagonal + c2 * z * z)
    # chord / h = (1 - c2 (y^2 + z^2), c1 z + c2 x y, -c1 y + c2 x z)
    u0 = -d[1] * (y * y + z * z)
    u1 = d[0] * z + d[1] * x * y
    u2 = d[1] * x * z - d[0] * y
    chord_jacobian = (h * u0 * x, h * (u0 * y - 2 * c2 * y), h * (u0 * z - 2 * c2 * z),
                      h * (u1 * x + c2 * y), h * (u1 * y + c2 * x), h * (u1 * z + c1),
                      h * (u2 * x + c2 * z), h * (u2 * y - c1), h * (u2 * z + c2 * x))
    return rotation_jacobian, chord_jacobian


@kernel(forceinline=True)
def slope(x, y, z, h, force, moment, c):
    """Return (3 numbers) the derivative of a load's potential by phi = (x, y, z).

    That is J^T moment + (d(h J e1) / dphi)^T force, written out; c: `coefficients`.

    Args:
        force: (3 numbers) on the end, as derivative of the potential, in this element's frame
        moment: likewise, about that end
    """
    a2 = x * x + y * y + z * z
    c1, c2, (d1, d2) = c[1], c[2], first_slopes(c)
    b0, b1, b2 = force
    a0, a1, a_2 = moment
    along = x * b0 + y * b1 + z * b2
    # J^T a = (1 - c2 a^2) a + c1 a x phi + c2 (a . phi) phi;  b . J e1 = b0 + c1 alpha + c2 beta
    alpha = b1 * z - b2 * y
    beta = x * along - a2 * b0
    radial = c2 * (x * a0 + y * a1 + z * a_2) + h * (d1 * alpha + d2 * beta)
    own = 1 - c2 * a2
    return (own * a0 + c1 * (a1 * z - a_2 * y) + radial * x + h * c2 * (along - x * b0),
            own * a1 + c1 * (a_2 * x - a0 * z) + radial * y
            + h * (c2 * (x * b1 - 2 * y * b0) - c1 * b2),
            own * a_2 + c1 * (a0 * y - a1 * x) + radial * z
            + h * (c2 * (x * b2 - 2 * z * b0) + c1 * b1))


@kernel(forceinline=True)
def second_derivatives(x, y, z, h, force, moment, c):
    """Return (9 numbers) the second derivative of a load's potential through this one element.

    For a dead force b on the end and a moment a about it (both in this element's frame,
    as derivatives of the potential): d2/dphi2 of b . h J(phi) e1, plus the part of the rotation's
    second variation that comes from dJ/dphi, i.e. the quadratic form a . (dJ[d] d). c:
    `coefficients`.
    """
    a2 = x * x + y * y + z * z
    c2, (d1, d2), (dd1, dd2) = c[2], first_slopes(c), second_slopes(c)
    b0, b1, b2 = h * force[0], h * force[1], h * force[2]
    a0, a1, a_2 = moment
    # b . J e1 = b0 + c1 alpha + c2 beta
    alpha = b1 * z - b2 * y
    along = b0 * x + b1 * y + b2 * z
    beta = x * along - a2 * b0
    twist = a0 * x + a1 * y + a_2 * z
    own = 0.5 * (d2 * a2 + c2)
    # side: of the symmetric rank-two part, phi side^T + side phi^T
    s0 = d2 * (along - x * b0) + 0.5 * d1 * (a1 * z - a_2 * y) - own * a0
    s1 = d2 * (x * b1 - 2 * y * b0) - d1 * b2 + 0.5 * d1 * (a_2 * x - a0 * z) - own * a1
    s2 = d2 * (x * b2 - 2 * z * b0) + d1 * b1 + 0.5 * d1 * (a0 * y - a1 * x) - own * a_2
    square = dd1 * alpha + dd2 * beta + d2 * twist
    unit = d1 * alpha + d2 * beta + c2 * twist
    # and c2 (e1 b^T + b e1^T - 2 b0 I)
    xy = square * x * y + x * s1 + s0 * y + c2 * b1
    xz = square * x * z + x * s2 + s0 * z + c2 * b2
    yz = square * y * z + y * s2 + s1 * z
    across = unit - 2 * c2 * b0
    return (square * x * x + 2 * x * s0 + unit, xy, xz,
            xy, square * y * y + 2 * y * s1 + across, yz,
            xz, yz, square * z * z + 2 * z * s2 + across)


# ------------------------------------------------------------------------------------------------
# Rotations between two frames, in kernels: SciPy's take longer than the shape in between.


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


@kernel
def turns_between(one: Floats, other: Floats, fractions: Floats) -> Floats:
    """Return (n, 3, 3) what `partway` does at n fractions."""
    frames = np.empty((fractions.size, 3, 3))
    for k in range(fractions.size):
        frames[k] = partway(one, other, fractions[k])
    return frames


def turn_between(one: Floats, other: Floats) -> Floats:
    """Return the rotation vector (3,), rad, in world axes, from one frame (3, 3) to another."""
    turn = cast(Matrix, tuple((other @ one.T).ravel().tolist()))
    return np.array(rotation_vector(turn), dtype=float)


def left_jacobian(v: Floats) -> Floats:
    """Return (3, 3) the turn of exp(v) per change of v (3,), rad (Bullo and Murray 1995)."""
    turning, _ = jacobians(float(v[0]), float(v[1]), float(v[2]), 1.0)
    return np.reshape(turning, (3, 3))
