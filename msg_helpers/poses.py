# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose <-> geometry_msgs."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMsg
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, shown, vector
from dlo_planner.model.pose import Pose


def header(frame_id: str, stamp: Time | None = None) -> Header:
    """Return a std_msgs/Header; `stamp` a builtin_interfaces/Time, None for zero.

    As all functions of this package it raises InvalidTask where an argument makes no sense.
    """
    instance('frame_id', frame_id, str)
    instance('stamp', stamp, Time, optional=True)
    return Header(frame_id=frame_id, stamp=stamp if stamp is not None else Time())


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
    """Return the Pose of a geometry_msgs/Pose.

    Raises
    ------
    InvalidTask
        A component is not finite, or the quaternion is zero.
    """
    instance('msg', msg, PoseMsg)
    p, q = msg.position, msg.orientation
    return Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def pose_from_stamped(msg: PoseStamped, frame_id: str, name: str) -> Pose:
    """Return the Pose of a geometry_msgs/PoseStamped that must be given in `frame_id`.

    Parameters
    ----------
    msg : PoseStamped
    frame_id : str
        The only frame that is understood.
    name : str
        How the sender knows the field, for the message.

    Raises
    ------
    InvalidTask
        Naming the field and its value.
    """
    instance('msg', msg, PoseStamped)
    _judge(frame_id, name)
    if msg.header.frame_id != frame_id:
        raise InvalidTask(f'{name}.header.frame_id = {shown(msg.header.frame_id)}: '
                          f'expected {frame_id!r}')
    try:
        return pose_from_msg(msg.pose)
    except InvalidTask as error:
        raise InvalidTask(f'{name}: {error}') from None


def _judge(frame_id: str, name: str) -> None:
    instance('frame_id', frame_id, str)
    instance('name', name, str)
