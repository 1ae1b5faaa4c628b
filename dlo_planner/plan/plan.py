# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The answer of the inverse simulation: gripper poses, the shapes they make, and their proof."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlo_planner.direct.grasp import grasped_at
from dlo_planner.direct.shape import Shape, carried, pack, unpack
from dlo_planner.direct.storage import load, pose_of_row, pose_row, save
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import (
    choice,
    instance,
    integer,
    items,
    number,
    results,
    row,
    shown,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import BORE, FIXTURE, Hold, alike, place_of
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import brief, freeze, put
from dlo_planner.pictured import Filmed
from dlo_planner.plan.goals import DirectionAt, FrameAt, PositionAt, Residuals, Through
from dlo_planner.plan.margin import GripErrors, least_margin, rating, usual_uncertainty
from dlo_planner.plan.path import GripperPath, held_after
from dlo_planner.plan.stage import (
    GRIPPER,
    Event,
    Metric,
    Stage,
    Starts,
    checked_starts,
    default_starts,
    events_of,
    moving,
    shifted_starts,
    wrenches_of,
)
from dlo_planner.uncertainty.parameters import Uncertainty

# An entry of `Plan.via_points`: center (3,), m; arc length, m; planned direction (3,) or None.
Passes: TypeAlias = Sequence[tuple[Floats, float, Floats | None]]

# fields of a Plan with an entry for each waypoint
PER_WAYPOINT = ('depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'times',
                'via_points', 'clearances', 'insertion_force', 'clearance', 'yield_utilization',
                'insertion_status', 'plug_wrenches')
# What an entry of `Plan.insertion_status` says.
INSERTION_STATUSES = FOUND, JAMS, NO_BALANCE, NOT_LOOKED_AT = (
    'found', 'jams', 'no balance', 'not looked at')
_MAY_BE_LEFT_OUT = 'insertion_force', 'yield_utilization'  # nan where they are
_SAME = 1e-6      # of the length, or of unit vectors: poses that are nearer are one
_STRAIGHT = np.cos(np.deg2rad(5))
_NEAR = 0.1       # of the length: how far before the planned arc length the DLO may pass a center
OBLIQUE = 1e-6    # rad: a smaller `misalignment` is rounding, waypoints are exact to 1e-10 rad
_ARRAYS = {'depths': 'depths', 'misalignment': 'misalignment', 'miss': 'position_error',
           'times': 'times', 'clearances': 'clearances', 'stops': 'stops',
           'insertion_force': 'insertion_force', 'clearance': 'clearance',
           'yield_utilization': 'yield_utilization',
           'plug_wrenches': 'plug_wrenches'}  # in a file: in a Plan


# named figures of the waypoints: attribute, unit, and whether larger (1) or smaller ones are worse
_METRICS = (('position_error', 'm', 1), ('misalignment', 'rad', 1), ('clearance', 'm', -1),
            ('margin', 'm', -1), ('stability', '', -1), ('residual', '', 1),
            ('bend_margin', '1/m', -1), ('yield_utilization', '', 1),
            ('insertion_force', 'N', 1), ('largest_force', 'N', 1), ('largest_moment', 'N m', 1),
            ('plug_force', 'N', 1), ('plug_moment', 'N m', 1), ('friction_needed', '', 1))


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
    """A sequence of gripper poses, in stages; n waypoints.

    Attributes
    ----------
    depths : ndarray, shape (n,)
        Arc length that has gone through the cut-out, m.
    grippers : tuple of Pose
        The n poses.
    shapes : tuple of Shape
        The n shapes, the DLO at each waypoint.
    misalignment : ndarray, shape (n,)
        Angle between DLO and normal at the cut-out, rad, also of a DLO that is planned to pass
        obliquely; of a contact against the requested direction.
    position_error : ndarray, shape (n,)
        Distance of the DLO from the cut-out's center, or that place, m.
    times : ndarray, shape (n,)
        Seconds from the first waypoint, see `timing`.
    via_points : tuple of Passes
        n tuples of (center (3,), s, direction (3,) or None): which arc length should be where, and
        along what: the normal, or the direction in which the DLO is planned to pass obliquely.
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
        rest (`plan/bore.py`), no bound; nan where there is none, which `insertion_status` explains.
    clearance : ndarray, shape (n,)
        Smallest distance in m between the DLO's surface and all that is around it: the sheets of
        its cut-outs and the simulator's obstacles, about 0 where it touches one; infinite where
        there is nothing. If not given, the smallest of the `clearances`.
    yield_utilization : ndarray, shape (n,)
        Largest strain of the DLO, as a part of what it yields at. Plans are elastic: above 1 the
        DLO would yield there and take another shape, now and later, which `replay` shows. nan where
        it was not looked at, or nothing yields.
    insertion_status : tuple of str
        n entries about `insertion_force`. 'found': it is known. 'jams': no push overcomes what
        rubs, since pushing presses the DLO against the bore even more. 'no balance': the part in
        the bore was not found in balance. 'not looked at': the bore's radius or friction is not
        stated, the DLO does not go into it or has no round section, or nothing is inserted.
    uncertainty : Uncertainty or None
        What is not known, for `margin`. If None, the usual one, see `Requirements`.
    starts : tuple of (str, int)
        Name of each of the `stages`, and the index of its first waypoint. If empty, one begins
        wherever the DLO is held otherwise than before, named by what holds it.
    wrench_limits : (float or None, float or None)
        Largest force (N) and moment (N m) that a grip may exert, at rest and in motion; None: any.
    plug : Plug or None
        The plug that the hand holds.
    plug_wrenches : ndarray, shape (n, 6)
        What the hand has to give at the plug's front at rest, `Plug.wrench`: world axes, force (N)
        before moment about the front's middle (N m). nan where it holds no plug.
    """

    _REMEMBERED = ('margin',)

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
    clearance: Floats = ()  # type: ignore[assignment]  # the same
    yield_utilization: Floats = ()  # type: ignore[assignment]  # the same
    insertion_status: tuple[str, ...] = ()
    uncertainty: Uncertainty | None = None
    starts: Starts = ()
    wrench_limits: tuple[float | None, float | None] = (None, None)
    plug: Plug | None = None
    plug_wrenches: Floats = ()  # type: ignore[assignment]  # an array (n, 6) from then on

    def __post_init__(self) -> None:
        grippers = items('Plan.grippers', self.grippers, Pose)
        n = len(grippers)
        put(self, **{name: np.full(n, np.nan) for name in _MAY_BE_LEFT_OUT
                     if isinstance(getattr(self, name), tuple) and not getattr(self, name)})
        wrenches = self.plug_wrenches
        if isinstance(wrenches, tuple) and not wrenches or (
                self.plug is None and isinstance(wrenches, np.ndarray)
                and wrenches.dtype == float and np.isnan(wrenches).all()):
            put(self, plug_wrenches=np.full((n, 6), np.nan))
        if isinstance(self.insertion_status, tuple) and not self.insertion_status:
            forces = results('Plan.insertion_force', self.insertion_force, (n,))
            put(self, insertion_status=tuple(NOT_LOOKED_AT if np.isnan(force) else FOUND
                                             for force in forces))
        for name in PER_WAYPOINT:
            if name != 'clearance' and len(items(f'Plan.{name}', getattr(self, name), object)) != n:
                raise InvalidTask(f'Plan.{name} = {shown(getattr(self, name))}: expected one entry '
                                  f'per gripper pose, {n}')
        put(self, clearances=results('Plan.clearances', self.clearances, (n, None, 3)))
        if isinstance(self.clearance, tuple) and not self.clearance:
            put(self, clearance=self.clearances.min(axis=(1, 2), initial=np.inf))
        put(self, grippers=grippers, shapes=items('Plan.shapes', self.shapes, Shape),
            via_points=tuple(items('Plan.via_points', one, tuple)
                         for one in items('Plan.via_points', self.via_points, (Iterable,))),
            sheets=items('Plan.sheets', self.sheets, tuple),
            fraction=number('Plan.fraction', self.fraction, minimum=0, maximum=1),
            status=instance('Plan.status', self.status, PlanStatus),
            uncertainty=instance('Plan.uncertainty', self.uncertainty, Uncertainty, optional=True),
            plug=instance('Plan.plug', self.plug, Plug, optional=True),
            plug_wrenches=results('Plan.plug_wrenches', self.plug_wrenches, (n, 6)),
            insertion_status=tuple(
                choice('Plan.insertion_status', str(one), INSERTION_STATUSES)
                for one in items('Plan.insertion_status', self.insertion_status, str)),
            stops=tuple(integer('Plan.stops', stop, minimum=0, maximum=max(n - 1, 0))
                        for stop in items('Plan.stops', self.stops, object)),
            **{name: results(f'Plan.{name}', getattr(self, name), (n,))
               for name in ('depths', 'misalignment', 'position_error', 'times',
                            'insertion_force', 'clearance', 'yield_utilization')})
        if not isinstance(self.starts, tuple) or self.starts:
            put(self, starts=checked_starts(self.starts, self.shapes))
        put(self, wrench_limits=tuple(
            limit if limit is None else number('Plan.wrench_limits', limit, above=0)
            for limit in items('Plan.wrench_limits', self.wrench_limits, object, least=2)))
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
        return brief(self, f'{n} waypoint{"" if n == 1 else "s"}', self.status.value,
                     *([f'{self.times[-1]:.4g} s', f'miss {self.position_error.max():.1g} m',
                        f'stability {self.stability.min():.2g}',
                        f'clearance {self.clearance.min():.2g} m'
                        if np.isfinite(self.clearance).any() else '',
                        f'misaligned by {self.misalignment.max():.2g} rad'
                        if self.misalignment.max() > OBLIQUE else '',
                        'it would yield' if self.yields else ''] if n else []))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan: everything but the rods of its shapes, and what surrounds them.

        As JSON where `path` ends with .json, else as npz; both keep every number exactly.
        """
        save(path, plan_tree(self), 'Plan')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Plan:
        """Return the Plan saved at `path`; its shapes know no rod, see `Shape.load`.

        Raises
        ------
        InvalidTask
            Not such a file; the message names it.
        """
        return load(path, plan_of, 'Plan')

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Its stages, in each of which the same places are held in the same ways."""
        starts = self.starts or default_starts(self.shapes)
        ends = [first for _, first in starts[1:]]
        return tuple(Stage(name, first, self.times[first:end], self.shapes[first:end], tuple(
            metric._replace(values=metric.values[first:end]) for metric in self.metrics))
            for (name, first), end in zip(starts, [*ends, len(self)], strict=True))

    @property
    def events(self) -> tuple[Event, ...]:
        """What opens and closes between its `stages`, in this order, while all arms stand."""
        return events_of(self.stages)

    @property
    def stage_plans(self) -> tuple[Plan, ...]:
        """Its `stages` as plans of their own, which are timed, replayed and executed one by one."""
        starts = self.starts or default_starts(self.shapes)
        firsts = [first for _, first in starts]
        return tuple(self._part(name, begin, end) for (name, begin), end in zip(
            starts, [*firsts[1:], len(self)], strict=True))

    @property
    def _passes_by_hands(self) -> bool:
        """Whether it passes cut-outs while hands open or close on the way; a bore is no hand."""
        return any(self.via_points) and len(default_starts(self.shapes)) > 1 and not any(
            hold.by == BORE for shape in self.shapes for hold in shape.holds)

    def _part(self, name: str, begin: int, end: int) -> Plan:
        """Return the waypoints from `begin` on, before `end`, as a stage alone."""
        part = {field: getattr(self, field)[begin:end] for field in PER_WAYPOINT}
        part['times'] = part['times'] - part['times'][0]
        made = replace(self, **part, starts=((name, 0),), stops=tuple(
            stop - begin for stop in self.stops if begin < stop < end - 1))
        if self._passes_by_hands:  # what they are off by depends on where they closed
            margin = self.margin[begin:end].copy()
            freeze(margin)
            put(made, margin=margin)
        return made

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """What is said of each waypoint, as named figures; those of no waypoint are left out."""
        known = tuple(Metric(name, unit, getattr(self, name), worse)
                      for name, unit, worse in _METRICS)
        return tuple(one for one in known if not np.isnan(one.values).all())

    @property
    def arms(self) -> dict[str, tuple[Pose, ...]]:
        """The n poses of each hold that moves, by the name of the arm that moves it.

        That is its `Hold.by`; of what holds the far end without a name, 'far_end'.
        """
        return moving(self.shapes)

    @property
    def paths(self) -> dict[str, GripperPath]:
        """The path of the 'gripper', and that of each of the `arms`, by the same parameter."""
        path = GripperPath.of(self)
        return {name: path.arm(name) for name in (GRIPPER, *path.arms)}

    @property
    def far_end_poses(self) -> tuple[Pose | None, ...]:
        """The n poses of what holds the far end; None where it is free."""
        return tuple(None if shape.far_end is None else shape.far_end.pose
                     for shape in self.shapes)

    @property
    def hold_poses(self) -> tuple[tuple[Pose, ...], ...]:
        """The n tuples of the poses of all holds, by arc length."""
        return tuple(tuple(hold.pose for hold in shape.holds) for shape in self.shapes)

    @property
    def wrenches(self) -> Floats:
        """(n, 1 + A, 6) what the gripper and each of the A holds exert on the DLO, by arc length.

        World axes, force (N) before moment about the place (N m). nan where there are fewer holds
        than elsewhere in the plan.
        """
        return wrenches_of(self.shapes)

    def gripper_wrench_at(self, times: ArrayLike) -> Floats:
        """Return what the gripper exerts on the DLO (m, 6) at the plan's times (m,), s.

        World axes, force (N) before moment about the gripper (N m), linear between the waypoints;
        before the first one and after the last as there. A hand under impedance or force control
        that is fed with it is where the plan has it: at `trajectory.progress(t)`, t s after a
        motion began.

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        times, known = row('times', times, least=0), self.wrenches[:, 0]
        return np.stack([np.interp(times, self.times, one) for one in known.T], axis=1)

    @property
    def tensions(self) -> Floats:
        """(n, 1 + A) largest tension in each span, N, from the gripper on; nan where there is none.

        A the most holds of a waypoint; what lies beyond the last hold is a span, too.
        """
        most = max((len(shape.holds) for shape in self.shapes), default=0)
        out = np.full((len(self), 1 + most), np.nan)
        for spans, shape in zip(out, self.shapes, strict=True):
            length, forces = float(shape.s[-1]), shape.section_forces
            ends = [0.0, *(place_of(hold, length) for hold in shape.holds), length]
            for k, (begin, end) in enumerate(zip(ends, ends[1:], strict=False)):
                # each place stands twice, as seen from both sides
                inside = (0.5 * (forces.s[::2] + forces.s[1::2]) > begin) & (
                    0.5 * (forces.s[::2] + forces.s[1::2]) < end)
                if inside.any():
                    spans[k] = forces.tension.reshape(-1, 2)[inside].max()
        return out

    @property
    def goals(self) -> tuple[tuple[Residuals, ...], ...]:
        """N tuples of what the DLO is to be like at each waypoint; their residuals are its misses.

        `PositionAt` of each of its `via_points`, `DirectionAt` of those with a direction; where
        there is none, `FrameAt` of the gripper.
        """
        return tuple(tuple(goal for center, s, along in points for goal in (
            PositionAt(s, center), *(() if along is None else (DirectionAt(s, along),))))
            or (FrameAt(grasped_at(shape) or 0.0, gripper),)
            for points, gripper, shape in zip(self.via_points, self.grippers, self.shapes,
                                              strict=True))

    @property
    def position_errors(self) -> list[list[float]]:
        """N lists of the DLO's distances from each center that it should pass there, m."""
        return [[float(np.linalg.norm(goal.residuals(shape))) for goal in goals
                 if isinstance(goal, PositionAt)]
                for shape, goals in zip(self.shapes, self.goals, strict=True)]

    @property
    def arc_lengths(self) -> Floats:
        """(n,) arc length that is to be in the first cut-out, or in contact, m; nan: none is."""
        center = next((one[0][0] for one in self.via_points if one), None)
        known = (arc_length_at(center, one) for one in self.via_points)
        return np.array([np.nan if s is None else s for s in known])

    def at_arc_length(self, s: float) -> Pose:
        """Return the Pose of the gripper at which the DLO passes the first cut-out at `s` in m.

        On the path of its `Trajectory`, where it first does.

        Raises
        ------
        InvalidTask
            `s` does not pass it between the waypoints.
        """
        s, known = number('s', s), self.arc_lengths
        between = np.flatnonzero((known[1:] - s) * (known[:-1] - s) <= 0)
        if not between.size:
            passing = known[np.isfinite(known)]
            raise InvalidTask(f's = {s:g}: expected an arc length that passes a cut-out, ' + (
                f'{passing.min():g} to {passing.max():g} m' if passing.size > 1 else 'none does'))
        one, other = between[0], between[0] + 1
        step = known[other] - known[one]
        share = (s - known[one]) / step if step else 0.0
        u = self.times[one] + share * (self.times[other] - self.times[one])
        position, rotation = GripperPath.of(self).at(u)
        return Pose.from_rotation(position[0], rotation[0])

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
        """(n, 3) moment in N m, world axes, on the DLO at the entrance of the bore that holds it.

        It bends the part inside straight: (0, EI_n k_n, EI_b k_b) in the material frame, k the
        natural curvature there. nan where nothing is held in a bore.
        """
        if held_after(self) is None:
            return np.full((len(self), 3), np.nan)
        return np.array([_straightening(shape) for shape in self.shapes]).reshape(-1, 3)

    @property
    def yields(self) -> bool:
        """Whether the DLO would yield at a waypoint, by `yield_utilization`."""
        return bool((self.yield_utilization > 1).any())

    @cached_property
    def margin(self) -> Floats:
        """(n,) what is left of the clearance in the cut-outs that the DLO has come to, m.

        The least of the `clearances` less two standard deviations of the DLO's miss there, across
        itself, to first order under the `uncertainty`; below 0 it misses the hole too often. What
        else holds the DLO is off as the gripper is, by an error of its own; a hand that closes on
        the way, by what the DLO is off where it takes it. nan where there is no size of a cut-out,
        or the DLO is held in a bore or touches something.
        """
        errors, found = None, list[float]()
        rods = [shape.rod for shape in self.shapes]
        if self._passes_by_hands and rods[0] is not None and None not in rods:
            errors = GripErrors(self.uncertainty or usual_uncertainty(rods[0]))
        for k, shape in enumerate(self.shapes):
            if errors is not None:
                errors.follow(shape)
            found.append(_margin_at(self, k, errors))
        margin = np.array(found)
        freeze(margin)
        return margin

    @property
    def bend_margin(self) -> Floats:
        """(n,) `Shape.bend_margin` of each waypoint, 1/m."""
        return np.array([shape.bend_margin for shape in self.shapes])

    @property
    def largest_force(self) -> Floats:
        """(n,) largest force of the gripper or a hold, N, as `wrenches` have it."""
        return _largest(self.wrenches[:, :, :3])

    @property
    def friction_needed(self) -> Floats:
        """(n,) friction coefficient by which all contacts hold; nan where it touches nothing."""
        return np.array([friction_needed(shape) for shape in self.shapes])

    @property
    def largest_moment(self) -> Floats:
        """(n,) largest moment of the gripper or a hold, N m, as `wrenches` have it."""
        return _largest(self.wrenches[:, :, 3:])

    @property
    def plug_force(self) -> Floats:
        """(n,) size of the force in `plug_wrenches`, N; nan where there is no plug."""
        result: Floats = np.linalg.norm(self.plug_wrenches[:, :3], axis=1)
        return result

    @property
    def plug_moment(self) -> Floats:
        """(n,) size of the moment in `plug_wrenches`, N m; nan where there is no plug."""
        result: Floats = np.linalg.norm(self.plug_wrenches[:, 3:], axis=1)
        return result

    @property
    def plug_poses(self) -> tuple[Pose, ...]:
        """The n poses of the plug's front; none without a plug."""
        return () if self.plug is None else tuple(map(self.plug.front, self.grippers))

    @property
    def residual(self) -> Floats:
        """(n,) `Shape.residual` of each waypoint."""
        return np.array([shape.residual for shape in self.shapes])

    @property
    def stability(self) -> Floats:
        """(n,) `Shape.stability` of each waypoint."""
        return np.array([shape.stability for shape in self.shapes])


def _largest(vectors: Floats) -> Floats:
    """Return (n,) the largest lengths of vectors (n, 1 + A, 3), where there is one."""
    sizes = np.linalg.norm(vectors, axis=2)
    return np.fmax.reduce(sizes, axis=1) if len(sizes) else np.zeros(0)


def _margin_at(plan: Plan, k: int, errors: GripErrors | None = None) -> float:
    """Return the margin of a waypoint, m, as `Plan.margin`."""
    return least_margin(plan.uncertainty, plan.shapes[k], [s for _, s, _ in plan.via_points[k]],
                        plan.clearances[k], errors)


def least_rating(plan: Plan, waypoints: Ints, room: float) -> float:
    """Return the least `rating` of some waypoints (k,) of a Plan, in holes of this room, m."""
    margins = np.array([_margin_at(plan, k) for k in waypoints.tolist()])
    return float(rating(plan.clearances[waypoints].min(axis=(1, 2)), margins, room).min())


def _straightening(shape: Shape) -> Floats:
    """Return the moment (3,) in N m that makes a DLO go on straight beyond its held far end."""
    if shape.far_end is None or shape.rod is None:
        return np.full(3, np.nan)
    s = shape.s[-1:]
    moment = (shape.rod.stiffnesses(s) * shape.rod.natural_strains(s))[0]
    moment[0] = 0.0  # its twist is free
    result: Floats = shape.frames[-1] @ moment
    return result


def truncate(plan: Plan, count: int, status: PlanStatus) -> Plan:
    """Return the first `count` waypoints of a Plan, as a plan with another PlanStatus."""
    part = {name: getattr(plan, name)[:count] for name in PER_WAYPOINT}
    return replace(plan, **part, fraction=1.0 if status is PlanStatus.COMPLETE
                   else plan.fraction * count / len(plan), status=status,
                   stops=tuple(stop for stop in plan.stops if stop < count),
                   starts=tuple(one for one in plan.starts if one[1] < count))


def moved(plan: Plan, shift: Floats) -> Plan:
    """Return a Plan displaced by `shift` (3,), m, with the sheets around its cut-outs."""
    return replace(
        plan, grippers=tuple(_shifted(pose, shift) for pose in plan.grippers),
        shapes=tuple(carried(shape, shift) for shape in plan.shapes),
        via_points=tuple(tuple((center + shift, s, normal) for center, s, normal in passes)
                         for passes in plan.via_points),
        sheets=tuple((moved_sheet(sheet, shift), normal) for sheet, normal in plan.sheets))


def moved_sheet(sheet: Sheet, shift: Floats) -> Sheet:
    """Return a Sheet displaced by `shift` (3,), m, with its cut-outs."""
    return replace(sheet, pose=_shifted(sheet.pose, shift), cutouts=tuple(
        replace(cutout, pose=_shifted(cutout.pose, shift)) for cutout in sheet.cutouts))


def _shifted(pose: Pose, shift: Floats) -> Pose:
    return Pose(pose.position + shift, pose.quaternion)


def concatenate(one: Plan, other: Plan) -> Plan:
    """Return one Plan that does a Plan and then another, which begins where the first ends.

    The gripper stops between them, unless it goes on in the same direction (within 5 degrees) and
    is the only arm that moves. Their `stages` stay; where neither names one, there is one.

    Raises
    ------
    InvalidTask
        The second begins elsewhere than the first ends or is held otherwise there, or both pass
        cut-outs and their margins are for another `uncertainty` each, or the hand holds another
        plug in each.
    """
    for name, plan in (('one', one), ('other', other)):
        if not len(instance(name, plan, Plan)):
            raise InvalidTask(f'{name} = {plan!r}: expected a Plan with a waypoint')
    apart = np.abs(one.grippers[-1].matrix - other.grippers[0].matrix).max()
    if apart > _SAME * max(1.0, one.shapes[-1].s[-1]):
        raise InvalidTask(f'other begins at {other.grippers[0]!r}: expected the end of one, '
                          f'{one.grippers[-1]!r}')
    _held_on(one.shapes[-1], other.shapes[0])
    known = [plan.uncertainty for plan in (one, other) if any(plan.via_points)]
    if len(known) == 2 and known[0] != known[1]:
        raise InvalidTask(f'other.uncertainty = {known[1]!r}: expected that of one, {known[0]!r}, '
                          'margins of one plan are for one uncertainty')
    if None not in (one.plug, other.plug) and one.plug != other.plug:
        raise InvalidTask(f'other.plug = {other.plug!r}: expected that of one, {one.plug!r}')
    (depths, grippers, shapes, misalignment, errors, times, via_points, clearances, forces, rooms,
     used, pushes, plug_wrenches) = (
        [*getattr(one, name), *getattr(other, name)[1:]] for name in PER_WAYPOINT)
    end = len(one) - 1
    times[end + 1:] = one.times[-1] + other.times[1:] - other.times[0]
    stops = [*one.stops, *(stop + end for stop in other.stops if stop)]
    if moving(shapes) or _turns(grippers[max(end - 1, 0):end + 2], shapes[0].s[-1]):
        stops.append(end)
    starts = one.starts or other.starts and default_starts(one.shapes)
    if starts:
        starts += shifted_starts(other.starts or default_starts(other.shapes), end, len(other))
    return Plan(np.array(depths), tuple(grippers), tuple(shapes), np.array(misalignment),
                np.array(errors), np.array(times), tuple(via_points), padded_clearances(clearances),
                other.sheets or one.sheets,
                min(one.fraction, other.fraction), other.status, tuple(sorted(set(stops))),
                np.array(forces), np.array(rooms), np.array(used), tuple(pushes),
                known[-1] if known else other.uncertainty, starts,
                _least(one.wrench_limits, other.wrench_limits), one.plug or other.plug,
                np.array(plug_wrenches))


def in_stages(plans: Sequence[Plan], names: Sequence[str], speeds: tuple[float, float]) -> Plan:
    """Return one Plan of stages, each held otherwise than the one before it ends, in its shape.

    All arms stop at the end of each; speeds: m/s and rad/s, of open hands too.
    """
    columns: dict[str, Any] = {name: [one for plan in plans for one in getattr(plan, name)]
                               for name in PER_WAYPOINT}
    firsts = np.cumsum([0, *(len(plan) for plan in plans)]).tolist()
    stops = {first + stop for plan, first in zip(plans, firsts, strict=False)
             for stop in plan.stops} | {end - 1 for end in firsts[1:-1]} | set(firsts[1:-1])
    arms, last = moving(columns['shapes']), plans[-1]
    for name in ('depths', 'misalignment', 'position_error', 'insertion_force', 'clearance',
                 'yield_utilization', 'plug_wrenches'):
        columns[name] = np.array(columns[name])
    # the gripper of a DLO that two hands hold alone is now this, now that one: no arm goes there
    ways = [*arms.values()] if any(map(_in_hands, columns['shapes'])) else [
        columns['grippers'], *arms.values()]
    columns['times'] = times_at_speed(ways[0], *speeds, ways[1:])
    columns['clearances'] = padded_clearances(columns['clearances'])
    return Plan(
        **columns, sheets=last.sheets, fraction=1.0, status=last.status, stops=tuple(sorted(stops)),
        uncertainty=last.uncertainty, starts=tuple(zip(names, firsts, strict=False)),
        wrench_limits=last.wrench_limits)


def friction_needed(shape: Shape) -> float:
    """Return the largest friction over force of the contacts of a Shape; nan: it touches nothing.

    With a coefficient of that size or more, all contacts bear these forces.
    """
    return max((float(np.linalg.norm(one.friction)) / one.force for one in shape.contacts
                if one.force > 0), default=np.nan)


def _in_hands(shape: Shape) -> bool:
    """Whether the gripper of a Shape is one of the hands that hold it, under a name of its own."""
    return any(hold.s is not None and hold.s == grasped_at(shape) for hold in shape.holds)


def _least(one: Sequence[float | None],
           other: Sequence[float | None]) -> tuple[float | None, float | None]:
    """Return the smaller of two limits each, of forces and of moments."""
    force, moment = (min((limit for limit in pair if limit is not None), default=None)
                     for pair in zip(one, other, strict=True))
    return force, moment


def _held_on(end: Shape, begin: Shape) -> None:
    """Raise InvalidTask unless the DLO is held at the beginning of a plan as it was before."""
    if not alike(end.holds, begin.holds):
        raise InvalidTask(f'other begins held by {shown(begin.holds)}: expected what one ends '
                          f'with, {shown(end.holds)}')
    for before, after in zip(end.holds, begin.holds, strict=True):
        apart = np.abs(before.pose.matrix - after.pose.matrix).max()
        if apart > _SAME * max(1.0, end.s[-1]):
            raise InvalidTask(f'other begins with {after!r}: expected it where one ends, '
                              f'{before.pose!r}')


def _turns(grippers: Sequence[Pose], length: float) -> bool:
    """Whether the path through three Poses bends; a turn by 1 rad counts as `length`."""
    chords = [np.concatenate([after.position - before.position, length * Rotation.from_matrix(
        after.rotation @ before.rotation.T).as_rotvec()])
        for before, after in zip(grippers, grippers[1:], strict=False)]
    sizes = [np.linalg.norm(chord) for chord in chords]
    return len(chords) == 2 and bool(
        min(sizes) > 0 and chords[0] @ chords[1] < _STRAIGHT * sizes[0] * sizes[1])


def padded_clearances(clearances: Sequence[Sequence[Sequence[float] | Floats] | Floats]) -> Floats:
    """Return (n, k, 3) of n sequences of at most k entries; infinite where there is none."""
    most = max((len(rooms) for rooms in clearances), default=0)
    out = np.full((len(clearances), most, 3), np.inf)
    for k, rooms in enumerate(clearances):
        if len(rooms):
            out[k, :len(rooms)] = rooms
    return out


def rooms_in_holes(plan: Plan) -> Floats:
    """Return (n, k) least distances in m of all three parts of the DLO from the k sheets.

    Infinite where the DLO is not in the sheet, or a cut-out has no size. At the rim alone an
    oblique DLO would seem to have more room: what is before a thin sheet and behind it knows how
    oblique it is.
    """
    rooms: Floats = np.where(np.isfinite(plan.clearances[:, :, 0]), plan.clearances.min(axis=2),
                             np.inf)
    return rooms


def greatest_push(plan: Plan) -> tuple[float, str]:
    """Return the greatest `insertion_force` that is known (N, or nan), and where others are not.

    In words, of the waypoints with the DLO in the bore; empty if all of them are known, or none.
    """
    held = [(force, status) for force, status, shape in zip(
        plan.insertion_force.tolist(), plan.insertion_status, plan.shapes, strict=True)
        if shape.far_end is not None]
    known = [force for force, status in held if status == FOUND]
    others = Counter(status for _, status in held if status != FOUND)
    if not others or set(others) == {NOT_LOOKED_AT} and not known:
        return max(known, default=np.nan), ''
    counts = ', '.join(f'{status} at {count}' for status, count in sorted(others.items()))
    return max(known, default=np.nan), f'{counts} of {len(held)} waypoints'


def means_to_touch(plan: Plan) -> bool:
    """Whether a Plan has contacts, or a bore that holds the DLO."""
    return held_after(plan) is not None or any(shape.contacts for shape in plan.shapes)


def passages(passes: Passes, length: float) -> tuple[Through, ...]:
    """Return the goals whose residuals are the misses of a DLO of a length (m) at some centers.

    Which arc length passes a center hardly matters, but where: on the way, of a DLO that differs.
    """
    return tuple(Through(center, max(0.0, min(s, length) - _NEAR * length))
                 for center, s, _ in passes)


def arc_length_at(center: Floats | None, passes: Passes) -> float | None:
    """Return the arc length (m) at which the DLO has to pass a center, None if it has not."""
    if center is None:
        return None
    return next((s for other, s, _ in passes if np.array_equal(other, center)), None)


def times_at_speed(grippers: Sequence[Pose], linear_speed: float, angular_speed: float,
                   others: Iterable[Sequence[Pose]] = ()) -> Floats:
    """Return (n,) times in s: each leg takes as long as the slower of its two motions.

    `others`: n poses of each other arm; the slowest arm counts.
    """
    if len(grippers) < 2:
        return np.zeros(len(grippers))
    legs = np.max([_seconds(poses, linear_speed, angular_speed) for poses in (grippers, *others)],
                  axis=0)
    return np.concatenate([[0.0], np.cumsum(legs)])


def _seconds(grippers: Sequence[Pose], linear_speed: float, angular_speed: float) -> Floats:
    """Return (n - 1,) how long an arm takes from each of n poses to the next, s."""
    positions = np.array([pose.position for pose in grippers])
    rotations = np.array([pose.rotation for pose in grippers])
    distance = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    turns = rotations[1:] @ rotations[:-1].swapaxes(1, 2)
    sines = turns[:, (2, 0, 1), (1, 2, 0)] - turns[:, (1, 2, 0), (2, 0, 1)]
    angle = np.arctan2(np.linalg.norm(sines, axis=1), np.trace(turns, axis1=1, axis2=2) - 1.0)
    seconds: Floats = np.maximum(distance / linear_speed, angle / angular_speed)
    return seconds


def plan_tree(plan: Plan) -> dict[str, Any]:
    """Return a tree (see `direct.storage`) of all of a Plan but the rods of its shapes."""
    passes = [[k, *center, s, *(np.full(3, np.nan) if normal is None else normal)]
              for k, points in enumerate(plan.via_points) for center, s, normal in points]
    return {**{key: getattr(plan, name) for key, name in _ARRAYS.items()},
            'grippers': np.array([pose_row(gripper) for gripper in plan.grippers]).reshape(-1, 7),
            'margin': plan.margin, 'uncertainty': json.dumps(
                None if plan.uncertainty is None else asdict(plan.uncertainty)),
            'fraction': plan.fraction, 'status': plan.status.value,
            'insertion_status': np.array(plan.insertion_status, dtype=str),
            'stages': json.dumps(plan.starts), 'wrench_limits': json.dumps(plan.wrench_limits),
            'plug': json.dumps(None if plan.plug is None else _plug(plan.plug)),
            'passes': np.array(passes).reshape(-1, 8),
            'sheets': json.dumps([{**_sheet(sheet), 'normal': list(normal)}
                                  for sheet, normal in plan.sheets]),
            **{str(k): pack(shape) for k, shape in enumerate(plan.shapes)}}


def plan_of(tree: Mapping[str, Any]) -> Plan:
    """Return the Plan of the tree of `plan_tree`."""
    grippers = [pose_of_row(row) for row in tree['grippers']]
    via_points: list[list[tuple[Floats, float, Floats | None]]] = [[] for _ in grippers]
    for k, *numbers in tree['passes']:
        normal = np.array(numbers[4:])
        via_points[int(k)].append((np.array(numbers[:3]), float(numbers[3]),
                               None if np.isnan(normal).any() else normal))
    known: dict[str, Any] = {name: tree[key] for key, name in _ARRAYS.items() if key in tree}
    shapes = [unpack(tree[str(k)]) for k in range(len(grippers))]
    if np.any(tree['depths']):
        shapes = [_in_bore(shape) for shape in shapes]
    known_to = json.loads(str(tree.get('uncertainty', 'null')))
    plug = json.loads(str(tree.get('plug', 'null')))
    plan = Plan(**known | {
        'grippers': grippers, 'shapes': shapes,
        'sheets': [(_read_sheet(one), np.array(one['normal']))
                   for one in json.loads(str(tree['sheets']))],
        'via_points': [tuple(one) for one in via_points], 'fraction': float(tree['fraction']),
        'uncertainty': None if known_to is None else Uncertainty(**known_to),
        'status': PlanStatus(str(tree['status'])),
        'insertion_status': tuple(np.asarray(tree.get('insertion_status', ())).tolist()),
        'stops': tuple(int(stop) for stop in tree['stops']),
        # files of before there were stages: by what holds the DLO
        'starts': tuple(tuple(one) for one in json.loads(str(tree.get('stages', '[]')))),
        'wrench_limits': json.loads(str(tree.get('wrench_limits', '[null, null]'))),
        'plug': plug and Plug(**plug | {'grasp': pose_of_row(plug['grasp'])})})
    margin = np.array(tree.get('margin', np.full(len(plan), np.nan)), dtype=float)
    freeze(margin)
    put(plan, margin=margin)
    return plan


def _in_bore(shape: Shape) -> Shape:
    """Return a Shape of an insertion; files of before there were holds do not say what holds it."""
    if not shape.holds or shape.holds[-1].by != FIXTURE:
        return shape
    *others, end = shape.holds
    return replace(shape, holds=(*others, Hold(end.pose, end.grip, by=BORE)))


def _plug(plug: Plug) -> dict[str, Any]:
    return {'length': plug.length, 'radius': plug.radius, 'mass': plug.mass,
            'grasp': pose_row(plug.grasp).tolist()}


def _sheet(sheet: Sheet) -> dict[str, Any]:
    return {'pose': pose_row(sheet.pose).tolist(), 'width': sheet.width, 'height': sheet.height,
            'thickness': sheet.thickness, 'friction': sheet.friction, 'cutouts': [
                {'pose': pose_row(one.pose).tolist(), 'radius': one.radius, 'width': one.width,
                 'height': one.height} for one in sheet.cutouts]}


def _read_sheet(known: Mapping[str, Any]) -> Sheet:
    cutouts = [CutOut(**{**one, 'pose': pose_of_row(one['pose'])}) for one in known['cutouts']]
    return Sheet(pose_of_row(known['pose']), cutouts=cutouts,
                 **{name: known[name] for name in ('width', 'height', 'thickness', 'friction')})
