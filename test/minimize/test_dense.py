# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Small dense systems: against LAPACK, and where contacts depend on each other."""

import numpy as np
import pytest

from dlo_planner.minimize.dense import lu_factor, lu_solve, softly_solved


@pytest.mark.parametrize('size', [1, 2, 7, 20])
def test_factors_solve_and_tell_the_sign_of_the_determinant(size):
    rng = np.random.default_rng(size)
    for _ in range(5):
        matrix, right = rng.normal(size=(size, size)), rng.normal(size=size)
        factors, order, found = matrix.copy(), np.empty(size, dtype=np.int64), right.copy()
        sign = lu_factor(factors, order)
        lu_solve(factors, order, found)
        assert sign == np.sign(np.linalg.det(matrix))
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9, atol=1e-12)


def test_what_is_singular_is_told():
    assert lu_factor(np.zeros((3, 3)), np.empty(3, dtype=np.int64)) == 0


def test_softness_hardly_counts_where_contacts_are_independent():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    matrix, right, soft = root @ root.T + np.eye(6), rng.normal(size=6), np.full(6, 1e-3)
    known, found = softly_solved(matrix + np.diag(soft), right, soft, 2)
    exact = np.linalg.solve(matrix, right)
    rough = np.linalg.solve(matrix + np.diag(soft), right)
    assert known
    assert np.abs(rough - exact).max() > 1e-5
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-8)


def test_contacts_that_depend_on_each_other_share():
    # two contacts at one place: what each bears is not determined, their sum is
    matrix, soft = np.ones((2, 2)), np.full(2, 1e-3)
    known, found = softly_solved(matrix + np.diag(soft), np.array([1.0, 1.0]), soft, 2)
    assert known
    assert found[0] == pytest.approx(found[1])
    assert found.sum() == pytest.approx(1.0, rel=1e-8)
