# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The executor does not spin while a callback waits for its turn."""

import threading
import time

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from dlo_planner.ros.executor import PatientExecutor


def test_a_busy_callback_costs_the_executor_nothing(domain):
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node('busy', context=context)
    executor = PatientExecutor(2, context=context)
    rounds = 0
    done = threading.Event()

    def work():
        time.sleep(0.3)
        done.set()

    node.create_timer(0.01, work, callback_group=MutuallyExclusiveCallbackGroup())
    executor.add_node(node)
    end = time.monotonic() + 10
    while not done.is_set() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
        rounds += 1
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    assert done.is_set()
    assert rounds < 40  # six waits of 50 ms and a few wake-ups; a busy loop makes hundreds
