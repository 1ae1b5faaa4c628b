# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion of several arms, as a machine: one time for all, limits and guards of each; no node."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from streams import ROUNDED
from wires import threaded

from dlo_planner import Limits, Pose
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import Execution, blend_from_current_pose
from dlo_planner.execute.guards import Feedback, Guards
from dlo_planner.execute.limiter import frames_of, used
from dlo_planner.plan.path import GripperPath
from dlo_planner.trajectory.timed_path import TimedPath, fastest_law, standing

PERIOD, LIMITS = 0.02, Limits()
FULL = Limits(*(0.95 * LIMITS.sizes).ravel())
LEVEL = (0, 0, 0, 1)
TURNED = tuple(Rotation.from_rotvec((0, 0, 0.8)).as_quat())
# the second arm goes three times as far as the gripper, and turns: its limits count
GRIPPER = [Pose((x, 0.0, 1.0), LEVEL) for x in (0.0, 0.05, 0.1)]
SECOND = [Pose((0.8, 3 * x, 1.0), quaternion) for x, quaternion in (
    (0.0, LEVEL), (0.05, tuple(Rotation.from_rotvec((0, 0, 0.4)).as_quat())), (0.1, TURNED))]
PATH = GripperPath.through(GRIPPER, [0.0, 1.0, 2.0], 1.0, arms={'second': SECOND})
WAY = TimedPath(PATH, tuple(fastest_law(leg, FULL) for leg in PATH.legs), FULL)
STANDS = Pose((0.4, 0.0, 0.8), LEVEL)  # an arm that holds and does not move
SHAPE = threaded(0.3, 3e-3).shapes[0]


def begun(horizon=0.0, begin=0.0, ways=None, **guards):
    """Return an Execution of three arms from `begin` s on."""
    first, *others = ways or (WAY, WAY.arm('second'), standing(STANDS, WAY.duration, LIMITS))
    made = Execution(first, Pose.identity(), 'world', Guards(**guards), PERIOD, horizon, LIMITS,
                     begin=begin, done=begin)
    return replace(made, others=tuple(
        replace(made, way=way, name=name, guards=Guards(**guards, heard=f'gripper_pose/{name}'))
        for name, way in zip(('second', 'third'), others, strict=True)))


class Robots:
    """Robots that follow single commands, or what is told ahead, at once."""

    def __init__(self, execution):
        self.execution, self.now = execution, 50.0
        self.sent = {one.name: [] for one in execution.arms}
        self.told = {one.name: {} for one in execution.arms}
        self.there = {one.name: one.way.poses([execution.begin])[0] for one in execution.arms}
        self.known = dict.fromkeys(self.sent)
        self.stuck = ()

    def run(self, steps, period=PERIOD, heard=lambda name, pose, now: Feedback(
            pose, now, stamp=now)):
        for _ in range(steps):
            if not self.execution.active:
                break
            came = {name: heard(name, pose, self.now) for name, pose in self.there.items()}
            came = {name: one for name, one in came.items() if one is not None}
            self.execution = self.execution.tick(
                self.now, came.pop('gripper', None), self.now, None, came)
            self.now += period
            for one in self.execution.arms:
                if one.sending is not None:
                    self.sent[one.name].append(one.sending)
                if one.ahead is not self.known[one.name]:
                    self.known[one.name] = one.ahead
                    begin = round(self.execution.stamp / PERIOD)
                    kept = {k: pose for k, pose in self.told[one.name].items() if k < begin}
                    self.told[one.name] = kept | {
                        begin + k: pose for k, pose in enumerate(one.ahead.poses)}
                if one.command is not None and one.name not in self.stuck:
                    self.there[one.name] = one.command
        return self

    def streams(self):
        """Return what went out to each arm, one pose in each period."""
        if not self.execution.horizon:
            return self.sent
        return {name: [table[k] for k in sorted(table)] for name, table in self.told.items()}


def parts(robots):
    """Return the largest part of the limits that each arm's commands use."""
    return {name: used(frames_of([*[poses[0]] * 3, *poses, *[poses[-1]] * 3]), LIMITS, PERIOD)
            for name, poses in robots.streams().items() if poses}


@cache
def sampled():
    """Return where the gripper and the second arm are at 20000 times of their ways, m."""
    times = np.linspace(0, WAY.duration, 20000)
    return [way.frames(times)[0] for way in (WAY, WAY.arm('second'))]


