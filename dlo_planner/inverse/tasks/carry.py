# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Carried from shape to shape: the gripper and what else holds the DLO move at once.

The straight way is tried first, then one that lifts all that moves, goes across and lowers it,
higher and higher. What was found is shortened where the DLO then ends in the same shape: else it
would change its branch unseen. Each way is judged as every plan is, at its waypoints and between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from dlo_planner.direct.grips import Grips
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.stages import again, check_reach, held_at_first, upwards
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.move_to import led, limit, straight
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, number, shown
from dlo_planner.model.holds import FarEnd, Hold, Holds, holds_of, place_of, posed
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.stage import arm_of
from dlo_planner.plan.waypoint import Waypoint

# of the length: heights by which all is lifted, one after the other
_HEIGHTS = 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0
_BRANCH = 1e-5   # of the length: two shapes in the same grips that are nearer are one
# a shortcut is taken that leaves out at least this part of the way it replaces: less is not worth
# another corner, at which all arms stop
_WORTH = 0.03
_CUTS = 1.0, 0.5, 0.25  # parts of the ways beside a corner, in the order in which they are cut off
_SAME_PLACE = 1e-9  # of the length: places of holds that are nearer are one


@dataclass(frozen=True, eq=False, repr=False)
class Carry(Task):
    """Carry the DLO from where it is held to where it is to be held, all of it in one motion.

    The gripper goes from `start` to `to`; the far end, or other places of the DLO, are moved by
    arms of their own (`Plan.arms`) as far as it is said where they go, all by one parameter. The
    DLO does not jump, touch anything, pass through itself or bend more than
    `Rod.max_bend_curvature`, and no grip exerts more than is allowed, at and between waypoints. The
    workspace is the gripper's; where other arms may be, and the hands themselves, are not looked
    at.

    Attributes
    ----------
    to : Pose
        Where the gripper goes.
    far_end_to : Pose or None
        Where the far end is held then. If None, what holds it stands still.
    holds_to : tuple of Hold
        What else goes along, each as it holds then: the same places, in the same grips. Holds that
        are not listed stand still.
    far_end : FarEnd or None
        What holds the far end at the beginning. If None, `holds` or `initial` say it.
    holds : tuple of Hold
        What else holds the DLO at the beginning.
    max_force : float or None
        Largest force that a grip may exert, N. If None, any.
    max_moment : float or None
        The same for the moment, N m.
    clearance : float
        Least distance of the DLO from everything, m.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    takes_initial: ClassVar[bool] = True
    takes_held: ClassVar[bool] = True

    to: Pose
    far_end_to: Pose | None = None
    holds_to: tuple[Hold, ...] = ()
    far_end: FarEnd | None = None
    holds: tuple[Hold, ...] = ()
    max_force: float | None = None
    max_moment: float | None = None
    clearance: float = 0.0

    if TYPE_CHECKING:  # what may be given
        def __init__(self, to: Pose, far_end_to: Pose | None = None,
                     holds_to: Iterable[Hold] = (), far_end: FarEnd | None = None,
                     holds: Iterable[Hold] = (), max_force: float | None = None,
                     max_moment: float | None = None, clearance: float = 0.0) -> None: ...

    def __post_init__(self) -> None:
        instance('to', self.to, Pose)
        instance('far_end_to', self.far_end_to, Pose, optional=True)
        instance('far_end', self.far_end, FarEnd, optional=True)
        put(self, holds_to=items('holds_to', self.holds_to, Hold),
            holds=items('holds', self.holds, Hold),
            max_force=limit('max_force', self.max_force),
            max_moment=limit('max_moment', self.max_moment),
            clearance=number('clearance', self.clearance, minimum=0))
        if self.far_end_to is not None and any(hold.s is None for hold in self.holds_to):
            raise InvalidTask(f'holds_to = {shown(self.holds_to)}: expected none of the tip, s = '
                              'None, beside far_end_to')
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan from `start` to where all arms are to be."""
        instance('context', context, PlanContext)
        begin = self._begin(context)
        return _Search(context, replace(
            context.demands, wrench_limits=(self.max_force, self.max_moment),
            clearance=self.clearance), begin, self._end(begin, context.rod.length)).plan()

    def _begin(self, context: PlanContext) -> Grips:
        """Return what holds the DLO at the beginning; raise InvalidTask if that is not known."""
        start = instance('context.start', context.start, Pose)
        return Grips(start, held_at_first(context, holds_of(
            self.far_end, self.holds, context.rod.length)))

    def _end(self, begin: Grips, length: float) -> Grips:
        """Return what holds the DLO at the end; raise InvalidTask if it holds it otherwise."""
        goals = list(self.holds_to)
        if self.far_end_to is not None:
            if not begin.holds or begin.holds[-1].s is not None:
                raise InvalidTask(f'far_end_to = {self.far_end_to!r}: expected a far end that is '
                                  'held, as far_end or initial say; it is free')
            goals.append(posed(begin.holds[-1], self.far_end_to))
        holds, moved = [], list[str]()
        for hold in begin.holds:
            there = [goal for goal in goals if abs(
                place_of(goal, length) - place_of(hold, length)) < _SAME_PLACE * length]
            if not there:
                holds.append(hold)
                continue
            if there[0].grip != hold.grip:
                raise InvalidTask(f'holds_to: {there[0]!r}: expected the grip {hold.grip!r}, as '
                                  f'{hold!r} holds there')
            goals = [goal for goal in goals if goal is not there[0]]
            holds.append(posed(hold, there[0].pose))
            moved.append(arm_of(hold))
        if goals:
            raise InvalidTask(f'holds_to: {goals[0]!r}: expected a place that is held at the '
                              f'beginning, one of {shown(begin.holds)}')
        names = [arm_of(hold) for hold in begin.holds]
        if any(names.count(name) > 1 for name in moved):
            raise InvalidTask(f'holds_to: held by {", ".join(names)}: expected a name of its own, '
                              '`Hold.by`, for each arm that moves')
        return Grips(self.to, tuple(holds))


