# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from references.blocks import dense as matrix_of
from scipy.spatial.transform import Rotation

from dlo_planner import FarEnd, Rod
from dlo_planner.direct.discretization import Discretization
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.energy.terms import KKTBorder
from dlo_planner.minimize.dense import lu_factor, lu_solve
from dlo_planner.minimize.hessian import (
    assemble,
    assembled_definite,
    compliance,
    factorize,
    factorize_with,
    is_definite,
    largest_turn,
    new_hessian,
    solve,
    solve_held,
)
from dlo_planner.minimize.kkt import complemented
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import newton
from dlo_planner.minimize.riccati import no_springs
from dlo_planner.model.supports import Surroundings


@pytest.fixture(params=['local', 'chebyshev', 'local, anchored', 'chebyshev, anchored'])
def problem(request, curly, rng):
    basis, *anchored = request.param.split(', ')
    s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 14))])
    around = Surroundings(curly, np.array([0.0, 3.0, -9.81]))
    discretization = Discretization(around, s * 1.3 / s[-1], basis, 6)
    system = discretization.system(np.eye(3))
    if anchored:
        system = system._replace(anchor=InertiaTerm(rng.normal(size=(15, 3)),
                                                    rng.uniform(0, 3, size=15)))
    state = new_configuration(system)
    state.q[:] = rng.normal(size=state.q.shape)
    evaluate(system, state)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    dense = matrix_of(system, hessian)
    return system, hessian, dense


