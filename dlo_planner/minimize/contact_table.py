# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of contacts: where a DLO touches, what rubs there, and what breaks the contact laws."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import Contact, ContactSet, trial_traction
from dlo_planner.energy.gap import (
    closest_point,
    gap_at,
    near_gaps,
    node_gap,
)
from dlo_planner.energy.grip import constraint_violation
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.energy.scene import Scene
from dlo_planner.geometry.kinematics import nothing_attached, point_inside
from dlo_planner.geometry.record import Record, replaced
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import residual_of
from dlo_planner.model.arrays import Floats, Ints

_BELIEVED = 2.0  # of a force, beyond its multiplier, that is believed
NEGLIGIBLE = 1e-9  # of the force of a spring over its gap: that of a candidate
_INSIDE = 1.0 - 1e-14  # largest fraction of a point of friction that is not on a node


class Touching(Record):
    """The A contacts that bear at one state, on nodes and inside elements."""

    obstacle: Ints  # (A,) index of the obstacle
    element: Ints  # (A,) index of the element
    fraction: Floats  # (A,) of the element; 1 for a node, its end, only
    inside: Ints  # (A,) index among ContactSet' points, -1 for a node
    rubbing: Ints  # (A,) index of its point of friction there, -1 without
    gap: Floats  # (A,) gap in m
    force: Floats  # (A,) force in N
    normal: Floats  # (A, 3) normal of the obstacle
    arm: Floats  # (A, 3) of the force from the axis, m, beyond the radius of a round DLO


@kernel
def touching(scene: Scene, contacts: ContactSet, lengths: Floats, state: Configuration) -> Touching:
    """Return the Touching of a state."""
    k = contacts.stiffness
    most = scene.kind.size * lengths.size + contacts.element.size
    index = np.empty((4, most), dtype=np.int64)
    value = np.empty((3, most))
    normals, arms = np.empty((most, 3)), np.zeros((most, 3))
    count = 0
    x, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    offset, rotation, place = np.zeros(2), np.empty((3, 3)), np.empty(3)
    for o in range(scene.kind.size):
        gaps = near_gaps(scene, o, lengths, contacts.node[o], state.strains, state.rotations,
                         state.positions, 0.0)
        for node in range(gaps.size):
            force = contacts.node[o, node]
            if k > 0.0:  # a gap that is not looked at is infinite
                force -= k * gaps[node]
            if force > 0.0:
                node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                         hessian)
                index[0, count], index[1, count], index[2, count] = o, node - 1, -1
                value[0, count], value[1, count], value[2, count] = 1.0, gaps[node], force
                normals[count] = normal
                _fill_arm(state.rotations[node], offset, arms[count])
                count += 1
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
    """Return the index of the point of friction of a contact, -1 if it has none.

    Beside a hole the nearest of two in the element.
    """
    best, nearest = -1, np.inf
    for c in range(contacts.element.size):
        away = abs(contacts.fraction[c] - fraction)
        if (contacts.obstacle[c] == -1 - o and contacts.element[c] == e
                and (contacts.fraction[c] == 1.0) == (fraction == 1.0) and away < nearest):
            best, nearest = c, away
    return best


@kernel
def kkt_residual(system: Problem, q: Floats) -> tuple[Configuration, float, Touching, float]:
    """Return Configuration, residual, Touching at q (m, 3), and the largest violation in m.

    The limits of friction are mu times the forces of this state, so that the residual is that of
    the law of Coulomb. What is violated: a contact that bears has no gap; a point that sticks has
    not moved; one that slides has moved against its friction; what is held is in its grips.
    """
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    contacts = system.effects.contact.contacts
    table = touching(system.effects.contact.scene, contacts, system.lengths, state)
    violation = constraint_violation(system.effects.hold, state)
    for a in range(table.gap.size):
        if is_candidate(contacts, table, a):
            continue
        violation = max(violation, abs(table.gap[a]))
        c = table.rubbing[a]
        if c >= 0:
            violation = max(violation, _slip_error(system, state, contacts, c))
    return state, residual_of(system, state), table, violation


@kernel
def is_candidate(contacts, table, a):
    """Whether a contact in the table has a gap and no force but a candidate's: it may bear soon."""
    return (table.gap[a] > 0.0
            and table.force[a] <= 2.0 * NEGLIGIBLE * contacts.stiffness * table.gap[a])


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
    return replaced(old, 'element', element[order], 'obstacle', obstacle[order],
                    'multiplier', multiplier[order], 'fraction', fraction[order],
                    'anchor', anchor[order], 'normal', normal[order], 'shear', shear[order])


