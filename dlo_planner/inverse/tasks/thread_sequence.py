# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through more than two cut-outs: nearest to all of their centers that are passed.

The gripper has six degrees of freedom, and the arc lengths at all cut-outs but the first are free:
two centers can be hit, three in general cannot. So the weighted distances are minimized. The weight
of a cut-out ahead grows smoothly as the free end comes near, so that the gripper's path is
continuous: the DLO, extended straight, aims at it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.continuation import BranchPoint, Follower, SolutionBranch, continue_branch
from dlo_planner.inverse.equilibria import is_axisymmetric
from dlo_planner.inverse.room_of_two import nearness
from dlo_planner.inverse.route import Threading, quick_simulator
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.inverse.tasks.thread import Thread, thread
from dlo_planner.inverse.tasks.thread_two import ThreadTwo
from dlo_planner.inverse.waypoint_newton import goal_shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, row
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between, turned_by
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.continuity import gripper_motion, largest_shift, largest_turn
from dlo_planner.plan.goal_rows import DIRECTION, POSITION, ROLL, THROUGH, GoalTable
from dlo_planner.plan.goals import Through
from dlo_planner.plan.margin import upright_room
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

_FREE = 1e-3          # weight of the first normal, which decides only what is left free
_ROLLED = 3e-3        # of the length, counts a roll of 1 rad on the longest step: not for nothing
_SOON = 0.02          # share of a third one at which the second counts in full
_COMPARED, _ROLLS = 8, 4  # depths and rolls at which start_candidates are compared
_HIT = 1e-4           # of the length: misses that need no comparison
_BETTER = 0.99        # of the squared misses: another roll has to bring them below
_SETTLING, _SETTLED = 50, 1e-6  # steps; rad plus part of the length
_PART = 0.7           # of the largest turn and shift, so that both together are no jump
_REWEIGHTED = 5       # weights that are tried; their changes are about halved by each
_COUNTS = 0.05        # part of a room lost, at least: a cut-out that is hit keeps a weight
_EDGE = 0.95          # of the reach: what came so far was kept back by it


class NearestToCenters(SolutionBranch):
    """The shapes nearest to the centers of k cut-outs, with weights (k,), at depths in the first.

    A step is kept in a ball about the shape before; if the nearest shape is farther away, it goes
    towards it.
    """

    what = 'that are nearest to the centers'
    longest, shortest = 1 / 20, 1 / 200
    soft = True

    def __init__(self, simulator: DirectSimulator, cutouts: Sequence[CutOut],
                 weights: Floats) -> None:
        self.simulator, self.weights = simulator, weights
        self.normals = [cutout.normal for cutout in cutouts]
        self.centers = np.array([cutout.center for cutout in cutouts], dtype=float)
        legs = np.linalg.norm(np.diff(self.centers, axis=0), axis=1)
        self._reached = np.append(0.0, legs.cumsum())  # depth of a straight DLO at each center

    def at(self, before: BranchPoint, depth: float, roll: float = 0.0,
           final: bool = False) -> BranchPoint | None:
        """Return the BranchPoint at `depth` (m) near `before`, or None; no roll is left free."""
        del roll
        length, whole = self.simulator.rod.length, self._reach(depth - before.depth)
        shape = self._nearest(before, depth, _PART * whole)
        if shape is None:
            return None
        if final:  # what the reach has kept back may come nearer by what is left of a step
            last, gripper = before.shape.gripper, shape.gripper
            moved = np.array([angle_between(last.rotation, gripper.rotation),
                              np.linalg.norm(gripper.position - last.position)])
            if np.linalg.norm(moved / whole) > _EDGE * _PART:
                closer = self._nearest(BranchPoint(shape, depth=depth), depth, (1 - _PART) * whole)
                shape = shape if closer is None else closer
        further: list[float] = []
        for center in self.centers[1:] if final else ():
            s = Through(center, length - depth).passage(shape)
            if s > length:
                break
            further.append(s)
        return BranchPoint(shape, tuple(further), depth)

    def _reach(self, step: float) -> Floats:
        """Return the turn (rad) and the shift (m) that are no jump for a step of the depth, m."""
        length = self.simulator.rod.length
        return np.array([largest_turn(step / length), length * largest_shift(step / length)])

    def _nearest(self, before: BranchPoint, depth: float, reach: Floats) -> Shape | None:
        """Return the Shape nearest to the centers at a depth (m), within reach of a BranchPoint."""
        length, gripper = self.simulator.rod.length, before.shape.gripper
        part = (depth - before.depth) / length
        turns = _ROLLED * length * np.sqrt(self.longest / (part or self.longest))
        goals = self._goals(depth, gripper, turns)
        found = goal_shape(self.simulator, before.shape, goals, goals.s, origin=gripper.position,
                           reach=(float(reach[0]), float(reach[1])))
        return found and found.shape

    def settled(self, point: BranchPoint) -> BranchPoint:
        """Return the BranchPoint that is nearest at its depth, however far away."""
        for _ in range(_SETTLING):
            after = self.at(point, point.depth)
            if after is None:
                break
            moved = gripper_motion(point.shape.gripper, after.shape.gripper,
                                   self.simulator.rod.length)
            point = after
            if moved < _SETTLED:
                break
        return point

    def _goals(self, depth: float, gripper: Pose, turns: float) -> GoalTable:
        """Return the goals at a depth, m, and near a Pose: a roll by 1 rad counts as `turns` m."""
        length = self.simulator.rod.length
        share = nearness(self._reached - depth, length)
        weights = self.weights * share
        weights[0] = self.weights[0]
        if share[1] > 0:
            # Two can be hit, whatever the weight: so the second one may decide what the normal did,
            # and has to count in full before a third one does.
            second = share[1] * max(_FREE, min(1.0, share[2] / _SOON))
            weights[1] = self.weights[1] * (1.0 if share[1] == 1 else second)
        further, rotation = len(weights) - 1, np.array(gripper.rotation)
        return GoalTable(
            np.array([POSITION, DIRECTION, *[THROUGH] * further, ROLL]),
            np.full(further + 3, length - depth),
            np.vstack([self.centers[0], self.normals[0], self.centers[1:], rotation[:, 0]]),
            np.array([rotation] * (further + 3)),
            np.array([weights[0], _FREE * float(1 - share[1]) * length, *weights[1:],
                      turns]) / length)


