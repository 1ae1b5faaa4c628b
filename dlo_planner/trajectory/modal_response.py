# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The response of a DLO to a motion along a leg: its vibrations, excited by the time law.

While the gripper is at the parameter u the DLO would hang in the equilibrium X(u). Its deviation
from it is a sum of modes, displacement_i(u) y_i(t), with

    y_i'' + 2 zeta_i w_i y_i' + w_i^2 y_i = -(slope_i(u) u'' + bend_i(u) u'^2),

slope_i and bend_i the products, weighted by mass, of the mode with dX/du and d^2X/du^2. Along the
way frequencies and modes change; where two come near to each other they turn into one another, so
the coordinates turn with them. A time law is judged with it in milliseconds;
`DirectSimulator.simulate` verifies the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.interpolate import CubicSpline

from dlo_planner.direct.grasp import Simulator
from dlo_planner.direct.shape import Shape, modes_along
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.loads import node_masses
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.dense import lu_factor, lu_solve
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.holds import BORE
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.plan.path import Leg
from dlo_planner.plan.stage import holds_along
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.topp import DeviationBound

_GAUSS = np.polynomial.legendre.leggauss(16)
_LIGHTEST = 1e-12  # kg: a DLO without mass has some period, too


def slowest_period(rod: Rod) -> float:
    """Return the period (s) of the slowest vibration of a Rod clamped at one end, roughly.

    As if it were straight and weightless (`Shape.modes` knows shape and weight). By Dunkerley's
    formula, which for an even stiffness is never below the period of such a rod: a mass at s counts
    as (s / L)^3 of it at the tip, and so the mass of a uniform rod counts a quarter.
    """
    x, weights = 0.5 * (_GAUSS[0] + 1), 0.5 * _GAUSS[1]
    mass = rod.length * float(weights @ (rod.masses_per_length(rod.length * x) * x**3))
    mass += rod.tip_mass + sum(kg * (s / rod.length) ** 3 for s, kg in rod.point_masses)
    return float(2 * np.pi * np.sqrt(max(mass, _LIGHTEST) * rod.length**3
                                     / (3 * min(rod.stiffness[1:]))))


def slowest_period_of(simulator: Simulator, begin: Shape | None = None) -> float:
    """Return the `slowest_period` (s) of a simulator's DLO, of the slower of its parts.

    Of one that more than the gripper holds in the Shape `begin`: the period of its slowest mode
    there, where it has any.
    """
    if begin is not None and begin.holds and begin.holds[-1].by != BORE:
        try:
            return float(1 / begin.modes(1).frequencies[0])
        except InvalidTask:  # neutral, in contact with friction, or from a file
            pass
    parts = (simulator,) if isinstance(simulator, DirectSimulator) else simulator.parts
    return max(slowest_period(part.rod) for part in parts)


class Turns(Record):
    """How m modes turn into one another in t steps: by the skew matrix part * rates[place]."""

    rates: Floats  # (n, m, m) skew matrices
    place: Ints  # (t,)
    part: Floats  # (t,)

    @classmethod
    def none(cls, count: int, modes: int) -> Turns:
        """Return those of modes that stay the same."""
        return cls(np.zeros((1, modes, modes)), np.zeros(count, dtype=np.int64), np.zeros(count))


class Oscillators(NamedTuple):
    """The m modes of a DLO at t + 1 instants of a time law."""

    times: Floats  # (t + 1,) times in s
    parameters: Floats  # (t + 1,) parameters of the leg
    rates: Floats  # (t, m) angular frequencies between the instants, 1/s
    damping: Floats  # (t, m) damping ratios
    turns: Turns  # of t steps
    course: Floats  # (3, t) the parameter between the instants, its first two derivatives by time


