# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The rest of a threading, aimed anew for the estimated DLO.

At each remaining waypoint, a coupled Newton system finds the equilibrium of the estimated DLO and
the gripper's rotation together, as planning does (`inverse.solvers.points.aligned`), starting from
the shape known there. The estimated offset of the gripper is then taken off the poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.predicted_miss import PredictedMiss, judged_plan, miss_of
from dlo_planner.identify.uncertain import mesh_of
from dlo_planner.inverse.solvers.conditions import aligned_on
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance, integer, items, results
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.plan import Plan

_LOOKED_AT = 3  # waypoints at which the miss that remains is predicted


@dataclass(frozen=True, eq=False, repr=False)
class Correction(Value):
    """New gripper poses for the m waypoints of a plan from `first` on.

    Attributes
    ----------
    first : int
        Index of the first of them in the plan.
    grippers : tuple of Pose
        The m poses to command.
    offsets : ndarray, shape (m, 6)
        Offsets from the plan's poses to these: rotation vector about the gripper's origin, rad,
        then displacement, m; world axes.
    miss : PredictedMiss
        PredictedMiss that remains, at three of the waypoints that pass the center, the first and
        the last among them.
    converged : bool
        Whether every waypoint could be aimed; if not, the poses are the plan's, and a new plan is
        needed.
    shapes : tuple of Shape
        The m shapes: of the estimated DLO where the center is passed, else the plan's.
    """

    first: int
    grippers: tuple[Pose, ...]
    offsets: Floats
    miss: PredictedMiss
    converged: bool
    shapes: tuple[Shape, ...]

    def __post_init__(self) -> None:
        grippers = items('Correction.grippers', self.grippers, Pose)
        shapes = items('Correction.shapes', self.shapes, Shape)
        if len(shapes) != len(grippers):
            raise InvalidTask(f'Correction.shapes has {len(shapes)} entries: expected one per '
                              f'entry of Correction.grippers, {len(grippers)}')
        put(self, first=integer('Correction.first', self.first, minimum=0, maximum=10**9),
            grippers=grippers, shapes=shapes,
            offsets=results('Correction.offsets', self.offsets, (len(grippers), 6)),
            miss=instance('Correction.miss', self.miss, PredictedMiss),
            converged=flag('Correction.converged', self.converged))
        super().__post_init__()

    def __repr__(self) -> str:
        moved = np.linalg.norm(self.offsets[:, 3:], axis=1).max(initial=0.0)
        return brief(self, f'{len(self.grippers)} waypoints from {self.first} on',
                     '' if self.converged else 'not converged', f'moved up to {moved:.2g} m',
                     f'miss with 95 % up to {self.miss.bound.max(initial=0.0):.2g} m')


def correct(estimate: Estimate, plan: Plan, first: int = 0,
            before: Correction | None = None) -> Correction:
    """Return the Correction of the remaining waypoints of a plan.

    At each waypoint that passes the center, the DLO passes it at the planned arc length, along the
    normal. A waypoint before these is displaced like the first of them. Neither clearance nor
    workspace is checked again. The poses are quasi-static; `Steered` blends them into a motion.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the DLO that the plan is for.
    plan : Plan
        Plan through one cut-out, in commanded poses, unchanged since it was made.
    first : int, optional
        Index of the waypoint to which the gripper goes next.
    before : Correction, optional
        An earlier Correction of the same plan, whose shapes begin the search. If None, those of the
        plan.

    Raises
    ------
    InvalidTask
        An argument makes no sense.
    """
    judged_plan(instance('estimate', estimate, Estimate), plan)
    if not len(plan):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    first = integer('first', first, minimum=0, maximum=len(plan) - 1)
    if any(len(passes) > 1 or passes and passes[0][2] is None for passes in plan.via_points):
        raise InvalidTask('plan: expected one through one cut-out, along its normal')
    known = _known(plan, instance('before', before, Correction, optional=True))
    rest = range(first, len(plan))
    aim = _Aim(estimate)
    shapes: dict[int, Shape] = {}
    for k in rest:
        if plan.via_points[k]:
            shape = aim.shape(plan, k, known[k])
            if shape is None:
                return _as_planned(estimate, plan, rest)
            shapes[k] = shape
    grippers = {k: aim.commanded(shape.gripper) for k, shape in shapes.items()}
    moved = dict(zip(grippers, _offsets([plan.grippers[k] for k in grippers],
                                        list(grippers.values())), strict=True))
    offsets = np.zeros((len(rest), 6))
    for k in rest:  # a waypoint before those that pass the center moves like the first of them
        source = next((j for j in moved if j >= k), None)
        offsets[k - first] = 0.0 if source is None else moved[source]
        if k not in grippers:
            grippers[k] = displaced(plan.grippers[k], offsets[k - first])
    looked = _some([k for k in rest if k in shapes])
    return Correction(first, tuple(grippers[k] for k in rest),
                      offsets, miss_of(estimate, plan, looked, [shapes[k] for k in looked]), True,
                      tuple(shapes.get(k, plan.shapes[k]) for k in rest))


