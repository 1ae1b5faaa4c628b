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
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.boundary_motion import BoundaryMotion
from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.direct.equilibrium import acts_at, reach_of, shape_from
from dlo_planner.direct.integrator import (
    AFTER,
    CONTACT_WORK,
    DAMPED,
    DISSIPATED,
    ELASTIC,
    FRICTION_LOSS,
    KINETIC,
    PAST,
    STATIC,
    STRAIGHT,
    WORK,
    Scheme,
    SchemeCoefficients,
    StepBuffer,
    StepOptions,
    account,
    consistent_rates,
    integrate,
    is_good,
    is_straight,
    record_step,
    stability_at,
    step_problem,
)
from dlo_planner.direct.search import EXACT, KEPT, MAX_ITERATIONS, TOLERANCE, minimum_by
from dlo_planner.direct.self_passage import TURNING
from dlo_planner.direct.shape import Shape, State, self_contacts_of
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import configuration_at, unknowns_of
from dlo_planner.energy.problem import Problem
from dlo_planner.geometry.self_passage import first_passage
from dlo_planner.minimize.convergence import accept_by_decrement
from dlo_planner.minimize.solve import Solution
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.holds import spans_along, unreached
from dlo_planner.model.value import Constant, changed, freeze, read_only
from dlo_planner.progress import uninterrupted

MOST = 64            # steps of a batch
_POINTS = 24         # contacts a step for which there is room at first
_ROUNDING = 1e-17    # of the residual, per inertia's strength relative to elasticity's
_ROUGHEST = 1e-7        # the largest that still tells an equilibrium
_BLURRED = 1e-4         # the same where Newton's decrement tells it, as in contact
_FOLLOWED = 0.2      # of the DLO's own time: shorter steps follow vibrations
_AT_FIRST = 0.1      # of a step: it may be halved yet
_BRIEF = 1e-1, 1e-3  # of a step, of the DLO's own time: how long it is watched
_BRIEFEST = 3e-5     # of that time: of what is watched for less rounding errors would count
# Times all forces that are known: one that is larger is that of an impact. Of a steel wire of 12 g
# that stands on its tip it is 1932 N, of one that is 1 nm above the floor 0.004 N.
_STRIKES = 10.0
_AT_ONCE = 1e-13     # of the length: how exactly grips are kept in so short a time
_WRENCHES = 'wrenches', 'hold_wrenches', 'mean_wrenches'
NO_GUESS = np.zeros((0, 3))  # read-only arrays are another type for kernels


class Row(NamedTuple):
    """All that a row of a StepBuffer says of the DLO, under the names there; read-only."""

    nodes: Floats
    bends: Floats
    frames: Floats
    wrenches: Floats
    hold_wrenches: Floats
    mean_wrenches: Floats
    proofs: Floats
    iterations: Any
    evaluations: Any
    energies: Floats
    converged: Any
    impulsive: Any
    after_impact: Any
    reactions: Floats
    plastic: Floats
    node_forces: Floats
    point_of: Ints
    points: Floats
    contact_of: Ints
    contacts: Floats
    rub_of: Ints
    rubs: Floats

    @classmethod
    def of(cls, buffer: StepBuffer, rows: Sequence[int]) -> list[Row]:
        """Return copies of some rows: of many, few are kept."""
        which, table = list(rows), cls._fields[-6:]
        arrays = [np.array(getattr(buffer, name)[:, which].swapaxes(0, 1), order='C')
                  for name in cls._fields[:2]]
        arrays += [getattr(buffer, name)[which] for name in cls._fields[2:-6]]
        tables = [np.array(getattr(buffer, name)) for name in table]
        for array in (*arrays, *tables):  # (what `freeze` does, by a call for each)
            array.flags.writeable = False
        found = []
        for k, row in enumerate(which):
            points, contacts, rubs = (slice(*one[row:row + 2]) for one in buffer.starts)
            found.append(cls(*(array[k] for array in arrays), *(array[points]
                             for array in tables[:2]), *(array[contacts] for array in tables[2:4]),
                             *(array[rubs] for array in tables[4:])))
        return found


