# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How much room a DLO has in its cut-outs, and beside obstacles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.energy.gap import (
    closest_point_in_element,
    least_gap,
    node_gap,
    node_range,
    radius_at,
    radius_at_node,
    stretch,
    taper,
)
from dlo_planner.energy.scene import AXIS, FACE, NODE_FACE, SHEET, Scene, build_scene, in_plane
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.so3 import inner
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface

_WIDE = 100.0    # times the length: a sheet without an end
_FLUSH = 1e-9    # of the length: a node that near to a plane is in it
_SECANTS = 60
_EXACT = 1e-15   # of an element's height: how exactly it is cut at a plane
_KNOWN = 1e-9    # of the length: how exactly the smallest gap is known, 128 times that at worst
SheetSide: TypeAlias = tuple[Sheet, Floats]      # and the normal (3,) from before it to behind it


def sheet_of(cutout: CutOut, length: float, obstacles: Iterable[Obstacle] = ()) -> Sheet | None:
    """Return the Sheet around a CutOut: one of the obstacles, or one without thickness or end.

    None for a cut-out without a size.
    """
    if cutout.radius is None and cutout.width is None:
        return None
    for obstacle in obstacles:
        if isinstance(obstacle, Sheet) and cutout in obstacle.cutouts:
            return obstacle
    pose = Pose.from_rotation(cutout.pose.position, cutout.pose.rotation)
    return Sheet(pose, _WIDE * length, _WIDE * length, 0.0, (cutout,))


def clearance(obstacles: Iterable[Obstacle], surface: Surface | float, shape: Shape) -> float:
    """Return the smallest distance in m between a DLO's surface and obstacles (< 0: inside)."""
    return _clearance(build_scene(obstacles, surface, shape.s, sharp=True, outlines=True), shape)


def _clearance(scene: Scene, shape: Shape) -> float:
    return float(_smallest(scene, *kernel_arrays(shape), np.zeros(3), np.inf)[3])


def scene_about(sheet: Sheet, surface: Surface | float, s: Floats) -> Scene:
    """Return the Scene of a Sheet relative to its middle, for nodes at arc lengths s (n,), m."""
    return build_scene([sheet], surface, s, sharp=True)._replace(
        origin=np.array(sheet.pose.position))


def hole_clearances(sheet: Sheet, normal: ArrayLike, surface: Surface | float,
                    shape: Shape, scene: Scene | None = None) -> Floats:
    """Return the distances (3,) in m between a DLO's surface and a Sheet, by parts of the DLO.

    The first: of what is in the plate, to the rim; by as much the cut-out may be displaced in its
    plane. The others: of what is before the plate and behind it, to its faces and edges; they are
    the smaller ones where the DLO bends back to the sheet, or passes obliquely. Infinite for a
    part that does not exist, negative where the DLO would be in the material. Of a rectangular DLO
    the four edges count, each where it is.

    Shapes: normal (3,).
    """
    middle = np.array(sheet.pose.position)
    scene = scene_about(sheet, surface, shape.s) if scene is None else scene
    lengths, strains, frames, positions = kernel_arrays(shape)
    result: Floats = _smallest(scene, lengths, strains, frames, positions - middle,
                               np.array(normal, dtype=float), 0.5 * sheet.thickness)[:3]
    return result


