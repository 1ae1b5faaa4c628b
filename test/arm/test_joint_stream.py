# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion that is told to the joints piece by piece, by a stand-in of the controller; no node.

What is looked at is what the controller commands, 500 times a second, through the kinematics.
"""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from robot_arms import PANDA_READY, UR5_READY, panda, placed_by_hand, timed, ur5, way
from streams import ROUNDED, largest
from trajectory_controller import TrajectoryController

from dlo_planner import Limits, Pose
from dlo_planner.arm.inverse_kinematics import IKFailure, solve
from dlo_planner.arm.joint_stream import JointStream, followed, settling_time
from dlo_planner.execute.causes import Cause
from dlo_planner.execute.execution import Execution
from dlo_planner.execute.guards import Feedback, Guards
from dlo_planner.identify.online_trajectory import Change, CorrectedTrajectory
from msg_helpers.trajectories import joint_points_msg

LIMITS, PERIOD, RATE = Limits(), 0.02, 0.002
FULL = Limits(*(0.95 * LIMITS.sizes).ravel())
TOOL = Pose((0.0, 0.0, 0.1), (0.0, 0.6, 0.0, 0.8))  # the gripper in the frame of the tool link
CLOCK, SETTLING = 1.7e9, settling_time(LIMITS)
HEARD = 0.1  # s in which a message is heard
STEADY = Guards(path_position=0.02, path_angle=0.1)


def motion(arm, joints, shift=(0.0, 0.25, 0.1), turn=(0.0, 0.0, 0.6), limits=FULL):
    """Return the motion of the gripper that an arm holds."""
    return timed(way(arm.pose(joints).compose(TOOL), shift, turn), limits)


class Cell:
    """The machine, the arm's stream, and a controller that hears of it some time later."""

    def __init__(self, arm, joints, way, late=0.0, off=0.0, seed=0, **controller):
        self.arm, self.rng, self.late = arm, np.random.default_rng(seed), late
        self.execution = Execution(way, TOOL.inverse(), 'world', STEADY, PERIOD, 1.0, LIMITS,
                                   begin=-SETTLING, done=-SETTLING)
        self.stream = JointStream(arm, np.array(joints, float), PERIOD, SETTLING)
        # it holds the arm where it was led to, which is not quite where it is
        self.led = TrajectoryController(arm.joints, np.array(joints) + off, **controller)
        self.joints, self.speeds = np.array(joints, float), np.zeros(len(joints))
        self.off, self.coming, self.told = off, [], None
        self.commands, self._grippers, self.lost = [], [], lambda time: False
        self.samples = 0

    def run(self, end, events=None):
        """Run to `end` s after the beginning; `events`: {time: function of this}."""
        for k in range(self.samples, round(end / RATE)):
            now = k * RATE
            for time, event in (events or {}).items():
                if abs(time - now) < RATE / 2:
                    event(self)
            if k % round(PERIOD / RATE) == 0:
                self.tick(now)
            heard = [one for one in self.coming if one[0] <= now]
            self.coming = [one for one in self.coming if one[0] > now]
            for _, msg in heard:
                self.led.hear(msg, CLOCK + now)
            command = self.led.update(CLOCK + now, self.joints, self.speeds)
            self.commands.append(command.copy())
            # the arm follows a little off, as it does by its weight
            self.speeds = (command - self.off - self.joints) / RATE
            self.joints = command - self.off
        self.samples = round(end / RATE)
        return self

    def tick(self, now):
        if not self.execution.active:
            return
        here = Feedback(self.arm.pose(self.joints), now, stamp=CLOCK + now)
        self.execution = execution = self.execution.tick(now, here, CLOCK + now)
        if execution.ahead is self.told or not execution.active:
            return
        self.told = ahead = execution.ahead
        points = self.stream.ahead(execution.stamp, ahead.poses,
                                   execution.published_until - execution.done,
                                   execution.phase == 'stopping')
        if points is not None and not self.lost(now):
            self.coming.append((now + self.rng.uniform(0, self.late),
                                joint_points_msg(self.arm.joints, points)))

    @property
    def grippers(self):
        """Poses of the gripper that was commanded, one a sample."""
        self._grippers += [self.arm.pose(joints).compose(TOOL)
                           for joints in self.commands[len(self._grippers):]]
        return self._grippers

    def largest(self):
        """Return the largest part of the limits that is used, by differences over a period."""
        step, poses = round(PERIOD / RATE), self.grippers
        return max(largest(poses[k::step], LIMITS, PERIOD) for k in range(step))

    def off_way(self, way):
        """Return how far the gripper is off its motion at most, m; it begins after the settling."""
        times = RATE * np.arange(len(self.commands)) - SETTLING
        there = way.frames(times)[0]
        here = np.array([pose.position for pose in self.grippers])
        return np.linalg.norm(here - there, axis=1)[times > 0].max()


