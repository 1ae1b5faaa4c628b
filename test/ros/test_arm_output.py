# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A URDF and joint states in, a joint trajectory out: over DDS, in this process."""

import time

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from planner_process import PATIENCE, WIRE
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from robot_arms import PACKAGES, PANDA_READY, UR5_READY, panda, placed_by_hand, timed, ur5, way
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from dlo_planner import Infeasible, InvalidTask, Pose
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.ros.arm import ArmOutput, _current
from dlo_planner.ros.lifecycle import LATCHED, LifecycleNode
from dlo_planner.ros.node import declare
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.parameters import PARAMETERS

STAMP = Time(sec=5)
TOOL = Pose((0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0))


class Cell:
    """A node with an ArmOutput, and another one that is the robot and its controller."""

    def __init__(self, domain, *parameters):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        options = {'context': self.context, 'enable_rosout': False}
        self.node = LifecycleNode('planner', parameter_overrides=[
            Parameter(name, value=value) for name, value in parameters],
            cli_args=['--ros-args', *WIRE], **options)
        declare(self.node)
        self.node.show()
        self.robot = Node('robot', **options)
        self.received = []
        self.output = ArmOutput(self.node, None)
        self.node.start_up()
        self.node.open()
        self.description = self.robot.create_publisher(String, 'robot_description', LATCHED)
        self.semantic = self.robot.create_publisher(String, 'robot_description_semantic', LATCHED)
        self.states = self.robot.create_publisher(JointState, 'joint_states', 10)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.robot)

    def listen(self):
        self.robot.create_subscription(JointTrajectory, 'planner/joint_trajectory',
                                       self.received.append, LATCHED)

    def until(self, done):
        end = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.05)

    def robot_is(self, arm, positions, **others):
        self.description.publish(String(data=arm.urdf))
        known = dict(zip(arm.joints, map(float, positions), strict=True)) | others
        # (it is published once: joints of an arm that is not known yet say nothing of its tool)
        self.until(lambda: self.output._description and self.states.get_subscription_count() == 1)
        self.states.publish(JointState(name=list(known), position=list(known.values())))
        self.until(lambda: self.output._positions)

    def close(self):
        self.executor.shutdown()
        for node in (self.node, self.robot):
            node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def cell(domain, monkeypatch):
    monkeypatch.setattr('dlo_planner.ros.arm._STALE', 10 * PATIENCE)  # this machine may be busy
    cells = []

    def make(*parameters):
        cells.append(Cell(domain, *parameters))
        return cells[-1]

    yield make
    for one in cells:
        one.close()


def test_a_proved_plan_becomes_what_the_controller_takes(cell):
    cell = cell(('arm.tool_link', 'panda_hand_tcp'), ('arm.packages', list(PACKAGES)),
                ('arm.base.position', [1.0, 0.0, 0.0]))
    cell.robot_is(panda(), PANDA_READY, panda_finger_joint1=0.02, elsewhere=3.0)
    trajectory = timed(way(Pose((1, 0, 0), (0, 0, 0, 1)).compose(panda().pose(PANDA_READY)).compose(
        TOOL), (0.0, 0.1, 0.05)))
    made = cell.output.on_proof(trajectory, TOOL, STAMP)
    assert made.not_looked_at == ()
    assert made.self_clearance > 0.01
    cell.listen()  # late
    cell.until(lambda: cell.received)
    msg = cell.received[-1]
    assert msg.joint_names == list(panda().joints)
    assert msg.header.stamp == Time()
    np.testing.assert_allclose(msg.points[0].positions, PANDA_READY, atol=1e-6)
    for point in msg.points[::20]:
        seconds = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
        gripper = trajectory.at([seconds])[0][0]
        by_hand = placed_by_hand(panda().urdf, 'panda_hand_tcp', dict(zip(
            msg.joint_names, point.positions, strict=True)))
        by_hand[0, 3] += 1.0
        np.testing.assert_allclose(by_hand @ TOOL.matrix, gripper.matrix, atol=1e-5)


