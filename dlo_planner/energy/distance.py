# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a point is from an obstacle: signed distance with its first and second derivatives."""

from dataclasses import replace
from itertools import product

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.kernels import kernel
from dlo_planner.model.obstacles import Box, Capsule, Cylinder, Plane, Sheet, Sphere
from dlo_planner.model.pose import Pose
from dlo_planner.model.surface import Surface
from dlo_planner.ritz.record import Record, makes

PLANE, SPHERE, CAPSULE, BOX, SHEET, CYLINDER = range(6)
AXIS, EDGE, FACE, NODE_FACE = range(4)
_MOST_FOILS = 5
_ROUNDING = 0.02  # of the smaller half size: of a section's edges where an obstacle has edges
_ALL = (0, 2**31)  # nodes
_AROUND = np.array([(np.cos(angle), np.sin(angle)) for angle in np.arange(12) * np.pi / 6])
_CENTER = 1e-12  # of a radius: so near to the middle, no direction leads out


class Scene(Record):
    """Obstacles as plain arrays; M bodies with H cut-outs in all.

    A body is a part of an obstacle, as one feature of the DLO's surface meets it. A sheet is a
    stack of foils, its faces and, if it is thick, some between: at the rim of a hole a DLO touches
    edges, and each edge needs a nearest point of its own. A round DLO has one feature, balls about
    its axis. A rectangular one has four edges along it; where an obstacle is curved or has edges
    itself, also the faces between them (`energy.outline`).

    Attributes:
        source: (M,) index of the obstacle that a body is (part of)
        kind: (M,) PLANE ... CYLINDER
        axes: (M, 3, 3) columns x, y, z of the obstacle's frame; center: (M, 3) m, world
        size: (M, 3) half sizes along the axes; a sphere's or capsule's radius is the last one, a
            capsule's half length the first; a cylinder's (half length, radius, the smaller one)
        friction: (M,)
        hole_of: (H,) index of its sheet; hole_center: (H, 2) y, z there, m; hole_axis: (H, 2)
            the hole's own first axis there; hole_size: (H, 2) half width and height, or the
            radius and -1
        radius: of the DLO, m; the largest
        origin: (3,) the gripper's position: nodes are given relative to it
        feature: (M,) of the DLO: AXIS, EDGE, FACE (anywhere along an element) or NODE_FACE
        offset: (M, 2) of an edge from the axis along n and b, m; of faces: half sizes of the
            section; less `rounding` (M,) m, by which the feature is thickened
        span: (M, 2) first and last node of the feature; it may end beyond the DLO
        radii: (N, 2) of the DLO at both ends of its elements, m; (0, 2): `radius` everywhere
    """

    source: np.ndarray
    kind: np.ndarray
    axes: np.ndarray
    center: np.ndarray
    size: np.ndarray
    friction: np.ndarray
    hole_of: np.ndarray
    hole_center: np.ndarray
    hole_axis: np.ndarray
    hole_size: np.ndarray
    radius: float
    origin: np.ndarray
    feature: np.ndarray
    offset: np.ndarray
    rounding: np.ndarray
    span: np.ndarray
    radii: np.ndarray


@makes(Scene)
@kernel
def _new_scene(source, kind, axes, center, size, friction, hole_of, hole_center, hole_axis,
               hole_size, radius, origin, feature, offset, rounding, span, radii):
    return Scene(source, kind, axes, center, size, friction, hole_of, hole_center, hole_axis,
                 hole_size, radius, origin, feature, offset, rounding, span, radii)


def build_scene(obstacles, surface, s=None, *, sharp=False):
    """Return the Scene of a sequence of obstacles for a DLO.

    Args:
        surface: Surface of the DLO, or its radius in m
        s: (N + 1,) its nodes, m; only a radius that varies needs them
        sharp: whether the edges of its section are, against obstacles that have edges, too: for
            distances alone, whose derivatives would be infinite in contact
    """
    if not isinstance(surface, Surface):
        surface = Surface(float(surface))
    rows, holes = [], []
    rims = [] if s is None else surface.rims(np.asarray(s))
    for source, obstacle in enumerate(obstacles):
        for part in _parts(obstacle, surface):
            kind, pose, half = _body(part)
            for feature, offset, rounding, span in _features(kind, half, surface, rims, sharp):
                if kind == SHEET:
                    holes += [(len(rows), *_hole(pose, cutout)) for cutout in part.cutouts]
                rows.append((source, kind, pose.rotation, pose.position, half, obstacle.friction,
                             feature, offset, rounding, span))
    source, kind, axes, center, size, friction, feature, offset, rounding, span = (
        zip(*rows, strict=True) if rows else ((),) * 10)
    return Scene(np.array(source, dtype=np.int64), np.array(kind, dtype=np.int64),
                 np.array(axes, dtype=float).reshape(-1, 3, 3),
                 np.array(center, dtype=float).reshape(-1, 3),
                 np.array(size, dtype=float).reshape(-1, 3), np.array(friction, dtype=float),
                 np.array([hole[0] for hole in holes], dtype=np.int64),
                 *(np.array([hole[k] for hole in holes], dtype=float).reshape(-1, 2)
                   for k in (1, 2, 3)), surface.radius, np.zeros(3),
                 np.array(feature, dtype=np.int64),
                 np.array(offset, dtype=float).reshape(-1, 2), np.array(rounding, dtype=float),
                 np.array(span, dtype=np.int64).reshape(-1, 2),
                 np.zeros((0, 2)) if s is None else surface.radii(np.asarray(s)))


