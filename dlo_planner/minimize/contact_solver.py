# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO among obstacles comes to rest: in which order methods are tried, and what is judged.

Shape and contact forces are sought at once (`minimize.semismooth`), near where the DLO is. Where
that finds nothing, a DLO at rest follows its flow, in which all contact forces of a step are found
at once (`minimize.quasi_static`), whether it touches something yet or not; on many points it does
so first, between grips on few points after two stages of what follows. Where this finds nothing,
the DLO is brought nearer to rest (`minimize.relaxation`), in a few stages: it gives way more
gradually, and where it buckles on few points comes to the side to which it is bent. A series
follows its flow on many points alone.
What is found is judged as any other minimum: the points that bear are those that `active_set`
chooses, and the shape stands; else it leaves its saddle, and all begins anew. What is judged is the
residual with the limits of friction: it has no potential.

A DLO that begins deep inside an obstacle is pressed out by springs before. Where no equilibrium is
wanted, on a way between two poses, nearly at rest is enough.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.energy.contact import obstructed, trial_traction
from dlo_planner.energy.gap import closest_point
from dlo_planner.energy.grip import constraint_violation, holds, reaction_of, set_reaction
from dlo_planner.energy.inertia import has_inertia
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    bending_energy,
    hinged,
    new_configuration,
)
from dlo_planner.energy.terms import row_count
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import copy, put_sum, replaced
from dlo_planner.geometry.so3 import matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.kernels.interruption import interrupted
from dlo_planner.minimize.active_set import (
    AT_NODE,
    enlarge_active_set,
    free_to_roll,
    update_active_set,
)
from dlo_planner.minimize.contact_table import (
    kkt_residual,
    touching,
    with_contacts,
    with_springs,
    with_stiffness,
)
from dlo_planner.minimize.convergence import TOUCHING, Minimum, as_rounded, gradient_noise
from dlo_planner.minimize.hessian import assemble, is_definite, largest_turn, new_hessian
from dlo_planner.minimize.kkt import dot, put_scaled
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import (
    HARDLY,
    HELD_NEUTRAL,
    KICK_TURN,
    WELL_STABLE,
    leave_saddle,
    minimize,
    new_workspace,
    newton,
    newton_descent,
    thorough,
)
from dlo_planner.minimize.quasi_static import carried, settle, with_bearing, without_friction
from dlo_planner.minimize.relaxation import deepest, relax
from dlo_planner.minimize.semismooth import (
    bears,
    crosses_a_sheet,
    forces,
    place,
    put_forces,
    semismooth_newton,
    tangent_predictor,
)
from dlo_planner.model.arrays import Floats
from dlo_planner.progress import uninterrupted

