# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan as a motion in time."""

from dataclasses import replace

import numpy as np
import pytest
from oblique_plans import oblique_plan
from scipy.spatial.transform import Rotation

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Trajectory,
)
from dlo_planner.plan.builder import build_plan
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import PlanStatus, concatenate, truncate
from dlo_planner.plan.waypoint import Waypoint

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))
DIRECT = DirectSimulator(WIRE)
ROUND = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
SHAPE = DIRECT.solve(Pose.identity())


@pytest.fixture(scope='module')
def plan():
    return InverseSimulator(DIRECT).thread(ROUND, depths=np.linspace(0, 0.9, 40))


def through(grippers, times=None):
    """Return a plan through any Poses; its shapes do not matter."""
    made = build_plan([Waypoint(replace(SHAPE, gripper=gripper)) for gripper in grippers],
                      np.zeros(len(grippers)), (0.1, 0.5), PlanStatus.COMPLETE)
    return made if times is None else replace(made, times=np.array(times, dtype=float))


def fastest(made, limits=None):
    """Return the Trajectory of a plan whose shapes do not matter."""
    return Trajectory(made, limits, tolerance=np.inf)


def random_plan(rng, turn):
    """Return a plan whose gripper wanders, with turns of up to `turn` rad at once and dwells."""
    position, rotation, grippers = np.zeros(3), np.eye(3), []
    for _ in range(rng.integers(2, 12)):
        grippers.append(Pose.from_rotation(position, rotation))
        position = position + rng.normal(size=3) * rng.choice([0.0, 0.02, 0.3])
        axis = rng.normal(size=3)
        angle = rng.choice([0.0, 0.3, 1.0]) * rng.uniform(0, turn)
        rotation = Rotation.from_rotvec(
            angle * axis / np.linalg.norm(axis)).as_matrix() @ rotation
    grippers.append(Pose.from_rotation(position + 0.1, rotation))
    made = through(grippers)
    stays = rng.choice([0.0, 0.7], len(made))  # only where the pose is the same is it a dwell
    return replace(made, times=made.times + np.cumsum(stays))


def moving(way, times):
    """Return positions (n, 3), rotations (n, 3, 3), velocities and accelerations (n, 6)."""
    poses, velocities, accelerations = way.at(times)
    return (np.array([pose.position for pose in poses]),
            np.array([pose.rotation for pose in poses]), velocities, accelerations)


def differences(way, times, step):
    """Return velocities and accelerations (n, 6) from poses and velocities around `times`."""
    velocities, accelerations = [], []
    for h in (step, step / 2):
        after, before = moving(way, times + h), moving(way, times - h)
        rate = (after[1] - before[1]) / (2 * h) @ np.swapaxes(moving(way, times)[1], 1, 2)
        spin = 0.5 * np.stack([rate[:, 2, 1] - rate[:, 1, 2], rate[:, 0, 2] - rate[:, 2, 0],
                               rate[:, 1, 0] - rate[:, 0, 1]], axis=1)
        velocities.append(np.hstack([(after[0] - before[0]) / (2 * h), spin]))
        accelerations.append((after[2] - before[2]) / (2 * h))
    return tuple((4 * fine - coarse) / 3 for coarse, fine in (velocities, accelerations))


@pytest.mark.every(2)
@pytest.mark.parametrize('turn', [0.3, 2.9])
def test_velocities_and_accelerations_are_those_of_the_poses_in_world_axes(rng, turn):
    for _ in range(4):
        way = fastest(random_plan(rng, turn))
        step = 1e-4 * way.duration
        times = rng.uniform(2 * step, way.duration - 2 * step, 100)
        _, _, velocities, accelerations = moving(way, times)
        by_poses, by_velocities = differences(way, times, step)
        np.testing.assert_allclose(velocities, by_poses, atol=2e-5)
        # where the jerk leaps within a step, differences are off by its leap
        off = np.abs(accelerations - by_velocities).max(axis=1)
        assert np.quantile(off, 0.9) < 1e-4 and off.max() < 0.05


