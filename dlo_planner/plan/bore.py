# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The force that pushes a DLO into a bore with room and friction: an estimate, no bound.

The part inside is a beam that bends little, in a round bore with some room: it lies on the walls
where its weight, its natural bend, or the part outside presses it there. The part outside is
planned as if it ended free of force at the entrance; it yields to the entrance by its compliance.
Where the walls press they rub, and what is before is pushed: this compression bends the beam and
the part outside, which may take it off the walls or press it against them. So the force is sought
as a gripper finds it, pushing harder and harder until the push exceeds what rubs. There may be no
such push: the DLO jams. Not counted are the compression and the weight in the compliance of the
part outside, edges that bite, and torsion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.rod import Surface
from dlo_planner.plan.plan import FOUND, JAMS, NO_BALANCE, NOT_LOOKED_AT

_OUTSIDE = 1e-6     # of the length: nothing is inside yet
_ELEMENTS = 32
_GRADED = 1.5       # power of the places of nodes: they are closest at the entrance
_BAND = 7           # nodes have four unknowns, and act on those of their neighbors
# Walls push back as they did in the search before, and by how much they give way (Hestenes, Powell
# 1969). In the search they are soft, a part of the beam's largest stiffness: along stiff walls what
# bears would go on by one node in a step. They are made stiffer where nodes come back slowly.
_SOFT, _SLOW, _STIFFER = 1e-6, 0.3, 10.0
_WALL = 1e-5        # of the room: how far nodes may be off their places
_WALLS, _HALVINGS = 40, 30  # searches, halvings of a step
_STEPS = 400        # of Newton's method: where the beam buckles it goes far
_SAME = 1e-9        # of the room and what walls give way: a Newton step that is none
_DESCENT, _NOISE = 1e-4, 1e-13  # of what a step promises; of the energy: its rounding errors
_CALM = 2           # steps that promise no more than these: it is the minimum
_ROUNDS, _CLOSE = 60, 1e-4  # of the compression inside; relative
_BOLD = 10          # rounds of it without damping
_ENDLESS = 1e6      # of what rubs without a push: a compression inside that grows so far has no end
_FIRST, _FASTER = 0.1, 1.4  # of what rubs without a push; times: steps in which the push grows
# Of what rubs without a push: what rubs grows at last in proportion to the push (by the part
# outside) or faster (where the beam buckles in the bore). From the first on it jams if the push
# falls behind from step to step, from the second on in any case.
_MORE, _MOST = 4.0, 100.0
_EXACT = 1e-4       # of what rubs without a push: how exactly the force is found


class Push(NamedTuple):
    """The force (N) that pushes a DLO into a bore, and its status, as a Plan has them."""

    force: float
    status: str


class Inside(NamedTuple):
    """The part of a DLO in a bore, as a beam of N elements from the entrance to its tip."""

    lengths: Floats  # (N,) m
    stiffness: Floats  # (N, 2, 2) N m^2, of the second derivatives of the deflections (y, z)
    natural: Floats  # (N, 2) these where it is free of stress, 1/m
    load: Floats  # (N + 1, 3) forces on the nodes along the bore (inwards), y and z, N
    # (4, 4) stiffness of the part outside: force (y, z) in N and moment of slopes (y, z) in N m per
    # deflection in m and slope there
    entrance: Floats
    # (4,) deflections and slopes of its end, free of other forces, per N that pushes it back
    pushed: Floats


def insertion_force(simulator: DirectSimulator, bore: CutOut, friction: float | None,
                    depth: float, outside: Shape) -> Push:
    """Return the Push of a DLO on into a bore; below 0: it falls in by itself.

    Not looked at where the bore's radius or friction is not stated, the DLO does not go into it, or
    its section or load is not a plain one.
    """
    rod, load = simulator.rod, simulator.surroundings.load
    if friction is None or bore.radius is None or callable(load) or (
            Surface.of(rod).half is not None):
        return Push(np.nan, NOT_LOOKED_AT)
    if depth <= _OUTSIDE * rod.length:
        return Push(0.0, FOUND)
    entrance = rod.length - depth
    inside = _inside(simulator, entrance, outside)
    places = entrance + np.append(0.0, np.cumsum(inside.lengths))
    room = bore.radius - rod.radii(np.minimum(places, rod.length))
    return Push(np.nan, NOT_LOOKED_AT) if room.min() <= 0 else pushing(inside, room, friction)