def in_step(robots):
    """Assert that at each moment all arms were sent to one time of their ways."""
    streams = robots.streams()
    assert len({len(poses) for poses in streams.values()}) == 1
    known, other = sampled()
    for first, second, third in zip(*streams.values(), strict=True):
        at = np.linalg.norm(known - first.position, axis=1).argmin()
        # 0.1 mm of the gripper are 0.3 mm of the other arm
        assert np.linalg.norm(other[at] - second.position) < 5e-4
        np.testing.assert_array_equal(third.matrix, STANDS.matrix)


@pytest.mark.parametrize('horizon', [0.0, 1.0])
def test_all_arms_go_by_one_time_to_their_ends(horizon):
    robots = Robots(begun(horizon)).run(2000)
    assert robots.execution.phase == 'succeeded'
    for name, end in (('gripper', GRIPPER[-1]), ('second', SECOND[-1]), ('third', STANDS)):
        np.testing.assert_allclose(robots.there[name].matrix, end.matrix, atol=1e-9)
    in_step(robots)
    assert max(parts(robots).values()) < ROUNDED
    assert parts(robots)['second'] > 2 * parts(robots)['gripper']


@pytest.mark.every(3)
@pytest.mark.parametrize('horizon', [0.0, 1.0])
@pytest.mark.parametrize('share', [0.1, 0.4, 0.8])
def test_a_stop_keeps_the_limits_of_the_quickest_arm(horizon, share):
    robots = Robots(begun(horizon)).run(int(share * WAY.duration / PERIOD))
    robots.execution = robots.execution.canceled()
    robots.run(2000)
    assert robots.execution.phase == 'stopped'
    in_step(robots)
    assert max(parts(robots).values()) < ROUNDED
    for one in robots.execution.arms:
        assert one.phase == 'stopped' and one.done == robots.execution.done


@pytest.mark.every(3)
@pytest.mark.parametrize('late', [1, 6, 15, 40])
@pytest.mark.parametrize('share', [0.2, 0.4, 0.95])
def test_a_stop_that_goes_out_late_begins_where_the_robots_are(late, share):
    # until it goes out they follow the preview before it
    robots = Robots(begun(1.0)).run(int(share * WAY.duration / PERIOD))
    robots.execution = robots.execution.canceled()
    robots.now += (late - 1) * PERIOD
    robots.run(2000)
    assert robots.execution.phase in ('stopped', 'succeeded')
    in_step(robots)
    assert max(parts(robots).values()) < ROUNDED


@pytest.mark.parametrize('horizon', [0.0, 1.0])
def test_an_arm_that_does_not_follow_stops_all(horizon):
    robots = Robots(begun(horizon)).run(int(0.3 * WAY.duration / PERIOD))
    robots.stuck = ('second',)
    robots.run(2000)
    execution = robots.execution
    assert (execution.phase, execution.cause) == ('stopped', Cause.PATH_TOLERANCE)
    assert 'the arm second is 0.0' in execution.reason
    assert execution.done < WAY.duration
    in_step(robots)
    assert max(parts(robots).values()) < ROUNDED


@pytest.mark.parametrize('late', [3, 8])
def test_an_arm_that_stands_still_is_noticed_when_the_preview_has_ended(late):
    # a robot that follows single commands is as far behind as this machine is
    robots = Robots(begun(1.0, path_position=0.15, path_angle=0.0,
                          incoming_command_timeout=1.0))
    robots.stuck = ('second',)
    robots.run(2000, period=late * PERIOD)
    execution = robots.execution
    assert (execution.phase, execution.cause) == ('stopped', Cause.PATH_TOLERANCE)
    assert execution.done == WAY.duration
    assert 'the arm second is 0.15' in execution.reason
    # what single commands led comes to rest within its limits
    assert execution.single.phase == 'stopped' and execution.single.done < WAY.duration
    for poses in robots.sent.values():
        frames = frames_of([*[poses[0]] * 3, *poses, *[poses[-1]] * 3])
        assert used(frames, LIMITS, PERIOD) < ROUNDED


def test_an_arm_that_should_stand_still_and_is_moved_stops_all():
    robots = Robots(begun()).run(int(0.3 * WAY.duration / PERIOD))
    robots.stuck = ('third',)
    robots.there['third'] = Pose((0.4, 0.03, 0.8), LEVEL)
    robots.run(2000)
    assert robots.execution.cause == Cause.PATH_TOLERANCE
    assert robots.execution.reason.startswith('the arm third is 0.03 m from its command')


