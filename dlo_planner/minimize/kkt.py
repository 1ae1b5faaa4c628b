# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What K rows of constraints add to a Newton system (Nocedal and Wright, ch. 16.2).

    [H  A^T] [dq      ]   [right]
    [A  -d ] [reaction] = [-miss]

is solved with answers H^-1 A^T, found one by one, and the inverse of A H^-1 A^T + d (K, K).
"""

import numpy as np

from dlo_planner.energy.grip import held_nodes
from dlo_planner.energy.potential import project
from dlo_planner.energy.terms import constraint_jacobian
from dlo_planner.geometry.so3 import coefficients_in, columns_scaled, jacobians_with, matrix, times
from dlo_planner.kernels import kernel

_NEVER = 1e-14  # of the largest: the eigenvalue of a direction in which nothing can move
_CLEAR = 1e-9   # of the largest entry: a pivot above it is of a direction in which something can
_LARGE = 0.1    # of the largest entry left: a pivot above it spoils nothing


@kernel
def fill_border(system, state, hessian, border):
    """Fill the derivatives of what is held of nodes by the unknowns."""
    if border is None:
        return
    n, held = system.lengths.size, border.rows.shape[0]
    if held == 0:
        return
    twists, values = np.empty((held, 6)), np.empty((held, n, 3))
    constraint_jacobian(system.effects, state, twists)
    nodes = held_nodes(system.effects.hold, held)
    for e in range(n):
        h, u, x, scale = (system.lengths[e], state.strains[e], state.positions[e + 1],
                          system.scale[e])
        _, chord = jacobians_with(h * u[0], h * u[1], h * u[2], h, coefficients_in(state.arcs[e]))
        moved = columns_scaled(times(matrix(state.rotations[e]), chord), h * scale[0],
                               h * scale[1], h * scale[2])
        turned = matrix(hessian.twist_jacobian[e])
        for row in range(held):
            if e >= nodes[row]:  # what lies beyond a node does not move it
                for i in range(3):
                    values[row, e, i] = 0.0
                continue
            f0, f1, f2 = twists[row, 3], twists[row, 4], twists[row, 5]
            m0 = twists[row, 0] - x[1] * f2 + x[2] * f1  # about the end of the element
            m1 = twists[row, 1] - x[2] * f0 + x[0] * f2
            m2 = twists[row, 2] - x[0] * f1 + x[1] * f0
            for i in range(3):
                values[row, e, i] = (turned[i] * m0 + turned[3 + i] * m1 + turned[6 + i] * m2
                                     + moved[i] * f0 + moved[3 + i] * f1 + moved[6 + i] * f2)
    for row in range(held):
        project(system.basis, values[row], border.rows[row])


@kernel
def set_give(border, give):
    """Say by how much what is held gives way, m/N."""
    if border is None:
        return
    border.give[0] = give


@kernel
def complemented(border):
    """Fill border.schur from its answers; return how many eigenvalues of its inverse are negative.

    As many of those of H are not of what the grip leaves free (Haynsworth). Where a number
    overflowed, the factorization is of no use: it returns less than there can be.
    """
    schur, held = border.schur, border.rows.shape[0]
    for row in range(held):
        for other in range(row + 1):
            schur[row, other] = dot(border.rows[row], border.answers[other])
            schur[other, row] = schur[row, other]
        schur[row, row] += border.give[0]
    if not np.isfinite(schur).all():
        schur[:] = 0.0
        return -held - 1
    negative = _inverted(schur)
    return negative if negative >= 0 else _inverted_where_it_can_be(schur)


@kernel
def _inverted(schur):
    """Invert a symmetric matrix (K, K) in place; return how many of its eigenvalues are negative.

    By exchange of rows with columns (Gauss and Jordan) on the largest pivot of the diagonal: a
    congruence, so that pivots have the eigenvalues' signs. Where none left is large enough it
    returns -1, and the matrix is what it was.
    """
    held, negative = schur.shape[0], 0
    work, left = schur.copy(), np.ones(held, dtype=np.bool_)
    least = 0.0
    for _ in range(held):
        best, pivot, largest = -1, 0.0, 0.0
        for row in range(held):
            if left[row]:
                if best < 0 or abs(work[row, row]) > abs(pivot):
                    best, pivot = row, work[row, row]
                for other in range(row + 1):
                    if left[other]:
                        largest = max(largest, abs(work[row, other]))
        least = max(least, _CLEAR * largest)
        if not (abs(pivot) > least and abs(pivot) >= _LARGE * largest):
            return -1
        left[best] = False
        negative += pivot < 0.0
        for row in range(held):
            if row == best:
                continue
            factor = work[row, best] / pivot
            for other in range(held):
                if other != best:
                    work[row, other] -= factor * work[best, other]
            work[row, best] = factor
        for other in range(held):
            if other != best:
                work[best, other] /= pivot
        work[best, best] = -1.0 / pivot
    for row in range(held):
        for other in range(held):
            schur[row, other] = -work[row, other]
    return negative


@kernel
def _inverted_where_it_can_be(schur):
    """Do what `_inverted` does of a matrix on what it does not map to nothing, by eigenvectors."""
    negative, held = 0, schur.shape[0]
    values, vectors = np.linalg.eigh(schur)
    largest = np.abs(values).max()
    for row in range(held):
        for other in range(held):
            schur[row, other] = 0.0
    for k in range(held):
        negative += values[k] < 0.0
        if abs(values[k]) > _NEVER * largest:  # else no force there changes anything
            for row in range(held):
                for other in range(held):
                    schur[row, other] += vectors[row, k] * vectors[other, k] / values[k]
    return negative


@kernel
def project_on_constraint(border, out):
    """Correct the solution `out` (m, 3) without the grip, which is not missed."""
    if border is None:
        return
    if border.rows.shape[0]:
        apply_kkt_border(border, out, np.zeros(border.rows.shape[0]))


@kernel
def apply_kkt_border(border, out, reaction):
    """Correct the solution `out` (m, 3) without the grip; `reaction` (K,): in the miss."""
    if border is None:
        return
    held = reaction.size
    miss = np.empty(held)
    for row in range(held):
        miss[row] = reaction[row] + dot(border.rows[row], out)
    for row in range(held):
        reaction[row] = 0.0
        for other in range(held):
            reaction[row] += border.schur[row, other] * miss[other]
    for row in range(held):
        add_to(out, -reaction[row], border.answers[row])


@kernel
def dot(a, b):
    """Return the sum of products of two arrays (m, 3)."""
    x, y, z = 0.0, 0.0, 0.0  # three sums: each addition waits for the one before
    for e in range(a.shape[0]):
        x += a[e, 0] * b[e, 0]
        y += a[e, 1] * b[e, 1]
        z += a[e, 2] * b[e, 2]
    return x + y + z


@kernel
def put_scaled(factor, a, out):
    """Fill out (m, 3) with a factor times a (m, 3)."""
    for e in range(a.shape[0]):
        for i in range(3):
            out[e, i] = factor * a[e, i]


@kernel
def add_to(a, factor, b):
    """Add factor times b (m, 3) to a (m, 3)."""
    for e in range(a.shape[0]):
        for i in range(3):
            a[e, i] += factor * b[e, i]


@kernel
def dots(loads, a):
    """Return (K,) the sums of products of each of loads (m, 3, K) with an array (m, 3)."""
    sums = np.zeros(loads.shape[2])
    for e in range(a.shape[0]):
        for i in range(3):
            for k in range(sums.size):
                sums[k] += a[e, i] * loads[e, i, k]
    return sums


@kernel
def add_all(a, factors, loads):
    """Add factors (K,) times loads (m, 3, K) to a (m, 3)."""
    for e in range(a.shape[0]):
        for i in range(3):
            for k in range(factors.size):
                a[e, i] += factors[k] * loads[e, i, k]


@kernel
def subtract_held(border, loads, products):
    """Take from products (K, K), of loads (m, 3, K) and H^-1 loads, what the grip does not give."""
    if border is None:
        return
    size = products.shape[0]
    for row in range(border.rows.shape[0]):
        pulled = dots(loads, border.answers[row])
        for other in range(border.rows.shape[0]):
            moved = dots(loads, border.answers[other])
            for i in range(size):
                for k in range(size):
                    products[i, k] -= pulled[i] * border.schur[row, other] * moved[k]
