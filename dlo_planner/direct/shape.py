# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The answer of the direct simulation: a curve, of a DLO, with its proof."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.discretization import Discretization, Memory, mapped
from dlo_planner.direct.modes import MOST_MODES, SPARE, Linearized, Modes, continued, modes_of
from dlo_planner.direct.section_forces import SectionForces, section_forces
from dlo_planner.direct.storage import load, pose_of_row, pose_row, save
from dlo_planner.direct.touches import Touch, touches_of
from dlo_planner.energy.strands import Strands, bears, nearest_points, tangents
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import folded, frame_along, positions_along
from dlo_planner.geometry.self_distance import may_head_back, self_distance
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import (
    array,
    figure,
    flag,
    instance,
    integer,
    items,
    number,
    results,
    row,
    shown,
    vector,
)
from dlo_planner.model.holds import (
    FarEnd,
    Hold,
    Holds,
    holds_of,
    named,
    place_of,
    spans_of,
    tip_of,
    unreached,
)
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose, shifted
from dlo_planner.model.rod import BACK, Rod, Surface
from dlo_planner.model.section import Section
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import Constant, Value, brief, freeze, owned, put
from dlo_planner.pictured import Pictured

_ROUNDING = 1e-9  # of the length
_NEARLY, _STABLE, _KEPT = 1e-4, 1e-3, 1e-6  # what a shape is not to exceed to go on from it
_NOT_KNOWN = Constant(float('nan'))
_UNKNOWN_ROD = 'this shape does not know its rod: expected one from a simulator'
_BALANCED = 1e-3  # of the largest force: what forces at rest may leave over


@dataclass(frozen=True, eq=False, repr=False)
class Contact(Value):
    """One place where a DLO touches an obstacle.

    Attributes
    ----------
    obstacle : int
        Index of the obstacle in the simulator's `obstacles`.
    s : float
        Arc length of the place, m.
    position : ndarray, shape (3,)
        Point of the DLO's axis there, m, world.
    normal : ndarray, shape (3,)
        Unit vector from the obstacle to the DLO.
    force : float
        Force in N, along the normal, on the DLO, > 0.
    friction : ndarray, shape (3,)
        Friction in N, on the DLO, across the normal.
    penetration : float
        Depth of the DLO's surface in the obstacle, m, >= 0.
    """

    obstacle: int
    s: float
    position: np.ndarray
    normal: np.ndarray
    force: float
    friction: np.ndarray
    penetration: float

    def __post_init__(self) -> None:
        put(self, obstacle=integer('Contact.obstacle', self.obstacle, minimum=0, maximum=2**31),
            **{name: figure(f'Contact.{name}', getattr(self, name))
               for name in ('s', 'force', 'penetration')},
            **{name: results(f'Contact.{name}', getattr(self, name), (3,))
               for name in ('position', 'normal', 'friction')})
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f'obstacle {self.obstacle}', f's {self.s:.4g} m',
                     f'force {self.force:.3g} N', f'penetration {self.penetration:.2g} m')

    @property
    def vector(self) -> np.ndarray:
        """(3,) N, the whole force on the DLO."""
        result: np.ndarray = self.force * self.normal + self.friction
        return result


def contacts_of(s: Floats, of: Ints, rows: Floats, origin: Floats) -> tuple[Contact, ...]:
    """Return the Contacts, by arc length, of `contact_rows` on nodes s, the gripper at `origin`."""
    if not len(rows):
        return ()
    at = s[of[:, 1]] + rows[:, 0]
    order = np.argsort(at, kind='stable')
    rows = rows[order]
    vectors = rows[:, 1:4] + origin, rows[:, 4:7], rows[:, 8:11]
    freeze(vectors)  # so are their rows
    found = []
    for obstacle, where, force, depth, position, normal, friction in zip(
            of[order, 0].tolist(), at[order].tolist(), rows[:, 7].tolist(),
            np.maximum(-rows[:, 11], 0.0).tolist(), *vectors, strict=True):
        contact = Contact.__new__(Contact)  # to judge it takes as long as to find it
        put(contact, obstacle=obstacle, s=where, position=position, normal=normal, force=force,
            friction=friction, penetration=depth)
        found.append(contact)
    return tuple(found)


@dataclass(frozen=True, eq=False, repr=False)
class SelfContact(Value):
    """One place where a DLO touches itself.

    Attributes
    ----------
    s : float
        Arc length of the place, m. Between two grips that turn the DLO, what goes straight on
        behind both stands for these: below 0 it is that part of the gripper.
    other_s : float
        Arc length of the place beyond it that it touches, m; beyond the length it is on what stands
        for the far end's grip.
    position : ndarray, shape (3,)
        Point of the DLO's axis at s, on the chord of its element, m, world.
    normal : ndarray, shape (3,)
        Unit vector from the axis at other_s to that at s.
    force : float
        Force in N, along the normal, on the DLO at s, > 0; at other_s acts its opposite.
    friction : ndarray, shape (3,)
        Friction in N, on the DLO at s, across the normal; at other_s acts its opposite. Both act on
        the surfaces, where these touch.
    penetration : float
        By how much the axes are nearer than both radii, m, >= 0.
    """

    s: float
    other_s: float
    position: np.ndarray
    normal: np.ndarray
    force: float
    friction: np.ndarray
    penetration: float

    def __post_init__(self) -> None:
        put(self, **{name: figure(f'SelfContact.{name}', getattr(self, name))
                     for name in ('s', 'other_s', 'force', 'penetration')},
            **{name: results(f'SelfContact.{name}', getattr(self, name), (3,))
               for name in ('position', 'normal', 'friction')})
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f's {self.s:.4g} m', f'other_s {self.other_s:.4g} m',
                     f'force {self.force:.3g} N', f'penetration {self.penetration:.2g} m')

    @property
    def vector(self) -> np.ndarray:
        """(3,) N, the whole force on the DLO at s."""
        result: np.ndarray = self.force * self.normal + self.friction
        return result


def self_contacts_of(s: Floats, positions: Floats,
                     strands: Strands) -> tuple[tuple[SelfContact, ...], float, Floats]:
    """Return the SelfContacts, by arc length, of nodes s (N + 1,), and the largest depth, m.

    And what a Memory has of them as its `strands`.
    """
    found, deepest, lengths, axes = [], 0.0, np.diff(s), np.zeros((3, 3))
    known, rubs = [], np.zeros((len(strands.pair), 4))
    if len(strands.rub_limit):
        rubs[:, :2] = strands.rub_force - strands.rub_spring * strands.rub_slip
        sizes = np.maximum(np.linalg.norm(rubs[:, :2], axis=1), 1e-300)
        rubs[:, :2] *= np.minimum(strands.rub_limit / sizes, 1.0)[:, None]
        rubs[:, 2:] = strands.rub_slip
    along = np.diff(s, prepend=s[0] - s[-1], append=2.0 * s[-1])
    at = np.array([s[0] - s[-1], *s])
    places = np.array([positions[0] - strands.rays[0], *positions,
                       positions[-1] + strands.rays[1]])
    for p, (i, j) in enumerate(strands.pair.tolist()):
        a, b, distance = nearest_points(lengths, strands.rays, positions, i, j)
        force = float(bears(strands, p, distance))
        depth = max(float(strands.pair_reach[p]) - distance, 0.0)
        deepest = max(deepest, depth)
        if force > 0.0:
            place, away = ((1.0 - t) * places[e + 1] + t * places[e + 2]
                           for e, t in ((i, a), (j, b)))
            apart, friction = place - away, np.zeros(3)
            if rubs[p, :2].any():
                tangents(positions, i, a, j, b, axes)
                friction = rubs[p, :2] @ axes[1:]
            # (the distance has a part that keeps nearest points in the middle, and bears nothing)
            width = float(np.linalg.norm(apart))
            found.append(SelfContact(at[i + 1] + a * along[i + 1], at[j + 1] + b * along[j + 1],
                                     place, apart / width, force * width / distance, friction,
                                     depth))
            known.append([found[-1].s, found[-1].other_s, force, *rubs[p]])
    return (tuple(sorted(found, key=lambda one: (one.s, one.other_s))), deepest,
            np.reshape(known, (-1, 7)))


