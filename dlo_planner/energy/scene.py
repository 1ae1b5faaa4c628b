# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as plain arrays, for kernels: bodies as a DLO meets them, and their distance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.bvh import Tree, Trees, joined, signed_from_surface, tree_of
from dlo_planner.geometry.record import Record, replaced
from dlo_planner.geometry.smooth_distance import Grid, Grids, grids_of, smooth_distance
from dlo_planner.geometry.smooth_distance import joined as joined_grids
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Body, Box, Hull, Mesh, Obstacle, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import changed

KINDS = ('plane', 'sphere', 'capsule', 'box', 'sheet', 'cylinder', 'ellipsoid', 'hull', 'mesh')
PLANE, SPHERE, CAPSULE, BOX, SHEET, CYLINDER, ELLIPSOID, HULL, MESH = range(len(KINDS))
AXIS, EDGE, FACE, NODE_FACE = range(4)
_SMOOTH = (PLANE, SPHERE, CAPSULE, ELLIPSOID)  # edges of a section need not be rounded there
_BY_SECTIONS = (PLANE, SPHERE, CAPSULE, BOX, SHEET)  # what its edges and faces are watched against
_REMEMBERED = 8    # sets of surfaces of triangles, the last ones; 10^5 triangles have 25 MB
_HOME = Pose.identity()
_MOST_SLOTTED = 2  # rectangular cut-outs of a sheet: each doubles its bodies
_ROUNDING = 0.02  # of the smaller half size: of a section's edges where an obstacle has edges
_ALL = (0, 2**31)  # nodes
_AROUND = np.array([(np.cos(angle), np.sin(angle)) for angle in np.arange(12) * np.pi / 6])


class Scene(Record):
    """Obstacles as plain arrays; M bodies with H cut-outs in all.

    A body is a part of an obstacle, as one feature of the DLO's surface meets it. A sheet is two
    layers, if it is thick: at the rims of a hole a DLO touches two edges, and each edge needs a
    nearest point of its own. So do those that meet in the corner of a rectangular hole, which are
    edges of two layers with slots. A round DLO has one feature, balls
    about its axis. A rectangular one has four edges along it; where an obstacle is curved or has
    edges itself, also the faces between them (`energy.gap`).
    """

    source: Ints  # (M,) index of the obstacle that a body is (part of)
    kind: Ints  # (M,) PLANE ... MESH
    axes: Floats  # (M, 3, 3) columns x, y, z of the obstacle's frame
    center: Floats  # (M, 3) center in m, world
    # (M, 3) half sizes along the axes, m. A sphere's or capsule's radius is the last one, a
    # capsule's half length the first; a cylinder has half length and radius
    size: Floats
    friction: Floats  # (M,) Coulomb's coefficients
    hole_of: Ints  # (H,) index of the sheet of each hole
    hole_center: Floats  # (H, 2) its center y, z there, m
    hole_axis: Floats  # (H, 2) its own first axis there
    hole_size: Floats  # (H, 2) half width and height, or the radius and -1, m
    radius: float  # radius of the DLO, m; the largest
    origin: Floats  # (3,) position of the gripper, m: nodes are given relative to it
    # (M,) feature of the DLO: AXIS, EDGE, FACE (anywhere along an element) or NODE_FACE
    feature: Ints
    # (M, 2) of an edge, from the axis along n and b, m; of faces, half sizes of the section. Both
    # less `rounding`
    offset: Floats
    rounding: Floats  # (M,) by how much the feature is thickened, m
    span: Ints  # (M, 2) first and last node of the feature; it may end beyond the DLO
    # (N, 2) radius of the DLO at both ends of its elements, m; (0, 2): `radius` everywhere
    radii: Floats
    inner: Floats  # (M,) of a convex body: how deep in it a point still knows its way out, m
    root: Ints  # (M,) of a hull or a mesh: the box of `trees` around it; else -1
    trees: Trees  # their triangles
    smooth: Ints  # (M,) of a mesh that is touched smoothly: its number among `grids`; else -1
    grids: Grids  # their smooth distances


