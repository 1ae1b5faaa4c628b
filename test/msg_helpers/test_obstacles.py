# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as markers: there and back, taken away, refused by name."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from meshes import SOLIDS
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    Ellipsoid,
    Hull,
    InvalidTask,
    Mesh,
    Plane,
    Pose,
    Sheet,
    Sphere,
)
from dlo_planner.model.obstacles import OBSTACLES, ball
from dlo_planner.model.triangles import volume
from msg_helpers.obstacles import Body, obstacles_after, obstacles_msg

TURNED = Pose((0.1, -0.2, 0.3), (0.1, -0.2, 0.3, 0.9))
ENDS = (0.1, 0.2, 0.3), (0.5, -0.2, 0.6)
HOLE = CutOut(TURNED.compose(Pose((0.0, 0.03, -0.02), (0, 0, 0, 1))), radius=0.01)
ALL = [Box(TURNED, (0.1, 0.2, 0.3)), Sphere((1, 2, 3), 0.4, 0.2), Cylinder(*ENDS, 0.02, 0.3),
       Capsule(*ENDS, 0.02), Plane((0.1, 0.2, 0.3), (1.0, 2.0, 2.0), 0.5),
       Sheet(TURNED, 0.3, 0.2, 0.002, [HOLE], 0.1), Ellipsoid(TURNED, (0.1, 0.2, 0.3), 0.4),
       Mesh(*SOLIDS['bracket'], TURNED, 0.2), Mesh(*SOLIDS['ring'], TURNED, smooth=False),
       Hull(SOLIDS['wedge'].vertices, TURNED, 0.3)]


def shown(obstacles=tuple(ALL), **more):
    """Return the message of some obstacles, without the marker that takes those before away."""
    message = obstacles_msg(obstacles, 'world', Time(), **more)
    assert message.markers[0].action == Marker.DELETEALL
    return MarkerArray(markers=message.markers[1:])


def after(message, known=()):
    return obstacles_after(dict(known), message, 'world', 'obstacles')


def numbers(obstacle):
    parts = [obstacle.friction]
    for name in ('center', 'radius', 'start', 'end', 'point', 'normal', 'size', 'width', 'height',
                 'thickness', 'smooth'):
        parts.append(getattr(obstacle, name, ()))
    if isinstance(obstacle, Mesh | Hull):
        parts.append(np.sort(obstacle.surface.vertices, axis=0))
        parts.append(volume(*obstacle.surface))
    for pose in [getattr(obstacle, 'pose', None), *(
            one.pose for one in getattr(obstacle, 'cutouts', ()))]:
        parts.append(() if pose is None else pose.matrix)
    return np.concatenate([np.ravel(part) for part in parts])


def test_each_obstacle_is_there_and_back_as_it_is():
    assert {type(one) for one in ALL} == set(OBSTACLES)
    back = [body.obstacle for body in after(shown()).values()]
    assert [type(one) for one in back] == [type(one) for one in ALL]
    for one, other in zip(back, ALL, strict=True):
        np.testing.assert_allclose(numbers(one), numbers(other), atol=1e-9)
    rubbing = after(shown(friction=0.7)).values()
    assert [body.obstacle.friction for body in rubbing] == [0.7] * len(ALL)


class Row(Sphere):
    """What is drawn by two bodies."""

    @property
    def solids(self):
        return (*super().solids, ball(self.center + 1, self.radius))


def test_what_is_no_marker_is_refused_and_not_another_body():
    with pytest.raises(InvalidTask, match='Row.*one marker'):
        shown([Row((0, 0, 0), 0.5)])


def resource(name, scale=1.0, text=''):
    """Return the bodies of a marker with the name of a file."""
    marker = Marker(ns='a', type=Marker.MESH_RESOURCE, mesh_resource=name, text=text)
    marker.header.frame_id, marker.pose.orientation.w = 'world', 1.0
    marker.scale.x = marker.scale.y = marker.scale.z = scale
    return after(MarkerArray(markers=[marker]))


def test_a_mesh_from_a_file(tmp_path, monkeypatch):
    pytest.importorskip('trimesh').Trimesh(*SOLIDS['ring'], process=False).export(
        tmp_path / 'ring.stl')
    body, = resource(f'file://{tmp_path}/ring.stl', 1e-3, '{friction: 0.2}').values()
    assert body.friction == 0.2
    assert volume(*body.obstacle.surface) == pytest.approx(1e-9 * volume(*SOLIDS['ring']), rel=1e-5)
    (tmp_path / 'share/ament_index/resource_index/packages').mkdir(parents=True)
    (tmp_path / 'share/ament_index/resource_index/packages/parts').touch()
    (tmp_path / 'share/parts').mkdir()
    (tmp_path / 'ring.stl').rename(tmp_path / 'share/parts/ring.stl')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    hull, = resource('package://parts/ring.stl', 1e-3, '{hull: true}').values()
    assert isinstance(hull.obstacle, Hull)


