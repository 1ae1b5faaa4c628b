# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The cell as a node: it follows commands, shows its DLO, and says where it is not in real time."""

import time
from contextlib import contextmanager

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from planner_here import Witness, context_of_its_own
from planner_process import PATIENCE
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

pytest.importorskip('mujoco')

from dlo_planner import DloPlannerError, Pose  # noqa: E402
from dlo_planner.cell.cases import NOMINAL, case  # noqa: E402
from dlo_planner.cell.node import CellNode  # noqa: E402
from dlo_planner.cell.plant import (
    Passage,  # noqa: E402
    Plant,  # noqa: E402
)
from dlo_planner.ros.lifecycle import CHANGES, LATCHED, REQUEST  # noqa: E402
from msg_helpers.clouds import points_from_cloud  # noqa: E402
from msg_helpers.poses import pose_from_msg, pose_stamped_msg  # noqa: E402
from msg_helpers.trajectories import poses_ahead  # noqa: E402


class _Cell:
    def __init__(self, context, **more):
        values = {'dlo': 'leaf spring', 'radius': 0.02, **more}
        self.node = CellNode(context=context, parameter_overrides=[
            Parameter(name, value=value) for name, value in values.items()])
        self.witness = Witness(context)
        self.outcomes = self.witness.hear(DiagnosticStatus, '/dlo_cell/outcome', LATCHED)
        self.poses, self.clouds = (
            self.witness.hear(kind, f'/dlo_planner/{name}', qos_profile_sensor_data)
            for kind, name in ((PoseStamped, 'gripper_pose'), (PointCloud2, 'observed_points')))
        self.holes = self.witness.hear(PoseStamped, '/dlo_planner/observed_cutout', REQUEST)
        self.cutouts = self.witness.hear(PoseStamped, '/dlo_cell/cutout', LATCHED)
        self.out = self.witness.node.create_publisher(
            PoseStamped, '/dlo_planner/gripper_command', REQUEST)
        self.witness.executor.add_node(self.node)

    def said(self, wanted, seconds=PATIENCE):
        """Return the first outcome from now on of which `wanted(message, values)`."""
        self.outcomes.clear()
        found = []

        def came():
            found[:] = [(one.message, values) for one in self.outcomes
                        for values in [{item.key: item.value for item in one.values}]
                        if wanted(one.message, values)]
            return found
        assert self.witness.wait_for(came, seconds), [one.message for one in self.outcomes]
        return found[0]


@contextmanager
def serving(**more):
    with context_of_its_own() as context:
        made = _Cell(context, **more)
        yield made
        made.witness.executor.remove_node(made.node)
        made.node.destroy_node()
        made.witness.close()


@pytest.fixture
def cell(domain):
    with serving() as made:
        yield made


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def late_and_again(monkeypatch, sleep):
    """Let each computation of the plant take `sleep` s longer."""
    move = Plant.move

    def slow(self, *arguments):
        time.sleep(sleep)
        move(self, *arguments)
    monkeypatch.setattr(Plant, 'move', slow)


@pytest.mark.sweep
def test_something_happens_some_time_after_the_gripper_first_moves(domain):
    with serving(case='slip', seed=3) as cell:
        slip, plant = case('slip', 3)[0].slips[0], cell.node._plant
        assert cell.witness.wait_for(lambda: len(cell.poses) > 20)
        with cell.node._lock:
            assert plant.course.in_grip(plant.time + 100)[0] == 0
        start = cell.node.task.start
        ahead = Pose(start.position + (0, 0, 0.001), start.quaternion)
        now = cell.node.get_clock().now().to_msg()

        def moves():
            cell.out.publish(pose_stamped_msg(ahead, 'world', now))
            return plant.course.since < plant.time
        assert cell.witness.wait_for(moves)
        with cell.node._lock:
            since = plant.course.since
            assert plant.course.in_grip(since + slip.time - 0.01)[0] == 0
            assert plant.course.in_grip(since + slip.time + 0.1)[0] == slip.back
            assert plant._obstacles[0].friction == 0.3
            assert plant.course.disturbances.robot_position == NOMINAL.robot_position


@pytest.mark.parametrize(('name', 'value', 'said'), [
    ('case', 'rain', 'case = .rain'), ('unknown', 'all', 'expected one of nothing, much, more')])
def test_a_case_that_is_none(domain, name, value, said):
    with context_of_its_own() as context, pytest.raises(DloPlannerError, match=said):
        CellNode(context=context, parameter_overrides=[Parameter(name, value=value)])


def at(msg):
    return pose_from_msg(msg.pose)


