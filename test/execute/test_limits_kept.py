# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The limits of speed, acceleration and jerk, on what goes out; in simulated time, no node."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from streams import ROUNDED, largest, shares
from wires import threaded

from dlo_planner import Limits, Pose, Trajectory
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import Execution, blend_from_current_pose
from dlo_planner.execute.guards import Enabled, Feedback, Guards
from dlo_planner.execute.limiter import Limiter, frames_of, shortest_stop, used
from dlo_planner.identify.online_trajectory import Change, CorrectedTrajectory
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.parameters import PARAMETERS

PERIOD, LIMITS = 0.02, Limits()
FULL = Limits(*(0.95 * LIMITS.sizes).ravel())  # what a motion is made for
ON = Guards(path_position=0.0, path_angle=0.0, goal_position=0.0, goal_angle=0.0)


WIRE, STIFF = threaded(), threaded(0.3, 3e-3)
WAY = Trajectory(WIRE, FULL, tolerance=np.inf)
SHORT = Trajectory(STIFF, FULL, tolerance=np.inf)


def begun(way=WAY, horizon=0.0, begin=0.0, **more):
    return Execution(way, Pose.identity(), 'world', ON, PERIOD, horizon, LIMITS, begin=begin,
                     done=begin, **more)


class Robot:
    """Hears an execution: each command as it comes, and what is told with stamps."""

    def __init__(self, execution):
        self.execution, self.commands, self.table, self.ahead = execution, [], {}, None

    def run(self, times, at=None):
        """Tick at `times`; `at`: {index: function of the Execution}."""
        for index, now in enumerate(times):
            if index in (at or {}):
                self.execution = at[index](self.execution)
            if not self.execution.active:
                break
            there = self.execution.command or self.execution.way.at([0.0])[0][0]
            self.execution = self.execution.tick(now, Feedback(there, now, stamp=now), now)
            if self.execution.sending is not None:
                self.commands.append(self.execution.sending)
            self.hear(self.execution.ahead)
        return self

    def hear(self, ahead):
        if ahead is None or ahead is self.ahead:
            return
        self.ahead, begin = ahead, round(self.execution.stamp / PERIOD)
        self.table = {k: pose for k, pose in self.table.items() if k < begin}
        self.table.update({begin + k: pose for k, pose in enumerate(ahead.poses)})

    @property
    def told(self):
        """Where a robot is that follows the stamps, a pose in each period."""
        known = sorted(self.table)
        assert known == list(range(known[0], known[0] + len(known)))
        return [self.table[k] for k in known]

    @property
    def streams(self):
        """All that goes out: single commands, and what is told with a horizon."""
        return [self.commands, self.told] if self.table else [self.commands]


def regular(seconds):
    return PERIOD * np.arange(round(seconds / PERIOD))


def displaced(pose, meters, radians):
    return Pose.from_rotation(pose.position + (0.0, meters, 0.0), Rotation.from_rotvec(
        [0.0, radians, 0.0]).as_matrix() @ pose.rotation)


def test_the_measure_is_that_of_closed_forms():
    # on a circle: speed r w, acceleration r w^2, jerk r w^3; and turning as a pendulum does
    r, w, period = 0.02, 3.0, 1e-3
    times = np.arange(0, 3, period)
    angle = 0.2 * np.sin(w * times)
    poses = [Pose.from_rotation((r * np.cos(w * t), r * np.sin(w * t), 0.0),
                                Rotation.from_rotvec([0, 0, a]).as_matrix())
             for t, a in zip(times, angle, strict=True)]
    free = Limits(*[np.inf] * 6)
    for n in (1, 2, 3):
        for k, size in ((0, r * w**n), (1, 0.2 * w**n)):
            name = [['linear', 'angular'][k], ['speed', 'acceleration', 'jerk'][n - 1]]
            one = replace(free, **{'_'.join(name): 2 * size})
            assert used(frames_of(poses), one, period) == pytest.approx(0.5, rel=1e-3)
            assert largest(poses, one, period, rests=(False, False)) == pytest.approx(
                0.5, rel=1e-3)