@dataclass(frozen=True, eq=False)
class TimePoint:
    """All that the rest of a motion depends on, and what has become of the energy."""

    place: float  # time / dt
    row: Row
    stepper: Stepper
    free: bool                # whether nothing but what acts on all DLOs has acted so far
    how: SchemeCoefficients   # of the step there
    begun: Memory             # what the motion began with
    given: Shape | None = None
    passed: bool = False      # whether the DLO has passed through itself since the motion began

    @cached_property
    def shape(self) -> Shape:
        """The Shape: made when it is asked for, which takes longer than to find it."""
        shape = self.given or self._shape()
        return replace(shape, passed_itself=True) if self.passed else shape

    @property
    def positions(self) -> Floats:
        """(N + 1, 3) of the nodes, m."""
        result: Floats = self.row.nodes[0]
        return result

    @property
    def velocities(self) -> Floats:
        """(N + 1, 3) of the nodes, m/s."""
        result: Floats = self.row.nodes[1]
        return result

    @property
    def idle(self) -> bool:
        """Whether nothing but what acts on all DLOs has left anything that acts."""
        row = self.row
        return self.free or not (len(row.contacts) or row.node_forces.any() or row.plastic.any()
                                 or row.points[:, 0].any())

    @property
    def balance(self) -> float:
        """Energy that is there, less what was put in, plus what was taken out, J."""
        energies = self.row.energies
        given = energies[WORK] + energies[CONTACT_WORK]
        lost = energies[DAMPED:FRICTION_LOSS + 1].sum()
        return float(energies[KINETIC] + energies[STATIC] - given + lost)

    def _shape(self) -> Shape:
        mesh, (gripper, holds), row = (self.stepper.discretization,
                                       self.stepper.grips.at(self.place), self.row)
        residual, stability, _, violation = row.proofs.tolist()
        end = Solution(
            row.bends[0], row.frames, row.nodes[0], row.wrenches, row.hold_wrenches, row.reactions,
            row.plastic, (row.node_forces, row.point_of, row.points),
            (row.contact_of, row.contacts),
            float(row.energies[ELASTIC]), float(row.energies[STATIC]),
            float(row.energies[DISSIPATED]), 0.0, 0.0, bool(row.converged), residual, stability,
            int(row.iterations), 0, violation, False)
        shape = shape_from(mesh, gripper, end, self.begun, holds, self.free,
                           int(row.evaluations))
        if stability == np.inf:  # it was proved to be good, and no more
            shape = replace(shape, stability=stability_at(
                mesh.free, self.how, gripper.rotation, gripper.position, np.array(row.nodes),
                np.array(row.bends)))
        if mesh.touches_itself:
            from dlo_planner.direct.self_contact import (  # noqa: PLC0415  (few need it)
                springs_between,
                stored_between,
            )
            strands = springs_between(mesh, gripper, holds, row.bends[0], row.nodes[0], row.rub_of,
                                      row.rubs)
            touching, _, known = self_contacts_of(mesh.s, row.nodes[0], strands)
            # (what is at rest has no energy in these springs)
            stored = stored_between(mesh, strands, row.nodes[0], row.rubs)
            shape = replace(shape, self_contacts=touching, energy=shape.energy - stored)
        past = shape.state.history if shape.state.history is not self.begun else mesh.start
        if past is not None and mesh.rubs_itself:  # what goes on from here rubs as it does here
            past = changed(past, strands=read_only(known))
        return replace(shape, state=State(mesh, past, past, _NOT_ESTIMATED, self.free))


class Acceptance(NamedTuple):
    """Until when the steps of a StepBatch are good."""

    patience: int = MAX_ITERATIONS  # Newton steps after which a step counts as not solved
    error: float = np.inf           # m, local error of a step
    bearing: float = np.inf         # m, local error of a step where it bears on an obstacle,
    reach: float = np.inf           # m, unless no node moves by more in it
    part: float = 0.0               # of the energy that has moved, which a motion may gain,
    noise: float = np.inf           # and J in addition
    budget: Floats = np.zeros(5)    # as of `integrate`
    began: float = 0.0              # J, balance when the motion began
    damps: bool = False             # whether what is not good otherwise may damp all vibrations


