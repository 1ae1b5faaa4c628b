# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A stage of a plan: consecutive waypoints at which the same places are held in the same ways.

Some of the holds stand still, others are moved by arms of their own, beside the gripper. All arms
go by one parameter, the plan's time. Where the DLO is held elsewhere, another stage begins: what
opens and closes there are events.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.grips import between
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, shown
from dlo_planner.model.holds import BORE, FIXTURE, Hold, Holds, alike, posed
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, same

GRIPPER, FAR_END = 'gripper', 'far_end'  # names of arms
OPEN, CLOSE = 'open', 'close'  # kinds of events

# name of each stage, and the index of its first waypoint
Starts: TypeAlias = tuple[tuple[str, int], ...]


class Metric(NamedTuple):
    """A figure of each waypoint, under a name."""

    name: str
    unit: str
    values: Floats  # (n,), nan where it was not looked at
    worse: int  # 1: a larger one is worse, -1: a smaller one is


class Event(NamedTuple):
    """What a hand does between two stages, while all else stands still."""

    stage: int  # index of the stage that may begin when it has been done
    kind: str   # 'open' or 'close'
    hold: Hold  # what it lets go of, or what it holds from then on

    @property
    def arm(self) -> str:
        """The name of the arm."""
        return arm_of(self.hold)

    def __str__(self) -> str:
        at = 'the tip' if self.hold.s is None else f's = {self.hold.s:.6g} m'
        return f'{self.kind} {self.arm} at {at}'


@dataclass(frozen=True, eq=False, repr=False)
class Stage(Value):
    """A stage of a Plan; n waypoints.

    Attributes
    ----------
    name : str
    first : int
        Index of its first waypoint in the plan.
    times : ndarray, shape (n,)
        As `Plan.times`.
    shapes : tuple of Shape
        The n shapes, which know their grippers and holds.
    metrics : tuple of Metric
        What the plan says of these waypoints, by name.
    """

    name: str
    first: int
    times: Floats
    shapes: tuple[Shape, ...]
    metrics: tuple[Metric, ...]

    def __len__(self) -> int:
        return len(self.shapes)

    def __repr__(self) -> str:
        return brief(self, repr(self.name), f'{len(self)} waypoints', *(
            f'{name} moves' for name in self.arms))

    @property
    def grippers(self) -> tuple[Pose, ...]:
        """The n poses of the gripper."""
        return tuple(shape.gripper for shape in self.shapes)

    @property
    def arms(self) -> dict[str, tuple[Pose, ...]]:
        """The n poses of each hold that moves, by the name of the arm that moves it."""
        return moving(self.shapes)

    @property
    def resting(self) -> Holds:
        """The holds that stand still."""
        moved = self.arms
        return tuple(hold for hold in self.shapes[0].holds if arm_of(hold) not in moved)

    def metric(self, name: str) -> Floats:
        """Return the values (n,) of a metric.

        Raises
        ------
        InvalidTask
            There is none of this name.
        """
        known = {one.name: one.values for one in self.metrics}
        if name not in known:
            raise InvalidTask(f'name = {shown(name)}: expected one of {", ".join(known)}')
        return known[name]


def arm_of(hold: Hold) -> str:
    """Return the name of the arm that a Hold is moved by, if it moves: what holds there.

    That of a hold without a name is 'far_end' at the tip, else it goes by its place.
    """
    if hold.by != FIXTURE:
        return hold.by
    return FAR_END if hold.s is None else f'hold at {hold.s:.6g} m'


def moving(shapes: Sequence[Shape]) -> dict[str, tuple[Pose, ...]]:
    """Return the poses at n Shapes of each hold that is not the same at all, by its arm's name.

    A bore is no arm: its hold turns with the DLO. A hand with a name of its own may open, and
    close elsewhere: as long as it is open it goes straight there, and rests before it first
    closes and when it does not close again.

    Raises
    ------
    InvalidTask
        Two of them have the same name, or one without a name of its own is not there all the time.
    """
    found: dict[str, tuple[Pose, ...]] = {}
    known: dict[tuple[str, float | None], list[Pose]] = {}  # by name and place
    hands: dict[str, list[tuple[int, Pose]]] = {}  # by name, where they hold: waypoint and pose
    for k, shape in enumerate(shapes):
        for hold in shape.holds:
            if hold.by != BORE:
                known.setdefault((arm_of(hold), hold.s), []).append(hold.pose)
            if hold.by not in (BORE, FIXTURE):
                hands.setdefault(hold.by, []).append((k, hold.pose))
    names = [name for name, _ in known]
    for (name, _), poses in known.items():
        held = hands.get(name, [])
        if len({k for k, _ in held}) < len(held):  # two of one name at a time
            held = []
        if all(_same_pose(pose, poses[0]) for pose in poses) and (
                len(poses) == len(shapes) or all(_same_pose(pose, poses[0]) for _, pose in held)):
            continue
        if held:
            found[name] = _opening(held, len(shapes))
        elif len(poses) != len(shapes) or names.count(name) > 1:
            raise InvalidTask(f'Plan.shapes: the hold by {name!r} moves: expected exactly one of '
                              'that name at each waypoint')
        else:
            found[name] = tuple(poses)
        if name == GRIPPER:
            raise InvalidTask(f'Plan.shapes: a hold by {name!r} moves: expected another name than '
                              'that of the gripper itself')
    return found


