# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The entities of a managed node act only while it is active."""

import threading
import time
from types import SimpleNamespace

import pytest
from planner_process import PATIENCE, until
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from dlo_planner.ros.lifecycle import CHANGES, Entities, Once, PatientExecutor


class Recorder(Entities):
    """A node that keeps what is made of it."""

    def __init__(self):
        super().__init__()
        self.made, self.destroyed = {}, []

    def __getattr__(self, name):
        if name.startswith('destroy_'):
            return self.destroyed.append
        return lambda *_, **__: None

    def create_subscription(self, kind, topic, callback, qos, **options):
        return self.made.setdefault(topic, callback)

    def create_service(self, kind, name, callback, **options):
        return self.made.setdefault(name, callback)

    def create_timer(self, period, callback, **options):
        return self.made.setdefault('timer', callback)


def answered(_, response):
    response.success, response.message = True, 'done'
    return response


def test_nothing_acts_while_it_is_shut():
    node, calls = Recorder(), []
    node.add_subscription(object, 'heard', calls.append, 10)
    node.add_subscription(object, 'scene', calls.append, 10, always=True)
    node.add_timer(1.0, lambda: calls.append('tick'))
    node.add_service(Trigger, 'asked', answered, None)

    def use():
        calls.clear()
        node.made['heard']('message')
        node.made['scene']('marker')
        node.made['timer']()
        answer = node.made['asked'](None, Trigger.Response())
        return calls, answer.success, answer.message

    refused = (['marker'], False, 'the node is not active: expected its lifecycle state to be '
                                  'active')
    assert use() == refused
    node.open()
    assert use() == (['message', 'marker', 'tick'], True, 'done')
    assert node.shut(0.0)
    assert use() == refused
    node.destroy_entities()
    assert len(node.destroyed) == 4
    node.destroy_entities()
    assert len(node.destroyed) == 4


def test_an_answer_without_a_message_is_empty():
    node = Recorder()
    node.add_service(object, 'plan', answered, None)
    assert node.made['plan'](None, SimpleNamespace(plan='empty')).plan == 'empty'


def test_it_waits_for_what_runs():
    node, begun, go = Recorder(), threading.Event(), threading.Event()
    node.add_timer(1.0, lambda: (begun.set(), go.wait(10)))
    node.open()
    thread = threading.Thread(target=node.made['timer'])
    thread.start()
    begun.wait(10)
    assert not node.shut(0.05)
    go.set()
    assert node.shut(10.0)
    thread.join()


def test_it_goes_on_as_soon_as_what_runs_has_ended():
    node, begun, go, answers = Recorder(), threading.Event(), threading.Event(), []
    node.add_timer(1.0, lambda: (begun.set(), go.wait(10)))
    node.open()
    running = threading.Thread(target=node.made['timer'])
    running.start()
    begun.wait(10)
    shutting = threading.Thread(target=lambda: answers.append(node.shut(30.0)), daemon=True)
    shutting.start()
    waits = False
    while not waits:  # it gives the lock back when it waits
        with node._changed:
            waits = not node._open
    go.set()
    running.join()
    shutting.join(10)
    assert answers == [True]


def test_a_callback_that_fails_does_not_count_on():
    node = Recorder()
    node.add_timer(1.0, lambda: 1 / 0)
    node.open()
    with pytest.raises(ZeroDivisionError):
        node.made['timer']()
    assert node.shut(0.0)


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
