# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a leg of the path is passed in time: from rest to rest, smoothed by moving averages.

Before smoothing, the parameter u of the leg has a piecewise constant acceleration, as the fastest
motion within limits has. It is then averaged over moving windows, one after the other: the gripper
stays on its path, each window adds one continuous derivative, and a vibration whose period is the
width of a window is not excited (input shaping with box filters). See `docs/theory.md`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import comb, factorial

import numpy as np
from scipy.interpolate import BPoly, BSpline, PPoly

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import results
from dlo_planner.model.value import Value, put

DEGREE = 4  # jerks are continuous


@dataclass(frozen=True, eq=False)
class Shift(Value):
    """A displacement (3,) of the gripper over the time of a leg, m, world axes; 0 at both ends."""

    knots: Floats  # (k,) knots in s, of a BSpline of degree 4, clamped at both ends
    # (k - 5, 3) coefficients in m; the first and the last four are zero, so that the shift and its
    # first three derivatives vanish at both ends
    coefficients: Floats
    _spline: BSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        knots = results('Shift.knots', self.knots, (None,))
        coefficients = results('Shift.coefficients', self.coefficients,
                               (knots.size - DEGREE - 1, 3))
        put(self, knots=knots, coefficients=coefficients,
            _spline=BSpline(knots, coefficients, DEGREE))
        super().__post_init__()

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return (n, 3) shifts in m, or their derivatives by time of `order`, at times (n,) s.

        Times outside the leg count as its ends.
        """
        result: Floats = self._spline(np.clip(times, self.knots[0], self.knots[-1]), order)
        return result

    @property
    def most(self) -> Floats:
        """(4,) bounds of the lengths of the shift, m, and of its three derivatives by time."""
        bounds, spline = [], self._spline
        for _ in range(4):
            # a spline lies in the convex hull of its coefficients
            bounds.append(np.linalg.norm(spline.c[:spline.t.size - spline.k - 1], axis=1).max())
            spline = spline.derivative()
        return np.array(bounds)


_SAME = 1e-9  # of the duration: times closer than this count as one
_HALVINGS = 50  # of the duration by bisection: to rounding


@dataclass(frozen=True, eq=False)
class TimeLaw(Value):
    """The parameter of a leg as a function of time."""

    parameters: Floats  # (m,) parameters u, increasing
    # (m,) rates du/dt there before smoothing, zero at both ends; u'' is constant in between
    rates: Floats
    windows: Floats  # (k,) widths of the moving averages, s, k >= 1
    shift: Shift | None = None  # shift of the gripper beside the leg, or None
    _progress: PPoly = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        u = results('TimeLaw.parameters', self.parameters, (None,))
        rates = results('TimeLaw.rates', self.rates, u.shape)
        windows = results('TimeLaw.windows', self.windows, (None,))
        put(self, parameters=u, rates=rates, windows=windows)
        progress = _before_smoothing(u, rates)
        for width in np.sort(windows):
            progress = _averaged(progress, width)
        put(self, _progress=progress)
        super().__post_init__()

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return float(self._progress.x[-1])

    def at(self, times: Floats, orders: int = 4) -> Floats:
        """Return (orders, n): u and its first derivatives by time, three at most, at times (n,) s.

        At rest before 0 and after the duration.
        """
        inside = np.clip(times, 0, self.duration)
        out = np.stack([self._progress(inside, order) for order in range(orders)])
        out[0] = np.clip(out[0], *self.parameters[[0, -1]])
        out[1:, times != inside] = 0.0
        return out

    def reached(self, times: Floats) -> Floats:
        """Return u (n,) at times (n,) s."""
        result: Floats = np.clip(self._progress(np.clip(times, 0, self.duration)),
                                 *self.parameters[[0, -1]])
        return result

    def slower(self, factor: float) -> TimeLaw:
        """Return the law with the rates before smoothing divided by `factor`, without a shift."""
        return TimeLaw(self.parameters, self.rates / factor, self.windows)

    def bounds(self, a: Floats, b: Floats) -> Floats:
        """Return (2, n) bounds of the sizes of u'' and u''' between times a and b (n,), s, a < b.

        A polynomial lies between its coefficients by Bernstein; where u is uneven they are large in
        few places, and what is far from there need not be slower.
        """
        pieces = self._progress.x.size - 1
        first = np.clip(np.searchsorted(self._progress.x, a, side='right') - 1, 0, pieces - 1)
        after = np.maximum(np.searchsorted(self._progress.x, b), first + 1).clip(max=pieces)
        ranges = np.stack([first, after], axis=1).ravel()
        sizes = (np.abs(BPoly.from_power_basis(self._progress.derivative(order)).c).max(axis=0)
                 for order in (2, 3))
        return np.stack([np.maximum.reduceat(np.append(size, 0.0), ranges)[::2] for size in sizes])

    @property
    def steps(self) -> Floats:
        """(m - 1,) times from one parameter to the next before smoothing, s."""
        return 2 * np.diff(self.parameters) / (self.rates[1:] + self.rates[:-1])

    def arrivals(self, parameters: Floats) -> Floats:
        """Return the times (n,), s, at which u reaches the parameters (n,)."""
        low, high = np.zeros(len(parameters)), np.full(len(parameters), self.duration)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            before = self._progress(middle) < parameters
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return high


def _before_smoothing(u: Floats, rates: Floats) -> PPoly:
    """Return the PPoly of u over time, from rest at 0 to rest."""
    steps = 2 * np.diff(u) / (rates[1:] + rates[:-1])
    coefficients = np.stack([0.5 * np.diff(rates) / steps, rates[:-1], u[:-1]])
    return PPoly(coefficients, np.append(0.0, np.cumsum(steps)), extrapolate=False)


def _averaged(progress: PPoly, width: float) -> PPoly:
    """Return the PPoly of the average of a motion from rest to rest over the `width` s before."""
    end = progress.x[-1]
    last = float(np.polyval(progress.c[:, -1], end - progress.x[-2]))
    first = float(progress.c[-1, 0])
    order = len(progress.c)
    rest = np.zeros((order, 1))
    # at rest before and after, so that the window may reach there
    padded = PPoly(np.hstack([_constant(rest, first), progress.c, _constant(rest, last)]),
                   np.concatenate([[-width], progress.x, [end + width]]))
    total = padded.antiderivative()
    knots = np.unique(np.concatenate([progress.x, progress.x + width]))
    knots = knots[np.append(True, np.diff(knots) > _SAME * knots[-1])]
    middle, half = 0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots)
    # about the middle of each interval, where it is clear which pieces it lies in
    about = np.stack([(total(middle, n) - total(middle - width, n)) / (width * factorial(n))
                      for n in range(order + 1)])
    return PPoly(np.stack([
        sum(comb(k, n) * about[k] * (-half) ** (k - n) for k in range(n, order + 1))
        for n in range(order, -1, -1)]), knots)


def _constant(coefficients: Floats, value: float) -> Floats:
    coefficients = coefficients.copy()
    coefficients[-1] = value
    return coefficients
