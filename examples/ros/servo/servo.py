# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A Cartesian servo that is not there: it follows poses a little late, and says where it is.

python3 servo.py --ros-args -p 'begin:=[x, y, z, qx, qy, qz, qw]' -p lag:=0.05
"""

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from scipy.spatial.transform import Rotation, Slerp

PERIOD = 0.01  # s between two poses


class Servo(Node):
    """Goes to the last pose that it was told, as a first-order lag does."""

    def __init__(self):
        super().__init__('servo')
        begin = self.declare_parameter('begin', [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]).value
        lag = self.declare_parameter('lag', 0.05).value  # s
        self._frame = self.declare_parameter('frame_id', 'world').value
        self._share = 1 - np.exp(-PERIOD / lag)
        self._here = self._wanted = np.array(begin[:3]), Rotation.from_quat(begin[3:])
        self._out = self.create_publisher(PoseStamped, 'gripper_pose', qos_profile_sensor_data)
        self.create_subscription(PoseStamped, 'gripper_command', self._on_command, 10)
        self.create_timer(PERIOD, self._step)

    def _on_command(self, msg):
        place, turn = msg.pose.position, msg.pose.orientation
        self._wanted = (np.array([place.x, place.y, place.z]),
                        Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]))

    def _step(self):
        (place, turn), (goal, aim) = self._here, self._wanted
        turned = Slerp([0, 1], Rotation.concatenate([turn, aim]))(self._share)
        self._here = place + self._share * (goal - place), turned
        msg = PoseStamped()
        msg.header.frame_id, msg.header.stamp = self._frame, self.get_clock().now().to_msg()
        for name, value in zip('xyz', self._here[0], strict=True):
            setattr(msg.pose.position, name, float(value))
        for name, value in zip('xyzw', self._here[1].as_quat(), strict=True):
            setattr(msg.pose.orientation, name, float(value))
        self._out.publish(msg)


def main():
    """Follow until it is interrupted."""
    rclpy.init()
    node = Servo()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
