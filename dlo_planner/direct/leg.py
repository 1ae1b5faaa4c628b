# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Several steps of a motion at once, all of one length, and how far each of them is to be trusted.

Of a DLO that hangs freely they are made by one kernel (`swinging`), of others one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dlo_planner.direct.books import allowed, entered
from dlo_planner.direct.culling import acting_on
from dlo_planner.direct.instant import Instant
from dlo_planner.direct.integrator import KinematicState, Scheme
from dlo_planner.direct.proof import CONVERGED
from dlo_planner.direct.resisting import stability_at
from dlo_planner.direct.statics import MAX_ITERATIONS, TOLERANCE, hanging_shape
from dlo_planner.direct.swinging import set_off, swing_along
from dlo_planner.direct.trail import PAST, Coefficients, Trail
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.value import freeze

if TYPE_CHECKING:  # it imports this module
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.stepping import Stepper

MOST = 64  # steps of a leg: after them a deadline is looked at


@dataclass(frozen=True)
class Limits:
    """Until when the steps of a Leg are good.

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
        See `direct.books`, which writes there.
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


class Leg(NamedTuple):
    """What came of steps of one length.

    Attributes
    ----------
    errors : ndarray, shape (k,)
        Local errors of the k good ones, m.
    kept : list of Instant
        Those at 1, 2, 3 ... times the dt of a Stepper.
    last : Instant
        At the end of the last good step.
    past : list
        Pairs of time and node positions: the last but one and the last before that.
    samples : ndarray, shape (k, m, 3)
        Places of some nodes after each good step, see `sampled`.
    refused : Instant or None
        At the end of the step after that, which is not good.
    """

    errors: Floats
    kept: list[Instant]
    last: Instant
    past: list[tuple[float, Floats]]
    samples: Floats
    refused: Instant | None


def leg_of(stepper: Stepper, now: Instant, past: Sequence[tuple[float, Floats]], places: Floats,
           scheme: Scheme, limits: Limits) -> Leg:
    """Return the Leg of steps that end at `places` (n,), or of the first of them alone."""
    if stepper.swings_from(now):
        leg = stepper.along(now, past, places, scheme, limits)
        if leg is not None:
            return leg
    return stepped(stepper, now, past, float(places[0]), scheme, limits)


def sampled(s: Floats) -> Ints:
    """Return the nodes, of those at `s` (n,), that are looked at between two instants."""
    return np.unique(np.linspace(0, s.size - 1, min(s.size, 9)).round().astype(np.int64))


def swung(stepper: Stepper, now: Instant, past: Sequence[tuple[float, Floats]], places: Floats,
          scheme: Scheme, limits: Limits) -> Leg | None:
    """Return the Leg of a DLO that hangs freely, see `Stepper.along`."""
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
    return Leg(trail.proofs[PAST + 1:last + 1, 2], [made[row] for row in whole],
               made.get(last, now),
               [(float(trail.times[row]), nodes[row].copy()) for row in (last - 2, last - 1)],
               nodes[PAST + 1:last + 1, stepper.watched], made.get(last + 1))


def _first_acting(mesh: Discretization, trail: Trail, end: int) -> int | None:
    """Return the first row after that of now, up to `end`, where something acts; None: nowhere."""
    nodes, rows = trail.nodes[0], slice(PAST + 1, end + 1)
    found = np.flatnonzero(acting_on(mesh, trail.bends[0, rows], nodes[rows], nodes[PAST:end]))
    return PAST + 1 + int(found[0]) if found.size else None


def set_going(stepper: Stepper, now: Instant, brief: Scheme, going: bool) -> Instant:
    """Return an Instant of a DLO that hangs freely, moving as its grips and forces allow.

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


def _instants(stepper: Stepper, now: Instant, trail: Trail, rows: list[int], places: Floats,
              made_by: tuple[Coefficients, float]) -> list[Instant]:
    """Return the Instants in some rows of a Trail; they keep no memory of many others.

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
        found.append(Instant.made(
            place=place, kinetic=kinetic, potential=energy, work=work, power=power, losses=losses,
            touched=False, boxed=partial(_unboxed, known, k, place)))
    return found


class _Rows(NamedTuple):
    """What Shapes and KinematicStates of several Instants are made of, as of a Trail."""

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
    """Return what an Instant is asked for the first time, by name; see `Instant`."""
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
        residual, stability, rows.iterations[k], 0), rows.rounding)


def stepped(stepper: Stepper, now: Instant, past: Sequence[tuple[float, Floats]], place: float,
            scheme: Scheme, limits: Limits) -> Leg:
    """Return the Leg of one step, of any DLO, as `swung`."""
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
        return Leg(np.zeros(0), [], now, list(past), np.zeros((0, nodes.size, 3)), after)
    return Leg(np.array([error]), [after] if place == round(place) else [], after,
               [*past, here][-2:], after.nodes.position[None, nodes], None)


def _pushes_little(now: Instant, after: Instant, energies: Floats, limits: Limits) -> bool:
    """Whether the work of contacts along the chords of steps is small.

    That of this step, and the energy that the motion has beyond what it began with, are each at
    most what `books.allowed` says.
    """
    push = after.pushed - now.pushed
    excess = after.balance + after.pushed - limits.began
    return push == 0.0 or max(push, excess) <= float(
        allowed(limits.books, energies, limits.part, limits.noise))