def test_no_arm_is_asked_for(cell):
    cell = cell()
    assert cell.output.on_proof(None, TOOL, STAMP) is None
    assert not cell.node.get_parameter('arm.tool_link').value


def test_what_is_missing_is_said(cell):
    trajectory = timed(way(ur5().pose(UR5_READY), (0.0, 0.1, 0.0)))
    cell = cell(('arm.tool_link', 'tool0'), ('arm.joints', []))
    with pytest.raises(InvalidTask, match='robot_description was not received'):
        cell.output.on_proof(trajectory, TOOL, STAMP)
    cell.description.publish(String(data=ur5().urdf))
    cell.until(lambda: cell.output._description)
    with pytest.raises(InvalidTask, match='joint_states: no position of shoulder_pan_joint'):
        cell.output.on_proof(trajectory, TOOL, STAMP)
    cell.robot_is(ur5(), UR5_READY)
    made = cell.output.on_proof(trajectory, Pose.identity(), STAMP)
    assert len(made.not_looked_at) == 7  # no folder with the meshes
    far = timed(way(ur5().pose(UR5_READY), (3.0, 0.0, 0.0)))
    with pytest.raises(Infeasible, match='waypoint'):
        cell.output.on_proof(far, Pose.identity(), STAMP)
    cell.node.set_parameters([Parameter('arm.tool_link', value='nothing')])
    with pytest.raises(InvalidTask, match="arm.* tool_link = 'nothing': expected a link"):
        cell.output.on_proof(trajectory, TOOL, STAMP)


def test_joint_states_in_parts_are_put_together_and_bad_ones_refused(cell):
    cell = cell(('arm.tool_link', 'tool0'))
    cell.robot_is(ur5(), UR5_READY)
    before = cell.output._positions
    for positions in ([float('nan')], [1.0, 2.0]):
        cell.output._on_joint_state(JointState(name=['elbow_joint'], position=positions))
    assert cell.output._positions is before
    cell.output._on_joint_state(JointState(name=['finger'], position=[0.5]))
    known = {name: value for name, (value, _) in cell.output._positions.items()}
    assert known == {'finger': 0.5, **dict(zip(ur5().joints, UR5_READY, strict=True))}


def test_positions_count_for_a_second():
    arm = ur5()
    known = {name: (value, 5.0) for name, value in zip(arm.joints, UR5_READY, strict=True)}
    np.testing.assert_array_equal(_current(arm, known, 5.9), UR5_READY)
    with pytest.raises(InvalidTask, match='no position of shoulder_pan_joint, .* in the last 1 s'):
        _current(arm, known, 6.1)


def test_joints_that_carry_the_arm_have_to_be_known(cell):
    cell = cell(('arm.tool_link', 'tool0'), ('arm.joints', list(ur5().joints[1:])))
    cell.robot_is(ur5(), UR5_READY)
    cell.output._positions = {name: known for name, known in cell.output._positions.items()
                              if name != ur5().joints[0]}
    with pytest.raises(InvalidTask, match='no position of shoulder_pan_joint so far'):
        cell.output.on_proof(timed(way(ur5().pose(UR5_READY), (0, 0.1, 0))), TOOL, STAMP)


def test_a_semantic_description_says_what_is_looked_at(cell):
    cell = cell(('arm.tool_link', 'tool0'), ('arm.packages', list(PACKAGES)))
    cell.robot_is(ur5(), UR5_READY)
    links = ['base_link', 'shoulder_link', 'upper_arm_link', 'forearm_link', 'wrist_1_link',
             'wrist_2_link', 'wrist_3_link', 'ee_link']
    pairs = ''.join(f'<disable_collisions link1="{one}" link2="{other}"/>'
                    for one in links for other in links if one != other)
    cell.semantic.publish(String(data=f'<robot name="ur5">{pairs}</robot>'))
    cell.until(lambda: cell.output._semantic)
    trajectory = timed(way(ur5().pose(UR5_READY), (0.0, 0.05, 0.0)))
    assert cell.output.on_proof(trajectory, Pose.identity(), STAMP).self_clearance == np.inf


