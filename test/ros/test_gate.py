# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The entities of a managed node act only while it is active."""

import threading
from types import SimpleNamespace

import pytest
from std_srvs.srv import Trigger

from dlo_planner.ros.managed import Gate


class Recorder:
    """A node that keeps what is made of it."""

    def __init__(self):
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
    gate = Gate(node)
    gate.create_subscription(object, 'heard', calls.append, 10)
    gate.create_subscription(object, 'scene', calls.append, 10, always=True)
    gate.create_timer(1.0, lambda: calls.append('tick'))
    gate.create_service(Trigger, 'asked', answered)

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
    gate.open()
    assert use() == (['message', 'marker', 'tick'], True, 'done')
    assert gate.shut(0.0)
    assert use() == refused
    gate.destroy()
    assert len(node.destroyed) == 4
    gate.destroy()
    assert len(node.destroyed) == 4


def test_an_answer_without_a_message_is_empty():
    node = Recorder()
    Gate(node).create_service(object, 'plan', answered)
    assert node.made['plan'](None, SimpleNamespace(plan='empty')).plan == 'empty'


def test_it_waits_for_what_runs():
    node, begun, go = Recorder(), threading.Event(), threading.Event()
    gate = Gate(node)
    gate.create_timer(1.0, lambda: (begun.set(), go.wait(10)))
    gate.open()
    thread = threading.Thread(target=node.made['timer'])
    thread.start()
    begun.wait(10)
    assert not gate.shut(0.05)
    go.set()
    assert gate.shut(10.0)
    thread.join()


def test_it_goes_on_as_soon_as_what_runs_has_ended():
    node, begun, go, answers = Recorder(), threading.Event(), threading.Event(), []
    gate = Gate(node)
    gate.create_timer(1.0, lambda: (begun.set(), go.wait(10)))
    gate.open()
    running = threading.Thread(target=node.made['timer'])
    running.start()
    begun.wait(10)
    shutting = threading.Thread(target=lambda: answers.append(gate.shut(30.0)), daemon=True)
    shutting.start()
    waits = False
    while not waits:  # it gives the lock back when it waits
        with gate._changed:
            waits = not gate._open
    go.set()
    running.join()
    shutting.join(10)
    assert answers == [True]


def test_a_callback_that_fails_does_not_count_on():
    node = Recorder()
    gate = Gate(node)
    gate.create_timer(1.0, lambda: 1 / 0)
    gate.open()
    with pytest.raises(ZeroDivisionError):
        node.made['timer']()
    assert gate.shut(0.0)
