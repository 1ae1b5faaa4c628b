# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of a motion: statics with inertia added, Eq. 12, 13 of the paper.

Nodes carry the mass, the strains are the unknowns: the same minimization as in statics, with one
term more. Damping is Rayleigh's: in proportion to mass (drag of a calm surrounding) and to
stiffness (Kelvin and Voigt); neither changes a shape at rest. All DLOs are integrated by one
kernel, `integrator.integrate`, many steps at a time; this file hands it what moves, and hands out
what has become of it: shapes are made of the rows of a StepBuffer when they are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.boundary_motion import Grips
from dlo_planner.direct.contact import contacts_of
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.integrator import (
    DAMPED,
    DISSIPATED,
    ELASTIC,
    KINETIC,
    PAST,
    POWER,
    PUSHED,
    RUBBED,
    STATIC,
    WORK,
    KinematicState,
    Scheme,
    SchemeCoefficients,
    StepBuffer,
    StepOptions,
    account,
    consistent_rates,
    integrate,
    is_good,
    record_step,
    stability_at,
    step_problem,
    within_energy_budget,
)
from dlo_planner.direct.memory import ContactPoints, Memory
from dlo_planner.direct.shape import NO_WRENCH, Shape, State
from dlo_planner.direct.statics import EXACT, KEPT, MAX_ITERATIONS, TOLERANCE, reach_of
from dlo_planner.direct.step import acting
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import configuration_at, unknowns_of
from dlo_planner.energy.problem import Problem
from dlo_planner.minimize.classic import search
from dlo_planner.minimize.convergence import accept_by_decrement
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.supports import FarEnd, held_rows
from dlo_planner.model.value import Constant, freeze

MOST = 64            # steps of a batch: after them a deadline is looked at
_POINTS = 24         # contacts a step for which there is room at first
_ROUNDING = 1e-17    # of the residual, per inertia's strength relative to elasticity's
_ROUGHEST = 1e-7
_AT_FIRST = 0.1      # of a step: it may be halved yet
_BRIEF = 1e-1, 1e-3  # of a step, of the DLO's own time: how long it is watched
_BRIEFEST = 3e-5     # of that time: of what is watched for less rounding errors would count
_AT_ONCE = 1e-13     # of the length: how exactly grips are kept in so short a time
_NO_GUESS = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class TimePoint:
    """All that the rest of a motion depends on, and what has become of the energy.

    Attributes
    ----------
    place : float
        Time / dt.
    energies : ndarray, shape (9,)
        As of a StepBuffer: what is there, and what was put in and taken out so far.
    touched : bool
        Whether the DLO has touched an obstacle.
    rows : _Rows
        What its Shape is made of, when it is asked for.
    k : int
        Which of these rows.
    """

    place: float
    energies: Floats
    touched: bool
    rows: _Rows
    k: int

    @cached_property
    def shape(self) -> Shape:
        """The Shape."""
        return self.rows.shape(self.k, self.place)

    @cached_property
    def nodes(self) -> KinematicState:
        """Motion of the nodes, (N + 1, 3), m."""
        return KinematicState.of(self.rows.nodes[:, self.k])

    @cached_property
    def bends(self) -> KinematicState:
        """Motion of the strains of the elements, (N, 3), 1/m."""
        return KinematicState.of(self.rows.bends[:, self.k])

    @property
    def memory(self) -> StepMemory:
        """What it leaves to the next step."""
        return self.rows.after.one(self.k)

    def with_shape(self, shape: Shape) -> TimePoint:
        """Return the same TimePoint with another Shape."""
        other = replace(self)
        other.__dict__['shape'] = shape
        return other

    @property
    def positions(self) -> Floats:
        """(N + 1, 3) of the nodes, m."""
        result: Floats = self.rows.nodes[0, self.k]
        return result

    @property
    def velocities(self) -> Floats:
        """(N + 1, 3) of the nodes, m/s."""
        result: Floats = self.rows.nodes[1, self.k]
        return result

    @property
    def free(self) -> bool:
        """Whether nothing has acted on the DLO but what acts on all of them."""
        return not self.touched and (self.rows.free or _remembers_nothing(self.shape))

    @property
    def converged(self) -> bool:
        """Whether it is an equilibrium."""
        return bool(self.rows.converged[self.k])

    @property
    def kinetic(self) -> float:
        """Kinetic energy, J."""
        return float(self.energies[KINETIC])

    @property
    def potential(self) -> float:
        """Potential energy, J."""
        return float(self.energies[STATIC])

    @property
    def work(self) -> float:
        """Work done by the grips so far, J."""
        return float(self.energies[WORK])

    @property
    def losses(self) -> Floats:
        """(3,) energy lost to damping, plasticity and friction so far, J."""
        return self.energies[DAMPED:RUBBED + 1]

    @property
    def balance(self) -> float:
        """Energy that is there, less what was put in, plus what was taken out, J."""
        given = self.work + float(self.energies[PUSHED])
        return self.kinetic + self.potential - given + float(self.losses.sum())


