# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is told of the coming time: the machine may be late, the motion is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from wires import threaded

from dlo_planner import Limits, Pose, Trajectory
from dlo_planner.cell.robot import Robot, Timetable
from dlo_planner.execute.causes import Cause
from dlo_planner.execute.execution import Ahead, Execution, places_ahead
from dlo_planner.execute.guards import Feedback, Guards
from dlo_planner.identify.online_trajectory import Change, CorrectedTrajectory
from msg_helpers.trajectories import poses_ahead, stamped_poses

PLAN = threaded()
TOOL = Pose((0, 0, 0.1), (0, 0.6, 0, 0.8))
WAY = Trajectory(PLAN, Limits(), tolerance=np.inf)
PERIOD, STEP, HORIZON = 0.02, 0.01, 1.0
CLOCK = 1.7e9 - 100.0  # of the stamps against the steady clock, s
PERIOD_STEPS = 2
CLOSE = 1e-4           # m: a robot goes straight between two poses that are a period apart


def coming(execution):
    """Return what a robot would be told now of the coming time."""
    return Ahead.of(execution, *execution.way.frames(places_ahead(execution)))


class Line:
    """A machine that ticks when it can, and a robot that hears of it some time later."""

    def __init__(self, way=WAY, late=0.0, seed=0, clock=lambda now: now + CLOCK):
        self.execution = Execution(way, TOOL.inverse(), 'world', Guards(), PERIOD, HORIZON)
        self.table, self.coming, self.told = Timetable(), [], None
        self.rng, self.late, self.clock = np.random.default_rng(seed), late, clock
        self.places, self.due = [], 100.0
        self.there = PLAN.grippers[0].compose(TOOL.inverse())  # the tool frame

    def run(self, end, events=None):
        """Run to `end` s after the beginning; `events`: {time: function of this}."""
        for k in range(len(self.places), round(end / STEP)):
            now = 100.0 + k * STEP
            for time, event in (events or {}).items():
                if abs(time - k * STEP) < STEP / 2:
                    event(self)
            if now >= self.due - 1e-9:
                self.due = now + PERIOD + self.rng.uniform(0, self.late) * (
                    self.rng.random() < 0.2)
                self.tick(now)
            self.coming = [one for one in self.coming if not self.arrived(one, now)]
            self.there = self.table.at(self.clock(now)) or self.there
            self.places.append(self.there.compose(TOOL).position)
        return np.array(self.places)

    def tick(self, now):
        execution, stamp = self.execution, self.clock(now)
        if not execution.active:
            return
        there = self.table.at(stamp) or self.there
        self.execution = execution.tick(now, Feedback(there, now, stamp=stamp), stamp)
        ahead = self.execution.last_published, self.execution.phase
        if self.execution.active and ahead != self.told:
            self.told = ahead
            msg = poses_ahead(*coming(self.execution), 'world', self.execution.stamp)
            self.coming.append((now + self.rng.uniform(0, 0.5 * STEP + 0.1 * self.late), msg))

    def arrived(self, one, now):
        if one[0] > now:
            return False
        self.table.take(*stamped_poses(one[1]))
        return True


def on_the_way(times, way=WAY):
    return np.array([pose.position for pose in way.at(times)[0]])


def rates(places):
    """Return the largest acceleration, m/s^2, by differences over the time between two poses."""
    both = places[2 * PERIOD_STEPS:] - 2 * places[PERIOD_STEPS:-PERIOD_STEPS] + places[
        :-2 * PERIOD_STEPS]
    return np.linalg.norm(both / PERIOD**2, axis=1).max()


def test_a_machine_that_is_late_delays_nothing():
    line = Line(late=0.7)
    places = line.run(WAY.duration + 1.0)
    times = np.arange(len(places)) * STEP
    assert np.linalg.norm(places - on_the_way(times), axis=1)[10:].max() < CLOSE
    assert line.execution.phase in ('settling', 'succeeded')
    assert line.execution.stall_displacement == 0


def test_a_preview_that_comes_when_the_one_before_is_used_up_delays_nothing():
    line = Line()
    line.run(3.0)
    line.due = 100.0 + line.execution.published_until  # the machine is as late as it may be,
    line.rng, line.late = SimpleNamespace(random=lambda: 1.0, uniform=lambda low, high: high), 0.85
    places = line.run(WAY.duration + 1.0)  # and then messages take 0.09 s
    times = np.arange(len(places)) * STEP
    assert line.execution.phase in ('settling', 'succeeded'), line.execution.reason
    assert np.linalg.norm(places - on_the_way(times), axis=1)[10:].max() < CLOSE


