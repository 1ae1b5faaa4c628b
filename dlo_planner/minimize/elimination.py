# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Small dense systems that are not symmetric: what the forces of contacts do to each other."""

import numpy as np

from dlo_planner.kernels import kernel


@kernel
def softly_solved(matrix, right, soft, times):
    """Return whether the determinant of matrix (K, K) is > 0, and the solution for right (K,).

    What is soft (K,) on the diagonal is there for contacts that depend on each other. Of others it
    is taken away, so many times a thousandth of it (proximal point iteration: Rockafellar 1976).
    """
    change, order = right.copy(), np.empty(right.size, dtype=np.int64)
    positive = decomposed(matrix, order) > 0
    if positive:
        substituted(matrix, order, change)
        for _ in range(times):
            for i in range(right.size):
                change[i] = right[i] + soft[i] * change[i]
            substituted(matrix, order, change)
    return positive, change


@kernel
def decomposed(matrix, order):
    """Replace matrix (K, K) by its factors L and U, rows swapped; return its determinant's sign.

    Where that is 0 nothing can be solved.

    Args:
        order: (K,) filled: the row that each was swapped with
    """
    size = order.size
    sign = 1
    for i in range(size):
        pivot = i
        for j in range(i + 1, size):
            if abs(matrix[j, i]) > abs(matrix[pivot, i]):
                pivot = j
        if not abs(matrix[pivot, i]) > 0.0:
            return 0
        order[i] = pivot
        if pivot != i:
            sign = -sign
            for k in range(size):
                matrix[i, k], matrix[pivot, k] = matrix[pivot, k], matrix[i, k]
        if matrix[i, i] < 0.0:
            sign = -sign
        for j in range(i + 1, size):
            if matrix[j, i] != 0.0:
                matrix[j, i] /= matrix[i, i]
                for k in range(i + 1, size):
                    matrix[j, k] -= matrix[j, i] * matrix[i, k]
    return sign


@kernel
def substituted(factors, order, right):
    """Solve for right (K,), in place, with what `decomposed` has filled."""
    size = right.size
    for i in range(size):
        right[i], right[order[i]] = right[order[i]], right[i]
    for i in range(size):
        for k in range(i):
            right[i] -= factors[i, k] * right[k]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= factors[i, k] * right[k]
        right[i] /= factors[i, i]
