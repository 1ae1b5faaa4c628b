# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The answer of the inverse simulation: gripper poses, the shapes they make, and their proof."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from os import PathLike
from typing import NamedTuple, overload

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.storage import load, save
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, integer, items, number, results, shown
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import brief, put
from dlo_planner.pictured import Filmed
from dlo_planner.plan.goals import DirectionAt, FrameAt, PositionAt, Residuals
from dlo_planner.plan.passing import Passes, arc_lengths_at, first_center
from dlo_planner.plan.path import pose_at_arc_length
from dlo_planner.plan.plan_storage import plan_arrays, plan_contents

# fields of a Plan with an entry for each waypoint
PER_WAYPOINT = ('depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'times',
                'via_points', 'clearances', 'insertion_force')


class PlanStatus(Enum):
    """How much of the task a plan covers."""

    COMPLETE = 'complete'
    PARTIAL = 'partial'  # only ever as the evidence inside `Infeasible`

    @classmethod
    def _missing_(cls, value: object) -> None:
        choice('PlanStatus', value, [one.value for one in cls])


class PlanPoint(NamedTuple):
    """One waypoint of a Plan: what `Plan` says of it under the same names, in the singular."""

    time: float
    depth: float
    gripper: Pose
    shape: Shape
    position_error: float
    misalignment: float
    clearance: float


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Filmed):
    """A sequence of gripper poses; n waypoints.

    Attributes
    ----------
    depths : ndarray, shape (n,)
        Arc length that has gone through the cut-out, m.
    grippers : tuple of Pose
        The n poses.
    shapes : tuple of Shape
        The n shapes, the DLO at each waypoint.
    misalignment : ndarray, shape (n,)
        Angle between DLO and normal at the cut-out, rad; of a contact against the requested
        direction.
    position_error : ndarray, shape (n,)
        Distance of the DLO from the cut-out's center, or that place, m.
    times : ndarray, shape (n,)
        Seconds from the first waypoint, see `timing`.
    via_points : tuple of Passes
        n tuples of (center (3,), s, normal (3,) or None): which arc length should be where.
    clearances : ndarray, shape (n, k, 3)
        Distances in m between the DLO's surface and the sheets around the k cut-outs of the task:
        at the rim (the cut-out may be displaced by it), of the part before the sheet, of the part
        behind it; infinite where a cut-out has no size.
    sheets : tuple of (Sheet, ndarray)
        (Sheet, normal (3,)) around each cut-out that has a size.
    fraction : float
        Part of the requested waypoints that is reached, 1 for a complete plan.
    status : PlanStatus
    stops : tuple of int
        Indices of waypoints at which the gripper stops, besides sharp corners and dwells.
    insertion_force : ndarray, shape (n,)
        Force in N that pushes the DLO on into a bore; below 0 it falls in by itself. An estimate at
        rest (`plan/bore.py`), no bound; nan where it was not looked at: the bore's radius or
        friction is not stated, or nothing is inserted.
    """

    depths: Floats
    grippers: tuple[Pose, ...]
    shapes: tuple[Shape, ...]
    misalignment: Floats
    position_error: Floats
    times: Floats
    via_points: tuple[Passes, ...]
    clearances: Floats
    sheets: tuple[tuple[Sheet, Floats], ...]
    fraction: float
    status: PlanStatus
    stops: tuple[int, ...] = ()
    insertion_force: Floats = ()  # type: ignore[assignment]  # an array (n,) from then on

    def __post_init__(self) -> None:
        grippers = items('Plan.grippers', self.grippers, Pose)
        n = len(grippers)
        if isinstance(self.insertion_force, tuple) and not self.insertion_force:
            put(self, insertion_force=np.full(n, np.nan))
        for name in PER_WAYPOINT:
            if len(items(f'Plan.{name}', getattr(self, name), object)) != n:
                raise InvalidTask(f'Plan.{name} = {shown(getattr(self, name))}: expected one entry '
                                  f'per gripper pose, {n}')
        put(self, grippers=grippers, shapes=items('Plan.shapes', self.shapes, Shape),
            via_points=tuple(items('Plan.via_points', one, tuple)
                         for one in items('Plan.via_points', self.via_points, (Iterable,))),
            clearances=results('Plan.clearances', self.clearances, (n, None, 3)),
            sheets=items('Plan.sheets', self.sheets, tuple),
            fraction=number('Plan.fraction', self.fraction, minimum=0, maximum=1),
            status=instance('Plan.status', self.status, PlanStatus),
            stops=tuple(integer('Plan.stops', stop, minimum=0, maximum=max(n - 1, 0))
                        for stop in items('Plan.stops', self.stops, object)),
            **{name: results(f'Plan.{name}', getattr(self, name), (n,))
               for name in ('depths', 'misalignment', 'position_error', 'times',
                            'insertion_force')})
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.grippers)

    @overload
    def __getitem__(self, index: int) -> PlanPoint: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[PlanPoint, ...]: ...
    def __getitem__(self, index: int | slice) -> PlanPoint | tuple[PlanPoint, ...]:
        """Return the PlanPoint of one waypoint, or several."""
        points = tuple(map(PlanPoint, self.times, self.depths, self.grippers, self.shapes,
                           self.position_error, self.misalignment, self.clearance))
        return points[index]

    def __iter__(self) -> Iterator[PlanPoint]:
        return iter(self[:])

    def __repr__(self) -> str:
        n = len(self)
        return brief(self, f'{n} waypoints', self.status.value,
                     *([f'{self.times[-1]:.4g} s', f'miss {self.position_error.max():.1g} m',
                        f'stability {self.stability.min():.2g}',
                        f'clearance {self.clearance.min():.2g} m'
                        if np.isfinite(self.clearance).any() else ''] if n else []))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan: everything but the rods of its shapes, and what surrounds them.

        As JSON where `path` ends with .json, else as npz; both keep every number exactly.
        """
        save(path, plan_arrays(self), 'Plan')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Plan:
        """Return the Plan saved at `path`; its shapes know no rod, see `Shape.load`.

        Raises
        ------
        InvalidTask
            Not such a file; the message names it.
        """
        result: Plan = load(path, lambda arrays: cls(
                    **plan_contents(arrays), status=PlanStatus(str(arrays['status']))), 'Plan')
        return result

    @property
    def clearance(self) -> Floats:
        """(n,) smallest of the `clearances` of each waypoint, m."""
        result: Floats = self.clearances.min(axis=(1, 2), initial=np.inf)
        return result

    @property
    def goals(self) -> tuple[tuple[Residuals, ...], ...]:
        """N tuples of what the DLO is to be like at each waypoint; their residuals are its misses.

        `PositionAt` of each of its `via_points`, `DirectionAt` of those with a normal; where there
        is none, `FrameAt` of the gripper.
        """
        return tuple(tuple(goal for center, s, normal in points for goal in (
            PositionAt(s, center), *(() if normal is None else (DirectionAt(s, normal),))))
            or (FrameAt(0.0, gripper),)
            for points, gripper in zip(self.via_points, self.grippers, strict=True))

    @property
    def position_errors(self) -> list[list[float]]:
        """N lists of the DLO's distances from each center that it should pass there, m."""
        return [[float(np.linalg.norm(goal.residuals(shape))) for goal in goals
                 if isinstance(goal, PositionAt)]
                for shape, goals in zip(self.shapes, self.goals, strict=True)]

    @property
    def arc_lengths(self) -> Floats:
        """(n,) arc length that is to be in the first cut-out, or in contact, m; nan: none is."""
        return arc_lengths_at(first_center(self.via_points), self.via_points)

    def at_arc_length(self, s: float) -> Pose:
        """Return the Pose of the gripper at which the DLO passes the first cut-out at `s` in m.

        On the path of its `Trajectory`, where it first does.

        Raises
        ------
        InvalidTask
            `s` does not pass it between the waypoints.
        """
        return pose_at_arc_length(self, self.arc_lengths, number('s', s))

    @property
    def velocities(self) -> Floats:
        """(n, 6) linear (m/s) and angular (rad/s) velocity of the gripper, world axes.

        Of the straight motion to the next waypoint at even speed; zero at the end.
        """
        velocities = np.zeros((len(self), 6))
        for k, (one, other) in enumerate(zip(self.grippers, self.grippers[1:], strict=False)):
            seconds = self.times[k + 1] - self.times[k]
            if seconds > 0:
                turn = Rotation.from_matrix(other.rotation @ one.rotation.T).as_rotvec()
                velocities[k] = np.concatenate([other.position - one.position, turn]) / seconds
        return velocities

    @property
    def bore_moment(self) -> Floats:
        """(n, 3) moment in N m, world axes, on the DLO at the mouth of the bore that holds it.

        It bends the part inside straight: (0, EI_n k_n, EI_b k_b) in the material frame, k the
        natural curvature there. nan where nothing is held in a bore.
        """
        return np.array([_straightening(shape) for shape in self.shapes]).reshape(-1, 3)

    @property
    def bend_margin(self) -> Floats:
        """(n,) `Shape.bend_margin` of each waypoint, 1/m."""
        return np.array([shape.bend_margin for shape in self.shapes])

    @property
    def residual(self) -> Floats:
        """(n,) `Shape.residual` of each waypoint."""
        return np.array([shape.residual for shape in self.shapes])

    @property
    def stability(self) -> Floats:
        """(n,) `Shape.stability` of each waypoint."""
        return np.array([shape.stability for shape in self.shapes])


def _straightening(shape: Shape) -> Floats:
    """Return the moment (3,) in N m that makes a DLO go on straight beyond its held far end."""
    if shape.far_end is None or shape.rod is None:
        return np.full(3, np.nan)
    s = shape.s[-1:]
    moment = (shape.rod.stiffnesses(s) * shape.rod.natural_strains(s))[0]
    moment[0] = 0.0  # its twist is free
    result: Floats = shape.frames[-1] @ moment
    return result
