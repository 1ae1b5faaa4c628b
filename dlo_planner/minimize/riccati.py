# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Riccati sweeps: factorization and solution of a local Newton system in O(N)."""

import numpy as np

from dlo_planner.geometry.hessian import element_blocks
from dlo_planner.geometry.record import Record
from dlo_planner.geometry.so3 import (
    ZERO,
    added,
    applied,
    coefficients_in,
    matrix,
    minus,
    outer,
    plus,
    put_matrix,
    put_vector,
    subtracted,
    times,
    transposed,
    transposed_applied,
    transposed_times,
    vector,
    without_trace,
)
from dlo_planner.geometry.so3 import cross as crossed
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats

_CLEAR = 1e-3  # of the product of a diagonal: a determinant that has lost three digits at most
TINY = 1e-16  # of a pivot of zero, as rounding errors leave them: less would overflow further on


class SpringBlocks(Record):
    """Springs on nodes and on points inside elements that are not in a Hessian."""

    acts: Bools     # (N + 1,) whether a node has any
    twist: Floats   # (N + 1, 6, 6) second derivative by a node's twist, at the gripper's origin
    inside: Bools   # (N,) whether an element has any inside; these move with its first node as well
    cross: Floats   # (N, 3, 6) second derivative by an element's unknowns and that node's twist
    own: Floats     # (N, 3, 3) second derivative by an element's unknowns


@kernel
def no_springs(n):
    """Return empty SpringBlocks of N elements."""
    return SpringBlocks(np.zeros(n + 1, dtype=np.bool_), np.empty((n + 1, 6, 6)),
                        np.zeros(n, dtype=np.bool_), np.empty((n, 3, 6)), np.empty((n, 3, 3)))


@kernel(error_model='numpy', forceinline=True)
def inverse3(a):
    """Return the inverse of a symmetric matrix (9 numbers), and how many pivots are <= 0.

    By its minors where these lose few digits: a sweep waits for one division, not for three.
    """
    xx, yy, zz = a[1] * a[2] - a[5] * a[5], a[0] * a[2] - a[4] * a[4], a[0] * a[1] - a[3] * a[3]
    xy, xz, yz = a[4] * a[5] - a[3] * a[2], a[3] * a[5] - a[4] * a[1], a[3] * a[4] - a[0] * a[5]
    determinant = a[0] * xx + (a[3] * xy + a[4] * xz)
    if a[0] > 0.0 and zz > 0.0 and determinant > _CLEAR * (a[0] * (a[1] * abs(a[2]))):
        i = 1.0 / determinant
        xy, xz, yz = i * xy, i * xz, i * yz
        return (i * xx, xy, xz, xy, i * yy, yz, xz, yz, i * zz), 0
    return _inverse_by_pivots(a)


@kernel(error_model='numpy')
def _inverse_by_pivots(a):
    """Return what `inverse3` does, of any matrix."""
    d0 = a[0] if a[0] != 0.0 else TINY
    i0 = 1.0 / d0
    minor = d0 * a[1] - a[3] * a[3]  # not the pivot itself: the division need not wait for another
    minor = minor if minor != 0.0 else TINY * d0
    i1 = d0 / minor
    l10, l20 = a[3] * i0, a[4] * i0
    middle = a[5] - l20 * a[3]
    l21 = middle * i1
    d2 = a[2] - l20 * a[4] - l21 * middle
    d2 = d2 if d2 != 0.0 else TINY
    i2 = 1.0 / d2
    low = l10 * l21 - l20
    xy, xz, yz = -l10 * i1 - l21 * low * i2, low * i2, -l21 * i2
    inverse = (i0 + l10 * l10 * i1 + low * low * i2, xy, xz, xy, i1 + l21 * l21 * i2, yz,
               xz, yz, i2)
    # (in plain Python, where they are NumPy's, two truths would add up to one)
    return inverse, int(d0 <= 0) + int(minor * i0 <= 0) + int(d2 <= 0)


