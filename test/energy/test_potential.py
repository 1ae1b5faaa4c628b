import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretisation import Discretisation
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import evaluate, new_state
from dlo_planner.minimize.linear import assemble, multiply, new_hessian

GRAVITY = np.array([1.0, -2.0, -9.0])
BASE = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()


def at(system, q):
    state = new_state(system)
    state.q[:] = q
    energy, _ = evaluate(system, state)
    return energy, state


@pytest.fixture(params=['local', 'chebyshev', 'fourier', 'local, anchored',
                        'chebyshev, anchored'])
def system(request, curly, rng):
    s = np.array([0, 0.02, 0.1, 0.2, 0.4, 0.5, 0.8, 1.0, 1.1, 1.3])
    basis, *anchored = request.param.split(', ')
    system = Discretisation(curly, s, basis, 5, GRAVITY).system(BASE)
    if anchored:
        system = system._replace(anchor=rng.normal(size=(10, 3)),
                                 anchor_weight=rng.uniform(0, 3, size=10))
    return system


def test_gradient_against_differences(system, rng):
    q = rng.normal(size=new_state(system).q.shape)
    _, state = at(system, q)
    step = 1e-6
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = step
        slope = (at(system, q + change)[0] - at(system, q - change)[0]) / (2 * step)
        assert state.gradient[index] == pytest.approx(slope, abs=1e-8)


def test_hessian_against_differences(system, rng):
    q = rng.normal(size=new_state(system).q.shape)
    _, state = at(system, q)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    step = 1e-6
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = 1.0
        column = np.empty_like(q)
        multiply(system, hessian, change, column)
        up, down = (at(system, q + sign * step * change)[1].gradient for sign in (1, -1))
        np.testing.assert_allclose(column, (up - down) / (2 * step), atol=1e-8)


def test_base_moment_and_its_derivative_against_differences(system, rng):
    q = rng.normal(size=new_state(system).q.shape)
    _, state = at(system, q)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    step = 1e-6
    for axis in range(3):
        turned = []
        for sign in (1, -1):
            turn = Rotation.from_rotvec(sign * step * np.eye(3)[axis]).as_matrix()
            turned.append(at(system._replace(base=turn @ BASE), q))
        slope = (turned[0][0] - turned[1][0]) / (2 * step)
        assert state.base_moment[axis] == pytest.approx(slope, abs=1e-7)
        if system.anchor_weight.size:
            continue  # the rate is that of dead loads only
        rate = (turned[0][1].base_moment - turned[1][1].base_moment) / (2 * step)
        np.testing.assert_allclose(hessian.base[:, axis], rate, atol=1e-7)


def test_elastic_energy_is_half_the_square_of_the_unknowns(curly, rng):
    system = Discretisation(curly, np.linspace(0, 1.3, 9), 'chebyshev', 4,
                            np.zeros(3)).system(np.eye(3))
    q = rng.normal(size=(4, 3))
    energy, state = at(system, q)
    assert energy == pytest.approx(0.5 * np.sum(q**2))
    np.testing.assert_allclose(state.gradient, q, atol=1e-12)


def test_masses_keep_total_and_first_moment(curly):
    s = np.linspace(0, 1.3, 8)
    masses = node_masses(curly, s)
    assert masses.sum() == pytest.approx(0.2 * 1.3 + 0.1 + 0.2)
    assert masses @ s == pytest.approx(0.2 * 1.3**2 / 2 + 0.1 * 1.3 + 0.2 * 0.65)