def thread_by_room(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading whose cut-outs may be missed the farther, the wider they are.

    The weights go as 1 / room of a DLO upright in a cut-out. Where that leaves too little in one
    of them, it counts the more, the more of its room was lost there: so the largest part that any
    of them loses becomes least (Lawson 1961).
    """
    weights, refused = np.ones(len(task.cutouts)), None
    rooms = np.array([upright_room(cutout, task.demands.surface) for cutout in task.cutouts])
    if not ((rooms > 0) & (rooms < np.inf)).all():
        return thread_sequence(simulator, task, weights)
    weights = rooms.min() / rooms
    for left in reversed(range(_REWEIGHTED)):
        try:
            return thread_sequence(simulator, task, weights)
        except Infeasible as error:
            if error.constraint != 'clearance':
                raise refused or error from None
            refused = error
            if not left:
                break
        try:
            lost = _lost_parts(simulator, task, weights, rooms)
        except Infeasible:
            break
        weights = weights * np.sqrt(np.maximum(lost, _COUNTS))  # the squares of distances count
        weights /= weights.max()
    assert refused is not None  # one is tried at least
    raise refused


def _lost_parts(simulator: DirectSimulator, task: Threading, weights: Floats,
                rooms: Floats) -> Floats:
    """Return the largest part (k,) of the room (k,), m, that the DLO loses in each cut-out.

    That is on its whole way, as though no cut-out had an edge.
    """
    demands = PlanChecker(task.demands.speeds, task.demands.progress.silent())
    plan = thread_sequence(simulator, replace(task, demands=demands, cutouts=tuple(
        CutOut(cutout.pose) for cutout in task.cutouts)), weights)
    holes = task.holes(simulator.rod.length)
    left = np.array([[min(rooms) for rooms in holes.passed(Waypoint(shape)).clearances]
                     for shape in plan.shapes])
    lost: Floats = np.maximum(1 - left.min(axis=0) / rooms, 0)
    return lost


def thread_sequence(simulator: DirectSimulator, task: Threading, weights: Floats) -> Plan:
    """Return the Plan; see `InverseSimulator.thread_sequence` for what the arguments mean.

    Several rolls to begin with are compared, with a quick simulator at a few depths; the one with
    the smallest errors is taken.
    """
    quick = quick_simulator(simulator)
    if quick is simulator and is_axisymmetric(simulator.rod):
        return _thread(simulator, task, weights)  # all rolls are alike
    few = task.tried_with(quick).at_most(_COMPARED)
    best: Threading | None = None
    least, refused = np.inf, None
    for start in _rolled(simulator, task):
        task.demands.progress.check()
        try:
            plan = _thread(quick, replace(few, start=start), weights)
        except Infeasible as error:
            refused = refused or error
            continue
        missed = sum((weight * miss) ** 2 for misses in plan.position_errors
                     for weight, miss in zip(weights, misses, strict=False))
        if missed < _BETTER * least:
            least, best = missed, replace(task, start=start)
        if missed <= (_HIT * simulator.rod.length) ** 2 * max(weights) ** 2:
            break
    if best is None:
        if quick is simulator and len(few.depths) < len(task.depths):
            return _thread(simulator, task, weights)  # closer waypoints may do, or tell more
        assert refused is not None  # one roll is tried at least
        raise refused
    return _thread(simulator, best, weights)


def _rolled(simulator: DirectSimulator, task: Threading) -> Iterator[Pose | None]:
    """Yield Poses, or None, from whose roll the DLO is turned least; first the requested one."""
    yield task.start
    if is_axisymmetric(simulator.rod):
        return
    upright = (Pose.looking_along((0.0, 0.0, 0.0), task.cutouts[0].normal) if task.start is None
               else task.start)
    for k in range(1, _ROLLS):
        turn = turned_by(2 * np.pi * k / _ROLLS * upright.direction)
        yield Pose.from_rotation(upright.position, turn @ upright.rotation)


def _thread(simulator: DirectSimulator, task: Threading, weights: Floats) -> Plan:
    """Return the Plan that begins with the roll of `task.start`."""
    branch = NearestToCenters(simulator, task.cutouts, weights)
    begin = thread(simulator, replace(
        task, cutouts=task.cutouts[:1], depths=np.zeros(1), demands=PlanChecker(
            task.demands.speeds, task.demands.progress.silent()))).shapes[0]
    holes, length, (first, *others) = task.holes(begin.s[-1]), begin.s[-1], branch.centers

    def waypoint(point: BranchPoint) -> Waypoint:
        made = waypoint_at(point.shape, first, length - point.depth, None)
        for center, s in zip(others, point.further, strict=False):
            made = made.with_via_point(center, s)
        return holes.passed(made)

    builder = PlanBuilder(task.depths, task.demands)
    point = branch.settled(BranchPoint(begin, depth=0.0))
    continue_branch(builder, Follower(branch, point, 0.0, task.depths), waypoint)
    return builder.finished()


@dataclass(frozen=True, eq=False, repr=False)
class ThreadSequence(Task):
    """Thread near the centers of cut-outs; see `InverseSimulator.thread_sequence`.

    Attributes
    ----------
    cutouts : tuple of CutOut
        The cut-outs, in the order in which they are passed.
    weights : ndarray, shape (k,) or None
        Weights of their distances. If None, as 1 / room that the DLO has in them, so that a wide
        one may be missed farther, and other ones where one would be left; all alike where one has
        no size.
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through the first one, m, or None.
    """

    threads: ClassVar[bool] = True
    deepest: ClassVar[float | None] = 1.0

    cutouts: tuple[CutOut, ...]
    weights: Floats | None = None
    depths: Floats | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, cutouts: Iterable[CutOut], weights: ArrayLike | None = None,
                     depths: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        cutouts = items('cutouts', self.cutouts, CutOut, least=1)
        weights = None if self.weights is None else row('weights', self.weights, above=0)
        if weights is not None and weights.size != len(cutouts):
            raise InvalidTask(f'weights has {weights.size} entries: expected one per cut-out, '
                              f'{len(cutouts)}')
        put(self, cutouts=cutouts, weights=weights, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    @property
    def passed(self) -> tuple[CutOut, ...]:
        """The cut-outs that the DLO passes, in their order."""
        return self.cutouts

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan; one and two cut-outs are hit exactly, as by `Thread` and `ThreadTwo`."""
        instance('context', context, PlanContext)
        if len(self.cutouts) <= 2:
            return threading_of(self.cutouts, self.depths).solve(context)
        free, task = context.without_obstacles, Threading(
            self.cutouts, depths_on(context.rod.length, self.depths), context.start,
            context.demands)
        if self.weights is None:
            return thread_by_room(free, task)
        return thread_sequence(free, task, self.weights)


def threading_of(cutouts: Sequence[CutOut],
                 depths: ArrayLike | None = None) -> Thread | ThreadTwo | ThreadSequence:
    """Return the task that threads through these cut-outs, one after the other.

    Parameters
    ----------
    cutouts : sequence of CutOut
        One or more.
    depths : array_like, shape (n,), optional
        Arc lengths that have gone through the first one, m, or None.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    cutouts = items('cutouts', cutouts, CutOut, least=1)
    if len(cutouts) == 1:
        return Thread(cutouts[0], depths)
    return ThreadTwo(*cutouts, depths) if len(cutouts) == 2 else ThreadSequence(
        cutouts, None, depths)


def cutouts_of(task: Task | None) -> tuple[CutOut, ...]:
    """Return the cut-outs that the DLO passes in a task, in their order; none for other tasks."""
    return () if task is None else task.passed
