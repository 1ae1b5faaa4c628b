# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One waypoint of a plan in the making: a shape in its place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import Bodies, sheet_of
from dlo_planner.plan.plan import Passes

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
        """Smallest of the clearances beside the sheets, m."""
        return min((float(min(rooms)) for rooms in self.clearances), default=np.inf)

    def with_via_point(self, center: Floats, s: float, normal: Floats | None = None) -> Waypoint:
        """Return the same waypoint, its errors those of the worse of this and another center."""
        other = waypoint_at(self.shape, center, s, normal)
        return self._replace(misalignment=max(self.misalignment, other.misalignment),
                             position_error=max(self.position_error, other.position_error),
                             via_points=(*self.via_points, *other.via_points))


class Holes:
    """Cut-outs of a plan and the sheets around them, of a DLO of a length (m).

    A Sheet among the obstacles with the hole of a cut-out is the one around it.
    """

    def __init__(self, cutouts: Sequence[CutOut], length: float, obstacles: Iterable[Obstacle],
                 surface: Surface) -> None:
        obstacles = tuple(obstacles)
        around = [sheet_of(cutout, length, obstacles) for cutout in cutouts]
        self._sized = [sheet is not None for sheet in around]
        self._sheets = tuple((sheet, np.array(cutout.normal)) for sheet, cutout in zip(
            around, cutouts, strict=True) if sheet is not None)
        self._bodies = Bodies(self._sheets, (), surface)

    def passed(self, waypoint: Waypoint) -> Waypoint:
        """Return a Waypoint with its clearances."""
        rooms = iter(self._bodies.holes(waypoint.shape))
        return waypoint._replace(sheets=self._sheets, clearances=tuple(
            next(rooms) if sized else _FREE for sized in self._sized))


def waypoint_at(shape: Shape, center: Floats, s: float, normal: Floats | None,
                known: tuple[Floats, Floats] | None = None) -> Waypoint:
    """Return the Waypoint of a Shape that should pass `center` at `s`, where it is.

    `known`: its axes (3, 3) and position (3,), m, at `s`, if they are.
    """
    axes, position = shape.frame_at(s) if known is None else known
    angle = 0.0
    if normal is not None:
        along = axes[:, 0] @ normal
        angle = math.atan2(length_of(axes[:, 0] - along * normal), along)
    return Waypoint(shape, angle, length_of(position - center), ((center, s, normal),))


def length_of(v: Floats) -> float:
    """Return the length of a vector (3,): for one, quicker than `np.linalg.norm`."""
    return math.hypot(*v.tolist())
