# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node in a cell: obstacles, the way to the hole, proof, execution, a DLO that yields."""

import signal
import time

import numpy as np
import pytest
from follower import Follower
from nav_msgs.srv import GetPlan
from planner_process import drain, first, quiet, steps, under_way, until
from rclpy.node import Node
from scipy.interpolate import CubicSpline
from streams import largest
from visualization_msgs.msg import Marker

from dlo_planner import DirectSimulator, Limits, Pose, Rod
from msg_helpers.poses import pose_from_msg, pose_msg
from msg_helpers.trajectories import poses_from_path

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
AWAY = Pose.looking_along((-1.3, 0.2, 1.1), (1.0, 0.2, 0.1))
LEVEL = Pose((0.0, 0.0, 1.0), (0, 0, 0, 1))


def cube(height, number=0, frame='world', kind=Marker.CUBE, action=Marker.ADD):
    marker = Marker(ns='cell', id=number, type=kind, action=action)
    marker.header.frame_id = frame
    marker.pose = pose_msg(Pose((0.8, 0.0, height), (0, 0, 0, 1)))
    marker.scale.x = marker.scale.y = marker.scale.z = 0.2
    return marker


def status(client, wanted):
    """Return the values of the first report that satisfies `wanted`, and its message."""
    def read(msg):
        return {v.key: v.value for v in msg.status[0].values}, msg.status[0].message

    drain(client.diagnostics)
    return read(first(client.diagnostics, lambda msg: wanted(*read(msg))))


def times_and_transforms(timed):
    """Return times (n,) s and positions and quaternions (n, 7) of a timed trajectory."""
    rows = [(p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec, p.transforms[0])
            for p in timed.points]
    return np.array([time for time, _ in rows]), np.array([
        (t.translation.x, t.translation.y, t.translation.z,
         t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w) for _, t in rows])


def tip(client, pose):
    return poses_from_path(client.predict_shape(pose)[0])[-1].position


def test_obstacles_come_and_go(client):
    free = tip(client, LEVEL)
    client.send_obstacles([cube(free[2])])
    assert until(lambda: not np.allclose(tip(client, LEVEL), free))
    shape = np.array([p.position for p in poses_from_path(client.predict_shape(LEVEL)[0])])
    over = np.abs(shape[:, 0] - 0.8) < 0.1
    assert over.any() and shape[over, 2].min() > free[2] + 0.1  # on top of it, or before it
    drain(client.diagnostics)
    client.send_obstacles([cube(0.5, 1, frame='map')])
    assert 'expected \'world\'' in status(client, lambda _, m: 'obstacles refused' in m)[1]
    client.send_obstacles([cube(0.5, 1, kind=Marker.TEXT_VIEW_FACING)])
    said = status(client, lambda _, m: 'markers[0]: type' in m)[1]
    assert 'CUBE, SPHERE, CYLINDER, ARROW (a plane), TRIANGLE_LIST or MESH_RESOURCE' in said
    client.send_obstacles([cube(0, action=Marker.DELETEALL)])
    until(lambda: np.allclose(tip(client, LEVEL), free))
    np.testing.assert_allclose(tip(client, LEVEL), free, atol=1e-9)


@pytest.fixture
def robot(client):
    """Yield a robot that stands where the plan begins, and follows."""
    follower = Follower(client.node, client.planner, AWAY)
    yield follower
    follower.close()


@pytest.fixture
def begun(client, robot):
    """Plan from where the gripper is; yield the Path."""
    client.set_parameters(threading__standoff=0.05, cutouts__radius=0.01,
                          rod__damping=[0.5, 0.01])
    client.shape_for(AWAY)
    path, _ = client.plan_threading(AWAY, GOAL)
    yield path
    if 'execution' in client.trigger('cancel').message:  # and not only a proof
        client.execution_in('stopped')
    client.set_parameters(threading__standoff=0.0, cutouts__radius=0.0, rod__damping=[0.0, 0.0])