def test_it_says_where_all_is_and_what_it_sees_and_begins_again(domain):
    with serving(sees_hole=True) as cell:
        task = cell.node.task
        assert cell.witness.wait_for(lambda: cell.cutouts and cell.poses and len(cell.holes) > 4
                                     and len(cell.clouds) > 4)
        np.testing.assert_allclose(at(cell.cutouts[0]).matrix, task.cutout.pose.matrix, atol=1e-12)
        np.testing.assert_allclose(at(cell.poses[0]).matrix, task.start.matrix, atol=1e-9)
        for msg in cell.clouds:
            points = points_from_cloud(msg, 'cloud')
            assert len(points) == 20
            away = np.linalg.norm(points - task.start.position, axis=1)
            assert away.max() < task.rod.length + 0.02
        off = np.array([at(one).position for one in cell.holes]) - task.cutout.center
        assert 1e-4 < np.abs(off).max() < 6e-3  # 1 mm of noise
        np.testing.assert_allclose(at(cell.holes[0]).quaternion, task.cutout.pose.quaternion,
                                   atol=1e-9)
        assert {seconds(one.header.stamp) for one in cell.holes} & {
            seconds(one.header.stamp) for one in cell.clouds}
        goal = Pose(task.start.position + (0.01, 0.0, 0.0), task.start.quaternion)
        now = cell.node.get_clock().now().to_msg()

        def there():
            cell.out.publish(pose_stamped_msg(goal, 'world', now))
            return np.allclose(at(cell.poses[-1]).position, goal.position, atol=1e-4)
        assert cell.witness.wait_for(there)
        assert cell.witness.ask(Trigger, '/dlo_cell/restart').success
        assert cell.witness.wait_for(lambda: np.allclose(
            at(cell.poses[-1]).matrix, task.start.matrix, atol=1e-9))


def test_it_shows_its_dlo_and_follows_commands(cell):
    assert cell.witness.wait_for(lambda: len(cell.poses) > 20 and len(cell.clouds) > 3)
    start = cell.node.task.start
    ahead = Pose(start.position + (0, 0, 0.001), start.quaternion)
    now = cell.node.get_clock().now().to_msg()

    def there():
        cell.out.publish(pose_stamped_msg(ahead, 'world', now))
        return abs(cell.poses[-1].pose.position.z - ahead.position[2]) < 1e-9
    assert cell.witness.wait_for(there)
    message, values = cell.said(lambda *_: True)
    assert message.startswith('under way')
    assert (values['threaded'], values['depth [m]'], values['largest force [N]'],
            values['struck inside']) == ('False', '0', '0', 'False')
    assert values['largest miss [m]'] == values['its y [m]'] == values['its z [m]'] == 'nan'
    cell.node._worst = Passage(0.02, 5e-3, 3e-3, -4e-3, 5e-3)
    _, values = cell.said(lambda _, values: values['its y [m]'] != 'nan')
    worst = [float(values[f'{name} [m]']) for name in ('its y', 'its z', 'its depth')]
    assert worst == [3e-3, -4e-3, 0.02] and float(values['largest miss [m]']) == 5e-3
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in cell.clouds]
    assert stamps == sorted(stamps)


@pytest.mark.sweep
def test_a_machine_that_is_too_slow_is_said_to_be(cell, monkeypatch):
    late_and_again(monkeypatch, 0.1)
    message, values = cell.said(lambda message, _: 'too slow' in message)
    assert 'of no meaning' in message and float(values['lost [s]']) > 0.5
    monkeypatch.undo()
    assert cell.witness.ask(Trigger, '/dlo_cell/restart').success
    lost = float(values['lost [s]'])
    assert cell.said(lambda _, values: float(values['lost [s]']) < lost)


@pytest.mark.sweep
def test_a_plant_that_is_late_catches_up_and_stamps_as_if_it_were_not(cell, monkeypatch):
    monkeypatch.setattr('dlo_planner.cell.node._BEHIND', 100.0)  # however busy the machine is
    assert cell.witness.wait_for(lambda: len(cell.poses) > 20)
    cell.poses.clear()
    with cell.node._lock:  # as if nothing were computed for a while
        time.sleep(0.25)
    assert cell.witness.wait_for(lambda: len(cell.poses) > 40)
    stamps = np.array([seconds(one.header.stamp) for one in cell.poses])
    steps = np.diff(stamps) / 0.01  # some messages may be lost
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)
    assert steps.min() > 0.5


@pytest.mark.sweep
def test_with_a_clock_of_its_own_nothing_is_lost(domain, monkeypatch):
    late_and_again(monkeypatch, 0.05)
    with serving(clock=True) as cell:
        clocks = cell.witness.hear(Clock, '/clock', CHANGES)
        out = cell.witness.node.create_publisher(
            MultiDOFJointTrajectory, '/dlo_planner/gripper_commands_ahead', REQUEST)
        assert cell.witness.wait_for(lambda: len(clocks) > 5 and out.get_subscription_count())
        begin, start = seconds(clocks[-1].clock), cell.node.task.start
        times = np.linspace(0, 0.6, 31)
        poses = [Pose(start.position + (0, 0, 0.01 * time), start.quaternion) for time in times]
        out.publish(poses_ahead(times, poses, 'world', begin + 0.1))
        clocks.clear(), cell.poses.clear()
        assert cell.witness.wait_for(lambda: len(clocks) > 60)
        steps = np.diff([seconds(one.clock) for one in clocks])
        np.testing.assert_allclose(steps, 0.01, atol=1e-6)
        assert float(cell.said(lambda *_: True)[1]['lost [s]']) == 0
        # after two lags of 0.03 s it is where it was told to be 0.06 s before
        then = [(seconds(one.header.stamp) - begin - 0.1, one.pose.position.z) for one in
                cell.poses]
        behind = [0.01 * (time - 0.06) - (z - start.position[2]) for time, z in then
                  if 0.35 < time < 0.6]
        assert len(behind) > 5 and np.abs(behind).max() < 1e-4