ARMS = {'ur5': (ur5, UR5_READY), 'panda': (panda, PANDA_READY)}


@pytest.mark.every(2)
@pytest.mark.parametrize(('name', 'controller'), [
    ('ur5', {'tolerance': 0.02}), ('ur5', {'open_loop': True, 'defers': True}),
    ('panda', {'has_velocities': False}), ('panda', {'open_loop': True})])
def test_the_controller_leads_the_gripper_along_its_motion_within_the_limits(name, controller):
    make, ready = ARMS[name]
    arm = make()
    going = motion(arm, ready)
    cell = Cell(arm, ready, going, late=0.09, **controller)
    cell.run(going.duration + SETTLING + 0.6)
    assert cell.execution.phase == 'succeeded', cell.execution.reason
    assert cell.led.taken > 10 and not cell.led.refused and not cell.led.held
    assert cell.largest() <= ROUNDED
    assert cell.off_way(going) < 2e-5
    by_hand = placed_by_hand(arm.urdf, arm.tool_link, dict(zip(
        arm.joints, cell.commands[-1], strict=True)))
    np.testing.assert_allclose(by_hand @ TOOL.matrix, going.poses([100.0])[0].matrix, atol=1e-6)
    used = np.abs(np.diff(cell.commands, axis=0) / RATE).max(axis=0) / arm.speeds
    assert used.max() < 1


def test_it_begins_calmly_where_the_controller_holds_the_arm_a_little_off():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going, late=0.05, off=3e-4, open_loop=True)
    cell.run(going.duration + SETTLING + 0.6)
    away = np.linalg.norm(cell.grippers[0].position - going.poses([0.0])[0].position)
    assert 1e-4 < away < 1e-3  # it has a way to go
    assert cell.execution.phase == 'succeeded', cell.execution.reason
    assert cell.largest() <= ROUNDED
    assert cell.off_way(going) < 2e-5


def test_messages_that_are_lost_change_nothing_as_long_as_others_come():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going, late=0.05)
    cell.lost = lambda now: now > 0.1 and round(now / 0.2) % 4 != 0  # three of four
    cell.run(going.duration + SETTLING + 0.6)
    assert cell.execution.phase == 'succeeded', cell.execution.reason
    assert cell.led.taken < 8
    assert cell.largest() <= ROUNDED and cell.off_way(going) < 2e-5


def test_an_arm_that_hears_no_more_comes_to_rest_on_its_way_and_is_stopped():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going)
    cell.lost = lambda now: now > 1.0
    cell.run(6.0)
    assert cell.largest() <= ROUNDED
    assert (cell.execution.phase, cell.execution.cause) == ('stopped', Cause.PATH_TOLERANCE)
    still = np.ptp(np.array(cell.commands)[-500:], axis=0).max()
    assert still == 0
    there = cell.grippers[-1].position
    asides = np.linalg.norm(going.frames(np.arange(0, 5, 1e-3))[0] - there, axis=1)
    assert asides.min() < 1e-4


@pytest.mark.every(3)
@pytest.mark.parametrize('late', [0.0, 0.09])
@pytest.mark.parametrize('at', [0.1, 0.5, 1.2, 2.6])
def test_cancel_is_a_trajectory_to_rest_within_the_limits(at, late):
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going, late=late, seed=3)

    def cancels(cell):
        cell.execution = cell.execution.canceled()

    cell.run(at + 2.0, {at: cancels})
    assert (cell.execution.phase, cell.execution.cause) == ('stopped', Cause.CANCELED)
    assert cell.largest() <= ROUNDED
    moving = np.abs(np.diff(cell.commands, axis=0)).max(axis=1) > 1e-9
    assert not moving.any() or np.flatnonzero(moving)[-1] * RATE < at + 1.2
    there = cell.execution.command.position
    np.testing.assert_allclose(ur5().pose(cell.commands[-1]).position, there, atol=1e-6)


