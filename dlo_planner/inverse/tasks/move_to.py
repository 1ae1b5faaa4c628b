# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From pose to pose: the DLO goes along, free or held elsewhere too, by what rests or moves.

Nothing is sought: between two poses the gripper and all other arms go straight, turning evenly, and
the plan is refused where the DLO would jump, touch something, bend too sharply or pull too hard.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from dlo_planner.direct.grips import Grips, between
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.continuation import BranchPoint, GivenPoses, Step
from dlo_planner.inverse.stages import held_as_said
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.checks import instance, items, number, shown
from dlo_planner.model.holds import FarEnd, Hold, have_rings, holds_of
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.continuity import SAME, SURELY_STABLE, apart, same
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint

_LONGEST = 0.1        # of the length, and
SHARPEST = 0.15       # rad: between two waypoints
_UNEVEN = 0.1         # of a motion: what it may leave an even one in its middle
_HALVINGS = 8         # of the way between two waypoints where the DLO is hardly stable


def interpolated(one: Pose, other: Pose, length: float) -> list[Pose]:
    """Return Poses from `one`, which is left out, to `other`; none where they are the same."""
    shift = np.linalg.norm(other.position - one.position)
    turn = angle_between(one.rotation, other.rotation)
    parts = int(np.ceil(max(float(shift) / (_LONGEST * length), turn / SHARPEST) - 1e-9))
    return [between(one, other, k / parts) for k in range(1, parts + 1)]


def straight(one: Grips, other: Grips, length: float) -> list[Grips]:
    """Return Grips from `one`, which is left out, to `other`; none where they are the same.

    As many as the arm with the longest way needs; the places that are held are the same.
    """
    pairs = [(one.gripper, other.gripper), *((before.pose, after.pose) for before, after in zip(
        one.holds, other.holds, strict=True))]
    parts = max(len(interpolated(*pair, length)) for pair in pairs)
    return [one.towards(other, k / parts) for k in range(1, parts + 1)]


def limit(name: str, value: object) -> float | None:
    """Return a limit of forces (N) or moments (N m), None for none."""
    return None if value is None else number(name, value, above=0)


def led(context: PlanContext, grips: Sequence[Grips], demands: PlanChecker,
        stops: Collection[int] = (), first: Shape | None = None,
        known: Sequence[Shape] = (), ends: list[int] | None = None) -> Plan:
    """Return the Plan of a DLO that is led straight through n Grips, or raise Infeasible.

    The first Shape is found from `first`, or naturally. `known` are the Shapes at the first of the
    Grips where they are known, each tracked from the one before. Where the DLO is hardly stable
    there are more waypoints than Grips: `ends` is given how many there are up to each of these.
    """
    branch = GivenPoses(context.simulator.without_obstacles(), [one.gripper for one in grips],
                        [one.holds for one in grips])
    builder = PlanBuilder(np.zeros(len(grips)), demands)
    before = known[0] if known else branch.first(first).shape
    found = [before]
    for index, goal in enumerate(grips):
        builder.check()
        if index:
            after = known[index] if index < len(known) and before is known[index - 1] else None
            found = _followed(branch.simulator, before, goal, _HALVINGS, after)
            builder.lengthen(len(found) - 1)
        for shape in found:
            refused = branch.refusal(builder, None, Step(BranchPoint(shape), 0.0))
            if refused is not None:
                raise refused
            builder.add(Waypoint(shape))
        before = found[-1]
        if ends is not None:
            ends.append(len(builder.waypoints))
        if index in stops:
            builder.stop()
    return builder.finished()


def _followed(simulator: DirectSimulator, before: Shape, goal: Grips, halvings: int,
              after: Shape | None = None) -> list[Shape]:
    """Return the Shapes in which a DLO follows its grips, the last one at `goal`.

    `after`: where one step leads, if that is known.

    Near the loss of stability there are two shapes close to each other, and a long step may lead
    to that in which the DLO does not come: steps are halved until the stability is halved at most
    from each to the next, half a step leads to the same, and the DLO moves evenly. Where it does
    not follow the last one is not `converged`, or has `jumped`. What is neutral is so everywhere:
    that is the demand on stability to judge.
    """
    here = Grips(before.gripper, before.holds)
    middle = here.towards(goal, 0.5)
    if after is None:
        after, = simulator.track([goal.gripper], initial=before, holds=goal.holds)
    least = min(before.stability, after.stability)
    if not after.converged or after.jumped or not NEUTRAL < least < SURELY_STABLE:
        return [after]
    halved, again = simulator.track([middle.gripper, goal.gripper], initial=before,
                                    holds=[middle.holds, goal.holds])
    if (again.converged and same(again, after) and halved.stability > least / 2
            and after.stability > before.stability / 2 and _evenly(before, halved, after)):
        return [after]
    if not halvings:
        if have_rings(after.holds) and apart(before, after) < SAME * before.s[-1]:
            return [after]  # where a ring begins to slide, or sticks, no step is even
        return [replace(after, jumped=True)]  # in which shape the DLO comes there is not known
    found = _followed(simulator, before, middle, halvings - 1)
    if not found[-1].converged or found[-1].jumped:
        return found
    return found + _followed(simulator, found[-1], goal, halvings - 1)