def _parts(obstacle, surface):
    """Return what an obstacle consists of: obstacles, and (pose, half length) of straight edges."""
    if isinstance(obstacle, Sheet):
        return _foils(obstacle, surface.least)
    if isinstance(obstacle, Box) and surface.half is not None:
        return [obstacle, *_edges(obstacle)]
    if isinstance(obstacle, Cylinder) and surface.half is not None:
        raise InvalidTask(f'{obstacle!r}: expected a DLO with a round section, of a rectangular '
                          'one the faces are not watched at its rims; a Capsule has none')
    return [obstacle]


def _edges(box):
    """Yield (pose, half length) of the 12 edges of a Box, x along them."""
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        turned = box.pose.rotation[:, [axis, second, third]]
        for one, other in product((-0.5, 0.5), repeat=2):
            away = (one * box.size[second] * turned[:, 1] + other * box.size[third] * turned[:, 2])
            yield Pose.from_rotation(box.pose.position + away, turned), 0.5 * box.size[axis]


def _body(part):
    """Return kind, pose and half sizes (3,) of one of `_parts`."""
    if isinstance(part, Plane):
        return PLANE, Pose.looking_along(part.point, part.normal), (0, 0, 0)
    if isinstance(part, Sphere):
        return SPHERE, Pose(part.center, (0, 0, 0, 1)), (0, 0, part.radius)
    if isinstance(part, Capsule):
        along = part.end - part.start
        return (CAPSULE, Pose.looking_along(0.5 * (part.start + part.end), along),
                (0.5 * np.linalg.norm(along), 0, part.radius))
    if isinstance(part, Cylinder):
        along = part.end - part.start
        half = 0.5 * np.linalg.norm(along)
        return (CYLINDER, Pose.looking_along(0.5 * (part.start + part.end), along),
                (half, part.radius, min(half, part.radius)))
    if isinstance(part, Box):
        return BOX, part.pose, 0.5 * part.size
    if isinstance(part, Sheet):
        return SHEET, part.pose, (0.5 * part.thickness, 0.5 * part.width, 0.5 * part.height)
    pose, half = part
    return CAPSULE, pose, (half, 0, 0)


def _features(kind, size, surface, rims, sharp):
    """Return [(feature, offset, rounding, span)] of a DLO's surface that may touch a body.

    Args:
        rims: of `Surface.rims`
    """
    smooth = kind in (PLANE, SPHERE, CAPSULE)  # edges need not be rounded to touch it
    if surface.half is None:
        features = [(AXIS, (0.0, 0.0), 0.0, _ALL)]
        for radius, span in rims:
            rounding = 0.0 if smooth or sharp else _ROUNDING * radius
            features += [(EDGE, (radius - rounding) * around, rounding, span) for around in _AROUND]
        return features
    half, rounding = np.array(surface.half), _ROUNDING * min(surface.half)
    faces = [(feature, half - rounding, rounding, _ALL) for feature in (FACE, NODE_FACE)]
    if smooth or sharp:
        rounding = 0.0
    edges = [(EDGE, signs * (half - rounding), rounding, _ALL)
             for signs in map(np.array, product((-1, 1), repeat=2))]
    if kind in (SPHERE, CAPSULE):
        return edges + faces if size[2] > 0 else faces
    return edges


def _foils(sheet, radius):
    """Return Sheets without thickness that stand for `sheet`, close enough for the DLO's radius."""
    if sheet.thickness == 0:
        return [sheet]
    number = _MOST_FOILS
    if sheet.thickness < 4 * _MOST_FOILS * radius:
        number = min(_MOST_FOILS, 2 + int(sheet.thickness / (4 * radius)))
    shifts = np.linspace(-0.5, 0.5, number) * sheet.thickness
    return [_moved(sheet, shift) for shift in shifts]


def _moved(sheet, shift):
    def along(pose):
        return Pose(pose.position + shift * sheet.pose.direction, pose.quaternion)

    return replace(sheet, pose=along(sheet.pose), thickness=0.0,
                   cutouts=tuple(replace(cutout, pose=along(cutout.pose))
                                 for cutout in sheet.cutouts))


def _hole(pose, cutout):
    center = pose.rotation.T @ (cutout.center - pose.position)
    axis = pose.rotation.T @ cutout.pose.rotation[:, 1]
    size = ((cutout.radius, -1.0) if cutout.radius is not None
            else (0.5 * cutout.width, 0.5 * cutout.height))
    return center[1:], axis[1:], size


