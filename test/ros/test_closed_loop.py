# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The closed loop in the node: a tracker's points in, identified parameters and corrections out."""

import queue
from contextlib import suppress

import numpy as np
import pytest
from closed_loops import Touching, Truth
from diagnostic_msgs.msg import DiagnosticStatus
from follower import Follower
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from node_inside import Alive, state
from planner_process import PATIENCE, ROOM, connected_client, drain, first, until
from rclpy.exceptions import InvalidHandle
from sensor_msgs.msg import PointCloud2

from dlo_planner import Capsule, CutOut, Pose, Rod, Uncertainty
from dlo_planner.execute.causes import Cause
from dlo_planner.penalties import Through
from dlo_planner.ros.lifecycle import ALL_LATCHED, LATEST, REQUEST
from msg_helpers.clouds import cloud_msg
from msg_helpers.diagnostics import WARN
from msg_helpers.obstacles import obstacles_msg
from msg_helpers.poses import pose_stamped_msg

# short and stiff: it is threaded within seconds
WIRE = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
START = Pose.looking_along((-0.36, -0.1, 1.02), (1, 0, 0))
SPREAD = Uncertainty(0.05, 0.05, 0.02, natural_curvature=0.3, gripper_position=5e-4,
                gripper_rotation=3.5e-3)
OVERRIDES = {'rod.length': 0.3, 'rod.diameter': 1e-3, 'diagnostics_period': 0.1,
             'threading.waypoints': 12, 'threading.deepest': 0.35, 'threading.standoff': 0.02,
             'threading.linear_speed': 0.1, 'threading.angular_speed': 1.0,
             # wide: on a busy machine commands come late, which counts before the entry
             'threading.tolerance': 1e-3, 'cutouts.radius': 1.0,
             **ROOM,
             'observe.noise': 3e-4, 'observe.period': 0.05, 'observe.correction_period': 0.2,
             'observe.largest_correction': 0.05,  # the first ones are larger: few looks are behind
             'spread.natural_curvature': 0.3, 'spread.curvature_variation': 0.0}


@pytest.fixture(scope='module')
def client(node):
    with connected_client(Alive()) as connected:
        yield connected


@pytest.fixture
def robot(client):
    robot = Follower(client.node, '/dlo_planner', START, rate=100.0)
    yield robot
    robot.close()


class Tracker:
    """Publishes points of a true DLO that hangs in the robot's gripper."""

    def __init__(self, client, robot, truth):
        self._client, self._robot, self._truth = client, robot, truth
        self._rng = np.random.default_rng(3)
        self.out = client.node.create_publisher(PointCloud2, '/dlo_planner/observed_points', LATEST)
        self._timer = client.node.create_timer(1 / 15, self.publish)

    def publish(self):
        shape = self._truth.shape(self._robot._pose)
        points = shape.positions_at(np.linspace(0, 1, 20) * shape.s[-1])
        points += 3e-4 * self._rng.standard_normal(points.shape)
        with suppress(InvalidHandle):  # closed meanwhile, by another thread
            self.out.publish(cloud_msg(points, 'world',
                                       self._client.node.get_clock().now().to_msg()))

    def close(self):
        self._client.node.destroy_timer(self._timer)
        self._client.node.destroy_publisher(self.out)


@pytest.fixture
def truth():
    return Truth.drawn(np.random.default_rng(8), WIRE, SPREAD)


@pytest.fixture
def tracker(client, robot, truth):
    tracker = Tracker(client, robot, truth)
    yield tracker
    tracker.close()


def values(client):
    drain(client.diagnostics)
    msg = client.diagnostics.get(timeout=PATIENCE)
    return {item.key: item.value for item in msg.status[0].values}


@pytest.fixture
def restored(client, node):
    """Give back the parameters that are changed, and forget what was seen."""
    before = dict(state(node).scene.values)
    yield before
    changed = {name.replace('.', '__'): value for name, value in state(node).scene.values.items()
               if value != before[name]}
    if changed:
        client.set_parameters(**changed | {name: before[name.replace('__', '.')]
                                           for name in changed})
    client.trigger('reset')


