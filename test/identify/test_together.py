# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The covariance of sums of what goes together, against closed forms and repeated draws."""

import numpy as np
import pytest

from dlo_planner.identify.together import spread_together


def lasting(rng, k, n, rho):
    """Return (k, n) of variance 1, each correlated by rho with the one before."""
    out = rng.normal(size=(k, n))
    for row in range(1, k):
        out[row] = rho * out[row - 1] + np.sqrt(1 - rho**2) * out[row]
    return out


@pytest.mark.parametrize(('rho', 'tolerance'), [(0.0, 0.05), (0.5, 0.15), (0.8, 0.3)])
def test_what_lasts_has_the_variance_of_its_sum(rng, rho, tolerance):
    # the sum of k has the variance k (1 + rho) / (1 - rho), but for its ends
    k, sums = 200, []
    for _ in range(40):
        series = [lasting(rng, k, 1, rho) for _ in range(4)]
        sums.append(spread_together(series, np.array([[4.0 * k]]))[0, 0])
    true = 4 * k * (1 + rho) / (1 - rho)
    assert true * (1 - tolerance) < np.mean(sums) < true * (1 + 0.5 * tolerance) + 0.08 * 4 * k


def test_one_direction_that_lasts_is_told_from_one_that_does_not(rng):
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    pulls = np.column_stack([lasting(rng, 4000, 1, 0.8), rng.normal(size=(4000, 1))]) @ turn.T
    found = turn.T @ spread_together([pulls], 4000 * np.eye(2)) @ turn / 4000
    assert found[0, 0] == pytest.approx(9, rel=0.25)
    assert found[1, 1] == pytest.approx(1, abs=0.3)


def test_it_is_never_less_than_of_what_is_independent(rng):
    # pulls that alternate add up to nothing, which may be chance
    pulls = lasting(rng, 60, 3, -0.9)
    alone = pulls.T @ pulls
    assert np.linalg.eigvalsh(spread_together([pulls], alone) - alone).min() > -1e-9 * 60


def test_what_nothing_is_known_of_stays_so(rng):
    pulls = lasting(rng, 50, 3, 0.7) * [1.0, 1e-4, 0.0]
    out = spread_together([pulls], pulls.T @ pulls)
    assert np.isfinite(out).all()
    assert out[2].tolist() == [0.0, 0.0, 0.0]
    assert np.array_equal(spread_together([], np.eye(2)), np.eye(2))
    assert np.array_equal(spread_together([np.ones((1, 2))], np.eye(2)), np.eye(2))


def test_a_slope_is_as_far_off_as_is_stated(rng):
    # a line through errors that last: stated as if independent, its slope would be 3 times better
    times, off, plain = np.linspace(-1, 1, 150), [], []
    for _ in range(150):
        seen = lasting(rng, 150, 1, 0.8)[:, 0]
        slope = times @ seen / (times @ times)
        left = seen - slope * times
        information = times @ times
        pulls = (left * times)[:, None]
        alone = np.array([[left @ left / 149 * information]])
        spread = np.sqrt(spread_together([pulls], alone)[0, 0]) / information
        off.append(slope / spread)
        plain.append(slope / np.sqrt(alone[0, 0]) * information)
    assert np.sqrt(np.mean(np.square(plain))) > 2.3
    assert 0.8 < np.sqrt(np.mean(np.square(off))) < 1.5
