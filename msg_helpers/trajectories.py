# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories and stamped poses <-> trajectory_msgs/MultiDOFJointTrajectory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.trajectory.trajectory import Trajectory
from msg_helpers.poses import header

_NANOSECONDS = 10**9
_MOST = 100_000  # points
_LATEST = 2**31 - 1  # s that a stamp holds


def timed_trajectory(trajectory: Trajectory, number: int, tool: Pose, frame_id: str,
                     stamp: Time) -> MultiDOFJointTrajectory:
    """Return poses, velocities and accelerations of the tool frame at even times, world axes.

    Parameters
    ----------
    trajectory : Trajectory
        Trajectory of the gripper frame.
    number : int
        Number of points, from start to end.
    tool : Pose
        Pose of the gripper frame in the tool frame (constant).
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time of the start.
    """
    instance('trajectory', trajectory, Trajectory)
    number = integer('number', number, minimum=2, maximum=_MOST)
    instance('tool', tool, Pose)
    top = header(frame_id, instance('stamp', stamp, Time))
    times = np.linspace(0, trajectory.duration, number)
    grippers, speeds, changes = trajectory.at(times)
    poses = [gripper.compose(tool.inverse()) for gripper in grippers]
    arms = np.array([pose.position - gripper.position
                     for pose, gripper in zip(poses, grippers, strict=True)])
    spins, turns = speeds[:, 3:], changes[:, 3:]
    # the tool's origin turns about the gripper's
    swing = np.cross(spins, arms)
    velocities = speeds[:, :3] + swing
    accelerations = changes[:, :3] + np.cross(turns, arms) + np.cross(spins, swing)
    quaternions = Rotation.from_matrix([pose.rotation for pose in poses]).as_quat()
    points = [MultiDOFJointTrajectoryPoint(
        transforms=[Transform(translation=_vector(pose.position),
                              rotation=_quaternion(quaternion))],
        velocities=[Twist(linear=_vector(velocity), angular=_vector(spin))],
        accelerations=[Twist(linear=_vector(acceleration), angular=_vector(turn))],
        time_from_start=_duration(time))
        for time, pose, quaternion, velocity, spin, acceleration, turn in zip(
            times, poses, quaternions, velocities, spins, accelerations, turns, strict=True)]
    return MultiDOFJointTrajectory(header=top, joint_names=['gripper'],
                                   points=points)


def poses_ahead(times: ArrayLike, poses: Sequence[Pose], frame_id: str,
                stamp: float) -> MultiDOFJointTrajectory:
    """Return poses at times after a stamp, each by itself.

    Parameters
    ----------
    times : array_like, shape (n,)
        Seconds after the stamp, ascending.
    poses : sequence of Pose
        The n poses.
    frame_id : str
        Frame id of the poses.
    stamp : float
        Seconds on the clock of ROS.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    times = row('times', times, minimum=0)
    poses = items('poses', poses, Pose)
    if len(times) != len(poses):
        raise InvalidTask(f'poses has {len(poses)} entries: expected {len(times)}, as times')
    nanoseconds = round(number('stamp', stamp, minimum=0, maximum=_LATEST) * _NANOSECONDS)
    top = header(frame_id, Time(sec=nanoseconds // _NANOSECONDS,
                                nanosec=nanoseconds % _NANOSECONDS))
    return MultiDOFJointTrajectory(
        header=top, joint_names=['gripper'],
        points=[MultiDOFJointTrajectoryPoint(
            transforms=[Transform(translation=_vector(pose.position),
                                  rotation=_quaternion(pose.quaternion))],
            time_from_start=_duration(time))
            for time, pose in zip(times, poses, strict=True)])


def stamped_poses(msg: MultiDOFJointTrajectory) -> tuple[Floats, list[Pose]]:
    """Return the times (n,) in s on the clock of ROS and the n Poses of `poses_ahead`.

    Raises
    ------
    InvalidTask
        A point has no pose, or one that is none.
    """
    instance('msg', msg, MultiDOFJointTrajectory)
    if not all(point.transforms for point in msg.points):
        raise InvalidTask('msg.points: expected a transform in each')
    begin = msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec
    times = [begin + point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
             for point in msg.points]
    ways = [point.transforms[0] for point in msg.points]
    return np.array(times), [Pose(
        [getattr(way.translation, axis) for axis in 'xyz'],
        [getattr(way.rotation, axis) for axis in 'xyzw']) for way in ways]


def _vector(values: Iterable[float]) -> Vector3:
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)


def _quaternion(values: Iterable[float]) -> Quaternion:
    x, y, z, w = map(float, values)
    return Quaternion(x=x, y=y, z=z, w=w)


def _duration(seconds: float) -> Duration:
    total = round(float(seconds) * _NANOSECONDS)
    return Duration(sec=total // _NANOSECONDS, nanosec=total % _NANOSECONDS)
