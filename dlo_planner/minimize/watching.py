"""Which points inside elements may touch an obstacle: looked at anew between two minimisations."""

import numpy as np

from dlo_planner.energy.contact import Contacts, nearest_inside
from dlo_planner.energy.distance import FACE, NODE_FACE
from dlo_planner.energy.outline import gap_at, node_gap, nodes_of, sliding, slope_along, taper
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
    rotation, offset, point = np.empty((3, 3)), np.zeros(2), np.empty(3)
    gaps, normals, offsets = np.empty(n + 1), np.empty((n + 1, 3)), np.empty((n + 1, 2))
    for o in range(scene.kind.size):
        begin, end = nodes_of(scene, o, n)
        for k in range(begin, end + 1):
            gaps[k] = node_gap(scene, o, k, state.rotations, state.positions, offset, point,
                               normals[k], bend)
            offsets[k] = offset
        for e in range(begin, end):
            near = min(gaps[e], gaps[e + 1])
            if near > system.lengths[e]:
                continue
            if scene.feature[o] == NODE_FACE:
                if gaps[e + 1] < 0.5 * system.lengths[e] and _rounds(
                        scene, o, total, state.rotations[e + 1], state.positions[e + 1]):
                    found[count, 0], found[count, 1] = e, o
                    count += 1
                continue
            grows = taper(scene, o, e) / system.lengths[e]
            if (_slope(state.rotations[e], state.strains[e], offsets[e], normals[e]) >= grows
                    or _slope(state.rotations[e + 1], state.strains[e], offsets[e + 1],
                              normals[e + 1]) <= grows):
                continue
            gap, fraction = nearest_inside(scene, o, e, system.lengths, state.strains,
                                           state.rotations, state.positions, normal, bend)
            point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                         fraction, rotation, x)
            gap_at(scene, o, rotation, x, 0.0, offset, point, normal, bend)
            if scene.feature[o] == FACE and not _rounds(scene, o, total, rotation, x):
                continue
            _, curve = slope_along(scene, o, rotation, state.strains[e], offset, normal, bend)
            sharp = curve * system.lengths[e] ** 2 > 8 * _SAG * total
            if (sharp or gap < near - _SAG * total) and gap < 0.5 * system.lengths[e]:
                found[count, 0], found[count, 1] = e, o
                count += 1
    return found[:count]


@kernel
def _slope(rotation, strain, offset, normal):
    """Return the slope along the DLO of the distance of a point at an offset from the axis."""
    w0 = 1.0 + strain[1] * offset[1] - strain[2] * offset[0]
    w1, w2 = -strain[0] * offset[1], strain[0] * offset[0]
    slope = 0.0
    for i in range(3):
        slope += normal[i] * (rotation[i, 0] * w0 + rotation[i, 1] * w1 + rotation[i, 2] * w2)
    return slope


@kernel
def _rounds(scene, o, total, rotation, position):
    """Whether an obstacle is nearest between the edges of a section, and sharply so."""
    offset, point, normal, bend = np.zeros(2), np.empty(3), np.empty(3), np.empty((3, 3))
    moves, curves = np.empty((3, 3)), np.empty((3, 3))
    gap_at(scene, o, rotation, position, 0.0, offset, point, normal, bend)
    if sliding(scene, o, False, rotation, normal, offset, normal, bend, moves, curves) == 0:
        return False
    half = abs(scene.offset[o, 0 if abs(offset[0]) < scene.offset[o, 0] else 1])
    return curves[0, 0] * half**2 > 8 * _SAG * total