def test_joint_states_say_where_the_tool_link_is_where_they_are_to(cell, monkeypatch):
    base, heard = Pose((1.0, 0.0, 0.5), (0.0, 0.0, 0.6, 0.8)), []
    place = (('arm.base.position', base.position.tolist()),
             ('arm.base.orientation', base.quaternion.tolist()))
    cell = cell(('arm.tool_link', 'tool0'), ('execute.through', 'joints'), *place)
    cell.output._hear = lambda pose, stamp: heard.append((pose, stamp))
    cell.robot_is(ur5(), UR5_READY)
    cell.until(lambda: heard)
    by_hand = base.matrix @ placed_by_hand(ur5().urdf, 'tool0', dict(zip(
        ur5().joints, UR5_READY, strict=True)))
    np.testing.assert_allclose(heard[-1][0].matrix, by_hand, atol=1e-9)
    monkeypatch.setattr('dlo_planner.ros.arm._OFTEN', 0.0)
    msg = JointState(name=list(ur5().joints), position=(UR5_READY + 0.1).tolist())
    msg.header.stamp = STAMP
    cell.output._on_joint_state(msg)
    assert heard[-1][1] == STAMP
    assert np.linalg.norm(heard[-1][0].position - by_hand[:3, 3]) > 0.05
    cell.node.set_parameters([Parameter('arm.base.position', value=[0.0, 0.0, 0.0])])
    cell.output._on_joint_state(msg)  # the arm is made anew
    np.testing.assert_allclose(heard[-1][0].position, heard[-2][0].position - base.position,
                               atol=1e-9)
    count = len(heard)
    cell.node.set_parameters([Parameter('execute.through', value='ahead')])
    cell.output._on_joint_state(msg)
    assert len(heard) == count


def test_an_arm_of_which_too_little_is_known_is_not_led(cell):
    cell = cell(('arm.tool_link', 'tool0'), ('execute.through', 'joints'))
    scene = Scene.of({name: cell.node.get_parameter(name).value for name in PARAMETERS})
    with pytest.raises(Refused, match='robot_description was not received') as refused:
        cell.output.drive(scene)
    assert refused.value.cause == Cause.ARM
    cell.robot_is(ur5(), UR5_READY)
    drive = cell.output.drive(scene)
    np.testing.assert_array_equal(drive.stream.joints, UR5_READY)
    assert drive.arm.chain is not drive.looks.chain  # of two threads
    cell.output._positions.pop('elbow_joint')
    with pytest.raises(Refused, match='joint_states: no position of elbow_joint'):
        cell.output.drive(scene)


def test_an_arm_is_made_anew_where_what_carries_it_moves(cell):
    joints = list(ur5().joints)
    cell = cell(('arm.tool_link', 'tool0'), ('execute.through', 'joints'),
                ('arm.joints', joints[1:]))
    cell.robot_is(ur5(), UR5_READY)
    arm = cell.output._same_arm()
    assert arm.carriers == (joints[0],)
    cell.output._positions[joints[0]] = UR5_READY[0] + 1e-6, time.monotonic()  # noise
    assert cell.output._same_arm() is arm
    cell.output._positions[joints[0]] = UR5_READY[0] + 0.3, time.monotonic()
    turned = cell.output._same_arm()
    by_hand = placed_by_hand(ur5().urdf, 'tool0', dict(zip(
        joints, UR5_READY + np.array([0.3, 0, 0, 0, 0, 0]), strict=True)))
    np.testing.assert_allclose(turned.pose(UR5_READY[1:]).matrix, by_hand, atol=1e-9)
