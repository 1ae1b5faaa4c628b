# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far observed points are from a DLO, at rest or in motion, with derivatives by the unknowns.

At rest they come from the sensitivities of the equilibrium, in motion from differences of motions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.boundary_motion import GripTrajectory
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.identify.observation import Observation, ObservedMotion
from dlo_planner.identify.parameters import ParameterizedMesh
from dlo_planner.identify.unknowns import Unknowns
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.supports import FarEnd
from dlo_planner.progress import Progress

MOVED = 1e-3  # of a unit: for differences of motions
_AT_REST, _IN_MOTION = 1e-6, 1e-4  # relative errors of the derivatives
ROUGHLY, EXACTLY = 2e-4, 1e-4  # of the length: error of the steps of motions
_MOST_PARTS = 16  # of a motion's dt
_KEPT = 4  # values of x whose residuals are remembered
_ITERATIONS = 20


class PointResiduals(NamedTuple):
    """m seen points less those of a shape that they are of."""

    off: Floats      # (m, 3) m, world axes
    s: Floats        # (m,) arc lengths of the DLO's points, m
    frames: Floats   # (m, 3, 3) there
    outward: Bools   # (m,) which are beyond an end, to which they are nearest


def point_residuals(shape: Shape, points: Floats, s: Floats | None = None,
                    bent: Floats | None = None) -> PointResiduals:
    """Return the PointResiduals of points (m, 3), at s (m,), m, or from the nearest of the DLO.

    `bent` (k, 3), m: by how much the DLO is off the shape at even arc lengths.
    """
    nodes, kernels = np.array(shape.s), kernel_arrays(shape)  # copies: see `kernel_arrays`
    even = np.linspace(0, nodes[-1], 0 if bent is None else len(bent))

    def off_shape(at: Floats) -> Floats:
        if bent is None:
            return np.zeros(3)
        return np.stack([np.interp(at, even, part) for part in bent.T], axis=1)

    outward = np.zeros(len(points), dtype=bool)
    if s is None:
        at, outward = nearest(nodes, *kernels, np.array(points))
        if bent is not None:  # the nearest place of the bent DLO
            at, outward = nearest(nodes, *kernels, points - off_shape(at))
    else:
        at = np.clip(s, 0.0, nodes[-1])
    frames, places = _points_at(nodes, *kernels, at)
    return PointResiduals(points - places - off_shape(at), at, frames, outward)