@kernel
def with_springs(contacts, stiffness, node, multiplier):
    """Return the same ContactSet with springs of another stiffness, and other multipliers."""
    return replaced(contacts, 'stiffness', stiffness, 'node', node, 'multiplier', multiplier,
                    'shear', contacts.shear.copy())


@kernel
def with_contacts(system, contacts, scene):
    """Return the same Problem with another ContactSet and Scene."""
    attached = nothing_attached(system.lengths.size + 1, contacts.element)
    return replaced(system,
                    'effects', replaced(system.effects, 'contact', Contact(scene, contacts)),
                    'needs', replaced(system.needs, 'attached', attached))


@kernel
def with_stiffness(system, stiffness, grip):
    """Return the same Problem with copies of its contacts, of other stiffnesses, N/m."""
    old = system.effects.contact.contacts
    contacts = with_springs(old, stiffness, old.node.copy(), old.multiplier.copy())
    return with_contacts(system, replaced(contacts, 'grip', grip), system.effects.contact.scene)


@kernel
def update_friction(system: Problem, contacts: ContactSet, state: Configuration,
                    previous: Floats) -> ContactSet:
    """Return the ContactSet with a point of friction for each contact that bears and rubs.

    It sticks to where its point of the DLO was before the step; contacts that move along the DLO
    keep by how much they had been stretched then. Its limit is mu times the force at `state`, which
    the multiplier bounds: the spring force of a new contact may be anything.

    Args:
        contacts: Contacts in place of the system's
        previous: (N + 1, 6) positions and tangents of the nodes before the step, or (0, 6)
    """
    scene = system.effects.contact.scene
    if not (np.any(scene.friction > 0.0) or np.any(contacts.obstacle < 0)):
        return contacts
    table = touching(scene, contacts, system.lengths, state)
    rubs = scene.friction[table.obstacle] > 0.0
    for a in range(rubs.size):
        c = table.inside[a]
        bound = (contacts.multiplier[c] if c >= 0
                 else contacts.node[table.obstacle[a], table.element[a] + 1])
        table.force[a] = min(table.force[a], _BELIEVED * bound)
        rubs[a] &= bound > 0.0
    count = np.sum(rubs)
    anchors, shears = np.empty((count, 3)), np.zeros((count, 3))
    limits = scene.friction[table.obstacle[rubs]] * table.force[rubs]
    elements, fractions = table.element[rubs], table.fraction[rubs]
    obstacles, normals = -1 - table.obstacle[rubs], table.normal[rubs]
    place, former = np.empty(3), np.empty(3)
    for p in range(count):
        place_before(system, state, previous, elements[p], fractions[p], place)
        anchors[p] = place
        c = _friction_before(contacts, obstacles[p], elements[p], fractions[p])
        if c >= 0:
            place_before(system, state, previous, contacts.element[c], contacts.fraction[c],
                          former)
            anchors[p] += contacts.anchor[c] - former
            shear = contacts.shear[c]
            shears[p] = shear - np.sum(shear * normals[p]) * normals[p]
    kept = contacts.obstacle >= 0
    return with_contacts_of(
        contacts, np.concatenate((contacts.element[kept], elements)),
        np.concatenate((contacts.obstacle[kept], obstacles)),
        np.concatenate((contacts.multiplier[kept], limits)),
        np.concatenate((contacts.fraction[kept], fractions)),
        np.concatenate((contacts.anchor[kept], anchors)),
        np.concatenate((contacts.normal[kept], normals)),
        np.concatenate((contacts.shear[kept], shears)))


@kernel
def _friction_before(contacts, obstacle, element, fraction):
    """Return the nearest point of friction there was on an obstacle, within an element, or -1."""
    best, nearest = -1, 1.0
    for c in range(contacts.element.size):
        if contacts.obstacle[c] == obstacle:
            away = abs(contacts.element[c] + contacts.fraction[c] - element - fraction)
            if (contacts.fraction[c] == 1.0) != (fraction == 1.0):
                away += 1e-9  # a node goes on with the same node
            if away < nearest:
                best, nearest = c, away
    return best


@kernel
def place_before(system, state, previous, e, fraction, x):
    """Fill x (3,): where a point of the DLO was before the step, where it is if there was none.

    Between the nodes a cubic (Hermite).
    """
    if not previous.shape[0]:
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e, fraction,
                     np.empty((3, 3)), x)
        return
    f, h = fraction, system.lengths[e]
    for i in range(3):
        x[i] = ((1 + 2 * f) * (1 - f) ** 2 * previous[e, i]
                + f * f * (3 - 2 * f) * previous[e + 1, i]
                + h * f * (1 - f) * ((1 - f) * previous[e, 3 + i] - f * previous[e + 1, 3 + i]))
