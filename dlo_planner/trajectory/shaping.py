# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The fastest laws in time with which a DLO arrives at rest, according to its `Response`.

On each leg the rates are the fastest that the gripper's limits, and a bound of the slowly built-up
deviation, allow. Moving averages as wide as the periods of the slowest modes, at the leg's
beginning and its end, smooth them: such a window leaves no vibration of its period. Which windows
and which bound are the quickest is tried; each trial is judged with the DLO as it is given, and
with one whose stiffness is wrong. Each leg takes over the vibration that the one before leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from operator import itemgetter

import numpy as np
from scipy.interpolate import BSpline

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.plan.path import Leg
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.modal_response import Case, Passage, Response, vibrated
from dlo_planner.trajectory.time_law import DEGREE, Shift, TimeLaw
from dlo_planner.trajectory.timed_path import most_used, smoothed
from dlo_planner.trajectory.topp import fastest_rates

_PER_PERIOD = 5   # pieces of the spline in the slowest period
_SMALL = 3e-2     # weight of the shift beside the deviation: none that hardly helps
_BEFORE = 0.05    # weight of the free end's deviation before something is passed
_NEAR = 0.01      # of the length: from so near on the free end counts as if it passed
_LONGEST = 50.0   # slowest periods: a longer leg is so slow that a shift is of no use
_PART = 50        # instants in which what is passed weighs as much as the end of the leg


def compensated(task: LegTask, law: TimeLaw,
                begins: Sequence[Floats] | None = None,
                check: Callable[[], None] = lambda: None) -> Shift | None:
    """Return the Shift that makes the deviations of a LegTask's DLOs least.

    None on a leg that is too short for one, or takes very many periods of the DLO.
    """
    period = 2 * np.pi / task.response.rates.min()
    knots, inner = _knots(min(law.duration, _LONGEST * period), period)
    if not inner.size or law.duration > _LONGEST * period:
        return None
    basis = BSpline(knots, np.eye(knots.size - DEGREE - 1)[:, inner], DEGREE)
    normal, right = _SMALL**2 * np.eye(3 * inner.size), np.zeros(3 * inner.size)
    for case, begin in zip(task.cases, task.rest if begins is None else begins, strict=True):
        check()
        rows, own = _answers(case, law, begin, basis)
        normal += rows.T @ rows / case.allowed**2
        right -= rows.T @ own / case.allowed**2
    coefficients = np.zeros((knots.size - DEGREE - 1, 3))
    # the small weight of the shift itself keeps that well posed
    coefficients[inner] = np.linalg.solve(normal, right).reshape(3, -1).T
    return Shift(knots, coefficients)


def _answers(case: Case, law: TimeLaw, begin: Floats, basis: BSpline) -> tuple[Floats, Floats]:
    """Return what counts of the deviation of a Case, by the coefficients (r, 3 k) and before (r,).

    Shapes: begin (2, m).
    """
    response = case.response
    times, u, rates, damping, turns, course = response.oscillators(law)
    middle = 0.5 * (times[1:] + times[:-1])
    pulled = response.between(response.pulls, course[0])
    force = -np.einsum('tmi,tk->iktm', pulled, basis(middle, 2)).reshape(-1, *pulled.shape[:2])
    places = np.einsum('tk,ij->iktj', basis(times), np.eye(3)).reshape(len(force), -1, 3)
    own = response.excited(law, begin)[2]
    rest = np.zeros((2, len(force), pulled.shape[1]))
    answers = vibrated(times[1], rates, damping, turns, force, rest)
    rows, before = [], []
    for passage in case.passed:
        moved = response.between(passage.across, u)
        near = response.between(passage.before, u) <= _NEAR * response.shapes[0].s[-1]
        weight = np.where(near, 1.0, _BEFORE)[:, None] / np.sqrt(len(times) / _PART)
        before.append((np.einsum('tmi,tm->ti', moved, own[0]) * weight).ravel())
        away = (answers[0].swapaxes(0, 1) @ moved).swapaxes(0, 1) + places
        rows.append((away * weight).reshape(len(force), -1).T)
    sizes = response.sizes[-1]
    before.append((sizes * own[:, -1]).ravel())
    rows.append(np.moveaxis(sizes * answers[:, :, -1], 1, 2).reshape(-1, len(force)))
    return np.vstack(rows), np.concatenate(before)


def _knots(duration: float, period: float) -> tuple[Floats, Ints]:
    """Return knots of a spline over the duration, and which coefficients leave its ends at rest."""
    pieces = max(1, int(duration / period * _PER_PERIOD))
    knots = np.concatenate([[0.0] * DEGREE, np.linspace(0, duration, pieces + 1),
                            [duration] * DEGREE])
    return knots, np.arange(DEGREE, knots.size - 2 * DEGREE - 1)


