# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a fit explains its points; pictures; which branch a DLO in two grips is on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from dlo_planner import DirectSimulator, FarEnd, InvalidTask, Observer, Pose, Rod, Uncertainty
from dlo_planner.identify import Observation
from dlo_planner.identify.fit import fit_rod, student_widening
from dlo_planner.identify.residuals import MeasurementModel, picture_residuals
from dlo_planner.progress import Progress
from dlo_planner.uncertainty.parameters import Unknowns

TRUE = Rod(1.0, 0.07, 0.02, 0.015)
GUESS = replace(TRUE, bending_stiffness=0.03)
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
S = np.linspace(0.1, 1.0, 10)
POINTS = DirectSimulator(TRUE).solve(LEVEL).positions_at(S)
NOISE = 1e-3
WRONG = {
    'axes swapped': lambda points: points[:, [0, 2, 1]],
    'another order': lambda points: points[:, [1, 2, 0]],
    'z down': lambda points: points * (1, 1, -1),
    'in the frame of the gripper': lambda points: points - (0, 0, 1),
    'gripper off by 5 cm': lambda points: points + (0.0, 0.03, 0.04)}


def seen(rng, change=lambda points: points, noise=NOISE):
    return [Observation(LEVEL, change(POINTS + noise * rng.normal(size=POINTS.shape)), S)]


# ---- what is left is noise ------------------------------------------------------------------


@pytest.mark.parametrize('stated', [None, NOISE])
def test_what_noise_explains_is_converged(rng, stated):
    fit = fit_rod(GUESS, seen(rng), noise=stated)
    assert fit.converged and fit.status == 'converged' and fit.doubt == ''
    assert fit.birge_ratio == 1 if stated is None else 0.6 < fit.birge_ratio < 1.4


@pytest.mark.every(3)
@pytest.mark.parametrize('stated', [None, NOISE])
@pytest.mark.parametrize('wrong', WRONG)
def test_what_no_noise_explains_is_not_converged_and_says_what_to_check(rng, wrong, stated):
    fit = fit_rod(GUESS, seen(rng, WRONG[wrong]), noise=stated)
    assert not fit.converged and fit.status == 'does not explain the points'
    assert 'does not explain' in repr(fit) and 'does not explain' in fit.summary()
    for word in ('axes', 'unit', 'frame', 'gripper', 'far end'):
        assert word in fit.doubt


def test_chi_square_is_that_of_the_points_and_widens_all_deviations(rng):
    names = ('bending_stiffness', 'natural_curvature')
    looks = seen(rng, noise=4 * NOISE)
    right, less = (fit_rod(GUESS, looks, names, noise=one) for one in (4 * NOISE, NOISE))
    # numbers seen less those found; curvature about n, in the plane of gravity, too
    off = DirectSimulator(less.rod, n_elements=64, n_terms=10).solve(LEVEL).positions_at(S)
    square = np.sum((looks[0].points - off) ** 2) / NOISE**2
    assert less.birge_ratio == pytest.approx(np.sqrt(square / (30 - 3)), rel=1e-3)
    assert less.status == 'does not explain the points'
    assert f'{less.birge_ratio:.3g} times' in less.doubt
    assert right.converged and right.birge_ratio == pytest.approx(less.birge_ratio / 4, rel=1e-6)
    for name in names:
        wide = np.array(less.deviations[name]) / np.array(right.deviations[name])
        np.testing.assert_allclose(wide, less.birge_ratio / 4 / max(right.birge_ratio, 1),
                                   rtol=0.02)


def test_noise_that_is_known_within_a_half_is_no_doubt(rng):
    assert fit_rod(GUESS, seen(rng, noise=1.3 * NOISE), noise=NOISE).converged


def test_a_pose_that_is_far_off_by_what_was_stated_counts_in_chi_square(rng):
    looks = [replace(seen(rng)[0], gripper=Pose((0.05, 0, 1), (0, 0, 0, 1)))]
    wide, tight = (fit_rod(GUESS, looks, noise=NOISE, gripper_position=one)
                   for one in (0.05, 1e-3))
    assert wide.converged and not tight.converged and tight.birge_ratio > 3