@pytest.mark.every(4)
@pytest.mark.parametrize('shift', [0.0, 0.7, 30.0])
def test_solution_and_inertia_are_those_of_the_dense_matrix(problem, shift, rng):
    system, hessian, dense = problem
    dense = dense + shift * np.eye(len(dense))
    np.testing.assert_allclose(dense, dense.T, atol=1e-12)
    assert factorize(system, hessian, shift) == np.sum(np.linalg.eigvalsh(dense) < 0)
    right = rng.normal(size=(len(dense) // 3, 3))
    out = np.empty_like(right)
    solve(system, hessian, right, out)
    np.testing.assert_allclose(out.ravel(), np.linalg.solve(dense, right.ravel()), atol=1e-9)


@pytest.mark.parametrize('shift', [0.0, 30.0])
def test_springs_join_a_hessian_that_is_assembled(problem, shift, rng):
    """Against the sum of all their second derivatives, written out as matrices."""
    system, hessian, dense = problem
    if hessian.cross.shape[2] == 3:
        pytest.skip('displacements do not matter')
    n = system.lengths.size
    springs, whole = no_springs(n), np.zeros((3 * n, 3 * n))
    twist = np.zeros((6, 3 * n))  # of the node that an element begins at, by all unknowns
    for e in range(n + 1):
        if e % 3 == 1:
            root = rng.normal(size=(6, 6))
            springs.acts[e], springs.twist[e] = True, root @ root.T
            whole += twist.T @ springs.twist[e] @ twist
        if e == n:
            break
        own = np.zeros((3, 3 * n))
        own[:, 3 * e:3 * e + 3] = np.eye(3)
        if e % 4 == 2:
            root = rng.normal(size=(3, 3))
            springs.inside[e], springs.own[e] = True, root @ root.T
            springs.cross[e] = rng.normal(size=(3, 6))
            across = own.T @ springs.cross[e] @ twist
            whole += own.T @ springs.own[e] @ own + across + across.T
        twist = twist + hessian.twist_jacobian[e] @ own
    if system.basis.shape[1]:
        values = np.zeros((n, 3, system.basis.shape[2], 3))
        for i in range(3):
            values[:, i, :, i] = system.basis[i]
        values = values.reshape(3 * n, -1)
        whole = values.T @ whole @ values
    whole += dense + shift * np.eye(len(dense))
    for _ in range(2):  # what is assembled is kept
        below = factorize_with(system, hessian, springs, shift)
        assert below == np.sum(np.linalg.eigvalsh(whole) < 0)
        right = rng.normal(size=(len(dense) // 3, 3))
        out = np.empty_like(right)
        solve(system, hessian, right, out)
        np.testing.assert_allclose(out.ravel(), np.linalg.solve(whole, right.ravel()), rtol=1e-7,
                                   atol=1e-9)


@pytest.mark.parametrize('held', [False, True])
def test_compliance_is_what_solutions_give(problem, held, rng):
    system, hessian, _ = problem
    if held:
        mesh = Discretization(Surroundings(Rod(1.0, 0.0, 1.0, 1.0), np.zeros(3)),
                              np.linspace(0, 1, 15), 'chebyshev' if system.basis.size else 'local',
                              6)
        system = mesh.system(np.eye(3), np.zeros(3), None, (FarEnd.of((0.7, 0.2, 0.1)),))
        state = new_configuration(system)
        evaluate(system, state)
        hessian = new_hessian(system)
        assemble(system, state, hessian)
    factorize(system, hessian, 0.0)
    loads = rng.normal(size=(*new_configuration(system).q.shape, 5))
    found, out = compliance(system, hessian, loads), np.empty(loads.shape[:2])
    for k in range(5):
        solve(system, hessian, loads[:, :, k].copy(), out)
        np.testing.assert_allclose(found[:, k], np.tensordot(loads, out, ((0, 1), (0, 1))),
                                   rtol=1e-8, atol=1e-8 * np.abs(found).max())


@pytest.mark.every(3)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('gravity', [(0.0, 0.0, -9.81), (2.0, -3.0, -9.0), (0.0, 0.0, 0.0)])
def test_one_sweep_finds_what_assembling_and_factorizing_do(basis, gravity, curly, rng):
    mesh = Discretization(Surroundings(curly, np.array(gravity)),
                          np.sort(np.append([0.0, 1.3], rng.uniform(0.1, 1.2, 12))), basis, 6)
    system = mesh.system(Rotation.from_rotvec(rng.normal(size=3)).as_matrix())
    for size in (0.03, 0.3, 1.0):
        state = new_configuration(system)
        state.q[:] = size * rng.normal(size=state.q.shape)
        evaluate(system, state)
        at_once, apart = new_hessian(system), new_hessian(system)
        assemble(system, state, apart)
        dense = matrix_of(system, apart)
        lowest = np.linalg.eigvalsh(dense)[0]
        for shift in (max(0.0, 0.1 - lowest), 0.5 - lowest, -0.1 - lowest):
            definite = lowest + shift > 0
            at_once.gain[:] = np.nan  # as memory may be that is not filled
            assert assembled_definite(system, state, at_once, shift) == definite
            assert is_definite(system, apart, shift) == definite
            if definite:
                right, out = rng.normal(size=state.q.shape), np.empty_like(state.q)
                solve(system, at_once, right, out)
                np.testing.assert_allclose(
                    (dense + shift * np.eye(len(dense))) @ out.ravel(), right.ravel(), atol=1e-9)
                # what follows from a turn of the gripper is read off the gains
                np.testing.assert_allclose(at_once.gain, apart.gain, atol=1e-9)
            else:  # it is filled, for other shifts
                assert is_definite(system, at_once, 0.1 - lowest)


def test_lowest_mode_is_the_dense_one(problem):
    system, hessian, dense = problem
    values, vectors = np.linalg.eigh(dense)
    shift = max(0.0, 0.1 - values[0])
    assert factorize(system, hessian, shift) == 0
    value, mode = lowest_mode(system, hessian, shift, 1e-8)
    assert value == pytest.approx(values[0], abs=1e-6)
    if values[0] < 0:  # a mode is only found where it is needed
        assert abs(mode.ravel() @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-4)


def test_the_search_for_the_lowest_mode_does_not_end_where_it_only_rests():
    # bent in a plane under its weight: the lowest mode leaves it, and the search finds it late
    around = Surroundings(Rod(1.0, 0.0145, (1e-3, 2.546e-3), 8.964e-4), np.array([0, 0, -9.81]))
    mesh = Discretization(around, np.linspace(0, 1, 3), 'local', 0)
    system = mesh.system(np.eye(3))
    state = newton(system, np.zeros((2, 3)), 1e-10, 100, True).state
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    assert factorize(system, hessian, 0.0) == 0
    value, _ = lowest_mode(system, hessian, 0.0, 1e-4)
    lowest = np.linalg.eigvalsh(matrix_of(system, hessian))[0]
    assert value == pytest.approx(lowest, rel=1e-3)


def test_largest_turn_is_that_of_any_node(problem, rng):
    # against the rotations themselves, also where the nodes beyond turn back
    system, hessian, _ = problem
    q = rng.normal(size=new_configuration(system).q.shape)
    m = len(q)
    here = new_configuration(system)
    here.q[:] = q
    evaluate(system, here)
    assemble(system, here, hessian)
    for k in range(6):
        step = rng.normal(size=(m, 3))
        if k > 3 and not system.basis.shape[1]:
            step[m // 2:] = -step[:m // 2][::-1]
        turns = []
        for sign in (1, -1):
            state = new_configuration(system)
            state.q[:] = q + sign * 1e-6 * step
            evaluate(system, state)
            turns.append(state.rotations)
        spins = [Rotation.from_matrix(up @ down.T).magnitude() / 2e-6
                 for up, down in zip(*turns, strict=True)]
        assert largest_turn(system, hessian, step) == pytest.approx(max(spins), rel=1e-6)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_a_pivot_of_zero_is_survived(basis):
    # without loads the Hessian is the identity: shifted by -1 nothing is left of it
    rod = Rod(1.0, 0.0, 1.0, 1.0)
    around = Surroundings(rod, np.zeros(3))
    system = Discretization(around, np.linspace(0, 1, 9), basis, 4).system(np.eye(3))
    state = new_configuration(system)
    evaluate(system, state)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    for shift, negative in ((0.0, 0), (-1 + 1e-12, 0), (-1 - 1e-12, state.q.size)):
        assert factorize(system, hessian, shift) == negative
    for part in (hessian.twist_jacobian, hessian.cross, hessian.diagonal, hessian.dense):
        part[:] = 0.0
    assert factorize(system, hessian, 0.0) == 0  # neutral is not negative
    out = np.empty_like(state.q)
    solve(system, hessian, np.zeros_like(state.q), out)
    np.testing.assert_array_equal(out, 0)


def test_a_pivot_of_zero_lets_no_number_overflow():
    # what a pivot of zero is divided by goes on into all pivots before it
    rod = Rod(1.0, 0.0, 1.0, 1.0)
    around = Surroundings(rod, np.zeros(3))
    mesh = Discretization(around, np.linspace(0, 1, 9), 'local', 4)
    system = mesh.system(np.eye(3), np.zeros(3), None, (FarEnd.of((0.9, 0.0, 0.1)),))
    state = new_configuration(system)
    evaluate(system, state)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    hessian.diagonal[-3:] = 0.0
    hessian.border.give[0] = 0.0
    factorize(system, hessian, 0.0)
    out, reaction = np.empty_like(state.q), np.empty(3)
    solve_held(system, hessian, np.ones_like(state.q), np.ones(3), out, reaction)
    assert np.isfinite(out).all() and np.isfinite(reaction).all()


def of_matrix(matrix):
    """Return a KKTBorder whose matrix A H^-1 A^T is a given one, (6, 6)."""
    return KKTBorder(np.eye(6).reshape(6, 2, 3), np.array(matrix).reshape(6, 2, 3),
                     np.empty((6, 6)), np.zeros(1))


def symmetric(values, rng):
    """Return (6, 6) with given eigenvalues and random eigenvectors."""
    vectors, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    matrix = (vectors * values) @ vectors.T
    return 0.5 * (matrix + matrix.T)


@pytest.mark.parametrize('below', range(7))
def test_inverse_and_number_of_negative_eigenvalues(below, rng):
    for _ in range(50):
        values = 10.0 ** rng.uniform(-3, 3, 6) * np.where(np.arange(6) < below, -1, 1)
        matrix = symmetric(values, rng)
        border = of_matrix(matrix)
        assert complemented(border) == below
        np.testing.assert_allclose(border.schur @ matrix, np.eye(6), atol=1e-8)


def test_an_empty_diagonal_has_an_inverse(rng):
    block = rng.normal(size=(3, 3))
    matrix = np.block([[np.zeros((3, 3)), block], [block.T, np.zeros((3, 3))]])
    border = of_matrix(matrix)
    assert complemented(border) == 3
    np.testing.assert_allclose(border.schur @ matrix, np.eye(6), atol=1e-9)


def test_a_direction_in_which_nothing_moves_gets_no_force(rng):
    values = np.array([3.0, 1.0, 0.5, 0.2, -0.1, 0.0])
    matrix = symmetric(values, rng)
    border = of_matrix(matrix)
    assert complemented(border) in (1, 2)  # rounding decides on the sign of zero
    np.testing.assert_allclose(border.schur, np.linalg.pinv(matrix, rcond=1e-12), atol=1e-9)


def test_numbers_that_overflowed_are_of_no_use():
    border = of_matrix(np.full((6, 6), np.inf))
    assert complemented(border) == -7
    assert (border.schur == 0).all()


@pytest.mark.parametrize('size', [1, 2, 7, 40])
def test_lu_swaps_rows_and_tells_the_sign_of_the_determinant(size, rng):
    for _ in range(10):
        matrix, right = rng.normal(size=(size, size)), rng.normal(size=(size, 3))
        factors, order, found = matrix.copy(), np.empty(size, dtype=np.int64), right.copy()
        assert lu_factor(factors, order) == np.linalg.slogdet(matrix)[0]
        lu_solve(factors, order, found)
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-7, atol=1e-7)
    assert lu_factor(np.zeros((size, size)), order) == 0
