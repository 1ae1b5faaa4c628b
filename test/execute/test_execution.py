# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion that is executed, as a machine: faults of clocks, poses and robots; without a node."""

import numpy as np
import pytest

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Limits, Pose, Rod, Trajectory
from dlo_planner.execute.causes import Cause
from dlo_planner.execute.execution import Execution, Feedback, Guards

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
PLAN = InverseSimulator(DirectSimulator(WIRE)).thread(
    CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0))), depths=np.linspace(0, 0.95, 12))
TOOL = Pose((0, 0, 0.1), (0, 0.6, 0, 0.8))
WAY = Trajectory(PLAN, Limits(), tolerance=np.inf)
PERIOD = 0.02
TIMES = np.arange(0, WAY.duration + PERIOD, PERIOD)
REGULAR = np.linalg.norm(np.diff([pose.position for pose in WAY.at(TIMES)[0]], axis=0),
                         axis=1).max()


def begun(**guards):
    return Execution(WAY, TOOL.inverse(), 'world', Guards(**guards), PERIOD)


class Robot:
    """Follows commands `lag` s later; its poses come on time and are `age` s old."""

    def __init__(self, lag=0.1, first=None):
        self.sent = [(-np.inf, first or WAY.at([0.0])[0][0].compose(TOOL.inverse()))]
        self.lag = lag

    def take(self, now, pose):
        self.sent.append((now, pose))

    def heard(self, now, **more):
        there = [pose for time, pose in self.sent if time <= now - self.lag]
        return Feedback(there[-1], now, **more)


def run(execution, times, heard=None, at=None):
    """Tick at `times`; return the last Execution and the commands, (n, 3) and their times.

    Args:
        heard: function of the robot and the time; at: {index: function of Execution}
    """
    robot, places, sent = Robot(), [], []
    for index, now in enumerate(times):
        if index in (at or {}):
            execution = at[index](execution)
        if not execution.active:
            break
        before = execution
        execution = execution.tick(now, (heard or Robot.heard)(robot, now))
        if execution.command is not None and execution is not before:
            robot.take(now, execution.command)
            places.append(execution.command.compose(TOOL).position)
            sent.append(now)
    return execution, np.array(places), np.array(sent)


def largest_step(places):
    return np.linalg.norm(np.diff(places, axis=0), axis=1).max()


def test_commands_go_from_the_first_pose_to_the_last_one_in_time():
    end = 100 + WAY.duration
    execution, places, sent = run(begun(), 100 + np.arange(0, WAY.duration + 3, PERIOD))
    assert execution.phase == 'succeeded' and execution.cause == Cause.DONE
    np.testing.assert_allclose(places[[0, -1]], [PLAN.grippers[0].position,
                                                 PLAN.grippers[-1].position], atol=1e-9)
    np.testing.assert_allclose(execution.command.compose(TOOL).matrix, PLAN.grippers[-1].matrix,
                               atol=1e-9)
    within = sent < end
    expected = [pose.position for pose in WAY.at(sent[within] - 100)[0]]
    np.testing.assert_allclose(places[within], expected, atol=1e-9)
    assert execution.tick(sent[-1] + 1, None) is execution  # nothing more is commanded


def test_ticks_that_are_late_now_and_then_do_not_slow_the_motion_down():
    jitter = np.random.default_rng(3).uniform(0, 0.5 * PERIOD, 300)
    times = np.arange(300) * PERIOD + jitter
    execution, places, _ = run(begun(), times)
    assert execution.done == pytest.approx(times[-1] - times[0], abs=1.5 * PERIOD)
    assert largest_step(places) <= 1.2 * REGULAR


def test_what_was_lost_is_not_made_up_for():
    # 0.4 s late once, and from then on two ticks a period: one of them catches up, no more
    times = np.concatenate([np.arange(100) * PERIOD, 2.4 + np.arange(100) * PERIOD / 2])
    execution = run(begun(), times)[0]
    assert execution.done <= 99 * PERIOD + 2 * PERIOD + times[-1] - 2.4 + 1e-9


FAULTS = {'stopped for 4 s': 4.0, 'just too long': 0.5, 'loaded machine': 0.3}


