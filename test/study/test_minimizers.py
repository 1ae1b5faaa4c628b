# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's minimizers: against a function with a known minimum, and against Newton's."""

import numpy as np
import pytest
from scipy.optimize import rosen, rosen_der

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.direct.search import METHODS
from dlo_planner.study.minimizers import (
    SEARCHES,
    Objective,
    Point,
    dfp,
    downhill_simplex,
    hager_zhang_search,
    quadratic_surface,
)

ROSENBROCK = Objective(rosen, lambda q: (rosen(q), rosen_der(q)), 1.0)
TILTED = Pose((0, 0, 1), (0.1, -0.2, 0.05, 0.97))


def test_dfp_finds_rosenbrocks_minimum():
    found = dfp(ROSENBROCK, np.array([-1.2, 1.0, 0.5]), 1e-10)
    np.testing.assert_allclose(found.q, 1.0, atol=1e-8)
    assert 10 < found.iterations <= found.evaluations < 1000


def test_dfp_learns_the_inverse_hessian_of_a_quadratic(rng):
    # in n dimensions n exact line searches do; with inexact ones a few more
    root = rng.normal(size=(6, 6))
    matrix = np.eye(6) + 0.3 * root @ root.T
    center = rng.normal(size=6)
    problem = Objective(lambda q: 0.5 * (q - center) @ matrix @ (q - center),
                        lambda q: (0.5 * (q - center) @ matrix @ (q - center),
                                   matrix @ (q - center)), 1.0)
    found = dfp(problem, np.zeros(6), 1e-12)
    np.testing.assert_allclose(found.q, center, atol=1e-10)
    assert found.iterations < 30


def test_downhill_simplex_finds_rosenbrocks_minimum():
    found = downhill_simplex(ROSENBROCK, np.array([-1.2, 1.0, 0.5]), 1e-10)
    np.testing.assert_allclose(found.q, 1.0, atol=1e-5)
    assert 10 < found.iterations < found.evaluations


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier', 'local'])
@pytest.mark.parametrize('rod', ['wire', 'curly'])
def test_dfp_agrees_with_newton(rod, basis, request):
    rod = request.getfixturevalue(rod)
    one, two = (DirectSimulator(rod, basis=basis, n_elements=24, method=method).solve(TILTED)
                for method in ('newton', 'dfp'))
    assert two.converged
    assert two.residual < 1e-8
    np.testing.assert_allclose(two.positions, one.positions, atol=1e-7)
    assert two.stability == pytest.approx(one.stability, rel=1e-2)


def test_the_simplex_keeps_the_promise(wire, curly):
    for rod in (wire, curly):
        for terms in (2, 5):
            shape = DirectSimulator(rod, n_elements=16, n_terms=terms,
                                    method='downhill_simplex').solve(TILTED)
            assert shape.converged and shape.residual < 1e-8


def test_a_quadratic_surface_through_a_quadratic_is_exact(rng):
    matrix, slope = rng.normal(size=(2, 5, 5))
    matrix, slope, at = matrix + matrix.T, slope[0], rng.normal(size=5)
    gradient, hessian = quadratic_surface(lambda q: 3 + slope @ q + 0.5 * q @ matrix @ q, at, 0.1)
    np.testing.assert_allclose(gradient, slope + matrix @ at, atol=1e-11)
    np.testing.assert_allclose(hessian, matrix, atol=1e-10)


def _quartic(q):
    return float(q[0] ** 4 + (q[0] - 2) ** 2), np.array([4 * q[0] ** 3 + 2 * (q[0] - 2)])


@pytest.mark.parametrize('step', [1e-3, 0.5, 2.0, 50.0])
def test_a_line_search_ends_where_the_slope_does(step):
    start, direction = Point(np.array([-1.0]), *_quartic(np.array([-1.0]))), np.array([step])
    end = hager_zhang_search(_quartic, start, direction, 0.0)
    assert abs(end.gradient @ direction) <= 0.1 * abs(start.gradient @ direction)
    assert end.value < start.value and end[1:] == _quartic(end.q)


def test_a_line_search_goes_by_the_slope_where_values_are_rounded():
    # a value of 1e6 with a gain of 1e-16: no value tells, the slope does
    def rounded(q):
        return 1e6 + 0.5 * float(q @ q), q

    q = np.array([1e-8, 2e-8])
    end = hager_zhang_search(rounded, Point(q, *rounded(q)), -3.0 * q, 0.0)
    assert np.linalg.norm(end.q) < 0.1 * np.linalg.norm(q)
    lies = Point(q, rounded(q)[0], -q)
    assert hager_zhang_search(rounded, lies, q, 0.0) is None


def test_dfp_ends_at_rounding_errors_of_the_gradient():
    # a quadratic on a large constant: values tell the minimum to 1e-5 only
    curvatures = np.geomspace(1, 1e4, 12)
    problem = Objective(lambda q: 1e4 + 0.5 * curvatures @ q**2,
                        lambda q: (1e4 + 0.5 * curvatures @ q**2, curvatures * q), 1.0)
    found = dfp(problem, np.ones(12), 1e-11)
    assert np.linalg.norm(curvatures * found.q) < 1e-11
    assert found.evaluations < 300


def test_the_simplex_needs_a_few_thousand_values_however_stiff():
    # w L^3 / EI = 1200 and rigidities of 12.7 : 1 : 2.3, where an even simplex takes 800,000
    rod = Rod(1.0, 1200 / 9.81, (12.7, 1.0), 2.34)
    shape = DirectSimulator(rod, n_elements=32, n_terms=5, method='downhill_simplex').solve(TILTED)
    assert shape.converged and shape.evaluations < 20_000


@pytest.mark.parametrize('options', [
    {'method': 'dfp'}, {'method': 'dfp', 'basis': 'local', 'n_elements': 16},
    {'method': 'dfp', 'strains': 'paper'},
    {'method': 'downhill_simplex', 'n_elements': 16, 'n_terms': 3}])
@pytest.mark.parametrize('stiffness', [1.0, (1.0, 3.0)])
def test_a_saddle_is_left(stiffness, options):
    # upright and above Greenhill's load, where standing straight is stationary
    rod = Rod(1.0, 20 / 9.81, stiffness, 0.75)
    upright = Pose.looking_along((0, 0, 0), (0, 0, 1))
    shape = DirectSimulator(rod, **options).solve(upright)
    wanted = DirectSimulator(rod, **{**options, 'method': 'newton',
                                     'strains': 'components'}).solve(upright)
    assert shape.converged and shape.stability > -1e-7
    assert shape.energy == pytest.approx(wanted.energy, rel=1e-4)
    assert shape.positions[-1, 2] == pytest.approx(wanted.positions[-1, 2], abs=5e-3)


def test_every_method_of_the_simulator_is_there():
    assert ('newton', *SEARCHES) == METHODS
