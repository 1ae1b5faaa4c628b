# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Hand over hand: a long soft DLO goes through one hole in several grasps.

The free end is threaded by the first hand. Then two hands take turns: one alone holds the DLO near
the sheet, the rest hangs from it; the other one opens, goes to another place of the DLO and closes
there, as the DLO is. A hand opens where the other one alone would hold the DLO in the same shape,
so nothing falls: it bears nothing then. In between both draw the DLO through, slack by a little,
and shift together so that the DLO keeps to the center of the hole.

Where there is no second hand the rim may hold what has passed (`_OverTheRim`): the first one lays
the DLO on it, where its friction and what feeds the DLO bear all of the weight, opens, closes
farther back, lifts the DLO off and draws it on.

Each stage is judged as every plan is, at its waypoints and between, with all of the DLO: from what
feeds it to its free end, or from one free end to the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.grasp import GraspedInside, grasped_at
from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.geometry.so3 import partway
from dlo_planner.inverse.equilibria import least_turn
from dlo_planner.inverse.stages import Stages
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.move_to import limit
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import Hold, Holds, unreached
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose, angle_between, turned_by
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.margin import (
    GripErrors,
    least_margin,
    rating,
    upright_room,
    usual_uncertainty,
)
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import Plan, PlanStatus, truncate
from dlo_planner.plan.waypoint import Holes, Waypoint, waypoint_at

FIRST, SECOND = 'first', 'second'  # names of the hands
# lengths of the free part in front of the first hand that are tried, of that at which the weight
# bends a level DLO most of the way down, w f^3 / EI = 24 (of 24 to 48 the least that was measured)
_FREE, _SOFT = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4), 24.0
_FREEST = 0.6       # of the length: the largest of them
_MOST_PULLS = 8     # that are tried
_GAIN = 0.1         # of the room: what another pull, or a shorter free part, has to leave more
_PULLS = 0.25, 1.0  # of the weight between the hands: how they pull while they draw
_BOWED = 0.4, 0.8, -0.4  # rad, by which they pitch then: what is between is bowed, so not taut
_TURN = 0.1         # rad, and
_SHIFT = 0.02       # of the length: between two waypoints at most
_PITCH, _PITCHES = 0.05, 30  # rad, and how often to either side: how one hand alone may hold
_PLACES = 7         # of a pull, at which its margin is looked at
_EXACT = 1e-8       # of the length: by how much the DLO may miss the center
_CENTERINGS = 8     # corrections until it does not
_PULLED = 0.02      # of a pull and the weight between the hands: how exact it has to be on the way
_FURTHEST = 0.7     # by how much the logarithm of what is slack is changed at once,
_LOOSER = 0.4       # and where the DLO does not follow
_LOOSE = 4.0        # standard deviations of the hands' distance: what is less slack may be taut
_TAUT = 1e-4        # of the length between the hands: the least that is slack
_FALLS = 1e-3       # of the length: how far the DLO may move where a hand opens
_TAIL = 0.5         # of `grip_distance`: how much of the DLO is beyond the second hand at least
# With the rim: part of the room by which the hand is lowered at once, how often; part of the weight
# beyond the hole that it may bear where it is lowered far enough; how often it is led to where the
# DLO comes to without it; part of the rim's friction that is not counted on
_LOWER, _LOWERED, _BORNE, _LAID, _SURE = 0.25, 60, 0.05, 4, 0.1
_VERTICAL = 1e-9    # of a unit vector: a normal that is nearer to the vertical has no across

Step: TypeAlias = tuple[Shape, float]  # and the place of the DLO in the center, m