@pytest.mark.every(2)
@pytest.mark.parametrize(('plan', 'way', 'meters', 'radians', 'horizon'), [
    (STIFF, SHORT, 0.019, 0.09, 0.0), (STIFF, SHORT, 0.019, 0.09, 1.0),
    (STIFF, SHORT, 0.3, 1.0, 0.0), (WIRE, WAY, 0.019, 0.09, 1.0),
    (STIFF, SHORT, 0.0, 0.006, 0.0), (STIFF, SHORT, 0.0011, 0.0, 0.0)])
def test_a_start_from_elsewhere_keeps_the_limits(plan, way, meters, radians, horizon):
    here = displaced(plan.grippers[0], meters, radians)
    (start,), begin = blend_from_current_pose([way], [here], plan.shapes[0], LIMITS, PERIOD)
    robot = Robot(begun(start, horizon, begin)).run(regular(way.duration - begin + 1))
    assert robot.execution.phase == 'succeeded'
    assert len(robot.streams) == 1 + bool(horizon)
    for stream in robot.streams:
        assert largest([here, *stream], LIMITS, PERIOD) <= ROUNDED
        np.testing.assert_allclose(stream[0].matrix, here.matrix, atol=1e-9)
        np.testing.assert_allclose(stream[-1].matrix, plan.grippers[-1].matrix, atol=1e-9)
    # the way itself is gone as it was proved
    motion = robot.commands[round(-begin / PERIOD):]
    expected = way.at(PERIOD * np.arange(len(motion)))[0]
    assert max(np.abs(one.matrix - other.matrix).max()
               for one, other in zip(motion, expected, strict=True)) < 1e-9


def test_a_start_that_the_limits_do_not_allow_is_refused():
    here = displaced(STIFF.grippers[0], 0.3, 0.0)
    slow = replace(LIMITS, linear_speed=0.02)
    with pytest.raises(Refused, match=r'0\.3 m and .* rad from where the plan begins') as refused:
        blend_from_current_pose([SHORT], [here], STIFF.shapes[0], slow, PERIOD)
    assert refused.value.cause == Cause.NOT_AT_START


@pytest.mark.every(3)
@pytest.mark.parametrize('horizon', [0.0, 1.0])
@pytest.mark.parametrize('index', [2, 9, 20, 60, 140, 220, 300, 380, 455])
def test_a_stop_keeps_all_limits_and_is_soon_at_rest(index, horizon):
    robot = Robot(begun(horizon=horizon)).run(regular(12), {index: Execution.canceled})
    assert (robot.execution.phase, robot.execution.cause) == ('stopped', Cause.CANCELED)
    for stream in robot.streams:
        assert largest(stream, LIMITS, PERIOD) <= ROUNDED
        assert PERIOD * (len(stream) - index) < 1.8


@pytest.mark.parametrize('index', [100, 200, 300])
def test_a_stop_keeps_a_limit_of_jerk_that_it_depends_on(index):
    gentle = replace(LIMITS, linear_jerk=0.1, angular_jerk=0.4)
    way = Trajectory(WIRE, Limits(*(0.95 * gentle.sizes).ravel()), tolerance=np.inf)
    execution = replace(begun(way), limits=gentle)
    robot = Robot(execution).run(regular(30), {index: Execution.canceled})
    assert robot.execution.phase == 'stopped'
    assert robot.execution.limiter.rest is None  # the last resort was not needed
    assert 0.7 < largest(robot.commands[index - 4:], gentle, PERIOD,
                         rests=(False, True)) <= ROUNDED


