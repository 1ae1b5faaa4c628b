# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO touches, as a table, and by how much that breaks the laws of contact and friction."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import Contact, ContactSet, trial_traction
from dlo_planner.energy.gap import (
    closest_point,
    gap_at,
    near_nodes,
    next_touching,
    node_gap,
)
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.energy.scene import Scene
from dlo_planner.energy.terms import Structure, with_terms
from dlo_planner.geometry.kinematics import nothing_attached, point_inside
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import residual_of
from dlo_planner.model.arrays import Floats, Ints

_INSIDE = 1.0 - 1e-14  # largest fraction of a point of friction that is not on a node


class Touching(Record):
    """The A contacts that bear at one state, on nodes and inside elements.

    Attributes
    ----------
    obstacle : ndarray of int, shape (A,)
        Index of the obstacle.
    element : ndarray of int, shape (A,)
        Index of the element.
    fraction : ndarray, shape (A,)
        Of the element; 1 for a node, its end, only.
    inside : ndarray of int, shape (A,)
        Index among ContactSet' points, -1 for a node.
    rubbing : ndarray of int, shape (A,)
        Index of its point of friction there, -1 without.
    gap : ndarray, shape (A,)
        Gap in m.
    force : ndarray, shape (A,)
        Force in N.
    normal : ndarray, shape (A, 3)
        Normal of the obstacle.
    arm : ndarray, shape (A, 3)
        Of the force from the axis, m, beyond the radius of a round DLO.
    """

    obstacle: Ints
    element: Ints
    fraction: Floats
    inside: Ints
    rubbing: Ints
    gap: Floats
    force: Floats
    normal: Floats
    arm: Floats


@kernel
def touching(scene: Scene, contacts: ContactSet, lengths: Floats, state: Configuration) -> Touching:
    """Return the Touching of a state."""
    k = contacts.stiffness
    last = lengths.size
    most = scene.kind.size * last + contacts.element.size
    index = np.empty((4, most), dtype=np.int64)
    value = np.empty((3, most))
    normals, arms = np.empty((most, 3)), np.zeros((most, 3))
    count = 0
    x, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    offset, rotation, place = np.zeros(2), np.empty((3, 3)), np.empty(3)
    for o in range(scene.kind.size):
        node, last, longest = near_nodes(scene, o, state.strains)
        while node <= last:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           hessian)
            force = contacts.node[o, node] - k * gap
            if force > 0.0:
                index[0, count], index[1, count], index[2, count] = o, node - 1, -1
                value[0, count], value[1, count], value[2, count] = 1.0, gap, force
                normals[count] = normal
                _fill_arm(state.rotations[node], offset, arms[count])
                count += 1
            node = next_touching(lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        o, e = contacts.obstacle[c], contacts.element[c]
        if o < 0:
            continue
        gap, e, fraction = closest_point(scene, contacts, c, lengths, state.strains,
                                         state.rotations, state.positions, normal, hessian)
        force = contacts.multiplier[c] - k * gap
        if force > 0.0:
            index[0, count], index[1, count], index[2, count] = o, e, c
            value[0, count] = min(fraction, _INSIDE)
            value[1, count], value[2, count] = gap, force
            normals[count] = normal
            point_inside(lengths, state.strains, state.rotations, state.positions, e, fraction,
                         rotation, place)
            offset[:] = 0.0
            gap_at(scene, o, rotation, place, 0.0, offset, x, normal, hessian)
            _fill_arm(rotation, offset, arms[count])
            count += 1
    for a in range(count):
        index[3, a] = _friction_of(contacts, index[0, a], index[1, a], value[0, a])
    return Touching(index[0, :count].copy(), index[1, :count].copy(), value[0, :count].copy(),
                    index[2, :count].copy(), index[3, :count].copy(), value[1, :count].copy(),
                    value[2, :count].copy(), normals[:count].copy(), arms[:count].copy())


@kernel
def _fill_arm(rotation, offset, arm):
    for i in range(3):
        arm[i] = rotation[i, 1] * offset[0] + rotation[i, 2] * offset[1]


@kernel
def _friction_of(contacts, o, e, fraction):
    """Return the index of the point of friction of a contact, -1 if it has none."""
    for c in range(contacts.element.size):
        if (contacts.obstacle[c] == -1 - o and contacts.element[c] == e
                and (contacts.fraction[c] == 1.0) == (fraction == 1.0)):
            return c
    return -1


@kernel
def truth(system: Problem, q: Floats) -> tuple[Configuration, float, Touching, float]:
    """Return Configuration, residual, Touching at q (m, 3), and the largest violation in m.

    The limits of friction are mu times the forces of this state, so that the residual is that of
    the law of Coulomb. What is violated: a contact that bears has no gap; a point that sticks has
    not moved; one that slides has moved against its friction.
    """
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    contacts = system.effects.contact.contacts
    table = touching(system.effects.contact.scene, contacts, system.lengths, state)
    violation = 0.0
    for a in range(table.gap.size):
        violation = max(violation, abs(table.gap[a]))
        c = table.rubbing[a]
        if c >= 0:
            violation = max(violation, _slip_error(system, state, contacts, c))
    return state, residual_of(system, state), table, violation


@kernel
def _slip_error(system, state, contacts, c):
    """Return how far, in m, a point has slid that sticks, or otherwise than against its friction.

    The multiplier is the force itself where all is right; what it differs by is such a way.
    """
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    point_inside(system.lengths, state.strains, state.rotations, state.positions,
                 contacts.element[c], contacts.fraction[c], rotation, x)
    size = trial_traction(contacts, c, x, trial)
    along = 0.0  # of the way, against its friction
    if size > contacts.multiplier[c]:
        for i in range(3):
            along += (trial[i] - contacts.shear[c, i]) * trial[i] / size
        along = max(0.0, along)
    square = 0.0
    for i in range(3):
        slid = trial[i] - contacts.shear[c, i]
        if along > 0.0:
            slid -= along * trial[i] / size
        square += slid * slid
    return np.sqrt(square) / contacts.grip


@kernel
def with_contacts_of(old, element, obstacle, multiplier, fraction, anchor, normal, shear):
    """Return ContactSet with other points, in the order of their elements."""
    order = np.argsort(element, kind='mergesort')
    return ContactSet(old.stiffness, old.node, element[order], obstacle[order], multiplier[order],
                      fraction[order], anchor[order], normal[order], shear[order], old.grip)


@kernel
def touching_system(system, contacts, scene):
    """Return the same Problem with other ContactSet with a Scene."""
    needs, effects = system.needs, system.effects
    beside = needs.attached.moment.shape[0] + needs.attached.node_moment.shape[0] > 0
    attached = nothing_attached(needs.attached.sprung.size, contacts.element, beside)
    return Problem(system.lengths, system.natural, system.stiffness, system.scale, system.basis,
                   system.base, system.origin,
                   with_terms(effects, effects.anchor, effects.hold, Contact(scene, contacts)),
                   Structure(needs.displaced, attached, needs.border), system.proximal_point,
                   system.proximal_weight)