# Of a buckling force, and of how far a DLO buckles: how nearly they are known where Newton's method
# finds the rest; by so many bisections at most, of what may be smaller by so many powers of two,
# and so many doublings of a force, which may be larger by as many
_ABOUT, _BISECTIONS = 0.05, 40
# Contacts whose springs hardly give are stiffer by so much, at most so many times over: a column
# that has hardly buckled is held by its axial contact alone. Where an eigenvalue keeps more than a
# part of its size, the springs are not why it is negative
_FIRM, _MOST_FIRM, _UNCHANGED = 1e2, 3, 0.5
_WEAK = 1e-6  # times the stiffness of contacts' springs: they add nothing to the known forces
COARSER = 10.0  # times the tolerance: the rounding errors of contact forces leave no more of it
_ON_A_WAY = 1e-7  # of the length: who allows a violation as large wants no equilibrium
# A DLO so deep inside, of the length, is pressed out: at first, and where it came out nowhere; in
# so many steps at once and in all.
_DEEP, _STUCK, _PRESSING, _PRESSED = 1e-3, 1e-4, 16, 200
_FALLING = 200  # Newton steps in which a DLO comes to rest that touches nothing
# How nearly a DLO is brought to rest, in how many steps, and from when on it slides there; then
# forces are sought at once, with so many exchanges of points, which are kept after the first few.
_ROUGH, _MOST = (1e-3, 1e-3, 1e-6, 1e-9, 1e-9), (12, 48, 100, 100, 400)
_SLIDES, _EXCHANGES, _CHOICES = 4, 8, 3
# Times the violation aimed at, in the last attempt: a stiff part that lies along a body keeps it.
_STIFF = 100.0
# Of the flow: at rest with such a residual, at first and well; steps at most until the first rest,
# and from there to the second; how often it leaves a saddle, with a shift of at least so many times
# the size of its eigenvalue (with twice the size, what has left doubles in each step). What is as
# near (`_CLOSE`) is brought to rest exactly, with so many Newton steps.
_RESTS, _RESTS_WELL, _MOST_FLOW, _MOST_FINER, _MOST_FALLS = 1e-6, 1e-9, 250, 30, 3
_LEAVES, _CLOSE, _POLISH = 2.0, 1e-4, 6
# Points that bear of a DLO that lies on something; attempts that are made before its flow, where
# fewer do, of one that is held elsewhere as well
_MANY, _TRIES = 4, 2
# With fewer points that bear all are moved to where they are nearest, exactly; more share their
# forces so that this finds nothing in half of the cases, and takes the time of their square
_ROLLING = 12
# Points. Their dense equations take the cube of their number: 0.5 s a step with 280. Attempts with
# 30 to 64 points fail as often as not
_DENSE = 64
# rad and of the length: a motion of the gripper with which, of a hundred points a hundredth of the
# length apart, about one comes to bear; what sticks goes back exactly with it
_LITTLE = 1e-4
_KEPT, _KEPT_WELL = 9e-7, 2e-8  # of the length: violation there, and where no more is tried
_UNSEEN = 5e-7   # of the length: how deep what does not bear yet may be, where no more is tried
# How often limits of friction are set to those of the forces, and a relative change that is none
_CYCLES, _SAME_LIMIT = 4, 1e-6
_MOST_KICKS, _SAME = 10, 1e-6  # part of the unknowns: shapes that differ by less are one


def constrained_newton(system: Problem, q: Floats, tolerance: float, max_iterations: int,
                       check: bool, exact: float, previous: Floats) -> Minimum:
    """Descend from q to a minimum that keeps all constraints.

    Shapes: q (m, 3), previous (N + 1, 6).
    """
    if obstructed(system.contact):
        end = solve_contact(system, q, COARSER * tolerance, exact, max_iterations, check, previous,
                            np.zeros((3, 3)), np.inf)
        return Minimum(*uninterrupted(end))
    return newton(system, q, tolerance, max_iterations, check,
                  exact if holds(system.hold) or hinged(system) else 0.0)


@kernel
def firm(contact: Any, system: Problem, q: Floats) -> Problem:
    """Return the Problem with contacts so stiff that they hardly give at q (m, 3); forces stay."""
    if contact is None:
        return system
    if contact.scene.kind.size == 0:
        return system
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    return _stiffened(system, state, _FIRM)


