# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch files of examples/ros: what they start is led by their own commands, with stand-ins.

The planner is the real node in this process, with the parameters and topics of the launch file; the
robot's own software (robot_state_publisher, ros2_control) is not on each machine.
"""

import re
import signal
import subprocess
import sys
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np
import pytest
from arm_over_dds import arm_over_dds
from launching import command_line, started, text
from nav_msgs.srv import GetPlan
from node_inside import state
from planner_client import PlannerClient
from planner_here import context_of_its_own, planner_here
from planner_process import (
    ENDS_WITH_US,
    PATIENCE,
    ROOM,
    ROOT,
    options,
    until,
)
from ros2_commands import commands_of, run_inside
from sensor_msgs.msg import PointCloud2

from dlo_planner import Pose
from dlo_planner.execute.causes import Cause
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.clouds import cloud_msg

EXAMPLES = ROOT / 'examples' / 'ros'
# a robot in a busy process is late; how far it may be is tested without one
BUSY = {name: value for name, value in ROOM.items() if name != 'constraints.path.angle'}


@contextmanager
def an_arm(topic):
    """Yield the arm of the example over DDS, whose controller hears a topic."""
    pytest.importorskip('pinocchio', reason='the extra [arm] is not installed')
    with arm_over_dds((EXAMPLES / 'arm' / 'arm.urdf').read_text(), topic) as arm:
        yield arm


@contextmanager
def launched(name, monkeypatch, **arguments):
    """Yield the planner that an example starts, and a client of it."""
    monkeypatch.setattr('planner_here.WIRE', ())
    made = started(EXAMPLES / name / f'{name}.launch.py', **arguments)
    (planner, values), = (one for one in made if one[0].named.get('package') == 'dlo_planner')
    with context_of_its_own() as context, planner_here(
            monkeypatch, context, *command_line(planner, values), *options(BUSY)) as node, closing(
            PlannerClient('/dlo_planner', timeout=PATIENCE)) as client:
        assert client._client(GetPlan, 'plan_threading').wait_for_service(PATIENCE)
        yield node, client


def session(name, client, node, before_executed=lambda command: None):
    """Do what README.md of an example says, line by line; nothing is refused.

    `before_executed` is called with the command that executes, when the plan is proved.
    """
    commands = commands_of((EXAMPLES / name / 'README.md').read_text())
    assert commands
    for how, topic, third, content in commands:
        if topic.endswith('/execute'):
            assert until(lambda: state(node).proof.done, 10 * PATIENCE)
            assert state(node).proof.safe, state(node).proof.reason
            before_executed((how, topic, third, content))
        said = run_inside(client, node, how, topic, third, content)
        assert not said, (topic, said)
    assert until(lambda: not state(node).executing, 10 * PATIENCE)
    return state(node).execution


def test_an_arm_is_led_by_its_joints(domain, own_domain, monkeypatch):
    with an_arm('/joint_trajectory_controller/joint_trajectory') as arm, launched(
            'arm', monkeypatch) as (node, client):
        assert until(lambda: state(node).pose is not None)
        begin = arm.joints.copy()
        assert node.streamer._joints_out.topic_name == (
            '/joint_trajectory_controller/joint_trajectory')

        def too_near(execute):
            """Have links stay farther from each other than they do on this way."""
            client.set_parameters(arm__self_clearance=0.08)
            said = run_inside(client, node, *execute)
            assert said.startswith('420: ') and 'come together' in said
            client.set_parameters(arm__self_clearance=0.005)

        execution = session('arm', client, node, too_near)
        assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
        assert arm.controller.taken > 3 and not arm.controller.refused
        assert np.abs(arm.joints - begin).max() > 0.1
        there = execution.way.poses([execution.way.duration])[0]
        np.testing.assert_allclose(state(node).gripper.matrix, there.matrix, atol=1e-4)


@contextmanager
def beside(name, **arguments):
    """Run the scripts that an example starts beside the planner."""
    processes = []
    for one, values in started(EXAMPLES / name / f'{name}.launch.py', **arguments):
        if 'cmd' in one.named:
            python, *line = [text(part, values) for part in one.named['cmd']]
            assert python == 'python3' and Path(line[0]).is_file()
            processes.append(subprocess.Popen([*ENDS_WITH_US, sys.executable, *line]))
    assert processes
    try:
        yield
        assert all(one.poll() is None for one in processes)
    finally:
        for one in processes:
            one.send_signal(signal.SIGINT)
            one.wait(PATIENCE)


def test_a_servo_follows_poses(own_domain, monkeypatch):
    with beside('servo'), launched('servo', monkeypatch) as (node, client):
        assert until(lambda: state(node).feedback is not None)
        execution = session('servo', client, node)
        assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
        assert execution.horizon == 0  # each pose counts as it comes
        end = execution.way.poses([execution.way.duration])[0]
        assert np.linalg.norm(state(node).gripper.position - end.position) < 0.01


@pytest.mark.sweep
def test_two_servos_carry_both_ends(own_domain, monkeypatch):
    with beside('two_arms'), launched('two_arms', monkeypatch) as (node, client):
        assert until(lambda: state(node).feedback is not None
                     and state(node).shape is not None and state(node).shape.holds)
        execution = session('two_arms', client, node)
        assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
        assert [one.name for one in execution.arms] == ['gripper', 'far_end']
        here = state(node).gripper.position, state(node).far_end.pose.position
        np.testing.assert_allclose(here, [(0.0, 0.1, 1.0), (0.32, 0.15, 1.0)], atol=0.01)


def test_a_tracker_tells_what_the_hose_is_like(own_domain, monkeypatch):
    there = (0.2693, 0.0233, 0.5043)  # m, where record.py says that the free end is
    with beside('tracker'), launched('tracker', monkeypatch) as (node, client):
        assert until(lambda: state(node).shape is not None)
        before = state(node).shape
        estimator = node.estimator
        assert until(lambda: (known := estimator._at[1]) is not None and known.estimate.looks > 15)
        session('tracker', client, node)
        rod = node.shared.store.state.scene.direct.rod
        assert until(lambda: state(node).shape.rod == rod)
        off = [np.linalg.norm(shape.positions[-1] - there) for shape in (before, state(node).shape)]
        assert off[0] > 0.03 and off[1] < 0.004
        assert 1.1 < node.get_parameter('rod.youngs_modulus').value / 8e6 < 1.4


@pytest.mark.parametrize('name', ['arm', 'servo', 'tracker'])
def test_each_readme_says_what_there_is(name):
    page = (EXAMPLES / name / 'README.md').read_text()
    for file in {*(EXAMPLES / name).iterdir()} - {EXAMPLES / name / '__pycache__'}:
        assert f'`{file.name}`' in page or file.name == 'README.md', file.name
    launches = re.findall(r'ros2 launch (\S+\.launch\.py) ?(.*)$', page, re.M)
    assert len(launches) == 2
    for path, line in launches:
        given = dict(one.split(':=') for one in line.split())
        assert started(ROOT / path, **given)
    steps = re.findall(r'^\d\. \*\*(.*?)\*\*', page, re.M)
    assert ' '.join(steps).startswith('Frames. Tool.') and 'Emergency stop.' in steps
    assert any(one.startswith('First without') for one in steps)
    for parameter in re.findall(r'`((?:\w+\.)+\w+)`', page):
        known = parameter in PARAMETERS or (EXAMPLES / name / parameter).exists()
        assert known, parameter


@contextmanager
def proved_arm(monkeypatch):
    """Yield arm, planner, client, and the command that executes the plan, which is proved."""
    with an_arm('/joint_trajectory_controller/joint_trajectory') as arm, launched(
            'arm', monkeypatch) as (node, client):
        assert until(lambda: state(node).pose is not None)
        plan, execute = (one for one in commands_of((EXAMPLES / 'arm' / 'README.md').read_text())
                         if one[0] == 'service call')
        assert not run_inside(client, node, *plan)
        assert until(lambda: state(node).proof.done, 10 * PATIENCE)
        yield arm, node, client, execute


def at_rest(arm):
    """Wait until an arm has stood for 50 samples; return its joints."""
    begun = len(arm.commands)

    def still():
        last = np.array([joints for _, joints in arm.commands[-50:]])
        return len(arm.commands) > begun + 50 and not np.ptp(last, axis=0).any()

    assert until(still)
    return arm.joints


def test_an_arm_that_is_not_heard_any_more_is_led_to_rest(own_domain, monkeypatch):
    with proved_arm(monkeypatch) as (arm, node, client, execute):
        there = state(node).pose
        assert until(client._pose_out.get_subscription_count)
        client.send_pose(Pose((0.0, 0.0, 3.0), (0, 0, 0, 1)))  # joint_states alone say that
        assert until(lambda: node.shared.statistics.report()[2]['poses refused'])
        assert np.abs(state(node).pose.matrix - there.matrix).max() < 1e-9
        assert not run_inside(client, node, *execute)
        assert until(lambda: state(node).execution.done > 1.0)
        arm.silent = True
        assert until(lambda: not state(node).executing)
        execution = state(node).execution
        assert (execution.phase, execution.cause) == ('stopped', Cause.GRIPPER_POSE_LOST)
        assert execution.reason.startswith('joint_states: the last one is')
        tool = node.streamer._drive.arm.pose(at_rest(arm))
        np.testing.assert_allclose(tool.matrix, execution.command.matrix, atol=1e-6)
        assert client.commands.empty()  # gripper_command is not for this robot


@pytest.mark.sweep
def test_an_arm_that_cannot_go_on_comes_to_rest_by_what_it_was_told(own_domain, monkeypatch):
    with proved_arm(monkeypatch) as (arm, node, client, execute):
        assert not run_inside(client, node, *execute)
        assert until(lambda: state(node).execution.done > 1.0)
        stream = node.streamer._drive.stream
        stream.arm = replace(stream.arm, self_clearance=0.08)  # as a correction may come upon it
        assert until(lambda: not state(node).executing)
        execution = state(node).execution
        assert (execution.phase, execution.cause) == ('stopped', Cause.ARM)
        assert 'come together' in execution.reason
        tool = stream.arm.pose(at_rest(arm))
        times = np.arange(0.0, execution.way.duration, 1e-3)
        places = np.array([pose.compose(node.shared.store.state.scene.tool.inverse()).position
                           for pose in execution.way.poses(times)])
        off = np.linalg.norm(places - tool.position, axis=1)
        assert off.min() < 1e-4 and 1.0 < times[np.argmin(off)] < execution.way.duration - 0.5


@pytest.mark.sweep
def test_a_closed_loop_lets_the_arm_rest_before_it_looks(own_domain, monkeypatch):
    with proved_arm(monkeypatch) as (arm, node, client, execute):
        clouds = client.node.create_publisher(PointCloud2, '/dlo_planner/observed_points', 10)
        rng, closed = np.random.default_rng(1), Event()

        def see():
            while not closed.wait(0.1):
                points = state(node).shape.positions
                clouds.publish(cloud_msg(points + 1e-3 * rng.normal(size=points.shape), 'world',
                                         client.node.get_clock().now().to_msg()))

        with closing(SimpleNamespace(close=closed.set)):
            Thread(target=see, daemon=True).start()
            assert until(lambda: (made := node.estimator._at[1]) and made.estimate.looks > 2)
            assert not run_inside(client, node, *execute)
            assert state(node).looking is not None
            assert until(lambda: arm.controller.taken)
            (_, times, states), = [arm.controller._points]
            assert len(times) == 1 and times[0] == pytest.approx(node.streamer._drive.stream
                                                                 ._settling, abs=1e-6)
            np.testing.assert_allclose(states[0][0], arm.joints, atol=1e-9)
            assert until(lambda: state(node).execution.phase == 'running', 2 * PATIENCE)
            assert until(lambda: arm.controller.taken > 2)
            assert client.trigger('cancel').success
            assert until(lambda: not state(node).executing)
        at_rest(arm)
        assert not arm.controller.refused


def test_an_arm_whose_controller_does_not_hear_is_not_led(own_domain, monkeypatch):
    with an_arm('/elsewhere') as arm, launched('arm', monkeypatch) as (node, client):
        assert until(lambda: state(node).pose is not None)
        _, execute = (one for one in commands_of((EXAMPLES / 'arm' / 'README.md').read_text())
                         if one[0] == 'service call')
        said = run_inside(client, node, *execute)
        assert said.startswith('420: ')
        assert 'nobody hears /joint_trajectory_controller/joint_trajectory' in said
        assert not arm.controller.taken
