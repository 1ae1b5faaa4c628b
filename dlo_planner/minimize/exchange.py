# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points inside elements that may touch an obstacle: kept, and joined by those that are pressed in.

Where a DLO lies along an obstacle, `watching` may choose other points after each minimization, in
turn, without an end. A set that only grows comes to an end: the exchange method of semi-infinite
programs (Hettich and Kortanek, SIAM Review 35, 1993), of which a contact is one, a condition at
every point of the DLO.
"""

import numpy as np

from dlo_planner.energy.gap import follow_closest_point, gap_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hugging import MIDDLE, SAG
from dlo_planner.minimize.touching import with_contacts_of
from dlo_planner.minimize.watching import points_inside, rolled_to


@kernel
def exchanged(system, state):
    """Return Contacts with all points of the Problem's, and whether others have joined them.

    One joins that is deeper in an obstacle than flat elements may be. The middle of an element that
    bends as the obstacle does replaces a point that rolls in it, with its multiplier.
    """
    old = system.effects.contact.contacts
    at, places = rolled_to(system, state)
    inside, fixed = points_inside(system, state, places)
    kept = np.ones(old.element.size, dtype=np.bool_)
    joins, force = np.zeros(inside.shape[0], dtype=np.bool_), np.zeros(inside.shape[0])
    for p in range(inside.shape[0]):
        e, o = inside[p]
        joins[p] = (_gap(system, state, o, e, fixed[p]) < -SAG * np.sum(system.lengths)
                    and not _known(old, at, e, o, fixed[p] > 0.0))
        for c in range(old.element.size if joins[p] and fixed[p] > 0.0 else 0):
            if kept[c] and old.obstacle[c] == o and at[c] == e and old.fraction[c] == 0.0:
                kept[c] = False
                force[p] += old.multiplier[c]
    none = np.zeros((np.sum(joins), 3))
    return with_contacts_of(
        old, np.concatenate((old.element[kept], inside[joins, 0])),
        np.concatenate((old.obstacle[kept], inside[joins, 1])),
        np.concatenate((old.multiplier[kept], force[joins])),
        np.concatenate((old.fraction[kept], fixed[joins])),
        np.concatenate((old.anchor[kept], none)), np.concatenate((old.normal[kept], none)),
        np.concatenate((old.shear[kept], none))), none.shape[0] > 0


@kernel
def _gap(system, state, o, e, fixed):
    """Return the gap in m of the middle of element e, if `fixed`, or of where it is nearest."""
    scene, normal, hessian = system.effects.contact.scene, np.empty(3), np.empty((3, 3))
    if fixed > 0.0:
        return gap_inside(scene, o, e, MIDDLE, system.lengths, state.strains, state.rotations,
                          state.positions, normal, hessian)
    gap, _, _ = follow_closest_point(scene, o, e, system.lengths, state.strains, state.rotations,
                                     state.positions, normal, hessian)
    return gap


@kernel
def _known(contacts, at, e, o, fixed):
    """Whether such a point on obstacle o is in element e by now; at: (C,) where they are."""
    for c in range(at.size):
        if contacts.obstacle[c] == o and at[c] == e and (contacts.fraction[c] > 0.0) == fixed:
            return True
    return False