def used_parts(way):
    """Return (3, 2): largest speed, acceleration, jerk, linear and angular, as parts of limits."""
    times = np.linspace(0, way.duration, 8001)
    _, _, velocities, accelerations = moving(way, times)
    jerks = np.diff(accelerations, axis=0) / times[1]  # a mean, so never above the largest
    sizes = [np.linalg.norm(v.reshape(-1, 2, 3), axis=2).max(axis=0)
             for v in (velocities, accelerations, jerks)]
    return np.array(sizes) / way.limits.sizes


@pytest.mark.every(2)
@pytest.mark.parametrize('jerks', [(5.0, 20.0), (0.2, 1.0), (np.inf, np.inf)])
def test_limits_are_never_exceeded(rng, jerks):
    limits = Limits(0.2, 0.3, 0.1, 1.0, *jerks)
    for _ in range(2):
        used = used_parts(fastest(random_plan(rng, 1.0), limits))
        assert used.max() <= 1 + 1e-9
        # averages take the peaks off a little; jerks are bounded by twice the largest change
        assert used.max() > (0.9 if np.isinf(jerks[0]) else 0.5)


def test_it_is_at_rest_at_both_ends_and_beyond(rng):
    for _ in range(3):
        made = random_plan(rng, 2.0)
        way = fastest(made)
        times = np.array([-1.0, 0.0, way.duration, way.duration + 1])
        positions, rotations, velocities, accelerations = moving(way, times)
        np.testing.assert_allclose(velocities, 0, atol=1e-12)
        np.testing.assert_allclose(accelerations, 0, atol=1e-9)
        for k, gripper in ((0, made.grippers[0]), (3, made.grippers[-1])):
            np.testing.assert_allclose(positions[k], gripper.position, atol=1e-12)
            np.testing.assert_allclose(rotations[k], gripper.rotation, atol=1e-12)


def test_trajectory_keeps_limits_and_poses(plan):
    limits = Limits(0.2, 0.3, 0.1, 1.0)
    way = fastest(plan, limits)
    times = np.linspace(0, way.duration, 4001)
    assert 0.97 < used_parts(way).max() <= 1
    position = np.array([pose.position for pose in way.at(times)[0]])
    for gripper in (plan.grippers[0], plan.grippers[17], plan.grippers[-1]):
        nearest = np.linalg.norm(position - gripper.position, axis=1).min()
        assert nearest < 5e-4  # as near as the samples are


def test_it_stops_at_corners(plan):
    inverse = InverseSimulator(DIRECT)
    start = Pose((-1.3, 0.2, 1.1), (0, 0, 0, 1))
    whole = concatenate(inverse.approach(ROUND, plan, start, standoff=0.05), plan)
    way = fastest(whole)
    times = np.linspace(0, way.duration, 6001)
    poses, speeds, _ = way.at(times)
    still = np.flatnonzero(np.linalg.norm(speeds, axis=1) < 2e-3)
    rests = np.split(times[still], np.flatnonzero(np.diff(still) > 1) + 1)
    assert 3 <= len(rests) <= 6  # at both ends, and between backing off, turning, going in
    assert np.linalg.norm(np.diff([pose.position for pose in poses], axis=0), axis=1).max() < 1e-2
    mixed = np.array([way.duration, 0.0, 0.5 * way.duration])
    for pose, time in zip(way.at(mixed)[0], mixed, strict=True):
        np.testing.assert_allclose(pose.matrix, way.at(time)[0][0].matrix)
    assert (np.diff(way.progress(times)) >= -1e-12).all()
    assert way.progress([way.duration])[0] == pytest.approx(whole.times[-1])


