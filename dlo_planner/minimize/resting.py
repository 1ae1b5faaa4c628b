# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that bears on obstacles comes to rest: at once where it can, else by turns.

Shape and forces are sought at once first (`minimize.bearing`). What that finds is judged like any
other minimum: the points that bear are those that `watching` chooses, nothing else is pressed in,
and the shape stands. Mostly nothing is left to be done; else `minimize.settling` does it.
"""

import numpy as np

from dlo_planner.energy.problem import new_configuration
from dlo_planner.geometry.so3 import matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.minimize.bearing import borne, carried
from dlo_planner.minimize.convergence import gradient_noise
from dlo_planner.minimize.hessian import assemble, is_definite, safe_shift
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import HARDLY, HELD_NEUTRAL, WELL_STABLE, is_held
from dlo_planner.minimize.settling import ROUNDS, STALLED, settle
from dlo_planner.minimize.watching import watching

_FEW, _SOON = 12, 40  # rounds and steps in which a DLO that goes on bearing has to come to rest
_ON_A_WAY = 20      # steps: who allows no more wants no equilibrium


@kernel
def touch_down(system, q, tolerance, exact, max_iterations, check, previous):
    """Do as `settle` does, but seek shape and forces at once before, where the DLO bears."""
    before = 0
    if not is_held(system) and max_iterations > _ON_A_WAY:
        bears, state, residual, stability, steps, kicks, loaded, violation = _at_once(
            system, q, tolerance, exact, max_iterations, check, previous)
        if bears:
            return state, residual, stability, steps, kicks, loaded, violation
        before = steps
    state, residual, stability, steps, kicks, loaded, violation = settle(
        system, q, tolerance, exact, max_iterations, check, previous, ROUNDS)
    return state, residual, stability, steps + before, kicks, loaded, violation


@kernel
def bear_on(system, base, slid, strains, shift, tolerance, exact, max_iterations, previous):
    """Return whether a DLO that bears goes on bearing, and what `settle` returns from there.

    Args:
        system, base, slid, strains: as of `carried`
        shift: (3,) displacement of the gripper, m; others as of `constrained_newton`
    """
    twist = np.empty(6)
    put_vector(rotation_vector(times_transposed(matrix(system.base), matrix(base))), twist)
    twist[3:] = shift
    follows, q = carried(system, base, slid, strains, twist)
    if follows:
        return _at_once(system, q, tolerance, exact, max_iterations, follows, previous)
    return False, new_configuration(system), np.inf, np.nan, 0, 0, system, np.inf


@kernel
def _at_once(system, q, tolerance, exact, max_iterations, check, previous):
    """Return whether a DLO that bears comes to rest from q (m, 3), and what `settle` returns.

    Arguments as of `constrained_newton`.
    """
    bears, state, residual, violation, loaded, hessian, turned, steps = borne(
        system, q, tolerance, exact, previous)
    stability, kicks, moves = np.nan, 0, 0
    if bears and not _bears_there(loaded, state, exact):
        state, residual, stability, moves, kicks, loaded, violation = settle(
            loaded, state.q, tolerance, exact, min(_SOON, max_iterations), check, previous, _FEW)
        bears = kicks == 0 and _rests(loaded, state, residual, stability, violation, tolerance,
                                      exact)
    elif bears and check:
        stability = _stability(loaded, state, hessian, turned)
        bears = stability > -HELD_NEUTRAL
    return bears, state, residual, stability, steps + moves, kicks, loaded, violation


@kernel
def _bears_there(system, state, exact):
    """Whether the points that bear are those that `watching` would choose, multipliers and all.

    And nothing else is deeper in an obstacle than `exact`, m. What is pushes from now on.
    """
    old = system.effects.contact.contacts
    if _buried(old, exact):
        return False
    node = old.node.copy()
    new, news = watching(system, state)
    same = not news and new.element.size == old.element.size
    for c in range(old.element.size if same else 0):
        same = same and (new.element[c] == old.element[c] and new.obstacle[c] == old.obstacle[c]
                         and new.fraction[c] == old.fraction[c]
                         and new.multiplier[c] == old.multiplier[c])
    for o in range(node.shape[0]):
        for k in range(node.shape[1]):
            same = same and node[o, k] == old.node[o, k]
    if not same:
        old.node[:] = node
        _let_push(old)
    return same


@kernel
def _buried(contacts, exact):
    """Whether what `borne` kept from pushing is deeper than `exact`, m; then it pushes, in place.

    A multiplier below zero holds back the force of a spring that an obstacle presses on.
    """
    least = 0.0
    for o in range(contacts.node.shape[0]):
        for k in range(contacts.node.shape[1]):
            least = min(least, contacts.node[o, k])
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            least = min(least, contacts.multiplier[c])
    buried = least < -contacts.stiffness * exact
    if buried:
        _let_push(contacts)
    return buried


@kernel
def _let_push(contacts):
    """Take back the multipliers below zero, in place."""
    for o in range(contacts.node.shape[0]):
        for k in range(contacts.node.shape[1]):
            contacts.node[o, k] = max(0.0, contacts.node[o, k])
    for c in range(contacts.element.size):
        contacts.multiplier[c] = max(0.0, contacts.multiplier[c])


@kernel
def _stability(system, state, hessian, turned):
    """Return the smallest eigenvalue, by a factorization from which the DLO has hardly turned."""
    if turned < HARDLY and is_definite(system, hessian, 0.0):
        stability, _ = lowest_mode(system, hessian, 0.0, 1e-4)
        if stability > WELL_STABLE:
            return stability
    assemble(system, state, hessian)
    stability, _ = lowest_mode(system, hessian, safe_shift(system, hessian, 0.0), 1e-4)
    return stability


@kernel
def _rests(system, state, residual, stability, violation, tolerance, exact):
    """Whether nothing is left to be done, and the shape stands; a stability of nan is not known."""
    return (violation < exact and not stability <= -HELD_NEUTRAL
            and residual < max(tolerance * STALLED, gradient_noise(system, state)))