class StepBatch(NamedTuple):
    """What came of steps of one length."""

    errors: Floats           # (k,) local errors of the good ones, m
    kept: list[TimePoint]    # those at 1, 2, 3 ... times the dt of a Stepper
    last: TimePoint          # at the end of the last good step
    past: list[tuple[float, Floats]]  # time and node positions: the last but one, and before
    samples: Floats          # (k, m, 3) places of some nodes after each good step, see `sampled`
    budget: Floats           # (5,) that of Acceptance, renewed
    chosen: float            # place from which on it is bent though nothing said how; or infinity
    refused: TimePoint | None         # at the end of the step after that, which is not good


_NOT_ESTIMATED = Constant(np.inf)  # the error of a shape in motion, by itself


def sampled(s: Floats) -> Ints:
    """Return the nodes, of those at `s` (n,), that are looked at between two instants."""
    return np.unique(np.linspace(0, s.size - 1, min(s.size, 9)).round().astype(np.int64))


class Stepper:
    """Makes the steps of one DLO in moving grips.

    `method` minimizes the steps; beginnings are by Newton's. `watched` (m,) are the nodes whose
    places are recorded after each step; if None, some. `dt` in s is the unit of places.
    """

    nearby = True  # whether a shape near the start of a search is sought first

    def __init__(self, discretization: Discretization, grips: BoundaryMotion, dt: float,
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
        if self.grips.kinds or not mesh.may_hang or not (mesh.hangs or now.idle):
            return False
        return mesh.hangs or not acts_at(mesh, now.row.bends[0], now.positions, now.positions)

    def steps(self, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
              scheme: Scheme, limits: Acceptance, guess: Floats = NO_GUESS) -> StepBatch:
        """Return the StepBatch of steps that end at `places` (n,), each the end of one of a Scheme.

        It may end before that, where something begins to act. The first search begins with the
        strains `guess` (N, 3), if any.
        """
        batch = None
        if self.hangs_from(now):
            batch = self._batch(now, past, places, scheme, limits, guess, True)
        while batch is None:
            batch = self._batch(now, past, places, scheme, limits, guess, False)
            if batch is None:
                self._room *= 4  # for the contacts of a step
        return batch

    def _batch(self, now: TimePoint, past: Sequence[tuple[float, Floats]], places: Floats,
               scheme: Scheme, limits: Acceptance, guess: Floats, culled: bool) -> StepBatch | None:
        """Return the StepBatch, `culled`: without what may act; None: its first step needs more."""
        buffer = self._buffer(np.append(now.place, places), now.row)
        for row, (time, positions) in enumerate(past or [
                (buffer.times[PAST] - k * scheme.dt, now.positions) for k in (2, 1)]):
            buffer.times[row], buffer.nodes[0, row] = time, positions
        how, options = self.coefficients(scheme), self._options(scheme, limits)
        system, budget = self._problem(culled), limits.budget.copy()
        if self.method == 'newton':
            after, impact = (self.coefficients(Scheme(name, scheme.dt))
                             for name in ('annihilating', 'euler'))
            last = uninterrupted(integrate(system, self._full, culled, how, after,
                                           impact, buffer, budget, options, guess))
        else:
            last = self._integrated(system, how, buffer, budget, options, guess)
        stopped = bool(buffer.stopped.any())
        end = last if stopped else min(last + 1, PAST + places.size)
        if stopped and last == PAST:
            return None
        if buffer.stopped[0]:  # the batches that follow need not end before they are full
            self._room = max(self._room, 2 * int(np.diff(buffer.starts[1:]).max()))
        free = now.free and (culled or self.discretization.hangs)

        passed = self._passed(buffer, last, end)
        where = np.concatenate([np.full(PAST, np.nan), [now.place], places])
        kept = [row for row in range(PAST + 1, last + 1) if where[row] == np.rint(where[row])]
        rows = sorted({*kept, *([last] if last > PAST else []), *([end] if end > last else [])})
        instants = {row: TimePoint(float(where[row]), one, self, free, how, now.begun,
                                   passed=now.passed or row > passed)
                    for row, one in zip(rows, Row.of(buffer, rows), strict=True)}
        nodes = buffer.nodes[0]
        return StepBatch(
            buffer.proofs[PAST + 1:last + 1, 2], [instants[row] for row in kept],
            instants[last] if last > PAST else now,
            [(float(buffer.times[row]), nodes[row].copy()) for row in (last - 2, last - 1)],
            nodes[PAST + 1:last + 1, self.watched], budget,
            self._chosen(buffer, last, where),
            instants[end] if end > last else None)

    def _passed(self, buffer: StepBuffer, last: int, end: int) -> int:
        """Return the row after which the DLO passes through itself; `end` if not until `last`."""
        mesh, rows = self.discretization, slice(PAST, last + 1)
        if buffer.energies[rows, ELASTIC].max() > mesh.bending_back:
            steps = first_passage(mesh.free.lengths, buffer.bends[0, rows].copy(),
                                  buffer.frames[rows, 0].copy(), buffer.nodes[0, rows].copy())
            if steps >= 0:
                return PAST + int(steps)
        return end

    def _chosen(self, buffer: StepBuffer, last: int, where: Floats) -> float:
        """Return where a straight DLO first buckles that nothing moves to any side; or infinity.

        Its side, and its wave, are chosen then by the length of the step and by rounding errors:
        nothing that was given tells them. A twist does not: turned by half a turn about its axis,
        what is straight and twisted is the same.
        """
        if not self.grips.kinds:
            return np.inf
        length = self.discretization.s.item(-1)
        most = STRAIGHT * length
        nodes, speeds, times = buffer.nodes[0], buffer.nodes[1], buffer.times
        for row in range(PAST + 1, last + 1):
            now = row - 1
            axis = nodes[now, -1] - nodes[now, 0]
            axis = axis / np.linalg.norm(axis)
            if not is_straight(nodes[now], length):
                return np.inf  # it is bent already
            grips = np.concatenate([buffer.origins[[now, row]], *buffer.targets[[now, row]]])
            drawn = max(_across(axis, grips - nodes[now, 0]),
                        (times[row] - times[now]) * _across(axis, speeds[now] - speeds[now, 0]))
            turned = max(np.abs(one[row, ..., 0] - one[now, ..., 0]).max()  # of the tangents
                         for one in (buffer.bases, buffer.axes))
            symmetric = drawn < most and turned < STRAIGHT and buffer.proofs[now, 0] < _ROUGHEST
            if symmetric and not is_straight(nodes[row], length):
                return float(where[now])
        return np.inf

    def _integrated(self, system: Problem, how: SchemeCoefficients, buffer: StepBuffer,
                    budget: Floats, options: StepOptions, guess: Floats) -> int:
        """Do what `integrator.integrate` does by another `method`, of a DLO that hangs freely."""
        for row in range(PAST + 1, buffer.times.size):
            problem = step_problem(system, how, buffer, row, row - 1, options)
            starts = [_extrapolated(buffer.bends[:, row - 1], how.dt, share) for share in (1, 0)]
            for start in [guess, *starts] if len(guess) and row == PAST + 1 else starts:
                q = np.empty((self.discretization.n_unknowns, 3))
                unknowns_of(problem, start, q)
                found = accept_by_decrement(
                    minimum_by(self.method, problem, q, options.tolerance))
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

        `touched`: whether it has touched an obstacle in a motion that this one continues.
        Its acceleration is what a very short first step, of constant acceleration, finds. Where
        that strikes an obstacle there is none: a column that is pressed along itself buckles in the
        step, under a force that is the larger the shorter it is, and none at time 0.
        """
        mesh, strains = self.discretization, np.array(shape.element_strains)
        here = configuration_at(mesh.system(shape.gripper.rotation), strains)
        nodes, bends = (np.zeros((5, *one.shape)) for one in (here.positions, here.strains))
        nodes[0], bends[0] = here.positions + shape.gripper.position, here.strains
        if velocity is not None:
            nodes[1] = velocity
        energies = np.zeros(8)
        energies[[ELASTIC, STATIC]] = shape.elastic_energy, shape.energy
        left, count = shape.state.history or mesh.start, len(shape.contacts)
        count_of_holds = len(self.grips.kinds)
        known = shape.wrenches if len(shape.holds) == count_of_holds else np.zeros(
            (count_of_holds, 6))  # what was not held at the beginning has exerted nothing yet
        wrench, (gripper, holds) = shape.gripper_wrench, self.grips.at(0.0)
        rubs = self._rubs(left)
        if mesh.touches_itself:  # at rest forces stand beside springs, which may store more
            from dlo_planner.direct.self_contact import (  # noqa: PLC0415
                springs_between,
                stored_between,
            )
            strands = springs_between(mesh, gripper, holds, np.array(here.strains), nodes[0], *rubs)
            energies[STATIC] += stored_between(mesh, strands, nodes[0], rubs[1])
        if mesh.loaded and unreached(holds, gripper, mesh.s.item(-1), True):
            wrench, known = np.nan_to_num(wrench), np.nan_to_num(known)  # see `at_full_length`
        row = Row(nodes, bends, shape.frames, wrench, known,
                  np.zeros((1 + count_of_holds, 6)),
                  np.array([shape.residual, shape.stability, 0.0, shape.violation]),
                  shape.iterations, shape.evaluations, energies, shape.converged, 0, False,
                  left.hold, left.plastic, left.node_force, *left.points,
                  np.zeros((count, 2), dtype=np.int64), np.zeros((count, 15)), *rubs)
        shape = replace(shape, state=replace(shape.state, estimate=_NOT_ESTIMATED))
        now = TimePoint(0.0, row, self, not count and left.idle,
                        self.coefficients(Scheme('paper', 1.0)), left, shape)
        begun, touches = self._with_rates(now, _AT_FIRST * self.dt, velocity is not None)
        if touches and velocity is None and self._strikes(begun, row):
            means = np.concatenate([[row.wrenches], row.hold_wrenches])
            return replace(now, row=row._replace(impulsive=AFTER, mean_wrenches=means))
        return begun

    def _rubs(self, left: Memory) -> tuple[Ints, Floats]:
        """Return the pairs of strands that rub, (c, 2), and `rubs` (c, 4) of a StepBuffer."""
        mesh = self.discretization
        if not mesh.rubs_itself:
            return np.zeros((0, 2), dtype=np.int64), np.zeros((0, 4))
        friction = left.strands[:, 3:5]
        return mesh.pairs_at(left.strands), np.column_stack([friction, np.zeros_like(friction)])

    def _strikes(self, begun: TimePoint, rest: Row) -> bool:
        """Return whether the gripper's force at a beginning is no force of weight and inertia."""
        change = np.abs(begun.row.wrenches[:3] - rest.wrenches[:3]).max()
        weight = np.abs(self.discretization.load).sum() * self.discretization.rod.length
        inertia = self.masses.sum() * np.abs(begun.row.nodes[2]).max()
        return bool(change > _STRIKES * (weight + inertia + np.abs(rest.wrenches[:3]).max()))

    def renewed(self, now: TimePoint, dt: float) -> TimePoint:
        """Return a TimePoint with the velocities and accelerations that its grips and forces allow.

        A scheme that keeps the length by positions alone carries small parts of both along that do
        not: harmless as long as the steps stay the same, not where they change. What that makes
        wrong is of second order in the steps of dt (s) that follow, as the scheme is.
        """
        return self._with_rates(now, dt, True)[0]

    def resized(self, now: TimePoint, dt: float) -> TimePoint:
        """Return a TimePoint from which steps go on that are now of dt (s).

        Where contacts stir it up rates are renewed by the steps themselves, as after an impact.
        """
        if len(now.row.contacts) or now.row.after_impact:
            return replace(now, row=now.row._replace(impulsive=max(now.row.impulsive, AFTER)))
        return self.renewed(now, dt)

    def _with_rates(self, now: TimePoint, dt: float, going: bool) -> tuple[TimePoint, bool]:
        """Return a TimePoint with consistent accelerations; if `going`, velocities, too.

        And whether the DLO touches anything in the time for which it is watched.
        """
        short = max(_BRIEF[0] * dt, _BRIEFEST * self.own_time)
        brief = Scheme('paper', min(short, _BRIEF[1] * self.own_time))
        ahead = brief.dt / self.dt
        buffer = self._buffer(now.place + ahead * np.array([0.0, 1.0, 2.0, 0.0, -1.0]), now.row)
        uninterrupted(consistent_rates(
            self._problem(self.hangs_from(now)), self.coefficients(brief, (0.0, 0.0)),
            self.coefficients(brief), buffer, going,
            self._options(brief, Acceptance(), _AT_ONCE)))
        energies = now.row.energies.copy()
        energies[[KINETIC, WORK]] = buffer.energies[PAST, [KINETIC, WORK]]
        if now.place == 0.0:  # no work is done yet
            energies[WORK] = 0.0
        row = now.row._replace(nodes=buffer.nodes[:, PAST].copy(), energies=energies,
                               bends=buffer.bends[:, PAST].copy(), impulsive=0,
                               **{name: getattr(buffer, name)[PAST].copy() for name in _WRENCHES})
        touches = bool(buffer.starts[1].any())
        if now.place > 0.0 and not len(now.row.contacts) and touches:
            # it lands in that time: what stops it is no force that grips exert all along a step
            row = row._replace(**{name: getattr(now.row, name) for name in _WRENCHES})
        freeze(row)
        return replace(now, row=row, given=now.shape), touches

    # ---- what kernels take ----------------------------------------------------------------------

    def _problem(self, culled: bool = False) -> Problem:
        """Return the Problem at rest, with all that may act if not `culled`."""
        mesh = self.discretization
        if culled:
            return mesh.free
        return self._full if self.grips.kinds or not mesh.hangs else mesh.free

    @cached_property
    def _full(self) -> Problem:
        """The Problem with all that may act, between grips that turn the DLO with strands behind.

        Where these are, the grips of each step tell: the rays are not 0.
        """
        mesh = self.discretization
        ends = [hold for hold in self.grips.kinds if hold.s is None and hold.grip in TURNING]
        if not (mesh.touches_itself and ends):
            return mesh.full
        return mesh.full._replace(rays=np.ones((2, 3)))

    def problem(self, now: TimePoint, place: float, scheme: Scheme) -> Problem:
        """Return the Problem of one step of a Scheme to a place."""
        buffer = self._buffer(np.array([now.place, place]), now.row)
        return step_problem(self._problem(), self.coefficients(scheme), buffer, PAST + 1, PAST,
                            self._options(scheme, Acceptance()))

    def guess(self, now: TimePoint, dt: float) -> Floats:
        """Return the strains (N, 3) with which the search for those dt (s) later begins."""
        return _extrapolated(now.row.bends, dt, 0 if now.row.impulsive else 1)

    def rounding(self, scheme: Scheme) -> float:
        """Return how large a residual rounding errors may leave."""
        return min(self._rounding(scheme), _ROUGHEST)

    def _rounding(self, scheme: Scheme) -> float:
        """Return the same, whether such a residual tells anything or not."""
        return _ROUNDING * self.coefficients(scheme).stiffness * float(self.own_time**2)

    def coefficients(self, scheme: Scheme, damping: Any = None) -> SchemeCoefficients:
        """Return the coefficients of a Scheme; `damping` if it is not the rod's."""
        damping = self.discretization.rod.damping if damping is None else damping
        known = self._known.get((scheme, damping))
        if known is None:
            known = self._known[scheme, damping] = scheme.coefficients(damping, self.masses)
        return known

    def _options(self, scheme: Scheme, limits: Acceptance, exact: float = EXACT) -> StepOptions:
        mesh, left = self.discretization, self._rounding(scheme)
        rounding = min(left, _ROUGHEST)
        return StepOptions(
            TOLERANCE + rounding, rounding, TOLERANCE + min(left, _BLURRED),
            float(exact * mesh.s[-1]), float(KEPT * mesh.s[-1]),
            limits.patience, self.nearby,
            mesh.held_spring if self.grips.kinds else mesh.spring, *self._held,
            float(limits.error), float(limits.bearing), float(limits.reach), limits.part,
            limits.noise, limits.began, limits.damps, scheme.dt < _FOLLOWED * self.own_time,
            mesh.surroundings.self_friction)

    @cached_property
    def _held(self) -> tuple[Ints, Ints, Floats, Bools]:
        """Nodes, rows, shares of Holds, and which of them slide, as of StepOptions."""
        kinds = self.grips.kinds
        return (*self.discretization.held_nodes(kinds),
                np.array([hold.slides for hold in kinds], dtype=bool))

    def _buffer(self, places: Floats, now: Row) -> StepBuffer:
        """Return a StepBuffer at `places` (n,), of which the first is now."""
        rows, mesh = PAST + places.size, self.discretization
        times, many = np.empty(rows), np.concatenate([places[:1]] * PAST + [places])
        times[PAST:] = self.dt * places
        grips = self.grips.gripper.along(many)
        ends = self._holds(many, grips[1])
        courses = [np.empty((5, rows, *one.shape[1:])) for one in (now.nodes, now.bends)]
        for course, one in zip(courses, (now.nodes, now.bends), strict=True):
            course[:, PAST] = one
        frames, energies = np.empty((rows, *now.frames.shape)), np.zeros((rows, 8))
        frames[PAST], energies[PAST] = now.frames, now.energies
        wrenches = []
        for one in (getattr(now, name) for name in _WRENCHES):
            wrenches.append(np.zeros((rows, *one.shape)))
            wrenches[-1][PAST] = one
        proofs, impulsive = np.empty((rows, 4)), np.zeros(rows, dtype=np.int64)
        proofs[PAST] = now.proofs
        after_impact = np.zeros(rows, dtype=bool)
        impulsive[PAST], after_impact[PAST] = now.impulsive, now.after_impact
        # zeros: steps without what may act leave nothing of it
        left = [np.zeros((rows, *shape)) for shape in (
            (ends[2].shape[1],), mesh.start.plastic.shape, mesh.start.node_force.shape)]
        for kept, one in zip(left, (now.reactions, now.plastic, now.node_forces), strict=True):
            if one.shape == kept.shape[1:]:
                kept[PAST] = one
        room = places.size * self._room if mesh.obstructed else 0
        starts = np.zeros((3, rows + 1), dtype=np.int64)
        indices, values = [], []
        for kind, (index, value) in enumerate(((now.point_of, now.points),
                                               (now.contact_of, now.contacts))):
            count = len(value) if mesh.obstructed else 0
            starts[kind, PAST + 1] = count
            indices.append(np.zeros((count + room, 2), dtype=np.int64))
            values.append(np.empty((count + room, *value.shape[1:])))
            indices[-1][:count], values[-1][:count] = index[:count], value[:count]
        count, room = len(now.rubs), places.size * self._room if mesh.rubs_itself else 0
        starts[2, PAST + 1] = count
        rub_of, rubs = np.zeros((count + room, 2), dtype=np.int64), np.zeros((count + room, 4))
        rub_of[:count], rubs[:count] = now.rub_of, now.rubs
        return StepBuffer(
            times, *grips, *ends, *courses, frames, *wrenches, proofs,
            np.zeros(rows, dtype=np.int64), np.zeros(rows, dtype=np.int64), energies,
            np.zeros(rows, dtype=bool), impulsive, after_impact, *left, starts, indices[0],
            values[0], indices[1], values[1], rub_of, rubs, np.zeros(2, dtype=bool))

    def _holds(self, places: Floats, origins: Floats) -> tuple[Floats, ...]:
        """Return targets, axes, rows and reach of Holds at places (n,), grippers at `origins`."""
        mesh, many, kinds = self.discretization, places.size, self.grips.kinds
        if not kinds:
            return (np.zeros((many, 0, 3)), np.zeros((many, 0, 3, 3)), np.zeros((many, 0, 6)),
                    np.full(many, np.inf))
        ways = [path.along(places) for path in self.grips.paths]
        axes, targets = (np.stack(arrays, axis=1) for arrays in zip(*ways, strict=True))
        spans = spans_along(kinds, origins, targets, axes, mesh.s.item(-1))
        return (targets, axes, mesh.grip_rows(kinds, axes),
                np.array([reach_of(mesh, there, True) for there in spans]))


def _across(axis: Floats, ways: Floats) -> float:
    """Return how far ways (n, 3) lead across an axis (3,) at most."""
    return float(np.linalg.norm(np.cross(ways, axis), axis=1).max())


def _extrapolated(course: Floats, dt: float, share: float) -> Floats:
    """Return where a course (5, ...) goes in dt (s), with a `share` of its acceleration."""
    result: Floats = course[0] + dt * (course[1] + share * 0.5 * dt * course[2])
    return result
