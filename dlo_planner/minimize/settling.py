# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that touches comes to rest: minimization and multipliers by turns, in one compiled loop.

The augmented Lagrangian method (Nocedal and Wright, ch. 17.4): minimize, move each multiplier by
what its constraint is violated by, repeat until nothing is violated. Between two minimizations the
set of points that may touch is looked at anew, and the limits of friction follow from the forces
found. What is judged is the residual with these limits: friction has no potential. Points that are
chosen anew each time may alternate without an end: by turns they are kept, too (`exchange`).

Where the DLO bears already, shape and forces are sought at once first (`minimize.resting`).
"""

import numpy as np

from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.grip import constraint_violation as hold_violation
from dlo_planner.energy.terms import row_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_forces import move_multipliers
from dlo_planner.minimize.convergence import gradient_noise
from dlo_planner.minimize.exchange import exchanged
from dlo_planner.minimize.friction import with_friction
from dlo_planner.minimize.hessian import assemble, new_hessian, safe_shift
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import (
    HELD_NEUTRAL,
    is_held,
    kicked,
    new_workspace,
    newton_descent,
    thorough,
)
from dlo_planner.minimize.touching import touching_system, truth
from dlo_planner.minimize.watching import watching

ROUNDS = 100
_TURN = 12          # rounds in which points are chosen anew, then as many in which they are kept
_SLOW = 0.3         # a violation that falls less than this in a round needs a stiffer spring
_STIFFER = 10.0
_MOST_STIFFER = 1e2
_CLOSE = 1e3        # times what is exact: a violation that the forces' laws are about to end
_OUTSIDE = 1e6      # the same: a DLO that is deeper inside an obstacle is on its way out
_MOST_KICKS = 10
_COARSER = 10.0     # times the tolerance: the springs' rounding errors leave no more of it
STALLED = 100.0    # the same, where Newton's method has found no better point
_HELPS = 0.5        # an error that falls less in a round asks for smaller steps of the multipliers
_SHARES = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.125, 0.125, 0.0)  # after so many rounds in vain
_SHORT = 1e3        # times the tolerance: a residual that Newton's method did not bring down
_PATIENCE = 80      # Newton steps in a round, before it is looked at what touches
_NEWS = 3           # rounds in a row that go without multipliers, because of what has just touched


@kernel
def settle(system, q, tolerance, exact, max_iterations, check, previous, rounds):
    """Descend from q (m, 3) among obstacles, in so many rounds at most.

    Other arguments as of `constrained_newton`.

    Returns
    -------
        state, residual, stability, iterations, kicks, system, violation: as of a Minimum
    """
    vain = news = kicks = iterations = 0
    best = before = violation = np.inf
    stiffer, held = 1.0, is_held(system)
    stability, judged, final = np.nan, False, False
    for turn in range(rounds):
        state, left, steps, contacts, new = _round(
            system, q, tolerance, exact, min(_PATIENCE, max_iterations - iterations), previous,
            turn // _TURN % 2 == 1 and violation < _OUTSIDE * exact)
        news = news + 1 if new or left > _SHORT * tolerance else 0
        iterations += steps
        q = state.q
        system = touching_system(system, contacts, system.effects.contact.scene)
        state, residual, table, violation = truth(system, q)
        violation = max(violation, _off_its_grip(system, state))
        enough = residual < max(tolerance * (_COARSER if steps else STALLED),
                                gradient_noise(system, state))
        good = violation < exact and enough
        if iterations >= max_iterations or good and not check:
            break
        if good:
            stability, mode = _judged(system, state, tolerance, exact)
            judged = final = True
            beside = np.empty_like(q)
            if (stability > -HELD_NEUTRAL or kicks >= _MOST_KICKS
                    or not kicked(system, state, mode, beside)):
                break
            kicks += 1
            q, before, judged, final = beside, np.inf, False, False
            continue
        wrong = max(violation / exact, residual / tolerance)
        vain = 0 if wrong < _HELPS * best else vain + 1
        best = min(wrong, best)
        solved = False
        if news % (_NEWS + 1) == 0:  # what is new has to bear before its force counts
            solved = move_multipliers(system, state, table, _share(vain, held), q, vain)
        if solved and stiffer > 1.0 and vain == 0 and violation < _CLOSE * exact:
            # stiff springs multiply rounding errors
            system, stiffer = _stiffened(system, 1.0 / stiffer), 1.0
        if (not solved and not held and news == 0 and violation > max(exact, _SLOW * before)
                and stiffer < _MOST_STIFFER):
            stiffer *= _STIFFER
            system = _stiffened(system, _STIFFER)
        before = violation if not solved and news == 0 else np.inf
    if check and not judged:
        stability, _ = _judged(system, state, tolerance, exact)
    if not final:  # the multipliers have moved since
        state, residual, _, inside = truth(system, state.q)
        violation = max(violation, inside)
    return state, residual, stability, iterations, kicks, system, violation


@kernel
def _round(system, q, tolerance, exact, most, previous, keeps):
    """Descend with the multipliers as they are, and look at what touches there.

    Parameters
    ----------
    keeps
        Whether points that are watched stay so, be they needed or not.

    Returns
    -------
        Configuration, its residual, steps made, Contacts, whether one of them is new
    """
    never = most < 0  # literals would be compiled for by themselves
    state, residual, _, steps, _, _, _ = newton_descent(
        system, q, thorough(tolerance, exact, most, never, never), new_workspace(system))
    contacts, new = exchanged(system, state) if keeps else watching(system, state)
    # Without a past it has slid to where it needs no friction; on its way it keeps what it has.
    if len(previous) and residual <= _SHORT * tolerance:
        contacts = with_friction(system, contacts, state, previous)
    return state, residual, steps, contacts, new


@kernel
def _share(vain, held):
    """Return how far multipliers move after so many rounds in vain."""
    # a grip may need full steps again, once its reaction has changed
    return _SHARES[vain % len(_SHARES) if held else min(vain, len(_SHARES) - 1)]


@kernel
def _off_its_grip(system, state):
    """Return how far, in m, the far end is from where it is held."""
    if row_count(system.needs.border) == 0:
        return 0.0
    return hold_violation(system.effects.hold, state.rotations[-1], state.positions[-1])


@kernel
def _judged(system, state, tolerance, exact):
    """Return the smallest eigenvalue, on what a grip leaves free, and its mode."""
    always, none = exact > 0.0, 0 * state.q.shape[0]
    if is_held(system):
        _, _, stability, _, mode, _, _ = newton_descent(
            system, state.q, thorough(tolerance, exact, none, always, not always),
            new_workspace(system))
    else:
        hessian = new_hessian(system)
        assemble(system, state, hessian)
        shift = safe_shift(system, hessian, 0.0)
        stability, mode = lowest_mode(system, hessian, shift, 1e-4)
    return stability, mode


@kernel
def _stiffened(system, factor):
    """Return the same Problem with springs at its contacts that are stiffer by a factor."""
    old = system.effects.contact.contacts
    contacts = ContactSet(factor * old.stiffness, old.node, old.element, old.obstacle,
                          old.multiplier, old.fraction, old.anchor, old.normal, old.shear, old.grip)
    return touching_system(system, contacts, system.effects.contact.scene)
