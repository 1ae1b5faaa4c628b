# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""An arm that is not there, over DDS: its URDF, joint_states, a stand-in of its controller."""

import threading
from contextlib import contextmanager
from time import sleep
from xml.etree import ElementTree

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_controller import TrajectoryController
from trajectory_msgs.msg import JointTrajectory

from dlo_planner.ros.lifecycle import LATCHED
from msg_helpers.poses import time_msg

PERIOD = 0.008  # s between two samples: joint_states as often


def initial_positions(urdf):
    """Return the positions at which the mock hardware of a URDF begins, by joint."""
    joints = ElementTree.fromstring(urdf).find('ros2_control').findall('joint')
    return {joint.get('name'): float(joint.find('.//param[@name="initial_value"]').text)
            for joint in joints}


class ArmOverDds:
    """Follows its controller exactly; `commands` has the stamp and the joints of each sample."""

    def __init__(self, urdf, topic):
        self.urdf, begin = urdf, initial_positions(urdf)
        self.names, self.joints = tuple(begin), np.array(list(begin.values()))
        self.controller = TrajectoryController(self.names, self.joints)
        self.commands, self.speeds, self._last = [], np.zeros(len(self.joints)), None
        self.silent = False  # whether no joint_states come
        self._lock = threading.Lock()
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node('arm', context=self.context)
        self.node.create_publisher(String, 'robot_description', LATCHED).publish(String(data=urdf))
        self._out = self.node.create_publisher(JointState, 'joint_states', 10)
        self.node.create_subscription(JointTrajectory, topic, self._hear, 10)
        self._closed = threading.Event()
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._threads = [threading.Thread(target=one, daemon=True)
                         for one in (self._spin, self._sample)]
        for one in self._threads:
            one.start()

    @property
    def now(self):
        return 1e-9 * self.node.get_clock().now().nanoseconds

    def _hear(self, msg):
        with self._lock:
            self.controller.hear(msg, self.now)

    def _spin(self):
        with_suppressed(self._executor.spin)

    def _sample(self):
        while not self._closed.wait(PERIOD):
            with_suppressed(self._step)

    def _step(self):
        with self._lock:
            now = self.now
            command = self.controller.update(now, self.joints, self.speeds).copy()
            if self._last is not None and now > self._last:
                self.speeds = (command - self.joints) / (now - self._last)
            self._last, self.joints = now, command
            self.commands.append((now, command))
        msg = JointState(name=list(self.names), position=command.tolist())
        msg.header.stamp = time_msg(now)
        if not self.silent:
            self._out.publish(msg)

    def close(self):
        self._closed.set()
        self._executor.shutdown()
        for one in self._threads:
            one.join(5.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def with_suppressed(call):
    """Call what the end of a context interrupts."""
    try:
        call()
    except (ExternalShutdownException, rclpy.exceptions.InvalidHandle,
            rclpy._rclpy_pybind11.RCLError):
        sleep(0.01)


@contextmanager
def arm_over_dds(urdf, topic):
    """Yield an ArmOverDds that hears a topic."""
    arm = ArmOverDds(urdf, topic)
    try:
        yield arm
    finally:
        arm.close()
