# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of a motion: statics with inertia added, Eq. 12, 13 of the paper.

Nodes carry the mass, the strains are the unknowns: the same minimization as in statics, with one
term more. Damping is Rayleigh's: in proportion to mass (drag of a calm surrounding) and to
stiffness (Kelvin and Voigt); neither changes a shape at rest. Of a DLO that hangs freely many steps
are made by one kernel, of others one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.boundary_motion import Grips
from dlo_planner.direct.contact import Contact
from dlo_planner.direct.culling import acting_on, remembers_nothing
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.integrator import (
    PAST,
    Coefficients,
    KinematicState,
    Scheme,
    Trail,
    allowed,
    entered,
    set_off,
    stability_at,
    swing_along,
)
from dlo_planner.direct.memory import Memory
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import (
    CONVERGED,
    MAX_ITERATIONS,
    TOLERANCE,
    Search,
    hanging_shape,
    shape_of,
    solve,
    unknown,
)
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.plastic import yields
from dlo_planner.energy.potential import configuration_at, unknowns_of
from dlo_planner.energy.problem import Problem, tip_wrench
from dlo_planner.minimize.classic import search
from dlo_planner.minimize.convergence import settled
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import freeze


@dataclass(frozen=True)
class TimePoint:
    """All that the rest of a motion depends on, and what has become of the energy.

    Attributes
    ----------
    place : float
        Time / dt.
    shape : Shape
    nodes : KinematicState
        Their (N + 1, 3) positions.
    bends : KinematicState
        The (N, 3) strains of the elements.
    kinetic : float
        Kinetic energy, J.
    potential : float
        Potential energy, J.
    work : float
        Work done by the grips so far, J.
    power : float
        Power of the grips now, W.
    losses : ndarray, shape (3,)
        Energy lost to damping, plasticity and friction so far, J.
    touched : bool
        Whether the DLO has touched an obstacle.
    pushed : float
        Work that contacts have done so far because a step follows a chord where the DLO slides
        along a curve, J: of first order, and none in truth.
    """

    place: float
    shape: Shape
    nodes: KinematicState
    bends: KinematicState
    kinetic: float
    potential: float
    work: float
    power: float
    losses: Floats
    touched: bool = False
    pushed: float = 0.0

    def __getattr__(self, name: str) -> Any:
        """Make a shape, nodes or bends that a motion may never be asked for."""
        if name not in _BOXED or 'boxed' not in self.__dict__:
            raise AttributeError(name)
        made = self.__dict__[name] = self.__dict__['boxed'](name)
        return made

    @property
    def free(self) -> bool:
        """Whether nothing has acted on the DLO but what acts on all of them."""
        if self.touched:
            return False
        # one whose Shape is not made yet is of `swung`
        return 'shape' not in self.__dict__ or remembers_nothing(self.shape)

    @property
    def positions(self) -> Floats:
        """(N + 1, 3) of the nodes, m."""
        return self._of_nodes('positions', 'position')

    @property
    def velocities(self) -> Floats:
        """(N + 1, 3) of the nodes, m/s."""
        return self._of_nodes('velocities', 'velocity')

    def _of_nodes(self, several: str, one: str) -> Floats:
        """Return what `nodes` has under the name `one`; it is not made for that alone."""
        known = self.__dict__.get('nodes')
        result: Floats = (self.__dict__['boxed'](several) if known is None
                          else getattr(known, one))
        return result

    @classmethod
    def made(cls, **contents: Any) -> TimePoint:
        """Return the TimePoint with these fields: quicker than by its constructor.

        Parameters
        ----------
        contents : object
            All fields, but for those in _BOXED which `boxed`, a function of their name, makes; and
            also 'positions' and 'velocities'.
        """
        instant = object.__new__(cls)
        instant.__dict__.update(contents)
        return instant

    def changed(self, **contents: Any) -> TimePoint:
        """Return the same TimePoint with other values of some fields."""
        return self.made(**(self.__dict__ | contents))

    @property
    def balance(self) -> float:
        """Energy that is there, less what was put in, plus what was taken out, J."""
        given = self.work + self.pushed
        return self.kinetic + self.potential - given + float(self.losses.sum())


