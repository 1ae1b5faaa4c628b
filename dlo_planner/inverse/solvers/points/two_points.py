# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shapes that pass two centers at once, without a direction: x(s2) - x(s1) = P2 - P1."""

from typing import NamedTuple

import numpy as np

from dlo_planner.direct.continuation import fell
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import TOLERANCE, hanging_shape
from dlo_planner.inverse.solvers.continuation.following import Passing
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes, crossings
from dlo_planner.inverse.solvers.points.aligned import free_axis
from dlo_planner.inverse.solvers.points.spanning import two_points_hanging
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import pose_of
from dlo_planner.model.value import freeze
from dlo_planner.plan.waypoint import length_of

_ITERATIONS = 30
_ORIGIN = np.zeros(3)
freeze(_ORIGIN)
_EXACT = 1e-10          # of the length
_TURNED = 1e-9          # rad
_LARGEST_TURN = 0.3     # rad per step
_MESHES = 6             # that an accuracy may take


class Sought(NamedTuple):
    """Where two centers are passed, as far as it is known.

    Attributes
    ----------
    first, second : float
        Arc lengths s1 and s2, m, one of them about.
    free : str
        'first' or 'second': which of them is sought.
    roll : float
        Rotation in rad about the axis that the task leaves free, solved together with the rest.
    trend : (Shape, float) or None
        What `Passing.trend` returns; the search begins as far ahead.
    """

    first: float
    second: float
    free: str
    roll: float = 0.0
    trend: tuple[Shape, float] | None = None


class TwoPoints:
    """The shapes that pass both centers, at each depth in the first.

    Parameters
    ----------
    simulator
        DirectSimulator.
    way
        (3,) from the first center to the second, m.
    """

    def __init__(self, simulator: DirectSimulator, chord: Floats) -> None:
        self.simulator, self.chord = simulator, np.array(chord, dtype=float)
        freeze(self.chord)
        self._apart = float(np.linalg.norm(chord))

    def axis(self, shape: Shape) -> Floats:
        """Return the axis (3,) of the free roll: the mean of the gripper's and the way."""
        return free_axis(shape.gripper.rotation, self.chord / self._apart)

    def at(self, before: Passing, depth: float, roll: float = 0.0,
           final: bool = False) -> Passing | None:
        """Return the Passing at `depth`; see `following.Condition`."""
        del final
        assert before.second is not None  # every Passing of this task has it
        s1, s2, trend = self.simulator.rod.length - depth, before.second, before.trend(depth)
        if roll or trend is None or before.since is None or before.since.second is None:
            trend = None
        else:
            s2 = min(s2 + trend[1] * (s2 - before.since.second), self.simulator.rod.length)
            if s2 <= s1:
                s2, trend = before.second, None
        solved = self._solved(before.shape, Sought(s1, s2, 'second', roll, trend))
        return None if solved is None else solved[0]._replace(depth=depth).after(before)

    def from_end(self, guess: Shape, depth: float) -> tuple[Passing, float] | None:
        """Return the Passing whose free end is at the second center, and its depth, m, or None.

        Parameters
        ----------
        guess : Shape
            Shape near it, in equilibrium.
        depth : float
            Approximate depth, m.
        """
        length = self.simulator.rod.length
        solved = self._solved(guess, Sought(length - depth, length, 'first'))
        if solved is None:
            return None
        passing, s1 = solved
        return passing._replace(depth=length - s1), length - s1

    def _solved(self, shape: Shape, sought: Sought) -> tuple[Passing, float] | None:
        """Return the Passing and its s1, or None."""
        solved = two_points(self.simulator, shape, self.chord, sought)
        if solved is None:
            return None
        shape, s1, s2 = solved
        axes, place = shape.frame_at(s1)
        return Passing(shape, shape.gripper.position - place, s2, axes=axes), s1

    def crossings(self, shapes: HangingShapes, depth: float) -> Crossings:
        """Return where the shapes at `depth` cross the grid of HangingShapes."""
        s1 = self.simulator.rod.length - depth
        begin, _ = shapes.at(s1)
        away = np.linalg.norm(shapes.positions - begin[:, None], axis=2)
        away[:, shapes.s <= s1] = 0.0
        s2 = _first_above(shapes.s, away, self._apart)
        return self._between(shapes, s1, s2)

    def last_crossings(self, shapes: HangingShapes) -> tuple[Crossings, Floats]:
        """Return where the shapes whose free end is at the second center cross the grid.

        And the depth (m,) of each in the first.
        """
        away = np.linalg.norm(shapes.positions - shapes.positions[:, -1:], axis=2)
        s1 = shapes.s[-1] - _first_above(shapes.s[-1] - shapes.s[::-1], away[:, ::-1], self._apart)
        crossed = self._between(shapes, s1, np.full(len(away), shapes.s[-1]))
        a, b = crossed.pairs.T
        return crossed, shapes.s[-1] - ((1 - crossed.shares) * s1[a] + crossed.shares * s1[b])

    def least_miss(self, shapes: HangingShapes) -> float:
        """Return the least distance (m) of a stable shape's free end from the second center.

        The shape passes the first center somewhere; its turn about the vertical is free.
        """
        stable = shapes.stability > 0
        chords = shapes.positions[stable, -1:] - shapes.positions[stable]
        height = chords @ shapes.up
        aside = np.sqrt(np.maximum((chords**2).sum(axis=2) - height**2, 0.0))
        up = float(self.chord @ shapes.up)
        off = np.hypot(aside - np.sqrt(max(self._apart**2 - up**2, 0.0)), height - up)
        return float(off.min(initial=self._apart))

    def _between(self, shapes: HangingShapes, s1: float | Floats, s2: Floats) -> Crossings:
        missing = ~np.isfinite(s1 + s2)
        s1, s2 = (np.where(missing, shapes.s[-1], s) for s in (s1, s2))
        chords = shapes.at(s2)[0] - shapes.at(s1)[0]
        chords[missing] = np.nan
        return crossings(shapes, chords, self.chord, s1)


