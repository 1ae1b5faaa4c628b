# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that touches comes to rest: shape and forces at once where it can, else by turns.

Shape and forces are sought at once first (`minimize.semismooth`). What that finds is judged as
any other minimum: the points that bear are those that `active_set` chooses, and the shape stands.
Mostly nothing is left to be done; else the augmented Lagrangian method does it (Nocedal and Wright,
ch. 17.4): minimize, move each multiplier by what its constraint is violated by, repeat until
nothing is violated. Between two minimizations the active set is looked at anew, and the limits of
friction follow from the forces found. What is judged is the residual with these limits: friction
has no potential.

Both are needed: between two grips turns often go on without an end, so that forces are sought at
once from several starts there; but only turns bring out what begins deep inside an obstacle. Where
turns end nowhere, as where friction holds back a fall, the DLO is brought nearer to rest first
(`minimize.relaxation`).
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import obstructed, trial_traction
from dlo_planner.energy.gap import closest_point
from dlo_planner.energy.grip import holds, reaction_of, set_reaction
from dlo_planner.energy.problem import Configuration, Problem, hinged, new_configuration
from dlo_planner.energy.terms import row_count
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import copy
from dlo_planner.geometry.so3 import matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import enlarge_active_set, free_to_roll, update_active_set
from dlo_planner.minimize.contact_table import (
    kkt_residual,
    touching,
    update_friction,
    with_contacts,
    with_springs,
    with_stiffness,
)
from dlo_planner.minimize.convergence import Minimum, gradient_noise
from dlo_planner.minimize.hessian import is_definite
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import (
    HARDLY,
    HELD_NEUTRAL,
    WELL_STABLE,
    is_held,
    leave_saddle,
    new_workspace,
    newton,
    newton_descent,
    thorough,
)
from dlo_planner.minimize.relaxation import relax
from dlo_planner.minimize.semismooth import (
    forces,
    place,
    put_forces,
    semismooth_newton,
    tangent_predictor,
    update_multipliers,
)
from dlo_planner.model.arrays import Floats

_FIRM = 1e2      # times the stiffness of contacts' springs, where they are to hardly give
COARSER = 10.0  # times the tolerance: the springs' rounding errors leave no more of it
_FEW, _SOON = 12, 40  # rounds and steps in which a DLO that goes on bearing has to come to rest
_STARTS = 8         # between two grips, see `_starts`
_EXCHANGES = 6      # of points that bear, with forces at once; then by turns
_ON_A_WAY = 20      # steps: who allows no more wants no equilibrium
_BETWEEN_GRIPS = 100  # the same: what is deep inside an obstacle comes out by springs
_ROUNDS = 100
# How nearly a DLO is brought to rest, in how many steps, and from when on it slides there; then
# forces are sought at once, where points are kept after so many exchanges.
_ROUGH, _MOST, _SLIDES, _CHOICES = (1e-3, 1e-6, 1e-6), (60, 100, 400), 2, 3
_TURN = 12          # rounds in which points are chosen anew, then as many in which they are kept
_SLOW = 0.3         # a violation that falls less than this in a round needs a stiffer spring
_STIFFER = 10.0
_MOST_STIFFER = 1e2
_CLOSE = 1e3        # times what is exact: a violation that the forces' laws are about to end
_OUTSIDE = 1e6      # the same: a DLO that is deeper inside an obstacle is on its way out
_MOST_KICKS = 10
_STALLED = 100.0    # the same, where Newton's method has found no better point
_HELPS = 0.5        # an error that falls less in a round asks for smaller steps of the multipliers
_SHARES = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.125, 0.125, 0.0)  # after so many rounds in vain
_SHORT = 1e3        # times the tolerance: a residual that Newton's method did not bring down
_PATIENCE = 80      # Newton steps in a round, before it is looked at what touches
_NEWS = 3           # rounds in a row that go without multipliers, because of what has just touched


def constrained_newton(system: Problem, q: Floats, tolerance: float, max_iterations: int,
                       check: bool, exact: float, previous: Floats) -> Minimum:
    """Descend from q to a minimum that keeps all constraints.

    Shapes: q (m, 3), previous (N + 1, 6).
    """
    if obstructed(system.contact):
        end = solve_contact(system, q, COARSER * tolerance, exact, max_iterations, check, previous)
        return Minimum(*end)
    return newton(system, q, tolerance, max_iterations, check,
                  exact if holds(system.hold) or hinged(system) else 0.0)