def _known(plan: Plan, before: Correction | None) -> list[Shape]:
    """Return the Shape for each waypoint of the plan from which the search begins."""
    shapes = list(plan.shapes)
    if before is not None:
        if before.first + len(before.shapes) != len(plan):
            raise InvalidTask(f'before = {before!r}: expected a Correction of the same plan')
        shapes[before.first:] = before.shapes
    return shapes


class _Aim:
    """Aims the DLO of an Estimate at a center."""

    def __init__(self, estimate: Estimate) -> None:
        self._estimate, self._offset = estimate, estimate.gripper_offset
        self._meshes: dict[int, Discretization] = {}

    def shape(self, plan: Plan, index: int, guess: Shape) -> Shape | None:
        """Return the Shape that passes the center at a waypoint, or None."""
        center, s, normal = plan.via_points[index][0]
        assert normal is not None  # `correct` has judged the plan
        mesh = self._mesh(mesh_of(plan.shapes[index]))
        inside = min(s, float(mesh.s[-1]))
        found = aligned_on(mesh, guess, inside, normal, plan.grippers[index].rotation)
        if found is None or found.shape.stability < -NEUTRAL:
            return None
        shape = found.shape
        axes, position = shape.frame_at(inside)
        position = position + (s - inside) * axes[:, 0]
        result: Shape | None = shape.moved(self._estimate.center(center) - position)
        return result

    def commanded(self, gripper: Pose) -> Pose:
        """Return `Estimate.commanded`, quickly."""
        rotation = gripper.rotation @ self._offset.rotation.T
        return Pose.from_rotation(gripper.position - rotation @ self._offset.position, rotation)

    def _mesh(self, planned: Discretization) -> Discretization:
        """Return the Discretization of the estimated DLO on the mesh of a planned one."""
        if id(planned) not in self._meshes:  # waypoints share them
            varied = self._estimate.uncertain.varied(planned)
            self._meshes[id(planned)] = varied.at(self._estimate.mean)
        return self._meshes[id(planned)]


def _as_planned(estimate: Estimate, plan: Plan, rest: Sequence[int]) -> Correction:
    looked = _some([k for k in rest if plan.via_points[k]])
    return Correction(rest[0], tuple(plan.grippers[k] for k in rest), np.zeros((len(rest), 6)),
                      miss_of(estimate, plan, looked), False,
                      tuple(plan.shapes[k] for k in rest))


def _offsets(planned: Sequence[Pose], grippers: Sequence[Pose]) -> Floats:
    """Return (k, 6) the rotation vectors and displacements from k Poses to others."""
    if not grippers:
        return np.zeros((0, 6))
    turns = Rotation.from_matrix(np.array([one.rotation @ other.rotation.T for other, one in zip(
        planned, grippers, strict=True)])).as_rotvec()
    return np.hstack([turns, [one.position - other.position for other, one in zip(
        planned, grippers, strict=True)]])


def _some(indices: Sequence[int]) -> list[int]:
    """Return a few of these indices, the first and the last among them."""
    few = np.unique(np.linspace(0, len(indices) - 1, min(len(indices), _LOOKED_AT)).astype(int))
    return [indices[k] for k in few] if indices else []
