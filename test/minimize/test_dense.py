# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Small dense systems: against LAPACK, and where contacts depend on each other."""

import numpy as np
import pytest

from dlo_planner.minimize.dense import softly_solved


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
