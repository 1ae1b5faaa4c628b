# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Finding a rod's properties from shapes that a known rod has made."""

import numpy as np
import pytest
from fit_coverage import coverage
from scipy.spatial.transform import Rotation

from dlo_planner import (
    DeadlineExceeded,
    DirectSimulator,
    InvalidTask,
    Pose,
    Rod,
    Uncertainty,
    fit_rod,
)
from dlo_planner.identify import Observation, ObservedMotion
from dlo_planner.identify.residuals import MeasurementModel
from dlo_planner.progress import Progress
from dlo_planner.uncertainty.parameters import Unknowns

TRUE = Rod(1.0, 0.07, (0.02, 0.03), 0.015, natural_curvature=(0.3, -0.2))
POSES = [Pose((0, 0, 1), Rotation.from_rotvec(v).as_quat())
         for v in ([0, 0, 0], [0, 0.5, 0.3], [1.2, -0.7, 0.2], [0.5, -1.5, 0])]


def observed(rng, noise, known):
    simulator = DirectSimulator(TRUE)
    s = np.linspace(0.1, 1.0, 10)
    for pose in POSES:
        points = simulator.solve(pose).positions_at(s)
        yield Observation(pose, points + noise * rng.normal(size=points.shape),
                          s if known else None)


@pytest.mark.parametrize('known', [True, False])
def test_exact_observations_give_the_exact_rod(rng, known):
    guess = Rod(1.0, 0.07, (0.04, 0.06), 0.03)
    fit = fit_rod(guess, observed(rng, 0.0, known),
                  ('bending_stiffness', 'torsional_stiffness', 'natural_curvature'))
    assert fit.converged
    tolerance = 1e-7
    assert fit.values['bending_stiffness'] == pytest.approx((0.02, 0.03), rel=tolerance)
    assert fit.values['torsional_stiffness'] == pytest.approx(0.015, rel=10 * tolerance)
    assert fit.values['natural_curvature'] == pytest.approx((0.3, -0.2), abs=tolerance)
    assert fit.misfit < 1e-8


def test_a_section_goes_with_the_stiffness_that_is_fitted():
    # what yields by the fibers of its section does so with other stiffness too
    rod = Rod.tube(1.0, 4e-3, 3e-3, 8960.0, 110e9, 0.34, yield_stress=60e6)
    other = Unknowns(rod, ('bending_stiffness', 'torsional_stiffness')).of(np.log([1.5, 0.8]))
    assert other.section_model == 'fibers'
    assert other.bending_stiffness == pytest.approx(np.multiply(1.5, rod.bending_stiffness))
    assert other.section.bending_stiffness == pytest.approx(other.bending_stiffness)
    assert other.section.torsional_stiffness == pytest.approx(0.8 * rod.torsional_stiffness)


@pytest.mark.sweep
@pytest.mark.parametrize(('case', 'repeats'), [('without s', 16),
                                               ('with s, gripper, noise known', 8)])
def test_coverage(case, repeats):
    # `python test/fit_coverage.py` is the same with more repeats: there within 5 points
    errors = coverage(case, repeats)
    assert 0.5 < (np.abs(errors) < 1).mean() < 0.85
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.4


@pytest.mark.sweep
def test_the_noise_found_counts_what_was_fitted_to_it():
    # nine numbers, four of them used up: without that the noise would be a third too small
    rod, rng, s = Rod(1.0, 0.07, 0.02, 0.015), np.random.default_rng(0), [0.4, 0.7, 1.0]
    exact = DirectSimulator(rod).solve(POSES[1]).positions_at(s)
    found = [fit_rod(rod, [Observation(POSES[1], exact + 1e-3 * rng.normal(size=(3, 3)), s)],
                     ('bending_stiffness', 'natural_curvature')).noise for _ in range(12)]
    assert 0.75e-6 < np.mean(np.square(found)) < 1.3e-6


