# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO between two grips that have moved a little: from its shape before to the next, at once.

Newton's method for shape and reaction, without springs in the grip: then displacements of what lies
beyond an element do not matter, and the Hessian's blocks are 3 wide. What the springs would add is
zero on what the grip leaves free, so neither the steps nor the eigenvalues there depend on them.
Without them the Hessian may be indefinite. Its factorization is a congruence nevertheless, and is
used only where no pivot is small.

Each step has to be much smaller than the one before (Deuflhard, Newton Methods for Nonlinear
Problems, ch. 2: the natural monotonicity test), and the end a minimum that is well stable. What is
not quite so simple is left to `minimize.held`, with all its guards.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.effects import Border, fill_rows, potential, stored
from dlo_planner.energy.hold import Hold, fill_miss
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.system import State, System, new_state, regripped_system, unknown_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import project_rows
from dlo_planner.minimize.linear import (
    Hessian,
    assemble,
    factorize,
    largest_turn,
    new_hessian,
    solve_held,
)
from dlo_planner.minimize.newton import without_traces
from dlo_planner.minimize.residual import gradient_noise, residual_of
from dlo_planner.minimize.spectrum import lowest_mode
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arc import coefficients_in, jacobians_with
from dlo_planner.ritz.arrays import put_sum, scaled_by
from dlo_planner.ritz.matrix3 import columns_scaled, matrix, times

_MISSED = 0.08   # of the length: a grip that is farther away has not moved a little
_NEAR = 0.3      # rad, of any node, in all steps together
_FEW = 8         # steps in which the end has to be found
_LESS = 0.25     # of a step: the next one at most
_HARDLY = 2e-5   # rad: a step that changes the Hessian by about as little
_SMALL = 1e-6    # a pivot that is smaller spoils a factorization; 1 is a rod that feels no load
_STABLE = 0.01   # the smallest eigenvalue at least
_BLURRED = 1e-5  # a residual that rounding may make larger than this tells nothing


@kernel
def hold_on(system: System, base: Floats, origin: Floats, place: Floats, axes: Floats,
            share: Floats, rows: Floats, strains: Floats, force: Floats, tolerance: float,
            exact: float) -> tuple[bool, Floats, Floats, Floats, Floats, Floats, float, float,
                                   float, float, int, float]:
    """Return the equilibrium between two grips next to given strains, if it is near.

    Args:
        system: System without obstacles, its far end free; its `base` and `origin` are not used
        base: (3, 3), read-only, rotation of the gripper; origin: (3,), read-only, its position, m
        place: (3,), read-only, where the far end is held, m; axes: (3, 3), read-only, its frame
        share: (3,), rows: (K, 6), of the Hold
        strains: (N, 3), read-only, of the shape before, 1/m
        force: (K,), read-only, forces of the grip before, N
        tolerance: of the residual
        exact: by how much the grip may be missed, m

    Returns
    -------
    found : bool
        Whether there is one; if not, nothing else means anything.
    strains : ndarray, shape (N, 3)
        Strains of the elements, 1/m.
    rotations : ndarray, shape (N + 1, 3, 3)
        Frames of the nodes.
    positions : ndarray, shape (N + 1, 3)
        Positions of the nodes, world, m.
    wrenches : ndarray, shape (2, 6)
        Force and moment of the gripper on the DLO, and of the far end's grip, N, N m.
    force : ndarray, shape (K,)
        Forces of the grip, N.
    elastic, energy : float
        Energy that is stored in the DLO, and all with the dead loads' potential, J.
    residual, stability, steps
        As of `newton.newton`.
    missed : float
        By how much the grip is missed, m.
    """
    target = np.empty(3)
    for i in range(3):
        target[i] = place[i] - origin[i]
    hold = Hold(target, axes.copy(), share, rows, force.copy(), 0.0, 0.0)
    held = regripped_system(system, base.copy(), hold)
    q = np.empty((unknown_count(held), 3))
    unknowns_of(held, strains.copy(), q)
    found, state, residual, stability, steps, missed = _nearby(held, q, tolerance, exact)
    positions, wrenches, attached = state.positions, np.empty((2, 6)), state.attached
    for k in range(positions.shape[0]):
        for i in range(3):
            positions[k, i] += origin[i]
    for i in range(3):
        wrenches[0, i], wrenches[0, 3 + i] = state.base_force[i], state.base_moment[i]
        wrenches[1, i], wrenches[1, 3 + i] = -attached.tip_force[i], -attached.tip_moment[i]
    elastic = stored(held.effects, held, state.strains)
    energy = elastic + potential(held.effects, held, positions)
    return (found, state.strains, state.rotations, positions, wrenches, hold.multiplier, elastic,
            energy, residual, stability, steps, missed)


