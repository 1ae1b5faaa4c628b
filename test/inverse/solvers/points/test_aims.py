# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Misses of several centers are those of the penalties of each; their slopes are differences."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.inverse.solvers.points.aims import Aimed, Aims
from dlo_planner.model.pose import displaced
from dlo_planner.penalties import DirectionAt, PositionAt, Through

ROD = Rod(1.0, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
GRIPPER = Pose.looking_along((0.3, -0.2, 0.1), (1, 0.3, 0.4))
BEFORE = displaced(GRIPPER, np.array([0.03, -0.02, 0.01, 0.0, 0.0, 0.0]))
S, NORMAL = 0.35, np.array([0.6, 0.0, 0.8])


@pytest.fixture(scope='module')
def shape():
    return DirectSimulator(ROD, n_elements=40, basis='local').solve(GRIPPER)


def aims(shape, weights):
    """Return Aims at centers of which the third is beyond the free end, the last before S."""
    off = np.array([0.01, 0.02, -0.03])
    end, position = shape.frame_at(1.0)
    centers = np.array([shape.frame_at(S)[1] + off, shape.frame_at(0.7)[1] - off,
                        position + 0.2 * end[:, 0] + off, shape.frame_at(0.2)[1] + off])
    return Aims(S, centers, np.array(weights), NORMAL, 0.7, np.array(BEFORE.rotation), 0.1)


@pytest.mark.parametrize('weights', [(1.0, 2.0, 0.5, 3.0), (1.0, 0.0, 2.0, 0.0)])
def test_misses_are_those_of_the_penalties(shape, weights):
    one = aims(shape, weights)
    penalties = [PositionAt(S, one.centers[0], weights[0]), DirectionAt(S, NORMAL, 0.7)]
    expected = [penalty.residuals(shape) for penalty in penalties]
    expected += [Through(center, S, weight).residuals(shape) if weight else np.zeros(3)
                 for center, weight in zip(one.centers[1:], weights[1:], strict=True)]
    misses = Aimed(one).residuals(shape)
    np.testing.assert_allclose(misses[:-1], np.concatenate(expected), atol=1e-15)
    assert Through(one.centers[2], S).passage(shape) > 1.0  # beyond the end
    assert Through(one.centers[3], S).passage(shape) == S   # not before
    # about the axis of the gripper, by which of three small rotations
    assert misses[-1] == pytest.approx(-0.1 * BEFORE.direction @ [0.03, -0.02, 0.01], rel=1e-3)


def test_slopes_are_differences_of_misses(shape):
    simulator = DirectSimulator(ROD, n_elements=40, basis='local')
    aimed, size = Aimed(aims(shape, (1.0, 2.0, 0.5, 3.0))), 1e-5
    slopes = aimed.slopes(shape, Sensitivity(shape))
    for column, twist in enumerate(np.eye(6) * size):
        ahead, back = (aimed.residuals(simulator.solve(displaced(GRIPPER, sign * twist), shape))
                       for sign in (1, -1))
        np.testing.assert_allclose(slopes[:-1, column], (ahead - back)[:-1] / (2 * size),
                                   atol=1e-6)
        # the turn's slope is that at the rotation before, 0.04 rad away
        assert slopes[-1, column] == pytest.approx((ahead - back)[-1] / (2 * size), abs=3e-3)
