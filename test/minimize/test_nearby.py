# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The quick search for a minimum that is near finds what Newton's method finds, or nothing."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.minimize.newton import new_workspace, newton, newton_descent, next_to

LEVEL = Pose((0, 0, 0), (0, 0, 0, 1))
DOWN = Pose.looking_along((0, 0, 0), (0, 0, 1))  # a wire that stands


def nearby(system, q, tolerance, check=True):
    """Return whether what is near is found, and what is."""
    state, residual, stability, steps, *_ = newton_descent(
        system, q, next_to(tolerance, 0.0, check, False), new_workspace(system))
    return residual < np.inf, state, residual, stability, steps


def drawn(rng, gripper=LEVEL, strength=1e3, stiffness=0.05, basis='local', **options):
    """Return a DLO at rest whose nodes are drawn to where they are, and its unknowns there."""
    options = {'n_elements': 24, 'basis': basis} | options
    simulator = DirectSimulator(Rod(1.0, 0.1, stiffness, 0.04), **options)
    shape = simulator.solve(gripper)
    mesh = shape.mesh
    place = shape.positions - gripper.position + 1e-5 * rng.normal(size=shape.positions.shape)
    system = mesh.system(gripper.rotation)._replace(
        anchor=InertiaTerm(place, np.full(mesh.s.size, strength * 0.1 / mesh.s.size)))
    return system, mesh.unknowns(shape.element_strains)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('strength', [0.0, 1e2, 1e4])
def test_it_finds_what_newtons_method_finds(basis, strength, rng):
    system, q = drawn(rng, strength=strength, basis=basis)
    found, state, residual, stability, steps = nearby(system, q, 1e-10)
    true = newton(system, q, 1e-10, 100, True)
    assert found and residual < 1e-9 and steps <= 8
    np.testing.assert_allclose(state.positions, true.state.positions, rtol=0, atol=1e-9)
    if strength:
        assert stability == np.inf and true.stability > 0.01  # proved, not found
    else:  # no step was made, so there was no factorization either
        assert stability == pytest.approx(true.stability, rel=0.02)


def test_it_leaves_alone_what_is_far(rng):
    system, q = drawn(rng)
    assert not nearby(system, q + 0.3, 1e-10)[0]


def test_it_does_not_take_a_saddle_for_a_minimum(rng):
    # straight up, far above the load at which it buckles: an equilibrium, but no minimum
    system, q = drawn(rng, DOWN, strength=0.0, stiffness=0.01)
    assert not nearby(system, np.zeros_like(q), 1e-10)[0]


def test_it_gets_along_with_a_guess_that_is_too_short(rng):
    # inertia pushes along the DLO, with forces at which it would buckle
    system, q = drawn(rng, strength=1e6)
    place = (1 - 1e-3) * system.anchor.place
    system = system._replace(anchor=InertiaTerm(place, system.anchor.weight))
    found, state, _, stability, steps = nearby(system, q, 1e-9)
    true = newton(system, q, 1e-9, 100, True)
    assert found and steps < true.iterations
    np.testing.assert_allclose(state.positions, true.state.positions, rtol=0, atol=1e-9)
    assert stability == np.inf and true.stability > 0.01


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_what_is_proved_to_be_well_stable_is(basis, rng):
    # a wire that stands, a little stiffer than one that buckles, and is moved a little
    proved = found = refused = 0
    for stiffness in np.linspace(0.126, 0.15, 40):
        system, q = drawn(rng, DOWN, strength=1e-3, stiffness=stiffness, basis=basis)
        near, _, _, stability, _ = nearby(system, q + 1e-5, 1e-10)
        true = newton(system, q, 1e-10, 100, True).stability
        if not near:
            refused += 1
            assert true < 0.0101
        elif stability == np.inf:
            proved += 1
            assert true > 0.01
        else:
            found += 1
            assert stability == pytest.approx(true, rel=0.02)
    assert proved and found and refused


def test_it_does_not_look_at_stability_if_not_asked(rng):
    system, q = drawn(rng, strength=1e3)
    found, state, _, stability, _ = nearby(system, q, 1e-10, False)
    assert found and np.isnan(stability)
    np.testing.assert_array_equal(state.q, nearby(system, q, 1e-10)[1].q)
