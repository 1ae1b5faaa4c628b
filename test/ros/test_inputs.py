# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What comes: in other frames, by a stand-in for tf2, and what is too large to be looked at."""

import sys
from types import ModuleType

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Goals
from rclpy.duration import Duration
from rclpy.time import Time as RosTime
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import InvalidTask, Pose
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.model.checks import shown
from dlo_planner.ros.estimate import points_in
from dlo_planner.ros.inputs import Frames, bodies_in, brief_text, goals_in, pose_in
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.clouds import cloud_msg
from msg_helpers.poses import pose_from_msg, pose_from_stamped, pose_msg, pose_stamped_msg

VALUES = {name: entry.default for name, entry in PARAMETERS.items()}
SCENE = Scene.of(VALUES)
CAMERA = Pose((1.0, 2.0, 3.0), Rotation.from_euler('xyz', (0.3, -0.4, 1.2)).as_quat())
SEEN = Pose((0.1, 0.2, 0.3), Rotation.from_euler('xyz', (1.0, 0.5, 0.2)).as_quat())


class TransformException(Exception):  # noqa: N818, as in tf2_ros
    """Base of all that a lookup raises."""


class Buffer:
    """Static transforms from frames to `world`, by tf2_ros' calls."""

    def __init__(self, cache_time=None, node=None):
        self.known, self.asked = {}, []

    def set_transform_static(self, transform, authority):
        self.known[transform.header.frame_id, transform.child_frame_id] = transform

    def lookup_transform(self, target_frame, source_frame, time, timeout=None):
        assert isinstance(time, RosTime) and isinstance(timeout, Duration)
        self.asked.append((target_frame, source_frame, time.nanoseconds))
        try:
            return self.known[target_frame, source_frame]
        except KeyError:
            raise TransformException(f'"{source_frame}" passed to lookupTransform argument '
                                     'source_frame does not exist.') from None


class TransformListener:
    """Hears nothing."""

    def __init__(self, buffer, node, *, spin_thread=False):
        self.buffer, self.on = buffer, True

    def unregister(self):
        self.on = False


@pytest.fixture
def tf2(monkeypatch):
    module = ModuleType('tf2_ros')
    for kind in (Buffer, TransformListener, TransformException):
        setattr(module, kind.__name__, kind)
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    return module


@pytest.fixture
def frames(tf2):
    """Return Frames that know where the camera is."""
    frames = Frames(object())
    transform = TransformStamped(header=Header(frame_id='world'), child_frame_id='camera')
    place = pose_msg(CAMERA)
    transform.transform.translation.x = place.position.x
    transform.transform.translation.y = place.position.y
    transform.transform.translation.z = place.position.z
    transform.transform.rotation = place.orientation
    frames._buffer.set_transform_static(transform, 'test')
    return frames


def expected():
    """Return SEEN in the world, by matrices."""
    return CAMERA.matrix @ SEEN.matrix


def test_a_pose_is_transformed(frames):
    stamp = Time(sec=12, nanosec=34)
    pose = pose_in(SCENE, pose_stamped_msg(SEEN, 'camera', stamp), 'task_goal', frames)
    np.testing.assert_allclose(pose.matrix, expected(), atol=1e-12)
    assert frames._buffer.asked == [('world', 'camera', 12 * 10**9 + 34)]


def test_the_own_frame_asks_nobody(frames):
    pose = pose_in(SCENE, pose_stamped_msg(SEEN, 'world'), 'task_goal', frames)
    np.testing.assert_array_equal(pose.matrix, SEEN.matrix)
    assert frames._buffer.asked == []


@pytest.mark.parametrize('outer', ['camera', 'world'])
def test_goals_count_by_their_own_header_or_that_of_the_message(frames, outer):
    msg = Goals(header=Header(frame_id=outer), goals=[
        PoseStamped(pose=pose_msg(SEEN)), pose_stamped_msg(SEEN, 'camera')])
    first, second = goals_in(SCENE, msg, 'task_goals', frames)
    np.testing.assert_allclose(second.matrix, expected(), atol=1e-12)
    np.testing.assert_allclose(first.matrix, expected() if outer == 'camera' else SEEN.matrix,
                               atol=1e-12)


