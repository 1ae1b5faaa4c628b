# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Equilibrium and alignment at once: what is asked holds, and Newton's method is quadratic."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.inverse.solvers.hanging.marching import integrate_from_tip
from dlo_planner.inverse.solvers.hanging.start_candidates import is_axisymmetric, least_turn
from dlo_planner.inverse.solvers.points.aligned import aligned_newton, free_axis

ROD = Rod(1.0, 0.1, (0.5, 1.0), 0.4, natural_curvature=(0.6, -0.3), natural_twist=0.5,
          tip_mass=0.02)
NORMAL = np.array([0.8, 0.36, -0.48])


def system_of(basis, rotation=None):
    direct = DirectSimulator(ROD, basis=basis, n_elements=12, n_terms=None if basis == 'local'
                             else 6)
    rotation = np.eye(3) if rotation is None else rotation
    return direct, direct.mesh.system(rotation)


def upright(direction):
    return np.array(Pose.looking_along((0, 0, 0), direction).rotation)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize(('element', 'fraction'), [(11, 1.0), (7, 0.3), (0, 0.5)])
def test_the_tangent_is_the_normal_and_the_gripper_has_not_rolled(basis, element, fraction):
    reference = upright(NORMAL)
    direct, system = system_of(basis, reference)
    axis = free_axis(reference, NORMAL)
    start = np.zeros_like(new_configuration(system).q)
    state, base, residual, misaligned, stability, iterations, converged = aligned_newton(
        system, start, element, fraction, NORMAL, reference, axis, 1e-11, 50)
    assert converged and residual < 1e-11 and misaligned < 1e-11
    assert iterations < 9  # from a straight DLO
    turned = Rotation.from_matrix(base @ reference.T).as_rotvec()
    assert axis @ turned == pytest.approx(0, abs=1e-10)
    assert np.linalg.norm(turned) > 0.01  # but about other axes it has
    shape = direct.solve(Pose.from_rotation((0, 0, 0), base))
    np.testing.assert_allclose(shape.at((element + fraction) / 12).direction, NORMAL, atol=1e-9)
    assert stability == pytest.approx(shape.stability, rel=1e-3)
    np.testing.assert_array_equal(start, 0)
    np.testing.assert_array_equal(system.base, reference)  # what it is given it leaves alone
    # a little beside it, each step squares the error: slopes are right
    beside = state.q + 1e-4
    again = aligned_newton(system._replace(base=base), beside, element, fraction, NORMAL,
                           reference, axis, 1e-11, 50)
    assert again[-1] and again[-2] <= 2
    np.testing.assert_allclose(again[1], base, atol=1e-9)


def test_neither_half_alone_is_convergence():
    reference = upright(NORMAL)
    direct, system = system_of('local', reference)

    def found(q, base, normal):
        return aligned_newton(system._replace(base=base), q, 7, 0.3, normal, reference,
                              free_axis(reference, normal), 1e-10, 50)

    def holds(answer):
        state, base, residual, misaligned, _, iterations, converged = answer
        tangent = direct.solve(Pose.from_rotation((0, 0, 0), base)).at(7.3 / 12).direction
        return (converged and iterations > 0 and residual < 1e-10 and misaligned < 1e-10
                and tangent @ NORMAL > 1 - 1e-9)

    still = direct.solve(Pose.from_rotation((0, 0, 0), reference))
    q = direct.mesh.unknowns(still.element_strains)
    assert holds(found(q, reference, NORMAL))              # in equilibrium, not aligned
    relaxed = new_configuration(system)
    evaluate(system, relaxed)
    natural = DirectSimulator(ROD, basis='local', n_elements=12, gravity=(0, 0, 0)).solve(
        Pose.from_rotation((0, 0, 0), reference)).at(7.3 / 12).direction
    base = np.ascontiguousarray(least_turn(natural, NORMAL) @ reference)
    assert holds(found(relaxed.q, base, NORMAL))           # aligned, not in equilibrium
    opposite = -still.at(7.3 / 12).direction               # the opposite is not aligned
    _, base, *_, converged = found(q, reference, opposite)
    there = direct.solve(Pose.from_rotation((0, 0, 0), base)).at(7.3 / 12).direction
    assert not converged or there @ opposite > 1 - 1e-9


@pytest.mark.parametrize('roll', [0.3, -0.8])
def test_a_gripper_that_has_rolled_is_rolled_back(roll):
    reference = upright(NORMAL)
    axis = free_axis(reference, NORMAL)
    _, system = system_of('local', np.ascontiguousarray(
        Rotation.from_rotvec(roll * axis).as_matrix() @ reference))
    q = np.zeros_like(new_configuration(system).q)
    _, base, *_, converged = aligned_newton(system, q, 11, 1.0, NORMAL, reference, axis, 1e-11, 50)
    assert converged
    assert axis @ Rotation.from_matrix(base @ reference.T).as_rotvec() == pytest.approx(0, abs=1e-9)


def test_no_more_steps_than_allowed():
    reference = upright(NORMAL)
    _, system = system_of('local', reference)
    q = np.zeros_like(new_configuration(system).q)
    *_, iterations, converged = aligned_newton(system, q, 11, 1.0, NORMAL, reference,
                                               free_axis(reference, NORMAL), 1e-11, 1)
    assert iterations == 1 and not converged


def test_the_free_axis_lies_between_gripper_and_normal():
    rotation = upright((1, 0.2, 0.1))
    axis = free_axis(rotation, NORMAL)
    assert np.linalg.norm(axis) == pytest.approx(1)
    assert axis @ rotation[:, 0] == pytest.approx(axis @ NORMAL)
    opposite = free_axis(rotation, -rotation[:, 0])  # no mean: its own axis
    np.testing.assert_array_equal(opposite, rotation[:, 0])
    assert not np.shares_memory(opposite, rotation) and opposite.flags.c_contiguous


def test_the_march_from_the_end_is_an_equilibrium(rng):
    end = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    _, system = system_of('local')
    strains, base = integrate_from_tip(system, np.ascontiguousarray(end))
    turned = system._replace(base=base)
    state = new_configuration(turned)
    state.q[:] = (strains - turned.natural) / turned.scale
    evaluate(turned, state)
    np.testing.assert_allclose(state.gradient, 0, atol=1e-13)
    np.testing.assert_allclose(state.rotations[-1], end, atol=1e-13)


def test_the_least_turn_is_about_the_axis_across(rng):
    for _ in range(20):
        one, other = rng.normal(size=(2, 3))
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        turn = least_turn(one, other)
        np.testing.assert_allclose(turn @ one, other, atol=1e-12)
        angle = Rotation.from_matrix(turn).magnitude()
        assert angle == pytest.approx(np.arccos(np.clip(one @ other, -1, 1)))
        np.testing.assert_allclose(least_turn(one, one), np.eye(3), atol=1e-15)
        np.testing.assert_allclose(least_turn(one, -one) @ one, -one, atol=1e-12)


@pytest.mark.parametrize(('more', 'alike'), [
    ({}, True), ({'natural_curvature': (0.3, 0.0)}, False), ({'natural_twist': 0.5}, False),
    ({'natural_curvature': lambda s: (0.0, max(0.0, s - 0.9))}, False),
    ({'bending_stiffness': (0.5, 0.6)}, False), ({'tip_mass': 0.1}, True)])
def test_rolls_are_alike_where_the_dlo_is_straight_and_round(more, alike):
    rod = Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 0.5,
                 'torsional_stiffness': 0.4, **more})
    assert is_axisymmetric(rod) == alike