@kernel
def translated(scene, shift):
    """Return the same Scene for a gripper displaced by shift (3,), m."""
    return replaced(scene, 'origin', scene.origin + shift)


class _Layer(NamedTuple):
    """A Sheet with other cut-outs, which may reach beyond it."""

    sheet: Sheet
    cutouts: tuple[CutOut, ...]


_Span: TypeAlias = tuple[int, int]  # first and last node


class _Feature(NamedTuple):
    """What `Scene` says of one feature of the DLO's surface; offset: (2,)."""

    feature: int
    offset: ArrayLike
    rounding: float
    span: _Span


def build_scene(obstacles: Iterable[Obstacle], surface: Surface | float, s: Floats | None = None,
                *, sharp: bool = False, outlines: bool = False) -> Scene:
    """Return the Scene of obstacles for a DLO, relative to the world's origin.

    `outlines`: whether faces of a rectangular DLO are watched at the outlines of sheets. Where one
    of its edges lies on the same line a face would bear at the same points, which leaves forces
    open that no step finds: so it is for clearances.

    Shapes: s (N + 1,).
    """
    if not isinstance(surface, Surface):
        surface = Surface(float(surface))
    rims = [] if s is None else surface.rims(np.asarray(s))
    rows: list[tuple[Any, ...]] = []
    solids: list[tuple[Mesh | Hull, bool]] = []
    radii = _least_and_largest(surface, s)
    holes: list[tuple[int, Floats, Floats, Floats]] = []
    for source, obstacle in enumerate(obstacles):
        if isinstance(obstacle, Mesh | Hull):
            at_home = changed(obstacle, pose=_HOME, friction=0.0)  # what all of its kind share
            smoothed = isinstance(obstacle, Mesh) and obstacle.smooth
            solids.append((at_home, smoothed and not sharp and radii[0] > 0.0))
        for body, cutouts in _bodies(obstacle, surface.half is not None, outlines):
            kind = KINDS.index(body.kind)
            if surface.half is not None and kind not in _BY_SECTIONS:
                raise InvalidTask(f'{obstacle!r}: expected a DLO with a round section, of a '
                                  'rectangular one the faces are not watched there; a Capsule or '
                                  'a Box is possible')
            for feature in _features(kind, body, surface, rims, sharp):
                holes += [(len(rows), *_hole(body.pose, cutout)) for cutout in cutouts]
                rows.append((source, kind, body.pose.rotation, body.pose.position, body.size,
                             obstacle.friction, *feature, body.inner,
                             -1 if body.surface is None else len(solids) - 1))

    def column(index: int, *shape: int, dtype: type = float) -> Any:
        return np.array([row[index] for row in rows], dtype=dtype).reshape(-1, *shape)

    forest, roots, grids, smooth = _surfaces(tuple(solids), radii)

    def of_solid(numbers: Sequence[int]) -> Ints:
        return np.array([numbers[row[11]] if row[11] >= 0 else -1 for row in rows], dtype=np.int64)

    return Scene(column(0, dtype=np.int64), column(1, dtype=np.int64), column(2, 3, 3),
                 column(3, 3), column(4, 3), column(5),
                 np.array([hole[0] for hole in holes], dtype=np.int64),
                 *(np.array([hole[k] for hole in holes], dtype=float).reshape(-1, 2)
                   for k in (1, 2, 3)),
                 surface.radius, np.zeros(3), column(6, dtype=np.int64), column(7, 2), column(8),
                 column(9, 2, dtype=np.int64),
                 np.zeros((0, 2)) if s is None else surface.radii(np.asarray(s)), column(10),
                 of_solid(roots), forest, of_solid(smooth), grids)


@lru_cache(maxsize=_REMEMBERED)
def _surfaces(solids: tuple[tuple[Mesh | Hull, bool], ...], radii: tuple[float, float]
              ) -> tuple[Trees, list[int], Grids, list[int]]:
    """Return what scenes with the same solids share: trees, smooth distances, where each begins.

    solids: each in its own frame, and whether it has smooth distances, which are for a DLO with
    radii between two, m; their number is -1 where there are none.
    """
    grids: list[Grid] = []
    first = []
    trees = [_tree(solid) for solid, _ in solids]
    for tree, (_, smooth) in zip(trees, solids, strict=True):
        first.append(len(grids) if smooth else -1)
        if smooth:
            grids += grids_of(joined([tree])[0], radii)
    return *joined(trees), joined_grids(grids), first


