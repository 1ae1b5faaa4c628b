"""One element: an arc of constant strain, integrated exactly, with its derivatives.

The strain u = (torsion, curvature about n, curvature about b) is constant over the element's
length h, so that the frame turns by the rotation vector phi = h u and the element is a helix:

    Q = exp(phi^),    p = h J(phi) e1,    J(phi) = I + c1 phi^ + c2 phi^ phi^

with c1 = (1 - cos a) / a^2, c2 = (a - sin a) / a^3, a = |phi|. J is the left Jacobian of SO(3)
(Bullo and Murray 1995): a change of phi turns all that lies beyond by J dphi, in this frame.
"""

from math import factorial

import numpy as np

from dlo_planner.kernels import kernel

# Below this angle^2 the closed forms lose digits (up to eight of them in the second derivatives);
# ten terms of the power series in a^2 are exact to 1e-17 there, and need no sine.
_SMALL, _TERMS = 1.0, 10
_TINY, _TERMS_OF_TINY = 4e-3, 5  # the usual element: a few degrees


def _series():
    """Return (7, _TERMS) coefficients of a^(2k) in c0, c1, c2, d1, d2, dd1, dd2."""
    k = np.arange(_TERMS + 2)
    rows = [[(-1.0) ** n / factorial(2 * n + m) for n in k] for m in (1, 2, 3)]
    slope = [[2 * (n + 1) * row[n + 1] for n in k[:-1]] for row in rows[1:]]
    bend = [[2 * (n + 1) * row[n + 1] for n in k[:-2]] for row in slope]
    return np.array([row[:_TERMS] for row in rows + slope + bend])


_SERIES = _series()


@kernel
def _power_series(row, a2):
    last = _TERMS_OF_TINY - 1 if a2 < _TINY else _TERMS - 1
    total = _SERIES[row, last]
    for k in range(last - 1, -1, -1):
        total = total * a2 + _SERIES[row, k]
    return total


@kernel
def coefficients(a2):
    """Return c0 = sin a / a, c1, c2 of the angle squared `a2`."""
    if a2 < _SMALL:
        return _power_series(0, a2), _power_series(1, a2), _power_series(2, a2)
    a = np.sqrt(a2)
    c0 = np.sin(a) / a
    return c0, 2 * (np.sin(0.5 * a) / a) ** 2, (1 - c0) / a2


@kernel
def first_slopes(a2, c0, c1, c2):
    """Return d1 = D c1 and d2 = D c2, with D = (1 / a) d/da."""
    if a2 < _SMALL:
        return _power_series(3, a2), _power_series(4, a2)
    return (c0 - 2 * c1) / a2, (c1 - 3 * c2) / a2


@kernel
def second_slopes(a2, c1, c2, d1, d2):
    """Return D d1 and D d2, with D = (1 / a) d/da."""
    if a2 < _SMALL:
        return _power_series(5, a2), _power_series(6, a2)
    # D c0 = c2 - c1 follows from c0 = 1 - a^2 c2 and the lines above
    return (c2 - c1 - 4 * d1) / a2, (d1 - 5 * d2) / a2


@kernel
def rotation_and_chord(phi0, phi1, phi2, h, turn, chord):
    """Fill turn (3, 3) = exp(phi^) and chord (3,) = h J(phi) e1 for the vector phi."""
    a2 = phi0 * phi0 + phi1 * phi1 + phi2 * phi2
    c0, c1, c2 = coefficients(a2)
    diagonal = 1 - c1 * a2
    turn[0, 0] = diagonal + c1 * phi0 * phi0
    turn[1, 1] = diagonal + c1 * phi1 * phi1
    turn[2, 2] = diagonal + c1 * phi2 * phi2
    turn[0, 1] = c1 * phi0 * phi1 - c0 * phi2
    turn[1, 0] = c1 * phi0 * phi1 + c0 * phi2
    turn[0, 2] = c1 * phi0 * phi2 + c0 * phi1
    turn[2, 0] = c1 * phi0 * phi2 - c0 * phi1
    turn[1, 2] = c1 * phi1 * phi2 - c0 * phi0
    turn[2, 1] = c1 * phi1 * phi2 + c0 * phi0
    chord[0] = h * (1 - c2 * (phi1 * phi1 + phi2 * phi2))
    chord[1] = h * (c1 * phi2 + c2 * phi0 * phi1)
    chord[2] = h * (-c1 * phi1 + c2 * phi0 * phi2)