def test_outliers_are_not_what_a_robust_fit_is_judged_by(rng):
    points = seen(rng)[0].points + (np.arange(10) == 4)[:, None] * [0.1, 0, 0.1]
    looks = [Observation(LEVEL, points, S)]
    robust, plain = (fit_rod(GUESS, looks, loss=loss, noise=NOISE) for loss in ('huber', 'linear'))
    assert robust.converged and not plain.converged


def test_a_stiffness_that_runs_off_is_named_and_not_an_error():
    short = Rod.circular(0.25, 1.5e-3, 8960.0, 110e9, 0.34)
    points = DirectSimulator(short).solve(LEVEL).positions_at(0.25 * S) + (0, 0.01, 0.017)
    fit = fit_rod(short, [Observation(LEVEL, points, 0.25 * S)])
    assert not fit.converged and fit.doubt


@pytest.mark.parametrize('freedom', [3, 4, 7, 30, 1000])
def test_few_numbers_tell_noise_badly_which_widens_deviations(freedom):
    within = [2 * student.cdf(one * student_widening(freedom), freedom) - 1 for one in (1.0, 1.96)]
    assert 0.63 < within[0] < 0.73 and 0.92 < within[1] < 0.98


# ---- pictures -------------------------------------------------------------------------------


@pytest.mark.parametrize('s', [S, None])
def test_what_is_not_measured_in_a_picture_does_not_count(rng, s):
    points = np.array(POINTS)
    fits = []
    for _ in range(2):
        points[:, 1] = rng.uniform(-9, 9, size=10)
        fit = fit_rod(GUESS, [Observation(LEVEL, points, s, normal=(0, 1, 0))])
        fits.append(fit.values['bending_stiffness'][0])
    assert fits[0] == pytest.approx(0.02, rel=1e-6) == fits[1]


def test_a_picture_tells_two_numbers_a_point_and_one_where_s_is_not_known():
    rod = Rod(1.0, 0.0, 0.02, 0.015)
    points = [[0.5, 3.0, 1.01], [0.9, -2.0, 1.02], [1.03, 1.0, 0.99]]  # the last beyond the end

    def numbers(s):
        model = MeasurementModel(Unknowns(rod, ('natural_twist',)),
                                 [Observation(LEVEL, points, s, normal=(0, 1, 0))], (),
                                 np.zeros((0, 6)), {}, Progress()).at(np.zeros(1))
        return model.counts.sum(axis=1).tolist(), np.linalg.norm(model.away, axis=1)

    counts, away = numbers(None)
    assert counts == [1, 1, 2]
    np.testing.assert_allclose(away, [0.01, 0.02, np.sqrt(10e-4)], atol=1e-9)
    counts, away = numbers([0.5, 0.8, 1.0])
    assert counts == [2, 2, 2]
    np.testing.assert_allclose(away, [0.01, np.hypot(0.1, 0.02), np.sqrt(10e-4)], atol=1e-9)


def test_the_nearest_point_in_a_picture_against_a_fine_search(rng):
    rod = Rod(1.0, 0.07, 0.02, 0.015, natural_curvature=(4.0, 3.0))
    shape = DirectSimulator(rod).solve(LEVEL)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    s = rng.uniform(0.05, 0.95, size=30)
    points = shape.positions_at(s) + 5e-3 * rng.normal(size=(30, 3))
    off = picture_residuals(shape, points, None, normal)[0].off
    fine = np.linspace(0, 1, 2001)
    at = shape.positions_at(fine)
    for point, here in zip(points, np.linalg.norm(off, axis=1), strict=True):
        def distance(s, point=point):
            return np.linalg.norm(np.cross(point - shape.positions_at([s])[0], normal))
        best = fine[np.argmin(np.linalg.norm(np.cross(point - at, normal), axis=1))]
        found = minimize_scalar(distance, bounds=(max(best - 1e-3, 0), min(best + 1e-3, 1)),
                                method='bounded', options={'xatol': 1e-10}).fun
        assert here <= found + 1e-7