@pytest.mark.parametrize('known', [True, False])
def test_slopes_against_differences(known, rng):
    guess = Rod(1.0, 0.07, (0.025, 0.04), 0.02)
    names = ('bending_stiffness', 'torsional_stiffness', 'natural_curvature')
    points = list(observed(rng, 3e-3, known))
    assert known or any(nearest_ends(guess, points))
    here = MeasurementModel(Unknowns(guess, names), points, (),
                            np.diag([0.01] * 3 + [0.002] * 3), {}, Progress())
    x = 0.3 * rng.normal(size=here.size)
    at = here.at(x)
    slope = 2 * np.einsum('mi,mik->k', at.away, at.slopes)
    for k, step in enumerate(1e-5 * np.eye(here.size)):
        ahead, back = (np.sum(here.at(x + sign * step).away ** 2) for sign in (1, -1))
        assert slope[k] == pytest.approx((ahead - back) / 2e-5, rel=1e-4, abs=1e-6)


def nearest_ends(rod, points):
    """Yield whether points of each observation are nearest to an end of the DLO."""
    for one in points:
        counts = MeasurementModel(Unknowns(rod, ('natural_twist',)), [one], (), np.zeros((0, 6)),
                                  {}, Progress()).at(np.zeros(1)).counts
        yield counts[:, 0].any() and not counts[:, 0].all()


def test_a_nearest_point_tells_two_numbers_and_three_beyond_the_end():
    pose, rod = POSES[0], Rod(1.0, 0.0, 0.02, 0.015)
    points = [[0.5, 0.01, 1.0], [0.95, 0.0, 1.02], [1.03, 0.02, 0.99], [-0.01, 0.005, 1.0]]
    at = MeasurementModel(Unknowns(rod, ('natural_twist',)), [Observation(pose, points)], (),
                  np.zeros((0, 6)), {}, Progress()).at(np.zeros(1))
    assert at.counts.sum(axis=1).tolist() == [2, 2, 3, 3]
    np.testing.assert_allclose(np.linalg.norm(at.away, axis=1),
                               [0.01, 0.02, np.sqrt(14e-4), np.sqrt(1.25e-4)], atol=1e-12)


def test_an_error_of_the_gripper_is_found_and_not_taken_for_stiffness(rng):
    off = Pose((0.002, -0.001, 1.003), Rotation.from_rotvec([0.0, -0.02, 0.01]).as_quat())
    direct, s = DirectSimulator(TRUE), np.linspace(0.05, 1, 20)
    seen = [Observation(POSES[0], direct.solve(off).positions_at(s)
                        + 1e-4 * rng.normal(size=(20, 3)), s)]
    guess = Rod(1.0, 0.07, (0.03, 0.045), 0.015, natural_curvature=(0.3, -0.2))
    plain = fit_rod(guess, seen)
    fit = fit_rod(guess, seen, gripper_position=3e-3, gripper_rotation=0.02)
    errors = [abs(one.values['bending_stiffness'][0] - 0.02)
              / one.deviations['bending_stiffness'][0] for one in (plain, fit)]
    assert fit.converged and errors[1] < 2.5 < errors[0]
    np.testing.assert_allclose(fit.grippers[0].matrix, off.matrix, atol=5e-3)
    assert fit.noise == pytest.approx(1e-4, rel=0.25)
    assert fit_rod(guess, seen, prior=Uncertainty(gripper_position=3e-3, gripper_rotation=0.02)
                   ).values == fit.values


def test_a_prior_alone_is_the_answer_where_nothing_is_seen():
    # a straight DLO that hangs down does not tell its stiffness
    down = Pose.looking_along((0, 0, 1), (0, 0, -1))
    seen = [Observation(down, [[0, 0, 0.5], [0, 0, 0.2]], [0.5, 0.8])]
    rod = Rod(1.0, 0.07, 0.02, 0.015)
    fit = fit_rod(rod, seen, noise=1e-3, prior=Uncertainty(bending_stiffness=0.1))
    assert fit.values['bending_stiffness'][0] == pytest.approx(0.02, rel=1e-6)
    log_normal = np.sqrt(np.exp(0.01) * np.expm1(0.01))
    assert fit.deviations['bending_stiffness'][0] == pytest.approx(0.02 * log_normal, rel=1e-3)
    unknown = fit_rod(rod, seen, noise=1e-3)
    assert unknown.deviations['bending_stiffness'] == (np.inf, np.inf)


