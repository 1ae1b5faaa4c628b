# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Latched and ordinary publishers on one topic, each message heard once and in order."""

import time

import pytest
from planner_process import PATIENCE, until
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Int32

from dlo_planner.ros.lifecycle import CHANGES, Entities, Once

LATCHED = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Hearer(Entities, Node):
    """A node that hears what is latched."""

    def __init__(self, **options):
        Node.__init__(self, 'hearer', **options)
        Entities.__init__(self)


@pytest.fixture
def pair(context):
    """Yield a node that sends, one that hears, what it heard, and a function that spins."""
    sender, hearer = Node('sender', context=context), Hearer(context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(hearer)
    heard = []

    def spin(number, seconds=PATIENCE):
        end = time.monotonic() + seconds
        while len(heard) < number and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        for _ in range(10):  # what comes too much comes now
            executor.spin_once(timeout_sec=0.02)
        return heard

    yield sender, hearer, heard, spin
    executor.shutdown()
    sender.destroy_node()
    hearer.destroy_node()


def hear(hearer, heard):
    hearer.add_latched(Int32, 'numbers', lambda msg: heard.append(msg.data), CHANGES,
                       MutuallyExclusiveCallbackGroup())


def wait_for(publisher, number):
    assert until(lambda: publisher.get_subscription_count() >= number)


def test_what_was_latched_before_is_heard_once(pair):
    sender, hearer, heard, spin = pair
    publisher = sender.create_publisher(Int32, 'numbers', LATCHED)
    for number in range(3):
        publisher.publish(Int32(data=number))
    hear(hearer, heard)
    assert spin(3) == [0, 1, 2]


def test_what_is_latched_later_is_heard_once(pair):
    sender, hearer, heard, spin = pair
    hear(hearer, heard)
    publisher = sender.create_publisher(Int32, 'numbers', LATCHED)
    publisher.publish(Int32(data=1))
    assert spin(1) == [1]
    assert until(lambda: spin(1) and publisher.get_subscription_count() == 2)
    for number in (1, 2, 2):  # equal contents are messages of their own
        publisher.publish(Int32(data=number))
    assert spin(4) == [1, 1, 2, 2]


def test_an_ordinary_publisher_is_heard_and_not_warned(pair):
    sender, hearer, heard, spin = pair
    warned = []
    publisher = sender.create_publisher(
        Int32, 'numbers', QoSProfile(depth=10),
        event_callbacks=PublisherEventCallbacks(incompatible_qos=warned.append))
    watching = SingleThreadedExecutor(context=sender.context)
    watching.add_node(sender)
    hear(hearer, heard)
    wait_for(publisher, 1)
    for number in range(5):
        publisher.publish(Int32(data=number))
    assert spin(5) == [0, 1, 2, 3, 4]
    for _ in range(10):
        watching.spin_once(timeout_sec=0.1)
    watching.shutdown()
    assert not warned


def test_messages_without_a_time_are_not_taken_for_copies():
    heard = []
    once = Once(heard.append)
    for number in range(3):
        once(number, {'source_timestamp': 0})
    assert heard == [0, 1, 2]


def test_memory_stays_small():
    once = Once(lambda _: None)
    for number in range(20_000):
        once(number, {'source_timestamp': number + 1, 'publication_sequence_number': number})
    assert len(once._seen) < 5000
