"""The fastest time laws with which a DLO arrives calm, as its `Response` predicts.

On each leg the rates are the fastest that the gripper's limits, and a bound of the slowly built-up
deviation, allow. Moving averages as wide as the periods of the slowest modes, at the leg's
beginning and its end, smooth them: such a window leaves no vibration of its period. Which windows
and which bound are the quickest is tried; each trial is judged with the frequencies as they are,
and off by 5 %.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.compensation import compensated
from dlo_planner.inverse.fastest import fastest_rates
from dlo_planner.inverse.kept_limits import most_used
from dlo_planner.inverse.leg_response import Response
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.path import Leg
from dlo_planner.inverse.time_law import TimeLaw
from dlo_planner.inverse.timed_path import smoothed

_BOUNDS, _CLOSER = 12, 0.7  # bounds of deviations that are tried, parts of the one before
_OFF = (0.95, 1.05)  # frequencies, as if the stiffness was wrong by 10 %, and
_WORSE = 2.0         # times the tolerance are allowed then
_ARRIVING = 0.5      # part of the tolerance that may be left of a vibration where a leg ends
_MOST_OFF, _TRIED = 0.3, 30  # largest part by which frequencies are taken to be off; trials
_MUCH = 0.3          # of the tolerance: once a law is as calm as this, no slower ones are tried
_FAR = 30.0          # times the tolerance: no shift mends a deviation that is larger
_TRIALS, _CALMER = 16, 6  # laws that are given a shift: the quickest, and ever calmer ones
_ROUNDS = 4          # of slowing down to make room for a shift


@dataclass(frozen=True)
class LegTask:
    """A leg that the DLO has to pass calmly.

    Attributes:
        leg: Leg; response: Response on it; limits: Limits
        holes: (k, n) arc lengths at which the DLO passes the k centres at the n parameters of
            `response`, m; nan where it passes none
        last: whether the plan ends with this leg
    """

    leg: Leg
    response: Response
    limits: Limits
    holes: np.ndarray
    last: bool

    @cached_property
    def supply(self) -> tuple[list, Iterator]:
        """Sets of (TimeLaw, predicted deviation in m) tried so far, and rates for more sets."""
        return [], _rates(self)

    @cached_property
    def passed(self) -> list[tuple[float, np.ndarray]]:
        """For each centre that is passed: the parameter where that begins, displacements (n, m, 3).

        The modes displace the point that passes the centre by these, across the DLO, in m; before
        that, the free end.
        """
        return [(self.response.parameters[np.argmax(np.isfinite(s))],
                 self.response.sideways(np.where(np.isnan(s), self.response.shapes[0].s[-1], s)))
                for s in self.holes if np.isfinite(s).any()]

    @cached_property
    def sizes(self) -> np.ndarray:
        """(n, m) largest displacements by the modes of the points that count, m."""
        if not self.passed:
            return self.response.sizes
        return np.max([np.linalg.norm(sideways, axis=2) for _, sideways in self.passed], axis=0)


def calm_law(task: LegTask, tolerance: float,
             check: Callable[[], None] = lambda: None) -> TimeLaw:
    """Return the quickest TimeLaw found whose predicted deviation is within `tolerance` (m).

    If there is none, return the law with the least predicted deviation. `check` is called before
    each trial; it may raise.
    """
    found = sorted(_candidates(task, tolerance, check), key=lambda one: one[0].duration)
    best = None
    for law, shifted in _trials(found, tolerance):
        check()
        kept = _within_limits(task, law, shifted)
        used = predicted(task, kept)
        if best is None or used < best[1]:
            best = kept, used
        if used <= tolerance:
            break
    return best[0]


def _candidates(task, tolerance, check):
    """Return laws and their predicted deviations, m; ever slower ones, until one is very calm."""
    sets, more = task.supply
    while not sets or min(off for _, off in sets[-1]) >= _MUCH * tolerance:
        check()
        rates = next(more, None)
        if rates is None:
            break
        laws = [TimeLaw(*rates, windows) for windows in _windows(task.response)]
        sets.append([(law, predicted(task, law)) for law in laws])
    return [one for some in sets for one in some]


def _trials(found, tolerance):
    """Yield the laws that are worth a trial, and whether a shift is to be added to each.

    The quickest come first, then ever calmer ones.
    """
    tried, calmer, least = 0, [], np.inf
    for law, off in found:
        if off <= tolerance:
            yield law, False
        elif off <= _FAR * tolerance and tried < _TRIALS:
            tried += 1
            yield law, True
        elif off < least:
            calmer.append(law)
        least = min(least, off)
    some = np.unique(np.linspace(0, len(calmer) - 1, min(len(calmer), _CALMER)).astype(int))
    yield from ((calmer[k], True) for k in some)


def _within_limits(task, law, shifted):
    """Return the TimeLaw slowed down until it keeps the limits; `shifted`: with the best Shift."""
    law = smoothed(task.leg, task.limits, law.parameters, law.rates, law.windows)
    for _ in range(_ROUNDS if shifted else 0):
        shift = compensated(task.response, task.passed, law)
        if shift is None:
            break
        used = (shift.most[1:] / task.limits.sizes[:, 0]).max() + most_used(
            task.leg, law, task.limits)
        if used <= 1:
            return replace(law, shift=shift)
        law = law.slower(used)
    return law


def predicted(task: LegTask, law: TimeLaw) -> float:
    """Return the largest deviation that counts, in m; half of it where frequencies are off by 5 %.

    While the DLO passes a centre, the deviation of the passing point across the DLO counts. At the
    end of a leg the amplitude that is left of the vibration counts; if another leg follows, only
    half of the tolerance may be left, so it counts twice.
    """
    return max(_predicted(task, law, 1.0), *(_predicted(task, law, off) / _WORSE for off in _OFF))


def margin(task: LegTask, law: TimeLaw, allowed: float) -> float:
    """Return the part by which all frequencies may be off, up or down, within `allowed` (m).

    The largest tried part up to which the predicted deviation stays within `allowed`: from 0 in
    steps of 0.01 up to 0.3.
    """
    tried = np.arange(1, _TRIED + 1) * (_MOST_OFF / _TRIED)
    for k, part in enumerate(tried):
        if max(_predicted(task, law, 1 - part), _predicted(task, law, 1 + part)) > allowed:
            return float(tried[k - 1]) if k else 0.0
    return _MOST_OFF


def _predicted(task, law, off):
    response = task.response
    times, u, (place, speed) = response.excited(law, off)
    left = float((response.sizes[-1] * np.hypot(place[-1], speed[-1])).sum())
    worst = left if task.last else left / _ARRIVING
    for begin, sideways in task.passed:
        counts = u >= begin
        away = np.einsum('tmi,tm->ti', response.between(sideways, u[counts]),
                         place[counts])
        if law.shift is not None:
            away += law.shift.at(times[counts])
        worst = max(worst, float(np.linalg.norm(away, axis=1).max(initial=0.0)))
    return worst


def _rates(task):
    """Yield parameters and rates of ever slower motions through the leg."""
    parameters, rates = fastest_rates(task.leg, task.limits)
    yield parameters, rates
    response = task.response
    rate = np.interp(response.parameters, parameters, rates)[:, None]
    deviation = np.abs(response.bends * rate**2 * task.sizes / response.rates**2).max()
    for _ in range(_BOUNDS):
        deviation *= _CLOSER
        try:
            found = fastest_rates(task.leg, task.limits, response.bearing(deviation, task.sizes))
        except InvalidTask:  # at such low rates rounding errors make toppra fail: stop here
            return
        yield found


def _windows(response):
    """Return lists of windows (s) to be tried, from the periods of the two slowest modes."""
    periods = 2 * np.pi / response.rates[:, :2]
    if periods.shape[1] < 2:
        periods = np.repeat(periods, 2, axis=1)
    (one, two), (end, other), (long, next_) = periods[0], periods[-1], periods.max(axis=0)
    return [[end], [end, other], [one, two], [one, end], [long, next_], [long, long],
            [one, end, next_], [one, end, two, other], [long, long, next_, next_]]