@pytest.mark.every(2)
@pytest.mark.parametrize('name', FAULTS)
def test_no_lateness_makes_a_leap(name):
    times = np.arange(500) * PERIOD
    times[150:] += FAULTS[name]
    times[300:] += FAULTS[name]
    execution, places, sent = run(begun(), times)
    assert largest_step(places) <= 1.2 * REGULAR
    if FAULTS[name] + PERIOD > 0.5:  # it stays where it was, and says so
        assert (execution.phase, execution.cause) == ('stopped', Cause.PAUSED)
        assert 'execute.longest_pause = 0.5 s' in execution.reason
        assert f'{FAULTS[name] + PERIOD:.3g} s' in execution.reason
        np.testing.assert_array_equal(places[-1], places[-2])
        assert len(places) == 151
    else:
        assert execution.phase == 'running'
    assert run(begun(longest_pause=0.0), times)[0].phase == 'running'


def test_a_pause_while_it_stops_does_not_hide_why_it_stops():
    execution = run(begun(), np.arange(100) * PERIOD)[0].canceled()
    assert execution.phase == 'stopping'
    paused = execution.tick(execution.last + 4.0, execution.feedback)
    assert (paused.phase, paused.cause) == ('stopped', Cause.CANCELED)
    assert paused.reason == 'canceled'


def test_poses_that_are_not_believed_any_more_stop_it_calmly():
    # as when the clock of the node jumps, and that of the publisher does not
    last = []

    def heard(robot, now):
        if now <= 3.0:
            last[:] = [robot.heard(now)]
        return last[0]

    execution, places, _ = run(begun(), np.arange(500) * PERIOD, heard)
    assert (execution.phase, execution.cause) == ('stopped', Cause.GRIPPER_POSE_LOST)
    assert largest_step(places) <= 1.2 * REGULAR


def differences(places):
    """Return velocities and accelerations by differences."""
    speeds = np.diff(places, axis=0) / PERIOD
    return speeds, np.diff(speeds, axis=0) / PERIOD


@pytest.mark.every(3)
@pytest.mark.parametrize('index', range(20, 460, 40))
def test_cancel_decelerates_within_the_limits(index):
    execution, places, sent = run(begun(), np.arange(520) * PERIOD, at={
        index: Execution.canceled})
    assert (execution.phase, execution.cause) == ('stopped', Cause.CANCELED)
    speeds, accelerations = differences(places)
    assert np.linalg.norm(accelerations, axis=1).max() <= 1.05 * WAY.limits.linear_acceleration
    jerks = np.diff(accelerations, axis=0) / PERIOD
    assert np.linalg.norm(jerks, axis=1).max() <= 1.6 * WAY.limits.linear_jerk
    assert np.linalg.norm(speeds[-1]) < 1e-3  # at rest
    assert sent[-1] - sent[index - 1] < 1.5  # and soon
    # on its way: the gripper is nowhere where it was not planned to be
    way = WAY.frames(np.linspace(0, WAY.duration, 20_001))[0]
    assert max(np.linalg.norm(way - place, axis=1).min() for place in places[index:]) < 5e-5


def test_cancel_without_deceleration_ends_with_the_last_command():
    execution, places, sent = run(begun(decelerate_on_cancel=False), np.arange(500) * PERIOD,
                                  at={100: Execution.canceled})
    assert execution.phase == 'stopped' and len(places) == 100


def test_the_first_reason_stays_and_a_machine_that_ended_does_not_begin_again():
    stopping = run(begun(), np.arange(150) * PERIOD)[0].stop(Cause.OBSTACLES_CHANGED, 'a box')
    assert stopping.phase == 'stopping'
    again = stopping.canceled()
    assert (again.cause, again.reason) == (Cause.OBSTACLES_CHANGED, 'a box')
    ended = run(stopping, 3 + np.arange(100) * PERIOD)[0]
    assert (ended.phase, ended.reason) == ('stopped', 'a box')
    assert ended.canceled() is ended and not ended.active
    assert begun().canceled().phase == 'stopped'  # nothing was commanded yet


