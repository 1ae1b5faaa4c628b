# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What can be drawn, anywhere, and as which lines and triangles."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import array, choice, instance, integer, number, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import Surface
from dlo_planner.model.value import Value, put

# What a primitive is made of, and what `size` means: line, segments (pairs of points): width; arrow
# (two points): diameters of shaft and head, length of the head; box: its sides; ball, cylinder
# (about z): diameters and, along z, height; text: height of a letter; points: diameter;
# triangles (three points each): nothing.
KINDS = ('line', 'segments', 'arrow', 'box', 'ball', 'cylinder', 'text', 'points', 'triangles')
_NOWHERE = np.zeros((0, 3))
_WORLD = Pose.identity()


def rows_of_points(name: str, value: object) -> Floats:
    """Return points (n, 3), finite; none for an empty sequence; or raise InvalidTask."""
    empty = (value.shape[:1] == (0,) if isinstance(value, np.ndarray)
             else isinstance(value, list | tuple) and not value)
    return _NOWHERE if empty else array(name, value, (None, 3))


@dataclass(frozen=True, eq=False, repr=False)
class Primitive(Value):
    """Something to be drawn: by RViz as a marker, in the browser as a mesh, by matplotlib."""

    group: str
    index: int  # in its group; both together are its name
    kind: str   # one of KINDS
    color: tuple[float, ...]  # red, green, blue, 0 to 1
    alpha: float = 1.0        # 1 opaque, 0 invisible
    points: Floats = field(default_factory=lambda: _NOWHERE)  # (n, 3) m, in the frame of `pose`
    colors: Floats | None = None  # (n, 3) of each point, None: all have `color`
    pose: Pose = _WORLD           # of a box, ball, cylinder, text: its center
    size: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) m, see KINDS
    text: str = ''

    if TYPE_CHECKING:  # what may be given
        def __init__(self, group: str, index: int, kind: str, color: ArrayLike, alpha: float = 1.0,
                     points: ArrayLike = ..., colors: ArrayLike | None = None, pose: Pose = ...,
                     size: ArrayLike = ..., text: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Primitive.group', self.group, str)
        instance('Primitive.text', self.text, str)
        instance('Primitive.pose', self.pose, Pose)
        choice('Primitive.kind', self.kind, KINDS)
        points = rows_of_points('Primitive.points', self.points)
        put(self, index=integer('Primitive.index', self.index, minimum=-2**31, maximum=2**31 - 1),
            color=tuple(vector('Primitive.color', self.color, 3).tolist()),
            alpha=number('Primitive.alpha', self.alpha, minimum=0, maximum=1), points=points,
            size=vector('Primitive.size', self.size, 3))
        if self.colors is not None:
            put(self, colors=array('Primitive.colors', self.colors, points.shape))
        super().__post_init__()

    @property
    def name(self) -> tuple[str, int]:
        """Group and index."""
        return self.group, self.index

    @property
    def corners(self) -> Floats:
        """(n, 3) points in the world that it reaches to: its own, or those around its size."""
        points = self.points
        if not len(points):
            half = np.zeros(3) if self.kind == 'text' else 0.5 * self.size
            points = np.array([-half, half])
        return points @ self.pose.rotation.T + self.pose.position


_SHOWN_RADIUS = 0.02  # m, of a cut-out without a size
_STEPS = 48           # of a circle, a multiple of 8: corners of the plate are among them
_MOST_DRAWN = 20_000  # triangles of a mesh; more of them are drawn coarser
_COARSE = 64          # places along its size where those are
_PLATE = 3.0          # half a plate's side, in sizes of its hole


def rim(cutout: CutOut) -> Floats:
    """Return (n, 3) m: the rim of a CutOut in its frame, closed; a circle if it has no size."""
    if cutout.width is not None and cutout.height is not None:
        return border(cutout.width, cutout.height)
    angle = np.linspace(0, 2 * np.pi, _STEPS + 1)
    radius = cutout.radius or _SHOWN_RADIUS
    return radius * np.column_stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)])


def triangles(surface: Surface) -> Floats:
    """Return (3 n, 3) m: the triangles of a surface, coarser ones where there are many."""
    vertices, faces = surface
    if len(faces) > _MOST_DRAWN:
        cells = np.round(vertices * (_COARSE / np.ptp(vertices, axis=0).max()))
        number = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        often = np.bincount(number)[:, None]
        vertices = np.column_stack([np.bincount(number, weights=vertices[:, k])
                                    for k in range(3)]) / often
        faces = number[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    return vertices[faces].reshape(-1, 3)


def border(width: float, height: float) -> Floats:
    """Return (5, 3) m: the edge of `rectangle`, closed."""
    y, z = width / 2, height / 2
    return np.array([(0, y, z), (0, -y, z), (0, -y, -z), (0, y, -z), (0, y, z)])


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


_ROUND = 24           # sides of a cylinder and steps of a ball's equator
_HEAD, _SPREAD = 0.25, 0.1  # length and half width of an arrow's head, of the arrow's length
_EDGES = ((0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7),
          (6, 7))
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class Tessellation(NamedTuple):
    """What a Primitive consists of, in the world."""

    lines: list[Floats]  # (n, 3) m each, polylines
    faces: list[Floats]  # (m, 3) m each, flat polygons
    dots: Floats         # (n, 3) m


def tessellate(item: Primitive) -> Tessellation:
    """Return the Tessellation of a Primitive; of a text none."""
    lines: list[Floats] = []
    faces: list[Floats] = []
    dots = np.zeros((0, 3))
    if item.kind == 'line':
        lines = [item.points]
    elif item.kind == 'segments':
        lines = list(item.points.reshape(-1, 2, 3))
    elif item.kind == 'arrow':
        lines = _arrow_lines(*item.points)
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
    return Tessellation([line @ turn + origin for line in lines],
                        [face @ turn + origin for face in faces], dots @ turn + origin)


def _arrow_lines(start: Floats, end: Floats) -> list[Floats]:
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
    """Return the corners (n, 3), m, in order, of the part of a plane in a box, or None."""
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
