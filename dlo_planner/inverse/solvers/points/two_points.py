# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shapes that pass two centers at once, without a direction: x(s2) - x(s1) = P2 - P1."""

import numpy as np

from dlo_planner.direct.continuation import fell
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.statics import TOLERANCE, found_hanging
from dlo_planner.inverse.solvers.continuation.following import Passing
from dlo_planner.inverse.solvers.hanging.sphere import crossings
from dlo_planner.inverse.solvers.points.aligned import free_axis
from dlo_planner.inverse.solvers.points.coupled import two_points_hanging
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze

_ITERATIONS = 30
_ORIGIN = np.zeros(3)
_EXACT = 1e-10          # of the length
_TURNED = 1e-9          # rad
_LARGEST_TURN = 0.3     # rad per step
_MESHES = 6             # that an accuracy may take


class TwoPoints:
    """The shapes that pass both centers, at each depth in the first.

    Parameters
    ----------
    simulator
        DirectSimulator.
    way
        (3,) from the first center to the second, m.
    """

    def __init__(self, simulator, way):
        self.simulator, self.way = simulator, way
        self._apart = float(np.linalg.norm(way))

    def axis(self, shape):
        """Return the axis (3,) of the free roll: the mean of the gripper's and the way."""
        return free_axis(shape.gripper.rotation, self.way / self._apart)

    def at(self, before, depth, roll=0.0, final=False):
        """Return the Passing at `depth`; see `following.Task`."""
        del final
        found = self._solved(before.shape, self.simulator.rod.length - depth, before.second,
                             'second', roll)
        return None if found is None else found[0]

    def from_end(self, guess, depth):
        """Return the Passing whose free end is at the second center, and its depth, m, or None.

        Parameters
        ----------
        guess
            Shape near it, in equilibrium.
        depth
            Approximate depth, m.
        """
        length = self.simulator.rod.length
        found = self._solved(guess, length - depth, length, 'first')
        return None if found is None else (found[0], length - found[1])

    def _solved(self, shape, s1, s2, free, roll=0.0):
        """Return the Passing and its s1, or None."""
        found = two_points(self.simulator, shape, self.way, (s1, s2), free, roll)
        if found is None:
            return None
        shape, s1, s2 = found
        return Passing(shape, shape.gripper.position - shape.frame_at(s1)[1], s2), s1

    def crossings(self, shapes, depth):
        """Return where the shapes at `depth` cross the grid of HangingShapes."""
        s1 = self.simulator.rod.length - depth
        begin, _ = shapes.at(s1)
        away = np.linalg.norm(shapes.positions - begin[:, None], axis=2)
        away[:, shapes.s <= s1] = 0.0
        s2 = _first_above(shapes.s, away, self._apart)
        return self._between(shapes, s1, s2)

    def last_crossings(self, shapes):
        """Return where the shapes whose free end is at the second center cross the grid.

        And the depth (m,) of each in the first.
        """
        away = np.linalg.norm(shapes.positions - shapes.positions[:, -1:], axis=2)
        s1 = shapes.s[-1] - _first_above(shapes.s[-1] - shapes.s[::-1], away[:, ::-1], self._apart)
        found = self._between(shapes, s1, np.full(len(away), shapes.s[-1]))
        a, b = found.pairs.T
        return found, shapes.s[-1] - ((1 - found.shares) * s1[a] + found.shares * s1[b])

    def least_miss(self, shapes):
        """Return the least distance (m) of a stable shape's free end from the second center.

        The shape passes the first center somewhere; its turn about the vertical is free.
        """
        stable = shapes.stability > 0
        chords = shapes.positions[stable, -1:] - shapes.positions[stable]
        height = chords @ shapes.up
        aside = np.sqrt(np.maximum((chords**2).sum(axis=2) - height**2, 0.0))
        up = self.way @ shapes.up
        off = np.hypot(aside - np.sqrt(max(self._apart**2 - up**2, 0.0)), height - up)
        return float(off.min(initial=self._apart))

    def _between(self, shapes, s1, s2):
        missing = ~np.isfinite(s1 + s2)
        s1, s2 = (np.where(missing, shapes.s[-1], s) for s in (s1, s2))
        chords = shapes.at(s2)[0] - shapes.at(s1)[0]
        chords[missing] = np.nan
        return crossings(shapes, chords, self.way, s1)