def off(meters=0.0, radians=0.0, after=2.0, **more):
    """Return poses of a robot that is off its way from `after` s on."""
    def heard(robot, now):
        there = robot.heard(now, **more)
        if now < after:
            return Feedback(there.pose, now)
        away = Pose((0, 0, meters), (np.sin(radians / 2), 0, 0, np.cos(radians / 2)))
        return Feedback(there.pose.compose(away), now, **more)
    return heard


@pytest.mark.parametrize(('heard', 'cause', 'named'), [
    (off(meters=0.035), Cause.PATH_TOLERANCE, 'constraints.path.position = 0.02 m'),
    (off(radians=0.2), Cause.PATH_TOLERANCE, 'constraints.path.angle = 0.1 rad'),
    (off(deviation=0.03), Cause.SHAPE_TOLERANCE, 'constraints.path.shape = 0.02 m'),
    (off(age=0.2), Cause.GRIPPER_POSE_LOST, 'incoming_command_timeout = 0.1 s'),
    (lambda robot, now: None, Cause.GRIPPER_POSE_LOST, 'none came')])
def test_faults_on_the_way_stop_it_with_the_reason(heard, cause, named):
    execution, places, _ = run(begun(path_shape=0.02), np.arange(520) * PERIOD, heard)
    assert (execution.phase, execution.cause) == ('stopped', cause)
    assert named in execution.reason
    if len(places) > 2:
        accelerations = differences(places)[1]
        assert np.linalg.norm(accelerations, axis=1).max() <= 0.525
        assert 1.9 < len(places) * PERIOD < 3.5


@pytest.mark.parametrize(('guards', 'heard'), [
    ({'path_position': 0.0}, off(meters=0.035)), ({'path_angle': 0.0}, off(radians=0.2)),
    ({}, off(deviation=0.03)), ({'incoming_command_timeout': 0.0}, off(age=0.2)),
    ({'incoming_command_timeout': 0.3}, off(age=0.2))])
def test_guards_that_are_off_do_not_stop_it(guards, heard):
    execution = run(begun(**guards), np.arange(300) * PERIOD, heard)[0]
    assert execution.phase == 'running'


def test_a_robot_that_lags_by_a_tenth_of_a_second_is_followed_to_the_end():
    times = np.arange(0, WAY.duration + 3, PERIOD)
    execution = run(begun(), times, lambda robot, now: robot.heard(now, age=0.03))[0]
    assert execution.phase == 'succeeded'


def test_a_robot_that_stands_still_is_noticed():
    still = Robot()
    execution, places, _ = run(begun(), np.arange(520) * PERIOD,
                               lambda robot, now: still.heard(now))
    assert execution.cause == Cause.PATH_TOLERANCE
    assert np.linalg.norm(places[-1] - places[0]) < 0.06


def short_of_the_goal(robot, now):
    there = robot.heard(now)
    return Feedback(Pose(there.pose.position + (0, 0.015, 0), there.pose.quaternion), now)


def turned_at_the_goal(robot, now):
    heard = Robot.heard(robot, now)
    return Feedback(heard.pose.compose(Pose((0, 0, 0), (0, 0, 0.04, np.sqrt(1 - 0.04**2)))), now)


@pytest.mark.parametrize(('position', 'angle', 'phase'), [
    (0.0, 0.05, 'stopped'), (0.0, 0.09, 'succeeded'), (0.01, 0.0, 'succeeded')])
def test_at_the_goal_each_tolerance_counts_by_itself(position, angle, phase):
    guards = {'path_angle': 0.0, 'goal_position': position, 'goal_angle': angle}
    execution, _, _ = run(begun(**guards), np.arange(0, WAY.duration + 4, PERIOD),
                          turned_at_the_goal)
    assert execution.phase == phase
    assert ('constraints.goal.angle = 0.05 rad' in execution.reason) == (phase == 'stopped')


