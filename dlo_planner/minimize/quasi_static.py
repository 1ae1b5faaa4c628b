# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO comes to rest among obstacles from anywhere: pseudo-transient continuation.

The DLO follows its gradient flow, in the metric of elasticity, by linearly implicit steps,

    (H + shift I) dq = -gradient + forces of contacts,

in which contacts obey their laws exactly, about linear geometry (`minimize.interior_point`). The
shift becomes small as the flow comes to rest, and then this is Newton's method (Kelley and Keyes,
SIAM J. Numer. Anal. 35, 1998). A step is good if the gradient after it is about what it should be;
the shift is chosen by that. No potential is asked: friction has none. It counts from where the DLO
was before the gripper moved.

All that is near an obstacle is a candidate for contact: nodes, and points inside elements that are
nearer than these. A point stays where it is on the DLO during a step, and is chosen anew after it;
one that bears alone rolls to where the DLO is nearest, which is as stiff as the DLO itself where it
bends but little more than the obstacle. The step has the second derivative of that.
"""

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.gap import (
    clear_between,
    gap_at,
    is_face,
    minima_in_element,
    near_gaps,
    node_gap,
    node_range,
    slope_along,
    taper,
)
from dlo_planner.energy.grip import move_multipliers
from dlo_planner.energy.inertia import has_inertia
from dlo_planner.energy.potential import project
from dlo_planner.energy.problem import (
    bending_energy,
    is_to_end,
    new_configuration,
    with_gripper,
)
from dlo_planner.energy.scene import MESH, is_convex, translated
from dlo_planner.energy.terms import forbids
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import put_sum, replaced
from dlo_planner.geometry.so3 import matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import contact_candidates, gap_slope, rolled_to
from dlo_planner.minimize.contact_table import (
    kkt_residual,
    place_before,
    with_contacts,
    with_contacts_of,
    with_springs,
)
from dlo_planner.minimize.hessian import assemble, largest_turn, new_hessian
from dlo_planner.minimize.interior_point import (
    add_twist,
    exact_step,
    interior_step,
    new_answer,
    put_change,
    step_laws,
    world_forces,
)
from dlo_planner.minimize.kkt import add_to, dot
from dlo_planner.minimize.relaxation import deepest
from dlo_planner.minimize.semismooth import (
    crosses_a_sheet,
    farthest_of_halved,
    forces,
    is_halfway,
    no_reaction,
    place,
    put_halved,
)

_COST = 30        # of a step, relative to one of Newton's method for a DLO that hangs freely
_TURN = 0.5       # rad: no step turns a node by more
_NEAR, _FARTHEST = 0.05, 0.5  # of the length: candidates have smaller gaps, at first and at most
_CLOSELY = 0.01   # of the length: the same, of a step that only mends the error of a mesh
_FARTHER = 4.0    # times that reach, where a step has met what was not seen
# The shift, relative to elasticity and loads: where it begins, its least and most, times the first
_LEAST_SHIFT, _FLOOR, _MOST_SHIFT = 1e-3, 1e-4, 1e9
_SLIGHTLY = 1e-2  # times the first one: one that hardly counts
_LARGER, _SMALLER = 4.0, 0.1  # most and least that it is multiplied by
# Steps in which it has not stood with the shift at first, and steps in a row after which more is
# left to be balanced than before them: it falls. Of 1764 flows in scenes of contact that were
# followed only so far 62 of 182 in vain end sooner, by ten steps of them, and 5 that came to rest
_LOST, _GROWS = 3, 4
_FADES = 0.25     # of a shift with which the DLO did not stand: as it falls its curvature changes
_AIM, _BAD = 0.3, 1.0  # wrong part of the gradient after a step: as it should be; too large
_EASY, _QUIET = 0.02, 1e-3  # rad, residual: after such a step contacts hardly change
# Below such a residual contacts give less, by this factor. What neighbours give decides how soon
# their shares of a force settle: in each step all is left but 1 / (1 + g / f) of what was wrong,
# with g what they give and f what the DLO between them does, which is a tenth of it and less.
# Farther from rest firm contacts lock what has to roll and slide.
_NEARLY, _FIRMER = 1e-4, 1e-2
# A DLO has left a saddle once it has turned by so much, rad, or after so many steps: before, a step
# of Newton's method would lead back; with more, another equilibrium is near
_AWAY, _LEAVING = 0.1, 40
_NOTHING = 1e-12  # rad: a step that turns nodes by less is of rounding
_DEEPER = 0.3     # of a step: how much deeper than foreseen it may bring a contact
_DEEPEST = 2e-3   # of the length, about a radius: the same, however far it goes. Deeper in a thin
# body the other side is nearer
_SLIGHT = 1e-5    # of the length: a depth that is always allowed
_DEPTH = 10.0     # times the residual, of the length: how deep a contact may be at the end
_SOFT = 1e-10     # of the loads per length: springs that hardly push
_TINY = 1e-15     # of the loads: the force of a candidate
_BEARS = 1e-6     # of the loads that an element has: a smaller force is none
_FIRM = 1e2       # times that: a force that is one in spite of a gap
_STICKS = 0.99    # of its limit: friction below holds what it acts on
# Of the length: a point inside an element is a candidate that is deeper in an obstacle than its
# nodes by this much; far from rest by as much as the residual times the second, at most the third
_FINE, _FINER, _COARSE = 1e-7, 1e-5, 2e-6
_BULGES = 1e-3    # of an element: one that comes nearer than its nodes by more is watched there
_APART, _SAME = 0.02, 1e-9  # of an element: points that are nearer are one; differ by rounding
_ALONE = 3        # elements: on points that bear nearer to each other a DLO lies
_FLAT = 1e-3      # rad: on an element that turns by less against a body no point rolls
_BESIDE = 0.01    # of an element: a point in it is not nearer to a node


@kernel
def settle(system, q, previous, rough, most, farthest, flow):
    """Return Problem with its contact forces, unknowns, steps, residual, where the flow rests.

    At rest the residual is below `rough`, and no contact is deeper than `_DEPTH` times that, of the
    length. The flow also ends after `most` steps, and, with an infinite residual, where all of them
    have turned nodes by more than `farthest`, rad. If that is finite, also where the DLO leaves
    what was an equilibrium before, and is none any more; and in the step of a motion where a DLO
    that is pressed along itself into an obstacle does not move: it has to buckle. `flow` (2,) is
    the shift, here and where it ends, and its least while the DLO leaves a saddle: with a smaller
    one the flow would lead back.
    The last value returned is whether the DLO does not stand there with a smaller one.
    """
    hold, length = system.effects.hold, np.sum(system.lengths)
    system = _without_springs(system)
    hold, held = system.effects.hold, hold
    reaction, whole = no_reaction(system), loads_on(system)
    least, near = _least_shift(system), _NEAR * length
    state, hessian = new_configuration(system), new_hessian(system)
    trial, right, wrong = new_configuration(system), np.empty_like(q), np.empty_like(q)
    state.q[:] = q
    place(system, state)
    loaded = with_candidates(system, state, previous, near, whole, 1.0, _TURN)
    state, residual, table, _ = kkt_residual(loaded, state.q)
    shift, steps, stands, easy, falls, made = flow[0], 0, False, True, False, False
    lower, last = 0.0, _TURN  # a shift with which it did not stand, of late
    lost = grows = 0  # steps in which it did not, and in a row that have left more to be balanced
    floor, largest, worked, gone = _FLOOR * least, _MOST_SHIFT * least, np.zeros(1), 0.0
    away = _AWAY if flow[1] == 0.0 else 0.0
    moves_on = has_inertia(system.effects.anchor)
    while steps < most and shift < largest and gone <= farthest:
        if farthest < np.inf and lost >= _LOST and grows >= _GROWS:
            gone = np.inf
            break
        if away < _AWAY and steps < _LEAVING:
            shift = max(shift, flow[1])
        known = (stands or falls or shift < _SLIGHTLY * least) and not (
            away < _AWAY and steps < _LEAVING)
        # (what has gone along with its gripper is in balance, but may rub the wrong way)
        if known and made and residual < rough and deepest(table) < (
                max(_DEPTH * rough, 2.0 * _FINE) * length):
            break
        # (what is straight and pressed along itself yields to second order alone: it has to buckle;
        # at rest a column leaves its saddle by the shift)
        if (moves_on and made and residual < rough and last < _NOTHING
                and deepest(table) > _DEPTH * rough * length):
            break
        steps += 1
        if is_to_end(worked, system, _COST):
            break
        tried = shift
        part, error, turn, met = 0.0, np.inf, np.inf, False
        _, shear = forces(table, state)
        laws = step_laws(loaded, state, table, shear, 1.0 / (1.0 + shift), reaction.size)
        if residual < _NEARLY:
            laws = replaced(laws, 'give', _FIRMER * laws.give)
        answer, force = new_answer(q.shape[0], table.gap.size), np.zeros((table.gap.size, 3))
        found, shift = exact_step(loaded, state, hessian, laws, shift, floor, largest,
                                  easy and lower == 0.0, force, answer, reaction)
        if found < 1:
            found, shift = interior_step(loaded, state, hessian, laws, shift, floor, largest, easy,
                                         force, answer, reaction)
        if found > 0:
            turn = largest_turn(loaded, hessian, answer.step)
            if turn < np.inf:
                part = min(1.0, _TURN / max(_TURN, turn))
        if part > 0.0:
            put_sum(state.q, part, answer.step, trial.q)
            place(system, trial)
            met = (not crosses_a_sheet(loaded, state)
                   and forbids(system.effects, system, state, trial))
        if part > 0.0 and not met:
            for a in range(table.gap.size):
                for i in range(3):
                    force[a, i] = laws.first[a, i] + part * (force[a, i] - laws.first[a, i])
            normal, shear = world_forces(laws, force)
            after = _rolled(with_forces(loaded, table, normal, shear, whole), table, trial)
            move_multipliers(hold, part, reaction)
            there, later, its_table, _ = kkt_residual(after, trial.q)
            put_sum(there.gradient, part * shift, answer.step, wrong)
            add_to(wrong, part - 1.0, state.gradient)
            put_change(loaded, state, hessian, laws, force, part, right)
            left, error = dot(wrong, wrong), 0.0
            size = max(dot(right, right), part * part * shift * shift * dot(answer.step,
                                                                            answer.step))
            if left != 0.0:  # else it rests already, as a DLO upright on its tip may
                error = np.sqrt(left / size) if size > 0.0 else np.inf
            after = with_candidates(after, there, previous, near, whole, later, part * turn)
            there, later, its_table, _ = kkt_residual(after, there.q)
            moved = part * turn * length
            unseen = deepest(its_table) - deepest(table) - _SLIGHT * length
            if error < _BAD and unseen > _DEEPER * moved and near < _FARTHEST * length:
                near = min(_FARTHER * near, _FARTHEST * length)
                move_multipliers(hold, -part, reaction)
                loaded = with_candidates(loaded, state, previous, near, whole, residual, last)
                state, residual, table, _ = kkt_residual(loaded, state.q)
                continue
            if unseen > 0.0:
                error = max(error, unseen / min(_DEEPER * moved, _DEEPEST * length))
            if not error < _BAD:
                error = np.inf  # it may be no number
                move_multipliers(hold, -part, reaction)
        made = error < _BAD
        if made:
            stands, easy = shift == 0.0 and part == 1.0, turn < _EASY and later < _QUIET
            # (what leaves a saddle goes the faster the farther it is; else it comes to rest)
            rests = steps > 1 and later < rough and part * turn < last
            last = part * turn
            away, gone = _AWAY if rests else away + last, gone + last
            grows = grows + 1 if later > residual else 0
            loaded, state, residual, table = after, there, later, its_table
        falls = found < 1 or shift > tried
        if falls:
            lost += 1
            lower = max(lower, tried, floor)
        elif made:
            lower = _FADES * lower if lower > floor else 0.0
        shift = next_shift(shift, error, lower, floor)
    flow[0], flow[1] = shift if shift < largest else 0.0, 0.0
    return (_with_hold(loaded, held), state.q, steps, residual if gone <= farthest else np.inf,
            falls)


@kernel
def _with_hold(system, hold):
    """Return the same Problem with other HoldRows."""
    return replaced(system, 'effects', replaced(system.effects, 'hold', hold))


@kernel
def _without_springs(system):
    """Return the same Problem; what is held has no springs, but forces.

    They would push against what a step turns to second order.
    """
    hold = system.effects.hold
    return _with_hold(system, replaced(hold, 'stiffness', 0.0, 'turn_stiffness', 0.0))


@kernel
def without_friction(system):
    """Return the same Problem; what is set down slides as it comes to rest."""
    contact = system.effects.contact
    return with_contacts(system, contact.contacts, replaced(
        contact.scene, 'friction', np.zeros_like(contact.scene.friction)))


@kernel
def carried(system, q, previous, base):
    """Return whether a DLO that bears follows its gripper to first order, its unknowns (m, 3) then.

    And the Problem, with the forces there. Geometry is linear about where it was, before its
    gripper moved from `base` (3, 3) and from its first place in `previous` (N + 1, 6). Where the
    gripper has moved alone, the DLO may be in obstacles, and nearest to the wrong side of them.
    """
    length, whole = np.sum(system.lengths), loads_on(system)
    shift, turn, twist = np.empty(3), np.empty(3), np.empty(6)
    there, after = previous.copy(), new_configuration(system)
    for i in range(3):
        shift[i] = -previous[0, i]
    for k in range(previous.shape[0]):
        for i in range(3):
            there[k, i] += shift[i]
    now = system.effects.contact
    before = with_gripper(
        with_contacts(system, replaced(now.contacts, 'anchor', now.contacts.anchor + shift),
                      translated(now.scene, -shift)), base, system.origin - shift)
    state, hessian, reaction = new_configuration(before), new_hessian(before), no_reaction(system)
    state.q[:] = q
    place(before, state)
    for k in range(previous.shape[0]):  # else it has another past
        for i in range(3):
            if not abs(state.positions[k, i] - there[k, i]) < _SLIGHT * length:
                return False, q, system
    put_vector(rotation_vector(times_transposed(matrix(system.base), matrix(base))), turn)
    twist[:3], twist[3:] = turn, shift
    loaded = with_candidates(before, state, there, _NEAR * length, whole, 0.0, _TURN)
    state, _, table, _ = kkt_residual(loaded, state.q)
    _, shear = forces(table, state)
    laws = step_laws(loaded, state, table, shear, 1.0, reaction.size)
    assemble(loaded, state, hessian)
    loads, load = np.zeros((system.lengths.size, 3)), np.empty_like(q)
    for e in range(loads.shape[0]):
        for i in range(3):
            for c in range(hessian.cross.shape[2]):
                loads[e, i] += hessian.cross[e, i, c] * twist[c]
    project(system.basis, loads, load)
    add_to(state.gradient, 1.0, load)
    add_twist(laws.rows, twist, laws.gap, laws.slid)
    answer, force = new_answer(q.shape[0], table.gap.size), np.zeros((table.gap.size, 3))
    found, _ = exact_step(loaded, state, hessian, laws, 0.0, _SLIGHTLY, _SLIGHTLY, True, force,
                          answer, reaction)
    if found < 1:
        found, _ = interior_step(loaded, state, hessian, laws, 0.0, _SLIGHTLY, _SLIGHTLY, found < 1,
                                 force, answer, reaction)
    if found < 1 or not largest_turn(loaded, hessian, answer.step) < _TURN:
        return False, q, system
    for k in range(state.positions.shape[0]):
        for i in range(3):
            state.positions[k, i] -= shift[i]
    for part in (1.0, 0.0):  # what turns far bends into a wall, more so if it does not follow
        put_sum(q, part, answer.step, after.q)
        place(system, after)
        met = sweeps_through(now.scene, system.lengths, state.strains, state.rotations,
                             state.positions, after.rotations, after.positions)
        if not met:
            break
    if part == 0.0 and not met:
        return False, q, system
    put_sum(q, 1.0, answer.step, after.q)
    normal, shear = world_forces(laws, force)
    contacts = with_forces(loaded, table, normal, shear, whole).effects.contact.contacts
    return True, after.q, with_contacts(
        system, replaced(contacts, 'anchor', contacts.anchor - shift), now.scene)


@kernel
def settling(system, strains, positions, previous):
    """Return how far, in m, the first step of the flow moves nodes where elements are halved.

    It has the least shift with which the DLO stands. Infinite where there is no such step, or the
    DLO falls. Shapes: strains (N, 3), positions (N + 1, 3); previous (2 N + 1, 6), as of `settle`.
    """
    length, most, system = np.sum(system.lengths), _least_shift(system), _without_springs(system)
    state, hessian, reaction = new_configuration(system), new_hessian(system), no_reaction(system)
    put_halved(system, strains, state)
    loaded = with_candidates(system, state, previous, _CLOSELY * length, loads_on(system), 0.0,
                             _TURN)
    state, _, table, _ = kkt_residual(loaded, state.q)
    _, shear = forces(table, state)
    laws = step_laws(loaded, state, table, shear, 1.0, reaction.size)
    answer, force = new_answer(state.q.shape[0], table.gap.size), np.zeros((table.gap.size, 3))
    found, shift = exact_step(loaded, state, hessian, laws, 0.0, _FLOOR * most, most, True, force,
                              answer, reaction)
    if found < 1:
        found, _ = interior_step(loaded, state, hessian, laws, shift, _FLOOR * most, most, True,
                                 force, answer, reaction)
    if found < 1 or not largest_turn(loaded, hessian, answer.step) < _TURN:
        return np.inf
    put_sum(state.q, 1.0, answer.step, state.q)
    place(loaded, state)
    return farthest_of_halved(state, positions)


@kernel
def _least_shift(system):
    """Return the shift with which a flow begins where it has one, relative to all that acts."""
    rigidity = bending_energy(system) / np.sum(system.lengths)
    return _LEAST_SHIFT * (1.0 + np.sum(np.abs(system.effects.load.pull)) / rigidity)


@kernel
def next_shift(shift, error, lower, floor):
    """Return the shift of the next step of a flow, after one with such an error.

    The error is infinite if the step was not made. Where the DLO falls its flow leaves an
    equilibrium that is none any more, the faster the nearer the shift is to that with which it does
    not stand. It is approached from above.

    Args:
        lower: with which the DLO did not stand of late, 0 if it did
        floor: smaller shifts are none
    """
    factor = error / _AIM
    if factor > 1.0:
        return max(shift, floor) * min(factor * factor, _LARGER)
    smaller = shift * max(factor, _SMALLER)
    if lower > 0.0:
        smaller = max(smaller, np.sqrt(lower * shift))
    return smaller if smaller >= floor else 0.0


@kernel
def loads_on(system):
    """Return the size of all forces on a DLO, N: of loads and of its own rigidity."""
    length = np.sum(system.lengths)
    return np.sum(np.abs(system.effects.load.pull)) + bending_energy(system) / length


@kernel
def with_candidates(system, state, previous, near, whole, residual, turn):
    """Return the Problem whose contacts are all that is near: nodes, and points inside elements.

    With the forces of those that were known, and next to none of others. All that may rub has a
    point of friction, whose force is a load. A point that bears alone rolls, if nodes turn by no
    more than `turn`, rad, in a step.
    """
    scene, old, lengths = (system.effects.contact.scene, system.effects.contact.contacts,
                           system.lengths)
    n, k = lengths.size, _SOFT * whole / np.sum(lengths)
    tiny = _TINY * whole
    fine = np.sum(lengths) * min(max(_FINE, _FINER * residual), _COARSE)
    most = scene.kind.size * 3 * n + old.element.size + 1
    element, obstacle = np.empty(2 * most, dtype=np.int64), np.empty(2 * most, dtype=np.int64)
    multiplier, fraction = np.zeros(2 * most), np.zeros(2 * most)
    anchor, normals, shear = np.zeros((2 * most, 3)), np.zeros((2 * most, 3)), np.zeros(
        (2 * most, 3))
    node = np.zeros_like(old.node)
    (at, places), held = rolled_to(system, state), old.multiplier.copy()
    faces, bears, alone = False, _BEARS * whole / n, np.zeros(at.size, dtype=np.bool_)
    rolled = places.copy()
    for b in range(at.size):
        alone[b] = _is_alone(old, at, held, b, bears)
    # (a body that an element touches is nearer to both its nodes than the element is long)
    seen = max(near, np.max(lengths))
    gap2, where = np.empty(2), np.empty(2)
    x, normal, hessian, offset = np.empty(3), np.empty((n + 1, 3)), np.empty((3, 3)), np.zeros(
        (n + 1, 2))
    count = 0
    for o in range(scene.kind.size):
        if is_face(scene, o):
            faces = True
            continue
        pushes = old.node[o]
        gaps = near_gaps(scene, o, lengths, pushes, state.strains, state.rotations,
                         state.positions, seen)
        begin, end = node_range(scene, o, n)
        for b in range(max(1, begin), end + 1):
            if gaps[b] < np.inf:
                node_gap(scene, o, b, state.rotations, state.positions, offset[b], x, normal[b],
                         hessian)
        for b in range(max(1, begin), end + 1):
            if not gaps[b] < near or is_halfway(scene, o, b, gaps[b]):
                continue
            node[o, b] = max(pushes[b], tiny) + k * gaps[b]
            if scene.friction[o] > 0.0:
                element[count], obstacle[count], fraction[count] = b - 1, -1 - o, 1.0
                normals[count] = normal[b]
                count += 1
        first = begin
        if begin == 0:  # (the gripper's end is no candidate, but its element may be)
            gaps[0] = node_gap(scene, o, 0, state.rotations, state.positions, offset[0], x,
                               normal[0], hessian)
        for e in range(first, end):
            close = min(gaps[e], gaps[e + 1])
            if not close < 0.5 * lengths[e] or max(gaps[e], gaps[e + 1]) == np.inf:
                continue
            if scene.kind[o] == MESH and clear_between(
                    scene, o, e, gaps[e], gaps[e + 1], lengths, state.strains, state.rotations,
                    state.positions):
                continue
            grows = taper(scene, o, e) / lengths[e]
            if is_convex(scene, o) and (
                    gap_slope(state.rotations[e], state.strains[e], offset[e], normal[e]) >= grows
                    or gap_slope(state.rotations[e + 1], state.strains[e], offset[e + 1],
                                 normal[e + 1]) <= grows):
                continue  # a convex body is nearest at a node
            found = minima_in_element(scene, o, e, lengths, state.strains, state.rotations,
                                      state.positions, gap2, where)
            for c in range(found):
                if not (gap2[c] < close - _BULGES * lengths[e] or gap2[c] < min(0.0, close) - fine):
                    continue
                f, known, nearest = min(max(where[c], _BESIDE), 1.0 - _BESIDE), -1, _APART
                for b in range(old.element.size):
                    if alone[b] and old.obstacle[b] == o and abs(places[b] - e - f) < 1.0:
                        at[b], places[b] = e, e + f
                    if (old.obstacle[b] == o and at[b] == e and held[b] > bears
                            and abs(places[b] - e - f) < nearest):
                        known, nearest = b, abs(places[b] - e - f)
                if known >= 0 and gap2[c] < -fine:  # it rolls there, and joins what is there
                    for b in range(old.element.size):
                        if (b != known and old.obstacle[b] == o and at[b] == e and held[b] > bears
                                and abs(places[b] - e - f) < _APART):
                            held[known] += held[b]
                            held[b] = 0.0
                    places[known] = e + f
                if known >= 0:
                    continue
                element[count], obstacle[count], fraction[count] = e, o, f
                multiplier[count] = tiny + k * gap2[c]
                count += 1
                if scene.friction[o] > 0.0:
                    element[count], obstacle[count], fraction[count] = e, -1 - o, f
                    _put_normal(scene, system, state, o, e, f, normals[count])
                    count += 1
    for b in range(old.element.size):  # what bears goes on
        o = old.obstacle[b]
        if o < 0 or is_face(scene, o) or not held[b] > bears:
            continue
        f = min(max(places[b] - at[b], _SAME), 1.0 - _SAME)
        rolls = alone[b] and _rolls_at(system, state, o, at[b], f, turn)
        if not rolls:
            f = min(max(f, _BESIDE), 1.0 - _BESIDE)
        element[count], obstacle[count], fraction[count] = at[b], o, -f if rolls else f
        multiplier[count] = held[b]
        count += 1
        if scene.friction[o] > 0.0:
            element[count], obstacle[count], fraction[count] = at[b], -1 - o, f
            _put_normal(scene, system, state, o, at[b], f, normals[count])
            count += 1
    if faces:
        inside, _ = contact_candidates(system, state, places)
        for c in range(inside.shape[0]):
            e, o = inside[c]
            if is_face(scene, o):
                best = -1
                for b in range(old.element.size):
                    if old.obstacle[b] == o and abs(at[b] - e) <= 1:
                        best = b
                element[count], obstacle[count] = e, o
                multiplier[count] = tiny + (max(0.0, old.multiplier[best]) if best >= 0 else 0.0)
                count += 1
    for b in range(old.element.size):  # friction goes on where it is by now
        if old.obstacle[b] >= 0:
            continue
        place, best, nearest = (_place_of(old, rolled, places, b), -1,
                                _SAME if old.fraction[b] == 1.0 else _APART)
        for c in range(count):
            if obstacle[c] == old.obstacle[b] and (old.fraction[b] == 1.0) == (fraction[c] == 1.0):
                away = abs(place - element[c] - fraction[c])
                if away < nearest:
                    best, nearest = c, away
        if best >= 0:
            for i in range(3):
                shear[best, i] += old.shear[b, i]
    for c in range(count):
        if obstacle[c] >= 0:
            continue
        place_before(system, state, previous, element[c], fraction[c], anchor[c])
        size = along = 0.0
        for i in range(3):
            along += shear[c, i] * normals[c, i]
        for i in range(3):
            shear[c, i] -= along * normals[c, i]
            size += shear[c, i] ** 2
        multiplier[c] = 2.0 * np.sqrt(size) + tiny
    contacts = with_contacts_of(
        with_springs(old, k, node, old.multiplier), element[:count], obstacle[:count],
        multiplier[:count], fraction[:count], anchor[:count], normals[:count], shear[:count])
    return with_contacts(system, _with_grip(contacts, k), scene)


@kernel
def _rolls_at(system, state, o, e, f, turn):
    """Whether a point of element e is where that is nearest to a body, and rolls along it.

    Where nodes turn by more than the element does, those beside it are met.
    """
    scene = system.effects.contact.scene
    rotation, x, offset, point = np.empty((3, 3)), np.empty(3), np.zeros(2), np.empty(3)
    normal, hessian, length = np.empty(3), np.empty((3, 3)), system.lengths[e]
    point_inside(system.lengths, state.strains, state.rotations, state.positions, e, f, rotation, x)
    gap_at(scene, o, rotation, x, 0.0, offset, point, normal, hessian)
    slope, curve = slope_along(scene, o, rotation, state.strains[e], offset, normal, hessian)
    slope -= taper(scene, o, e) / length
    return (curve * length > max(turn, _FLAT) and abs(slope) < _APART * curve * length)


@kernel
def _is_alone(contacts, at, held, b, bears):
    """Whether a point of contact bears, and no other one on its body within a few elements."""
    o, e = contacts.obstacle[b], at[b]
    if o < 0 or not held[b] > bears:
        return False
    for k in range(max(1, e - _ALONE), min(contacts.node.shape[1], e + 2 + _ALONE)):
        if contacts.node[o, k] > bears:
            return False
    for c in range(at.size):
        if c != b and contacts.obstacle[c] == o and abs(at[c] - e) <= _ALONE and held[c] > bears:
            return False
    return True


@kernel
def _place_of(contacts, rolled, places, b):
    """Return where friction b goes on, element and fraction: with the point that it belongs to.

    Args:
        rolled, places: (C,) where points have rolled to, and where they go on
    """
    place = contacts.element[b] + contacts.fraction[b]
    for c in range(places.size):
        if contacts.obstacle[c] == -1 - contacts.obstacle[b] and (
                abs(rolled[c] - place) < _SAME
                or contacts.element[c] + abs(contacts.fraction[c]) == place):
            return places[c]
    return place


@kernel
def _rolled(system, table, state):
    """Return the Problem whose friction acts where the points of a table have rolled to."""
    old = system.effects.contact.contacts
    at, places = rolled_to(system, state)
    element, fraction = old.element.copy(), old.fraction.copy()
    for a in range(table.gap.size):
        b, c = table.inside[a], table.rubbing[a]
        if b >= 0 and c >= 0 and old.fraction[b] < 0.0:
            element[c] = at[b]
            fraction[c] = min(max(places[b] - at[b], _SAME), 1.0 - _SAME)
    return with_contacts(system, replaced(old, 'element', element, 'fraction', fraction),
                         system.effects.contact.scene)


@kernel
def _with_grip(contacts, grip):
    """Return the same ContactSet with points of friction of another stiffness, N/m."""
    return replaced(contacts, 'grip', grip)


@kernel
def _put_normal(scene, system, state, o, e, fraction, normal):
    """Fill the normal (3,) of a body at a point inside an element."""
    rotation, x, offset, point, hessian = (np.empty((3, 3)), np.empty(3), np.zeros(2), np.empty(3),
                                           np.empty((3, 3)))
    point_inside(system.lengths, state.strains, state.rotations, state.positions, e, fraction,
                 rotation, x)
    gap_at(scene, o, rotation, x, 0.0, offset, point, normal, hessian)


@kernel
def with_forces(system, table, normal, shear, whole):
    """Return the Problem with forces, normal (A,) and across (A, 3), of the contacts in a table."""
    old = system.effects.contact.contacts
    tiny = _TINY * whole
    contacts = replaced(old, 'node', old.node.copy(), 'multiplier', old.multiplier.copy(),
                        'shear', old.shear.copy())
    for a in range(table.gap.size):
        force, c = max(normal[a], tiny), table.rubbing[a]
        if table.inside[a] < 0:
            contacts.node[table.obstacle[a], table.element[a] + 1] = force
        else:
            contacts.multiplier[table.inside[a]] = force
        if c >= 0:
            size = 0.0
            for i in range(3):
                contacts.shear[c, i] = shear[a, i]
                size += shear[a, i] ** 2
            contacts.multiplier[c] = 2.0 * np.sqrt(size) + tiny
    return with_contacts(system, contacts, system.effects.contact.scene)


@kernel
def with_bearing(system, q, given, exactly):
    """Return the Problem with the contacts that bear alone at q (m, 3), their springs as `given`.

    `exactly`: their multipliers are such that springs push with the forces that there are.
    """
    whole = loads_on(system)
    state, _, table, _ = kkt_residual(system, q)
    scene, old = system.effects.contact.scene, system.effects.contact.contacts
    friction, bears = scene.friction, _BEARS * whole / system.lengths.size
    fine = _FINE * np.sum(system.lengths)
    normal, shear = forces(table, state)
    kept = np.zeros(old.element.size, dtype=np.bool_)
    node, multiplier, fraction = (np.zeros_like(old.node), np.zeros(old.element.size),
                                  old.fraction.copy())
    rotation, x, traction, normals = (np.empty((3, 3)), np.empty(3), old.shear.copy(),
                                      old.normal.copy())
    for a in range(table.gap.size):
        if not (normal[a] > bears and (table.gap[a] < fine or normal[a] > _FIRM * bears)):
            continue
        o, c = table.obstacle[a], table.inside[a]
        spring = given.stiffness * table.gap[a] if exactly else 0.0
        if c < 0:
            node[o, table.element[a] + 1] = normal[a] + spring
        else:
            kept[c], multiplier[c] = True, normal[a] + spring
        c = table.rubbing[a]
        if c >= 0:
            limit, out = friction[o] * normal[a], 0.0
            kept[c], multiplier[c] = True, limit
            for i in range(3):
                normals[c, i] = table.normal[a, i]
                out += shear[a, i] * table.normal[a, i]
            for i in range(3):
                shear[a, i] -= out * table.normal[a, i]
                traction[c, i] = shear[a, i]
            point_inside(system.lengths, state.strains, state.rotations, state.positions,
                         old.element[c], old.fraction[c], rotation, x)
            size = np.sqrt(np.sum(shear[a] ** 2))
            out = along = 0.0
            for i in range(3):
                x[i] -= old.anchor[c, i]
                out += x[i] * normals[c, i]
            for i in range(3):
                x[i] -= out * normals[c, i]
                along += x[i] * shear[a, i]
            # what sticks has its force wherever in the compliance of the step it has come to rest;
            # what slides does so along its friction, as exactly as a step is solved
            slides = along > fine * size and size > _STICKS * limit
            if exactly:
                for i in range(3):
                    traction[c, i] -= given.grip * (
                        x[i] - (along * shear[a, i] / (size * size) if slides else 0.0))
    springs = _with_grip(with_springs(old, given.stiffness, node, multiplier), given.grip)
    contacts = with_contacts_of(springs, old.element[kept], old.obstacle[kept], multiplier[kept],
                                fraction[kept], old.anchor[kept], normals[kept],
                                traction[kept])
    return with_contacts(system, contacts, scene)
