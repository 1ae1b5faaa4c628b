# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shape and contact forces at once: a semismooth Newton method (Alart and Curnier 1991).

With the compliance of the DLO at its contacts, from solves with Newton's Hessian, all multipliers
follow to first order, with the reaction of a held far end: no gap where it bears, no sliding where
it sticks, mu times the force where it slides. Where that cannot be trusted each multiplier becomes
the force that it has (augmented Lagrangian).

In `semismooth_newton` the springs of contacts push with the forces themselves, whatever their gaps
are, so that a gap of the start is closed by the forces and not fought by the springs. It begins
where a DLO that goes on bearing would be carried by its gripper. What it finds is a start: the
minimizer alone tells whether something else touches, and whether the shape falls.
"""

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.contact import trial_traction
from dlo_planner.energy.gap import closest_point, near_nodes, next_touching, node_gap
from dlo_planner.energy.grip import constraint_value, move_multipliers
from dlo_planner.energy.inertia import has_inertia
from dlo_planner.energy.potential import at_elements, evaluate, project, unknowns_of
from dlo_planner.energy.problem import new_configuration, with_gripper
from dlo_planner.energy.scene import translated
from dlo_planner.energy.terms import forbids, row_count
from dlo_planner.geometry.kinematics import forward_kinematics, part_of_element, point_inside
from dlo_planner.geometry.record import copy, put_sum, replaced
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import free_to_roll
from dlo_planner.minimize.contact_table import (
    kkt_residual,
    touching,
    update_friction,
    with_contacts,
    with_springs,
)
from dlo_planner.minimize.dense import softly_solved
from dlo_planner.minimize.hessian import (
    assemble,
    factorize,
    is_definite,
    largest_turn,
    new_hessian,
    solve,
    solve_held,
)
from dlo_planner.minimize.kkt import add_to, dot, put_scaled
from dlo_planner.minimize.newton import HELD_NEUTRAL, is_held

_SOFT = 1e-3      # of a spring's compliance, added: contacts that depend on each other share
_REFINED = 2      # times: what is soft counts a thousandth as much after each
_CHANGES = 8      # times that contacts are let go or taken back
_FARTHEST = 0.02  # of the length: a prediction that moves a contact farther is none
_TOILS = 2        # rounds in vain, after which what is soft goes with its forces
_FARTHEST_TURN = 0.3  # rad: the same, of what a node turns by
_STEPS = 24
_LARGEST_TURN = 0.3  # rad: of a node in the gripper, by a step; a longer one is a guess
_FALLS = 0.5         # of the error before: what falls less does not converge
_STALE = 1e3         # 1/rad: of a residual, what an old factorization leaves per rad turned since
_GRACE = 3           # first steps, in which it may do so
_LONG = 6            # steps after which contacts that still change may go round in circles
_HARDLY = 1e-9       # of its springs' force: what a contact that begins to bear pushes with


@kernel
def update_multipliers(system, state, table, share, q, vain):
    """Move the multipliers of `system`, in place, to what the laws ask for.

    After some rounds in vain q (m, 3) goes with them: what is soft, like the plane in which a
    column buckles, would go anywhere on its way to where the new multipliers belong.
    """
    normal, shear = forces(table, state)
    used = share > 0.0 and table.gap.size > 0
    if used:
        target, across, hessian = normal.copy(), shear.copy(), new_hessian(system)
        step = np.empty_like(q)
        used = complementarity_step(system, state, table, hessian, used, vain > _TOILS,
                                    not is_held(system), target, across, step, _no_reaction(system))
        if used:
            there = new_configuration(system)
            put_sum(q, share, step, there.q)
            evaluate(system, there)
            if (vain > _TOILS and largest_turn(system, hessian, step) < _FARTHEST_TURN
                    and not forbids(system.effects, system, state, there)):
                q[:] = there.q
            for a in range(table.gap.size):
                normal[a] += share * (target[a] - normal[a])
                for i in range(3):
                    shear[a, i] += share * (across[a, i] - shear[a, i])
    put_forces(system, table, normal, shear)
    return used


@kernel
def forces(table, state):
    """Return the forces of the contacts in a table: normal (A,) and across (A, 3), N."""
    shear = np.zeros((table.gap.size, 3))
    for a in range(table.gap.size):
        if table.rubbing[a] >= 0:
            shear[a] = state.attached.force[table.rubbing[a]]
    return table.force.copy(), shear


@kernel
def put_forces(system, table, normal, shear):
    """Make forces, normal (A,) and across (A, 3), the multipliers of `system`, in place."""
    contacts, friction = system.effects.contact.contacts, system.effects.contact.scene.friction
    contacts.node[:] = 0.0
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            contacts.multiplier[c] = 0.0
    for a in range(table.gap.size):
        o, e, c = table.obstacle[a], table.element[a], table.rubbing[a]
        force = max(0.0, normal[a])
        if table.inside[a] < 0:
            contacts.node[o, e + 1] = force
        else:
            contacts.multiplier[table.inside[a]] = force
        if c >= 0:
            limit = friction[o] * force
            contacts.multiplier[c] = limit
            size = max(limit, np.sqrt(np.sum(shear[a] ** 2)))
            for i in range(3):
                contacts.shear[c, i] = shear[a, i] * limit / size if size > 0.0 else 0.0


@kernel
def complementarity_step(system, state, table, hessian, fresh, neutral, exchanges, normal, shear,
                         step, reaction):
    """Fill the forces that satisfy the linearized laws, and the step to where they do.

    And the change of the reaction (K,) of a held far end. `exchanges`: whether contacts are let go.
    """
    contacts = system.effects.contact.contacts
    if fresh:
        assemble(system, state, hessian)
        if not _stands(system, hessian, neutral):
            return False
    count = table.gap.size
    first = np.empty(count, dtype=np.int64)  # row of the normal; of a friction's two, the next
    size = 0
    for a in range(count):
        first[a] = size
        size += 1 if table.rubbing[a] < 0 else 3
    axes, laws = np.zeros((size, 3)), np.zeros((size, 3))
    linearize_contact_law(system, state, table, first, axes, laws)
    loads, answers = _answers(system, state, hessian, table, first, axes)
    compliance = _products(loads, answers)
    miss, right, free = np.zeros_like(reaction), np.empty_like(step), np.empty(size)
    constraint_value(system.effects.hold, state.rotations[-1], state.positions[-1], miss)
    put_scaled(-1.0, state.gradient, right)
    solve_held(system, hessian, right, miss, step, reaction)
    for i in range(size):
        free[i] = dot(loads[i], step)
    known, change, bears = _pushing_only(system, table, first, laws, compliance, free, exchanges,
                                         normal)
    if not known:
        return False  # what slides does so by itself: no multipliers hold it there
    shift, moved, response = _linear_response(system, table, first, laws, compliance, free, bears)
    farthest = _FARTHEST * np.sum(system.lengths)
    for i in range(size):
        if not abs(moved[i] - np.sum(response[i] * change)) < farthest:
            return False
    for a in range(count):
        i = first[a]
        normal[a] = (normal[a] + contacts.stiffness * table.gap[a] + change[i] if bears[a] else 0.0)
        if table.rubbing[a] >= 0:
            for j in range(3):
                shear[a, j] = (contacts.shear[table.rubbing[a], j] + change[i + 1] * axes[i + 1, j]
                               + change[i + 2] * axes[i + 2, j]) if bears[a] else 0.0
    _add_loads(table, first, laws, bears, shift, change, loads, right)
    solve_held(system, hessian, right, miss, step, reaction)
    return True


@kernel
def _stands(system, hessian, neutral):
    """Factorize an assembled Hessian; return whether it is definite, but for what is `neutral`.

    Newton's method finds what is neutral nearby; a descent goes far along it, in many short steps.
    """
    if factorize(system, hessian, 0.0) > 0:
        if not (neutral and is_definite(system, hessian, HELD_NEUTRAL)):
            return False
        factorize(system, hessian, 0.0)
    return True


@kernel
def _pushing_only(system, table, first, laws, compliance, free, exchanges, normal):
    """Return whether there are changes (K,) of the multipliers, these, and who bears (A,).

    Contacts side by side depend on each other: with no gap at any of them, some would pull as hard
    as others push. One that pulls is let go, one let go that is pressed in bears again (primal-dual
    active set method: Hintermueller, Ito and Kunisch 2002).
    """
    k, times = system.effects.contact.contacts.stiffness, _REFINED if exchanges else 0
    bears = np.ones(table.gap.size, dtype=np.bool_)
    turns = _CHANGES if exchanges or has_inertia(system.effects.anchor) else 0
    for a in range(bears.size if turns > 0 else 0):
        bears[a] = normal[a] > 2.0 * _HARDLY * k * abs(table.gap[a])
    last, change = bears.copy(), np.zeros(free.size)
    for turn in range(turns + 1):
        _, moved, response = _linear_response(system, table, first, laws, compliance, free, bears)
        matrix, right, soft = _equations(system, table, first, laws, response, moved, bears)
        known, there = softly_solved(matrix, right, soft, times)
        if not known:  # those before do
            return turn > 0, change, last
        change, same = there, True
        last[:] = bears
        for a in range(table.gap.size if turn < turns else 0):
            i = first[a]
            gap = table.gap[a] + moved[i] - np.sum(response[i] * change)
            # after some turns nothing bears again: so they come to an end
            bears[a] = (normal[a] + k * table.gap[a] + change[i] >= 0.0 if bears[a]
                        else gap < 0.0 and turn < turns // 2)
            same = same and bears[a] == last[a]
        if same:
            break
    return True, change, last


@kernel
def _linear_response(system, table, first, laws, compliance, free, bears):
    """Return what a change of the multipliers does, to first order.

    That is: (K,) the fixed change of the forces, of limits to those of the multipliers as they are
    or to none where nothing bears; (K,) the displacements by it and the gradient left over; and
    (K, K) the displacements against changes of the multipliers.
    """
    contacts, size = system.effects.contact.contacts, free.size
    shift, moved, response = np.zeros(size), free.copy(), np.empty((size, size))
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        response[:, i] = -compliance[:, i]
        if c < 0:
            continue
        slides = laws[i + 1, 0] > 0.0
        if slides:
            shift[i + 1] = (laws[i + 1, 2] * contacts.stiffness * table.gap[a] if bears[a]
                            else -contacts.multiplier[c])
            moved -= shift[i + 1] * compliance[:, i + 1]
            if bears[a]:
                response[:, i] += laws[i + 1, 2] * compliance[:, i + 1]
        response[:, i + 1] = (0.0 if slides else 1.0) * compliance[:, i + 1]
        response[:, i + 2] = laws[i + 1, 1] * compliance[:, i + 2]
    return shift, moved, response


@kernel
def _equations(system, table, first, laws, response, moved, bears):
    """Return matrix (K, K), right side (K,) for the changes of the multipliers, what is soft (K,).

    What does not bear has multipliers with which neither its spring nor its friction has a force.
    """
    size, contacts = moved.size, system.effects.contact.contacts
    matrix, right, soft = np.zeros((size, size)), np.empty(size), np.zeros(size)
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        _put_law(matrix, right, soft, response, moved, i, -contacts.stiffness,
                 -contacts.stiffness * table.gap[a], table.force[a], bears[a])
        if c < 0:
            continue
        along, across, trial = laws[i + 2]
        part = laws[i + 1, 1]
        if laws[i + 1, 0] == 0.0:
            _put_law(matrix, right, soft, response, moved, i + 1, contacts.grip, trial - along,
                     trial, bears[a])
            _put_law(matrix, right, soft, response, moved, i + 2, contacts.grip,
                     laws[i + 1, 2] - across, laws[i + 1, 2], bears[a])
        else:
            matrix[i + 1, i + 1] = matrix[i + 2, i + 2] = 1.0
            right[i + 1] = right[i + 2] = 0.0
            if bears[a]:
                matrix[i + 1, i] = -laws[i + 1, 2]
                # the limit is that of the force here; the multiplier's change counts from m
                right[i + 1] = (contacts.multiplier[c] - along
                                + laws[i + 1, 2] * contacts.stiffness * table.gap[a])
                matrix[i + 2] = contacts.grip * part * response[i + 2]
                matrix[i + 2, i + 2] += 1.0 - part
                right[i + 2] = -across + contacts.grip * part * moved[i + 2]
    return matrix, right, soft


@kernel
def _put_law(matrix, right, soft, response, moved, i, spring, yielded, force, bears):
    """Write row i: nothing moves there, or, where nothing bears, no force is left."""
    if bears:
        matrix[i] = spring * response[i]
        right[i] = yielded + spring * moved[i]
        soft[i] = _SOFT
        matrix[i, i] += _SOFT
    else:
        matrix[i] = -spring * response[i]
        matrix[i, i] += 1.0
        right[i] = -force - spring * moved[i]


@kernel
def _add_loads(table, first, laws, bears, shift, change, loads, right):
    """Add to right (m, 3) the loads by which the changes of the multipliers change the forces."""
    part = shift.copy()
    for a in range(table.gap.size):
        i = first[a]
        part[i] -= change[i]
        if table.rubbing[a] >= 0:
            if laws[i + 1, 0] == 0.0:
                part[i + 1] += change[i + 1]
            elif bears[a]:
                part[i + 1] += laws[i + 1, 2] * change[i]
            part[i + 2] += laws[i + 1, 1] * change[i + 2]
    for i in range(part.size):
        add_to(right, -part[i], loads[i])


@kernel
def linearize_contact_law(system, state, table, first, axes, laws):
    """Fill axes (K, 3): normal, direction of friction, third; and laws (K, 3) of the friction.

    Laws: in the second row whether it slides, the limit's part of the trial force, mu; in the third
    the multiplier's components along both axes and the trial force.
    """
    contacts = system.effects.contact.contacts
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        n = table.normal[a]
        axes[i] = n
        if c < 0:
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        size = trial_traction(contacts, c, x, trial)
        limit = contacts.multiplier[c]
        slides = size > limit
        if slides:
            axes[i + 1] = trial / size
        else:
            least = np.argmin(np.abs(n))
            axes[i + 1, least] = 1.0
            axes[i + 1] -= n[least] * n
            axes[i + 1] /= np.sqrt(np.sum(axes[i + 1] ** 2))
        for j in range(3):
            axes[i + 2, j] = (n[(j + 1) % 3] * axes[i + 1, (j + 2) % 3]
                              - n[(j + 2) % 3] * axes[i + 1, (j + 1) % 3])
        laws[i + 1, 0] = 1.0 if slides else 0.0
        laws[i + 1, 1] = limit / size if slides else 1.0
        laws[i + 1, 2] = system.effects.contact.scene.friction[table.obstacle[a]]
        laws[i + 2, 0] = np.sum(contacts.shear[c] * axes[i + 1])
        laws[i + 2, 1] = np.sum(contacts.shear[c] * axes[i + 2])
        laws[i + 2, 2] = np.sum(trial * axes[i + 1])
        if not slides:
            laws[i + 1, 2] = np.sum(trial * axes[i + 2])


@kernel
def _answers(system, state, hessian, table, first, axes):
    """Return (K, m, 3) unit forces at the contacts along `axes`, as loads, and what they answer."""
    loads, none = np.empty((axes.shape[0], state.q.shape[0], 3)), np.zeros(3)
    answers = np.empty_like(loads)
    for a in range(table.gap.size):
        for i in range(first[a], first[a] + (1 if table.rubbing[a] < 0 else 3)):
            # friction acts at the axis
            unit_load(system, state, hessian, table.element[a], table.fraction[a],
                      table.arm[a] if i == first[a] else none, axes[i], loads[i])
            solve(system, hessian, loads[i], answers[i])
    return loads, answers


@kernel
def unit_load(system, state, hessian, element, fraction, beside, axis, load):
    """Fill load (m, 3): change of the displacement along `axis` of a point, by the unknowns."""
    n = system.lengths.size
    rows = np.zeros((n, 3))
    part, arm = np.empty((6, 3)), np.empty(3)
    part_of_element(system.lengths[element], fraction, state.strains[element],
                    system.scale[element], state.rotations[element], part, arm)
    moment = np.empty(3)
    for i in range(3):
        arm[i] += state.positions[element, i] + beside[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moment[i] = arm[j] * axis[k] - arm[k] * axis[j]
    for e in range(element):
        for j in range(3):
            for k in range(3):
                rows[e, j] += (hessian.twist_jacobian[e, k, j] * moment[k]
                               + hessian.twist_jacobian[e, 3 + k, j] * axis[k])
    for j in range(3):
        for k in range(3):
            one, other = (k + 1) % 3, (k + 2) % 3
            moved = part[3 + k, j] + part[one, j] * beside[other] - part[other, j] * beside[one]
            rows[element, j] += moved * axis[k]
    project(system.basis, rows, load)


@kernel
def _products(loads, answers):
    """Return (K, K), symmetric: the displacement of each contact by a unit force at each other."""
    size = loads.shape[0]
    products = np.empty((size, size))
    for i in range(size):
        for j in range(i + 1):
            products[i, j] = products[j, i] = dot(loads[j], answers[i])
    return products


@kernel
def tangent_predictor(system, base, slid, strains, twist):
    """Return whether a DLO that goes on bearing follows its gripper, its unknowns (m, 3) there.

    And the Problem, its contacts free to roll.

    To first order, and if nothing is in the way.
    """
    before, lengths = _before(system, base, slid, twist), system.lengths
    start, after = new_configuration(before), new_configuration(system)
    unknowns_of(system, strains.copy(), start.q)  # they are read-only
    place(before, start)
    now, then = system.effects.contact, before.effects.contact
    system = with_contacts(system, free_to_roll(before, start, now.contacts), now.scene)
    before = with_contacts(before, free_to_roll(before, start, then.contacts), then.scene)
    state = new_configuration(before)
    copy(start.q, state.q)
    evaluate(before, state)
    hessian = new_hessian(before)
    assemble(before, state, hessian)
    if not _stands(before, hessian, strains.size > 0):
        return False, state.q, system
    loads, step, load = np.zeros_like(strains), np.empty_like(state.q), np.empty_like(state.q)
    for e in range(strains.shape[0]):
        for i in range(3):
            for column in range(hessian.cross.shape[2]):
                loads[e, i] -= hessian.cross[e, i, column] * twist[column]
    project(system.basis, loads, load)
    solve(before, hessian, load, step)
    if not largest_turn(before, hessian, step) < _LARGEST_TURN:
        return False, state.q, system
    put_sum(state.q, 1.0, step, after.q)
    place(system, after)
    for k in range(state.positions.shape[0]):
        for i in range(3):
            state.positions[k, i] -= twist[3 + i]
    met = sweeps_through(system.effects.contact.scene, lengths, state.strains, state.rotations,
                         state.positions, after.rotations, after.positions)
    return not met, after.q, system


@kernel
def _before(system, base, slid, twist):
    """Return the Problem before its gripper has moved by a twist.

    What slides goes on along its way, and is held back across it as in the step before: friction
    has the direction of the whole step's way. Without it a DLO may slip aside that does not.
    """
    now, shift = system.effects.contact.contacts, twist[3:].copy()
    contacts = replaced(now, 'anchor', now.anchor + shift - slid)
    moved = with_contacts(system, contacts, translated(system.effects.contact.scene, -shift))
    return with_gripper(moved, base, system.origin - shift)


@kernel
def semismooth_newton(system, q, tolerance, exact, previous):
    """Return whether it is found, and what is known of it then."""
    loaded, age, before, hold = system, np.inf, np.inf, system.effects.hold
    reaction, gone = _no_reaction(system), _no_reaction(system)
    begin, hessian = new_configuration(system), new_hessian(system)
    begin.q[:] = q
    neutral = age > 0.0  # literals would be compiled for by themselves
    if not _bears(system.effects.contact.contacts):
        return False, begin, np.inf, np.inf, system, hessian, age, 0
    place(system, begin)
    # 1/N: how many times the smallest stiffness of all of the DLO a force is
    softness = np.sum(system.lengths) ** 2 / np.min(system.stiffness)
    state, step = begin, np.empty_like(q)
    last = touching(system.effects.contact.scene, system.effects.contact.contacts, system.lengths,
                    begin)
    for steps in range(_STEPS):
        loaded = _loaded(loaded, state, previous, exact)
        state, residual, table, violation = kkt_residual(loaded, state.q)
        if table.gap.size == 0:
            break
        normal, shear = forces(table, state)
        same = _same(table, last)
        if residual < tolerance and violation < exact:
            if not same:  # the factorization is that of other contacts
                age = np.inf
            if forbids(system.effects, system, begin, state):
                break
            return True, state, residual, violation, loaded, hessian, age, steps
        wrong = max(residual / tolerance, violation / exact)
        if steps >= _GRACE and same and not wrong < _FALLS * before:
            break
        before, last = wrong, table
        # near the end the factorization before is as good; what slides turns its friction
        fresh = (not same or not _STALE * age * residual < tolerance
                 or np.max(table.rubbing) >= 0)
        if not complementarity_step(loaded, state, table, hessian, fresh, neutral, neutral, normal,
                                    shear, step, reaction):
            break
        change = largest_turn(loaded, hessian, step) + softness * _difference(table.force, normal)
        age = change if fresh else age + change
        put_forces(loaded, table, normal, shear)
        # contacts that come and go in turn are those of neither shape: from the middle on
        part = 0.5 if steps >= _LONG and steps % 2 > 0 and not same else 1.0
        put_sum(state.q, part, step, state.q)
        move_multipliers(hold, part, reaction)
        gone += part * reaction
        place(loaded, state)
    move_multipliers(hold, -1.0, gone)
    return False, state, np.inf, np.inf, system, hessian, age, _STEPS


@kernel
def _no_reaction(system):
    """Return zeros (K,), one for each row that a grip of the far end holds."""
    return np.zeros(row_count(system.needs.border))


@kernel
def _difference(one, other):
    """Return the largest difference of two arrays (A,)."""
    largest = 0.0
    for a in range(one.size):
        largest = max(largest, abs(one[a] - other[a]))
    return largest


@kernel
def _same(table, other):
    """Whether the same points bear, and rub."""
    same = table.gap.size == other.gap.size
    for a in range(table.gap.size if same else 0):
        same = same and (table.obstacle[a] == other.obstacle[a]
                         and table.inside[a] == other.inside[a]
                         and (table.rubbing[a] >= 0) == (other.rubbing[a] >= 0)
                         and (table.inside[a] >= 0 or table.element[a] == other.element[a]))
    return same


@kernel
def correction(system, strains, positions):
    """Return how far, in m, a step of `semismooth_newton` moves nodes where elements are halved.

    Infinite where there is no such step. Friction is that of the Problem's contacts.
    """
    twice, state = np.empty((2 * strains.shape[0], 3)), new_configuration(system)
    for e in range(twice.shape[0]):
        twice[e] = strains[e // 2]
    unknowns_of(system, twice, state.q)
    place(system, state)
    loaded = _loaded(system, state, np.zeros((0, 6)), np.inf)
    state, _, table, _ = kkt_residual(loaded, state.q)
    normal, shear = forces(table, state)
    step = np.zeros_like(state.q)
    touches = table.gap.size > 0
    if not touches or not complementarity_step(
            loaded, state, table, new_hessian(system), touches, not touches, not is_held(system),
            normal, shear, step, _no_reaction(system)):
        return np.inf
    if not np.min(normal) > 0.0:
        return np.inf
    state.q[:] += step
    place(loaded, state)
    farthest = 0.0
    for k in range(positions.shape[0]):
        away = 0.0
        for i in range(3):
            away += (state.positions[2 * k, i] - positions[k, i]) ** 2
        farthest = max(farthest, away)
    return np.sqrt(farthest)


@kernel
def place(system, state):
    """Refill strains, rotations and positions of `state` for its q, and nothing else."""
    values = at_elements(system.basis, state.q)
    for e in range(system.lengths.size):
        for i in range(3):
            state.strains[e, i] = system.natural[e, i] + system.scale[e, i] * values[e, i]
    forward_kinematics(system.lengths, state.strains, system.base, state.rotations, state.positions,
                       state.arcs)


@kernel
def _bears(contacts):
    """Whether any force of contact is known."""
    for o in range(contacts.node.shape[0]):
        for k in range(contacts.node.shape[1]):
            if contacts.node[o, k] > 0.0:
                return True
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0 and contacts.multiplier[c] > 0.0:
            return True
    return False


@kernel
def _loaded(system, state, previous, exact):
    """Return the Problem whose contacts, at `state`, push with the forces that are its multipliers.

    What has none does not push. Beside nodes that bear those begin to that are pressed in by more
    than `exact`, m; beside a point that rolls nodes have no say. Friction is that of the contacts
    there.
    """
    given = system.effects.contact.contacts
    contacts = with_springs(given, 0.0, given.node.copy(), given.multiplier.copy())
    if len(previous):
        contacts = update_friction(system, contacts, state, previous)
    scene, k, lengths = system.effects.contact.scene, given.stiffness, system.lengths
    x, normal, hessian, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        node, last, longest = near_nodes(scene, o, state.strains)
        while node <= last:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           hessian)
            deep = k * exact if _lies_beside(given.node[o], node) else np.inf
            contacts.node[o, node] = _pushing(contacts.node[o, node], k * gap, deep)
            node = next_touching(lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            gap, _, _ = closest_point(scene, contacts, c, lengths, state.strains, state.rotations,
                                      state.positions, normal, hessian)
            contacts.multiplier[c] = _pushing(contacts.multiplier[c], k * gap, np.inf)
    contacts = with_springs(contacts, k, contacts.node, contacts.multiplier)
    return with_contacts(system, contacts, scene)



@kernel
def _lies_beside(forces, node):
    """Whether a node that bears, one of forces (N + 1,), is next to a node, or the next but one."""
    most = 0.0
    for k in range(max(0, node - 2), min(forces.size, node + 3)):
        most = max(most, forces[k])
    return most > 0.0


@kernel
def _pushing(force, yielded, deep):
    """Return the multiplier with which a spring that has lost the force `yielded` has a force.

    What is pressed in by more than `deep` (N) bears from now on: with a force that counts for
    nothing, the laws tell it (primal-dual active set method).
    """
    if force > 0.0:
        return force + yielded
    return (1.0 - _HARDLY) * yielded if yielded < -deep else min(0.0, yielded)
