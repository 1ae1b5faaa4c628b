# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The entities of a managed node act only while it is active."""

import threading
from types import SimpleNamespace

import pytest
from std_srvs.srv import Trigger

from dlo_planner.ros.lifecycle import Entities


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
