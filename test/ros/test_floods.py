# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics that are sent quicker than the node can take them: its services answer all the same."""

from contextlib import contextmanager
from threading import Event, Thread
from time import sleep

import node_inside
import numpy as np
import pytest
from node_inside import HERE, Alive, clear, state
from planner_process import connected_client, until
from sensor_msgs.msg import PointCloud2

from dlo_planner import Pose
from dlo_planner.ros.lifecycle import LATEST
from msg_helpers.clouds import cloud_msg

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
