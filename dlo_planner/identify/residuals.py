# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far observed points are from a DLO, at rest or in motion, with derivatives by the unknowns.

At rest they come from the sensitivities of the equilibrium, in motion from differences of motions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from dlo_planner.direct.boundary_motion import GripTrajectory
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.identify.branches import seen_starts
from dlo_planner.identify.observation import Observation, ObservedMotion
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.progress import Progress
from dlo_planner.uncertainty.parameters import ParameterizedMesh, Unknowns

MOVED = 1e-3  # of a unit: for differences of motions
_AT_REST, _IN_MOTION = 1e-6, 1e-4  # relative errors of the derivatives
ROUGHLY, EXACTLY = 2e-4, 1e-4  # of the length: error of the steps of motions
_MOST_PARTS = 16  # of a motion's dt
_KEPT = 4  # values of x whose residuals are remembered
_ITERATIONS = 20
_SEEN = 1e-6  # of a tangent's length: what is shorter in a picture has no direction there
_STILL = 1e-13  # of the length: the last step to a nearest point
# Shapes whose points are off by less than so many times as much fit a picture as well: loops with a
# turn of twist are 0.8 to 1.2 times as far off those of 6 photographs as loops without, by guesses
# of the stiffness from half to twice what it is.
_ALIKE = 1.5


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


def picture_residuals(shape: Shape, points: Floats, s: Floats | None,
                      normal: Floats) -> tuple[PointResiduals, Bools]:
    """Return the PointResiduals of points (m, 3) of a picture, and which components count (m, 3).

    Their frames are across the normal (3,) in the third axis, which is not measured. Of a point
    whose arc length is not known the first is along the DLO in the picture, where it slides.
    """
    nodes, kernels = np.array(shape.s), kernel_arrays(shape)
    plane = np.linalg.svd(normal[None])[2][1:].T
    outward = np.zeros(len(points), dtype=bool)
    if s is None:
        at, outward = _nearest_in_picture(shape, points @ plane, plane)
    else:
        at = np.clip(s, 0.0, nodes[-1])
    frames, places = _points_at(nodes, *kernels, at)
    along = np.tile(plane[:, 0], (len(points), 1))
    if s is None:
        tangents = frames[:, :, 0] @ plane @ plane.T
        size = np.linalg.norm(tangents, axis=1)
        seen = size > _SEEN  # else the DLO is seen end on, and any direction will do
        along[seen] = tangents[seen] / size[seen, None]
    axes = np.stack([along, np.cross(normal, along), np.tile(normal, (len(points), 1))], axis=2)
    counts = np.ones((len(points), 3), dtype=bool)
    counts[:, 2] = False
    if s is None:
        counts[:, 0] = outward
    return PointResiduals((points - places) @ plane @ plane.T, at, axes, outward), counts


def _nearest_in_picture(shape: Shape, points: Floats, plane: Floats) -> tuple[Floats, Bools]:
    """Return arc lengths (m,) nearest to points (m, 2) in a plane (3, 2), and which are beyond.

    As `nearest`: chords tell the element, Newton's method finds the point.
    """
    nodes, kernels, strains = np.array(shape.s), kernel_arrays(shape), shape.element_strains
    corners = shape.positions @ plane
    chords = np.diff(corners, axis=0)
    squares = np.maximum(np.sum(chords**2, axis=1), np.finfo(float).tiny)
    shares = np.clip(np.sum((points[:, None] - corners[:-1]) * chords, axis=2) / squares, 0.0, 1.0)
    away = np.sum((points[:, None] - corners[:-1] - shares[:, :, None] * chords) ** 2, axis=2)
    best = away.argmin(axis=1)
    at = nodes[best] + shares[np.arange(len(points)), best] * np.diff(nodes)[best]
    outward = np.zeros(len(points), dtype=bool)
    for _ in range(_ITERATIONS):
        frames, places = _points_at(nodes, *kernels, at)
        elements = np.clip(np.searchsorted(nodes, at, side='right') - 1, 0, len(strains) - 1)
        off, tangents = points - places @ plane, frames[:, :, 0] @ plane
        bends = (strains[elements, 2:] * frames[:, :, 1]
                 - strains[elements, 1:2] * frames[:, :, 2]) @ plane
        slope, square = np.sum(off * tangents, axis=1), np.sum(tangents**2, axis=1)
        curved = np.maximum(square - np.sum(off * bends, axis=1), 0.5 * square)
        step = slope / np.maximum(curved, _SEEN**2)
        outward = (at == 0.0) & (slope < 0.0) | (at == nodes[-1]) & (slope > 0.0)
        moved = np.clip(at + step, 0.0, nodes[-1])
        if (np.abs(moved - at) <= _STILL * nodes[-1]).all():
            break
        at = moved
    return at, outward


