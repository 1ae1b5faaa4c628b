"""The fastest laws in time with which a DLO arrives calm, as far as its `Response` tells.

On each leg the rates are the fastest that the gripper's limits, and a bound of the slowly built-up
deviation, allow. Moving averages as wide as the periods of the slowest modes, at the leg's beginning and
its end, smooth them: such a window leaves no vibration of its period. Which windows and which bound are
the quickest is tried; each trial is judged with the frequencies as they are, and off by 5 %.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dlo_planner.inverse.fastest import fastest_rates
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.path import Leg
from dlo_planner.inverse.response import Response
from dlo_planner.inverse.time_law import TimeLaw
from dlo_planner.inverse.timed_path import smoothed

_BOUNDS, _CLOSER = 12, 0.7  # bounds of deviations that are tried, parts of the one before
_OFF = (0.95, 1.05)  # frequencies, as if the stiffness was wrong by 10 %, and
_WORSE = 2.0         # times the tolerance are allowed then
_ARRIVING = 0.5      # part of the tolerance that may be left of a vibration where a leg ends
_MOST_OFF, _TRIED = 0.3, 30  # part of the frequencies; how many such are tried
_TUNED = (0.8, 0.9, 0.95, 1.05)  # times a window


@dataclass(frozen=True)
class LegTask:
    """A leg to be gone through calmly.

    Attributes:
        leg: Leg; response: Response on it; limits: Limits
        holes: (k, n) arc lengths that pass the k centres at the parameters of `response`, m, nan where
            none does
        last: whether the plan ends with it
    """

    leg: Leg
    response: Response
    limits: Limits
    holes: np.ndarray
    last: bool

    @cached_property
    def passed(self):
        """For each centre that is passed: the parameter where that begins, and (n, m, 3).

        These are the displacements by the modes, across the DLO, of what passes the centre; of the
        free end before.
        """
        return [(self.response.parameters[np.argmax(np.isfinite(s))],
                 self.response.sideways(np.where(np.isnan(s), self.response.shapes[0].s[-1], s)))
                for s in self.holes if np.isfinite(s).any()]


    @cached_property
    def sizes(self):
        """(n, m) by how much the modes displace what counts, m."""
        if not self.passed:
            return self.response.sizes
        return np.max([np.linalg.norm(sideways, axis=2) for _, sideways in self.passed], axis=0)


def calm_law(task: LegTask, tolerance: float) -> TimeLaw:
    """Return the quickest TimeLaw found that keeps `tolerance` (m) as far as the response tells.

    The one that comes nearest to that, if none does.
    """
    found = []
    for parameters, rates in _rates(task):
        for windows in _windows(task.response):
            law = TimeLaw(parameters, rates, windows)
            found.append((law, predicted(task, law) / tolerance))
        if min(part for _, part in found[-len(_windows(task.response)):]) < 0.5:
            break  # slower ones only take longer
    good = [law for law, part in found if part <= 1]
    if not good:
        law = min(found, key=lambda one: one[1])[0]
    else:
        law = _tuned(task, min(good, key=lambda law: law.duration), tolerance)
    return smoothed(task.leg, task.limits, law.parameters, law.rates, law.windows)


def predicted(task: LegTask, law: TimeLaw) -> float:
    """Return the largest deviation that counts, in m; half of it where frequencies are off.

    From where a centre is passed on: that of the whole DLO. At the end of a leg before: what is left of
    the vibration, in parts of _ARRIVING.
    """
    return max(_predicted(task, law, 1.0), *(_predicted(task, law, off) / _WORSE for off in _OFF))


def margin(task: LegTask, law: TimeLaw, allowed: float) -> float:
    """Return the part by which all frequencies may be off, up or down, until `allowed` (m) is passed.

    At most _MOST_OFF.
    """
    tried = np.arange(1, _TRIED + 1) * (_MOST_OFF / _TRIED)
    for k, part in enumerate(tried):
        if max(_predicted(task, law, 1 - part), _predicted(task, law, 1 + part)) > allowed:
            return float(tried[k - 1]) if k else 0.0
    return _MOST_OFF


def _predicted(task, law, off):
    response = task.response
    _, u, (place, speed) = response.excited(law, off)
    left = float((response.sizes[-1] * np.hypot(place[-1], speed[-1])).sum())
    worst = left if task.last else left / _ARRIVING
    for begin, sideways in task.passed:
        counts = u >= begin
        away = np.einsum('tmi,tm->ti', _between(response.parameters, sideways, u[counts]),
                         place[counts])
        worst = max(worst, float(np.linalg.norm(away, axis=1).max(initial=0.0)))
    return worst


def _between(parameters, known, u):
    """Return what is `known` (n, ...) at n parameters, at parameters u (t,)."""
    after = np.clip(np.searchsorted(parameters, u), 1, parameters.size - 1)
    share = (u - parameters[after - 1]) / (parameters[after] - parameters[after - 1])
    share = np.clip(share, 0, 1).reshape(-1, *np.ones(known.ndim - 1, dtype=int))
    return (1 - share) * known[after - 1] + share * known[after]


def _rates(task):
    """Yield parameters and rates of ever slower ways through the leg."""
    parameters, rates = fastest_rates(task.leg, task.limits)
    yield parameters, rates
    response = task.response
    rate = np.interp(response.parameters, parameters, rates)[:, None]
    deviation = np.abs(response.bends * rate**2 * task.sizes / response.rates**2).max()
    for _ in range(_BOUNDS):
        deviation *= _CLOSER
        yield fastest_rates(task.leg, task.limits, response.bearing(deviation, task.sizes))


def _windows(response):
    """Return lists of windows (s) to be tried, from the periods of the two slowest modes."""
    periods = 2 * np.pi / response.rates[:, :2]
    if periods.shape[1] < 2:
        periods = np.repeat(periods, 2, axis=1)
    (one, two), (end, other), (long, next_) = periods[0], periods[-1], periods.max(axis=0)
    return [[end], [end, other], [one, two], [one, end], [long, next_], [long, long],
            [one, end, next_], [one, end, two, other], [long, long, next_, next_]]


def _tuned(task, law, tolerance):
    """Return a quicker law with narrower windows that still keeps the tolerance."""
    for k in range(len(law.windows)):
        for factor in _TUNED:
            windows = law.windows.copy()
            windows[k] *= factor
            other = TimeLaw(law.parameters, law.rates, windows)
            if other.duration < law.duration and predicted(task, other) <= tolerance:
                law = other
                break
    return law