def stiffen_penalty(system: Problem, state: Configuration) -> Problem:
    """Return the Problem with contacts so stiff that they hardly give, their forces the same."""
    if not obstructed(system.contact):
        return system
    contacts = system.contacts
    contacts = contacts._replace(node=contacts.node.copy(), multiplier=contacts.multiplier.copy(),
                                 shear=contacts.shear.copy())
    _keep_forces(system._replace(contacts=contacts), state, (_FIRM - 1) * contacts.stiffness)
    return system._replace(contacts=contacts._replace(stiffness=_FIRM * contacts.stiffness,
                                                      grip=_FIRM * contacts.grip))


@kernel
def _keep_forces(system: Problem, state: Configuration, more: float) -> None:
    """Move the multipliers of what touches by what springs stiffer by `more` (N/m) would add.

    Those of friction get stiffer by the same part.
    """
    contacts, rotation, x, trial = (system.effects.contact.contacts, np.empty((3, 3)), np.empty(3),
                                    np.empty(3))
    table = touching(system.effects.contact.scene, contacts, system.lengths, state)
    for a in range(table.gap.size):
        if table.inside[a] < 0:
            contacts.node[table.obstacle[a], table.element[a] + 1] += more * table.gap[a]
        else:
            contacts.multiplier[table.inside[a]] += more * table.gap[a]
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        if trial_traction(contacts, c, x, trial) <= contacts.multiplier[c]:  # it sticks
            contacts.shear[c] -= more / contacts.stiffness * (trial - contacts.shear[c])


@kernel
def solve_contact(system, q, tolerance, exact, max_iterations, check, previous):
    """Do as `augmented_lagrangian`, but seek shape and forces at once before, where it bears."""
    before, hold = 0, system.effects.hold
    reaction = reaction_of(hold, row_count(system.needs.border))
    there, begin = system, q
    for start in _starts(system, max_iterations):
        if start > 0:
            touches, steps, there, begin = _pressed(there, begin, tolerance, exact, max_iterations,
                                                    previous)
            before += steps
            if not touches:
                break
        rests, state, residual, stability, steps, kicks, loaded, violation = _at_once(
            there, begin, False, tolerance, exact, max_iterations, check, previous)
        before += steps
        if rests:
            return state, residual, stability, before, kicks, loaded, violation
    set_reaction(hold, reaction)
    end = augmented_lagrangian(system, q, tolerance, exact, max_iterations, check, previous,
                               _ROUNDS)
    state, residual, stability, steps, kicks, loaded, violation = end
    before += steps
    if not (_on_a_way(system, max_iterations)
            or _rests(loaded, state, residual, stability, violation, tolerance, exact)):
        left = reaction_of(hold, row_count(system.needs.border))
        set_reaction(hold, reaction)
        rests, another, steps = _relaxed(system, q, tolerance, exact, max_iterations, check,
                                         previous)
        before += steps
        if rests:
            state, residual, stability, loaded, violation = another
        else:
            set_reaction(hold, left)
    return state, residual, stability, before, kicks, loaded, violation


@kernel
def _relaxed(system, q, tolerance, exact, max_iterations, check, previous):
    """Return whether a DLO that is brought nearer to rest first comes to rest, where, and steps.

    Where: Configuration, residual, stability, Problem, violation.
    """
    hold, there, begin, before = system.effects.hold, system, q, 0
    for attempt in range(len(_ROUGH)):
        there, begin, steps, previous = relax(there, begin, previous, attempt == _SLIDES,
                                              _ROUGH[attempt], _MOST[attempt])
        before += steps
        reaction = reaction_of(hold, row_count(system.needs.border))
        rests, state, residual, stability, steps, _, loaded, violation = _at_once(
            there, begin, True, tolerance, exact, max_iterations, check, previous)
        before += steps
        if rests:
            break
        set_reaction(hold, reaction)
    return rests, (state, residual, stability, loaded, violation), before


@kernel
def _on_a_way(system, max_iterations):
    """Whether no equilibrium is wanted, for no more steps than these are allowed."""
    return max_iterations <= (_BETWEEN_GRIPS if is_held(system) else _ON_A_WAY)


@kernel
def _starts(system, max_iterations):
    """Return from how many starts forces are sought at once.

    More between two grips: there turns often go on without an end.
    """
    if _on_a_way(system, max_iterations):
        return range(0)
    return range(_STARTS if is_held(system) else 1)