class Single(Line):
    """The same machine, and a robot that follows its single commands some time later."""

    def tick(self, now):
        before = self.execution
        self.execution = before.tick(now, Feedback(self.there, now, stamp=self.clock(now)),
                                     self.clock(now))
        if self.execution.sending is not None:
            self.coming.append((now + 2 * STEP, self.execution.sending))

    def arrived(self, one, now):
        if one[0] <= now:
            self.there = one[1]
        return one[0] <= now


def test_a_robot_that_follows_single_commands_may_be_as_late_as_the_machine():
    line = Single(late=0.22)
    line.run(3 * WAY.duration)
    assert line.execution.phase == 'succeeded', line.execution.reason
    behind = line.execution.single
    assert behind.stall_displacement > Guards().path_position  # it was that late


@pytest.mark.parametrize('kind', [Line, Single])
def test_a_robot_that_is_stuck_is_stopped_whatever_it_followed(kind):
    line = kind(late=0.22)

    def get_stuck(line):
        line.arrived = lambda *_: False
        line.table.at = lambda _: line.there

    line.run(5.0, {3.0: get_stuck})
    assert line.execution.cause == Cause.PATH_TOLERANCE


def test_without_a_horizon_what_is_late_shakes_the_dlo():
    execution = Execution(WAY, TOOL.inverse(), 'world', Guards(), PERIOD)
    lost, way = 0.3, 0.0
    for k in range(200):
        now = k * PERIOD + lost * (k > 150)
        execution = execution.tick(now, Feedback(execution.command or PLAN.grippers[0], now))
        if k == 150:
            way = np.linalg.norm(WAY.at([execution.done])[1][0, :3]) * lost
    assert way > 0.01
    assert execution.stall_displacement == pytest.approx(way, rel=0.1)


def test_a_robot_that_hears_no_more_comes_to_rest_within_its_limits():
    line = Line()
    line.run(5.0)

    def dies(line):
        line.due = np.inf

    places = line.run(10.0, {5.0: dies})
    assert np.linalg.norm(places[-1] - places[-100]) == 0
    asides = np.linalg.norm(places[:, None, :] - on_the_way(np.arange(0, 9, 1e-2))[None], axis=2)
    assert asides.min(axis=1).max() < 5e-4  # it stays on its way
    assert rates(places[495:]) < 1.1 * Limits().linear_acceleration
    line.due = 0.0
    line.run(10.1)
    assert (line.execution.phase, line.execution.cause) == ('stopped', Cause.PAUSED)
    assert 'execute.horizon = ' in line.execution.reason


@pytest.mark.every(2)
@pytest.mark.parametrize('late', [0.3, 0.0])
def test_a_correction_begins_where_nothing_was_told_yet(late):
    moved = np.array([[0, 0, 0, 0.0, 0.01, 0.005]])

    def corrects(line):
        execution = line.execution
        corrected_trajectory = replace(CorrectedTrajectory(WAY, np.array([0.8, 0.7, 0.1])),
                          changes=(Change(execution.free, np.zeros(1), moved),))
        line.began, line.way = execution.free, corrected_trajectory
        # motions are made for less than the limits, corrections have the rest
        line.execution = replace(execution, way=corrected_trajectory,
                                 limits=Limits(*(Limits().sizes / 0.95).ravel().tolist()))

    line = Line(late=late, seed=2)
    places = line.run(7.5, {4.0: corrects})
    times = np.arange(len(places)) * STEP
    assert 4.0 < line.began <= 4.0 + HORIZON
    assert np.linalg.norm(places - on_the_way(times, line.way), axis=1)[10:].max() < CLOSE
    assert np.linalg.norm(places[-1] - on_the_way(times[-1:])[0]) > 0.01


def test_cancel_does_not_wait_for_the_horizon():
    def cancels(line):
        line.execution = line.execution.canceled()

    line = Line(late=0.08, seed=1)
    places = line.run(8.0, {4.0: cancels})
    assert (line.execution.phase, line.execution.cause) == ('stopped', Cause.CANCELED)
    moving = np.linalg.norm(np.diff(places, axis=0), axis=1) > 1e-9
    assert np.flatnonzero(moving)[-1] * STEP < 5.5
    assert rates(places[350:]) < 1.3 * Limits().linear_acceleration


