# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The most likely state after the looks so far, and its covariance.

An iterated extended Kalman filter (Bell and Cathey 1993: each update is a Gauss-Newton search) in
information form. A filter that keeps each look linearized at the estimate of its time becomes too
sure of itself: the difference between two linearizations looks like information about what no look
shows, such as stiffness against weight. So the looks from the last few poses of the gripper are
remembered and searched together (a smoother with a fixed lag); older ones stay linearized.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from dlo_planner.direct.indicator import surely_within
from dlo_planner.direct.shape import Shape
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.looking import (
    Distances,
    Information,
    from_either_end,
    information_of,
    looked_at,
    squares,
)
from dlo_planner.identify.memory import Group, Memory, solved
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.response import node_slopes
from dlo_planner.identify.settling import settled
from dlo_planner.identify.uncertain import mesh_of
from dlo_planner.model.arrays import Floats

if TYPE_CHECKING:
    from dlo_planner.identify.observer import Observer

_ITERATIONS = 30
_HALVINGS = 8
_SETTLED = 1e-3   # mean square of the last step, in standard deviations of the estimate
_STEADY = 1.05    # ratio of two successive scales of the residuals that count as equal
_FARTHEST = 0.15  # of the length: by which one step may move a node
_ENOUGH = 1e-4    # part of the decrease predicted for a step that it has to give (Armijo)
_STILL = 1e-6     # of the noise: a smaller sway counts as none


class Evaluated(NamedTuple):
    """A state x (n,), the Shape of each group there, and the Distances of its points from it."""

    x: Floats
    shapes: list[Shape]
    distances: list[list[tuple[Distances, bool]]]


class _Equations(NamedTuple):
    """The normal equations of a step.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
        Information matrix.
    down : ndarray, shape (n,)
        Minus the gradient of the cost.
    scales : list of float
        Noise with which each group is weighed, m.
    fit : (float, float)
        Misfit, m, and part of outliers of the last group's last look.
    """

    matrix: Floats
    down: Floats
    scales: list[float]
    fit: tuple[float, float]


