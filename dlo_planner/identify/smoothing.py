# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The most likely state after the looks so far, and its covariance.

An iterated extended Kalman filter (Bell and Cathey 1993: each update is a Gauss-Newton search) in
information form. A filter that keeps each look linearized at the estimate of its time becomes too
sure of itself: the difference between two linearizations looks like information about what no look
shows, such as stiffness against weight. So the looks from the last few poses of the gripper are
remembered and searched together (a smoother with a fixed lag); older ones stay linearized. The
robot's wandering error is an unknown at each of these poses, linked to the one before.

Each look is judged before it is believed: by how far it moves the state, in units of what was
expected (the normalized innovation of a Kalman filter: Bar-Shalom, Li, Kirubarajan 2001, 5.4), by
how far the points stay off the DLO after it, and by how many of them are none of the DLO's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import chi2

from dlo_planner.direct.accuracy import surely_within
from dlo_planner.direct.shape import Shape
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.looking import (
    Distances,
    Fit,
    Information,
    Own,
    fit_of,
    from_either_end,
    information_of,
    looked_at,
    squares,
)
from dlo_planner.identify.memory import Group, Memory, solved, way_between
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.settling import settled
from dlo_planner.model.arrays import Floats
from dlo_planner.verify.response import node_slopes
from dlo_planner.verify.uncertain import mesh_of

if TYPE_CHECKING:
    from dlo_planner.identify.observer import Observer

_ITERATIONS = 30
_HALVINGS = 8
_SETTLED = 1e-3   # mean square of the last step, in standard deviations of the estimate
_STEADY = 1.05    # ratio of two successive scales of the residuals that count as equal
_FARTHEST = 0.15  # of the length: by which one step may move a node
_ENOUGH = 1e-4    # part of the decrease predicted for a step that it has to give (Armijo)
_STILL = 1e-6     # of the noise: a smaller sway counts as none
_RARE = 1e-4      # part of the looks that exceed a limit of consistency by chance
_SEEN = 0.02      # part of a variance by which a look has to lower it to tell of that direction
_MODEL = 1.5      # ratio of variances that the model's own errors may add to the residuals
_MORE_OUTLIERS = 0.1  # part of the points by which more may be none of the DLO's than are stated


class Evaluated(NamedTuple):
    """A state y, the Shape of each group there, and the Distances of its points from it.

    y (n + p (k + 1),) in standard deviations: the state, the robot's error at the last forgotten
    group, and at each of the k groups.
    """

    y: Floats
    shapes: list[Shape]
    distances: list[list[tuple[Distances, bool]]]


class _Equations(NamedTuple):
    """The normal equations of a step.

    Attributes
    ----------
    matrix : ndarray
        Information matrix of y.
    down : ndarray
        Minus the gradient of the cost.
    scales : list of float
        Noise with which each group is weighed, m.
    """

    matrix: Floats
    down: Floats
    scales: list[float]


