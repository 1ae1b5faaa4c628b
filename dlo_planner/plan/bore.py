# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The force that pushes a DLO into a bore with room and friction: an estimate, no bound.

The part inside is a beam that bends little, in a round bore with some room: it lies on the walls
where its weight, its natural bend, or the part outside presses it there. The part outside is
planned as if it ended free of force at the mouth; it yields to the mouth by its compliance. Where
the walls press they rub, so that what is before is pushed: this compression bends the beam and the
part outside more (a fixed point). Not counted are the compression and the weight in the compliance
of the part outside, edges that bite, and torsion.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dlo_planner.blas import one_thread
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.rod import Surface

_OUTSIDE = 1e-6     # of the length: nothing is inside yet
_ELEMENTS = 32
_GRADED = 1.5       # power of the places of nodes: they are closest at the mouth
# Nodes would go to and fro between the sides of a stiff wall: walls begin soft, a part of the
# beam's largest stiffness, and are made stiffer from balance to balance. A beam that is much bent
# enters them far, and comes back by one room in a step.
_SOFT = 1e-6
_WALL = 1e-5        # of the room: how far walls give way
_STIFFER = 10.0     # times: walls that give way more are made so
_WALLS, _STEPS = 18, 600  # of such walls, of Newton steps
_SAME = 1e-9        # of the energy's slope
_ROUNDS, _CLOSE = 60, 1e-3  # of the fixed point; relative
_BOLD = 10          # rounds of it without damping


class Inside(NamedTuple):
    """The part of a DLO in a bore, as a beam of N elements from the mouth to its tip."""

    lengths: Floats  # (N,) m
    stiffness: Floats  # (N, 2, 2) N m^2, of the second derivatives of the deflections (y, z)
    natural: Floats  # (N, 2) these where it is free of stress, 1/m
    load: Floats  # (N + 1, 3) forces on the nodes along the bore (inwards), y and z, N
    # (4, 4) stiffness of the part outside: force (y, z) in N and moment of slopes (y, z) in N m per
    # deflection in m and slope there
    mouth: Floats
    # (4,) deflections and slopes of its end, free of other forces, per N that pushes it back
    pushed: Floats


def insertion_force(simulator: DirectSimulator, bore: CutOut, friction: float | None,
                    depth: float, outside: Shape) -> float:
    """Return the force in N that pushes a DLO on into a bore; below 0: it falls in by itself.

    nan where the bore's radius or friction is not stated, the DLO does not go into it, its section
    or load is not a plain one, or no balance is found (it may jam).
    """
    rod, load = simulator.rod, simulator.surroundings.load
    if friction is None or bore.radius is None or callable(load) or (
            Surface.of(rod).half is not None):
        return np.nan
    if depth <= _OUTSIDE * rod.length:
        return 0.0
    mouth = rod.length - depth
    inside = _inside(simulator, mouth, outside)
    places = mouth + np.append(0.0, np.cumsum(inside.lengths))
    room = bore.radius - rod.radii(np.minimum(places, rod.length))
    return np.nan if room.min() <= 0 else pushing(inside, room, friction)


@one_thread()
def pushing(inside: Inside, room: Floats, friction: float) -> float:
    """Return the force in N at the mouth that pushes a beam on; nan if no balance is found.

    Shapes: room (N + 1,).
    """
    force, beam = np.zeros(room.size), _Beam(inside, room)
    for k in range(_ROUNDS):
        wall = beam.walls(force)
        if wall is None:
            return np.nan
        # from the tip to the mouth: each node takes what it rubs, and its load along the bore
        now = np.cumsum((friction * wall - inside.load[:, 0])[::-1])[::-1]
        if abs(now[0] - force[0]) <= _CLOSE * np.abs(now).max():
            return float(now[0])
        force = force + (1.0 if k < _BOLD else 0.5) * (now - force)
    return np.nan


def _inside(simulator: DirectSimulator, mouth: float, outside: Shape) -> Inside:
    """Return the part Inside behind the arc length of the mouth, m."""
    rod, frame = simulator.rod, outside.frames[-1]
    places = mouth + (rod.length - mouth) * np.linspace(0, 1, _ELEMENTS + 1) ** _GRADED
    lengths = np.diff(places)
    middles = places[:-1] + 0.5 * lengths
    natural = rod.natural_strains(middles)
    # (y, z) are the axes (n, b) at the mouth; a natural twist turns those of the pieces inside
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
        if s > mouth:
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
    frame, s = outside.frames[-1], 0.5 * (outside.s[1:] + outside.s[:-1])
    total = np.zeros((5, 5))
    for place, length, stiffness in zip(s, np.diff(outside.s), outside.rod.stiffnesses(s),
                                        strict=True):
        axes, position = outside.frame_at(place)
        arm = outside.positions[-1] - position
        # a turn w of this element: the end moves by w x arm, its tangent t turns by w x t
        answers = np.array([np.cross(arm, frame[:, 1]), np.cross(arm, frame[:, 2]),
                            frame[:, 2], -frame[:, 1], np.cross(arm, frame[:, 0])]) @ axes
        total += length * answers @ np.diag(1 / stiffness) @ answers.T
    return total


