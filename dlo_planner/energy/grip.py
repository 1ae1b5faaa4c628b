# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A second grip at the free end: which motions of that end are held, and with which forces.

K rows of a twist (rotation, displacement) of the free end are held: c(shape) = 0 (K,), in m. Their
multipliers are the reaction, which `minimize.newton` finds with the shape. The end's axes d_i are
compared with their targets t_i by rho = sum of a_i t_i x d_i, which is linear in d_i:
so a moment acts as dead forces on the tips of the axes, and its second derivatives are those of
dead loads. Springs stand beside the multipliers. They vanish, with their gradient, where c = 0, so
they change no equilibrium; they make the Hessian positive along what is held.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.geometry.kinematics import spring_at
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


class GripConstraint(Record):
    """What is held of the far end; K = 0 if it is free."""

    target: Floats  # (3,) where the end is held, m, world axes, relative to the gripper
    axes: Floats  # (3, 3) its frame there, columns t, n, b
    share: Floats  # (3,) a_i, how much each axis counts
    # (K, 6) held directions of the twist: lever (m) times a unit vector of rotation, or a unit
    # vector of displacement
    rows: Floats
    multiplier: Floats  # (K,) derivative of the potential by c, N
    stiffness: float  # of displacement, N/m
    turn_stiffness: float  # of rotation, N m


def no_grip(stiffness: float, turn_stiffness: float) -> GripConstraint:
    """Return the GripConstraint of a free end, with springs as of one that is held."""
    return GripConstraint(np.zeros(3), np.eye(3), np.zeros(3), np.zeros((0, 6)), np.zeros(0),
                          stiffness, turn_stiffness)


@kernel
def holds(effect: GripConstraint | None) -> bool:
    """Whether anything of the far end is held."""
    if effect is None:
        return False
    return effect.multiplier.size > 0


def needs(effect: GripConstraint) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    return {'displaced': holds(effect), 'attached': True, 'rows': effect.multiplier.size}


@kernel
def constraint_value(hold, rotation, position, miss):
    """Fill miss (K,) with c in m, of a free end with rotation (3, 3) at position (3,).

    Returns its size, by how much the grip is missed.
    """
    if hold is None:
        return 0.0
    if miss.size == 0:
        return 0.0
    square = 0.0
    turned = np.zeros(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for axis in range(3):
            turned[i] += hold.share[axis] * (hold.axes[j, axis] * rotation[k, axis]
                                             - hold.axes[k, axis] * rotation[j, axis])
    for row in range(miss.size):
        miss[row] = 0.0
        for i in range(3):
            miss[row] += (hold.rows[row, i] * turned[i]
                          + hold.rows[row, 3 + i] * (position[i] - hold.target[i]))
        square += miss[row] * miss[row]
    return np.sqrt(square)


@kernel
def constraint_violation(hold: GripConstraint | None, rotation: Floats, position: Floats) -> float:
    """Return by how much the grip is missed, m: the size of c (K,)."""
    if hold is None:
        return 0.0
    return constraint_value(hold, rotation, position, np.empty(hold.multiplier.size))


@kernel
def move_multipliers(hold, part, reaction):
    """Add a part of the reaction's change (K,) to the forces of a grip."""
    if hold is None:
        return
    for row in range(reaction.size):
        hold.multiplier[row] += part * reaction[row]


@kernel
def reaction_of(hold, count):
    """Return a copy (K,) of the forces of a grip with so many."""
    reaction = np.zeros(count)
    if hold is not None:
        reaction[:] = hold.multiplier
    return reaction


@kernel
def set_reaction(hold, reaction):
    """Make `reaction` (K,) the forces of a grip."""
    if hold is not None:
        hold.multiplier[:] = reaction


@kernel
def add_forces(effect, system, state):
    """Add what holds the last node to it; return the potential in J, and its size."""
    if effect is None:
        return 0.0, 0.0
    energy = 0.0
    if effect.multiplier.size:
        n, attached = system.lengths.size, state.attached
        spring_at(attached, n)
        energy = add_hold(effect, state.rotations[n], state.positions[n], state.pull[n],
                          attached.node_moment[n], attached.node_first[n], attached.node_matrix[n])
    return energy, abs(energy)


@kernel
def put_wrench(effect, rotation, position, wrench):
    """Fill wrench (6,): force and moment of the grip on the free end, N and N m."""
    force, moment = np.zeros(3), np.zeros(3)
    add_hold(effect, rotation, position, force, moment, np.zeros((3, 3)), np.zeros((6, 6)))
    for i in range(3):
        wrench[i], wrench[3 + i] = -force[i], -moment[i]


@kernel
def roundoff(effect, system, state, length):
    """Return forces in N whose relative rounding errors those of the grip have."""
    if effect is None:
        return 0.0
    if effect.multiplier.size == 0:
        return 0.0
    return effect.stiffness * length + effect.turn_stiffness / length


@kernel
def constraint_jacobian(effect, rotation, position, out):
    """Fill out (K, 6): change of c per twist (rotation, displacement) at the gripper's origin."""
    if effect is None:
        return
    axes, rows = effect.axes, effect.rows
    for row in range(out.shape[0]):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            # x rotates with the twist: (rotation x position) . row
            total = position[j] * rows[row, 3 + k] - position[k] * rows[row, 3 + j]
            for axis in range(3):
                along = across = 0.0
                for m in range(3):
                    along += axes[m, axis] * rotation[m, axis]
                    across += rotation[m, axis] * rows[row, m]
                # t x (theta x d) = theta (t . d) - d (t . theta)
                total += effect.share[axis] * (along * rows[row, i] - across * axes[i, axis])
            out[row, i] = total
            out[row, 3 + i] = rows[row, 3 + i]


@kernel
def add_hold(hold, rotation, position, pull, moment, first, spring):
    """Add to what acts on a node, see `OffNodeLoads`; return the potential in J."""
    torque, couple = np.zeros(3), np.empty(3)
    energy = 0.0
    for row in range(hold.multiplier.size):
        away = 0.0
        for i in range(3):
            away += hold.rows[row, 3 + i] * (position[i] - hold.target[i])
            torque[i] += hold.multiplier[row] * hold.rows[row, i]
        energy += away * (hold.multiplier[row] + 0.5 * hold.stiffness * away)
        force = hold.multiplier[row] + hold.stiffness * away
        for i in range(3):
            pull[i] += force * hold.rows[row, 3 + i]
            for j in range(3):
                spring[3 + i, 3 + j] += (hold.stiffness * hold.rows[row, 3 + i]
                                         * hold.rows[row, 3 + j])
    for axis in range(3):
        if hold.share[axis] == 0.0:
            continue
        along = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            t, d = hold.axes[i, axis], rotation[i, axis]
            couple[i] = hold.share[axis] * (
                torque[j] * hold.axes[k, axis] - torque[k] * hold.axes[j, axis]
                - hold.turn_stiffness * t)
            energy += d * couple[i]
            along += t * t
        energy += hold.share[axis] * hold.turn_stiffness * along
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            moment[i] += rotation[j, axis] * couple[k] - rotation[k, axis] * couple[j]
            for j in range(3):
                first[i, j] += couple[i] * rotation[j, axis]
    return energy