@kernel(forceinline=True)
def _less(value, coupling, gain):
    """Return the symmetric matrix value - coupling^T gain."""
    less = transposed_times(coupling, gain)
    xy, xz, yz = value[3] - less[3], value[6] - less[6], value[7] - less[7]
    return (value[0] - less[0], xy, xz, xy, value[4] - less[4], yz, xz, yz, value[8] - less[8])


@kernel(forceinline=True)
def _passed(turned, gain):
    """Return I - turned gain: the rotation beyond an element per one before it."""
    p = times(turned, gain)
    return (1.0 - p[0], -p[1], -p[2], -p[3], 1.0 - p[4], -p[5], -p[6], -p[7], 1.0 - p[8])


@kernel(forceinline=True)
def _with_springs_of_node(springs, node, turning, mixed, shifting):
    """Return the second derivative of a cost to go by a node's twist, and of its springs."""
    if springs is None:
        return turning, mixed, shifting
    if not springs.acts[node]:
        return turning, mixed, shifting
    more = springs.twist[node]
    return (added(turning, matrix(more)), added(mixed, matrix(more[:, 3:])),
            added(shifting, matrix(more[3:, 3:])))


@kernel(forceinline=True)
def _with_springs_inside(springs, e, own, by_turn, by_move):
    """Return an element's second derivatives by its unknowns, and by what moves it, with springs.

    These are to be added to what it has of springs beyond.
    """
    if springs is None:
        return own, by_turn, by_move
    if not springs.inside[e]:
        return own, by_turn, by_move
    return (added(own, matrix(springs.own[e])), added(by_turn, matrix(springs.cross[e])),
            added(by_move, matrix(springs.cross[e, :, 3:])))


@kernel
def factorize_blocks(hessian, springs, shift, most):
    """Factorize assembled blocks; give up where more than `most` pivots are negative.

    Blocks 6 wide, where displacements count as well, are two 3 wide, for rotation and displacement.
    `springs`: SpringBlocks that are not in them, or None. They join the cost to go at their nodes.
    """
    negative, wide = 0, hessian.twist_jacobian.shape[1] == 6
    turning, mixed, shifting = ZERO, ZERO, ZERO  # second derivative of the cost to go by a twist
    jacobians, crosses, diagonals = hessian.twist_jacobian, hessian.cross, hessian.diagonal
    gains, inverses, passed = hessian.gain, hessian.inverse, hessian.passed
    for k in range(jacobians.shape[0]):
        e = jacobians.shape[0] - 1 - k
        d, turn, by_move = matrix(diagonals[e]), matrix(jacobians[e]), ZERO
        turning, mixed, shifting = _with_springs_of_node(springs, e + 1, turning, mixed, shifting)
        by_turn = transposed_times(turn, turning)
        if wide:
            move = matrix(jacobians[e, 3:])
            by_turn = added(by_turn, transposed(times(mixed, move)))
            by_move = added(transposed_times(turn, mixed), transposed_times(move, shifting))
            d = added(d, times(by_move, move))
        p = added(d, times(by_turn, turn))
        p, by_turn, by_move = _with_springs_inside(springs, e, p, by_turn, by_move)
        inverse, below = inverse3((p[0] + shift, p[4] + shift, p[8] + shift, p[3], p[6], p[7]))
        negative += below
        if negative > most:
            break
        by_turn = added(by_turn, matrix(crosses[e]))
        gain = times(inverse, by_turn)
        put_matrix(inverse, inverses[e])
        put_matrix(gain, gains[e])
        turning = _less(turning, by_turn, gain)
        if wide:
            by_move = added(by_move, matrix(crosses[e, :, 3:]))
            beside = times(inverse, by_move)
            put_matrix(beside, gains[e, :, 3:])
            shifting = _less(shifting, by_move, beside)
            mixed = subtracted(mixed, transposed_times(by_turn, beside))
        else:
            put_matrix(_passed(turn, gain), passed[e])
    return negative


