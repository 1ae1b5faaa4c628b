# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One thing that is drawn: by RViz as a marker, by the page in the browser as a mesh."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, choice, instance, integer, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put

# What an item is made of, and what `size` means: line, segments (pairs of points): width; arrow
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
class Item(Value):
    """Something to be drawn.

    Attributes
    ----------
    group : str
        What it belongs to.
    index : int
        Its number there; both together are its name.
    kind : str
        One of KINDS.
    color : tuple of float
        (3,) red, green, blue, 0 to 1.
    alpha : float
        1 opaque, 0 invisible.
    points : ndarray, shape (n, 3)
        Points in m, in the frame of `pose`.
    colors : ndarray, shape (n, 3) or None
        Colors of each point, or None: all have `color`.
    pose : Pose
        Pose in the world; of a box, ball, cylinder, text: its center.
    size : ndarray, shape (3,)
        Size in m, see KINDS.
    text : str
        What a text says.

    Raises
    ------
    InvalidTask
        Naming the attribute.
    """

    group: str
    index: int
    kind: str
    color: tuple[float, ...]
    alpha: float = 1.0
    points: Floats = field(default_factory=lambda: _NOWHERE)
    colors: Floats | None = None
    pose: Pose = _WORLD
    size: Floats = field(default_factory=lambda: np.zeros(3))
    text: str = ''

    if TYPE_CHECKING:  # what may be given
        def __init__(self, group: str, index: int, kind: str, color: ArrayLike, alpha: float = 1.0,
                     points: ArrayLike = ..., colors: ArrayLike | None = None, pose: Pose = ...,
                     size: ArrayLike = ..., text: str = '') -> None: ...

    def __post_init__(self) -> None:
        instance('Item.group', self.group, str)
        instance('Item.text', self.text, str)
        instance('Item.pose', self.pose, Pose)
        choice('Item.kind', self.kind, KINDS)
        points = rows_of_points('Item.points', self.points)
        put(self, index=integer('Item.index', self.index, minimum=-2**31, maximum=2**31 - 1),
            color=tuple(vector('Item.color', self.color, 3).tolist()),
            alpha=number('Item.alpha', self.alpha, minimum=0, maximum=1), points=points,
            size=vector('Item.size', self.size, 3))
        if self.colors is not None:
            put(self, colors=array('Item.colors', self.colors, points.shape))
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