@dataclass(frozen=True, eq=False, repr=False)
class ThreadInGrasps(Task):
    """Thread a long soft DLO through one hole hand over hand, until a length of it has passed.

    A first hand before the sheet threads the free end. A second hand behind it takes what has
    passed; the first one opens, closes again farther back along the DLO, and both draw the DLO on.
    That is repeated until `length` has passed. Hands hold the DLO clamped; one closes where the DLO
    is, and opens where it bears nothing. The first waypoint has the free end in the hole.

    What is modelled: all of the DLO, under its own weight, from what feeds it. That holds its
    beginning, clamped, at `feed`, and stands still: a spool, a plugged connector. Between it and
    the hands the DLO hangs freely, and is in the way like the rest. With `begins_free` nothing
    feeds it: it hangs from the hands alone, its beginning free, off the floor. The hands are arms
    of the plan, 'first' and 'second' (`Plan.arms`). Its gripper is the feed; where nothing feeds
    the DLO it is the hand that is nearer to the beginning, another one from stage to stage. The
    hands themselves are not looked at, nor the way of an open hand, which `Plan.arms` has straight;
    the workspace holds for both, as for any gripper.

    `Plan.events` tell which hand opens or closes before which of the `Plan.stages`;
    `Plan.stage_plans` are what is timed, replayed and executed one by one.

    Attributes
    ----------
    cutout : CutOut
        With a size.
    length : float
        How much of the DLO has passed in the end, m.
    feed : Pose or None
        Where the DLO's beginning is held, x axis = tangent. If None, at `start`, unless it begins
        free.
    hold_at : float or None
        Where the first hand holds the DLO at first, m from its beginning. If None, as far from the
        free end as leaves room in the hole.
    stroke : float or None
        How much passes in one pull at most, m. If None, as much as leaves room in the hole.
    grip_distance : float
        Length of the DLO, m, from the sheet to a hand that is next to it.
    max_force : float or None
        Largest force that a hand or the feed may exert, N. If None, any.
    max_moment : float or None
        The same for the moment, N m.
    clearance : float
        Least distance of the DLO from the sheet and all obstacles, m.
    begins_free : bool
        Whether the DLO's beginning hangs freely, and nothing feeds it.
    on_rim : bool
        Whether the rim holds what has passed while the hand goes back, instead of a second hand: by
        the friction of the Sheet with this cut-out, which is among the obstacles. The DLO then has
        to be fed, and touches the sheet. Where the rim does not hold it the task is refused
        ('friction'); `Plan.friction_needed` says which friction it takes.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    cutout: CutOut
    length: float
    feed: Pose | None = None
    hold_at: float | None = None
    stroke: float | None = None
    grip_distance: float = 0.05
    max_force: float | None = None
    max_moment: float | None = None
    clearance: float = 0.0
    begins_free: bool = False
    on_rim: bool = False

    if TYPE_CHECKING:  # an integer is a number, too
        def __init__(self, cutout: CutOut, length: float, feed: Pose | None = None,
                     hold_at: float | None = None, stroke: float | None = None,
                     grip_distance: float = 0.05, max_force: float | None = None,
                     max_moment: float | None = None, clearance: float = 0.0,
                     begins_free: bool = False, on_rim: bool = False) -> None: ...

    def __post_init__(self) -> None:
        instance('cutout', self.cutout, CutOut)
        if self.cutout.radius is None and self.cutout.width is None:
            raise InvalidTask(f'cutout = {self.cutout!r}: expected one with a radius, or a width '
                              'and height: hands go by the room in it')
        instance('feed', self.feed, Pose, optional=True)
        if flag('begins_free', self.begins_free) and self.feed is not None:
            raise InvalidTask(f'feed = {self.feed!r}: expected None with begins_free = True, where '
                              'nothing feeds the DLO')
        if flag('on_rim', self.on_rim) and self.begins_free:
            raise InvalidTask('on_rim = True: expected False with begins_free = True: while the '
                              'hand is open, something has to hold the beginning of the DLO')
        put(self, length=number('length', self.length, above=0, unit='m'),
            grip_distance=number('grip_distance', self.grip_distance, above=0, unit='m'),
            max_force=limit('max_force', self.max_force),
            max_moment=limit('max_moment', self.max_moment),
            clearance=number('clearance', self.clearance, minimum=0))
        for name in ('hold_at', 'stroke'):
            if getattr(self, name) is not None:
                put(self, **{name: number(name, getattr(self, name), above=0, unit='m')})
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan, in stages."""
        instance('context', context, PlanContext)
        feed = None if self.begins_free else (
            self.feed or instance('context.start', context.start, Pose))
        if self.on_rim:
            return _OverTheRim(self, context, feed).plan()
        return _HandOverHand(self, context, feed).plan()



class _Hands(NamedTuple):
    """Where both hands are, but for a common shift, and what the second one does."""

    first: Pose
    second: Pose
    pull: float  # N, of the second hand away from the first

    @property
    def chord(self) -> Floats:
        """(3,) from the first to the second, m."""
        chord: Floats = self.second.position - self.first.position
        return chord

    @property
    def size(self) -> float:
        """How far the hands are apart, m."""
        return float(np.linalg.norm(self.chord))

    def shifted(self, shift: Floats) -> _Hands:
        """Return the same displaced by `shift` (3,), m."""
        return self._replace(first=_shifted(self.first, shift),
                             second=_shifted(self.second, shift))


class _Pull(NamedTuple):
    """How both hands hold the DLO while they draw it through."""

    apart: float   # m along the DLO
    hands: _Hands
    margin: float  # m, the least one on the way


