# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One waypoint of a plan in the making: a shape in its place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape, carried
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import hole_clearances
from dlo_planner.plan.passing import Passes

_FREE = (np.inf,) * 3


class Waypoint(NamedTuple):
    """A Shape in its place, and how well it passes a center."""

    shape: Shape
    misalignment: float = 0.0
    position_error: float = 0.0
    via_points: Passes = ()
    clearances: tuple[Sequence[float] | Floats, ...] = ()
    sheets: tuple[tuple[Sheet, Floats], ...] = ()

    @property
    def clearance(self) -> float:
        """Smallest of the clearances, m."""
        return min((float(min(rooms)) for rooms in self.clearances), default=np.inf)

    def with_via_point(self, center: Floats, s: float) -> Waypoint:
        """Return the same waypoint, its error that of the worse of this and another center."""
        other = float(np.linalg.norm(self.shape.frame_at(s)[1] - center))
        return self._replace(position_error=max(self.position_error, other),
                             via_points=(*self.via_points, (center, s, None)))

    def with_clearances(self, cutouts: Sequence[CutOut], sheets: Sequence[Sheet | None],
                        surface: Surface) -> Waypoint:
        """Return the same waypoint with its clearances in CutOuts.

        Parameters
        ----------
        cutouts : sequence of CutOut
        sheets : sequence of Sheet or None
            The sheet of each.
        surface : Surface
            Surface of the DLO.
        """
        both = [(sheet, cutout.normal) for cutout, sheet in zip(cutouts, sheets, strict=True)]
        return Waypoint(  # quicker than `_replace`
            self.shape, self.misalignment, self.position_error, self.via_points,
            clearances=tuple([
                _FREE if sheet is None else hole_clearances(sheet, normal, surface, self.shape)
                for sheet, normal in both]),
            sheets=tuple([(sheet, normal) for sheet, normal in both if sheet is not None]))


def waypoint_of(shape: Shape, center: Floats, s: float, normal: Floats | None,
                known: tuple[Floats, Floats] | None = None) -> Waypoint:
    """Return the Waypoint of a Shape carried so that it passes `center` at `s`: section 5.2.

    Parameters
    ----------
    shape : Shape
    center : ndarray, shape (3,)
        World, m.
    s : float
        Arc length, m.
    normal : ndarray, shape (3,), or None
        Along which it should pass; None: along any.
    known : (ndarray, ndarray), optional
        What `shape.frame_at(s)` returns.
    """
    axes, position = shape.frame_at(s) if known is None else known
    displacement = center - position
    return _waypoint(carried(shape, displacement), axes, position + displacement, center, s, normal)


def waypoint_at(shape: Shape, center: Floats, s: float, normal: Floats | None) -> Waypoint:
    """Return the Waypoint of a Shape that should pass `center` at `s`, where it is."""
    return _waypoint(shape, *shape.frame_at(s), center, s, normal)


def _waypoint(shape: Shape, axes: Floats, position: Floats, center: Floats, s: float,
              normal: Floats | None) -> Waypoint:
    """Return the Waypoint of a Shape with these `axes` (3, 3) and this `position` (3,) at `s`."""
    angle = 0.0
    if normal is not None:
        along = axes[:, 0] @ normal
        angle = math.atan2(length_of(axes[:, 0] - along * normal), along)
    return Waypoint(shape, angle, length_of(position - center), ((center, s, normal),))


def length_of(v: Floats) -> float:
    """Return the length of a vector (3,): for one, quicker than `np.linalg.norm`."""
    return math.hypot(*v.tolist())