class Search:
    """One more look at the DLO.

    Parameters
    ----------
    observer : Observer
    estimate : Estimate
        Estimate before the look.
    observation : Observation
    wandered : float
        Variance by which the state has wandered since, as a part of the prior's.
    noise, sway : float
        Noise and sway in m, of this look.
    """

    def __init__(self, observer: Observer, estimate: Estimate, observation: Observation,
                 wandered: float, noise: float, sway: float) -> None:
        self._noise, self._sway = noise, sway if sway > _STILL * noise else 0.0
        self._observer, self._estimate, self._observation = observer, estimate, observation
        self._uncertain, self._unit = observer.uncertain, observer.uncertain.deviations
        memory: Memory | None = estimate._memory
        if memory is None or wandered:
            covariance = estimate.covariance / np.outer(self._unit, self._unit)
            information = np.linalg.inv(covariance + wandered * np.eye(self._unit.size))
            memory = Memory(estimate.mean / self._unit, cast(Floats, information), ())
        self._memory = memory

    def estimate(self) -> Estimate | None:
        """Return the Estimate, or None if no equilibrium explains the look."""
        x, last = self._estimate.mean / self._unit, np.inf
        shape = self._first()
        if not shape.converged:
            return None
        s, points = self._observation.s, self._observation.points
        if s is not None:
            s = from_either_end(shape, points, s)
        memory, forgotten = self._memory.with_look(
            Group(self._observation.gripper, ((points, s),), shape, self._noise, self._sway))
        if forgotten is not None:
            folded = self._folded(memory, forgotten, x)
            if folded is None:
                return None
            memory = folded
        self._memory = memory
        evaluated = self._at(x, [group.shape for group in memory.groups])
        for _ in range(_ITERATIONS):
            if evaluated is None:
                return None
            matrix, down, scales, fit = self._equations(evaluated)
            step = solved(matrix, down)
            slope = float(step @ down)
            steady = last <= _STEADY * scales[-1] or scales[-1] == self._noise
            if slope < _SETTLED * step.size and steady:
                return self._result(evaluated, step, matrix, fit)
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

    def _at(self, x: Floats, before: Sequence[Shape]) -> Evaluated | None:
        """Return the Evaluated at x, searched from Shapes `before`; None: not converged."""
        z, shapes, distances = x * self._unit, [], []
        offset, bias = self._uncertain.offset(z), self._uncertain.camera(z)
        for group, known in zip(self._memory.groups, before, strict=True):
            shape = settled(self._varied, z, group.gripper.compose(offset), known, followed=False)
            if not shape.converged:
                return None
            shapes.append(shape)
            distances.append(self._distances(group, shape, bias))
        return Evaluated(x, shapes, distances)

    def _distances(self, group: Group, shape: Shape, bias: Floats) -> list[tuple[Distances, bool]]:
        """Return [(Distances, whether arc lengths were seen)] of a group's looks."""
        return [(squares(shape, points - bias, s), s is not None)
                for points, s in group.stacked()]

    def _equations(self, evaluated: Evaluated) -> _Equations:
        """Return the _Equations of a step from a state."""
        memory, scales = self._memory, []
        matrix, down = memory.matrix.copy(), memory.matrix @ (memory.x - evaluated.x)
        for group, shape, distances in zip(memory.groups, evaluated.shapes, evaluated.distances,
                                           strict=True):
            for one in self._information_by(evaluated.x, group, shape, distances):
                matrix += one.matrix
                down += one.vector
            scales.append(one.scale)
        return _Equations(matrix, down, scales, (one.misfit, one.outliers))

    def _information_by(self, x: Floats, group: Group, shape: Shape,
                 distances: Sequence[tuple[Distances, bool]]) -> Iterator[Information]:
        """Yield the Information of a group's looks."""
        slopes = node_slopes(self._varied, x * self._unit, shape)
        for off, known in distances:
            look = looked_at(self._uncertain, shape, slopes, off, known)
            yield information_of(replace(look, slopes=look.slopes * self._unit), group.noise,
                       self._observer.outliers, group.sway, shape.s[-1])

    def _moved(self, evaluated: Evaluated, step: Floats, slope: float,
               scales: Sequence[float]) -> Evaluated | None:
        """Return the Evaluated after a step, halved until it lowers the cost; None: never."""
        part, cost = 1.0, self._cost(evaluated, scales)
        for _ in range(_HALVINGS):
            trial = self._at(evaluated.x + part * step, evaluated.shapes)
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
        memory, outliers = self._memory, self._observer.outliers
        off = evaluated.x - memory.x
        cost = 0.5 * float(off @ memory.matrix @ off)
        for group, shape, distances, scale in zip(
                memory.groups, evaluated.shapes, evaluated.distances, scales, strict=True):
            cost += sum(one.cost(scale, outliers, group.sway, shape.s[-1])
                        for one, _ in distances)
        return cost

    def _folded(self, memory: Memory, group: Group, x: Floats) -> Memory | None:
        """Return the Memory with a forgotten Group, linearized at x; None: no equilibrium."""
        offset = self._uncertain.offset(x * self._unit)
        shape = settled(self._varied, x * self._unit, group.gripper.compose(offset), group.shape,
                        followed=False)
        if not shape.converged:
            return None
        matrix, vector = memory.matrix.copy(), memory.matrix @ memory.x
        bias = self._uncertain.camera(x * self._unit)
        for one in self._information_by(x, group, shape, self._distances(group, shape, bias)):
            matrix += one.matrix
            vector += one.matrix @ x + one.vector
        return replace(memory, x=solved(matrix, vector), matrix=matrix)

    def _result(self, evaluated: Evaluated, step: Floats, matrix: Floats,
                fit: tuple[float, float]) -> Estimate:
        covariance = np.linalg.inv(matrix) * np.outer(self._unit, self._unit)
        groups = tuple(replace(group, shape=shape)
                       for group, shape in zip(self._memory.groups, evaluated.shapes, strict=True))
        return replace(self._estimate, mean=(evaluated.x + step) * self._unit,
                       covariance=symmetric(covariance), looks=self._estimate.looks + 1,
                       converged=True, misfit=fit[0], outliers=fit[1], _shape=evaluated.shapes[-1],
                       _memory=replace(self._memory, groups=groups))


def symmetric(matrix: Floats) -> Floats:
    """Return the symmetric part of a matrix (n, n)."""
    return 0.5 * (matrix + matrix.T)