@lru_cache(maxsize=_REMEMBERED)
def _tree(obstacle: Mesh | Hull) -> Tree:
    """Return the tree over the triangles of an obstacle; many scenes are made of the same ones."""
    return tree_of(obstacle.surface)


def _least_and_largest(surface: Surface, s: Floats | None) -> tuple[float, float]:
    """Return between which two the radius of a DLO is, m."""
    radii = np.zeros((0, 2)) if s is None else surface.radii(np.asarray(s))
    if not radii.size:
        return surface.radius, surface.radius
    return float(radii.min()), float(radii.max())


def _bodies(obstacle: Obstacle, edged: bool,
            outlines: bool) -> Iterator[tuple[Body, tuple[CutOut, ...]]]:
    """Yield the bodies that stand for an obstacle, with their cut-outs; `edged`: so is the DLO.

    The rim of a hole meets the edges of a DLO that is in it, never its faces.
    """
    if isinstance(obstacle, Sheet):
        for layer in _layers(obstacle):
            for sheet, cutouts in _slotted(layer):
                size = (0.5 * sheet.thickness, 0.5 * sheet.width, 0.5 * sheet.height)
                yield Body('sheet', sheet.pose, size), cutouts
        if edged and outlines:
            outline = np.array([obstacle.thickness, obstacle.width, obstacle.height])
            for edge in _edges(obstacle.pose, outline):
                yield edge, ()
        return
    for body in obstacle.bodies:
        yield body, ()
    if isinstance(obstacle, Box) and edged:
        for edge in _edges(obstacle.pose, np.asarray(obstacle.size)):
            yield edge, ()


def _edges(pose: Pose, size: Floats) -> Iterator[Body]:
    """Yield the 12 edges of a box of a size (3,) in m; the 4 of a rectangle, if the first is 0."""
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        turned = pose.rotation[:, [axis, second, third]]
        if size[axis] == 0.0:
            continue
        ways = [(-0.5, 0.5) if size[k] > 0.0 else (0.0,) for k in (second, third)]
        for one, other in product(*ways):
            away = one * size[second] * turned[:, 1] + other * size[third] * turned[:, 2]
            yield Body('capsule', Pose.from_rotation(pose.position + away, turned),
                       (0.5 * size[axis], 0, 0))


def _features(kind: int, body: Body, surface: Surface, rims: Iterable[tuple[float, _Span]],
              sharp: bool) -> list[_Feature]:
    """Return the features of a DLO's surface that may touch a body; rims: of `Surface.rims`."""
    smooth = kind in _SMOOTH
    if surface.half is None:
        features = [_Feature(AXIS, (0.0, 0.0), 0.0, _ALL)]
        for radius, span in rims:
            rounding = 0.0 if smooth or sharp else _ROUNDING * radius
            features += [_Feature(EDGE, (radius - rounding) * around, rounding, span)
                         for around in _AROUND]
        return features
    half, rounding = np.array(surface.half), _ROUNDING * min(surface.half)
    faces = [_Feature(feature, half - rounding, rounding, _ALL) for feature in (FACE, NODE_FACE)]
    if smooth or sharp:
        rounding = 0.0
    edges = [_Feature(EDGE, signs * (half - rounding), rounding, _ALL)
             for signs in map(np.array, product((-1, 1), repeat=2))]
    if kind in (SPHERE, CAPSULE):
        return edges + faces if np.asarray(body.size)[2] > 0 else faces
    return edges


def _layers(sheet: Sheet) -> list[Sheet]:
    """Return the halves of a Sheet, each its x axis out of it; itself, if it has no thickness."""
    return [sheet] if sheet.thickness == 0 else [_layer(sheet, side) for side in (-1, 1)]