class Bodies:
    """What a DLO may come near to: sheets around cut-outs, and obstacles; scenes are made once.

    `check` is called between the steps of a long computation; it may raise. `apart` is how far (m)
    the DLO has to stay away from all of it: what `exact` and `rooms` say is beyond that.
    """

    def __init__(self, sheets: Iterable[SheetSide], obstacles: Iterable[Obstacle],
                 surface: Surface, check: Callable[[], None] = lambda: None,
                 apart: float = 0.0) -> None:
        self._sheets, self._surface, self.check = tuple(sheets), surface, check
        self.apart = apart
        around = [sheet for sheet, _ in self._sheets]
        self._others = [one for one in obstacles if not any(one is sheet for sheet in around)]
        self._all = [*around, *self._others]
        # of all, of what is no sheet, and about each sheet, by mesh
        self._scenes: dict[bytes, tuple[Scene, Scene, list[Scene]]] = {}

    def __bool__(self) -> bool:
        return bool(self._all)

    def holes(self, shape: Shape) -> list[Floats]:
        """Return the distances (3,) of `hole_clearances` from each sheet, m."""
        return [hole_clearances(*sheet, self._surface, shape, scene)
                for sheet, scene in zip(self._sheets, self._known(shape)[2], strict=True)]

    def exact(self, shape: Shape) -> float:
        """Return the smallest distance of a Shape in m, negative inside; inf without a body.

        Less `apart`.
        """
        self.check()
        rooms = [float(room.min()) for room in self.holes(shape)]
        if self._others:
            rooms.append(_clearance(self._known(shape)[1], shape))
        return min(rooms, default=np.inf) - self.apart

    def called_at(self, shape: Shape) -> str:
        """Return how that is called which a Shape is deepest in, or nearest to."""
        rooms: list[tuple[float, Obstacle]] = [
            (float(room.min()), sheet)
            for room, (sheet, _) in zip(self.holes(shape), self._sheets, strict=True)]
        rooms += [(clearance([one], self._surface, shape), one) for one in self._others]
        _, nearest = min(rooms, key=lambda room: room[0])
        return nearest.name or 'the sheet or an obstacle'

    def rooms(self, shape: Shape, least: float = -np.inf) -> Floats:
        """Return (N,) a lower bound in m of the distance of each element, none below `least`."""
        found = element_rooms(self._known(shape)[0], *kernel_arrays(shape), least + self.apart)
        result: Floats = found - self.apart
        return result

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

    def _known(self, shape: Shape) -> tuple[Scene, Scene, list[Scene]]:
        """Return the Scenes of the bodies for the mesh of a Shape."""
        key = shape.s.tobytes() if self._surface.rod is not None else b''
        if key not in self._scenes:
            self._scenes[key] = (
                build_scene(self._all, self._surface, shape.s, sharp=True, outlines=True),
                build_scene(self._others, self._surface, shape.s, sharp=True, outlines=True),
                [scene_about(sheet, self._surface, shape.s) for sheet, _ in self._sheets])
        return self._scenes[key]