def pushing(inside: Inside, room: Floats, friction: float) -> Push:
    """Return the Push of a beam: the least that exceeds what rubs, as it grows from zero.

    Shapes: room (N + 1,).
    """
    beam, state = beam_of(inside, room), np.zeros(4 * room.size)
    compression, press, wall = np.zeros(room.size), np.zeros((room.size, 2)), np.zeros(1)

    def lacks(push: float) -> float:
        return rubbed(beam, friction, push, state, compression, press, wall) - push

    at_rest = lacks(0.0)
    if at_rest == 0.0 or np.isnan(at_rest):
        return Push(at_rest, NO_BALANCE if np.isnan(at_rest) else FOUND)
    size = abs(at_rest) if np.isfinite(at_rest) else float(np.abs(inside.load).sum())
    sign, push, lack, step = np.sign(at_rest), 0.0, at_rest, _FIRST * size
    while abs(push) <= _MOST * size:
        before, last = push, lack
        push, step = push + sign * step, _FASTER * step
        lack = lacks(push)
        if np.isnan(lack):
            return Push(np.nan, NO_BALANCE)
        if sign * lack <= 0:
            return _between(lacks, before, last, push, lack, _EXACT * size)
        if abs(push) > _MORE * size and not sign * lack < sign * last:
            break
    return Push(np.nan, JAMS)


def _inside(simulator: DirectSimulator, entrance: float, outside: Shape) -> Inside:
    """Return the part Inside behind the arc length of the entrance, m."""
    rod, frame = simulator.rod, outside.frames[-1]
    places = entrance + (rod.length - entrance) * np.linspace(0, 1, _ELEMENTS + 1) ** _GRADED
    lengths = np.diff(places)
    middles = places[:-1] + 0.5 * lengths
    natural = rod.natural_strains(middles)
    # (y, z) are the axes (n, b) at the entrance; a natural twist turns those of the pieces inside
    angle = np.cumsum(natural[:, 0] * lengths) - 0.5 * natural[:, 0] * lengths
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    axes = axes.transpose(2, 0, 1)
    own = np.zeros((_ELEMENTS, 2, 2))
    own[:, 0, 0], own[:, 1, 1] = rod.stiffnesses(middles)[:, [2, 1]].T  # about b it bends along n
    bend = np.column_stack([natural[:, 2], -natural[:, 1]])
    weight: Floats = rod.masses_per_length(middles)[:, None] * simulator.surroundings.gravity
    spread: Any = simulator.surroundings.load  # not a function of s
    if spread is not None:
        weight = weight + spread
    load = np.zeros((_ELEMENTS + 1, 3))
    load[:-1] += 0.5 * lengths[:, None] * weight
    load[1:] += 0.5 * lengths[:, None] * weight
    for s, mass in (*rod.point_masses, (rod.length, rod.tip_mass)):
        if s > entrance:
            load[np.abs(places - s).argmin()] += mass * simulator.surroundings.gravity
    compliance = _compliance(outside)
    return Inside(lengths, axes @ own @ axes.transpose(0, 2, 1),
                  np.einsum('kij,kj->ki', axes, bend), load @ frame,
                  np.array(np.linalg.inv(compliance[:4, :4])), -compliance[:4, 4])