@kernel
def _stiffened(system: Problem, state: Configuration, by: float) -> Problem:
    """Return the Problem with contacts stiffer `by` a factor, their forces the same."""
    contacts = system.effects.contact.contacts
    stiffness, grip = by * contacts.stiffness, by * contacts.grip
    firm = with_contacts(system, replaced(
        contacts, 'node', contacts.node.copy(), 'multiplier', contacts.multiplier.copy(),
        'shear', contacts.shear.copy()), system.effects.contact.scene)
    _keep_forces(firm, state, stiffness - contacts.stiffness)
    return with_stiffness(firm, stiffness, grip)


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
def solve_contact(system, q, tolerance, exact, max_iterations, check, previous, turned_from,
                  farthest):
    """Descend from q (m, 3) among obstacles, arguments as of `constrained_newton`.

    Return the Configuration, residual, stability, Newton steps, how often a saddle was left, the
    Problem with its contacts' forces, and the violation, m. What falls in its flow is followed by
    `farthest`, rad, at most: then nothing is found, and that a saddle was left is said.
    """
    there, begin, hold, past = system, q, system.effects.hold, previous
    length = np.sum(system.lengths)
    first = reaction_of(hold, row_count(system.needs.border))
    steps = kicks = attempt = 0
    tried = False
    beside, saddle = np.empty_like(q), np.full_like(q, np.inf)
    seeks = bears(system.effects.contact.contacts)
    on_a_way, flow = exact > _ON_A_WAY * length, np.array([0.0, 1.0, 0.0])
    if not (seeks or on_a_way):
        done, state, residual, stability, steps, kicks, violation = _free(
            system, q, tolerance, exact, min(_FALLING, max_iterations), check)
        if done:
            return state, residual, stability, steps, kicks, system, violation
        set_reaction(hold, first)
        kicks = 0  # what falls through obstacles falls nowhere
    # (between few points a series waves, and relaxation is as quick, as it is for a series that
    # moves)
    moves_on = has_inertia(system.effects.anchor)
    local, held = system.basis.shape[1] == 0, row_count(system.needs.border) > 0
    may_flow = not (on_a_way or moves_on and not local)
    if past.shape[0] == 0:  # what is set down has no way along which it could have rubbed
        there = system = without_friction(system)
    while max_iterations > 0:
        many = _bearing(there.effects.contact.contacts) >= _MANY
        # (what hangs between grips goes on bearing where it does: relaxation ends in the same shape
        # as shorter steps do, the flow with friction in another one, by a thousandth of its energy)
        flows = may_flow and not tried and (many or local and attempt >= (_TRIES if held else 0))
        # (what lies on many points hardly ever goes on bearing by the same ones, and to exchange
        # them one by one takes the time of many steps of the flow)
        if seeks and not on_a_way and not (flows and many):
            reaction = reaction_of(hold, row_count(system.needs.border))
            aim = _STIFF * exact if attempt == len(_ROUGH) else exact
            rests, state, residual, stability, moves, loaded, violation = _at_once(
                there, begin, attempt == 0, tolerance, aim, check, previous)
            steps += moves
            if rests and attempt > 0:  # points that are kept in the middle of elements roll
                found = reaction_of(hold, row_count(system.needs.border))
                rolled, its, left, stands, moves, there, inside = _at_once(
                    loaded, state.q, rests, tolerance, aim, check, previous)
                steps += moves
                if rolled:
                    state, residual, stability, loaded, violation = its, left, stands, there, inside
                else:
                    set_reaction(hold, found)
            if rests:  # friction that counts from steps of the flow is not that of a step from rest
                kicks += attempt > _SLIDES
                return state, residual, stability, steps, kicks, loaded, violation
            falls = (stability <= -HELD_NEUTRAL and kicks < _MOST_KICKS  # and not back to the same
                     and np.max(np.abs(state.q - saddle)) > _SAME * np.max(np.abs(state.q)))
            if falls:
                stability, mode = _judged(loaded, state, tolerance, exact)
                saddle = state.q.copy()
                falls = leave_saddle(loaded, state, mode, beside)
            if falls:
                kicks, attempt, there, begin = kicks + 1, 0, loaded, beside.copy()
                previous, flow = past, np.array([0.0, 1.0, 0.0])
            else:
                set_reaction(hold, reaction)
        if steps >= max_iterations or attempt >= len(_ROUGH) or interrupted():
            break
        if flows:
            reaction = reaction_of(hold, row_count(system.needs.border))
            rests, state, residual, stability, moves, falls, loaded, violation = _settled(
                there, begin, past, turned_from, tolerance, exact, max_iterations - steps, check,
                farthest, beside)
            steps, tried = steps + moves, True
            if rests:
                return state, residual, stability, steps, kicks + falls, loaded, violation
            set_reaction(hold, reaction)
            falls = (many or held) and stability <= -HELD_NEUTRAL
            kicks += falls
            # (relaxation finds what has let go of a hand, and a series; a step of a motion, and one
            # that is followed `farthest` alone, can be made in halves, which takes less)
            if falls or many and (moves_on or local and farthest < np.inf):
                break
            if _bearing(there.effects.contact.contacts) > _DENSE:
                break
        there, begin, moves = _pressed_out(
            there, begin, length * (_STUCK if attempt > 0 else _DEEP), tolerance, exact,
            max_iterations - steps)
        steps += moves
        rough = exact / length if on_a_way else _ROUGH[attempt]
        most = max(0, max_iterations - steps)
        if not on_a_way:
            most = min(most, _MOST[attempt])
        there, begin, moves, previous = relax(there, begin, previous, attempt == _SLIDES, rough,
                                              most, flow, farthest)
        steps, attempt, seeks = steps + moves, attempt + 1, True
        kicks += flow[2] > farthest
        if on_a_way or flow[2] > farthest:
            break
        if moves_on and kicks < _MOST_KICKS:
            buckles, its = _buckles(there, begin, tolerance, exact, beside)
            if buckles:
                kicks, there, begin = kicks + 1, its, beside.copy()
    state = new_configuration(there)
    copy(begin, state.q)
    place(there, state)
    contacts, _ = update_active_set(there, state)  # else what is inside between nodes goes unseen
    there = with_contacts(there, contacts, there.effects.contact.scene)
    state, residual, _, violation = kkt_residual(there, begin)
    return state, residual, np.nan, steps, kicks, there, violation