def from_either_end(shape: Shape, points: Floats, s: Floats) -> Floats:
    """Return the arc lengths (m,), from the other end if the points (m, 3) fit better so."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(point_residuals(shape, points, one).off, axis=1))
           for one in both]
    return both[int(off[1] < off[0])]


@dataclass(frozen=True, eq=False)
class Residuals:
    """Distances of m points from a DLO, m, that a fit minimizes.

    Along the axes of the DLO where an arc length is sought, the world's else. A nearest point
    slides along the DLO, but not over its end: `counts` are the components that are observed.
    """

    away: Floats                  # (m, 3)
    counts: Bools                 # (m, 3)
    slopes: Callable[[], Floats]  # (m, 3, n) derivatives of `away` by the unknowns
    shape: Shape                  # or the last one of the motion
    converged: bool               # whether all is solved


def _nowhere(points: Floats, length: float, size: int, shape: Shape) -> Residuals:
    """Return what stands for points (m, 3) of a DLO that was not solved."""
    m = len(points)
    return Residuals(np.full((m, 3), length), np.ones((m, 3), dtype=bool),
                     lambda: np.zeros((m, 3, size)), shape, False)


def _at_rest(unknowns: Unknowns, one: Observation, shape: Shape, errors: PoseErrors,
             x: Floats) -> Residuals:
    """Return the Residuals of an Observation from its Shape at unknowns x (n,)."""
    seen = point_residuals(shape, one.points, one.s)
    m, counts = len(one.points), np.ones((len(one.points), 3), dtype=bool)
    axes = np.tile(np.eye(3), (m, 1, 1))
    if one.s is None:
        axes, counts[:, 0] = seen.frames, seen.outward

    def slopes() -> Floats:
        out, k = np.zeros((m, 3, x.size)), unknowns.size
        sensitivity = Sensitivity(shape)
        mesh = ParameterizedMesh(unknowns.parameters, shape.state.made_on)
        out[:, :, :k] = -mesh.slopes(unknowns.units * x[:k], shape, seen.s,
                                     sensitivity) * unknowns.units
        if errors.count:
            by_twist = np.array([sensitivity.at(value)[3:] for value in seen.s])
            by_twist[:, :, :3] = by_twist[:, :, :3] @ left_jacobian(errors.twist[:3])
            out[:, :, errors.where] = -by_twist @ errors.deviations.T
        result: Floats = np.einsum('mji,mjk->mik', axes, out) * counts[:, :, None]
        return result

    return Residuals(np.einsum('mji,mj->mi', axes, seen.off) * counts, counts, slopes, shape, True)


def _in_motion(one: ObservedMotion, x: Floats,
              positions_at: Callable[[Floats], tuple[Floats | None, Shape]],
              columns: Sequence[tuple[int, bool]], size: int, length: float) -> Residuals:
    """Return the Residuals of an ObservedMotion at unknowns x (n,)."""
    points = one.points.reshape(-1, 3)
    positions, shape = positions_at(x)
    if positions is None:
        return _nowhere(points, length, size, shape)

    def slopes() -> Floats:
        out = np.zeros((len(points), 3, size))
        for k, both in columns:
            step = np.zeros_like(x)
            step[k] = MOVED
            ahead = positions_at(x + step)[0]
            back = positions_at(x - step)[0] if both else positions
            if ahead is None or back is None:  # the edge of what can be solved
                continue
            out[:, :, k] = (back - ahead).reshape(-1, 3) / (2 * MOVED if both else MOVED)
        return out

    return Residuals(points - positions.reshape(-1, 3), np.ones((len(points), 3), dtype=bool),
                     slopes, shape, True)


def _with_displacements(residuals: Residuals, displacements: Floats, amounts: Floats,
                        where: slice) -> Residuals:
    """Return the Residuals where points are displaced by other causes in addition.

    Shapes: displacements (j, k, m, 3), amounts (j,).
    """
    if not residuals.converged:
        return residuals
    by_amount = displacements.reshape(len(displacements), *residuals.away.shape)

    def slopes() -> Floats:
        out = residuals.slopes()
        out[:, :, where] = -by_amount.transpose(1, 2, 0)
        return out

    return Residuals(residuals.away - np.tensordot(amounts, by_amount, 1), residuals.counts,
                     slopes, residuals.shape, True)


class PoseErrors:
    """The error of the gripper's pose in one observation: `where` of the unknowns x (n,).

    They are in standard deviations: `deviations` (count, 6) are unit twists times these, rad
    before m.
    """

    def __init__(self, deviations: Floats, where: slice, x: Floats) -> None:
        self.deviations, self.where, self.count = deviations, where, len(deviations)
        self.twist = x[where] @ deviations

    def applied(self, pose: Pose) -> Pose:
        """Return the Pose with this error."""
        return displaced(pose, self.twist)


class StackedResiduals:
    """The Residuals of all observations, as one; `any` tells whether one of them is solved."""

    def __init__(self, parts: Sequence[Residuals]) -> None:
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


class MeasurementModel:
    """Observations as a function of unknowns x (n,): parameters, errors of poses, displacements.

    Errors of each pose are in standard deviations, `pose` (k, 6) are unit twists times these; that
    of a motion is the same all along.
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
        self.forget()

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
        self.forget()
        return before != self._parts

    def use_central_differences(self) -> None:
        """Take central differences of motions from now on: twice the cost, hardly an error."""
        self._central = True
        self.forget()

    def by_motion(self, rows: Floats) -> list[Floats]:
        """Return of each motion (k, points, ...): the rows (m, ...) of its k instants."""
        sizes = [one.points.shape[:2] for one in self.motions]
        first = len(rows) - sum(k * m for k, m in sizes)
        ends = first + np.cumsum([0, *(k * m for k, m in sizes)])
        return [rows[begin:begin + k * m].reshape(k, m, *rows.shape[1:])
                for begin, (k, m) in zip(ends[:-1], sizes, strict=True)]

    def forget(self) -> None:
        """Forget the shapes from which the search for the next ones begins."""
        self._cache: dict[bytes, StackedResiduals] = {}
        self._known_shapes: dict[int, Shape] = {}
        self._initials: dict[int, Shape] = {}

    def at(self, x: Floats) -> StackedResiduals:
        """Return the StackedResiduals at unknowns x (n,)."""
        key = x.tobytes()
        if key not in self._cache:
            self._cache = {**dict(list(self._cache.items())[1 - _KEPT:]), key: self._at(x)}
        return self._cache[key]

    def errors(self, index: int, x: Floats) -> PoseErrors:
        """Return the PoseErrors of an observation (motions come after what is at rest)."""
        begin = self.n_parameters + len(self._pose) * index
        return PoseErrors(self._pose, slice(begin, begin + len(self._pose)), x)

    def grippers(self, x: Floats) -> tuple[Pose, ...]:
        """Return the Poses of the observations at rest, corrected."""
        return tuple(self.errors(k, x).applied(one.gripper)
                     for k, one in enumerate(self.observations))

    def _at(self, x: Floats) -> StackedResiduals:
        direct = self._simulator(x)
        parts = []
        for index, one in enumerate(self.observations):
            errors = self.errors(index, x)
            shape = self._shape(direct, index, one, errors)
            self._progress.check()
            parts.append(_at_rest(self.unknowns, one, shape, errors, x) if shape.converged
                         else _nowhere(one.points, self.rod.length, x.size, shape))
        parts += [self._motion(index, one, x) for index, one in enumerate(self.motions)]
        return StackedResiduals(parts)

    def _simulator(self, x: Floats) -> DirectSimulator:
        return DirectSimulator(self.unknowns.of(x[:self.n_parameters]), **self._options)

    def _shape(self, direct: DirectSimulator, index: int, one: Observation,
               errors: PoseErrors) -> Shape:
        """Return the Shape of an observation.

        It is set down in its natural shape each time: from another shape it may come to a third.
        A DLO held at both ends, which takes long to get there, stays where it was led once.
        """
        gripper = errors.applied(one.gripper)
        before = self._known_shapes.get(index)
        shape = direct.solve(gripper, before, far_end=one.far_end)
        if before is not None and not shape.converged:
            shape = direct.solve(gripper, far_end=one.far_end)
        if one.far_end is not None and shape.converged:
            self._known_shapes[index] = shape
        return shape

    def _motion(self, index: int, one: ObservedMotion, x: Floats) -> Residuals:
        where = self.errors(len(self.observations) + index, x).where
        lower = self.bounds[0]
        columns = [(k, self._central and x[k] - MOVED >= lower[k]) for k in range(x.size)
                   if k < self.n_parameters or where.start <= k < where.stop]
        residuals = _in_motion(one, x, partial(self._seen, index, one), columns, x.size,
                               self.rod.length)
        if one.displacements is None:
            return residuals
        others = self._displaced[index]
        return _with_displacements(residuals, one.displacements, x[others], others)

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
        initial = self._initial(direct, index, grippers[0], ends) if one.initial is None else (
            one.initial)
        motion = direct.simulate(grippers, one.dt / parts, initial, far_ends=ends,
                                 tolerance=np.inf)
        self._progress.check()
        solved = motion.converged and len(motion) == len(grippers)
        seen = positions_in_motion(motion, one.times, one.s) if solved else None
        return seen, motion.shapes[-1]

    def _initial(self, direct: DirectSimulator, index: int, gripper: Pose,
               ends: list[FarEnd] | None) -> Shape | None:
        """Return the static Shape in which a DLO held at both ends begins; None: it is free."""
        if ends is None:
            return None
        shape = direct.solve(gripper, self._initials.get(index), far_end=ends[0])
        if not shape.converged:
            return None
        self._initials.setdefault(index, shape)
        return shape


