# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a DLO comes to bodies, at the instants of a motion and between them.

Between two instants the nodes go along cubic polynomials of time that keep their places and
velocities (Hermite). A point leaves the even way by at most h^2/8 times its largest acceleration in
h seconds, which of a cubic is that at an end; by how much a cubic itself is off is told by those
over two intervals, which are 16 times as far off in the middle, where the DLO is known. As in
`plan.between` shapes are compared as curves, each point of an even way is at most half the distance
of both curves from the nearer one, and a distance from bodies changes no more than the place does.
Where that is not enough to show that nothing is touched, the DLO is looked at in the middle, and
so on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.scene import Scene, build_scene
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Surface
from dlo_planner.plan.between import SheetSide
from dlo_planner.plan.clearance import clearance, hole_clearances, scene_about
from dlo_planner.plan.curve_distance import curve_distances, element_rooms

_HALVINGS = 10   # of an interval between two instants
_SURE = 2.0     # times what the error of a cubic seems to be


class Nearness:
    """The distance of a DLO's surface from bodies.

    Parameters
    ----------
    sheets : iterable of SheetSide
        (Sheet, normal (3,)) around cut-outs.
    obstacles : iterable of obstacle
    surface : Surface
        Surface of the DLO.
    check : callable, optional
        Called between the steps of a long computation; it may raise.
    """

    def __init__(self, sheets: Iterable[SheetSide], obstacles: Iterable[Obstacle],
                 surface: Surface, check: Callable[[], None] = lambda: None) -> None:
        self._sheets, self._surface, self._check = tuple(sheets), surface, check
        around = [sheet for sheet, _ in self._sheets]
        self._others = [one for one in obstacles if not any(one is sheet for sheet in around)]
        self._bodies = [*around, *self._others]
        self._scenes: dict[bytes, tuple[Scene, list[Scene]]] = {}  # of all, and about each sheet

    def __bool__(self) -> bool:
        return bool(self._bodies)

    def exact(self, shape: Shape) -> float:
        """Return the smallest distance of a Shape in m, negative inside; inf without a body."""
        self._check()
        rooms = [float(hole_clearances(*sheet, self._surface, shape, scene).min())
                 for sheet, scene in zip(self._sheets, self._known(shape)[1], strict=True)]
        if self._others:
            rooms.append(clearance(self._others, self._surface, shape))
        return min(rooms, default=np.inf)

    def rooms(self, shape: Shape, least: float = -np.inf) -> Floats:
        """Return (N,) a lower bound in m of the distance of each element, none below `least`."""
        result: Floats = element_rooms(self._known(shape)[0], *shape.for_kernels, least)
        return result

    def _known(self, shape: Shape) -> tuple[Scene, list[Scene]]:
        """Return the Scene of all bodies, and those about each sheet; made once for all shapes."""
        key = shape.s.tobytes() if self._surface.rod is not None else b''
        if key not in self._scenes:
            self._scenes[key] = (
                build_scene(self._bodies, self._surface, shape.s, sharp=True),
                [scene_about(sheet, self._surface, shape.s) for sheet, _ in self._sheets])
        return self._scenes[key]

    def least(self, shapes: Sequence[Shape]) -> float:
        """Return the smallest distance of all Shapes in m; nan without a body or a shape."""
        if not (self and len(shapes)):
            return np.nan
        bounds = np.array([self.rooms(shape).min() for shape in shapes])
        best = np.inf
        for k in np.argsort(bounds):
            if bounds[k] >= best:
                break
            best = min(best, self.exact(shapes[k]))
        return best

    def least_between(self, shapes: Sequence[Shape], velocities: Floats, dt: float) -> float:
        """Return a lower bound of the distance at and between the instants of a motion, m.

        It is the smallest distance at all shapes that are looked at where they are shown to be
        clear of the bodies in between; else it is not above 0, or at most what was found between.

        Shapes: velocities (n, N + 1, 3).
        """
        best = self.least(shapes)
        if not self or len(shapes) < 2 or best <= 0:
            return best
        cubics = _Cubics(shapes, velocities, dt)
        bounds = np.array([self.rooms(shape) for shape in shapes])
        ways = cubics.ways
        short = np.maximum(ways[:, 1:], ways[:, :-1]) - np.minimum(bounds[1:], bounds[:-1])
        known: dict[int, float] = {}
        for k in map(int, np.flatnonzero(short.max(axis=1) > 0)):
            for at in (k, k + 1):
                if at not in known:
                    known[at] = self.exact(shapes[at])
            ends = ((0.0, shapes[k], known[k]), (1.0, shapes[k + 1], known[k + 1]))
            best = min(best, self._inside(cubics, k, *ends, _HALVINGS))
            if best <= 0:
                break
        return best

    def _inside(self, cubics: _Cubics, k: int, one: _Look, other: _Look, halvings: int) -> float:
        """Return a lower bound of the distance between two looks in the interval k, inf if clear.

        That is: not above 0, or the distances that were found between.
        """
        bulges = cubics.bulges(k, other[0] - one[0])
        short = -np.inf
        for (_, this, least), (_, that, _) in ((one, other), (other, one)):
            away = 0.5 * curve_distances(this, that) + bulges
            short = max(short, float((np.maximum(away[1:], away[:-1])
                                      - self.rooms(this, least)).max()))
        if short < 0:
            return np.inf
        if not halvings:
            return -short
        share = 0.5 * (one[0] + other[0])
        shape = cubics.shape(k, share)
        middle = share, shape, self.exact(shape)
        if middle[2] <= 0:
            return middle[2]
        return min(middle[2], self._inside(cubics, k, one, middle, halvings - 1),
                   self._inside(cubics, k, middle, other, halvings - 1))


