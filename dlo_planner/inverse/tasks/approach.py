# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From the present pose of the gripper to the beginning of a threading, clear of the sheet.

The gripper goes straight, turning evenly, to where the free end is `standoff` before the center,
stops there, and goes in along the normal: few corners set the DLO swinging least. If the DLO would
come too near to the sheet, the gripper backs off along the normal first, turns, and comes straight.
While it only translates, a DLO that is behind the sheet at both ends is behind it all along; while
it turns, it has to keep away by as much as may happen between two poses. The gripper backs off by
the smallest distance that allows that; from farther than its length the DLO cannot reach the sheet.
Where the DLO would fall on the way, the gripper turns by way of other directions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.grasp import grasped_at
from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DeadlineExceeded, Infeasible, InvalidTask
from dlo_planner.inverse.continuation import (
    BranchPoint,
    Follower,
    GivenPoses,
    Step,
    continue_branch,
)
from dlo_planner.inverse.equilibria import least_turn
from dlo_planner.inverse.held_inside import HeldInside, front_of
from dlo_planner.inverse.route import first_feasible, quick_simulator
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.move_to import SHARPEST, interpolated
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between, turned_by
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.continuity import apart, same
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.plan.waypoint import Holes, Waypoint
from dlo_planner.trajectory.trajectory import quickest_plan

_MARGIN = 0.02        # of the length
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the distance back that is safe in any case
_STRAIGHT = None      # instead of backing off: translation and rotation at once
_WHAT = 'start phase, waypoint'  # in a refusal
_FALLS = 'continuity', 'start'  # refusals: the DLO falls, or comes into another shape
# Unit vectors that the gripper is directed along on a detour: a grid of eighths of a turn.
_DIRECTIONS = np.array([(np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift))
                        for lift in (0.0, -np.pi / 4, np.pi / 4)
                        for turn in np.arange(8) * np.pi / 4] + [(0.0, 0.0, -1.0)])


# A pose of the gripper, and how far (m) the DLO has to be behind the sheet there.
_Station: TypeAlias = tuple[Pose, float]


def first_approach(approach: Callable[..., Plan], length: float, *arguments: Any,
                   **options: Any) -> Plan:
    """Return the first Plan of `InverseSimulator.approach` at any of its standoffs.

    Quicker than to compare their settled motions. One standoff does not tell whether there is a
    way: each leads to another place outside of the hole.
    """
    return first_feasible(partial(approach, *arguments, standoff=part * length, **options)
                          for part in _STANDOFFS)


def _from_behind(simulator: DirectSimulator, task: Approach, start: Pose, initial: Shape | None,
                 demands: PlanChecker, back: float | None, detour: Sequence[Floats] = ()) -> Plan:
    """Return the Plan to `first` that goes `back` (m) before it turns, or _STRAIGHT.

    detour: rotations (3, 3) that the gripper turns through, where it goes back.
    """
    cutout, first, standoff = task.cutout, task.first, task.standoff
    assert standoff is not None  # the task chooses one
    normal, length, radius = cutout.normal, simulator.rod.length, demands.surface.bound
    entering = _entering(first.gripper, normal, standoff, length)
    before = entering[0]
    coming = (_blended(start, before, standoff, radius, length) if back is _STRAIGHT else
              _cornered(cutout, start, before, radius, length, back, detour))
    # the free end may wait in the hole, and comes to be there
    hole = -(1 + _MARGIN) * radius - _MARGIN**2 * length
    stations = [(start, hole), *coming]
    stop = len(stations) - 1
    if standoff <= radius:
        stations[-1] = (stations[-1][0], hole)
    stations += [(pose, 0.0) for pose in entering[1:]]
    stations[-1] = (stations[-1][0], hole)
    branch = _Coming(simulator, cutout, stations, demands.surface.bound, first)
    builder = PlanBuilder(np.zeros(len(stations)), demands, _WHAT, stops=(stop,))
    holes = Holes([cutout], length, demands.obstacles, demands.surface)

    def waypoint(point: BranchPoint) -> Waypoint:
        return holes.passed(Waypoint(point.shape))

    continue_branch(builder, Follower(branch, branch.first(initial), 0.0,
                                      np.arange(len(stations), dtype=float)), waypoint)
    return builder.finished()


