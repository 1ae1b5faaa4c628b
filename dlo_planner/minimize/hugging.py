# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Elements that bend just as the obstacle does that they bear on, and are kept to that.

As long as its curvature is less an element bears at one point, which rolls, and where it is more at
both nodes. In a range of loads between it is neither: the force spreads over the element, whose
curvature is the obstacle's. Both nodes and the middle carry it then.
"""

import numpy as np

from dlo_planner.energy.gap import gap_inside
from dlo_planner.energy.scene import NODE_FACE
from dlo_planner.kernels import kernel

SAG = 2e-6      # of the length: an element that comes no nearer than its nodes by more is flat
MIDDLE, _BESIDE = 0.5, 0.01  # of an element
_EVEN, _LEAVES = 2.0, 40.0   # times the sag: how much a gap bends along an element
_SNUG = 0.3     # rad: an element whose slope against an obstacle changes by more has its own bend
_DEEP = 0.02    # of an element: a node that is deeper inside is on its way out


@kernel
def hugs_at(system, state, o, e, gaps, places):
    """Return whether an element bends just as the obstacle does, and has to be kept to that.

    This begins where the point that rolls in it is not the nearest any more, or both nodes bear and
    what is between them is pressed in (not in a series, where elements wave); it ends where the
    middle does not bear, or an end does not while the element bends less than the obstacle.

    Args:
        gaps: (N + 1,) m, of the nodes from obstacle o; places: (C,) as of `points_inside`
    """
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    sag = SAG * np.sum(system.lengths)
    if e == 0 or scene.feature[o] == NODE_FACE or np.isinf(gaps[e] + gaps[e + 1]):
        return False
    if min(gaps[e], gaps[e + 1]) < -_DEEP * system.lengths[e]:
        return False
    first, second = presses(system, o, e, gaps), presses(system, o, e + 1, gaps)
    old = -1
    for c in range(contacts.element.size):
        if (contacts.obstacle[c] == o and -_BESIDE <= places[c] - e <= 1.0 + _BESIDE
                and (old < 0 or contacts.multiplier[c] > contacts.multiplier[old])):
            old = c
    if old < 0 and not (first and second):
        return False
    normal, hessian = np.empty(3), np.empty((3, 3))
    middle = gap_inside(scene, o, e, MIDDLE, system.lengths, state.strains,
                        state.rotations, state.positions, normal, hessian)
    curved = 4.0 * (gaps[e] - 2.0 * middle + gaps[e + 1])  # of the gap, times the length squared
    if abs(curved) > _SNUG * system.lengths[e]:
        return False
    if old < 0:
        return middle < -sag and system.basis.shape[1] == 0
    bears = contacts.multiplier[old] > contacts.stiffness * middle
    if contacts.fraction[old] == 0.0 or not (first or second):
        return bears and curved < _EVEN * sag
    return bears and (first and second or curved <= _LEAVES * sag)


@kernel
def presses(system, o, k, gaps):
    """Return whether a spring at node k presses on obstacle o."""
    contacts = system.effects.contact.contacts
    return contacts.node[o, k] > contacts.stiffness * gaps[k]
