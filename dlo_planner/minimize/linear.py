"""Solving with the Hessian H + shift I: Riccati sweep (local) or dense LDL^T (Ritz).

With prefix rotations theta_f = sum of turning_e dq_e over e < f, the local Newton system is a
linear-quadratic optimal control problem, solved by one backward and one forward sweep in O(N).
Both factorisations are congruences, so the signs of their pivots are the signs of the eigenvalues
(Sylvester): no negative pivot means a minimum.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from dlo_planner.energy.potential import element_hessian, unknown_count

_TINY = 1e-300


class Hessian(NamedTuple):
    """The Hessian at one state and its factorisation (arrays, refilled in place).

    Attributes:
        turning, cross, diagonal: (N, 3, 3) per element, see `ritz.kinematics.second_order`
        base: (3, 3) change of the moment on the gripper per rotation of it
        gain, inverse: (N, 3, 3) of the Riccati sweep; (0, 3, 3) for Ritz
        dense, factor: (3 m, 3 m) for Ritz; (0, 0) for local
    """

    turning: np.ndarray
    cross: np.ndarray
    diagonal: np.ndarray
    base: np.ndarray
    gain: np.ndarray
    inverse: np.ndarray
    dense: np.ndarray
    factor: np.ndarray


@njit(cache=True)
def new_hessian(system):
    """Return an empty Hessian of the right sizes."""
    n = system.lengths.size
    local = n if system.basis.shape[1] == 0 else 0
    size = 0 if local else 3 * unknown_count(system)
    return Hessian(np.empty((n, 3, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 3)),
                   np.empty((3, 3)), np.empty((local, 3, 3)), np.empty((local, 3, 3)),
                   np.empty((size, size)), np.empty((size, size)))


@njit(cache=True)
def assemble(system, state, hessian):
    """Fill the Hessian at `state`."""
    hessian.base[:] = element_hessian(system, state, hessian.turning, hessian.cross,
                                      hessian.diagonal)
    if system.basis.shape[1] > 0:
        _project(system.basis, hessian)


@njit(cache=True)
def _project(basis, hessian):
    """Fill hessian.dense (3 m, 3 m), unknown (j, i) at row 3 j + i, in O(N m^2)."""
    n, m = basis.shape
    prefix = np.zeros((m, 3, 3))  # sum over e < f of basis_e turning_e
    rows = np.empty((n, 9 * m))
    for f in range(n):
        turning, cross, diagonal = hessian.turning[f], hessian.cross[f], hessian.diagonal[f]
        for j in range(m):
            value = basis[f, j]
            for a in range(3):
                for b in range(3):
                    rows[f, 9 * j + 3 * a + b] = (
                        cross[a, 0] * prefix[j, 0, b] + cross[a, 1] * prefix[j, 1, b]
                        + cross[a, 2] * prefix[j, 2, b] + 0.5 * value * diagonal[a, b])
            for a in range(3):
                for b in range(3):
                    prefix[j, a, b] += value * turning[a, b]
    half = basis.T @ rows
    for k in range(m):
        for j in range(m):
            for a in range(3):
                for b in range(3):
                    hessian.dense[3 * k + a, 3 * j + b] = (half[k, 9 * j + 3 * a + b]
                                                           + half[j, 9 * k + 3 * b + a])


@njit(cache=True)
def factorise(system, hessian, shift):
    """Factorise H + shift I; return the number of pivots that are not positive."""
    if system.basis.shape[1] == 0:
        return _factorise_sweep(hessian, shift)
    return _factorise_dense(hessian, shift)


@njit(cache=True)
def solve(system, hessian, right, out):
    """Fill out (m, 3) with the solution of (H + shift I) out = right (m, 3)."""
    if system.basis.shape[1] == 0:
        _solve_sweep(hessian, right, out)
    else:
        _solve_dense(hessian.factor, right, out)


@njit(cache=True)
def _inverse3(a, out):
    """Fill out with the inverse of the symmetric 3 x 3 `a`; return its pivots <= 0."""
    d0 = a[0, 0]
    if d0 == 0.0:
        d0 = _TINY
    l10 = a[1, 0] / d0
    l20 = a[2, 0] / d0
    d1 = a[1, 1] - l10 * a[1, 0]
    if d1 == 0.0:
        d1 = _TINY
    middle = a[2, 1] - l20 * a[1, 0]
    l21 = middle / d1
    d2 = a[2, 2] - l20 * a[2, 0] - l21 * middle
    if d2 == 0.0:
        d2 = _TINY
    i0, i1, i2 = 1.0 / d0, 1.0 / d1, 1.0 / d2
    low = l10 * l21 - l20
    out[2, 2] = i2
    out[1, 2] = -l21 * i2
    out[0, 2] = low * i2
    out[1, 1] = i1 + l21 * l21 * i2
    out[0, 1] = -l10 * i1 - l21 * low * i2
    out[0, 0] = i0 + l10 * l10 * i1 + low * low * i2
    out[1, 0] = out[0, 1]
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    return (d0 <= 0) + (d1 <= 0) + (d2 <= 0)


@njit(cache=True)
def _factorise_sweep(hessian, shift):
    negative = 0
    value = np.zeros((3, 3))  # second derivative of the cost to go by theta
    pivot = np.empty((3, 3))
    coupling = np.empty((3, 3))
    for e in range(hessian.turning.shape[0] - 1, -1, -1):
        turning, cross = hessian.turning[e], hessian.cross[e]
        diagonal, gain, inverse = hessian.diagonal[e], hessian.gain[e], hessian.inverse[e]
        for i in range(3):
            v0 = (turning[0, i] * value[0, 0] + turning[1, i] * value[1, 0]
                  + turning[2, i] * value[2, 0])
            v1 = (turning[0, i] * value[0, 1] + turning[1, i] * value[1, 1]
                  + turning[2, i] * value[2, 1])
            v2 = (turning[0, i] * value[0, 2] + turning[1, i] * value[1, 2]
                  + turning[2, i] * value[2, 2])
            coupling[i, 0] = cross[i, 0] + v0
            coupling[i, 1] = cross[i, 1] + v1
            coupling[i, 2] = cross[i, 2] + v2
            for j in range(i + 1):
                pivot[i, j] = (diagonal[i, j] + v0 * turning[0, j] + v1 * turning[1, j]
                               + v2 * turning[2, j])
                pivot[j, i] = pivot[i, j]
            pivot[i, i] += shift
        negative += _inverse3(pivot, inverse)
        for i in range(3):
            for j in range(3):
                gain[i, j] = (inverse[i, 0] * coupling[0, j] + inverse[i, 1] * coupling[1, j]
                              + inverse[i, 2] * coupling[2, j])
        for i in range(3):
            for j in range(i + 1):
                value[i, j] -= (coupling[0, i] * gain[0, j] + coupling[1, i] * gain[1, j]
                                + coupling[2, i] * gain[2, j])
                value[j, i] = value[i, j]
    return negative


@njit(cache=True)
def _solve_sweep(hessian, right, out):
    r0 = r1 = r2 = 0.0
    for e in range(hessian.turning.shape[0] - 1, -1, -1):
        turning, gain, inverse = hessian.turning[e], hessian.gain[e], hessian.inverse[e]
        g0 = -right[e, 0] + turning[0, 0] * r0 + turning[1, 0] * r1 + turning[2, 0] * r2
        g1 = -right[e, 1] + turning[0, 1] * r0 + turning[1, 1] * r1 + turning[2, 1] * r2
        g2 = -right[e, 2] + turning[0, 2] * r0 + turning[1, 2] * r1 + turning[2, 2] * r2
        for i in range(3):
            out[e, i] = inverse[i, 0] * g0 + inverse[i, 1] * g1 + inverse[i, 2] * g2
        r0 -= gain[0, 0] * g0 + gain[1, 0] * g1 + gain[2, 0] * g2
        r1 -= gain[0, 1] * g0 + gain[1, 1] * g1 + gain[2, 1] * g2
        r2 -= gain[0, 2] * g0 + gain[1, 2] * g1 + gain[2, 2] * g2
    t0 = t1 = t2 = 0.0
    for e in range(hessian.turning.shape[0]):
        turning, gain = hessian.turning[e], hessian.gain[e]
        for i in range(3):
            out[e, i] = -out[e, i] - (gain[i, 0] * t0 + gain[i, 1] * t1 + gain[i, 2] * t2)
        t0 += turning[0, 0] * out[e, 0] + turning[0, 1] * out[e, 1] + turning[0, 2] * out[e, 2]
        t1 += turning[1, 0] * out[e, 0] + turning[1, 1] * out[e, 1] + turning[1, 2] * out[e, 2]
        t2 += turning[2, 0] * out[e, 0] + turning[2, 1] * out[e, 1] + turning[2, 2] * out[e, 2]


@njit(cache=True)
def _factorise_dense(hessian, shift):
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


@njit(cache=True)
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


@njit(cache=True)
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
    theta = np.zeros(3)
    after = np.zeros(3)  # sum over f > e of cross_f^T vector_f
    for e in range(n):
        out[e] = hessian.diagonal[e] @ vector[e] + hessian.cross[e] @ theta
        theta += hessian.turning[e] @ vector[e]
    for e in range(n - 1, -1, -1):
        out[e] += hessian.turning[e].T @ after
        after += hessian.cross[e].T @ vector[e]


@njit(cache=True)
def largest_turn(system, hessian, step):
    """Return the largest rotation in rad of any node that the step (m, 3) makes, to first order."""
    n, terms = system.basis.shape
    theta = np.zeros(3)
    largest = 0.0
    value = np.empty(3)
    for e in range(n):
        for i in range(3):
            if terms == 0:
                value[i] = step[e, i]
            else:
                value[i] = 0.0
                for j in range(terms):
                    value[i] += system.basis[e, j] * step[j, i]
        for i in range(3):
            theta[i] += (hessian.turning[e, i, 0] * value[0] + hessian.turning[e, i, 1] * value[1]
                         + hessian.turning[e, i, 2] * value[2])
        size = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
        largest = max(largest, size)
    return np.sqrt(largest)
