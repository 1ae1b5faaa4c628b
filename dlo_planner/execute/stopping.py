# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a motion that is being executed comes to rest, or goes on from it: along its own path.

Time along the path runs slower and slower, or quicker and quicker, by the polynomial
10 x^3 - 15 x^4 + 6 x^5: the motion's acceleration goes on without a jump at both ends. How long
that takes is found on the poses that are sent, so that they keep the limits.
"""

from collections.abc import Callable

import numpy as np

from dlo_planner.execute.limiter import used
from dlo_planner.identify.steering import Steered
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.timed_path import TimedPath

_SHORTEST = 2     # periods
_LONGEST = 20.0   # s
_GUESSED = 1.5    # speeds over acceleration: hardly any stop is shorter
_LEAST, _MOST = 1.03, 1.5  # from one duration that is tried to the next
_SEEN = 3         # periods before and after it that a jerk needs to be seen

# a product of two of these polynomials, over one period, is integrated exactly
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS

Rising = tuple[int, int]  # periods since time began to run, periods until it runs evenly


def decelerate(way: TimedPath | Steered, done: float, limits: Limits, period: float,
               lead: int = 0, rising: Rising | None = None, lasting: float = 0.0) -> Floats:
    """Return the times along a way, s, one for each coming period, on which it comes to rest."""
    def rate(since: Floats, steps: int) -> Floats:
        begun = _smooth((since + rising[0]) / rising[1]) if rising else 1.0
        return begun * (1 - _smooth((since - lead) / steps))

    return _shortest(way, done, limits, period, rate, lead, lasting)


def accelerate(way: TimedPath | Steered, done: float, limits: Limits, period: float) -> Floats:
    """Return the times along a way, s, one for each coming period, on which it begins to run."""
    return _shortest(way, done, limits, period, lambda since, steps: _smooth(since / steps), 0)


def _shortest(way: TimedPath | Steered, done: float, limits: Limits, period: float,
              rate: Callable[[Floats, int], Floats], lead: int, least: float = 0.0) -> Floats:
    """Return the times along a way in the shortest change of its rate that keeps the limits.

    It takes `least` s at least.
    """
    speeds = np.linalg.norm(way.at([done])[1].reshape(2, 3), axis=1)
    guess = float((_GUESSED * speeds / limits.sizes[1]).max())
    steps, found = max(_SHORTEST, int(np.ceil(max(guess, least) / period))), []
    while True:
        since = np.arange(-_SEEN, lead + steps + _SEEN)[:, None] + _NODES
        times = period * np.append(0.0, np.cumsum(rate(since, steps) @ _WEIGHTS))
        times += done - times[_SEEN]
        part = used(way.frames(times), limits, period)
        found.append((part, times[_SEEN + 1:_SEEN + 1 + lead + steps]))
        if part <= 1 or steps * period > max(_LONGEST, least):
            return min(found, key=lambda one: one[0])[1] if part > 1 else found[-1][1]
        steps = int(np.ceil(steps * np.clip(np.sqrt(part), _LEAST, _MOST)))


def _smooth(x: Floats) -> Floats:
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)