def _evenly(before: Shape, middle: Shape, after: Shape) -> bool:
    """Whether a DLO is half way between two Shapes in the `middle` one."""
    one, other, halfway = (shape.positions_at(before.s) for shape in (before, after, middle))
    away = np.linalg.norm(halfway - 0.5 * (one + other), axis=1).max()
    return bool(away < _UNEVEN * np.linalg.norm(other - one, axis=1).max())


@dataclass(frozen=True, eq=False, repr=False)
class MoveTo(Task):
    """Move the gripper from `start` through poses, one straight motion after the other.

    What holds the far end may move along, by an arm of its own: `Plan.arms`. The plan is refused
    where the DLO would fall into another shape, touch an obstacle, bend more than
    `Rod.max_bend_curvature`, or where a grip bears more than is allowed, at and between waypoints.
    The workspace is the gripper's; where other arms may be is not looked at.

    Attributes
    ----------
    poses : tuple of Pose
        Where the gripper goes, in this order; it stops at each. One or more.
    far_end : FarEnd or None
        What holds the far end, at the beginning. If None, it is free.
    max_force : float or None
        Largest force that the gripper, and what else holds the DLO, may exert, N. If None, any.
    max_moment : float or None
        The same for the moment, N m.
    far_ends : tuple of Pose
        Where the far end is held at each of the `poses`. If empty, its grip stands still.
    holds : tuple of Hold
        What else holds the DLO, standing still.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    takes_initial: ClassVar[bool] = True
    takes_held: ClassVar[bool] = True

    poses: tuple[Pose, ...]
    far_end: FarEnd | None = None
    max_force: float | None = None
    max_moment: float | None = None
    far_ends: tuple[Pose, ...] = ()
    holds: tuple[Hold, ...] = ()

    if TYPE_CHECKING:  # what may be given
        def __init__(self, poses: Iterable[Pose], far_end: FarEnd | None = None,
                     max_force: float | None = None, max_moment: float | None = None,
                     far_ends: Iterable[Pose] = (),
                     holds: Iterable[Hold] = ()) -> None: ...

    def __post_init__(self) -> None:
        put(self, poses=items('poses', self.poses, Pose, least=1))
        instance('far_end', self.far_end, FarEnd, optional=True)
        put(self, max_force=limit('max_force', self.max_force),
            max_moment=limit('max_moment', self.max_moment),
            holds=items('holds', self.holds, Hold))
        put(self, far_ends=items('far_ends', self.far_ends, Pose))
        if self.far_ends:
            if self.far_end is None:
                raise InvalidTask(f'far_end = None: expected the FarEnd that far_ends = '
                                  f'{shown(self.far_ends)} move')
            if len(self.far_ends) != len(self.poses):
                raise InvalidTask(f'far_ends has {len(self.far_ends)} entries: expected one for '
                                  f'each of the poses, {len(self.poses)}')
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan from `start` to the last pose."""
        instance('context', context, PlanContext)
        start, length = instance('context.start', context.start, Pose), context.rod.length
        grips, stops = [Grips(start, holds_of(self.far_end, self.holds, length))], list[int]()
        held_as_said(context.initial, grips[0].holds)
        for k, pose in enumerate(self.poses):
            end = self.far_end
            if end is not None and self.far_ends:
                end = FarEnd(self.far_ends[k], end.grip)
            grips += straight(grips[-1], Grips(pose, holds_of(end, self.holds, length)), length)
            stops.append(len(grips) - 1)
        return led(context, grips, replace(
            context.demands, wrench_limits=(self.max_force, self.max_moment)), stops[:-1],
            context.initial)