def _layer(sheet: Sheet, side: int) -> Sheet:
    """Return the half of a Sheet on the side 1 or -1 of its x axis."""
    shift = 0.25 * side * sheet.thickness * sheet.pose.direction
    out = sheet.pose.rotation * (side, side, 1)
    return replace(sheet, pose=Pose.from_rotation(sheet.pose.position + shift, out),
                   thickness=0.5 * sheet.thickness,
                   cutouts=tuple(replace(one, pose=Pose(one.pose.position + shift,
                                                        one.pose.quaternion))
                                 for one in sheet.cutouts))


def _slotted(sheet: Sheet) -> list[_Layer]:
    """Return layers whose union is a sheet, with slots in place of its rectangular cut-outs.

    In the corner of a rectangle a DLO touches two edges, each of which needs a normal of its own. A
    cut-out is where two slots meet that reach beyond the sheet; each layer has one of them.
    """
    round_ones = [cutout for cutout in sheet.cutouts if cutout.radius is not None]
    square = [cutout for cutout in sheet.cutouts if cutout.radius is None]
    if len(square) > _MOST_SLOTTED:
        return [_Layer(sheet, sheet.cutouts)]
    beyond = 4.0 * (sheet.width + sheet.height)
    slots = [(replace(one, width=beyond), replace(one, height=beyond)) for one in square]
    return [_Layer(sheet, (*round_ones, *chosen)) for chosen in product(*slots)]


def _hole(pose: Pose, cutout: CutOut) -> tuple[Floats, Floats, Floats]:
    """Return center, first axis and size, (2,) each, of a cut-out in the plane of its sheet."""
    center = pose.rotation.T @ (cutout.center - pose.position)
    axis = pose.rotation.T @ cutout.pose.rotation[:, 1]
    if cutout.radius is not None:
        return center[1:], axis[1:], np.array([cutout.radius, -1.0])
    return center[1:], axis[1:], 0.5 * np.array([cutout.width, cutout.height])


# ------------------------------------------------------------------------------------------------
# How far a point is from an obstacle: signed distance with its first and second derivatives.


_CENTER = 1e-12  # of a radius: so near to the middle, no direction leads out
_SINGULAR = 1e-9  # of the square of the least half axis: the same, in an ellipsoid
_LAST = 1e-15     # of that: a change of the root that is rounding
_ITERATIONS = 60  # for that root, at most


@kernel
def signed_distance(scene: Scene, o: int, x: Floats, normal: Floats, hessian: Floats) -> float:
    """Return the distance in m of the world point x (3,) from obstacle `o`, negative inside.

    Fills normal (3,), its gradient, and hessian (3, 3), its second derivative, in 1/m.
    """
    axes = scene.axes[o]
    kind = scene.kind[o]
    if kind == PLANE:
        for i in range(3):
            normal[i] = axes[i, 0]
            for j in range(3):
                hessian[i, j] = 0.0
        return height(axes, scene.center[o], x)
    v = np.empty(3)
    for i in range(3):
        v[i] = x[i] - scene.center[o, i]
    p = np.empty(3)
    for i in range(3):
        p[i] = axes[0, i] * v[0] + axes[1, i] * v[1] + axes[2, i] * v[2]
    local, curved = np.zeros(3), np.zeros((3, 3))
    if kind in (SPHERE, CAPSULE):
        distance = _from_axis(p, scene.size[o, 0], scene.size[o, 2], local, curved)
    elif kind == BOX:
        distance = _from_box(p, scene.size[o], local, curved)
    elif kind == CYLINDER:
        distance = _from_cylinder(p, scene.size[o, 0], scene.size[o, 1], local, curved)
    elif kind == ELLIPSOID:
        distance = _from_ellipsoid(p, scene.size[o], local, curved)
    elif kind in (HULL, MESH):
        distance = np.inf
        if scene.smooth[o] >= 0:
            distance = smooth_distance(scene.trees, scene.root[o], scene.grids, scene.smooth[o], p,
                                       local, curved)
        if distance == np.inf:
            distance = signed_from_surface(scene.trees, scene.root[o], p, np.inf, local, curved)
    else:
        distance = _from_sheet(scene, o, p, local, curved)
    for i in range(3):
        normal[i] = axes[i, 0] * local[0] + axes[i, 1] * local[1] + axes[i, 2] * local[2]
        for k in range(3):
            v[k] = axes[i, 0] * curved[0, k] + axes[i, 1] * curved[1, k] + axes[i, 2] * curved[2, k]
        for j in range(3):
            hessian[i, j] = axes[j, 0] * v[0] + axes[j, 1] * v[1] + axes[j, 2] * v[2]
    return distance


