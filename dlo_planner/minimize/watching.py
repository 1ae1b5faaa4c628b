"""Which points inside elements may touch an obstacle: looked at anew between two minimisations."""

import numpy as np

from dlo_planner.energy.contact import along_the_dlo, nearest_inside, next_touching
from dlo_planner.energy.distance import signed_distance
from dlo_planner.kernels import kernel
from dlo_planner.minimize.touching import with_contacts_of
from dlo_planner.ritz.kinematics import point_inside

_SAG = 2e-6     # of the length: an element that comes no nearer than its nodes by more is flat
_LEVEL = 1e-12  # the same, by rounding errors alone
_NEARBY = 5     # elements: a DLO that bears within so many as well lies along the obstacle


@kernel
def watching(system, state):
    """Return the Contacts that watch the points inside elements which matter now.

    Points of friction are kept; multipliers go to the nearest new point on the same obstacle. Also
    returned is whether there is a point in an element that had none.
    """
    old = system.contacts
    inside = _points_inside(system, state)
    count = inside.shape[0]
    multiplier = np.zeros(count)
    news = False
    taken = np.zeros(old.element.size, dtype=np.bool_)
    for c in range(count):
        best = -1
        for b in range(old.element.size):
            if (old.obstacle[b] == inside[c, 1] and not taken[b]
                    and abs(old.element[b] - inside[c, 0]) <= 1
                    and (best < 0 or old.element[b] == inside[c, 0])):
                best = b
        if best >= 0:
            taken[best] = True
            multiplier[c] = old.multiplier[best]
        news = news or best < 0 or old.element[best] != inside[c, 0]
    rubs = old.obstacle < 0
    nothing = np.zeros((count, 3))
    return with_contacts_of(
        old, np.concatenate((inside[:, 0], old.element[rubs])),
        np.concatenate((inside[:, 1], old.obstacle[rubs])),
        np.concatenate((multiplier, old.multiplier[rubs])),
        np.concatenate((np.zeros(count), old.fraction[rubs])),
        np.concatenate((nothing, old.anchor[rubs])), np.concatenate((nothing, old.normal[rubs])),
        np.concatenate((nothing, old.shear[rubs]))), news


@kernel
def _points_inside(system, state):
    """Return (C, 2) element and obstacle where the DLO is nearest inside an element.

    Where a DLO lies along an obstacle, with a row of nodes that bear, its nearly flat elements
    bear at their nodes. A contact by itself is a point that rolls along the DLO, flat or not:
    two nodes in its place would lock the direction of the DLO there.
    """
    scene = system.scene
    n = system.lengths.size
    sag, level = _SAG * np.sum(system.lengths), _LEVEL * np.sum(system.lengths)
    longest = np.max(system.lengths)
    found = np.empty((n * scene.kind.size, 2), dtype=np.int64)
    count = 0
    x, normal, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    rotation = np.empty((3, 3))
    nobody = np.zeros(n + 1)
    gaps, slopes = np.empty(n + 1), np.empty(n + 1)
    for o in range(scene.kind.size):
        gaps[:] = np.inf
        k = 0
        while k <= n:
            for i in range(3):
                x[i] = scene.origin[i] + state.positions[k, i]
            gaps[k] = signed_distance(scene, o, x, normal, bend) - scene.radius
            slopes[k] = np.sum(normal * state.rotations[k, :, 0])
            k = next_touching(system.lengths, nobody, k, gaps[k] - 2 * longest)
        for e in range(n):
            near = min(gaps[e], gaps[e + 1])
            if near > system.lengths[e] or slopes[e] >= 0.0 or slopes[e + 1] <= 0.0:
                continue
            gap, fraction = nearest_inside(scene, o, e, system.lengths, state.strains,
                                           state.rotations, state.positions, normal, bend)
            if gap >= 0.5 * system.lengths[e]:
                continue
            point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                         fraction, rotation, x)
            _, curve = along_the_dlo(normal, bend, rotation, state.strains[e])
            sharp = curve * system.lengths[e] ** 2 > 8 * sag or gap < near - sag
            if sharp or gap < near - level and not _lies(system.contacts.node[o], gaps, e):
                found[count, 0], found[count, 1] = e, o
                count += 1
    return found[:count]


@kernel
def _lies(node, gaps, e):
    """Whether the DLO bears on an obstacle nearby, but not at or next to element e.

    Args:
        node: (N + 1,) multipliers; gaps: (N + 1,) m
    """
    for k in range(max(1, e - _NEARBY), min(node.size, e + 2 + _NEARBY)):
        if (node[k] > 0.0 or gaps[k] < 0.0) and not e - 1 <= k <= e + 2:
            return True
    return False
