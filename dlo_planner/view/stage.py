# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands around the DLO in a picture: holes, obstacles, the gripper; one scale for all."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import items
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Plane
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, means_to_touch
from dlo_planner.view.axes import Frame, azimuth, box_around
from dlo_planner.view.colors import GRAY, ORANGE, SKY_BLUE
from dlo_planner.view.dlo_items import axes_items
from dlo_planner.view.drawing import draw
from dlo_planner.view.item import Item
from dlo_planner.view.primitives import cut_box
from dlo_planner.view.replanning import cutouts_of
from dlo_planner.view.scene_items import cutout_items, obstacle_items
from dlo_planner.view.triangles import plate, room

_AXIS = 0.09     # of the DLO's length: axes of the gripper, a normal
_PLATE = 0.14    # the same: half a plate around a hole
_HIDDEN = 0.02   # the same: a hole without a size, seen from the side
_DOT = 0.035     # the same: a center that the DLO passes in any direction
_ALPHA, _GLASS = 0.45, 0.25
_BLACK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Stage:
    """Shapes and what is around them.

    Attributes
    ----------
    shapes : tuple of Shape
        Shapes, all that the picture has to hold.
    cutouts : tuple of CutOut
        CutOuts that the DLO passes.
    centers : tuple of ndarray
        (n, 3) m, points that it passes in any direction.
    obstacles : tuple of obstacle
        Those of the shapes, and further ones.
    length : float
        Length of the DLO, m.
    """

    shapes: tuple[Shape, ...]
    cutouts: tuple[CutOut, ...]
    centers: tuple[Floats, ...]
    obstacles: tuple[Obstacle, ...]
    length: float

    @classmethod
    def of(cls, shapes: tuple[Shape, ...], obstacles: Iterable[Obstacle],
           plan: Plan | None = None) -> 'Stage':
        """Return the stage of Shapes, and of the Plan that they belong to."""
        own = list(shapes[0].obstacles)
        own += [one for one in items('obstacles', obstacles, OBSTACLES) if one not in own]
        cutouts: tuple[CutOut, ...] = ()
        centers: tuple[Floats, ...] = ()
        if plan is not None and not _in_contact(plan):
            cutouts = tuple(cutouts_of(plan))
            centers = tuple(center for center, _, normal in plan.via_points[-1] if normal is None)
        return cls(shapes, cutouts, centers, tuple(own), max(float(shape.s[-1])
                                                             for shape in shapes))

    def set(self, frame: Frame, more: Iterable[Item] = ()) -> None:
        """Draw all that stands still, and further Items, and choose what is seen."""
        drawn = self._items(frame)
        solid = [item.corners for item in (*drawn, *more) if item.kind != 'text']
        points = np.concatenate([self._around_shapes(), *solid])
        low, high = box_around(points)
        draw(frame.axes, [*drawn, *self._planes(low, high), *more], frame.side)
        frame.look(azimuth(points))
        frame.show(low, high)

    @property
    def points(self) -> Floats:
        """(n, 3) m: of the DLO in all its shapes, and the holes it passes."""
        passed = [cutout.center for cutout in self.cutouts] + [*self.centers]
        return np.concatenate([*(shape.positions for shape in self.shapes),
                               np.reshape(passed, (-1, 3))])

    def gripper(self, pose: Pose, index: int = 0) -> list[Item]:
        """Return the axes of a gripper."""
        return axes_items(f'gripper {index}', pose, _AXIS * self.length)

    def _items(self, frame: Frame) -> list[Item]:
        """Return Items of what stands still but planes; from the side, holes are gaps in a line."""
        drawn = obstacle_items(one for one in self.obstacles if not isinstance(one, Plane))
        drawn += [Item('center', index, 'ball', ORANGE, size=(_DOT * self.length,) * 3,
                       pose=Pose(center, (0.0, 0.0, 0.0, 1.0)))
                  for index, center in enumerate(self.centers)]
        if not frame.space:
            return drawn + [self._gap(k, cutout, frame.side[0])
                            for k, cutout in enumerate(self.cutouts)]
        drawn += [Item('plate', index, 'triangles', GRAY, _ALPHA,
                       plate(cutout, _PLATE * self.length), pose=cutout.pose)
                  for index, cutout in enumerate(self.cutouts) if room(cutout) is not None]
        return drawn + cutout_items(self.cutouts, _AXIS * self.length)

    def _planes(self, low: Floats, high: Floats) -> list[Item]:
        """Return Items of what is seen of the planes in a box."""
        drawn = []
        planes = [one for one in self.obstacles if isinstance(one, Plane)]
        for index, plane in enumerate(planes):
            corners = cut_box(plane.point, plane.normal, low, high)
            if len(corners) > 2:
                fan = [corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)]
                drawn += [Item('plane', index, 'triangles', SKY_BLUE, _GLASS, np.concatenate(fan)),
                          Item('border', index, 'line', SKY_BLUE, 0.8,
                               points=corners[[*range(len(corners)), 0]])]
        return drawn

    def _around_shapes(self) -> Floats:
        tips = [shape.gripper.position + sign * _AXIS * self.length * shape.gripper.rotation[:, k]
                for shape in self.shapes for k in range(3) for sign in (0, 1)]
        return np.concatenate([*(shape.positions for shape in self.shapes), tips])

    def _gap(self, index: int, cutout: CutOut, level: int) -> Item:
        """Return a plate cut through its hole, in the upright plane through its center."""
        across = np.zeros(3)
        across[[level, 2]] = -cutout.normal[2], cutout.normal[level]
        size = np.linalg.norm(across)
        across = across / size if size > 0 else np.array([0.0, 0.0, 1.0])
        inner = room(cutout) or _HIDDEN * self.length
        outer = max(_PLATE * self.length, 2 * inner)
        ends = [cutout.center + distance * across for distance in (inner, outer, -inner, -outer)]
        return Item('plate', index, 'segments', _BLACK, points=ends)


def _in_contact(plan: Plan) -> bool:
    return means_to_touch(plan) and all(shape.far_end is None for shape in plan.shapes)
