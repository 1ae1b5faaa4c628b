# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a file of a cell says while it is read, and how what it says is moved and scaled."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Hull,
    Mesh,
    Obstacle,
    Plane,
    Sheet,
    Sphere,
)
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import UNITS, Surface, hull, mended, volume
from dlo_planner.scene.plates import recognized

_FEW = 64  # planes: a mesh with no more has flat faces, and is touched on its triangles
_ALONG = 1e-6  # how far the direction of a hole may lie off the normal of its plate
NO_TURN = (0.0, 0.0, 0.0, 1.0)


class Asked(NamedTuple):
    """What is asked of a file beside its path."""

    unit: str | None = None  # of 'm', 'cm', 'mm', 'in'; None: what the file says, or the rule is
    friction: float = 0.0  # of obstacles that state none
    joints: Mapping[str, Any] = MappingProxyType({})  # where joints stand: name -> m or rad
    hulls: bool = False  # whether triangles that do not enclose a solid are their convex hull


@dataclass
class Content:
    """What a file says: obstacles, holes, and what has to be told of how it was read."""

    obstacles: list[Obstacle] = field(default_factory=list)
    cutouts: list[CutOut] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def scaled(self, unit: str | None) -> Content:
        """Return the same in m, where the numbers of a file are in another unit."""
        factor = UNITS[unit or 'm']
        if factor == 1:
            return self
        return Content([moved(one, scale=factor) for one in self.obstacles],
                       [moved_cutout(one, scale=factor) for one in self.cutouts], self.notes)


def counted(number: int, what: str) -> str:
    """Return a number of things in words."""
    return f'{number} {what}{"" if number == 1 else "s"}'


def solids_of(name: str, surface: Surface, asked: Asked, notes: list[str]) -> list[Obstacle]:
    """Return the obstacles that triangles are: each closed part of them is one.

    Where one is not closed all of them are one convex hull, if that is asked for, which is noted.

    Parameters
    ----------
    name : str
        What they are called, with a number if they are several.
    surface : Surface
        Triangles in m, as they come.
    asked : Asked
        Friction, and whether hulls are asked for.
    notes : list of str
        Where it is noted.

    Raises
    ------
    InvalidTask
        A part that does not enclose a solid.
    """
    parts = solid_parts(mended(*surface))
    names = [name] if len(parts) == 1 else [f'{name}/{k}' for k in range(len(parts))]
    try:
        return [solid_or_hull(one, part, asked._replace(hulls=False), notes)
                for one, part in zip(names, parts, strict=True)]
    except InvalidTask:
        if not asked.hulls:
            raise
        return [_hull(name, surface, asked, notes)]


def solid_or_hull(name: str, part: Surface, asked: Asked, notes: list[str]) -> Obstacle:
    """Return the obstacle that one part of a surface is, see `solids_of`."""
    try:
        return solid_of(name, *part, asked.friction)
    except InvalidTask as error:
        if not asked.hulls:
            raise InvalidTask(f'{error}; or be taken as the convex hull of it, by hulls=True, on '
                              'the terminal --hulls') from None
        return _hull(name, part, asked, notes)


def _hull(name: str, surface: Surface, asked: Asked, notes: list[str]) -> Hull:
    """Return the convex hull of triangles, which is noted."""
    found = Hull(hull(name, surface.vertices).vertices, friction=asked.friction, name=name)
    notes.append(f'{name!r} is not closed, and read as its convex hull')
    return found


def solid_of(name: str, vertices: Floats, faces: Ints, friction: float) -> Box | Sheet | Mesh:
    """Return the obstacle that triangles are: a Box or a Sheet with holes, or else a Mesh.

    Parameters
    ----------
    name : str
        What it is called.
    vertices : ndarray, shape (n, 3)
        Vertices in m.
    faces : ndarray of int, shape (m, 3)
        Indices of vertices.
    friction : float
        Coulomb's coefficient.

    Raises
    ------
    InvalidTask
        They do not enclose a solid; the message names the obstacle.
    """
    whole = mended(vertices, faces)
    try:
        mesh = Mesh(*whole, friction=friction, smooth=_planes(whole.vertices, whole.faces) > _FEW,
                    name=name)
    except InvalidTask as error:
        raise InvalidTask(f'{name!r}: {error}' if name else str(error)) from None
    found = recognized(mesh.surface)
    return mesh if found is None else replace(found, friction=friction, name=name)


