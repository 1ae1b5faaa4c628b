# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node as its users meet it: a process of its own, reached over DDS."""

import queue

import numpy as np
import pytest
from nav_msgs.msg import Path
from planner_process import DEEPEST, PATIENCE, drain, first, newest
from visualization_msgs.msg import MarkerArray

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod
from dlo_planner.ros.lifecycle import LATCHED
from msg_helpers.trajectories import poses_from_path, times_from_path

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
GRIPPER = Pose.looking_along((0.1, -0.2, 1.0), (1.0, 0.3, 0.2))
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))


def test_pose_in_shape_out(client):
    path, _ = client.shape_for(GRIPPER)
    expected = DirectSimulator(WIRE).solve(GRIPPER)
    poses = poses_from_path(path)
    assert path.header.frame_id == 'world'
    assert {pose.header.frame_id for pose in path.poses} == {'world'}
    np.testing.assert_allclose([pose.position for pose in poses], expected.positions, atol=1e-8)
    np.testing.assert_allclose([pose.direction for pose in poses], expected.tangents, atol=1e-8)


def test_plan_by_service_is_published_and_stamped(client):
    drain(client.trajectories)
    path, _ = client.plan_threading(GRIPPER, GOAL)
    grippers = poses_from_path(path)
    expected = InverseSimulator(DirectSimulator(WIRE)).thread(
        CutOut(GOAL), start=GRIPPER, depths=np.linspace(0, DEEPEST, 25))
    np.testing.assert_allclose([pose.matrix for pose in grippers],
                               [pose.matrix for pose in expected.grippers], atol=1e-8)
    np.testing.assert_allclose(times_from_path(path), expected.times, atol=1e-6)
    assert newest(client.trajectories) == path


def test_shapes_go_on_during_a_plan(client):
    # a long plan is asked for; shapes must come while it is made, not only before and after
    client.set_parameters(threading__waypoints=2000)
    try:
        drain(client.trajectories)
        client.send_goal(GOAL)
        came = 0
        while client.trajectories.empty() and came < 1000:
            client.shape_for(GRIPPER)
            came += client.trajectories.empty()
        assert came >= 5
    finally:
        client.trajectories.get(timeout=2 * PATIENCE)
        client.set_parameters(threading__waypoints=25)


def test_latest_pose_wins_without_a_backlog(client):
    for k in range(500):
        client.send_pose(Pose((0.001 * k, 0, 1), (0, 0, 0, 1)))
    drain(client.shapes)
    last = [client.send_pose(Pose((9.0, 0, 1), (0, 0, 0, 1))) for _ in range(3)]
    before = []
    first(client.shapes, lambda shape: shape.header.stamp in last or before.append(shape))
    assert len(before) < 20  # what had not been overtaken


def test_late_comers_get_shape_plan_and_markers(client):
    client.shape_for(GRIPPER)
    client.plan_threading(GRIPPER, GOAL)
    received = queue.Queue()
    subscriptions = [client.node.create_subscription(kind, f'/dlo_planner/{name}', received.put,
                                                     LATCHED)
                     for kind, name in ((Path, 'predicted_shape'), (Path, 'gripper_trajectory'),
                                        (MarkerArray, 'markers'))]
    messages = [received.get(timeout=PATIENCE) for _ in subscriptions]
    for subscription in subscriptions:
        client.node.destroy_subscription(subscription)
    markers = next(message for message in messages if isinstance(message, MarkerArray)).markers
    kinds = {(marker.ns, marker.id) for marker in markers}
    assert {('dlo', 0), ('cutout', 0), ('trajectory', 0), ('gripper', 0)} <= kinds
    assert all(marker.pose.orientation.w == 1.0 or marker.ns == 'cutout' for marker in markers)
    tube = next(marker for marker in markers if marker.ns == 'dlo')
    assert len(tube.points) == len(tube.colors) == 65
    assert tube.scale.x == pytest.approx(1.5e-3)


def diagnostics(client, wanted=lambda status: True):
    """Return the first report that satisfies `wanted`, as (level, message, dict)."""
    drain(client.diagnostics)
    status = first(client.diagnostics, lambda msg: wanted(msg.status[0])).status[0]
    return status.level, status.message, {v.key: v.value for v in status.values}


def test_diagnostics_tell_rates_latencies_and_proof(client):
    for _ in range(3):
        client.shape_for(GRIPPER)
    client.plan_threading(GRIPPER, GOAL)
    _, _, values = diagnostics(client)
    assert float(values['shape residual']) < 1e-8
    assert float(values['shape stability']) > 0
    assert 0 < float(values['shape error estimate [m]']) < 1e-3
    assert float(values['latency median [ms]']) > 0
    assert float(values['plan largest miss [m]']) < 1e-8
    assert int(values['plans made']) >= 1


def test_tool_frame_is_taken_off_and_put_on(client):
    tool = Pose((0.0, 0.0, 0.1), (0, -np.sin(np.pi / 4), 0, np.cos(np.pi / 4)))  # x along tool z
    client.set_parameters(tool__position=list(tool.position),
                          tool__orientation=list(tool.quaternion))
    try:
        path, _ = client.predict_shape(GRIPPER)
        root = poses_from_path(path)[0]
        np.testing.assert_allclose(root.matrix, GRIPPER.compose(tool).matrix, atol=1e-9)
        plan, _ = client.plan_threading(GRIPPER, GOAL)
        ends = [pose.compose(tool) for pose in poses_from_path(plan)]
    finally:
        client.set_parameters(tool__position=[0.0] * 3, tool__orientation=[0.0, 0.0, 0.0, 1.0])
    shape = DirectSimulator(WIRE).solve(ends[0])
    np.testing.assert_allclose(shape.positions[-1], GOAL.position, atol=1e-8)


def test_reset_forgets_the_shape(client):
    # held level the wire is set by its own weight: afterwards it does not hang straight any more
    level, down = (Pose.looking_along((0, 0, 1), along) for along in ((1, 0, 0), (0, 0, -1)))

    def aside():
        """Return how far from below the gripper the free end hangs, m."""
        return np.linalg.norm(poses_from_path(client.shape_for(down)[0])[-1].position[:2])

    assert all(result.successful for result in client.set_parameters(
        rod__yield_stress=60e6, rod__hardening=0.1))  # without hardening it folds at the gripper
    try:
        client.shape_for(level)
        assert aside() > 0.1
        assert aside() > 0.1  # it stays so
        assert client.trigger('reset').success
        assert aside() < 1e-6
    finally:
        client.set_parameters(rod__yield_stress=0.0, rod__hardening=0.0)