@pytest.mark.every(2)
@pytest.mark.parametrize('loss', ['soft_l1', 'huber', 'cauchy', 'arctan'])
def test_outliers_do_not_spoil_a_robust_fit(rng, loss):
    seen = [Observation(one.gripper, one.points + (np.arange(10) == 4)[:, None] * [0.1, 0, 0.1],
                        one.s) for one in observed(rng, 1e-3, True)]
    guess = Rod(1.0, 0.07, (0.03, 0.045), 0.015, natural_curvature=(0.3, -0.2))
    plain, fit = fit_rod(guess, seen), fit_rod(guess, seen, loss=loss)
    errors = [abs(one.values['bending_stiffness'][0] / 0.02 - 1) for one in (plain, fit)]
    assert errors[1] < 0.02 < errors[0]
    assert fit.noise == pytest.approx(1e-3, rel=0.4)


def test_progress_and_deadline(rng):
    seen, calls = list(observed(rng, 1e-3, True)), []
    fit_rod(TRUE, seen, progress=lambda *step: calls.append(step))
    assert calls == [(k, calls[-1][1]) for k in range(1, calls[-1][1] + 1)]
    with pytest.raises(DeadlineExceeded, match='deadline'):
        fit_rod(TRUE, seen, deadline=1e-9)


@pytest.mark.parametrize(('more', 'named'), [
    ({'color': 1}, 'color'), ({'strains': 'paper', 'method': 'dfp'}, 'strains'),
    ({'prior': Uncertainty(mass=0.1)}, r'prior.mass'), ({'prior': 3}, 'prior'),
    ({'noise': 0}, 'noise'),
    ({'loss': 'l2'}, 'loss'), ({'loss_scale': -1}, 'loss_scale'),
    ({'gripper_rotation': -1}, 'gripper_rotation'), ({'parameters': ()}, 'parameters'),
    ({'parameters': ('bending_stiffness',) * 2}, 'parameters'), ({'progress': 3}, 'progress'),
    ({'parameters': ('bending_stiffness', 'bending_stiffness_n')}, 'components'),
    ({'parameters': ('damping',)}, 'motions'), ({'parameters': ('tip_mass',)}, 'tip_mass'),
    ({'knots': (0.0, 1.0)}, 'knots'), ({'motions': (3,)}, 'motions'),
    ({'parameters': ('natural_twist',), 'knots': (0.5, 0.2)}, 'knots'),
    ({'parameters': ('natural_twist',), 'knots': (0.0, 1.2)}, 'knots')])
def test_what_is_not_taken_into_account_is_refused(more, named):
    with pytest.raises(InvalidTask, match=named):
        fit_rod(TRUE, [Observation(POSES[0], [[0.1, 0, 1]], [0.1])], **more)


def test_nonsense_requests_are_named():
    one = Observation(POSES[0], [[0.1, 0, 1]], [3.0])
    with pytest.raises(InvalidTask, match=r'observations\[0\]'):
        fit_rod(TRUE, [one])
    with pytest.raises(InvalidTask, match='parameters'):
        fit_rod(TRUE, [one], ('color',))
    with pytest.raises(InvalidTask, match='observations'):
        fit_rod(TRUE, [])


def test_points_that_no_such_rod_has_are_refused(rng):
    seen = list(observed(rng, 0.0, True))
    in_mm = [Observation(one.gripper, 1e3 * one.points, one.s) for one in seen]
    with pytest.raises(InvalidTask, match=r'observations\[0\].points: half of them are .* in m'):
        fit_rod(TRUE, in_mm)
    motion = ObservedMotion(POSES[:1] * 3, 0.1, [0.0, 0.2], np.full((2, 2, 3), 9.0), [0.4, 1.0])
    with pytest.raises(InvalidTask, match=r'motions\[0\].points'):
        fit_rod(TRUE, motions=[motion])
    # a few are outliers
    points = seen[0].points + (np.arange(10) < 4)[:, None] * [1e3, 0, 0]
    mixed = [Observation(seen[0].gripper, points, seen[0].s), *seen[1:]]
    assert fit_rod(TRUE, mixed, loss='cauchy').values['bending_stiffness'][0] == pytest.approx(
        0.02, rel=0.01)