def test_a_stop_that_is_not_heard_is_said():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going, late=0.05, seed=2)
    cell.lost = lambda now: now > 1.19  # the message of the stop, and all later ones
    cell.execution = replace(cell.execution, guards=Guards(path_position=0.01, path_angle=0.1))

    def cancels(cell):
        cell.execution = cell.execution.canceled()

    cell.run(4.0, {1.2: cancels})
    away = np.linalg.norm(ur5().pose(cell.commands[-1]).position - cell.execution.command.position)
    assert away > 0.05 and cell.largest() <= ROUNDED  # it went on as far as it had been told
    assert (cell.execution.phase, cell.execution.cause) == ('stopped', Cause.PATH_TOLERANCE)
    assert cell.execution.reason.startswith('canceled; the stop is not followed: ')


def test_a_correction_is_spliced_in_where_nothing_was_told_yet():
    going = motion(ur5(), UR5_READY, limits=Limits(*(0.5 * LIMITS.sizes).ravel()))
    moved = np.array([[0.01, 0, 0, 0.0, 0.005, 0.002]])
    cell = Cell(ur5(), UR5_READY, going, late=0.09, seed=5)

    def corrects(cell):
        spliced = replace(CorrectedTrajectory(going, np.array([0.8, 0.7, 0.1])),
                          changes=(Change(cell.execution.free, np.zeros(1), moved),))
        cell.execution = cell.execution.corrected(spliced)
        assert not cell.execution.refusal
        cell.way = cell.execution.way

    cell.run(going.duration + SETTLING + 1.2, {1.0: corrects})
    assert cell.execution.phase == 'succeeded', cell.execution.reason
    assert cell.off_way(cell.way) < 2e-5
    assert np.linalg.norm(cell.grippers[-1].position - going.poses([99.0])[0].position) > 0.005
    assert cell.largest() <= ROUNDED


def test_an_arm_that_is_blocked_is_held_by_its_controller_and_stopped():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going, late=0.05, tolerance=0.03)
    cell.run(1.5)
    stuck = cell.joints.copy()
    update = cell.led.update
    cell.led.update = lambda now, joints, speeds: update(now, stuck, 0 * speeds)
    places = []
    tick = cell.tick

    def blocked(now):
        cell.joints = stuck  # where encoders see it
        places.append(np.abs(cell.commands[-1] - stuck).max())
        tick(now)

    cell.tick = blocked
    cell.run(5.0)
    assert cell.led.held
    assert (cell.execution.phase, cell.execution.cause) == ('stopped', Cause.PATH_TOLERANCE)
    assert max(places) <= 0.03 and not cell.led.refused


@pytest.mark.every(2)
@pytest.mark.parametrize('defers', [True, False])
def test_a_controller_whose_clock_is_behind_hears_what_it_knows(defers):
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going, defers=defers)
    tick = cell.tick
    cell.tick = lambda now: tick(now + 0.15) if now > 0 else tick(0.0)
    cell.run(going.duration + SETTLING + 0.6)
    assert cell.largest() <= ROUNDED
    assert not cell.led.refused


@pytest.mark.every(2)
@pytest.mark.parametrize(('name', 'shift'), [('ur5', (0.0, 0.25, 0.1)), ('panda', (0.0,) * 3)])
def test_a_second_motion_begins_where_the_first_one_rests(name, shift):
    make, ready = ARMS[name]
    going = motion(make(), ready, shift)  # or turns on the spot
    cell = Cell(make(), ready, going, late=0.05, seed=7)
    cell.run(going.duration + SETTLING + 1.0)
    end = going.poses([100.0])[0]
    back = timed(way(end, (0.0, -0.1, 0.0)), FULL)
    cell.execution = Execution(back, TOOL.inverse(), 'world', STEADY, PERIOD, 1.0, LIMITS,
                               begin=-HEARD, done=-HEARD)
    begun = len(cell.commands) * RATE + 0.007  # off the beat of the first one
    tick = cell.tick
    cell.tick = lambda now: tick(now + 0.007)
    cell.run(begun + back.duration + 1.0)
    assert cell.execution.phase == 'succeeded', cell.execution.reason
    assert cell.largest() <= ROUNDED
    np.testing.assert_allclose(cell.grippers[-1].position, back.poses([100.0])[0].position,
                               atol=1e-6)


