# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""visualization_msgs <-> obstacles, as RViz shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from ament_index_python.packages import get_package_share_directory
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import choice, flag, instance, items, number, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import (
    OBSTACLES,
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
from dlo_planner.model.triangles import MOST, read
from dlo_planner.settings.yaml_files import load_yaml, yaml_of
from msg_helpers.poses import header, pose_from_msg, pose_msg

_ALIKE = 1e-6  # relative: sizes that count as the same
_LONGEST = 10_000  # characters of a text
_ROLES = ('all', 'workspace only')
_ENDS = ('flat', 'round')
_MARKERS = {'box': Marker.CUBE, 'ball': Marker.SPHERE, 'cylinder': Marker.CYLINDER}
_SAID = ('friction', 'role', 'ends', 'cutouts', 'smooth', 'hull')  # what a marker's text may say
_FILE, _PACKAGE = 'file://', 'package://'


class Body(NamedTuple):
    """An obstacle that a marker describes."""

    obstacle: Obstacle
    friction: float | None = None  # Coulomb's coefficient; None: the marker says nothing of it
    role: str = 'all'  # 'all': for the DLO and the gripper, 'workspace only': for the gripper


def obstacles_after(known: Mapping[tuple[str, int], Body], msg: MarkerArray, frame_id: str,
                    name: str) -> dict[tuple[str, int], Body]:
    """Return the dict of bodies, by (namespace, id), after a visualization_msgs/MarkerArray.

    CUBE is a Box, SPHERE a Sphere or an Ellipsoid, CYLINDER a Cylinder, ARROW the Plane from
    whose surface it stands out, TRIANGLE_LIST and MESH_RESOURCE (`file://`, `package://`; in m,
    times the marker's scale) a Mesh. The text of a marker is empty, or YAML that says more:
    `{friction: 0.3}`, `{role: workspace only}`, `{ends: round}` (of a cylinder: a Capsule),
    `{cutouts: [{y: 0, z: 0, radius: 0.01}]}` (of a cube: a Sheet, whose thickness is along x), of
    triangles `{smooth: false}` and `{hull: true}` (the Hull of their corners). DELETE takes one
    away, DELETEALL all (of a namespace, if one is named). Those of role 'workspace only' come last.
    """
    items('known', tuple(instance('known', known, dict).values()), Body)
    instance('msg', msg, MarkerArray)
    instance('frame_id', frame_id, str)
    instance('name', name, str)
    after = dict(known)
    for index, marker in enumerate(msg.markers):
        where = f'{name}.markers[{index}]'
        if marker.action == Marker.DELETEALL:
            after = {key: value for key, value in after.items()
                     if marker.ns and key[0] != marker.ns}
        elif marker.action == Marker.DELETE:
            after.pop((marker.ns, marker.id), None)
        elif marker.action == Marker.ADD:
            if marker.header.frame_id != frame_id:
                raise InvalidTask(f'{where}.header.frame_id = {shown(marker.header.frame_id)}: '
                                  f'expected {frame_id!r}')
            try:
                after[marker.ns, marker.id] = _body(marker)
            except InvalidTask as error:
                raise InvalidTask(f'{where}: {error}') from None
        else:
            raise InvalidTask(f'{where}.action = {marker.action}: expected ADD, DELETE or '
                              'DELETEALL')
    return dict(sorted(after.items(), key=lambda item: item[1].role != 'all'))


def obstacles_msg(obstacles: Iterable[Obstacle], frame_id: str, stamp: Time | None = None,
                  friction: float | None = None) -> MarkerArray:
    """Return the MarkerArray that `obstacles_after` reads: all before go, these come."""
    markers = [Marker(header=header(frame_id, stamp), action=Marker.DELETEALL)]
    for index, one in enumerate(items('obstacles', obstacles, OBSTACLES)):
        kind, pose, size, said = _drawn(one)
        said['friction'] = one.friction if friction is None else number('friction', friction,
                                                                       minimum=0)
        marker = Marker(header=header(frame_id, stamp), ns='obstacles', id=index, type=kind,
                        action=Marker.ADD, pose=pose_msg(pose), text=yaml_of(said))
        marker.scale.x, marker.scale.y, marker.scale.z = map(float, size)
        if isinstance(one, Mesh | Hull):
            marker.points = [Point(x=x, y=y, z=z) for x, y, z in
                             one.surface.vertices[one.surface.faces].reshape(-1, 3).tolist()]
        marker.color.r = marker.color.g = marker.color.b = marker.color.a = 0.5
        markers.append(marker)
    return MarkerArray(markers=markers)


def _drawn(obstacle: Obstacle) -> tuple[int, Pose, Iterable[float], dict[str, Any]]:
    """Return type, pose and scale of the marker of an obstacle, and what its text has to say."""
    if isinstance(obstacle, Plane):
        return Marker.ARROW, Pose.looking_along(obstacle.point, obstacle.normal), (0.1,) * 3, {}
    if isinstance(obstacle, Sheet):
        local = [(obstacle.pose.inverse().compose(one.pose), one) for one in obstacle.cutouts]
        cutouts = [{'y': float(pose.position[1]), 'z': float(pose.position[2]), **{
            name: value for name in ('radius', 'width', 'height')
            if (value := getattr(one, name)) is not None}} for pose, one in local]
        return Marker.CUBE, obstacle.pose, (max(obstacle.thickness, 1e-9), obstacle.width,
                                            obstacle.height), {'cutouts': cutouts}
    if isinstance(obstacle, Mesh):
        return Marker.TRIANGLE_LIST, obstacle.pose, (1.0,) * 3, (
            {} if obstacle.smooth else {'smooth': False})
    if isinstance(obstacle, Hull):
        return Marker.TRIANGLE_LIST, obstacle.pose, (1.0,) * 3, {'hull': True}
    body, *more = obstacle.solids
    if more and not isinstance(obstacle, Capsule):
        raise InvalidTask(f'{obstacle!r}: expected an obstacle that is one marker')
    return _MARKERS[body.kind], body.pose, body.size, {'ends': 'round'} if more else {}


def _body(marker: Marker) -> Body:
    said = _said(marker.text)
    friction = said.get('friction')
    if friction is not None:
        friction = number('text: friction', friction, minimum=0)
    return Body(_obstacle(marker, said, friction or 0.0), friction,
                choice('text: role', said.get('role', 'all'), _ROLES))


def _said(text: str) -> dict[str, Any]:
    """Return what the text of a marker says, name -> value."""
    if not text.strip():
        return {}
    if len(text) > _LONGEST:
        raise InvalidTask(f'text has {len(text)} characters: expected {_LONGEST} at most')
    said = load_yaml(text, 'text')
    if not isinstance(said, dict) or not said.keys() <= set(_SAID):
        raise InvalidTask(f'text = {shown(text)}: expected none, or YAML with some of '
                          f'{", ".join(_SAID)}, as {{friction: 0.3}}')
    return said


def _obstacle(marker: Marker, said: Mapping[str, Any], friction: float) -> Obstacle:
    pose = pose_from_msg(marker.pose)
    x, y, z = size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    for key, kind, called in (('ends', Marker.CYLINDER, 'cylinder'),
                              ('cutouts', Marker.CUBE, 'cube')):
        if key in said and marker.type != kind:
            raise InvalidTask(f'text: {key} = {shown(said[key])}: expected of a {called} alone')
    of_triangles = marker.type in (Marker.TRIANGLE_LIST, Marker.MESH_RESOURCE)
    for key in ('smooth', 'hull'):
        if key in said and not of_triangles:
            raise InvalidTask(f'text: {key} = {shown(said[key])}: expected of triangles alone')
    if marker.type == Marker.ARROW:
        if marker.points:
            raise InvalidTask('points: expected none, an arrow by its pose: a plane at its '
                              'beginning, solid behind it')
        return Plane(pose.position, pose.direction, friction)
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise InvalidTask(f'scale = {size.tolist()}: expected three numbers above 0 m')
    if marker.type == Marker.CUBE:
        if 'cutouts' in said:
            return Sheet(pose, y, z, x, _cutouts(pose, said['cutouts']), friction)
        return Box(pose, size, friction)
    if marker.type == Marker.SPHERE:
        if np.ptp(size) > _ALIKE * x:
            return Ellipsoid(pose, size / 2, friction)
        return Sphere(pose.position, x / 2, friction)
    if marker.type == Marker.CYLINDER:
        if abs(x - y) > _ALIKE * x:
            raise InvalidTask(f'scale = {size.tolist()}: expected a round cylinder, x = y')
        along = 0.5 * z * pose.rotation[:, 2]
        kind = Capsule if choice('text: ends', said.get('ends', 'flat'),
                                 _ENDS) == 'round' else Cylinder
        return kind(pose.position - along, pose.position + along, x / 2, friction)
    if of_triangles:
        return _of_triangles(marker, pose, size, said, friction)
    raise InvalidTask(f'type = {marker.type}: expected CUBE, SPHERE, CYLINDER, ARROW (a plane), '
                      'TRIANGLE_LIST or MESH_RESOURCE')


def _of_triangles(marker: Marker, pose: Pose, scale: Any, said: Mapping[str, Any],
                  friction: float) -> Mesh | Hull:
    """Return the Mesh or the Hull of a marker with triangles, or with the name of their file."""
    smooth = flag('text: smooth', said.get('smooth', True))
    is_hull = flag('text: hull', said.get('hull', False))
    if marker.type == Marker.MESH_RESOURCE:
        surface = read(_path_of(marker.mesh_resource), 'm')
        vertices, faces = scale * surface.vertices, surface.faces
    else:
        if not marker.points or len(marker.points) % 3 or len(marker.points) > 3 * MOST:
            raise InvalidTask(f'points has {len(marker.points)} entries: expected three for each '
                              f'triangle, of at most {MOST}')
        vertices = scale * np.array([(point.x, point.y, point.z) for point in marker.points])
        faces = np.arange(len(vertices)).reshape(-1, 3)
    if is_hull:
        return Hull(vertices, pose, friction)
    return Mesh.mended(vertices, faces, pose, friction, smooth)


def _path_of(resource: str) -> str:
    """Return the path of a resource: `file://` and an absolute path, or `package://name/path`."""
    if resource.startswith(_FILE + '/'):
        return resource.removeprefix(_FILE)
    package, _, path = resource.removeprefix(_PACKAGE).partition('/')
    if not resource.startswith(_PACKAGE) or not path:
        raise InvalidTask(f'mesh_resource = {shown(resource)}: expected file:///absolute/path or '
                          'package://name/path')
    try:
        return f'{get_package_share_directory(package)}/{path}'
    except (LookupError, OSError, ValueError) as error:
        raise InvalidTask(f'mesh_resource = {shown(resource)}: expected a package that is '
                          f'installed here, {error}') from None


def _cutouts(pose: Pose, given: Any) -> list[CutOut]:
    """Return the CutOuts of a sheet at a Pose, of what its text says of them."""
    cutouts = []
    for index, one in enumerate(instance('text: cutouts', given, list)):
        name = f'text: cutouts[{index}]'
        if not isinstance(one, dict) or not one.keys() <= {'y', 'z', 'radius', 'width', 'height'}:
            raise InvalidTask(f'{name} = {shown(one)}: expected y, z and radius, or width and '
                              'height')
        sizes = dict(one)
        at = [number(f'{name}.{axis}', sizes.pop(axis, 0.0)) for axis in 'yz']
        cutouts.append(CutOut(pose.compose(Pose((0.0, *at), (0.0, 0.0, 0.0, 1.0))), **sizes))
    return cutouts
