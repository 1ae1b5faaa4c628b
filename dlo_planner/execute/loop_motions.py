# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motions of a task in a closed loop, which take seconds to be computed.

To the standoff, from there to the depth or the contact, and back again; and a small one by which a
standing gripper takes the vibration of its DLO away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from dlo_planner.direct.grasp import GraspedInside, Simulator
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.execute.correction_checks import miss_bound, obstacles_around
from dlo_planner.execute.limiter import used
from dlo_planner.identify.correction import Correction
from dlo_planner.identify.estimate import SHARE, Estimate, way_between
from dlo_planner.identify.estimator import Swing
from dlo_planner.identify.online_trajectory import (
    NARROWEST,
    WIDEST,
    Change,
    CorrectedTrajectory,
    step_response,
)
from dlo_planner.identify.vibration import FreeVibration
from dlo_planner.inverse.held_inside import front_of
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.inverse.tasks.move_to import MoveTo
from dlo_planner.inverse.tasks.thread import Thread, ThreadLookedAt
from dlo_planner.inverse.tasks.thread_sequence import cutouts_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, integer
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, Surface, followed_by
from dlo_planner.plan.builder import PlanBuilder, build_plan
from dlo_planner.plan.clearance import Bodies, sheet_of
from dlo_planner.plan.continuity import apart, same
from dlo_planner.plan.margin import unseen
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import (
    Plan,
    PlanStatus,
    concatenate,
    moved,
    rooms_in_holes,
    truncate,
)
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.waypoint import Waypoint, waypoint_at
from dlo_planner.trajectory.modal_response import Turns, vibrated
from dlo_planner.trajectory.timed_path import TimedPath
from dlo_planner.trajectory.trajectory import Trajectory, simulator_of

_FOR_MOTION = 0.25  # At the standoff the DLO may vibrate by this fraction of the room.
_SLOWER = 1.0, 0.7, 0.5, 0.35, 0.25  # of the speed that limits allow, until
_AT_MOST = 0.75     # At rest the DLO may miss by this fraction of the room.
_OF_SPARE = 0.6     # Motion may use this fraction of the room that the bound leaves. Far below 1 mm
                    # the search takes long, and the motions it finds four times as long.
_FOR_CORRECTIONS = 0.05  # Until the entry a bound may grow by this fraction of the room.
LEAST_FOR_MOTION = 0.1  # This fraction of the room is kept for the DLO's deviation in motion.
_MISSING = 1 - SHARE  # Probability with which an entry may miss.
_LEAST_TOLERANCE = 1e-3  # m, of the motion to the standoff
_ALONG = 0.01       # rad; along the normal it passes within rounding, obliquely far beyond this.
_OF_LIMITS = 0.95   # Motions are made for this fraction of the limits; corrections have the rest.
_BACK = 12, 24, 48, 96, 192  # Poses on the path back, until they keep to the path there.
_STEP = 0.01        # of the length; from pose to pose on the path onto a contact.
_TRIED = 200        # The place of the gripper on its path is sought at so many times.
_WINDOW = 0.1       # of the slowest period; three windows of this width smooth a step.
_PULSES = 10       # steps aside and back again, one after the other
_APART = 0.15      # of the slowest period, from one to the next
_ASIDE = 2         # of them, until it goes back
_SMALL = 1e-3      # weight of a displacement beside that of the free end: no more than is needed
_OF_PERIOD = 1 / 200  # of the slowest: a step of what a displacement leaves
FARTHEST = 0.01   # m, that the gripper may be displaced
_DELAYS = np.linspace(-0.1, 0.4, 101)  # s


