# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is executed through the joints of an arm: the closed loop, in simulated time; the node.

The arm is the stand-in of its controller, 250 times a second, and follows that exactly.
"""

import time
from dataclasses import replace

import numpy as np
import pytest
from closed_loops import Truth
from robot_arms import UR5_READY, ur5
from streams import ROUNDED, largest
from trajectory_controller import TrajectoryController

from dlo_planner import CutOut, InvalidTask, Pose, Rod, Uncertainty, replay
from dlo_planner.arm.joint_stream import settling_time
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.guards import Feedback
from dlo_planner.identify.estimator import DloEstimator
from dlo_planner.identify.vibration import FreeVibration
from dlo_planner.penalties import Through
from dlo_planner.ros.arm import ArmDrive
from dlo_planner.ros.plan import make_plan, through
from dlo_planner.ros.proof import proofs
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import PlanResult, State, Store
from dlo_planner.ros.status import Statistics
from dlo_planner.ros.streaming import closed_loop_of
from dlo_planner.ros.worker import Worker
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.trajectories import joint_points_msg

WIRE = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
START = Pose.looking_along((-0.36, -0.1, 1.02), (1, 0, 0))
SPREAD = Uncertainty(0.05, 0.05, 0.02, natural_curvature=0.3, gripper_position=5e-4,
                     gripper_rotation=3.5e-3)
DEFAULTS = {name: entry.default for name, entry in PARAMETERS.items()}
JOINTS = {'execute.through': 'joints', 'arm.tool_link': 'tool0'}
VALUES = {**DEFAULTS, **JOINTS, 'rod.length': 0.3, 'rod.diameter': 1e-3, 'threading.waypoints': 12,
          'threading.deepest': 0.35, 'threading.standoff': 0.02, 'threading.angular_speed': 1.0,
          'cutouts.radius': HOLE.radius, 'observe.noise': 3e-4, 'observe.period': 0.1,
          'observe.correction_period': 0.3, 'observe.largest_correction': 0.05,
          'spread.natural_curvature': 0.3, 'spread.curvature_variation': 0.0}
SAMPLES, LATE, LONGEST = 5, 0.05, 60.0  # in a period; s
CLOCK = 1.7e9  # of the stamps against the steady clock, s


def standing_at(start):
    """Return a UR5 that holds the gripper at a pose in its middle configuration."""
    return replace(ur5(), base=start.compose(ur5().pose(UR5_READY).inverse()))


@pytest.fixture(scope='module')
def worker():
    made = Worker('plans')
    yield made
    made.close()


@pytest.fixture(scope='module')
def proved():
    """Return a State whose plan is proved, with a gripper at its beginning."""
    state = State(Scene.of(VALUES))
    task = through(state.scene, [HOLE.pose])
    plan, before = make_plan(state.scene, task, START, None)
    state = state.with_plan(PlanResult(state.scene, plan, before, None, task, None))
    proof = list(proofs(replay, state.scene, plan, before))[-1]
    assert proof.safe, proof.reason
    return state.with_proof(proof)


class Cell:
    """An arm with its controller, and a camera, in simulated time."""

    def __init__(self, state, worker, arm):
        self.rng, self.arm = np.random.default_rng(8), arm
        self.truth = Truth.drawn(self.rng, WIRE, SPREAD)
        self.observing = DloEstimator(state.scene.direct, state.scene.seeing)
        self.time, self.joints, self.speeds = 0.0, UR5_READY.copy(), np.zeros(6)
        self.controller = TrajectoryController(arm.joints, self.joints)
        self.leads, self.coming, self.told = ArmDrive(arm, self.joints, state.scene), [], None
        self.commands = [self.joints]
        started = state.with_feedback(Feedback(START, 0.0)).started(0.0)
        self.drive = closed_loop_of(started, self.observing, worker, self.leads)
        self.store, self.health = Store(self.drive.begun(started)), Statistics()
        self.hear(self.leads.stream.resting(CLOCK))

    def hear(self, points):
        if points is not None:
            self.coming.append((self.time + LATE, joint_points_msg(self.arm.joints, points)))

    def step(self):
        here = self.arm.pose(self.joints)
        self.store.change(lambda now: now.with_feedback(Feedback(
            here, self.time, 0.0, self.observing.off, CLOCK + self.time)))
        self.observing.gripper(CLOCK + self.time, here)
        if self.observing.due(CLOCK + self.time):
            shape = self.truth.shape(here)
            points = shape.positions_at(np.linspace(0, 1, 20) * shape.s[-1])
            self.observing.look(CLOCK + self.time,
                                points + 3e-4 * self.rng.standard_normal((20, 3)))
        execution = self.drive.tick(self.store, self.health, self.time, CLOCK + self.time)
        while self.drive._loop.work is not None:  # in another process
            time.sleep(2e-3)
        if execution.active and execution.ahead is not None and execution.ahead is not self.told:
            self.told = execution.ahead
            self.hear(self.leads.told(execution))
        self.move(self.store.state.scene.period)
        return execution

    def move(self, seconds):
        for _ in range(SAMPLES):
            self.time += seconds / SAMPLES
            for _, msg in [one for one in self.coming if one[0] <= self.time]:
                assert self.controller.hear(msg, CLOCK + self.time)
            self.coming = [one for one in self.coming if one[0] > self.time]
            command = self.controller.update(CLOCK + self.time, self.joints, self.speeds).copy()
            self.speeds = (command - self.joints) * SAMPLES / seconds
            self.joints = command
            self.commands.append(command)

    def until_the_end(self):
        while (execution := self.step()).active:
            assert self.time < LONGEST
        return execution

    def part(self, scene):
        """Return the part of the limits that the gripper has used."""
        poses = [self.arm.pose(joints) for joints in self.commands]
        return max(largest(poses[k::SAMPLES], scene.limits, scene.period) for k in range(SAMPLES))


def test_a_closed_loop_leads_the_arm_within_the_limits_and_threads(proved, worker):
    cell = Cell(proved, worker, standing_at(START))
    execution = cell.until_the_end()
    assert (execution.phase, execution.cause) == ('succeeded', Cause.DONE), execution.reason
    assert cell.part(proved.scene) <= ROUNDED
    assert cell.health.report()[2]['corrections'] >= 1
    center, *_ = proved.planned.plan.via_points[-1][0]
    off = np.linalg.norm(Through(center).residuals(cell.truth.shape(cell.arm.pose(cell.joints))))
    assert off < cell.store.state.looking.miss_bound_95 < HOLE.radius
    assert not cell.controller.refused


def test_a_motion_of_the_loop_that_the_arm_cannot_follow_is_not_begun(proved, worker):
    arm = standing_at(START)
    cell = Cell(proved, worker, arm)
    slow = replace(arm, urdf=arm.urdf.replace('velocity="3.15"', 'velocity="0.01"')
                   .replace('velocity="3.2"', 'velocity="0.01"'))
    assert slow.speeds.max() == 0.01
    cell.leads.looks = slow
    execution = cell.until_the_end()
    assert (execution.phase, execution.cause) == ('stopped', Cause.ARM)
    assert 'rad/s: expected at most 0.01' in execution.reason
    assert np.ptp(cell.commands, axis=0).max() < 1e-9  # it has not moved


def test_what_an_arm_cannot_follow_is_refused_by_time_joint_and_limit(proved):
    scene, way = proved.scene, proved.proof.report.trajectory
    ArmDrive(standing_at(START), UR5_READY, scene).judge(way)
    far = replace(standing_at(START), base=Pose((5.0, 0.0, 0.0), (0, 0, 0, 1)))
    with pytest.raises(Refused, match='the tool cannot get there') as refused:
        ArmDrive(far, UR5_READY, scene).judge(way)
    assert refused.value.cause == Cause.ARM


@pytest.mark.parametrize(('given', 'said'), [
    ({'execute.through': 'joint'}, "execute.through = 'joint': expected one of 'pose', 'ahead', "),
    ({'execute.through': 'joints'}, "arm.tool_link = '': expected the link"),
    ({**JOINTS, 'execute.horizon': 0.0}, 'execute.horizon = 0: expected how much')])
def test_how_the_robot_is_told_is_judged(given, said):
    with pytest.raises(InvalidTask) as refused:
        Scene.of({**DEFAULTS, **given})
    assert said in str(refused.value)


def test_single_poses_have_no_horizon_and_joints_say_where_the_gripper_is():
    made = {kind: Scene.of({**DEFAULTS, **JOINTS, 'execute.through': kind})
            for kind in ('pose', 'ahead', 'joints')}
    assert {kind: scene.horizon for kind, scene in made.items()} == {
        'pose': 0.0, 'ahead': 1.0, 'joints': 1.0}
    assert [scene.guards.heard for scene in made.values()] == [
        'gripper_pose', 'gripper_pose', 'joint_states']


@pytest.mark.parametrize(('heard', 'cause', 'said'), [
    (None, Cause.NO_GRIPPER_POSE, 'expected joint_states and robot_description of the arm'),
    (Feedback(START, 0.0, age=5.0), Cause.OLD_GRIPPER_POSE, 'joint_states: each one that came'),
    (Feedback(START, -5.0), Cause.OLD_GRIPPER_POSE, 'joint_states: the last one is 5 s old')])
def test_joint_states_that_do_not_come_are_named(proved, heard, cause, said):
    state = proved if heard is None else proved.with_feedback(heard)
    with pytest.raises(Refused, match=said) as refused:
        state.started(0.0)
    assert refused.value.cause == cause


def test_an_execution_begins_when_the_controller_has_led_the_arm_there(proved):
    execution = proved.with_feedback(Feedback(START, 0.0)).started(0.0).execution
    assert execution.begin == execution.done == -settling_time(proved.scene.limits) < -0.2
    poses = execution.way.poses([execution.begin, 0.0])
    np.testing.assert_array_equal(poses[0].matrix, poses[1].matrix)


def test_a_motion_against_a_swing_counts_from_when_the_controller_has_heard_of_it(proved, worker):
    loop = Cell(proved, worker, standing_at(START)).drive._loop
    shape = loop.observing.estimate.shape(START)
    modes, s = shape.modes(2), np.linspace(0.2, 1.0, 20) * shape.s[-1]
    moved = modes.displacements[0] / np.linalg.norm(modes.displacements[0, -1])
    off = np.column_stack([np.interp(s, modes.s, part) for part in moved.T])
    times = np.arange(0, 3 / modes.frequencies[0], 1 / 30)
    seen = FreeVibration.of(shape, [
        (time, shape.positions_at(s) + 2e-3 * np.cos(2 * np.pi * modes.frequencies[0] * time) * off)
        for time in times])
    way = loop._calming(seen, times[-1] + 0.3)
    execution = loop._execution_of(way)
    assert execution.done == -0.1
    assert loop._calmed.stamp == pytest.approx(
        times[-1] + 0.3 - execution.begin + way.trajectory.duration)
