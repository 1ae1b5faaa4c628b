# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The error to leading order, beside much finer meshes and SciPy's solution of the equations."""

import numpy as np
import pytest
from references.kirchhoff import true_rod

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.direct.accuracy import discretization_errors, resampled_means
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.equilibrium import equilibrium
from dlo_planner.geometry.basis import equidistribute

PLAIN = Rod(1.0, 1.0, 1.0, 0.7)
TWISTED = Rod(1.0, 2.0, (1.0, 2.5), 0.5, natural_curvature=(1.0, -2.0), natural_twist=1.5)
WEIGHTED = Rod(1.0, 0.5, (1.0, 0.6), 0.3, natural_curvature=(0.5, 1.0), tip_mass=0.7)
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
TILTED = Pose((0.2, 0, 1), (0.1, -0.3, 0.2, 0.9))


def foreseen(simulator, shape, load=(0.0, 0.0, 0.0)):
    """Return what `discretization_errors` does of a Shape."""
    spread = -simulator.rod.mass_per_length * simulator.gravity - np.array(load)
    return discretization_errors(simulator.mesh.static, shape.gripper.rotation,
                                 shape.element_strains, spread)


@pytest.mark.parametrize('rod', [PLAIN, TWISTED, WEIGHTED])
@pytest.mark.parametrize('gripper', [LEVEL, TILTED])
@pytest.mark.parametrize('load', [(0.0, 0.0, 0.0), (3.0, -5.0, 2.0)])
def test_it_is_that_of_much_finer_meshes(rod, gripper, load):
    n, finer = 64, 16
    simulator = DirectSimulator(rod, basis='local', n_elements=n, load=load)
    shape = simulator.solve(gripper)
    error, off, *_ = foreseen(simulator, shape, load)
    fine = DirectSimulator(rod, basis='local', n_elements=finer * n, load=load).solve(gripper,
                                                                                      shape)
    true = np.linalg.norm(shape.positions - fine.positions[::finer], axis=1).max()
    assert error == pytest.approx(true, rel=0.02)
    means = fine.element_strains.reshape(n, finer, 3).mean(axis=1)
    size = np.abs(shape.element_strains - means).max()
    np.testing.assert_allclose(off, shape.element_strains - means, rtol=0, atol=0.06 * size)


@pytest.mark.parametrize('rod', [PLAIN, TWISTED])
def test_it_is_that_of_kirchhoffs_equations(rod):
    simulator = DirectSimulator(rod, basis='local', n_elements=64)
    shape = simulator.solve(TILTED)
    true = np.linalg.norm(shape.positions - true_rod(rod, TILTED, shape), axis=1).max()
    assert foreseen(simulator, shape)[0] == pytest.approx(true, rel=0.02)


@pytest.mark.parametrize('rod', [PLAIN, TWISTED, WEIGHTED])
def test_it_tells_of_a_graded_mesh_before_that_is_made(rod):
    simulator = DirectSimulator(rod, basis='local', n_elements=48)
    shape = simulator.solve(TILTED)
    _, off, shares, one, there = foreseen(simulator, shape)
    n = 200
    s = np.interp(np.linspace(0, 1, n + 1), shares, shape.s)
    s[-1] = rod.length
    mesh = Discretization(simulator.surroundings, s, 'local', 0)
    start = resampled_means(shape.s, shape.element_strains - off + there / n**2, s)
    graded = equilibrium(mesh, TILTED, start)
    assert graded.iterations <= 2
    assert one / n**2 == pytest.approx(graded.error_estimate, rel=0.05)
    before = np.abs(graded.element_strains - mesh.strains_from(shape.s, shape.element_strains))
    assert np.abs(graded.element_strains - start).max() < 0.02 * before.max()


def test_a_saddle_has_none():
    # it stands upright, far above the load at which it buckles
    simulator = DirectSimulator(Rod(1.0, 5.0, 0.5, 0.4), basis='local', n_elements=16)
    up, straight = Pose.looking_along((0, 0, 0), (0, 0, 1)), np.zeros((16, 3))
    straight.flags.writeable = False
    assert discretization_errors(simulator.mesh.static, up.rotation, straight,
                   np.array([0, 0, 5 * 9.81]))[0] == np.inf


@pytest.mark.parametrize('count', [1, 3, 5, 24])
def test_means_of_polynomials_are_exact(count, rng):
    s, nodes = (np.sort(np.append(rng.uniform(0.01, 1.99, n), [0.0, 2.0])) for n in (count, 60))
    wave = np.polynomial.Polynomial(rng.normal(size=min(5, count)))

    def means(mesh):
        one = np.diff(wave.integ()(mesh)) / np.diff(mesh)
        return np.column_stack([one, -one, 2 * one])

    np.testing.assert_allclose(resampled_means(s, means(s), nodes), means(nodes), rtol=0,
                               atol=1e-7)


def test_a_mesh_that_shares_out_the_error_has_no_grading_left(rng):
    s = np.linspace(0, 1, 401)
    middle = 0.5 * (s[1:] + s[:-1])

    def strains(s):
        return np.column_stack([0 * s, np.tanh(20 * (s - 0.3)), 0.2 * s])

    shares = equidistribute(np.diff(s), strains(middle))
    assert shares[0] == 0.0 and shares[-1] == 1.0 and (np.diff(shares) > 0).all()
    rate = np.hypot(20 / np.cosh(20 * (middle - 0.3)) ** 2, 0.2)
    density = np.cbrt(rate) / np.mean(np.cbrt(rate)) + 0.5
    np.testing.assert_allclose(np.diff(shares), density / density.sum(), rtol=2e-2)
    assert (equidistribute(np.diff(s), np.ones((400, 3))) == pytest.approx(s, abs=1e-12))
