# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A real process that executes, and what happens to it: stopped, told to end, at any moment."""

import signal
import time

import numpy as np
import pytest
from planner_process import (
    PATIENCE,
    ROOM,
    connected_client,
    drain,
    in_time,
    options,
    quiet,
    running_planner,
    until,
)
from streams import largest

from demo.follower import Follower
from dlo_planner import Limits, Pose
from msg_helpers.poses import pose_from_msg

_UNDER_WAY = 2.0  # s, at the top speed of this motion about
AWAY = Pose.looking_along((-1.3, 0.2, 1.1), (1.0, 0.2, 0.1))
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
OPTIONS = options({'rod.diameter': 0.0015, 'threading.waypoints': 25, 'threading.standoff': 0.05,
                   'cutouts.radius': 0.01, 'rod.damping': [0.5, 0.01], 'diagnostics_period': 0.1,
                   **ROOM})


@pytest.fixture
def planner(domain, tmp_path):
    with running_planner(tmp_path, *OPTIONS) as running:
        yield running


@pytest.fixture
def client(planner):
    with connected_client(planner) as connected:
        yield connected


@pytest.fixture
def robot(client):
    follower = Follower(client.node, client.planner, AWAY)
    yield follower
    follower.close()


def executing(client):
    """Plan, prove, execute for 2 s; return the largest step of the way in a period, m."""
    client.shape_for(AWAY)
    path, _ = client.plan_threading(AWAY, GOAL)
    assert client.proof(path)['report'] == 'held'
    timed = client.timed_for(path)
    speeds = [np.linalg.norm([v.x, v.y, v.z]) for v in (
        point.velocities[0].linear for point in timed.points)]
    for messages in (client.commands, client.executions):
        drain(messages)
    assert client.trigger('execute').success
    assert until(lambda: float(
        client.execution_in('running')[2]['done [s]']) >= _UNDER_WAY)
    return 0.02 * max(speeds)


def steps(client):
    places = [pose_from_msg(one.pose).position for one in quiet(client.commands)]
    return np.linalg.norm(np.diff(places, axis=0), axis=1)


@pytest.mark.every(2)
@pytest.mark.parametrize('horizon', [0.0, 1.0])
def test_a_process_that_was_stopped_for_seconds_makes_no_leap(planner, client, robot, horizon):
    client.set_parameters(execute__horizon=horizon)
    regular = executing(client)
    planner.process.send_signal(signal.SIGSTOP)
    time.sleep(2.5)  # longer than it may pause
    planner.process.send_signal(signal.SIGCONT)
    code, reason, _ = client.execution_in('stopped')
    assert code == 412 and (f'execute.{"horizon" if horizon else "longest_pause"} = ' in reason)
    assert client.status_of('execute')[0] in (0, 412)
    moved = steps(client)
    assert moved.max() <= 1.2 * regular
    if horizon:  # what the robot was told: it has come to rest by itself, within the limits
        assert largest(robot.told, Limits(), 0.02) <= 1.01


@pytest.mark.every(2)
@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_process_that_is_told_to_end_decelerates_first(planner, client, robot, number):
    regular = executing(client)
    planner.process.send_signal(number)
    assert planner.process.wait(timeout=PATIENCE) == 0
    moved = steps(client)
    assert moved.max() <= 1.2 * regular
    told = np.linalg.norm(np.diff([pose.position for pose in robot.told], axis=0), axis=1)
    assert 0.2 * regular < told.max() <= 1.2 * regular and told[-1] < 1e-5
    assert largest(robot.told, Limits(), 0.02) <= 1.01
    assert 'the node ends' in planner.log and 'Traceback' not in planner.log


def test_a_process_that_plans_ends_when_it_is_told_to(domain, tmp_path):
    def seconds():
        with running_planner(tmp_path, *OPTIONS) as planner, connected_client(planner) as client:
            client.set_parameters(threading__waypoints=10_000)
            client.send_goal(GOAL)
            time.sleep(1.0)
            asked = time.monotonic()
            planner.process.send_signal(signal.SIGTERM)
            assert planner.process.wait(timeout=PATIENCE) == 0
            assert 'Traceback' not in planner.log
            return time.monotonic() - asked
    assert in_time(seconds, 4.0)
