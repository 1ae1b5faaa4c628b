# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A small shift of the gripper beside its path, as a spline in time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import results
from dlo_planner.model.value import Value, put

DEGREE = 4  # jerks are continuous


@dataclass(frozen=True, eq=False)
class Shift(Value):
    """A displacement (3,) of the gripper over the time of a leg, m, world axes; zero at both ends.

    Attributes
    ----------
    knots : ndarray, shape (k,)
        Knots in s, of a BSpline of degree 4, clamped at both ends.
    coefficients : ndarray, shape (k - 5, 3)
        Coefficients in m; the first and the last four are zero, so that the shift and its first
        three derivatives vanish at both ends.
    """

    knots: Floats
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