@kernel
def sheet_distance(scene: Scene, o: int, x: Floats) -> float:
    """Return `signed_distance` of the world point x (3,) from a layer of a sheet, in m, alone.

    Derivatives take most of the time of that, and searches look at millions of points.
    """
    axes, center, half = scene.axes[o], scene.center[o], scene.size[o, 0]
    u, v, w = x[0] - center[0], x[1] - center[1], x[2] - center[2]
    height = axes[0, 0] * u + axes[1, 0] * v + axes[2, 0] * w
    y = axes[0, 1] * u + axes[1, 1] * v + axes[2, 1] * w
    z = axes[0, 2] * u + axes[1, 2] * v + axes[2, 2] * w
    a = _outside(y, z, scene.size[o, 1], scene.size[o, 2])
    for hole in range(scene.hole_of.size):
        if scene.hole_of[hole] != o:
            continue
        away_y, away_z = y - scene.hole_center[hole, 0], z - scene.hole_center[hole, 1]
        size = scene.hole_size[hole, 0]
        if scene.hole_size[hole, 1] < 0:
            a = max(a, size - np.sqrt(away_y * away_y + away_z * away_z))
        else:
            c, s = scene.hole_axis[hole, 0], scene.hole_axis[hole, 1]
            a = max(a, -_outside(c * away_y + s * away_z, c * away_z - s * away_y, size,
                                 scene.hole_size[hole, 1]))
    b = abs(height) - half
    if a <= 0.0 and abs(height + half) <= 2.0 * half:  # with the layer below
        b = abs(height + half) - 2.0 * half
    if a > 0.0 and b > 0.0:
        return np.sqrt(a * a + b * b)
    return max(a, b)


@kernel(forceinline=True)
def _outside(y, z, half_y, half_z):
    """Return the signed distance of (y, z) from a rectangle."""
    b, c = abs(y) - half_y, abs(z) - half_z
    return np.sqrt(b * b + c * c) if b > 0.0 and c > 0.0 else max(b, c)


@kernel
def is_convex(scene, o):
    """Return whether all of body `o` is behind the plane that touches it at its nearest point."""
    return scene.kind[o] != SHEET and scene.kind[o] != MESH


@kernel
def in_its_frame(scene, o, x, p):
    """Fill p (3,) with the world point x (3,) in the frame of body `o`."""
    for i in range(3):
        p[i] = 0.0
        for j in range(3):
            p[i] += scene.axes[o, j, i] * (x[j] - scene.center[o, j])


@kernel(forceinline=True)
def height(axes, center, x):
    """Return the distance in m of x (3,) from the plane of a half space, negative inside."""
    return (axes[0, 0] * (x[0] - center[0]) + axes[1, 0] * (x[1] - center[1])
            + axes[2, 0] * (x[2] - center[2]))


@kernel
def _from_axis(p, half, radius, normal, hessian):
    """Distance from a capsule along x (half = 0: a sphere)."""
    beyond = abs(p[0]) - half
    sign = 1.0 if p[0] >= 0 else -1.0
    along = sign * beyond if beyond > 0 or half == 0.0 else 0.0
    rho = np.sqrt(along * along + p[1] * p[1] + p[2] * p[2])
    if rho <= _CENTER * radius:
        normal[2] = 1.0
        return -radius
    normal[0], normal[1], normal[2] = along / rho, p[1] / rho, p[2] / rho
    first = 0 if beyond > 0 or half == 0.0 else 1
    for i in range(first, 3):
        for j in range(first, 3):
            hessian[i, j] = ((i == j) - normal[i] * normal[j]) / rho
    return rho - radius


