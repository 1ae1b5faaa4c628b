# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What pairs of places that touch add to the Hessian: it couples elements that lie far apart.

That is H + A^T W A with few rows A (R, 3 m) and weights W (R,), which no sweep along the DLO knows.
Its solutions are those of H, corrected (Sherman, Morrison and Woodbury):

    (H + A^T W A)^-1 b = x - Y^T (A Y^T + W^-1)^-1 A x,   x = H^-1 b,  Y = A H^-1

and as many of its eigenvalues are negative as those of H and W together, less those of
A Y^T + W^-1 (Haynsworth, 1968).
"""

import numpy as np

from dlo_planner.energy.potential import project
from dlo_planner.energy.strands import (
    ACROSS,
    nodes_of,
    pair_count,
    put_friction_rows,
    put_load_row,
    put_rows,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.dense import factorized
from dlo_planner.minimize.kkt import add_to, dot, dots

_LOST = 1e-13  # of the largest entry: with a pivot as small a factorization is of no use
_NONE = 1e-12  # of the largest weight: smaller ones change nothing


@kernel
def fill_coupling(system, state, coupling):
    """Fill rows and weights of all pairs that bear at `state`."""
    if coupling is None:
        return
    coupling.used[0] = 0
    if pair_count(system.effects.strands) == 0:
        return
    n, used = system.lengths.size, 0
    forces, weights, none = np.empty((ACROSS, 4, 3)), np.empty(ACROSS), np.zeros((4, 3))
    values, places = np.empty((2, n, 3)), np.empty(4, dtype=np.int64)
    strands = system.effects.strands
    for p in range(pair_count(strands)):
        count = put_rows(strands, system, state, p, forces, weights)
        places[0], places[1], places[2], places[3] = nodes_of(strands, n, p)
        for row in range(count):
            if abs(weights[row]) <= _NONE * abs(weights[0]):
                continue
            put_load_row(system.lengths, state, places, forces[row], none, values[0])
            used = _with_row(system, coupling, used, values[0], weights[row])
        for row in range(put_friction_rows(strands, system, state, p, values, weights)):
            used = _with_row(system, coupling, used, values[row], weights[row])
    coupling.used[0] = used


@kernel
def _with_row(system, coupling, used, values, weight):
    """Write a row by the strains, (N, 3), and its weight; return how many rows there are then."""
    for e in range(values.shape[0]):
        for k in range(3):
            values[e, k] *= system.scale[e, k]
    project(system.basis, values, coupling.rows[used])
    coupling.weights[used] = weight
    return used + 1


@kernel
def used_rows(coupling):
    """Return how many rows there are."""
    if coupling is None:
        return 0
    return coupling.used[0]


@kernel
def coupled(coupling):
    """Fill the factor from the answers; return how many negative eigenvalues the rows add to H."""
    if coupling is None:
        return 0
    used = coupling.used[0]
    if used == 0:
        return 0
    negative, schur, largest = 0, np.empty((used, used)), 0.0
    for row in range(used):
        for other in range(row + 1):
            schur[row, other] = dot(coupling.rows[row], coupling.answers[other])
            schur[other, row] = schur[row, other]
        schur[row, row] += 1.0 / coupling.weights[row]
        largest = max(largest, abs(schur[row, row]))
        negative += coupling.weights[row] < 0.0
    factor = coupling.factor[:used, :used]
    negative -= factorized(schur, factor, 0.0, used)
    for row in range(used):
        if not abs(factor[row, row]) > _LOST * largest:  # nor if it is not a number
            return 3 * coupling.rows.shape[1]  # of no use: more than there are
    return negative


@kernel
def _solved(factor, right):
    """Replace right (R,) by the solution with the factor L, D of `dense.factorized`."""
    size = right.size
    for i in range(size):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
    for i in range(size - 1, -1, -1):
        right[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i):
            right[k] -= factor[i, k] * right[i]


@kernel
def correct_for_pairs(coupling, out):
    """Make of the solution `out` (m, 3) of H that of H with the pairs."""
    if coupling is None:
        return
    used = coupling.used[0]
    if used == 0:
        return
    missed = np.empty(used)
    for row in range(used):
        missed[row] = dot(coupling.rows[row], out)
    _solved(coupling.factor, missed)
    for row in range(used):
        add_to(out, -missed[row], coupling.answers[row])


@kernel
def subtract_coupled(coupling, loads, products):
    """Take from products (K, K), of loads (m, 3, K) and H^-1 loads, what pairs hold back."""
    if coupling is None:
        return
    used, size = coupling.used[0], products.shape[0]
    if used == 0:
        return
    moved = np.empty((used, size))
    for row in range(used):
        moved[row] = dots(loads, coupling.answers[row])
    solved = np.empty(used)
    for k in range(size):
        solved[:] = moved[:, k]
        _solved(coupling.factor, solved)
        for i in range(size):
            for row in range(used):
                products[i, k] -= moved[row, i] * solved[row]
