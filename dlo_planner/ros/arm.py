# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The arm that robot_description describes: where its joints lead the gripper, and are led to."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory as JointTrajectoryMsg

from dlo_planner.arm import Arm, JointTrajectory, joint_trajectory
from dlo_planner.arm.inverse_kinematics import IKFailure
from dlo_planner.arm.joint_stream import JointPoints, JointStream, followed, settling_time
from dlo_planner.arm.robot import parsed, single_joints
from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import Execution
from dlo_planner.identify.online_trajectory import CorrectedTrajectory
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.ros.lifecycle import LATCHED, LifecycleNode
from dlo_planner.ros.scene import Scene
from dlo_planner.trajectory.timed_path import TimedPath
from msg_helpers.trajectories import joint_trajectory_msg, positions_from_joint_state

_JOINTS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_MOST_JOINTS = 1000  # of which positions are remembered
_STALE = 1.0   # s, after which a position of the arm's joints is not the present one
_AWAY = 1e-2   # rad or m: farther from its first point the arm has to be brought there
_DIGITS = 4    # of rad or m, by which a joint that carries the arm has to move for another arm
_OFTEN = 0.01  # s between joint_states by which the gripper is followed: they may come at 500 Hz


class ArmDrive:
    """Leads the joints of an arm along what is executed, as `ArmOutput.drive` begins it.

    `looks` is the same arm for another thread than that of the stream: Pinocchio keeps what it
    computes with the arm.
    """

    def __init__(self, arm: Arm, joints: Floats, scene: Scene) -> None:
        self.arm, self.looks = arm, replace(arm)
        self._period, self._back = scene.period, scene.tool.inverse()
        self.stream = JointStream(arm, joints, scene.period, settling_time(scene.limits))

    def judge(self, way: TimedPath | CorrectedTrajectory, begin: float = 0.0) -> None:
        """Refuse a motion of the gripper, from a time on (s), that the joints cannot follow."""
        times = np.arange(begin, way.duration + self._period, self._period)
        poses = [pose.compose(self._back) for pose in way.poses(times)]
        try:
            followed(self.looks, poses, self.stream.joints, self._period)
        except IKFailure as failure:
            raise _refused(failure, begin + failure.time) from None

    def told(self, execution: Execution) -> JointPoints | None:
        """Return what the joints are sent for the poses that are sent ahead; None: nothing new."""
        assert execution.ahead is not None and execution.stamp is not None  # there is something
        until = execution.published_until - execution.done
        try:
            return self.stream.ahead(execution.stamp, execution.ahead.poses, max(until, 0.0),
                                     execution.phase == 'stopping')
        except IKFailure as failure:
            raise _refused(failure, execution.done + failure.time) from None

    def halted(self, execution: Execution) -> JointPoints:
        """Return what ends the motion of the joints at the last command at once."""
        assert execution.command is not None and execution.stamp is not None  # it ran
        try:
            return self.stream.held(execution.stamp, execution.command)
        except IKFailure as failure:
            raise _refused(failure, execution.done) from None


def _refused(failure: IKFailure, time: float) -> Refused:
    return Refused(Cause.ARM, f'the arm cannot follow the motion, {max(time, 0.0):.2f} s after its '
                   f'beginning: {failure.words}')