def test_a_plan_begins_where_the_gripper_is_is_proved_and_goes_from_there_alone(
        client, robot, begun):
    grippers = poses_from_path(begun)
    np.testing.assert_allclose(grippers[0].matrix, AWAY.matrix, atol=1e-9)
    assert len(grippers) > 25
    simulator = DirectSimulator(WIRE)
    for shape in simulator.track(grippers)[:len(grippers) - 25]:
        assert shape.positions[:, 0].max() < -WIRE.radius  # still before the sheet
    values = client.proof(begun)
    assert (values['report'], values['report reason']) == ('held', 'none')
    assert float(values['report largest miss [m]']) < 1e-6
    assert float(values['report largest misalignment [rad]']) < 1e-6
    assert float(values['report smallest stability']) > 0
    assert 0.008 < float(values['report smallest clearance [m]']) < 0.01
    tolerance = float(values['report tolerance in motion [m]'])
    assert tolerance == pytest.approx(0.25 * (0.01 - WIRE.radius), rel=1e-4)  # of the room
    for figure in ('largest miss in motion [m]', 'swing at departure [m]'):
        assert 1e-6 < float(values[f'report {figure}']) <= tolerance
    assert 0.005 < float(values['report smallest clearance in motion [m]']) < 0.01
    assert 5 < float(values['report duration [s]']) < 15
    assert float(values['report frequency margin']) > 0.02
    timed = client.timed_for(begun)
    times, transforms = times_and_transforms(timed)
    assert (np.diff(times) > 0).all()
    np.testing.assert_allclose(transforms[-1, :3], grippers[-1].position, atol=1e-9)
    speeds = [np.linalg.norm([v.x, v.y, v.z]) for v in (
        point.velocities[0].linear for point in timed.points)]
    assert speeds[0] == pytest.approx(0, abs=1e-12) and 0.03 < max(speeds) < 0.1 * 1.001
    away = Pose((-1.3, 0.5, 1.1), (0, 0, 0, 1))
    robot.put(away)
    client.shape_for(away)
    answer = client.trigger('execute')
    assert not answer.success and 'execute.start_distance' in answer.message
    assert 'execute.start_distance' in status(client, lambda _, m: 'where the plan' in m)[1]


def test_who_asks_gets_the_own_plan_executed_once_it_is_proved_or_none(client, begun):
    other, _ = client.plan_threading(AWAY, Pose.looking_along((0.0, 0.25, 1.0), (1.0, 0.0, 0.0)))
    assert 'ask again' in client.trigger('execute').message  # its own last one, not yet proved
    stranger = Node('stranger', context=client.context)
    stranger.create_client(GetPlan, f'{client.planner}/plan')
    # others may have planned before, in other files
    assert until(lambda: ' different plans were made' in client.trigger('execute').message)
    answer = client.trigger('execute')  # it may be meant for either
    assert not answer.success and '/dlo_planner_client, /stranger' in answer.message
    stranger.destroy_node()
    code, message, _ = client.execute(begun)
    assert code == 418 and 'is not the last one' in message
    assert 'ask again' in client.execute(other)[1]
    assert client.proof(other)['report'] == 'held'
    drain(client.executions)
    code, _, values = client.execute(other)
    stamp = other.header.stamp
    assert (code, values['plan stamp']) == (0, f'{stamp.sec}.{stamp.nanosec:09d}')
    assert client.execution_in('running')[0] == 0
    again = client.trigger('execute')
    assert not again.success and 'is being executed' in again.message


def refused_while_it_is_executed(client):
    """Try to change parameters: limits and places stay, a name may change."""
    for name, value in {'threading__linear_speed': 10.0, 'workspace__reach': 5.0,
                        'tool__position': [0.0, 0.0, 0.1], 'rod__length': 1.1,
                        'constraints__path__position': 0.03}.items():
        refused = client.set_parameters(**{name: value})[0]
        assert not refused.successful
        assert f'parameter {name.replace("__", ".")}: a plan is being executed' in refused.reason
    assert client.set_parameters(threading__linear_speed=0.1, rod__name='w')[0].successful
    assert client.set_parameters(rod__name='copper wire')[0].successful


def comes_to_rest(client, done):
    """Wait until what is canceled after `done` s has come to rest."""
    code, reason, values = client.execution_in('stopped')
    assert (code, reason) == (405, 'canceled')
    assert client.status_of('cancel')[0] == 0
    assert 'canceled' in client.status_of('execute')[1]
    assert done < float(values['done [s]']) < 0.8 * float(values['duration [s]'])
    assert not client.trigger('cancel').success


def comes_slower(came):
    """Look whether commands go, and come to rest.

    Where none goes out for a quarter of a second, a robot that waits for each stands still: then
    the motion begins again from rest, as far as the machine lets it. Else each is near the one
    before, whenever it comes.
    """
    places = np.array([pose_from_msg(one.pose).position for one in came])
    stamps = np.array([one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in came])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() > 5e-4, steps.max()
    assert steps[-1] < 1e-5
    again = np.diff(stamps)[1:] > 0.2
    changes = np.diff(steps)
    assert np.abs(changes[~again]).max() < 1.5 * 0.5 * 0.02**2 + 1e-4, changes


