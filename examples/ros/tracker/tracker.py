# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A tracker that is not there: it publishes the looks of looks.csv again and again, as they come.

python3 tracker.py --ros-args -p rate:=5.0
"""

from itertools import cycle
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2, PointField

LOOKS = Path(__file__).resolve().parent / 'looks.csv'


class Tracker(Node):
    """Publishes points of the DLO, in m, stamped when they were seen: now."""

    def __init__(self):
        super().__init__('tracker')
        file = self.declare_parameter('file', str(LOOKS)).value
        rate = self.declare_parameter('rate', 5.0).value  # clouds in a second
        self._frame = self.declare_parameter('frame_id', 'world').value
        rows = np.loadtxt(file, delimiter=',', skiprows=1)
        self._looks = cycle([rows[rows[:, 0] == look, 1:] for look in np.unique(rows[:, 0])])
        self._out = self.create_publisher(PointCloud2, 'points', qos_profile_sensor_data)
        self.create_timer(1 / rate, self._look)

    def _look(self):
        points = next(self._looks).astype('<f4')
        msg = PointCloud2(
            height=1, width=len(points), point_step=12, row_step=12 * len(points), is_dense=True,
            fields=[PointField(name=axis, offset=4 * k, datatype=PointField.FLOAT32, count=1)
                    for k, axis in enumerate('xyz')], data=points.tobytes())
        msg.header.frame_id, msg.header.stamp = self._frame, self.get_clock().now().to_msg()
        self._out.publish(msg)


def main():
    """Publish until it is interrupted."""
    rclpy.init()
    node = Tracker()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
