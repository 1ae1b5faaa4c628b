# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Routing: a DLO is led through clips, forks and round pegs, one after the other.

What lies between the last fitting and the gripper is led past the mouth of the next one: first at a
standoff before it, then along its mouth into its seat. There the fitting holds from then on (a
stage of its own begins), and the gripper goes on until it presses the DLO into the seat as strongly
as the fitting takes to snap, and back. Then the next one follows.

Where the gripper has to be is found by Gauss and Newton's method: the DLO has to be in the middle
of the mouth, at a height before the seat, and about straight; the gripper may go anywhere, its axis
turning as the DLO does. The direction in which the DLO comes is that from the last fitting: where a
clip holds another one, it turns the DLO as it closes.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlo_planner.direct.grips import Grips
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.aiming import Aim, part_led, straightness
from dlo_planner.inverse.equilibria import least_turn
from dlo_planner.inverse.stages import Stages, again, held_at_first, upwards
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.move_to import SHARPEST, led, limit
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, items, number, row, vector
from dlo_planner.model.holds import RINGS, FarEnd, Hold, Holds, holds_of
from dlo_planner.model.obstacles import Box
from dlo_planner.model.pose import Pose, angle_between, displaced
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import Value, put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.plan import Plan, PlanStatus, truncate
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

_AIMED = 1e-5        # of the length, and rad: by how much the DLO may miss a seat
_CORRECTIONS = 40    # of the gripper until it does not
_TURN, _SHIFT = 0.1, 0.05  # rad and of the length: the largest correction
_STEP = 0.04         # of the length: between two waypoints of the way
_ENTRIES = 6         # waypoints from the standoff to the seat
# times as high as a fitting, the DLO and the clearance need: the standoff before one that has a
# size; the last of the waypoints above it is a quarter higher than it needs to be
_ABOVE = 2.5
_STANDOFF = 0.05     # m: the standoff before one that is a point
_LEAST = 0.05        # of the length: the least that is left to lead by
_BACKS = 0.0, 0.25, 0.5, 1.0  # of the way it came as it pressed: how much of it it goes back first
_RISES = 0.0, 0.1, 0.2, 0.35  # of the length: by how much the gripper rises on its way
# of what it leads: by how much nearer the gripper is halfway; and times the pull at the ends of a
# way, or what straightens the DLO: one on which it pulls harder is not the first choice; and one
# on which it pulls so much harder that it goes back farther for another
_NEARER, _HARD, _TAUT = (0.0, 0.005, 0.02), 3.0, 6.0
# rad: by which it swings into a fitting, the least, and how far beyond level
_SWING, _LEAST_SWING, _STEEPEST = 0.1, 0.025, 0.35
_FIRM, _LESS_FIRM = 0.1, 0.5  # least stability of a DLO that presses; or of what it has before
_TAUTEST, _SLACKEST = 2e-5, 0.5  # of the DLO between: the least and the most that is slack
# trials of how slack it is where the gripper pulls as it should, nearly: unevenly it would jerk
_PULLS, _PULLED = 16, 0.1
_EASIER = 1.2        # times more than before it pulled: the gripper goes back no farther
_ABOUT = 2.0         # times less or more than it should: how the gripper may pull on its way
_PASSING = 0.02      # of the length: what the DLO may miss a mouth by while it is drawn straight
_STRONGER = 1.5      # by which it pulls more then
_LOOSER = 1.5        # by which it is slackened, or drawn tighter, until it pulls less, or more
# rad: by how much the gripper goes aside to press, past what stands ahead; the least that is enough
_ASIDE = 0.0, 0.15, -0.15, 0.3, -0.3, 0.5, -0.5, 0.8, -0.8
# rad: by how much the gripper is turned down as the DLO enters, where that bows it over what stands
# ahead: it rises towards the gripper then, the way up and back takes the longer the more it is
_BOWS = 0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.8
# the same where nothing stands ahead: what is taut between two fittings as the next one closes
# comes in slacker, and by so much that a hand that gives way takes what its length may be off
_SLACKER = 0.0, 0.2, 0.4, 0.8
_EASED = 10.0        # per rad: by how much less than it should it pulls then
_CLOSER = 3          # trials, each with twice as many waypoints beside the refused corner
_EDGE = 0.02         # of the least pull: a search for one that lifts nothing off ends so near it
_LIFTS = 0.05        # of the pull: by which the DLO may lift off a seat that has not snapped yet
_ACROSS = 1e-6       # of a unit vector: a mouth that is less across has no direction