def test_a_stop_begins_where_a_robot_has_heard_of_it():
    line = Line()
    line.run(4.0)
    going, stopping = line.execution, line.execution.canceled()
    (times, before), (_, after) = coming(going), coming(stopping)
    slower = [np.linalg.norm(one.position - other.position) for one, other in zip(
        before, after, strict=False)]
    heard = int(np.searchsorted(times - times[0], 0.1 - 1e-9)) + 1  # 0.1 s until it has
    assert max(slower[:heard]) < 1e-9
    assert slower[heard + 4] > 1e-5


def test_who_is_canceled_at_once_has_to_be_told():
    line = Line()
    line.run(2.0)
    running = line.execution
    assert not running.ends_at_once and not running.canceled().ends_at_once
    at_once = replace(running, guards=Guards(decelerate_on_cancel=False)).canceled()
    assert (at_once.phase, at_once.ends_at_once) == ('stopped', True)
    assert not replace(at_once, horizon=0.0, published_until=0.0).ends_at_once


def test_a_clock_that_leaps_ahead_ends_it_and_one_that_is_set_back_does_not():
    ahead = Line(clock=lambda now: now + CLOCK + 5.0 * (now > 103))
    ahead.run(6.0)
    assert (ahead.execution.phase, ahead.execution.cause) == ('stopped', Cause.PAUSED)
    back = Line(clock=lambda now: now + CLOCK - 60.0 * (now > 103))
    places = back.run(6.0)
    assert back.execution.phase == 'running'
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1).max() / STEP
    assert speed < 1.2 * np.linalg.norm(WAY.at(np.arange(0, 6, STEP))[1][:, :3], axis=1).max()


REGULAR = PERIOD * np.arange(300)


def tolerated(age, horizon, timeout=0.5, times=REGULAR, stands_at=np.inf):
    """Return whether a robot that does all at once is let go on; its poses are `age` s old."""
    execution = Execution(WAY, TOOL.inverse(), 'world', Guards(
        path_position=2e-3, incoming_command_timeout=timeout), PERIOD, horizon)
    done = np.zeros(0)
    for k, now in enumerate(times):
        then = min(now - age, stands_at)
        by_itself = np.interp(then, times[:k], done) if k else 0.0
        place = max(then, 0.0) if horizon else by_itself
        there = WAY.at([place])[0][0].compose(TOOL.inverse())
        execution = execution.tick(now, Feedback(there, now, age, stamp=now - age))
        done = np.append(done, execution.done)
        if execution.phase != 'running':
            assert execution.cause == Cause.PATH_TOLERANCE
            return False
    return True


@pytest.mark.every(2)
@pytest.mark.parametrize('horizon', [0.0, HORIZON])
def test_the_gripper_is_compared_with_the_command_of_its_time(horizon):
    assert tolerated(0.1, horizon)
    assert not tolerated(0.1, horizon, stands_at=3.0)
    # the machine is late, once: the robot went on by itself, or waited
    late = REGULAR + 0.3 * (np.arange(300) > 150)
    assert tolerated(0.1, horizon, times=late)
    assert tolerated(0.01, horizon, times=late)


def test_a_command_counts_as_far_back_as_poses_may_be_old():
    assert tolerated(0.08, 0.0, timeout=0.1)
    assert not tolerated(0.4, 0.0, timeout=0.0)  # else an old pose would do for good


def test_a_timetable_and_single_commands():
    one, other, third = (Pose((x, 0.0, 0.0), (0, 0, 0, 1)) for x in (0.0, 1.0, 5.0))
    table = Timetable()
    assert table.at(3.0) is None and table.over
    table.take(np.array([1.0, 2.0]), [one, other])
    assert table.at(0.9) is None
    assert table.at(1.25).position[0] == pytest.approx(0.25)
    table.take(np.array([1.5, 3.0]), [one, third])
    assert table.at(1.25).position[0] == pytest.approx(0.0)  # what came before 1.5 ended there
    assert table.at(2.25).position[0] == pytest.approx(2.5)
    assert table.at(3.05) == third and table.at(3.2) is None
    robot = Robot(one)
    assert not robot.waits(0.0)
    robot.follow_ahead(np.array([0.0, 0.5]), [one, other])
    robot.moved(0.1, 0.01)
    assert not robot.waits(0.4) and robot.waits(0.51)
    robot.follow(third)  # it is told by stamps where to be
    for k in range(200):
        last = robot.moved(0.1 + 0.01 * k, 0.01)
    assert last.position[0] == pytest.approx(1.0, abs=1e-6)
    assert not robot.waits(9.0)  # all is done
    robot.follow(third)  # single commands come beside, and late: it does not leap back to them
    for k in range(200):
        last = robot.moved(2.1 + 0.01 * k, 0.01)
    assert last.position[0] == pytest.approx(1.0, abs=1e-6)