class Feed(NamedTuple):
    """What is known of the rings that a DLO slides through, n of its A holds."""

    forces: Floats     # (A,) N, derivative of the energy by the place in each; nan of other holds
    slides: tuple[bool, ...]  # n, whether friction is at its limit there
    stiffness: Floats  # (n, n) N/m, derivative of those forces by the places; nan where not known
    work: float        # J, of friction in the step
    trouble: str       # in words, why it does not stay so; '' where it does


class Try(NamedTuple):
    """A strategy by which a step was sought, and how that ended; see `Shape.tried`."""

    strategy: str
    end: str


@dataclass(frozen=True, eq=False, repr=False)
class State(Value):
    """What a Shape carries along, opaque to users; equal if the next step begins with one past."""

    mesh: Discretization | None = field(default=None, compare=False)  # None: as of a file
    history: Memory | None = None  # what it leaves to the next step; None: nothing is known
    before: Memory | None = field(default=None, compare=False)  # what the step began with
    estimate: Callable[[], float] = field(default=_NOT_KNOWN, compare=False)  # m, `error_estimate`
    culled: bool = field(default=False, compare=False)  # found without what may act, which does not
    kicks: int = field(default=0, compare=False)  # how often the search for it left a saddle
    overspent: float = field(default=0.0, compare=False)  # J, see `statics.overspent`
    feed: Feed | None = field(default=None, compare=False)  # None: there is no ring
    tried: tuple[Try, ...] = field(default=(), compare=False)  # strategies of the last step
    # error and the accuracy that was asked for, m, where that is not kept
    missed: tuple[float, float] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.mesh, Discretization):  # else a simulator made it
            instance('State.mesh', self.mesh, Discretization, optional=True)
            for name in ('history', 'before'):
                instance(f'State.{name}', getattr(self, name), Memory, optional=True)
            put(self, kicks=integer('State.kicks', self.kicks, minimum=0, maximum=10**12),
                overspent=figure('State.overspent', self.overspent))
            if not callable(self.estimate):
                raise InvalidTask(f'State.estimate = {shown(self.estimate)}: expected a function')

    @property
    def made_on(self) -> Discretization:
        """The mesh, of a Shape from a simulator."""
        if self.mesh is None:
            raise InvalidTask('Shape.mesh = None: expected a shape that comes from a simulator')
        return self.mesh

    @property
    def left(self) -> Memory:
        """The history, of a Shape from a simulator; raises as `made_on`."""
        if self.history is None:
            raise InvalidTask('Shape.history = None: expected a shape that comes from a simulator')
        return self.history

    @property
    def held(self) -> Memory:
        """What the step began with, under the forces after it; raises as `made_on`."""
        if self.before is None:
            raise InvalidTask('Shape.state: expected a shape that comes from a simulator')
        return self.before.under(self.left)

    @property
    def kept(self) -> bool:
        """Whether it is that of a Shape from a file, with the past that it had."""
        return self.mesh is None and self.history is not None and self.history.of is None

    def forgotten(self) -> State:
        """Return what is left of it where the Shape was changed by hand: its error estimate."""
        return State(estimate=self.estimate)


UNKNOWN = State()