@kernel
def factorize_dead_loads(system, state, hessian, shift):
    """Return whether all pivots of H + shift I are positive, where nothing but dead loads acts.

    What `fill_blocks` and `factorize_blocks` do is one sweep here: the second derivative by
    rotations of what lies beyond an element is that of the loads and the cost to go, taken as one.
    The blocks themselves, `cross` and `diagonal`, are not filled; the latter has, at the beginning,
    the second derivatives by each element's own strain.
    """
    lengths, scale, pull, strains = system.lengths, system.scale, state.pull, state.strains
    rotations, positions, diagonals = state.rotations, state.positions, hessian.diagonal
    arcs = state.arcs
    jacobians, gains, inverses = hessian.twist_jacobian, hessian.gain, hessian.inverse
    passed = hessian.passed
    value, first = ZERO, ZERO
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(lengths.size):
        e = lengths.size - 1 - k
        d = diagonals[e]
        force = plus(force, vector(pull[e + 1]))
        turned, _, coupling, p = element_blocks(
            lengths[e], vector(strains[e]), coefficients_in(arcs[e]), vector(scale[e]),
            matrix(rotations[e]), force, moment, added(value, without_trace(first)))
        inverse, below = inverse3((d[0, 0] + p[0] + shift, d[1, 1] + p[1] + shift,
                                    d[2, 2] + p[2] + shift, d[0, 1] + p[3], d[0, 2] + p[4],
                                    d[1, 2] + p[5]))
        put_matrix(turned, jacobians[e])
        if below > 0:
            return False
        gain = times(inverse, coupling)
        put_matrix(inverse, inverses[e])
        put_matrix(gain, gains[e])
        put_matrix(_passed(turned, gain), passed[e])
        value = _less(value, coupling, gain)
        along = (positions[e + 1, 0] - positions[e, 0], positions[e + 1, 1] - positions[e, 1],
                 positions[e + 1, 2] - positions[e, 2])
        first = added(first, outer(force, along))
        moment = plus(moment, crossed(along, force))
    return True


@kernel
def solve_turns(hessian, right, out):
    """Solve where only rotations count.

    What one element hands to the next follows from what it was handed by `passed` alone: the rest
    of the work need not wait for it.
    """
    jacobians, gains, inverses = hessian.twist_jacobian, hessian.gain, hessian.inverse
    passed = hessian.passed
    n = jacobians.shape[0]
    to_go = (0.0, 0.0, 0.0)  # slope of the cost to go by theta, negated
    for k in range(n):
        e = n - 1 - k
        own = vector(right[e])
        less = transposed_applied(matrix(gains[e]), own)
        turned = transposed_applied(matrix(jacobians[e]), to_go)
        put_vector(applied(matrix(inverses[e]), plus(own, turned)), out[e])
        kept = transposed_applied(matrix(passed[e]), to_go)
        to_go = minus(kept, less)
    theta = (0.0, 0.0, 0.0)
    for e in range(n):
        half = vector(out[e])
        less = applied(matrix(gains[e]), theta)
        put_vector(minus(half, less), out[e])
        theta = plus(applied(matrix(passed[e]), theta), applied(matrix(jacobians[e]), half))


@kernel
def answer_to_turn(hessian, axis, answer):
    """Fill the change (m, 3) of the equilibrium per rotation of the gripper about a world axis.

    That is a turn of all that lies before the first element: the sweep of `solve_turns` to the free
    end begins with it.
    """
    jacobians, gains = hessian.twist_jacobian, hessian.gain
    theta = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
    for e in range(answer.shape[0]):
        less = applied(matrix(gains[e]), theta)
        step = (-less[0], -less[1], -less[2])
        put_vector(step, answer[e])
        theta = plus(theta, applied(matrix(jacobians[e]), step))