_Look = tuple[float, Shape, float]  # part of an interval, Shape there, its distance in m


class _Cubics:
    """The cubic polynomials of time along which the nodes of n Shapes go, every `dt` seconds one.

    `ways` (n - 1, N + 1): how far a node may be from where it is at the nearer instant, m.
    """

    def __init__(self, shapes: Sequence[Shape], velocities: Floats, dt: float) -> None:
        self._shapes, self._velocities, self._dt = shapes, np.asarray(velocities), dt
        x, v = np.array([shape.positions for shape in shapes]), self._velocities
        moved = np.diff(x, axis=0)
        ends = np.stack([6 * moved / dt - 4 * v[:-1] - 2 * v[1:],
                         -6 * moved / dt + 2 * v[:-1] + 4 * v[1:]]) / dt
        self._accelerations = np.linalg.norm(ends, axis=3).max(axis=0)
        errors = np.zeros(len(x))
        if len(x) > 2:
            off = 0.5 * (x[2:] + x[:-2]) + 0.25 * dt * (v[:-2] - v[2:]) - x[1:-1]
            errors[1:-1] = _SURE / 16 * np.linalg.norm(off, axis=2).max(axis=1)
            errors[0], errors[-1] = errors[1], errors[-2]
        self._errors = np.maximum(errors[1:], errors[:-1])
        self.ways: Floats = (0.5 * np.linalg.norm(moved, axis=2)
                             + dt * dt / 8 * self._accelerations + self._errors[:, None])

    def bulges(self, k: int, part: float) -> Floats:
        """Return (N + 1,) by how much nodes leave an even way in a part of the interval k, m."""
        result: Floats = (part * self._dt) ** 2 / 8 * self._accelerations[k] + self._errors[k]
        return result

    def shape(self, k: int, t: float) -> Shape:
        """Return the Shape at a part t of the interval k."""
        one, other, h = self._shapes[k], self._shapes[k + 1], self._dt
        positions = ((1 + 2 * t) * (1 - t) ** 2 * one.positions + t * t * (3 - 2 * t)
                     * other.positions + h * t * (1 - t) * (
                         (1 - t) * self._velocities[k] - t * self._velocities[k + 1]))
        turns = Rotation.from_matrix(other.frames @ np.swapaxes(one.frames, 1, 2)).as_rotvec()
        frames = Rotation.from_rotvec(t * turns).as_matrix() @ one.frames
        strains = (1 - t) * one.element_strains + t * other.element_strains
        return replace(one, positions=positions, frames=frames, element_strains=strains)
