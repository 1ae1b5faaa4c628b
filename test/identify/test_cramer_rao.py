# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The covariance that a fit states: the least possible one, and that of repeated draws of noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from dlo_planner import DirectSimulator, Pose, Rod, fit_rod
from dlo_planner.identify import Observation, ObservedMotion
from dlo_planner.identify.residuals import positions_in_motion

MESH = {'basis': 'local', 'n_elements': 12}
NOISE, DRAWS = 1e-3, 20
S = np.linspace(0.1, 1.0, 7)
POSES = [Pose((0, 0, 1), Rotation.from_rotvec(v).as_quat()) for v in ([0, 0.5, 0.3],
                                                                     [1.2, -0.7, 0.2])]
TRUE = Rod(1.0, 0.07, 0.02, 0.015, natural_curvature=(0.3, -0.2))
NAMES = 'bending_stiffness', 'torsional_stiffness', 'natural_curvature'
USED = [0, 2, 3, 4]  # of the numbers of a fit: a pair of stiffnesses that keeps its ratio is one

STEP = 0.04
SWUNG = [Pose((0.03 * np.sin(6 * k * STEP) * min(1, 5 * k * STEP), 0, 1), (0, 0, 0, 1))
         for k in range(12)]
TIMES = np.arange(0.08, 0.44, 0.02)
FEW = {'basis': 'local', 'n_elements': 5}
SWINGING = Rod(1.0, 0.07, 0.05, 0.04, damping=(0.8, 0.02))


def shapes(rod):
    """Return the points (k, 3) of a rod that is seen at rest."""
    direct = DirectSimulator(rod, **MESH)
    return np.concatenate([direct.solve(pose).positions_at(S) for pose in POSES])


def fitted(points, noise=NOISE):
    """Return the Fit of points (k, 3) of a rod at rest."""
    seen = [Observation(pose, part, S) for pose, part in zip(
        POSES, np.split(points, len(POSES)), strict=True)]
    return fit_rod(replace(TRUE, bending_stiffness=0.023, torsional_stiffness=0.013), seen, NAMES,
                   noise=noise, **MESH)


def rod_of(values):
    """Return the Rod of the numbers (4,) that are sought."""
    return replace(TRUE, bending_stiffness=values[0], torsional_stiffness=values[1],
                   natural_curvature=tuple(values[2:]))


VALUES = np.array([0.02, 0.015, 0.3, -0.2])


def sums_of_squares(found):
    """Return the sum of squares of each error in the stated covariance, [(error, covariance)]."""
    return np.array([error @ np.linalg.solve(covariance, error) for error, covariance in found])


def chance(sums, size):
    """Return the probability of a smaller sum of the sums of squares of `size` normal numbers."""
    return chi2.cdf(sums.sum(), size * len(sums))


def test_the_covariance_is_the_least_possible():
    # inverse of the information (Cramer, Rao) of normal noise, by differences of shapes; little
    # noise: the deviation of what is known badly by its logarithm is larger
    noise = 1e-5
    steps = 1e-4 * np.array([0.02, 0.015, 1.0, 1.0])
    slopes = np.array([(shapes(rod_of(VALUES + step)) - shapes(rod_of(VALUES - step))).ravel()
                       / (2 * step.sum()) for step in np.diag(steps)]).T
    least = np.linalg.inv(slopes.T @ slopes) * noise**2
    found = fitted(shapes(TRUE), noise).covariance[np.ix_(USED, USED)]
    size = np.sqrt(np.diag(least))
    np.testing.assert_allclose(found / np.outer(size, size), least / np.outer(size, size),
                               atol=1e-3)


@pytest.mark.sweep
@pytest.mark.parametrize('known', [True, False])
def test_draws_at_rest_are_off_by_the_covariance(known):
    rng, exact, found = np.random.default_rng(11), shapes(TRUE), []
    for _ in range(DRAWS):
        fit = fitted(exact + NOISE * rng.normal(size=exact.shape), NOISE if known else None)
        values = np.concatenate([np.ravel(fit.values[name]) for name in NAMES])[USED]
        found.append((values - VALUES, fit.covariance[np.ix_(USED, USED)]))
    sums = sums_of_squares(found)
    assert 1e-3 < chance(sums, 4) < 1 - 1e-3
    # a covariance that is 4 times too large or too small would be seen
    assert chance(sums / 4, 4) < 1e-6 and chance(4 * sums, 4) > 1 - 1e-6


@pytest.mark.sweep
def test_draws_of_a_motion_are_off_by_the_covariance():
    rng, found = np.random.default_rng(12), []
    motion = DirectSimulator(SWINGING, **FEW).simulate(SWUNG, STEP)
    exact = positions_in_motion(motion, TIMES, S[2::2])
    for _ in range(DRAWS):
        seen = ObservedMotion(SWUNG, STEP, TIMES, exact + NOISE * rng.normal(size=exact.shape),
                              S[2::2])
        fit = fit_rod(SWINGING, motions=[seen], parameters=['bending_stiffness', 'damping'],
                      noise=NOISE, **FEW)
        values = np.concatenate([np.ravel(fit.values[name]) for name in fit.values])
        found.append(((values - [0.05, 0.05, 0.8, 0.02])[[0, 2, 3]],
                      fit.covariance[np.ix_([0, 2, 3], [0, 2, 3])]))
    sums = sums_of_squares(found)
    assert 1e-3 < chance(sums, 3) < 1 - 1e-3
    assert chance(sums / 4, 3) < 1e-6 and chance(4 * sums, 3) > 1 - 1e-6