@kernel
def _bearing(contacts):
    """Return how many points are known to bear."""
    count = 0
    for o in range(contacts.node.shape[0]):
        for k in range(contacts.node.shape[1]):
            count += contacts.node[o, k] > 0.0
    for c in range(contacts.element.size):
        count += contacts.obstacle[c] >= 0 and contacts.multiplier[c] > 0.0
    return count


@kernel
def _bears_inside(contacts):
    """Whether a point inside an element bears."""
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0 and contacts.multiplier[c] > 0.0:
            return True
    return False


@kernel
def _polished(system, q, tolerance, exact, allowed):
    """Return whether a DLO that is nearly at rest near q (m, 3) rests among contacts, and where.

    The limits of friction are those of the forces there; contacts are violated by `allowed`, m, at
    most, and what is held is missed by `exact`. Also returned are residual, violation, m, and
    Newton steps.
    """
    steps, never, hold = 0, exact < 0.0, system.effects.hold
    tolerance = max(tolerance, 0.5 * TOUCHING)
    state, residual, table, violation = kkt_residual(system, q)
    contacts, friction = system.effects.contact.contacts, system.effects.contact.scene.friction
    for _ in range(_CYCLES):
        if not (residual < _CLOSE and violation < allowed):
            break
        if (not _is_small(system, state, residual, tolerance)
                or constraint_violation(hold, state) > exact):
            state, _, _, moves, _, _, _ = newton_descent(
                system, state.q, thorough(tolerance, exact, _POLISH, never, never),
                new_workspace(system))
            steps += moves
            state, residual, table, violation = kkt_residual(system, state.q)
        change = 0.0
        for a in range(table.gap.size):
            c = table.rubbing[a]
            if c >= 0:
                limit = friction[table.obstacle[a]] * table.force[a]
                change = max(change, abs(limit - contacts.multiplier[c]) / max(limit, 1e-300))
                contacts.multiplier[c] = limit
        state, residual, table, violation = kkt_residual(system, state.q)
        if (violation < allowed and change < _SAME_LIMIT
                and constraint_violation(hold, state) <= exact
                and _is_small(system, state, residual, tolerance)):
            changes, _ = _exchanged(system, state, allowed, change >= 0.0)
            return not changes, state, residual, violation, steps
    return False, state, residual, violation, steps