@dataclass(frozen=True, eq=False, repr=False)
class Fitting(Value):
    """Base of what a DLO is laid into: its seat, and the way there.

    Attributes
    ----------
    pose : Pose
        Of the DLO in its seat: x axis = tangent, from the gripper on.
    mouth : ndarray, shape (3,)
        Where the DLO comes from, out of the seat, in the axes of `pose`; what is along the DLO does
        not count.
    push : float
        Force at which the DLO snaps in, N, against the mouth.
    retains : float or None
        Largest force out of the mouth that it bears from then on, N, at waypoints. If None, any.
    bears : float or None
        Largest force into the seat that it bears, N, at waypoints: as the DLO is pressed in, and
        from then on. No less than `push`. If None, any.
    room : float
        Largest distance of the DLO from the middle of the mouth on its way in, m.
    size : ndarray, shape (3,), or None
        Of the box around the seat that the fitting fills, m: along the DLO, across it, and along
        the mouth. The DLO keeps out of it until it goes in. If None, nothing is in the way.
    """

    pose: Pose
    mouth: Floats = (0.0, 0.0, 1.0)  # type: ignore[assignment]  # an array (3,) from then on
    push: float = 0.0
    room: float = 1e-3
    retains: float | None = None
    size: Floats | None = None
    bears: float | None = None

    word: ClassVar[str] = 'fitting'

    def __post_init__(self) -> None:
        name = type(self).__name__
        instance(f'{name}.pose', self.pose, Pose)
        mouth = np.array(vector(f'{name}.mouth', self.mouth, 3))
        mouth[0] = 0.0
        size = float(np.linalg.norm(mouth))
        if size < _ACROSS:
            raise InvalidTask(f'{name}.mouth = {self.mouth!r}: expected a direction across the '
                              'DLO, whose tangent in the seat is (1, 0, 0)')
        put(self, mouth=mouth / size, push=number(f'{name}.push', self.push, minimum=0, unit='N'),
            room=number(f'{name}.room', self.room, above=0, unit='m'))
        if self.retains is not None:
            put(self, retains=number(f'{name}.retains', self.retains, minimum=0, unit='N'))
        if self.bears is not None:
            put(self, bears=number(f'{name}.bears', self.bears, minimum=0, unit='N'))
            if self.bears < self.push:
                raise InvalidTask(f'{name}.bears = {self.bears:g}: expected no less than '
                                  f'{name}.push = {self.push:g}')
        if self.size is not None:
            put(self, size=row(f'{name}.size', self.size, least=3, most=3, above=0))
        super().__post_init__()

    @property
    def outwards(self) -> Floats:
        """(3,) unit vector out of the seat, world axes."""
        result: Floats = self.pose.rotation @ self.mouth
        return result

    @property
    def aside(self) -> Floats:
        """(3,) unit vector across the DLO and the mouth, world axes."""
        result: Floats = np.cross(self.outwards, self.pose.rotation[:, 0])
        return result

    def body(self, name: str) -> tuple[Box, ...]:
        """Return the Box that it fills, if it has a size; `name`: how that is called."""
        if self.size is None:
            return ()
        axes = np.stack([self.pose.rotation[:, 0], self.aside, self.outwards], axis=1)
        return (Box(Pose.from_rotation(self.pose.position, axes), self.size, name=name),)


@dataclass(frozen=True, eq=False, repr=False)
class Clip(Fitting):
    """Holds the place of the DLO that has come in.

    Attributes
    ----------
    pose : Pose
        As of every fitting, like mouth, push, room, retains, size and bears.
    grip : str
        'aligned' (default): the DLO may turn about its tangent; 'clamped'; or 'pinned': about all.
    """

    grip: str = 'aligned'

    word: ClassVar[str] = 'clip'

    if TYPE_CHECKING:  # what may be given
        def __init__(self, pose: Pose, mouth: ArrayLike = (0, 0, 1), push: float = 0.0,
                     room: float = 1e-3, retains: float | None = None,
                     size: ArrayLike | None = None, bears: float | None = None,
                     grip: str = 'aligned') -> None: ...

    def __post_init__(self) -> None:
        choice('Clip.grip', self.grip, ('aligned', 'clamped', 'pinned'))
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class Fork(Fitting):
    """Lets the DLO slide through, against friction along it.

    Attributes
    ----------
    pose : Pose
        As of every fitting, like mouth, push, room, retains, size and bears.
    slip : float
        Friction along the DLO, N, as of a Hold.
    grip : str
        'ring' (default): the DLO may take any direction; 'tube': only that of the seat.
    """

    slip: float = 0.0
    grip: str = 'ring'

    word: ClassVar[str] = 'fork'

    if TYPE_CHECKING:  # what may be given
        def __init__(self, pose: Pose, mouth: ArrayLike = (0, 0, 1), push: float = 0.0,
                     room: float = 1e-3, retains: float | None = None,
                     size: ArrayLike | None = None, bears: float | None = None,
                     slip: float = 0.0, grip: str = 'ring') -> None: ...

    def __post_init__(self) -> None:
        choice('Fork.grip', self.grip, ('ring', 'tube'))
        put(self, slip=number('Fork.slip', self.slip, minimum=0, unit='N'))
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class Peg(Fitting):
    """A post that the DLO is led round: a ring where it bears, with the capstan's friction.

    That is tension (e^(friction angle) - 1), at the `tension` that is stated.

    Attributes
    ----------
    pose : Pose
        As of every fitting, like mouth, push, room, retains, size and bears: where the DLO bears
        on the post.
    friction : float
        Coulomb's coefficient.
    angle : float
        By which the DLO turns round it, rad.
    tension : float
        Largest tension on the slack side, N.
    """

    friction: float = 0.0
    angle: float = 0.0
    tension: float = 0.0

    word: ClassVar[str] = 'peg'

    if TYPE_CHECKING:  # what may be given
        def __init__(self, pose: Pose, mouth: ArrayLike = (0, 0, 1), push: float = 0.0,
                     room: float = 1e-3, retains: float | None = None,
                     size: ArrayLike | None = None, bears: float | None = None,
                     friction: float = 0.0, angle: float = 0.0,
                     tension: float = 0.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, friction=number('Peg.friction', self.friction, minimum=0, maximum=10),
            angle=number('Peg.angle', self.angle, minimum=0, maximum=20 * np.pi, unit='rad'),
            tension=number('Peg.tension', self.tension, minimum=0, unit='N'))
        super().__post_init__()

    @property
    def grip(self) -> str:
        """As of a Hold: the DLO may take any direction."""
        return 'ring'

    @property
    def slip(self) -> float:
        """The friction along the DLO, N."""
        return float(self.tension * np.expm1(self.friction * self.angle))


def before(fitting: Fitting, height: float) -> Pose:
    """Return the Pose of the DLO before the seat of a Fitting, m out of it."""
    return Pose(fitting.pose.position + height * fitting.outwards, fitting.pose.quaternion)


