# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Several unknowns at once, held far ends, natural strains along s, motions: true or not known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, FarEnd, InvalidTask, Pose, Rod, Uncertainty, fit_rod
from dlo_planner.direct.boundary_motion import GripTrajectory
from dlo_planner.identify import Observation, ObservedMotion
from dlo_planner.identify.residuals import MeasurementModel, positions_in_motion
from dlo_planner.progress import Progress
from dlo_planner.results import Motion
from dlo_planner.uncertainty.parameters import Unknowns

MESH = {'basis': 'local', 'n_elements': 16}
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
POSES = [Pose((0, 0, 1), Rotation.from_rotvec(v).as_quat())
         for v in ([0, 0, 0], [0, 0.5, 0.3], [1.2, -0.7, 0.2], [0.5, -1.5, 0], [2.0, 0.3, 0.8])]
ENDS = [Pose((0.75, 0.1, 0.9), Rotation.from_rotvec([0.3, 0.2, 0.1]).as_quat()),
        FarEnd(Pose((0.6, -0.2, 1.1), Rotation.from_rotvec([0.8, -0.2, 0.4]).as_quat())),
        (0.7, 0.2, 1.0)]
S = np.linspace(0.05, 0.95, 13)
NOISE = 5e-4


def at_rest(rod, rng, poses=POSES, ends=None, noise=NOISE):
    direct = DirectSimulator(rod, **MESH)
    for pose, end in zip(poses, ends or [None] * len(poses), strict=True):
        points = direct.solve(pose, far_end=end).positions_at(S)
        yield Observation(pose, points + noise * rng.normal(size=points.shape), S, end)


def errors(fit, **true):
    """Return the errors of all numbers in stated deviations."""
    return np.concatenate([np.ravel((np.array(fit.values[name]) - value) / fit.deviations[name])
                           for name, value in true.items()])


def test_components_and_twist(rng):
    rod = Rod(1.0, 0.07, (0.02, 0.03), 0.015, natural_twist=0.4, natural_curvature=(0.5, -0.3))
    fit = fit_rod(Rod(1.0, 0.07, 0.03, 0.02), at_rest(rod, rng), (
        'bending_stiffness_n', 'bending_stiffness_b', 'torsional_stiffness', 'natural_curvature',
        'natural_twist'), **MESH)
    off = errors(fit, bending_stiffness_n=0.02, bending_stiffness_b=0.03, natural_twist=0.4,
                 torsional_stiffness=0.015, natural_curvature=(0.5, -0.3))
    assert fit.converged and fit.noise == pytest.approx(NOISE, rel=0.2)
    assert np.abs(off).max() < 3
    assert fit.rod.bending_stiffness == pytest.approx((0.02, 0.03), rel=0.05)


def test_natural_curvature_along_the_dlo(rng):
    rows = ((0.0, (0.3, -0.2)), (0.5, (0.8, 0.1)), (1.0, (-0.4, 0.3)))
    rod = Rod(1.0, 0.07, 0.02, 0.015, natural_curvature=rows)
    true, knots = np.array([row[1] for row in rows]), [row[0] for row in rows]
    guess = Rod(1.0, 0.07, 0.03, 0.015)
    names = ('bending_stiffness', 'natural_curvature')
    exact = fit_rod(guess, at_rest(rod, rng, noise=0.0), names, knots=knots, **MESH)
    np.testing.assert_allclose(exact.values['natural_curvature'], true, atol=1e-5)
    assert np.array_equal(exact.rod.natural_curvature.s, knots)
    fit = fit_rod(guess, at_rest(rod, rng), names, knots=knots, **MESH)
    assert fit.converged and np.shape(fit.deviations['natural_curvature']) == (3, 2)
    assert np.abs(errors(fit, natural_curvature=true)).max() < 3
    assert fit.names[2:4] == ('natural_curvature[0]', 'natural_curvature[1]')


