# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Headers, stamps, poses and wrenches <-> std_msgs, geometry_msgs."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, PoseStamped, Quaternion, Vector3, Wrench, WrenchStamped
from geometry_msgs.msg import Pose as PoseMsg
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number, shown, vector
from dlo_planner.model.pose import Pose

_NANOSECONDS = 10**9
_LAST = 2**31  # s, of builtin_interfaces/Time


def header(frame_id: str, stamp: Time | None = None) -> Header:
    """Return a std_msgs/Header; `stamp` a builtin_interfaces/Time, None for zero.

    As all functions of this package it raises InvalidTask where an argument makes no sense.
    """
    instance('frame_id', frame_id, str)
    instance('stamp', stamp, Time, optional=True)
    return Header(frame_id=frame_id, stamp=stamp if stamp is not None else Time())


def seconds_of(stamp: Time | Duration) -> float:
    """Return the seconds of a builtin_interfaces/Time or Duration."""
    instance('stamp', stamp, (Time, Duration))
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def stamp_text(stamp: Time) -> str:
    """Return a builtin_interfaces/Time as seconds with nine digits."""
    instance('stamp', stamp, Time)
    return f'{stamp.sec}.{stamp.nanosec:09d}'


def time_msg(seconds: float, stamp: Time | None = None) -> Time:
    """Return builtin_interfaces/Time of seconds on its clock, or after another one."""
    begin = Time() if stamp is None else instance('stamp', stamp, Time)
    whole, rest = _parts(seconds, begin.sec * _NANOSECONDS + begin.nanosec)
    return Time(sec=whole, nanosec=rest)


def duration_msg(seconds: float) -> Duration:
    """Return builtin_interfaces/Duration of seconds."""
    whole, rest = _parts(seconds)
    return Duration(sec=whole, nanosec=rest)


def _parts(seconds: float, after: int = 0) -> tuple[int, int]:
    """Return whole seconds and nanoseconds, `after` so many nanoseconds."""
    whole, rest = divmod(round(number('seconds', seconds) * _NANOSECONDS) + after, _NANOSECONDS)
    if not -_LAST <= whole < _LAST:
        raise InvalidTask(f'seconds = {seconds:g}: expected a time that fits in 32 bits of seconds')
    return whole, rest


def point_msg(position: ArrayLike) -> Point:
    """Return geometry_msgs/Point of (3,) m; each field a true float, or it arrives as garbage."""
    x, y, z = vector('position', position, 3).tolist()
    return Point(x=x, y=y, z=z)


def pose_msg_of(position: ArrayLike, quaternion: ArrayLike) -> PoseMsg:
    """Return geometry_msgs/Pose of (3,) m and (4,) x, y, z, w."""
    x, y, z, w = vector('quaternion', quaternion, 4).tolist()
    return PoseMsg(position=point_msg(position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def pose_msg(pose: Pose) -> PoseMsg:
    """Return geometry_msgs/Pose of a Pose."""
    instance('pose', pose, Pose)
    return pose_msg_of(pose.position, pose.quaternion)


def pose_stamped_msg(pose: Pose, frame_id: str, stamp: Time | None = None) -> PoseStamped:
    """Return geometry_msgs/PoseStamped of a Pose given in `frame_id`."""
    return PoseStamped(header=header(frame_id, stamp), pose=pose_msg(pose))


def pose_from_msg(msg: PoseMsg) -> Pose:
    """Return the Pose of a geometry_msgs/Pose."""
    instance('msg', msg, PoseMsg)
    p, q = msg.position, msg.orientation
    return Pose(np.array((p.x, p.y, p.z)), np.array((q.x, q.y, q.z, q.w)))


def pose_from_stamped(msg: PoseStamped, frame_id: str, name: str) -> Pose:
    """Return the Pose of a geometry_msgs/PoseStamped that must be given in `frame_id`."""
    instance('msg', msg, PoseStamped)
    instance('frame_id', frame_id, str)
    instance('name', name, str)
    if msg.header.frame_id != frame_id:
        raise InvalidTask(f'{name}.header.frame_id = {shown(msg.header.frame_id)}: '
                          f'expected {frame_id!r}')
    try:
        return pose_from_msg(msg.pose)
    except InvalidTask as error:
        raise InvalidTask(f'{name}: {error}') from None


def wrench_in(frame: Pose, at: Pose, wrench: ArrayLike) -> Floats:
    """Return a wrench (6,) by the axes of a frame, its moment about the frame's origin.

    It is given as force (N) and moment (N m) by world axes, about the origin of `at`.
    """
    given = vector('wrench', wrench, 6)
    arm = instance('at', at, Pose).position - instance('frame', frame, Pose).position
    moment = given[3:] + np.cross(arm, given[:3])
    return np.concatenate([given[:3] @ frame.rotation, moment @ frame.rotation])


def wrench_msg(wrench: ArrayLike, frame_id: str, stamp: Time | None = None) -> WrenchStamped:
    """Return the message of force (N) and moment (N m) (6,) by the axes of `frame_id`."""
    a, b, c, x, y, z = vector('wrench', wrench, 6).tolist()
    return WrenchStamped(header=header(frame_id, stamp), wrench=Wrench(
        force=Vector3(x=a, y=b, z=c), torque=Vector3(x=x, y=y, z=z)))