def _compliance(outside: Shape) -> Floats:
    """Return (5, 5): deflections (y, z), slopes (y, z), way along t of the end, per force, moment.

    Of the elements' strains: each turns what lies beyond it.
    """
    assert outside.rod is not None
    end, lengths = outside.frames[-1], np.diff(outside.s)
    s = outside.s[:-1] + 0.5 * lengths
    axes = outside.frames[:-1] @ Rotation.from_rotvec(
        0.5 * lengths[:, None] * outside.element_strains).as_matrix()
    arms = outside.positions[-1] - outside.positions_at(s)
    # a turn w of an element: the end moves by w x arm, its tangent t turns by w x t
    answers = np.empty((s.size, 5, 3))
    for row, axis in ((0, end[:, 1]), (1, end[:, 2]), (4, end[:, 0])):
        answers[:, row] = np.cross(arms, axis)
    answers[:, 2:4] = end[:, 2], -end[:, 1]
    answers = answers @ axes
    parts: Floats = lengths[:, None] / outside.rod.stiffnesses(s)
    result: Floats = np.einsum('kia,ka,kja->ij', answers, parts, answers)
    return result


class Beam(Record):
    """A beam of N elements in a bore; of each node deflections and slopes are unknown."""

    elastic: Floats  # (N, 8, 8) of (y, z, y', z') of both ends: stiffness,
    turn: Floats     # (N, 8, 8) and what a compression of 1 N takes from it
    slope: Floats    # (N + 1, 4) of the energy, at rest
    entrance: Floats    # (4, 4) stiffness of the part outside
    aside: Floats    # (4,) force and moment by which it presses there per N of push
    along: Floats    # (N + 1,) load along the bore, N
    room: Floats     # (N + 1,) m


def beam_of(inside: Inside, room: Floats) -> Beam:
    """Return the Beam of a part Inside; room: (N + 1,) m."""
    count = inside.lengths.size
    bend, turn = _hermite(inside.lengths)
    slope = np.zeros((count + 1, 4))
    moment = np.einsum('kij,kj->ki', inside.stiffness, inside.natural)
    slope[:-1, 2:] += moment  # ends turn by the natural bend
    slope[1:, 2:] -= moment
    slope[:, :2] -= inside.load[:, 1:]
    whole = (count, 8, 8)
    return Beam(np.einsum('kab,kij->kaibj', bend, inside.stiffness).reshape(whole),
                np.einsum('kab,ij->kaibj', turn, np.eye(2)).reshape(whole), slope,
                np.array(inside.entrance), inside.entrance @ inside.pushed,
                np.array(inside.load[:, 0]), np.array(room))


def _between(lacks: Callable[[float], float], low: float, low_lack: float, high: float,
             high_lack: float, exact: float) -> Push:
    """Return the Push between two, of which one is too weak, by false position (Illinois)."""
    for _ in range(_ROUNDS):
        share = 0.5 if np.isinf(low_lack) else low_lack / (low_lack - high_lack)
        push = low + share * (high - low)
        lack = lacks(push)
        if abs(lack) <= exact:
            return Push(push, FOUND)
        if np.isnan(lack):
            break
        if np.sign(lack) == np.sign(low_lack):
            low, low_lack, high_lack = push, lack, 0.5 * high_lack
        else:
            high, high_lack, low_lack = push, lack, 0.5 * low_lack
    return Push(np.nan, NO_BALANCE)


@kernel
def rubbed(beam: Beam, friction: float, push: float, state: Floats, compression: Floats,
           press: Floats, wall: Floats) -> float:
    """Return what a beam under a push (N) at the entrance rubs, less its load along the bore, N.

    Infinite where the compression inside has no end, nan where no balance is found. `state`
    (4 N + 4,), `compression` (N + 1,), forces of the walls `press` (N + 1, 2) and their stiffness
    in the search (1,) begin it, and are renewed.
    """
    deep, along = np.zeros(beam.room.size), beam.along
    least = np.inf  # the total of the first round
    for k in range(_ROUNDS):
        compression[0] = push
        if not _pressed(beam, compression, state, press, wall, deep):
            return np.nan
        # from the tip to the entrance: each node takes what it rubs, and its load along the bore
        total, change, most = 0.0, 0.0, 0.0
        for node in range(along.size - 1, -1, -1):
            total += friction * wall[0] * deep[node] - along[node]
            if node > 0:
                change = max(change, abs(total - compression[node]))
                compression[node] += (1.0 if k < _BOLD else 0.5) * (total - compression[node])
            most = max(most, abs(total))
        if change <= _CLOSE * most:
            return total
        least = min(least, most)
        if most > _ENDLESS * least:
            compression[:] = 0.0
            state[:], press[:], wall[:] = 0.0, 0.0, 0.0
            return np.inf
    return np.nan


