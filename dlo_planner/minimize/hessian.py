# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Hessian H at one shape: its blocks, its factorization and solutions with H + shift I.

With prefix rotations theta_f = sum of turning_e dq_e over e < f, the local Newton system is a
linear-quadratic optimal control problem, solved by one backward and one forward sweep in O(N)
(`riccati`); that of a series is dense (`dense`). Both factorizations are congruences, so the signs
of their pivots are the signs of the eigenvalues (Sylvester): no negative pivot means a minimum.
"""

import numpy as np

from dlo_planner.energy.potential import element_hessian, value_at
from dlo_planner.energy.problem import unknown_count
from dlo_planner.energy.terms import (
    Coupling,
    KKTBorder,
    add_stiffness,
    new_border,
    new_coupling,
    row_count,
    width,
)
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.coupling import (
    correct_for_pairs,
    coupled,
    fill_coupling,
    subtract_coupled,
    used_rows,
)
from dlo_planner.minimize.dense import add_products, factorized, project_all, solve_dense
from dlo_planner.minimize.kkt import (
    apply_kkt_border,
    complemented,
    fill_border,
    project_on_constraint,
    subtract_held,
)
from dlo_planner.minimize.riccati import (
    add_block_products,
    add_springs,
    factorize_blocks,
    factorize_dead_loads,
    solve_turns,
    solve_twists,
)
from dlo_planner.model.arrays import Floats

LEAST_SHIFT = 1e-3
_ALL = 2**62  # of the pivots may be negative
_SMALL = 1e-6    # a pivot that is smaller spoils a factorization; 1 is a rod that feels no load


class Hessian(Record):
    """The Hessian at one state and its factorization (arrays, refilled in place)."""

    # (N, w, 3) see `geometry.kinematics`; w is 3 for rotations alone, 6 for twists
    twist_jacobian: Floats
    cross: Floats  # (N, 3, w) likewise
    diagonal: Floats  # (N, 3, 3) likewise
    base: Floats  # (3, 3) change of the moment on the gripper per rotation of it
    gain: Floats  # (N, 3, w) of the Riccati sweep; empty for Ritz
    inverse: Floats  # (N, 3, 3) of the Riccati sweep; empty for Ritz
    # (N, 3, 3) of the Riccati sweep where only rotations count: I - twist_jacobian gain; else empty
    passed: Floats
    dense: Floats  # (3 m, 3 m) the whole Hessian, for Ritz; (0, 0) for local
    factor: Floats  # (3 m, 3 m) its factorization
    border: KKTBorder | None  # what is held; None: nothing
    coupling: Coupling | None  # what touches itself; None: nothing


@kernel
def new_hessian(system):
    """Return an empty Hessian of the right sizes."""
    n = system.lengths.size
    local = n if system.basis.shape[1] == 0 else 0
    m, wide = unknown_count(system), width(system.needs.displaced)
    size = 0 if local else 3 * m
    return Hessian(np.empty((n, wide, 3)), np.empty((n, 3, wide)), np.empty((n, 3, 3)),
                   np.empty((3, 3)), np.empty((local, 3, wide)), np.empty((local, 3, 3)),
                   np.empty((local if wide == 3 else 0, 3, 3)), np.empty((size, size)),
                   np.empty((size, size)),
                   new_border(system.needs.border, m), new_coupling(system.needs.coupling, m))


@kernel
def assemble(system, state, hessian):
    """Fill the Hessian at `state`."""
    element_hessian(system, state, hessian.twist_jacobian, hessian.cross, hessian.diagonal,
                    hessian.base)
    if system.basis.shape[1] > 0:
        _project(system, hessian, hessian.cross, hessian.diagonal)
    fill_border(system, state, hessian, hessian.border)
    fill_coupling(system, state, hessian.coupling)
    if system.basis.shape[1] == 0:
        _add_proximal(system, hessian.diagonal)


@kernel
def _project(system, hessian, cross, diagonal):
    """Fill the dense Hessian of a series from blocks of its elements."""
    project_all(system.basis, hessian.twist_jacobian, cross, diagonal, hessian.dense)
    if system.proximal_point.shape[0]:
        for i in range(hessian.dense.shape[0]):
            hessian.dense[i, i] += system.proximal_weight


@kernel
def _add_proximal(system, diagonal):
    if system.proximal_point.shape[0]:
        for e in range(system.lengths.size):
            for i in range(3):
                diagonal[e, i, i] += system.proximal_weight


@kernel
def factorize(system, hessian, shift):
    """Factorize H + shift I; return how many of its eigenvalues are not positive.

    Where the DLO is held these are the eigenvalues on what the grips leave free (Haynsworth).
    """
    negative = _factorize_without_border(system, hessian, None, shift, _ALL)
    return negative - _bordered(system, hessian, hessian.border)


@kernel
def factorize_with(system, hessian, springs, shift):
    """Do what `factorize` does with SpringBlocks as well, which the Hessian itself is without.

    So springs can change again and again, and all else is assembled once.
    """
    if system.basis.shape[1] > 0:
        cross, diagonal = hessian.cross.copy(), hessian.diagonal.copy()
        add_springs(hessian.twist_jacobian, springs, cross, diagonal)
        _project(system, hessian, cross, diagonal)
    negative = _factorize_without_border(system, hessian, springs, shift, _ALL)
    return negative - _bordered(system, hessian, hessian.border)


@kernel
def is_definite(system, hessian, shift):
    """Factorize H + shift I; return whether all its eigenvalues are positive, as `factorize`.

    Where they are not, the factorization is given up and of no use.
    """
    held = row_count(hessian.border)
    negative = _factorize_without_border(system, hessian, None, shift, held)
    return negative <= held and negative <= _bordered(system, hessian, hessian.border)


@kernel
def assembled_definite(system, state, hessian, shift):
    """Do what `assemble` and `is_definite` do, in one sweep where that can be.

    Where H + shift I is definite, blocks of the Hessian that solving does not need may be missing.
    """
    swept = is_fused(system)
    if swept and _definite_at_once(system, state, hessian, system.needs.displaced, shift):
        return True
    assemble(system, state, hessian)
    return not swept and is_definite(system, hessian, shift)


@kernel
def is_fused(system):
    """Whether the Hessian is assembled and factorized in one sweep: only dead loads act."""
    return system.needs.displaced is None and system.basis.shape[1] == 0


@kernel
def _definite_at_once(system, state, hessian, displaced, shift):
    """Return whether H + shift I is found to be definite in one sweep."""
    if displaced is None:
        diagonal = hessian.diagonal
        for e in range(diagonal.shape[0]):
            for i in range(3):
                for j in range(3):
                    diagonal[e, i, j] = 0.0
        add_stiffness(system.effects, system, state, diagonal)
        _add_proximal(system, diagonal)
        return factorize_dead_loads(system, state, hessian, shift)
    return False


@kernel
def _bordered(system, hessian, border):
    """Fill what is held into a factorization; return how many eigenvalues it keeps in place."""
    if border is None:
        return 0
    held = border.rows.shape[0]
    if held == 0:
        return 0
    for row in range(held):
        _solve_without_border(system, hessian, border.rows[row],
                              border.answers[row])
    return complemented(border)


@kernel
def _factorize_without_border(system, hessian, springs, shift, most):
    """Return how many eigenvalues are negative; give up where they are more than `most`.

    `springs`: SpringBlocks, which are in the dense Hessian of a series already, or None.
    """
    rows = used_rows(hessian.coupling)
    if rows > 0:
        most = _ALL  # pairs may hold what falls without them
    if system.basis.shape[1] > 0:
        negative = factorized(hessian.dense, hessian.factor, shift, most)
    else:
        negative = factorize_blocks(hessian, springs, shift, most)
    return negative + _added_by_pairs(system, hessian, hessian.coupling)


@kernel
def _added_by_pairs(system, hessian, coupling):
    """Fill what touches itself into a factorization; return how many eigenvalues it makes negative.

    They are fewer than none where pairs hold what falls without them.
    """
    if coupling is None:
        return 0
    for row in range(coupling.used[0]):
        _solve_without_pairs(system, hessian, coupling.rows[row], coupling.answers[row])
    return coupled(coupling)


@kernel
def solve(system, hessian, right, out):
    """Fill out (m, 3) with the solution of (H + shift I) out = right (m, 3).

    Where the DLO is held `out` keeps to what the grips leave free, and the equation holds there.
    """
    _solve_without_border(system, hessian, right, out)
    project_on_constraint(hessian.border, out)


@kernel
def solve_held(system, hessian, right, miss, out, reaction):
    """Fill out (m, 3) and reaction (K,), which bring a grip that is missed by `miss` (K,) to zero.

    To first order, and but for what the grip gives under the reaction.
    """
    _solve_without_border(system, hessian, right, out)
    for row in range(miss.size):
        reaction[row] = miss[row]
    apply_kkt_border(hessian.border, out, reaction)


@kernel
def compliance(system, hessian, loads):
    """Return (K, K): loads (m, 3, K) times the solutions of `solve` for them.

    With H = L D L^T these are products of L^-1 loads: half of the work of solutions.
    """
    size = loads.shape[2]
    products = np.zeros((size, size))
    if system.basis.shape[1] > 0:
        add_products(hessian.factor, loads, products)
    else:
        add_block_products(hessian, loads, products)
    subtract_coupled(hessian.coupling, loads, products)
    subtract_held(hessian.border, loads, products)
    return products


@kernel
def _solve_without_border(system, hessian, right, out):
    _solve_without_pairs(system, hessian, right, out)
    correct_for_pairs(hessian.coupling, out)


@kernel
def _solve_without_pairs(system, hessian, right, out):
    if system.basis.shape[1] > 0:
        solve_dense(hessian.factor, right, out)
    elif hessian.twist_jacobian.shape[1] == 6:
        solve_twists(hessian, right, out)
    else:
        solve_turns(hessian, right, out)


@kernel
def has_safe_pivots(hessian, border):
    """Whether a factorization without springs in a grip has no pivot that spoils it."""
    if border is None:
        return True
    if border.rows.shape[0] == 0:
        return True
    small, inverse = 0, hessian.inverse
    for i in range(hessian.factor.shape[0]):
        small += not abs(hessian.factor[i, i]) > _SMALL
    for e in range(inverse.shape[0]):
        for i in range(3):
            small += not abs(inverse[e, i, i]) * _SMALL < 1.0
    return small == 0


@kernel
def largest_turn(system, hessian, step):
    """Return the largest rotation in rad of any node that the step (m, 3) makes, to first order."""
    a = b = c = largest = 0.0
    jacobian, basis = hessian.twist_jacobian, system.basis
    for e in range(jacobian.shape[0]):
        x, y, z = value_at(basis, step, e)
        a += jacobian[e, 0, 0] * x + jacobian[e, 0, 1] * y + jacobian[e, 0, 2] * z
        b += jacobian[e, 1, 0] * x + jacobian[e, 1, 1] * y + jacobian[e, 1, 2] * z
        c += jacobian[e, 2, 0] * x + jacobian[e, 2, 1] * y + jacobian[e, 2, 2] * z
        square = a * a + b * b + c * c
        if not square <= largest:  # what is not a number has to be seen, too
            largest = square
    return np.sqrt(largest)


@kernel
def inertia_correction(system, hessian, shift):
    """Factorize with the first shift in a growing row that leaves no negative pivot."""
    while not is_definite(system, hessian, shift):
        shift = max(LEAST_SHIFT, 4.0 * shift)
        if shift > 1e12:
            factorize(system, hessian, shift)  # to its end, whatever it is
            break
    return shift
