# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What holds nodes beside the gripper: which motions of them are held, and with which forces.

A holds are at a node each, any of the DLO: its tip is one of them. Of the twist (rotation,
displacement) of a node some rows are held, K of all together: c(shape) = 0 (K,), in m. Their
multipliers are the reactions, which `minimize.newton` finds with the shape, all in one system. A
node's axes d_i are compared with their targets t_i by rho = sum of a_i t_i x d_i, which is linear
in d_i: so a moment acts as dead forces on the tips of the axes, and its second derivatives are
those of dead loads. Springs stand beside the multipliers. They vanish, with their gradient, where
c = 0, so they change no equilibrium; they make the Hessian positive along what is held.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.geometry.kinematics import spring_at
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints


class HoldRows(Record):
    """What is held of a DLO beside its gripper; A = K = 0 if nothing is."""

    node: Ints  # (A,) nodes that are held, rising
    first: Ints  # (A + 1,) where the rows of each begin
    target: Floats  # (A, 3) where they are held, m, world axes, relative to the gripper
    axes: Floats  # (A, 3, 3) their frames there, columns t, n, b
    share: Floats  # (A, 3) a_i, how much each axis counts
    # (K, 6) held directions of the twist: lever (m) times a unit vector of rotation, or a unit
    # vector of displacement
    rows: Floats
    multiplier: Floats  # (K,) derivative of the potential by c, N
    stiffness: float  # of displacement, N/m
    turn_stiffness: float  # of rotation, N m


def no_holds(stiffness: float, turn_stiffness: float) -> HoldRows:
    """Return the HoldRows of a DLO that is held nowhere, with springs as of one that is."""
    return HoldRows(np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros((0, 3)),
                    np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 6)), np.zeros(0),
                    stiffness, turn_stiffness)


@kernel
def holds(effect: HoldRows | None) -> bool:
    """Whether anything is held."""
    if effect is None:
        return False
    return effect.multiplier.size > 0


def needs(effect: HoldRows) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    return {'displaced': holds(effect), 'attached': True, 'rows': effect.multiplier.size}


@kernel
def constraint_value(hold, state, miss):
    """Fill miss (K,) with c in m at a Configuration; return its size."""
    if hold is None:
        return 0.0
    if miss.size == 0:
        return 0.0
    square = 0.0
    turned = np.zeros(3)
    for a in range(hold.node.size):
        rotation, position = state.rotations[hold.node[a]], state.positions[hold.node[a]]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned[i] = 0.0
            for axis in range(3):
                turned[i] += hold.share[a, axis] * (
                    hold.axes[a, j, axis] * rotation[k, axis]
                    - hold.axes[a, k, axis] * rotation[j, axis])
        for row in range(hold.first[a], hold.first[a + 1]):
            miss[row] = 0.0
            for i in range(3):
                miss[row] += (hold.rows[row, i] * turned[i]
                              + hold.rows[row, 3 + i] * (position[i] - hold.target[a, i]))
            square += miss[row] * miss[row]
    return np.sqrt(square)


@kernel
def constraint_violation(hold: HoldRows | None, state: Any) -> float:
    """Return by how much all holds together are missed, m: the size of c (K,)."""
    if hold is None:
        return 0.0
    return constraint_value(hold, state, np.empty(hold.multiplier.size))


@kernel
def move_multipliers(hold, part, reaction):
    """Add a part of the reactions' change (K,) to the forces of holds."""
    if hold is None:
        return
    for row in range(reaction.size):
        hold.multiplier[row] += part * reaction[row]


@kernel
def reaction_of(hold, count):
    """Return a copy (K,) of the forces of holds with so many."""
    reaction = np.zeros(count)
    if hold is not None:
        reaction[:] = hold.multiplier
    return reaction


@kernel
def set_reaction(hold, reaction):
    """Make `reaction` (K,) the forces of holds."""
    if hold is not None:
        hold.multiplier[:] = reaction


@kernel
def add_forces(effect, system, state):
    """Add what holds act with on their nodes; return the potential in J, and its size."""
    if effect is None:
        return 0.0, 0.0
    energy, attached = 0.0, state.attached
    for a in range(effect.node.size):
        n = effect.node[a]
        spring_at(attached, n)
        energy += add_hold(effect, a, state.rotations[n], state.positions[n], state.pull[n],
                           attached.node_moment[n], attached.node_first[n],
                           attached.node_matrix[n])
    return energy, abs(energy)


@kernel
def put_wrenches(effect, state, wrenches):
    """Fill wrenches (A, 6): force and moment of each hold on its node, N and N m."""
    force, moment = np.empty(3), np.empty(3)
    first, spring = np.empty((3, 3)), np.empty((6, 6))
    for a in range(effect.node.size):
        n = effect.node[a]
        force[:], moment[:] = 0.0, 0.0
        add_hold(effect, a, state.rotations[n], state.positions[n], force, moment, first, spring)
        for i in range(3):
            wrenches[a, i], wrenches[a, 3 + i] = -force[i], -moment[i]


