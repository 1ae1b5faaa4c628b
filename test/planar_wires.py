# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Two wires in a vertical plane, written without the package: the references of motions.

Both are inextensible, bend elastically and are held by a gripper whose place and angle are given
functions of time. `spectral`: the curvature is a series of Legendre polynomials, the integrals
along the wire are Gauss's. `links`: a chain of rigid bars with springs in its joints. SciPy's
explicit method of order 8 and implicit one of order 5 integrate them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Wire:
    """What both take; angles in rad from +x to +z, `place` is (x, z) in m.

    Each motion of the gripper is a function of time that returns value, first and second
    derivative.
    """

    length: float
    density: float  # kg/m
    stiffness: float  # N m^2
    angle: Callable = lambda t: (0.0, 0.0, 0.0)
    place: Callable = lambda t: (np.zeros(2), np.zeros(2), np.zeros(2))
    tip_mass: float = 0.0
    gravity: float = 9.81


def _integrated(rates, start, times, tolerance, method):
    found = solve_ivp(rates, (times[0], times[-1]), start, method, times, rtol=tolerance,
                      atol=tolerance)
    assert found.success
    return found.y.T


def spectral(wire, times, curvature, terms=20, points=48, tolerance=1e-8):
    """Return tips (n, 2) in m and energies (n,) in J at `times`; at rest before.

    Args:
        curvature: (terms,) coefficients at times[0] of P_j(2 s / L - 1), 1/m
    """
    nodes, weights = legendre.leggauss(points)
    half = 0.5 * wire.length
    values = legendre.legvander(nodes, points - 1)
    inverse = np.linalg.inv(values)
    upto = np.column_stack([legendre.legval(nodes, legendre.legint(row, lbnd=-1))
                            for row in np.eye(points)]) @ inverse * half
    whole = weights * half
    shapes = values[:, :terms]
    turns = upto @ shapes
    stiff = wire.stiffness * shapes.T @ (whole[:, None] * shapes)
    masses = np.append(wire.density * whole, wire.tip_mass)
    upto = np.vstack([upto, whole])
    down = np.array([0.0, -wire.gravity])

    def kinematics(t, q):
        theta = wire.angle(t)[0] + turns @ q
        along, across = (np.array([np.cos(theta), np.sin(theta)]),
                         np.array([-np.sin(theta), np.cos(theta)]))
        return along, across, np.array([upto @ (row[:, None] * turns) for row in across])

    def rates(t, state):
        q, v = state.reshape(2, terms)
        along, across, slopes = kinematics(t, q)
        _, turn, spin = wire.angle(t)
        rate = turn + turns @ v
        free = (wire.place(t)[2][:, None] - down[:, None]
                + np.array([upto @ (one * spin - other * rate**2)
                            for one, other in zip(across, along, strict=True)]))
        inertia = sum(one.T @ (masses[:, None] * one) for one in slopes)
        force = sum(one.T @ (masses * part) for one, part in zip(slopes, free, strict=True))
        return np.append(v, np.linalg.solve(inertia, -stiff @ q - force))

    start = np.zeros((2, terms))
    start[0, :len(curvature)] = curvature
    states = _integrated(rates, start.ravel(), times, tolerance, 'Radau')
    tips, energies = [], []
    for t, state in zip(times, states, strict=True):
        q, v = state.reshape(2, terms)
        along, across, slopes = kinematics(t, q)
        turn = wire.angle(t)[1]
        places = wire.place(t)[0][:, None] + np.array([upto @ row for row in along])
        speeds = (wire.place(t)[1][:, None] + np.array([upto @ (row * turn) for row in across])
                  + slopes @ v)
        tips.append(places[:, -1])
        energies.append(0.5 * q @ stiff @ q + np.sum(0.5 * masses * (speeds**2).sum(axis=0))
                        + wire.gravity * masses @ places[1])
    return np.array(tips), np.array(energies)


def links(wire, times, angles, tolerance=1e-8):
    """Return tips (n, 2) in m at `times` of a chain that begins at rest.

    Args:
        angles: (n,) of its bars at times[0], rad
    """
    n = len(angles)
    h = wire.length / n
    bar = wire.density * h
    # mass beyond each pair of bars, from the bars' centers and the tip
    beyond = np.array([bar * (n - 1 - np.arange(n)) + wire.tip_mass for _ in range(n)])
    inner = np.minimum(beyond, beyond.T) + 0.5 * bar
    inner[np.diag_indices(n)] -= bar / 6  # a bar's own inertia about its end: m / 3
    inner *= h * h
    first = h * (bar * (n - 1 - np.arange(n)) + 0.5 * bar + wire.tip_mass)
    joint = np.full(n, wire.stiffness / h)
    joint[0] *= 2

    def rates(t, state):
        theta, rate = state.reshape(2, n)
        apart = theta[:, None] - theta
        bent = joint * np.diff(theta, prepend=wire.angle(t)[0])
        moment = -bent
        moment[:-1] += bent[1:]
        place = wire.place(t)[2]
        lift = place[1] + wire.gravity
        moment -= first * (lift * np.cos(theta) - place[0] * np.sin(theta))
        moment -= (inner * np.sin(apart)) @ rate**2
        return np.append(rate, np.linalg.solve(inner * np.cos(apart), moment))

    states = _integrated(rates, np.append(angles, np.zeros(n)), times, tolerance, 'DOP853')
    theta = states[:, :n]
    places = np.array([wire.place(t)[0] for t in times])
    return places + h * np.column_stack([np.cos(theta).sum(axis=1), np.sin(theta).sum(axis=1)])