@kernel
def _pressed(beam: Beam, compression: Floats, state: Floats, press: Floats, wall: Floats,
             deep: Floats) -> bool:
    """Bring a beam into balance in its bore by augmented Lagrangians; fill the forces `press`."""
    most, last, place = _WALL * np.max(beam.room), np.inf, np.empty(2)
    if wall[0] == 0.0:
        for e in range(beam.elastic.shape[0]):
            for i in range(8):
                wall[0] = max(wall[0], _SOFT * beam.elastic[e, i, i])
    for _ in range(_WALLS):
        if not _balanced(beam, compression, state, press, wall[0], deep):
            return False
        missed = 0.0
        for k in range(beam.room.size):
            away = _beyond(state, press, wall[0], k, place)
            for i in range(2):
                force = wall[0] * deep[k] * place[i] / away if deep[k] > 0.0 else 0.0
                missed = max(missed, abs(force - press[k, i]) / wall[0])
                press[k, i] = force
        if missed <= most:
            return True
        if missed > _SLOW * last:
            wall[0] *= _STIFFER
        last = missed
    return False


@kernel
def _beyond(u: Floats, press: Floats, wall: float, k: int, place: Floats) -> float:
    """Fill the `place` (2,) where a node would be if its walls gave way; return how far it is."""
    for i in range(2):
        place[i] = u[4 * k + i] + press[k, i] / wall
    away: float = np.hypot(place[0], place[1])
    return away


@kernel
def _balanced(beam: Beam, compression: Floats, u: Floats, press: Floats, wall: float,
              deep: Floats) -> bool:
    """Minimize the energy by Newton's method, downhill; return whether it is found."""
    n, room = u.size, np.max(beam.room)
    band, gradient, trial = np.empty((n, _BAND + 1)), np.empty(n), np.empty(n)
    energy, calm = _energy(beam, compression, u, press, wall, gradient, deep), 0
    for _ in range(_STEPS):
        shift = 0.0
        _hessian(beam, compression, u, press, wall, band)
        stiffest = np.max(band[:, 0])
        while not _factorized(band):  # the beam buckles: downhill all the same
            shift = max(10.0 * shift, 1e-12 * stiffest)
            if shift > stiffest:
                return False
            _hessian(beam, compression, u, press, wall, band)
            for i in range(n):
                band[i, 0] += shift
        step = -gradient
        _solve(band, step)
        slope, longest = 0.0, 0.0
        for i in range(n):
            slope += gradient[i] * step[i]
            if i % 4 < 2:
                longest = max(longest, abs(step[i]))
        least = _SAME * (room + np.max(deep))
        part = 1.0
        for _ in range(_HALVINGS):
            for i in range(n):
                trial[i] = u[i] + part * step[i]
            after = _energy(beam, compression, trial, press, wall, gradient, deep)
            if after <= energy + _DESCENT * part * slope + _NOISE * abs(energy):
                break
            part *= 0.5
        u[:] = trial
        energy = after
        calm = calm + 1 if -slope <= _NOISE * abs(energy) else 0
        if longest <= least or calm == _CALM:
            return True
    return False