_BOXED = ('shape', 'nodes', 'bends')


class There(NamedTuple):
    """What was found a very short time later.

    Attributes
    ----------
    positions, strains : ndarray, shape (N + 1, 3), (N, 3)
        Of the nodes, world, m; of the elements, 1/m.
    wrench, far_wrench : ndarray, shape (6,)
        Of the gripper and of the far end on the DLO.
    """

    positions: Floats
    strains: Floats
    wrench: Floats
    far_wrench: Floats


MOST = 64  # steps of a leg: after them a deadline is looked at


@dataclass(frozen=True)
class Limits:
    """Until when the steps of a StepBatch are good.

    Attributes
    ----------
    patience : int
        Newton steps after which a step counts as not solved.
    error : float
        Local error of a step, m.
    part : float
        Part of the energy that has moved which a motion may gain.
    noise : float
        J that it may gain in addition.
    books : ndarray, shape (5,)
        See `direct.integrator`, which writes there.
    touched : bool
        Whether a step may have any error once the DLO has touched an obstacle.
    began : float
        Balance when the motion began, J.
    """

    patience: int = MAX_ITERATIONS
    error: float = np.inf
    part: float = 0.0
    noise: float = np.inf
    books: Floats = field(default_factory=lambda: np.zeros(5))
    touched: bool = False
    began: float = 0.0


class StepBatch(NamedTuple):
    """What came of steps of one length.

    Attributes
    ----------
    errors : ndarray, shape (k,)
        Local errors of the k good ones, m.
    kept : list of TimePoint
        Those at 1, 2, 3 ... times the dt of a Stepper.
    last : TimePoint
        At the end of the last good step.
    past : list
        Pairs of time and node positions: the last but one and the last before that.
    samples : ndarray, shape (k, m, 3)
        Places of some nodes after each good step, see `sampled`.
    refused : TimePoint or None
        At the end of the step after that, which is not good.
    """

    errors: Floats
    kept: list[TimePoint]
    last: TimePoint
    past: list[tuple[float, Floats]]
    samples: Floats
    refused: TimePoint | None


def leg_of(stepper: Stepper, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
           scheme: Scheme, limits: Limits) -> StepBatch:
    """Return the StepBatch of steps that end at `places` (n,), or of the first of them alone."""
    if stepper.swings_from(now):
        leg = stepper.along(now, past, places, scheme, limits)
        if leg is not None:
            return leg
    return stepped(stepper, now, past, float(places[0]), scheme, limits)


def sampled(s: Floats) -> Ints:
    """Return the nodes, of those at `s` (n,), that are looked at between two instants."""
    return np.unique(np.linspace(0, s.size - 1, min(s.size, 9)).round().astype(np.int64))


def swung(stepper: Stepper, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
          scheme: Scheme, limits: Limits) -> StepBatch | None:
    """Return the StepBatch of a DLO that hangs freely, see `Stepper.along`."""
    mesh, known = stepper.discretization, limits.books.copy()
    rounding = stepper.rounding(scheme)
    trail = _trail(stepper, now.nodes, now.bends, np.append(now.place, places))
    nodes = trail.nodes[0]
    for row, (time, positions) in enumerate(past or [
            (trail.times[PAST] - k * scheme.dt, now.nodes.position) for k in (2, 1)]):
        trail.times[row], nodes[row] = time, positions
    # not the elastic energy: nothing asks for that of now, and a Shape would be made for it
    trail.energies[PAST, 1:] = now.potential, now.kinetic, now.work, now.power, now.losses[0]
    books = np.array([CONVERGED + 100 * rounding, limits.error, limits.part, limits.noise])
    how = stepper.coefficients(scheme)
    last = swing_along(mesh.free.static, how, trail, limits.books, books,
                       TOLERANCE + rounding, limits.patience)
    end = min(last + 1, PAST + places.size)
    if not mesh.hangs and (acts := _first_acting(mesh, trail, end)) is not None:
        end = last = acts - 1
        limits.books[:] = known
        for row in range(PAST + 1, last + 1):
            entered(limits.books, trail.energies[row], limits.part, limits.noise)
        if last == PAST:
            return None
    places = np.concatenate([np.full(PAST, np.nan), [now.place], places])
    whole = np.flatnonzero(places[:last + 1] == np.rint(places[:last + 1]))
    whole = whole[whole > PAST].tolist()
    rows = [*whole, *([last] if last > PAST and last not in whole else []),
            *([end] if end > last else [])]
    made = dict(zip(rows, _instants(stepper, now, trail, rows, places[rows], (how, rounding)),
                    strict=True))
    return StepBatch(trail.proofs[PAST + 1:last + 1, 2], [made[row] for row in whole],
               made.get(last, now),
               [(float(trail.times[row]), nodes[row].copy()) for row in (last - 2, last - 1)],
               nodes[PAST + 1:last + 1, stepper.watched], made.get(last + 1))


