# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A shift beside the path: at rest at both ends, its derivatives, its bounds."""

import numpy as np
import pytest

from dlo_planner import InvalidTask
from dlo_planner.trajectory.time_law import DEGREE, Shift

KNOTS = np.concatenate([[0.0] * DEGREE, np.linspace(0, 3, 13), [3.0] * DEGREE])


@pytest.fixture
def shift(rng):
    coefficients = np.zeros((KNOTS.size - DEGREE - 1, 3))
    coefficients[DEGREE:-DEGREE] = 1e-3 * rng.normal(size=(len(coefficients) - 2 * DEGREE, 3))
    return Shift(KNOTS, coefficients)


def test_it_is_at_rest_at_both_ends_and_stays_there(shift):
    for order in range(4):
        np.testing.assert_allclose(shift.at(np.array([0.0, 3.0]), order), 0, atol=1e-12)
    np.testing.assert_array_equal(shift.at(np.array([-1.0, 4.0])), 0)
    assert np.abs(shift.at(np.array([1.5]))).max() > 1e-5


def test_derivatives_are_those_of_the_shift(shift):
    times, step = np.linspace(0.1, 2.9, 57), 1e-6
    for order in range(3):
        by = (shift.at(times + step, order) - shift.at(times - step, order)) / (2 * step)
        np.testing.assert_allclose(shift.at(times, order + 1), by, atol=1e-5, rtol=1e-5)


def test_bounds_are_not_below_what_is_sampled_and_not_far_above(shift):
    times = np.linspace(0, 3, 3001)
    for order, bound in enumerate(shift.most):
        found = np.linalg.norm(shift.at(times, order), axis=1).max()
        assert found <= bound <= 3 * found


def test_bad_ones_are_named():
    with pytest.raises(InvalidTask, match=r'Shift.coefficients'):
        Shift(KNOTS, np.zeros((3, 3)))
    with pytest.raises(InvalidTask, match=r'Shift.knots'):
        Shift('knots', np.zeros((3, 3)))