@pytest.mark.parametrize('known', [True, False])
def test_slopes_of_a_picture_against_differences(rng, known):
    names = ('bending_stiffness', 'natural_curvature')
    picture = [Observation(LEVEL, POINTS + 3e-3 * rng.normal(size=(10, 3)), S if known else None,
                           normal=(0.2, 1.0, 0.1))]
    here = MeasurementModel(Unknowns(GUESS, names), picture, (), np.diag([0.01] * 3 + [2e-3] * 3),
                            {}, Progress())
    x = 0.3 * rng.normal(size=here.size)
    slope = 2 * np.einsum('mi,mik->k', here.at(x).away, here.at(x).slopes)
    for k, step in enumerate(1e-5 * np.eye(here.size)):
        ahead, back = (np.sum(here.at(x + sign * step).away ** 2) for sign in (1, -1))
        assert slope[k] == pytest.approx((ahead - back) / 2e-5, rel=1e-4, abs=1e-6)


@pytest.mark.sweep
@pytest.mark.parametrize(('known', 'noise'), [(True, None), (False, None), (True, 2e-3)])
def test_coverage_of_a_picture_of_five_points(known, noise):
    rng, s, errors = np.random.default_rng(3), S[1::2], []
    for _ in range(60):
        points = POINTS[1::2] + 2e-3 * rng.normal(size=(5, 3)) * (1, 0, 1)
        fit = fit_rod(GUESS, [Observation(LEVEL, points, s if known else None,
                                          normal=(0, 1, 0))], noise=noise)
        value = fit.values['bending_stiffness'][0]
        errors.append(np.log(value / 0.02) * value / fit.deviations['bending_stiffness'][0])
    # 60 samples scatter by 6 and 3 points
    assert 0.55 < (np.abs(errors) < 1).mean() < 0.81
    assert (np.abs(errors) < 1.96).mean() > 0.88


def test_an_observer_takes_no_pictures():
    observer = Observer(DirectSimulator(TRUE), Uncertainty(0.05))
    with pytest.raises(InvalidTask, match='observation.normal'):
        observer.update(observer.begin(), Observation(LEVEL, POINTS, normal=(0, 1, 0)))


@pytest.mark.parametrize(('more', 'named'), [
    ({'normal': (0, 0, 0)}, 'Observation.normal'), ({'normal': 1.0}, 'Observation.normal'),
    ({'initial': 3}, 'Observation.initial'), ({'initial': [(LEVEL,)]}, r'initial\[0\]'),
    ({'initial': [(1, None)]}, r'initial\[0\]\[0\]')])
def test_nonsense_is_named(more, named):
    with pytest.raises(InvalidTask, match=named):
        Observation(LEVEL, POINTS, **more)


# ---- branches of a DLO in two grips ---------------------------------------------------------


def led(rod, axis, place):
    """Return the way of grips in which the far end turns once about an axis, and the last Shape."""
    way = [(LEVEL, FarEnd(Pose.from_rotation(place, Rotation.from_rotvec(
        angle * np.array(axis)).as_matrix()))) for angle in np.linspace(0, 2 * np.pi, 25)]
    direct, shape = DirectSimulator(rod), None
    for gripper, end in way:
        shape = direct.solve(gripper, shape, far_end=end)
    assert shape.converged
    return way, shape


@pytest.mark.every(3)
@pytest.mark.parametrize('known', [True, False])
@pytest.mark.parametrize('axis', [(1.0, 0, 0), (0, -1.0, 0)])
def test_a_held_dlo_is_found_on_the_branch_that_was_seen(rng, axis, known):
    rod, s = Rod(1.0, 0.02, 0.05, 0.04), np.linspace(0.08, 0.92, 12)
    way, shape = led(rod, axis, (0.4, 0.2, 0.9))
    cold = DirectSimulator(rod).solve(LEVEL, far_end=way[-1][1])
    assert np.abs(cold.positions_at(s) - shape.positions_at(s)).max() > 0.03  # it is another one
    look = Observation(LEVEL, shape.positions_at(s) + 5e-4 * rng.normal(size=(12, 3)),
                       s if known else None, way[-1][1])
    guess = replace(rod, bending_stiffness=0.075)
    for initial in (None, shape, way):
        fit = fit_rod(guess, [replace(look, initial=initial)])
        assert fit.converged and fit.misfit < 1.5e-3
        assert fit.values['bending_stiffness'][0] == pytest.approx(0.05, rel=0.05)