@kernel
def _pressed(system, q, tolerance, exact, max_iterations, previous):
    """Descend once with springs, whose forces are those of contacts then.

    Return whether it touches, steps, and the Problem and unknowns there.
    """
    contacts = system.effects.contact.contacts  # copied: a round moves forces from node to node
    system = with_stiffness(system, contacts.stiffness, contacts.grip)
    state, _, steps, contacts, _ = _round(system, q, tolerance, exact,
                                          min(_PATIENCE, max_iterations), previous,
                                          max_iterations < 0)
    system = with_contacts(system, contacts, system.effects.contact.scene)
    state, _, table, _ = kkt_residual(system, state.q)
    put_forces(system, table, *forces(table, state))
    return table.gap.size > 0, steps, system, state.q


@kernel
def predictor_corrector(system, base, slid, strains, shift, tolerance, exact, max_iterations,
                        previous):
    """Return whether a DLO that bears goes on bearing, and what `augmented_lagrangian` returns."""
    twist = np.empty(6)
    put_vector(rotation_vector(times_transposed(matrix(system.base), matrix(base))), twist)
    twist[3:] = shift
    follows, q, system = tangent_predictor(system, base, slid, strains, twist)
    if follows:
        return _at_once(system, q, not follows, tolerance, exact, max_iterations, follows, previous)
    return False, new_configuration(system), np.inf, np.nan, 0, 0, system, np.inf


@kernel
def _at_once(system, q, afar, tolerance, exact, max_iterations, check, previous):
    """Return whether a DLO that bears comes to rest from q (m, 3), and where, as `solve_contact`.

    `afar`: whether it has been brought here from afar, see `semismooth_newton`; then its points do
    not roll far, nor does it go on by turns. Others as of `constrained_newton`.
    """
    steps = kicks = moves = 0
    stability, start, contact = np.nan, new_configuration(system), system.effects.contact
    copy(q, start.q)
    place(system, start)
    if not afar:
        system = with_contacts(system, free_to_roll(system, start, contact.contacts),
                               contact.scene)
    for exchange in range(_EXCHANGES):
        bears, state, residual, violation, loaded, hessian, age, moves = semismooth_newton(
            system, q, tolerance, exact, previous, afar)
        steps += moves
        if not bears:
            break
        changes, contacts = _exchanged(loaded, state, exact, afar and exchange >= _CHOICES)
        if not changes:
            break
        system, q = with_contacts(loaded, contacts, loaded.effects.contact.scene), state.q
    if bears and changes and afar:
        bears = not afar
    elif bears and changes:
        state, residual, stability, moves, kicks, loaded, violation = augmented_lagrangian(
            loaded, state.q, tolerance, exact, min(_SOON, max_iterations), check, previous, _FEW)
        steps += moves
        bears = kicks == 0 and _rests(loaded, state, residual, stability, violation, tolerance,
                                      exact)
    elif bears and check:
        # by a factorization since which hardly anything has changed, where that tells
        if age < HARDLY and is_definite(loaded, hessian, 0.0):
            stability, _ = lowest_mode(loaded, hessian, 0.0, 1e-4)
        if not stability > WELL_STABLE:
            stability, _ = _judged(loaded, state, tolerance, exact)
        bears = stability > -HELD_NEUTRAL
    return bears, state, residual, stability, steps, kicks, loaded, violation


@kernel
def _exchanged(system, state, exact, keeps):
    """Return whether points pull, meet, or join that are deeper in an obstacle than `exact` (m).

    And the ContactSet that is to be tried then, of all points that there were if it `keeps` them.
    """
    old, normal, hessian = system.effects.contact.contacts, np.empty(3), np.empty((3, 3))
    held_back, less = old.node.copy(), old.multiplier.copy()
    changes = _let_push(old) < -old.stiffness * exact or _met(old, state.attached)
    node = old.node.copy()
    new, _ = (enlarge_active_set(system, state) if keeps
              else update_active_set(system, state))
    for c in range(0 if changes else new.element.size):
        if new.obstacle[c] >= 0:
            gap, _, _ = closest_point(system.effects.contact.scene, new, c, system.lengths,
                                      state.strains, state.rotations, state.positions, normal,
                                      hessian)
            changes = changes or gap < -exact
    new = with_springs(new, new.stiffness, old.node.copy(), new.multiplier)
    old.node[:] = node
    if not changes:  # what is pressed in by less than `exact` is no contact, and not to stiffen one
        old.node[:], old.multiplier[:] = held_back, less
    return changes, new


