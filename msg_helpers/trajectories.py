# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes, plans, motions and joints <-> nav_msgs/Path, trajectory_msgs, JointState."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from types import MappingProxyType

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3
from nav_msgs.msg import Path
from numpy.typing import ArrayLike
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory as JointTrajectoryMsg
from trajectory_msgs.msg import (
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from dlo_planner.arm.joint_stream import JointPoints
from dlo_planner.arm.joint_trajectory import JointTrajectory
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, integer, items, number, row
from dlo_planner.model.pose import Pose, quaternions_of
from dlo_planner.plan.stage import GRIPPER
from dlo_planner.trajectory.timed_path import TimedPath
from dlo_planner.trajectory.trajectory import Trajectory
from msg_helpers.poses import (
    duration_msg,
    header,
    pose_from_msg,
    pose_stamped_msg,
    seconds_of,
    time_msg,
)

_MOST = 100_000  # points
_NONE: Mapping[str, Sequence[Pose]] = MappingProxyType({})


def shape_path(shape: Shape, frame_id: str, stamp: Time) -> Path:
    """Return the DLO node by node as a Path; x axis of each pose = tangent, s as in `Shape.s`."""
    path: Path = deserialize_message(shape_bytes(shape, frame_id, stamp), Path)
    return path


def shape_bytes(shape: Shape, frame_id: str, stamp: Time) -> bytes:
    """Return the message of `shape_path`, serialized (CDR): forty times as quick as its fields."""
    instance('shape', shape, Shape)
    name: bytes = header(frame_id, instance('stamp', stamp, Time)).frame_id.encode() + b'\0'
    top = struct.pack('<iII', stamp.sec, stamp.nanosec, len(name)) + name
    begin = top + bytes(-len(top) % 4) + struct.pack('<I', shape.s.size)
    begin += top + bytes(-(len(begin) + len(top)) % 8)  # a double begins at a multiple of 8
    top += bytes(-len(top) % 8)
    poses = np.empty((shape.s.size, 7))
    poses[:, :3], poses[:, 3:] = shape.positions, quaternions_of(shape.frames)
    nodes = np.empty((shape.s.size, 56 + len(top)), np.uint8)
    nodes[:, :56], nodes[:, 56:] = poses.view(np.uint8), np.frombuffer(top, np.uint8)
    return bytes((0, 1, 0, 0)) + begin + nodes.tobytes()[:-len(top)]  # the last has no next


def plan_path(grippers: Iterable[Pose], times: ArrayLike, frame_id: str, stamp: Time) -> Path:
    """Return gripper poses as a Path, each stamped with `stamp` plus its time."""
    grippers = items('grippers', grippers, Pose)
    times = row('times', times, least=0)
    if len(times) != len(grippers):
        raise InvalidTask(f'times has {len(times)} entries: expected one per gripper pose, '
                          f'{len(grippers)}')
    poses = [pose_stamped_msg(pose, frame_id, time_msg(time, stamp))
             for pose, time in zip(grippers, times, strict=True)]
    return Path(header=header(frame_id, stamp), poses=poses)


def poses_from_path(path: Path) -> list[Pose]:
    """Return the list of Pose in a nav_msgs/Path."""
    instance('path', path, Path)
    return [pose_from_msg(stamped.pose) for stamped in path.poses]


def times_from_path(path: Path) -> Floats:
    """Return (n,) s: the poses' stamps, counted from the first one's."""
    instance('path', path, Path)
    stamps = [one.header.stamp for one in path.poses]
    return np.array([one.sec - stamps[0].sec + 1e-9 * (one.nanosec - stamps[0].nanosec)
                     for one in stamps])


def timed_trajectory(trajectory: Trajectory, number: int, tool: Pose, frame_id: str,
                     stamp: Time) -> MultiDOFJointTrajectory:
    """Return `number` poses, velocities and accelerations of the tool frame at even times.

    All by world axes. `trajectory` is of the gripper frame, whose Pose in the tool frame is `tool`.
    The other arms of the trajectory have a joint each, under their names: of the DLO's frame where
    they hold it.
    """
    instance('trajectory', trajectory, Trajectory)
    number = integer('number', number, minimum=2, maximum=_MOST)
    instance('tool', tool, Pose)
    top = header(frame_id, instance('stamp', stamp, Time))
    times = np.linspace(0, trajectory.duration, number)
    motions = [_moved(trajectory, times, tool.inverse()), *(
        _moved(trajectory.arm(name), times, Pose.identity()) for name in trajectory.path.arms)]
    points = [MultiDOFJointTrajectoryPoint(
        transforms=[transform for transform, _, _ in joints],
        velocities=[velocity for _, velocity, _ in joints],
        accelerations=[acceleration for _, _, acceleration in joints],
        time_from_start=duration_msg(time))
        for time, joints in zip(times, zip(*motions, strict=True), strict=True)]
    return MultiDOFJointTrajectory(header=top, joint_names=['gripper', *trajectory.path.arms],
                                   points=points)


def _moved(motion: TimedPath, times: Floats, tool: Pose) -> list[tuple[Transform, Twist, Twist]]:
    """Return where a frame, `tool` in that of a motion, is at n times, how quick, and its rates."""
    grippers, speeds, changes = motion.at(times)
    poses = [gripper.compose(tool) for gripper in grippers]
    arms = np.array([pose.position - gripper.position
                     for pose, gripper in zip(poses, grippers, strict=True)])
    spins, turns = speeds[:, 3:], changes[:, 3:]
    # the tool's origin turns about the gripper's
    swing = np.cross(spins, arms)
    velocities = speeds[:, :3] + swing
    accelerations = changes[:, :3] + np.cross(turns, arms) + np.cross(spins, swing)
    quaternions = quaternions_of(np.array([pose.rotation for pose in poses]))
    return [(Transform(translation=_vector(pose.position), rotation=_quaternion(quaternion)),
             Twist(linear=_vector(velocity), angular=_vector(spin)),
             Twist(linear=_vector(acceleration), angular=_vector(turn)))
            for pose, quaternion, velocity, spin, acceleration, turn in zip(
                poses, quaternions, velocities, spins, accelerations, turns, strict=True)]


def poses_ahead(times: ArrayLike, poses: Sequence[Pose], frame_id: str, stamp: float,
                others: Mapping[str, Sequence[Pose]] = _NONE) -> MultiDOFJointTrajectory:
    """Return poses at times (n,) s, ascending, after a stamp in s on the clock of ROS.

    `others`: n poses of each other arm, which has a joint of its name.
    """
    times = row('times', times, minimum=0)
    ways = {'poses': items('poses', poses, Pose)}
    ways |= {name: items(f'others[{name!r}]', way, Pose)
             for name, way in instance('others', others, Mapping).items()}
    for name, way in ways.items():
        if len(times) != len(way):
            raise InvalidTask(f'{name} has {len(way)} entries: expected {len(times)}, as times')
    top = header(frame_id, time_msg(number('stamp', stamp, minimum=0)))
    return MultiDOFJointTrajectory(
        header=top, joint_names=[GRIPPER, *others],
        points=[MultiDOFJointTrajectoryPoint(
            transforms=[Transform(translation=_vector(pose.position),
                                  rotation=_quaternion(pose.quaternion)) for pose in at_once],
            time_from_start=duration_msg(time))
            for time, *at_once in zip(times, *ways.values(), strict=True)])


def stamped_poses(msg: MultiDOFJointTrajectory,
                  name: str = GRIPPER) -> tuple[Floats, list[Pose]]:
    """Return the times (n,) in s on the clock of ROS and the n Poses of an arm of `poses_ahead`."""
    names = instance('msg', msg, MultiDOFJointTrajectory).joint_names
    k = names.index(choice('name', name, names)) if len(names) > 1 else 0
    if not all(len(point.transforms) > k for point in msg.points):
        raise InvalidTask('msg.points: expected a transform in each for each joint')
    begin = seconds_of(msg.header.stamp)
    times = [begin + seconds_of(point.time_from_start) for point in msg.points]
    ways = [point.transforms[k] for point in msg.points]
    return np.array(times), [Pose(
        [getattr(way.translation, axis) for axis in 'xyz'],
        [getattr(way.rotation, axis) for axis in 'xyzw']) for way in ways]


def _vector(values: Iterable[float]) -> Vector3:
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)