@kernel
def _smallest(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
              normal: Floats, half: float) -> Floats:
    """Return the smallest gaps (4,): in the plate, before it, behind it, of all.

    Each part is closed: where the DLO passes a face belongs to both sides of it.

    Args:
        positions: (N + 1, 3) from the scene's origin
        normal: (3,) of a plate there; half: of its thickness, m; infinite: there is no plate
    """
    nodes = positions.shape[0]
    frame, x, offset = np.empty((3, 3)), np.empty(3), np.zeros(2)
    slope, bend = np.empty(3), np.empty((3, 3))
    flush, exact = _FLUSH * np.sum(lengths), _KNOWN * np.sum(lengths)
    gaps, heights, cuts = np.empty(nodes), np.empty(nodes), np.empty(4)
    out = np.full(4, np.inf)
    for o in range(scene.kind.size):
        if scene.feature[o] == NODE_FACE:
            continue  # the face itself is looked at everywhere
        begin, end = node_range(scene, o, nodes - 1)
        for k in range(begin, end + 1):
            gaps[k] = node_gap(scene, o, k, rotations, positions, offset, x, slope, bend)
            _shifted(scene, o, rotations[k], positions[k], x)
            heights[k] = inner(normal, x)
            part = _part(heights[k], half, flush)
            out[part] = min(out[part], gaps[k])
        for e in range(begin, end):
            # no point of an element comes nearer than half its length beyond its nodes' mean
            bound = 0.5 * (gaps[e] + gaps[e + 1] - _reach(scene, o, e, lengths, strains))
            if scene.kind[o] == SHEET and bound < 2.0 * scene.size[o, 0] - min(
                    radius_at(scene, o, e, 0.0), radius_at(scene, o, e, 1.0)):
                bound -= 2.0 * scene.size[o, 0]  # at once, in the other layer's material
            part = _part(heights[e], half, flush)
            if part == _part(heights[e + 1], half, flush) and bound >= out[part]:
                continue
            pieces = 1
            cuts[0] = 0.0
            for side in ((-1, 1) if heights[e] < heights[e + 1] else (1, -1)):
                last, following = heights[e] - side * half, heights[e + 1] - side * half
                if last * following < 0.0 and min(abs(last), abs(following)) > flush:
                    cuts[pieces] = _passage(scene, o, lengths, strains, rotations, positions, e,
                                            normal, side * half, last, frame, x)
                    pieces += 1
            cuts[pieces] = 1.0
            for piece in range(pieces):
                _place(scene, o, lengths, strains, rotations, positions, e,
                       0.5 * (cuts[piece] + cuts[piece + 1]), frame, x)
                part = _part(inner(normal, x), half, flush)
                if bound < out[part]:
                    _, _, gap = least_gap(scene, o, e, cuts[piece], cuts[piece + 1], out[part],
                                          exact, lengths, strains, rotations, positions)
                    out[part] = min(out[part], gap)
        if half < np.inf:
            gap, height = _at_the_rim(scene, o, lengths, strains, rotations, positions, heights,
                                      normal, flush)
            out[0] = min(out[0], gap)
            for part, face in ((1, -half), (2, half)):
                # where it leaves the plate belongs to what is outside as well, if anything is
                if abs(height - face) <= flush and out[part] < np.inf:
                    out[part] = min(out[part], gap)
    out[3] = np.min(out[:3])
    return out


@kernel
def _reach(scene: Scene, o: int, e: int, lengths: Floats, strains: Floats) -> Any:
    """Return by how much gaps change along element e at most, m."""
    return lengths[e] * stretch(scene, o, strains[e]) + abs(taper(scene, o, e))


@kernel
def _place(scene: Scene, o: int, lengths: Floats, strains: Floats, rotations: Floats,
           positions: Floats, e: int, fraction: float, frame: Floats, x: Floats) -> None:
    """Fill frame (3, 3) and place (3,), from the scene's origin, of the DLO's feature for `o`."""
    point_inside(lengths, strains, rotations, positions, e, fraction, frame, x)
    _shifted(scene, o, frame, x, x)


@kernel
def _shifted(scene: Scene, o: int, frame: Floats, axis: Floats, x: Floats) -> None:
    """Fill x (3,) with the place of the DLO's feature for `o`, the axis at `axis` (3,)."""
    beside = scene.feature[o] != AXIS and scene.feature[o] < FACE
    for i in range(3):
        x[i] = axis[i]
        if beside:
            x[i] += frame[i, 1] * scene.offset[o, 0] + frame[i, 2] * scene.offset[o, 1]


@kernel
def _part(height: float, half: float, flush: float) -> int:
    """Return in which part of a DLO a point lies: 0 in the plate, 1 before it, 2 behind it."""
    if abs(height) <= half + flush:
        return 0
    return 1 if height < 0.0 else 2


