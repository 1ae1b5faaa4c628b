"""The paper's minimisers: against a function with a known minimum, and against Newton's."""

import numpy as np
import pytest
from scipy.optimize import rosen, rosen_der

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.minimize.dfp import dfp
from dlo_planner.minimize.downhill_simplex import downhill_simplex
from dlo_planner.minimize.newton import newton
from dlo_planner.minimize.protocol import Problem

ROSENBROCK = Problem(rosen, lambda q: (rosen(q), rosen_der(q)), 1.0)
TILTED = Pose((0, 0, 1), (0.1, -0.2, 0.05, 0.97))


def test_dfp_finds_rosenbrocks_minimum():
    found = dfp(ROSENBROCK, np.array([-1.2, 1.0, 0.5]), 1e-10)
    np.testing.assert_allclose(found.q, 1.0, atol=1e-8)
    assert 10 < found.iterations <= found.evaluations < 1000


def test_dfp_learns_the_inverse_hessian_of_a_quadratic(rng):
    # in n dimensions n exact line searches do; with inexact ones a few more
    root = rng.normal(size=(6, 6))
    matrix = np.eye(6) + 0.3 * root @ root.T
    centre = rng.normal(size=6)
    problem = Problem(lambda q: 0.5 * (q - centre) @ matrix @ (q - centre),
                      lambda q: (0.5 * (q - centre) @ matrix @ (q - centre),
                                 matrix @ (q - centre)), 1.0)
    found = dfp(problem, np.zeros(6), 1e-12)
    np.testing.assert_allclose(found.q, centre, atol=1e-10)
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


def test_downhill_simplex_agrees_with_newton(wire):
    one, two = (DirectSimulator(wire, n_elements=16, n_terms=3, method=method).solve(TILTED)
                for method in ('newton', 'downhill_simplex'))
    np.testing.assert_allclose(two.positions, one.positions, atol=1e-5)
    assert two.iterations > 10 * one.iterations


def test_a_saddle_is_not_called_a_shape():

    rod = Rod(1.0, 20 / 9.81, 1.0, 0.75)
    shape = DirectSimulator(rod, method='dfp').solve(Pose.looking_along((0, 0, 0), (0, 0, 1)))
    assert shape.stability < 0
    assert not shape.converged


def test_every_newton_step_lowers_the_energy(wire_with_load):
    discretisation = DirectSimulator(wire_with_load)._discretisation
    system = discretisation.system(TILTED.rotation)
    start = np.zeros((discretisation.n_unknowns, 3))
    energies = []
    for steps in range(12):
        state, _, _, iterations, _ = newton(system, start, 1e-10, steps, False)
        if iterations < steps:
            break
        energies.append(0.5 * np.sum(state.q**2) + np.sum(system.pull * state.positions))
    assert len(energies) > 6  # far from straight forward
    assert (np.diff(energies) < 1e-15).all()
