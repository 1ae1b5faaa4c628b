# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions in a plane whose true course is known from two wires written without the package.

Both are inextensible, bend elastically and are held by a gripper whose place and angle are given
functions of time. `spectral`: the curvature is a series of Legendre polynomials, the integrals
along the wire are Gauss's. `links`: a chain of rigid bars with springs in its joints. SciPy's
explicit method of order 8 and implicit one of order 5 integrate them.

python test/references/planar_motions.py    prints how well they are met, and what that costs
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parents[2])]

from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402

LEVEL = Pose.identity()
DENSITY, STIFFNESS = 0.1, 0.05
# x and z of the tip in m at hundredths of a second, in benchmark C without damping: chains of 24
# and 48 bars (`links`), extrapolated
REFERENCE_C = {50: (0.64699, -0.40074), 100: (-0.99267, 0.11679),
               125: (0.65159, -0.38623), 150: (-0.18759, -0.39121)}


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


def rod(**more):
    return Rod(1.0, DENSITY, STIFFNESS, 0.04, **more)


def tilted(angle, place=(0.0, 0.0)):
    """Return a gripper turned by `angle` from x to z, at x, z."""
    return Pose((place[0], 0, place[1]), Rotation.from_euler('y', -angle).as_quat())


def turn(angle):
    """Return angle, rate and acceleration of a turn that begins and ends smoothly in 1 s."""
    def at(t):
        x = min(t, 1.0)
        return (angle * x**3 * (10 - 15 * x + 6 * x**2), angle * 30 * x**2 * (1 - x) ** 2,
                angle * 60 * x * (1 - x) * (1 - 2 * x))
    return at


def shaken(t, hertz=20.0, size=0.002):
    """Return place, velocity and acceleration of a gripper that begins to shake along z."""
    w = 2 * np.pi * hertz
    up, rate, change = size * (1 - np.cos(w * t)), size * w * np.sin(w * t), w * w * np.cos(w * t)
    return np.array([0, up]), np.array([0, rate]), np.array([0, size * change])


def still(t):
    return np.zeros(2), np.zeros(2), np.zeros(2)


# angle and place of the gripper, tip mass, s, interval s; all begin straight and level, at rest
CASES = {'swing': (lambda t: (0.0, 0.0, 0.0), still, 0.0, 0.8, 0.01),
         'whirl': (turn(np.pi), still, 0.0, 1.0, 0.01),
         'tip mass': (turn(0.7), still, 0.1, 1.0, 0.01),
         'shake': (lambda t: (0.0, 0.0, 0.0), shaken, 0.0, 0.2, 0.004)}


def motion_of(case, **options):
    angle, place, mass, seconds, interval = CASES[case]
    n = round(seconds / interval)
    times = interval * np.arange(n + 1)
    thing = rod(tip_mass=mass)
    straight = DirectSimulator(thing, gravity=(0, 0, 0), **options).solve(LEVEL)
    grippers = [tilted(angle(t)[0], place(t)[0]) for t in times]
    return DirectSimulator(thing, **options).simulate(grippers, interval, straight)


def reference(case, bars=(12, 24)):
    """Return the tips of a chain with ever more bars, and how far they may be off, m."""
    angle, place, mass, seconds, interval = CASES[case]
    times = interval * np.arange(round(seconds / interval) + 1)
    wire = Wire(1.0, DENSITY, STIFFNESS, angle, place, mass)
    coarse, fine = (links(wire, times, np.zeros(n), 1e-7) for n in bars)
    return (4 * fine - coarse) / 3, np.linalg.norm(fine - coarse, axis=1).max() / 12


def tips(motion):
    return np.array([shape.positions[-1, [0, 2]] for shape in motion.shapes])


def wild_turn(seconds=1.5, **options):
    """Return the Motion of benchmark C's wire, turned by 180 degrees and back in 2 s, undamped."""
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    times = 0.01 * np.arange(round(100 * seconds) + 1)
    grippers = [tilted(np.pi / 2 * (1 - np.cos(np.pi * t))) for t in times]
    return DirectSimulator(wire, **options).simulate(grippers, 0.01)


def _say(name, begun, motion, true, doubtful):
    seconds = process_time() - begun
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    begun = process_time()
    estimate = motion.error_estimate[-1]
    estimating = process_time() - begun
    loss = motion.numerical_loss
    print(f'{name:10s} {motion.status} true error {1e3 * true:.3g} mm (known to '
          f'{1e3 * doubtful:.2g}), estimate {1e3 * estimate:.3g} mm, numerical loss '
          f'{100 * loss.min() / moved:.3g} to {100 * loss.max() / moved:.3g} % of the energy that '
          f'moves, {seconds:.2g} s, estimate {estimating:.2g} s')


def main():
    for case in CASES:
        known, doubtful = reference(case, (16, 32))
        begun = process_time()
        motion = motion_of(case)
        _say(case, begun, motion, np.linalg.norm(tips(motion) - known, axis=1).max(), doubtful)
    begun = process_time()
    motion = wild_turn()
    at = list(REFERENCE_C)
    away = np.linalg.norm(tips(motion)[at] - list(REFERENCE_C.values()), axis=1)
    _say('C to 1.5 s', begun, motion, away.max(), 3e-4)
    begun = process_time()
    motion = wild_turn(2.0)
    print(f'C to 2 s: {motion.status} {motion.message}, at most '
          f'{motion.kinetic_energy.max():.3g} J of motion, numerical loss '
          f'{motion.numerical_loss.min():.2g} to {motion.numerical_loss.max():.2g} J, '
          f'{process_time() - begun:.2g} s')


if __name__ == '__main__':
    main()
