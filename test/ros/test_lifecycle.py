# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node is managed: what it offers in which state, and how it comes there."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from planner_here import Witness, opened, planner_here
from planner_process import PATIENCE, until
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray
from wires import threaded

from dlo_planner import Limits, Pose, Trajectory
from dlo_planner.execute.causes import Cause
from dlo_planner.execute.execution import Execution, Feedback, Guards
from dlo_planner.ros import node as planner
from dlo_planner.ros.lifecycle import CHANGES, LATCHED
from msg_helpers.poses import pose_from_msg, pose_msg, pose_stamped_msg

LEVEL = Pose((0.0, 0.0, 1.0), (0, 0, 0, 1))
NAME = '/dlo_planner'
OWN = {f'{NAME}/{name}' for name in ('execute', 'cancel', 'replan', 'reset', 'plan_threading',
                                     'plan_two_cutouts', 'predict_shape')}


@pytest.fixture
def witness(context):
    witness = Witness(context)
    yield witness
    witness.close()


def change(witness, transition):
    """Ask for a transition by its label; return whether it was done."""
    request = ChangeState.Request(transition=Transition(label=transition))
    return witness.ask(ChangeState, f'{NAME}/change_state', request).success


def state(witness):
    return witness.ask(GetState, f'{NAME}/get_state').current_state.label


def shape_comes(witness, shapes, publisher):
    """Return whether poses are answered by shapes; they are sent again, as by a robot."""
    shapes.clear()

    def came():
        stamp = witness.node.get_clock().now().to_msg()
        publisher.publish(pose_stamped_msg(LEVEL, 'world', stamp))
        return bool(shapes)

    return witness.wait_for(came)


def test_a_manager_takes_it_through_all_states(monkeypatch, context, witness):
    with planner_here(monkeypatch, context, '-p', 'autostart:=false',
                      diagnostics_period=0.05) as node:
        shapes = witness.hear(Path, f'{NAME}/predicted_shape', LATCHED)
        reports = witness.hear(DiagnosticArray, '/diagnostics')
        poses = witness.node.create_publisher(PoseStamped, f'{NAME}/gripper_pose',
                                              qos_profile_sensor_data)

        def reported(text):
            reports.clear()
            return witness.wait_for(lambda: any(
                one.status[0].message.startswith(text) for one in reports))

        assert state(witness) == 'unconfigured'
        assert opened(node, 'service') & OWN == set()
        assert reported('not active: unconfigured')
        assert not change(witness, 'activate')

        for _ in range(2):  # and all over again
            assert change(witness, 'configure') and state(witness) == 'inactive'
            assert witness.wait_for(lambda: opened(node, 'service') >= OWN)
            answer = witness.ask(Trigger, f'{NAME}/reset')
            assert not answer.success and 'not active' in answer.message
            request = GetPlan.Request(start=pose_stamped_msg(LEVEL, 'world'))
            assert witness.ask(GetPlan, f'{NAME}/predict_shape', request).plan.poses == []
            assert reported('not active: inactive')

            assert change(witness, 'activate') and state(witness) == 'active'
            assert witness.ask(Trigger, f'{NAME}/reset').success
            assert len(witness.ask(GetPlan, f'{NAME}/predict_shape', request).plan.poses) == 65
            assert shape_comes(witness, shapes, poses)
            assert reported('ready')

            assert change(witness, 'deactivate') and state(witness) == 'inactive'
            unheard = pose_stamped_msg(LEVEL, 'world')
            unheard.header.stamp.sec = 77
            for _ in range(3):
                poses.publish(unheard)
                assert not witness.wait_for(
                    lambda: 77 in [one.header.stamp.sec for one in shapes], 0.1)
            assert change(witness, 'cleanup') and state(witness) == 'unconfigured'
            assert witness.wait_for(lambda: not opened(node, 'service') & OWN)
            assert not any(name.startswith(f'{NAME}/predicted') for name in opened(
                node, 'publisher'))
        assert change(witness, 'shutdown') and state(witness) == 'finalized'


def test_parameters_are_judged_when_it_is_configured(monkeypatch, context, witness):
    def set_section(value):
        request = SetParameters.Request(parameters=[
            Parameter('rod.section', value=value).to_parameter_msg()])
        return witness.ask(SetParameters, f'{NAME}/set_parameters', request).results[0].successful

    with planner_here(monkeypatch, context, autostart=False):
        assert set_section('oval')
        assert not change(witness, 'configure') and state(witness) == 'unconfigured'
        assert set_section('tube')
        assert change(witness, 'configure') and change(witness, 'activate')
        assert not set_section('oval')  # from now on, at once


def test_obstacles_are_heard_in_every_state(monkeypatch, context, witness):
    marker = Marker(ns='cell', id=1, type=Marker.CUBE, pose=pose_msg(LEVEL))
    marker.header.frame_id = 'world'
    marker.scale.x = marker.scale.y = marker.scale.z = 0.2
    latched = witness.node.create_publisher(MarkerArray, f'{NAME}/obstacles', LATCHED)
    latched.publish(MarkerArray(markers=[marker]))  # before there is anybody to hear it
    with planner_here(monkeypatch, context, autostart=False) as node:
        markers = witness.hear(MarkerArray, f'{NAME}/markers', LATCHED)
        assert change(witness, 'configure')
        assert witness.wait_for(lambda: node.shared.store.state.scene.bodies)
        assert change(witness, 'activate')
        assert witness.wait_for(lambda: markers)  # they are drawn as soon as it may
        assert {one.ns for one in markers[-1].markers} == {'obstacle'}