def _first_acting(mesh: Discretization, trail: Trail, end: int) -> int | None:
    """Return the first row after that of now, up to `end`, where something acts; None: nowhere."""
    nodes, rows = trail.nodes[0], slice(PAST + 1, end + 1)
    found = np.flatnonzero(acting_on(mesh, trail.bends[0, rows], nodes[rows], nodes[PAST:end]))
    return PAST + 1 + int(found[0]) if found.size else None


def set_going(stepper: Stepper, now: TimePoint, brief: Scheme, going: bool) -> TimePoint:
    """Return a TimePoint of a DLO that hangs freely, moving as its grips and forces allow.

    Parameters
    ----------
    brief : Scheme
        Scheme of the very short steps by which that is found.
    going : bool
        Whether its velocities are changed, too; else its accelerations only.
    """
    there = brief.dt / stepper.dt
    trail = _trail(stepper, now.nodes, now.bends,
                   now.place + there * np.array([0.0, 1.0, 0.0, -1.0]))
    set_off(stepper.discretization.free.static, stepper.coefficients(brief, (0.0, 0.0)),
            stepper.coefficients(brief), trail, going, TOLERANCE + stepper.rounding(brief),
            MAX_ITERATIONS)
    nodes, bends = (course[:, PAST].copy() for course in (trail.nodes, trail.bends))
    freeze([nodes, bends])
    kinetic, power = trail.energies[PAST, [2, 4]].tolist()
    return now.changed(nodes=KinematicState.of(nodes), bends=KinematicState.of(bends),
                       kinetic=kinetic, power=power)


def _trail(stepper: Stepper, nodes: KinematicState, bends: KinematicState, places: Floats) -> Trail:
    """Return a Trail at `places` (n,), of which the first is now, with how it moves now."""
    rows, elements = PAST + places.size, len(bends.position)
    times = np.empty(rows)
    times[PAST:] = stepper.dt * places
    grips = stepper.grips.gripper.along(np.concatenate([places[:1]] * PAST + [places]))
    courses = [np.empty((4, rows, *one.position.shape)) for one in (nodes, bends)]
    for course, known in zip(courses, (nodes, bends), strict=True):
        course[:, PAST] = known.arrays
    return Trail(times, *grips, *courses, np.empty((rows, elements + 1, 3, 3)),
                 np.empty((rows, 6)), np.empty((rows, 3)), np.empty(rows, dtype=np.int64),
                 np.empty((rows, 6)))


def _instants(stepper: Stepper, now: TimePoint, trail: Trail, rows: list[int], places: Floats,
              made_by: tuple[Coefficients, float]) -> list[TimePoint]:
    """Return the TimePoints in some rows of a Trail; they keep no memory of many others.

    `made_by`: Coefficients of the steps, and what rounding leaves of their residuals.
    """
    at: Any = rows
    if rows and 2 * len(rows) > trail.times.size and rows[-1] - rows[0] == len(rows) - 1:
        at = slice(rows[0], rows[-1] + 1)  # nothing is copied
    arrays = (trail.nodes[:, at], trail.bends[:, at], trail.frames[at], trail.wrenches[at])
    freeze(arrays)
    energies = trail.energies[rows].tolist()
    known = _Rows(stepper, *arrays, energies, trail.proofs[rows].tolist(),
                  trail.iterations[rows].tolist(), *made_by)
    found = []
    for k, place in enumerate(places.tolist()):
        _, energy, kinetic, work, power, lost = energies[k]
        losses = now.losses.copy()
        losses[0] = lost
        found.append(TimePoint.made(
            place=place, kinetic=kinetic, potential=energy, work=work, power=power, losses=losses,
            touched=False, boxed=partial(_unboxed, known, k, place)))
    return found