def _first_above(s, away, apart):
    """Return (n,) where rows of `away` (n, N + 1), given at `s`, first exceed `apart`; else nan."""
    k = np.argmax(away >= apart, axis=1)
    rows = np.arange(len(away))
    low, high = away[rows, k - 1], away[rows, k]
    found = (k > 0) & (high >= apart)
    share = (apart - low) / np.where(high > low, high - low, 1.0)
    return np.where(found, s[k - 1] + share * (s[k] - s[k - 1]), np.nan)


def two_points(simulator, shape, way, s, free, roll=0.0):
    """Find the gripper's rotation and an arc length such that x(s2) - x(s1) = `way`.

    A step after which the DLO falls into another shape ends it.

    Parameters
    ----------
    s
        Arc lengths s1 and s2, m.
    free
        'first' or 'second': which of them is sought.
    roll
        Rotation in rad about the axis that the task leaves free, solved together with the rest.

    Returns
    -------
    (Shape, float, float) or None
        The shape, s1 and s2. None if there is none.
    """
    mesh, way = shape.state.mesh, np.array(way)
    freeze(way)
    if simulator.method != 'newton' or mesh is None or not mesh.hangs:
        return _step_by_step(simulator, shape, way, s, free, roll)
    before, reached = shape, s
    axis = free_axis(shape.gripper.rotation, way / np.linalg.norm(way))
    for _ in range(_MESHES):
        found, base, *reached, converged = two_points_hanging(
            mesh.static, shape.gripper.rotation, mesh.start_from(shape), mesh.s, way, *reached,
            free == 'first', axis, roll, TOLERANCE, _EXACT * mesh.s[-1], _ITERATIONS)
        if not converged:
            return None
        shape = found_hanging(mesh, Pose.from_rotation(_ORIGIN, base), found)
        if not shape.converged or fell(before, shape):
            return None
        better = simulator.discretization(shape.gripper, shape)
        if better is mesh:
            break
        mesh, roll = better, 0.0
    return shape, *reached


def _step_by_step(simulator, shape, way, s, free, roll):
    """Return what `two_points` does, of any DLO, an equilibrium at a time.

    Newton's method with the sensitivities of the equilibrium, which also predict the shape after
    each step, so that the shapes in between pass both centers, about.
    """
    length, (s1, s2) = shape.s[-1], s
    axis = free_axis(shape.gripper.rotation, way / np.linalg.norm(way))
    missing = roll
    for _ in range(_ITERATIONS):
        (one, begin), (other, end) = shape.frame_at(s1), shape.frame_at(s2)
        miss = end - begin - way
        if np.linalg.norm(miss) < _EXACT * length and abs(missing) < _TURNED:
            return shape, s1, s2
        answer = Sensitivity(shape)
        rows = np.zeros((4, 4))
        rows[:3, :3] = answer.at(s2)[3:, :3] - answer.at(s1)[3:, :3]
        rows[:3, 3] = -one[:, 0] if free == 'first' else other[:, 0]
        rows[3, :3] = axis
        try:
            step = np.linalg.solve(rows, np.append(-miss, missing))
        except np.linalg.LinAlgError:
            return None
        step *= min(1.0, _LARGEST_TURN / max(np.linalg.norm(step[:3]), 1e-300),
                    0.1 * length / max(abs(step[3]), 1e-300))
        missing -= axis @ step[:3]
        if free == 'first':
            s1 = s1 + step[3]
        else:
            s2 = s2 + step[3]
        if not (0 <= s1 < s2 <= length * (1 + 1e-12)):
            return None
        s2 = min(s2, length)
        guess = answer.moved(np.append(step[:3], np.zeros(3)))
        there = simulator.solve(guess.gripper, guess)
        if not there.converged or fell(shape, there):
            return None
        shape = there
    return None