def test_the_goal_has_to_be_reached_in_time():
    times = np.arange(0, WAY.duration + 6, PERIOD)
    execution, places, sent = run(begun(), times, short_of_the_goal)
    assert (execution.phase, execution.cause) == ('stopped', Cause.GOAL_TOLERANCE)
    assert 'constraints.goal.position = 0.01 m' in execution.reason
    assert sent[-1] == pytest.approx(WAY.duration + 2.0, abs=0.05)  # it was waited for
    assert largest_step(places[-90:]) == 0.0
    for more, phase in (({'goal_time': 0.0}, 'settling'), ({'goal_position': 0.02}, 'succeeded'),
                        ({'goal_position': 0.0, 'goal_angle': 0.0}, 'succeeded'),
                        ({'goal_time': 0.0, 'cmd_timeout': 3.0}, 'stopped')):
        assert run(begun(**more), times, short_of_the_goal)[0].phase == phase


def test_the_time_of_the_goal_counts_before_that_of_the_last_command():
    assert [Guards(goal_time=goal, cmd_timeout=last).patience for goal, last in (
        (2.0, 3.0), (3.0, 2.0), (0.0, 3.0), (2.0, 0.0), (0.0, 0.0))] == [2.0, 3.0, 3.0, 2.0, np.inf]


def test_without_poses_the_goal_is_not_reached():
    unheard = begun(incoming_command_timeout=0.0)
    execution, _, _ = run(unheard, np.arange(0, WAY.duration + 4, PERIOD), lambda *_: None)
    assert (execution.phase, execution.cause) == ('stopped', Cause.GOAL_TOLERANCE)
    assert 'no pose came' in execution.reason


@pytest.mark.parametrize(('age', 'phase'), [(0.075, 'running'), (0.085, 'stopping')])
def test_a_pose_that_waits_to_be_heard_ages_by_a_period_at_most(age, phase):
    there = WAY.at([0.0])[0][0].compose(TOOL.inverse())
    execution = begun().tick(0.0, Feedback(there, 0.0))
    execution = execution.tick(PERIOD, Feedback(there, PERIOD - 0.5, age=age))
    assert execution.phase == phase


@pytest.mark.parametrize(('late', 'phase'), [(7, 'running'), (30, 'stopped')])
def test_a_late_machine_does_not_blame_the_poses_that_are_as_late_to_be_heard(late, phase):
    # ticks come every 60 ms for a while, and poses are not served before; then they are lost
    times = np.cumsum(np.where((np.arange(200) >= 100) & (np.arange(200) < 140), 0.06, PERIOD))
    kept = []

    def heard(robot, now):
        index = int(np.searchsorted(times, now - 1e-9))
        if not 100 <= index < 100 + late or not kept:
            kept[:] = [robot.heard(now)]
        return kept[0]

    guards = {'incoming_command_timeout': 0.15, 'path_position': 0.0}
    execution = run(begun(**guards), times, heard)[0]
    assert execution.phase == phase


def test_the_goal_waits_for_single_commands_that_are_behind_by_more_than_its_time():
    times, now = [], 100.0
    while now < 160 + WAY.duration:  # 3.5 s late before the end
        times.append(now)
        now += 0.6 if len(times) % 20 == 0 and len(times) <= 120 else PERIOD
    ended = run(Execution(WAY, TOOL.inverse(), 'world', Guards(
        0.0, 0.0, goal_time=2.0, incoming_command_timeout=0.0), PERIOD, 1.0), times)[0]
    assert (ended.phase, ended.cause) == ('succeeded', Cause.DONE), ended.reason


def test_late_ticks_do_not_take_the_time_that_the_gripper_has_to_come_there():
    first, settling = WAY.at([0.0])[0][0].compose(TOOL.inverse()), []
    execution = Execution(WAY, TOOL.inverse(), 'world', Guards(
        0.0, 0.0, 0.0, 0.01, 0.05, 2.0, incoming_command_timeout=0.0), PERIOD, 1.0)
    now = 100.0
    while execution.active and now < 200 + WAY.duration:
        there = execution.command if len(settling) > 15 else first
        execution = execution.tick(now, Feedback(there, now))
        if execution.phase == 'settling' and execution.alone:
            settling.append(now)
        now += 0.5 if settling else PERIOD
    assert execution.phase == 'succeeded', execution.reason
    assert settling[-1] - settling[0] > 5.0