SLOWEST = 16.0       # times as long as the limits ask for: slower is no motion any more
_BOUNDS, _CLOSER = 12, 0.7  # bounds of deviations that are tried, parts of the one before
_OFF = (0.95, 1.05)  # frequencies: a response is not quite that of the DLO, and
_WORSE = 2.0         # times the tolerance are allowed then, and with a wrong stiffness
_MOST_OFF, _TRIED = 0.3, 30  # part of the frequencies; how many such are tried
_MUCH = 0.3          # of the tolerance: calmer laws are not looked for
_FAR = 30.0          # times the tolerance: beyond help by a shift
_SHIFTED = 24        # laws at most that a shift is tried with
_ROUNDS = 4          # of slowing down to make room for a shift


@dataclass(frozen=True)
class LegTask:
    """A leg to be gone through calmly."""

    leg: Leg
    response: Response  # on it
    limits: Limits
    # (k, n) arc lengths that pass the k centers at the parameters of `response`, m, nan where none
    # does
    holes: Floats
    last: bool  # whether the plan ends with it
    # responses, at the same parameters, of DLOs whose stiffness is wrong
    wrong: tuple[Response, ...] = ()
    on_path: bool = False  # whether the gripper may not be shifted, for a plug that it holds

    @cached_property
    def cases(self) -> list[Case]:
        """The Case of the DLO as it is given, then those it may be in truth."""
        return [Case(self.response, self.passed, self.last),
                *(Case(self.response.faster(factor), self.passed, self.last, _WORSE)
                  for factor in _OFF),
                *(Case(one, Passage.all_of(one, self.holes), self.last, _WORSE)
                  for one in self.wrong)]

    @cached_property
    def _supply(self) -> tuple[list[list[TimeLaw]], Iterator[list[TimeLaw]]]:
        sets = ([TimeLaw(*rates, np.array(windows)) for windows in _windows(self.response)]
                for rates in _rates(self))
        first = next(sets)
        return [first], takewhile(lambda laws: laws[0].duration <= SLOWEST * first[0].duration,
                                  sets)

    def laws(self) -> Iterator[list[TimeLaw]]:
        """Yield laws, set by set ever slower ones; they are made once."""
        known, more = self._supply
        yield from known
        for some in more:
            known.append(some)
            yield some

    def undamped(self) -> LegTask:
        """Return the task of the same DLO without damping."""
        response, *wrong = (replace(one, damping=np.zeros_like(one.damping))
                            for one in (self.response, *self.wrong))
        return replace(self, response=response, wrong=tuple(wrong))

    @property
    def rest(self) -> list[Floats]:
        """States of DLOs that do not vibrate, one for each case."""
        return [case.response.rest for case in self.cases]

    def taken_over(self, before: LegTask, ends: Sequence[Floats]) -> list[Floats]:
        """Return the states at the beginning: `ends` are those at the end of the LegTask before."""
        return [case.response.taken_over(other.response, end)
                for case, other, end in zip(self.cases, before.cases, ends, strict=True)]

    def waited(self, ends: Sequence[Floats], seconds: float) -> list[Floats]:
        """Return what becomes of the states at the end, after some seconds."""
        return [case.response.waited(end, seconds)
                for case, end in zip(self.cases, ends, strict=True)]

    def after(self, law: TimeLaw, begins: Sequence[Floats]) -> list[Floats]:
        """Return the states at the end of a TimeLaw."""
        return [case.deviation(law, begin)[1]
                for case, begin in zip(self.cases, begins, strict=True)]

    @cached_property
    def passed(self) -> list[Passage]:
        """The Passages of the DLO as it is given, whatever its frequencies are."""
        return Passage.all_of(self.response, self.holes)

    @cached_property
    def sizes(self) -> Floats:
        """(n, m) by how much the modes displace what counts, m."""
        if not self.passed:
            return self.response.sizes
        result: Floats = np.max([np.linalg.norm(one.across, axis=2) for one in self.passed], axis=0)
        return result


def calm_law(task: LegTask, tolerance: float, begins: Sequence[Floats] | None = None,
             check: Callable[[], None] = lambda: None) -> TimeLaw:
    """Return the quickest TimeLaw found that keeps `tolerance` (m) according to the response.

    The one that comes nearest to that, if none does. `begins` are the states of the cases at the
    beginning, None: at rest. `check` is called before each step of a trial; it may raise.
    """
    begins = task.rest if begins is None else begins
    found: list[tuple[float, TimeLaw]] = []
    far: list[tuple[float, TimeLaw]] = []

    def hold(law: TimeLaw, off: float) -> float:
        check()
        kept = _within_limits(task, law, begins, off > tolerance and len(found) < _SHIFTED, check)
        found.append((predicted(task, kept, begins, check), kept))
        return found[-1][0]

    for off, law in _by_duration(task, tolerance, begins, check):
        if off > _FAR * tolerance:
            far.append((off, law))
        elif hold(law, off) <= tolerance:
            break
    if not found:
        off, law = min(far, key=_first)
        hold(law, off)
    return min(found, key=_first)[1]


