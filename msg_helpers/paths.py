"""Shapes and plans -> nav_msgs/Path, and back to poses."""

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from scipy.spatial.transform import Rotation

from msg_helpers.poses import header, pose_from_msg, pose_msg_of, pose_stamped_msg

_NANOSECONDS = 10**9


def shape_path(shape, frame_id, stamp):
    """Return the DLO node by node as a Path; x axis of each pose = tangent, s as in `Shape.s`.

    Args:
        shape: Shape
        frame_id: of the world
        stamp: builtin_interfaces/Time of the gripper pose that it belongs to
    """
    top = header(frame_id, stamp)
    quaternions = Rotation.from_matrix(shape.frames).as_quat()
    # Sixty nodes at pose rate: no Pose objects in between, and one header that all share.
    nodes = zip(shape.positions.tolist(), quaternions.tolist(), strict=True)
    poses = [PoseStamped(header=top, pose=pose_msg_of(*node)) for node in nodes]
    return Path(header=top, poses=poses)


def plan_path(grippers, times, frame_id, stamp):
    """Return gripper poses as a Path, each stamped with `stamp` plus its time.

    Args:
        grippers: n Pose
        times: (n,) s
        frame_id: of the world
        stamp: builtin_interfaces/Time of the first pose
    """
    poses = [pose_stamped_msg(pose, frame_id, later(stamp, time))
             for pose, time in zip(grippers, times, strict=True)]
    return Path(header=header(frame_id, stamp), poses=poses)


def later(stamp, seconds):
    """Return builtin_interfaces/Time `seconds` after `stamp`."""
    total = stamp.sec * _NANOSECONDS + stamp.nanosec + round(float(seconds) * _NANOSECONDS)
    return type(stamp)(sec=total // _NANOSECONDS, nanosec=total % _NANOSECONDS)


def poses_from_path(path):
    """Return the list of Pose in a nav_msgs/Path."""
    return [pose_from_msg(stamped.pose) for stamped in path.poses]


def times_from_path(path):
    """Return (n,) s: the poses' stamps, counted from the first one's."""
    stamps = np.array([p.header.stamp.sec * _NANOSECONDS + p.header.stamp.nanosec
                       for p in path.poses], dtype=np.int64)
    return (stamps - stamps[:1]) / _NANOSECONDS