def hold_by(fitting: Fitting, s: float, axes: Floats, by: str) -> Hold:
    """Return the Hold of a DLO that has just come into a Fitting at s, m, with axes (3, 3) there.

    What holds a place takes the DLO as it is turned about its tangent.
    """
    grip: str = getattr(fitting, 'grip', 'ring')
    if grip in RINGS:
        return Hold(fitting.pose, grip, s, getattr(fitting, 'slip', 0.0), by=by)
    turn = least_turn(np.array(axes[:, 0]), fitting.pose.rotation[:, 0])
    return Hold(Pose.from_rotation(fitting.pose.position, turn @ axes), grip, s, by=by)


def closed(simulator: DirectSimulator, shape: Shape, fitting: Fitting, s: float,
           by: str) -> Holds:
    """Return what holds a Shape once a Fitting has closed about it, near its place s, m.

    As it closes it turns the DLO, which needs length, and slides along it until it grips; what
    nothing but the gripper held is led by that place.
    """
    length = float(shape.s[-1])
    if shape.holds:
        grip = 'ring' if getattr(fitting, 'grip', 'ring') in ('ring', 'pinned') else 'tube'
        ring = Hold(fitting.pose, grip, s, by=by)
        there = simulator.track([shape.gripper], initial=shape, holds=[
            holds_of(None, (ring, *shape.holds), length)])[0]
        found = next((hold.s for hold in there.holds if hold.by == by), None)
        if found is not None and there.converged and not there.jumped:
            s = found
    return holds_of(None, (hold_by(fitting, s, shape.frame_at(s)[0], by), *shape.holds), length)


def aim_at(fitting: Fitting) -> Aim:
    """Return the Aim of what is to lie in the seat of a Fitting."""
    return Aim(fitting.pose, fitting.aside, None)


def names_of(fittings: Iterable[Fitting]) -> list[str]:
    """Return how plans call the Fittings of a Route: 'clip 1', 'fork 2' and so on."""
    return [f'{one.word} {k}' for k, one in enumerate(fittings, start=1)]


@dataclass(frozen=True, eq=False, repr=False)
class Route(Task):
    """Lead the DLO through fittings, in their order: from the far end towards the gripper.

    The far end is held (a plugged connector), or free: then the first fitting takes the DLO at
    `tail` before it. Each fitting is approached at a `standoff` out of its mouth, entered along the
    mouth, and pressed into until the DLO presses with its `push`. `Plan.events` tell which fitting
    holds before which of the `Plan.stages`; `Plan.stage_plans` are what is timed, replayed and
    executed one by one. `Plan.tensions` has the tension of each span, `Plan.wrenches` the load of
    each fitting.

    That the DLO fits into a fitting is looked at by `room` alone. Where a fitting says its `size`,
    the DLO stays out of it until it goes in, and `clearance` away; it bows over what stands ahead,
    and is pressed in past it, to one side. What the DLO lies in is in its way no more. The hands
    are in the way only if they are obstacles of the simulator. Motions are proved at rest; in time
    only where nothing slides.

    Attributes
    ----------
    fittings : tuple of Fitting
        Clips, Forks and Pegs, one or more; a Clip takes hold of whatever place has come to
        lie in it. They are called 'clip 1', 'fork 2' and so on.
    far_end : FarEnd or None
        What holds the far end. If None, it is free, or held as `initial` says.
    to : Pose or None
        Where the gripper goes in the end. If None, it stays where the last fitting snaps.
    standoff : float or None
        m, out of the mouth. If None, 2.5 times as high as a fitting stands out of its seat by its
        `size`, with the DLO and the `clearance`; 0.05 m where it has none.
    slack : float
        How much longer the DLO between a fitting and the gripper is than its way, as a part.
    tail : float or None
        Of a free far end, m; if None, a fifth of the length.
    max_force : float or None
        Largest force that the gripper or a fitting may exert, N. If None, any.
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
    hangs_after: ClassVar[bool] = False

    fittings: tuple[Fitting, ...]
    far_end: FarEnd | None = None
    to: Pose | None = None
    standoff: float | None = None
    slack: float = 0.01
    tail: float | None = None
    max_force: float | None = None
    max_moment: float | None = None
    clearance: float = 0.0

    if TYPE_CHECKING:  # what may be given
        def __init__(self, fittings: Iterable[Fitting], far_end: FarEnd | None = None,
                     to: Pose | None = None, standoff: float | None = None,
                     slack: float = 0.01, tail: float | None = None,
                     max_force: float | None = None, max_moment: float | None = None,
                     clearance: float = 0.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, fittings=items('fittings', self.fittings, Fitting, least=1),
            slack=number('slack', self.slack, above=0, below=1),
            max_force=limit('max_force', self.max_force),
            max_moment=limit('max_moment', self.max_moment),
            clearance=number('clearance', self.clearance, minimum=0))
        instance('far_end', self.far_end, FarEnd, optional=True)
        instance('to', self.to, Pose, optional=True)
        if self.standoff is not None:
            put(self, standoff=number('standoff', self.standoff, above=0, unit='m'))
        if self.tail is not None:
            put(self, tail=number('tail', self.tail, above=0, unit='m'))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan, in stages."""
        instance('context', context, PlanContext)
        return _Routing(self, context).plan()


class _Pressed(NamedTuple):
    """A step in which a DLO is pressed into a fitting."""

    before: Shape
    after: tuple[Shape, float] | None  # and what is slack then; None: it cannot be
    too_hard: bool  # whether it cannot because the fitting would bear too much