class _Coming(GivenPoses):
    """The shapes at stations [(Pose, room)], each so far behind the sheet; the last is `end`."""

    def __init__(self, simulator: DirectSimulator, cutout: CutOut, stations: Sequence[_Station],
                 radius: float, end: Shape) -> None:
        super().__init__(simulator, [pose for pose, _ in stations])
        self._cutout, self._rooms, self._radius = cutout, [room for _, room in stations], radius
        self._end = end

    def least(self, point: BranchPoint) -> float:
        """Return how far (m) the DLO has to be behind the sheet."""
        return self._rooms[int(point.depth)]

    def room(self, point: BranchPoint) -> float:
        """Return how far (m) it is."""
        away = self._cutout.center - point.shape.positions
        return float((away @ self._cutout.normal).min()) - self._radius

    def refusal(self, builder: PlanBuilder, before: BranchPoint | None,
                step: Step) -> Infeasible | None:
        """Return why the DLO does not follow, comes too near or ends in another shape, or None."""
        refused = super().refusal(builder, before, step)
        if refused is not None or step.point is None:
            return refused
        room, least, shape = self.room(step.point), self.least(step.point), step.point.shape
        if room < least:
            return builder.refusal('clearance', least - room, 'the DLO is not behind the sheet'
                                   if room < 0 else
                                   f'the DLO would turn {room:.3g} m behind the sheet')
        if len(builder.waypoints) == builder.wanted - 1 and not same(shape, self._end):
            return builder.refusal('start', apart(shape, self._end), 'the DLO does not come into '
                                   'the shape in which the threading begins')
        return None


def _entering(first: Pose, normal: Floats, standoff: float, length: float) -> list[Pose]:
    """Return the Poses from where the free end is `standoff` before the center to `first`."""
    before = Pose.from_rotation(first.position - standoff * normal, first.rotation)
    return [before, *interpolated(before, first, length)]


def _blended(start: Pose, before: Pose, standoff: float, radius: float,
             length: float) -> list[_Station]:
    """Return [(Pose, least distance of the DLO from the sheet, m)] of the straight motion."""
    margin = min(_MARGIN * length, 0.5 * max(standoff - radius, 0.0))
    return [(pose, margin) for pose in interpolated(start, before, length)]


def _cornered(cutout: CutOut, start: Pose, before: Pose, radius: float, length: float,
              back: float, detour: Sequence[Floats]) -> list[_Station]:
    """Return the same of a motion back along the normal by `back` (m), a turn, and one forward."""
    safe = (cutout.center - start.position) @ cutout.normal + back >= length + radius
    away = start.position - back * cutout.normal
    lifted, *between, turned = (Pose.from_rotation(away, rotation) for rotation in (
        start.rotation, *detour, before.rotation))
    return ([(pose, 0.0) for pose in interpolated(start, lifted, length)]
            + [(pose, 0.0 if safe else SHARPEST * length)
               for one, other in pairwise((lifted, *between, turned))
               for pose in interpolated(one, other, length)]
            + [(pose, 0.0) for pose in interpolated(turned, before, length)])


def _detours(simulator: DirectSimulator, start: Pose, first: Shape,
             initial: Shape | None) -> Iterator[tuple[Floats, ...]]:
    """Yield rotations to turn through, by which the DLO comes into the shape `first`.

    The gripper goes by way of another direction, or turns the long way around. How the DLO falls
    depends on the rotation alone; the shortest ways that do it without a fall come first.
    """
    one, other = start.rotation, first.gripper.rotation
    turn = Rotation.from_matrix(other @ one.T).as_rotvec()
    angle = float(np.linalg.norm(turn))
    # a rotation by 2 pi less, about the same axis; without one, any
    axis = turn / angle if angle > 0 else one[:, 0]
    ways = [tuple(turned_by(share * (angle - 2 * np.pi) * axis) @ one for share in (1 / 3, 2 / 3))]
    ways += [(least_turn(one[:, 0], by) @ one, least_turn(other[:, 0], by) @ other)
             for by in _DIRECTIONS]
    begin = simulator.track([start], initial=initial)[0]

    def turned(way: tuple[Floats, ...]) -> float:
        return sum(angle_between(a, b) for a, b in pairwise((one, *way, other)))

    for way in sorted(ways, key=turned):
        shape, poses = begin, [Pose.from_rotation(start.position, rotation)
                               for rotation in (one, *way, other)]
        for pose in (pose for a, b in pairwise(poses)
                     for pose in interpolated(a, b, simulator.rod.length)):
            shape = simulator.track([pose], initial=shape)[0]
            if shape.jumped or not shape.converged:
                break
        else:
            if same(carried(shape, first.gripper.position - start.position), first):
                yield way


_FARTHEST = 100  # of the length: from where the gripper may come
_STANDOFFS = 0.1, 0.05, 0.15  # of the length: the first one where motion does not tell


