# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A node in the process of a test: its state at hand, what it is sent, what is waited for."""

import threading
from contextlib import contextmanager

import rclpy
from planner_process import ROOM, WIRE, until
from rclpy.parameter import Parameter
from visualization_msgs.msg import Marker

from dlo_planner import Pose
from dlo_planner.ros.lifecycle import PatientExecutor
from dlo_planner.ros.node import PlannerNode
from msg_helpers.poses import pose_msg

HERE = Pose.looking_along((0.1, -0.2, 1.0), (1.0, 0.3, 0.2))
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
OVERRIDES = {'rod.diameter': 1.5e-3, 'threading.waypoints': 12, 'diagnostics_period': 0.1,
             'threading.deepest': 0.5, 'rod.damping': [0.5, 0.0], **ROOM}


@contextmanager
def served_node():
    """Yield a PlannerNode that is served by a thread."""
    context = rclpy.Context()
    rclpy.init(context=context)
    planner = PlannerNode(context=context, cli_args=['--ros-args', *WIRE], parameter_overrides=[
        Parameter('diagnostics_period', value=0.1)])
    executor = PatientExecutor(8, context=context)
    executor.add_node(planner)
    ended = threading.Event()

    def serve():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.05)

    thread = threading.Thread(target=serve)
    thread.start()
    yield planner
    ended.set()
    thread.join()
    executor.shutdown()
    planner.destroy_node()
    rclpy.try_shutdown(context=context)


def begin_anew(node, values):
    """Let a node forget all, and begin with parameters (name -> value)."""
    node.trigger_deactivate()
    node.trigger_cleanup()
    changed = {name: value for name, value in values.items()
               if node.get_parameter(name).value != value}
    results = node.set_parameters([Parameter(name, value=value)
                                   for name, value in changed.items()])
    assert all(result.successful for result in results), results
    node.start_up()


class Alive:
    """Stands for the process of a node that has none of its own."""

    log = ''

    def alive(self):
        return True


def state(node):
    return node.shared.store.state


def box(number, x=3.0, size=0.1, namespace='cell'):
    marker = Marker(ns=namespace, id=number, type=Marker.CUBE, action=Marker.ADD)
    marker.header.frame_id = 'world'
    marker.pose = pose_msg(Pose((x, 5.0, 0.0), (0, 0, 0, 1)))
    marker.scale.x = marker.scale.y = marker.scale.z = size
    return marker


def clear(client, node):
    client.send_obstacles([Marker(action=Marker.DELETEALL)])
    assert until(lambda: not state(node).scene.bodies)