@kernel
def roundoff(effect, system, state, length):
    """Return forces in N whose relative rounding errors those of holds have."""
    if effect is None:
        return 0.0
    if effect.multiplier.size == 0:
        return 0.0
    return effect.stiffness * length + effect.turn_stiffness / length


@kernel
def constraint_jacobian(effect, state, out):
    """Fill out (K, 6): change of c as all turns and moves with the gripper, about its origin."""
    if effect is None:
        return
    rows = effect.rows
    for a in range(effect.node.size):
        axes = effect.axes[a]
        rotation, position = state.rotations[effect.node[a]], state.positions[effect.node[a]]
        for row in range(effect.first[a], effect.first[a + 1]):
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
                    total += effect.share[a, axis] * (along * rows[row, i]
                                                      - across * axes[i, axis])
                out[row, i] = total
                out[row, 3 + i] = rows[row, 3 + i]


@kernel
def add_hold(hold, a, rotation, position, pull, moment, first, spring):
    """Add what hold a acts with on its node, see `OffNodeLoads`; return the potential in J."""
    torque, couple = np.zeros(3), np.empty(3)
    energy = 0.0
    for row in range(hold.first[a], hold.first[a + 1]):
        away = 0.0
        for i in range(3):
            away += hold.rows[row, 3 + i] * (position[i] - hold.target[a, i])
            torque[i] += hold.multiplier[row] * hold.rows[row, i]
        energy += away * (hold.multiplier[row] + 0.5 * hold.stiffness * away)
        force = hold.multiplier[row] + hold.stiffness * away
        for i in range(3):
            pull[i] += force * hold.rows[row, 3 + i]
            for j in range(3):
                spring[3 + i, 3 + j] += (hold.stiffness * hold.rows[row, 3 + i]
                                         * hold.rows[row, 3 + j])
    for axis in range(3):
        if hold.share[a, axis] == 0.0:
            continue
        along = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            t, d = hold.axes[a, i, axis], rotation[i, axis]
            couple[i] = hold.share[a, axis] * (
                torque[j] * hold.axes[a, k, axis] - torque[k] * hold.axes[a, j, axis]
                - hold.turn_stiffness * t)
            energy += d * couple[i]
            along += t * t
        energy += hold.share[a, axis] * hold.turn_stiffness * along
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            moment[i] += rotation[j, axis] * couple[k] - rotation[k, axis] * couple[j]
            for j in range(3):
                first[i, j] += couple[i] * rotation[j, axis]
    return energy


@kernel
def held_nodes(hold, count):
    """Return (K,) the node that each of `count` rows holds."""
    nodes = np.zeros(count, dtype=np.int64)
    if hold is not None:
        for a in range(hold.node.size):
            for row in range(hold.first[a], hold.first[a + 1]):
                nodes[row] = hold.node[a]
    return nodes


@kernel
def holds_node(hold, k):
    """Whether node k is held."""
    held = False
    if hold is not None:
        for a in range(hold.node.size):
            held |= hold.node[a] == k
    return held


@kernel
def shortest_span(hold, lengths):
    """Return the length in m of the shortest part of a DLO between two grips, or of all of it."""
    whole = np.sum(lengths)
    if hold is None:
        return whole
    if hold.node.size == 0 or hold.node[0] == lengths.size:
        return whole
    shortest, begin = whole, 0
    for a in range(hold.node.size):
        span = 0.0
        for e in range(begin, hold.node[a]):
            span += lengths[e]
        shortest, begin = min(shortest, span), hold.node[a]
    return shortest


@kernel
def put_misses_by_twist(hold, state, out):
    """Fill out (K, 6): change of c per twist of each hold about its own origin, c being zero.

    Rotation before displacement. Of the columns those of a hold say nothing of other holds' rows.
    """
    if hold is None:
        return
    for a in range(hold.node.size):
        position = state.positions[hold.node[a]]
        for row in range(hold.first[a], hold.first[a + 1]):
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                # a sleeve's axis turns about its pose, from which the node may have slid
                arm_j, arm_k = position[j] - hold.target[a, j], position[k] - hold.target[a, k]
                out[row, i] = -(hold.rows[row, i] + arm_j * hold.rows[row, 3 + k]
                                - arm_k * hold.rows[row, 3 + j])
                out[row, 3 + i] = -hold.rows[row, 3 + i]


@kernel
def put_sliding_force(hold, a, force):
    """Fill force (3,) with the derivative of the potential by the place of hold a's node, at c = 0.

    Returns whether the node slides: two directions of its place are held, no third.
    """
    directions = 0
    force[:] = 0.0
    for row in range(hold.first[a], hold.first[a + 1]):
        held = False
        for i in range(3):
            force[i] += hold.multiplier[row] * hold.rows[row, 3 + i]
            held |= hold.rows[row, 3 + i] != 0.0
        directions += held
    return directions == 2


def hinged(effect: HoldRows, _: float) -> HoldRows:
    """Return the same with one more element before the first."""
    return effect._replace(node=effect.node + 1)


def without_hinge(effect: HoldRows) -> HoldRows:
    """Return the same without the first element."""
    return effect._replace(node=effect.node - 1)
