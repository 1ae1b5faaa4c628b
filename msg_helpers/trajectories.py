# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectory -> trajectory_msgs/MultiDOFJointTrajectory."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from dlo_planner.model.checks import instance, integer
from dlo_planner.model.pose import Pose
from dlo_planner.plan.motion.trajectory import Trajectory
from msg_helpers.poses import header

_NANOSECONDS = 10**9
_MOST = 100_000  # points


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


def _vector(values: Iterable[float]) -> Vector3:
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)


def _quaternion(values: Iterable[float]) -> Quaternion:
    x, y, z, w = map(float, values)
    return Quaternion(x=x, y=y, z=z, w=w)


def _duration(seconds: float) -> Duration:
    total = round(float(seconds) * _NANOSECONDS)
    return Duration(sec=total // _NANOSECONDS, nanosec=total % _NANOSECONDS)
