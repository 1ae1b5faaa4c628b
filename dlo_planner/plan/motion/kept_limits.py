# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a motion keeps its limits: bounds of its speeds, accelerations and jerks at all times."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.plan.leg import Leg
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.time_law import TimeLaw

_TIGHT = 5e-3    # by which part a bound may exceed the largest value that was found
_ROUNDS = 40     # halvings of an interval of time, at most
_PARTS = 8       # of the time between two knots, in which jerks are bounded


def most_used(leg: Leg, law: TimeLaw, limits: Limits) -> float:
    """Return an upper bound of the largest part of its limits that a motion uses at any time.

    Speed and acceleration are computed at the ends of an interval of time, and their slopes within
    it are bounded. The interval is halved until its bound is at most 0.5 % above the largest value
    found. Jerks are bounded only. The shift of the law is left out.
    """
    most = limits.sizes
    times = np.unique(np.concatenate([[0.0], law.arrivals(leg.knots[1:-1]), [law.duration]]))
    a, b = times[:-1], times[1:]
    largest = proved = _largest_jerk(leg, law, a, b, most[2])
    for _ in range(_ROUNDS):
        ends = law.at(np.append(a, b))
        used = _sizes(leg, ends) / most[:2]
        largest = max(largest, used.max())
        slopes = _slopes(_bounds(leg, law, ends, 0.5 * (b - a)))
        bound = (used.reshape(2, -1, 2, 2).mean(axis=0)
                 + 0.5 * (b - a)[:, None, None] * slopes / most[:2]).max(axis=(1, 2))
        wide = bound > (1 + _TIGHT) * largest
        proved = max(proved, bound[~wide].max(initial=0.0))
        if not wide.any():
            return float(max(largest, proved))
        a, b, middle = a[wide], b[wide], 0.5 * (a + b)[wide]
        a, b = np.append(a, middle), np.append(middle, b)
    return float(max(proved, bound.max()))


def _largest_jerk(leg: Leg, law: TimeLaw, a: Floats, b: Floats, most: Floats) -> float:
    """Return a bound of the largest jerk as a part of the limits `most` (2,)."""
    shares = np.linspace(0, 1, _PARTS + 1)
    edges = a[:, None] + (b - a)[:, None] * shares
    a, b = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    return float((_jerks(_bounds(leg, law, law.at(np.append(a, b)), 0.5 * (b - a))) / most).max())


def _sizes(leg: Leg, at: Floats) -> Floats:
    """Return (n, 2, 2): speed and acceleration, each linear and angular, from u, rates (4, n)."""
    _, _, first, second = leg.at(at[0])
    rate, change = at[1][:, None], at[2][:, None]
    both = np.stack([rate * first, change * first + rate**2 * second], axis=1)
    result: Floats = np.linalg.norm(both.reshape(-1, 2, 2, 3), axis=3)
    return result


class _Bounds(NamedTuple):
    """Bounds between n pairs of times.

    Attributes
    ----------
    leg : ndarray, shape (n, 2, 3)
        Of the leg's derivatives by u, linear and angular, first to third.
    rate : ndarray, shape (n,)
        Of u'.
    change : ndarray, shape (n,)
        Of u''.
    jerk : float
        Of u'''.
    """

    leg: Floats
    rate: Floats
    change: Floats
    jerk: float


def _bounds(leg: Leg, law: TimeLaw, ends: Floats, half: Floats) -> _Bounds:
    """Return the _Bounds between n pairs of times.

    Shapes: ends (4, 2 n), half (n,).
    """
    change, jerk = law.bounds
    sizes = np.abs(ends).reshape(4, 2, -1).max(axis=1)
    return _Bounds(leg.bounds(*np.split(ends[0], 2)), sizes[1] + half * change,
                   sizes[2] + half * jerk, jerk)


def _slopes(bounds: _Bounds) -> Floats:
    """Return (n, 2, 2): bounds of the slopes of `_sizes` between the times."""
    first, second = np.moveaxis(bounds.leg, 2, 0)[:2]
    return np.stack([bounds.change[:, None] * first + bounds.rate[:, None] ** 2 * second,
                     _jerks(bounds)], axis=1)


def _jerks(bounds: _Bounds) -> Floats:
    """Return (n, 2): bounds of the linear and angular jerk between the times."""
    first, second, third = np.moveaxis(bounds.leg, 2, 0)
    rate, change = bounds.rate[:, None], bounds.change[:, None]
    result: Floats = bounds.jerk * first + 3 * rate * change * second + rate**3 * third
    return result