def test_a_stop_on_the_way_to_the_beginning_keeps_the_limits():
    here = displaced(STIFF.grippers[0], 0.019, 0.09)
    (start,), begin = blend_from_current_pose([SHORT], [here], STIFF.shapes[0], LIMITS, PERIOD)
    for index in range(4, round(-begin / PERIOD), 7):
        robot = Robot(begun(start, 0.0, begin)).run(regular(5), {index: Execution.canceled})
        assert robot.execution.phase == 'stopped' and robot.execution.done < 0.5
        assert largest([here, *robot.commands], LIMITS, PERIOD) <= ROUNDED


@pytest.mark.every(3)
@pytest.mark.parametrize('index', [5, 60, 150, 290, 420])
def test_a_robot_whose_planner_dies_comes_to_rest_within_the_limits(index):
    robot = Robot(begun(horizon=1.0)).run(regular(PERIOD * index))
    assert largest(robot.told, LIMITS, PERIOD) <= ROUNDED
    assert len(robot.told) * PERIOD < PERIOD * index + 1.0 + 1.8
    steps = np.linalg.norm(np.diff([pose.position for pose in robot.told], axis=0), axis=1)
    assert steps[-1] < 1e-6


@pytest.mark.every(2)
@pytest.mark.parametrize('late', [0.08, 0.2, 0.45])
@pytest.mark.parametrize('at', [40, 250])
def test_after_a_pause_commands_begin_again_where_the_gripper_stands(late, at):
    times = regular(14)
    times[at:] += late
    robot = Robot(begun()).run(times)
    assert robot.execution.phase == 'succeeded'
    before, after = robot.commands[:at], robot.commands[at - 1:]
    assert largest(before, LIMITS, PERIOD, rests=(True, False)) <= ROUNDED
    # a robot that got no command for a quarter of a second stands still
    stands = late > 0.25
    assert largest(after, LIMITS, PERIOD, rests=(stands, True)) <= ROUNDED


def test_a_stop_while_it_begins_again_keeps_the_limits():
    for wait in range(2, 30, 9):
        times = regular(14)
        times[150:] += 0.3
        robot = Robot(begun()).run(times, {150 + wait: Execution.canceled})
        assert robot.execution.phase == 'stopped'
        assert robot.execution.limiter.rest is None  # it stops on its way, not by the last resort
        assert largest(robot.commands[149:], LIMITS, PERIOD) <= ROUNDED


def test_a_pause_while_it_stops_is_the_end():
    times = regular(14)
    times[155:] += 0.3
    robot = Robot(begun()).run(times, {150: Execution.canceled})
    assert robot.execution.phase == 'stopped' and len(robot.commands) == 155


@pytest.mark.every(3)
@pytest.mark.parametrize('late', [0.3, 0.5, 0.7])
def test_with_a_horizon_single_commands_do_not_leap_after_a_pause(late):
    times = regular(14)
    times[150:] += late
    robot = Robot(begun(horizon=1.0)).run(times)
    assert robot.execution.phase == 'succeeded'
    assert largest(robot.told, LIMITS, PERIOD) <= ROUNDED  # nothing was delayed
    assert len(robot.told) == pytest.approx(WAY.duration / PERIOD, abs=2)
    # behind, and from where the gripper stood: never a leap
    before, after = robot.commands[:150], robot.commands[149:]
    assert largest(before, LIMITS, PERIOD, rests=(True, False)) <= ROUNDED
    assert largest(after, LIMITS, PERIOD) <= ROUNDED
    np.testing.assert_allclose(robot.commands[-1].matrix, robot.told[-1].matrix, atol=1e-9)


def test_with_a_horizon_single_commands_that_are_behind_stop_as_soon():
    times = regular(14)
    times[150:] += 0.7
    robot = Robot(begun(horizon=1.0)).run(times, {220: Execution.canceled})
    assert robot.execution.phase == 'stopped'
    for stream in (robot.commands[149:], robot.told):
        assert largest(stream, LIMITS, PERIOD) <= ROUNDED
    assert len(robot.commands) < 220 + 1.8 / PERIOD


