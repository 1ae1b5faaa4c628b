# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The decrement is the residual where nothing moves, and blind to rounding where inertia rules."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.potential import configuration_at, evaluate, unknowns_of
from dlo_planner.energy.problem import new_configuration
from dlo_planner.minimize.convergence import (
    SETTLED,
    Minimum,
    accept_by_decrement,
    decrement_of,
    residual_of,
)
from dlo_planner.minimize.newton import minimize, new_workspace, newton, thorough

N, LEVEL = 24, Pose.identity()


def drawn_newton(system, q, tolerance, most, check):
    """Return what is found where forces of inertia are left out that are in the way."""
    return minimize(system, q.copy(), thorough(tolerance, 0.0, most, check, True),
                    new_workspace(system))


def state_at(system, q):
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    return state


def drawn(per_second, length=1.0, apart=0.0):
    """Return the Problem of a rod that springs as stiff as a short step's draw to a bow.

    `apart` (of the length) is how far the bow's nodes are off, to and fro along it.
    """
    rod = Rod(length, 0.05, 5e-4 * length**3, 4e-4 * length**3)
    mesh = DirectSimulator(rod, basis='local', n_elements=N).solve(LEVEL).mesh
    static = mesh.system(LEVEL.rotation, LEVEL.position)
    s = np.linspace(0, 1, N)
    strains = np.column_stack([0.3 * s, 1.0 + s, np.cos(3 * s)]) / length
    bow = configuration_at(static, strains).positions.copy()
    bow[1:, 0] += apart * length * (-1.0) ** np.arange(N)
    weight = rod.node_masses(mesh.s) * per_second**2 * 9.81 / length
    return static._replace(anchor=InertiaTerm(bow, weight)), strains


def test_it_is_the_residual_of_a_dlo_without_forces(rng):
    rod = Rod(1.0, 0.05, 5e-4, 4e-4)
    mesh = DirectSimulator(rod, basis='local', n_elements=N, gravity=(0, 0, 0)).solve(LEVEL).mesh
    system = mesh.system(LEVEL.rotation, LEVEL.position)
    state = state_at(system, 0.01 * rng.standard_normal((N, 3)))
    assert decrement_of(system, state) == pytest.approx(residual_of(system, state), rel=1e-9)


@pytest.mark.parametrize('length', [1e-3, 1.0, 1e3])
def test_rounding_is_no_distance_and_a_distance_is_one(length, rng):
    system, strains = drawn(1e5, length)
    q = np.empty((N, 3))
    unknowns_of(system, strains, q)
    state = drawn_newton(system, q, 1e-10, 60, False)[0]
    # the forces of rounding errors look large: what is left to go does not
    found = Minimum(state, residual_of(system, state), 1.0, 1, 0, system)
    assert found.residual > 1e-6
    assert accept_by_decrement(found).residual < SETTLED
    # what is wrong by little is not let through
    size = np.linalg.norm(state.q)
    for part in (1e-6, 1e-4):
        off = state_at(system, state.q + part * size * rng.standard_normal((N, 3)))
        wrong = Minimum(off, residual_of(system, off), 1.0, 1, 0, system)
        assert accept_by_decrement(wrong) is wrong
        assert decrement_of(system, off) > part


@pytest.mark.parametrize('apart', [0.0, 1e-4])
@pytest.mark.parametrize('per_second', [300.0, 1e3])
def test_what_inertia_draws_to_a_place_is_found_in_few_steps(per_second, apart):
    system, strains = drawn(per_second, apart=apart)
    q = np.empty((N, 3))
    # from elsewhere by a few degrees, wound by more
    unknowns_of(system, 0.9 * strains + np.array([0.8, 0.0, 0.0]), q)
    state, residual, stability, steps, kicks, _ = drawn_newton(system, q, 1e-10, 60, True)
    assert kicks == 0
    assert residual < 1e-9
    assert stability > 0.01
    slow = newton(system, q, 1e-10, 1000, True)
    np.testing.assert_allclose(state.positions, slow.state.positions, rtol=0, atol=1e-9)
    assert steps < 0.7 * slow.iterations