def test_nothing_is_seen_before_it_is_ready_but_that_it_starts(monkeypatch, context, witness):
    go = threading.Event()
    reports = witness.hear(DiagnosticArray, '/diagnostics')
    made = []

    def make():
        with planner_here(monkeypatch, context, warm_up=lambda: go.wait(2 * PATIENCE),
                          diagnostics_period=0.05):
            made.append(True)

    thread = threading.Thread(target=make)
    thread.start()
    try:
        assert witness.wait_for(lambda: len(reports) > 2)
        status = reports[-1].status[0]
        assert status.message.startswith('starting') and status.name == 'dlo_planner: solver'
        assert status.level == DiagnosticStatus.WARN
        assert not {name for name, _ in witness.node.get_topic_names_and_types()
                    if name.startswith(NAME)}
        services = {name for name, _ in witness.node.get_service_names_and_types()}
        assert {name for name in services if name.startswith(NAME)} <= {
            f'{NAME}/get_type_description'}
        assert not made
    finally:
        go.set()
        thread.join(2 * PATIENCE)
    assert made


def test_shapes_come_while_the_rest_of_the_solver_is_compiled(monkeypatch, context, witness):
    go = threading.Event()
    asked = []

    def compiles(worker, call, **_):
        asked.append(call)
        assert go.wait(PATIENCE)

    monkeypatch.setattr(planner.Worker, 'result', compiles)
    with planner_here(monkeypatch, context) as node:
        try:
            shapes = witness.hear(Path, f'{NAME}/predicted_shape', LATCHED)
            out = witness.node.create_publisher(PoseStamped, f'{NAME}/gripper_pose', 10)
            assert shape_comes(witness, shapes, out)
            assert node.lifecycle_state == 'active' and len(asked) == 1
        finally:
            go.set()


@pytest.mark.every(2)
@pytest.mark.parametrize('limits', [Limits(), Limits(linear_acceleration=0.06)],
                         ids=['quickly', 'slowly'])
def test_a_motion_comes_to_rest_before_it_is_inactive(monkeypatch, context, witness, limits):
    plan = threaded()
    way = Trajectory(plan, limits, tolerance=np.inf)
    speeds = np.linalg.norm(way.at(np.linspace(0, way.duration, 999))[1][:, :3], axis=1)
    fast = 50 * way.duration * np.argmax(speeds > 0.95 * speeds.max()) / 998  # commands until it is
    unguarded = Guards(path_position=0.0, path_angle=0.0, incoming_command_timeout=0.0,
                       longest_pause=0.0)
    execution = Execution(way, Pose.identity(), 'world', unguarded, 0.02)
    with planner_here(monkeypatch, context) as node:
        commands = witness.hear(PoseStamped, f'{NAME}/gripper_command', CHANGES)
        assert witness.wait_for(lambda: node.count_subscribers(f'{NAME}/gripper_command'))
        heard = Feedback(plan.grippers[0], time.monotonic())
        node.shared.store.change(lambda now: replace(now, execution=execution, feedback=heard))
        node.streamer._finished = False
        node.streamer._timer.reset()
        assert witness.wait_for(lambda: len(commands) > fast)
        assert change(witness, 'deactivate')
        number = -1
        while len(commands) > number:  # what was sent may be late to be heard
            number = len(commands)
            witness.wait_for(lambda: False, 0.5)
        assert number < 50 * way.duration
        steps = np.linalg.norm(np.diff([pose_from_msg(one.pose).position for one in commands],
                                       axis=0), axis=1)
        regular = 0.02 * speeds.max()
        assert 0.5 * regular < steps.max() <= 1.2 * regular  # no jump
        assert steps[-1] < 0.05 * regular
        assert node.shared.store.state.execution.cause == Cause.SHUTDOWN


def test_names_and_namespaces_go_everywhere(monkeypatch, context):
    with planner_here(monkeypatch, context, '-r', '__ns:=/cell1', '-r', '__node:=hose') as node:
        robot = {'joint_states', 'robot_description', 'robot_description_semantic'}
        shared = {'/diagnostics', '/parameter_events', '/rosout',
                  *(f'/cell1/{name}' for name in robot)}
        assert until(lambda: shared == {  # the graph may be late to know
            name for kind in ('publisher', 'subscriber', 'service') for name in opened(node, kind)
            if not name.startswith('/cell1/hose/')})


def test_an_unexpected_error_leaves_it_unconfigured_and_alive(monkeypatch, context, witness):
    with planner_here(monkeypatch, context, autostart=False) as node:
        monkeypatch.setattr(node, 'activate', lambda: 1 / 0)
        assert change(witness, 'configure')
        assert not change(witness, 'activate')
        assert state(witness) == 'unconfigured'
        monkeypatch.undo()
        assert change(witness, 'configure') and change(witness, 'activate')