class _Rows(NamedTuple):
    """What Shapes and KinematicStates of several TimePoints are made of, as of a Trail."""

    stepper: Stepper
    nodes: Floats
    bends: Floats
    frames: Floats
    wrenches: Floats
    energies: list[list[float]]
    proofs: list[list[float]]
    iterations: list[int]
    how: Coefficients
    rounding: float


def _unboxed(rows: _Rows, k: int, place: float, name: str) -> Any:
    """Return what a TimePoint is asked for the first time, by name; see `TimePoint`."""
    if name == 'positions':
        return rows.nodes[0, k]
    if name == 'velocities':
        return rows.nodes[1, k]
    if name == 'nodes':
        return KinematicState.of(rows.nodes[:, k])
    if name == 'bends':
        return KinematicState.of(rows.bends[:, k])
    stepper, energies, (residual, stability, _) = rows.stepper, rows.energies[k], rows.proofs[k]
    mesh, gripper = stepper.discretization, stepper.grips.gripper.at(place)
    if stability == np.inf:  # it was proved to be good, and no more
        stability = stability_at(mesh.free.static, rows.how, gripper.rotation, gripper.position,
                                 np.array(rows.nodes[:, k]), np.array(rows.bends[:, k]))
    return hanging_shape(mesh, gripper, (
        rows.bends[0, k], rows.frames[k], rows.nodes[0, k], rows.wrenches[k], *energies[:2],
        residual, stability, rows.iterations[k], 0), rows.rounding, unknown)


def stepped(stepper: Stepper, now: TimePoint, past: Sequence[tuple[float, Floats]], place: float,
            scheme: Scheme, limits: Limits) -> StepBatch:
    """Return the StepBatch of one step, of any DLO, as `swung`."""
    after = stepper.step(now, place, scheme, limits.patience)
    here, there = ((each.place * stepper.dt, each.nodes.position) for each in (now, after))
    error = scheme.error(*zip(*past, here, there, strict=True)) if past else 0.0
    energies = np.array([after.shape.elastic_energy, after.potential, after.kinetic,
                         after.work + after.pushed, after.power, after.losses.sum()])
    good = (after.shape.converged
            and (error <= limits.error or after.touched and limits.touched)
            and _pushes_little(now, after, energies, limits)
            and entered(limits.books, energies, limits.part, limits.noise))
    nodes = stepper.watched
    if not good:
        return StepBatch(np.zeros(0), [], now, list(past), np.zeros((0, nodes.size, 3)), after)
    return StepBatch(np.array([error]), [after] if place == round(place) else [], after,
               [*past, here][-2:], after.nodes.position[None, nodes], None)


def _pushes_little(now: TimePoint, after: TimePoint, energies: Floats, limits: Limits) -> bool:
    """Whether the work of contacts along the chords of steps is small.

    That of this step, and the energy that the motion has beyond what it began with, are each at
    most what `integrator.allowed` says.
    """
    push = after.pushed - now.pushed
    excess = after.balance + after.pushed - limits.began
    return push == 0.0 or max(push, excess) <= float(
        allowed(limits.books, energies, limits.part, limits.noise))


_ROUNDING = 1e-17    # of the residual, per inertia's strength relative to elasticity's
_ROUGHEST = 1e-7


class Task(NamedTuple):
    """What a step minimizes: its Problem, both grips, and what rounding leaves of a residual."""

    system: Problem
    gripper: Pose
    far_end: FarEnd | None
    rounding: float


