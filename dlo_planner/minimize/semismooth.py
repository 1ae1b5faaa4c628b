# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shape and contact forces together: a semismooth Newton method (Alart and Curnier 1991).

The compliance of the DLO at its contacts comes from solves with Newton's Hessian. With it all
contact forces follow to first order (`minimize.contact_laws`), and the reactions of holds.

In `semismooth_newton` the springs of contacts push with the multipliers alone, whatever the gaps
and slips are: a gap of the start is closed by a change of the forces, not fought by the springs.
Nodes beside contacts are candidates before they touch. It begins where a DLO whose contacts all go
on bearing would be carried by its gripper, or where `relaxation` has brought one nearly to rest,
from afar; then whatever is pressed in is a candidate. What it finds is a start: the caller tells
whether something else touches, and whether the shape falls.
"""

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.contact import trial_traction
from dlo_planner.energy.gap import closest_point, near_gaps, radius_at_node
from dlo_planner.energy.grip import constraint_value, move_multipliers
from dlo_planner.energy.potential import at_elements, evaluate, project, unknowns_of
from dlo_planner.energy.problem import (
    bending_energy,
    is_to_end,
    new_configuration,
    with_gripper,
)
from dlo_planner.energy.scene import SHEET, translated
from dlo_planner.energy.terms import forbids, row_count
from dlo_planner.geometry.kinematics import (
    folded,
    forward_kinematics,
    part_of_element,
    point_inside,
)
from dlo_planner.geometry.record import copy, put_sum, replaced
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import free_to_roll, rolled_to
from dlo_planner.minimize.contact_laws import (
    contact_axes,
    contact_forces,
    contact_laws,
    force_after,
    slides,
    yielding_forces,
)
from dlo_planner.minimize.contact_table import (
    NEGLIGIBLE,
    is_candidate,
    kkt_residual,
    touching,
    update_friction,
    with_contacts,
    with_springs,
)
from dlo_planner.minimize.convergence import as_rounded, gradient_noise
from dlo_planner.minimize.hessian import (
    assemble,
    compliance,
    factorize,
    is_definite,
    largest_turn,
    new_hessian,
    solve,
    solve_held,
)
from dlo_planner.minimize.kkt import add_all, dots, put_scaled
from dlo_planner.minimize.newton import HELD_NEUTRAL

_TINY = 1e-4      # of a negligible force: of candidates that are far away
_CHANGES = 8      # times that contacts are let go or taken back
_FARTHEST = 0.02  # of the length: a prediction that moves a contact farther is none
_STEPS = 24       # Newton steps at most
_LARGEST_TURN = 0.3  # rad: of a node in the gripper, by a step; a longer one is a guess
_FALLS = 0.5         # of the error before: what falls less does not converge
_STALE = 1e3         # 1/rad: of a residual, what an old factorization leaves per rad turned since
_GRACE = 3           # first steps, in which it may do so
_LONG = 6            # steps after which contacts that still change may go round in circles
_PATIENCE = 8        # steps in vain with friction: a change of its direction raises the error first
_CROSSES = 0.9       # of the DLO's radius: its axis is so deep in what it crosses
_APART = 2.0  # times the way from the last candidate: with a larger gap a node is none beside it
_CLOSE = 1 / 500  # of the length: nor is one with a gap that is so near to it
_AROUND = 4.0       # times the largest gap of what bears: nodes beside it may bear as well


@kernel
def forces(table, state):
    """Return the forces of the contacts in a table: normal (A,) and across (A, 3), N."""
    shear = np.zeros((table.gap.size, 3))
    for a in range(table.gap.size):
        if table.rubbing[a] >= 0:
            shear[a] = state.attached.force[table.rubbing[a]]
    return table.force.copy(), shear


@kernel
def forces_without_candidates(system, table, state):
    """Return what `forces` does, but no force of candidates."""
    normal, shear = forces(table, state)
    for a in range(table.gap.size):
        if is_candidate(system.effects.contact.contacts, table, a):
            normal[a] = 0.0
    return normal, shear


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
            contacts.multiplier[c] = friction[o] * force
            for i in range(3):
                contacts.shear[c, i] = shear[a, i]


@kernel
def linearize(system, state, hessian, neutral):
    """Assemble and factorize the Hessian; return whether it is definite, but for what is `neutral`.

    Newton's method finds what is neutral nearby; a descent goes far along it, in many short steps.
    """
    assemble(system, state, hessian)
    if factorize(system, hessian, 0.0) > 0:
        if not (neutral and is_definite(system, hessian, HELD_NEUTRAL)):
            return False
        factorize(system, hessian, 0.0)
    return True


@kernel
def turn_into_loads(system, state, everywhere):
    """Make friction a load, its multiplier, in place, whatever has slid.

    That of what sticks, so that rounding errors of places count for nothing; or of all contacts.
    """
    contacts = system.effects.contact.contacts
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for c in range(contacts.element.size):
        force = np.sqrt(np.sum(contacts.shear[c] ** 2))
        if contacts.obstacle[c] >= 0 or not everywhere and slides(force, contacts.multiplier[c]):
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        trial_traction(contacts, c, x, trial)
        for i in range(3):
            contacts.shear[c, i] -= trial[i] - contacts.shear[c, i]


@kernel
def complementarity_step(system, state, table, hessian, exchanges, softness, closed, farthest,
                         normal, shear, step, right, reaction):
    """Fill the forces that obey the linearized laws, the step, and what makes it, `right` (m, 3).

    And the change of the reactions (K,) of holds. Return whether forces are found (what
    slides by itself is held by none) and no contact moves by more than `farthest` of the length.

    `hessian`: factorized; `exchanges`: how often the active set may change; `softness`: by how
    much, m/N, contacts yield to a change of their forces, then it changes as often as it has to;
    `closed`: the part by which a held end comes nearer to its place.
    """
    count = table.gap.size
    first, of, beside, axes = contact_axes(table)
    loads = unit_loads(system, state, hessian, table.element[of], table.fraction[of], beside, axes)
    miss = np.zeros_like(reaction)
    constraint_value(system.effects.hold, state, miss)
    miss *= closed
    put_scaled(-1.0, state.gradient, right)
    solve_held(system, hessian, right, miss, step, reaction)
    if count == 0:
        return True
    free = dots(loads, step)
    law = contact_laws(system, state, table, first, axes, normal, free,
                       compliance(system, hessian, loads))
    if softness > 0.0:
        known, change, bears = yielding_forces(law, softness)
    else:
        known, change, bears = contact_forces(law, exchanges)
    if not known:
        return False
    moved = free.copy()
    for i in range(free.size):
        for k in range(free.size):
            moved[i] += law.compliance[i, k] * change[k]
        if not abs(moved[i]) < farthest * np.sum(system.lengths):
            return False
    for a in range(count):
        i, force = first[a], force_after(law, a, change, moved)
        normal[a] = force[0] if bears[a] else 0.0
        for j in range(3 if table.rubbing[a] >= 0 else 0):
            shear[a, j] = -(force[1] * axes[i + 1, j] + force[2] * axes[i + 2, j])
    add_all(right, change, loads)
    solve_held(system, hessian, right, miss, step, reaction)
    return True


@kernel
def unit_loads(system, state, hessian, element, fraction, beside, axes):
    """Return (m, 3, K): changes of the displacements of points along axes (K, 3), by the unknowns.

    The points are in elements (K,), at fractions of them, `beside` (K, 3) the axis by so much.
    """
    n, size = system.lengths.size, element.size
    rows, wrench = np.zeros((n, 3, size)), np.zeros((6, size))
    part, arm = np.empty((6, 3)), np.empty(3)
    for r in range(n):
        e = n - 1 - r
        for j in range(3):
            for k in range(6):
                by = hessian.twist_jacobian[e, k, j]
                for p in range(size):
                    rows[e, j, p] += by * wrench[k, p]
        for p in range(size):
            if element[p] != e:
                continue
            part_of_element(system.lengths[e], fraction[p], state.strains[e], system.scale[e],
                            state.rotations[e], part, arm)
            for i in range(3):
                arm[i] += state.positions[e, i] + beside[p, i]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                wrench[i, p] = arm[j] * axes[p, k] - arm[k] * axes[p, j]
                wrench[3 + i, p] = axes[p, i]
                for b in range(3):
                    moved = part[3 + i, b] + part[j, b] * beside[p, k] - part[k, b] * beside[p, j]
                    rows[e, b, p] += moved * axes[p, i]
    if system.basis.shape[1] == 0:
        return rows
    loads = np.zeros((system.basis.shape[2], 3, size))
    for e in range(n):
        for k in range(loads.shape[0]):
            for j in range(3):
                by = system.basis[j, e, k]
                for p in range(size):
                    loads[k, j, p] += by * rows[e, j, p]
    return loads


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
    if not linearize(before, state, hessian, strains.size > 0):
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
def semismooth_newton(system, q, tolerance, exact, previous, afar):
    """Return whether a DLO that bears comes to rest near q (m, 3), and what is known of it then.

    That is its Configuration, residual, violation, the Problem with its forces as multipliers, the
    Hessian, by how much (rad) nodes have turned since it was factorized, and Newton steps.
    """
    loaded, age, before, hold = system, np.inf, np.inf, system.effects.hold
    reaction, gone = no_reaction(system), no_reaction(system)
    begin, hessian = new_configuration(system), new_hessian(system)
    begin.q[:] = q
    neutral = age > 0.0  # literals would be compiled for by themselves
    if not (afar or bears(system.effects.contact.contacts)):
        return False, begin, np.inf, np.inf, system, hessian, age, 0
    place(system, begin)
    # 1/N: how many times the smallest stiffness of all of the DLO a force is
    softness = np.sum(system.lengths) / bending_energy(system)
    state, step, right = begin, np.empty_like(q), np.empty_like(q)
    last = touching(system.effects.contact.scene, system.effects.contact.contacts, system.lengths,
                    begin)
    vain, worked = 0, np.zeros(1)
    for steps in range(_STEPS):
        if is_to_end(worked, system, 1 + last.gap.size):
            break
        loaded = loaded_by_contacts(loaded, state, previous, -exact, False, afar)
        state, residual, table, violation = kkt_residual(loaded, state.q)
        if not (afar or table.gap.size):
            break
        normal, shear = forces(table, state)
        same, rubs = _same(table, last), np.any(table.rubbing >= 0)
        small = residual < tolerance or afar and as_rounded(
            residual, gradient_noise(loaded, state), tolerance)
        if small and violation < exact:
            if not same:  # the factorization is that of other contacts
                age = np.inf
            if forbids(system.effects, system, begin, state):
                break
            return True, state, residual, violation, loaded, hessian, age, steps
        wrong = max(residual / tolerance, violation / exact)
        vain = 0 if wrong < _FALLS * before or not same else vain + 1
        if steps >= _GRACE and vain > (_PATIENCE if rubs or afar else 0):
            break
        before, last = min(wrong, before) if same else wrong, table
        # near the end the last factorization is as good; but friction turns with what slides
        fresh = not same or not _STALE * age * residual < tolerance or rubs
        if fresh and not linearize(loaded, state, hessian, neutral):
            break
        if not complementarity_step(loaded, state, table, hessian, _CHANGES, 0.0, 1.0, _FARTHEST,
                                    normal, shear, step, right, reaction):
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
        # The tangent of an element that has yielded is zero but for rounding errors: a step along
        # it may be of any length, and no law of contact tells, for the element bears all the same.
        if folded(loaded.lengths, state.strains, loaded.natural):
            break
    move_multipliers(hold, -1.0, gone)
    return False, state, np.inf, np.inf, system, hessian, age, steps + 1 if afar else _STEPS


@kernel
def no_reaction(system):
    """Return zeros (K,), one for each row that holds keep."""
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
    state = new_configuration(system)
    put_halved(system, strains, state)
    loaded = loaded_by_contacts(system, state, np.zeros((0, 6)), -np.inf, False, False)
    state, _, table, _ = kkt_residual(loaded, state.q)
    normal, shear = forces(table, state)
    step, hessian = np.zeros_like(state.q), new_hessian(system)
    if table.gap.size == 0 or not linearize(loaded, state, hessian, table.gap.size == 0):
        return np.inf
    if not complementarity_step(loaded, state, table, hessian, _CHANGES, 0.0, 1.0, _FARTHEST,
                                normal, shear, step, step.copy(), no_reaction(system)):
        return np.inf
    if not np.min(normal) > 0.0:
        return np.inf
    state.q[:] += step
    place(loaded, state)
    return farthest_of_halved(state, positions)


@kernel
def put_halved(system, strains, state):
    """Fill what `place` does for strains (N, 3) of elements of which each is two of the system."""
    twice = np.empty((2 * strains.shape[0], 3))
    for e in range(twice.shape[0]):
        twice[e] = strains[e // 2]
    unknowns_of(system, twice, state.q)
    place(system, state)


@kernel
def farthest_of_halved(state, positions):
    """Return how far, in m, nodes are at most from where they were with twice as long elements."""
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
def bears(contacts):
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
def loaded_by_contacts(system, state, previous, near, everywhere, afar):
    """Return the Problem whose contacts, at `state`, push with the forces that are its multipliers.

    A contact without force does not push. Nodes whose gap is below `near`, m, become candidates
    with a negligible force: the laws tell what they bear. They are all (`everywhere`), or those
    beside nodes that bear (not beside points that roll), of these as well what is about as near as
    the state is exact, so that a step finds at once all that touches then; points inside elements
    that are pressed in; and from `afar` nodes that are. Then friction is a load, too, that of what
    sticks or all. With a past (`previous`) friction is that of the contacts there.
    """
    given = system.effects.contact.contacts
    scene, k, lengths = system.effects.contact.scene, given.stiffness, system.lengths
    force, yielded = np.zeros_like(given.node), np.zeros_like(given.node)
    at = given.element
    if afar:
        at, _ = rolled_to(system, state)
    normal, hessian = np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        node, around = given.node[o], near
        gaps = near_gaps(scene, o, lengths, node, state.strains, state.rotations, state.positions,
                         max(near, 0.0))
        for b in range(gaps.size):
            if node[b] > 0.0 and abs(gaps[b]) > -near:
                around = max(around, _AROUND * abs(gaps[b]))
        for b in range(gaps.size):
            gap = gaps[b]
            if gap == np.inf:
                continue
            yielded[o, b], force[o, b] = k * gap, max(0.0, node[b])
            if not everywhere and force[o, b] == 0.0 and (
                    gap < around and _lies_beside(node, b)
                    or afar and gap < near and not _has_point_beside(given, at, o, b)):
                force[o, b] = NEGLIGIBLE * k * abs(gap)
    contacts = with_springs(given, 0.0, force, given.multiplier.copy())
    if len(previous):
        contacts = update_friction(system, contacts, state, previous)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            gap, _, _ = closest_point(scene, contacts, c, lengths, state.strains, state.rotations,
                                      state.positions, normal, hessian)
            push = contacts.multiplier[c]
            if everywhere and is_halfway(scene, contacts.obstacle[c], contacts.element[c], gap):
                push = 0.0
            elif not push > 0.0 and gap < near:
                push = _TINY * NEGLIGIBLE * k * abs(gap)
            contacts.multiplier[c] = _pushing(push, k * gap)
    close = _CLOSE * np.sum(lengths)
    for o in range(scene.kind.size):
        away = np.inf  # from the last node that counts
        for node in range(force.shape[1]):
            away += lengths[max(node - 1, 0)]
            if everywhere and is_halfway(scene, o, node, yielded[o, node] / k):
                force[o, node] = 0.0
            elif everywhere and force[o, node] == 0.0 and yielded[o, node] < (
                    k * min(near, _APART * away) if away > close else 0.0):
                force[o, node] = _TINY * NEGLIGIBLE * abs(yielded[o, node])
            if force[o, node] > 0.0:
                away = 0.0
            contacts.node[o, node] = _pushing(force[o, node], yielded[o, node])
    loaded = with_contacts(system, with_springs(contacts, k, contacts.node, contacts.multiplier),
                           scene)
    if afar:
        turn_into_loads(loaded, state, everywhere)
    return loaded


@kernel
def is_halfway(scene, o, node, gap):
    """Whether the axis is so near to the middle of a sheet that nothing tells to which side."""
    return _is_in_sheet(scene, o, node, gap + 2.0 * scene.size[o, 0])  # it has two layers


@kernel
def _is_in_sheet(scene, o, node, gap):
    """Whether the axis is in a sheet, or nearly so."""
    return scene.kind[o] == SHEET and gap < -_CROSSES * radius_at_node(scene, o, node)


@kernel
def crosses_a_sheet(system, state):
    """Whether the axis is in a sheet, at a node or at a point that is watched."""
    scene, contacts, lengths = (system.effects.contact.scene, system.effects.contact.contacts,
                                system.lengths)
    normal, hessian = np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        if scene.kind[o] != SHEET:
            continue
        gaps = near_gaps(scene, o, lengths, contacts.node[o], state.strains, state.rotations,
                         state.positions, 0.0)
        for node in range(gaps.size):
            if _is_in_sheet(scene, o, node, gaps[node]):
                return True
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0 and scene.kind[contacts.obstacle[c]] == SHEET:
            gap, e, _ = closest_point(scene, contacts, c, lengths, state.strains, state.rotations,
                                      state.positions, normal, hessian)
            if _is_in_sheet(scene, contacts.obstacle[c], e, gap):
                return True
    return False


@kernel
def _has_point_beside(contacts, at, o, node):
    """Whether a point that rolls is in an element beside a node; at (C,): elements of points."""
    found = False
    for c in range(at.size):
        found = found or contacts.obstacle[c] == o and node - 1 <= at[c] <= node
    return found


@kernel
def _lies_beside(forces, node):
    """Whether a node that bears, one of forces (N + 1,), is next to a node, or the next but one."""
    most = 0.0
    for k in range(max(0, node - 2), min(forces.size, node + 3)):
        most = max(most, forces[k])
    return most > 0.0


@kernel
def _pushing(force, yielded):
    """Return the multiplier with which a spring that has lost the force `yielded` has a force."""
    return force + yielded if force > 0.0 else min(0.0, yielded)
