"""Where a DLO rubs: the points of friction and the limits of their forces."""

import numpy as np

from dlo_planner.energy.contact import Contacts, nearest_inside
from dlo_planner.energy.outline import node_gap
from dlo_planner.kernels import kernel
from dlo_planner.ritz.kinematics import point_inside

_SETTLED = 1e-6  # part of a limit by which it may still change


@kernel
def with_friction(system, state, previous):
    """Return the Contacts with the points of friction of now, and if these have settled.

    A point sticks to where it was before the step, less what its spring was stretched by then.
    """
    scene = system.scene
    n = system.lengths.size
    old = system.contacts
    most = (n + 1) * scene.kind.size + old.element.size
    where = np.empty((most, 2))  # element, fraction
    limits, anchors, normals = np.empty(most), np.empty((most, 3)), np.empty((most, 3))
    count = 0
    x, normal, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    rotation, offset = np.empty((3, 3)), np.zeros(2)
    settled = True
    for o in range(scene.kind.size):
        if scene.friction[o] == 0.0:
            continue
        for k in range(1, n + 1):
            if old.node[o, k] > 0.0:
                where[count, 0], where[count, 1] = k - 1, 1.0
                limits[count] = scene.friction[o] * old.node[o, k]
                node_gap(scene, o, k, state.rotations, state.positions, offset, x, normals[count],
                         bend)
                count += 1
        for c in range(old.element.size):
            if old.obstacle[c] == o and old.multiplier[c] > 0.0:
                e = old.element[c]
                _, fraction = nearest_inside(scene, o, e, system.lengths, state.strains,
                                             state.rotations, state.positions, normal, bend)
                where[count, 0], where[count, 1] = e, fraction
                limits[count] = scene.friction[o] * old.multiplier[c]
                normals[count] = normal
                count += 1
    for k in range(count):
        e, fraction = int(where[k, 0]), where[k, 1]
        best, nearest = -1, 1.0
        for b in range(old.element.size):
            away = abs(old.element[b] + old.fraction[b] - e - fraction)
            if old.obstacle[b] < 0 and away < nearest:
                best, nearest = b, away
        if best < 0:
            settled = False
            if previous.shape[0]:
                anchors[k] = (1 - fraction) * previous[e] + fraction * previous[e + 1]
            else:
                point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                             fraction, rotation, x)
                anchors[k] = x
        else:
            anchors[k] = old.anchor[best]
            if previous.shape[0]:  # another point of the DLO: its own way, the same stretch
                was = old.element[best]
                anchors[k] += ((1 - fraction) * previous[e] + fraction * previous[e + 1]
                               - (1 - old.fraction[best]) * previous[was]
                               - old.fraction[best] * previous[was + 1])
            change = abs(old.multiplier[best] - limits[k])
            settled = settled and change <= _SETTLED * (limits[k] + old.multiplier[best])
    stripped = old.obstacle >= 0
    element = np.concatenate((old.element[stripped], where[:count, 0].astype(np.int64)))
    order = np.argsort(element, kind='mergesort')
    obstacle = np.concatenate((old.obstacle[stripped], np.full(count, -1)))
    multiplier = np.concatenate((old.multiplier[stripped], limits[:count]))
    fraction = np.concatenate((old.fraction[stripped], where[:count, 1]))
    anchor = np.concatenate((old.anchor[stripped], anchors[:count]))
    normal_of = np.concatenate((old.normal[stripped], normals[:count]))
    return Contacts(old.stiffness, old.node, element[order], obstacle[order],
                    multiplier[order], fraction[order], anchor[order], normal_of[order],
                    old.grip), settled