def test_what_the_arm_cannot_do_is_not_told():
    arm = ur5()
    far = motion(arm, UR5_READY, shift=(1.5, 0.0, 0.0), turn=(0.0, 0.0, 0.0))
    cell = Cell(arm, UR5_READY, far)
    with pytest.raises(IKFailure) as failure:
        cell.run(far.duration)
    assert failure.value.constraint in ('reach', 'joint_speed', 'continuity', 'self_collision')
    before = len(cell.commands)
    # the machine stops it: what was told before ends at rest, and so does what is told then
    cell.execution = replace(cell.execution, ahead=cell.told).stop(Cause.ARM, 'as it said')
    cell.samples = before
    cell.run(before * RATE + 3.0)
    assert cell.largest() <= ROUNDED
    assert np.ptp(np.array(cell.commands)[-100:], axis=0).max() == 0


@pytest.mark.parametrize(('shift', 'constraint'), [
    ((0.0, 0.0, 0.9), 'reach'), ((0.0, 0.0, -0.9), 'self_collision')])
def test_a_whole_way_is_judged_before(shift, constraint):
    arm = ur5()
    poses = [pose.compose(TOOL.inverse()) for pose in way(
        arm.pose(UR5_READY).compose(TOOL), shift, number=2000)]
    with pytest.raises(IKFailure) as failure:
        followed(arm, poses, UR5_READY, PERIOD)
    assert failure.value.constraint == constraint, failure.value.words


def test_a_joint_that_is_too_fast_is_refused():
    arm = ur5()
    poses = way(arm.pose(UR5_READY), (0.0, 0.25, 0.0), number=30)
    assert followed(arm, poses, UR5_READY, PERIOD).shape == (30, 6)
    with pytest.raises(IKFailure, match=r'would move at .* rad/s: expected at most 3\.1') as found:
        followed(arm, poses, UR5_READY, PERIOD / 10)
    assert found.value.constraint == 'joint_speed'


def test_the_settling_keeps_half_of_the_limits_and_no_less_time():
    steps = np.linspace(0, 1, 2001)
    curve = steps**3 * (10 - 15 * steps + 6 * steps**2)
    for limits in (Limits(), Limits(0.02, 1.0, 0.05, 5.0, 0.1, 50.0)):
        step, used = settling_time(limits) / 2000, []
        for part, way_ in enumerate((1e-3, 5e-3)):
            used += [np.abs(np.diff(way_ * curve, n)).max() / step**n / limits.sizes[n - 1, part]
                     for n in (1, 2, 3)]
        assert max(used) == pytest.approx(0.5, rel=5e-3)


def test_a_halt_at_once_is_one_point_at_rest():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going)
    cell.run(1.5)
    points = cell.stream.held(cell.execution.stamp, cell.execution.command)
    msg = joint_points_msg(ur5().joints, points)
    assert cell.led.hear(msg, CLOCK + 1.5)
    cell.tick = lambda now: None
    cell.run(3.0)
    np.testing.assert_allclose(ur5().pose(cell.commands[-1]).matrix,
                               cell.execution.command.matrix, atol=1e-6)
    assert np.ptp(np.array(cell.commands)[-500:], axis=0).max() == 0


def test_an_arm_that_rests_is_told_so_first():
    stream = JointStream(ur5(), UR5_READY, PERIOD, SETTLING)
    points = stream.resting(CLOCK)
    assert (points.stamp, points.times.tolist()) == (CLOCK, [SETTLING])
    np.testing.assert_array_equal(points.positions, [UR5_READY])
    pose = ur5().pose(UR5_READY)
    later = stream.ahead(CLOCK + 2.013, [pose] * 60, 1.0, stops=False)
    np.testing.assert_allclose(later.positions, np.tile(UR5_READY, (len(later.times), 1)),
                               atol=1e-9)
    assert later.stamp == pytest.approx(CLOCK + 1.813, abs=1e-6)


