# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Solving with the Hessian H + shift I: Riccati sweep (local) or dense LDL^T (Ritz).

With prefix rotations theta_f = sum of turning_e dq_e over e < f, the local Newton system is a
linear-quadratic optimal control problem, solved by one backward and one forward sweep in O(N).
Both factorizations are congruences, so the signs of their pivots are the signs of the eigenvalues
(Sylvester): no negative pivot means a minimum.
"""

import numpy as np

from dlo_planner.energy.effects import Border, new_border, width
from dlo_planner.energy.potential import at_element, element_hessian, unknown_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import complemented, fill_border, keep, kept
from dlo_planner.ritz.matrix3 import (
    ZERO,
    added,
    applied,
    inner,
    matrix,
    plus,
    put_matrix,
    put_vector,
    times,
    transposed_applied,
    transposed_times,
    vector,
)
from dlo_planner.ritz.record import Record

_TINY = 1e-16  # of a pivot of zero, as rounding errors leave them: less would overflow further on


class Hessian(Record):
    """The Hessian at one state and its factorization (arrays, refilled in place).

    Attributes:
        turning: (N, w, 3), cross: (N, 3, w), diagonal: (N, 3, 3), see `ritz.kinematics`; w is 3
            for rotations alone, 6 for twists
        base: (3, 3) change of the moment on the gripper per rotation of it
        gain: (N, 3, w), inverse: (N, 3, 3) of the Riccati sweep; empty for Ritz
        dense, factor: (3 m, 3 m) for Ritz; (0, 0) for local
        border: Border, what is held; None: nothing
        displaced: whether w is 6; None: never
    """

    turning: np.ndarray
    cross: np.ndarray
    diagonal: np.ndarray
    base: np.ndarray
    gain: np.ndarray
    inverse: np.ndarray
    dense: np.ndarray
    factor: np.ndarray
    border: Border | None
    displaced: bool | None


@kernel
def new_hessian(system):
    """Return an empty Hessian of the right sizes."""
    n = system.lengths.size
    local = n if system.basis.shape[1] == 0 else 0
    m, displaced = unknown_count(system), system.needs.displaced
    size = 0 if local else 3 * m
    wide = width(displaced)
    return Hessian(np.empty((n, wide, 3)), np.empty((n, 3, wide)), np.empty((n, 3, 3)),
                   np.empty((3, 3)), np.empty((local, 3, wide)), np.empty((local, 3, 3)),
                   np.empty((size, size)), np.empty((size, size)),
                   new_border(system.needs.border, m), displaced)


@kernel
def assemble(system, state, hessian):
    """Fill the Hessian at `state`."""
    element_hessian(system, state, hessian.turning, hessian.cross, hessian.diagonal, hessian.base)
    if system.basis.shape[1] > 0:
        _project_all(system.basis, hessian, hessian.displaced)
    fill_border(system, state, hessian, hessian.border)
    if system.near.shape[0]:
        if system.basis.shape[1] > 0:
            for i in range(hessian.dense.shape[0]):
                hessian.dense[i, i] += system.tie
        else:
            for e in range(system.lengths.size):
                for i in range(3):
                    hessian.diagonal[e, i, i] += system.tie


# The width of the blocks is written out in the calls, so that the compiler, which inlines this
# function, sees constant loops and unrolls them.


@kernel
def _project_all(basis, hessian, displaced):
    if displaced is None:
        _project(basis, hessian, 3)
        return
    if displaced:
        _project(basis, hessian, 6)
    else:
        _project(basis, hessian, 3)


@kernel(inline='always')
def _project(basis, hessian, wide):
    """Fill hessian.dense (3 m, 3 m), unknown (j, i) at row 3 j + i, in O(N m^2)."""
    n, m = basis.shape
    prefix = np.zeros((m, wide, 3))  # sum over e < f of basis_e turning_e
    rows = np.empty((n, 9 * m))
    turnings, crosses, diagonals = hessian.turning, hessian.cross, hessian.diagonal
    for f in range(n):
        turning, cross, diagonal = turnings[f], crosses[f], diagonals[f]
        for j in range(m):
            value = basis[f, j]
            for a in range(3):
                for b in range(3):
                    total = 0.5 * value * diagonal[a, b]
                    for k in range(wide):
                        total += cross[a, k] * prefix[j, k, b]
                    rows[f, 9 * j + 3 * a + b] = total
            for k in range(wide):
                for b in range(3):
                    prefix[j, k, b] += value * turning[k, b]
    half, dense = basis.T @ rows, hessian.dense
    for k in range(m):
        for j in range(m):
            for a in range(3):
                for b in range(3):
                    dense[3 * k + a, 3 * j + b] = (half[k, 9 * j + 3 * a + b]
                                                   + half[j, 9 * k + 3 * b + a])


@kernel
def factorize(system, hessian, shift):
    """Factorize H + shift I; return how many of its eigenvalues are not positive.

    With a held far end these are the eigenvalues on what the grip leaves free (Haynsworth).
    """
    negative = _factorize_alone(system, hessian, hessian.displaced, shift)
    return negative - _bordered(system, hessian, hessian.border)


@kernel
def _bordered(system, hessian, border):
    """Fill what is held into a factorization; return how many eigenvalues it keeps in place."""
    if border is None:
        return 0
    held = border.rows.shape[0]
    if held == 0:
        return 0
    for row in range(held):
        _solve_alone(system, hessian, hessian.displaced, border.rows[row], border.answers[row])
    return complemented(border)


@kernel
def _factorize_alone(system, hessian, displaced, shift):
    if system.basis.shape[1] > 0:
        return _factorize_dense(hessian, shift)
    if displaced is None:
        return _factorize_turns(hessian, shift)
    if displaced:
        return _factorize_twists(hessian, shift)
    return _factorize_turns(hessian, shift)


@kernel
def solve(system, hessian, right, out):
    """Fill out (m, 3) with the solution of (H + shift I) out = right (m, 3).

    With a held far end `out` keeps to what the grip leaves free, and the equation holds there.
    """
    _solve_alone(system, hessian, hessian.displaced, right, out)
    kept(hessian.border, out)


@kernel
def solve_held(system, hessian, right, miss, out, reaction):
    """Fill out (m, 3) and reaction (K,), which bring a grip that is missed by `miss` (K,) to zero.

    To first order, and but for what the grip gives under the reaction.
    """
    _solve_alone(system, hessian, hessian.displaced, right, out)
    for row in range(miss.size):
        reaction[row] = miss[row]
    keep(hessian.border, out, reaction)


@kernel
def _solve_alone(system, hessian, displaced, right, out):
    if system.basis.shape[1] > 0:
        _solve_dense(hessian.factor, right, out)
        return
    if displaced is None:
        _solve_turns(hessian, right, out)
        return
    if displaced:
        _solve_twists(hessian, right, out)
    else:
        _solve_turns(hessian, right, out)


@kernel
def _inverse3(a):
    """Return the inverse of the symmetric 3 x 3 `a` (9 numbers), and how many pivots are <= 0."""
    d0 = a[0] if a[0] != 0.0 else _TINY
    i0 = 1.0 / d0
    l10, l20 = a[3] * i0, a[6] * i0
    d1 = a[4] - l10 * a[3]
    d1 = d1 if d1 != 0.0 else _TINY
    i1 = 1.0 / d1
    middle = a[7] - l20 * a[3]
    l21 = middle * i1
    d2 = a[8] - l20 * a[6] - l21 * middle
    d2 = d2 if d2 != 0.0 else _TINY
    i2 = 1.0 / d2
    low = l10 * l21 - l20
    xy, xz, yz = -l10 * i1 - l21 * low * i2, low * i2, -l21 * i2
    inverse = (i0 + l10 * l10 * i1 + low * low * i2, xy, xz, xy, i1 + l21 * l21 * i2, yz,
               xz, yz, i2)
    return inverse, (d0 <= 0) + (d1 <= 0) + (d2 <= 0)


@kernel
def _factorize_turns(hessian, shift):
    """Factorize where only rotations count."""
    negative = 0
    value = ZERO  # second derivative of the cost to go by theta
    turnings, crosses, diagonals = hessian.turning, hessian.cross, hessian.diagonal
    gains, inverses = hessian.gain, hessian.inverse
    for k in range(turnings.shape[0]):
        e = turnings.shape[0] - 1 - k
        turning, d = matrix(turnings[e]), matrix(diagonals[e])
        carried = transposed_times(turning, value)
        coupling = added(matrix(crosses[e]), carried)
        p = times(carried, turning)
        inverse, found = _inverse3((d[0] + p[0] + shift, p[3], p[6],
                                    d[3] + p[3], d[4] + p[4] + shift, p[7],
                                    d[6] + p[6], d[7] + p[7], d[8] + p[8] + shift))
        negative += found
        gain = times(inverse, coupling)
        put_matrix(inverse, inverses[e])
        put_matrix(gain, gains[e])
        less = transposed_times(coupling, gain)
        xy, xz, yz = value[3] - less[3], value[6] - less[6], value[7] - less[7]
        value = (value[0] - less[0], xy, xz, xy, value[4] - less[4], yz,
                 xz, yz, value[8] - less[8])
    return negative


@kernel
def _solve_turns(hessian, right, out):
    """Solve where only rotations count."""
    turnings, gains, inverses = hessian.turning, hessian.gain, hessian.inverse
    n = turnings.shape[0]
    to_go = (0.0, 0.0, 0.0)  # slope of the cost to go by theta, negated
    for k in range(n):
        e = n - 1 - k
        own = plus(vector(right[e]), transposed_applied(matrix(turnings[e]), to_go))
        put_vector(applied(matrix(inverses[e]), own), out[e])
        less = transposed_applied(matrix(gains[e]), own)
        to_go = (to_go[0] - less[0], to_go[1] - less[1], to_go[2] - less[2])
    theta = (0.0, 0.0, 0.0)
    for e in range(n):
        less = applied(matrix(gains[e]), theta)
        step = (out[e, 0] - less[0], out[e, 1] - less[1], out[e, 2] - less[2])
        put_vector(step, out[e])
        theta = plus(theta, applied(matrix(turnings[e]), step))


@kernel
def _factorize_twists(hessian, shift):
    """Factorize where displacements count as well."""
    wide = 6
    negative = 0
    value = np.zeros((wide, wide))  # second derivative of the cost to go by theta
    pivot = np.empty((3, 3))
    carried = np.empty((3, wide))
    coupling = np.empty((3, wide))
    turnings, crosses, diagonals = hessian.turning, hessian.cross, hessian.diagonal
    gains, inverses = hessian.gain, hessian.inverse
    for e in range(turnings.shape[0] - 1, -1, -1):
        turning, cross = turnings[e], crosses[e]
        diagonal, gain, inverse = diagonals[e], gains[e], inverses[e]
        for i in range(3):
            for k in range(wide):
                total = 0.0
                for j in range(wide):
                    total += turning[j, i] * value[j, k]
                carried[i, k] = total
                coupling[i, k] = cross[i, k] + total
            for j in range(i + 1):
                total = diagonal[i, j]
                for k in range(wide):
                    total += carried[i, k] * turning[k, j]
                pivot[i, j] = total
                pivot[j, i] = total
            pivot[i, i] += shift
        inverted, found = _inverse3(matrix(pivot))
        put_matrix(inverted, inverse)
        negative += found
        for i in range(3):
            for k in range(wide):
                gain[i, k] = (inverse[i, 0] * coupling[0, k] + inverse[i, 1] * coupling[1, k]
                              + inverse[i, 2] * coupling[2, k])
        for i in range(wide):
            for k in range(i + 1):
                value[i, k] -= (coupling[0, i] * gain[0, k] + coupling[1, i] * gain[1, k]
                                + coupling[2, i] * gain[2, k])
                value[k, i] = value[i, k]
    return negative


@kernel
def _solve_twists(hessian, right, out):
    """Solve where displacements count as well."""
    wide = 6
    slope = np.zeros(wide)  # of the cost to go by theta
    own = np.empty(3)
    turnings, gains, inverses = hessian.turning, hessian.gain, hessian.inverse
    for e in range(turnings.shape[0] - 1, -1, -1):
        turning, gain, inverse = turnings[e], gains[e], inverses[e]
        for i in range(3):
            own[i] = -right[e, i]
            for k in range(wide):
                own[i] += turning[k, i] * slope[k]
        for i in range(3):
            out[e, i] = inverse[i, 0] * own[0] + inverse[i, 1] * own[1] + inverse[i, 2] * own[2]
        for k in range(wide):
            slope[k] -= gain[0, k] * own[0] + gain[1, k] * own[1] + gain[2, k] * own[2]
    theta = np.zeros(wide)
    for e in range(turnings.shape[0]):
        turning, gain = turnings[e], gains[e]
        for i in range(3):
            total = -out[e, i]
            for k in range(wide):
                total -= gain[i, k] * theta[k]
            out[e, i] = total
        for k in range(wide):
            theta[k] += (turning[k, 0] * out[e, 0] + turning[k, 1] * out[e, 1]
                         + turning[k, 2] * out[e, 2])


@kernel
def _factorize_dense(hessian, shift):
    dense, factor = hessian.dense, hessian.factor
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
            pivot = _TINY
        factor[i, i] = pivot
        negative += pivot <= 0
    return negative


@kernel
def _solve_dense(factor, right, out):
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
def multiply(system, hessian, vector, out):
    """Fill out (m, 3) = H vector (m, 3)."""
    if system.basis.shape[1] > 0:
        m = vector.shape[0]
        for i in range(3 * m):
            total = 0.0
            for k in range(3 * m):
                total += hessian.dense[i, k] * vector[k // 3, k % 3]
            out[i // 3, i % 3] = total
        return
    n = hessian.turning.shape[0]
    wide = hessian.turning.shape[1]
    theta = np.zeros(wide)
    after = np.zeros(wide)  # sum over f > e of cross_f^T vector_f
    for e in range(n):
        out[e] = hessian.diagonal[e] @ vector[e] + hessian.cross[e] @ theta
        theta += hessian.turning[e] @ vector[e]
    for e in range(n - 1, -1, -1):
        out[e] += hessian.turning[e].T @ after
        after += hessian.cross[e].T @ vector[e]


@kernel
def largest_turn(system, hessian, step):
    """Return the largest rotation in rad of any node that the step (m, 3) makes, to first order."""
    theta, largest = (0.0, 0.0, 0.0), 0.0
    turning, basis = hessian.turning, system.basis
    for e in range(turning.shape[0]):
        value = (at_element(basis, step, e, 0), at_element(basis, step, e, 1),
                 at_element(basis, step, e, 2))
        t = turning[e]
        theta = plus(theta, applied((t[0, 0], t[0, 1], t[0, 2], t[1, 0], t[1, 1], t[1, 2],
                                     t[2, 0], t[2, 1], t[2, 2]), value))
        largest = max(largest, inner(theta, theta))
    return np.sqrt(largest)
