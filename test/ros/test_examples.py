# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch files of examples/ros: what they start is led by their own commands, with stand-ins.

The planner is the real node in this process, with the parameters and topics of the launch file; the
robot's own software (robot_state_publisher, ros2_control) is not on each machine.
"""

from contextlib import contextmanager

import numpy as np
import pytest
from arm_over_dds import arm_over_dds
from launching import command_line, started
from node_inside import Alive, state
from planner_here import context_of_its_own, planner_here
from planner_process import PATIENCE, ROOT, ROOM, connected_client, options, until
from ros2_commands import commands_of, run_inside

from dlo_planner.execute.causes import Cause

pytest.importorskip('pinocchio', reason='the extra [arm] is not installed')
EXAMPLES = ROOT / 'examples' / 'ros'
# a robot in a busy process is late; how far it may be is tested without one
BUSY = {name: value for name, value in ROOM.items() if name != 'constraints.path.angle'}


@contextmanager
def launched(name, monkeypatch, **arguments):
    """Yield the planner that an example starts, and a client of it."""
    monkeypatch.setattr('planner_here.WIRE', ())
    made = started(EXAMPLES / name / f'{name}.launch.py', **arguments)
    (planner, values), = (one for one in made if one[0].named.get('package') == 'dlo_planner')
    with context_of_its_own() as context, planner_here(
            monkeypatch, context, *command_line(planner, values), *options(BUSY)) as node, (
            connected_client(Alive())) as client:
        yield node, client


def session(name, client, node, until_executed=True):
    """Do what README.md of an example says, line by line; nothing is refused."""
    commands = commands_of((EXAMPLES / name / 'README.md').read_text())
    assert commands
    for how, topic, third, text in commands:
        if topic.endswith('/execute'):
            assert until(lambda: state(node).proof.done, 10 * PATIENCE)
            assert state(node).proof.safe, state(node).proof.reason
        said = run_inside(client, node, how, topic, third, text)
        assert not said, (topic, said)
    assert until(lambda: not state(node).executing, 10 * PATIENCE)
    return state(node).execution


def test_an_arm_is_led_by_its_joints(domain, own_domain, monkeypatch):
    urdf = (EXAMPLES / 'arm' / 'arm.urdf').read_text()
    with arm_over_dds(urdf, '/joint_trajectory_controller/joint_trajectory') as arm, launched(
            'arm', monkeypatch) as (node, client):
        assert until(lambda: state(node).pose is not None)
        begin = arm.joints.copy()
        execution = session('arm', client, node)
        assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
        assert arm.controller.taken > 3 and not arm.controller.refused
        assert np.abs(arm.joints - begin).max() > 0.1
        there = execution.way.poses([execution.way.duration])[0]
        np.testing.assert_allclose(state(node).gripper.matrix, there.matrix, atol=1e-4)