def _refined(given: list[Pose], dt: float, parts: int) -> list[Pose]:
    """Return Poses at `parts` times as many instants, on the smooth way through those given."""
    if parts == 1:
        return given
    guide = GripTrajectory(given, dt)
    return [guide.at(k / parts) for k in range((len(given) - 1) * parts + 1)]


def positions_in_motion(motion: Motion, times: Floats, s: Floats) -> Floats:
    """Return positions (k, m, 3) of the points at arc lengths `s` (m,) in a Motion at `times` (k,).

    Between the instants of the motion they go on cubics with its velocities.
    """
    out = np.empty((len(times), len(s), 3))
    for k, time in enumerate(times):
        j = int(np.clip(np.searchsorted(motion.times, time, side='right') - 1, 0, len(motion) - 2))
        step = motion.times[j + 1] - motion.times[j]
        f = (time - motion.times[j]) / step
        (here, speed), (there, later) = (_moving(motion, i, s) for i in (j, j + 1))
        out[k] = ((1 + 2 * f) * (1 - f) ** 2 * here + f**2 * (3 - 2 * f) * there
                  + step * f * (1 - f) * ((1 - f) * speed - f * later))
    return out


def _moving(motion: Motion, index: int, s: Floats) -> tuple[Floats, Floats]:
    """Return positions (m, 3) and velocities (m, 3) at arc lengths s (m,) at an instant."""
    shape, velocities = motion.shapes[index], motion.velocities[index]
    return shape.positions_at(s), np.column_stack([np.interp(s, shape.s, velocities[:, i])
                                                   for i in range(3)])


