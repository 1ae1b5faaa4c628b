# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Goals of a waypoint for kernels: residuals, and their derivatives by motions of the gripper.

Each goal has three residuals, times its weight; `fill_rows` takes the motions of the frames at the
goals as columns of any number, so that steps of the strains can be among them.
"""

import numpy as np

from dlo_planner.geometry.kinematics import nearest_place, point_inside
from dlo_planner.geometry.record import Record
from dlo_planner.geometry.so3 import (
    cross,
    inner,
    matrix,
    put_vector,
    rotation_vector,
    times_transposed,
    vector,
)
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints

# Kinds: a place, a tangent, a frame's rotation, a place at any arc length, the gripper's roll.
POSITION, DIRECTION, ROTATION, THROUGH, ROLL = range(5)


class GoalTable(Record):
    """Goals of one waypoint, g of them."""

    kind: Ints  # (g,) POSITION, DIRECTION, ROTATION, THROUGH or ROLL
    # (g,) arc length, m; of THROUGH: beyond which the place is sought. A DLO that is shorter goes
    # on straight
    s: Floats
    target: Floats  # (g, 3) place in m, unit tangent, or axis of the roll
    # (g, 3, 3) rotation that the frame should have, or since which the gripper should not roll
    frame: Floats
    weight: Floats  # (g,) 1/m of places, 1/rad else; 0: it does not count


@kernel
def goals_at(goals: GoalTable, s: Floats) -> GoalTable:
    """Return the same goals at arc lengths (g,), m, with a ROLL of its own."""
    return GoalTable(goals.kind, s, goals.target.copy(), goals.frame.copy(), goals.weight)


@kernel
def element_at(nodes: Floats, s: float) -> int:
    """Return the element in which an arc length (m) is."""
    return min(int(np.searchsorted(nodes, s, side='right')) - 1, nodes.size - 2)


@kernel
def fill_residuals(goals: GoalTable, nodes: Floats, lengths: Floats, strains: Floats,
                   rotations: Floats, positions: Floats, origin: Floats, base: Floats,
                   residuals: Floats, where: Floats, places: Floats) -> None:
    """Fill by how much a shape misses its goals, times the weights.

    Shapes: nodes (N + 1,), base (3, 3), residuals (3 g,).
    """
    length, frame, point = nodes[nodes.size - 1], np.empty((3, 3)), np.empty(3)
    for g in range(goals.kind.size):
        kind, weight = goals.kind[g], goals.weight[g]
        for i in range(3):
            residuals[3 * g + i] = 0.0
        where[g] = goals.s[g]
        if not weight > 0.0:
            continue
        if kind == ROLL:
            residuals[3 * g] = weight * inner(vector(goals.target[g]), rotation_vector(
                times_transposed(matrix(base), matrix(goals.frame[g]))))
            continue
        if kind == THROUGH:
            for i in range(3):
                point[i] = goals.target[g, i] - origin[i]
            where[g] = nearest_place(nodes, lengths, strains, rotations, positions, point,
                                     goals.s[g], places[g])
        else:
            inside = min(goals.s[g], length)
            e = element_at(nodes, inside)
            point_inside(lengths, strains, rotations, positions, e,
                         (inside - nodes[e]) / lengths[e], frame, point)
            for i in range(3):
                places[g, 1, i], places[g, 2, i] = frame[i, 0], 0.0
                if kind == POSITION:
                    places[g, 0, i] = (point[i] + (goals.s[g] - inside) * frame[i, 0]
                                       + origin[i] - goals.target[g, i])
                elif kind == DIRECTION:
                    places[g, 0, i] = frame[i, 0] - goals.target[g, i]
            if kind == ROTATION:
                put_vector(rotation_vector(times_transposed(matrix(frame), matrix(goals.frame[g]))),
                           places[g, 0])
        for i in range(3):
            residuals[3 * g + i] = weight * places[g, 0, i]


@kernel
def fill_rows(goals: GoalTable, length: float, base: Floats, where: Floats, places: Floats,
              twists: Floats, rows: Floats) -> None:
    """Fill the derivatives of `fill_residuals` by c motions; twists (g, 6, c), rows (3 g, c)."""
    rows[:] = 0.0
    for g in range(goals.kind.size):
        kind, weight, row = goals.kind[g], goals.weight[g], 3 * g
        if not weight > 0.0:
            continue
        if kind == ROLL:
            axis = vector(goals.target[g])
            turn = rotation_vector(times_transposed(matrix(base), matrix(goals.frame[g])))
            across = cross(turn, axis)  # the inverse of the left Jacobian, to second order
            for j in range(3):
                rows[row, j] = weight * (axis[j] + 0.5 * across[j])
            continue
        off, tangent, change = places[g, 0], places[g, 1], places[g, 2]
        beyond = max(where[g] - length, 0.0)
        slides = kind == THROUGH and where[g] > goals.s[g]  # the nearest arc length changes, too
        for j in range(rows.shape[1]):
            t0, t1, t2 = twists[g, 0, j], twists[g, 1, j], twists[g, 2, j]
            if kind == ROTATION:
                rows[row, j], rows[row + 1, j], rows[row + 2, j] = (weight * t0, weight * t1,
                                                                    weight * t2)
                continue
            turned = (t1 * tangent[2] - t2 * tangent[1], t2 * tangent[0] - t0 * tangent[2],
                      t0 * tangent[1] - t1 * tangent[0])
            if kind == DIRECTION:
                for i in range(3):
                    rows[row + i, j] = weight * turned[i]
                continue
            along = 0.0
            if slides:
                for i in range(3):
                    along += (tangent[i] * (twists[g, 3 + i, j] + beyond * turned[i])
                              + off[i] * turned[i])
                along /= 1.0 + inner(off, change)
            for i in range(3):
                rows[row + i, j] = weight * (twists[g, 3 + i, j] + beyond * turned[i]
                                             - along * tangent[i])
