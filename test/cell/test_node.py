# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The cell as a ROS node: in this process, over DDS."""

import queue
import time

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')
pytest.importorskip('domain_coordinator', reason='domain_coordinator is not installed')

import rclpy  # noqa: E402
from diagnostic_msgs.msg import DiagnosticStatus  # noqa: E402
from domain_coordinator import domain_id  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from planner_process import PATIENCE  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import qos_profile_sensor_data  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from dlo_planner import DloPlannerError, Pose  # noqa: E402
from dlo_planner.cell.node import _LATCHED, _RELIABLE, CellNode  # noqa: E402
from dlo_planner.cell.robot import Robot, nearer  # noqa: E402
from dlo_planner.cell.tasks import draw_task  # noqa: E402
from msg_helpers.clouds import points_from_cloud  # noqa: E402
from msg_helpers.poses import pose_from_msg, pose_stamped_msg  # noqa: E402

TASK = draw_task(2, 'hose', 0.02)


class World:
    """A CellNode, and a node that stands for the planner."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.cell = CellNode(context=self.context, parameter_overrides=[
            Parameter(name, value=value) for name, value in {
                'task': 2, 'dlo': 'hose', 'radius': 0.02, 'planner': '/planner',
                'sees_hole': True}.items()])
        self.planner = Node('planner', context=self.context)
        self.heard = {name: queue.Queue()
                      for name in ('pose', 'cloud', 'hole', 'outcome', 'cutout')}
        for kind, name, topic, qos in (
                (PoseStamped, 'pose', '/planner/gripper_pose', qos_profile_sensor_data),
                (PointCloud2, 'cloud', '/planner/observed_points', qos_profile_sensor_data),
                (PoseStamped, 'hole', '/planner/observed_cutout', _RELIABLE),
                (DiagnosticStatus, 'outcome', '/dlo_cell/outcome', _LATCHED),
                (PoseStamped, 'cutout', '/dlo_cell/cutout', _LATCHED)):
            self.planner.create_subscription(kind, topic, self.heard[name].put, qos)
        self.command = self.planner.create_publisher(PoseStamped, '/planner/gripper_command',
                                                     _RELIABLE)
        self.restart = self.planner.create_client(Trigger, '/dlo_cell/restart')
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in (self.cell, self.planner):
            self.executor.add_node(node)

    def spin(self, done, patience=PATIENCE):
        end = time.monotonic() + patience
        while not done() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        assert done()

    def newest(self, name):
        self.spin(lambda: not self.heard[name].empty())
        while True:
            msg = self.heard[name].get()
            if self.heard[name].empty():
                return msg

    def close(self):
        self.executor.shutdown()
        self.cell.destroy_node()
        self.planner.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture(scope='module')
def world():
    with domain_id() as domain:
        world = World(domain)
        yield world
        world.close()


def at(msg):
    return pose_from_msg(msg.pose)


def test_it_says_where_the_gripper_and_the_hole_are(world):
    np.testing.assert_allclose(at(world.newest('cutout')).matrix, TASK.cutout.pose.matrix,
                               atol=1e-12)
    np.testing.assert_allclose(at(world.newest('pose')).matrix, TASK.start.matrix, atol=1e-9)
    values = {one.key: one.value for one in world.newest('outcome').values}
    assert (values['threaded'], values['depth [m]'], values['largest force [N]'],
            values['struck inside']) == ('False', '0', '0', 'False')


def test_clouds_are_late_and_stamped_when_they_were_taken(world):
    ages = []
    for _ in range(15):
        msg, now = world.newest('cloud'), world.planner.get_clock().now().nanoseconds
        points = points_from_cloud(msg, 'cloud')
        assert len(points) == 20
        away = np.linalg.norm(points - TASK.start.position, axis=1)
        assert away.max() < TASK.rod.length + 0.02
        ages.append(now - msg.header.stamp.sec * 10**9 - msg.header.stamp.nanosec)
    # a plant that is late catches up, so single images are younger than the camera's latency
    assert 0.05e9 < np.median(ages) < 5e9


def test_the_hole_is_seen_with_each_cloud(world):
    seen = []
    for _ in range(5):
        seen.append(at(world.newest('hole')))
        stamps = [world.newest(name).header.stamp for name in ('hole', 'cloud')]
        assert abs(stamps[0].sec - stamps[1].sec) <= 1
    off = np.array([one.position for one in seen]) - TASK.cutout.center
    assert 1e-4 < np.abs(off).max() < 6e-3  # 1 mm of noise
    np.testing.assert_allclose(seen[0].quaternion, TASK.cutout.pose.quaternion, atol=1e-9)


def test_it_follows_its_commands_smoothly_and_starts_again(world):
    goal = Pose(TASK.start.position + (0.01, 0.0, 0.0), TASK.start.quaternion)
    world.spin(lambda: world.command.get_subscription_count() == 1)
    world.newest('pose')
    world.command.publish(pose_stamped_msg(goal, 'world'))
    world.spin(lambda: abs(at(world.newest('pose')).position - goal.position).max() < 1e-4)
    world.spin(world.restart.service_is_ready)
    answer = world.restart.call_async(Trigger.Request())
    world.spin(answer.done)
    assert answer.result().success
    world.spin(lambda: np.allclose(at(world.newest('pose')).matrix, TASK.start.matrix, atol=1e-9))


def test_a_pose_between_two():
    one = Pose((0.0, 0.0, 0.0), (0, 0, 0, 1))
    other = Pose((1.0, 0.0, 2.0), (0, 0, np.sin(0.2), np.cos(0.2)))
    middle = nearer(one, other, 0.5)
    np.testing.assert_allclose(middle.position, (0.5, 0, 1))
    np.testing.assert_allclose(middle.quaternion, (0, 0, np.sin(0.1), np.cos(0.1)))


def test_a_robot_that_is_told_ahead_does_not_go_back_to_single_commands_that_are_behind():
    here, there = (Pose((x, 0.0, 0.0), (0, 0, 0, 1)) for x in (0.0, 1.0))
    robot = Robot(here, lag=0.0)
    robot.follow(there)
    assert robot.moved(0.5, 0.01).position[0] == 1.0  # it was told nothing else
    robot.follow_ahead(np.array([1.0, 2.0]), [here, there])
    assert robot.moved(1.5, 0.01).position[0] == 0.5
    robot.follow(here)
    for now in (2.0, 2.5):  # in time, and when all that it was told is over
        assert robot.moved(now, 0.01).position[0] == 1.0
        robot.follow(here)
    assert robot.moved(9.0, 0.01).position[0] == 1.0


def test_what_it_does_not_know_is_one_of_three():
    with domain_id() as domain:
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        with pytest.raises(DloPlannerError, match='expected one of nothing, much, more'):
            CellNode(context=context, parameter_overrides=[Parameter('unknown', value='all')])
        rclpy.try_shutdown(context=context)