class _Beam:
    """A beam in a bore; of each node deflections and slopes are unknown: (y, z, y', z')."""

    def __init__(self, inside: Inside, room: Floats) -> None:
        self._inside, self._room, count = inside, room, inside.lengths.size
        self._deflections = np.arange(count + 1)[:, None] * 4 + [0, 1]
        own = np.arange(count)[:, None, None, None] * 4 + np.arange(8).reshape(4, 2)[:, :, None]
        rows = own.transpose(0, 1, 3, 2).reshape(count, 4, 2)
        self._places = (np.repeat(rows.reshape(count, 8), 8, axis=1).ravel(),
                        np.tile(rows.reshape(count, 8), (1, 8)).ravel())
        bend, self._turn = _hermite(inside.lengths)
        self._stiff = np.einsum('kab,kij->kaibj', bend, inside.stiffness).reshape(count, -1)
        self._slope = np.zeros((count + 1, 4))
        moment = np.einsum('kij,kj->ki', inside.stiffness, inside.natural)
        self._slope[:-1, 2:] += moment  # ends turn by the natural bend
        self._slope[1:, 2:] -= moment
        self._slope[:, :2] -= inside.load[:, 1:]
        self._u, self._wall = np.zeros(4 * count + 4), 0.0

    def walls(self, force: Floats) -> Floats | None:
        """Return the forces (N + 1,) of the walls under a push (N + 1,), N; None: not found."""
        matrix, slope = self._pushed(force)
        self._wall = self._wall or _SOFT * np.abs(np.diag(matrix)).max()
        for _ in range(_WALLS):
            deep = self._balanced(matrix, slope)
            if deep is None or deep.max() <= _WALL * self._room.max():
                return None if deep is None else np.array(self._wall * deep)
            self._wall *= _STIFFER
        return None

    def _balanced(self, matrix: Floats, slope: Floats) -> Floats | None:
        """Return how deep (N + 1,) the beam lies in its walls by Newton's method, or None."""
        places, room, wall = self._deflections, self._room, self._wall
        for _ in range(_STEPS):
            at = self._u[places]
            away = np.linalg.norm(at, axis=1)
            deep = np.maximum(away - room, 0.0)
            normal = at / np.maximum(away, 1e-300)[:, None]
            gradient, hessian = matrix @ self._u + slope, matrix.copy()
            gradient[places] += wall * deep[:, None] * normal
            out = np.einsum('ki,kj->kij', normal, normal)
            round_it = (deep / np.maximum(away, 1e-300))[:, None, None] * (np.eye(2) - out)
            hessian[places[:, :, None], places[:, None, :]] += wall * (
                (deep > 0)[:, None, None] * out + round_it)
            try:
                step = -np.linalg.solve(hessian, gradient)
            except np.linalg.LinAlgError:
                return None
            longest = np.abs(step[places]).max()
            self._u = self._u + min(1.0, room.max() / max(longest, 1e-300)) * step
            if longest <= _SAME * room.max():
                return np.array(deep)
        return None

    def _pushed(self, force: Floats) -> tuple[Floats, Floats]:
        """Return matrix and vector of the energy without walls, pushed by a force (N + 1,)."""
        count = force.size - 1
        matrix, slope = np.zeros((4 * count + 4, 4 * count + 4)), self._slope.ravel().copy()
        turn = np.einsum('k,kab,ij->kaibj', force[1:], self._turn, np.eye(2)).reshape(count, -1)
        np.add.at(matrix, self._places, (self._stiff - turn).ravel())
        matrix[:4, :4] += self._inside.mouth
        slope[:4] -= self._inside.mouth @ self._inside.pushed * force[0]
        return matrix, slope


def _hermite(h: Floats) -> tuple[Floats, Floats]:
    """Return (N, 4, 4) what cubic elements of lengths (N,) need to bend, and to turn."""
    one = np.ones_like(h)
    bend = np.array([[12 * one, 6 * h, -12 * one, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                     [-12 * one, -6 * h, 12 * one, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])
    turn = np.array([[36 * one, 3 * h, -36 * one, 3 * h], [3 * h, 4 * h**2, -3 * h, -h**2],
                     [-36 * one, -3 * h, 36 * one, -3 * h], [3 * h, -h**2, -3 * h, 4 * h**2]])
    return (bend / h**3).transpose(2, 0, 1), (turn / (30 * h)).transpose(2, 0, 1)
