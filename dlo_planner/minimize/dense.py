# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Dense systems: LDL^T of the Hessian of a series; LU of what contacts do to each other."""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.minimize.riccati import TINY

# What many kinds of DLO do alike gets arrays, not Records, so that it is compiled once for all. The
# width of the blocks is written out in the calls, so that the compiler, which inlines this
# function, sees constant loops and unrolls them; and that what is filled is new, and no part of
# what is read.


@kernel
def project_all(basis, twist_jacobian, cross, diagonal, dense):
    """Fill the dense Hessian (3 m, 3 m) from its blocks, in O(N m^2)."""
    blocks = twist_jacobian, cross, diagonal
    if twist_jacobian.shape[1] == 6:
        _project_twists(basis, blocks, dense)
    else:
        _project_turns(basis, blocks, dense)


@kernel
def _project_turns(basis, blocks, dense):
    _, n, m = basis.shape
    rows, prefix = np.empty((3, n, 3 * m)), np.zeros((3, 3 * m))
    _fill_rows(basis, blocks, prefix, rows, 0, n, 3)
    _put_together(basis, rows, dense)


@kernel
def _project_twists(basis, blocks, dense):
    _, n, m = basis.shape
    rows, prefix = np.empty((3, n, 3 * m)), np.zeros((6, 3 * m))
    reach = _reach_of_springs(blocks[1])
    _fill_rows(basis, blocks, prefix, rows, 0, reach, 6)
    _fill_rows(basis, blocks, prefix, rows, reach, n, 3)  # displacements do not matter there
    _put_together(basis, rows, dense)


@kernel
def _reach_of_springs(crosses):
    """Return how many elements there are up to the last one that a displacement acts on."""
    n = crosses.shape[0]
    while n > 0:
        across = crosses[n - 1]
        for i in range(3):
            if across[i, 3] != 0.0 or across[i, 4] != 0.0 or across[i, 5] != 0.0:
                return n
        n -= 1
    return n


@kernel(inline='always')
def _fill_rows(basis, blocks, prefix, rows, begin, end, wide):
    """Fill rows (3, N, 3 m) of elements: what of the Hessian is to be multiplied by their basis.

    Inner loops run over the terms, which lie side by side: the compiler makes vectors of them.
    """
    m = basis.shape[2]
    jacobians, crosses, diagonals = blocks
    for f in range(begin, end):
        jacobian, cross, diagonal = jacobians[f], crosses[f], diagonals[f]
        for a in range(3):
            for b in range(3):
                own = 0.5 * diagonal[a, b]
                for j in range(m):
                    rows[a, f, b * m + j] = own * basis[b, f, j]
            for j in range(3 * m):
                total = rows[a, f, j]
                for k in range(wide):
                    total += cross[a, k] * prefix[k, j]
                rows[a, f, j] = total
        for k in range(wide):
            for b in range(3):
                turning = jacobian[k, b]
                for j in range(m):
                    prefix[k, b * m + j] += turning * basis[b, f, j]


@kernel
def _put_together(basis, rows, dense):
    """Fill dense (3 m, 3 m), unknown (j, i) at row 3 j + i, of the rows of all elements."""
    m = basis.shape[2]
    half = np.empty((3, m, 3 * m))
    for a in range(3):
        np.dot(basis[a].T, rows[a], half[a])
    for k in range(m):
        for j in range(m):
            for a in range(3):
                for b in range(3):
                    dense[3 * k + a, 3 * j + b] = half[a, k, b * m + j] + half[b, j, a * m + k]


@kernel
def factorized(dense, factor, shift, most):
    """Fill factor with L, D of dense + shift I = L D L^T; return how many pivots are negative.

    Give up where more than `most` are.
    """
    n = dense.shape[0]
    negative = 0
    scaled = np.empty(n)
    for i in range(n):
        # row i of L D, then of L; rows are contiguous
        for j in range(i):
            total = dense[i, j]
            for k in range(j):
                total -= scaled[k] * factor[j, k]
            scaled[j] = total
        pivot = dense[i, i] + shift
        for j in range(i):
            factor[i, j] = scaled[j] / factor[j, j]
            pivot -= scaled[j] * factor[i, j]
        if pivot == 0.0:
            pivot = TINY
        factor[i, i] = pivot
        negative += pivot <= 0
        if negative > most:
            break
    return negative


@kernel
def solve_dense(factor, right, out):
    """Fill out (m, 3) with the solution for right (m, 3)."""
    n = factor.shape[0]
    flat = np.empty(n)
    for i in range(n):
        total = right[i // 3, i % 3]
        for k in range(i):
            total -= factor[i, k] * flat[k]
        flat[i] = total
    for i in range(n):
        flat[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        value = flat[i]
        out[i // 3, i % 3] = value
        for k in range(i):
            flat[k] -= factor[i, k] * value


@kernel
def add_products(factor, loads, products):
    """Add loads (m, 3, K) times the solutions for them to products (K, K)."""
    n, size = factor.shape[0], products.shape[0]
    half = loads.copy().reshape((n, size))
    for i in range(n):
        for k in range(i):
            for p in range(size):
                half[i, p] -= factor[i, k] * half[k, p]
        for p in range(size):
            for r in range(size):
                products[p, r] += half[i, p] / factor[i, i] * half[i, r]


@kernel
def lu_factor(matrix, order):
    """Replace matrix (K, K) by its factors L and U, rows swapped; return its determinant's sign.

    Where that is 0 nothing can be solved.
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
            part = matrix[j, i] / matrix[i, i]
            if part != 0.0:
                matrix[j, i] = part
                row, above = matrix[j, i + 1:], matrix[i, i + 1:]  # slices are vectorized
                for k in range(row.size):
                    row[k] -= part * above[k]
    return sign


@kernel
def lu_solve(factors, order, right):
    """Solve for the columns of right (K, n), in place, with what `lu_factor` has filled."""
    size, columns = right.shape
    for i in range(size):
        if order[i] != i:
            for k in range(columns):
                right[i, k], right[order[i], k] = right[order[i], k], right[i, k]
    for i in range(size):
        for k in range(i):
            for j in range(columns):
                right[i, j] -= factors[i, k] * right[k, j]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            for j in range(columns):
                right[i, j] -= factors[i, k] * right[k, j]
        for j in range(columns):
            right[i, j] /= factors[i, i]
