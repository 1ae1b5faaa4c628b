# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A robot that does as it is told, a little later."""

from bisect import bisect_left, bisect_right
from collections import deque
from threading import Lock
from time import monotonic

from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from trajectory_msgs.msg import MultiDOFJointTrajectory

from dlo_planner.model.pose import Pose
from dlo_planner.plan.stage import GRIPPER
from dlo_planner.ros.lifecycle import REQUEST
from dlo_planner.ros.state import pose_topic
from msg_helpers.poses import pose_from_msg, pose_stamped_msg
from msg_helpers.trajectories import stamped_poses

_KEPT = 1000  # commands
_SAME = 1e-4  # s: stamps are rounded, and add up


class Follower:
    """Publishes the commands of a planner as the gripper's poses, some time after they are due.

    Commands with stamps are due then, and single ones, which count where there are no others, when
    they come. It stands at `pose` of the tool frame first, and is `lag` s late. `arm`: the gripper,
    or another one.
    """

    def __init__(self, node: Node, planner: str, pose: Pose, lag: float = 0.05,
                 rate: float = 50.0, arm: str = GRIPPER) -> None:
        self._node, self._lag, self._lock, self._arm = node, lag, Lock(), arm
        heard, told = (('gripper_pose', 'gripper_command') if arm == GRIPPER
                       else (pose_topic(arm), f'gripper_command/{arm}'))
        self._pose, self._frame_id = pose, 'world'
        self._coming: deque[tuple[float, Pose]] = deque(maxlen=_KEPT)
        self._times: list[float] = []  # of commands with stamps, s
        self._told: list[Pose] = []
        self.silent = False  # whether it reports nothing
        self._stands = False
        self._out = node.create_publisher(PoseStamped, f'{planner}/{heard}',
                                          qos_profile_sensor_data)
        self._in = node.create_subscription(PoseStamped, f'{planner}/{told}',
                                            self._on_command, REQUEST)
        self._ahead_in = node.create_subscription(
            MultiDOFJointTrajectory, f'{planner}/gripper_commands_ahead', self._on_ahead, REQUEST)
        self._timer = node.create_timer(1 / rate, self._publish,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))

    def put(self, pose: Pose) -> None:
        """Move to a Pose at once, and follow from there."""
        with self._lock:
            self._pose = pose
            self._coming.clear()
            self._times, self._told = [], []

    def stand(self) -> None:
        """Follow no more."""
        with self._lock:
            self._stands = True

    @property
    def pose(self) -> Pose:
        """The Pose where it is."""
        with self._lock:
            return self._pose

    @property
    def told(self) -> list[Pose]:
        """The Poses that it was told with stamps since it was put somewhere, in their order."""
        with self._lock:
            return list(self._told)

    def close(self) -> None:
        """Stop publishing."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._in)
        self._node.destroy_subscription(self._ahead_in)
        self._node.destroy_publisher(self._out)

    def _on_command(self, msg: PoseStamped) -> None:
        with self._lock:
            self._frame_id = msg.header.frame_id
            if not self._times:
                self._coming.append((monotonic(), pose_from_msg(msg.pose)))

    def _on_ahead(self, msg: MultiDOFJointTrajectory) -> None:
        if self._arm not in msg.joint_names:
            return
        times, poses = stamped_poses(msg, self._arm)
        with self._lock:
            self._frame_id = msg.header.frame_id
            kept = bisect_left(self._times, times[0] - _SAME)
            self._times[kept:], self._told[kept:] = times.tolist(), poses
            self._coming.clear()

    def _publish(self) -> None:
        with self._lock:
            while self._coming and self._coming[0][0] <= monotonic() - self._lag:
                self._pose = self._coming.popleft()[1]
            now = 1e-9 * self._node.get_clock().now().nanoseconds - self._lag
            due = bisect_right(self._times, now + _SAME)
            self._pose = self._told[due - 1] if due and not self._stands else self._pose
            pose = self._pose
        if self.silent:
            return
        self._out.publish(pose_stamped_msg(pose, self._frame_id,
                                           self._node.get_clock().now().to_msg()))
