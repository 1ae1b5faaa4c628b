# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses in other frames: through tf2 if it is installed, refused by name if not."""

from typing import Any

from std_msgs.msg import Header

from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.model.checks import shown
from dlo_planner.model.pose import Pose

_PATIENCE = 0.1  # s that a transform may come later than a pose
_LONGEST = 256   # characters of a name: what is longer is neither looked up nor said


class OneFrame:
    """Knows one frame only; also the interface of the others."""

    def origin(self, header: Header, frame_id: str, name: str) -> Pose | None:
        """Return the Pose of a message's frame in another one; None if it is the same frame.

        Parameters
        ----------
        header : Header
            std_msgs/Header of the message; stamp 0: as it is now.
        frame_id : str
            Frame id of the frame in which it is wanted.
        name : str
            How the sender knows the message.

        Raises
        ------
        Refused
            Naming the field, its value, and what would be right.
        """
        if header.frame_id == frame_id:
            return None
        judge_length(header.frame_id, f'{name}.header.frame_id', Cause.INVALID_FRAME)
        raise _refused(header, frame_id, name, 'tf2_ros is not installed')

    def close(self) -> None:
        """Listen no more."""


class TfFrames(OneFrame):
    """Knows what tf knows.

    Parameters
    ----------
    node : object
        Rclpy Node that listens to /tf and /tf_static.
    tf2 : object
        Module tf2_ros.
    """

    def __init__(self, node: Any, tf2: Any) -> None:
        from rclpy.duration import Duration  # noqa: PLC0415
        from rclpy.time import Time  # noqa: PLC0415
        self._tf2, self._time, self._patience = tf2, Time, Duration(seconds=_PATIENCE)
        self._buffer = tf2.Buffer()
        self._listener = tf2.TransformListener(self._buffer, node)

    def origin(self, header: Header, frame_id: str, name: str) -> Pose | None:
        """As `OneFrame.origin`."""
        if header.frame_id == frame_id:
            return None
        judge_length(header.frame_id, f'{name}.header.frame_id', Cause.INVALID_FRAME)
        if not header.frame_id:
            raise _refused(header, frame_id, name, 'it is empty')
        try:
            found = self._buffer.lookup_transform(
                frame_id, header.frame_id, self._time.from_msg(header.stamp), self._patience)
        except self._tf2.TransformException as error:
            raise _refused(header, frame_id, name, f'tf says: {error}') from None
        at, turn = found.transform.translation, found.transform.rotation
        return Pose((at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w))

    def close(self) -> None:
        """Listen no more."""
        self._listener.unregister()


def frames_of(node: Any) -> OneFrame:
    """Return the Frames of a Node: TfFrames where tf2_ros is installed."""
    try:
        import tf2_ros  # noqa: PLC0415
    except ImportError:
        return OneFrame()
    return TfFrames(node, tf2_ros)


def judge_length(text: str, name: str, cause: Cause) -> None:
    """Refuse a name that is too long to be looked up, or said in the log."""
    if len(text) > _LONGEST:
        raise Refused(cause, f'{name} has {len(text)} characters: expected {_LONGEST} at most')


def _refused(header: Header, frame_id: str, name: str, why: str) -> Refused:
    return Refused(Cause.INVALID_FRAME, f'{name}.header.frame_id = {shown(header.frame_id)}: '
                   f'expected {frame_id!r}, or a frame that tf can transform to it ({why})')
