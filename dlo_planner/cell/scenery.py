# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Sheets and obstacles as bodies of the physics engine."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.cell.chain import DLO, SCENE
from dlo_planner.cell.engine import mujoco
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import OBSTACLES, Capsule, Obstacle, Plane, Sheet

_SIDES = 24         # of the polygon around a round hole, which is up to 0.9 % wider than the hole
_THINNEST = 1e-3    # m: a thinner sheet could be tunnelled through
_HALF_PLANE = 10.0  # m

Part = tuple[str, Sequence[float] | Floats, Floats, Floats]  # kind, size, center, rotation


def add_obstacle(spec: mujoco.MjSpec, obstacle: Obstacle, number: int) -> None:
    """Add an obstacle to an MjSpec; the names of its geoms are 'number/part'."""
    for part, (kind, size, center, rotation) in enumerate(_parts(obstacle)):
        spec.worldbody.add_geom(
            name=f'{number}/{part}', type=getattr(mujoco.mjtGeom, f'mjGEOM_{kind}'), size=size,
            pos=center, quat=np.roll(Rotation.from_matrix(rotation).as_quat(), 1),
            contype=SCENE, conaffinity=DLO, condim=3 if obstacle.friction else 1,
            friction=(obstacle.friction, 0, 0))


def _parts(obstacle: Obstacle) -> list[Part]:
    """Return [(kind, size (3,), center (3,), rotation (3, 3))] of an obstacle."""
    if isinstance(obstacle, Plane):
        return [('PLANE', (_HALF_PLANE, _HALF_PLANE, 1), obstacle.point, _z_along(obstacle.normal))]
    if isinstance(obstacle, Capsule):
        axis = obstacle.end - obstacle.start
        return [('CAPSULE', (obstacle.radius, 0.5 * float(np.linalg.norm(axis)), 0),
                 0.5 * (obstacle.start + obstacle.end), _z_along(axis))]
    if isinstance(obstacle, Sheet):
        return _around_hole(obstacle)
    if not isinstance(obstacle, OBSTACLES):
        raise InvalidTask(f'obstacles: expected {", ".join(one.__name__ for one in OBSTACLES)}, '
                          f'got {obstacle!r}')
    return [(*_GEOMS[solid.kind](*solid.size), solid.pose.position, np.array(solid.pose.rotation))
            for solid in obstacle.solids]


# kind of a Solid -> its name in MuJoCo, and its size there
_GEOMS: dict[str, Callable[[float, float, float], tuple[str, Sequence[float]]]] = {
    'box': lambda x, y, z: ('BOX', (0.5 * x, 0.5 * y, 0.5 * z)),
    'ball': lambda x, y, z: ('SPHERE' if x == y == z else 'ELLIPSOID',
                             (0.5 * x, 0.5 * y, 0.5 * z)),
    'cylinder': lambda x, y, z: ('CYLINDER', (0.5 * x, 0.5 * z, 0))}


def _around_hole(sheet: Sheet) -> list[Part]:
    """Return the boxes of a Sheet."""
    half = 0.5 * np.array([max(sheet.thickness, _THINNEST), sheet.width, sheet.height])
    if not sheet.cutouts:
        return [('BOX', half, sheet.pose.position, np.array(sheet.pose.rotation))]
    if len(sheet.cutouts) > 1:
        raise InvalidTask(f'{sheet!r}: expected one cut-out at most, in the cell each has a sheet')
    hole = sheet.cutouts[0]
    rotation = np.array(hole.pose.rotation)
    reach = half[1:].min()  # the sheet is as wide in all directions
    if hole.radius is not None:
        turns = 2 * np.pi * np.arange(_SIDES) / _SIDES
        sides = [(angle, hole.radius, reach * np.tan(np.pi / _SIDES)) for angle in turns]
    else:
        y, z = 0.5 * float(hole.width or 0.0), 0.5 * float(hole.height or 0.0)
        sides = [(0, y, reach), (np.pi / 2, z, y), (np.pi, y, reach), (1.5 * np.pi, z, y)]
    parts: list[Part] = []
    for angle, inner, wide in sides:
        turned = rotation @ Rotation.from_euler('x', angle).as_matrix()
        center = hole.center + 0.5 * (inner + reach) * turned[:, 1]
        parts.append(('BOX', (half[0], 0.5 * (reach - inner), wide), center, turned))
    return parts


def _z_along(direction: Floats) -> Floats:
    """Return a rotation (3, 3) whose z axis is along a direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