@dataclass(frozen=True)
class LoopTask:
    """A task for a closed loop: the DLO hangs freely up to its entry, where its miss is judged.

    The entry is the first waypoint that passes a place of the task: a cut-out or the entrance of a
    bore as the free end comes to it, a contact shortly before it is touched.

    Attributes
    ----------
    inverse : InverseSimulator
        Of the DLO as stated, with its obstacles and its workspace.
    task : Task
        Task with its places as stated, its depths from 0 on.
    standoff : float
        Distance before the entry at which it looks again, m.
    limits : Limits
        Limits of the gripper.
    most_off : float or None
        By how much places without a size, contacts, may be missed, m.
    planned_room : float
        Room that the plan which is executed leaves the DLO, m, see `of_plan`: less than that of the
        cut-outs where it passes obliquely, or bends back to a sheet. Infinite: none is known yet.
    obliquely : bool or None
        Whether that plan passes one cut-out obliquely, see `ThreadLookedAt`. None: none is known.
    given_up : int
        How often an entry was given up because it might have missed.

    Raises
    ------
    InvalidTask
        The task passes no place, by how much it may be missed is not stated, or a plan leaves no
        room.
    """

    inverse: InverseSimulator
    task: Task
    standoff: float
    limits: Limits = Limits()
    most_off: float | None = None
    planned_room: float = np.inf
    obliquely: bool | None = None
    given_up: int = 0

    def __post_init__(self) -> None:
        if not (self.touches or cutouts_of(self.task)):
            raise InvalidTask(f'task = {self.task!r}: expected one that passes cut-outs, goes into '
                              'a bore or touches an obstacle, there is nothing else to look for')
        if self.task.held_inside and not self.task.hangs_after:
            raise InvalidTask(f'task.hold_at = {self.task.held_inside:g}: expected none for an '
                              'insertion, which is not simulated in motion with it')
        if self.touches and self.most_off is None:
            raise InvalidTask(f'task = {self.task!r}: expected most_off, by how much the DLO may '
                              'miss the place that it touches')
        if not self.planned_room > 0:
            raise InvalidTask(f'planned_room = {self.planned_room}: expected more than 0 m, what '
                              'the plan leaves between the DLO and the sheets')
        if self.obliquely is not None:
            flag('obliquely', self.obliquely)
        integer('given_up', self.given_up, minimum=0, maximum=1000)
        self.room  # noqa: B018  it refuses

    @property
    def touches(self) -> bool:
        """Whether it means to touch an obstacle."""
        return self.task.outwards is not None

    @property
    def hangs(self) -> bool:
        """Whether the DLO hangs freely from the entry on, too: it can be looked at as before."""
        return self.task.hangs_after

    @property
    def hold_at(self) -> float | None:
        """Where the gripper holds the DLO inside, m: what is in front is estimated. None: not."""
        return self.task.held_inside

    @cached_property
    def front(self) -> InverseSimulator:
        """The InverseSimulator of what is estimated: of the part in front of the gripper."""
        if self.hold_at is None:
            return self.inverse
        return InverseSimulator(self.inverse.simulator.part(self.hold_at, 1),
                                workspace=self.inverse.workspace,
                                allow_plastic=self.inverse.requirements.allow_plastic)

    def rod(self, estimate: Estimate) -> Rod:
        """Return the whole Rod, its part behind the gripper as stated."""
        if self.hold_at is None:
            return estimate.rod
        return followed_by(self.inverse.simulator.rod, self.hold_at, estimate.rod)

    def simulator(self, estimate: Estimate) -> Simulator:
        """Return the simulator of the whole estimated DLO, without obstacles."""
        if self.hold_at is None:
            return estimate.simulator
        free = self.inverse.simulator.without_obstacles().with_rod(self.rod(estimate))
        return GraspedInside.of(free, self.hold_at)

    def estimated(self, plan: Plan) -> Plan:
        """Return the part of a Plan that is of the estimated DLO: of what is in front."""
        if self.hold_at is None:
            return plan
        return front_of(plan, Surface.of(self.front.simulator.rod))

    def hanging(self, estimate: Estimate, here: Pose) -> list[tuple[Shape, Surface]]:
        """Return the Shapes of the DLO's parts in a measured gripper, each with its Surface."""
        simulator, front = self.simulator(estimate), estimate.shape(here)
        shapes = [(front, Surface.of(self.front.simulator.rod))]
        if isinstance(simulator, GraspedInside):
            back, = simulator.behind([estimate.actual(here)])
            shapes.append((back, Surface.of(simulator.parts[0].rod)))
        return shapes

    def behind(self, estimate: Estimate, correction: Correction) -> str:
        """Return in words what the part behind the gripper comes into, corrected; '' if nothing."""
        simulator = self.simulator(estimate)
        if isinstance(simulator, DirectSimulator):
            return ''
        shapes = simulator.behind([estimate.actual(pose) for pose in correction.grippers])
        cutouts = [estimate.moved_cutout(one) for one in cutouts_of(self.task)]
        around = estimate.moved_obstacles(self.inverse.simulator.obstacles, np.array(
            [one.center for one in cutouts_of(self.task)]))
        length = simulator.rod.length
        sheets = [(sheet, np.array(one.normal)) for one in cutouts
                  if (sheet := sheet_of(one, length, around)) is not None]
        surface = Surface.of(simulator.parts[0].rod)
        room = Bodies(sheets, around, surface).least(shapes)
        if any(not shape.converged or shape.jumped for shape in shapes):
            return 'the part of the DLO behind the gripper would fall into another shape'
        return '' if not room < 0 else (
            f'the part of the DLO behind the gripper would be {-room:.3g} m in what is around')

    @property
    def room(self) -> float:
        """Largest bound of the miss (95 %) with which an entry is begun, m.

        At first the free room. Who tries until a bound is small enough finds one that is small by
        chance: after each entry that was given up the next one may miss half as likely, so all of
        them together less than twice as likely as one. The bound of a smaller probability is
        larger by the ratio of quantiles of a normal distribution along a line; where the miss
        scatters in a plane it is larger by less.
        """
        at_first, likely = ndtri([_MISSING / 2, _MISSING / 2**(self.given_up + 1)])
        return self.free_room * float(at_first / likely)

    @cached_property
    def free_room(self) -> float:
        """By how much the DLO may miss a place without touching a sheet, m."""
        if self.touches and self.most_off is not None:
            return self.most_off
        thick, rooms = self.inverse.simulator.rod.radius, [self.planned_room]
        for cutout in cutouts_of(self.task):
            radius = cutout.radius
            if radius is None or not isinstance(thick, float) or radius <= thick:
                raise InvalidTask(f'cutout.radius = {radius}: expected more than the radius of the '
                                  f'DLO, which has to be one number, not {thick!r}')
            rooms.append(radius - thick)
        return min(rooms)

    def of_plan(self, plan: Plan) -> LoopTask:
        """Return the task with the room that a Plan of it leaves, at its waypoints in the holes.

        The least distance of all parts of the DLO from the sheets there. As its misses it counts
        from the centers: what is planned beside one has been taken off already.
        """
        room = np.inf
        for rooms, errors in zip(rooms_in_holes(plan), plan.position_errors, strict=True):
            beside = np.zeros(rooms.size)  # in the order of the cut-outs, as far as they are passed
            beside[:len(errors)] = errors[:rooms.size]
            room = min(room, float((rooms + beside).min(initial=np.inf)))
        obliquely = bool((plan.misalignment > _ALONG).any()) if isinstance(
            self.task, Thread) else None
        return replace(self, planned_room=room, obliquely=obliquely)

    @property
    def room_at_rest(self) -> float:
        """What of the room the DLO may miss at rest, m: the rest is kept for how it moves."""
        return (1 - LEAST_FOR_MOTION) * self.room

    @property
    def motion_limits(self) -> Limits:
        """Limits that motions are made for."""
        return Limits(*map(float, (_OF_LIMITS * self.limits.sizes).ravel()))

    @property
    def tolerance(self) -> float:
        """By how much the DLO may swing when it has come to rest at the standoff, m."""
        return max(_LEAST_TOLERANCE, _FOR_MOTION * self.room)

    def ways(self, estimate: Estimate, here: Pose, standoff: float) -> tuple[Plan, Plan]:
        """Return the way to the entry, and on from there, in true poses of the estimated DLO.

        How obliquely it passes a hole is chosen by what looks do not tell, before them as after:
        so the way in goes on from where the way to the standoff ends, and passes as planned then.
        The gripper rolls as little as it can: see `ThreadLookedAt`.
        """
        known, start = self.inverse, estimate.actual(here)
        simulator = known.simulator.with_rod(self.rod(estimate))
        if not self.touches:  # the obstacle that is touched stands where it is stated
            simulator = simulator.with_obstacles(estimate.moved_obstacles(
                simulator.obstacles, np.array([one.center for one in cutouts_of(self.task)])))
        inverse = InverseSimulator(simulator, workspace=known.workspace,
                                   allow_plastic=known.requirements.allow_plastic)
        if self.touches:
            return way_onto(inverse, self.task, start, standoff, self.free_room)

        def estimated(value: Any) -> Any:
            if isinstance(value, CutOut):
                return estimate.moved_cutout(value)
            return tuple(map(estimated, value)) if isinstance(value, tuple) else value

        stated: Any = self.task  # a dataclass
        known_now = {one.name: estimated(getattr(stated, one.name)) for one in fields(stated)}
        task: Task = (ThreadLookedAt(**known_now, obliquely=None if standoff else self.obliquely)
                      if type(stated) is Thread else replace(stated, **known_now))
        through = inverse.plan(task, start=start, requirements=replace(
            known.requirements, uncertainty=unseen(simulator.rod)))
        return inverse.plan(Approach(cutouts_of(task)[0], through.shapes[0], standoff),
                            start=start), through