def test_far_ends(rng):
    rod = Rod(1.0, 0.07, 0.02, 0.015, natural_curvature=(0.3, -0.2))
    seen = list(at_rest(rod, rng, [LEVEL] * 3, ENDS))
    assert seen[2].far_end.grip == 'pinned'
    fit = fit_rod(Rod(1.0, 0.07, 0.03, 0.02), seen, (
        'bending_stiffness', 'torsional_stiffness', 'natural_curvature'), **MESH)
    off = errors(fit, bending_stiffness=0.02, torsional_stiffness=0.015,
                 natural_curvature=(0.3, -0.2))
    assert fit.converged and np.abs(off).max() < 3
    assert fit.noise == pytest.approx(NOISE, rel=0.25)


@pytest.mark.parametrize(('held', 'mesh'), [
    (False, MESH), (True, MESH), (False, {'n_elements': 32, 'n_terms': 6})])
def test_slopes_against_differences(held, mesh, rng):
    guess = Rod(1.0, 0.07, (0.025, 0.04), 0.02, tip_mass=0.01)
    unknowns = Unknowns(guess, ('bending_stiffness_n', 'bending_stiffness_b', 'natural_curvature',
                                'torsional_stiffness', 'natural_twist', 'mass_per_length',
                                'tip_mass'), (0.2, 0.9))
    seen = list(at_rest(guess, rng, [LEVEL] * 3, ENDS) if held else at_rest(guess, rng))
    here = MeasurementModel(unknowns, seen, (), np.zeros((0, 6)), mesh, Progress())
    x = 0.2 * rng.normal(size=here.size)
    slopes = here.at(x).slopes
    for k, step in enumerate(3e-4 * np.eye(here.size)):
        ahead, back = (here.at(x + sign * step).away for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, :, k], (ahead - back) / 6e-4, atol=1e-6)


def test_slopes_of_a_dlo_that_yields_against_differences(rng):
    rod = Rod(1.0, 0.07, (0.02, 0.03), 0.015, natural_curvature=(0.3, -0.2), yield_curvature=3.0,
              hardening=0.1)
    assert DirectSimulator(rod, **MESH).solve(POSES[2]).dissipated > 0
    unknowns = Unknowns(rod, ('bending_stiffness', 'torsional_stiffness', 'natural_curvature',
                              'mass_per_length'))
    here = MeasurementModel(unknowns, list(at_rest(rod, rng, POSES[2:3])), (), np.zeros((0, 6)),
                            MESH, Progress())
    x = 0.1 * rng.normal(size=here.size)
    slopes = here.at(x).slopes
    for k, step in enumerate(1e-3 * np.eye(here.size)):
        ahead, back = (here.at(x + sign * step).away for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, :, k], (ahead - back) / 2e-3, atol=1e-6)


@pytest.mark.sweep
def test_deviations_are_those_of_repeated_experiments():
    rng, off = np.random.default_rng(5), []
    rod = Rod(1.0, 0.07, (0.02, 0.03), 0.015, tip_mass=0.02, natural_twist=0.3)
    guess = Rod(1.0, 0.06, (0.022, 0.028), 0.017, tip_mass=0.02)
    for _ in range(10):
        fit = fit_rod(guess, at_rest(rod, rng, POSES[1:]), (
            'bending_stiffness_n', 'bending_stiffness_b', 'torsional_stiffness', 'mass_per_length',
            'natural_twist'), **MESH)
        off.append(errors(fit, bending_stiffness_n=0.02, bending_stiffness_b=0.03,
                          mass_per_length=0.07, torsional_stiffness=0.015, natural_twist=0.3))
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5
    # stiffness and mass are known apart by the tip mass alone: nearly one and the same error
    assert fit.correlations[0, 3] > 0.9
    spread = np.sqrt(np.diag(fit.covariance))
    assert spread[3] == fit.deviations['mass_per_length']
    np.testing.assert_allclose(fit.covariance, fit.correlations * np.outer(spread, spread))