@kernel
def _from_box(p, half, normal, hessian):
    outside = 0.0
    deepest = 0
    for i in range(3):
        if abs(p[i]) - half[i] > abs(p[deepest]) - half[deepest]:
            deepest = i
        if abs(p[i]) > half[i]:
            outside += (abs(p[i]) - half[i]) ** 2
    if outside == 0.0:
        normal[deepest] = 1.0 if p[deepest] >= 0 else -1.0
        return abs(p[deepest]) - half[deepest]
    distance = np.sqrt(outside)
    for i in range(3):
        if abs(p[i]) > half[i]:
            normal[i] = (abs(p[i]) - half[i]) / distance * (1.0 if p[i] >= 0 else -1.0)
    for i in range(3):
        for j in range(3):
            if abs(p[i]) > half[i] and abs(p[j]) > half[j]:
                hessian[i, j] = ((i == j) - normal[i] * normal[j]) / distance
    return distance


@kernel
def _from_ellipsoid(p, half, normal, hessian):
    """Distance from an ellipsoid with half axes a_i.

    The nearest point is y_i = a_i^2 p_i / (a_i^2 + t) for the one t at which the vector of the
    y_i / a_i has the size 1 (Eberly, Distance from a Point to an Ellipsoid). The inverse of that
    size is concave in t and nearly linear: Newton's method from below takes few steps and passes
    over nothing.
    """
    square, least, largest = 0.0, 0, 0.0
    for i in range(3):
        square += p[i] * p[i]
        largest = max(largest, half[i])
        if half[i] < half[least]:
            least = i
    a = half[least]
    t = max(a * abs(p[least]) - a * a, a * np.sqrt(square) - largest * largest,
            (_SINGULAR - 1.0) * a * a)
    for _ in range(_ITERATIONS):
        square = slope = 0.0
        for i in range(3):
            x = half[i] * p[i] / (half[i] * half[i] + t)
            square += x * x
            slope += x * x / (half[i] * half[i] + t)
        if square <= 1.0:
            break
        change = square * (np.sqrt(square) - 1.0) / slope
        t += change
        if change <= _LAST * (a * a + t):
            break
    y, g, m, w = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for i in range(3):
        m[i] = half[i] * half[i] / (half[i] * half[i] + t)
        y[i] = m[i] * p[i]
    if square < 1.0 - _SINGULAR:  # about the middle, where two points of the surface are as near
        rest = 1.0 - square + (y[least] / a) ** 2
        y[least] = (a if p[least] >= 0.0 else -a) * np.sqrt(rest)
    size = total = distance = 0.0
    for i in range(3):
        g[i] = y[i] / (half[i] * half[i])
        size += g[i] * g[i]
        total += m[i] * g[i] * g[i]
    size = np.sqrt(size)
    for i in range(3):
        normal[i] = g[i] / size
        distance += (p[i] - y[i]) * normal[i]
        for j in range(3):  # the surface's point moves by w dp
            w[i, j] = (m[i] if i == j else 0.0) - m[i] * g[i] * m[j] * g[j] / total
    for j in range(3):
        along = 0.0
        for i in range(3):
            along += normal[i] * w[i, j] / (half[i] * half[i])
        for i in range(3):
            hessian[i, j] = (w[i, j] / (half[i] * half[i]) - normal[i] * along) / size
    return distance


@kernel
def _from_sheet(scene, o, p, normal, hessian):
    """Distance from one of the two layers of a plate with holes; the other one is below it.

    What is inside of one of them comes out of both, not from one into the other.
    """
    slope, half = np.zeros(2), scene.size[o, 0]
    a, turn = in_plane(scene, o, p[1], p[2], slope)
    if a <= 0.0 and abs(p[0] + half) <= 2.0 * half:
        whole = np.array([p[0] + half, p[1], p[2]])
        return from_faces(whole, 2.0 * half, a, turn, slope, normal, hessian)
    return from_faces(p, half, a, turn, slope, normal, hessian)