@kernel
def _is_small(system, state, residual, tolerance):
    """Whether a residual is below a tolerance, or, at rest, what rounding leaves of it.

    On many short elements stiff springs leave more. Steps of a motion add up what is left.
    """
    return residual < tolerance or not has_inertia(system.effects.anchor) and as_rounded(
        residual, gradient_noise(system, state), tolerance)


@kernel
def _settled(system, q, previous, turned_from, tolerance, exact, max_iterations, check, farthest,
             kicked):
    """Return whether a DLO comes to rest by its flow, and what `solve_contact` does.

    It begins at q (m, 3); `kicked` (m, 3) is work space. Stability is -inf of what falls that is
    followed to `farthest` alone. From where the flow rests the search for what is near is exact.
    Where it finds nothing, as along many points that share their forces, the end of the flow itself
    is looked at as any other shape: residual, violation, cones, points that are deeper in an
    obstacle, stability.
    """
    given, hold, there, flow = (system.effects.contact.contacts, system.effects.hold, system,
                                np.zeros(2))
    steps = kicks = goes_on = 0
    stability, residual, violation, state = np.nan, np.inf, np.inf, new_configuration(system)
    local = system.basis.shape[1] == 0  # waves of a series would touch between its nodes
    if previous.shape[0]:
        follows, its, there = carried(system, q, previous, turned_from)
        q = its if follows else q
    while True:
        there, q, moves, left, falls = settle(there, q, previous, _RESTS,
                                              min(_MOST_FLOW, max_iterations), farthest, flow)
        steps += moves
        if not left < _CLOSE:
            stability = -np.inf if left == np.inf else stability
            break
        rests, stands = False, True
        firm, state, residual, violation = _at_end(there, q, given)
        buckles, its = _buckles(firm, state.q, tolerance, exact, kicked)
        if buckles:
            rests, state, residual, stability, moves, loaded, violation = _at_once(
                its, kicked, rests, tolerance, exact, check, previous)
            return rests, state, residual, stability, steps + moves, kicks + 1, loaded, violation
        if falls and check:
            stability, mode = _judged(firm, state, tolerance, exact)
            stands = stability > -HELD_NEUTRAL
        if stands:
            if local:
                rests, state, residual, violation, firm, there, q, left, moves = _rests_well(
                    there, q, given, previous, left, tolerance, exact, max_iterations, flow)
                steps += moves
            if not rests:
                firm, state, residual, violation = _at_end(there, q, given)
            if check:
                stability, mode = _judged(firm, state, tolerance, exact)
                stands = stability > -HELD_NEUTRAL
        if stands:
            # points that bear inside elements are where they are nearest, exactly; and what moves
            # is not pressed in, as the next step would push it out, with that energy
            exactly = _bears_inside(firm.effects.contact.contacts) or (
                violation > exact and has_inertia(system.effects.anchor))
            bearing = _bearing(firm.effects.contact.contacts)
            if bearing <= _DENSE if not rests else exactly and bearing < _ROLLING:
                near = firm if rests else with_bearing(there, q, given, rests)
                borne = reaction_of(hold, row_count(system.needs.border))
                rolls, its, its_residual, its_stability, moves, loaded, inside = _at_once(
                    near, state.q, rests, tolerance, exact, check, previous)
                steps += moves
                if rolls:
                    return True, its, its_residual, its_stability, steps, kicks, loaded, inside
                set_reaction(hold, borne)
                buckles, its_system = _buckles(near, state.q, tolerance, exact, kicked)
                if buckles:  # (not buckles: False; a literal would be compiled for by itself)
                    rolls, its, its_residual, its_stability, moves, loaded, inside = _at_once(
                        its_system, kicked, not buckles, tolerance, exact, check, previous)
                    steps += moves
                    if rolls:
                        return (True, its, its_residual, its_stability, steps, kicks + 1, loaded,
                                inside)
                    set_reaction(system.effects.hold, borne)
            if rests:
                return (True, state, residual, stability if check else np.inf, steps, kicks, firm,
                        violation)
            if not local or left < _CLOSE or goes_on == _MOST_FALLS:
                break
            goes_on += 1
            continue
        if farthest < np.inf:
            stability = -np.inf
            break
        if kicks == _MOST_FALLS or not leave_saddle(firm, state, mode, kicked):
            break
        kicks += 1
        q, flow[0], flow[1] = kicked.copy(), 0.0, _LEAVES * abs(stability)
    return False, state, residual, stability, steps, kicks, system, violation