def test_what_streams_is_what_was_proved_until_it_is_canceled_and_decelerates(client, begun):
    values, timed = client.proof(begun), client.timed_for(begun)
    times, transforms = times_and_transforms(timed)
    assert times[-1] == pytest.approx(float(values['report duration [s]']), rel=1e-4)
    for messages in (client.commands, client.executions, client.statuses):
        drain(messages)
    answer = client.trigger('execute')
    assert answer.success and 'gripper_command' in answer.message
    refused_while_it_is_executed(client)
    assert until(lambda: client.commands.qsize() > 150)
    done = float(client.execution_in('running')[2]['done [s]'])
    assert client.trigger('cancel').success
    comes_to_rest(client, done)
    came = quiet(client.commands)
    comes_slower(came)
    came = came[:150]
    assert came[0].header.frame_id == 'world'
    np.testing.assert_allclose(pose_from_msg(came[0].pose).matrix, AWAY.matrix, atol=1e-3)
    # each command lies on the trajectory, and they go along it in time
    way = CubicSpline(times, transforms[:, :3])
    dense = way(np.arange(0, 1 + 0.02 * len(came), 1e-3))
    places = np.array([pose_from_msg(one.pose).position for one in came])
    off = np.linalg.norm(dense[None] - places[:, None], axis=2)
    assert off.min(axis=1).max() < 1e-4
    since = 1e-3 * off.argmin(axis=1)
    stamps = np.array([one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in came])
    moving = since > 1.0  # where its place tells the time
    assert moving.sum() > 30
    strides = (since[moving][10:] - since[moving][:-10]) / 10
    assert np.median(strides) == pytest.approx(0.02, abs=5e-4)  # a period a command
    late = (stamps - stamps[0] - since)[moving]
    gaps = np.diff(stamps)
    assert np.median(gaps) == pytest.approx(0.02, abs=5e-3)  # 50 a second
    assert len(came) < 50 * np.ptp(stamps) + 5
    # it never hurries; what it waits is what the machine was late
    waited = np.where(gaps > 0.03, gaps - 0.02, 0.0).sum()
    assert np.diff(late).min() > -0.03 and late[0] - late.min() < 0.05
    assert np.ptp(late) < 0.05 + waited
    answer = client.trigger('execute')  # what was not finished has to be planned again
    assert not answer.success and 'canceled' in answer.message


def test_obstacles_that_change_void_the_plan_and_end_its_execution(client, begun):
    assert client.proof(begun)['report'] == 'held'
    for messages in (client.executions, client.commands):
        drain(messages)
    assert client.trigger('execute').success
    assert until(lambda: client.commands.qsize() > 50)
    box = cube(1.0, 7)
    box.pose = pose_msg(poses_from_path(begun)[-1])
    client.send_obstacles([box])
    try:
        code, reason, _ = client.execution_in('stopped')
        assert code == 410 and 'cell/7 is 0.1 m in the way of the gripper' in reason
        answer = client.trigger('execute')
        assert not answer.success and 'cell/7' in answer.message
    finally:
        client.send_obstacles([cube(0, action=Marker.DELETEALL)])
        assert until(lambda: client.plan_threading(AWAY, GOAL)[0].poses)


@pytest.mark.every(2)
@pytest.mark.parametrize('horizon', [0.0, 1.0])
def test_a_process_that_was_stopped_for_seconds_makes_no_leap(planner, client, robot, begun,
                                                              horizon):
    client.set_parameters(execute__horizon=horizon)
    regular = under_way(client, begun)
    planner.process.send_signal(signal.SIGSTOP)
    time.sleep(2.5)  # longer than it may pause
    planner.process.send_signal(signal.SIGCONT)
    code, reason, _ = client.execution_in('stopped')
    client.set_parameters(execute__horizon=1.0)
    assert code == 412 and (f'execute.{"horizon" if horizon else "longest_pause"} = ' in reason)
    assert client.status_of('execute')[0] in (0, 412)
    assert steps(client).max() <= 1.2 * regular
    if horizon:  # what the robot was told: it has come to rest by itself, within the limits
        assert largest(robot.told, Limits(), 0.02) <= 1.01