def leaping(way=WAY, by=0.01, since=3.0):
    """Return a motion that leaps: it must never go out."""
    return CorrectedTrajectory(way, np.array([0.02, 0.02, 0.02]),
                   (Change(since, np.zeros(1), np.array([[0, 0, 0, 0, by, 0.0]])),))


def test_a_command_that_exceeds_the_limits_is_not_sent():
    robot = Robot(begun(leaping())).run(regular(12))
    assert (robot.execution.phase, robot.execution.cause) == ('stopped', Cause.LIMITS)
    assert 140 < len(robot.commands) < 260
    assert largest(robot.commands, LIMITS, PERIOD) <= 1.0 + 3e-3
    assert max(pose.position[1] for pose in robot.commands) < 5e-3


@pytest.mark.parametrize('by', [1e-2, 1e-4])  # leaps; and a jerk that is too large by three
def test_what_exceeds_the_limits_is_not_told(by):
    robot = Robot(begun(leaping(by=by), 1.0)).run(regular(12))
    assert (robot.execution.phase, robot.execution.cause) == ('stopped', Cause.LIMITS)
    for stream in (robot.commands, robot.told):
        assert largest(stream, LIMITS, PERIOD) <= ROUNDED
        assert max(abs(pose.position[1]) for pose in stream) < 1e-6
    assert 1.5 < PERIOD * len(robot.told) < 4.5


@pytest.mark.parametrize('seed', range(25))
def test_the_shortest_stop_keeps_the_limits_where_that_is_possible(seed):
    rng = np.random.default_rng(seed)
    most = 10 ** rng.uniform(-2, 1, 3)
    # a state that a motion within 0.6 of the limits is in: speed left to let the acceleration go
    velocity, acceleration = (0.6 * size * one / np.linalg.norm(one) for size, one in zip(
        (most[0], min(most[1], np.sqrt(0.6 * most[0] * most[2]))), rng.normal(size=(2, 3)),
        strict=True))
    period = 0.01 * min(most[0] / most[1], most[1] / most[2], np.sqrt(most[0] / most[2]))
    way = shortest_stop(np.stack([velocity, acceleration]), most, period)
    stream = np.vstack([velocity - period * acceleration, velocity, way, np.zeros((3, 3))])
    np.testing.assert_allclose(way[-1], 0.0, atol=1e-9 * most[0])
    for n, size in enumerate(most):
        rows = np.diff(stream, n, axis=0) / period**n
        assert np.linalg.norm(rows, axis=1).max() <= (1 + 1e-6) * size


@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('part', [0, 1])
def test_the_limiter_keeps_each_limit_by_itself(order, part):
    sizes = 100 * LIMITS.sizes
    sizes[order - 1, part] = LIMITS.sizes[order - 1, part]
    limits = Limits(*sizes.ravel())
    for used_part, passes in ((0.99, True), (1.02, False)):
        way = np.full(12, used_part * sizes[order - 1, part] * PERIOD**order)
        for _ in range(order):
            way = np.cumsum(way)
        limiter, sent = Limiter(limits, PERIOD), []
        for x in [0.0, 0.0, 0.0, *way]:
            place, turn = ((0.0, x, 0.0), np.zeros(3)) if part == 0 else (np.zeros(3), [0, x, 0])
            limiter = limiter.after(Pose.from_rotation(
                place, Rotation.from_rotvec(turn).as_matrix()))
            sent.append(limiter.pose)
        assert (limiter.rest is None) is passes
        assert largest(sent, limits, PERIOD, rests=(True, False)) <= ROUNDED


def test_the_limiter_lets_nothing_through_after_it_has_stopped():
    limiter = Limiter(LIMITS, PERIOD)
    poses = [Pose((x, 0.0, 0.0), (0, 0, 0, 1)) for x in (0.0, 0.0, 0.01)]
    for pose in poses:
        limiter = limiter.after(pose)
    assert limiter.rest == () and limiter.pose == poses[0]
    assert limiter.after(poses[0]).pose == poses[0]