class _Way(NamedTuple):
    """A way that is found: n Grips, their Shapes, and the indices of its corners and ends."""

    grips: list[Grips]
    shapes: Sequence[Shape]
    corners: list[int]

    @classmethod
    def of(cls, shapes: Sequence[Shape], corners: Iterable[int]) -> _Way:
        """Return the way through Shapes, with corners at these and at both ends."""
        return cls([Grips(shape.gripper, shape.holds) for shape in shapes], shapes,
                   sorted({0, *corners, len(shapes) - 1}))


class _Search:
    """Looks for a way from Grips to others."""

    def __init__(self, context: PlanContext, demands: PlanChecker, begin: Grips,
                 end: Grips) -> None:
        self._context, self._demands, self._begin, self._end = context, demands, begin, end
        self._silent, self._length = demands.silent(), context.rod.length
        self._up = upwards(context.simulator.surroundings.gravity)

    def plan(self) -> Plan:
        """Return the Plan, or raise Infeasible that says why there is none."""
        for name, grips in (('start', self._begin), ('goal', self._end)):
            check_reach(self._context, self._silent, grips, f'at the {name} the DLO')
        best: Infeasible | None = None
        for height in (0.0, *_HEIGHTS):
            keys = self._over(height * self._length)
            try:
                plan = self._led(keys, self._silent, self._context.initial)
            except Infeasible as error:
                if error.waypoint == 0:  # the start itself
                    raise
                if best is None or _progress(error) > _progress(best):
                    best = error
                continue
            return replace(self._final(keys, plan) if height else self._led(
                keys, self._demands, self._context.initial), starts=(('carry', 0),))
        assert best is not None  # the straight way is tried at least
        raise self._refusal(best)

    def _over(self, height: float) -> list[Grips]:
        """Return the corners of a way that lifts all that moves by a height, m; 0: straight."""
        if not height:
            return [self._begin, self._end]
        # those that the task does not list are the very same
        still = [one is other for one, other in zip(
            self._begin.holds, self._end.holds, strict=True)]
        return [self._begin, *(_lifted(grips, height * self._up, still)
                               for grips in (self._begin, self._end)), self._end]

    def _led(self, keys: Sequence[Grips], demands: PlanChecker, first: Shape | None) -> Plan:
        """Return the Plan through corners, from a Shape or as the DLO naturally is."""
        grips, corners = _through(keys, self._length)
        return led(self._context, grips, demands, corners[1:-1], first)

    def _final(self, keys: Sequence[Grips], plan: Plan) -> Plan:
        """Return the Plan through corners `keys`, shortened, as it is handed out."""
        for corners in (self._shortened(plan), keys):
            try:
                return self._led(corners, self._demands, self._context.initial)
            except Infeasible as error:  # its waypoints are others than those of its pieces
                refused = error
        raise refused

    def _shortened(self, plan: Plan) -> list[Grips]:
        """Return the corners of a shorter way than that of `plan`, with the same shapes at its end.

        Each corner is cut off, from a waypoint before it to one behind it.
        """
        way, k = _Way.of(plan.shapes, plan.stops), 1
        while k < len(way.corners) - 1:
            cut = next(filter(None, (self._cut(way, k, part) for part in _CUTS)), None)
            if cut is None:
                k += 1
            else:
                # the corner may be gone, or two are in its place, which are not cut again
                way, k = cut, k + len(cut.corners) - len(way.corners) + 1
        return [way.grips[k] for k in way.corners]

    def _cut(self, way: _Way, k: int, part: float) -> _Way | None:
        """Return a way with corner k cut off by a part of the ways beside it, None if it is not."""
        before, corner, after = way.corners[k - 1:k + 2]
        i, j = corner - round(part * (corner - before)), corner + round(part * (after - corner))
        one, other = way.grips[i], way.grips[j]
        if corner in (i, j) or _apart(one, other) > (1 - _WORTH) * (
                _apart(one, way.grips[corner]) + _apart(way.grips[corner], other)):
            return None
        try:
            plan = self._led([one, other], self._silent, way.shapes[i])
        except Infeasible:
            return None
        if apart(plan.shapes[-1], way.shapes[j]) > _BRANCH * self._length:
            return None
        later = i + len(plan) - 1 - j
        corners = [*way.corners[1:k], i, j + later, *(c + later for c in way.corners[k + 1:-1])]
        return _Way.of([*way.shapes[:i], *plan.shapes, *way.shapes[j + 1:]], corners)

    def _refusal(self, best: Infeasible) -> Infeasible:
        """Return why there is no way: the goal itself breaks a demand, or all ways do."""
        simulator = self._context.simulator.without_obstacles()
        goal = simulator.solve(self._end.gripper, holds=self._end.holds)
        if not goal.converged:
            return again(best, f'at the goal the DLO is {goal.status}; ')
        broken = self._silent.violation(Waypoint(goal))
        if broken is not None:
            return Infeasible(f'at the goal {broken.message}', best.waypoint, broken.name,
                              float(-broken.room), best.plan, broken.unit)
        heights = ', '.join(f'{height * self._length:.3g}' for height in _HEIGHTS)
        return again(best, f'neither the straight way nor one lifted by {heights} m is free; of '
                      'the one that came farthest ')


