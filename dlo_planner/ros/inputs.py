# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages that come, in the frame of the scene and within its bounds, or refused by name."""

import re
from collections.abc import Sequence
from contextlib import suppress
from math import hypot
from typing import Any

from builtin_interfaces.msg import Time as Stamp
from geometry_msgs.msg import PoseStamped, Quaternion
from nav_msgs.msg import Goals
from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.errors import InvalidTask
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.guards import Feedback
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.pose import Pose
from dlo_planner.ros.scene import Scene
from msg_helpers.obstacles import obstacles_after
from msg_helpers.poses import header, pose_from_msg, pose_from_stamped, pose_msg, seconds_of

_PATIENCE = 0.1  # s that a transform may come later than a pose
_LONGEST = 256   # characters of a name: what is longer is neither looked up nor said


class Frames:
    """Knows what tf knows, of a node; one frame alone where there is no node, or no tf2_ros."""

    def __init__(self, node: Any = None) -> None:
        self._buffer: Any = None
        if node is not None:
            with suppress(ImportError):
                import tf2_ros  # noqa: PLC0415
                self._unknown, self._buffer = tf2_ros.TransformException, tf2_ros.Buffer()
                self._listener = tf2_ros.TransformListener(self._buffer, node)

    def origin(self, header: Header, frame_id: str, name: str) -> Pose | None:
        """Return the Pose of a message's frame in another one; None if it is the same frame."""
        given = header.frame_id
        if given == frame_id:
            return None
        judge_length(given, f'{name}.header.frame_id', Cause.INVALID_FRAME)
        why = 'tf2_ros is not installed' if self._buffer is None else 'it is empty'
        if given and self._buffer is not None:
            try:
                found = self._buffer.lookup_transform(
                    frame_id, given, Time.from_msg(header.stamp), Duration(seconds=_PATIENCE))
            except self._unknown as error:
                why = f'tf says: {error}'
            else:
                at, turn = found.transform.translation, found.transform.rotation
                return Pose((at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w))
        raise Refused(Cause.INVALID_FRAME, f'{name}.header.frame_id = {shown(given)}: expected '
                      f'{frame_id!r}, or a frame that tf can transform to it ({why})')

    def close(self) -> None:
        """Listen no more."""
        if self._buffer is not None:
            self._listener.unregister()


def judge_length(text: str, name: str, cause: Cause) -> None:
    """Refuse a name that is too long to be looked up, or said in the log."""
    if len(text) > _LONGEST:
        raise Refused(cause, f'{name} has {len(text)} characters: expected {_LONGEST} at most')


_ONE = Frames()
_UNIT = 1e-2  # by which the length of a quaternion may be off 1, as for tf2
_MOST_GOALS = 100
_MOST_BODIES = 1000
_MOST_MARKERS = 10_000  # of a message, most of which delete
_MOST_SAID = 2000  # characters of a text that goes out
_KEEP_OUT = re.compile(r'workspace\.keep_out\[(.*?)\]')


def pose_in(scene: Scene, msg: PoseStamped, name: str, frames: Frames = _ONE) -> Pose:
    """Return the Pose of a geometry_msgs/PoseStamped in the scene's frame."""
    origin = frames.origin(msg.header, scene.frame_id, name)
    try:
        pose = pose_from_stamped(msg, msg.header.frame_id, name)
    except InvalidTask as error:
        raise Refused(Cause.INVALID_POSE, str(error)) from None
    _judge_orientation(msg.pose.orientation, f'{name}.pose')
    if origin is None:
        judge_distance(pose.position, scene, f'{name}.pose')
        return pose
    there = origin.compose(pose)
    judge_distance(there.position, scene, f'{name} in {scene.frame_id}: pose')
    return there


def feedback_of(node: Any, pose: Pose, stamp: Stamp, arrived: float,
                deviation: float | None = None) -> Feedback:
    """Return what a pose with a stamp says of the gripper, or of another arm.

    `arrived`: s, on a steady clock; `deviation`: of the DLO from its plan, m; None: it is another
    arm's, which without a stamp is of now.
    """
    age = 1e-9 * (node.get_clock().now().nanoseconds - stamp.nanosec) - stamp.sec
    if deviation is not None:
        return Feedback(pose, arrived, age, deviation, seconds_of(stamp))
    if stamp.sec or stamp.nanosec:
        return Feedback(pose, arrived, age, stamp=seconds_of(stamp))
    return Feedback(pose, arrived)


