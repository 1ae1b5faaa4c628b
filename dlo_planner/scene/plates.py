# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks and plates with holes, told from the triangles that a CAD program made of them.

What is a block or a plate is worth more as such: its distance is exact and quick, and a DLO can be
threaded through its holes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import pi, tau
from typing import NamedTuple

import numpy as np

from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Box, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import Surface

_SAME = 1e-5  # of the size: files have float32, of places that are centimeters from their origin
_ALONG = 1e-4  # rad: normals that count as one, and edges as one line
_UPRIGHT = 1e-3  # rad: how far a wall may lean, of which single precision knows the corners
_FEWEST = 12  # corners of a hole that counts as round: a hexagon is none
_ROUND = 2e-3  # of the radius: how far corners of a round hole may lie off its circle
_MOST_CORNERS = 4096  # of a face with holes


class _Loop(NamedTuple):
    """A closed line on the face of a plate; it goes round an outline to the left."""

    corners: Floats  # (n, 2) m, those that are none (on a straight edge) left out

    @property
    def area(self) -> float:
        """Area in m2, negative of a hole."""
        x, y = (self.corners - self.corners[0]).T
        return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


class Rectangle(NamedTuple):
    """A rectangle in a plane."""

    center: Floats  # (2,) m
    axis: Floats  # (2,) unit vector along one side
    size: Floats  # (2,) full sizes along the axis and across it, m


class Circle(NamedTuple):
    """A circle in a plane: the largest one within the corners of what was taken for round."""

    center: Floats  # (2,) m
    radius: float  # m


def recognized(surface: Surface) -> Box | Sheet | None:
    """Return the Box, or the Sheet with its cut-outs, that triangles are; None of other solids.

    A plate has all its corners in two parallel planes, a rectangular outline, and holes straight
    through it that are round (with twelve corners or more) or rectangular. A round hole is as
    large as the circle within the polygon of the file.

    Parameters
    ----------
    surface : Surface
        Triangles that enclose a solid, in m.
    """
    vertices, faces = surface
    normals, areas = _normals(surface)
    for normal in _directions(normals, areas):
        heights = vertices @ normal
        low, high = float(heights.min()), float(heights.max())
        size = float(np.ptp(vertices, axis=0).max())
        if not ((heights - low < _SAME * size) | (high - heights < _SAME * size)).all():
            continue
        above = heights[faces] > 0.5 * (low + high)
        top, walls = above.all(axis=1), above.any(axis=1) & ~above.all(axis=1)
        if np.abs(normals[walls] @ normal).max() > _UPRIGHT:
            continue
        frame = Pose.looking_along(0.5 * (low + high) * normal, normal)
        flat = (vertices - frame.position) @ frame.rotation[:, 1:]
        found = _plate(frame, high - low, _loops(faces[top], flat), _SAME * size)
        if found is not None:
            return found
    return None


def _plate(frame: Pose, thickness: float, loops: Sequence[_Loop] | None,
           close: float) -> Box | Sheet | None:
    """Return what lies between two faces with these edges, in the plane of a frame's y and z."""
    outlines = [loop for loop in loops or () if loop.area > 0]
    if loops is None or len(outlines) != 1:
        return None
    outline = rectangle_of(outlines[0].corners, close)
    if outline is None:
        return None
    pose = _there(frame, outline.center, outline.axis)
    if len(loops) == 1:
        return Box(pose, (thickness, *outline.size))
    cutouts = []
    for loop in loops:
        if loop is outlines[0]:
            continue
        hole = circle_of(loop.corners) or rectangle_of(loop.corners[::-1], close)
        if hole is None:
            return None
        cutouts.append(
            CutOut(_there(frame, hole.center, outline.axis), radius=hole.radius)
            if isinstance(hole, Circle) else
            CutOut(_there(frame, hole.center, hole.axis), width=float(hole.size[0]),
                   height=float(hole.size[1])))
    return Sheet(pose, float(outline.size[0]), float(outline.size[1]), thickness, tuple(cutouts))


def rectangle_of(corners: Floats, close: float) -> Rectangle | None:
    """Return the rectangle with four corners (4, 2), m, to the left round it; None of others."""
    if len(corners) != 4:
        return None
    one, other = corners[1] - corners[0], corners[2] - corners[1]
    if max(np.abs(corners[0] + corners[2] - corners[1] - corners[3])) > 4 * close:
        return None  # no parallelogram
    size = np.array([np.linalg.norm(one), np.linalg.norm(other)])
    if abs(one @ other) > max(_ALONG * size.prod(), close * size.max()):
        return None
    return Rectangle(corners.mean(axis=0), one / size[0], size)


def circle_of(corners: Floats) -> Circle | None:
    """Return the circle within corners (n, 2), m, that are those of a round hole; else None."""
    if len(corners) < _FEWEST:
        return None
    middle = corners.mean(axis=0)
    x, y = (corners - middle).T
    (a, b, c), *_ = np.linalg.lstsq(np.column_stack([x, y, np.ones_like(x)]), x**2 + y**2,
                                    rcond=None)
    center = middle + 0.5 * np.array([a, b])
    radius = float(np.sqrt(max(c + 0.25 * (a**2 + b**2), 0.0)))
    away = corners - center
    if np.abs(np.linalg.norm(away, axis=1) - radius).max() > _ROUND * radius:
        return None
    turns = np.arctan2(away[:, 1], away[:, 0])
    steps = np.abs((np.roll(turns, -1) - turns + pi) % tau - pi)
    if steps.max() > tau / _FEWEST * (1 + _ROUND):
        return None
    sides = np.roll(corners, -1, axis=0) - corners
    across = np.abs(sides[:, 0] * away[:, 1] - sides[:, 1] * away[:, 0])
    return Circle(center, float((across / np.linalg.norm(sides, axis=1)).min()))