def way_onto(inverse: InverseSimulator, task: Task, start: Pose,
             standoff: float, room: float, **options: Any) -> tuple[Plan, Plan]:
    """Return the ways to the entry above a contact, and straight down onto it.

    The entry is `room` (m) above where the DLO begins to touch. The first way stops `standoff` (m)
    above the entry; 0: it begins at the entry already. The obstacle stands where it is stated.
    """
    held, outwards = inverse.plan(task, start=start, **options), task.outwards
    if outwards is None:
        raise InvalidTask(f'task = {task!r}: expected one that leads the DLO straight onto an '
                          'obstacle, `Task.outwards`')
    (place, s, along), = held.via_points[0]
    simulator, onto, shape = inverse.simulator, held.grippers[0], held.shapes[0]
    step, height = _STEP * simulator.rod.length, 0.0

    def lifted(height: float) -> Pose:
        return Pose(onto.position + height * outwards, onto.quaternion)

    while shape.contacts:
        height += step
        shape = simulator.track([lifted(height)], initial=shape)[0]
        if height > simulator.rod.length or not shape.converged:
            raise Infeasible(f'lifted straight off the contact by {height:.3g} m the DLO still '
                             'touches: it cannot be led straight onto it', 0, 'contact', height)
    entry = height + room
    above, down = entry + standoff, np.linspace(entry, 0, int(np.ceil(entry / step)) + 1)
    hanging = inverse.plan(MoveTo((lifted(above),)), start=start, **options).shapes[-1]
    shapes = simulator.track([lifted(one) for one in down], initial=hanging)
    if shapes[0].contacts or not same(shapes[-1], held.shapes[0]) or any(
            shape.jumped or not shape.converged for shape in shapes):
        raise Infeasible('from the standoff the DLO does not come straight into the shape in which '
                         f'it touches s = {s:g} m', 0, 'contact', apart(shapes[-1], held.shapes[0]))
    way = inverse.plan(MoveTo((lifted(above), lifted(entry)) if standoff else (lifted(entry),)),
                       start=start, **options)
    axes, there = shapes[0].frame_at(s)
    lowered = [Waypoint(shapes[0], via_points=((there, s, axes[:, 0]),)),
               *map(Waypoint, shapes[1:-1]),
               *(waypoint_at(shape, place, points[0][1], along)
                 for shape, points in zip(held.shapes, held.via_points, strict=True))]
    builder = PlanBuilder(np.full(len(lowered), held.depths[0]), inverse.demands(
        held, requirements=options.get('requirements')))
    for waypoint in lowered:
        builder.add(waypoint)
    return way, builder.finished()


