# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The way of a grip between the instants: against motions that are known in closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Pose
from dlo_planner.direct.boundary_motion import Guide

AXIS = np.array([1.0, 2.0, -2.0]) / 3


def twist_at(guide, place):
    return guide.along(np.array([float(place)]))[2][0]


def test_two_poses_are_one_constant_acceleration():
    guide = Guide([Pose.identity(), Pose((0.4, 0, -0.2), (0, 0, 0, 1))], 0.5)
    for place in (0.25, 0.5, 0.75):
        np.testing.assert_allclose(guide.at(place).position, place**2 * np.array([0.4, 0, -0.2]),
                                   atol=1e-15)
    for place in (0.0, 0.5, 1.0):  # v = 2 x t / T^2
        np.testing.assert_allclose(twist_at(guide, place),
                                   2 * place / 0.5 * np.array([0.4, 0, -0.2, 0, 0, 0]), atol=1e-14)


@pytest.mark.parametrize('at_rest', [True, False])
def test_several_whole_turns_are_gone_through(at_rest):
    # a rotation has two quaternions: here now the one comes, now the other
    angles = 4.5 * np.pi * np.linspace(0, 1, 60) ** 2
    guide = Guide([Pose((0, 0, 0), (-1) ** (k // 3) * Rotation.from_rotvec(a * AXIS).as_quat())
                   for k, a in enumerate(angles)],
                  0.1, at_rest)
    for place in np.arange(2.5, 57):
        angle = 4.5 * np.pi * (place / 59) ** 2
        away = guide.at(place).rotation @ Rotation.from_rotvec(-angle * AXIS).as_matrix()
        assert np.linalg.norm(away - np.eye(3)) < 1e-4
        rate = 2 * 4.5 * np.pi * place / 59**2 / 0.1
        np.testing.assert_allclose(twist_at(guide, place), [0, 0, 0, *rate * AXIS], atol=0.02)
    rotations, _, twists = guide.along(np.array([3.5, 40.0, 41.25]))
    for place, rotation, twist in zip((3.5, 40.0, 41.25), rotations, twists, strict=True):
        np.testing.assert_allclose(rotation, guide.at(place).rotation, atol=1e-12)
        np.testing.assert_allclose(twist, twist_at(guide, place), atol=1e-12)
