# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The executor does not spin while a callback waits for its turn."""

import threading
import time

from planner_process import PATIENCE
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from dlo_planner.ros.lifecycle import PatientExecutor


def test_a_busy_callback_costs_the_executor_nothing(context):
    node = Node('busy', context=context)
    executor = PatientExecutor(2, context=context)
    rounds = 0
    done = threading.Event()

    def work():
        time.sleep(0.3)
        done.set()

    node.create_timer(0.01, work, callback_group=MutuallyExclusiveCallbackGroup())
    executor.add_node(node)
    begun = time.monotonic()
    while not done.is_set() and time.monotonic() < begun + PATIENCE:
        executor.spin_once(timeout_sec=0.05)
        rounds += 1
    seconds = time.monotonic() - begun
    executor.shutdown()
    node.destroy_node()
    assert done.is_set()
    # waits of 50 ms and a few wake-ups; a busy loop makes hundreds
    assert rounds < 34 + seconds / 0.05