class Search:
    """One more look at the DLO.

    Parameters
    ----------
    observer : Observer
    estimate : Estimate
        Estimate before the look.
    observation : Observation
    elapsed : float
        Seconds since the look before.
    noise : float
        Noise of this look, m.
    own : Own
        What is its own.
    bent : ndarray, shape (k, 3) or None
        By how much the DLO was off its rest.
    """

    def __init__(self, observer: Observer, estimate: Estimate, observation: Observation,
                 elapsed: float, noise: float, own: Own,
                 bent: Floats | None) -> None:
        self._noise, self._own = noise, own._replace(
            sway=own.sway if own.sway > _STILL * noise else 0.0)
        self._bent = bent
        self._observer, self._estimate, self._observation = observer, estimate, observation
        self._uncertain, self._robot = observer.uncertain, observer.robot
        self._elapsed = elapsed
        self._n, self._p = self._uncertain.size, self._robot.acting.size
        self._unit = np.append(self._uncertain.deviations,
                               self._robot.deviations[self._robot.acting])
        self._memory = memory_of(observer, estimate)

    def estimate(self) -> Estimate | None:
        """Return the Estimate, or None if no equilibrium explains the look."""
        last = np.inf
        shape = self._first()
        if not shape.converged:
            return None
        s, points = self._observation.s, self._observation.points
        if s is not None:
            s = from_either_end(shape, points, s)
        before = self._memory
        memory, forgotten = before.with_look(
            Group(self._observation.gripper, ((points, s),), shape, self._noise, self._own,
                  self._bent),
            self._elapsed, self._robot)
        joined = bool(before.groups) and forgotten is None and (
            len(memory.groups) == len(before.groups))
        if forgotten is not None:
            folded = self._folded(memory, forgotten)
            if folded is None:
                return None
            memory = folded
        self._memory = memory
        expected = self._expected(before, joined)
        start = np.concatenate([self._estimate.mean / self._unit[:self._n]] + (
            len(memory.groups) + 1) * [expected[0][self._n:]])
        evaluated = self._at(start, [group.shape for group in memory.groups])
        for _ in range(_ITERATIONS):
            if evaluated is None:
                return None
            equations = self._equations(evaluated)
            step = solved(equations.matrix, equations.down)
            slope, scales = float(step @ equations.down), equations.scales
            steady = last <= _STEADY * scales[-1] or scales[-1] == self._noise
            if slope < _SETTLED * step.size and steady:
                return self._result(evaluated, step, equations, expected)
            evaluated, last = self._moved(evaluated, step, slope, scales), scales[-1]
        return None

    def _first(self) -> Shape:
        """Return the Shape at the gripper's pose of this look, with the state before it."""
        estimate = self._estimate
        simulator, known = self._uncertain.simulator, estimate._shape
        groups = self._memory.groups
        if known is not None and groups and groups[-1].gripper == self._observation.gripper:
            self._varied = self._uncertain.varied(mesh_of(known))
            return known
        gripper = estimate.actual(self._observation.gripper)
        if known is not None and (simulator.accuracy is None
                                  or surely_within(known, simulator.accuracy)):
            mesh = mesh_of(known)
        else:
            mesh = simulator.discretization(gripper, None)
        self._varied = self._uncertain.varied(mesh)
        return settled(self._varied, estimate.mean, gripper, known)

    # ---- unknowns -----------------------------------------------------------------------------

    def _expected(self, before: Memory, joined: bool) -> tuple[Floats, Floats]:
        """Return mean (n + p,) and covariance of state and robot's error, before the look."""
        if joined or not self._p:
            return before.mean, before.covariance
        moved = way_between(before.groups[-1].gripper, self._observation.gripper) if (
            before.groups) else 0.0
        link = self._robot.link(self._elapsed, moved)
        carried = np.append(np.ones(self._n), np.full(self._p, link))
        covariance = before.covariance * np.outer(carried, carried)
        covariance[self._n:, self._n:] += (1 - link**2) * np.eye(self._p)
        return before.mean * carried, covariance

    def _errors(self, count: int) -> slice:
        """Return where in y the robot's error is: 0 of the memory, 1 to k of the groups."""
        return slice(self._n + count * self._p, self._n + (count + 1) * self._p)

    def _offset(self, y: Floats, count: int) -> tuple[Floats, Floats]:
        """Return the state (n,) and the robot's error (6,) at the group of a number from 1 on."""
        return (y[:self._n] * self._unit[:self._n], self._robot.twist(y[self._errors(count)]))

    def _at(self, y: Floats, before: Sequence[Shape]) -> Evaluated | None:
        """Return the Evaluated at y, searched from Shapes `before`; None: not converged."""
        shapes, distances = [], []
        for count, (group, known) in enumerate(zip(self._memory.groups, before, strict=True), 1):
            z, error = self._offset(y, count)
            shape = self._shape(group, z, error, known)
            if not shape.converged:
                return None
            shapes.append(shape)
            distances.append(self._distances(group, shape, self._uncertain.camera(z)))
        return Evaluated(y, shapes, distances)

    def _shape(self, group: Group, z: Floats, error: Floats, known: Shape) -> Shape:
        return settled(self._varied, z, group.gripper.compose(self._uncertain.offset(z, error)),
                       known, followed=False)

    def _distances(self, group: Group, shape: Shape, bias: Floats) -> list[tuple[Distances, bool]]:
        """Return [(Distances, whether arc lengths were seen)] of a group's looks."""
        return [(squares(shape, points - bias, s, group.bent), s is not None)
                for points, s in group.stacked()]

    # ---- the search ---------------------------------------------------------------------------

    def _equations(self, evaluated: Evaluated) -> _Equations:
        """Return the _Equations of a step from a state."""
        memory, y, scales = self._memory, evaluated.y, []
        size = memory.x.size
        matrix, down = np.zeros((y.size, y.size)), np.zeros(y.size)
        matrix[:size, :size] = memory.matrix
        down[:size] = memory.matrix @ (memory.x - y[:size])
        for count, (group, shape, distances) in enumerate(zip(
                memory.groups, evaluated.shapes, evaluated.distances, strict=True), 1):
            self._link(matrix, down, y, count, group)
            own = np.r_[0:self._n, self._errors(count)]
            for one in self._information_by(y, count, group, shape, distances):
                matrix[np.ix_(own, own)] += one.matrix
                down[own] += one.vector
            scales.append(one.scale)
        return _Equations(matrix, down, scales)

    def _link(self, matrix: Floats, down: Floats, y: Floats, count: int, group: Group) -> None:
        """Add what the robot's error at one group says of the error at the next."""
        if not self._p:
            return
        link = group.link
        own, old = self._errors(count), self._errors(count - 1)
        certain = np.eye(self._p) / (1 - link**2)
        off = certain @ (y[own] - link * y[old])
        matrix[own, own] += certain
        matrix[old, old] += link**2 * certain
        matrix[own, old] -= link * certain
        matrix[old, own] -= link * certain
        down[own] -= off
        down[old] += link * off

    def _information_by(self, y: Floats, count: int, group: Group, shape: Shape,
                        distances: Sequence[tuple[Distances, bool]]) -> Iterator[Information]:
        """Yield the Information of a group's looks."""
        z, error = self._offset(y, count)
        slopes = node_slopes(self._varied, z, shape, error if self._p else None)
        kept = np.append(np.arange(self._n), self._n + self._robot.acting)
        for off, known in distances:
            look = looked_at(self._uncertain, shape, slopes, off, known)
            yield information_of(
                replace(look, slopes=look.slopes[:, :, kept] * self._unit), group.noise,
                self._observer.outliers, group.own, shape.s[-1])

    def _moved(self, evaluated: Evaluated, step: Floats, slope: float,
               scales: Sequence[float]) -> Evaluated | None:
        """Return the Evaluated after a step, halved until it lowers the cost; None: never."""
        part, cost = 1.0, self._cost(evaluated, scales)
        for _ in range(_HALVINGS):
            trial = self._at(evaluated.y + part * step, evaluated.shapes)
            if trial is not None and self._near(evaluated.shapes, trial.shapes) and self._cost(
                    trial, scales) <= cost - _ENOUGH * part * slope:
                return trial
            part *= 0.5
        return None

    def _near(self, shapes: Sequence[Shape], trial: Sequence[Shape]) -> bool:
        return all(np.abs(one.positions - other.positions).max() <= _FARTHEST * one.s[-1]
                   for one, other in zip(shapes, trial, strict=True))

    def _cost(self, evaluated: Evaluated, scales: Sequence[float]) -> float:
        """Return minus the logarithm of the likelihood, up to a constant: what is minimized."""
        memory, outliers, y = self._memory, self._observer.outliers, evaluated.y
        off = y[:memory.x.size] - memory.x
        cost = 0.5 * float(off @ memory.matrix @ off)
        for count, (group, shape, distances, scale) in enumerate(zip(
                memory.groups, evaluated.shapes, evaluated.distances, scales, strict=True), 1):
            link = group.link
            wandered = y[self._errors(count)] - link * y[self._errors(count - 1)]
            cost += 0.5 * float(wandered @ wandered) / (1 - link**2)
            cost += sum(one.cost(scale, outliers, group.own, shape.s[-1])
                        for one, _ in distances)
        return cost

    def _folded(self, memory: Memory, group: Group) -> Memory | None:
        """Return the Memory with a forgotten Group, linearized; None: no equilibrium."""
        y = np.append(self._memory.mean, self._memory.mean[self._n:])  # the state before the look
        z, error = self._offset(y, 1)
        shape = self._shape(group, z, error, group.shape)
        if not shape.converged:
            return None
        size = memory.x.size
        matrix, vector = np.zeros((y.size, y.size)), np.zeros(y.size)
        matrix[:size, :size], vector[:size] = memory.matrix, memory.matrix @ memory.x
        self._link(matrix, vector, np.zeros(y.size), 1, group)
        own = np.r_[0:self._n, self._errors(1)]
        for one in self._information_by(y, 1, group, shape, self._distances(
                group, shape, self._uncertain.camera(z))):
            matrix[np.ix_(own, own)] += one.matrix
            vector[own] += one.matrix @ y[own] + one.vector
        if self._p:  # the error before it is forgotten (Schur complement)
            old = np.r_[self._errors(0)]
            across = np.linalg.solve(matrix[np.ix_(old, old)], matrix[np.ix_(old, own)]).T
            vector = vector[own] - across @ vector[old]
            matrix = matrix[np.ix_(own, own)] - across @ matrix[np.ix_(old, own)]
        matrix = symmetric(matrix)
        return replace(memory, x=solved(matrix, vector), matrix=matrix)

    def _fit(self, evaluated: Evaluated) -> Fit:
        """Return the Fit of this look alone."""
        group, shape = self._memory.groups[-1], evaluated.shapes[-1]
        points, s = group.looks[-1]
        bias = self._uncertain.camera(evaluated.y[:self._n] * self._unit[:self._n])
        return fit_of(squares(shape, points - bias, s, group.bent), group.noise,
                      self._observer.outliers, group.own, shape.s[-1])

    # ---- the answer ---------------------------------------------------------------------------

    def _result(self, evaluated: Evaluated, step: Floats, equations: _Equations,
                expected: tuple[Floats, Floats]) -> Estimate:
        memory, last = self._memory, self._fit(evaluated)
        now = np.r_[0:self._n, self._errors(len(memory.groups))]
        covariance = symmetric(np.linalg.inv(equations.matrix)[np.ix_(now, now)])
        mean = (evaluated.y + step)[now]
        innovation, seen = innovation_of(*expected, mean, covariance)
        # the model's own errors are no news of the noise; what is left counts in full
        residual = max(last.residual / _MODEL, min(last.residual, last.degrees))
        count = len(self._observation.points)
        share = min(self._observer.outliers + _MORE_OUTLIERS, 1.0)
        most = share + 4 * np.sqrt(share * (1 - share) / count)
        surprise = max(innovation / _limit(seen), residual / _limit(last.degrees),
                       last.outliers / most)
        groups = tuple(replace(group, shape=shape)
                       for group, shape in zip(memory.groups, evaluated.shapes, strict=True))
        memory = replace(memory, groups=groups, mean=mean, covariance=covariance,
                         consistency=memory.consistency.after(innovation, seen, residual,
                                                              last.degrees))
        return estimate_of(self._estimate, memory, looks=self._estimate.looks + 1, converged=True,
                           misfit=last.misfit, outliers=last.outliers, surprise=float(surprise),
                           _shape=evaluated.shapes[-1])