def test_what_only_ratios_tell_has_no_finite_deviation(rng):
    rod = Rod(1.0, 0.07, (0.02, 0.03), 0.015)
    seen = list(at_rest(rod, rng))
    names = ('bending_stiffness', 'torsional_stiffness', 'mass_per_length')
    fit = fit_rod(Rod(1.0, 0.05, (0.02, 0.03), 0.02), seen, names, **MESH)
    assert all(np.isinf(fit.deviations[name]).all() for name in names)
    np.testing.assert_allclose(fit.correlations, 1.0, atol=1e-6)
    ratio = fit.values['bending_stiffness'][0] / fit.values['mass_per_length']
    assert ratio == pytest.approx(0.02 / 0.07, rel=0.02)
    assert 'not resolvable' in repr(fit)
    # a prior of one of them makes all of them known
    known = fit_rod(Rod(1.0, 0.07, (0.02, 0.03), 0.02), seen, names, prior=Uncertainty(mass=0.05),
                    **MESH)
    deviations = [np.ravel(known.deviations[name])[0] / np.ravel(known.values[name])[0]
                  for name in names]
    assert all(0.04 < one < 0.1 for one in deviations)


def test_torsion_is_not_told_by_a_dlo_that_stays_in_a_plane(rng):
    turned = [Pose((0, 0, 1), Rotation.from_euler('y', a, degrees=True).as_quat())
              for a in (0, 30, 70)]
    fit = fit_rod(Rod(1.0, 0.07, 0.03, 0.02), at_rest(Rod(1.0, 0.07, 0.02, 0.015), rng, turned),
                  ('bending_stiffness', 'torsional_stiffness'), **MESH)
    assert abs(errors(fit, bending_stiffness=0.02)).max() < 3
    assert fit.deviations['torsional_stiffness'] > 10 * fit.values['torsional_stiffness']


@pytest.mark.sweep
def test_what_varies_is_scaled_as_a_whole(rng):
    rows = ((0.0, 0.03), (1.0, 0.015))
    rod = Rod(1.0, 0.07, rows, 0.015)
    guess = Rod(1.0, 0.07, tuple((s, 1.3 * value) for s, value in rows), 0.015)
    fit = fit_rod(guess, at_rest(rod, rng), **MESH)
    assert abs(errors(fit, bending_stiffness=rod.stiffness[1:])).max() < 3


STEP, STEPS = 0.03, 25
SHAKEN = [Pose((0.02 * np.sin(5 * k * STEP) * min(1, 5 * k * STEP), 0.01 * np.sin(8 * k * STEP), 1),
               (0, 0, 0, 1)) for k in range(STEPS)]
COARSE = {'basis': 'local', 'n_elements': 5}


def shaken(rod, rng, noise=1e-3):
    times, s = np.arange(0.05, 0.72, 0.02), np.array([0.3, 0.6, 1.0])
    motion = DirectSimulator(rod, **COARSE).simulate(SHAKEN, STEP)
    points = positions_in_motion(motion, times, s)
    return ObservedMotion(SHAKEN, STEP, times, points + noise * rng.normal(size=points.shape), s)


def test_a_motion_tells_stiffness_and_damping(rng):
    rod = Rod(1.0, 0.07, 0.05, 0.04, damping=(0.5, 0.004))
    fit = fit_rod(Rod(1.0, 0.07, 0.06, 0.04), parameters=('bending_stiffness', 'damping'),
                  motions=[shaken(rod, rng)], **COARSE)
    assert fit.converged and fit.noise == pytest.approx(1e-3, rel=0.15)
    assert np.abs(errors(fit, bending_stiffness=0.05, damping=(0.5, 0.004))).max() < 3
    assert fit.deviations['damping'][0] < 0.2


