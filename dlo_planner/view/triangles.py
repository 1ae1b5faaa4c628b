# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Surfaces as triangles: rectangles, plates with a hole, tubes, bars; in their own frames."""

import numpy as np

from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.cutout import CutOut

_SHOWN_RADIUS = 0.02  # m, of a cut-out without a size
_STEPS = 48           # of a circle, a multiple of 8: corners of the plate are among them
_PLATE = 3.0          # half a plate's side, in sizes of its hole


def rim(cutout: CutOut) -> Floats:
    """Return (n, 3) m: the rim of a CutOut in its frame, closed; a circle if it has no size."""
    if cutout.width is not None and cutout.height is not None:
        y, z = cutout.width / 2, cutout.height / 2
        return np.array([(0, y, z), (0, -y, z), (0, -y, -z), (0, y, -z), (0, y, z)])
    angle = np.linspace(0, 2 * np.pi, _STEPS + 1)
    radius = cutout.radius or _SHOWN_RADIUS
    return radius * np.column_stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)])


def room(cutout: CutOut) -> float | None:
    """Return the distance in m between the middle of a CutOut and its rim; None without a size."""
    if cutout.radius is not None:
        return cutout.radius
    if cutout.width is None or cutout.height is None:
        return None
    return min(cutout.width, cutout.height) / 2


def plate(cutout: CutOut, half: float = 0.0) -> Floats:
    """Return (3 n, 3) m: triangles of a square plate around the hole of a CutOut, in its frame."""
    angle = np.linspace(0, 2 * np.pi, _STEPS + 1)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    square = around / np.abs(around).max(axis=1, keepdims=True)
    if cutout.width is not None:
        inner = 0.5 * np.array([cutout.width, cutout.height]) * square
    else:
        inner = (cutout.radius or _SHOWN_RADIUS) * around
    outer = max(half, _PLATE * np.abs(inner).max()) * square
    corners = np.stack([inner[:-1], outer[:-1], outer[1:], inner[:-1], outer[1:], inner[1:]],
                       axis=1).reshape(-1, 2)
    return np.column_stack([np.zeros(len(corners)), corners])


def rectangle(width: float, height: float) -> Floats:
    """Return (6, 3) m: two triangles in the plane x = 0, `width` along y, `height` along z."""
    y, z = width / 2, height / 2
    a, b, c, d = (0, -y, -z), (0, y, -z), (0, y, z), (0, -y, z)
    return np.array([a, b, c, a, c, d], dtype=float)


def round_bar(sides: int = 12) -> tuple[Floats, Ints]:
    """Return vertices (2 n + 2, 3) and faces (m, 3) of a bar along x: length 1, radius 1."""
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.column_stack([np.zeros(sides), np.cos(angle), np.sin(angle)])
    vertices = np.vstack([ring - (0.5, 0, 0), ring + (0.5, 0, 0), (-0.5, 0, 0), (0.5, 0, 0)])
    faces = []
    for k in range(sides):
        after = (k + 1) % sides
        faces += [(k, after, sides + k), (after, sides + after, sides + k),
                  (2 * sides, after, k), (2 * sides + 1, sides + k, sides + after)]
    return vertices, np.array(faces, dtype=np.int64)


def tube(points: Floats, radius: float, sides: int = 10) -> tuple[Floats, Ints]:
    """Return vertices (n sides, 3) and faces (m, 3) of a tube through points (n, 3), n > 1."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    side = np.cross(along[0], np.eye(3)[np.argmin(np.abs(along[0]))])
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rings = []
    for point, tangent in zip(points, along, strict=True):
        side = side - (side @ tangent) * tangent  # carried along, so that the tube does not twist
        side /= max(np.linalg.norm(side), 1e-12)
        other = np.cross(tangent, side)
        rings.append(point + radius * (np.outer(np.cos(angle), side)
                                       + np.outer(np.sin(angle), other)))
    k = np.arange(sides)
    quad = np.vstack([np.column_stack([k, (k + 1) % sides, k + sides]),
                      np.column_stack([(k + 1) % sides, (k + 1) % sides + sides, k + sides])])
    faces = quad[None] + sides * np.arange(len(points) - 1)[:, None, None]
    return np.vstack(rings), faces.reshape(-1, 3)


def bars_between(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return quaternions (n - 1, 4) w, x, y, z, middles (n - 1, 3), lengths (n - 1,) of bars.

    Each lies along x in its frame and leads from one of the points (n, 3) to the next.
    """
    chords = np.diff(points, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    along = np.divide(chords, lengths[:, None], out=np.tile((1.0, 0.0, 0.0), (len(chords), 1)),
                      where=lengths[:, None] > 0)
    back = along[:, 0] < -1 + 1e-9  # half a turn about any axis across: z
    turns = np.column_stack([1 + along[:, 0], np.zeros(len(chords)), -along[:, 2], along[:, 1]])
    turns[back] = (0.0, 0.0, 0.0, 1.0)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return turns, 0.5 * (points[1:] + points[:-1]), lengths