@kernel
def _at_end(there, q, given):
    """Return the Problem with what bears where a flow has ended, q (m, 3), and how that rests."""
    firm = with_bearing(there, q, given, q.size > 0)
    state, residual, _, violation = kkt_residual(firm, q)
    return firm, state, residual, violation


@kernel
def _rests_well(there, q, given, previous, left, tolerance, exact, max_iterations, flow):
    """Return whether a DLO rests where its flow has ended, q (m, 3), as well as it can be told.

    And the Configuration, residual, violation, m, and Problem with the contacts that bear alone; to
    where the flow has gone on, its Problem, unknowns and residual; and the steps of that.
    """
    length, hold = np.sum(there.lengths), there.effects.hold
    firm = with_bearing(there, q, given, length > 0.0)
    rests, state, residual, violation, steps = _polished(firm, q, tolerance, exact, _KEPT * length)
    well = (_KEPT if has_inertia(there.effects.anchor) else _KEPT_WELL) * length  # it is gone soon
    if _bearing(firm.effects.contact.contacts) < _MANY:
        well = exact  # nothing but rounding errors stands against it
    # (a point in the middle of an element may have come to an obstacle that bears nothing yet)
    unseen = deepest(kkt_residual(there, q)[2])
    if not (rests and violation < well and unseen < _UNSEEN * length):
        flow[0], reaction = 0.0, reaction_of(hold, row_count(there.needs.border))
        there, q, moves, left, _ = settle(there, q, previous, _RESTS_WELL,
                                          min(_MOST_FINER, max_iterations), np.inf, flow)
        finer = with_bearing(there, q, given, length > 0.0)
        is_rest, its, its_residual, inside, more = _polished(finer, q, tolerance, exact,
                                                             _KEPT * length)
        steps += moves + more
        if is_rest:
            rests, state, residual, violation, firm = is_rest, its, its_residual, inside, finer
        else:
            set_reaction(hold, reaction)
    return rests, state, residual, violation, firm, there, q, left, steps


@kernel
def _pressed_out(system, q, deep, tolerance, exact, max_iterations):
    """Return Problem, unknowns and steps of a DLO that is pressed out of obstacles it is deep in.

    In the middle of a sheet nothing tells to which side. Springs push with ever greater forces.
    """
    state, never, steps = new_configuration(system), max_iterations < 0, 0
    given, most = system.effects.contact.contacts, min(max_iterations, _PRESSED)
    copy(q, state.q)
    place(system, state)
    while steps < most:
        table = touching(system.effects.contact.scene, system.effects.contact.contacts,
                         system.lengths, state)
        if not (crosses_a_sheet(system, state) or deepest(table) > deep):
            break
        system = with_stiffness(system, given.stiffness, given.grip)  # a copy
        if steps > 0:
            put_forces(system, table, *forces(table, state))
        state, _, _, moves, _, _, _ = newton_descent(
            system, state.q, thorough(tolerance, exact, min(_PRESSING, most - steps), never, never),
            new_workspace(system))
        steps += max(moves, 1)
        contacts, _ = update_active_set(system, state)
        system = with_contacts(system, contacts, system.effects.contact.scene)
        state, _, _, _ = kkt_residual(system, state.q)
    return system, state.q, steps