class GripperMotion(NamedTuple):
    """A motion to rest, the last Shape on it that hangs freely, and how the DLO swings on the way.

    The poses are true ones, of the gripper by the Estimate with which it was planned.
    `planned_room` and `obliquely`: see `LoopTask`, of the plan that goes on from where it ends.
    """

    estimate: Estimate
    trajectory: Trajectory
    there: Shape
    swing: Swing
    planned_room: float = np.inf
    obliquely: bool | None = None

    @property
    def corrected_trajectory(self) -> CorrectedTrajectory:
        """The motion in poses to be commanded, which can be corrected."""
        return _corrected_trajectory(self.trajectory, self.estimate, self.there)

    @property
    def bound(self) -> float:
        """By how much motion displaces the DLO in the cut-out at most, m."""
        return np.nan if self.trajectory.motion is None else self.trajectory.motion.bound

    @property
    def departure(self) -> float:
        """By how much the DLO still swings at its end, m."""
        return np.nan if self.trajectory.motion is None else self.trajectory.motion.departure


def _corrected_trajectory(trajectory: Trajectory, estimate: Estimate,
                          there: Shape) -> CorrectedTrajectory:
    return CorrectedTrajectory.of(trajectory, there, estimate.gripper_offset.inverse())


@dataclass(frozen=True)
class Entry:
    """The way from the standoff to the depth, and what is expected of it."""

    estimate: Estimate  # by which it was made
    bound: float        # of the miss with 95 %, m, at rest
    whole: Plan         # in true poses
    commanded: Plan     # its part from the entry on, in poses to be commanded
    motion: GripperMotion | None  # of the whole; None: the bound is too large to enter

    @property
    def moves(self) -> float:
        """By how much the DLO misses more in motion than at rest, m: `bound` has the rest."""
        return np.inf if self.motion is None else self.motion.bound - self.planned

    @property
    def planned(self) -> float:
        """By how much the estimated DLO misses as planned, m: not all centers can be hit."""
        return float(self.whole.position_error.max())

    @cached_property
    def reached(self) -> Floats:
        """Times (n,), s, at which the motion reaches the waypoints from the entry on."""
        assert self.motion is not None
        return self.motion.corrected_trajectory.reached(self.whole.times[-len(self.commanded):])


