# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Buckling of twisted rods and of arches by SciPy alone; lengths in those of the rod, EI = 1."""

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre
from scipy.integrate import solve_bvp
from scipy.linalg import eigh


def moment_that_buckles(tension, terms=14):
    """Return M L / EI at which a straight rod buckles, both ends clamped, one free to slide.

    Ritz in the deflection w = y + i z: EI |w''|^2 + T |w'|^2 against M Im(w'' conj(w')).
    """
    nodes, weights = legendre.leggauss(80)
    s, weights = 0.5 * (nodes + 1), 0.5 * weights
    clamped = Polynomial([0, 0, 1]) * Polynomial([1, -1])**2
    base = [clamped * Legendre.basis(k, domain=[0, 1]).convert(kind=Polynomial)
            for k in range(terms)]
    slope, bend = (np.array([one.deriv(order)(s) for one in base]) for order in (1, 2))
    stiff = bend @ (weights[:, None] * bend.T) + tension * slope @ (weights[:, None] * slope.T)
    turn = slope @ (weights[:, None] * bend.T)
    return 1 / eigh(0.5j * (turn - turn.T), stiff, eigvals_only=True).max()


def _shallow(root, slack):
    """Return clamp angle and (c, s, 1) coefficients of a shallow arch under the force root^2."""
    rows = np.array([[1, 0, 1], [np.cos(root), np.sin(root), 1],
                     [np.sin(root) / root, (1 - np.cos(root)) / root, 1]])
    found = np.linalg.solve(rows, [1, 0, 0])
    s, weights = legendre.leggauss(40)
    angle = _angles(root, found, 0.5 * (s + 1))
    return np.sqrt(2 * slack / (0.5 * weights @ angle**2)), found


def _angles(root, found, s):
    return found[0] * np.cos(root * s) + found[1] * np.sin(root * s) + found[2]


def arch_that_snaps(slack):
    """Return the clamp's angle (rad) at which an arch between level clamps snaps through.

    One clamp turns against the arch, the other one stays. The elastica's branch is followed by
    the force along the arch, from the shallow arch on; its angle has a maximum, the fold.
    """
    s, root = np.linspace(0, 1, 101), 7.0
    angle, found = _shallow(root, slack)
    theta = angle * _angles(root, found, s)
    step = s[1]
    y = np.array([np.append(0, np.cumsum((one[1:] + one[:-1]) * 0.5 * step))
                  for one in (np.cos(theta), np.sin(theta))] + [theta, np.gradient(theta, s)])
    p, forces, angles = np.array([angle * found[2] * root**2, angle]), [], []
    while len(angles) < 3 or not angles[-1] < angles[-2] < angles[-3]:
        force = root**2 + len(angles)
        solved = solve_bvp(
            lambda _, y, p, force=force: [np.cos(y[2]), np.sin(y[2]), y[3],
                                          p[0] * np.cos(y[2]) - force * np.sin(y[2])],
            lambda a, b, p: np.array([a[0], a[1], a[2] - p[1], b[0] - 1 + slack, b[1], b[2]]),
            s, y, p, tol=1e-8, max_nodes=20_000)
        assert solved.success, solved.message
        y, p = solved.sol(s), solved.p
        forces.append(force)
        angles.append(p[1])
    top = np.polyfit(np.array(forces[-5:]) - forces[-3], angles[-5:], 4)
    at = np.roots(np.polyder(top))
    at = at[np.abs(at.imag) < 1e-9].real
    return float(np.polyval(top, at[np.argmin(np.abs(at))]))