@kernel
def vibrated(step: float, rates: np.ndarray, damping: np.ndarray, turns: Turns,
             force: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return y and y'/w (2, c, t + 1, m) of m oscillators under c sets of forces.

    y'' + 2 zeta w y' + w^2 y = force. Exact for a force that is steady in each step. Damping ratios
    above 0.99 count as 0.99.

    Args:
        step: of time, s
        rates: (t, m) angular frequencies w in each step, 1/s; damping: (t, m) ratios zeta
        turns: of the coordinates, from the axes of a step to those of the next
        force: (c, t, m) per mass
        begin: (2, c, m) y and y'/w before the first step
    """
    count, modes = rates.shape
    cases = force.shape[0]
    out = np.zeros((2, cases, count + 1, modes))
    out[:, :, 0] = begin
    # what a step does is the same for all sets: `turning` is Cayley's transform (1 + A)^-1 (1 - A)
    cosine, sine = np.empty((count, modes)), np.empty((count, modes))
    turning, factors = np.empty((count, modes, modes)), np.empty((modes, modes))
    order = np.empty(modes, dtype=np.int64)
    for k in range(count):
        for m in range(modes):
            w = rates[k, m]
            zeta = min(damping[k, m], 0.99)
            free = np.sqrt(1.0 - zeta * zeta)
            decay = np.exp(-zeta * w * step)
            cosine[k, m] = decay * np.cos(free * w * step)
            sine[k, m] = decay * np.sin(free * w * step) / free
        if turns.part[k] != 0.0:
            skew = turns.rates[turns.place[k]]
            for i in range(modes):
                for j in range(modes):
                    factors[i, j] = turns.part[k] * skew[i, j]
                    turning[k, i, j] = 0.0
                factors[i, i] += 1.0
                turning[k, i, i] = 2.0
            lu_factor(factors, order)
            lu_solve(factors, order, turning[k])
            for i in range(modes):
                turning[k, i, i] -= 1.0
    place, speed, before = np.empty(modes), np.empty(modes), np.empty((2, modes))
    for c in range(cases):
        resting = True
        for m in range(modes):
            place[m], speed[m] = begin[0, c, m], begin[1, c, m] * rates[0, m]
            resting = resting and place[m] == 0.0 and speed[m] == 0.0
        for k in range(count):
            if resting:  # a piece of a spline moves nothing before it begins
                for m in range(modes):
                    resting = resting and force[c, k, m] == 0.0
                if resting:
                    continue
            for m in range(modes):
                w = rates[k, m]
                zeta = min(damping[k, m], 0.99)
                still = force[c, k, m] / (w * w)
                away, rate = place[m] - still, speed[m] / w
                place[m] = still + away * cosine[k, m] + (rate + zeta * away) * sine[k, m]
                speed[m] = w * (rate * cosine[k, m] - (away + zeta * rate) * sine[k, m])
            if turns.part[k] != 0.0:
                for m in range(modes):
                    before[0, m], before[1, m] = place[m], speed[m]
                    place[m] = speed[m] = 0.0
                for i in range(modes):
                    for j in range(modes):
                        place[i] += turning[k, i, j] * before[0, j]
                        speed[i] += turning[k, i, j] * before[1, j]
            for m in range(modes):
                out[0, c, k + 1, m] = place[m]
                out[1, c, k + 1, m] = speed[m] / rates[k, m]
    return out


_PLACES = 17      # on a leg, at least, where modes are known
_MODES = 5
_SLOWEST, _CHANGE, _HALVINGS = 2, 0.06, 5  # modes; part by which they change between places
_PER_PERIOD = 60  # instants in the slowest period: steps are exact, faster modes follow slowly
_FEWEST, _MOST = 200, 20_000  # instants


@dataclass(frozen=True)
class Response:
    """Modes of a DLO at n parameters of a leg; m modes, N + 1 nodes."""

    parameters: Floats  # (n,)
    shapes: tuple[Shape, ...]  # the n shapes
    rates: Floats  # (n, m) angular frequencies, 1/s
    damping: Floats  # (n, m) damping ratios
    displacements: Floats  # (n, m, N + 1, 3) displacements in m at a generalized mass of 1 kg
    slopes: Floats  # (n, m) see above
    bends: Floats  # (n, m) see above
    pulls: Floats  # (n, m, 3) the same products with a shift of the gripper, of the DLO as it is
    masses: Floats  # (N + 1,) masses of the nodes, kg
    # (n - 1, m, m) skew matrices: rates at which the modes turn into one another between parameters
    turning: Floats

    @classmethod
    def of(cls, simulator: Simulator, leg: Leg, first: Shape,
           parameters: Floats | None = None, check: Callable[[], None] = lambda: None,
           arms: Sequence[str] = ()) -> Response:
        """Return the Response on a Leg that begins in the Shape `first`; parameters (n,).

        The simulator's mesh has to be the same everywhere. `arms`: names of the other arms that
        move on the leg.
        """
        way = _LegWay(simulator, leg, arms, check)
        u, shapes, (frequencies, damping, displacements) = (
            _places(way, first) if parameters is None else
            (parameters, *way.known(first, parameters)))
        positions = CubicSpline(u, np.array([shape.positions for shape in shapes]))
        masses = node_masses(simulator.rod, shapes[0].s)
        slopes, bends = (np.einsum('k,umki,uki->um', masses, displacements, positions(u, order))
                         for order in (1, 2))
        return cls(u, tuple(shapes), 2 * np.pi * frequencies, damping, displacements, slopes, bends,
                   np.einsum('k,umki->umi', masses, displacements), masses,
                   _turning(masses, displacements) / np.diff(u)[:, None, None])

    @property
    def held(self) -> bool:
        """Whether something else than the gripper holds the DLO, so that `pulls` mean nothing."""
        return bool(self.shapes[0].holds)

    @property
    def sizes(self) -> Floats:
        """(n, m) largest displacement of a node by a mode, m."""
        result: Floats = np.linalg.norm(self.displacements, axis=3).max(axis=2)
        return result

    def deviation_bound(self, deviation: float, sizes: Floats) -> DeviationBound:
        """Return the DeviationBound that keeps the slowly built-up deviation of each mode below, m.

        Shapes: sizes (n, m).
        """
        stiff = sizes / self.rates**2
        return DeviationBound(self.parameters, self.slopes * stiff, self.bends * stiff,
                              np.full(self.slopes.shape, deviation))

    def faster(self, factor: float) -> Response:
        """Return the Response with all frequencies times a factor."""
        return replace(self, rates=factor * self.rates)

    def oscillators(self, law: TimeLaw) -> Oscillators:
        """Return the Oscillators that a time law excites."""
        periods = law.duration * self.rates.min() / (2 * np.pi)
        count = int(np.clip(periods * _PER_PERIOD, _FEWEST, _MOST))
        times = np.linspace(0, law.duration, count + 1)
        u, course = law.reached(times), law.at(0.5 * (times[1:] + times[:-1]), 3)
        place = np.clip(np.searchsorted(self.parameters, course[0]) - 1, 0, len(self.turning) - 1)
        return Oscillators(times, u, self.between(self.rates, course[0]),
                           self.between(self.damping, course[0]),
                           Turns(self.turning, place, 0.5 * np.diff(u)), course)

    def excited(self, law: TimeLaw, begin: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what a TimeLaw does at t instants: times, parameters (t,), y and y'/w (2, t, m).

        Shapes: begin (2, m).
        """
        times, u, rates, damping, turns, (places, rate, change) = self.oscillators(law)
        force = -(self.between(self.slopes, places) * change[:, None]
                  + self.between(self.bends, places) * (rate**2)[:, None])
        if law.shift is not None:
            force -= np.einsum('tmi,ti->tm', self.between(self.pulls, places),
                               law.shift.at(0.5 * (times[1:] + times[:-1]), 2))
        return times, u, vibrated(times[1], rates, damping, turns, force[None],
                                  begin[:, None])[:, 0]

    @property
    def rest(self) -> Floats:
        """(2, m) y and y'/w of a DLO that does not vibrate."""
        return np.zeros((2, self.rates.shape[1]))

    def taken_over(self, before: Response, end: Floats) -> Floats:
        """Return (2, m) y and y'/w at the beginning of a DLO that moves as at the end of a leg.

        Shapes: end (2, k).
        """
        moved = end * np.stack([np.ones(len(before.rates[-1])), before.rates[-1]])
        transferred = moved @ np.einsum('k,ski,mki->sm', self.masses, before.displacements[-1],
                                        self.displacements[0])
        result: Floats = transferred / np.stack([np.ones(len(self.rates[0])), self.rates[0]])
        return result

    def waited(self, end: Floats, seconds: float) -> Floats:
        """Return (2, m) y and y'/w, `end` at the end of the leg, of a DLO after some seconds."""
        modes = end.shape[1]
        result: Floats = vibrated(seconds, self.rates[-1:], self.damping[-1:], Turns.none(1, modes),
                                  np.zeros((1, 1, modes)), end[:, None])[:, 0, 1]
        return result

    def between(self, known: Floats, u: Floats) -> Floats:
        """Return what is `known` (n, ...) at the parameters, at others u (t,)."""
        nodes = self.parameters  # (a spline of SciPy takes ten times as long to be made)
        k = np.clip(np.searchsorted(nodes, u, side='right') - 1, 0, nodes.size - 2)
        share = np.clip((u - nodes[k]) / (nodes[k + 1] - nodes[k]), 0.0, 1.0)
        share = share.reshape(-1, *[1] * (known.ndim - 1))
        found: Floats = known[k] + share * (known[k + 1] - known[k])
        return found

    def sideways(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the displacements at arc lengths s (n,), m: (n, m, 3) across the DLO there.

        And the tangents there (n, 3), and the displacements along them (n, m).
        """
        across, ahead = np.empty((*self.slopes.shape, 3)), np.empty(self.slopes.shape)
        tangents = np.array([shape.frame_at(float(one))[0][:, 0]
                             for shape, one in zip(self.shapes, s, strict=True)])
        nodes = self.shapes[0].s
        for k, along in enumerate(tangents):
            moved = np.array([[np.interp(s[k], nodes, column) for column in one.T]
                              for one in self.displacements[k]])
            ahead[k] = moved @ along
            across[k] = moved - ahead[k][:, None] * along
        return across, tangents, ahead


# Frequencies (n, m), Hz, damping ratios (n, m), displacements (n, m, N + 1, 3), m, at n places.
_AllModes: TypeAlias = tuple[Floats, Floats, Floats]


class _LegWay(NamedTuple):
    """A DLO on a leg."""

    simulator: Simulator
    leg: Leg
    arms: Sequence[str]  # names of the other arms
    check: Callable[[], None]

    def known(self, first: Shape, u: Floats) -> tuple[list[Shape], _AllModes]:
        """Return n Shapes and their modes at the parameters u (n,)."""
        poses, *others = ([Pose.from_rotation(*pose) for pose in zip(*arm.poses(u), strict=True)]
                          for arm in self.leg.all_arms)
        holds = holds_along(first.holds, dict(zip(self.arms, others, strict=True)), u.size)
        shapes = self.simulator.track(poses, lambda *_: self.check(), first, holds=holds)
        return shapes, _modes_along(shapes)


def _places(way: _LegWay, first: Shape) -> tuple[Floats, list[Shape], _AllModes]:
    """Return parameters (n,), n Shapes and modes on a leg, denser where frequencies change fast.

    There, as near the loss of stability, all else changes fast, too.
    """
    parts = max(1, -(-(_PLACES - 1) // (way.leg.knots.size - 1)))
    u = np.append(way.leg.pieces(parts)[0], way.leg.knots[-1])
    left = _HALVINGS
    while True:
        shapes, modes = way.known(first, u)
        rates = modes[0][:, :_SLOWEST]
        change = np.abs(np.diff(rates, axis=0))
        far = (change > _CHANGE * np.maximum(rates[1:], rates[:-1])).any(axis=1)
        left -= 1
        if not (left and far.any()):
            return u, shapes, modes
        u = np.sort(np.append(u, 0.5 * (u[:-1] + u[1:])[far]))


def _modes_along(shapes: Sequence[Shape]) -> _AllModes:
    """Return the modes of n Shapes on a way; of one grasped inside each part vibrates by itself."""
    if shapes[0].parts is None:
        modes = modes_along(shapes, _MODES)
        frequencies, damping, displacements = (
            np.array([getattr(one, name) for one in modes])
            for name in ('frequencies', 'damping_ratios', 'displacements'))
        return frequencies, damping, displacements
    each = zip(*(shape.parts or () for shape in shapes), strict=True)
    back, front = map(_modes_along, each)
    (n, modes_back, nodes, _), modes_front = back[2].shape, front[2].shape[1]
    moved = np.zeros((n, modes_back + modes_front, shapes[0].s.size, 3))
    moved[:, :modes_back, :nodes] = back[2][:, :, ::-1]  # which runs against the arc length
    moved[:, modes_back:, nodes - 1:] = front[2]
    frequencies, damping = (np.hstack(pair) for pair in zip(back[:2], front[:2], strict=True))
    slowest = np.argsort(frequencies[0], kind='stable')
    return frequencies[:, slowest], damping[:, slowest], moved[:, slowest]


def _turning(masses: Floats, displacements: Floats) -> Floats:
    """Return (n - 1, m, m) skew matrices: by how much modes turn from one place to the next.

    They follow from the products, weighted by mass, of the modes at both places.
    """
    products = np.einsum('k,umki,uvki->umv', masses, displacements[:-1], displacements[1:])
    left, _, right = np.linalg.svd(products)
    # the rotation nearest to it is that of A / 2; Cayley's transform is its own inverse
    turns, one = np.swapaxes(left @ right, 1, 2), np.eye(products.shape[-1])
    skew: Floats = 2 * np.linalg.solve(one + turns, one - turns)
    return 0.5 * (skew - np.swapaxes(skew, 1, 2))


_ARRIVING = 0.5  # part of the tolerance that may be left of a vibration where a leg ends


@dataclass(frozen=True)
class Passage:
    """How a DLO passes a center; n parameters and m modes as of its Response."""

    # (n,) distance in m of the free end from the center before it is passed; 0 from then on
    before: Floats
    # (n, m, 3) displacements in m by the modes of what passes; before that, of the free end
    across: Floats
    tangents: Floats  # (n, 3) tangents there
    ahead: Floats  # (n, m) displacements in m along the tangents

    @classmethod
    def of(cls, response: Response, s: Floats) -> Passage:
        """Return the Passage at arc lengths s (n,), nan where the center is not passed."""
        first = np.argmax(np.isfinite(s))
        end = response.shapes[0].s[-1]
        across, tangents, ahead = response.sideways(np.where(np.isnan(s), end, s))
        ends = np.array([shape.positions_at([end])[0] for shape in response.shapes])
        before = np.einsum('ni,ni->n', tangents, ends[first] - ends)
        before[first:] = 0.0
        return cls(before, across, tangents, ahead)

    @classmethod
    def all_of(cls, response: Response, holes: Floats) -> list[Passage]:
        """Return the Passages at arc lengths (k, n) through k centers, if they are passed."""
        return [cls.of(response, s) for s in holes if np.isfinite(s).any()]

    def deviation(self, response: Response, u: Floats, place: Floats, shift: Floats) -> Floats:
        """Return (k, 3) m: where the moving DLO passes, at those instants at which it does.

        Shapes: u (t,), place (t, m), shift (t, 3).
        """
        ahead = (np.einsum('tm,tm->t', response.between(self.ahead, u), place)
                 + np.einsum('ti,ti->t', response.between(self.tangents, u), shift))
        # a DLO that swings ahead comes to the center earlier than one that hangs
        passes = response.between(self.before, u) <= np.maximum(ahead, 0.0)
        across = response.between(self.across, u[passes])
        result: Floats = shift[passes] + np.einsum('tmi,tm->ti', across, place[passes])
        return result


@dataclass(frozen=True)
class Case:
    """One of the DLOs with which a law is judged."""

    response: Response
    passed: Sequence[Passage]  # through each center that is passed
    last: bool  # whether the plan ends with its leg
    allowed: float = 1.0  # deviation, as a multiple of the tolerance

    def deviation(self, law: TimeLaw, begin: Floats) -> tuple[float, Floats]:
        """Return the largest deviation that counts, in m, and the state at the end of a TimeLaw.

        As long as a center is passed: that of what passes it, across the DLO. At the end of a leg:
        what is left of the vibration; of a leg that others follow only a part, _ARRIVING, is
        allowed. States are y and y'/w (2, m) of the modes; `begin` is that at the beginning.
        """
        response = self.response
        times, u, (place, speed) = response.excited(law, begin)
        left = float((response.sizes[-1] * np.hypot(place[-1], speed[-1])).sum())
        worst = left if self.last else left / _ARRIVING
        shift = np.zeros((len(times), 3)) if law.shift is None else law.shift.at(times)
        for passage in self.passed:
            away = passage.deviation(response, u, place, shift)
            worst = max(worst, float(np.linalg.norm(away, axis=1).max(initial=0.0)))
        return worst, np.stack([place[-1], speed[-1]])