def test_a_dwell_is_kept():
    one, other = Pose.identity(), Pose((0.1, 0, 0), (0, 0, 0, 1))
    last = Pose((0.2, 0, 0), (0, 0, 0.1, 1))
    way = fastest(through([one, other, other, last], [0, 1, 4, 5]))
    times = np.linspace(0, way.duration, 2001)
    positions, _, velocities, accelerations = moving(way, times)
    there = np.flatnonzero(np.linalg.norm(positions - other.position, axis=1) < 1e-12)
    assert np.ptp(times[there]) == pytest.approx(3.0, abs=2 * times[1])
    assert not velocities[there[1:-1]].any() and not accelerations[there[1:-1]].any()
    middle = times[there].mean()
    assert way.progress([middle])[0] == pytest.approx(2.5, abs=1e-2)
    assert (np.diff(way.progress(times)) >= -1e-12).all()
    waiting = fastest(through([one, one], [0, 5]))
    assert waiting.duration == 5 and not waiting.at([2.0])[1].any()


def test_a_pose_that_comes_twice_is_no_stop():
    grippers = [Pose((0.05 * k, 0, 0), (0, 0, 0, 1)) for k in range(6)]
    twice = through([*grippers[:3], grippers[2], *grippers[3:]])
    assert fastest(twice).duration == pytest.approx(fastest(through(grippers)).duration)


def test_without_limits_it_is_as_good_as_at_once():
    made = through([Pose((0.05 * k, 0, 0), (0, 0, 0, 1)) for k in range(6)])
    assert 0 < fastest(made, Limits(*[np.inf] * 6)).duration < 0.01 * made.times[-1]
    assert fastest(made, Limits(*[np.inf] * 4)).duration > 1.0  # jerks alone limit it too


def test_nonsense_is_named():
    one, other = Pose.identity(), Pose((0.1, 0, 0), (0, 0, 0, 1))
    for made, named in ((through([one]), 'plan has 1'), (through([one, one]), 'plan.times'),
                        (through([one, other, one], [0, 0, 1]), r'plan.times\[1\]'),
                        (through([one, other, other], [0, 2, 1]), r'plan.times\[2\]'),
                        (through([one, other], [0, np.nan]), 'plan.times')):
        with pytest.raises(InvalidTask, match=named):
            Trajectory(made)


def test_bounds_hold_everywhere(rng):
    for _ in range(8):
        for leg in GripperPath.of(random_plan(rng, 2.0)).legs:
            a, b = leg.pieces(2)
            bounds, control = leg.bounds(a, b), leg.control_points(a, b)
            for share in np.linspace(0, 1, 9):
                position, _, first, second = leg.at(a + share * (b - a))
                for order, rates in enumerate((first, second)):
                    for part, columns in enumerate((slice(3), slice(3, 6))):
                        size = np.linalg.norm(rates[:, columns], axis=1)
                        assert (size <= bounds[:, part, order] * (1 + 1e-9) + 1e-12).all()
                weights = np.array([(1 - share) ** 3, 3 * share * (1 - share) ** 2,
                                    3 * share**2 * (1 - share), share**3])
                np.testing.assert_allclose(np.einsum('j,nji->ni', weights, control), position,
                                           atol=1e-12)
            # the third ones by differences of the second ones
            inner, step = 0.5 * (a + b), 1e-4 * (b - a)
            rates = (leg.at(inner + step)[3] - leg.at(inner - step)[3]) / (2 * step)[:, None]
            for part, columns in enumerate((slice(3), slice(3, 6))):
                size = np.linalg.norm(rates[:, columns], axis=1)
                # the rate of an angular acceleration in world axes has a part that turns it
                turning = bounds[:, part, 1] * bounds[:, part, 0] if part else 0.0
                assert (size <= (bounds[:, part, 2] + turning) * (1 + 1e-3) + 1e-6).all()


def test_what_an_oblique_dlo_may_do_in_motion_is_a_part_of_its_least_room():
    made = truncate(oblique_plan(), 3, PlanStatus.COMPLETE)
    least = made.clearances.min()
    assert least < 0.5 * made.clearances[:, :, 0].min()
    calm = Trajectory(made, Limits(0.2, 1.0))
    assert calm.tolerance == pytest.approx(0.25 * least, rel=1e-12)
    assert calm.motion.position_error < calm.tolerance
    assert least - calm.motion.clearance < calm.tolerance