@kernel
def jacobians(phi, h, turning, shifting):
    """Fill turning (3, 3) = J(phi) and shifting (3, 3) = d(h J(phi) e1) / dphi."""
    x, y, z = phi[0], phi[1], phi[2]
    a2 = x * x + y * y + z * z
    c0, c1, c2 = coefficients(a2)
    d1, d2 = first_slopes(a2, c0, c1, c2)
    diagonal = 1 - c2 * a2
    turning[0, 0] = diagonal + c2 * x * x
    turning[1, 1] = diagonal + c2 * y * y
    turning[2, 2] = diagonal + c2 * z * z
    turning[0, 1] = c2 * x * y - c1 * z
    turning[1, 0] = c2 * x * y + c1 * z
    turning[0, 2] = c2 * x * z + c1 * y
    turning[2, 0] = c2 * x * z - c1 * y
    turning[1, 2] = c2 * y * z - c1 * x
    turning[2, 1] = c2 * y * z + c1 * x
    # chord / h = (1 - c2 (y^2 + z^2), c1 z + c2 x y, -c1 y + c2 x z)
    across = y * y + z * z
    for j in range(3):
        shifting[0, j] = -h * d2 * across * phi[j]
        shifting[1, j] = h * (d1 * z + d2 * x * y) * phi[j]
        shifting[2, j] = h * (-d1 * y + d2 * x * z) * phi[j]
    shifting[0, 1] -= 2 * h * c2 * y
    shifting[0, 2] -= 2 * h * c2 * z
    shifting[1, 0] += h * c2 * y
    shifting[1, 1] += h * c2 * x
    shifting[1, 2] += h * c1
    shifting[2, 0] += h * c2 * z
    shifting[2, 1] -= h * c1
    shifting[2, 2] += h * c2 * x


@kernel
def add_second_derivatives(phi, h, force, moment, out):
    """Add to out (3, 3) the second derivative of a load's potential through this one element.

    For a dead force b on the far end and a moment a about it (both in this element's frame,
    as derivatives of the potential): d2/dphi2 of b . h J(phi) e1, plus the part of the rotation's
    second variation that comes from dJ/dphi, i.e. the quadratic form a . (dJ[d] d).
    """
    x, y, z = phi[0], phi[1], phi[2]
    a2 = x * x + y * y + z * z
    c0, c1, c2 = coefficients(a2)
    d1, d2 = first_slopes(a2, c0, c1, c2)
    dd1, dd2 = second_slopes(a2, c1, c2, d1, d2)
    b0, b1, b2 = h * force[0], h * force[1], h * force[2]
    # b . J e1 = b0 + c1 alpha + c2 beta
    alpha = b1 * z - b2 * y
    along = b0 * x + b1 * y + b2 * z
    beta = x * along - a2 * b0
    twist = moment[0] * x + moment[1] * y + moment[2] * z
    m0 = moment[1] * z - moment[2] * y  # moment x phi
    m1 = moment[2] * x - moment[0] * z
    m2 = moment[0] * y - moment[1] * x
    grad_alpha = (0.0, -b2, b1)
    grad_beta = (along + x * b0 - 2 * x * b0, x * b1 - 2 * y * b0, x * b2 - 2 * z * b0)
    # rows of the symmetric rank-two parts that multiply phi
    side = (d1 * grad_alpha[0] + d2 * grad_beta[0]
            + 0.5 * (d1 * m0 - (d2 * a2 + c2) * moment[0]),
            d1 * grad_alpha[1] + d2 * grad_beta[1]
            + 0.5 * (d1 * m1 - (d2 * a2 + c2) * moment[1]),
            d1 * grad_alpha[2] + d2 * grad_beta[2]
            + 0.5 * (d1 * m2 - (d2 * a2 + c2) * moment[2]))
    square = dd1 * alpha + dd2 * beta + d2 * twist
    unit = d1 * alpha + d2 * beta + c2 * twist
    for i in range(3):
        for j in range(3):
            out[i, j] += square * phi[i] * phi[j] + phi[i] * side[j] + side[i] * phi[j]
        out[i, i] += unit
    # c2 (e1 b^T + b e1^T - 2 b0 I)
    out[0, 1] += c2 * b1
    out[1, 0] += c2 * b1
    out[0, 2] += c2 * b2
    out[2, 0] += c2 * b2
    out[1, 1] -= 2 * c2 * b0
    out[2, 2] -= 2 * c2 * b0


@kernel
def dot(a, b):
    """Return the product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