def correction(execution, meters, windows=(0.9, 0.8, 0.1)):
    way = execution.way
    return execution.corrected(CorrectedTrajectory(
        way.trajectory if isinstance(way, CorrectedTrajectory) else way, np.array(windows),
        (*getattr(way, 'changes', ()), Change(execution.free, np.zeros(1), np.array(
            [[0.0, 0.0, 0.0, 0.0, meters, 0.0]])))))


@pytest.mark.parametrize('horizon', [0.0, 1.0])
def test_a_correction_within_the_limits_goes_out(horizon):
    robot = Robot(begun(horizon=horizon)).run(regular(12), {
        150: lambda execution: correction(execution, 3e-3)})
    assert robot.execution.phase == 'succeeded' and robot.execution.refusal == ''
    assert robot.commands[-1].position[1] == pytest.approx(
        WAY.at([99.0])[0][0].position[1] + 3e-3)
    assert largest(robot.commands, LIMITS, PERIOD) <= ROUNDED


def test_a_correction_that_is_too_quick_takes_longer():
    quick = (0.15, 0.1, 0.05)
    before = begun()
    before = Robot(before).run(regular(3)).execution
    after = correction(before, 4e-3, quick)
    assert after.refusal == '' and after.way.windows.sum() > 1.2 * sum(quick)
    robot = Robot(after).run(3 + regular(12))
    assert robot.execution.phase == 'succeeded'
    assert largest(robot.commands, LIMITS, PERIOD, rests=(False, True)) <= ROUNDED
    # where another one is still blended in, it cannot: the motion would leap
    again = correction(after, 8e-3, after.way.windows)
    assert again.way is after.way and 'expected 0.98 at most' in again.refusal


def test_a_correction_that_exceeds_the_limits_is_refused():
    before = Robot(begun(horizon=1.0)).run(regular(3)).execution
    after = correction(before, 0.2)
    assert after.way is before.way and 'of the limits of speed' in after.refusal


def test_a_stop_in_a_correction_keeps_the_limits():
    for index in range(154, 240, 16):
        robot = Robot(begun()).run(regular(12), {
            150: lambda execution: correction(execution, 4e-3), index: Execution.canceled})
        assert robot.execution.phase == 'stopped'
        assert isinstance(robot.execution.way, CorrectedTrajectory)
        assert largest(robot.commands, LIMITS, PERIOD) <= ROUNDED


def test_a_motion_is_made_for_a_part_of_the_limits():
    values = {name: entry.default for name, entry in PARAMETERS.items()}
    scene = Scene.of({**values, 'threading.linear_jerk': float('inf')})
    np.testing.assert_allclose(scene.motion_limits.sizes, 0.95 * scene.limits.sizes)
    assert scene['execute.horizon'] == 1.0
    assert shares(WAY.at(regular(WAY.duration + 1))[0], FULL, PERIOD).max() <= ROUNDED


@pytest.mark.parametrize(('heard', 'named'), [
    (None, 'nothing came'), (Enabled(False, 0.0), 'it is false'), (Enabled(True, 2.5), 'is 0.5')])
def test_who_does_not_enable_it_any_more_stops_it_within_the_limits(heard, named):
    execution, commands = begun(), []
    execution = replace(execution, guards=replace(ON, enable_timeout=0.5))
    for now in regular(5):
        if not execution.active:
            break
        enabled = Enabled(True, now) if now < 2.5 else heard
        execution = execution.tick(now, Feedback(WIRE.grippers[0], now), now, enabled)
        if execution.sending is not None:
            commands.append(execution.sending)
    assert (execution.phase, execution.cause) == ('stopped', Cause.NOT_ENABLED)
    assert named in execution.reason and 'execute.enable_timeout = 0.5 s' in execution.reason
    assert largest(commands, LIMITS, PERIOD) <= ROUNDED
    begins = 3.0 if heard and heard.value else 2.5
    assert begins < PERIOD * len(commands) < begins + 1.8
