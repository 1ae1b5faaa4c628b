# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO rubs: the points of friction, what they stick to, and the limits of their forces."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.problem import Configuration, Problem
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.touching import touching, with_contacts_of
from dlo_planner.model.arrays import Floats

_GROWTH = 2.0  # of a force, beyond its multiplier, that is believed


@kernel
def with_friction(system: Problem, contacts: ContactSet, state: Configuration,
                  previous: Floats) -> ContactSet:
    """Return the ContactSet with a point of friction for each contact that bears and rubs.

    The force of a contact that is new may be anything: its multiplier bounds the limit.

    It sticks to where its point of the DLO was before the step; contacts that move along the DLO
    keep by how much they had been stretched then. Its limit is mu times the force at `state`.

    Args:
        contacts: Contacts in place of the system's
        previous: (N + 1, 6) positions and tangents of the nodes before the step, or (0, 6)
    """
    scene = system.effects.contact.scene
    if not _may_rub(scene, contacts):
        return contacts
    table = touching(scene, contacts, system.lengths, state)
    rubs = scene.friction[table.obstacle] > 0.0
    for a in range(rubs.size):
        c = table.inside[a]
        bound = (contacts.multiplier[c] if c >= 0
                 else contacts.node[table.obstacle[a], table.element[a] + 1])
        table.force[a] = min(table.force[a], _GROWTH * bound)
        rubs[a] &= bound > 0.0
    count = np.sum(rubs)
    anchors, shears = np.empty((count, 3)), np.zeros((count, 3))
    limits = scene.friction[table.obstacle[rubs]] * table.force[rubs]
    elements, fractions = table.element[rubs], table.fraction[rubs]
    obstacles, normals = -1 - table.obstacle[rubs], table.normal[rubs]
    place, former = np.empty(3), np.empty(3)
    for p in range(count):
        _before(system, state, previous, elements[p], fractions[p], place)
        anchors[p] = place
        c = _known(contacts, obstacles[p], elements[p], fractions[p])
        if c >= 0:
            _before(system, state, previous, contacts.element[c], contacts.fraction[c], former)
            anchors[p] += contacts.anchor[c] - former
            _cut(contacts.shear[c], normals[p], limits[p], shears[p])
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
def _may_rub(scene, contacts):
    """Whether there is an obstacle with friction, or a point of friction."""
    rubs = False
    for o in range(scene.friction.size):
        rubs = rubs or scene.friction[o] > 0.0
    for c in range(contacts.obstacle.size):
        rubs = rubs or contacts.obstacle[c] < 0
    return rubs


@kernel
def _known(contacts, obstacle, element, fraction):
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
def _cut(shear, normal, limit, out):
    """Fill out (3,) with what is across the normal of shear (3,), and no more than the limit."""
    along, square = np.sum(shear * normal), 0.0
    for i in range(3):
        out[i] = shear[i] - along * normal[i]
        square += out[i] * out[i]
    if square > limit * limit:
        out *= limit / np.sqrt(square)


@kernel
def _before(system, state, previous, e, fraction, x):
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
