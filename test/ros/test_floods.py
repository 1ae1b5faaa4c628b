# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics that are sent quicker than the node can take them, calls made at once: all is answered."""

from contextlib import contextmanager
from threading import Event, Thread
from time import sleep

import node_inside
import numpy as np
import pytest
from nav_msgs.srv import GetPlan
from node_inside import HERE, Alive, clear, state
from planner_client import drain
from planner_process import connected_client, until
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from dlo_planner import InvalidTask, Pose
from dlo_planner.execute.causes import Cause
from dlo_planner.ros.lifecycle import LATEST, MOST_CALLS
from msg_helpers.clouds import cloud_msg
from msg_helpers.poses import pose_stamped_msg

OVERRIDES = node_inside.OVERRIDES | {'observe.period': 1e-3}  # each cloud that it can get
ANSWERED = 20.0  # s; a service that starves gets no answer as long as the flood goes on
FAR = Pose.looking_along((0.3, 0.6, 1.2), (1, 1, 0.5))


@pytest.fixture(scope='module')
def client(node):
    with connected_client(Alive()) as connected:
        connected.timeout = ANSWERED
        yield connected


@contextmanager
def flood(send, pause=1e-3):
    """Send again and again, in a thread."""
    ended = Event()

    def run():
        while not ended.is_set():
            send()
            sleep(pause)

    thread = Thread(target=run)
    thread.start()
    yield
    ended.set()
    thread.join()


@pytest.mark.sweep
def test_clouds_do_not_starve_identify(client, node):
    client.shape_for(HERE)
    points = state(node).shape.positions_at(np.linspace(0, 1, 40) * state(node).shape.s[-1])
    out = client.node.create_publisher(PointCloud2, '/dlo_planner/observed_points', LATEST)

    def send():
        client.send_pose(HERE)
        out.publish(cloud_msg(points, 'world', client.node.get_clock().now().to_msg()))

    with flood(send):
        assert until(lambda: node.shared.statistics.report()[2].get('estimate looks', 0) >= 3)
        answer = client.trigger('identify')
    assert answer.success, answer.message
    client.node.destroy_publisher(out)
    client.trigger('reset')


@pytest.mark.sweep
def test_goals_do_not_starve_the_services_of_plans(client, node):
    with flood(lambda: client.send_goal(FAR), pause=1e-2):
        assert until(lambda: state(node).task)
        path, _ = client.plan_threading(HERE, Pose.looking_along((0, 0, 1), (1, 0, 0)))
    assert len(path.poses) > 2
    clear(client, node)


AT_ONCE = 100
GOAL = Pose.looking_along((0, 0, 1), (1, 0, 0))
CALLS = [(GetPlan, name) for name in (
    'predict_shape', 'plan', 'plan_threading', 'plan_insertion', 'plan_hold_contact',
    'plan_slide_contact', 'plan_sequence', 'plan_two_cutouts', 'execute_plan')] + [
    (Trigger, name) for name in ('replan', 'reset', 'identify', 'execute', 'cancel')]


def at_once(client, kind, name, number, request):
    """Return the answers to so many calls of a service that are made at once, None: lost."""
    asked = client.node.create_client(kind, f'/dlo_planner/{name}',
                                      qos_profile=QoSProfile(depth=number))
    assert asked.wait_for_service(ANSWERED)
    calls = [asked.call_async(request) for _ in range(number)]
    until(lambda: all(call.done() for call in calls))
    client.node.destroy_client(asked)
    return [call.result() if call.done() else None for call in calls]


@pytest.mark.parametrize(('kind', 'name'), CALLS, ids=[name for _, name in CALLS])
def test_a_hundred_calls_at_once_are_all_answered(client, node, kind, name):
    # in a frame that nobody knows: refused as soon as it is looked at, so that it takes no time
    request = kind.Request() if kind is Trigger else GetPlan.Request(
        start=pose_stamped_msg(HERE, 'nowhere'), goal=pose_stamped_msg(GOAL, 'nowhere'))
    answers = at_once(client, kind, name, AT_ONCE, request)
    assert answers.count(None) == 0
    if kind is Trigger:
        assert all(answer.message for answer in answers)


def test_calls_that_are_too_many_are_refused_while_the_others_wait(client, node, monkeypatch):
    begun, go_on = Event(), Event()

    def plan(*_):
        begun.set()
        go_on.wait(ANSWERED)
        raise InvalidTask('no plan')

    monkeypatch.setattr('dlo_planner.ros.plan.make_plan', plan)
    request = GetPlan.Request(start=pose_stamped_msg(HERE, 'world'),
                              goal=pose_stamped_msg(GOAL, 'world'))
    drain(client.statuses)
    asked = client.node.create_client(GetPlan, '/dlo_planner/plan_threading',
                                      qos_profile=QoSProfile(depth=1000))
    calls = [asked.call_async(request)]
    assert begun.wait(ANSWERED)
    calls += [asked.call_async(request) for _ in range(MOST_CALLS + 1)]
    code, message, _ = client.status_of('plan_threading')
    assert code == Cause.TOO_MANY_CALLS
    assert f'{MOST_CALLS} calls' in message
    assert until(lambda: sum(call.done() for call in calls) == 1)
    assert not calls[0].done()
    assert client.trigger('reset').success  # nothing else waits
    go_on.set()
    assert until(lambda: all(call.done() for call in calls))
    client.node.destroy_client(asked)
