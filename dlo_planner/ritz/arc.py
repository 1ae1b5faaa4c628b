# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One element: an arc of constant strain, integrated exactly, with its derivatives.

The strain u = (torsion, curvature about n, curvature about b) is constant over the element's
length h, so that the frame turns by the rotation vector phi = h u and the element is a helix:

    Q = exp(phi^),    p = h J(phi) e1,    J(phi) = I + c1 phi^ + c2 phi^ phi^

with c1 = (1 - cos a) / a^2, c2 = (a - sin a) / a^3, a = |phi|. J is the left Jacobian of SO(3)
(Bullo and Murray 1995): a change of phi turns all that lies beyond by J dphi, in this frame.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.matrix3 import Matrix, Vector

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
def slope(x: float, y: float, z: float, h: float, force: Vector, moment: Vector) -> Vector:
    """Return (3 numbers) the derivative of a load's potential by phi = (x, y, z).

    That is J^T moment + (d(h J e1) / dphi)^T force, written out.

    Args:
        force: (3 numbers) on the far end, as derivative of the potential, in this element's frame
        moment: likewise, about that end
    """
    return slope_with(x, y, z, h, force, moment, coefficients(x * x + y * y + z * z))


@kernel(forceinline=True)
def slope_with(x, y, z, h, force, moment, c):
    """Return what `slope` does, of c = `coefficients`."""
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


@kernel
def second_derivatives(x, y, z, h, force, moment):
    """Return (9 numbers) the second derivative of a load's potential through this one element.

    For a dead force b on the far end and a moment a about it (both in this element's frame,
    as derivatives of the potential): d2/dphi2 of b . h J(phi) e1, plus the part of the rotation's
    second variation that comes from dJ/dphi, i.e. the quadratic form a . (dJ[d] d).
    """
    c = coefficients(x * x + y * y + z * z)
    return second_derivatives_with(x, y, z, h, force, moment, c)


@kernel(forceinline=True)
def second_derivatives_with(x, y, z, h, force, moment, c):
    """Return what `second_derivatives` does, of c = `coefficients`."""
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


@kernel
def dot(a, b):
    """Return the product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
