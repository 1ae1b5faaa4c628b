# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Frequencies of beams, plane rods and parts of rings, by Ritz on polynomials.

Displacements, or the angle of a plane rod, are the unknowns: nothing of the package is used.
"""

import numpy as np
from numpy.polynomial import Legendre
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.linalg import eigh, null_space

G = 9.81
TERMS = 14
GAUSS, WEIGHT = np.polynomial.legendre.leggauss(60)


def polynomials(x, power, derivative, terms=TERMS):
    """Return (n, terms): derivatives of x^power P_j(2 x - 1), zero with their first ones at 0."""
    along = (Legendre([0, 1], [0, 1]) + 1) / 2  # x itself
    basis = [along**power * Legendre.basis(j, [0, 1]) for j in range(terms)]
    return np.array([(one.deriv(derivative) if derivative else one)(x) for one in basis]).T


def slowest(mass, stiffness, n):
    """Return the n lowest frequencies, Hz."""
    mu = eigh(mass, stiffness, eigvals_only=True)[::-1]
    return 1 / np.sqrt(mu[:n]) / (2 * np.pi)


def beam_frequencies(n, tension=lambda x: 0 * x, tip=0.0, stiffness=1.0, mass=0.1, held=None,
                     power=2):
    """Return frequencies of a beam of 1 m: EI v''^2 + T v'^2 against mass v'^2, by Ritz.

    `held(v, derivatives)` returns rows that vanish; `power` 2: clamped at 0, 1: pinned.
    """
    x, w = 0.5 * (GAUSS + 1), 0.5 * WEIGHT
    v, slope, bend = (polynomials(x, power, k) for k in range(3))
    K = (bend.T * w * stiffness) @ bend + (slope.T * w * tension(x)) @ slope
    end = polynomials(np.array([1.0]), power, 0)
    M = (v.T * w * mass) @ v + tip * end.T @ end
    if held is not None:
        free = null_space(np.vstack([polynomials(np.array([at]), power, k) for at, k in held]))
        K, M = free.T @ K @ free, free.T @ M @ free
    return slowest(M, K, n)


def plane_rod(angle, mass, stiffness, tip, n):
    """Return frequencies, Hz, in the plane of a rod of 1 m clamped at an angle over the level.

    Unknown is the angle along s, on polynomials; found by Newton's method, from the level on.
    """
    s = np.linspace(0, 1, 4001)
    shape, slope = polynomials(s, 1, 0), polynomials(s, 1, 1)
    weight = G * (mass * (1 - s) + tip)
    elastic = trapezoid(slope[:, :, None] * slope[:, None] * stiffness, s, axis=0)
    a = np.zeros(TERMS)
    for share in np.linspace(0.1, 1, 10):
        for _ in range(8):
            theta = angle + shape @ a
            force = elastic @ a + trapezoid((share * weight * np.cos(theta))[:, None] * shape, s,
                                            axis=0)
            K = elastic - trapezoid((share * weight * np.sin(theta))[:, None, None]
                                    * shape[:, :, None] * shape[:, None], s, axis=0)
            a = a - np.linalg.solve(K, force)
    moved = [cumulative_trapezoid(one(theta)[:, None] * shape, s, axis=0, initial=0)
             for one in (np.sin, np.cos)]
    M = sum(mass * trapezoid(one[:, :, None] * one[:, None], s, axis=0)
            + tip * np.outer(one[-1], one[-1]) for one in moved)
    return slowest(M, K, n)


def ring(opening, radius, stiffness, torsion, mass, n):
    """Return frequencies in and out of the plane of a ring's part, clamped at one end (Love).

    Displacements u along, w = -u' outwards, v across, and twist b:
    bends (w + w'') / R^2 and b / R - v'' / R^2, torsion (b' + v' / R) / R, primes by the angle.
    """
    phi, w = 0.5 * opening * (GAUSS + 1), 0.5 * opening * WEIGHT * radius
    u = [polynomials(phi / opening, 3, k) / opening**k for k in range(4)]
    bend = -(u[1] + u[3]) / radius**2
    inside = slowest(sum(mass * (one.T * w) @ one for one in u[:2]),
                     stiffness[0] * (bend.T * w) @ bend, n)
    v = [polynomials(phi / opening, 2, k) / opening**k for k in range(3)]
    b = [polynomials(phi / opening, 1, k) / opening**k for k in range(2)]
    none = np.zeros_like(b[0])
    across = np.hstack([-v[2] / radius**2, b[0] / radius])
    twist = np.hstack([v[1] / radius**2, b[1] / radius])
    still = np.hstack([v[0], none])
    K = stiffness[1] * (across.T * w) @ across + torsion * (twist.T * w) @ twist
    return inside, slowest(mass * (still.T * w) @ still, K, n)
