# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A change of poses that is blended in: the response of moving averages to a step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import factorial

import numpy as np
from scipy.interpolate import CubicSpline

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.checks import array, number, row, shown
from dlo_planner.model.value import Value, put

MOST_TIMES = 100_000  # times in one call, as `TimedPath.at` takes
_AT_ONCE = 1e-9  # s: waypoints reached so shortly one after the other are one (a dwell)


@dataclass(frozen=True, eq=False, repr=False)
class Change(Value):
    """Change of the remaining poses, blended in from some time on.

    Attributes
    ----------
    since : float
        Time at which the blending begins, s.
    times : ndarray, shape (m,)
        Times at which the remaining waypoints are reached, s, none before the last.
    offsets : ndarray, shape (m, 6)
        Change of their poses: rotation vector, rad, then displacement, m; world axes.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    since: float
    times: Floats
    offsets: Floats

    def __post_init__(self) -> None:
        put(self, since=number('Change.since', self.since),
            times=row('Change.times', self.times, most=MOST_TIMES))
        put(self, offsets=array('Change.offsets', self.offsets, (self.times.size, 6)))
        if (np.diff(self.times) < 0).any():
            raise InvalidTask(f'Change.times = {shown(self.times.tolist())}: expected times in '
                              'ascending order')
        super().__post_init__()

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return (n, 6) the unblended change at times (n,) s, or its derivative of `order` by time.

        A cubic spline between the waypoints, constant before the first and after the last.
        """
        if self._spline is None:
            return np.repeat(self.offsets[:1] * (order == 0), len(times), axis=0)
        known = self._spline.x
        inside = np.clip(times, known[0], known[-1])
        out = self._spline(inside, order)
        if order:
            out[times != inside] = 0.0
        result: Floats = out
        return result

    @cached_property
    def _spline(self) -> CubicSpline | None:
        """CubicSpline of the offsets; None where all waypoints are reached at once."""
        kept = apart_in_time(self.times)  # a dwell reaches two at once
        if kept.sum() == 1:
            return None
        return CubicSpline(self.times[kept], self.offsets[kept], bc_type='clamped')


def step_response(times: Floats, windows: Floats, order: int = 0) -> Floats:
    """Return (n,) a unit step at time 0 averaged over moving windows, or a derivative of that.

    In closed form: the Laplace transform of a step is 1 / s, and a window of width w multiplies it
    by (1 - exp(-s w)) / (s w).

    Shapes: times (n,), windows (k,).
    """
    power, out = len(windows) - order, np.zeros(np.shape(times))
    times = np.minimum(times, np.sum(windows))  # at rest from there on
    for count in range(len(windows) + 1):
        for some in combinations(windows, count):
            since = times - sum(some)
            out += (-1) ** count * np.maximum(since, 0.0) ** power
    out /= factorial(power) * np.prod(windows)
    return out if order else np.clip(out, 0.0, 1.0)


def apart_in_time(times: Floats) -> Bools:
    """Return (n,) which of ascending times are not reached together with the one before."""
    return np.append(True, np.diff(times) > _AT_ONCE)
