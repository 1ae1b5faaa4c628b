# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction at one point of contact: it sticks to where it is, or slides and is held back.

The force that a sliding by s across the normal meets is the trial force t = shear + grip s, cut to
the limit mu N:  T = t min(1, mu N / |t|).  With `shear` the force itself at the end of the
minimizer's outer loop, s vanishes where the point sticks, and where it slides T opposes s (the
augmented Lagrangian of Simo and Laursen 1992). For a given limit T has a potential, which is what
the minimizer sees; the outer loop moves limit and shear.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.kinematics import point_inside

if TYPE_CHECKING:
    from dlo_planner.energy.contact import Contacts


@kernel
def trial_force(contacts: Contacts, c: int, x: Floats, trial: Floats) -> float:
    """Fill trial (3,), what would pull point of friction c back to its anchor; return its size.

    Args:
        x: (3,) where the point is, relative to the gripper
    """
    normal = contacts.normal[c]
    out = 0.0
    for i in range(3):
        out += (x[i] - contacts.anchor[c, i]) * normal[i]
    square = 0.0
    for i in range(3):
        slid = x[i] - contacts.anchor[c, i] - out * normal[i]
        trial[i] = contacts.shear[c, i] + contacts.grip * slid
        square += trial[i] * trial[i]
    return np.sqrt(square)


@kernel
def add_friction(contacts, c, lengths, strains, rotations, positions, attached):
    """Write force and stiffness of point of friction c; return its potential in J."""
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    e, limit, normal, grip = (contacts.element[c], contacts.multiplier[c], contacts.normal[c],
                              contacts.grip)
    attached.fraction[c] = contacts.fraction[c]
    point_inside(lengths, strains, rotations, positions, e, contacts.fraction[c], rotation, x)
    size = trial_force(contacts, c, x, trial)
    if size <= limit:
        for i in range(3):
            attached.force[c, i] = trial[i]
            for j in range(3):
                attached.matrix[c, 3 + i, 3 + j] = grip * ((i == j) - normal[i] * normal[j])
        return 0.5 * size * size / grip
    for i in range(3):
        trial[i] /= size
        attached.force[c, i] = limit * trial[i]
    for i in range(3):
        for j in range(3):
            attached.matrix[c, 3 + i, 3 + j] = grip * limit / size * (
                (i == j) - normal[i] * normal[j] - trial[i] * trial[j])
    return limit * (size - 0.5 * limit) / grip