class _Routing:
    """Makes the stages of a Route one after the other."""

    def __init__(self, task: Route, context: PlanContext) -> None:
        self._task, self._context = task, context
        self._length = context.rod.length
        start = instance('context.start', context.start, Pose)
        self._begin = Grips(start, held_at_first(context, holds_of(
            task.far_end, (), self._length)))
        self._simulator: DirectSimulator = context.simulator.without_obstacles()
        self._demands = replace(context.demands, wrench_limits=(task.max_force, task.max_moment),
                                clearance=task.clearance)
        self._names = names_of(task.fittings)
        self._back = list[Pose]()  # by which the gripper came where it is, as it pressed
        self._pressed_by = 0.0  # N, with which it pulled then
        self._bow = 0.0  # rad, by which the gripper is turned down as the DLO enters
        self._keep_off(0)
        self._stages = Stages(self._demands.speeds)

    # ---- stage by stage ---------------------------------------------------------------------

    def plan(self) -> Plan:
        """Return the Plan, or raise Infeasible that says at which fitting there is none."""
        stages = 3 * len(self._task.fittings) + 1
        return self._stages.plan(self._through_all,
                                 lambda whole: len(self._stages.plans) / stages)

    def _through_all(self) -> None:
        shape = self._simulator.track([self._begin.gripper], initial=self._context.initial,
                                      holds=[self._begin.holds])[0]
        if not shape.converged:
            raise self._refused('start', 'equilibrium', 0.0, f'at the start the DLO is '
                                f'{shape.status}')
        for index in range(len(self._names)):
            shape = self._through(index, shape)
        if self._task.to is not None:
            self._way(shape, self._task.to, 'to')

    def _through(self, index: int, shape: Shape) -> Shape:
        """Add the stages of a fitting, by its index; return their end."""
        fitting, name = self._task.fittings[index], self._names[index]
        self._bow = 0.0
        self._keep_off(index)
        aim = self._aim_at(fitting, shape, name)
        shape = self._way(shape, self._gripper_for(fitting, shape, aim, name), f'approach {name}')
        self._keep_off(index + 1)
        kept = len(self._stages.plans)
        farthest, refused = (-1, 0.0), list[Infeasible]()
        for bow in _BOWS if self._is_ahead() else _SLACKER:
            self._bow = bow
            try:
                return self._pressed(*self._entered(shape, fitting, aim, name), fitting, name)
            except Infeasible as error:
                if error.constraint == 'push' and not self._is_ahead():
                    raise
                reached = (len(self._stages.plans),
                           0.0 if error.plan is None else error.plan.fraction)
                if reached > farthest:
                    farthest, refused = reached, [error]
                self._stages.cut(kept)
        raise refused[0]

    def _keep_off(self, first: int) -> None:
        """Demand that the DLO stays out of all fittings from the `first` on, by its index."""
        bodies = [body for one, name in zip(self._task.fittings[first:], self._names[first:],
                                            strict=True) for body in one.body(name)]
        self._silent = replace(self._demands.silent(),
                               obstacles=(*self._demands.obstacles, *bodies))

    def _is_ahead(self) -> bool:
        """Whether fittings stand ahead that the DLO has to stay out of."""
        return len(self._silent.obstacles) > len(self._demands.obstacles)

    def _top(self, fitting: Fitting) -> float:
        """Return how high the DLO is that keeps clear of a fitting, m out of it; 0: a point."""
        return 0.0 if fitting.size is None else 0.5 * float(fitting.size[2]) + (
            Surface.of(self._context.rod).bound + self._task.clearance)

    def _standoff(self, fitting: Fitting) -> float:
        """Return the standoff before a fitting, m out of its mouth."""
        if self._task.standoff is not None:
            return self._task.standoff
        return _ABOVE * self._top(fitting) or _STANDOFF

    def _aim_at(self, fitting: Fitting, shape: Shape, name: str) -> Aim:
        """Return the Aim before a fitting, or raise Infeasible where it is out of reach."""
        pose = before(fitting, self._standoff(fitting))
        if not shape.holds:  # the far end hangs: nothing but the gripper says what is there
            tail = 0.2 * self._length if self._task.tail is None else self._task.tail
            if not tail < (1 - _LEAST) * self._length:
                raise InvalidTask(f'tail = {tail:g}: expected less than '
                                  f'{(1 - _LEAST) * self._length:g} m, so that the gripper can '
                                  'lead')
            return Aim(pose, fitting.aside, self._length - tail)
        way, at, last = self._way_from(shape, fitting)
        if at < (1 + self._task.slack) * way + _LEAST * self._length:
            raise self._refused(
                name, 'reach', (1 + self._task.slack) * way + _LEAST * self._length - at,
                f'{name} cannot be reached: the way to it is {way:.3g} m, the DLO between '
                f'{last} and the gripper {at:.3g} m, and {_LEAST * self._length:.3g} m are left '
                'to lead by')
        return Aim(pose, fitting.aside, None)

    def _way_from(self, shape: Shape, fitting: Fitting) -> tuple[float, float, str]:
        """Return the way from the last fitting to one, how much DLO there is, m, and its name."""
        last = shape.holds[0]
        way = float(np.linalg.norm(fitting.pose.position - last.pose.position))
        at = self._length if last.s is None else last.s
        return way, at, 'the far end' if last.s is None else last.by

    # ---- where the gripper has to be ----------------------------------------------------------

    def _gripper_for(self, fitting: Fitting, shape: Shape, aim: Aim, name: str) -> Pose:
        """Return the gripper's Pose at the standoff, found from a DLO that is nearly straight."""
        at = aim.pose.position
        along = aim.pose.rotation[:, 0]
        if aim.s is None:
            way, length, _ = self._way_from(shape, fitting)
            lead = (1 - self._task.slack) * length - way
        else:
            lead = (1 - self._task.slack) * aim.s
        turn = least_turn(np.array(shape.gripper.rotation[:, 0]), along)
        guess = Pose.from_rotation(at - lead * along, turn @ shape.gripper.rotation)
        there = self._led_to(shape, guess)
        if there is None:
            raise self._refused(name, 'equilibrium', lead, 'the DLO does not follow to '
                                f'before {name}, {lead:.3g} m ahead of it')
        found = self._aimed(there, aim)
        if found is None:
            raise self._refused(name, 'aim', aim.miss(there), f'no pose of the gripper is '
                                f'found that leads the DLO past the mouth of {name}')
        return found.gripper

    def _led_to(self, shape: Shape, goal: Pose) -> Shape | None:
        """Return the Shape at a goal of the gripper, whatever is in the way; None: a fall."""
        for rise in _RISES:
            there = shape
            for pose in self._poses(shape.gripper, shape.holds, goal, rise):
                self._context.progress.check()
                there = self._simulator.track([pose], initial=there, holds=[there.holds])[0]
                if not there.converged or there.jumped:
                    break
            else:
                return there
        return None

    def _aimed(self, shape: Shape, aim: Aim) -> Shape | None:
        """Return the Shape that meets an Aim, near another one; None if none is found."""
        miss, size = aim.rows(shape)
        by, (pulls, slack) = _LOOSER, self._pulls(shape, _LOOSER)
        known: Shape | None = None  # that is in the middle, however the gripper pulls
        for _ in range(_CORRECTIONS):
            if size < _AIMED:
                known = shape
                if pulls:
                    break
            self._context.progress.check()
            step = self._correction(shape, aim, miss, 1 - slack)
            for _ in range(4):
                pose = self._slack(shape, displaced(shape.gripper, step), 1 - slack)
                there = self._simulator.track([pose], initial=shape, holds=[shape.holds])[0]
                if there.converged and not there.jumped:
                    missed, after = aim.rows(there)
                    if after < size or not pulls and after < size + _PASSING:
                        break
                step = 0.5 * step
            else:
                break
            looser = slack > 1 - straightness(shape)
            shape, miss, size = there, missed, after
            pulls, slack = self._pulls(shape, by)
            if (slack > 1 - straightness(shape)) != looser:  # too much before, too little now
                by = float(np.sqrt(by))
        return known

    def _pulls(self, shape: Shape, by: float) -> tuple[bool, float]:
        """Return whether the gripper pulls about as it should, and what would be slack if it did.

        As a part of the DLO between the gripper and what holds next to it; changed by a factor.
        """
        if not shape.holds:
            return True, 0.0
        slack = 1 - straightness(shape)
        wanted = self._least_pull(part_led(shape))
        pull = self._pull(shape, shape.holds[0].pose.position)
        if wanted / _ABOUT < pull < wanted * _ABOUT:
            return True, slack
        return False, max(slack / by if pull < wanted else slack * by, _TAUTEST)

    def _slack(self, shape: Shape, pose: Pose, straight: float) -> Pose:
        """Return the gripper's Pose, drawn in to be no farther than a part `straight` of the DLO.

        From what holds next to it.
        """
        if not shape.holds:
            return pose
        pivot = shape.holds[0].pose.position
        way = pose.position - pivot
        most = straight * part_led(shape) / float(np.linalg.norm(way))
        return pose if most >= 1.0 else Pose(pivot + most * way, pose.quaternion)

    def _correction(self, shape: Shape, aim: Aim, rows: Floats, straight: float) -> Floats:
        """Return the twist (6,) of `Aim.step`, no larger than one correction may be."""
        step = aim.step(shape, rows, straight)
        return step / max(float(np.linalg.norm(step[:3])) / _TURN,
                          float(np.linalg.norm(step[3:])) / (_SHIFT * self._length), 1.0)

    # ---- stages -----------------------------------------------------------------------------

    def _poses(self, begin: Pose, holds: Holds, goal: Pose, rise: float,
               nearer: float = 0.0) -> list[Pose]:
        """Return Poses on the way to a goal, about what holds next to the gripper.

        `rise`: of the length, by how much they rise in the middle; `nearer`: by which part of the
        distance they are nearer there to what holds.
        """
        length = self._length
        up = upwards(self._simulator.surroundings.gravity)
        pivot = holds[0].pose.position if holds else None
        whole = Rotation.from_matrix(goal.rotation @ begin.rotation.T).as_rotvec()
        spins = np.zeros(3)
        if pivot is not None:
            ways = [pose.position - pivot for pose in (begin, goal)]
            sizes = [float(np.linalg.norm(way)) for way in ways]
            spins = Rotation.from_matrix(least_turn(
                ways[0] / sizes[0], ways[1] / sizes[1])).as_rotvec()
        apart = float(np.linalg.norm(goal.position - begin.position)) + 2 * rise * length
        count = max(1, int(np.ceil(max(apart / (_STEP * length),
                                       angle_between(begin.rotation, goal.rotation) / SHARPEST,
                                       float(np.linalg.norm(spins)) / SHARPEST))))
        poses = []
        for share in np.arange(1, count + 1) / count:
            position = (1 - share) * begin.position + share * goal.position
            risen = rise * length * np.sin(np.pi * share) * up
            if pivot is not None:
                size = ((1 - share) * sizes[0] + share * sizes[1]) * (
                    1 - nearer * np.sin(np.pi * share))
                way = size * Rotation.from_rotvec(share * spins).apply(ways[0] / sizes[0]) + risen
                position = pivot + way * (size / np.linalg.norm(way))
            else:
                position = position + risen
            turned = Rotation.from_rotvec(share * whole).as_matrix() @ begin.rotation
            poses.append(Pose.from_rotation(position, turned))
        return [*poses[:-1], goal]

    def _way(self, shape: Shape, goal: Pose, name: str) -> Shape:
        """Add the stage in which the gripper goes to a Pose; return its end.

        Straight on or rising; if that cannot be, back first as it came when it pressed. Where the
        DLO turns on its way it may be drawn taut between two ends at which it is slack: then the
        gripper keeps nearer to what holds it.
        """
        refused: Infeasible | None = None
        found, least, eased = None, np.inf, self._least_pull(part_led(shape))
        backs = sorted({round(part * len(self._back)) for part in _BACKS})
        for count, rise, nearer in product(backs, _RISES, _NEARER if shape.holds else (0.0,)):
            if nearer and found is None:
                continue  # a way that cannot be is none because it is too taut
            if not (rise or nearer) and least < _TAUT:
                break  # it need not go back any farther
            back = self._back[:count]
            begin = back[-1] if back else shape.gripper
            grips = [Grips(pose, shape.holds) for pose in (
                shape.gripper, *back, *self._poses(begin, shape.holds, goal, rise, nearer))]
            try:
                plan = led(self._context, grips, self._silent, known=(shape,))
                self._check_fittings(plan)
            except Infeasible as error:
                if refused is None or (error.plan is not None and refused.plan is not None
                                       and error.plan.fraction > refused.plan.fraction):
                    refused = error
                continue
            pulls = np.linalg.norm(plan.wrenches[:, 0, :3], axis=1)
            hard = float(pulls.max() / max(pulls[0], pulls[-1], eased, self._pressed_by / _HARD))
            if hard < least:
                found, least = plan, hard
            if hard < _HARD:
                break
        if found is not None:
            return self._added(found, name)
        assert refused is not None  # one way is tried at least
        raise again(refused, f'{name}: ')

    def _entered(self, shape: Shape, fitting: Fitting, aim: Aim,
                 name: str) -> tuple[Shape, float]:
        """Add the stage in which the DLO goes into a fitting; return its end, and what is there."""
        heights = np.linspace(self._standoff(fitting), 0.0, _ENTRIES + 1)
        found, poses = [shape], list[Pose]()
        for height in heights.tolist():
            begin = self._turned_down(found[-1], fitting, self._bow / heights.size)
            there = self._aimed(begin, aim._replace(pose=before(fitting, height)))
            if there is None:
                missed = aim._replace(pose=before(fitting, height)).miss(found[-1])
                raise self._refused(f'enter {name}', 'aim', missed, f'{height:.3g} m before '
                                    f'{name} no pose of the gripper leads the DLO straight in')
            found.append(there)
            poses.append(there.gripper)
        # once more without the corrections, as it is carried out
        builder = PlanBuilder(np.zeros(len(poses) + 1), replace(
            self._silent, tolerance=fitting.room), f'enter {name}: waypoint')
        # where it came to before the mouth, which need not be the middle: the way there may differ
        # from the one by which the gripper's pose was found, and what slides remembers its way
        s = aim.level(shape)
        builder.add(waypoint_at(shape, shape.frame_at(s)[1], s, None)._replace(via_points=()))
        # it stops above the fitting, where what is seen of the DLO tells whether it goes in
        top = self._top(fitting)
        above = int((heights > top).sum()) if top else 0
        for pose, height in zip(poses, heights.tolist(), strict=True):
            after = self._simulator.track([pose], initial=shape, holds=[shape.holds])[0]
            if not after.converged or after.jumped:
                raise builder.refusal('continuity', aim.miss(after), 'the DLO would not '
                                      f'follow there: {after.status}')
            builder.add(self._waypoint(after, fitting, aim, height))
            if above and height == heights[above - 1]:
                builder.stop()
            shape = after
        plan = builder.finished()
        self._added(plan, f'enter {name}')
        return shape, aim._replace(pose=fitting.pose).level(shape)

    def _turned_down(self, shape: Shape, fitting: Fitting, angle: float) -> Shape:
        """Return the Shape with the gripper turned in its place, rad, against a mouth."""
        if not angle:
            return shape
        pose = displaced(shape.gripper, np.append(self._turn_down(shape, fitting, angle),
                                                  np.zeros(3)))
        there = self._simulator.track([pose], initial=shape, holds=[shape.holds])[0]
        return there if there.converged and not there.jumped else shape

    def _turn_down(self, shape: Shape, fitting: Fitting, angle: float) -> Floats:
        """Return the rotation vector (3,) that turns the gripper down towards a fitting."""
        axis = np.cross(fitting.outwards, shape.gripper.rotation[:, 0])
        result: Floats = angle * axis / np.linalg.norm(axis)
        return result

    def _waypoint(self, shape: Shape, fitting: Fitting, aim: Aim, height: float) -> Waypoint:
        """Return the Waypoint of a Shape before the seat of a fitting, with what it misses."""
        pose = before(fitting, height)
        made = waypoint_at(shape, pose.position, aim._replace(pose=pose).level(shape),
                           pose.rotation[:, 0])
        return made._replace(via_points=())

    def _presses(self, begin: Shape, fitting: Fitting, s: float, name: str, aside: float,
                 known_steps: dict[tuple[object, ...], _Pressed]) -> tuple[list[Shape], float]:
        """Return Shapes that press into a fitting that holds the DLO at s, m, until it snaps.

        The gripper swings `aside` about the seat, by so many rad, then inwards as long as nothing
        is in the way, then pulls more and more. Also returns how much of `aside` is left at the
        end, rad: something is in the way there. `known_steps`: those of other ways from `begin`,
        which begin alike; it is added to.
        """
        out, seat = fitting.outwards, fitting.pose.position
        way = begin.gripper.position - seat
        size = float(np.linalg.norm(way))
        ahead = way - (way @ out) * out
        ahead /= np.linalg.norm(ahead)
        across = np.cross(out, ahead)
        first, found = float(np.arcsin(way @ out / size)), [begin]
        angle, beside, slack = first, 0.0, max(1 - size / s, _TAUTEST)
        pull = max(self._pull(begin, seat), self._least_pull(s) / _ABOUT)
        bowed = self._turn_down(begin, fitting, self._bow)
        most, too_hard = np.inf if fitting.bears is None else fitting.bears, False
        firm = min(_FIRM, _LESS_FIRM * begin.stability)
        rate = 0.0  # N: by how much more it pulls for the inverse of what is slack; 0: not known

        def pressed(lower: float, side: float, wanted: float) -> tuple[Shape, float] | None:
            """Return the Shape at two angles with a pull, N, and what is slack then; or None."""
            # what was bowed to come in is straight when it is level: bowed, it would be in the way
            level = float(np.clip((first - lower) / max(first, _SWING), 0.0, 1.0))
            turned = (Rotation.from_rotvec(side * out)
                      * Rotation.from_rotvec((first - lower) * across)
                      * Rotation.from_rotvec(-level * bowed)).as_matrix()
            flat = np.cos(side) * ahead + np.sin(side) * across
            nonlocal too_hard, rate
            too_hard = False
            loose, tight, wide = slack, 0.0, np.inf  # between the last two is what is wanted
            known: tuple[float, float] | None = None  # the inverse of the last one, and its pull
            exactly = fitting.push and side == beside  # whether it is to pull as wanted, nearly
            least = (1 - _PULLED) * wanted if exactly else wanted / _ABOUT
            # what lifts it off is looked at where it pulls as little as it may, and a little more
            lifting = (1 + _EDGE) * least if exactly else least
            for _ in range(_PULLS):
                if not _TAUTEST <= loose <= max(_SLACKEST, slack):
                    return None
                pose = Pose.from_rotation(
                    seat + (1 - loose) * s * (np.cos(lower) * flat + np.sin(lower) * out),
                    turned @ begin.gripper.rotation)
                there = found[-1]
                if (lower, side, loose) != (angle, beside, slack):
                    there, = self._simulator.track([pose], initial=there, holds=[there.holds])
                if not there.converged or there.jumped:
                    tight, known, loose = loose, None, loose * _LOOSER
                    continue
                pulls = self._pull(there, seat)
                lifts = self._push(there, fitting, name) < -wanted * _LIFTS
                if lifts and pulls < lifting:
                    return None  # what bends it lifts it, not the pull: looser it would pull less
                much = pulls > wanted or lifts
                tight, wide = (loose, wide) if much else (tight, loose)
                if not lifts and not (exactly and pulls < least) and (
                        not fitting.push or pulls < (1 + _PULLED) * wanted):
                    too_hard = self._push(there, fitting, name) > most
                    # (a force that depends on less slack than the error is no figure)
                    good = (not too_hard and there.stability > firm
                            and loose * s > there.error_estimate
                            and self._leads_to(found[-1], there))
                    return (there, loose) if good else None
                if known is not None and (pulls - known[1]) * (1 / loose - known[0]) > 0:
                    rate = (pulls - known[1]) / (1 / loose - known[0])
                known = 1 / loose, pulls
                # it pulls as the inverse of what is slack goes, nearly, from wherever it is
                aim = 0.5 * (least + lifting) if lifts else wanted
                guess = loose / float(np.clip(1 + loose * (aim - pulls) / rate, 1 / _LOOSER**2,
                                              _LOOSER**2)) if rate and (
                                                  exactly or not lifts) else 0.0
                if not tight < guess < wide:
                    guess = float(np.sqrt(tight * wide)) if tight and wide < np.inf else loose * (
                        _LOOSER if much else 1 / _LOOSER)
                loose = guess
            return None

        swing, stronger = _SWING, _STRONGER
        while beside != aside or len(found) < 2 or fitting.push and (
                self._push(found[-1], fitting, name) < fitting.push):
            self._context.progress.check()
            left = aside - beside
            by = min(swing, angle + _STEEPEST)
            tries = [(angle - by, beside, pull), (angle, beside, stronger * pull)]
            if left:  # what is bowed would come down on what stands ahead: it rises then
                there = aside if abs(left) < 1.01 * _SWING else beside + float(
                    np.sign(left)) * _SWING
                tries = [*((angle + rise, there, pull) for rise in (0.0, 0.5 * _SWING, _SWING)),
                         tries[1]]
            else:
                tries = tries[by < _LEAST_SWING:]
            if not fitting.push:  # where nothing has to snap it would pull more and more for ever
                tries = [one for one in tries if one[2] == pull]
            for lower, side, wanted in tries:
                step = id(found[-1]), angle, beside, slack, lower, side, wanted
                if step not in known_steps:
                    known_steps[step] = _Pressed(found[-1], pressed(lower, side, wanted), too_hard)
                _, new, too_hard = known_steps[step]
                if new is not None:
                    if (lower, side, new[1]) != (angle, beside, slack):  # else it pulls enough
                        found.append(new[0])
                    angle, beside, pull, slack = lower, side, wanted, new[1]
                    break
                if lower < angle:
                    swing *= 0.5  # something is in the way, or it would lift off
                    break
            else:
                if not too_hard or stronger < 1 + _PULLED:
                    break
                stronger = float(np.sqrt(stronger))
        return found, abs(aside - beside)

    def _leads_to(self, one: Shape, other: Shape) -> bool:
        """Whether the gripper leads the DLO from one Shape to another without breaking a demand.

        A step is long: it may pass through what stands ahead and be clear at both ends.
        """
        try:
            led(self._context, [Grips(shape.gripper, shape.holds) for shape in (one, other)],
                replace(self._silent, says_how_deep=False), known=(one, other))
        except Infeasible:
            return False
        return True

    def _pull(self, shape: Shape, seat: Floats) -> float:
        """Return the force with which the gripper pulls the DLO away from a seat (3,), N."""
        way = shape.gripper.position - seat
        return float(shape.gripper_wrench[:3] @ way / np.linalg.norm(way))

    def _least_pull(self, length: float) -> float:
        """Return a pull, N, that straightens a part of the DLO (m) about as much as it can bend."""
        rod, surroundings = self._context.rod, self._simulator.surroundings
        ends = np.linspace(0.0, length, 9)
        weight = float(rod.masses_per_length(ends).mean()) * length * float(
            np.linalg.norm(surroundings.gravity))
        bends = float(rod.stiffnesses(ends)[:, 1:].mean()) / length**2
        return (weight + bends) / (1 + _EASED * self._bow)

    def _pressed(self, shape: Shape, s: float, fitting: Fitting, name: str) -> Shape:
        """Add the stage in which a fitting holds, and the DLO is pressed into it."""
        holds = closed(self._simulator, shape, fitting, s, name)
        s = next(hold.s for hold in holds if hold.by == name) or s
        begin = self._simulator.track([shape.gripper], initial=shape, holds=[holds])[0]
        if not begin.converged or begin.jumped:
            raise self._refused(f'press {name}', 'continuity', 0.0, f'where {name} closes the DLO '
                                f'would not stay: {begin.status}')
        if (broken := self._silent.violation(Waypoint(begin))) is not None:  # as it is turned
            raise self._refused(f'press {name}', broken.name, -broken.room, f'where {name} closes '
                                f'{broken.message}', broken.unit)
        pushed, found, known_steps = -np.inf, [begin], dict[tuple[object, ...], _Pressed]()
        blocked = set[float]()  # sides to which it goes no farther, however far it is to go
        for aside in _ASIDE:
            if np.sign(aside) in blocked:
                continue
            shapes, left = self._presses(begin, fitting, s, name, aside, known_steps)
            if left > (1 - 1e-9) * _SWING:  # a whole step: those to places beyond begin with it
                blocked.add(float(np.sign(aside)))
            if len(shapes) > 1 and (push := self._push(shapes[-1], fitting, name)) > pushed:
                pushed, found = push, shapes
            if pushed >= fitting.push or not self._is_ahead():
                break
        if len(found) < 2 or fitting.push and pushed < fitting.push:
            raise self._refused(
                f'press {name}', 'push', fitting.push - pushed, f'{name} snaps at '
                f'{fitting.push:.3g} N, the DLO presses into it with {pushed:.3g} N at most', 'N')
        # and back until it pulls as little as before, for what comes next
        pulls = [self._pull(one, fitting.pose.position) for one in found]
        most = _EASIER * max(pulls[0], self._least_pull(s))
        easy = max(k for k, pull in enumerate(pulls) if not k or pull < most)
        grips = [Grips(one.gripper, one.holds) for one in (*found, *reversed(found[easy:-1]))]
        self._back = [one.gripper for one in reversed(found[:easy])]
        self._pressed_by = max(pulls)
        top, known = grips[len(found) - 1], found
        for left in reversed(range(_CLOSER)):
            stop, ends = next(k for k, one in enumerate(grips) if one is top), list[int]()
            try:
                plan = led(self._context, grips, self._silent, (stop,), known=known, ends=ends)
                break
            except Infeasible as error:
                at = bisect_right(ends, error.waypoint)  # among the grips, the one on the way to
                if error.constraint != 'clearance' or not left or not 0 < at < len(grips):
                    raise again(error, f'press {name}: ') from None
                # Each step was looked at as a straight one; the trajectory rounds the corners
                # between steps, so there are more waypoints beside the one that is refused.
                grips = [new for k, one in enumerate(grips) for new in (
                    (grips[k - 1].towards(one, 0.5), one) if k and abs(k - at) < 2 else (one,))]
                known = known[:max(at - 1, 1)]
        return self._added(plan, f'press {name}')

    def _push(self, shape: Shape, fitting: Fitting, name: str) -> float:
        """Return the force with which a DLO presses into a fitting, N."""
        for hold, wrench in zip(shape.holds, shape.wrenches, strict=True):
            if hold.by == name:
                return float(wrench[:3] @ fitting.outwards)
        return 0.0

    def _added(self, plan: Plan, name: str) -> Shape:
        """Add a stage in which no fitting loses the DLO, or bears too much; return its end."""
        try:
            self._check_fittings(plan)
        except Infeasible as error:
            raise again(error, f'{name}: ') from None
        return self._stages.add(name, plan)

    def _check_fittings(self, plan: Plan) -> None:
        """Raise Infeasible where a fitting loses the DLO, or bears too much."""
        limits = dict(zip(self._names, self._task.fittings, strict=True))
        for index, shape in enumerate(plan.shapes):
            for hold in shape.holds:
                held = limits.get(hold.by)
                if held is None:
                    continue
                push = self._push(shape, held, hold.by)
                for word, force, most, how in (('retains', -push, held.retains, 'drawn out of'),
                                               ('bears', push, held.bears, 'pressed into')):
                    if most is not None and force > most:
                        raise Infeasible(
                            f'waypoint {index}: the DLO is {how} {hold.by} with '
                            f'{force:.3g} N, it {word} {most:.3g} N', index, word, force - most,
                            truncate(plan, index, PlanStatus.PARTIAL), 'N')

    # ---- refusals ---------------------------------------------------------------------------

    def _refused(self, name: str, constraint: str, amount: float, why: str,
                 unit: str | None = None) -> Infeasible:
        """Return a refusal without a plan of its own."""
        return Infeasible(f'{name}: {why}', 0, constraint, float(amount), None, unit)