@dataclass(frozen=True, eq=False, repr=False)
class Approach(Task):
    """Bring the free end before a cut-out and into it; see `InverseSimulator.approach`.

    Attributes
    ----------
    cutout : CutOut
    first : Shape
        Shape in which the threading begins: the first one of its Plan.
    standoff : float or None
        Distance in m between the free end and the cut-out where the last straight motion begins.
        If None, of 0.05, 0.1 and 0.15 of the length the one whose settled motion (`Trajectory`) is
        the quickest, within the requirements' limits; 0.1 if none can be made calm.
    through : Plan or None
        The threading that follows, a part of that motion. If None, the motion ends before it.
    tolerance : float or None
        Tolerance of that motion, m; see `Trajectory`.
    """

    takes_initial: ClassVar[bool] = True

    cutout: CutOut
    first: Shape
    standoff: float | None = None
    through: Plan | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        instance('cutout', self.cutout, CutOut)
        instance('first', self.first, Shape)
        instance('through', self.through, Plan, optional=True)
        if self.standoff is not None:
            put(self, standoff=number('standoff', self.standoff, minimum=0))
        if self.tolerance is not None:
            put(self, tolerance=number('tolerance', self.tolerance, above=0))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan from `start` to the gripper of `first`."""
        at = grasped_at(self.first)
        if at is not None:
            return self._inside(instance('context', context, PlanContext), at)
        instance('context', context, PlanContext)
        start, farthest = instance('start', context.start, Pose), _FARTHEST * context.rod.length
        for name, pose in (('start', start), ('plan.grippers[0]', self.first.gripper)):
            away = np.linalg.norm(pose.position - self.cutout.center)
            if away > farthest:
                raise InvalidTask(f'{name} = {pose!r}: expected at most {farthest:g} m from the '
                                  f'cut-out, is {away:.3g} m')
        if self.standoff is not None:
            number('standoff', self.standoff, maximum=farthest)
            return self._at(self.standoff, context)
        ways: list[Plan] = []
        refused: Infeasible | None = None
        for part in _STANDOFFS:
            try:
                ways.append(self._at(part * context.rod.length, context))
            except Infeasible as error:
                refused = refused or error
        if not ways:
            assert refused is not None  # of the first one
            raise refused
        return ways[self._quickest(ways, context)]

    def _inside(self, context: PlanContext, at: float) -> Plan:
        """Return the Plan of a DLO that is held at `at`, m, by that of its front."""
        held = HeldInside(context, at, (self.cutout,))
        through, parts = self.through, self.first.parts or ()
        task = replace(self, first=parts[1], through=None if through is None else front_of(
            through, Surface.of(held.front.rod)))
        plan = held.planned(partial(task.solve, held.front), _WHAT)
        last = plan.shapes[-1]
        if not same(last, self.first):
            raise Infeasible(f'{_WHAT} {len(plan) - 1}: the part of the DLO behind the gripper '
                             'does not come into the shape in which the threading begins',
                             len(plan) - 1, 'start', apart(last, self.first), plan)
        return plan

    def _at(self, standoff: float, context: PlanContext) -> Plan:
        """Return the Plan that goes straight or, if it must, backs off as little as does."""
        start, simulator = instance('start', context.start, Pose), context.without_obstacles
        demands, quick = context.demands.made_with(simulator), quick_simulator(simulator)
        behind = float((self.cutout.center - start.position) @ self.cutout.normal)
        back = max(0.0, (1 + _MARGIN) * simulator.rod.length + demands.surface.bound - behind)
        task = replace(self, standoff=standoff)
        trial, end = demands, self.first
        if quick is not simulator:
            trial, end = demands.silent().made_with(quick), quick.solve(end.gripper, end)

        def planned(away: float | None, detour: Sequence[Floats] = ()) -> Plan:
            plan = _from_behind(quick, replace(task, first=end), start, context.initial, trial,
                                away, detour)
            return plan if quick is simulator else _from_behind(
                simulator, task, start, context.initial, demands, away, detour)

        shares = _SHARES if back else (0.0,)
        try:
            return first_feasible(partial(planned, share if share is _STRAIGHT else share * back)
                                  for share in (_STRAIGHT, *shares))
        except Infeasible as refused:
            if refused.constraint not in _FALLS:
                raise
            for detour in _detours(quick, start, end, context.initial):
                context.progress.check()
                with suppress(Infeasible):
                    return first_feasible(partial(planned, share * back, detour)
                                          for share in shares)
            raise

    def _quickest(self, ways: Sequence[Plan], context: PlanContext) -> int:
        """Return the index of the plan whose settled motion is the quickest, 0 if none is calm."""
        plans = [one if self.through is None else concatenate(one, self.through) for one in ways]
        try:
            return quickest_plan(plans, context.requirements.limits, self.tolerance,
                                 context.simulator, context.progress.silent())
        except (Infeasible, InvalidTask, DeadlineExceeded):  # it can be gone through all the same
            return 0
