# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What slides in the answers of a DLO to its gripper: friction follows the forces of contact."""

import numpy as np

from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_forces import linearize, unit_load
from dlo_planner.minimize.dense import decomposed, substituted
from dlo_planner.minimize.hessian import solve
from dlo_planner.minimize.touching import touching


@kernel
def add_sliding(system, state, hessian, answers):
    """Complete the `answers` (6, m, 3) to the gripper's twists by what slides: T follows mu N.

    Args:
        hessian: of `system` at `state`, factorized; with the springs of friction alone, which know
            nothing of the forces that the limits depend on
    """
    contacts, k = system.effects.contact.contacts, system.effects.contact.contacts.stiffness
    table = touching(system.effects.contact.scene, contacts, system.lengths, state)
    first = np.arange(0, 3 * table.gap.size, 3)
    axes, laws = np.zeros((first.size * 3, 3)), np.zeros((first.size * 3, 3))
    linearize(system, state, table, first, axes, laws)
    slides = np.flatnonzero(laws[1::3, 0] > 0.0)
    size = slides.size
    across, response = np.empty((size, *state.q.shape)), np.empty((size, *state.q.shape))
    matrix, change, load = np.eye(size), np.empty((6, size)), np.empty_like(state.q)
    rotation, x = np.empty((3, 3)), np.empty(3)
    for p in range(size):
        a = slides[p]
        e, fraction = table.element[a], table.fraction[a]
        unit_load(system, state, hessian, e, fraction, table.arm[a], axes[3 * a], across[p])
        unit_load(system, state, hessian, e, fraction, np.zeros(3), axes[3 * a + 1], load)
        solve(system, hessian, load, response[p])
        response[p] *= laws[3 * a + 1, 2]
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e, fraction,
                     rotation, x)
        x += table.arm[a]
        normal = axes[3 * a]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            change[i, p] = x[j] * normal[m] - x[m] * normal[j]  # turned with the gripper
            change[3 + i, p] = normal[i]
        for i in range(6):
            change[i, p] = -k * (change[i, p] + np.sum(across[p] * answers[i]))
    for p in range(size):
        for r in range(size):
            matrix[p, r] -= k * np.sum(across[p] * response[r])
    order = np.empty(size, dtype=np.int64)
    if decomposed(matrix, order) == 0:
        return
    for i in range(6):
        substituted(matrix, order, change[i])
        for p in range(size):
            answers[i] -= change[i, p] * response[p]
