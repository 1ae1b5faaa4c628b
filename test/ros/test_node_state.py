# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node in this process: nothing is lost, planning ends when asked to, clocks may jump."""

import threading
import time

import numpy as np
import pytest
from follower import Follower
from geometry_msgs.msg import PoseStamped
from node_inside import GOAL, HERE, box, clear, state
from planner_process import PATIENCE, drain, first, until
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool
from streams import largest
from visualization_msgs.msg import MarkerArray

from dlo_planner.execute.causes import Cause
from dlo_planner.ros.plan import make_plan
from msg_helpers.poses import pose_from_msg, pose_msg


def test_of_obstacles_and_parameters_sent_at_once_none_is_lost(inside, node):
    rng, number = np.random.default_rng(5), 60
    pauses = rng.uniform(0, 4e-3, (2, number))

    def send_obstacles():
        for k, pause in enumerate(pauses[0]):
            inside._obstacles_out.publish(MarkerArray(markers=[box(k, 3 + 0.2 * k)]))
            time.sleep(pause)

    sending = threading.Thread(target=send_obstacles)
    sending.start()
    not_in_force = 0
    for k, pause in enumerate(pauses[1]):
        value = 0.05 + 1e-4 * k
        assert inside.set_parameters(threading__linear_speed=value)[0].successful
        not_in_force += state(node).scene.limits.linear_speed != value
        time.sleep(pause)
    sending.join()
    assert until(lambda: len(state(node).scene.bodies) == number)
    assert not_in_force == 0
    assert len(state(node).scene.direct.obstacles) == number
    assert set(state(node).scene.bodies) == {('cell', k) for k in range(number)}
    clear(inside, node)
    inside.set_parameters(threading__linear_speed=0.1)


def test_obstacles_that_come_again_unchanged_change_nothing(inside, node):
    inside.send_obstacles([box(1)])
    assert until(lambda: state(node).scene.bodies)
    inside.plan_threading(HERE, GOAL)
    made = state(node).planned
    for _ in range(3):
        inside.send_obstacles([box(1)])
    time.sleep(0.2)
    assert state(node).planned is made
    inside.send_obstacles([box(1, x=3.5)])
    assert until(lambda: state(node).planned is None)
    answer = inside.trigger('execute')
    assert not answer.success and 'obstacles changed (cell/1)' in answer.message
    clear(inside, node)


@pytest.fixture
def long_plan(inside):
    """Let plans take long."""
    inside.set_parameters(threading__waypoints=10_000)
    yield
    inside.set_parameters(threading__waypoints=12, threading__planning_deadline=60.0)


@pytest.fixture
def held_plan(monkeypatch):
    """Return two Events: the next plan is about to be made, and may be."""
    begun, go = threading.Event(), threading.Event()

    def made(*arguments):
        begun.set()
        go.wait(PATIENCE)
        return make_plan(*arguments)

    monkeypatch.setattr('dlo_planner.ros.plan.make_plan', made)
    yield begun, go
    go.set()


def test_cancel_ends_the_planning(inside, node, long_plan):
    inside.send_goal(GOAL)
    assert until(lambda: node.planning_server._job is not None)
    answer = inside.trigger('cancel')
    assert answer.success and 'planning ends' in answer.message
    code, message, _ = inside.status_of('task_goal')
    assert code == Cause.PLANNING_CANCELED and 'canceled' in message
    assert not inside.trigger('cancel').success


def test_planning_has_a_deadline(inside, node, long_plan):
    assert inside.set_parameters(threading__planning_deadline=0.2)[0].successful
    assert inside.plan_threading(HERE, GOAL)[0].poses == []
    code, message, _ = inside.status_of('plan_threading')
    assert code == Cause.PLANNING_DEADLINE
    assert 'threading.planning_deadline = 0.2 s' in message


def test_compiling_counts_for_no_deadline(inside, node, long_plan):
    assert inside.set_parameters(threading__planning_deadline=0.2)[0].successful
    for thread in threading.enumerate():
        if thread.name == 'loading':  # which says at its end that nothing has to be compiled
            thread.join(PATIENCE)
    node.loading.set()
    inside.send_goal(GOAL)
    assert until(lambda: node.planning_server._job is not None)
    assert not until(lambda: node.planning_server._job is None, 0.4)  # it takes about a second
    node.loading.clear()
    code, message, _ = inside.status_of('task_goal')
    assert code == Cause.PLANNING_DEADLINE and 'threading.planning_deadline = 0.2 s' in message


def test_a_plan_of_a_scene_that_changed_meanwhile_is_refused(inside, node, held_plan):
    begun, go = held_plan
    inside.send_goal(GOAL)
    assert begun.wait(PATIENCE)
    inside.send_obstacles([box(1)])
    assert until(lambda: state(node).scene.bodies)
    go.set()
    assert inside.status_of('task_goal')[0] == Cause.SCENE_CHANGED
    clear(inside, node)


def test_a_proof_whose_process_is_killed_is_made_again(inside, node):
    inside.plan_threading(HERE, GOAL)
    made = state(node).planned
    assert until(lambda: state(node).proof.report is not None)  # the motion is being made
    time.sleep(0.2)
    node._prover._process.kill()
    assert until(lambda: state(node).planned is made and state(node).proof.done)
    assert state(node).proof.safe