def test_obstacles_are_transformed(frames):
    marker = Marker(header=Header(frame_id='camera'), ns='cell', id=3, type=Marker.CUBE,
                    pose=pose_msg(SEEN))
    marker.scale.x, marker.scale.y, marker.scale.z = 0.1, 0.2, 0.3
    gone = Marker(header=Header(frame_id='nowhere'), action=Marker.DELETEALL)
    box, = bodies_in(SCENE, MarkerArray(markers=[gone, marker]), 'obstacles', frames).values()
    np.testing.assert_allclose(box.obstacle.pose.matrix, expected(), atol=1e-12)
    assert marker.header.frame_id == 'camera'  # what came is not changed
    np.testing.assert_allclose(pose_from_msg(marker.pose).matrix, SEEN.matrix)


def test_points_are_transformed_and_left_out_where_they_are_out_of_reach(frames):
    points = np.array([[0.1, 0.2, 0.3], [-0.4, 0.1, 0.9], [0.0, 0.0, 2 * SCENE.reach]])
    for frame, there in (('world', points), (
            'camera', (CAMERA.matrix @ np.column_stack([points, np.ones(3)]).T).T[:, :3])):
        seen = points_in(SCENE, cloud_msg(points, frame), 'observed_points', frames)
        np.testing.assert_allclose(seen, there[:2], atol=1e-6)


@pytest.mark.parametrize(('pose', 'cause', 'named'), [
    (Pose((1000.5, 0, 0), (0, 0, 0, 1)), Cause.OUT_OF_REACH, 'workspace.reach = 1000 m'),
    (None, Cause.INVALID_POSE, 'of length 1')])
def test_poses_and_obstacles_beyond_any_cell_are_refused(pose, cause, named):
    msg = pose_stamped_msg(pose or SEEN, 'world')
    msg.pose.orientation.w *= 1.0 if pose else 1.2
    marker = Marker(header=msg.header, type=Marker.SPHERE, pose=msg.pose)
    marker.scale.x = marker.scale.y = marker.scale.z = 0.1
    with pytest.raises(Refused, match=named) as refused:
        pose_in(SCENE, msg, 'task_goal')
    assert refused.value.cause == cause
    with pytest.raises(Refused, match=named) as refused:
        bodies_in(SCENE, MarkerArray(markers=[marker]), 'obstacles')
    assert refused.value.cause == Cause.INVALID_OBSTACLES


def test_an_obstacle_that_is_larger_than_any_cell_is_refused():
    marker = Marker(header=Header(frame_id='world'), type=Marker.CUBE, pose=pose_msg(SEEN))
    marker.scale.x, marker.scale.y, marker.scale.z = 0.1, 2001.0, 0.1
    with pytest.raises(Refused, match='scale = .*twice workspace.reach = 1000 m'):
        bodies_in(SCENE, MarkerArray(markers=[marker]), 'obstacles')


def test_a_frame_that_tf_does_not_know_is_refused_with_its_words(frames):
    with pytest.raises(Refused, match=r"task_goal\.header\.frame_id = 'tool0': expected 'world', "
                                      r"or a frame that tf .*does not exist") as refused:
        pose_in(SCENE, pose_stamped_msg(SEEN, 'tool0'), 'task_goal', frames)
    assert refused.value.cause == Cause.INVALID_FRAME
    marker = Marker(header=Header(frame_id='tool0'))
    with pytest.raises(Refused, match=r"obstacles\.markers\[0\]\.header\.frame_id = 'tool0'"):
        bodies_in(SCENE, MarkerArray(markers=[marker]), 'obstacles', frames)