class Stepper:
    """Makes the steps of one DLO in moving grips.

    Parameters
    ----------
    discretization : Discretization
    grips : Grips
    dt : float
        Time step in s, unit of `place`.
    method : str, optional
        One of METHODS, by which steps are minimized; beginnings are by Newton's.
    watched : ndarray, shape (m,) or None, optional
        Nodes whose places are recorded after each step. If None, some.
    """

    def __init__(self, discretization: Discretization, grips: Grips, dt: float,
                 method: str = 'newton', watched: Ints | None = None) -> None:
        self.discretization, self.grips, self.dt = discretization, grips, dt
        self.method = method
        self.watched = sampled(discretization.s) if watched is None else watched
        # whether one kernel makes steps, many at once, as long as nothing acts
        self.swings = (grips.far_end is None and method == 'newton' and discretization.free.hangs)
        rod = discretization.rod
        self.masses = node_masses(rod, discretization.s)
        # of the rod: 0.56 of the period of its slowest vibration, without tip mass
        self.own_time = np.sqrt((self.masses.sum() or 1.0) * rod.length**3
                                 / min(rod.stiffness[1:]))
        self._known: dict[Any, Coefficients] = {}  # of the Schemes so far

    def swings_from(self, now: TimePoint) -> bool:
        """Return whether nothing acts on the DLO at a TimePoint, nor has: then `along` goes on."""
        mesh = self.discretization
        if mesh.hangs or not self.swings:
            return self.swings
        if not now.free:
            return False
        strains, here = now.bends.position[None], now.nodes.position[None]
        return not acting_on(mesh, strains, here, here)[0]

    def step(self, before: TimePoint, place: float, scheme: Scheme,
             patience: int = MAX_ITERATIONS) -> TimePoint:
        """Return the TimePoint at `place`, one step of `scheme` later; converged or not.

        Once the DLO has touched an obstacle its forces may be impulses, of which a scheme that
        carries accelerations along would make energy: from then on steps are an implicit
        Euler's, of first order, which take the energy of impacts and some of vibrations.

        Parameters
        ----------
        patience : int, optional
            Newton steps after which it counts as not solved.
        """
        if scheme.first_order:
            return self._step(before, place, scheme, patience)
        if not (before.touched or before.shape.contacts):
            after = self._step(before, place, scheme, patience)
            if not after.shape.contacts:
                return after
        calm = replace(before, nodes=before.nodes.uniform(), bends=before.bends.uniform())
        euler = Scheme.named('euler', scheme.dt)
        return replace(self._step(calm, place, euler, patience), touched=True)

    def _step(self, before: TimePoint, place: float, scheme: Scheme, patience: int) -> TimePoint:
        if self.swings and self.discretization.hangs:
            leg = self.along(before, (), np.array([place]), scheme, Limits(patience))
            assert leg is not None  # nothing can act
            return leg.last if leg.refused is None else leg.refused
        after = self.step_from(before, place, scheme, self.guess(before, scheme.dt), patience)
        if after.shape.converged:
            return after
        if self.discretization.surroundings.obstacles:
            # from where the DLO is known to be outside of obstacles
            still = before.bends.position.copy()  # a Shape's are read-only, another type
            return self.step_from(before, place, scheme, still, patience)
        # rates change by vibrations too quick for the step, too, which tell nothing of its end
        evenly = before.bends.position + scheme.dt * before.bends.velocity
        return self.step_from(before, place, scheme, evenly, patience)

    def guess(self, before: TimePoint, dt: float) -> Floats:
        """Return the strains (N, 3) with which the search for those dt (s) later begins."""
        bends = before.bends
        if before.touched:  # an impact's acceleration is not the next step's
            return bends.position + dt * bends.velocity
        return bends.position + dt * (bends.velocity + 0.5 * dt * bends.acceleration)

    def step_from(self, before: TimePoint, place: float, scheme: Scheme, guess: Floats,
                  patience: int = MAX_ITERATIONS) -> TimePoint:
        """Return the TimePoint at `place`, for which the search begins with strains (N, 3)."""
        mesh, history, clear = self.discretization, before.shape.state.history, True
        system, gripper, far_end, rounding = self.moving(before.nodes, before.bends, history,
                                                         place, scheme)
        if mesh.surroundings.obstacles:
            clear = self._is_clear(system, before.shape, guess, gripper)
        q = np.empty((mesh.n_unknowns, 3))
        unknowns_of(system, guess, q)
        if self.method == 'newton':
            found = solve(mesh, system, gripper, q, history,
                          Search(patience if clear else 0, rounding=rounding))
        else:
            found = search(system, q, self.method, TOLERANCE + rounding)
        shape = shape_of(mesh, gripper, found, history, far_end, rounding)
        if not shape.converged and (true := settled(found)) is not found:
            shape = shape_of(mesh, gripper, true, history, far_end, rounding)
        shape = replace(shape, state=shape.state.estimating(unknown),
                        converged=shape.converged and clear)
        nodes = scheme.after(before.nodes, shape.positions)
        bends = scheme.after(before.bends, shape.element_strains)
        return self._after(before, place, scheme, replace(
            before, shape=shape, nodes=nodes, bends=bends, kinetic=self.kinetic(nodes.velocity)))

    def along(self, now: TimePoint, past: Sequence[Any], places: Floats, scheme: Scheme,
              limits: Limits) -> StepBatch | None:
        """Return the StepBatch of steps that end at `places` (n,), each the end of one of a Scheme.

        Only where it `swings_from` now. It ends before something acts; None if that is at once.

        Parameters
        ----------
        now : TimePoint
            Where they begin.
        past : sequence
            The last but one and the last pair of a time and node positions before; empty: not
            known, and no local errors.
        limits : Limits
            Until when to go on.
        """
        return swung(self, now, past, places, self.coefficients(scheme), limits)

    def rounding(self, scheme: Scheme) -> float:
        """Return how large a residual rounding errors may leave."""
        return min(_ROUNDING * scheme.stiffness * float(self.own_time**2), _ROUGHEST)

    def coefficients(self, scheme: Scheme, damping: Any = None) -> Coefficients:
        """Return the Coefficients of a Scheme; `damping` if it is not the rod's."""
        damping = self.discretization.rod.damping if damping is None else damping
        known = self._known.get((scheme, damping))
        if known is None:
            known = self._known[scheme, damping] = Coefficients(
                *(float(one) for one in (scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma,
                                         scheme.dt, scheme.stiffness, scheme.velocity_gain,
                                         scheme.third,
                                         *damping)), self.masses)
        return known

    def moving(self, nodes: KinematicState, bends: KinematicState, history: Memory | None,
               place: float,
               scheme: Scheme) -> Task:
        """Return the Task of a step."""
        grips = self.grips.at(place)
        system = self.moving_system(grips, history, (nodes, bends), scheme,
                                    self.discretization.rod.damping)
        return Task(system, *grips, self.rounding(scheme))

    def _is_clear(self, system: Problem, old: Shape, strains: Floats, gripper: Pose) -> bool:
        """Whether nothing is run through by the Shape `old` as it is when the gripper goes on."""
        new, shift = configuration_at(system, strains), gripper.position
        return not sweeps_through(system.scene, system.lengths, old.element_strains.copy(),
                                  old.frames.copy(), old.positions - shift, new.rotations,
                                  new.positions)

    def _after(self, before: TimePoint, place: float, scheme: Scheme,
               there: TimePoint) -> TimePoint:
        """Return the TimePoint `there`, at `place`, with its energy accounted for."""
        shape = there.shape
        power = self.grips.power(place, shape.gripper_wrench, shape.far_wrench,
                                 shape.positions[-1])
        half = 0.5 * scheme.dt
        work = half * (before.power + power)
        if scheme.first_order:  # its forces are the same all the step long
            then = self.grips.power(before.place, shape.gripper_wrench, shape.far_wrench,
                                    shape.positions[-1])
            work = half * (then + power)
        losses = before.losses + (self._damped(before, there, scheme.dt),
                                  shape.dissipated - before.shape.dissipated,
                                  _rubbed(before.shape, shape))
        return replace(there, place=place, potential=shape.energy, work=before.work + work,
                       power=power, losses=losses,
                       pushed=before.pushed + _pushed(before.shape, shape))

    def moving_system(self, grips: tuple[Pose, FarEnd | None], history: Memory | None,
                      courses: tuple[KinematicState, KinematicState], scheme: Scheme,
                      damping: Any) -> Problem:
        """Return the Problem of a step: the static one, with inertia and damping."""
        mesh, (gripper, far_end), (nodes, bends) = self.discretization, grips, courses
        drag, viscosity = damping
        where, velocity = scheme.anchor(nodes)
        strength = scheme.stiffness + drag * scheme.velocity_gain
        anchor = where - drag * velocity / strength - gripper.position
        system = mesh.system(gripper.rotation, gripper.position, history, far_end)
        system = system._replace(anchor=InertiaTerm(anchor, self.masses * strength))
        return system if viscosity == 0.0 else _viscous(system, bends, viscosity, scheme)

    def kinetic(self, velocity: Floats) -> float:
        """Return the kinetic energy, J."""
        return 0.5 * float(self.masses @ np.sum(velocity**2, axis=1))

    def _damped(self, before: TimePoint, there: TimePoint, dt: float) -> float:
        """Return the energy that damping takes at least in a step, J, see `integrator.damped`."""
        damping: Any = self.discretization.rod.damping
        (drag, viscosity), system = damping, self.discretization.static
        moved, bent = (other.position - one.position for one, other in
                       ((before.nodes, there.nodes), (before.bends, there.bends)))
        slow = float(self.masses @ np.sum(moved**2, axis=1))
        quick = float(np.sum(system.lengths[:, None] * system.stiffness * bent**2))
        return float(drag * slow + viscosity * quick) / dt


