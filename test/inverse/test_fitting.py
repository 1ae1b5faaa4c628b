"""Finding a rod's properties from shapes that a known rod has made."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Observation, Pose, Rod, fit_rod

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
    # where arc lengths are unknown, points are compared with chords between nodes
    tolerance = 1e-7 if known else 1e-3
    assert fit.values['bending_stiffness'] == pytest.approx((0.02, 0.03), rel=tolerance)
    assert fit.values['torsional_stiffness'] == pytest.approx(0.015, rel=10 * tolerance)
    assert fit.values['natural_curvature'] == pytest.approx((0.3, -0.2), abs=tolerance)
    assert fit.misfit < (1e-8 if known else 1e-4)


def test_deviations_tell_the_scatter(rng):
    # the same experiment many times: errors, in stated deviations, scatter by about one
    guess = Rod(1.0, 0.07, (0.03, 0.045), 0.015)
    errors = []
    for _ in range(12):
        fit = fit_rod(guess, observed(rng, 1e-3, True), ('bending_stiffness', 'natural_curvature'))
        errors.append([(fit.values['bending_stiffness'][0] - 0.02)
                       / fit.deviations['bending_stiffness'][0],
                       *(np.array(fit.values['natural_curvature']) - (0.3, -0.2))
                       / fit.deviations['natural_curvature']])
        assert fit.misfit == pytest.approx(np.sqrt(3) * 1e-3, rel=0.25)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4


@pytest.mark.parametrize(('change', 'named'), [
    ({'points': [[1, 2]]}, 'points'), ({'points': [[1, 2, np.nan]]}, 'points'),
    ({'s': [0.1, 0.2]}, 's has shape'), ({'gripper': 3}, 'gripper')])
def test_nonsense_is_named(change, named):
    with pytest.raises(InvalidTask, match=named):
        Observation(**{'gripper': POSES[0], 'points': [[0.1, 0, 1]], 's': [0.1], **change})


def test_nonsense_requests_are_named():
    one = Observation(POSES[0], [[0.1, 0, 1]], [3.0])
    with pytest.raises(InvalidTask, match=r'observations\[0\]'):
        fit_rod(TRUE, [one])
    with pytest.raises(InvalidTask, match='parameters'):
        fit_rod(TRUE, [one], ('colour',))
    with pytest.raises(InvalidTask, match='observations'):
        fit_rod(TRUE, [])