def way_to_standoff(task: LoopTask, estimate: Estimate, here: Pose) -> GripperMotion:
    """Return the motion from a measured pose to the standoff."""
    way, through = task.ways(estimate, here, task.standoff)
    return _motion(task.of_plan(through), estimate,
                   truncate(way, way.stops[0] + 1, PlanStatus.COMPLETE))


def way_in(task: LoopTask, estimate: Estimate, here: Pose, most: float | None, lag: float,
           left: float = 0.0) -> Entry:
    """Return the way from a measured pose at the standoff to the depth.

    It is not entered with a bound above `most`, m; None: above the room at rest of the plan. The
    DLO still swings by `left`, m, which counts as well: motion may use what that leaves.
    """
    way, through = task.ways(estimate, here, 0.0)
    task = task.of_plan(through)
    most = task.room_at_rest if most is None else most
    whole = concatenate(replace(way, stops=()), through)
    commanded = commanded_of(task.estimated(through), estimate)
    there = [shape for shape in whole.shapes if not (shape.holds or shape.contacts)][-1]

    def bound_in(way: CorrectedTrajectory, lag: float = lag) -> float:
        reached = way.reached(whole.times[-len(through):])
        return miss_bound(estimate, commanded, way, reached, 0.0, lag)

    tried = []
    for part in _SLOWER if np.isfinite(lag) else _SLOWER[:1]:  # slower is corrected the better
        limits = slowed(task.motion_limits, part)
        quick = _corrected_trajectory(Trajectory(whole, limits, tolerance=np.inf), estimate, there)
        tried.append((bound_in(quick), limits))
        if tried[-1][0] <= _AT_MOST * task.room:
            break
    at_most, limits = min(tried, key=lambda one: one[0])
    if at_most > most and bound_in(quick, -0.5 * quick.windows.sum()) > most:  # however slow it is
        return Entry(estimate, at_most, whole, commanded, None)
    spare = task.room - at_most
    tolerance = max(LEAST_FOR_MOTION * task.room,
                    min(_OF_SPARE * spare, spare - left - _FOR_CORRECTIONS * task.room))
    trajectory = _trajectory(task, whole, tolerance, limits)
    swing = swing_of(trajectory, estimate, task.estimated(whole))
    motion = GripperMotion(estimate, trajectory, there, swing)
    bound = bound_in(motion.corrected_trajectory)
    return Entry(estimate, bound, whole, commanded, None if bound > most else motion)