def _viscous(system: Problem, bends: KinematicState, viscosity: float, scheme: Scheme) -> Problem:
    """Return a Problem with damping of its strains.

    K b u' with u' = rate + velocity_gain (u - bent) is a spring of its own, drawn to where u' = 0.
    """
    bent, rate = scheme.anchor(bends)
    firm = viscosity * scheme.velocity_gain
    calm = bent - rate / scheme.velocity_gain
    if not yields(system.plastic):  # two springs make one
        natural = (system.natural + firm * calm) / (1 + firm)
        return system._replace(natural=natural, stiffness=system.stiffness * (1 + firm))
    # here it is one with what never yields
    elastic = with_couples(system.elastic, firm * system.stiffness * (calm - system.natural))
    return system._replace(elastic=elastic._replace(part=elastic.part + firm))


def _pushed(before: Shape, after: Shape) -> float:
    """Return the work that contacts have done between two Shapes, J, 0 where they took some.

    A force across the end of a chord has a part along it, where the DLO slides on a convex
    obstacle; an impact's takes energy.
    """
    return max(0.0, sum(float(contact.force * (contact.normal @ _moved(before, contact)))
                        for contact in after.contacts))


def _moved(before: Shape, contact: Contact) -> Floats:
    """Return how far the point of a Contact has moved since `before`, (3,), m."""
    moved: Floats = contact.position - before.frame_at(contact.s)[1]
    return moved


