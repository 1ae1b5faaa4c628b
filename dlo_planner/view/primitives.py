# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Items as what any drawing can show: polylines and triangles, in the world."""

from typing import NamedTuple

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.view.item import Item
from dlo_planner.view.triangles import round_bar

_ROUND = 24           # sides of a cylinder and steps of a ball's equator
_HEAD, _SPREAD = 0.25, 0.1  # length and half width of an arrow's head, of the arrow's length
_EDGES = ((0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7),
          (6, 7))
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class Primitives(NamedTuple):
    """What an Item consists of.

    Attributes
    ----------
    lines : list of ndarray
        list of (n, 3) m, polylines.
    faces : list of ndarray
        list of (m, 3) m, flat polygons.
    dots : ndarray, shape (n, 3)
        Dots in m, points.
    """

    lines: list[Floats]
    faces: list[Floats]
    dots: Floats


def primitives(item: Item) -> Primitives:
    """Return the Primitives of an Item; of a text none."""
    lines: list[Floats] = []
    faces: list[Floats] = []
    dots = np.zeros((0, 3))
    if item.kind == 'line':
        lines = [item.points]
    elif item.kind == 'segments':
        lines = list(item.points.reshape(-1, 2, 3))
    elif item.kind == 'arrow':
        lines = _arrow(*item.points)
    elif item.kind == 'points':
        dots = item.points
    elif item.kind == 'triangles':
        faces = list(item.points.reshape(-1, 3, 3))
    elif item.kind == 'box':
        corners = _CORNERS * item.size
        faces = [corners[list(face)] for face in _FACES]
        lines = [corners[list(edge)] for edge in _EDGES]
    elif item.kind == 'ball':
        faces = _ball(0.5 * item.size)
    elif item.kind == 'cylinder':
        faces = _cylinder(item.size)
    turn, origin = item.pose.rotation.T, item.pose.position
    return Primitives([line @ turn + origin for line in lines],
                      [face @ turn + origin for face in faces], dots @ turn + origin)


def _arrow(start: Floats, end: Floats) -> list[Floats]:
    """Return the shaft and the two strokes of the head, in a plane as upright as can be."""
    arrow = end - start
    length = np.linalg.norm(arrow)
    if not length > 0:
        return []
    aside = np.cross(arrow, np.eye(3)[np.argmin(np.abs(arrow))])
    aside *= _SPREAD * length / np.linalg.norm(aside)
    back = end - _HEAD * arrow
    return [np.array([start, end]), np.array([back + aside, end, back - aside])]


def _ball(half: Floats) -> list[Floats]:
    around = np.linspace(0, 2 * np.pi, _ROUND + 1)
    up = np.linspace(-np.pi / 2, np.pi / 2, _ROUND // 2 + 1)
    grid = np.stack([np.outer(np.cos(up), np.cos(around)), np.outer(np.cos(up), np.sin(around)),
                     np.outer(np.sin(up), np.ones_like(around))], axis=-1) * half
    return [np.array([grid[i, k], grid[i, k + 1], grid[i + 1, k + 1], grid[i + 1, k]])
            for i in range(_ROUND // 2) for k in range(_ROUND)]


def _cylinder(size: Floats) -> list[Floats]:
    vertices, faces = round_bar(_ROUND)
    upright = vertices[:, [2, 1, 0]] * (0.5, 0.5, 1.0) * size  # the bar lies along x
    return [upright[list(face)] for face in faces]


def cut_box(point: Floats, normal: Floats, low: Floats, high: Floats) -> Floats:
    """Return the corners (n, 3) in m, in order, of the part of a plane that is in a box.

    None where the plane does not cut it.

    Shapes: point, normal (3,), low, high (3,).
    """
    corners = low + (_CORNERS + 0.5) * (high - low)
    height = (corners - point) @ normal
    crossed = [corners[a] + height[a] / (height[a] - height[b]) * (corners[b] - corners[a])
               for a, b in _EDGES if height[a] * height[b] < 0]
    cut = np.array([*crossed, *corners[height == 0]]).reshape(-1, 3)
    if len(cut) < 3:
        return np.zeros((0, 3))
    aside = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    off = cut - cut.mean(axis=0)
    return cut[np.argsort(np.arctan2(off @ np.cross(normal, aside), off @ aside))]
