# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A real process that executes, and is told to end."""

import signal

import numpy as np
import pytest
from follower import Follower
from planner_process import (
    DEEPEST,
    PATIENCE,
    ROOM,
    connected_client,
    options,
    running_planner,
    steps,
    under_way,
)
from streams import largest

from dlo_planner import Limits, Pose

AWAY = Pose.looking_along((-1.3, 0.2, 1.1), (1.0, 0.2, 0.1))
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
OPTIONS = options({'rod.diameter': 0.0015, 'threading.waypoints': 25, 'threading.standoff': 0.05,
                   'threading.deepest': DEEPEST,
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


@pytest.mark.every(2)
@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_process_that_is_told_to_end_decelerates_first(planner, client, robot, number):
    client.shape_for(AWAY)
    regular = under_way(client, client.plan_threading(AWAY, GOAL)[0])
    planner.process.send_signal(number)
    assert planner.process.wait(timeout=PATIENCE) == 0
    moved = steps(client)
    assert moved.max() <= 1.2 * regular
    told = np.linalg.norm(np.diff([pose.position for pose in robot.told], axis=0), axis=1)
    assert 0.2 * regular < told.max() <= 1.2 * regular and told[-1] < 1e-5
    assert largest(robot.told, Limits(), 0.02) <= 1.01
    assert 'the node ends' in planner.log and 'Traceback' not in planner.log
