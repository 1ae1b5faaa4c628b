# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Newton's method where it is easy to be wrong: saddles, kicks, counts, and the lowest mode."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.minimize.convergence import residual_of
from dlo_planner.minimize.hessian import factorize, new_hessian
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import KICK_TURN, descend, leave_saddle, newton

UP = Pose.looking_along((0, 0, 0), (0, 0, 1))
HEAVY = Rod(1.0, 20 / 9.81, (1.0, 3.0), 0.75)  # falls over about n first


def beside_saddle(system, state, mode):
    """Return unknowns on the lower side of a saddle, None if no side is lower."""
    q = np.empty_like(mode)
    return q if leave_saddle(system, state, mode, q) else None


def system_of(rod, gripper, basis, n_elements=24, **more):
    direct = DirectSimulator(rod, basis=basis, n_elements=n_elements, **more)
    return direct.mesh.system(gripper.rotation)


def start_of(system):
    return np.zeros_like(new_configuration(system).q)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_a_saddle_is_found_named_and_left(basis):
    system = system_of(HEAVY, UP, basis)
    q = start_of(system)
    state, residual, stability, iterations, mode, *_ = descend(system, q, 1e-10, 100, True)
    assert iterations == 0 and residual < 1e-12 and stability < -0.5  # upright is a saddle
    assert np.linalg.norm(mode) == pytest.approx(1)
    np.testing.assert_allclose(mode[:, [0, 2]], 0, atol=1e-6)  # about n, the soft way
    found = newton(system, q, 1e-10, 100, True)
    assert found.kicks == 1 and found.residual < 1e-9 and found.stability > 0.05
    assert found.state.positions[-1, 2] < 0  # it has fallen over
    np.testing.assert_array_equal(q, 0)  # the start is left alone
    found = newton(system, q, 1e-10, 100, False)
    assert found.kicks == 0 and np.isnan(found.stability)  # nobody asked


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_a_kick_goes_down_and_no_farther_than_it_should(basis):
    system = system_of(HEAVY, UP, basis)
    found = descend(system, start_of(system), 1e-10, 100, True)
    state, mode = found.state, found.mode
    assert mode[0, 1] > 0  # the side that is stated: positive curvature
    for sign in (1, -1):  # both sides are as low: it goes where the mode points
        there = new_configuration(system)
        there.q[:] = beside_saddle(system, state, sign * mode)
        energy = evaluate(system, there)[0]
        assert energy < evaluate(system, state)[0] - 1e-3
        turn = np.arccos(np.clip(there.rotations[-1, 2, 0], -1, 1))
        assert turn == pytest.approx(KICK_TURN, rel=0.02)
        assert np.vdot(there.q - state.q, sign * mode) > 0


def test_a_kick_takes_the_lower_side():
    # gravity a little aside: one side is lower, whichever way the mode points
    for aside in (0.3, -0.3):
        system = system_of(HEAVY, UP, 'local', gravity=(aside, 0, -9.81))
        upright = new_configuration(system)
        evaluate(system, upright)
        mode = descend(system_of(HEAVY, UP, 'local'), start_of(system), 1e-10, 0, True).mode
        there = new_configuration(system)
        for sign in (1, -1):
            there.q[:] = beside_saddle(system, upright, sign * mode)
            evaluate(system, there)
            assert np.sign(there.positions[-1, 0]) == np.sign(aside)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_residual_is_relative_to_the_energy_and_a_bend(basis):
    # at rest on a straight rod only the 1 rad bend of the softer axis is left to compare with
    system = system_of(HEAVY, Pose.identity(), basis)
    state = new_configuration(system)
    evaluate(system, state)
    size = np.linalg.norm(state.gradient)
    assert residual_of(system, state) == pytest.approx(size)  # EI_n / L = 1 N m
    state.q[0, 0] = 3.0
    evaluate(system, state)
    wanted = np.linalg.norm(state.gradient) / np.sqrt(9.0 + 1.0)
    assert residual_of(system, state) == pytest.approx(wanted)
    stiff_about_n = system_of(Rod(1.0, 20 / 9.81, (3.0, 1.0), 0.75), Pose.identity(), basis)
    other = new_configuration(stiff_about_n)
    evaluate(stiff_about_n, other)
    assert residual_of(stiff_about_n, other) == pytest.approx(np.linalg.norm(other.gradient))


def test_a_mode_that_a_smooth_start_does_not_see_is_found():
    system = system_of(HEAVY, UP, 'chebyshev')
    hessian = new_hessian(system)
    size = start_of(system).size
    hidden = np.zeros(size)
    hidden[1], hidden[2] = 1.0, -1.0  # of the first term; a smooth start has both alike
    hidden /= np.sqrt(2)
    for value in (0.3, -0.3):
        hessian.dense[:] = np.eye(size) + (value - 1) * np.outer(hidden, hidden)
        shift = 0.0 if value > 0 else 0.5
        assert factorize(system, hessian, shift) == 0
        lowest, mode = lowest_mode(system, hessian, shift, 1e-8)
        assert lowest == pytest.approx(value, abs=1e-6)
        if value < 0:
            assert abs(mode.ravel() @ hidden) == pytest.approx(1, abs=1e-6)
