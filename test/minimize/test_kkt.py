# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a grip adds to a Newton system: inverse and inertia of the reaction's matrix."""

import numpy as np
import pytest

from dlo_planner.energy.terms import KKTBorder
from dlo_planner.minimize.kkt import complemented


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
