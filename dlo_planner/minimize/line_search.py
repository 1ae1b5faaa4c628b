# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The lowest point of a function on a line, told by its slope where its values are not fine enough.

Near a minimum values differ by the square of the way to it, and drown in rounding errors long
before the gradient does. So the point is that where the slope along the line vanishes, and
values only have to be no higher than the first one by more than their rounding errors (the
approximate Wolfe conditions of Hager and Zhang 2005).
"""

import numpy as np

_EXACT = 0.1      # of the slope may be left; with less care than this, DFP goes astray
_FALL = 1e-4      # of what the slope promises: so much lower it has to be at least
_UNTOLD = 100.0   # times the rounding errors: differences of values that tell nothing
_FARTHER_LEAST, _FARTHER = 1.1, 4.0  # times the way so far, where it still falls
_LESS = 0.9       # of the slope: what is left where no point is better
_LEAST, _MOST = 0.1, 0.9  # of the interval: where the next point may be
_TRIALS = 30
_EPS = 2.2e-16


def along(look, q, direction, value, gradient, noise):
    """Return a point (n,) on the way, value and gradient (n,) there; None if none is lower.

    Args:
        look: point -> (value, gradient)
        q, direction: (n,) start of the way, and the step that is tried first
        value, gradient: at q; the gradient points against `direction`
        noise: rounding errors of values, but for those in proportion to them
    """
    untold = _UNTOLD * (noise + _EPS * abs(value))
    first = gradient @ direction
    lower, upper = (0.0, first), None  # fractions and slopes of points between which it is lowest
    best, fraction = None, 1.0
    for _ in range(_TRIALS):
        at = q + fraction * direction
        new, there = look(at)
        slope = there @ direction
        if not new <= value + _FALL * fraction * first + untold:
            upper = fraction, None
        elif abs(slope) <= -_EXACT * first:
            return at, new, there
        else:
            if best is None or abs(slope) < best[0]:
                best = abs(slope), at, new, there
            if slope > 0:
                upper = fraction, slope
            else:
                lower = fraction, slope
        fraction = _next(lower, upper, first)
        if upper is not None and upper[0] - lower[0] < 1e-12 * upper[0]:
            break
    if best is None or best[0] > -_LESS * first and not best[2] < value - untold:
        return None
    return best[1:]


def _next(lower, upper, first):
    """Return the fraction to look at between two points, or beyond the lower one."""
    begin, slope = lower
    if upper is None:  # where a parabola has its lowest point, if it has one there
        part = first / (first - slope) if slope > first else np.inf
        return min(max(part, _FARTHER_LEAST), _FARTHER) * begin
    end, rise = upper
    part = 0.5 if rise is None else slope / (slope - rise)
    return begin + min(max(part, _LEAST), _MOST) * (end - begin)