def _rubbed(before: Shape, after: Shape) -> float:
    """Return the work done against friction between two Shapes, J."""
    return sum(float(contact.friction @ -_moved(before, contact))
               for contact in after.contacts if contact.friction.any())


_AT_FIRST = 0.1      # of a step: it may be halved yet
_BRIEF = 1e-1, 1e-3  # of a step, of the DLO's own time: how long it is watched
_BRIEFEST = 3e-5     # of that time: of what is watched for less rounding errors would count
_AT_ONCE = 1e-13     # of the length: how exactly grips are kept in so short a time


def begin(stepper: Stepper, shape: Shape, velocity: Floats | None = None) -> TimePoint:
    """Return the TimePoint at time 0 of a DLO that is free to move from now on.

    Its acceleration is what a very short first step, of constant acceleration, finds.

    Parameters
    ----------
    stepper : Stepper
    shape : Shape
    velocity : ndarray, shape (N + 1, 3), optional
        Velocities of the nodes, m/s. If None, at rest.
    """
    strains = np.array(shape.element_strains)
    here = configuration_at(stepper.discretization.system(shape.gripper.rotation), strains)
    positions = here.positions + shape.gripper.position
    rest = np.zeros_like(positions), np.zeros_like(strains)
    nodes, bends = (KinematicState.begun(where, still, still) for where, still in
                    zip((positions, here.strains), rest, strict=True))
    begun = TimePoint(0.0, replace(shape, state=shape.state.estimating(unknown)), nodes, bends,
                    0.0, shape.energy, 0.0, 0.0, np.zeros(3))
    if velocity is not None:
        begun = begun.changed(nodes=replace(nodes, velocity=np.array(velocity)))
    return _let_go(stepper, begun, _AT_FIRST * stepper.dt, velocity is not None)


