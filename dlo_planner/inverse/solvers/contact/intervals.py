# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a function of one positive parameter is positive, and its minima there.

A scan over the decades of the parameter finds intervals. Where the middle of three samples is the
best, but not positive, a search looks for an interval between them. A root finder finds the ends.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, minimize_scalar

_PER_DECADE = 8
_END = 1e-6     # relative: how well the ends of an interval are found
_SAMPLES = 9    # of an interval at least
_CLOSE = 1e-5   # relative: how well a minimum is found
_ALIKE = 1e-9   # relative: costs that differ by less are alike
_LOOKED_CLOSER = 4  # places where an interval may hide
_WORST = 1e6    # stands for no value at all


def intervals(merit: Callable[[float], float], least: float, most: float) -> list[list[float]]:
    """Return the intervals of x > 0 in which `merit` is positive, each as samples (n,) ascending.

    The first and last sample are the ends, inside the interval by a part of 1e-6 at most.
    """
    number = int(np.ceil(_PER_DECADE * np.log10(most / least))) + 2
    xs = [float(x) for x in np.geomspace(least, most, number)]
    xs = sorted({*xs, *_hidden(merit, xs)})
    good = [merit(x) > 0 for x in xs]
    intervals_found, k = [], 0
    while k < len(xs):
        if not good[k]:
            k += 1
            continue
        first = k
        while k + 1 < len(xs) and good[k + 1]:
            k += 1
        ends = ([_end(merit, xs[first], xs[first - 1])] if first else [],
                [_end(merit, xs[k], xs[k + 1])] if k + 1 < len(xs) else [])
        intervals_found.append(_filled(sorted({*ends[0], *xs[first:k + 1], *ends[1]})))
        k += 1
    return intervals_found


def _hidden(merit: Callable[[float], float], xs: list[float]) -> list[float]:
    """Return points of positive merit between samples `xs` of negative merit."""
    values = [merit(x) for x in xs]
    tops = [k for k in range(1, len(xs) - 1)
            if 0 >= values[k] >= max(values[k - 1], values[k + 1]) > -np.inf]
    points = []
    for k in sorted(tops, key=lambda k: -values[k])[:_LOOKED_CLOSER]:
        best = minimize_scalar(lambda log: -_finite(merit(float(np.exp(log)))), method='bounded',
                               bounds=np.log([xs[k - 1], xs[k + 1]]), options={'maxiter': 20})
        if best.fun < 0:
            points.append(float(np.exp(best.x)))
    return points


def _end(merit: Callable[[float], float], good: float, bad: float) -> float:
    """Return the last x of positive merit on the way from `good` to `bad`."""
    root = brentq(lambda log: _finite(merit(float(np.exp(log)))), np.log(good), np.log(bad),
                  xtol=_END)
    back = _END if good > bad else -_END
    for steps in (0, 1, 2, 4):
        x = float(np.exp(root + steps * back))
        if merit(x) > 0:
            return x
    return good


def _finite(value: float) -> float:
    return max(value, -_WORST)


def _filled(xs: list[float]) -> list[float]:
    """Return ascending `xs` with as many between them as make an interval's samples."""
    while 1 < len(xs) < _SAMPLES:
        xs = sorted({*xs, *(float(x) for x in np.sqrt(np.multiply(xs[1:], xs[:-1])))})
    return xs


def minima(cost: Callable[[float], float], merit: Callable[[float], float],
           xs: list[float]) -> list[tuple[float, float]]:
    """Return [(cost, x)], best first: the local minima of `cost` over an interval."""
    def judged(log: float) -> float:
        x = float(np.exp(log))
        return cost(x) if merit(x) > 0 else worst

    values = [cost(x) for x in xs]
    worst = max(values) + 1.0
    pairs = []
    for k, x in enumerate(xs):
        around = xs[max(k - 1, 0):k + 2]
        if values[k] > min(values[max(k - 1, 0):k + 2]):
            continue
        pairs.append((values[k], x))
        if len(around) > 1:
            best = minimize_scalar(judged, method='bounded', bounds=np.log([around[0], around[-1]]),
                                   options={'xatol': _CLOSE})
            if best.fun < values[k]:
                pairs[-1] = (float(best.fun), float(np.exp(best.x)))
    return best_first(pairs)


def best_first(pairs: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return pairs (cost, x) ordered by cost; where costs differ by rounding errors only, by x."""
    unit = _ALIKE * max((abs(cost) for cost, _ in pairs), default=0.0) or 1.0
    return sorted(pairs, key=lambda one: (round(one[0] / unit), one[1]))
