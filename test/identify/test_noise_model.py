# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a fit minimizes, by differences; what it says of its errors, by repeated draws.

The covariance of sums of what goes together is held against closed forms and repeated draws.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from dlo_planner import Rod
from dlo_planner.identify.noise_model import LOSSES, MEstimator, long_run_covariance

NOISE, SCALE = 2e-3, 1.5


@pytest.mark.parametrize('loss', LOSSES)
def test_slopes_of_losses_against_differences(loss):
    rho = LOSSES[loss]
    z = np.array([1e-3, 0.2, 0.6, 0.97, 1.04, 1.5, 4.0, 30.0])
    h = 1e-4 * z
    value, first, second = rho(z)
    np.testing.assert_allclose((rho(z + h)[0] - rho(z - h)[0]) / (2 * h), first, rtol=1e-6)
    np.testing.assert_allclose((rho(z + h)[1] - rho(z - h)[1]) / (2 * h), second, rtol=1e-6,
                               atol=1e-9)
    near = np.array([1e-6])  # what is near counts by its square
    np.testing.assert_allclose(rho(near)[:2], [near, [1.0]], rtol=1e-5)
    assert (value <= z * (1 + 1e-12)).all() and (second <= 0).all()


class Places:
    """Points (m, 3) in m seen of one place x (3,) in cm, in the part of a MeasurementModel."""

    UNIT = 0.01

    def __init__(self, points):
        self.points, self.size, self.n_parameters = points, 3, 3
        self.rod, self.motions, self.precision = Rod(1.0, 0.07, 0.02, 0.015), (), 1e-6
        self.bounds = np.full(3, -np.inf), np.full(3, np.inf)

    def at(self, x):
        slopes = np.tile(self.UNIT * np.eye(3), (len(self.points), 1, 1))
        return SimpleNamespace(away=self.UNIT * x - self.points, slopes=slopes,
                               counts=np.ones(self.points.shape, bool))

    def forget(self):
        pass

    def use_central_differences(self):
        pass

    def by_motion(self, values):
        return []


def errors_of(points, loss, noise=NOISE):
    return MEstimator(Places(points), np.zeros(3), noise, LOSSES[loss], SCALE)


@pytest.mark.parametrize('loss', LOSSES)
def test_the_mean_slope_of_forces_is_that_of_the_cost(loss, rng):
    # a unit of x is 5 deviations: of each point's cost, sum of second derivatives along the axes
    points, x = NOISE * rng.normal(size=(40, 3)) * 2, np.array([0.1, -0.2, 0.15])
    errors = errors_of(points, loss)
    information = errors._information(x, NOISE)
    h, here = 1e-3, errors.cost(x)
    bend = sum(errors.cost(x + step) - 2 * here + errors.cost(x - step)
               for step in h * np.eye(3)) / h**2
    assert information.stiffness == pytest.approx(
        bend * (NOISE / Places.UNIT) ** 2 / points.size, rel=2e-4)
    slope = [(errors.cost(x + step) - errors.cost(x - step)) / (2 * h) for step in h * np.eye(3)]
    np.testing.assert_allclose(slope, errors._slopes(x, NOISE).T @ errors._residuals(x, NOISE),
                               rtol=1e-5)


@pytest.mark.every(5)
@pytest.mark.parametrize('known', [True, False])
@pytest.mark.parametrize('loss', LOSSES)
def test_deviations_of_a_place_are_those_of_repeated_draws(loss, known):
    rng, off = np.random.default_rng(3), []
    for _ in range(60):
        # one point in eight is far off, which the deviations of a robust loss count
        away = NOISE * rng.normal(size=(40, 3)) * np.where(
            (loss != 'linear') & (rng.random((40, 1)) < 0.125), 4.0, 1.0)
        errors = errors_of(away, loss, NOISE if known else None)
        found, told = errors.with_noise(errors.minimum(np.array([0.3, -0.2, 0.1])))
        off.append(found.x / told.deviations)
    # 180 independent numbers: within four deviations of their root mean square
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1, abs=4 / np.sqrt(2 * 180))


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
        sums.append(long_run_covariance(series, np.array([[4.0 * k]]))[0, 0])
    true = 4 * k * (1 + rho) / (1 - rho)
    assert true * (1 - tolerance) < np.mean(sums) < true * (1 + 0.5 * tolerance) + 0.08 * 4 * k


def test_one_direction_that_lasts_is_told_from_one_that_does_not(rng):
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    pulls = np.column_stack([lasting(rng, 4000, 1, 0.8), rng.normal(size=(4000, 1))]) @ turn.T
    found = turn.T @ long_run_covariance([pulls], 4000 * np.eye(2)) @ turn / 4000
    assert found[0, 0] == pytest.approx(9, rel=0.25)
    assert found[1, 1] == pytest.approx(1, abs=0.3)


def test_it_is_never_less_than_of_what_is_independent(rng):
    # pulls that alternate add up to nothing, which may be chance
    pulls = lasting(rng, 60, 3, -0.9)
    alone = pulls.T @ pulls
    assert np.linalg.eigvalsh(long_run_covariance([pulls], alone) - alone).min() > -1e-9 * 60


def test_what_nothing_is_known_of_stays_so(rng):
    pulls = lasting(rng, 50, 3, 0.7) * [1.0, 1e-4, 0.0]
    out = long_run_covariance([pulls], pulls.T @ pulls)
    assert np.isfinite(out).all()
    assert out[2].tolist() == [0.0, 0.0, 0.0]
    assert np.array_equal(long_run_covariance([], np.eye(2)), np.eye(2))
    assert np.array_equal(long_run_covariance([np.ones((1, 2))], np.eye(2)), np.eye(2))


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
        spread = np.sqrt(long_run_covariance([pulls], alone)[0, 0]) / information
        off.append(slope / spread)
        plain.append(slope / np.sqrt(alone[0, 0]) * information)
    assert np.sqrt(np.mean(np.square(plain))) > 2.3
    assert 0.8 < np.sqrt(np.mean(np.square(off))) < 1.5
