"""Trajectory -> trajectory_msgs/MultiDOFJointTrajectory."""

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from msg_helpers.poses import header

_NANOSECONDS = 10**9


def timed_trajectory(trajectory, number, tool, frame_id, stamp):
    """Return poses, velocities and accelerations of the tool frame at even times.

    Args:
        trajectory: Trajectory of the gripper frame
        number: of points, from start to end
        tool: Pose of the gripper frame in the tool frame (constant)
        frame_id: of the world; stamp: builtin_interfaces/Time of the start
    """
    times = np.linspace(0, trajectory.duration, number)
    back = tool.inverse()
    points = []
    for time, gripper, speed, change in zip(times, *trajectory.at(times), strict=True):
        pose = gripper.compose(back)
        arm = pose.position - gripper.position
        spin, turn = speed[3:], change[3:]
        # the tool's origin turns about the gripper's
        velocity = speed[:3] + np.cross(spin, arm)
        acceleration = change[:3] + np.cross(turn, arm) + np.cross(spin, np.cross(spin, arm))
        points.append(MultiDOFJointTrajectoryPoint(
            transforms=[Transform(translation=_vector(pose.position),
                                  rotation=_quaternion(pose.quaternion))],
            velocities=[Twist(linear=_vector(velocity), angular=_vector(spin))],
            accelerations=[Twist(linear=_vector(acceleration), angular=_vector(turn))],
            time_from_start=_duration(time)))
    return MultiDOFJointTrajectory(header=header(frame_id, stamp), joint_names=['gripper'],
                                   points=points)


def _vector(values):
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)


def _quaternion(values):
    x, y, z, w = map(float, values)
    return Quaternion(x=x, y=y, z=z, w=w)


def _duration(seconds):
    total = round(float(seconds) * _NANOSECONDS)
    return Duration(sec=total // _NANOSECONDS, nanosec=total % _NANOSECONDS)