class _HandOverHand:
    """Makes the stages of a ThreadInGrasps one after the other."""

    def __init__(self, task: ThreadInGrasps, context: PlanContext, feed: Pose | None) -> None:
        rod = context.rod
        self._task, self._context, self._feed = task, context, feed
        self._length, self._gap = rod.length, task.grip_distance
        number('length', task.length, above=2 * self._gap, below=rod.length - 2 * self._gap,
               unit='m')
        self._simulator, demands = context.without_obstacles, context.demands
        self._uncertainty = demands.uncertainty or usual_uncertainty(rod)
        self._workspace = demands.workspace  # of the hands, not of what feeds the DLO
        self._demands = replace(
            demands, wrench_limits=(task.max_force, task.max_moment), clearance=task.clearance,
            uncertainty=self._uncertainty, workspace=None)
        self._center, self._normal = np.array(task.cutout.center), np.array(task.cutout.normal)
        self._holes = self._holes_of(self._simulator)
        self._room = upright_room(task.cutout, demands.surface)
        gravity = np.asarray(self._simulator.surroundings.gravity)
        self._weight = float(np.linalg.norm(gravity)) * float(  # N/m
            rod.masses_per_length(np.linspace(0, rod.length, 33)).max())
        across = np.cross(gravity, self._normal)
        if np.linalg.norm(across) < _VERTICAL * max(1.0, float(np.linalg.norm(gravity))):
            across = np.array(task.cutout.pose.rotation[:, 1])
        self._across: Floats = across / np.linalg.norm(across)  # about which hands pitch
        self._stages = Stages(self._demands.speeds)
        self._inside = dict[float, GraspedInside]()  # by where the hand holds the DLO, m
        self._errors = GripErrors(self._uncertainty)  # of the grips, until the last stage ends

    def plan(self) -> Plan:
        """Return the Plan, or raise Infeasible that says which stage there is none of."""
        return self._stages.plan(self._hand_over_hand, lambda whole: float(
            whole.depths[-1] / self._task.length))

    def _hand_over_hand(self) -> None:
        """Make all stages."""
        front, first = self._front()
        shape, passed, wanted = self._threaded(front, first), float(front.depths[-1]), (
            self._task.length)
        number_ = 0
        while passed < wanted - _EXACT * self._length:
            number_ += 1
            at = self._length - passed
            second, pulls = at + self._gap, self._pulls(at, wanted - passed)
            shape = self._handed_over(shape, first, second, at, f'hand over {number_}')
            shape = self._alone(shape, SECOND, at, f'second alone {number_}')
            shape, pull = self._drawn_somehow(shape, second, at, pulls, f'pull {number_}')
            first, passed = second - pull.apart, passed + pull.apart - 2 * self._gap
            if passed < wanted - _EXACT * self._length:
                at = self._length - passed
                shape = self._handed_back(shape, first, second, at, f'lower {number_}')
                shape = self._alone(shape, FIRST, at, f'first alone {number_}')

    # ---- the free end -----------------------------------------------------------------------

    def _front(self) -> tuple[Plan, float]:
        """Return the Plan of the part in front of the first hand, and where that holds the DLO."""
        least = (2 + _TAIL) * self._gap
        if self._task.hold_at is not None:
            at = number('hold_at', self._task.hold_at, above=0, maximum=self._length - least,
                        unit='m')
            return self._front_at(at), at
        rod, longest = self._context.rod, _FREEST * self._length
        if self._weight:
            soft = float(rod.stiffnesses(np.linspace(0, rod.length, 33))[:, 1:].min())
            longest = min(longest, (_SOFT * soft / self._weight)**(1 / 3))
        tried = dict.fromkeys(min(max(part * longest, least), self._task.length + self._gap)
                              for part in _FREE)
        best: tuple[float, Plan, float] | None = None
        refused: Infeasible | None = None
        for free in tried:
            try:
                plan = self._front_at(self._length - free)
            except Infeasible as error:
                refused = error
                continue
            found = float(rating(plan.clearances.min(axis=(1, 2)), plan.margin, self._room).min())
            if best is None or found > best[0] + _GAIN:
                best = found, plan, self._length - free
        if best is None:
            assert refused is not None  # one is tried at least
            raise refused
        return best[1:]

    def _front_at(self, at: float) -> Plan:
        """Return the Plan of the part in front of a hand at `at`, m from the beginning."""
        context = self._context
        deepest = min(self._length - at - self._gap, self._task.length)
        depths = np.linspace(0, deepest, int(np.ceil(deepest / (_SHIFT * self._length))) + 1)
        front = replace(
            context, simulator=context.simulator.part(at, 1), given=context.given.part(at, 1),
            start=None, progress=context.progress.silent(), requirements=replace(
                context.requirements, workspace=None, uncertainty=self._uncertainty))
        try:
            return Thread(self._task.cutout, depths).solve(front)
        except Infeasible as error:
            error.args = (f'thread, held at {at:.4g} m: {error}',)
            raise

    def _threaded(self, front: Plan, first: float) -> Shape:
        """Add the stage in which the first hand alone threads the free end; return its end."""
        holds = [_held(first, pose, FIRST) for pose in front.grippers]
        if self._feed is not None:
            for there in holds:
                said = unreached(there, self._feed, self._length, True)
                if said:
                    raise InvalidTask(f'feed = {self._feed!r}: expected a place from which the DLO '
                                      f'reaches the hole: {said}')
        found = list[Step]()
        shape = (self._grasped(first).solve(front.grippers[0], holds=holds[0])
                 if self._feed is None else self._simulator.solve(self._feed, holds=holds[0]))
        for there, depth in zip(holds, front.depths.tolist(), strict=True):
            shape = self._followed('thread', found, shape, there)
            found.append((shape, self._length - depth))
        return self._judged('thread', found)

    # ---- both hands -------------------------------------------------------------------------

    def _handed_over(self, shape: Shape, first: float, second: float, at: float,
                     name: str) -> Shape:
        """Add the stage in which the second hand takes what the first one bears."""
        begin = _hands_of(shape, first, second)
        found = [(self._closed(shape, (first, second), begin), at)]
        alone = self._second_alone(found[-1][0], second, at, name)
        found += self._swung(name, found, (first, second), _hands_of(alone, first, second), at)
        return self._judged(name, found)

    def _drawn_somehow(self, shape: Shape, second: float, at: float, pulls: Iterable[_Pull],
                       name: str) -> tuple[Shape, _Pull]:
        """Add the stage of the first of some pulls that can be; return its end, and which it is."""
        refused: Infeasible | None = None
        for pull in pulls:
            try:
                return self._drawn(shape, second - pull.apart, second, at, pull, name), pull
            except Infeasible as error:
                refused = refused or error
        assert refused is not None  # one is tried at least
        raise refused

    def _drawn(self, shape: Shape, first: float, second: float, at: float, pull: _Pull,
               name: str) -> Shape:
        """Add the stage in which both hands draw the DLO on, the first one up to the sheet."""
        begin = _hands_of(shape, first, second)
        found = [(self._closed(shape, (first, second), begin), at)]
        found += self._swung(name, found, (first, second), pull.hands, at)
        stop, end = len(found) - 1, first + self._gap
        for place in np.linspace(at, end, int(np.ceil((at - end) / (
                _SHIFT * self._length))) + 1)[1:].tolist():
            hands = _hands_of(found[-1][0], first, second)
            found.append((self._centered(name, found, (first, second), hands, place), place))
        return self._judged(name, found, [stop])

    def _handed_back(self, shape: Shape, first: float, second: float, at: float,
                     name: str) -> Shape:
        """Add the stage in which the second hand lets down what the first one then bears alone."""
        found, part = [(shape, at)], self._simulator.part(first, 1)
        pose = Pose.from_rotation(shape.frame_at(first)[1], shape.frame_at(first)[0])

        def solved(pose: Pose, before: Shape | None) -> Shape:
            return part.solve(pose) if before is None else part.track([pose], initial=before)[0]

        alone = self._best_pitch(solved, pose, at - first, self._holes_of(part), name, FIRST)
        found += self._swung(name, found, (first, second),
                             _hands_of(alone, 0.0, second - first), at)
        return self._judged(name, found)

    def _alone(self, shape: Shape, by: str | None, at: float, name: str) -> Shape:
        """Add the stage in which one hand holds the DLO alone, or none; return that shape."""
        held = tuple(hold for hold in shape.holds if hold.by == by)
        found = self._held_on(shape, held)
        moved = apart(shape, found) if found.converged and not found.jumped else np.inf
        if not moved < _FALLS * self._length:
            raise self._builder(name, [(found, at)]).refusal(
                'continuity', moved, f'where the hand opens the DLO would move by {moved:.3g} m')
        return self._judged(name, [(found, at)])

    def _second_alone(self, shape: Shape, second: float, at: float, name: str) -> Shape:
        """Return the Shape with the most margin that the second hand alone holds."""
        pose = next(hold.pose for hold in shape.holds if hold.by == SECOND)

        def solved(pose: Pose, before: Shape | None) -> Shape:
            return self._held_on(before or shape, _held(second, pose, SECOND))

        errors = self._errors.copy()
        errors.follow(shape)
        return self._best_pitch(solved, pose, at, self._holes, name, SECOND, errors)

    def _best_pitch(self, solved: Callable[[Pose, Shape | None], Shape], pose: Pose, at: float,
                    holes: Holes, name: str, by: str,
                    errors: GripErrors | None = None) -> Shape:
        """Return the Shape with the most margin of a DLO that a hand alone holds near the hole.

        It pitches about the center, in the plane of normal and weight, from a Pose on. `solved`:
        the Shape in a Pose, from another; `errors`: of the hand before that, if not its own.
        """
        best: tuple[float, Shape] | None = None
        for sign in (1.0, -1.0):
            here, shape = pose, None
            turn = turned_by(sign * _PITCH * self._across)
            for _ in range(_PITCHES):
                self._context.progress.check()
                for _ in range(_CENTERINGS):
                    found = solved(here, shape)
                    if not found.converged:
                        break
                    shape, off = found, self._center - found.frame_at(at)[1]
                    if np.linalg.norm(off) < _EXACT * self._length:
                        break
                    here = _shifted(here, off)
                if found.converged and found.frame_at(at)[0][:, 0] @ self._normal > 0:
                    rooms = holes.passed(Waypoint(found)).clearances
                    here_off = errors and errors.copy()
                    if here_off is not None:
                        here_off.follow(found)
                    margin = least_margin(self._uncertainty, found, [at], rooms, here_off)
                    if best is None or margin > best[0]:
                        best = margin, found
                here = Pose.from_rotation(self._center + turn @ (here.position - self._center),
                                          turn @ here.rotation)
        if best is None:
            raise PlanBuilder([0.0], self._demands, f'{name}: waypoint').refusal(
                'equilibrium', 0.0, f'the {by} hand alone does not hold the DLO in the hole')
        return best[1]

    # ---- drawing ----------------------------------------------------------------------------

    def _pulls(self, at: float, left: float) -> Iterator[_Pull]:
        """Yield how to draw on, the hole at `at`, m, where `left` m have to pass: best first.

        The first one is the longest whose margin the next shorter one exceeds by a small part of
        the room at most; then come shorter and shorter ones.
        """
        best: _Pull | None = None
        chosen = False
        for count in range(1, _MOST_PULLS + 1):
            stroke = left / count
            if self._task.stroke is not None and stroke > self._task.stroke * (1 + _EXACT):
                continue
            if not at - stroke > 2 * self._gap:  # there would be the feed
                continue
            pulls = [one for part in _PULLS for bowed in _BOWED
                     if (one := self._pull_with(at, stroke, part, bowed))]
            if not pulls:
                continue
            found = max(pulls, key=lambda pull: pull.margin)
            if best is not None and not chosen and (
                    found.margin < best.margin + _GAIN * self._room):
                chosen = True
                yield best
            if chosen:
                yield found
            best = found
        if best is not None and not chosen:
            yield best
        if best is None:
            raise InvalidTask(f'stroke = {self._task.stroke!r}: expected at least '
                              f'{left / _MOST_PULLS:.4g} m: {left:.4g} m are to pass, and more '
                              f'than {_MOST_PULLS} pulls are not tried')

    def _pull_with(self, at: float, stroke: float, part: float, bowed: float) -> _Pull | None:
        """Return a _Pull by a part of the weight between, None where the DLO has no such shape.

        `bowed`: how far hands pitch, rad; above 0 the first one up and the second one down, as when
        one hand alone holds the DLO. To pitch them the other way they come by where both are level.
        """
        far = 2 * self._gap + stroke
        simulator = self._simulator.part(at + self._gap - far, 1)
        frame = self._task.cutout.pose.rotation
        pitched = [turned_by(angle * self._across) @ frame for angle in (bowed, -bowed)]
        size = far * np.sin(bowed) / bowed  # of an arc
        begin = _Hands(Pose.from_rotation(self._center, pitched[0]), Pose.from_rotation(
            self._center + size * self._normal, pitched[1]), part * far * self._weight)
        def solved(hands: _Hands, before: Shape) -> Shape:
            return simulator.track([hands.first], initial=before,
                                   holds=_held(far, hands.second, SECOND))[0]

        first = simulator.solve(begin.first, holds=_held(far, begin.second, SECOND))
        if not first.converged:
            return None
        shape, hands = self._pulled(solved, begin, first, far, far - self._gap)
        if shape is None:
            return None
        if bowed < 0:
            level = hands._replace(first=Pose.from_rotation(hands.first.position, frame),
                                   second=Pose.from_rotation(hands.second.position, frame))
            there, level = self._pulled(solved, level, shape, far, far - self._gap)
            if there is None or far - level.size < _LOOSE * np.sqrt(2) * (
                    self._uncertainty.gripper_position):
                return None
        holes, least = self._holes_of(simulator), np.inf
        for place in np.linspace(far - self._gap, self._gap, _PLACES).tolist():
            there = carried(shape, self._center - shape.frame_at(place)[1])
            rooms = holes.passed(Waypoint(there)).clearances
            least = min(least, least_margin(self._uncertainty, there, [place], rooms))
        return _Pull(far, hands, least)

    def _pulled(self, solved: Callable[[_Hands, Shape], Shape], hands: _Hands, before: Shape,
                far: float, at: float) -> tuple[Shape | None, _Hands]:
        """Return the Shape in which the second hand pulls as wanted, and where both hands are then.

        They come nearer to each other or go apart, and shift until `at`, m, is in the center.
        None: there is no such shape. The secant method, in the logarithm of what is slack.
        """
        chord, wanted = hands.chord / hands.size, hands.pull
        slack = np.log(max(far - hands.size, _TAUT * far))
        close = _PULLED * (abs(wanted) + self._weight * far)
        known: list[tuple[float, float]] = []  # logarithm of the slack, pull too strong by, N
        found: Shape | None = None
        for _ in range(_CENTERINGS):
            self._context.progress.check()
            second = hands.first.position + (far - np.exp(slack)) * chord
            hands = hands._replace(second=Pose(second, hands.second.quaternion))
            shape = solved(hands, before)
            if not shape.converged or shape.jumped:
                slack += _LOOSER
                continue
            found = shape
            before, off = shape, self._center - shape.frame_at(at)[1]
            hands = hands.shifted(off)
            known.append((slack, float(shape.wrenches[-1, :3] @ chord) - wanted))
            if abs(known[-1][1]) < close:
                return shape, hands
            step = 0.1 if len(known) < 2 or known[-1][1] == known[-2][1] else -known[-1][1] * (
                known[-1][0] - known[-2][0]) / (known[-1][1] - known[-2][1])
            step = step if len(known) > 1 else float(np.copysign(0.1, known[-1][1]))
            slack = max(slack + float(np.clip(step, -_FURTHEST, _FURTHEST)), np.log(_TAUT * far))
        return found, hands

    def _swung(self, name: str, found: list[Step], places: tuple[float, float], goal: _Hands,
               at: float) -> list[Step]:
        """Return the Steps from the last one to where both hands are, but for a common shift."""
        begin, steps = _hands_of(found[-1][0], *places), list[Step]()
        one, other = begin.chord / begin.size, goal.chord / goal.size
        turn = least_turn(one, other)
        ways = (begin.first.rotation, goal.first.rotation), (
            begin.second.rotation, goal.second.rotation)
        turns = [angle_between(*way) for way in ways]
        turned = angle_between(np.eye(3), turn)
        count = max(1, int(np.ceil(max(
            *turns, turned, turned * goal.size * _TURN / (_SHIFT * self._length),
            abs(goal.size - begin.size) * _TURN / (_SHIFT * self._length)) / _TURN)))
        far = places[1] - places[0]
        for k in range(1, count + 1):
            share, here = k / count, _hands_of((steps or found)[-1][0], *places)
            along = here.size * partway(np.eye(3), turn, share) @ one
            first, second = (partway(*way, share) for way in ways)
            hands = _Hands(
                Pose.from_rotation(here.first.position, first),
                Pose.from_rotation(here.first.position + along, second),
                (1 - share) * begin.pull + share * goal.pull)
            if k == count:
                hands = goal.shifted(here.first.position - goal.first.position)
            else:
                shape, hands = self._pulled(
                    lambda hands, before: self._held_on(before, _both(places, hands)),
                    hands, (steps or found)[-1][0], far, at)
            steps.append((self._centered(name, [*found, *steps], places, hands, at), at))
        return steps

    def _centered(self, name: str, found: Sequence[Step], places: tuple[float, float],
                  hands: _Hands, at: float) -> Shape:
        """Return the next Shape, both hands shifted so that `at` is in the center."""
        shape = found[-1][0]
        for _ in range(_CENTERINGS):
            shape = self._followed(name, found, shape, _both(places, hands))
            off = self._center - shape.frame_at(at)[1]
            if np.linalg.norm(off) < _EXACT * self._length:
                return shape
            hands = hands.shifted(off)
        return shape

    def _closed(self, shape: Shape, places: tuple[float, float], hands: _Hands) -> Shape:
        """Return the same Shape once both hands hold it, as it is."""
        return self._held_on(shape, _both(places, hands))

    def _held_on(self, before: Shape, holds: Holds) -> Shape:
        """Return the Shape in which the DLO follows what holds it, from the Shape before.

        Where nothing feeds it, and another hand is the one that is nearer to the beginning than
        was before, the DLO stays where that hand takes it.
        """
        if self._feed is not None:
            return self._simulator.track([self._feed], initial=before, holds=holds)[0]
        at = holds[0].s
        assert at is not None  # hands hold places
        simulator = self._grasped(at)
        if grasped_at(before) != at:
            return simulator.taken(before, holds)
        return simulator.track([holds[0].pose], initial=before, holds=holds)[0]

    def _grasped(self, at: float) -> GraspedInside:
        """Return the simulator of the DLO whose beginning is free, held at `at`, m."""
        if at not in self._inside:
            self._inside[at] = GraspedInside.of(self._simulator, at)
        return self._inside[at]

    def _followed(self, name: str, found: Sequence[Step], before: Shape, holds: Holds) -> Shape:
        """Return the Shape in which the DLO follows, or raise Infeasible."""
        self._context.progress.check()
        shape = self._held_on(before, holds)
        if shape.converged and not shape.jumped:
            return shape
        builder = self._builder(name, [*found, (shape, found[-1][1] if found else self._length)])
        for one, at in found:
            builder.add(self._waypoint(one, at))
        raise builder.refusal(
            'continuity' if shape.converged else 'equilibrium', apart(shape, before),
            'the DLO would fall into another shape on the way there' if shape.converged
            else f'no stable shape is found: {shape.status}')

    # ---- stages -----------------------------------------------------------------------------

    def _judged(self, name: str, found: Sequence[Step], stops: Sequence[int] = ()) -> Shape:
        """Add a stage that keeps all demands, at its waypoints and between; return its end."""
        errors = self._errors.copy()
        builder = self._builder(name, found, errors)
        for k, (shape, at) in enumerate(found):
            builder.check()
            errors.follow(shape)
            builder.add(self._waypoint(shape, at))
            if k in stops:
                builder.stop()
        stage = builder.finished()
        self._check_workspace(stage, name)
        self._errors = errors
        self._stages.add(name, stage)
        return found[-1][0]

    def _builder(self, name: str, found: Sequence[Step],
                 errors: GripErrors | None = None) -> PlanBuilder:
        held, demands = grasped_at(found[0][0]), replace(self._demands, errors=errors)
        demands = demands if held is None else demands.made_with(self._grasped(held))
        return PlanBuilder([self._length - at for _, at in found], demands, f'{name}: waypoint')

    def _waypoint(self, shape: Shape, at: float) -> Waypoint:
        """Return the Waypoint of a Shape whose place at `at`, m, is in the center."""
        along = shape.frame_at(at)[0][:, 0]
        made = waypoint_at(shape, self._center, at, along)
        return self._holes.passed(made._replace(misalignment=float(np.arctan2(
            np.linalg.norm(np.cross(along, self._normal)), along @ self._normal))))

    def _holes_of(self, simulator: DirectSimulator) -> Holes:
        return Holes((self._task.cutout,), self._length, self._demands.obstacles,
                     Surface.of(simulator.rod))

    def _check_workspace(self, stage: Plan, name: str) -> None:
        """Raise Infeasible where a hand leaves the workspace in a stage."""
        if self._workspace is None or not stage.arms:
            return
        path = GripperPath.of(stage)
        for arm in path.arms:
            beyond = self._workspace.first_beyond(path.arm(arm))
            if beyond is not None:
                place, where, amount = beyond
                raise Infeasible(f'{name}: waypoint {place}: the {arm} hand comes {amount:.3g} m '
                                 f'beyond {where}', place, where, amount,
                                 truncate(stage, place, PlanStatus.PARTIAL))