@pytest.mark.parametrize('known', [True, False])
def test_no_frame_is_refused(frames, known):
    with pytest.raises(Refused, match="header.frame_id = '': expected 'world'"):
        pose_in(SCENE, pose_stamped_msg(SEEN, ''), 'goal', frames if known else Frames())


def test_odd_poses_are_named_in_any_frame(frames):
    msg = pose_stamped_msg(SEEN, 'camera')
    msg.pose.position.x = float('nan')
    with pytest.raises(Refused, match='task_goal') as refused:
        pose_in(SCENE, msg, 'task_goal', frames)
    assert refused.value.cause == Cause.INVALID_POSE


def test_reach_counts_in_the_frame_of_the_scene(frames):
    far = pose_stamped_msg(Pose((999.5, 0, 0), (0, 0, 0, 1)), 'camera')
    reached = np.linalg.norm((CAMERA.matrix @ [999.5, 0, 0, 1])[:3])
    assert reached > SCENE.reach
    with pytest.raises(Refused, match='task_goal in world: pose.position') as refused:
        pose_in(SCENE, far, 'task_goal', frames)
    assert refused.value.cause == Cause.OUT_OF_REACH


def test_without_tf2_other_frames_are_refused_by_name(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)  # an import fails
    frames = Frames(object())
    with pytest.raises(Refused, match="frame_id = 'camera': expected 'world'.*not installed"):
        pose_in(SCENE, pose_stamped_msg(SEEN, 'camera'), 'task_goal', frames)
    frames.close()


def test_it_stops_listening(frames):
    frames.close()
    assert not frames._listener.on


LONG = 'x' * 10_000_000


def told(kind, call, *arguments):
    """Return what a call refuses with."""
    with pytest.raises(kind) as refused:
        call(*arguments)
    assert len(str(refused.value)) < 400
    return refused.value


def test_a_long_frame_is_neither_looked_up_nor_said():
    msg = PoseStamped(header=Header(frame_id=LONG))
    error = told(Refused, pose_in, SCENE, msg, 'gripper_pose')
    assert error.cause == Cause.INVALID_FRAME
    assert str(error) == ('gripper_pose.header.frame_id has 10000000 characters: expected 256 at '
                          'most')
    told(InvalidTask, pose_from_stamped, msg, 'world', 'pose')
    assert 'expected \'world\'' in str(told(Refused, Frames().origin, Header(
        frame_id='x' * 256), 'world', 'pose'))


def test_long_names_and_many_markers_are_refused():
    error = told(Refused, bodies_in, SCENE, MarkerArray(markers=[
        Marker(), Marker(ns=LONG, action=Marker.DELETE)]), 'obstacles')
    assert error.cause == Cause.INVALID_OBSTACLES
    assert 'obstacles.markers[1].ns has 10000000 characters' in str(error)
    delete = Marker(action=Marker.DELETE)
    assert bodies_in(SCENE, MarkerArray(markers=[delete] * 10_000), 'obstacles') == {}
    error = told(Refused, bodies_in, SCENE, MarkerArray(markers=[delete] * 10_001), 'obstacles')
    assert 'obstacles.markers has 10001 entries: expected 10000 at most' in str(error)


@pytest.mark.parametrize(('name', 'value'), [
    ('rod.name', LONG), ('markers.color', LONG), ('gravity', [0.0] * 100_000)])
def test_long_parameters_are_refused_by_name(name, value):
    error = told(InvalidTask, Scene.of, {**VALUES, name: value})
    assert f'parameter {name} has {len(value)}' in str(error)


def test_what_goes_out_is_short():
    assert brief_text('short') == 'short'
    assert len(brief_text(LONG)) < 2100 and '(10000000 characters)' in brief_text(LONG)
    assert len(shown(LONG)) <= 120 and len(shown(LONG.encode())) <= 120
    assert shown('short') == "'short'" and shown('y' * 119).endswith(' ...')