@pytest.fixture
def simulated_time(inside, node):
    """Yield a function that publishes /clock; node and inside live by it, the clock at 100 s."""
    out = inside.node.create_publisher(Clock, '/clock', 10)
    parameter = Parameter('use_sim_time', value=True)

    def tell(seconds):
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = int(seconds), int(1e9 * (seconds % 1))
        out.publish(msg)

    node.set_parameters([parameter])
    inside.node.set_parameters([parameter])
    yield tell
    for one in (node, inside.node):
        one.set_parameters([Parameter('use_sim_time', value=False)])
    inside.node.destroy_publisher(out)


def test_without_a_clock_plans_are_proved_and_diagnostics_come(inside, node, simulated_time):
    path, _ = inside.plan_threading(HERE, GOAL)
    assert inside.proof(path)['report'] == 'held'
    assert len(inside.shape_for(HERE)[0].poses) == 65


@pytest.mark.every(2)
@pytest.mark.parametrize('jump', [5.0, -60.0])
def test_a_clock_that_jumps_makes_no_leap(inside, node, simulated_time, jump):
    inside.set_parameters(execute__horizon=0.0)
    begun, shift = time.monotonic(), [100.0]
    ended = threading.Event()

    def tick():
        while not ended.wait(0.01):
            simulated_time(shift[0] + time.monotonic() - begun)

    ticking = threading.Thread(target=tick)
    ticking.start()
    robot = Follower(inside.node, inside.planner, HERE)
    try:
        assert until(lambda: min(one.get_clock().now().nanoseconds
                                 for one in (node, inside.node)) > 1e11)
        path, _ = inside.plan_threading(HERE, GOAL)
        robot.put(pose_from_msg(path.poses[0].pose))
        assert inside.proof(path)['report'] == 'held'
        drain(inside.commands)
        drain(inside.executions)
        code, message, _ = inside.execute(path)
        assert code == 0, message
        assert until(lambda: inside.commands.qsize() > 60)
        shift[0] += jump
        assert until(lambda: inside.commands.qsize() > 120)  # it goes on
        inside.trigger('cancel')
        inside.execution_in('stopped')
    finally:
        ended.set()
        ticking.join()
        robot.close()
        inside.set_parameters(execute__horizon=1.0)
    places = np.array([pose_from_msg(one.pose).position for one in drain(inside.commands)])
    ran = state(node).execution.way
    way = [pose.position for pose in ran.at(np.arange(0, ran.duration, 0.02))[0]]
    regular = np.linalg.norm(np.diff(way, axis=0), axis=1).max()
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= 1.2 * regular


def test_execution_is_on_diagnostics_and_on_its_topic(inside, node):
    robot = Follower(inside.node, inside.planner, HERE)
    try:
        path, _ = inside.plan_threading(HERE, GOAL)
        robot.put(pose_from_msg(path.poses[0].pose))
        inside.proof(path)
        begun = time.monotonic()
        assert inside.execute(path)[0] == 0
        said = [float(inside.execution_in('running')[2]['progress [%]']) for _ in range(6)]
        assert 0 <= said[0] < said[-1] < 100 and said == sorted(said)
        left = len(drain(inside.executions))
        assert len(said) + left <= 2 + (time.monotonic() - begun) / 0.2  # five a second at most
        status = first(inside.diagnostics, lambda msg: msg.status[1].message == 'running').status[1]
        assert status.name.endswith(': execution')
        inside.trigger('cancel')
        inside.execution_in('stopped')

        def execution(msg):
            return {v.key: v.value for v in msg.status[1].values}

        msg = first(inside.diagnostics, lambda msg: execution(msg)['state'] == 'stopped')
        assert execution(msg)['cause'] == 'CANCELED'
    finally:
        robot.close()


def test_it_moves_only_while_somebody_allows_it(inside, node):
    inside.set_parameters(execute__enable_timeout=1.0)
    out = inside.node.create_publisher(Bool, f'{inside.planner}/enable', 1)
    allows = inside.node.create_timer(0.05, lambda: out.publish(Bool(data=True)))
    robot = Follower(inside.node, inside.planner, HERE)
    try:
        path, _ = inside.plan_threading(HERE, GOAL)
        robot.put(pose_from_msg(path.poses[0].pose))
        inside.proof(path)
        assert until(lambda: state(node).enabled is not None)
        allows.cancel()
        out.publish(Bool(data=False))
        assert until(lambda: not state(node).enabled.value)
        code, message, _ = inside.execute(path)
        assert code == 416 and 'enable: it is false' in message
        allows.reset()
        assert until(lambda: state(node).enabled.value)
        assert inside.execute(path)[0] == 0
        inside.execution_in('running')
        allows.cancel()
        code, message, _ = inside.execution_in('stopped')
        assert code == 416 and 'execute.enable_timeout = 1 s' in message
        assert largest(robot.told, state(node).scene.limits, 0.02) <= 1.01
    finally:
        inside.node.destroy_timer(allows)
        inside.node.destroy_publisher(out)
        robot.close()
        inside.set_parameters(execute__enable_timeout=0.0)


def test_a_pose_without_a_stamp_is_predicted_but_not_executed_from(inside, node):
    msg = PoseStamped()
    msg.header.frame_id, msg.pose = 'world', pose_msg(HERE)
    heard = state(node).feedback
    before = state(node).shape
    inside._pose_out.publish(msg)
    assert until(lambda: state(node).shape is not before)
    first(inside.shapes, lambda shape: shape.header.stamp.sec == 0)
    assert state(node).feedback is heard and state(node).pose == HERE