@kernel
def _energy(beam: Beam, compression: Floats, u: Floats, press: Floats, wall: float,
            gradient: Floats, deep: Floats) -> float:
    """Return the energy in J of deflections and slopes u (4 N + 4,); fill its gradient, `deep`."""
    count, total = beam.room.size, 0.0
    for k in range(count):
        for i in range(4):
            gradient[4 * k + i] = beam.slope[k, i]
    for i in range(4):
        gradient[i] -= beam.aside[i] * compression[0]
    for i in range(u.size):
        total += gradient[i] * u[i]
    for i in range(4):
        for j in range(4):
            force = beam.entrance[i, j] * u[j]
            total += 0.5 * u[i] * force
            gradient[i] += force
    for e in range(count - 1):
        for i in range(8):
            force = 0.0
            for j in range(8):
                force += (beam.elastic[e, i, j] - compression[e + 1] * beam.turn[e, i, j]
                          ) * u[4 * e + j]
            gradient[4 * e + i] += force
            total += 0.5 * u[4 * e + i] * force
    place = np.empty(2)
    for k in range(count):
        away = _beyond(u, press, wall, k, place)
        deep[k] = max(away - beam.room[k], 0.0)
        if deep[k] > 0.0:
            total += 0.5 * wall * deep[k] * deep[k]
            for i in range(2):
                gradient[4 * k + i] += wall * deep[k] * place[i] / away
    return total


@kernel
def _hessian(beam: Beam, compression: Floats, u: Floats, press: Floats, wall: float,
             band: Floats) -> None:
    """Fill the band (n, 8) of second derivatives: column j of row i is that by i and i - j."""
    band[:] = 0.0
    count = beam.room.size
    for i in range(4):
        for j in range(i + 1):
            band[i, i - j] += beam.entrance[i, j]
    for e in range(count - 1):
        for i in range(8):
            for j in range(i + 1):
                band[4 * e + i, i - j] += (beam.elastic[e, i, j]
                                           - compression[e + 1] * beam.turn[e, i, j])
    place = np.empty(2)
    for k in range(count):
        away = _beyond(u, press, wall, k, place)
        y, z = place
        if away > beam.room[k]:
            around = 1.0 - beam.room[k] / away  # along the wall; across it all of the stiffness
            across = (1.0 - around) / (away * away)
            band[4 * k, 0] += wall * (around + across * y * y)
            band[4 * k + 1, 0] += wall * (around + across * z * z)
            band[4 * k + 1, 1] += wall * across * y * z


@kernel
def _factorized(band: Floats) -> bool:
    """Replace a band by its factors L D L'; return whether all of D is positive."""
    for i in range(band.shape[0]):
        first = max(0, i - _BAND)
        for j in range(first, i):
            value = band[i, i - j]
            for k in range(max(first, j - _BAND), j):
                value -= band[i, i - k] * band[j, j - k] * band[k, 0]
            band[i, i - j] = value / band[j, 0]
        for k in range(first, i):
            band[i, 0] -= band[i, i - k] ** 2 * band[k, 0]
        if not band[i, 0] > 0.0:
            return False
    return True


@kernel
def _solve(band: Floats, b: Floats) -> None:
    """Replace b (n,) by the solution, by the factors of `_factorized`."""
    n = b.size
    for i in range(n):
        for k in range(max(0, i - _BAND), i):
            b[i] -= band[i, i - k] * b[k]
    for i in range(n):
        b[i] /= band[i, 0]
    for i in range(n - 1, -1, -1):
        for k in range(max(0, i - _BAND), i):
            b[k] -= band[i, i - k] * b[i]


def _hermite(h: Floats) -> tuple[Floats, Floats]:
    """Return (N, 4, 4) what cubic elements of lengths (N,) need to bend, and to turn."""
    one = np.ones_like(h)
    bend = np.array([[12 * one, 6 * h, -12 * one, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                     [-12 * one, -6 * h, 12 * one, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])
    turn = np.array([[36 * one, 3 * h, -36 * one, 3 * h], [3 * h, 4 * h**2, -3 * h, -h**2],
                     [-36 * one, -3 * h, 36 * one, -3 * h], [3 * h, -h**2, -3 * h, 4 * h**2]])
    return (bend / h**3).transpose(2, 0, 1), (turn / (30 * h)).transpose(2, 0, 1)