def _quaternion(values: Iterable[float]) -> Quaternion:
    x, y, z, w = map(float, values)
    return Quaternion(x=x, y=y, z=z, w=w)


def joint_trajectory_msg(joint_trajectory: JointTrajectory) -> JointTrajectoryMsg:
    """Return the message of a JointTrajectory as joint_trajectory_controller takes it.

    Its stamp is zero, which means: it starts when the controller receives it.
    """
    instance('joint_trajectory', joint_trajectory, JointTrajectory)
    points = [JointTrajectoryPoint(positions=positions, velocities=velocities,
                                   accelerations=accelerations, time_from_start=duration_msg(time))
              for time, positions, velocities, accelerations in zip(
                  joint_trajectory.times, joint_trajectory.positions.tolist(),
                  joint_trajectory.velocities.tolist(), joint_trajectory.accelerations.tolist(),
                  strict=True)]
    return JointTrajectoryMsg(joint_names=list(joint_trajectory.joint_names), points=points)


def joint_points_msg(names: Sequence[str], told: JointPoints) -> JointTrajectoryMsg:
    """Return the message of JointPoints, with the stamp from which its times count."""
    instance('told', told, JointPoints)
    names = items('names', names, str)
    if told.positions.shape[1] != len(names):
        raise InvalidTask(f'names has {len(names)} entries: expected {told.positions.shape[1]}, as '
                          'many as joints are told')
    points = [JointTrajectoryPoint(positions=positions, velocities=velocities,
                                   accelerations=accelerations, time_from_start=duration_msg(time))
              for time, positions, velocities, accelerations in zip(
                  told.times, told.positions.tolist(), told.velocities.tolist(),
                  told.accelerations.tolist(), strict=True)]
    top = header('', time_msg(number('stamp', told.stamp, minimum=0)))
    return JointTrajectoryMsg(header=top, joint_names=list(names), points=points)


def positions_from_joint_state(joint_state: JointState) -> dict[str, float]:
    """Return joint positions by name, rad or m, of a sensor_msgs/JointState."""
    instance('joint_state', joint_state, JointState)
    names, positions = joint_state.name, joint_state.position
    if len(positions) == 0:
        return {}  # allowed by the message: velocities or efforts only
    if len(names) != len(positions):
        raise InvalidTask(f'joint_state has {len(names)} names and {len(positions)} positions: '
                          'expected as many')
    for name, position in zip(names, positions, strict=True):
        if not isfinite(position):
            raise InvalidTask(f'joint_state: {name} = {position}: expected a finite number')
    return dict(zip(names, map(float, positions), strict=True))