@kernel
def _nearby(system: System, q: Floats, tolerance: float,
            exact: float) -> tuple[bool, State, float, float, int, float]:
    """Return if there is a minimum next to q (m, 3), its State, and what else `hold_on` says."""
    hold, last, length = system.effects.hold, system.lengths.size, np.sum(system.lengths)
    state, free = new_state(system), new_hessian(system)
    hessian = _bordered(free, hold.multiplier.size, q.shape[0])
    miss, reaction = np.empty(hold.multiplier.size), np.empty(hold.multiplier.size)
    step = np.empty_like(q)
    without_traces(q, state.q)
    evaluate(system, state)
    steps, turn, turned, whole, stability = 0, np.inf, np.inf, 0.0, np.nan
    while True:
        fill_miss(hold, state.rotations[last], state.positions[last], miss)
        missed, residual = np.sqrt(np.sum(miss * miss)), residual_of(system, state)
        if steps == _FEW or not missed < _MISSED * length:
            return False, state, residual, stability, steps, missed
        if turned > _HARDLY:
            turned = 0.0
            if not _factorized(system, state, free, hessian):
                return False, state, residual, stability, steps, missed
        if missed < exact and residual < max(tolerance, gradient_noise(system, state)):
            break
        scaled_by(-1.0, state.gradient)
        solve_held(system, hessian, state.gradient, miss, step, reaction)
        before, turn = turn, largest_turn(system, hessian, step)
        whole, turned = whole + turn, turned + turn
        if not (turn < _LESS * before and whole < _NEAR):
            return False, state, residual, stability, steps, missed
        put_sum(state.q, 1.0, step, state.q)
        for row in range(reaction.size):
            hold.multiplier[row] += reaction[row]
        evaluate(system, state)
        steps += 1
    if not gradient_noise(system, state) < _BLURRED:
        return False, state, residual, stability, steps, missed
    stability, _ = lowest_mode(system, hessian, 0.0, 1e-4)
    return stability > _STABLE, state, residual, stability, steps, missed


@kernel
def _bordered(free, held, unknowns):
    """Return a Hessian on the same arrays, bordered by the rows of a grip that holds K motions."""
    border = Border(np.empty((held, unknowns, 3)), np.empty((held, unknowns, 3)),
                    np.empty((held, held)), np.zeros(1))
    return Hessian(free.twist_jacobian, free.cross, free.diagonal, free.base, free.gain,
                   free.inverse, free.passed, free.dense, free.factor, border,
                   free.displaced, free.vertical)


@kernel
def _factorized(system, state, free, hessian):
    """Factorize the Hessian at `state`; return whether it is positive there, and well factorized.

    Positive on what the grip leaves free.
    """
    assemble(system, state, free)
    fill_rows_of_turns(system, state, hessian.twist_jacobian, hessian.border.rows)
    if factorize(system, hessian, 0.0) != 0:
        return False
    small, inverse = 0, hessian.inverse
    for i in range(hessian.factor.shape[0]):
        small += not abs(hessian.factor[i, i]) > _SMALL
    for e in range(inverse.shape[0]):
        for i in range(3):
            small += not abs(inverse[e, i, i]) * _SMALL < 1.0
    return small == 0


@kernel
def fill_rows_of_turns(system: System, state: State, turning: Floats, rows: Floats) -> None:
    """Fill rows (K, m, 3): derivatives of what is held of the far end by the unknowns.

    As `border.fill_border`, where the blocks `turning` (N, 3, 3) are of rotations alone.
    """
    n, held = system.lengths.size, rows.shape[0]
    twists, values = np.empty((held, 6)), np.empty((n, held, 3))
    fill_rows(system.effects, state.rotations[n], state.positions[n], twists)
    for e in range(n):
        h, u, x, scale = (system.lengths[e], state.strains[e], state.positions[e + 1],
                          system.scale[e])
        _, chord = jacobians_with(h * u[0], h * u[1], h * u[2], h, coefficients_in(state.arcs[e]))
        moved = columns_scaled(times(matrix(state.rotations[e]), chord), h * scale[0],
                               h * scale[1], h * scale[2])
        turned = matrix(turning[e])
        for row in range(held):
            f0, f1, f2 = twists[row, 3], twists[row, 4], twists[row, 5]
            m0 = twists[row, 0] - x[1] * f2 + x[2] * f1  # about the end of the element
            m1 = twists[row, 1] - x[2] * f0 + x[0] * f2
            m2 = twists[row, 2] - x[0] * f1 + x[1] * f0
            for i in range(3):
                values[e, row, i] = (turned[i] * m0 + turned[3 + i] * m1 + turned[6 + i] * m2
                                     + moved[i] * f0 + moved[3 + i] * f1 + moved[6 + i] * f2)
    project_rows(system.basis, values, rows)