class _OverTheRim(_HandOverHand):
    """Makes the stages of a ThreadInGrasps with one hand, while the rim holds what has passed."""

    def __init__(self, task: ThreadInGrasps, context: PlanContext, feed: Pose | None) -> None:
        super().__init__(task, context, feed)
        rims = [one for one in context.simulator.obstacles
                if isinstance(one, Sheet) and task.cutout in one.cutouts and one.friction]
        if not rims:
            raise InvalidTask('on_rim = True: expected a Sheet with this cut-out and a friction '
                              'among the obstacles, whose rim holds the DLO')
        self._rim = rims[0]
        # the forces that are found are within what the rim bears, by as much as is not sure
        self._touching = self._simulator.with_obstacles([replace(
            self._rim, friction=(1 - _SURE) * float(rims[0].friction or 0.0))])
        self._beside = replace(
            self._demands, obstacles=tuple(one for one in self._demands.obstacles
                                           if one is not self._rim), touched=(self._rim,),
            simulator=self._touching, margin=None)
        self._lies = False  # in the stage that is being made

    def _hand_over_hand(self) -> None:
        """Make all stages."""
        front, first = self._front()
        shape, passed, wanted = self._threaded(front, first), float(front.depths[-1]), (
            self._task.length)
        number_ = 0
        while passed < wanted - _EXACT * self._length:
            number_ += 1
            at = self._length - passed
            shape = self._laid(shape, first, at, f'lay {number_}')
            shape = self._left(shape, at, f'rim alone {number_}')
            shape, first, stroke = self._drawn_on(shape, at, wanted - passed, number_)
            passed += stroke

    def _laid(self, shape: Shape, first: float, at: float, name: str) -> Shape:
        """Add the stage in which the hand lays the DLO on the rim, until it bears nothing."""
        self._lies = True
        frame, place = shape.frame_at(first)
        gravity = np.asarray(self._simulator.surroundings.gravity)
        down = gravity / np.linalg.norm(gravity)
        found = [(self._held_on(shape, _held(first, Pose.from_rotation(place, frame), FIRST)), at)]
        for _ in range(_LOWERED):
            there = found[-1][0]
            if there.contacts and there.wrenches[0, :3] @ down > -_BORNE * self._weight * (
                    self._length - at):
                break
            frame, place = there.frame_at(first)
            pose = Pose.from_rotation(place + _LOWER * self._room * down, frame)
            found.append((self._followed(name, found, there, _held(first, pose, FIRST)), at))
        for _ in range(_LAID):
            there = found[-1][0]
            left = self._held_on(there, ())
            self._check_rests(left, at, name)
            frame, place = left.frame_at(first)
            found += self._led(name, found, first, Pose.from_rotation(place, frame), at)
            if apart(self._held_on(found[-1][0], ()), found[-1][0]) < _FALLS * self._length:
                break
        return self._judged(name, found)

    def _left(self, shape: Shape, at: float, name: str) -> Shape:
        """Add the stage in which the rim, and what feeds the DLO, hold it alone."""
        self._check_rests(self._held_on(shape, ()), at, name)
        return self._alone(shape, None, at, name)

    def _check_rests(self, shape: Shape, at: float, name: str) -> None:
        """Raise Infeasible where a DLO that no hand holds does not rest on the rim."""
        if not shape.converged or not shape.contacts or (
                (shape.positions[-1] - self._center) @ self._normal <= 0):
            raise self._builder(name, [(shape, at)]).refusal(
                'friction', apart(self._stages.plans[-1].shapes[-1], shape), 'the rim does not '
                f'hold what has passed: with {1 - _SURE:.0%} of its friction the DLO would slide '
                'off', 'm')

    def _drawn_on(self, shape: Shape, at: float, left: float,
                  count: int) -> tuple[Shape, float, float]:
        """Add the stages in which the hand closes farther back, lifts the DLO and draws it on.

        Returns its end, where the hand holds it, m, and how much has passed, m.
        """
        refused: Infeasible | None = None
        for parts in range(1, _MOST_PULLS + 1):
            stroke = left / parts
            first = at - stroke - self._gap
            if self._task.stroke is not None and stroke > self._task.stroke * (1 + _EXACT) or (
                    not first > self._gap):
                continue
            kept, errors = len(self._stages.plans), self._errors
            try:
                lifted = self._lifted(shape, first, at, f'lift {count}')
                return self._pushed(lifted, first, at, stroke, f'pull {count}'), first, stroke
            except Infeasible as error:
                refused = refused or error
                self._stages.cut(kept)
                self._errors = errors
        if refused is None:
            raise InvalidTask(f'stroke = {self._task.stroke!r}: expected at least '
                              f'{left / _MOST_PULLS:.4g} m: {left:.4g} m are to pass, and more '
                              f'than {_MOST_PULLS} pulls are not tried')
        raise refused

    def _lifted(self, shape: Shape, first: float, at: float, name: str) -> Shape:
        """Add the stage in which the hand takes the DLO and lifts it off the rim to the center."""
        self._lies = True
        frame, place = shape.frame_at(first)
        pose = Pose.from_rotation(place, frame)
        found = [(self._held_on(shape, _held(first, pose, FIRST)), at)]
        goal = self._alone_before(first, at, name).gripper
        found += self._led(name, found, first, goal, at)
        return self._judged(name, found)

    def _pushed(self, shape: Shape, first: float, at: float, stroke: float, name: str) -> Shape:
        """Add the stage in which the hand alone draws the DLO on, up to the sheet."""
        self._lies = False
        ways = (shape.frame_at(first)[0], self._alone_before(
            first, at - stroke, name).gripper.rotation)
        found = [(self._held_on(shape, shape.holds), at)]
        count = int(np.ceil(max(angle_between(*ways) / _TURN,
                                stroke / (_SHIFT * self._length))))
        for share in np.linspace(0, 1, count + 1)[1:].tolist():
            place, there = at - share * stroke, found[-1][0]
            here = Pose.from_rotation(there.frame_at(first)[1], partway(*ways, share))
            for _ in range(_CENTERINGS):
                there = self._followed(name, found, there, _held(first, here, FIRST))
                off = self._center - there.frame_at(place)[1]
                if np.linalg.norm(off) < _EXACT * self._length:
                    break
                here = _shifted(here, off)
            found.append((there, place))
        return self._judged(name, found)

    def _alone_before(self, first: float, at: float, name: str) -> Shape:
        """Return the Shape of the part in front of the hand, which alone holds the DLO at `first`.

        `at`, m, is in the center, with the most margin of all pitches.
        """
        part = self._simulator.part(first, 1)

        def solved(pose: Pose, before: Shape | None) -> Shape:
            return part.solve(pose) if before is None else part.track([pose], initial=before)[0]

        pose = Pose.from_rotation(self._center - (at - first) * self._normal,
                                  self._task.cutout.pose.rotation)
        return self._best_pitch(solved, pose, at - first, self._holes_of(part), name, FIRST)

    def _led(self, name: str, found: Sequence[Step], first: float, goal: Pose,
             at: float) -> list[Step]:
        """Return the Steps in which the hand leads the DLO straight to a Pose."""
        frame, place = found[-1][0].frame_at(first)
        way, steps = goal.position - place, list[Step]()
        count = max(1, int(np.ceil(max(angle_between(frame, goal.rotation) / _TURN, float(
            np.linalg.norm(way)) / (_SHIFT * self._length)))))
        for share in np.linspace(0, 1, count + 1)[1:].tolist():
            pose = Pose.from_rotation(place + share * way, partway(frame, goal.rotation, share))
            before = (steps or found)[-1][0]
            steps.append((self._followed(name, [*found, *steps], before,
                                         _held(first, pose, FIRST)), at))
        return steps

    def _held_on(self, before: Shape, holds: Holds) -> Shape:
        """Return the Shape in which the DLO follows what holds it; on the rim it may lie."""
        assert self._feed is not None  # else there is no such task
        simulator = self._touching if self._lies else self._simulator
        return simulator.track([self._feed], initial=before, holds=holds)[0]

    def _builder(self, name: str, found: Sequence[Step],
                 errors: GripErrors | None = None) -> PlanBuilder:
        if not self._lies:
            return super()._builder(name, found, errors)
        return PlanBuilder([self._length - at for _, at in found], self._beside,
                           f'{name}: waypoint')

    def _waypoint(self, shape: Shape, at: float) -> Waypoint:
        """Return the Waypoint of a Shape; one that may lie on the rim has no room beside it."""
        return Waypoint(shape) if self._lies else super()._waypoint(shape, at)


def _held(s: float, pose: Pose, by: str) -> Holds:
    return (Hold(pose, s=s, by=by),)


def _both(places: tuple[float, float], hands: _Hands) -> Holds:
    return (Hold(hands.first, s=places[0], by=FIRST), Hold(hands.second, s=places[1], by=SECOND))


def _hands_of(shape: Shape, first: float, second: float) -> _Hands:
    """Return where hands are that hold a Shape at two places, m, and what the second one does."""
    (one, there), (other, here) = shape.frame_at(first), shape.frame_at(second)
    chord = (here - there) / np.linalg.norm(here - there)
    pulls = [float(wrench[:3] @ chord) for hold, wrench in zip(
        shape.holds, shape.wrenches, strict=True) if hold.by == SECOND]
    return _Hands(Pose.from_rotation(there, one), Pose.from_rotation(here, other),
                  pulls[0] if pulls else 0.0)


def _shifted(pose: Pose, shift: Floats) -> Pose:
    return Pose(pose.position + shift, pose.quaternion)