@kernel
def _free(system, q, tolerance, exact, max_iterations, check):
    """Return whether a DLO comes to rest that touches nothing, and where, as `solve_contact`."""
    never = max_iterations < 0  # literals would be compiled for by themselves
    state, residual, stability, steps, kicks, violation = minimize(
        system, q.copy(), thorough(tolerance, exact, max_iterations, check, never),
        new_workspace(system))
    done = ((residual < tolerance
             or as_rounded(residual, gradient_noise(system, state), tolerance))
            and violation <= exact and not (check and stability <= -HELD_NEUTRAL))
    if done:
        changes, _ = _exchanged(system, state, exact, done)
        done = not changes and kkt_residual(system, state.q)[2].gap.size == 0
    return done, state, residual, stability, steps, kicks, violation


@kernel
def predictor_corrector(system, base, slid, strains, shift, tolerance, exact, previous):
    """Return whether a DLO that bears goes on bearing, and what `solve_contact` does."""
    twist = np.empty(6)
    put_vector(rotation_vector(times_transposed(matrix(system.base), matrix(base))), twist)
    twist[3:] = shift
    moved = np.sqrt(np.sum(twist[:3] ** 2)) + np.sqrt(np.sum(shift**2)) / np.sum(system.lengths)
    follows = moved < _LITTLE or _bearing(system.effects.contact.contacts) < _ROLLING
    if follows:  # (of more points some nearly always change, and all are exchanged one by one)
        follows, q, system = tangent_predictor(system, base, slid, strains, twist)
    if follows:
        goes_on, state, residual, stability, steps, system, violation = _at_once(
            system, q, follows, tolerance, exact, follows, previous)
        return goes_on, state, residual, stability, steps, 0, system, violation
    return False, new_configuration(system), np.inf, np.nan, 0, 0, system, np.inf


@kernel
def _at_once(system, q, rolls, tolerance, exact, check, previous):
    """Return whether a DLO comes to rest near q (m, 3), and where, as `solve_contact`.

    `rolls`: whether points may roll far, see `free_to_roll`; others as of `constrained_newton`.
    """
    steps = moves = 0
    stability, start, contact = np.nan, new_configuration(system), system.effects.contact
    copy(q, start.q)
    place(system, start)
    if rolls:
        system = with_contacts(system, free_to_roll(system, start, contact.contacts),
                               contact.scene)
    for exchange in range(_EXCHANGES):
        rests, state, residual, violation, loaded, hessian, age, moves = semismooth_newton(
            system, q, tolerance, exact, previous, not rolls)
        steps += moves
        if not rests:
            break
        changes, contacts = _exchanged(loaded, state, exact, exchange >= _CHOICES)
        rests = not changes
        if rests:
            break
        system, q = with_contacts(loaded, contacts, loaded.effects.contact.scene), state.q
    if rests and check:
        # by a factorization since which hardly anything has changed, where that tells
        if age < HARDLY and is_definite(loaded, hessian, 0.0):
            stability, _ = lowest_mode(loaded, hessian, 0.0, 1e-4)
        if not stability > WELL_STABLE:
            stability, _ = _judged(loaded, state, tolerance, exact)
        rests = stability > -HELD_NEUTRAL
    return rests, state, residual, stability, steps, loaded, violation


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
                    and contacts.fraction[c] <= 0.0 and contacts.fraction[b] <= 0.0
                    and attached.element[c] == attached.element[b]
                    and abs(attached.fraction[c] - attached.fraction[b]) < AT_NODE):
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
def _judged(system, state, tolerance, exact):
    """Return the smallest eigenvalue, on what grips and contacts leave free, and its mode.

    Springs of contacts that give let a DLO seem less stable than it is, never more.
    """
    stability, mode = _lowest(system, state, tolerance, exact)
    for _ in range(_MOST_FIRM):
        if stability > -HELD_NEUTRAL:
            break
        before, system = stability, _stiffened(system, state, _FIRM)
        stability, mode = _lowest(system, state, tolerance, exact)
        if stability < _UNCHANGED * before:  # it is not the springs
            break
    return stability, mode