def commanded_of(plan: Plan, estimate: Estimate) -> Plan:
    """Return a Plan of true poses through an estimated hole, in commanded ones: as stated."""
    return replace(moved(plan, -estimate.center(np.zeros(3))),
                   grippers=tuple(estimate.commanded(pose) for pose in plan.grippers))


def way_back(task: LoopTask, estimate: Estimate, poses: Sequence[Pose],
             known: Shape) -> GripperMotion:
    """Return the motion through many measured poses; the DLO hangs, and leaves the hole freely.

    `known` is its Shape near the first of them.
    """
    for count in _BACK:
        some = _evenly(poses, count)
        shapes = task.simulator(estimate).track([estimate.actual(pose) for pose in some],
                                                initial=known)
        plan = build_plan([Waypoint(shape) for shape in shapes], np.zeros(len(shapes)),
                          task.limits.sizes[0], PlanStatus.COMPLETE)
        off = _off(GripperPath.of(plan), [estimate.actual(pose) for pose in poses],
                   float(known.s[-1]))
        if off <= LEAST_FOR_MOTION * task.room:
            return _motion(task, estimate, plan)
    raise Infeasible(f'the way back leaves the way there by {off:.3g} m: expected '
                     f'{LEAST_FOR_MOTION * task.room:.3g} m at most', 0, 'clearance', off)


def _evenly(poses: Sequence[Pose], count: int) -> list[Pose]:
    """Return so many of many poses, about as far from each other: short bends take long."""
    way = np.cumsum([0.0, *(way_between(*pair) for pair in pairwise(poses))])
    chosen = np.searchsorted(way, np.linspace(0.0, way[-1], count)).clip(0, len(poses) - 1)
    return [poses[k] for k in np.unique(chosen)]


def _off(path: GripperPath, poses: Sequence[Pose], length: float) -> float:
    """Return how far a path leaves Poses, m: of the gripper, or of what is a length (m) ahead."""
    def ahead(position: Floats, rotation: Floats) -> Floats:
        return np.concatenate([position[..., None, :], position[..., None, :] + length
                               * np.swapaxes(rotation[..., :2], -1, -2)], axis=-2)

    on_it = ahead(*path.at(np.linspace(path.times[0], path.times[-1], 2 * _TRIED)))
    wanted = ahead(np.array([pose.position for pose in poses]),
                   np.array([pose.rotation for pose in poses]))
    steps, since = np.diff(on_it, axis=0), wanted[:, None] - on_it[:-1]
    part = np.clip(np.einsum('mkij,kij->mk', since, steps)
                   / np.maximum((steps**2).sum(axis=(1, 2)), 1e-300), 0, 1)
    apart = np.linalg.norm(since - part[:, :, None, None] * steps, axis=3).max(axis=2)
    return float(apart.min(axis=1).max())


def slowed(limits: Limits, part: float) -> Limits:
    """Return the limits of a motion that takes 1 / part as long."""
    return Limits(*map(float, (limits.sizes * part ** np.arange(1.0, 4.0)[:, None]).ravel()))


def _trajectory(task: LoopTask, plan: Plan, tolerance: float, limits: Limits) -> Trajectory:
    """Return the motion along a Plan of true poses, which keeps clear of what is around."""
    last = plan.shapes[-1]
    touched = [last.obstacles[one.obstacle] for one in last.contacts]
    trajectory = Trajectory(
        plan, limits, tolerance=tolerance,
        simulator=simulator_of(last, True) if touched else None,
        obstacles=[one for one in obstacles_around(task.inverse) if one not in touched])
    motion = trajectory.motion
    if motion is not None and motion.clearance < 0:
        raise Infeasible(f'in motion the DLO comes {-motion.clearance:.3g} m into what it has to '
                         'stay clear of', 0, 'clearance', float(-motion.clearance))
    return trajectory


def _motion(task: LoopTask, estimate: Estimate, plan: Plan) -> GripperMotion:
    trajectory = _trajectory(task, plan, task.tolerance, task.motion_limits)
    return GripperMotion(estimate, trajectory, plan.shapes[-1],
                         swing_of(trajectory, estimate, task.estimated(plan)), task.planned_room,
                         task.obliquely)


