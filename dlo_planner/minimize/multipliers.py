# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Constraints by multipliers: Newton's method inside, their update outside.

The augmented Lagrangian method (Nocedal and Wright, ch. 17.4): minimize, move each multiplier by
what its constraint is violated by, repeat until nothing is violated. The reaction of a held far
end is found with the shape (`minimize.held`). Between two minimizations the set of points that may
touch is looked at anew, and the limits of friction follow from the forces found. What is judged is
the residual with these limits: friction has no potential.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import next_touching, obstructed
from dlo_planner.energy.friction import trial_force
from dlo_planner.energy.hold import holds
from dlo_planner.energy.hold import violation as hold_violation
from dlo_planner.energy.outline import is_face, longest_stretch, node_gap, nodes_of
from dlo_planner.energy.rolling import watched
from dlo_planner.energy.system import State, System, hinged
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_forces import move_multipliers
from dlo_planner.minimize.friction import with_friction
from dlo_planner.minimize.held import HELD_NEUTRAL, held_descent, held_newton
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import descend, newton
from dlo_planner.minimize.residual import gradient_noise
from dlo_planner.minimize.saddle import kick
from dlo_planner.minimize.touching import truth
from dlo_planner.minimize.watching import watching
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.kinematics import point_inside

_ROUNDS = 100
_SLOW = 0.3         # a violation that falls less than this in a round needs a stiffer spring
_STIFFER = 10.0
_MOST_STIFFER = 1e2
_FIRM = 1e2         # times the stiffness of contacts' springs, where they are to hardly give
_MOST_KICKS = 10
_COARSER = 10.0     # times the tolerance: the springs' rounding errors leave no more of it
_STALLED = 100.0    # the same, where Newton's method has found no better point
_HELPS = 0.5        # an error that falls less in a round asks for smaller steps of the multipliers
_SHARES = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.125, 0.125, 0.0)  # after so many rounds in vain
_SHORT = 1e3        # times the tolerance: a residual that Newton's method did not bring down
_PATIENCE = 80      # Newton steps in a round, before it is looked at what touches
_NEWS = 3           # rounds in a row that go without multipliers, because of what has just touched


def constrained_newton(system: System, q: Floats, tolerance: float, max_iterations: int,
                       check: bool, exact: float, previous: Floats) -> Minimum:
    """Descend from q to a minimum that keeps all constraints.

    Parameters
    ----------
    system : System
        The DLO; the multipliers of its constraints are where the search begins.
    q : ndarray, shape (m, 3)
        Start, scaled unknowns.
    tolerance, max_iterations, check
        As of `newton.newton`.
    exact : float
        How far a constraint may be violated at the end, m.
    previous : ndarray, shape (N + 1, 6)
        Positions, m, relative to the gripper of this step, and tangents of the nodes before it,
        from which friction counts. (0, 6) if there is no step before.
    """
    if obstructed(system.contact):
        return _touching_newton(system, q, _COARSER * tolerance, max_iterations, check, exact,
                                previous)
    if _is_held(system):
        return held_newton(system, q, tolerance, exact, max_iterations, check)
    return newton(system, q, tolerance, max_iterations, check)