def _first_above(s: Floats, away: Floats, apart: float) -> Floats:
    """Return (n,) where rows of `away` (n, N + 1), given at `s`, first exceed `apart`; else nan."""
    k = np.argmax(away >= apart, axis=1)
    rows = np.arange(len(away))
    low, high = away[rows, k - 1], away[rows, k]
    crossed = (k > 0) & (high >= apart)
    share = (apart - low) / np.where(high > low, high - low, 1.0)
    return np.where(crossed, s[k - 1] + share * (s[k] - s[k - 1]), np.nan)


def two_points(simulator: DirectSimulator, shape: Shape, chord: Floats,
               sought: Sought) -> tuple[Shape, float, float] | None:
    """Find the gripper's rotation and an arc length such that x(s2) - x(s1) = `chord`.

    The search ends where the DLO falls into another shape after a step.

    Parameters
    ----------
    chord : ndarray, shape (3,)
        Read-only, m.
    sought : Sought

    Returns
    -------
    (Shape, float, float) or None
        The shape, s1 and s2. None if there is none.
    """
    mesh = shape.state.mesh
    if simulator.method != 'newton' or mesh is None or not mesh.hangs:
        return _step_by_step(simulator, shape, chord, sought)
    before, (s1, s2, free, roll, trend) = shape, sought
    axis = free_axis(shape.gripper.rotation, chord / length_of(chord))
    for _ in range(_MESHES):
        earlier, ahead = trend or (shape, 0.0)
        begin = mesh.start_from(shape)
        solution, base, s1, s2, converged = two_points_hanging(
            mesh.static, np.array(shape.gripper.rotation), np.array(begin),
            np.array(earlier.gripper.rotation),
            np.array(earlier.element_strains if trend else begin), ahead, mesh.s, chord, s1, s2,
            free == 'first', axis, roll, TOLERANCE, _EXACT * mesh.s[-1], _ITERATIONS)
        if not converged:
            return None
        shape = hanging_shape(mesh, pose_of(_ORIGIN, base), solution)
        if not shape.converged or fell(before, shape):
            return None
        better = simulator.discretization(shape.gripper, shape)
        if better is mesh:
            break
        mesh, roll, trend = better, 0.0, None
    return shape, s1, s2


def _step_by_step(simulator: DirectSimulator, shape: Shape, chord: Floats,
                  sought: Sought) -> tuple[Shape, float, float] | None:
    """Return the same as `two_points`, for any DLO, with one equilibrium per step.

    Newton's method with the sensitivities of the equilibrium. They also predict the shape after
    each step, so that the shapes in between nearly pass both centers.
    """
    length, (s1, s2, free, roll, _) = shape.s[-1], sought
    axis = free_axis(shape.gripper.rotation, chord / np.linalg.norm(chord))
    missing = roll
    for _ in range(_ITERATIONS):
        (one, begin), (other, end) = shape.frame_at(s1), shape.frame_at(s2)
        miss = end - begin - chord
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
        step *= min(1.0, _LARGEST_TURN / max(float(np.linalg.norm(step[:3])), 1e-300),
                    0.1 * length / max(abs(step[3]), 1e-300))
        missing -= float(axis @ step[:3])
        if free == 'first':
            s1 = s1 + step[3]
        else:
            s2 = s2 + step[3]
        if not (0 <= s1 < s2 <= length * (1 + 1e-12)):
            return None
        s2 = min(s2, length)
        guess = answer.moved(np.append(step[:3], np.zeros(3)))
        following = simulator.solve(guess.gripper, guess)
        if not following.converged or fell(shape, following):
            return None
        shape = following
    return None