def memory_of(observer: Observer, estimate: Estimate) -> Memory:
    """Return the Memory of an Estimate, a new one where nothing was seen."""
    if estimate._memory is not None:
        memory: Memory = estimate._memory
        return memory
    unit = observer.uncertain.deviations
    return Memory.of(estimate.mean / unit, estimate.covariance / np.outer(unit, unit),
                     observer.robot.acting.size)


def estimate_of(estimate: Estimate, memory: Memory, **changes: Any) -> Estimate:
    """Return an Estimate with the mean and covariance of a Memory."""
    unit = estimate.uncertain.deviations
    n = unit.size
    return replace(estimate, mean=memory.mean[:n] * unit,
                   covariance=memory.covariance[:n, :n] * np.outer(unit, unit), _memory=memory,
                   **changes)


def innovation_of(before: Floats, expected: Floats, after: Floats,
                  left: Floats) -> tuple[float, float]:
    """Return the chi-square by which a look moved a state, and its degrees of freedom.

    The change of a Kalman filter's state has the covariance P- less P+; only directions count in
    which the look lowered the variance.
    """
    root = np.linalg.cholesky(expected)
    moved = solve_triangular(root, after - before, lower=True)
    half = solve_triangular(root, left, lower=True)
    values, vectors = np.linalg.eigh(symmetric(solve_triangular(root, half.T, lower=True)))
    gained = 1.0 - values
    seen = gained > _SEEN
    return float(np.sum((vectors.T @ moved)[seen] ** 2 / gained[seen])), float(seen.sum())


def _limit(degrees: float) -> float:
    """Return what a chi-square of so many degrees of freedom hardly ever exceeds."""
    return float(chi2.isf(_RARE, max(degrees, 1.0)))


def symmetric(matrix: Floats) -> Floats:
    """Return the symmetric part of a matrix (n, n)."""
    return 0.5 * (matrix + matrix.T)
