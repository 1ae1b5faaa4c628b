# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The most likely state after the looks so far, and how far off it may be.

An iterated extended Kalman filter (Bell and Cathey 1993: each update is a Gauss-Newton search) in
information form. A filter that keeps each look linearized at the estimate of its time becomes too
sure of itself: the difference between two linearizations looks like information about what no look
shows, such as stiffness against weight. So the looks from the last few poses of the gripper are
remembered and searched together (a smoother with a fixed lag); older ones stay linearized.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from dlo_planner.direct.indicator import surely_within
from dlo_planner.direct.shape import Shape
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.looking import Distances, Told, from_either_end, looked_at, squares, told
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.response import node_slopes
from dlo_planner.identify.settling import settled
from dlo_planner.identify.uncertain import mesh_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

if TYPE_CHECKING:
    from dlo_planner.identify.observer import Observer

_ITERATIONS = 30
_HALVINGS = 8
_SETTLED = 1e-3   # mean square of the last step, in standard deviations of the estimate
_STEADY = 1.05    # ratio of two successive scales of the residuals that count as equal
_FARTHEST = 0.15  # of the length: by which one step may move a node
_ENOUGH = 1e-4    # part of the decrease predicted for a step that it has to give (Armijo)
_STILL = 1e-6     # of the noise: a smaller sway counts as none
_POSES = 3        # of the gripper, whose looks are remembered
_LOOKS = 32       # remembered at each of them


@dataclass(frozen=True, eq=False)
class Group:
    """Looks at one pose of the gripper, oldest first.

    Attributes
    ----------
    gripper : Pose
        Pose as commanded.
    looks : tuple of (ndarray, ndarray or None)
        Of each look: (points (m, 3), arc lengths from the gripper (m,) or None).
    shape : Shape
        Shape from which the next search begins.
    noise : float
        Noise in m, see `Observer`, of these looks.
    sway : float
        Sway in m, see `Observer`, of these looks.
    """

    gripper: Pose
    looks: tuple[tuple[Floats, Floats | None], ...]
    shape: Shape
    noise: float
    sway: float

    def takes(self, other: Group) -> bool:
        """Return whether looks of another Group can be added to this one."""
        return (self.gripper, self.noise, self.sway) == (other.gripper, other.noise, other.sway)

    def stacked(self) -> Iterator[tuple[Floats, np.ndarray | None]]:
        """Yield points (m, 3) and arc lengths (m,) or None, look by look only if they sway."""
        if self.sway:
            yield from self.looks
            return
        for known in (True, False):
            some = [look for look in self.looks if (look[1] is not None) == known]
            if some:
                points, s = zip(*some, strict=True)
                yield np.concatenate(points), np.concatenate(s) if known else None


@dataclass(frozen=True, eq=False)
class Memory:
    """The information in an estimate; the state x in standard deviations of the prior.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Mean of the prior and of forgotten looks.
    matrix : ndarray, shape (n, n)
        Their information matrix.
    groups : tuple of Group
        The looks that are remembered, oldest first.
    """

    x: Floats
    matrix: Floats
    groups: tuple[Group, ...]

    def with_linear(self, rows: Floats, right: Floats) -> Memory:
        """Return the Memory with k measurements of unit variance: rows (k, n) @ x = right (k,)."""
        matrix = self.matrix + rows.T @ rows
        return replace(self, matrix=matrix,
                       x=solved(matrix, self.matrix @ self.x + rows.T @ right))

    def with_look(self, new: Group) -> tuple[Memory, Group | None]:
        """Return the Memory with a Group of one new look, and the Group to be forgotten or None.

        Looks at the same pose, with the same noise and sway, are joined in one Group.
        """
        old = self.groups
        if old and old[-1].takes(new):
            last = replace(old[-1], looks=(*old[-1].looks, *new.looks), shape=new.shape)
            if len(last.looks) <= _LOOKS:
                return replace(self, groups=(*old[:-1], last)), None
            half = _LOOKS // 2
            first = replace(last, looks=last.looks[:half])
            return replace(self, groups=(*old[:-1], replace(last, looks=last.looks[half:]))), first
        groups = (*old, new)
        if len(groups) <= _POSES:
            return replace(self, groups=groups), None
        return replace(self, groups=groups[1:]), groups[0]


def solved(matrix: Floats, right: Floats) -> Floats:
    """Return x (n,) with matrix (n, n) @ x = right (n,)."""
    return cast(Floats, np.linalg.solve(matrix, right))