def _by_duration(task: LegTask, tolerance: float, begins: Sequence[Floats],
                 check: Callable[[], None]) -> Iterator[tuple[float, TimeLaw]]:
    """Yield predicted deviations (m) and laws, the quickest first, until one is calm by far.

    Deviations are predicted as late as that order allows.
    """
    waiting: list[tuple[float, TimeLaw]] = []
    for laws in task.laws():
        check()
        quickest = min(law.duration for law in laws)  # sets are ever slower
        yield from (one for one in waiting if one[1].duration < quickest)
        waiting = [one for one in waiting if one[1].duration >= quickest]
        some = [(predicted(task, law, begins, check), law) for law in laws]
        waiting = sorted([*waiting, *some], key=lambda one: one[1].duration)
        if min(some, key=_first)[0] < _MUCH * tolerance:
            break
    yield from waiting


_first = itemgetter(0)


def _within_limits(task: LegTask, law: TimeLaw, begins: Sequence[Floats], shifted: bool,
                   check: Callable[[], None]) -> TimeLaw:
    """Return a TimeLaw that keeps the limits, with the shift that helps most if it is `shifted`."""
    law = smoothed(task.leg, task.limits, law.parameters, law.rates, law.windows)
    # a shift of the gripper alone does not take along what others hold; a plug would leave its axis
    fixed = task.response.held or task.on_path
    for _ in range(_ROUNDS if shifted and not fixed else 0):
        shift = compensated(task, law, begins, check)
        if shift is None:
            break
        used = (shift.most[1:] / task.limits.sizes[:, 0]).max() + most_used(
            task.leg, law, task.limits)
        if used <= 1:
            return replace(law, shift=shift)
        law = law.slower(used)
    return law


def predicted(task: LegTask, law: TimeLaw, begins: Sequence[Floats] | None = None,
              check: Callable[[], None] = lambda: None) -> float:
    """Return the largest deviation that counts, in m; half of it where the stiffness is wrong.

    See `Case.deviation`. `begins` are the states at the beginning, None: at rest; `check` as for
    `calm_law`.
    """
    worst = 0.0
    for case, begin in zip(task.cases, task.rest if begins is None else begins, strict=True):
        check()
        worst = max(worst, case.deviation(law, begin)[0] / case.allowed)
    return worst


def margin(task: LegTask, law: TimeLaw, allowed: float,
           check: Callable[[], None] = lambda: None) -> float:
    """Return by which part all frequencies may be off, up or down, until `allowed` (m) is passed.

    Until more than `allowed` (m) is predicted; at most _MOST_OFF. `check` as for `calm_law`.
    """
    tried = np.arange(1, _TRIED + 1) * (_MOST_OFF / _TRIED)
    for k, part in enumerate(tried):
        for off in (1 - part, 1 + part):
            check()
            case = Case(task.response.faster(off), task.passed, task.last)
            if case.deviation(law, case.response.rest)[0] > allowed:
                return float(tried[k - 1]) if k else 0.0
    return _MOST_OFF


def _rates(task: LegTask) -> Iterator[tuple[Floats, Floats]]:
    """Yield parameters and rates of ever slower ways through the leg."""
    parameters, rates = fastest_rates(task.leg, task.limits)
    yield parameters, rates
    response = task.response
    rate = np.interp(response.parameters, parameters, rates)[:, None]
    deviation = np.abs(response.bends * rate**2 * task.sizes / response.rates**2).max()
    for _ in range(_BOUNDS):
        deviation *= _CLOSER
        try:
            slower = fastest_rates(task.leg, task.limits,
                                   response.deviation_bound(deviation, task.sizes))
        except InvalidTask:  # so slow that toppra loses its digits: no slower ones
            return
        yield slower


def _windows(response: Response) -> list[list[float]]:
    """Return lists of windows (s) to be tried, from the periods of the two slowest modes."""
    periods = 2 * np.pi / response.rates[:, :2]
    if periods.shape[1] < 2:
        periods = np.repeat(periods, 2, axis=1)
    (one, two), (end, other), (long, next_) = periods[0], periods[-1], periods.max(axis=0)
    return [[end], [end, other], [one, two], [one, end], [long, next_], [long, long],
            [one, end, next_], [one, end, two, other], [long, long, next_, next_]]
