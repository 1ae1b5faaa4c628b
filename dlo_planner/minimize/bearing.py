# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shape and contact forces at once, as long as the DLO bears where it did.

Newton's method on the equilibrium and the laws of contact and friction (semismooth, Alart and
Curnier 1991): the springs of contacts push with the forces themselves, whatever their gaps are, so
that a gap of the start is closed by the forces and not fought by the springs. It begins where a
DLO that goes on bearing would be carried by its gripper. What it finds is a start: the minimizer
alone tells whether something else touches, and whether the shape falls.
"""

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.gap import closest_point, near_nodes, next_touching, node_gap
from dlo_planner.energy.potential import at_elements, evaluate, project, unknowns_of
from dlo_planner.energy.problem import new_configuration, with_gripper
from dlo_planner.energy.scene import translated
from dlo_planner.energy.terms import forbids
from dlo_planner.geometry.kinematics import forward_kinematics
from dlo_planner.geometry.record import put_sum
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_forces import lawful, put_forces, stands
from dlo_planner.minimize.friction import with_friction
from dlo_planner.minimize.hessian import assemble, largest_turn, new_hessian, solve
from dlo_planner.minimize.touching import touching_system, truth

_STEPS = 12
_LARGEST_TURN = 0.3  # rad: of a node in the gripper, by a step; a longer one is a guess
_DEEP = 2e-3         # of the length: what is deeper in an obstacle has not been carried along it
_FALLS = 0.5         # of the error before: what falls less does not converge
_STALE = 1e3         # 1/rad: of a residual, what an old factorization leaves per rad turned since
_GRACE = 3           # first steps, in which it may do so


@kernel
def carried(system, base, slid, strains, twist):
    """Return whether a DLO that goes on bearing follows its gripper, and its unknowns (m, 3) there.

    To first order, and if nothing is in the way.

    Args:
        system: Problem in the gripper after, its contacts those before
        base: (3, 3) the gripper's rotation before
        slid: (C, 3) m, by how much points have slid: those go on sliding
        strains: (N, 3) in equilibrium, before
        twist: (6,) rotation in rad about the gripper and displacement in m, world
    """
    before, lengths = _before(system, base, slid, twist), system.lengths
    state, after = new_configuration(before), new_configuration(system)
    unknowns_of(system, strains, state.q)
    evaluate(before, state)
    hessian = new_hessian(before)
    assemble(before, state, hessian)
    if not stands(before, hessian, strains.size > 0):
        return False, state.q
    loads, step, load = np.zeros_like(strains), np.empty_like(state.q), np.empty_like(state.q)
    for e in range(strains.shape[0]):
        for i in range(3):
            for column in range(hessian.cross.shape[2]):
                loads[e, i] -= hessian.cross[e, i, column] * twist[column]
    project(system.basis, loads, load)
    solve(before, hessian, load, step)
    if not largest_turn(before, hessian, step) < _LARGEST_TURN:
        return False, state.q
    put_sum(state.q, 1.0, step, after.q)
    _place(system, after)
    for k in range(state.positions.shape[0]):
        for i in range(3):
            state.positions[k, i] -= twist[3 + i]
    met = sweeps_through(system.effects.contact.scene, lengths, state.strains, state.rotations,
                         state.positions, after.rotations, after.positions)
    return not met, after.q


@kernel
def _before(system, base, slid, twist):
    """Return the Problem before its gripper has moved by a twist.

    What slides goes on along its way, and is held back across it as in the step before: friction
    has the direction of the whole step's way. Without it a DLO may slip aside that does not.
    """
    now, shift = system.effects.contact.contacts, twist[3:].copy()
    contacts = ContactSet(now.stiffness, now.node, now.element, now.obstacle, now.multiplier,
                          now.fraction, now.anchor + shift - slid, now.normal, now.shear, now.grip)
    moved = touching_system(system, contacts, translated(system.effects.contact.scene, -shift))
    return with_gripper(moved, base, system.origin - shift)


@kernel
def borne(system, q, tolerance, exact, previous):
    """Return whether it is found, and what is known of it then.

    Args:
        q: (m, 3) start; the Problem's multipliers are the forces there
        tolerance: of the residual; exact: of gaps, m
        previous: as of `constrained_newton`

    Returns
    -------
        whether, Configuration, residual, violation, Problem with the forces, Hessian,
        factorized where the DLO has turned since by so many rad, steps made
    """
    loaded, turned, before = system, np.inf, np.inf
    begin, hessian = new_configuration(system), new_hessian(system)
    begin.q[:] = q
    neutral = turned > 0.0  # literals would be compiled for by themselves
    if not _bears(system.effects.contact.contacts):
        return False, begin, np.inf, np.inf, system, hessian, turned, 0
    _place(system, begin)
    state, step = begin, np.empty_like(q)
    for steps in range(_STEPS):
        loaded, deepest = _loaded(loaded, state, previous)
        state, residual, table, violation = truth(loaded, state.q)
        if table.gap.size == 0:
            break
        normal, shear = table.force.copy(), np.zeros((table.gap.size, 3))
        for a in range(table.gap.size):
            if table.rubbing[a] >= 0:
                shear[a] = state.attached.force[table.rubbing[a]]
        if residual < tolerance and violation < exact:
            outside = (deepest > -_DEEP * np.sum(system.lengths)
                       and not forbids(system.effects, system, begin, state))
            return outside, state, residual, violation, loaded, hessian, turned, steps
        wrong = max(residual / tolerance, violation / exact)
        if steps >= _GRACE and not wrong < _FALLS * before:
            break
        before = wrong
        # near the end the factorization before is as good; what slides turns its friction
        fresh = not _STALE * turned * residual < tolerance or np.max(table.rubbing) >= 0
        if not lawful(loaded, state, table, hessian, fresh, neutral, normal, shear, step):
            break
        turn = largest_turn(loaded, hessian, step)
        turned = turn if fresh else turned + turn
        put_forces(loaded, table, normal, shear)
        put_sum(state.q, 1.0, step, state.q)
        _place(loaded, state)
    return False, state, np.inf, np.inf, system, hessian, turned, _STEPS


@kernel
def correction(system, strains, positions):
    """Return how far, in m, one step of `borne` moves the nodes of a DLO with halved elements.

    Infinite where there is no such step. Friction is that of the Problem's contacts.

    Args:
        strains: (n, 3), positions: (n + 1, 3) from the gripper, m: of the DLO with n elements
    """
    twice, state = np.empty((2 * strains.shape[0], 3)), new_configuration(system)
    for e in range(twice.shape[0]):
        twice[e] = strains[e // 2]
    unknowns_of(system, twice, state.q)
    _place(system, state)
    loaded, _ = _loaded(system, state, np.zeros((0, 6)))
    state, _, table, _ = truth(loaded, state.q)
    normal, shear = table.force.copy(), np.zeros((table.gap.size, 3))
    step = np.zeros_like(state.q)
    touches = table.gap.size > 0
    if not touches or not lawful(loaded, state, table, new_hessian(system), touches, not touches,
                                 normal, shear, step):
        return np.inf
    if not np.min(normal) > 0.0:
        return np.inf
    state.q[:] += step
    _place(loaded, state)
    farthest = 0.0
    for k in range(positions.shape[0]):
        away = 0.0
        for i in range(3):
            away += (state.positions[2 * k, i] - positions[k, i]) ** 2
        farthest = max(farthest, away)
    return np.sqrt(farthest)


@kernel
def _place(system, state):
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
def _loaded(system, state, previous):
    """Return the Problem whose contacts, at `state`, push with the forces that are its multipliers.

    What has none does not push, however deep it is. Friction is that of the contacts there. Also
    returned is the least gap, m, of the nodes that do not push.
    """
    given = system.effects.contact.contacts
    contacts = _of_stiffness(given, 0.0, given.node.copy(), given.multiplier.copy())
    if len(previous):
        contacts = with_friction(system, contacts, state, previous)
    scene, k, lengths = system.effects.contact.scene, given.stiffness, system.lengths
    x, normal, hessian, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    deepest = np.inf
    for o in range(scene.kind.size):
        node, last, longest = near_nodes(scene, o, state.strains)
        while node <= last:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           hessian)
            if contacts.node[o, node] <= 0.0:
                deepest = min(deepest, gap)
            contacts.node[o, node] = _pushing(contacts.node[o, node], k * gap)
            node = next_touching(lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            gap, _, _ = closest_point(scene, contacts, c, lengths, state.strains, state.rotations,
                                      state.positions, normal, hessian)
            contacts.multiplier[c] = _pushing(contacts.multiplier[c], k * gap)
    contacts = _of_stiffness(contacts, k, contacts.node, contacts.multiplier)
    return touching_system(system, contacts, scene), deepest


@kernel
def _pushing(force, yielded):
    """Return the multiplier with which a spring that has lost the force `yielded` has a force."""
    return force + yielded if force > 0.0 else min(0.0, yielded)


@kernel
def _of_stiffness(contacts, stiffness, node, multiplier):
    """Return the same ContactSet with springs of another stiffness, and other multipliers."""
    return ContactSet(stiffness, node, contacts.element, contacts.obstacle, multiplier,
                      contacts.fraction, contacts.anchor, contacts.normal, contacts.shear.copy(),
                      contacts.grip)