def swing_of(trajectory: Trajectory, estimate: Estimate, plan: Plan) -> Swing:
    """Return how inertia bends the estimated DLO in a motion along a Plan of true poses."""
    return Swing.of(trajectory, estimate.simulator, plan.shapes[0])


@dataclass(frozen=True, eq=False)
class Calming:
    """A motion that takes most of a vibration away.

    The gripper is displaced in smooth steps, and comes back to where it stood. What they do to each
    mode is linear, so those are wanted that leave least of the vibration: linear least squares.
    """

    before: FreeVibration
    way: CorrectedTrajectory    # from where the gripper stands, and back
    stamp: float    # s, when it ends
    answer: Floats  # (2, m) state of the DLO then if it had been at rest before

    @classmethod
    def of(cls, vibration: FreeVibration, stamp: float, delay: float, here: Pose, limits: Limits,
           period: float, farthest: float = FARTHEST) -> Calming:
        """Return that from a stamp (s) on: as much as is possible within the limits."""
        slowest = float(2 * np.pi / vibration.rates.min())
        windows: Floats = np.full(3, float(np.clip(_WINDOW * slowest, NARROWEST, WIDEST)))
        begins: Floats = _APART * slowest * np.arange(float(_PULSES))
        lasts = _ASIDE * _APART * slowest
        duration = float(begins[-1] + lasts + windows.sum())
        answers = _answers(vibration, begins, lasts, windows, duration)
        sizes = np.linalg.norm(vibration.modes.displacements[:, -1], axis=1)
        left = (sizes * vibration.after(stamp + delay - vibration.stamp + duration)).ravel()
        rows = (answers * sizes).reshape(len(answers), -1).T
        pulses = -np.linalg.solve(rows.T @ rows + _SMALL**2 * np.eye(len(answers)),
                                  rows.T @ left)
        path = GripperPath.through([here, here], [0.0, duration], 1.0)

        def way(pulses: Floats) -> CorrectedTrajectory:
            changes = [Change(begin + later, np.zeros(1), np.append(np.zeros(3), sign * pulse)[
                None]) for begin, pulse in zip(begins, pulses.reshape(-1, 3), strict=True)
                for later, sign in ((0.0, 1.0), (lasts, -1.0))]
            return CorrectedTrajectory(TimedPath(path, (None,), limits), windows, tuple(changes))

        frames = way(pulses).frames(np.arange(0.0, duration + 4 * period, period))
        away = np.linalg.norm(frames[0] - here.position, axis=1).max()
        most = max(used(frames, limits, period) / _OF_LIMITS, float(away) / farthest)
        pulses /= max(most, 1.0)
        return cls(vibration, way(pulses), stamp + duration, np.tensordot(pulses, answers, 1))

    def delay(self, after: FreeVibration) -> float:
        """Return by how much later than commanded the DLO answered, as it was seen, s."""
        before, size = self.before, []
        for delay in _DELAYS:
            answer = before.decayed(self.answer, after.stamp - self.stamp - delay)
            state = before.after(after.stamp - before.stamp) + answer
            size.append(np.linalg.norm(before.end(state) - after.end(after.state)))
        return float(_DELAYS[int(np.argmin(size))])


def _answers(vibration: FreeVibration, begins: Floats, lasts: float, windows: Floats,
             duration: float) -> Floats:
    """Return (3 k, 2, m) what each of k pulses along each axis leaves of the modes at the end."""
    count = int(np.ceil(duration * vibration.rates.min() / (2 * np.pi * _OF_PERIOD)))
    step = duration / count
    middle = step * (np.arange(count) + 0.5)
    pulls = vibration.modes.participation[:, :3]
    modes = vibration.rates.size
    force = np.array([-np.outer(step_response(middle - begin, windows, 2)
                                - step_response(middle - begin - lasts, windows, 2), pull)
                      for begin in begins for pull in pulls.T])
    damping = np.tile(vibration.modes.damping_ratios, (count, 1))
    out = vibrated(step, np.tile(vibration.rates, (count, 1)), damping, Turns.none(count, modes),
                   force, np.zeros((2, len(force), modes)))
    return np.moveaxis(out[:, :, -1], 0, 1)