def _progress(error: Infeasible) -> float:
    """Return how much of a way was kept."""
    return error.plan.fraction if error.plan is not None else 0.0


def _lifted(grips: Grips, shift: Floats, still: Sequence[bool]) -> Grips:
    """Return Grips displaced by `shift` (3,), m; holds that stand still stay."""
    holds: Holds = tuple(hold if stays else posed(hold, _shifted(hold.pose, shift))
                         for hold, stays in zip(grips.holds, still, strict=True))
    return Grips(_shifted(grips.gripper, shift), holds)


def _shifted(pose: Pose, shift: Floats) -> Pose:
    return Pose(pose.position + shift, pose.quaternion)


def _through(keys: Sequence[Grips], length: float) -> tuple[list[Grips], list[int]]:
    """Return Grips through corners, closely, and the indices of the corners and both ends."""
    grips, corners = [keys[0]], [0]
    for one, other in pairwise(keys):
        grips += straight(one, other, length)
        corners.append(len(grips) - 1)
    return grips, corners


def _apart(one: Grips, other: Grips) -> float:
    """Return how far the arm goes that goes farthest, m."""
    ends = [(one.gripper, other.gripper), *((before.pose, after.pose) for before, after in zip(
        one.holds, other.holds, strict=True))]
    return max(float(np.linalg.norm(after.position - before.position)) for before, after in ends)
