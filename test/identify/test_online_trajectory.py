# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Corrections that are blended into a motion while it runs."""

import numpy as np
import pytest
from closed_loops import DEPTHS, NOISE, SPREAD, WIRE, plan_of
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Limits, Observer, Pose, Trajectory
from dlo_planner.identify import CorrectedTrajectory, correct
from dlo_planner.identify.online_trajectory import Change, step_response

PLAN = plan_of(depths=DEPTHS)
MOTION = Trajectory(PLAN, Limits(0.02, 0.1), tolerance=np.inf)
WINDOWS = np.array([0.9, 0.35, 0.1])
STEPPED = np.tile([0.0, 0.01, 0.0, 0.002, 0.0, -0.001], (2, 1))


def moving(*changes, **options):
    return CorrectedTrajectory(MOTION, WINDOWS, changes, **options)


def test_a_step_is_averaged_over_both_windows():
    dt = 1e-3
    times = dt * np.arange(2000)
    averaged = np.ones(2000)
    for width in WINDOWS:
        box = np.full(round(width / dt), dt / width)
        averaged = np.convolve(averaged, box)[:2000]
    np.testing.assert_allclose(step_response(times, WINDOWS), averaged, atol=3e-3)
    ends = step_response(np.array([-1.0, 0.0, 1.35, 1e9]), WINDOWS)
    np.testing.assert_allclose(ends, [0, 0, 1, 1], atol=1e-15)


@pytest.mark.parametrize('width', WINDOWS[:2])
def test_an_oscillator_of_a_windows_period_is_at_rest_again(width):
    # x'' = w^2 (u - x): what is left of its swing, in the frequency domain the response's at w
    w, dt = 2 * np.pi / width, 1e-4
    u = step_response(dt * np.arange(20_000), WINDOWS)
    left = abs(np.sum(np.diff(u) * np.exp(1j * w * dt * np.arange(len(u) - 1))))
    other = abs(np.sum(np.diff(u) * np.exp(1.3j * w * dt * np.arange(len(u) - 1))))
    assert left < 1e-3 < 0.1 * other


def test_without_changes_it_is_the_trajectory():
    times = np.linspace(0, MOTION.duration, 7)
    for one, other in zip(moving().at(times)[0], MOTION.at(times)[0], strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-15)
    assert moving().duration == MOTION.duration


def test_a_change_comes_smoothly_and_whole():
    change = Change(1.0, [0.0, MOTION.duration], STEPPED)
    motion = moving(change)
    times = np.linspace(0, motion.duration, 4001)
    base, now = MOTION.at(times)[0], motion.at(times)[0]
    off = np.array([one.position - other.position for one, other in zip(now, base, strict=True)])
    assert not off[times <= 1.0].any()
    np.testing.assert_allclose(off[times >= 1.0 + WINDOWS.sum()], [STEPPED[0, 3:]] * np.sum(
        times >= 1.0 + WINDOWS.sum()), atol=1e-12)
    speed = np.linalg.norm(np.diff(off, axis=0), axis=1) / times[1]
    assert speed.max() <= np.linalg.norm(STEPPED[0, 3:]) / WINDOWS.max() * (1 + 1e-6)
    turn = now[-1].rotation @ base[-1].rotation.T
    assert np.arccos((np.trace(turn) - 1) / 2) == pytest.approx(0.01)


def test_a_late_change_is_blended_in_to_its_end():
    motion = moving(Change(MOTION.duration - 0.1, [MOTION.duration], STEPPED[:1]))
    assert motion.duration == pytest.approx(MOTION.duration - 0.1 + WINDOWS.sum())
    end = motion.at([motion.duration])[0][0].position - MOTION.at([MOTION.duration])[0][0].position
    np.testing.assert_allclose(end, STEPPED[0, 3:], atol=1e-12)


def test_waypoints_are_reached_when_it_says():
    reached = moving().reached(PLAN.times[3:])
    assert len(reached) == len(PLAN) - 3
    for pose, planned in zip(MOTION.at(reached)[0], PLAN.grippers[3:], strict=True):
        np.testing.assert_allclose(pose.position, planned.position, atol=1e-4)


def test_corrections_lead_to_the_corrected_poses():
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE)
    estimate, motion = observer.begin(), moving()
    rng = np.random.default_rng(5)
    for first, time in ((2, 0.5), (4, 3.0)):
        z = 0.5 * observer.uncertain.deviations * rng.normal(size=observer.uncertain.size)
        wrong = type(estimate)(estimate.uncertain, z, estimate.covariance)
        correction = correct(wrong, PLAN, first)
        motion = motion.corrected(time, correction, moving().reached(PLAN.times[first:]))
    reached = moving().reached(PLAN.times)
    done = [k for k in range(first, len(PLAN)) if reached[k] > time + WINDOWS.sum()]
    assert len(done) > 3
    for k, pose in zip(done, motion.at(reached[done])[0], strict=True):
        np.testing.assert_allclose(pose.matrix, correction.grippers[k - first].matrix, atol=2e-4)
        assert not np.allclose(pose.matrix, PLAN.grippers[k].matrix, atol=2e-3)