def solid_parts(whole: Surface) -> list[Surface]:
    """Return the solids of a surface: its closed parts, those with the walls of cavities in them.

    A part that is seen from within, and in no other one, was turned by who wrote it.
    """
    from scipy.sparse import coo_matrix  # noqa: PLC0415  (a quarter of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415
    vertices, faces = whole
    count = len(vertices)
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    _, label = connected_components(coo_matrix(
        (np.ones(len(edges)), edges.T), shape=(count, count)), directed=False)
    of_face = label[faces[:, 0]]
    parts = [faces[of_face == k] for k in np.unique(of_face)]
    outer = [part for part in parts if volume(vertices, part) >= 0]
    boxes = [(vertices[part].min(axis=(0, 1)), vertices[part].max(axis=(0, 1))) for part in outer]
    for part in parts:
        if volume(vertices, part) >= 0:
            continue
        low, high = vertices[part].min(axis=(0, 1)), vertices[part].max(axis=(0, 1))
        around = [k for k, (least, most) in enumerate(boxes)
                  if k < len(boxes) and (least < low).all() and (most > high).all()]
        if around:
            k = min(around, key=lambda one: float(np.prod(boxes[one][1] - boxes[one][0])))
            outer[k] = np.concatenate([outer[k], part])
        else:
            outer.append(part[:, ::-1])
    return [_alone(vertices, part) for part in outer]


def _alone(vertices: Floats, faces: Ints) -> Surface:
    """Return a part of a surface with its own vertices alone."""
    used, number = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], number.reshape(-1, 3))


def pierced(box: Box, cutouts: Iterable[CutOut]) -> Sheet | None:
    """Return the Sheet that a Box with holes straight through it is; None where they are not."""
    cutouts = tuple(cutouts)
    along = np.abs(box.pose.rotation.T @ cutouts[0].normal)
    axis = int(np.argmax(along))
    if along[axis] < 1 - _ALONG:
        return None
    turned = np.roll(np.eye(3), -axis, axis=1)  # x, y, z of the sheet are axes of the box
    width, height = box.size[(axis + 1) % 3], box.size[(axis + 2) % 3]
    pose = Pose.from_rotation(box.pose.position, box.pose.rotation @ turned)
    inside = []
    for one in cutouts:  # those that stand on one face go through to the other
        depth = float((one.center - pose.position) @ pose.direction)
        inside.append(replace(one, pose=Pose(one.center - depth * pose.direction,
                                             one.pose.quaternion)))
    try:
        return Sheet(pose, float(width), float(height), float(box.size[axis]), tuple(inside),
                     box.friction, name=box.name)
    except InvalidTask:
        return None


def moved(obstacle: Obstacle, by: Pose = Pose.identity(),  # noqa: B008 - frozen
          scale: float = 1.0) -> Obstacle:
    """Return an obstacle whose numbers are multiplied by `scale`, then moved by a pose."""
    def place(point: Floats) -> Floats:
        there: Floats = by.position + by.rotation @ (scale * point)
        return there

    if isinstance(obstacle, Plane):
        return replace(obstacle, point=place(obstacle.point),
                       normal=by.rotation @ obstacle.normal)
    if isinstance(obstacle, Sphere):
        return replace(obstacle, center=place(obstacle.center), radius=scale * obstacle.radius)
    if isinstance(obstacle, Capsule | Cylinder):
        return replace(obstacle, start=place(obstacle.start), end=place(obstacle.end),
                       radius=scale * obstacle.radius)
    pose = _moved_pose(obstacle.pose, by, scale)
    if isinstance(obstacle, Box):
        return replace(obstacle, pose=pose, size=scale * obstacle.size)
    if isinstance(obstacle, Ellipsoid):
        return replace(obstacle, pose=pose, half_axes=scale * obstacle.half_axes)
    if isinstance(obstacle, Mesh):
        return replace(obstacle, pose=pose, vertices=scale * obstacle.vertices)
    if isinstance(obstacle, Hull):
        return replace(obstacle, pose=pose, points=scale * obstacle.points)
    return replace(obstacle, pose=pose, width=scale * obstacle.width,
                   height=scale * obstacle.height, thickness=scale * obstacle.thickness,
                   cutouts=tuple(moved_cutout(one, by, scale) for one in obstacle.cutouts))


def moved_cutout(cutout: CutOut, by: Pose = Pose.identity(),  # noqa: B008 - frozen
                 scale: float = 1.0) -> CutOut:
    """Return a cut-out whose numbers are multiplied by `scale`, then moved by a pose."""
    sizes = {name: scale * value for name in ('radius', 'width', 'height')
             if (value := getattr(cutout, name)) is not None}
    return replace(cutout, pose=_moved_pose(cutout.pose, by, scale), **sizes)


def _moved_pose(pose: Pose, by: Pose, scale: float) -> Pose:
    return by.compose(Pose(scale * pose.position, pose.quaternion))


def _planes(vertices: Floats, faces: Ints) -> int:
    """Return in how many directions triangles look, up to rounding to 1e-3."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    directions = np.round(normals[sizes > 0] / sizes[sizes > 0, None], 3) + 0.0
    return len(np.unique(directions, axis=0))
