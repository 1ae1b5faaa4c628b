# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The lowest point of a function on a line, told by its slope where its values are not fine enough.

Near a minimum values differ by the square of the way to it, and drown in rounding errors long
before the gradient does. So the point is that where the slope along the line vanishes, and
values only have to be no higher than the first one by more than their rounding errors (the
approximate Wolfe conditions of Hager and Zhang 2005).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dlo_planner.model.arrays import Floats

_EXACT = 0.1      # of the slope may be left; with less care than this, DFP goes astray
_FALL = 1e-4      # of what the slope promises: so much lower it has to be at least
_UNTOLD = 100.0   # times the rounding errors: differences of values that tell nothing
_FARTHER_LEAST, _FARTHER = 1.1, 4.0  # times the way so far, where it still falls
_LESS = 0.9       # of the slope: what is left where no point is better
_LEAST, _MOST = 0.1, 0.9  # of the interval: where the next point may be
_TRIALS = 30
_EPS = 2.2e-16


class Point(NamedTuple):
    """Unknowns q (n,), value in J and gradient (n,) of a function there."""

    q: Floats
    value: float
    gradient: Floats


def along(look: Callable[[Floats], tuple[float, Floats]], start: Point, direction: Floats,
          noise: float) -> Point | None:
    """Return a lower Point on a line, about where its slope vanishes; None if none is lower.

    Parameters
    ----------
    look : callable
        q -> (value, gradient).
    start : Point
        Where the line begins; the gradient there points against `direction`.
    direction : ndarray, shape (n,)
        The step that is tried first.
    noise : float
        Rounding errors of values, J, but for those in proportion to them.
    """
    untold = _UNTOLD * (noise + _EPS * abs(start.value))
    first = float(start.gradient @ direction)
    lower = 0.0, first  # fractions and slopes of points between which it is lowest
    upper: tuple[float, float | None] | None = None
    best: Point | None = None
    flattest, fraction = np.inf, 1.0
    for _ in range(_TRIALS):
        q = start.q + fraction * direction
        point = Point(q, *look(q))
        slope = float(point.gradient @ direction)
        if not point.value <= start.value + _FALL * fraction * first + untold:
            upper = fraction, None
        elif abs(slope) <= -_EXACT * first:
            return point
        else:
            if best is None or abs(slope) < flattest:
                flattest, best = abs(slope), point
            if slope > 0:
                upper = fraction, slope
            else:
                lower = fraction, slope
        fraction = _next(lower, upper, first)
        if upper is not None and upper[0] - lower[0] < 1e-12 * upper[0]:
            break
    if best is None or flattest > -_LESS * first and not best.value < start.value - untold:
        return None
    return best


def _next(lower: tuple[float, float], upper: tuple[float, float | None] | None,
          first: float) -> float:
    """Return the fraction to look at between two points, or beyond the lower one.

    Parameters
    ----------
    lower, upper : (float, float)
        Fraction and slope of each; a slope of None is not known, an upper point of None neither.
    first : float
        Slope where the line begins.
    """
    begin, slope = lower
    if upper is None:  # where a parabola has its lowest point, if it has one there
        part = first / (first - slope) if slope > first else np.inf
        return min(max(part, _FARTHER_LEAST), _FARTHER) * begin
    end, rise = upper
    part = 0.5 if rise is None else slope / (slope - rise)
    return begin + min(max(part, _LEAST), _MOST) * (end - begin)