def test_what_did_not_converge_changes_nothing():
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE)
    correction = correct(observer.begin(), PLAN, 2)
    failed = type(correction)(**{**{name: getattr(correction, name) for name in (
        'first', 'grippers', 'offsets', 'miss', 'shapes')}, 'converged': False})
    assert moving().corrected(1.0, failed, moving().reached(PLAN.times[2:])) == moving()
    with pytest.raises(InvalidTask, match='reached has 1 entries: expected one for each'):
        moving().corrected(1.0, correction, [1.0])


def test_the_tool_goes_along():
    tool = Pose((0.0, 0.0, 0.1), (0, 0, 0, 1))
    (one,), *_ = moving(tool=tool).at([2.0])
    np.testing.assert_allclose(one.matrix, MOTION.at([2.0])[0][0].compose(tool).matrix,
                               atol=1e-15)


def test_windows_are_the_slowest_periods_that_differ():
    shape = PLAN.shapes[0]
    periods = 1 / shape.modes(4).frequencies
    windows = CorrectedTrajectory.of(MOTION, shape).windows
    assert windows[0] == periods[0]
    assert len(windows) == 3
    assert windows[1] in periods
    assert windows[1] * 1.2 < windows[0]


def test_velocities_and_accelerations_against_differences():
    tool = Pose((0.1, 0.0, 0.1), Rotation.from_rotvec((0.2, 0.1, 0.0)).as_quat())
    offsets = np.array([[0.02, -0.01, 0.01, 0.004, 0.0, 0.003], [0.0, 0.02, 0.01, 0.0, 0.01, 0.0]])
    motion = moving(Change(1.0, [0.5, MOTION.duration], offsets),
                     Change(1.7, [1.0, MOTION.duration], -0.5 * offsets), tool=tool)
    step, times = 1e-4, np.linspace(0.6, MOTION.duration - 0.5, 23)
    (back, *_), (_, speeds, accelerations), (ahead, *_) = (
        motion.at(times + d) for d in (-step, 0.0, step))
    found = np.array([np.append(b.position - a.position, Rotation.from_matrix(
        b.rotation @ a.rotation.T).as_rotvec()) for a, b in zip(back, ahead, strict=True)])
    np.testing.assert_allclose(speeds, found / (2 * step), atol=1e-5)
    changes = (motion.at(times + step)[1] - motion.at(times - step)[1]) / (2 * step)
    np.testing.assert_allclose(accelerations, changes, atol=1e-4)
    assert np.abs(changes).max() > 0.01


def test_jerk_is_bounded():
    times = np.linspace(0, 1.35, 2701)
    changes = np.diff(step_response(times, WINDOWS, 2)) / times[1]
    assert np.abs(changes).max() < 4.1 / np.prod(WINDOWS)
    with pytest.raises(InvalidTask, match='CorrectedTrajectory.windows has 2 entries'):
        CorrectedTrajectory(MOTION, WINDOWS[:2])


@pytest.mark.parametrize(('times', 'offsets', 'named'), [
    ([0.0, 2.0, 1.0], np.zeros((3, 6)), 'Change.times'), ([0.0], np.zeros((2, 6)),
                                                          'Change.offsets'),
    ([0.0], np.full((1, 6), np.nan), 'Change.offsets'), ([], np.zeros((0, 6)), 'Change.times')])
def test_changes_that_make_no_sense_are_named(times, offsets, named):
    with pytest.raises(InvalidTask, match=named):
        Change(0.0, times, offsets)


def many_changes():
    reached = moving().reached(PLAN.times)
    rng = np.random.default_rng(2)
    return [Change(0.1 * k, reached[k // 4:], 1e-3 * rng.normal(size=(reached.size - k // 4, 6)))
            for k in range(0, 4 * reached.size - 1, 3)]


def test_many_changes_are_the_sum_of_each():
    changes, times = many_changes(), np.linspace(-0.5, MOTION.duration + 2.0, 301)
    found = moving(*changes)._offsets(times)
    step = [[step_response(times - one.since, WINDOWS, k)[:, None] for k in range(3)]
            for one in changes]
    whole = [[one.at(times, k) for k in range(3)] for one in changes]
    for k, (rows, size) in enumerate(zip(found, (1e-14, 1e-12, 1e-10), strict=True)):
        expected = sum(sum(part * s[k - j] * w[j] for j, part in enumerate(
            ([1], [1, 1], [1, 2, 1])[k])) for s, w in zip(step, whole, strict=True))
        np.testing.assert_allclose(rows, expected, atol=size)