@kernel
def _met(contacts, attached):
    """Whether two points have rolled to the same place: they are one."""
    for c in range(contacts.element.size):
        for b in range(c):
            if (contacts.obstacle[c] >= 0 and contacts.obstacle[c] == contacts.obstacle[b]
                    and contacts.fraction[c] == 0.0 and contacts.fraction[b] == 0.0
                    and attached.element[c] == attached.element[b]):
                return True
    return False


@kernel
def _let_push(contacts):
    """Take back the multipliers below zero, which hold springs back, in place; return the least."""
    least = 0.0
    for o in range(contacts.node.shape[0]):
        for k in range(contacts.node.shape[1]):
            least = min(least, contacts.node[o, k])
            contacts.node[o, k] = max(0.0, contacts.node[o, k])
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            least = min(least, contacts.multiplier[c])
            contacts.multiplier[c] = max(0.0, contacts.multiplier[c])
    return least


@kernel
def _rests(system, state, residual, stability, violation, tolerance, exact):
    """Whether nothing is left to be done, and the shape stands; a stability of nan is not known."""
    return (violation < exact and not stability <= -HELD_NEUTRAL
            and residual < max(tolerance * _STALLED, gradient_noise(system, state)))


@kernel
def augmented_lagrangian(system, q, tolerance, exact, max_iterations, check, previous, rounds):
    """Descend from q (m, 3) among obstacles, in so many rounds at most.

    Other arguments as of `constrained_newton`.
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
        system = with_contacts(system, contacts, system.effects.contact.scene)
        state, residual, table, violation = kkt_residual(system, q)
        enough = residual < max(tolerance * (COARSER if steps else _STALLED),
                                gradient_noise(system, state))
        good = violation < exact and enough
        if iterations >= max_iterations or good and not check:
            break
        if good:
            stability, mode = _judged(system, state, tolerance, exact)
            judged = final = True
            beside = np.empty_like(q)
            if (stability > -HELD_NEUTRAL or kicks >= _MOST_KICKS
                    or not leave_saddle(system, state, mode, beside)):
                break
            kicks += 1
            q, before, judged, final = beside, np.inf, False, False
            continue
        wrong = max(violation / exact, residual / tolerance)
        vain = 0 if wrong < _HELPS * best else vain + 1
        best = min(wrong, best)
        solved = False
        if news % (_NEWS + 1) == 0:  # what is new has to bear before its force counts
            solved = update_multipliers(system, state, table, _share(vain, held), q, vain)
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
        state, residual, _, inside = kkt_residual(system, state.q)
        violation = max(violation, inside)
    return state, residual, stability, iterations, kicks, system, violation


@kernel
def _round(system, q, tolerance, exact, most, previous, keeps):
    """Descend with the multipliers as they are, and look at what touches there."""
    never = most < 0  # literals would be compiled for by themselves
    state, residual, _, steps, _, _, _ = newton_descent(
        system, q, thorough(tolerance, exact, most, never, never), new_workspace(system))
    contacts, new = enlarge_active_set(system, state) if keeps else update_active_set(system, state)
    # Without a past it has slid to where it needs no friction; on its way it keeps what it has.
    if len(previous) and residual <= _SHORT * tolerance:
        contacts = update_friction(system, contacts, state, previous)
    return state, residual, steps, contacts, new


@kernel
def _share(vain, held):
    """Return how far multipliers move after so many rounds in vain."""
    # a grip may need full steps again, once its reaction has changed
    return _SHARES[vain % len(_SHARES) if held else min(vain, len(_SHARES) - 1)]


@kernel
def _judged(system, state, tolerance, exact):
    """Return the smallest eigenvalue, on what a grip leaves free, and its mode."""
    always, none = exact > 0.0, 0 * state.q.shape[0]
    _, _, stability, _, mode, _, _ = newton_descent(
        system, state.q, thorough(tolerance, exact, none, always, not always),
        new_workspace(system))
    return stability, mode


@kernel
def _stiffened(system, factor):
    """Return the same Problem with springs at its contacts that are stiffer by a factor."""
    contacts = system.effects.contact.contacts
    return with_stiffness(system, factor * contacts.stiffness, contacts.grip)
