# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint trajectory as a value, and as a curve."""

import numpy as np
import pytest
from robot_arms import panda
from scipy.interpolate import BPoly
from test_values import judge

from dlo_planner import InvalidTask
from dlo_planner.arm import Arm, JointTrajectory
from dlo_planner.arm.joint_trajectory import quintic, turning_points


def example(rng=None, number=6):
    rng = rng or np.random.default_rng(3)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.5, number - 1))])
    return JointTrajectory(('a', 'b'), times, *rng.normal(size=(3, number, 2)), 1e-6, 1e-7, 0.02,
                           0.3, ('hand (package://x/y)',))


def test_it_is_a_value():
    judge(example())
    judge(panda())
    assert panda() == Arm(panda().urdf, 'panda_hand_tcp', packages=panda().packages)
    assert panda() != panda(self_clearance=0.01)


def test_it_has_what_is_given_at_its_points_and_scipys_curve_between(rng):
    made = example(rng)
    for mine, given in zip(made.at(made.times), (made.positions, made.velocities,
                                                 made.accelerations), strict=True):
        np.testing.assert_allclose(mine, given, atol=1e-9)
    curve = BPoly.from_derivatives(made.times, np.stack(
        [made.positions, made.velocities, made.accelerations], axis=1))
    times = np.linspace(0, made.duration, 57)
    for order, mine in enumerate(made.at(times)):
        np.testing.assert_allclose(mine, curve(times, order), atol=1e-8)
    outside = made.at([-1.0, made.duration + 1.0])[0]
    np.testing.assert_allclose(outside, made.positions[[0, -1]])


def test_turning_points_are_the_extremes(rng):
    made = example(rng)
    curve = quintic(made.times, made.positions, made.velocities, made.accelerations)
    dense = curve(np.linspace(0, made.duration, 20_001))
    for joint, times in enumerate(turning_points(curve)):
        found = curve(times)[:, joint]
        assert found.max() >= dense[:, joint].max() - 1e-12
        assert found.min() <= dense[:, joint].min() + 1e-12
        assert found.max() == pytest.approx(dense[:, joint].max(), abs=1e-5)


def test_a_joint_that_stands_still_has_extremes():
    zero = np.zeros((3, 1))
    curve = quintic(np.array([0.0, 1.0, 2.0]), zero + 0.7, zero, zero)
    assert curve(turning_points(curve)[0]).max() == 0.7


@pytest.mark.parametrize('times', [[0.0, 0.0], [0.0, -1.0], [0.1, 1.0], [0.0]])
def test_times_increase_from_0(times):
    state = np.zeros((len(times), 1))
    with pytest.raises(InvalidTask, match='times'):
        JointTrajectory(('a',), times, state, state, state)
