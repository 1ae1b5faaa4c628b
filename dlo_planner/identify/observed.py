# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Observations as a function of what is unknown: properties of the rod, errors of the poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from dlo_planner.direct.boundary_motion import Guide
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.identify.misfit import (
    MOVED,
    STEP,
    Misfit,
    PoseErrors,
    at_rest,
    in_motion,
    nowhere,
    seen_in,
    with_others,
)
from dlo_planner.identify.observation import Observation, ObservedMotion
from dlo_planner.identify.unknowns import Unknowns
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import FarEnd
from dlo_planner.progress import Progress
from dlo_planner.verify.uncertain import mesh_of

_AT_REST, _IN_MOTION = 1e-6, 1e-4  # relative errors of the derivatives
ROUGHLY, EXACTLY = 2e-4, 1e-4  # of the length: error of the steps of motions
_MOST_PARTS = 16  # of a motion's dt
_KEPT = 4  # values of x whose misfits are remembered


class Misfits:
    """The Misfits of all observations, as one.

    Attributes
    ----------
    away : ndarray, shape (m, 3)
        Distances in m.
    counts : ndarray of bool, shape (m, 3)
        As of a Misfit.
    shapes : tuple of Shape
        Shapes of the observations.
    converged : bool
        Whether all are solved.
    any : bool
        Whether one is.
    """

    away: Floats
    counts: Bools
    shapes: tuple[Shape, ...]
    converged: bool
    any: bool

    def __init__(self, parts: Sequence[Misfit]) -> None:
        self._parts = parts
        self.away, self.counts = (np.concatenate([getattr(part, name) for part in parts])
                                  for name in ('away', 'counts'))
        self.shapes = tuple(part.shape for part in parts)
        self.converged = all(part.converged for part in parts)
        self.any = any(part.converged for part in parts)

    @cached_property
    def slopes(self) -> Floats:
        """(m, 3, n) derivatives of `away` by the unknowns; computed when first read."""
        return np.concatenate([part.slopes() for part in self._parts])