class StepMemory(NamedTuple):
    """What k rows of a StepBuffer leave to the next step, in its arrays.

    Attributes
    ----------
    starts : ndarray, shape (k, 2)
        Where the points of contact of each row begin and end, in those of all.
    """

    positions: Floats
    frames: Floats
    reactions: Floats
    plastic: Floats
    node_forces: Floats
    dissipated: Floats
    starts: Ints
    point_of: Ints
    points: Floats

    def one(self, k: int) -> StepMemory:
        """Return that of row k alone."""
        of_row: Any = [part[k:k + 1] for part in self[:-2]] + [self.point_of, self.points]
        return StepMemory(*of_row)


class _Rows(NamedTuple):
    """What Shapes and KinematicStates of k TimePoints are made of, as of a StepBuffer.

    Attributes
    ----------
    stepper : Stepper
    free : bool
        Whether they were made without what may act.
    how : SchemeCoefficients
    dissipated : float
        Energy lost to plasticity before the motion, J.
    contact_starts : ndarray, shape (k, 2)
        Where their contacts begin and end.
    after : StepMemory
        What each of their steps left.
    """

    stepper: Stepper
    free: bool
    how: SchemeCoefficients
    dissipated: float
    nodes: Floats
    bends: Floats
    wrenches: Floats
    end_wrenches: Floats
    proofs: Floats
    iterations: Ints
    evaluations: Ints
    converged: Bools
    energies: Floats
    contact_starts: Ints
    contact_of: Ints
    contacts: Floats
    after: StepMemory

    @classmethod
    def of(cls, stepper: Stepper, buffer: StepBuffer, rows: list[int], free: bool,
           how: SchemeCoefficients, dissipated: float) -> _Rows:
        """Return those of some rows of a StepBuffer; they keep no memory of many others."""
        at: Any = rows
        if rows and 2 * len(rows) > buffer.times.size and rows[-1] - rows[0] == len(rows) - 1:
            at = slice(rows[0], rows[-1] + 1)  # nothing is copied
        starts, used = buffer.starts, buffer.starts[:, max(rows, default=PAST) + 1]
        points = buffer.point_of[:used[0]].copy(), buffer.points[:used[0]].copy()

        def left(where: Any) -> StepMemory:
            return StepMemory(
                buffer.nodes[0, where], buffer.frames[where], buffer.reactions[where],
                buffer.plastic[where], buffer.node_forces[where],
                buffer.energies[where, DISSIPATED],
                np.column_stack([starts[0][where], starts[0][1:][where]]), *points)

        found = cls(
            stepper, free, how, dissipated, buffer.nodes[:, at], buffer.bends[:, at],
            buffer.wrenches[at], buffer.end_wrenches[at], buffer.proofs[at], buffer.iterations[at],
            buffer.evaluations[at], buffer.converged[at], buffer.energies[at],
            np.column_stack([starts[1][at], starts[1][1:][at]]),
            buffer.contact_of[:used[1]].copy(), buffer.contacts[:used[1]].copy(), left(at))
        freeze([found.nodes, found.bends, found.wrenches, found.end_wrenches, found.after.frames,
                found.energies])
        return found

    def one(self, k: int) -> _Rows:
        """Return row k alone."""
        here = slice(k, k + 1)
        return self._replace(
            nodes=self.nodes[:, here], bends=self.bends[:, here],
            after=self.after.one(k),
            **{name: getattr(self, name)[here] for name in (
                'wrenches', 'end_wrenches', 'proofs', 'iterations', 'evaluations', 'converged',
                'energies', 'contact_starts')})

    def memory(self, k: int) -> Memory:
        """Return the Memory that row k left."""
        stepper, part = self.stepper, self.after
        mesh = stepper.discretization
        start = mesh.start
        if mesh.hangs and not stepper.grips.far_end:
            return start
        plastic, hold, force, points = start.plastic, start.hold, start.node_force, start.points
        if not self.free:
            hold = part.reactions[k]
            if mesh.yields:
                plastic = part.plastic[k]
            if mesh.obstructed:
                begin, end = part.starts[k]
                rows, index = part.points[begin:end], part.point_of[begin:end]
                force = part.node_forces[k]
                points = ContactPoints(index[:, 0], index[:, 1], rows[:, 0], rows[:, 1],
                                       *(rows[:, i:i + 3] for i in (2, 5, 8, 11)))
        return Memory(mesh.s, plastic, self.dissipated + float(part.dissipated[k]), hold, force,
                      points, part.positions[k], part.frames[k][:, :, 0], mesh.surroundings)

    def shape(self, k: int, place: float) -> Shape:
        """Return the Shape of row k, which is at a place in time."""
        mesh, (gripper, far_end) = self.stepper.discretization, self.stepper.grips.at(place)
        residual, stability, _, violation = self.proofs[k].tolist()
        if stability == np.inf:  # it was proved to be good, and no more
            stability = stability_at(mesh.free, self.how, gripper.rotation, gripper.position,
                                     np.array(self.nodes[:, k]), np.array(self.bends[:, k]))
        begin, end = self.contact_starts[k]
        rows, index = self.contacts[begin:end], self.contact_of[begin:end]
        contacts = contacts_of(mesh.s, (
            index[:, 0], index[:, 1], rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7],
            rows[:, 8:11], rows[:, 11]), gripper.position)
        memory = self.memory(k)
        return Shape(
            gripper, mesh.s, self.nodes[0, k], self.after.frames[k], self.bends[0, k],
            float(self.energies[k, STATIC]), float(self.energies[k, ELASTIC]), self.wrenches[k],
            residual, stability, int(self.iterations[k]), bool(self.converged[k]),
            contacts=contacts, evaluations=int(self.evaluations[k]), violation=violation,
            far_end=far_end,
            far_wrench=NO_WRENCH if far_end is None else self.end_wrenches[k],
            dissipated=memory.dissipated,
            state=State(mesh, memory, memory, _NOT_ESTIMATED, self.free))


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
    budget : ndarray, shape (5,)
        See `integrator.integrate`, which writes there.
    touched : bool
        Whether a step may have any error once the DLO has touched an obstacle.
    began : float
        Balance when the motion began, J.
    """

    patience: int = MAX_ITERATIONS
    error: float = np.inf
    part: float = 0.0
    noise: float = np.inf
    budget: Floats = field(default_factory=lambda: np.zeros(5))
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


_NOT_ESTIMATED = Constant(np.inf)  # by itself


def _remembers_nothing(shape: Shape) -> bool:
    """Return whether a Shape touches nothing and has no past that acts on the next step."""
    known = shape.state.history
    return not shape.contacts and (known is None or known.idle)


def sampled(s: Floats) -> Ints:
    """Return the nodes, of those at `s` (n,), that are looked at between two instants."""
    return np.unique(np.linspace(0, s.size - 1, min(s.size, 9)).round().astype(np.int64))


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

    nearby = True  # whether a shape near the start of a search is sought first

    def __init__(self, discretization: Discretization, grips: Grips, dt: float,
                 method: str = 'newton', watched: Ints | None = None) -> None:
        self.discretization, self.grips, self.dt = discretization, grips, dt
        self.method = method
        self.watched = sampled(discretization.s) if watched is None else watched
        rod = discretization.rod
        self.masses = node_masses(rod, discretization.s)
        # of the rod: 0.56 of the period of its slowest vibration, without tip mass
        self.own_time = np.sqrt((self.masses.sum() or 1.0) * rod.length**3
                                 / min(rod.stiffness[1:]))
        self._known: dict[Any, SchemeCoefficients] = {}  # of the Schemes so far
        self._room = _POINTS

    # ---- steps ----------------------------------------------------------------------------------

    def hangs_from(self, now: TimePoint) -> bool:
        """Return whether nothing that may act does so at a TimePoint, nor has."""
        mesh = self.discretization
        if self.grips.far_end is not None or not mesh.may_hang:
            return False
        if mesh.hangs:
            return True
        if not now.free:
            return False
        strains, here = now.bends.position[None], now.nodes.position[None]
        return not acting(mesh, strains, here, here)[0]

    def steps(self, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
              scheme: Scheme, limits: Limits) -> StepBatch:
        """Return the StepBatch of steps that end at `places` (n,), each the end of one of a Scheme.

        It may end before that, where something begins to act.
        """
        return self.steps_from(now, past, places, scheme, limits, _NO_GUESS)

    def steps_from(self, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
                   scheme: Scheme, limits: Limits, guess: Floats) -> StepBatch:
        """Do what `steps` does; the first search begins with the strains `guess` (N, 3), if any."""
        if self.hangs_from(now):
            batch = self._batch(now, past, places, scheme, limits, guess, True)
            if batch is not None:
                return batch
        while True:
            batch = self._batch(now, past, places, scheme, limits, guess, False)
            if batch is not None:
                return batch
            self._room *= 4  # for the contacts of a step

    def _batch(self, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
               scheme: Scheme, limits: Limits, guess: Floats, free: bool) -> StepBatch | None:
        """Return the StepBatch, `free`: without what may act; None: its first step needs more."""
        mesh, known = self.discretization, limits.budget.copy()
        buffer = self._buffer(np.append(now.place, places), now.nodes, now.bends, now.memory)
        for row, (time, positions) in enumerate(past or [
                (buffer.times[PAST] - k * scheme.dt, now.nodes.position) for k in (2, 1)]):
            buffer.times[row], buffer.nodes[0, row] = time, positions
        buffer.energies[PAST], buffer.touched[PAST] = now.energies, now.touched
        if scheme.gamma != 1.0 and np.diff(now.rows.contact_starts[now.k])[0]:
            buffer.touched[PAST] = True
        how, options = self.coefficients(scheme), self._options(scheme, limits)
        system = mesh.free if free else self._problem
        if self.method == 'newton':
            impact = self.coefficients(Scheme.named('euler', scheme.dt))
            last = integrate(system, how, impact, buffer, limits.budget, options, guess)
        else:
            last = self._integrated(system, how, buffer, limits.budget, options, guess)
        end = min(last + 1, PAST + places.size)
        if free and not mesh.hangs and (acts := _first_acting(mesh, buffer, end)) is not None:
            end = last = acts - 1
            limits.budget[:] = known
            for row in range(PAST + 1, last + 1):
                within_energy_budget(limits.budget, buffer.energies[row], limits.part, limits.noise)
        if buffer.full[0]:
            end = last
        if last == end == PAST:
            return None
        where = np.concatenate([np.full(PAST, np.nan), [now.place], places])
        whole = np.flatnonzero(where[:last + 1] == np.rint(where[:last + 1]))
        whole = whole[whole > PAST].tolist()
        rows = [*whole, *([last] if last > PAST and last not in whole else []),
                *([end] if end > last else [])]
        kept = _Rows.of(self, buffer, rows, free, how, now.rows.dissipated)
        made = {row: TimePoint(float(where[row]), kept.energies[k], bool(buffer.touched[row]), kept,
                               k) for k, row in enumerate(rows)}
        nodes = buffer.nodes[0]
        return StepBatch(
            buffer.proofs[PAST + 1:last + 1, 2], [made[row] for row in whole], made.get(last, now),
            [(float(buffer.times[row]), nodes[row].copy()) for row in (last - 2, last - 1)],
            nodes[PAST + 1:last + 1, self.watched], made.get(last + 1))

    def _integrated(self, system: Problem, how: SchemeCoefficients, buffer: StepBuffer,
                    budget: Floats, options: StepOptions, guess: Floats) -> int:
        """Do what `integrator.integrate` does by another `method`, of a DLO that hangs freely."""
        for row in range(PAST + 1, buffer.times.size):
            problem = step_problem(system, how, buffer, row, row - 1, options)
            starts = [_extrapolated(buffer.bends[:, row - 1], how.dt, share) for share in (1, 0)]
            for start in [guess, *starts] if len(guess) and row == PAST + 1 else starts:
                q = np.empty((self.discretization.n_unknowns, 3))
                unknowns_of(problem, start, q)
                found = accept_by_decrement(search(problem, q, self.method, options.tolerance))
                converged = record_step(how, problem, found.state, buffer, row, row - 1,
                                        float(found.residual), float(found.stability),
                                        found.iterations, 0.0, options)
                buffer.evaluations[row] = found.evaluations
                if converged:
                    break
            account(system, how, how, buffer, row, options)
            if not (converged and is_good(buffer, row, budget, options)):
                return row - 1
        return int(buffer.times.size) - 1

    # ---- how a motion begins --------------------------------------------------------------------

    def begin(self, shape: Shape, velocity: Floats | None = None) -> TimePoint:
        """Return the TimePoint at time 0 of a DLO that is free to move from now on.

        Its acceleration is what a very short first step, of constant acceleration, finds.

        Shapes: velocity (N + 1, 3).
        """
        mesh, strains = self.discretization, np.array(shape.element_strains)
        here = configuration_at(mesh.system(shape.gripper.rotation), strains)
        nodes, bends = (np.zeros((4, 1, *one.shape)) for one in (here.positions, here.strains))
        nodes[0, 0], bends[0, 0] = here.positions + shape.gripper.position, here.strains
        if velocity is not None:
            nodes[1, 0] = velocity
        energies = np.zeros(9)
        energies[[ELASTIC, STATIC]] = shape.elastic_energy, shape.energy
        rows = self._begun(shape, nodes, bends, energies)
        shape = replace(shape, state=replace(shape.state, estimate=_NOT_ESTIMATED))
        now = TimePoint(0.0, energies, False, rows, 0).with_shape(shape)
        return self._with_rates(now, _AT_FIRST * self.dt, velocity is not None)

    def renewed(self, now: TimePoint, dt: float) -> TimePoint:
        """Return a TimePoint with the velocities and accelerations that its grips and forces allow.

        A scheme that keeps the length by positions alone carries small parts of both along that do
        not: harmless as long as the steps stay the same, not where they change. What that makes
        wrong is of second order in the steps of dt (s) that follow, as the scheme is.
        """
        return self._with_rates(now, dt, True)

    def _with_rates(self, now: TimePoint, dt: float, going: bool) -> TimePoint:
        """Return a TimePoint with consistent accelerations; if `going`, velocities, too."""
        short = max(_BRIEF[0] * dt, _BRIEFEST * self.own_time)
        brief = Scheme.named('paper', min(short, _BRIEF[1] * self.own_time))
        ahead = brief.dt / self.dt
        free = self.hangs_from(now)
        buffer = self._buffer(now.place + ahead * np.array([0.0, 1.0, 0.0, -1.0]), now.nodes,
                              now.bends, now.memory)
        buffer.energies[PAST] = now.energies
        options = self._options(brief, Limits(), _AT_ONCE)
        consistent_rates(self.discretization.free if free else self._problem,
                         self.coefficients(brief, (0.0, 0.0)), self.coefficients(brief), buffer,
                         going, options)
        nodes, bends = (one[:, PAST:PAST + 1].copy() for one in (buffer.nodes, buffer.bends))
        energies = now.energies.copy()
        energies[[KINETIC, POWER]] = buffer.energies[PAST, [KINETIC, POWER]]
        freeze([nodes, bends, energies])
        rows = now.rows.one(now.k)._replace(nodes=nodes, bends=bends, energies=energies[None])
        return TimePoint(now.place, energies, now.touched, rows, 0).with_shape(now.shape)

    def _begun(self, shape: Shape, nodes: Floats, bends: Floats, energies: Floats) -> _Rows:
        """Return the row of a Shape with which a motion begins."""
        left = shape.state.history or self.discretization.start
        index, points = np.column_stack(left.points[:2]), np.column_stack(left.points[2:])
        ends = np.array([[0, len(points)]])
        after = StepMemory(nodes[0], np.array(shape.frames)[None], left.hold[None],
                           left.plastic[None], left.node_force[None], np.zeros(1), ends, index,
                           points)
        count = len(shape.contacts)
        return _Rows(self, _remembers_nothing(shape), self.coefficients(Scheme.named('paper', 1.0)),
                     left.dissipated, nodes, bends, np.array(shape.gripper_wrench)[None],
                     np.array(shape.far_wrench)[None],
                     np.array([[shape.residual, shape.stability, 0.0, shape.violation]]),
                     np.array([shape.iterations]), np.array([shape.evaluations]),
                     np.array([shape.converged]), energies[None],
                     np.array([[0, count]]), np.zeros((count, 2), dtype=np.int64),
                     np.zeros((count, 12)), after)

    # ---- what kernels take ----------------------------------------------------------------------

    @cached_property
    def _problem(self) -> Problem:
        """The Problem at rest with all that may act."""
        mesh = self.discretization
        return mesh.static if self.grips.far_end is None else mesh.full

    def problem(self, nodes: KinematicState, bends: KinematicState, memory: StepMemory,
                place: float, scheme: Scheme) -> Problem:
        """Return the Problem of one step of a Scheme to a place."""
        buffer = self._buffer(np.array([place, place]), nodes, bends, memory)
        result: Problem = step_problem(self._problem, self.coefficients(scheme), buffer, PAST + 1,
                                       PAST, self._options(scheme, Limits()))
        return result

    def guess(self, now: TimePoint, dt: float) -> Floats:
        """Return the strains (N, 3) with which the search for those dt (s) later begins."""
        return _extrapolated(np.array(now.bends.arrays), dt, 0 if now.touched else 1)

    def rounding(self, scheme: Scheme) -> float:
        """Return how large a residual rounding errors may leave."""
        return min(_ROUNDING * scheme.stiffness * float(self.own_time**2), _ROUGHEST)

    def coefficients(self, scheme: Scheme, damping: Any = None) -> SchemeCoefficients:
        """Return the coefficients of a Scheme; `damping` if it is not the rod's."""
        damping = self.discretization.rod.damping if damping is None else damping
        known = self._known.get((scheme, damping))
        if known is None:
            known = self._known[scheme, damping] = scheme.coefficients(damping, self.masses)
        return known

    def _options(self, scheme: Scheme, limits: Limits, exact: float = EXACT) -> StepOptions:
        mesh, rounding = self.discretization, self.rounding(scheme)
        end = self._far_end
        share = np.zeros(3) if end is None else end.share
        return StepOptions(
            TOLERANCE + rounding, rounding, float(exact * mesh.s[-1]), float(KEPT * mesh.s[-1]),
            limits.patience, self.nearby, mesh.spring if end is None else mesh.held_spring, share,
            end is not None and end.grip == 'sleeve', float(limits.error), limits.part,
            limits.noise, limits.began, limits.touched)

    @cached_property
    def _far_end(self) -> FarEnd | None:
        """The FarEnd at time 0."""
        return self.grips.at(0.0)[1]

    def _buffer(self, places: Floats, nodes: KinematicState, bends: KinematicState,
                memory: StepMemory) -> StepBuffer:
        """Return a StepBuffer at `places` (n,), of which the first is now, where it is known."""
        rows, mesh = PAST + places.size, self.discretization
        elements, times = len(bends.position), np.empty(PAST + places.size)
        times[PAST:] = self.dt * places
        many = np.concatenate([places[:1]] * PAST + [places])
        grips = self.grips.gripper.along(many)
        ends = self._ends(many, grips[1])
        courses = [np.empty((4, rows, *one.position.shape)) for one in (nodes, bends)]
        for course, one in zip(courses, (nodes, bends), strict=True):
            course[:, PAST] = one.arrays
        frames, plastic = np.empty((rows, elements + 1, 3, 3)), mesh.start.plastic
        frames[PAST] = memory.frames[0]
        held = ends[3].shape[1]
        # zeros: steps without what may act leave nothing of it
        reactions, sets = np.zeros((rows, held)), np.zeros((rows, *plastic.shape))
        node_forces = np.zeros((rows, *mesh.start.node_force.shape))
        for kept, array in ((reactions, memory.reactions), (sets, memory.plastic),
                            (node_forces, memory.node_forces)):
            if array.shape[1:] == kept.shape[1:]:
                kept[PAST] = array[0]
        begin, end = memory.starts[0]
        count = end - begin
        room = count + places.size * self._room if mesh.obstructed else 0
        starts = np.zeros((2, rows + 1), dtype=np.int64)
        starts[0, PAST + 1] = count
        index, points = np.zeros((room, 2), dtype=np.int64), np.empty((room, 14))
        if mesh.obstructed:
            index[:count], points[:count] = memory.point_of[begin:end], memory.points[begin:end]
        return StepBuffer(
            times, *grips, *ends, *courses, frames, np.empty((rows, 6)), np.zeros((rows, 6)),
            np.empty((rows, 4)), np.zeros(rows, dtype=np.int64), np.zeros(rows, dtype=np.int64),
            np.zeros((rows, 9)), np.zeros(rows, dtype=bool), np.zeros(rows, dtype=bool), reactions,
            sets, node_forces, starts, index, points, np.zeros((room, 2), dtype=np.int64),
            np.empty((room, 12)), np.zeros(1, dtype=bool))

    def _ends(self, places: Floats, origins: Floats) -> tuple[Floats, ...]:
        """Return targets, axes, twists, rows and reach of the far end's grip at places (n,)."""
        mesh, many, end = self.discretization, places.size, self._far_end
        if self.grips.far_end is None or end is None:
            return (np.zeros((many, 3)), np.zeros((many, 3, 3)), np.zeros((many, 6)),
                    np.zeros((many, 0, 6)), np.full(many, np.inf))
        axes, targets, twists = self.grips.far_end.along(places)
        held = np.array([held_rows(end.grip, one) for one in axes])
        held[:, :, :3] *= mesh.lever
        away = targets - origins
        if end.grip == 'sleeve':
            along = axes[:, :, 0]
            away = away - np.sum(away * along, axis=1)[:, None] * along
        return targets, axes, twists, held, reach_of(mesh, np.linalg.norm(away, axis=1))


def _first_acting(mesh: Discretization, buffer: StepBuffer, end: int) -> int | None:
    """Return the first row after that of now, up to `end`, where something acts; None: nowhere."""
    nodes, rows = buffer.nodes[0], slice(PAST + 1, end + 1)
    found = np.flatnonzero(acting(mesh, buffer.bends[0, rows], nodes[rows], nodes[PAST:end]))
    return PAST + 1 + int(found[0]) if found.size else None


def _extrapolated(course: Floats, dt: float, share: float) -> Floats:
    """Return where a course (4, ...) goes in dt (s), with a `share` of its acceleration."""
    result: Floats = course[0] + dt * (course[1] + share * 0.5 * dt * course[2])
    return result