@kernel
def _from_cylinder(p, half, radius, normal, hessian):
    """Distance from a cylinder along x with flat ends."""
    slope = np.zeros(2)
    rho = np.sqrt(p[1] * p[1] + p[2] * p[2])
    turn = 0.0
    if rho <= _CENTER * radius:
        slope[1] = 1.0
    else:
        turn = 1.0 / rho
        slope[0], slope[1] = p[1] * turn, p[2] * turn
    return from_faces(p, half, rho - radius, turn, slope, normal, hessian)


@kernel
def from_faces(p, half, a, turn, slope, normal, hessian):
    """Distance from what lies between two faces `half` above and below: in the plane (a), both."""
    side = 1.0 if p[0] >= 0 else -1.0
    b = abs(p[0]) - half
    if a > 0 and b > 0:
        d = np.sqrt(a * a + b * b)
        normal[0], normal[1], normal[2] = side * b / d, a / d * slope[0], a / d * slope[1]
        m0, m1, m2 = -side * a / d, b / d * slope[0], b / d * slope[1]
        hessian[0, 0] = m0 * m0 / d
        hessian[0, 1] = hessian[1, 0] = m0 * m1 / d
        hessian[0, 2] = hessian[2, 0] = m0 * m2 / d
        _add_turn(hessian, slope, turn * a / d)
        hessian[1, 1] += m1 * m1 / d
        hessian[1, 2] += m1 * m2 / d
        hessian[2, 1] += m1 * m2 / d
        hessian[2, 2] += m2 * m2 / d
        return d
    if b > 0 or (a <= 0 and b >= a):
        normal[0] = side
        return b
    normal[1], normal[2] = slope[0], slope[1]
    _add_turn(hessian, slope, turn)
    return a


@kernel
def _add_turn(hessian, slope, amount):
    hessian[1, 1] += amount * slope[1] * slope[1]
    hessian[2, 2] += amount * slope[0] * slope[0]
    hessian[1, 2] -= amount * slope[0] * slope[1]
    hessian[2, 1] -= amount * slope[0] * slope[1]


@kernel
def in_plane(scene, o, y, z, slope):
    """Return how far (y, z) is outside the sheet's material (in a hole, or beyond its border).

    Fills slope (2,), the gradient; also returns the curvature of that distance, 1/m.
    """
    a, turn = from_rectangle(y, z, scene.size[o, 1], scene.size[o, 2], slope)
    other = np.empty(2)
    for hole in range(scene.hole_of.size):
        if scene.hole_of[hole] != o:
            continue
        away_y, away_z = y - scene.hole_center[hole, 0], z - scene.hole_center[hole, 1]
        if scene.hole_size[hole, 1] < 0:
            rho = max(np.sqrt(away_y * away_y + away_z * away_z),
                      _CENTER * scene.hole_size[hole, 0])
            inside = scene.hole_size[hole, 0] - rho
            if inside > a:
                a, turn = inside, -1.0 / rho
                slope[0], slope[1] = -away_y / rho, -away_z / rho
        else:
            c, s = scene.hole_axis[hole, 0], scene.hole_axis[hole, 1]
            outside, curved = from_rectangle(c * away_y + s * away_z, c * away_z - s * away_y,
                                              scene.hole_size[hole, 0], scene.hole_size[hole, 1],
                                              other)
            if -outside > a:
                a, turn = -outside, -curved
                slope[0], slope[1] = s * other[1] - c * other[0], -s * other[0] - c * other[1]
    return a, turn


@kernel
def from_rectangle(y, z, half_y, half_z, slope):
    """Return the signed distance of (y, z) from a rectangle and its curvature; fill its slope."""
    b, c = abs(y) - half_y, abs(z) - half_z
    sign_y = 1.0 if y >= 0 else -1.0
    sign_z = 1.0 if z >= 0 else -1.0
    if b > 0 and c > 0:
        d = np.sqrt(b * b + c * c)
        slope[0], slope[1] = sign_y * b / d, sign_z * c / d
        return d, 1.0 / d
    if b >= c:
        slope[0], slope[1] = sign_y, 0.0
        return b, 0.0
    slope[0], slope[1] = 0.0, sign_z
    return c, 0.0
