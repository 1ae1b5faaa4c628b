# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rods in a vertical plane and what makes them leave it; twisted rods; arches: by SciPy alone.

Planar rods: angles are from +x downwards, lengths in units of the rod's, moments and forces in
those of the weak bending stiffness: `load` is w L^3 / EI, `tip` P L^2 / EI. Twisted rods and
arches: EI = 1.
"""

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre
from scipy.integrate import solve_bvp, solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq

FINE = {'rtol': 1e-10, 'atol': 1e-13, 'method': 'DOP853'}


def level_cantilever(load):
    """Return (width, height) of the box about a level cantilever that bends by its weight.

    Shooting from the free end, where the curvature is 0: away from it the angle to the vertical
    grows, so that the integration is well-posed for any load.
    """
    def rates(r, y):  # r = 1 - s, phi = angle to the vertical
        return [y[1], load * r * np.sin(y[0]), np.sin(y[0]), np.cos(y[0])]

    def missed(log):
        return end(log)[0] - np.pi / 2

    def end(log):
        return solve_ivp(rates, (0, 1), [np.exp(log), 0, 0, 0], **FINE).y[:, -1]

    low = -2.0 - np.sqrt(load)  # of the roots, the first: others wind turns
    while missed(low + 0.5) < 0:
        low += 0.5
    found = brentq(missed, low, low + 0.5, xtol=1e-12, rtol=1e-12)
    return tuple(end(found)[2:])


class Planar:
    """A rod in its vertical plane, clamped at `angle` (rad), its other end free.

    Args:
        load, tip: weight and dead load of the tip
        strong: stiffness in the plane, over that out of it
        curvature: natural, downwards where above 0
    """

    def __init__(self, load=0.0, tip=0.0, strong=1.0, curvature=0.0, angle=0.0):
        self.load, self.tip, self.strong = load, tip, strong
        self.curvature, self.angle = curvature, angle

    def below(self, s):
        """Return the weight beyond s."""
        return self.load * (1 - s) + self.tip

    def rates(self, s, y):
        """Return d/ds of (angle, moment)."""
        return [y[1] / self.strong + self.curvature, -self.below(s) * np.cos(y[0])]

    def state(self, guess=None):
        """Return (angle, moment) as a function of s, by shooting from the free end."""
        def ended(angle):
            return solve_ivp(self.rates, (1, 0), [angle, 0.0], dense_output=True, **FINE)

        def missed(angle):
            return ended(angle).y[0, -1] - self.angle

        if guess is None:
            guess = self.angle + self.curvature
        step = 0.05
        while missed(guess - step) * missed(guess + step) > 0:
            step *= 1.5
        return ended(brentq(missed, guess - step, guess + step, xtol=1e-13)).sol

    def out_of_plane(self, torsion):
        """Return a determinant that vanishes where the planar shape is indifferent sideways.

        Turned a little by phi (in the plane), the rod's moment M0 = m y changes by
        dM = phi x M0 + K phi', and dM' = -(phi x t) x N with N the weight beyond, which is dead.

        Args:
            torsion: torsional stiffness over the weak bending stiffness
        """
        shape = self.state()

        def rates(s, y):
            angle, moment = shape(s)
            t = np.array([np.cos(angle), -np.sin(angle)])
            d = np.array([np.sin(angle), np.cos(angle)])
            phi, change = y[:2], y[2:]
            bent = change - moment * np.array([-phi[1], phi[0]])  # phi x y, in (x, z)
            turned = t * (t @ bent) / torsion + d * (d @ bent)
            aside = phi[1] * t[0] - phi[0] * t[1]  # (phi x t) along y
            return np.append(turned, [aside * self.below(s), 0.0])  # y x (0, 0, -N) = -N x

        ends = [solve_ivp(rates, (0, 1), start, **FINE).y[2:, -1]
                for start in ([0, 0, 1, 0], [0, 0, 0, 1])]
        return float(np.linalg.det(ends))


def critical(make, torsion, around):
    """Return the first number at which the planar rod `make(number)` leaves its plane.

    Args:
        around: numbers, increasing, between which it is sought
    """
    found = [make(one).out_of_plane(torsion) for one in around]
    first = next(k for k in range(len(found) - 1) if found[k] * found[k + 1] <= 0)
    return brentq(lambda one: make(one).out_of_plane(torsion), around[first], around[first + 1],
                  xtol=1e-10)


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