class Evaluated(NamedTuple):
    """A state x (n,), the Shape of each group there, and the Distances of its points from it."""

    x: Floats
    shapes: list[Shape]
    distances: list[list[tuple[Distances, bool]]]


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
        self._observer, self._estimate, self._seen = observer, estimate, observation
        self._uncertain, self._unit = observer.uncertain, observer.uncertain.deviations
        memory: Memory | None = estimate._memory
        if memory is None or wandered:
            covariance = estimate.covariance / np.outer(self._unit, self._unit)
            information = np.linalg.inv(covariance + wandered * np.eye(self._unit.size))
            memory = Memory(estimate.mean / self._unit, cast(Floats, information), ())
        self._memory = memory

    def found(self) -> Estimate | None:
        """Return the Estimate, or None if no equilibrium explains the look."""
        x, last = self._estimate.mean / self._unit, np.inf
        shape = self._first()
        if not shape.converged:
            return None
        s, points = self._seen.s, self._seen.points
        if s is not None:
            s = from_either_end(shape, points, s)
        memory, forgotten = self._memory.with_look(
            Group(self._seen.gripper, ((points, s),), shape, self._noise, self._sway))
        if forgotten is not None:
            folded = self._folded(memory, forgotten, x)
            if folded is None:
                return None
            memory = folded
        self._memory = memory
        here = self._at(x, [group.shape for group in memory.groups])
        for _ in range(_ITERATIONS):
            if here is None:
                return None
            matrix, down, scales, seen = self._told(here)
            step = solved(matrix, down)
            slope = float(step @ down)
            steady = last <= _STEADY * scales[-1] or scales[-1] == self._noise
            if slope < _SETTLED * step.size and steady:
                return self._result(here, step, matrix, seen)
            here, last = self._moved(here, step, slope, scales), scales[-1]
        return None

    def _first(self) -> Shape:
        """Return the Shape at the gripper's pose of this look, with the state before it."""
        estimate = self._estimate
        simulator, known = self._uncertain.simulator, estimate._shape
        groups = self._memory.groups
        if known is not None and groups and groups[-1].gripper == self._seen.gripper:
            self._varied = self._uncertain.varied(mesh_of(known))
            return known
        gripper = estimate.actual(self._seen.gripper)
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

    def _told(self, here: Evaluated) -> tuple[Floats, Floats, list[float], tuple[float, float]]:
        """Return the information matrix (n, n), minus the gradient (n,), scales and fit.

        The scales, m, are the noise with which each group is weighed. The fit is the misfit, m, and
        the part of outliers of the last group's last look.
        """
        memory, scales = self._memory, []
        matrix, down = memory.matrix.copy(), memory.matrix @ (memory.x - here.x)
        for group, shape, distances in zip(memory.groups, here.shapes, here.distances, strict=True):
            for one in self._told_by(here.x, group, shape, distances):
                matrix += one.matrix
                down += one.vector
            scales.append(one.scale)
        return matrix, down, scales, (one.misfit, one.outliers)

    def _told_by(self, x: Floats, group: Group, shape: Shape,
                 distances: Sequence[tuple[Distances, bool]]) -> Iterator[Told]:
        """Yield the Told of a group's looks."""
        slopes = node_slopes(self._varied, x * self._unit, shape)
        for off, known in distances:
            look = looked_at(self._uncertain, shape, slopes, off, known)
            yield told(replace(look, slopes=look.slopes * self._unit), group.noise,
                       self._observer.outliers, group.sway, shape.s[-1])

    def _moved(self, here: Evaluated, step: Floats, slope: float,
               scales: Sequence[float]) -> Evaluated | None:
        """Return the Evaluated after a step, halved until it lowers the cost; None: never."""
        part, cost = 1.0, self._cost(here, scales)
        for _ in range(_HALVINGS):
            trial = self._at(here.x + part * step, here.shapes)
            if trial is not None and self._near(here.shapes, trial.shapes) and self._cost(
                    trial, scales) <= cost - _ENOUGH * part * slope:
                return trial
            part *= 0.5
        return None

    def _near(self, shapes: Sequence[Shape], trial: Sequence[Shape]) -> bool:
        return all(np.abs(one.positions - other.positions).max() <= _FARTHEST * one.s[-1]
                   for one, other in zip(shapes, trial, strict=True))

    def _cost(self, here: Evaluated, scales: Sequence[float]) -> float:
        """Return minus the logarithm of the likelihood, up to a constant: what is minimized."""
        memory, outliers = self._memory, self._observer.outliers
        off = here.x - memory.x
        cost = 0.5 * float(off @ memory.matrix @ off)
        for group, shape, distances, scale in zip(memory.groups, here.shapes, here.distances,
                                                  scales, strict=True):
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
        for one in self._told_by(x, group, shape, self._distances(group, shape, bias)):
            matrix += one.matrix
            vector += one.matrix @ x + one.vector
        return replace(memory, x=solved(matrix, vector), matrix=matrix)

    def _result(self, here: Evaluated, step: Floats, matrix: Floats,
                seen: tuple[float, float]) -> Estimate:
        covariance = np.linalg.inv(matrix) * np.outer(self._unit, self._unit)
        groups = tuple(replace(group, shape=shape)
                       for group, shape in zip(self._memory.groups, here.shapes, strict=True))
        return replace(self._estimate, mean=(here.x + step) * self._unit,
                       covariance=symmetric(covariance), looks=self._estimate.looks + 1,
                       converged=True, misfit=seen[0], outliers=seen[1], _shape=here.shapes[-1],
                       _memory=replace(self._memory, groups=groups))


def symmetric(matrix: Floats) -> Floats:
    """Return the symmetric part of a matrix (n, n)."""
    return 0.5 * (matrix + matrix.T)