class Observed:
    """Observations as a function of unknowns x (n,): parameters, errors of poses, displacements.

    Errors of each pose are in standard deviations; that of a motion is the same all along.

    Parameters
    ----------
    unknowns : Unknowns
    observations : sequence of Observation
    motions : sequence of ObservedMotion
    pose : ndarray, shape (k, 6)
        Unit vectors times standard deviations, rad before m, of the errors to be found.
    options : dict
        Options of the `DirectSimulator`.
    progress : Progress
    """

    def __init__(self, unknowns: Unknowns, observations: Sequence[Observation],
                 motions: Sequence[ObservedMotion], pose: Floats, options: Mapping[str, Any],
                 progress: Progress) -> None:
        self.unknowns, self.rod = unknowns, unknowns.rod
        self.observations, self.motions = observations, motions
        self._pose, self._options, self._progress = pose, options, progress
        self.n_parameters = unknowns.size
        causes = [0 if one.displacements is None else len(one.displacements) for one in motions]
        ends = unknowns.size + len(pose) * (len(observations) + len(motions)) + np.cumsum(
            [0, *causes])
        self._displaced = [slice(*both) for both in zip(ends[:-1], ends[1:], strict=True)]
        self.size = int(ends[-1])
        free = np.full(self.size - unknowns.size, np.inf)
        self.bounds = np.append(unknowns.lower, -free), np.append(unknowns.upper, free)
        self.precision = _IN_MOTION if motions else _AT_REST
        self._parts = [1] * len(motions)  # steps in each dt
        self._central = False
        self.begin()

    def choose_steps(self, x: Floats, tolerance: float = EXACTLY) -> bool:
        """Halve the steps of the motions until that changed little at x (n,).

        They then stay the same: steps that follow an error would make derivatives noisy.
        """
        before = list(self._parts)
        for index, one in enumerate(self.motions):
            self._parts[index] = max(self._parts[index] // 2, 1)
            coarse, _ = self._seen(index, one, x)
            while self._parts[index] < _MOST_PARTS:
                self._parts[index] *= 2
                fine, _ = self._seen(index, one, x)
                if coarse is not None and fine is not None and (
                        np.abs(fine - coarse).max() <= tolerance * self.rod.length):
                    break
                coarse = fine
        self.begin()
        return before != self._parts

    def differ_centrally(self) -> None:
        """Take central differences of motions from now on: twice the cost, hardly an error."""
        self._central = True
        self.begin()

    def of_motions(self, rows: Floats) -> list[Floats]:
        """Return of each motion (k, points, ...): the rows (m, ...) of its k instants."""
        sizes = [one.points.shape[:2] for one in self.motions]
        first = len(rows) - sum(k * m for k, m in sizes)
        ends = first + np.cumsum([0, *(k * m for k, m in sizes)])
        return [rows[begin:begin + k * m].reshape(k, m, *rows.shape[1:])
                for begin, (k, m) in zip(ends[:-1], sizes, strict=True)]

    def begin(self) -> None:
        """Forget the shapes from which the search for the next ones begins."""
        self._known: dict[bytes, Misfits] = {}
        self._held: dict[int, Shape] = {}
        self._begins: dict[int, Shape] = {}

    def at(self, x: Floats) -> Misfits:
        """Return the Misfits at unknowns x (n,)."""
        key = x.tobytes()
        if key not in self._known:
            self._known = {**dict(list(self._known.items())[1 - _KEPT:]), key: self._at(x)}
        return self._known[key]

    def errors(self, index: int, x: Floats) -> PoseErrors:
        """Return the PoseErrors of an observation (motions come after what is at rest)."""
        begin = self.n_parameters + len(self._pose) * index
        return PoseErrors(self._pose, slice(begin, begin + len(self._pose)), x)

    def grippers(self, x: Floats) -> tuple[Pose, ...]:
        """Return the Poses of the observations at rest, corrected."""
        return tuple(self.errors(k, x).applied(one.gripper)
                     for k, one in enumerate(self.observations))

    def _at(self, x: Floats) -> Misfits:
        direct = self._simulator(x)
        nearby = _Nearby(self.unknowns, x)
        parts = []
        for index, one in enumerate(self.observations):
            errors = self.errors(index, x)
            shape = self._shape(direct, index, one, errors)
            self._progress.check()
            parts.append(at_rest(one, shape, nearby.on, errors) if shape.converged
                         else nowhere(one.points, self.rod.length, x.size, shape))
        parts += [self._motion(index, one, x) for index, one in enumerate(self.motions)]
        return Misfits(parts)

    def _simulator(self, x: Floats) -> DirectSimulator:
        return DirectSimulator(self.unknowns.of(x[:self.n_parameters]), **self._options)

    def _shape(self, direct: DirectSimulator, index: int, one: Observation,
               errors: PoseErrors) -> Shape:
        """Return the Shape of an observation.

        It is set down in its natural shape each time: from another shape it may come to a third.
        A DLO held at both ends, which takes long to get there, stays where it was led once.
        """
        gripper = errors.applied(one.gripper)
        before = self._held.get(index)
        shape = direct.solve(gripper, before, far_end=one.far_end)
        if before is not None and not shape.converged:
            shape = direct.solve(gripper, far_end=one.far_end)
        if one.far_end is not None and shape.converged:
            self._held[index] = shape
        return shape

    def _motion(self, index: int, one: ObservedMotion, x: Floats) -> Misfit:
        where = self.errors(len(self.observations) + index, x).where
        lower = self.bounds[0]
        columns = [(k, self._central and x[k] - MOVED >= lower[k]) for k in range(x.size)
                   if k < self.n_parameters or where.start <= k < where.stop]
        misfit = in_motion(one, x, partial(self._seen, index, one), columns, x.size,
                           self.rod.length)
        if one.displacements is None:
            return misfit
        others = self._displaced[index]
        return with_others(misfit, one.displacements, x[others], others)

    def _seen(self, index: int, one: ObservedMotion, x: Floats) -> tuple[Floats | None, Shape]:
        """Return where the points of a motion are at x, (k, m, 3) or None; and its last Shape."""
        parts, errors = self._parts[index], self.errors(len(self.observations) + index, x)
        grippers = _refined([errors.applied(pose) for pose in one.grippers], one.dt, parts)
        ends: list[FarEnd] | None = None
        if one.far_ends is not None:
            given = list(one.far_ends)
            ends = [FarEnd(pose, given[0].grip)
                    for pose in _refined([end.pose for end in given], one.dt, parts)]
        direct = self._simulator(x)
        initial = self._begun(direct, index, grippers[0], ends) if one.initial is None else (
            one.initial)
        motion = direct.simulate(grippers, one.dt / parts, initial, far_ends=ends,
                                 tolerance=np.inf)
        self._progress.check()
        solved = motion.converged and len(motion) == len(grippers)
        return (seen_in(motion, one.times, one.s) if solved else None), motion.shapes[-1]

    def _begun(self, direct: DirectSimulator, index: int, gripper: Pose,
               ends: list[FarEnd] | None) -> Shape | None:
        """Return the static Shape in which a DLO held at both ends begins; None: it is free."""
        if ends is None:
            return None
        shape = direct.solve(gripper, self._begins.get(index), far_end=ends[0])
        if not shape.converged:
            return None
        self._begins.setdefault(index, shape)
        return shape


def _refined(given: list[Pose], dt: float, parts: int) -> list[Pose]:
    """Return Poses at `parts` times as many instants, on the smooth way through those given."""
    if parts == 1:
        return given
    guide = Guide(given, dt)
    return [guide.at(k / parts) for k in range((len(given) - 1) * parts + 1)]


class _Nearby:
    """Rods that differ a little, each on a mesh once for all shapes on that mesh."""

    def __init__(self, unknowns: Unknowns, x: Floats) -> None:
        self._unknowns, self._x = unknowns, x[:unknowns.size]
        self._base: Discretization | None = None
        self._on_base: tuple[tuple[int, Discretization, Discretization], ...] = ()

    @cached_property
    def _rods(self) -> list[tuple[int, Rod, Rod]]:
        columns = np.flatnonzero(self._unknowns.at_rest).tolist()
        steps = STEP * np.eye(self._x.size)[columns]
        return [(k, self._unknowns.of(self._x + step), self._unknowns.of(self._x - step))
                for k, step in zip(columns, steps, strict=True)]

    def on(self, shape: Shape) -> tuple[tuple[int, Discretization, Discretization], ...]:
        """Return (column, Discretization ahead, back) with the elements of a Shape."""
        mesh = mesh_of(shape)
        if mesh is not self._base:
            self._base = mesh
            self._on_base = tuple((k, mesh.of(ahead), mesh.of(back))
                                  for k, ahead, back in self._rods)
        return self._on_base
