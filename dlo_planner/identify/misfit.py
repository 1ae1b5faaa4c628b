# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far observed points are from a DLO, at rest or in motion, with derivatives by the unknowns.

At rest they come from the sensitivities of the equilibrium, in motion from differences of motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.identify.observation import Observation, ObservedMotion
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.pose import Pose, displaced

# Of a Shape: column, Discretizations ahead and back, of each unknown that the rod depends on.
Nearby: TypeAlias = Callable[[Shape], Iterable[tuple[int, Discretization, Discretization]]]

STEP = 1e-5  # of a unit: for differences of predicted shapes
MOVED = 1e-3  # the same, for differences of motions
_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Misfit:
    """Distances of m points from a DLO.

    Attributes
    ----------
    away : ndarray, shape (m, 3)
        Distances in m, in axes of the DLO where an arc length is sought, in the world's else.
    counts : ndarray, shape (m, 3)
        Which of them are observed: a nearest point slides along the DLO, but not over its end.
    slopes : callable
        Function that returns (m, 3, n), their derivatives by the unknowns.
    shape : Shape
        The Shape, or the last one of the motion.
    converged : bool
        Whether all is solved.
    """

    away: Floats
    counts: Floats
    slopes: Callable[[], Floats]
    shape: Shape
    converged: bool


def nowhere(points: Floats, length: float, size: int, shape: Shape) -> Misfit:
    """Return what stands for points (m, 3) of a DLO that was not solved."""
    m = len(points)
    return Misfit(np.full((m, 3), length), np.ones((m, 3), dtype=bool),
                  lambda: np.zeros((m, 3, size)), shape, False)


def at_rest(one: Observation, shape: Shape, nearby: Nearby, errors: PoseErrors) -> Misfit:
    """Return the Misfit of an Observation from its Shape."""
    m = len(one.points)
    s, counts = one.s, np.ones((m, 3), dtype=bool)
    if s is None:
        # copies: the kernel is compiled for arrays that may be written
        s, outward = nearest(*map(np.array, (shape.s, np.diff(shape.s), shape.element_strains,
                                             shape.frames, shape.positions, one.points)))
        counts[:, 0] = outward
    axes, positions = (np.array(part) for part in zip(*map(shape.frame_at, s), strict=True))
    if one.s is not None:
        axes = np.tile(np.eye(3), (m, 1, 1))
    away = np.einsum('mji,mj->mi', axes, one.points - positions)

    def slopes() -> Floats:
        out = np.zeros((m, 3, errors.size))
        sensitivity = Sensitivity(shape)
        for k, *sides in nearby(shape):
            ahead, back = (np.array([moved.frame_at(value)[1] for value in s])
                           for moved in map(sensitivity.predicted_on, sides))
            out[:, :, k] = (back - ahead) / (2 * STEP)
        if errors.count:
            by_twist = np.array([sensitivity.at(value)[3:] for value in s])
            by_twist[:, :, :3] = by_twist[:, :, :3] @ left_jacobian(errors.twist[:3])
            out[:, :, errors.where] = -by_twist @ errors.deviations.T
        result: Floats = np.einsum('mji,mjk->mik', axes, out) * counts[:, :, None]
        return result

    return Misfit(away * counts, counts, slopes, shape, True)


def in_motion(one: ObservedMotion, x: Floats,
              positions_at: Callable[[Floats], tuple[Floats | None, Shape]],
              columns: Sequence[tuple[int, bool]], size: int, length: float) -> Misfit:
    """Return the Misfit of an ObservedMotion at unknowns x (n,)."""
    points = one.points.reshape(-1, 3)
    positions, shape = positions_at(x)
    if positions is None:
        return nowhere(points, length, size, shape)

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

    return Misfit(points - positions.reshape(-1, 3), np.ones((len(points), 3), dtype=bool), slopes,
                  shape, True)


def with_others(misfit: Misfit, displacements: Floats, amounts: Floats, where: slice) -> Misfit:
    """Return the Misfit where points are displaced by other causes in addition.

    Shapes: displacements (j, k, m, 3), amounts (j,).
    """
    if not misfit.converged:
        return misfit
    by_amount = displacements.reshape(len(displacements), *misfit.away.shape)

    def slopes() -> Floats:
        out = misfit.slopes()
        out[:, :, where] = -by_amount.transpose(1, 2, 0)
        return out

    return Misfit(misfit.away - np.tensordot(amounts, by_amount, 1), misfit.counts, slopes,
                  misfit.shape, True)


def seen_in(motion: Motion, times: Floats, s: Floats) -> Floats:
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


class PoseErrors:
    """The error of the gripper's pose in one observation, unknown in standard deviations.

    Parameters
    ----------
    deviations : ndarray, shape (count, 6)
        Unit twists times standard deviations, rad before m.
    where : slice
        Slice of the unknowns x that belong to it.
    x : ndarray, shape (n,)
        All unknowns.
    """

    def __init__(self, deviations: Floats, where: slice, x: Floats) -> None:
        self.deviations, self.where, self.count, self.size = (deviations, where, len(deviations),
                                                              x.size)
        self.twist = x[where] @ deviations

    def applied(self, pose: Pose) -> Pose:
        """Return the Pose with this error."""
        return displaced(pose, self.twist)


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