@pytest.mark.parametrize(('name', 'said'), [
    ('http://host/a.stl', 'mesh_resource = .*: expected file:///absolute/path or package://'),
    ('file://a.stl', 'expected file:///absolute/path'), ('package://none', 'expected file:///'),
    ('package://none_such/a.stl', 'expected a package that is installed here'),
    ('file:///none/such.stl', 'expected a file, there is none'), ('', 'expected file:///')])
def test_odd_names_of_files_are_refused(name, said, monkeypatch, tmp_path):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    with pytest.raises(InvalidTask, match=said):
        resource(name)


def test_open_triangles_are_refused():
    message = shown([ALL[-2]])
    message.markers[0].points = message.markers[0].points[3:]
    with pytest.raises(InvalidTask, match='not watertight: 575 triangles have 3 open edges'):
        after(message)


def test_a_plain_cylinder_is_one_with_flat_ends():
    disc = Marker(ns='a', type=Marker.CYLINDER, action=Marker.ADD)
    disc.header.frame_id, disc.pose.orientation.w = 'world', 1.0
    disc.scale.x = disc.scale.y = 1.0
    disc.scale.z = 0.02
    body, = after(MarkerArray(markers=[disc])).values()
    assert body == Body(Cylinder((0, 0, -0.01), (0, 0, 0.01), 0.5))
    assert body.friction is None  # it says nothing of it


def test_what_is_for_the_gripper_alone_comes_last():
    message = shown(ALL[:2])
    message.markers[0].text = '{role: workspace only}'
    bodies = after(message)
    assert list(bodies) == [('obstacles', 1), ('obstacles', 0)]
    assert [body.role for body in bodies.values()] == ['all', 'workspace only']


def test_what_is_gone_is_taken_away():
    known = after(shown(ALL[:3]))
    assert len(after(obstacles_msg(ALL[:1], 'world'), known)) == 1
    one = Marker(ns='obstacles', id=1, action=Marker.DELETE)
    assert list(after(MarkerArray(markers=[one]), known)) == [('obstacles', 0), ('obstacles', 2)]
    for namespace, left in (('obstacles', 0), ('', 0), ('other', 3)):
        everything = Marker(ns=namespace, action=Marker.DELETEALL)
        assert len(after(MarkerArray(markers=[everything]), known)) == left


@pytest.mark.parametrize(('field', 'value', 'named'), [
    ('type', Marker.LINE_LIST, 'type = 5: expected CUBE, SPHERE, CYLINDER, ARROW .* TRIANGLE_LIST'),
    ('type', Marker.TRIANGLE_LIST, 'points has 0 entries: expected three for each triangle'),
    ('text', '{smooth: false}', 'text: smooth = False: expected of triangles alone'),
    ('action', 7, 'action = 7'), ('text', 'table', "text = 'table': expected none, or YAML"),
    ('text', '{fricton: 0.3}', 'some of friction, role, ends, cutouts'),
    ('text', '{friction: -1}', 'text: friction = -1'), ('text', '{friction: [', 'text, line 1'),
    ('text', '{role: none}', "text: role = 'none'"), ('text', 20_000 * 'x', '20000 characters'),
    ('text', '{ends: round}', 'of a cylinder alone'), ('text', '{cutouts: []}', 'cube alone')])
def test_what_is_no_obstacle_is_named(field, value, named):
    message = shown()
    setattr(message.markers[1], field, value)
    with pytest.raises(InvalidTask, match=rf'markers\[1\].*{named}'):
        after(message)


@pytest.mark.parametrize(('number', 'text', 'named'), [
    (0, '{cutouts: [{x: 0}]}', r'cutouts\[0\] = .*expected y, z and radius'),
    (0, '{cutouts: [{y: 0, z: 0}]}', 'radius or width'), (0, '{cutouts: 3}', 'text: cutouts = 3'),
    (0, '{cutouts: [{y: 1, radius: 0.01}]}', 'within the sheet'),
    (2, '{ends: sharp}', "text: ends = 'sharp'")])
def test_what_a_text_says_wrong_is_named(number, text, named):
    message = shown()
    message.markers[number].text = text
    with pytest.raises(InvalidTask, match=rf'markers\[{number}\].*{named}'):
        after(message)


@pytest.mark.parametrize(('number', 'axis', 'value', 'named'), [
    (0, 'x', 0.0, 'above 0'), (0, 'y', float('nan'), 'above 0'), (2, 'x', 1.0, 'round cylinder')])
def test_absurd_sizes_are_named(number, axis, value, named):
    message = shown()
    setattr(message.markers[number].scale, axis, value)
    with pytest.raises(InvalidTask, match=rf'markers\[{number}\].*{named}'):
        after(message)


def test_another_frame_is_named():
    message = shown()
    message.markers[2].header.frame_id = 'map'
    with pytest.raises(InvalidTask, match=r"markers\[2\].header.frame_id = 'map'"):
        after(message)