class ArmOutput:
    """Publishes `~/joint_trajectory` when a plan is proved; parameters `arm.*` count for the next.

    Listens to robot_description, robot_description_semantic and joint_states. With
    `execute.through` = joints `hear` takes each Pose of the tool link in the world, and its stamp.
    """

    def __init__(self, node: LifecycleNode, group: Any,
                 hear: Callable[[Pose, Time], None] | None = None) -> None:
        self._node, self._hear, self._heard = node, hear, -np.inf
        self._known: tuple[Any, Arm] | None = None  # what an arm was made of, and that arm
        self._description = self._semantic = None
        # name -> (rad or m, when it was received)
        self._positions: dict[str, tuple[float, float]] = {}
        self._out = node.add_publisher(JointTrajectoryMsg, '~/joint_trajectory', LATCHED)
        for topic, callback in (('robot_description', self._on_description),
                                ('robot_description_semantic', self._on_semantic)):
            node.add_subscription(String, topic, callback, LATCHED, group)
        # of several nodes at once, as of an arm and its gripper
        node.add_newest(JointState, 'joint_states', self._on_joint_state, _JOINTS)

    def on_proof(self, trajectory: TimedPath | None, tool: Pose, stamp: Time,
                 free_roll: bool = False) -> JointTrajectory | None:
        """Return and publish the arm's JointTrajectory; None where no arm is asked for."""
        if trajectory is None or not self._value('arm.tool_link'):
            return None
        started, known = monotonic(), self._positions
        arm = self._arm({name: value for name, (value, _) in known.items()})
        current = _current(arm, known, started)
        made = joint_trajectory(trajectory, arm, tool, current=current, free_roll=free_roll,
                                deadline=self._value('arm.deadline'))
        self._out.publish(joint_trajectory_msg(made))
        self._say(made, current, stamp, monotonic() - started)
        return made

    def _arm(self, known: Mapping[str, float]) -> Arm:
        if self._description is None:
            raise InvalidTask('robot_description was not received: expected the URDF that '
                              'robot_state_publisher latches')
        singles = single_joints(parsed('robot_description', self._description))
        shares = [os.path.join(prefix, 'share') for prefix in
                  os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
        given = {name: tuple(filter(None, self._value(f'arm.{name}')))
                 for name in ('joints', 'packages')}
        try:
            return Arm(self._description, self._value('arm.tool_link'), given['joints'],
                       {name: value for name, value in known.items() if name in singles},
                       Pose(self._value('arm.base.position'), self._value('arm.base.orientation')),
                       (*given['packages'], *shares), self._semantic,
                       self._value('arm.self_clearance'))
        except DloPlannerError as error:
            raise InvalidTask(f'parameters arm.*, robot_description: {error}') from None

    def drive(self, scene: Scene) -> ArmDrive:
        """Return what leads the arm's joints from where they are; raise Refused if it cannot."""
        try:
            arm = replace(self._same_arm())
            return ArmDrive(arm, _current(arm, self._positions, monotonic()), scene)
        except InvalidTask as error:
            raise Refused(Cause.ARM, str(error)) from None

    def _same_arm(self) -> Arm:
        """Return the arm, which is made anew where what it is made of has changed."""
        known = {name: value for name, (value, _) in self._positions.items()}
        made_of = (self._description, self._semantic, *(
            str(self._value(f'arm.{name}')) for name in (
                'tool_link', 'joints', 'packages', 'base.position', 'base.orientation',
                'self_clearance')))

        def stands(arm: Arm) -> tuple[float, ...]:
            """Return where the joints are that carry the arm."""
            return tuple(round(known.get(name, np.inf), _DIGITS) for name in arm.carriers)

        if self._known is None or self._known[0] != (made_of, stands(self._known[1])):
            arm = self._arm(known)
            self._known = (made_of, stands(arm)), arm
        return self._known[1]

    def _follow(self, stamp: Time) -> None:
        """Tell where the joints lead the gripper, where they are what does."""
        now = monotonic()
        if (self._hear is None or self._value('execute.through') != 'joints'
                or self._description is None or now - self._heard < _OFTEN):
            return
        arm = self._same_arm()
        if all(name in self._positions for name in (*arm.joints, *arm.carriers)):
            self._heard = now
            self._hear(arm.pose(_current(arm, self._positions, now)), stamp)

    def _say(self, made: JointTrajectory, current: Floats, stamp: Time, seconds: float) -> None:
        log = self._node.get_logger()
        rolled = f', gripper rolled by {np.rad2deg(made.roll):.0f} deg' if made.roll else ''
        log.info(f'joint trajectory of plan {stamp.sec}.{stamp.nanosec:09d}: {len(made)} points, '
                 f'{made.duration:.1f} s, off by {made.position_error:.1e} m at most{rolled}; '
                 f'made in {seconds:.1f} s')
        if made.not_looked_at:
            log.warning('self-collision was not checked for '
                        f'{", ".join(made.not_looked_at)}: set arm.packages')
        away = np.abs(made.positions[0] - current)
        if away.max() > _AWAY:
            joint = int(np.argmax(away))
            log.warning(f'the joint trajectory begins elsewhere: {made.joint_names[joint]} = '
                        f'{made.positions[0, joint]:.4g} there, {current[joint]:.4g} now; bring '
                        'the arm there first')

    def _value(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def _on_description(self, msg: String) -> None:
        self._description = msg.data

    def _on_semantic(self, msg: String) -> None:
        self._semantic = msg.data

    def _on_joint_state(self, msg: JointState) -> None:
        try:
            positions = positions_from_joint_state(msg)
        except DloPlannerError as error:
            self._node.get_logger().warning(f'joint_states refused: {error}',
                                            throttle_duration_sec=1.0)
            return
        now = monotonic()
        # one new dict: the thread that plans reads the old one meanwhile
        known = {**self._positions, **{name: (value, now) for name, value in positions.items()}}
        newest = sorted(known.items(), key=lambda item: item[1][1])[-_MOST_JOINTS:]
        self._positions = dict(newest)
        try:
            self._follow(msg.header.stamp)
        except DloPlannerError as error:
            self._node.get_logger().warning(f'joint_states: {error}', throttle_duration_sec=1.0)


def _current(arm: Arm, known: Mapping[str, tuple[float, float]], now: float) -> Floats:
    """Return the arm's joint positions (m,) out of those of the whole robot by name."""
    unknown = [name for name in (*arm.joints, *arm.carriers) if name not in known]
    old = [name for name in arm.joints if name in known and now - known[name][1] > _STALE]
    if unknown or old:
        raise InvalidTask(f'joint_states: no position of {", ".join(unknown or old)} '
                          f'{"so far" if unknown else f"in the last {_STALE:g} s"}: expected all '
                          f'of {", ".join((*arm.joints, *arm.carriers))}')
    return np.array([known[name][0] for name in arm.joints])