def test_errors_that_last_widen_the_deviations(rng):
    rod, known = Rod(1.0, 0.07, 0.05, 0.04, damping=(0.5, 0.004)), {}
    clean = shaken(rod, rng, noise=0.0)
    lasting = 1e-3 * rng.normal(size=(len(clean.times), 1, 3))  # alike for all points
    for k in range(1, len(lasting)):
        lasting[k] = 0.7 * lasting[k - 1] + 0.714 * lasting[k]
    for name, error in (('lasting', lasting), ('mixed', rng.permutation(lasting))):
        seen = ObservedMotion(clean.grippers, clean.dt, clean.times, clean.points + error, clean.s)
        known[name] = fit_rod(Rod(1.0, 0.07, 0.06, 0.04), motions=[seen],
                              parameters=('bending_stiffness', 'damping'), **COARSE)
    fit, mixed = known['lasting'], known['mixed']
    assert np.abs(errors(fit, bending_stiffness=0.05, damping=(0.5, 0.004))).max() < 3
    assert fit.deviations['damping'][0] > 1.2 * mixed.deviations['damping'][0]


def both_ends(count=6, dt=0.08):
    """Return grippers and far ends of a DLO that sags between them and is shaken, and dt."""
    times = dt * np.arange(count)
    ramp = np.clip(times / 0.4, 0, 1) ** 2
    grippers = [Pose.looking_along((0.06 * r * np.sin(4 * t), 0, 1),
                                   (1, 0.2 * r * np.sin(3 * t), -1))
                for t, r in zip(times, ramp, strict=True)]
    ends = [FarEnd(Pose.looking_along((0.7, 0.08 * r * np.sin(5 * t), 1), (1, 0, 0.8)), 'aligned')
            for t, r in zip(times, ramp, strict=True)]
    return grippers, ends, dt


def test_a_motion_held_at_both_ends_tells_stiffness():
    rod = Rod(1.0, 0.07, 0.03, 0.02, natural_curvature=(0.3, -0.2), damping=(0.6, 0.0))
    grippers, ends, dt = both_ends()
    motion = DirectSimulator(rod, **COARSE).simulate(grippers, dt, far_ends=ends, tolerance=1e-4)
    times, s = np.linspace(0.1, 0.35, 6), np.array([0.2, 0.5, 0.8])
    points = positions_in_motion(motion, times, s)

    def away(**more):
        seen = ObservedMotion(grippers, dt, times, points, s, **more)
        here = MeasurementModel(Unknowns(rod, ('bending_stiffness',)), (), [seen], np.zeros((0, 6)),
                        COARSE, Progress())
        here.choose_steps(np.zeros(1))
        return here

    here = away(far_ends=ends)
    assert np.abs(here.at(np.zeros(1)).away).max() < 5e-4
    off = here.at(np.array([0.2]))  # of a stiffness that is 22 % too large
    step = np.linalg.lstsq(off.slopes.reshape(-1, 1), off.away.ravel(), rcond=None)[0]
    assert 0.2 - step[0] == pytest.approx(0, abs=0.03)
    assert np.abs(away().at(np.zeros(1)).away).max() > 0.1  # with a free end it is far away


def test_a_coarse_dt_is_cut():
    # seen with 20 steps of 1 ms in each step that the fit is given
    rod = Rod(1.0, 0.07, 0.05, 0.04, damping=(0.5, 0.004))
    guide = GripTrajectory(SHAKEN[::4], 4 * STEP)
    times, s = np.arange(0.1, 0.7, 0.1), np.array([0.6, 1.0])
    fine = [guide.at(k / 20) for k in range(20 * 6 + 1)]
    motion = DirectSimulator(rod, **COARSE).simulate(fine, 4 * STEP / 20, tolerance=np.inf)
    seen = ObservedMotion(SHAKEN[::4], 4 * STEP, times, positions_in_motion(motion, times, s), s)
    here = MeasurementModel(Unknowns(rod, ('damping',)), (), [seen], np.zeros((0, 6)), COARSE,
                            Progress())
    off = np.abs(here.at(np.zeros(2)).away).max()
    here.choose_steps(np.zeros(2))
    assert np.abs(here.at(np.zeros(2)).away).max() < 2.5e-4 < 0.5 * off


