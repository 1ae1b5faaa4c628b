# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One waypoint of a plan in the making: a shape in its place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape, carried
from dlo_planner.energy.scene import Scene
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import hole_clearances, scene_about, sheet_of
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
        """Smallest of the clearances, m."""
        return min((float(min(rooms)) for rooms in self.clearances), default=np.inf)

    def with_via_point(self, center: Floats, s: float) -> Waypoint:
        """Return the same waypoint, its error that of the worse of this and another center."""
        other = float(np.linalg.norm(self.shape.frame_at(s)[1] - center))
        return self._replace(position_error=max(self.position_error, other),
                             via_points=(*self.via_points, (center, s, None)))


class Holes:
    """Cut-outs of a plan and the sheets around them, whose scenes are made once a mesh.

    Parameters
    ----------
    cutouts : sequence of CutOut
    length : float
        Length of the DLO, m.
    obstacles : iterable of obstacle
        A Sheet among them with the hole of a cut-out is the one around it.
    surface : Surface
        Surface of the DLO.
    """

    def __init__(self, cutouts: Sequence[CutOut], length: float, obstacles: Iterable[Obstacle],
                 surface: Surface) -> None:
        obstacles = tuple(obstacles)
        self._all = [(sheet_of(cutout, length, obstacles), np.array(cutout.normal))
                     for cutout in cutouts]
        self._sheets = tuple((sheet, normal) for sheet, normal in self._all if sheet is not None)
        self._surface, self._s = surface, np.empty(0)
        self._scenes: list[Scene | None] = []

    def passed(self, waypoint: Waypoint) -> Waypoint:
        """Return a Waypoint with its clearances."""
        shape = waypoint.shape
        if shape.s is not self._s:
            self._s, self._scenes = shape.s, [
                None if sheet is None else scene_about(sheet, self._surface, shape.s)
                for sheet, _ in self._all]
        return Waypoint(  # quicker than `_replace`
            shape, waypoint.misalignment, waypoint.position_error, waypoint.via_points,
            tuple([_FREE if sheet is None else hole_clearances(sheet, normal, self._surface, shape,
                                                               scene)
                   for (sheet, normal), scene in zip(self._all, self._scenes, strict=True)]),
            self._sheets)


def waypoint_of(shape: Shape, center: Floats, s: float, normal: Floats | None,
                known: tuple[Floats, Floats] | None = None) -> Waypoint:
    """Return the Waypoint of a Shape carried so that it passes `center` at `s`: section 5.2.

    Shapes: center (3,), normal (3,).
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