def _same_pose(one: Pose, other: Pose) -> bool:
    return one is other or same(one, other)


def _opening(held: Sequence[tuple[int, Pose]], count: int) -> tuple[Pose, ...]:
    """Return the poses at `count` waypoints of a hand that holds at some of them, in order."""
    (k, pose), poses = held[0], list[Pose]()
    poses += [pose] * k
    for after, there in (*held[1:], (count, None)):
        poses.append(pose)
        poses += [pose if there is None else between(pose, there, (j - k) / (after - k))
                  for j in range(k + 1, after)]
        if there is not None:
            k, pose = after, there
    return tuple(poses)


def events_of(stages: Sequence[Stage]) -> tuple[Event, ...]:
    """Return what opens and closes between Stages: first all that closes, so that nothing falls."""
    found = list[Event]()
    for k, (one, other) in enumerate(pairwise(stages), start=1):
        before, after = one.shapes[-1].holds, other.shapes[0].holds
        found += [Event(k, kind, hold) for kind, holds, others in (
            (CLOSE, after, before), (OPEN, before, after)) for hold in holds
            if hold.by != BORE and not any(hold.s == there.s and hold.grip == there.grip
                                           and arm_of(hold) == arm_of(there) for there in others)]
    return tuple(found)


def moved_holds(holds: Holds, poses: Mapping[str, Pose]) -> Holds:
    """Return Holds, those by arms in `poses` at the Poses there."""
    return tuple(posed(hold, poses[name]) if (name := arm_of(hold)) in poses else hold
                 for hold in holds)


def holds_along(holds: Holds, arms: Mapping[str, Sequence[Pose]], count: int) -> list[Holds]:
    """Return the Holds at each of `count` places on the way of their arms; others stand still."""
    return [moved_holds(holds, {name: poses[k] for name, poses in arms.items()})
            for k in range(count)] if arms else [holds] * count


def default_starts(shapes: Sequence[Shape]) -> Starts:
    """Return the stages of n Shapes by what holds them alone: a new one where that changes."""
    changes = [k for k, (one, other) in enumerate(pairwise(shapes), start=1)
               if not alike(one.holds, other.holds)]
    return tuple((_named(shapes[k].holds), k) for k in (0, *changes)) if shapes else ()


def _named(holds: Holds) -> str:
    """Return the name of a stage by what holds beside the gripper."""
    return 'held by ' + ', '.join(map(arm_of, holds)) if holds else 'free'


def checked_starts(starts: Iterable[tuple[str, int]], shapes: Sequence[Shape]) -> Starts:
    """Return stages as they are given, for n Shapes; raise InvalidTask."""
    given: Starts = tuple(
        (instance('Plan.starts', name, str), integer('Plan.starts', first, minimum=0,
                                                     maximum=max(len(shapes) - 1, 0)))
        for name, first in items('Plan.starts', starts, tuple))
    firsts = [first for _, first in given]
    if not given or firsts[0] != 0 or any(
            later <= first for first, later in pairwise(firsts)):
        raise InvalidTask(f'Plan.starts = {shown(given)}: expected the first waypoint of each '
                          'stage, 0 and others increasing')
    for _, change in default_starts(shapes)[1:]:
        if change not in firsts:
            raise InvalidTask(f'Plan.starts = {shown(given)}: expected a stage to begin at '
                              f'waypoint {change}, where the DLO is held otherwise than before')
    return given


def shifted_starts(starts: Starts, end: int, count: int) -> Starts:
    """Return the stages of `count` waypoints of which the first is the waypoint `end` of a plan.

    That one belongs to what is before.
    """
    later = [(name, end + max(first, 1)) for name, first in starts]
    return tuple(one for one, following in zip(later, [*later[1:], ('', end + count)], strict=True)
                 if one[1] < following[1])


def wrenches_of(shapes: Sequence[Shape]) -> Floats:
    """Return (n, 1 + A, 6) what the gripper and each hold exert; nan where there is none.

    World axes, force (N) before moment about the place (N m), A the most holds of all n Shapes.
    """
    most = max((len(shape.holds) for shape in shapes), default=0)
    out = np.full((len(shapes), 1 + most, 6), np.nan)
    for row, shape in zip(out, shapes, strict=True):
        row[0] = shape.gripper_wrench
        row[1:1 + len(shape.holds)] = shape.wrenches
    return out
