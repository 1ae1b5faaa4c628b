# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a grip adds to a Newton system: K rows that border the Hessian.

    [H  A^T] [dq      ]   [right]
    [A  -d ] [reaction] = [-miss]

is solved with answers H^-1 A^T, found one by one, and the inverse of A H^-1 A^T + d (K, K).
"""

import numpy as np

from dlo_planner.energy.effects import fill_rows
from dlo_planner.energy.potential import project
from dlo_planner.kernels import kernel

_NEVER = 1e-14  # of the largest: the eigenvalue of a direction in which nothing can move


@kernel
def fill_border(system, state, hessian, border):
    """Fill the derivatives of what is held of the far end by the unknowns."""
    if border is None:
        return
    n, held = system.lengths.size, border.rows.shape[0]
    if held == 0:
        return
    twists, values = np.empty((held, 6)), np.zeros((n, 3))
    fill_rows(system.effects, state.rotations[n], state.positions[n], twists)
    for row in range(held):
        for e in range(n):
            for i in range(3):
                values[e, i] = 0.0
                for k in range(6):
                    values[e, i] += hessian.twist_jacobian[e, k, i] * twists[row, k]
        project(system.basis, values, border.rows[row])


@kernel
def complemented(border):
    """Fill border.schur from its answers; return how many eigenvalues of its inverse are negative.

    As many of those of H are not of what the grip leaves free (Haynsworth). Where a number
    overflowed, the factorization is of no use: it returns less than there can be.
    """
    negative, held = 0, border.rows.shape[0]
    schur = border.schur
    for row in range(held):
        for other in range(row + 1):
            schur[row, other] = dot(border.rows[row], border.answers[other])
            schur[other, row] = schur[row, other]
        schur[row, row] += border.give[0]
    if not np.isfinite(schur).all():
        schur[:] = 0.0
        return -held - 1
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
def kept(border, out):
    """Correct the solution `out` (m, 3) without the grip, which is not missed."""
    if border is None:
        return
    if border.rows.shape[0]:
        keep(border, out, np.zeros(border.rows.shape[0]))


@kernel
def keep(border, out, reaction):
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
def add_to(a, factor, b):
    """Add factor times b (m, 3) to a (m, 3)."""
    for e in range(a.shape[0]):
        for i in range(3):
            a[e, i] += factor * b[e, i]