LYING = 4  # contacts at least, of a DLO that lies on something
NO_WRENCH = np.zeros(6)  # of what is not held
NO_WRENCHES = np.zeros((0, 6))
freeze((NO_WRENCH, NO_WRENCHES))


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Shape(Pictured):
    """A static shape of a DLO held by a gripper; N_L elements, N_L + 1 nodes, world frame, SI.

    Two shapes are equal if all that is listed here is, and the past that the next step begins with.

    Attributes
    ----------
    gripper : Pose
        The pose for which it was computed.
    s : ndarray, shape (N_L + 1,)
        Arc lengths of the nodes, m, 0 at the gripper.
    positions : ndarray, shape (N_L + 1, 3)
        Positions in m.
    frames : ndarray, shape (N_L + 1, 3, 3)
        Columns are tangent t, normals n and b (the material frame).
    element_strains : ndarray, shape (N_L, 3)
        Torsion, curvature about n, about b; 1/m, constant per element.
    energy : float
        Total potential, J, gravity's zero at the world's origin.
    elastic_energy : float
        The part of it that is stored in the DLO, J.
    gripper_wrench : ndarray, shape (6,)
        Force (N) and moment about the gripper's origin (N m) that the gripper exerts on the DLO,
        world axes; nan at time 0 of a motion from full length, where it is not known.
    residual : float
        Size of the gradient of the potential, relative to the elastic energy and that of a 1 rad
        bend: whether the minimizer finished.
    stability : float
        Smallest eigenvalue of the Hessian relative to the elastic one; > 0 a minimum, 0 neutral
        (the shape is one of many), < 0 not stable.
    iterations : int
        Newton steps.
    evaluations : int
        Evaluations of the potential, where the method counts them.
    converged : bool
        The residual is below 1e-8 (1e-7 among obstacles, or what rounding errors leave of it where
        constrained), the shape is stable or neutral, no contact is violated by more than 1e-6 of
        the length and no grip by more than 1e-9, and the accuracy was reached.
    jumped : bool
        The shape is not the continuation of the one it was started from, or is one of several into
        which that one splits.
    contacts : tuple
        The Contacts, in the order of s.
    violation : float
        By how much a constraint (contact, hold) is violated, m; how deep the gripper itself, a
        point, is in an obstacle is part of it.
    holds : tuple
        The A Holds beside the gripper, in the order of their places; one of the tip is the last.
        Of rings, `Hold.s` is the place that is in them here.
    wrenches : ndarray, shape (A, 6)
        As `gripper_wrench`, nan where that is, what each of them exerts on the DLO, moment about
        its place.
    dissipated : float
        Energy lost to plastic deformation so far, J.
    parts : tuple or None
        The two Shapes of a DLO grasped inside (`GraspedInside`), else None.
    self_contacts : tuple
        The SelfContacts, in the order of s, of a simulator with `self_contact`.
    passed_itself : bool or float
        Whether the DLO would pass through itself on the way from the shape before, straight seen
        from the gripper; of a motion, since it began. Nothing holds its pieces off each other: a
        shape that is beyond such a passage is none that a DLO comes to. nan where that is not
        known: of a fall, whose way nobody knows, unless both ends are clamped or in a sleeve. Then
        twist and writhe tell, as no way changes their sum but through itself, or past the back of a
        grip. Of a simulator with `self_contact` it is True where grips moved through the DLO.
    state : State
        What it leaves to the next step, besides what is listed above; opaque.
    """

    gripper: Pose
    s: Floats
    positions: Floats
    frames: Floats
    element_strains: Floats
    energy: float
    elastic_energy: float
    gripper_wrench: Floats
    residual: float
    stability: float
    iterations: int
    converged: bool
    jumped: bool = False
    contacts: tuple[Contact, ...] = ()
    evaluations: int = 0
    violation: float = 0.0
    holds: Holds = ()
    wrenches: Floats = field(default_factory=lambda: NO_WRENCHES)
    dissipated: float = 0.0
    parts: tuple[Shape, ...] | None = None
    state: State = field(default=UNKNOWN, metadata={'opaque': True})
    passed_itself: bool | float = False
    self_contacts: tuple[SelfContact, ...] = ()

    _REMEMBERED = ('error_estimate',)

    def __init__(self, gripper: Pose, s: Floats, positions: Floats, frames: Floats,
                 element_strains: Floats, energy: float, elastic_energy: float,
                 gripper_wrench: Floats, residual: float, stability: float, iterations: int,
                 converged: bool, jumped: bool = False, contacts: tuple[Contact, ...] = (),
                 evaluations: int = 0, violation: float = 0.0, far_end: Hold | None = None,
                 far_wrench: Floats | None = None, dissipated: float = 0.0,
                 parts: tuple[Shape, ...] | None = None, state: State = UNKNOWN,
                 passed_itself: bool | float = False, holds: Holds = (),
                 wrenches: Floats = NO_WRENCHES,
                 self_contacts: tuple[SelfContact, ...] = ()) -> None:
        # written out: what a dataclass writes sets field by field, which takes as long as a step
        put(self, gripper=gripper, s=s, positions=positions, frames=frames,
            element_strains=element_strains, energy=energy, elastic_energy=elastic_energy,
            gripper_wrench=gripper_wrench, residual=residual, stability=stability,
            iterations=iterations, converged=converged, jumped=jumped, contacts=contacts,
            evaluations=evaluations, violation=violation, holds=holds, wrenches=wrenches,
            self_contacts=self_contacts,
            dissipated=dissipated, parts=parts, state=state, passed_itself=passed_itself)
        if far_end is not None or far_wrench is not None:
            self._hold_far_end(far_end, far_wrench)
        if getattr(state, 'mesh', None) is None:  # else a simulator made it
            self._judge()
        for name in _ARRAYS:
            array = self.__dict__[name]
            if array.flags.writeable or isinstance(array.base, np.ndarray):  # not its own
                put(self, **{name: owned(array)})

    def _hold_far_end(self, far_end: Hold | None, wrench: Floats | None) -> None:
        """Let `far_end` hold the tip, with a wrench (6,), instead of what does."""
        items('Shape.holds', self.holds, Hold)
        end = self.far_end if far_end is None else instance('Shape.far_end', far_end, Hold)
        if end is None:
            raise InvalidTask(f'Shape.far_wrench = {shown(wrench)}: expected none where nothing '
                              'holds the far end')
        wrench = array('Shape.far_wrench', self.far_wrench if wrench is None else wrench, (6,))
        inside = len(self.holds) - (self.far_end is not None)
        put(self, holds=(*self.holds[:inside], end),
            wrenches=np.vstack([self.wrenches[:inside], wrench]))

    def _judge(self) -> None:
        """Check what comes from elsewhere."""
        instance('Shape.gripper', self.gripper, Pose)
        s = row('Shape.s', self.s, least=2, minimum=0)
        if s[0] != 0 or (np.diff(s) <= 0).any():
            raise InvalidTask(f'Shape.s = {shown(s.tolist())}: expected arc lengths that grow '
                              'from 0')
        put(self, s=s, contacts=items('Shape.contacts', self.contacts, Contact),
            self_contacts=items('Shape.self_contacts', self.self_contacts, SelfContact),
            **{name: array(f'Shape.{name}', getattr(self, name), (s.size, *size))
               for name, size in (('positions', (3,)), ('frames', (3, 3)))},
            holds=holds_of(None, self.holds, float(s[-1]), 'Shape.holds'),
            **{name: array(f'Shape.{name}', getattr(self, name), size) for name, size in (
                ('element_strains', (s.size - 1, 3)), ('gripper_wrench', (6,)))},
            wrenches=results('Shape.wrenches', self.wrenches, (len(self.holds), 6)),
            **{name: figure(f'Shape.{name}', getattr(self, name)) for name in (
                'energy', 'elastic_energy', 'residual', 'stability', 'violation', 'dissipated')},
            **{name: integer(f'Shape.{name}', getattr(self, name), minimum=0, maximum=10**12)
               for name in ('iterations', 'evaluations')},
            **{name: flag(f'Shape.{name}', getattr(self, name))
               for name in ('converged', 'jumped')})
        if not (isinstance(self.passed_itself, float) and np.isnan(self.passed_itself)):
            put(self, passed_itself=flag('Shape.passed_itself', self.passed_itself))
        instance('Shape.state', self.state, State)
        if self.parts is not None:
            put(self, parts=items('Shape.parts', self.parts, Shape, least=2))

    def __repr__(self) -> str:
        mesh = self.state.mesh
        cheap = not (self.contacts or self.holds or mesh is None or mesh.yields)
        return brief(self, f'{self.s[-1]:.4g} m', f'{len(self.element_strains)} elements',
                     'converged' if self.converged else 'not converged',
                     'jumped' if self.jumped else '', f'residual {self.residual:.1g}',
                     f'stability {self.stability:.2g}',
                     f'error {self.error_estimate:.1g} m' if cheap else '',
                     f'{len(self.contacts)} contacts' if self.contacts else '',
                     'lies in itself' if self.lies_in_itself is True else '',
                     self._passage_in_words)

    @property
    def nearly(self) -> bool:
        """Whether it is not `converged`, but good enough to go on from (`DirectSimulator.track`).

        It is stable, keeps all constraints, and its residual is below 1e-4.
        """
        return bool(not self.converged and not self.jumped and self.hinge is None
                    and not self.impossible and self.residual < _NEARLY
                    and self.stability > -_STABLE and self.violation <= _KEPT * self.s[-1]
                    and self._within_reach)

    @property
    def status(self) -> str:
        """How the computation ended, in words: 'converged', 'nearly converged', or why not.

        With 'jumped', 'passed through itself' ('may have passed through itself' where that is
        not known), 'lies in itself' and 'plastic hinge' where it did, does and has one.
        """
        if self.parts is not None and not self._within_reach:
            return self.parts[1].status
        if self.holds and not self._within_reach:
            return 'out of reach: ' + unreached(self.holds, self.gripper, float(self.s[-1]),
                                                self._loaded)
        figures = (f'residual {self.residual:.2g}, stability {self.stability:.2g}, '
                   f'violation {self.violation:.2g} m')
        if self.converged:
            passage = self._passage_in_words
            return ('converged' + (', jumped' if self.jumped else '')
                    + (f', {passage}' if passage else '')
                    + (', lies in itself' if self.lies_in_itself is True else '')
                    + (f', {self._hinge_in_words}' if self.hinge is not None else ''))
        if self.hinge is not None:
            return f'not converged: {self._hinge_in_words}'
        if self.nearly:
            return 'nearly converged: ' + '; '.join(filter(None, (
                figures, self._inaccuracy_in_words)))
        cause = self.impossible or self._inaccuracy_in_words or self._cause()
        return (f'not converged{", jumped" if self.jumped else ""}: {figures}'
                + (f'; {cause}' if cause else ''))

    @property
    def tried(self) -> tuple[Try, ...]:
        """Strategies by which its last step was sought, in their order, and how each ended.

        Each is a pair of `strategy` and `end`; () if another than a simulator made the shape. Of a
        way in parts they are those of the last part. Strategies are

        * 'free': as if nothing acted but dead loads; then that is looked at;
        * 'bearing on': what it touches bears it as in the shape before, a little elsewhere;
        * 'near': held as before, a little elsewhere;
        * 'moved': the grips are moved from where they were, around obstacles, in small parts;
        * 'set down': without a shape before, it is brought into its grips, then among obstacles;
        * 'in steps': the grips go the same way in small steps, to a shape in each;
        * 'by parts': what is between two grips is sought by itself, then all together;
        * 'in halves': held, among obstacles, it was not found at once; so may each half be;
        * 'from elsewhere': it falls onto the obstacles from above, or swings against them;
        * 'paper': the series describe the paper's (q_d, q_kappa, q_tau).

        Ends are 'found', 'not near', 'not converged', and 'something acts': an obstacle, its yield
        stress or it itself, which the strategy leaves out.
        """
        return self.state.tried

    @property
    def _passage_in_words(self) -> str:
        if self.passed_itself is False:
            return ''
        return 'passed through itself' if self.passed_itself is True else (
            'may have passed through itself')

    @property
    def not_looked_at(self) -> tuple[str, ...]:
        """Names of the figures that are nan: what they tell is not known."""
        names = 'bend_margin', 'self_distance', 'lies_in_itself', 'passed_itself'
        return tuple(name for name in names if np.isnan(getattr(self, name)))

    @property
    def impossible(self) -> str:
        """Return in words why no DLO can be in it, whatever its residual is; else ''."""
        feed = self.state.feed
        if feed is not None and feed.trouble:
            return feed.trouble
        if self.state.overspent > 0.0:
            return (f'its step lost {self.state.overspent:.2g} J more to plastic deformation than '
                    'it was given')
        mesh = self.state.mesh
        if mesh is not None and folded(self._kernel_arrays[0], self._kernel_arrays[1],
                                       mesh.free.natural):
            return 'an element is bent by more than half a turn'
        return ''

    @property
    def _inaccuracy_in_words(self) -> str:
        if self.state.missed is None:
            return ''
        error, accuracy = self.state.missed
        return f'its error is {error:.2g} m, expected at most the accuracy of {accuracy:.2g} m'

    def _cause(self) -> str:
        """Return in words why no equilibrium was found, or '' where that is not known."""
        deepest = max(self.contacts, key=lambda contact: contact.penetration, default=None)
        if deepest is not None and deepest.penetration > _KEPT * self.s[-1]:
            known = self.obstacles  # none of a shape from a file
            name = known[deepest.obstacle].name if known else ''
            return (f'at s = {deepest.s:.4g} m the DLO is {deepest.penetration:.2g} m inside '
                    f'{name or f"obstacle {deepest.obstacle}"} and does not come out')
        if not self.holds or self.state.mesh is None or self.parts is not None:
            return ''
        from dlo_planner.direct.taut import coarseness  # noqa: PLC0415  (SciPy: a free DLO needs none)
        return coarseness(self.state.mesh, self.gripper,
                          tuple(hold.stuck for hold in self.holds))

    @property
    def hinge(self) -> float | None:
        """Arc length in m of a plastic hinge, one element that bends alone; None if there is none.

        Without `Rod.hardening` a moment beyond what the section bears bends one element, the
        sharper the shorter it is: strains there mean nothing, and no mesh is fine enough. On none
        that is a `converged` shape, nor what follows it, and `error_estimate` is infinite.
        """
        history = self.state.history
        if history is not None and history.hinge >= 0.0:
            return history.hinge
        found = self.outlier
        return None if found is None else float(0.5 * self.s[found[0]:found[0] + 2].sum())

    @property
    def outlier(self) -> tuple[int, float] | None:
        """Element strained far beyond all beside it, and its strain in yield limits; or None."""
        mesh = self.state.mesh
        if mesh is None or not mesh.yields:
            return None
        return _hinge(mesh.rod, self.element_strains - mesh.natural)

    @property
    def _hinge_in_words(self) -> str:
        strained = '' if self.outlier is None else (
            f'one element is strained {self.outlier[1]:.3g} times its yield limit, ')
        return (f'plastic hinge at s = {self.hinge:.4g} m, {strained}a shorter one would be '
                'further: more moment than the section bears without hardening (Rod.hardening)')

    @property
    def _within_reach(self) -> bool:
        if self.parts is not None:  # what is beyond the gripper alone is held
            return self.parts[1]._within_reach
        return all(span.reaches(self._loaded)
                   for span in spans_of(self.holds, self.gripper, float(self.s[-1])))

    @property
    def _loaded(self) -> bool:
        return self.state.mesh is None or self.state.mesh.loaded

    @cached_property
    def error_estimate(self) -> float:
        """Largest distance of a node from the true rod's, m.

        From an embedded solution with every element halved and freed from the series (computed
        when first read; it costs about as much as the solution itself). Where `accuracy` was asked
        for, and the mesh before foretold the error to leading order, it is the same on this mesh if
        both agree within a quarter. Where a DLO has yielded, at
        least the largest one of the steps that made its permanent set; of a set that a motion made
        nothing is known here, see `Motion.error_estimate`. Where a DLO lies on something, steps are
        made in two halves, as friction depends on the way: by how much these are from the whole
        step is added; that takes as long as the step. Where `accuracy` was asked for, the
        same is added of all that rubs, and a step made in up to 32 parts for it. Where a DLO
        has fallen onto obstacles or along them it may have landed elsewhere: by how much a fall
        with halved elements ends elsewhere is added (this may take a second), infinity where that
        does not come to rest soon, or the DLO slides through rings. Later steps start from where it
        landed, and say nothing of that.
        """
        history = self.state.history
        if history is not None and history.hinge >= 0.0:
            return np.inf
        return max(self.state.estimate(), 0.0 if history is None else history.set_error)

    def resample(self, n_elements: int) -> Shape:
        """Return the same shape on `n_elements` elements of equal length, for pictures and such.

        Nodes lie exactly on this shape's arcs; strains are averaged.
        """
        n = integer('n_elements', n_elements, minimum=1, maximum=1_000_000)
        s = np.linspace(0, self.s[-1], n + 1)
        poses = [self.at(value) for value in s]
        history = None if self.history is None else self.history.resampled(s)
        return replace(self, s=s, positions=np.array([pose.position for pose in poses]),
                       frames=np.array([pose.rotation for pose in poses]),
                       element_strains=mapped(self.s, self.element_strains, s), parts=None,
                       state=State(history=history, estimate=Constant(self.error_estimate)))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the shape as npz, or JSON (see `Plan.save`): all but rod and surroundings."""
        save(path, pack(self), 'Shape')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Shape:
        """Return the Shape saved at `path`; it can start a simulation of the same rod.

        Raises
        ------
        InvalidTask
            Not such a file.
        """
        return load(path, unpack, 'Shape')

    def moved(self, displacement: ArrayLike) -> Shape:
        """Return the same shape carried by `displacement` (3,) m: gravity does not notice.

        Raises
        ------
        InvalidTask
            The shape touches something, is held beside its gripper, or a load depends on where it
            is.
        """
        if self.contacts or self.holds:
            raise InvalidTask('shape: expected one that touches nothing and whose far end is free: '
                              'what holds it is not moved')
        return carried(self, vector('displacement', displacement, 3))

    # ---- its geometry ----------------------------------------------------------------------------

    @property
    def tangents(self) -> Floats:
        """(N_L + 1, 3) unit tangents at the nodes."""
        return self.frames[:, :, 0]

    @property
    def strains(self) -> Floats:
        """(N_L + 1, 3) strains at the nodes, 1/m, interpolated from the elements' middles."""
        return _at_nodes(self.s, self.element_strains)

    @property
    def bend_radius(self) -> Floats:
        """(N_L,) radius of curvature of the elements, m; infinite where straight."""
        with np.errstate(divide='ignore'):
            return 1 / np.hypot(self.element_strains[:, 1], self.element_strains[:, 2])

    def at(self, s: float) -> Pose:
        """Return the Pose (x axis = tangent) at arc length `s` in m, on the element's exact arc.

        Raises
        ------
        InvalidTask
            `s` is outside [0, L].
        """
        s = number('s', s, minimum=0, maximum=float(self.s[-1]))
        rotation, position = self.frame_at(s)
        return Pose.from_rotation(position, rotation)

    def positions_at(self, s: ArrayLike) -> Floats:
        """Return (m, 3) positions in m at arc lengths `s` (m,) in m, as `at`, but quicker.

        Raises
        ------
        InvalidTask
            One is outside [0, L].
        """
        s = row('s', s, least=0, minimum=0, maximum=float(self.s[-1]))
        return positions_along(self.s, self.element_strains, self.frames, self.positions, s)

    def frame_at(self, s: float) -> tuple[Floats, Floats]:
        """Return axes (3, 3) and position (3,) at `s` in m: `at` for inner loops.

        Raises
        ------
        InvalidTask
            `s` is outside [0, L] by more than rounding.
        """
        length = self.s[-1]
        if not (isinstance(s, float) and 0.0 <= s <= length):
            s = number('s', s, minimum=-_ROUNDING * length, maximum=(1 + _ROUNDING) * length)
            s = min(max(s, 0.0), length)
        return frame_along(self.s, self.element_strains, self.frames, self.positions, s)

    @cached_property
    def _kernel_arrays(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Copies: read-only arrays are another type for numba, which would compile all again."""
        return (np.diff(self.s), self.element_strains.copy(), self.frames.copy(),
                self.positions.copy())

    # ---- its DLO ---------------------------------------------------------------------------------

    @property
    def far_end(self) -> FarEnd | None:
        """What holds the tip; None if it is free."""
        return tip_of(self.holds)

    @property
    def far_wrench(self) -> Floats:
        """(6,) as `gripper_wrench`, at the tip, moment about it; zeros if it is free."""
        wrench: Floats = NO_WRENCH if self.far_end is None else self.wrenches[-1]
        return wrench

    @property
    def slip_forces(self) -> Floats:
        """(A,) force along the DLO, N, by which each ring's friction holds it back; nan elsewhere.

        It is the derivative of the energy by the place in the ring: the jump of the material force
        n . t + m . u - w (w: elastic energy per length), > 0 where the part beyond the ring draws
        more. Where its size is the ring's `slip` the DLO slides. nan of holds of a place, and of a
        shape from a file.
        """
        feed = self.state.feed
        return np.full(len(self.holds), np.nan) if feed is None else feed.forces

    @property
    def rod(self) -> Rod | None:
        """The Rod; None for a shape from a file."""
        return None if self.state.mesh is None else self.state.mesh.rod

    @property
    def mesh(self) -> Discretization | None:
        """The Discretization it was computed on; None for a shape from a file."""
        return self.state.mesh

    @property
    def history(self) -> Memory | None:
        """What the DLO carries to the next step: its permanent set and its contacts."""
        return self.state.history

    @property
    def pinned(self) -> bool:
        """Whether its beginning is pinned by the gripper, not clamped (a simulator's `grip`)."""
        return self.state.mesh is not None and self.state.mesh.surroundings.pinned

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles of its simulator; () for a shape from a file."""
        return () if self.state.mesh is None else self.state.mesh.surroundings.obstacles

    @property
    def bend_margin(self) -> float:
        """How much less than the rod's max_bend_curvature the sharpest bend is, 1/m (< 0: more).

        Of elements and nodes: where it is clamped a DLO is bent more than in any element's middle.
        nan without a limit: nothing was looked at.
        """
        if self.parts is not None:  # both are clamped by the gripper, and bent by it on their own
            return float(np.min([part.bend_margin for part in self.parts]))
        limit = None if self.rod is None else self.rod.max_bend_curvature
        if limit is None:
            return np.nan
        bends = np.vstack([self.element_strains, self.strains])[:, 1:]
        return float(limit - np.linalg.norm(bends, axis=1).max())

    @property
    def self_distance(self) -> float:
        """Least distance in m of its axis from itself, within 1e-6 of the length.

        Of places that are no neighbours: between them it heads back towards the first. Infinite if
        it heads back nowhere; nan where not known, of a DLO without a radius or from a file. What
        is below the diameter lies in itself, see `lies_in_itself`: nothing holds it off.
        """
        return self._near_itself[0]

    @property
    def lies_in_itself(self) -> bool | float:
        """Whether two of its pieces, no neighbours, are nearer than their radii.

        By the least half size of a rectangular section; nan where `self_distance` is. Where
        strands keep each other off (`self_contacts`) it is what the chords of their elements leave
        out, as exactly as these are kept.
        """
        gap = self._near_itself[1]
        return np.nan if np.isnan(gap) else gap < -self._chords_off

    @property
    def _chords_off(self) -> float:
        """By how much strands that keep each other off may be in each other, m."""
        mesh = self.state.mesh
        if not self.self_contacts:
            return _KEPT * self.s[-1] if mesh is not None and mesh.touches_itself else 0.0
        bends = np.hypot(self.element_strains[:, 1], self.element_strains[:, 2])
        heights = 0.125 * np.diff(self.s) ** 2 * bends  # of arcs over their chords
        places = [self._element_at(one.s)[0] for one in self.self_contacts] + [
            self._element_at(one.other_s)[0] for one in self.self_contacts]
        # springs give in a motion
        given = max(one.penetration for one in self.self_contacts) if self.converged else 0.0
        return float(2.0 * heights[places].max() + given + _KEPT * self.s[-1])

    @cached_property
    def _near_itself(self) -> tuple[float, float]:
        """Return `self_distance`, and the least distance less both radii, m; computed once."""
        radii = _radii_of(self)
        if radii is None:
            return np.nan, np.nan
        distance, gap = self_distance(*self._kernel_arrays, radii, np.inf, np.inf)
        return float(distance), float(gap)

    def _element_at(self, s: float) -> tuple[int, float]:
        """Return the element in which an arc length is, and the part of it before that."""
        e = int(np.clip(np.searchsorted(self.s, s, side='right') - 1, 0, self.s.size - 2))
        return e, (s - float(self.s[e])) / float(self.s[e + 1] - self.s[e])

    @property
    def bent(self) -> Floats:
        """(N_L, 3) strains since the stress-free shape, permanent set included there, 1/m.

        Raises
        ------
        InvalidTask
            The shape comes from a file and does not know its rod.
        """
        mesh = self.state.mesh
        if mesh is None:
            raise InvalidTask(_UNKNOWN_ROD)
        if self.parts is not None:  # each with its own permanent set
            back, on = (part.bent for part in self.parts)
            return np.vstack([back[::-1] * BACK, on])
        return self.element_strains - mesh.stress_free(self.state.history)

    @property
    def touches(self) -> tuple[Touch, ...]:
        """What the DLO bears on: a Touch for each obstacle that it touches.

        Raises
        ------
        InvalidTask
            The shape touches something, comes from a file and does not know what.
        """
        if not self.contacts:
            return ()
        if self.rod is None:
            raise InvalidTask(_UNKNOWN_ROD)
        return touches_of(self.contacts, self.obstacles, self.s, self.positions,
                          Surface.of(self.rod).radius or _ROUNDING * float(self.s[-1]))

    @cached_property
    def section_forces(self) -> SectionForces:
        """Forces and moments inside the DLO, on both sides of nodes and of all that acts on it.

        By the balance of what acts beyond a place; moments of a rectangular DLO in contact by its
        strains. Their errors are those of the shape.

        Raises
        ------
        InvalidTask
            The shape comes from a file, or the forces that are known do not balance: it is in
            motion or not converged, or a load is not dead.
        """
        if self.parts is not None:
            back, on = (part.section_forces for part in self.parts)
            return back.joined(on, float(self.parts[0].s[-1]))
        mesh = self.state.mesh
        if mesh is None:
            raise InvalidTask(_UNKNOWN_ROD)
        places = [one.s for one in self.contacts] + [
            place_of(hold, float(self.s[-1])) for hold in self.holds]
        wrenches = [[*one.vector, 0.0, 0.0, 0.0] for one in self.contacts] + [*self.wrenches]
        for at, sign in (('s', 1.0), ('other_s', -1.0)):
            for one in self.self_contacts:  # on the nodes of its element
                e, t = self._element_at(min(max(getattr(one, at), 0.0), float(self.s[-1])))
                places += [self.s[e], self.s[e + 1]]
                # (friction acts on the surface, on both strands from the same side)
                couple = -mesh.radii[e] * np.cross(one.normal, one.friction)
                wrenches += [share * np.array([*(sign * one.vector), *couple])
                             for share in (1.0 - t, t)]
        for one in self.self_contacts:  # the grip has its moment, too
            if one.other_s > self.s[-1]:
                places.append(float(self.s[-1]))
                wrenches.append([0.0, 0.0, 0.0, *np.cross(
                    self.positions[-1] - one.position, one.force * one.normal)])
        beside = bool(self.contacts) and Surface.of(mesh.rod).half is not None
        found = section_forces(mesh, self.frame_at, self.gripper_wrench[:3],
                               (np.array(places), np.reshape(wrenches, (-1, 6))),
                               self.bent if beside else None)
        bend = float(mesh.free.stiffness[:, 1:].max()) / self.s[-1] ** 2
        most = max(bend, *np.linalg.norm(found.force, axis=1))
        if not found.imbalance <= _BALANCED * most:
            raise InvalidTask(f'the forces on this shape ({self.status}) leave '
                              f'{found.imbalance:.2g} N over: expected a converged one at rest '
                              'under dead loads')
        return found

    @property
    def tension(self) -> Floats:
        """(N_L + 1,) force along the DLO at the nodes, N, > 0 where it is pulled.

        With `shear`, `torque` and `bending_moment` it is what the part beyond a node exerts on the
        part before it, by the axes of the node's frame; just beyond the gripper at the first node,
        just before the tip at the last one. Where something acts on a node it jumps, and what is
        told here is the mean of both sides: `section_forces` has both, and raises as these do.
        """
        return self._at_nodes[0][:, 0]

    @property
    def shear(self) -> Floats:
        """(N_L + 1, 2) force across the DLO at the nodes, along n and b, N; see `tension`."""
        return self._at_nodes[0][:, 1:]

    @property
    def torque(self) -> Floats:
        """(N_L + 1,) moment about the tangent at the nodes, N m; see `tension`."""
        return self._at_nodes[1][:, 0]

    @property
    def bending_moment(self) -> Floats:
        """(N_L + 1, 2) moment about n and b at the nodes, N m; see `tension`."""
        return self._at_nodes[1][:, 1:]

    @cached_property
    def _at_nodes(self) -> tuple[Floats, Floats]:
        forces = self.section_forces.at_nodes(self.s)
        freeze(forces)
        return forces

    @property
    def surface_strain(self) -> Floats:
        """(N_L, 2) largest axial and shear strain at the surface of each element, ends included.

        Needs `Rod.section`.
        """
        return largest_in_elements(self, self._section().surface_strain)

    @property
    def surface_stress(self) -> Floats:
        """(N_L, 2) largest axial and shear stress at the surface, Pa: those of `surface_strain`.

        Elastic, and so an upper bound where the section has yielded.
        """
        section = self._section()
        moduli: Floats = np.array([section.youngs_modulus, section.shear_modulus])
        return self.surface_strain * moduli

    def _section(self) -> Section:
        if self.rod is None or self.rod.section is None:
            raise InvalidTask('Rod.section = None: expected a Section where strain and stress at '
                              'the surface are asked for (Rod.circular and the like give one)')
        return self.rod.section

    def modes(self, n: int = 4) -> Modes:
        """Return the n slowest vibrations of the DLO about this shape, the grips at rest.

        Contacts that bear stay closed, what yields springs back. There are fewer than n where the
        masses cannot move in as many ways. About 1 ms with a series, see `Modes.error_estimate`.

        Raises
        ------
        InvalidTask
            The shape is not converged, neutral, one of a motion, grasped inside (take its `parts`)
            or from a file; dead moments act, it touches something with friction, or slides through
            a ring.
        """
        n = integer('n', n, minimum=1, maximum=MOST_MODES)
        return modes_of(_linearized(self), n)

    def stiffness_matrix(self) -> Floats:
        """Return (c, c), J: second derivative of the potential by the coordinates of vibrations.

        Coordinates are what the simulator minimizes by, term after term of its series ('local':
        element after element), for each torsion, curvature about n, about b. Their unit is sqrt(J),
        so scaled that the elastic part is the identity (where the stiffness does not vary along the
        DLO). A held far end leaves combinations of these. `jacobian` says what they move.

        Raises
        ------
        InvalidTask
            As `modes`.
        """
        return _linearized(self).vibration.stiffness

    def mass_matrix(self) -> Floats:
        """Return (c, c), J s^2: second derivative of the kinetic energy by the velocities.

        In the coordinates of `stiffness_matrix`, for shapes as there; it may be singular.
        """
        return _linearized(self).vibration.mass

    def jacobian(self) -> Floats:
        """Return (N_L + 1, 3, c), m, world axes: displacement of the nodes by the coordinates.

        In those of `stiffness_matrix`, for shapes as there; the grips at rest.
        """
        return _linearized(self).vibration.jacobian


def _at_nodes(s: Floats, values: Floats) -> Floats:
    """Return (N + 1, k) values at nodes s: on a line through the middles of the elements beside."""
    if len(values) == 1:
        return np.repeat(values, 2, axis=0)
    h = np.diff(s)[:, None]
    inner = (h[1:] * values[:-1] + h[:-1] * values[1:]) / (h[1:] + h[:-1])
    first = values[0] - (values[1] - values[0]) * h[0] / (h[0] + h[1])
    last = values[-1] + (values[-1] - values[-2]) * h[-1] / (h[-1] + h[-2])
    return np.vstack([first, inner, last])


def largest_in_elements(shape: Shape, measure: Callable[[Floats], Floats]) -> Floats:
    """Return (N_L, ...) the largest `measure` of strains (n, 3) since the stress-free shape.

    Of each element's middle and both its ends: at a clamp that is more than in any middle.
    """
    if shape.parts is not None:  # both are clamped by the gripper
        back, on = (largest_in_elements(part, measure) for part in shape.parts)
        return np.concatenate([back[::-1], on])
    bent = shape.bent
    ends = measure(_at_nodes(shape.s, bent))
    result: Floats = np.maximum(measure(bent), np.maximum(ends[:-1], ends[1:]))
    return result


def kernel_arrays(shape: Shape) -> tuple[Floats, Floats, Floats, Floats]:
    """Return lengths, strains of elements, frames, positions of nodes: for kernels alone."""
    return shape._kernel_arrays


def in_itself(shape: Shape, surface: Surface) -> float:
    """Return by how much, in m, a Shape with this Surface lies in itself; 0 where it does not."""
    if surface.radius == 0.0 or not may_head_back(shape.s, shape.element_strains):
        return 0.0
    _, gap = self_distance(*kernel_arrays(shape), surface.least_radii(shape.s), 0.0, 0.0)
    return -float(gap)


def _radii_of(shape: Shape) -> Floats | None:
    """Return the `least_radii` of a Shape; None where it has none."""
    if shape.rod is None or shape.rod.radius is None:
        return None
    return Surface.of(shape.rod).least_radii(shape.s)


_FAR_BEYOND = 10.0  # yield limits: a section that is strained as far bears what it can
_ALONE = 5.0        # times as far as the elements beside it
_FEW = 5            # elements: too few to tell
_WELL_BEYOND = 3.0  # yield limits: less is borne by 3 % less than the limit moment, and is no hinge
_SHARPER = 1.35     # times as far on halved elements: between 1.1 of coarse ones and sqrt(2)


def _hinge(rod: Rod, bent: Floats) -> tuple[int, float] | None:
    """Return the element that is a plastic hinge, and its strain in yield limits; None if none is.

    An element that is bent or twisted far beyond its limit bears its limit moment to 0.3 %; if the
    next ones but one bear 8 % less, the moment in it is beyond what the section can bear.
    """
    if rod.hardening > 0 or len(bent) < _FEW:
        return None
    for share in _yield_shares(rod, bent):
        at = int(share.argmax())
        beside = max(share[max(at - 2, 0):max(at - 1, 0)].max(initial=0.0),
                     share[at + 2:at + 3].max(initial=0.0))
        if share[at] > _FAR_BEYOND and share[at] > _ALONE * beside:
            return at, float(share[at])
    return None


def hinge_of(shape: Shape, finer: Shape | None) -> float | None:
    """Return the arc length in m of the plastic hinge that a step has made; None if it made none.

    `finer` is the same with every element halved, None if there is none. What yields and bears is
    strained as far there, to the error of its elements; a hinge twice as far, as all of it is in
    one of the halves, and at the least moment that makes one sqrt(2) times: curvature is there by
    one over the root of the distance. This tells a hinge on coarse elements, and under a series;
    on fine ones it stands out.
    """
    rod = shape.state.made_on.rod
    if rod.hardening > 0:
        return None
    if finer is not None:
        pair = (_yield_shares(rod, one.element_strains - one.state.made_on.natural)
                for one in (shape, finer))
        for share, other in zip(*pair, strict=True):
            if other.max() > max(_WELL_BEYOND, _SHARPER * share.max()):
                at = int(other.argmax())
                return float(0.5 * finer.s[at:at + 2].sum())
    return shape.hinge


def _yield_shares(rod: Rod, bent: Floats) -> tuple[Floats, Floats]:
    """Return torsions and curvatures (N,) in yield limits, of strains (N, 3) since the natural."""
    curved: Any = rod.yield_curvature or (np.inf, np.inf)  # a pair, whatever was given
    shares = np.abs(bent) / (rod.yield_torsion or np.inf, *curved)
    return shares[:, 0], np.hypot(shares[:, 1], shares[:, 2])


def check_movable(surroundings: Surroundings) -> None:
    """Raise InvalidTask if a load depends on where the DLO is: elsewhere its shape is another."""
    if surroundings.other_loads:
        raise InvalidTask('point_loads: expected PointLoads alone where a shape is moved, got '
                          f'{shown(surroundings.other_loads[0])}, which depends on where it is')


def refuse_sliding(name: str, shape: Shape) -> None:
    """Raise InvalidTask where a Shape slides through a ring: there it answers by that, too."""
    feed = shape.state.feed
    if feed is not None and any(feed.slides):
        rings = [hold for hold in shape.holds if hold.is_ring]
        where = ', '.join(named(hold) for hold, slides in zip(rings, feed.slides, strict=True)
                          if slides)
        raise InvalidTask(f'{name}: expected one that sticks in all its rings; at {where} friction '
                          'is at its limit, and how the DLO slides on is not linearized')


def refuse_self_contact(name: str, shape: Shape) -> None:
    """Raise InvalidTask where a Shape touches itself, which is not linearized."""
    if shape.self_contacts:
        raise InvalidTask(f'{name}: expected one that does not touch itself, it does so at '
                          f'{shape.self_contacts[0].s:.4g} m')


def carried(shape: Shape, displacement: Floats) -> Shape:
    """Return what `Shape.moved` does, of an array (3,); what it touches has to be carried, too."""
    if shape.state.mesh is not None:
        check_movable(shape.state.mesh.surroundings)
    parts = shape.parts and tuple(carried(part, displacement) for part in shape.parts)
    return replace(shape, gripper=shifted(shape.gripper, displacement), parts=parts,
                   positions=shape.positions + displacement,
                   self_contacts=tuple(replace(one, position=one.position + displacement)
                                       for one in shape.self_contacts),
                   energy=shape.energy + float(displacement @ shape.gripper_wrench[:3]))


def modes_along(shapes: Iterable[Shape], n: int = 4) -> tuple[Modes, ...]:
    """Return the Modes of each shape; mode i of one continues mode i of the one before.

    The n slowest modes of the first shape are followed: the modes of the next shape are assigned
    so that the sum of `Modes.overlap` is largest. Modes of equal frequency, as of a round DLO that
    hangs straight, are first turned together so as to be most like those before. Where an overlap
    is small, the steps along the path are too long to tell which mode is which.

    Parameters
    ----------
    shapes : iterable of Shape
        In the order of the path, as from `DirectSimulator.track`; meshes may differ.
    n : int, optional
        How many modes; there may be fewer, see `Shape.modes`.

    Raises
    ------
    InvalidTask
        A shape that has no modes, see `Shape.modes`, or fewer than the one before.
    """
    shapes = items('shapes', shapes, Shape)
    n = integer('n', n, minimum=1, maximum=MOST_MODES)
    followed: list[Modes] = []
    for k, shape in enumerate(shapes):
        linear = _linearized(shape, f'shapes[{k}]')
        followed.append(continued(followed[-1], linear) if followed
                        else modes_of(linear, n, SPARE))
    return tuple(followed)


def _linearized(shape: Shape, name: str = 'shape') -> Linearized:
    """Return what vibrates about a Shape; raise InvalidTask where that is not linear or known."""
    mesh, state = shape.state.mesh, shape.state
    if shape.parts is not None:
        raise InvalidTask(f'{name}: expected one held at its end; of a DLO grasped inside each of '
                          'Shape.parts vibrates by itself')
    if mesh is None or state.before is None:
        raise InvalidTask(f'{name}: expected one that comes from a simulator')
    if not shape.converged:
        raise InvalidTask(f'{name} is {shape.status}: expected a converged one')
    if mesh.surroundings.has_moments:
        raise InvalidTask(f'{name}: expected one without dead moments, which have no potential')
    refuse_sliding(name, shape)
    refuse_self_contact(name, shape)
    if any(shape.obstacles[contact.obstacle].friction for contact in shape.contacts):
        raise InvalidTask(f'{name}: expected one that touches nothing with friction, whose law is '
                          'not linear however small the vibrations are')
    return Linearized(name, mesh, shape.gripper, shape.holds, shape.element_strains,
                      shape.residual, state.before, state.held)


_FILED = 's', 'positions', 'frames', 'element_strains', 'gripper_wrench'
_ARRAYS = *_FILED, 'wrenches'
_PAST = 'past_'
_PARTS = 'back', 'front'  # of a DLO grasped inside
_NUMBERS = ('energy', 'elastic_energy', 'residual', 'stability', 'iterations', 'converged',
            'jumped', 'evaluations', 'violation', 'dissipated')


def pack(shape: Shape) -> dict[str, Any]:
    """Return a tree (see `direct.storage`) of all of a Shape but the rod and its surroundings."""
    packed = {name: getattr(shape, name) for name in _FILED + _NUMBERS}
    packed['gripper'] = pose_row(shape.gripper)
    packed['passed_itself'] = float(shape.passed_itself)
    packed['error_estimate'] = shape.error_estimate
    if shape.holds:
        packed |= {'holds': np.array([[*pose_row(hold.pose), place_of(hold, float(shape.s[-1]))]
                                      for hold in shape.holds]),
                   'hold_grips': np.array([hold.grip for hold in shape.holds]),
                   'held_by': np.array([hold.by for hold in shape.holds]),
                   'hold_slips': np.array([hold.slip for hold in shape.holds]),
                   'wrenches': shape.wrenches}
    if shape.self_contacts:
        packed['self_contacts'] = np.array([
            [c.s, c.other_s, *c.position, *c.normal, c.force, *c.friction, c.penetration]
            for c in shape.self_contacts])
    packed['contacts'] = np.array([[c.obstacle, c.s, *c.position, *c.normal, c.force, *c.friction,
                                    c.penetration] for c in shape.contacts]).reshape(-1, 13)
    if shape.parts is not None:
        packed |= {name: pack(part) for name, part in zip(_PARTS, shape.parts, strict=True)}
    if shape.state.history is not None:
        packed |= {_PAST + name: array for name, array in shape.state.history.packed().items()}
    return packed


def unpack(stored: Mapping[str, Any]) -> Shape:
    """Return the Shape of the tree of `pack`."""
    contacts = tuple(Contact(int(row[0]), row[1], row[2:5], row[5:8], row[8], row[9:12], row[12])
                     for row in stored['contacts'])
    touching = tuple(SelfContact(row[0], row[1], row[2:5], row[5:8], row[8], row[9:12], row[12])
                     for row in stored.get('self_contacts', ()))
    past = {name.removeprefix(_PAST): array for name, array in stored.items()
            if name.startswith(_PAST)}
    history = Memory.unpacked(past, float(stored['s'][-1])) if past else None
    values = {name: stored[name] for name in _FILED}
    values |= {name: stored[name].item() for name in _NUMBERS}
    passed = float(stored.get('passed_itself', np.nan))  # 1, 0, or nan
    parts = tuple(unpack(stored[name]) for name in _PARTS) if _PARTS[0] in stored else None
    holds, wrenches = _unpacked_holds(stored)
    return Shape(gripper=pose_of_row(stored['gripper']), contacts=contacts, holds=holds,
                 self_contacts=touching, wrenches=wrenches, parts=parts,
                 passed_itself=bool(passed) if passed in (0.0, 1.0) else np.nan,
                 state=State(history=history, estimate=Constant(float(stored['error_estimate']))),
                 **values)


def _unpacked_holds(stored: Mapping[str, Any]) -> tuple[Holds, Floats]:
    """Return Holds and their wrenches (A, 6) of the tree of `pack`."""
    if 'far_wrench' in stored:  # files of before there were holds anywhere but at the tip
        if 'far_end' not in stored:
            return (), NO_WRENCHES
        end = FarEnd(pose_of_row(stored['far_end']), str(stored['far_grip']))
        return (end,), np.atleast_2d(stored['far_wrench'])
    if 'holds' not in stored:
        return (), NO_WRENCHES
    length = float(stored['s'][-1])
    holds: list[Hold] = []
    slips = stored.get('hold_slips', np.zeros(len(stored['holds'])))  # not in files of before
    for at, grip, by, slip in zip(stored['holds'], stored['hold_grips'], stored['held_by'],
                                  slips, strict=True):
        pose = pose_of_row(at[:7])
        if at[7] < length:
            holds.append(Hold(pose, str(grip), float(at[7]), float(slip), by=str(by)))
        else:
            tip = Hold(pose, str(grip), by=str(by))
            holds.append(FarEnd(pose, tip.grip) if tip.by == FarEnd.by else tip)
    return tuple(holds), stored['wrenches']