@kernel
def solve_twists(hessian, right, out):
    """Solve where displacements count as well."""
    jacobians, gains, inverses = hessian.twist_jacobian, hessian.gain, hessian.inverse
    n = jacobians.shape[0]
    moment, force = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # slope of the cost to go by a twist, negated
    for k in range(n):
        e = n - 1 - k
        own = plus(vector(right[e]), plus(transposed_applied(matrix(jacobians[e]), moment),
                                          transposed_applied(matrix(jacobians[e, 3:]), force)))
        put_vector(applied(matrix(inverses[e]), own), out[e])
        moment = minus(moment, transposed_applied(matrix(gains[e]), own))
        force = minus(force, transposed_applied(matrix(gains[e, :, 3:]), own))
    turn, move = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(n):
        own = minus(vector(out[e]), plus(applied(matrix(gains[e]), turn),
                                        applied(matrix(gains[e, :, 3:]), move)))
        put_vector(own, out[e])
        turn = plus(turn, applied(matrix(jacobians[e]), own))
        move = plus(move, applied(matrix(jacobians[e, 3:]), own))


@kernel
def add_block_products(hessian, loads, products):
    """Add loads (N, 3, K) times the solutions for them to products (K, K).

    One sweep of all of them: what is the same for each is read once, and sums stand side by side.
    """
    jacobians, gains, inverses = hessian.twist_jacobian, hessian.gain, hessian.inverse
    (n, _, size), wide = loads.shape, jacobians.shape[1]
    beyond, own, answer = np.zeros((wide, size)), np.empty((3, size)), np.empty((3, size))
    for r in range(n):
        e = n - 1 - r
        jacobian, gain, inverse = jacobians[e], gains[e], inverses[e]
        for i in range(3):
            for p in range(size):
                own[i, p] = loads[e, i, p]
            for k in range(0, wide, 3):
                a, b, c = jacobian[k, i], jacobian[k + 1, i], jacobian[k + 2, i]
                for p in range(size):
                    own[i, p] += a * beyond[k, p] + b * beyond[k + 1, p] + c * beyond[k + 2, p]
        for i in range(wide):
            a, b, c = gain[0, i], gain[1, i], gain[2, i]
            for p in range(size):
                beyond[i, p] -= a * own[0, p] + b * own[1, p] + c * own[2, p]
        for i in range(3):
            a, b, c = inverse[i, 0], inverse[i, 1], inverse[i, 2]
            for p in range(size):
                answer[i, p] = a * own[0, p] + b * own[1, p] + c * own[2, p]
        for k in range(size):
            a, b, c = own[0, k], own[1, k], own[2, k]
            for p in range(size):
                products[k, p] += a * answer[0, p] + b * answer[1, p] + c * answer[2, p]


@kernel
def add_springs(jacobians, springs, cross, diagonal):
    """Add SpringBlocks to the blocks (N, 3, 6) and (N, 3, 3) of a Hessian, see `geometry.hessian`.

    Twists go along by `jacobians` (N, 6, 3).
    """
    beyond, through = np.zeros((6, 6)), np.empty((3, 6))
    n = cross.shape[0]
    for k in range(n):
        e = n - 1 - k
        jacobian = jacobians[e]
        if springs.acts[e + 1]:
            for i in range(6):
                for j in range(6):
                    beyond[i, j] += springs.twist[e + 1, i, j]
        for b in range(3):
            for j in range(6):
                through[b, j] = 0.0
                for i in range(6):
                    through[b, j] += jacobian[i, b] * beyond[i, j]
                cross[e, b, j] += through[b, j]
            for c in range(3):
                for i in range(6):
                    diagonal[e, b, c] += through[b, i] * jacobian[i, c]
        if springs.inside[e]:
            for b in range(3):
                for j in range(6):
                    cross[e, b, j] += springs.cross[e, b, j]
                for c in range(3):
                    diagonal[e, b, c] += springs.own[e, b, c]
