"""Which points inside elements may touch an obstacle: looked at anew between two minimisations."""

import numpy as np

from dlo_planner.energy.contact import Contacts, along_the_dlo, nearest_inside
from dlo_planner.energy.distance import signed_distance
from dlo_planner.kernels import kernel
from dlo_planner.ritz.kinematics import point_inside

_SAG = 2e-6  # of the length: an element that comes no nearer than its nodes by more is flat


@kernel
def watching(system, state):
    """Return the Contacts that watch the points inside elements which matter now.

    Points of friction are kept; multipliers go to the nearest new point on the same obstacle.
    """
    old = system.contacts
    n = system.lengths.size
    inside = _points_inside(system, state)
    kept = np.sum(old.obstacle < 0)
    total = inside.shape[0] + kept
    element = np.empty(total, dtype=np.int64)
    obstacle = np.empty(total, dtype=np.int64)
    multiplier, fraction = np.zeros(total), np.zeros(total)
    anchor, normal = np.zeros((total, 3)), np.zeros((total, 3))
    taken = np.zeros(old.element.size, dtype=np.bool_)
    c = 0
    for e in range(n):
        for k in range(inside.shape[0]):
            if inside[k, 0] != e:
                continue
            element[c], obstacle[c] = e, inside[k, 1]
            best = -1
            for b in range(old.element.size):
                if (old.obstacle[b] == obstacle[c] and not taken[b]
                        and abs(old.element[b] - e) <= 1
                        and (best < 0 or old.element[b] == e)):
                    best = b
            if best >= 0:
                taken[best] = True
                multiplier[c] = old.multiplier[best]
            c += 1
        for b in range(old.element.size):
            if old.obstacle[b] < 0 and old.element[b] == e:
                element[c], obstacle[c] = e, -1
                multiplier[c], fraction[c] = old.multiplier[b], old.fraction[b]
                anchor[c], normal[c] = old.anchor[b], old.normal[b]
                c += 1
    return Contacts(old.stiffness, old.node, element, obstacle, multiplier, fraction, anchor,
                    normal, old.grip)


@kernel
def _points_inside(system, state):
    """Return (C, 2) element and obstacle where the DLO is nearest inside an element, sharply."""
    scene = system.scene
    n = system.lengths.size
    total = np.sum(system.lengths)
    found = np.empty((n * scene.kind.size, 2), dtype=np.int64)
    count = 0
    x, normal, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    rotation = np.empty((3, 3))
    gaps, slopes = np.empty(n + 1), np.empty(n + 1)
    for o in range(scene.kind.size):
        for k in range(n + 1):
            for i in range(3):
                x[i] = scene.origin[i] + state.positions[k, i]
            gaps[k] = signed_distance(scene, o, x, normal, bend) - scene.radius
            slopes[k] = np.sum(normal * state.rotations[k, :, 0])
        for e in range(n):
            near = min(gaps[e], gaps[e + 1])
            if near > system.lengths[e] or slopes[e] >= 0.0 or slopes[e + 1] <= 0.0:
                continue
            gap, fraction = nearest_inside(scene, o, e, system.lengths, state.strains,
                                           state.rotations, state.positions, normal, bend)
            point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                         fraction, rotation, x)
            _, curve = along_the_dlo(normal, bend, rotation, state.strains[e])
            sharp = curve * system.lengths[e] ** 2 > 8 * _SAG * total
            if (sharp or gap < near - _SAG * total) and gap < 0.5 * system.lengths[e]:
                found[count, 0], found[count, 1] = e, o
                count += 1
    return found[:count]