@kernel
def _at_the_rim(scene: Scene, o: int, lengths: Floats, strains: Floats, rotations: Floats,
                positions: Floats, heights: Floats, normal: Floats,
                flush: float) -> tuple[float, float]:
    """Return the smallest gap where the DLO meets the face of layer `o`, and its height in m.

    It meets the plane where it passes from one side to the other, and with each node that is
    nearer to it than `flush` in m: on which side of zero the height of an end in the plane falls
    does not count.
    """
    smallest = np.inf
    frame, x = np.empty((3, 3)), np.empty(3)
    plane = inner(normal, scene.center[o] + scene.size[o, 0] * scene.axes[o, :, 0] - scene.origin)
    last = 0.0
    begin, end = node_range(scene, o, heights.size - 1)
    for k in range(begin, end + 1):
        height = heights[k] - plane
        if abs(height) <= flush:
            height = 0.0
            _shifted(scene, o, rotations[k], positions[k], x)
            smallest = min(smallest, _room_in_plane(scene, o, x) - radius_at_node(scene, o, k))
        elif last * height < 0.0:
            fraction = _passage(scene, o, lengths, strains, rotations, positions, k - 1, normal,
                                plane, last, frame, x)
            smallest = min(smallest, _room_in_plane(scene, o, x)
                           - radius_at(scene, o, k - 1, fraction))
        last = height
    return smallest, plane


@kernel
def _passage(scene: Scene, o: int, lengths: Floats, strains: Floats, rotations: Floats,
             positions: Floats, e: int, normal: Floats, plane: float, begin: float, frame: Floats,
             x: Floats) -> float:
    """Return the fraction of element e, which begins at the height `begin`, in a plane; fill x."""
    low, high, at_low, last = 0.0, 1.0, begin, 0
    _place(scene, o, lengths, strains, rotations, positions, e, high, frame, x)
    at_high: float = inner(normal, x) - plane
    for _ in range(_SECANTS):
        fraction = low + (high - low) * at_low / (at_low - at_high)
        _place(scene, o, lengths, strains, rotations, positions, e, fraction, frame, x)
        height: float = inner(normal, x) - plane
        if abs(height) <= _EXACT * abs(begin - at_high):
            break
        # that the same end stays twice makes it count half: the Illinois rule
        if height * begin > 0.0:
            low, at_low = fraction, height
            at_high, last = at_high * (0.5 if last == 1 else 1.0), 1
        else:
            high, at_high = fraction, height
            at_low, last = at_low * (0.5 if last == 2 else 1.0), 2
    return fraction


@kernel
def _room_in_plane(scene: Scene, o: int, x: Floats) -> Any:
    """Return how far (m) x (3,), from the scene's origin, is from the material in its own plane."""
    y = z = 0.0
    for i in range(3):
        away = x[i] + scene.origin[i] - scene.center[o, i]
        y += scene.axes[o, i, 1] * away
        z += scene.axes[o, i, 2] * away
    gap, _ = in_plane(scene, o, y, z, np.empty(2))
    return gap


def nearest(scene: Scene, shape: Shape) -> list[tuple[float, float, Floats]]:
    """Return [(gap in m, arc length in m, unit normal (3,))] of the DLO's nearest points."""
    s = np.array(shape.s)
    return [_nearest(scene, o, s, *kernel_arrays(shape)) for o in range(scene.kind.size)]


@kernel
def _nearest(scene: Scene, o: int, s: Floats, lengths: Floats, strains: Floats, rotations: Floats,
             positions: Floats) -> tuple[float, float, Floats]:
    x, slope, bend, normal = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(3)
    offset, last = np.zeros(2), 0.0
    smallest, where = np.inf, 0.0
    begin, end = node_range(scene, o, positions.shape[0] - 1)
    for k in range(begin, end + 1):
        gap = node_gap(scene, o, k, rotations, positions, offset, x, slope, bend)
        if gap < smallest:
            smallest, where = gap, s[k]
            normal[:] = slope
        between, last = 0.5 * (gap + last), gap
        if k > begin and between - 0.5 * _reach(scene, o, k - 1, lengths, strains) < smallest:
            gap, fraction = closest_point_in_element(scene, o, k - 1, 0.0, lengths, strains,
                                                     rotations, positions, slope, bend)
            if gap < smallest:
                smallest, where = gap, s[k - 1] + fraction * lengths[k - 1]
                normal[:] = slope
    return smallest, where, normal