def _there(frame: Pose, center: Floats, axis: Floats) -> Pose:
    """Return a pose in the plane of a frame's y and z: its y axis along a direction (2,) there."""
    x, y = frame.rotation[:, 0], frame.rotation[:, 1:] @ axis
    return Pose.from_rotation(frame.position + frame.rotation[:, 1:] @ center,
                              np.column_stack([x, y, np.cross(x, y)]))


def _normals(surface: Surface) -> tuple[Floats, Floats]:
    """Return unit normals (m, 3) and areas (m,), m2, of triangles."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    return normals / areas[:, None], 0.5 * areas


def _directions(normals: Floats, areas: Floats) -> list[Floats]:
    """Return up to three normals (3,) of much area, none of them along another one."""
    found: list[Floats] = []
    left: Bools = np.ones(len(areas), dtype=bool)
    while left.any() and len(found) < 3:
        best = normals[left][np.argmax(areas[left])]
        same = np.linalg.norm(np.cross(normals, best), axis=1) < _ALONG
        mean = (areas[same, None] * normals[same] * np.sign(normals[same] @ best)[:, None]
                ).sum(axis=0)
        # a hole leads upwards, or along the world's axes: which side is the front nobody says
        found.append(mean / np.linalg.norm(mean) * np.sign(mean[np.argmax(np.abs(mean))]))
        left &= ~same
    order = [float(areas[np.linalg.norm(np.cross(normals, one), axis=1) < _ALONG].sum())
             for one in found]
    return [found[k] for k in np.argsort(order)[::-1]]


def _loops(faces: Ints, flat: Floats) -> list[_Loop] | None:
    """Return the edges of a face of triangles as loops; None where they do not close."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there = {(int(a), int(b)) for a, b in edges}
    following: dict[int, int] = {}
    for a, b in there:
        if (b, a) in there:
            continue
        if a in following:
            return None  # two loops that touch
        following[a] = b
    if len(following) > _MOST_CORNERS:
        return None
    loops = []
    while following:
        start = next(iter(following))
        line = [start]
        while (ahead := following.pop(line[-1], None)) not in (None, start):
            line.append(int(ahead))
        if ahead is None:
            return None
        loops.append(_Loop(_corners(flat[line])))
    return loops


def _corners(line: Floats) -> Floats:
    """Return the points (n, 2) of a closed line at which it turns."""
    ahead = np.roll(line, -1, axis=0) - line
    behind = np.roll(ahead, 1, axis=0)
    turn = np.abs(np.arctan2(behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0],
                             (behind * ahead).sum(axis=1)))
    corners: Floats = line[turn > _ALONG]
    return corners


# ---- and back: a plate as convex pieces ------------------------------------------------------


_SIDES = 48  # of the polygon around a round hole: it is 0.2 % wider than the hole at its corners


def pieces_of(sheet: Sheet) -> list[Floats]:
    """Return the convex pieces of a Sheet, each as its corners (8, 3) in m, in the sheet's frame.

    They fill the sheet but its holes, of a round one the polygon around it: for programs that know
    no plates with holes. A sheet without thickness has none to fill, and gets 1 micrometer.
    """
    half = 0.5 * max(sheet.thickness, 1e-6)
    holes = [_polygon(sheet, cutout) for cutout in sheet.cutouts]
    y, z = 0.5 * sheet.width, 0.5 * sheet.height
    ends = np.unique(np.concatenate([[-y, y], *(hole[:, 0] for hole in holes)]).clip(-y, y))
    ends = ends[np.concatenate([[True], np.diff(ends) > _SAME * sheet.width])]
    out = []
    for left, right in pairwise(ends):
        middle = 0.5 * (left + right)
        # lower and upper edge of each hole at both ends of this slab, from below to above
        spans = sorted((np.array([_cut(hole, at, middle) for at in (left, right)])
                        for hole in holes if hole[:, 0].min() < middle < hole[:, 0].max()),
                       key=lambda span: float(span.mean()))
        levels = [np.array([-z, -z]), *(span[:, k] for span in spans for k in (0, 1)),
                  np.array([z, z])]
        for below, above in zip(levels[::2], levels[1::2], strict=True):
            if (above - below).max() > _SAME * sheet.height:
                flat = [(left, below[0]), (right, below[1]), (right, above[1]), (left, above[0])]
                out.append(np.array([(x, *one) for x in (-half, half) for one in flat]))
    return out


def _polygon(sheet: Sheet, cutout: CutOut) -> Floats:
    """Return the corners (n, 2) of a cut-out in its sheet's y and z, m."""
    local = sheet.pose.inverse().compose(cutout.pose)
    if cutout.radius is not None:
        turns = tau * np.arange(_SIDES) / _SIDES
        around = np.column_stack([np.cos(turns), np.sin(turns)]) * (
            cutout.radius / np.cos(pi / _SIDES))
    else:
        assert cutout.width is not None and cutout.height is not None
        around = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (
            cutout.width, cutout.height)
    corners: Floats = local.position[1:] + around @ local.rotation[1:, 1:].T
    return corners


def _cut(polygon: Floats, at: float, beside: float) -> tuple[float, float]:
    """Return least and largest z of a convex polygon at a y, those of edges that go by `beside`."""
    found = []
    for (y, z), (y2, z2) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if min(y, y2) < beside < max(y, y2):
            found.append(float(z + (z2 - z) * (at - y) / (y2 - y)))
    return min(found), max(found)
