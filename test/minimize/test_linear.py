import numpy as np
import pytest

from dlo_planner.direct.discretisation import Discretisation
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.potential import evaluate, new_state
from dlo_planner.minimize.linear import assemble, factorise, multiply, new_hessian, solve
from dlo_planner.minimize.spectrum import lowest_mode


@pytest.fixture(params=['local', 'chebyshev', 'local, anchored', 'chebyshev, anchored'])
def problem(request, curly, rng):
    basis, *anchored = request.param.split(', ')
    s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 14))])
    around = Surroundings(curly, np.array([0.0, 3.0, -9.81]))
    discretisation = Discretisation(around, s * 1.3 / s[-1], basis, 6)
    system = discretisation.system(np.eye(3))
    if anchored:
        system = system._replace(anchor=rng.normal(size=(15, 3)),
                                 anchor_weight=rng.uniform(0, 3, size=15))
    state = new_state(system)
    state.q[:] = rng.normal(size=state.q.shape)
    evaluate(system, state)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    size = state.q.size
    dense = np.empty((size, size))
    for column in range(size):
        out = np.empty_like(state.q)
        multiply(system, hessian, np.eye(size)[column].reshape(out.shape), out)
        dense[:, column] = out.ravel()
    return system, hessian, dense


@pytest.mark.parametrize('shift', [0.0, 0.7, 30.0])
def test_solution_and_inertia_are_those_of_the_dense_matrix(problem, shift, rng):
    system, hessian, dense = problem
    dense = dense + shift * np.eye(len(dense))
    np.testing.assert_allclose(dense, dense.T, atol=1e-12)
    assert factorise(system, hessian, shift) == np.sum(np.linalg.eigvalsh(dense) < 0)
    right = rng.normal(size=(len(dense) // 3, 3))
    out = np.empty_like(right)
    solve(system, hessian, right, out)
    np.testing.assert_allclose(out.ravel(), np.linalg.solve(dense, right.ravel()), atol=1e-9)


def test_lowest_mode_is_the_dense_one(problem):
    system, hessian, dense = problem
    values, vectors = np.linalg.eigh(dense)
    shift = max(0.0, 0.1 - values[0])
    assert factorise(system, hessian, shift) == 0
    value, mode = lowest_mode(system, hessian, shift, 1e-8)
    assert value == pytest.approx(values[0], abs=1e-6)
    if values[0] < 0:  # a mode is only found where it is needed
        assert abs(mode.ravel() @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-4)