def from_either_end(shape: Shape, points: Floats, s: Floats) -> Floats:
    """Return the arc lengths (m,), from the other end if the points (m, 3) fit better so."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(point_residuals(shape, points, one).off, axis=1))
           for one in both]
    return both[int(off[1] < off[0])]


class Residuals:
    """Distances `away` (m, 3) of m points from DLOs, m, that a fit minimizes.

    Along the axes of the DLO where an arc length is sought, the world's else. A nearest point
    slides along the DLO, but not over its end: `counts` (m, 3) are the observed components.
    `shapes` are those of all observations, or the last ones of motions; `solved` which are known.
    """

    def __init__(self, away: Floats, counts: Bools, slopes: Callable[[], Floats],
                 shapes: tuple[Shape, ...], solved: tuple[bool, ...]) -> None:
        self.away, self.counts, self.shapes, self.solved = away, counts, shapes, solved
        self._slopes = slopes

    @classmethod
    def stacked(cls, parts: Sequence[Residuals]) -> Residuals:
        """Return the Residuals of all observations, as one."""
        return cls(np.concatenate([part.away for part in parts]),
                   np.concatenate([part.counts for part in parts]),
                   lambda: np.concatenate([part.slopes for part in parts]),
                   tuple(shape for part in parts for shape in part.shapes),
                   tuple(solved for part in parts for solved in part.solved))

    @cached_property
    def slopes(self) -> Floats:
        """(m, 3, n) derivatives of `away` by the unknowns; computed when first read."""
        return self._slopes()


def _nowhere(points: Floats, length: float, size: int, shape: Shape) -> Residuals:
    """Return what stands for points (m, 3) of a DLO that was not solved."""
    m = len(points)
    return Residuals(np.full((m, 3), length), np.ones((m, 3), dtype=bool),
                     lambda: np.zeros((m, 3, size)), (shape,), (False,))


def _at_rest(unknowns: Unknowns, one: Observation, shape: Shape, errors: PoseErrors,
             x: Floats) -> Residuals:
    """Return the Residuals of an Observation from its Shape at unknowns x (n,)."""
    m, counts = len(one.points), np.ones((len(one.points), 3), dtype=bool)
    axes = np.tile(np.eye(3), (m, 1, 1))
    if one.normal is not None:
        seen, counts = picture_residuals(shape, one.points, one.s, one.normal)
        axes = seen.frames
    else:
        seen = point_residuals(shape, one.points, one.s)
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

    return Residuals(np.einsum('mji,mj->mi', axes, seen.off) * counts, counts, slopes, (shape,),
                     (True,))


class PoseErrors:
    """The error of one pose: `where` of the unknowns x (n,), in units `deviations` (count, 6)."""

    def __init__(self, deviations: Floats, where: slice, x: Floats) -> None:
        self.deviations, self.where, self.count = deviations, where, len(deviations)
        self.twist = x[where] @ deviations

    def applied(self, pose: Pose) -> Pose:
        """Return the Pose with this error."""
        return displaced(pose, self.twist)


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
        self._branches: dict[int, Shape | None] = {}  # from which the first search begins
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
        self._cache: dict[bytes, Residuals] = {}
        self._known_shapes: dict[int, Shape] = {}

    def at(self, x: Floats) -> Residuals:
        """Return the Residuals of all observations at unknowns x (n,)."""
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

    def _at(self, x: Floats) -> Residuals:
        direct = self._simulator(x)
        parts = []
        for index, one in enumerate(self.observations):
            errors = self.errors(index, x)
            shape = self._shape(direct, index, errors.applied(one.gripper),
                                FarEnd.of(one.far_end))
            self._progress.check()
            parts.append(_at_rest(self.unknowns, one, shape, errors, x) if shape.converged
                         else _nowhere(one.points, self.rod.length, x.size, shape))
        parts += [self._motion(index, one, x) for index, one in enumerate(self.motions)]
        return Residuals.stacked(parts)

    def _simulator(self, x: Floats) -> DirectSimulator:
        return DirectSimulator(self.unknowns.of(x[:self.n_parameters]), **self._options)

    def _shape(self, direct: DirectSimulator, index: int, gripper: Pose,
               far_end: FarEnd | None) -> Shape:
        """Return the Shape of an observation, or in which a motion begins.

        It is set down in its natural shape each time, or begins on the branch that was chosen once:
        from another shape it may come to a third. A DLO held at both ends, which takes long to get
        there, stays where it was led once.
        """
        before = self._known_shapes.get(index)
        if before is None and index < len(self.observations):
            if index not in self._branches:
                self._branches[index] = self._branch(direct, self.observations[index], gripper,
                                                     far_end)
            before = self._branches[index]
        shape = direct.solve(gripper, before, far_end=far_end)
        if before is not None and not shape.converged:
            shape = direct.solve(gripper, far_end=far_end)
        if far_end is not None and shape.converged:
            self._known_shapes[index] = shape
        return shape

    def _branch(self, direct: DirectSimulator, one: Observation, gripper: Pose,
                far_end: FarEnd | None) -> Shape | None:
        """Return the Shape from which the first search begins, None for the natural one."""
        if isinstance(one.initial, Shape):
            return one.initial
        if one.initial is not None:
            shape = None
            for pose, end in one.initial:
                shape = direct.solve(pose, shape, far_end=end)
            return shape
        if far_end is None:
            return None
        found = [direct.solve(gripper, start, far_end=far_end)
                 for start in (None, *seen_starts(direct, one, gripper, far_end))]
        fitting = [(self._misfit(one, shape), k) for k, shape in enumerate(found)
                   if shape.converged]
        if not fitting:
            return None
        least, best = min(fitting)
        if one.normal is not None:  # twist hardly shows: of alike ones the least strained is meant
            best = min((k for misfit, k in fitting if misfit <= _ALIKE * least),
                       key=lambda k: found[k].energy)
        return found[best]

    @staticmethod
    def _misfit(one: Observation, shape: Shape) -> float:
        """Return the median distance of an Observation's points from a Shape, m."""
        off = (point_residuals(shape, one.points, one.s) if one.normal is None else
               picture_residuals(shape, one.points, one.s, one.normal)[0]).off
        return float(np.median(np.linalg.norm(off, axis=1)))

    def _motion(self, index: int, one: ObservedMotion, x: Floats) -> Residuals:
        """Return the Residuals of a motion, whose points other causes may displace in addition."""
        where, others = self.errors(len(self.observations) + index, x).where, self._displaced[index]
        points = one.points.reshape(-1, 3)
        displaced = np.zeros((0, *points.shape)) if one.displacements is None else (
            one.displacements.reshape(-1, *points.shape))
        positions, shape = self._seen(index, one, x)
        if positions is None:
            return _nowhere(points, self.rod.length, x.size, shape)

        def slopes() -> Floats:
            out = np.zeros((*points.shape, x.size))
            out[:, :, others] = -displaced.transpose(1, 2, 0)
            for k in (*range(self.n_parameters), *range(where.start, where.stop)):
                step = MOVED * np.eye(x.size)[k]
                both = self._central and x[k] - MOVED >= self.bounds[0][k]
                ahead = self._seen(index, one, x + step)[0]
                back = self._seen(index, one, x - step)[0] if both else positions
                if ahead is not None and back is not None:  # else the edge of what can be solved
                    out[:, :, k] = (back - ahead).reshape(-1, 3) / (2 * MOVED if both else MOVED)
            return out

        away = points - positions.reshape(-1, 3) - np.tensordot(x[others], displaced, 1)
        return Residuals(away, np.ones(points.shape, dtype=bool), slopes, (shape,), (True,))

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
        initial = one.initial
        if initial is None and ends is not None:
            initial = self._shape(direct, len(self.observations) + index, grippers[0], ends[0])
            initial = initial if initial.converged else None
        motion = direct.simulate(grippers, one.dt / parts, initial, far_ends=ends,
                                 tolerance=np.inf)
        self._progress.check()
        solved = motion.converged and len(motion) == len(grippers)
        seen = positions_in_motion(motion, one.times, one.s) if solved else None
        return seen, motion.shapes[-1]


def _refined(given: list[Pose], dt: float, parts: int) -> list[Pose]:
    """Return Poses at `parts` times as many instants, on the smooth way through those given."""
    if parts == 1:
        return given
    guide = GripTrajectory(given, dt)
    return [guide.at(k / parts) for k in range((len(given) - 1) * parts + 1)]


def positions_in_motion(motion: Motion, times: Floats, s: Floats) -> Floats:
    """Return the points (k, m, 3) at `s` (m,) and `times` (k,), on cubics between the instants."""
    places = [shape.positions_at(s) for shape in motion.shapes]
    speeds = [[np.interp(s, shape.s, part) for part in velocities.T]
              for shape, velocities in zip(motion.shapes, motion.velocities, strict=True)]
    out: Floats = CubicHermiteSpline(motion.times, places, np.swapaxes(speeds, 1, 2))(times)
    return out


@kernel
def nearest(s: Floats, lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
            points: Floats) -> tuple[Floats, Bools]:
    """Return arc lengths (m,) of the DLO's nearest points to (m, 3), and whether beyond an end.

    Chords tell the element, Newton's method finds the point on its arc and those beside it.
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