@pytest.mark.parametrize('horizon', [0.0, 1.0])
@pytest.mark.parametrize('late', [False, True])
def test_an_arm_that_is_not_heard_stops_all(horizon, late):
    def heard(name, pose, now):
        if name == 'second' and now > 50.4:
            return Feedback(pose, now, 0.3, stamp=now - 0.3) if late else None
        return Feedback(pose, now, stamp=now)

    execution = Robots(begun(horizon)).run(2000, heard=heard).execution
    assert (execution.phase, execution.cause) == ('stopped', Cause.GRIPPER_POSE_LOST)
    assert execution.reason.startswith('gripper_pose/second: ')


def test_the_end_is_reached_when_all_arms_are_there():
    robots = Robots(begun(path_position=0.0, path_angle=0.0, goal_time=1.0))
    robots.stuck = ('second',)
    execution = robots.run(2000).execution
    assert (execution.phase, execution.cause) == ('stopped', Cause.GOAL_TOLERANCE)
    assert 'the arm second is 0.3 m from its command' in execution.reason


@pytest.mark.parametrize('pause', [0.1, 0.4])
def test_a_machine_that_is_late_leaves_no_arm_behind(pause):
    robots = Robots(begun(longest_pause=0.5, incoming_command_timeout=1.0)).run(60)
    robots.now += pause
    robots.run(2000)
    assert robots.execution.phase == 'succeeded'
    in_step(robots)
    assert max(parts(robots).values()) < (ROUNDED if pause < 0.25 else np.inf)


@pytest.mark.parametrize('name', ['gripper', 'second', 'third'])
def test_a_command_beyond_the_limits_of_one_arm_stops_all(name):
    class Leaps(TimedPath):
        """The same motion, which leaps aside in the middle."""

        def frames(self, times):
            positions, rotations = super().frames(times)
            late = np.asarray(times) > 0.4 * self.duration
            return positions + 0.02 * late[:, None] * np.array([0.0, 0.0, 1.0]), rotations

    ways = {'gripper': WAY.arm('gripper'), 'second': WAY.arm('second'),
            'third': standing(STANDS, WAY.duration, LIMITS)}
    ways[name] = Leaps(ways[name].path, ways[name].laws, ways[name].limits)
    robots = Robots(begun(ways=tuple(ways.values()))).run(2000)
    execution = robots.execution
    assert (execution.phase, execution.cause) == ('stopped', Cause.LIMITS)
    assert max(parts(robots).values()) < 1.05  # by differences of what stops from one command on
    assert len(robots.sent['gripper']) == len(robots.sent['second'])
    assert robots.sent['second'][-1].position[2] == pytest.approx(1.0, abs=1e-3)
    for poses in robots.sent.values():  # the last command is at rest
        assert np.linalg.norm(poses[-1].position - poses[-2].position) < 2e-5


def test_all_arms_come_to_where_the_plan_begins_at_once_and_calmly():
    ways = [WAY, WAY.arm('second'), standing(STANDS, WAY.duration, LIMITS)]
    here = [GRIPPER[0], Pose(SECOND[0].position + (0.01, 0.0, 0.005), LEVEL),
            Pose(STANDS.position, tuple(Rotation.from_rotvec((0.03, 0, 0)).as_quat()))]
    made, begin = blend_from_current_pose(ways, here, SHAPE, LIMITS, PERIOD)
    assert begin < 0 and made[0] is WAY
    for way, pose in zip(made, here, strict=True):
        np.testing.assert_allclose(way.poses([begin])[0].matrix, pose.matrix, atol=1e-9)
    robots = Robots(begun(begin=begin, ways=made)).run(4000)
    assert robots.execution.phase == 'succeeded'
    assert max(parts(robots).values()) < ROUNDED
    np.testing.assert_allclose(robots.there['second'].matrix, SECOND[-1].matrix, atol=1e-9)
    slow = Limits(*(1e-3 * LIMITS.sizes).ravel())
    with pytest.raises(Refused, match='an arm is 0.0112 m and 0.03 rad from where'):
        blend_from_current_pose(ways, here, SHAPE, slow, PERIOD)
