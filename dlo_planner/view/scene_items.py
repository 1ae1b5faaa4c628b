# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of what surrounds a DLO: cut-outs with their margins, the gripper's path, obstacles."""

from collections.abc import Iterable

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Plane, Sheet, Solid
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view.colors import GRAY, ORANGE, SKY_BLUE, viridis
from dlo_planner.view.item import Item
from dlo_planner.view.triangles import plate, rectangle, rim, room

_THIN = 0.002    # m, width of a line
_AXIS = 0.05     # m, length of a normal and of the gripper's direction
_ARROW = (0.004, 0.008, 0.01)  # m: shaft, head, length of the head
_GREEN = (0.0, 0.62, 0.45)
_BODY, _GLASS = 0.5, 0.25  # alpha of obstacles, of sheets
_WIDE = 2.0      # m, how much of a plane is drawn
_LETTER = 0.02   # m


def cutout_items(cutouts: Iterable[CutOut], length: float = _AXIS) -> list[Item]:
    """Return the rims of CutOuts and their normals, items 2 k and 2 k + 1 of 'cutout'."""
    length, drawn = number('length', length, above=0), []
    for index, cutout in enumerate(items('cutouts', cutouts, CutOut)):
        tip = cutout.center + length * cutout.normal
        drawn += [Item('cutout', 2 * index, 'line', ORANGE, points=rim(cutout), pose=cutout.pose,
                       size=(_THIN, 0.0, 0.0)),
                  Item('cutout', 2 * index + 1, 'arrow', ORANGE, points=(cutout.center, tip),
                       size=_ARROW)]
    return drawn


def path_items(grippers: Iterable[Pose], length: float = _AXIS) -> list[Item]:
    """Return the path of the gripper, 'trajectory' 0, and its directions on it, 1."""
    length, grippers = number('length', length, above=0), items('grippers', grippers, Pose)
    points = np.array([pose.position for pose in grippers]).reshape(-1, 3)
    tips = points + length * np.array([pose.direction for pose in grippers]).reshape(-1, 3)
    ticks = np.stack([points, tips], axis=1).reshape(-1, 3)
    return [Item('trajectory', 0, 'line', _GREEN, points=points, size=(_THIN, 0.0, 0.0)),
            Item('trajectory', 1, 'segments', _GREEN, points=ticks, size=(_THIN / 2, 0.0, 0.0))]


def margin_items(plan: Plan, cutouts: Iterable[CutOut], radius: float | None = None) -> list[Item]:
    """Return plates with the holes, their rims colored by the margin, and the margin as a text.

    The margin is the least distance between rim and DLO on the whole plan. Dark: none, bright: as
    much as a DLO in the middle of the hole would have; beyond the limit (the DLO in the rim) ALERT.
    """
    instance('plan', plan, Plan)
    radius = 0.0 if radius is None else number('radius', radius, minimum=0)
    drawn = []
    for index, cutout in enumerate(items('cutouts', cutouts, CutOut)):
        most = room(cutout)
        if most is None:
            continue
        drawn.append(Item('plate', index, 'triangles', GRAY, _GLASS, plate(cutout),
                          pose=cutout.pose))
        margin = (plan.clearances[:, index, 0].min(initial=np.inf)
                  if index < plan.clearances.shape[1] else np.inf)
        if not np.isfinite(margin):
            continue
        share = np.clip(margin / max(most - radius, 1e-12), 0.0, 1.0) if margin >= 0 else 2.0
        points = rim(cutout)
        below = cutout.pose.position - (0.0, 0.0, np.abs(points).max() + 3 * _LETTER)
        drawn += [Item('margin', index, 'line', viridis([share])[0], points=points,
                       colors=np.repeat(viridis([share]), len(points), axis=0), pose=cutout.pose,
                       size=(2 * _THIN, 0.0, 0.0)),
                  Item('rim margin', index, 'text', (1.0, 1.0, 1.0), size=(0.0, 0.0, _LETTER),
                       pose=Pose(below, (0.0, 0.0, 0.0, 1.0)),
                       text=f'rim margin {1e3 * margin:.2g} mm')]
    return drawn


def obstacle_items(obstacles: Iterable[Obstacle]) -> list[Item]:
    """Return obstacles half transparent, 'obstacle' k; the round ends of a Capsule are 'cap's."""
    drawn = []
    for index, obstacle in enumerate(items('obstacles', obstacles, OBSTACLES)):
        if isinstance(obstacle, Plane):
            pose = Pose.looking_along(obstacle.point, obstacle.normal)
            drawn.append(Item('obstacle', index, 'triangles', SKY_BLUE, _GLASS,
                              rectangle(_WIDE, _WIDE), pose=pose))
        elif isinstance(obstacle, Sheet):
            drawn += _sheet(index, obstacle)
        else:
            body, *ends = obstacle.solids
            drawn += [_solid('obstacle', index, body),
                      *(_solid('cap', 2 * index + k, end) for k, end in enumerate(ends))]
    return drawn


def _solid(group: str, index: int, solid: Solid) -> Item:
    return Item(group, index, solid.kind, GRAY, _BODY, pose=solid.pose, size=solid.size)


def _sheet(index: int, sheet: Sheet) -> list[Item]:
    if not sheet.cutouts:
        return [Item('obstacle', index, 'triangles', SKY_BLUE, _GLASS,
                     rectangle(sheet.width, sheet.height), pose=sheet.pose)]
    middle = Item('obstacle', index, 'line', GRAY, points=_border(sheet), pose=sheet.pose,
                  size=(_THIN, 0.0, 0.0))
    return [middle, *(Item(f'sheet {index}', k, 'triangles', SKY_BLUE, _GLASS, plate(cutout),
                           pose=cutout.pose) for k, cutout in enumerate(sheet.cutouts))]


def _border(sheet: Sheet) -> Floats:
    y, z = 0.5 * sheet.width, 0.5 * sheet.height
    return np.array([(0, y, z), (0, -y, z), (0, -y, -z), (0, y, -z), (0, y, z)])