def test_nothing_seen_nothing_identified(client):
    client.trigger('reset')
    answer = client.trigger('identify')
    assert not answer.success
    assert 'nothing of the DLO was seen since ~/reset' in answer.message
    assert client.status_of('identify')[0] == Cause.NOTHING_SEEN


def test_what_is_seen_is_identified_and_counts_from_then_on(client, node, tracker, truth, restored):
    def looks():
        return node.shared.statistics.report()[2].get('estimate looks', 0)

    assert until(lambda: looks() >= 30)
    before = np.abs(state(node).scene.direct.solve(START).positions[-1]
                    - truth.shape(START).positions[-1]).max()
    answer = client.trigger('identify')
    assert answer.success, answer.message
    assert 'natural curvature about ' in answer.message
    scene = state(node).scene
    assert state(node).scene.values['rod.youngs_modulus'] != restored['rod.youngs_modulus']
    after = scene.direct.solve(START.compose(scene.tool)).positions[-1]
    assert np.abs(after - truth.shape(START).positions[-1]).max() < 0.2 * before
    assert until(lambda: looks() < 30)  # the new DLO is observed anew


@pytest.mark.sweep
def test_an_execution_is_corrected_by_what_is_seen(client, node, robot, tracker, truth, restored):
    assert until(lambda: int(values(client).get('estimate looks', 0)) >= 10)
    path, _ = client.plan_threading(START, HOLE.pose)
    assert client.proof(path)['report'] == 'held'
    plan = state(node).planned.plan
    answer = client.trigger('execute')
    assert answer.success, answer.message
    assert 'it observes the DLO before it goes' in answer.message
    assert client.execution_in('waiting', timeout=PATIENCE)[2]['loop'] in ('look', 'plan')
    _, said, told = client.execution_in('succeeded', 'stopped', timeout=2 * PATIENCE)
    assert told['state'] == 'succeeded', said
    assert int(values(client)['corrections']) >= 1
    last = state(node).execution.command
    assert until(lambda: np.allclose(robot._pose.matrix, last.matrix, atol=1e-6))
    center, *_ = plan.via_points[-1][0]
    missed = [np.linalg.norm(Through(center).residuals(truth.shape(gripper)))
              for gripper in (plan.grippers[-1], robot._pose)]
    assert missed[1] < 1e-3 < 0.5 * missed[0]


@pytest.mark.sweep
def test_a_contact_is_held_as_what_is_seen_says(client, node, robot, truth, restored):
    bar, above = Capsule((0.0, -0.1, 0.98), (0.0, 0.1, 0.98), 0.02, 0.3), Pose.looking_along(
        (-0.2, 0.0, 1.24), (1.0, 0.0, 0.2))
    contact, true = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)), Touching(truth, bar)
    client._obstacles_out.publish(obstacles_msg([bar], 'world'))
    client.set_parameters(contacts__tolerance=3e-3,
                          task='{type: HoldContact, s: 0.2, condition: least_force}')
    robot.put(above)
    tracker = Tracker(client, robot, true)
    try:
        assert until(lambda: int(values(client).get('estimate looks', 0)) >= 10)
        request = GetPlan.Request(start=pose_stamped_msg(above, 'world'),
                                  goal=pose_stamped_msg(contact, 'world'))
        path = client._call(GetPlan, 'plan_hold_contact', request)[0].plan
        proof = client.proof(path)
        assert proof['report'] == 'held', proof['report reason']
        answer = client.trigger('execute')
        assert answer.success, answer.message
        assert 'it observes the DLO before it goes' in answer.message
        _, said, told = client.execution_in('succeeded', 'stopped', timeout=2 * PATIENCE)
        assert told['state'] == 'succeeded', said
    finally:
        tracker.close()
        client._obstacles_out.publish(obstacles_msg([], 'world'))
    last = state(node).execution.command
    assert until(lambda: np.allclose(robot._pose.matrix, last.matrix, atol=1e-6))
    shape = true.shape(robot._pose)
    axes, place = shape.frame_at(0.2)
    across = axes[:, 1:].T @ (place - contact.position - (0, 0, WIRE.radius))
    assert shape.contacts
    assert np.linalg.norm(across) < float(told['expected miss [m]']) < 3e-3