@kernel
def signed_distance(scene, o, x, normal, bend):
    """Return the distance in m of the world point x (3,) from obstacle `o`, negative inside.

    Fills normal (3,), its gradient, and bend (3, 3), its second derivative, in 1/m.
    """
    axes = scene.axes[o]
    kind = scene.kind[o]
    v = np.empty(3)
    for i in range(3):
        v[i] = x[i] - scene.center[o, i]
    p = np.empty(3)
    for i in range(3):
        p[i] = axes[0, i] * v[0] + axes[1, i] * v[1] + axes[2, i] * v[2]
    local, curved = np.zeros(3), np.zeros((3, 3))
    if kind == PLANE:
        local[0] = 1.0
        distance = p[0]
    elif kind in (SPHERE, CAPSULE):
        distance = _from_axis(p, scene.size[o, 0], scene.size[o, 2], local, curved)
    elif kind == BOX:
        distance = _from_box(p, scene.size[o], local, curved)
    elif kind == CYLINDER:
        distance = _from_cylinder(p, scene.size[o, 0], scene.size[o, 1], local, curved)
    else:
        distance = _from_sheet(scene, o, p, local, curved)
    for i in range(3):
        normal[i] = axes[i, 0] * local[0] + axes[i, 1] * local[1] + axes[i, 2] * local[2]
    if kind == PLANE:
        bend[:] = 0.0
    else:
        for i in range(3):
            for k in range(3):
                v[k] = axes[i, 0] * curved[0, k] + axes[i, 1] * curved[1, k] + (
                    axes[i, 2] * curved[2, k])
            for j in range(3):
                bend[i, j] = axes[j, 0] * v[0] + axes[j, 1] * v[1] + axes[j, 2] * v[2]
    return distance


@kernel
def _from_axis(p, half, radius, normal, bend):
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
            bend[i, j] = ((i == j) - normal[i] * normal[j]) / rho
    return rho - radius


@kernel
def _from_box(p, half, normal, bend):
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
                bend[i, j] = ((i == j) - normal[i] * normal[j]) / distance
    return distance


@kernel
def _from_sheet(scene, o, p, normal, bend):
    """Distance from a plate with holes."""
    slope = np.zeros(2)
    a, turn = in_plane(scene, o, p[1], p[2], slope)
    return _from_faces(p, scene.size[o, 0], a, turn, slope, normal, bend)


@kernel
def _from_cylinder(p, half, radius, normal, bend):
    """Distance from a cylinder along x with flat ends."""
    slope = np.zeros(2)
    rho = np.sqrt(p[1] * p[1] + p[2] * p[2])
    turn = 0.0
    if rho <= _CENTER * radius:
        slope[1] = 1.0
    else:
        turn = 1.0 / rho
        slope[0], slope[1] = p[1] * turn, p[2] * turn
    return _from_faces(p, half, rho - radius, turn, slope, normal, bend)


@kernel
def _from_faces(p, half, a, turn, slope, normal, bend):
    """Distance from what lies between two faces `half` above and below: in the plane (a), both.

    Args:
        a: distance in the plane, its gradient `slope` (2,) and its curvature `turn`
    """
    side = 1.0 if p[0] >= 0 else -1.0
    b = abs(p[0]) - half
    if a > 0 and b > 0:
        d = np.sqrt(a * a + b * b)
        normal[0], normal[1], normal[2] = side * b / d, a / d * slope[0], a / d * slope[1]
        m0, m1, m2 = -side * a / d, b / d * slope[0], b / d * slope[1]
        bend[0, 0] = m0 * m0 / d
        bend[0, 1] = bend[1, 0] = m0 * m1 / d
        bend[0, 2] = bend[2, 0] = m0 * m2 / d
        _add_turn(bend, slope, turn * a / d)
        bend[1, 1] += m1 * m1 / d
        bend[1, 2] += m1 * m2 / d
        bend[2, 1] += m1 * m2 / d
        bend[2, 2] += m2 * m2 / d
        return d
    if b > 0 or (a <= 0 and b >= a):
        normal[0] = side
        return b
    normal[1], normal[2] = slope[0], slope[1]
    _add_turn(bend, slope, turn)
    return a


@kernel
def _add_turn(bend, slope, amount):
    bend[1, 1] += amount * slope[1] * slope[1]
    bend[2, 2] += amount * slope[0] * slope[0]
    bend[1, 2] -= amount * slope[0] * slope[1]
    bend[2, 1] -= amount * slope[0] * slope[1]


@kernel
def in_plane(scene, o, y, z, slope):
    """Return how far (y, z) is outside the sheet's material (in a hole, or beyond its border).

    Fills slope (2,), the gradient; also returns the curvature of that distance, 1/m.
    """
    a, turn = _from_rectangle(y, z, scene.size[o, 1], scene.size[o, 2], slope)
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
            outside, curved = _from_rectangle(c * away_y + s * away_z, c * away_z - s * away_y,
                                              scene.hole_size[hole, 0], scene.hole_size[hole, 1],
                                              other)
            if -outside > a:
                a, turn = -outside, -curved
                slope[0], slope[1] = s * other[1] - c * other[0], -s * other[0] - c * other[1]
    return a, turn


@kernel
def _from_rectangle(y, z, half_y, half_z, slope):
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
