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
from dlo_planner.energy.strands import ROWS, nodes_of, pair_count, put_rows
from dlo_planner.geometry.so3 import coefficients_in, columns_scaled, jacobians_with, matrix, times
from dlo_planner.kernels import kernel
from dlo_planner.minimize.dense import factorized
from dlo_planner.minimize.kkt import add_to, dot, dots

_LOST = 1e-13  # of the largest entry: with a pivot as small a factorization is of no use
_NONE = 1e-12  # of the largest weight: smaller ones change nothing


@kernel
def fill_coupling(system, state, hessian, coupling):
    """Fill rows and weights of all pairs that bear at `state`."""
    if coupling is None:
        return
    coupling.used[0] = 0
    if pair_count(system.effects.strands) == 0:
        return
    n, used = system.lengths.size, 0
    forces, weights = np.empty((ROWS, 4, 3)), np.empty(ROWS)
    values, places = np.empty((n, 3)), np.empty(4, dtype=np.int64)
    strands = system.effects.strands
    for p in range(pair_count(strands)):
        count = put_rows(strands, system, state, p, forces, weights)
        places[0], places[1], places[2], places[3] = nodes_of(strands, n, p)
        for row in range(count):
            if abs(weights[row]) <= _NONE * abs(weights[0]):
                continue
            _put_row(system, state, hessian, places, forces[row], values)
            project(system.basis, values, coupling.rows[used])
            coupling.weights[used] = weights[row]
            used += 1
    coupling.used[0] = used


@kernel
def _put_row(system, state, hessian, places, forces, values):
    """Fill values (N, 3): what forces (4, 3) on nodes `places` (4,), rising, are by the strains."""
    moment, force, last = np.zeros(3), np.zeros(3), 3
    for r in range(system.lengths.size):
        e = system.lengths.size - 1 - r
        while last >= 0 and places[last] > e:  # it lies beyond the element
            x, f = state.positions[places[last]], forces[last]
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                force[k] += f[k]
                moment[k] += x[a] * f[b] - x[b] * f[a]
            last -= 1
        if last == 3:
            for k in range(3):
                values[e, k] = 0.0
            continue
        h, u, x, scale = (system.lengths[e], state.strains[e], state.positions[e + 1],
                          system.scale[e])
        _, chord = jacobians_with(h * u[0], h * u[1], h * u[2], h, coefficients_in(state.arcs[e]))
        moved = columns_scaled(times(matrix(state.rotations[e]), chord), h * scale[0],
                               h * scale[1], h * scale[2])
        turned = matrix(hessian.twist_jacobian[e])
        m0 = moment[0] - x[1] * force[2] + x[2] * force[1]  # about the end of the element
        m1 = moment[1] - x[2] * force[0] + x[0] * force[2]
        m2 = moment[2] - x[0] * force[1] + x[1] * force[0]
        for k in range(3):
            values[e, k] = (turned[k] * m0 + turned[3 + k] * m1 + turned[6 + k] * m2
                            + moved[k] * force[0] + moved[3 + k] * force[1]
                            + moved[6 + k] * force[2])


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