def renewed(stepper: Stepper, instant: TimePoint, dt: float) -> TimePoint:
    """Return a TimePoint with the velocities and accelerations that its grips and forces allow.

    A scheme that keeps the length by positions alone carries small parts of both along that do not:
    harmless as long as the steps stay the same, not where they change. What that makes wrong is of
    second order in the steps of dt (s) that follow, as the scheme is.
    """
    return _let_go(stepper, instant, dt, True)


def _let_go(stepper: Stepper, instant: TimePoint, dt: float, going: bool) -> TimePoint:
    """Return a TimePoint with the accelerations that grips and forces allow before steps of dt.

    If `going`, with such velocities, too.
    """
    short = max(_BRIEF[0] * dt, _BRIEFEST * stepper.own_time)
    brief = Scheme.named('paper', min(short, _BRIEF[1] * stepper.own_time))
    if stepper.swings_from(instant):
        return set_going(stepper, instant, brief, going)
    watch = _Watch(stepper, brief, instant.place * stepper.dt, instant.shape.state.history)
    nodes, bends = instant.nodes.uniform(), instant.bends.uniform()
    if going:
        nodes, bends = watch.set_going(nodes, bends, nodes.velocity)
    return watch.accelerated(instant, nodes, bends)


class _Watch:
    """Watches a DLO for a very short time, by a Scheme of such steps.

    Parameters
    ----------
    stepper : Stepper
    brief : Scheme
    time : float
        Now, s.
    history : Memory or None
        What the DLO remembers.
    """

    def __init__(self, stepper: Stepper, brief: Scheme, time: float,
                 history: Memory | None) -> None:
        self._stepper, self._brief, self._time, self._history = stepper, brief, time, history

    def accelerated(self, instant: TimePoint, nodes: KinematicState,
                    bends: KinematicState) -> TimePoint:
        """Return a TimePoint with these KinematicStates, and accelerations."""
        stepper, brief = self._stepper, self._brief
        damping: Any = stepper.discretization.rod.damping
        there = self._shortly(nodes, bends, 1.0, damping)
        nodes, bends = (
            KinematicState.begun(one.position, one.velocity, brief.after(one, ahead).acceleration)
            for one, ahead in ((nodes, there.positions), (bends, there.strains)))
        power = stepper.grips.power(instant.place, there.wrench, there.far_wrench,
                                    nodes.position[-1])
        return replace(instant, nodes=nodes, bends=bends, power=power,
                       kinetic=stepper.kinetic(nodes.velocity))

    def set_going(self, nodes: KinematicState, bends: KinematicState,
                  velocity: Floats) -> tuple[KinematicState, KinematicState]:
        """Return KinematicStates with the velocities nearest to `velocity` that the grips allow."""
        # what damps acts against either way: it would not cancel
        ahead, back = (self._shortly(replace(nodes, velocity=sign * velocity), bends.uniform(),
                                     sign, (0.0, 0.0)) for sign in (1.0, -1.0))
        double = 2 * self._brief.dt
        return (replace(nodes, velocity=(ahead.positions - back.positions) / double),
                replace(bends, velocity=(ahead.strains - back.strains) / double))

    def _shortly(self, nodes: KinematicState, bends: KinematicState, sign: float,
                 damping: tuple[float, float]) -> There:
        """Return what is There a very short time later (sign = 1) or before (-1)."""
        stepper, brief = self._stepper, self._brief
        mesh, place = stepper.discretization, (self._time + sign * brief.dt) / stepper.dt
        grips = gripper, _ = stepper.grips.at(place)
        system = stepper.moving_system(grips, self._history, (nodes, bends), brief, damping)
        q = np.empty((mesh.n_unknowns, 3))
        unknowns_of(system, bends.position.copy(), q)
        state = solve(mesh, system, gripper, q, self._history,
                      Search(exact=_AT_ONCE, rounding=stepper.rounding(brief))).state
        return There(state.positions + gripper.position, state.strains,
                     np.concatenate([state.base_force, state.base_moment]), -tip_wrench(state))