@kernel
def _buckles(system, q, tolerance, exact, beside):
    """Whether a DLO rests at q (m, 3) though it is pressed into an obstacle, and has to buckle.

    One that is straight and pressed along itself yields to second order alone: its forces grow, and
    nothing moves. If so, `beside` (m, 3) is where it is bent by the mode in which it buckles first,
    as far as it is pressed in, and the Problem returned has about the forces that do so. The side
    is arbitrary, but always the same. In the step of a motion alone: at rest a column leaves its
    saddle by the shift.
    """
    if not has_inertia(system.effects.anchor):
        return False, system
    state, residual, table, violation = kkt_residual(system, q)
    if not (residual < tolerance and violation > exact and table.gap.size):
        return False, system
    normal, shear = forces(table, state)
    given = system.effects.contact.contacts
    weak = with_stiffness(system, _WEAK * given.stiffness, _WEAK * given.grip)
    put_forces(weak, table, 0.0 * normal, 0.0 * shear)
    # few contacts may press it almost along its axis; of many, forces that move it to first order
    # show that it need not buckle
    if _bearing(given) >= _MANY and not kkt_residual(weak, q)[1] < tolerance:
        return False, system
    # multiples of the forces under which it stands, and does not: those that it is pressed in with
    # are of springs, and of any size where it neither yields nor buckles
    least, most, stability, mode = 0.0, 1.0, 0.0, q
    for _ in range(_BISECTIONS):
        put_forces(weak, table, most * normal, most * shear)
        stability, mode = _lowest(weak, state, tolerance, exact)
        if stability <= -HELD_NEUTRAL:
            break
        least, most = most, 2.0 * most
    if not stability <= -HELD_NEUTRAL:
        return False, system
    for _ in range(_BISECTIONS):
        if most - least < _ABOUT * most:
            break
        part = 0.5 * (least + most)
        put_forces(weak, table, part * normal, part * shear)
        stability, its = _lowest(weak, state, tolerance, exact)
        if stability <= -HELD_NEUTRAL:
            most, mode = part, its
        else:
            least = part
    hessian, trial = new_hessian(system), new_configuration(system)
    put_forces(weak, table, most * normal, most * shear)
    bent = kkt_residual(weak, q)[0]
    if dot(bent.gradient, mode) > _gradient_error(weak, bent) * np.sqrt(dot(mode, mode)):
        put_scaled(-1.0, mode, mode)  # what is bent already is bent farther
    assemble(system, state, hessian)
    reach = KICK_TURN / max(largest_turn(system, hessian, mode), 1e-12)
    inside, outside = 0.0, 1.0  # parts of that, at which it still is pressed in, and is not
    for _ in range(_BISECTIONS):
        part = 0.5 * (inside + outside)
        put_sum(state.q, part * reach, mode, trial.q)
        if deepest(kkt_residual(weak, trial.q)[2]) > exact:
            inside = part
        else:
            outside = part
        if outside - inside < _ABOUT * outside:
            break
    if inside == 0.0:
        return False, system
    put_sum(state.q, inside * reach, mode, beside)
    put_forces(weak, table, most * normal, most * shear)
    return True, with_stiffness(weak, given.stiffness, given.grip)


@kernel
def _gradient_error(system, state):
    """Return how large rounding errors may make the gradient, as `gradient_noise` does, in J."""
    return gradient_noise(system, state) * np.sqrt(dot(state.q, state.q) + bending_energy(system))


@kernel
def _lowest(system, state, tolerance, exact):
    """Return the smallest eigenvalue, on what a grip leaves free, and its mode."""
    always, none = exact > 0.0, 0 * state.q.shape[0]
    _, _, stability, _, mode, _, _ = newton_descent(
        system, state.q, thorough(tolerance, exact, none, always, not always),
        new_workspace(system))
    return stability, mode