def test_a_cutout_that_is_seen_counts_for_the_plan_through_it(client, node, restored):
    out = client.node.create_publisher(PoseStamped, '/dlo_planner/observed_cutout', REQUEST)
    off = np.array([0.0, 2e-3, 1e-3])

    def seen(off):
        stamp = client.node.get_clock().now().to_msg()
        out.publish(pose_stamped_msg(Pose(HOLE.center + off, (0, 0, 0, 1)), 'world', stamp))

    def shift():
        seen(off)
        estimate = node.estimator._observing_of(state(node)).estimate
        return estimate.moved_cutout(HOLE).center - HOLE.center

    try:
        assert until(out.get_subscription_count)
        client.plan_threading(START, HOLE.pose)
        assert until(lambda: seen(off) or 'observe.cutout = 0' in values(client)['last error'])
        assert until(lambda: not np.any(shift()))
        # a camera that is where it is stated: all that the cut-out is off is its own
        client.set_parameters(observe__cutout=2e-3, observe__bias=0.0, observe__camera_rotation=0.0)
        assert until(lambda: np.allclose(shift(), off, atol=1e-4))
        assert until(lambda: seen(50 * off) or 'the cut-out was seen 0.112 m from'
                     in values(client)['last error'])
        assert until(lambda: np.allclose(shift(), off, atol=1e-4))
        other = Pose(HOLE.center + (0, 0, 5e-3), HOLE.pose.quaternion)
        client.plan_threading(START, other)  # what is seen now is off by as much from that
        assert until(lambda: np.allclose(shift(), off - (0, 0, 5e-3), atol=1e-4))
    finally:
        client.node.destroy_publisher(out)


def test_where_nobody_looks_it_says_so_and_stops_before_a_hole_that_the_dlo_may_miss(
        client, node, robot, truth, restored):
    client.set_parameters(cutouts__radius=1.5e-3)
    path, _ = client.plan_threading(START, HOLE.pose)
    assert client.proof(path)['report'] == 'held'
    said = queue.Queue()
    ear = client.node.create_subscription(DiagnosticStatus, '/dlo_planner/status', said.put,
                                          ALL_LATCHED)
    code, message, _ = client.execute(path)
    tracker = Tracker(client, robot, truth)  # what is seen comes too late to correct anything
    try:
        assert code == 0 and 'in open loop: no cloud of the DLO was taken in' in message, message
        told = first(said, lambda msg: msg.name.endswith(': execute') and msg.message == message)
        assert told.level == WARN
        code, reason, values = client.execution_in('stopped', 'succeeded', timeout=PATIENCE)
    finally:
        tracker.close()
        client.node.destroy_subscription(ear)
    assert code == Cause.MISS_EXPECTED, reason
    assert 'the room of 0.001 m' in reason and values['state'] == 'stopped'
    assert (truth.shape(robot._pose).positions[-1] - HOLE.center) @ HOLE.normal < 0


def test_clouds_that_make_no_sense_are_refused_and_named(client, node, robot, truth):
    tracker = Tracker(client, robot, truth)
    try:
        for msg, said in (
                (cloud_msg(np.ones((5, 3)), 'camera'), "'camera': expected 'world'"),
                (cloud_msg(np.ones((2, 3)), 'world'), 'observed_points has 2 points'),
                (PointCloud2(), 'header.frame_id')):
            msg.header.stamp = client.node.get_clock().now().to_msg()
            assert until(lambda: tracker.out.publish(msg) or said in values(client)['last error'])  # noqa: B023
    finally:
        tracker.close()
