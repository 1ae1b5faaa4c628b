# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes and plans -> nav_msgs/Path, and back to poses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMsg
from nav_msgs.msg import Path
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, number, row
from dlo_planner.model.pose import Pose
from msg_helpers.poses import header, pose_from_msg, pose_stamped_msg

_NANOSECONDS = 10**9
_LAST = 2**31  # s, of builtin_interfaces/Time


def shape_path(shape: Shape, frame_id: str, stamp: Time) -> Path:
    """Return the DLO node by node as a Path; x axis of each pose = tangent, s as in `Shape.s`.

    Parameters
    ----------
    shape : Shape
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time of the gripper pose that it belongs to.
    """
    instance('shape', shape, Shape)
    top = header(frame_id, stamp)
    quaternions = Rotation.from_matrix(np.array(shape.frames)).as_quat()
    # Sixty nodes at pose rate: no Pose objects in between, and one header that all share.
    nodes = zip(shape.positions.tolist(), quaternions.tolist(), strict=True)
    poses = [PoseStamped(header=top, pose=_node(*node)) for node in nodes]
    return Path(header=top, poses=poses)


def shape_bytes(shape: Shape, frame_id: str, stamp: Time) -> bytes:
    """Return the serialized message (CDR) of `shape_path`, which is made forty times as quickly.

    Parameters
    ----------
    shape, frame_id, stamp : object
        As for `shape_path`.
    """
    instance('shape', shape, Shape)
    instance('stamp', stamp, Time)
    name = header(frame_id, stamp).frame_id.encode() + b'\0'
    top = np.array((stamp.sec, stamp.nanosec, len(name), name), [
        ('sec', '<i4'), ('nanosec', '<u4'), ('length', '<u4'), ('name', f'S{len(name)}')]).tobytes()
    top = top.ljust(12 + len(name), b'\0')
    count = np.array(shape.s.size, '<u4').tobytes()
    begin = top + bytes(-len(top) % 4) + count
    begin += top + bytes(-(len(begin) + len(top)) % 8)  # a double begins at a multiple of 8
    gap = -len(top) % 8
    nodes = np.zeros(shape.s.size, [('pose', '<f8', 7), ('top', f'V{len(top) + gap}')])
    nodes['pose'][:, :3] = shape.positions
    nodes['pose'][:, 3:] = Rotation.from_matrix(np.array(shape.frames)).as_quat()
    nodes['top'] = np.void(top + bytes(gap))  # of the next pose
    return bytes((0, 1, 0, 0)) + begin + nodes.tobytes()[:-len(top) - gap]


def _node(position: Sequence[float], quaternion: Sequence[float]) -> PoseMsg:
    """Return geometry_msgs/Pose of lists of floats that are known to be good."""
    (a, b, c), (x, y, z, w) = position, quaternion
    return PoseMsg(position=Point(x=a, y=b, z=c), orientation=Quaternion(x=x, y=y, z=z, w=w))


def plan_path(grippers: Iterable[Pose], times: ArrayLike, frame_id: str, stamp: Time) -> Path:
    """Return gripper poses as a Path, each stamped with `stamp` plus its time.

    Parameters
    ----------
    grippers : iterable of Pose
        The n poses.
    times : array_like, shape (n,)
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time of the first pose.
    """
    grippers = items('grippers', grippers, Pose)
    times = row('times', times, least=0)
    if len(times) != len(grippers):
        raise InvalidTask(f'times has {len(times)} entries: expected one per gripper pose, '
                          f'{len(grippers)}')
    poses = [pose_stamped_msg(pose, frame_id, later(stamp, time))
             for pose, time in zip(grippers, times, strict=True)]
    return Path(header=header(frame_id, stamp), poses=poses)


def later(stamp: Time, seconds: float) -> Time:
    """Return builtin_interfaces/Time `seconds` after `stamp`."""
    instance('stamp', stamp, Time)
    seconds = number('seconds', seconds)
    total = stamp.sec * _NANOSECONDS + stamp.nanosec + round(seconds * _NANOSECONDS)
    if not -_LAST <= total // _NANOSECONDS < _LAST:
        raise InvalidTask(f'seconds = {seconds:g}: expected a time that fits in 32 bits of seconds')
    return Time(sec=total // _NANOSECONDS, nanosec=total % _NANOSECONDS)


def poses_from_path(path: Path) -> list[Pose]:
    """Return the list of Pose in a nav_msgs/Path."""
    instance('path', path, Path)
    return [pose_from_msg(stamped.pose) for stamped in path.poses]


def times_from_path(path: Path) -> Floats:
    """Return (n,) s: the poses' stamps, counted from the first one's."""
    instance('path', path, Path)
    stamps = np.array([p.header.stamp.sec * _NANOSECONDS + p.header.stamp.nanosec
                       for p in path.poses], dtype=np.int64)
    return (stamps - stamps[:1]) / _NANOSECONDS