def bodies_in(scene: Scene, msg: MarkerArray, name: str,
              frames: Frames = _ONE) -> dict[tuple[str, int], Any]:
    """Return the obstacles, by (namespace, id), after a visualization_msgs/MarkerArray."""
    if len(msg.markers) > _MOST_MARKERS:
        raise Refused(Cause.INVALID_OBSTACLES, f'{name}.markers has {len(msg.markers)} entries: '
                      f'expected {_MOST_MARKERS} at most')
    for index, marker in enumerate(msg.markers):
        judge_length(marker.ns, f'{name}.markers[{index}].ns', Cause.INVALID_OBSTACLES)
    markers = [_marker_in(scene, marker, f'{name}.markers[{index}]', frames)
               for index, marker in enumerate(msg.markers)]
    try:
        bodies = obstacles_after(dict(scene.bodies), MarkerArray(markers=markers), scene.frame_id,
                                 name)
    except InvalidTask as error:
        raise Refused(Cause.INVALID_OBSTACLES, str(error)) from None
    if len(bodies) > _MOST_BODIES:
        raise Refused(Cause.INVALID_OBSTACLES, f'{name}.markers: {len(bodies)} obstacles with '
                      f'those that are there: expected {_MOST_BODIES} at most')
    return bodies


def _judge_orientation(q: Quaternion, name: str, cause: Cause = Cause.INVALID_POSE) -> None:
    quaternion = [q.x, q.y, q.z, q.w]
    if abs(hypot(*quaternion) - 1) > _UNIT:
        raise Refused(cause, f'{name}.orientation = {quaternion}: expected a quaternion x, y, z, w '
                      f'of length 1, within {_UNIT:g}')


def judge_distance(position: Sequence[float] | Floats, scene: Scene, name: str,
                   cause: Cause = Cause.OUT_OF_REACH) -> None:
    """Refuse a position that is farther from the origin than workspace.reach."""
    if hypot(*position) > scene.reach:
        raise Refused(cause, f'{name}.position = {[float(x) for x in position]}: expected at most '
                      f'workspace.reach = {scene.reach:g} m from the origin of {scene.frame_id}')


def goals_in(scene: Scene, msg: Goals, name: str, frames: Frames = _ONE) -> tuple[Pose, ...]:
    """Return the Poses of a nav_msgs/Goals; an empty header is that of the message."""
    if not 1 <= len(msg.goals) <= _MOST_GOALS:
        raise Refused(Cause.INVALID_GOALS, f'{name}.goals has {len(msg.goals)} poses: expected 1 '
                      f'to {_MOST_GOALS}')
    return tuple(pose_in(scene, PoseStamped(
        header=goal.header if goal.header.frame_id else msg.header, pose=goal.pose),
        f'{name}.goals[{index}]', frames) for index, goal in enumerate(msg.goals))


def _marker_in(scene: Scene, marker: Marker, name: str, frames: Frames) -> Marker:
    """Return a visualization_msgs/Marker in the scene's frame; refuse one beyond its bounds."""
    if marker.action != Marker.ADD:
        return marker
    origin, size = frames.origin(marker.header, scene.frame_id, name), marker.scale
    _judge_orientation(marker.pose.orientation, f'{name}.pose', Cause.INVALID_OBSTACLES)
    if origin is not None:
        pose = marker.pose
        with suppress(InvalidTask):  # what is wrong with it is said when it is read
            pose = pose_msg(origin.compose(pose_from_msg(pose)))
        marker = Marker(header=header(scene.frame_id, marker.header.stamp), ns=marker.ns,
                        id=marker.id, type=marker.type, action=marker.action, pose=pose,
                        scale=size, points=marker.points, text=marker.text,
                        mesh_resource=marker.mesh_resource)
    at = marker.pose.position
    judge_distance([at.x, at.y, at.z], scene, f'{name}.pose', Cause.INVALID_OBSTACLES)
    if max(size.x, size.y, size.z) > 2 * scene.reach:
        raise Refused(Cause.INVALID_OBSTACLES, f'{name}.scale = {[size.x, size.y, size.z]}: '
                      f'expected at most twice workspace.reach = {scene.reach:g} m')
    return marker


def brief_text(text: str, most: int = _MOST_SAID) -> str:
    """Return a text, shortened if it is long: it goes to logs and to everybody who listens."""
    return text if len(text) <= most else f'{text[:most]} ... ({len(text)} characters)'


def named(text: str) -> str:
    """Return a text that says which obstacle the gripper keeps out of, not which limit that is."""
    return _KEEP_OUT.sub(r'obstacle \1', text)


def inside_of(scene: Scene, gripper: Pose, name: str) -> str:
    """Return in words in which obstacle a gripper is, '' if in none."""
    if not scene.direct.obstacles:
        return ''
    found, room = scene.solid.min_margin(gripper)
    return '' if room >= 0 else named(f'{name}: the gripper is {-room:.3g} m inside {found}: '
                                      'expected a pose outside of all obstacles')