def test_a_joint_stays_within_its_limits():
    arm = ur5()
    poses = way(arm.pose(UR5_READY), (0.0, 0.2, 0.0), number=200)
    ways = followed(arm, poses, UR5_READY, PERIOD)
    joint = int(np.argmax(np.ptp(ways, axis=0)))
    least, most = ways[:, joint].min(), ways[:, joint].max()
    root = ElementTree.fromstring(arm.urdf)
    limit = root.find(f".//joint[@name='{arm.joints[joint]}']/limit")
    limit.set('lower', str(least - 1.0))
    limit.set('upper', str(0.5 * (least + most)))
    narrow = replace(arm, urdf=ElementTree.tostring(root, encoding='unicode'))
    begin = ways[-1] if ways[-1, joint] == least else ways[0]
    with pytest.raises(IKFailure, match=f'{arm.joints[joint]} = .* expected') as found:
        followed(narrow, poses if begin is ways[0] else poses[::-1], begin, PERIOD)
    assert found.value.constraint == 'joint_limit'


def test_what_is_told_is_never_over_when_it_is_heard():
    stream = JointStream(ur5(), UR5_READY, PERIOD, SETTLING)
    stream.resting(CLOCK)
    points = stream.ahead(CLOCK + 1.0, [ur5().pose(UR5_READY)], 0.0, stops=True)
    assert points.stamp + points.times[-1] >= CLOCK + 1.2 - 1e-6
    assert not points.velocities[-1].any() and not points.accelerations[-1].any()


@pytest.mark.parametrize('name', ARMS)
def test_what_is_told_again_is_told_the_same(name):
    make, ready = ARMS[name]
    arm = make()
    back = TOOL.inverse()
    poses = [pose.compose(back) for pose in motion(arm, ready).poses(
        PERIOD * np.arange(120))]
    stream, told = JointStream(arm, ready, PERIOD, SETTLING), []
    stream.resting(CLOCK)
    for k in range(0, 60, 10):
        ahead = [*poses[k:k + 50], *poses[k + 50:k + 60:2]]  # and a way to rest, of a kind
        told.append(stream.ahead(CLOCK + 1.0 + k * PERIOD, ahead, 1.0, stops=False))
    for one, other in zip(told[1:], told[2:], strict=False):
        shift = round((other.stamp - one.stamp) / PERIOD)
        shared = 50 + 10 - shift - 3  # what the way to rest does not bend
        for part in ('positions', 'velocities', 'accelerations'):
            np.testing.assert_allclose(getattr(other, part)[:shared],
                                       getattr(one, part)[shift:shift + shared], atol=1e-9)


def test_while_it_settles_it_is_told_once():
    going = motion(ur5(), UR5_READY)
    cell = Cell(ur5(), UR5_READY, going)
    cell.run(SETTLING - 0.01)
    assert cell.led.taken == 1
    cell.run(SETTLING + 0.5)
    assert cell.led.taken >= 3


def test_what_was_told_is_not_solved_again(monkeypatch):
    solved = []

    def counted(chain, positions, *rest, **more):
        solved.append(positions)
        return solve(chain, positions, *rest, **more)

    monkeypatch.setattr('dlo_planner.arm.joint_stream.solve', counted)
    poses = [pose.compose(TOOL.inverse()) for pose in motion(ur5(), UR5_READY).poses(
        PERIOD * np.arange(120))]
    stream = JointStream(ur5(), UR5_READY, PERIOD, SETTLING)
    stream.resting(CLOCK)
    stream.ahead(CLOCK + 1.0, poses[:60], 1.0, stops=False)
    first = len(solved)
    stream.ahead(CLOCK + 1.2, poses[10:70], 1.0, stops=False)
    assert first <= 61 and len(solved) - first <= 12


def test_a_motion_that_begins_elsewhere_is_refused():
    there = ur5().pose(UR5_READY + np.array([0.8, 0, 0, 0, 0, 0]))
    with pytest.raises(IKFailure, match='shoulder_pan_joint would have to go from 0.3 to 1.1 at'):
        followed(ur5(), [there], UR5_READY, PERIOD)