@kernel
def nearest(s: Floats, lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
            points: Floats) -> tuple[Floats, Bools]:
    """Return arc lengths (m,) of the DLO's nearest points, and whether each is beyond an end.

    Chords tell the element, Newton's method finds the point on its arc and those beside it.

    Args:
        s: (N + 1,) m; lengths: (N,); strains: (N, 3); rotations: (N + 1, 3, 3);
            positions: (N + 1, 3); points: (m, 3)
    """
    n = lengths.size
    out, outward = np.empty(points.shape[0]), np.zeros(points.shape[0], dtype=np.bool_)
    frame, x = np.empty((3, 3)), np.empty(3)
    for j in range(points.shape[0]):
        best = np.inf
        place = 0.0
        for e in range(n):
            along = square = 0.0
            for i in range(3):
                chord = positions[e + 1, i] - positions[e, i]
                along += (points[j, i] - positions[e, i]) * chord
                square += chord * chord
            share = min(max(along / square, 0.0), 1.0)
            distance = 0.0
            for i in range(3):
                distance += (points[j, i] - (1 - share) * positions[e, i]
                             - share * positions[e + 1, i]) ** 2
            if distance < best:
                best, place = distance, s[e] + share * lengths[e]
        for _ in range(_ITERATIONS):
            e = min(max(np.searchsorted(s, place, side='right') - 1, 0), n - 1)  # type: ignore[assignment]
            point_inside(lengths, strains, rotations, positions, e, (place - s[e]) / lengths[e],
                         frame, x)
            slope, bend = 0.0, 1.0
            for i in range(3):
                off = points[j, i] - x[i]
                slope += off * frame[i, 0]
                bend -= off * (strains[e, 2] * frame[i, 1] - strains[e, 1] * frame[i, 2])
            step = slope / max(bend, 0.5)
            outward[j] = (place == 0.0 and slope < 0.0) or (place == s[n] and slope > 0.0)
            target = min(max(place + step, 0.0), s[n])
            still = abs(target - place) <= 1e-13 * s[n]
            if still:
                break
            place = target
        out[j] = place
    return out, outward


@kernel
def _points_at(nodes: Floats, lengths: Floats, strains: Floats, rotations: Floats,
               positions: Floats, s: Floats) -> tuple[Floats, Floats]:
    """Return axes (m, 3, 3) and positions (m, 3) at arc lengths s (m,)."""
    m, n = s.size, lengths.size
    axes, places = np.empty((m, 3, 3)), np.empty((m, 3))
    for j in range(m):
        e = min(max(np.searchsorted(nodes, s[j], side='right') - 1, 0), n - 1)
        point_inside(lengths, strains, rotations, positions, e, (s[j] - nodes[e]) / lengths[e],
                     axes[j], places[j])
    return axes, places