@kernel
def element_rooms(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats,
                  positions: Floats, least: float) -> Floats:
    """Return (N,) a lower bound in m of the room of each element, none below the `least` of all."""
    x, slope, bend, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    rooms = np.full(lengths.size, np.inf)
    for o in range(scene.kind.size):
        if scene.feature[o] == NODE_FACE:
            continue
        last = 0.0
        begin, end = node_range(scene, o, lengths.size)
        for k in range(begin, end + 1):
            gap = node_gap(scene, o, k, rotations, positions, offset, x, slope, bend)
            if k > begin:
                e = k - 1
                rooms[e] = min(rooms[e], 0.5 * (gap + last - _reach(scene, o, e, lengths, strains)))
            last = gap
    return np.maximum(rooms, least)  # type: ignore[no-any-return]


def nearest_in_hole(scene: Scene, normal: Floats, shape: Shape) -> tuple[float, float, Floats]:
    """Return the clearance (m) of a round DLO in the hole of a Scene of one Sheet, and its slope.

    That is the smallest of `hole_clearances`. The others: the arc length of the place where it is,
    m, and its derivative (3,) by the displacement of that place. The scene is relative to the
    world's origin, the normal (3,) from before the sheet to behind it.
    """
    at_rim = _at_rims(scene, np.array(shape.s), *kernel_arrays(shape), normal)
    return min((at_rim, *nearest(scene, shape)), key=lambda place: place[0])


@kernel
def _at_rims(scene: Scene, s: Floats, lengths: Floats, strains: Floats, rotations: Floats,
             positions: Floats, normal: Floats) -> tuple[float, float, Floats]:
    """Return the smallest gap (m) where a DLO meets a sheet's faces, its arc length and slope.

    The point that meets a face stays in it, so it moves along the DLO where that moves across.
    """
    smallest, where, slope = np.inf, 0.0, np.zeros(3)
    frame, x = np.empty((3, 3)), np.empty(3)
    flush = _FLUSH * np.sum(lengths)
    for o in range(scene.kind.size):
        plane = inner(normal, scene.center[o] + scene.size[o, 0] * scene.axes[o, :, 0])
        last = 0.0
        for k in range(s.size):
            height = inner(normal, positions[k]) - plane
            e, fraction = max(k - 1, 0), 1.0 if k else 0.0
            if abs(height) <= flush:
                height = 0.0
                point_inside(lengths, strains, rotations, positions, e, fraction, frame, x)
            elif last * height < 0.0:
                fraction = _passage(scene, o, lengths, strains, rotations, positions, e, normal,
                                    plane, last, frame, x)
            else:
                last = height
                continue
            last = height
            gap = _room_in_plane(scene, o, x) - scene.radius
            if gap < smallest:
                smallest, where = gap, s[e] + fraction * lengths[e]
                _slope_in_plane(scene, o, x, frame[:, 0], normal, slope)
    return smallest, where, slope


@kernel
def _slope_in_plane(scene: Scene, o: int, x: Floats, tangent: Floats, normal: Floats,
                    slope: Floats) -> None:
    """Fill slope (3,) of the room at x (3,) in a plane, by displacements of a DLO that meets it.

    A DLO that lies in the plane does not slide along itself.
    """
    inside, y, z = np.empty(2), 0.0, 0.0
    for i in range(3):
        y += scene.axes[o, i, 1] * (x[i] - scene.center[o, i])
        z += scene.axes[o, i, 2] * (x[i] - scene.center[o, i])
    in_plane(scene, o, y, z, inside)
    for i in range(3):
        slope[i] = scene.axes[o, i, 1] * inside[0] + scene.axes[o, i, 2] * inside[1]
    through = inner(normal, tangent)
    slide = inner(slope, tangent) / through if abs(through) > _FLUSH else 0.0
    for i in range(3):
        slope[i] -= slide * normal[i]
