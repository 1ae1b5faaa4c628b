# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rods whose properties jump, and their true shapes by Runge-Kutta from jump to jump.

Nothing of the package is used but Rod's arguments: from a guessed rotation of the free end the
Kirchhoff equations are integrated back to the gripper, and the guess is mended until the gripper's
rotation is met.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

WEIGHT = np.array([0.0, 0.0, -9.81])


@dataclass
class Stepped:
    """A rod of 1 m (or `length`) that is even between jumps.

    Attributes:
        edges: (n + 1,) of its parts, m
        mass: (n,) kg/m; stiffness: (n, 3) GJ, EI_n, EI_b; natural: (n, 3) strains, 1/m
        load: (n, 3) N/m, world
        points: list of (s, force (3,), moment (3,))
    """

    edges: np.ndarray
    mass: np.ndarray
    stiffness: np.ndarray
    natural: np.ndarray
    load: np.ndarray
    points: list = field(default_factory=list)

    def part(self, s):
        """Return the index of the part that holds s."""
        return min(max(int(np.searchsorted(self.edges, s, side='right')) - 1, 0),
                   len(self.mass) - 1)

    def of(self, values, scalar=False):
        """Return a plain function of s of one of the quantities, as a user would write it."""
        if scalar:
            return lambda s: float(values[self.part(s)])
        return lambda s: tuple(float(v) for v in values[self.part(s)])

    def shape(self, gripper, end, samples):
        """Return positions (m, 3) at arc lengths `samples`, m.

        Args:
            gripper: Pose
            end: (3, 3) rotation of the free end to begin with
        """
        def from_end(turn):
            start = Rotation.from_matrix(np.array(end))  # SciPy 1.11 takes nothing read-only
            return self._back(Rotation.from_rotvec(turn) * start, samples)

        def off(turn):
            _, rotation = from_end(turn)
            return (rotation * Rotation.from_matrix(np.array(gripper.rotation)).inv()).as_rotvec()

        found = root(off, np.zeros(3), tol=1e-11)
        assert np.abs(found.fun).max() < 1e-8, found.message
        points, _ = from_end(found.x)
        return points - points[0] + gripper.position

    def _back(self, end, samples):
        state = np.concatenate([np.zeros(3), end.as_quat(), np.zeros(3), np.zeros(3)])
        places = sorted({*self.edges, *(s for s, _, _ in self.points)}, reverse=True)
        points = np.full((len(samples), 3), np.nan)
        points[np.isclose(samples, places[0])] = 0.0
        for high, low in zip(places[:-1], places[1:], strict=True):
            state = self._loaded(state, high)
            inside = np.flatnonzero((samples >= low) & (samples < high))
            wanted = np.unique(np.append(samples[inside], low))[::-1]
            run = solve_ivp(self._slope, (high, low), state, 'DOP853', wanted, rtol=1e-11,
                            atol=1e-13, args=(self.part(0.5 * (high + low)),))
            points[inside[np.argsort(-samples[inside])]] = run.y[:3, :inside.size].T
            state = run.y[:, -1]
        return points, Rotation.from_quat(state[3:7])

    def _loaded(self, state, s):
        state = state.copy()
        for place, force, moment in self.points:
            if place == s:
                state[7:10] += force
                state[10:] += moment
        return state

    def _slope(self, s, y, part):
        """Return d/ds of position, quaternion, force and moment of what lies beyond."""
        turn = Rotation.from_quat(y[3:7])
        tangent = turn.apply([1.0, 0.0, 0.0])
        a, b, c = turn.inv().apply(y[10:]) / self.stiffness[part] + self.natural[part]
        x, y_, z, w = y[3:7]
        rate = 0.5 * np.array([w * a + y_ * c - z * b, w * b + z * a - x * c,
                               w * c + x * b - y_ * a, -x * a - y_ * b - z * c])
        force = WEIGHT * self.mass[part] + self.load[part]
        return np.concatenate([tangent, rate, -force, -np.cross(tangent, y[7:10])])


def random_stepped(rng, softest=30.0, narrowest=1e-3):
    """Return a Stepped of 1 m, any of them, with parts from `narrowest` on."""
    parts = rng.integers(2, 7)
    widths = np.exp(rng.uniform(np.log(narrowest), 0, parts))
    widths = np.maximum(widths / widths.sum(), narrowest)
    edges = np.concatenate([[0.0], np.cumsum(widths)])
    edges /= edges[-1]
    weight = np.exp(rng.uniform(np.log(0.1), np.log(softest)))

    def some(size, spread):  # constant in half of all cases
        values = np.exp(rng.uniform(-spread, spread, (parts, *size)))
        return values if rng.random() < 0.5 else np.broadcast_to(values[0], values.shape).copy()

    bends = rng.normal(size=(parts, 3)) * np.minimum(0.5 / widths, 6.0)[:, None]
    return Stepped(
        edges, weight / 9.81 * some((), 1.0), np.array([0.7, 1.0, 1.0]) * some((3,), 0.8),
        bends * (rng.random() < 0.7),
        0.5 * weight * rng.normal(size=(parts, 3)) * (rng.random() < 0.5))