@pytest.mark.sweep
def test_a_motion_tells_ratios_only(rng):
    rod = Rod(1.0, 0.07, 0.05, 0.04, damping=(0.5, 0.004))
    names = ('bending_stiffness', 'mass_per_length')
    guess = Rod(1.0, 0.07, 0.05, 0.04, damping=(0.5, 0.004))
    # torsion hardly counts here: what remains is one ratio
    fit = fit_rod(guess, parameters=names, motions=[shaken(rod, rng)], **COARSE)
    for name in names:
        assert np.ravel(fit.deviations[name])[0] > np.ravel(fit.values[name])[0]
    assert fit.correlations[0, 2] == pytest.approx(1, abs=1e-3)


def test_between_its_instants_a_motion_goes_on_cubics():
    # a DLO that is carried along a cubic of time
    shape = DirectSimulator(Rod(1.0, 0.07, 0.05, 0.04), **COARSE).solve(LEVEL)
    powers = np.array([[0.1, -0.2, 0.3], [0.2, 0.1, 0.0], [-0.3, 0.2, 0.1], [0.4, -0.5, 0.6]])
    times, s = np.array([0.0, 0.5, 0.8, 1.2]), [0.25, 1.0]
    speeds = np.vander(times, 3, increasing=True) @ (powers[1:] * [[1], [2], [3]])
    ways = np.vander(times, 4, increasing=True) @ powers
    motion = Motion(times, [shape.moved(at) for at in ways],
                    np.tile(speeds[:, None], (1, shape.s.size, 1)), np.zeros(4), np.zeros(4))
    when = np.array([0.0, 0.1, 0.5, 0.77, 1.2])
    wanted = (np.vander(when, 4, increasing=True) @ powers)[:, None] + shape.positions_at(s)
    np.testing.assert_allclose(positions_in_motion(motion, when, s), wanted, atol=1e-12)


@pytest.mark.parametrize(('change', 'named'), [
    ({'grippers': [LEVEL]}, 'grippers'), ({'dt': 0}, 'dt'), ({'times': [0.0, 9.0]}, 'times'),
    ({'points': np.zeros((2, 2, 3))}, 'points'), ({'s': [-1.0]}, 's'), ({'initial': 3}, 'initial'),
    ({'far_ends': [LEVEL]}, 'far_ends'), ({'far_ends': 3}, 'far_ends'),
    ({'far_ends': [LEVEL, (1, 0, 1), LEVEL]}, 'one grip'),
    ({'displacements': np.zeros((2, 1, 3))}, 'displacements'),
    ({'displacements': np.full((1, 2, 1, 3), np.nan)}, 'displacements')])
def test_nonsense_motions_are_named(change, named):
    with pytest.raises(InvalidTask, match=named):
        ObservedMotion(**{'grippers': [LEVEL] * 3, 'dt': 0.1, 'times': [0.0, 0.2],
                          'points': np.zeros((2, 1, 3)), 's': [1.0], **change})


def test_what_else_displaces_points_is_found_and_not_taken_for_stiffness(rng):
    rod, guess = Rod(1.0, 0.07, 0.05, 0.04), Rod(1.0, 0.07, 0.06, 0.04)
    clean = shaken(rod, rng, noise=0.0)
    turned = [Pose(pose.position, (Rotation.from_quat(pose.quaternion)
                                   * Rotation.from_rotvec([0, 0.02, 0])).as_quat())
              for pose in SHAKEN]
    there = DirectSimulator(rod, **COARSE).simulate(turned, STEP)
    cause = positions_in_motion(there, clean.times, clean.s) - clean.points
    noise = 1e-3 * rng.normal(size=clean.points.shape)
    off = replace(clean, points=clean.points + 1.5 * cause + noise)
    told = replace(off, displacements=[cause, 1e-3 * rng.normal(size=cause.shape)])
    plain, fit = (fit_rod(guess, motions=[one], parameters=['bending_stiffness'], **COARSE)
                  for one in (off, told))
    assert abs(errors(plain, bending_stiffness=0.05)).max() > 3
    assert abs(errors(fit, bending_stiffness=0.05)).max() < 3
    assert fit.noise == pytest.approx(1e-3, rel=0.15) and plain.noise > 1.5e-3