def _touching_newton(system: System, q: Floats, tolerance: float, max_iterations: int,
                     check: bool, exact: float, previous: Floats) -> Minimum:
    """Do the same among obstacles."""
    vain = news = iterations = kicks = 0
    best = before = np.inf
    stiffer, held = 1.0, _is_held(system)
    stability, judged = np.nan, False
    for _ in range(_ROUNDS):
        state, left, made = _descended(system, q, tolerance, exact,
                                       min(_PATIENCE, max_iterations - iterations))
        short = left > _SHORT * tolerance
        iterations += made
        q = state.q
        contacts, new = watching(system, state)
        news = news + 1 if new or short else 0
        # Without a past it has slid to where it needs no friction; on its way it keeps what it has.
        if len(previous) and not short:
            contacts = with_friction(system, contacts, state, previous)
        system = system._replace(contacts=contacts)
        state, residual, table, violation = truth(system, q)
        violation = max(violation, _off_its_grip(system, state))
        enough = residual < max(tolerance * (_COARSER if made else _STALLED),
                                gradient_noise(system, state))
        good = violation < exact and enough
        if iterations >= max_iterations or good and not check:
            break
        if good:
            stability, mode = _judged(system, state, tolerance, exact)
            judged = True
            pushed = None
            if stability <= -HELD_NEUTRAL and kicks < _MOST_KICKS:
                pushed = kick(system, state, mode)
            if pushed is None:
                break
            kicks += 1
            q, before, judged = pushed, np.inf, False
            continue
        wrong = max(violation / exact, residual / tolerance)
        vain = 0 if wrong < _HELPS * best else vain + 1
        best = min(wrong, best)
        solved = False
        if news % (_NEWS + 1) == 0:  # what is new has to bear before its force counts
            # a grip may need full steps again, once its reaction has changed
            share = vain % len(_SHARES) if held else min(vain, len(_SHARES) - 1)
            solved = move_multipliers(system, state, table, _SHARES[share])
        if (not solved and not held and news == 0 and violation > max(exact, _SLOW * before)
                and stiffer < _MOST_STIFFER):
            stiffer *= _STIFFER
            system = system._replace(contacts=system.contacts._replace(
                stiffness=_STIFFER * system.contacts.stiffness))
        before = violation if not solved and news == 0 else np.inf
    if check and not judged:
        stability, _ = _judged(system, state, tolerance, exact)
    final, residual, _, inside = truth(system, state.q)
    return Minimum(final, residual, stability, iterations, kicks, system, max(violation, inside))


def _is_held(system: System) -> bool:
    """Whether a far end's grip, or a hinge at the gripper, has a say."""
    return holds(system.hold) or bool(hinged(system))


def _descended(system: System, q: Floats, tolerance: float, exact: float,
               most: int) -> tuple[State, float, int]:
    """Return State, residual and steps of a descent with the contacts' multipliers as they are."""
    if _is_held(system):
        found = held_newton(system, q, tolerance, exact, most, False)
    else:
        found = newton(system, q, tolerance, most, False)
    return found.state, found.residual, found.iterations


def _off_its_grip(system: System, state: State) -> float:
    """Return how far, in m, the far end is from where it is held."""
    if not holds(system.hold):
        return 0.0
    return float(hold_violation(system.hold, state.rotations[-1].copy(),
                                state.positions[-1].copy()))


def _judged(system: System, state: State, tolerance: float,
            exact: float) -> tuple[float, Floats]:
    """Return the smallest eigenvalue, on what a grip leaves free, and its mode."""
    if _is_held(system):
        found = held_descent(system, state.q, tolerance, exact, 0, True)
    else:
        found = descend(system, state.q, tolerance, 0, True)
    return found.stability, found.mode


def firm(system: System, state: State) -> System:
    """Return the System with contacts so stiff that they hardly give, their forces the same."""
    if not obstructed(system.contact):
        return system
    contacts = system.contacts
    contacts = contacts._replace(node=contacts.node.copy(), multiplier=contacts.multiplier.copy(),
                                 shear=contacts.shear.copy())
    _keep_forces(system._replace(contacts=contacts), state, (_FIRM - 1) * contacts.stiffness)
    return system._replace(contacts=contacts._replace(stiffness=_FIRM * contacts.stiffness,
                                                      grip=_FIRM * contacts.grip))


@kernel
def _keep_forces(system: System, state: State, more: float) -> None:
    """Move the multipliers of what touches by what springs stiffer by `more` (N/m) would add.

    Those of friction get stiffer by the same part.
    """
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    k = contacts.stiffness
    x, normal, bend, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        if is_face(scene, o):
            continue
        longest = longest_stretch(scene, o, state.strains)
        begin, end = nodes_of(scene, o, system.lengths.size)
        node = max(1, begin)
        while node <= end:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           bend)
            if contacts.node[o, node] > k * gap:
                contacts.node[o, node] += more * gap
            node = next_touching(system.lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        e = contacts.element[c]
        if contacts.obstacle[c] >= 0:
            gap, _, _ = watched(scene, contacts, c, system.lengths, state.strains,
                                state.rotations, state.positions, normal, bend)
            if contacts.multiplier[c] > k * gap:
                contacts.multiplier[c] += more * gap
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     contacts.fraction[c], bend, x)
        if trial_force(contacts, c, x, normal) <= contacts.multiplier[c]:  # it sticks
            contacts.shear[c] -= more / k * (normal - contacts.shear[c])
