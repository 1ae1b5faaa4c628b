# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of springs on a chain of elements, by its strains, see `second_order`."""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.attached import acts_inside, last_point
from dlo_planner.ritz.kinematics import part_of_element
from dlo_planner.ritz.matrix3 import (
    ZERO,
    added,
    applied,
    crossed_columns,
    matrix,
    plus,
    put_matrix,
    times,
    transposed_times,
    vector,
)
from dlo_planner.ritz.matrix3 import cross as crossed


@kernel
def widened(displaced, lengths, strains, scale, rotations, positions, weight, attached,
            twist_jacobian, cross, diagonal):
    """Widen the blocks of `second_order`, if `displaced`, by springs.

    What lies beyond an element now moves by a twist (rotation, displacement at the gripper's
    origin), so that node l moves by  displacement + rotation x position_l.

    Args:
        displaced: None where it never is
        weight: (N + 1,) springs of nodes that are the same in all directions, N/m
        attached: other springs, or None
        twist_jacobian: (N, 6, 3) filled by `second_order`, its last three rows with what moves the
            element's far end; here with what moves the gripper's origin
        cross: (N, 3, 6), diagonal: (N, 3, 3) filled likewise in their first three columns;
            completed here
    """
    if displaced is None:
        return
    if not displaced:
        return
    if attached is None:
        _widened_by_weights(positions, weight, twist_jacobian, cross, diagonal)
        return
    beyond = np.zeros((6, 6))  # of all nodes beyond: their springs as seen by a twist
    sprung = _add_tip(attached, positions[lengths.size], beyond)
    _widened_by_springs(lengths, (strains, scale, rotations, positions), weight, attached, beyond,
                        sprung, (twist_jacobian, cross, diagonal))


@kernel
def _widened_by_springs(lengths, rows, weight, attached, beyond, sprung, blocks):
    """Do what `widened` does where springs act anywhere; `sprung`: on the tip already."""
    strains, scale, rotations, positions = rows
    twist_jacobian, crosses, diagonals = blocks
    place, on_nodes = last_point(attached), attached.sprung
    for k in range(lengths.size):
        e = lengths.size - 1 - k
        where, twist, cross = positions[e + 1], twist_jacobian[e], crosses[e]
        turn, move = matrix(twist), matrix(twist[3:])
        move = added(move, crossed_columns(vector(where), turn))
        put_matrix(move, twist[3:])
        if weight[e + 1] != 0.0:
            _add_spring(beyond, where, weight[e + 1])
            sprung = True
        if on_nodes.size and on_nodes[e + 1]:
            _add_node(attached, e + 1, where, beyond)
            sprung = True
        if sprung:
            _add_beyond(turn, move, beyond, cross, diagonals[e])
        else:
            put_matrix(ZERO, cross[:, 3:])
        if acts_inside(attached, place, e):
            place = _springs_inside(attached, place, e, lengths[e], strains, scale, rotations,
                                    positions, beyond, crosses, diagonals)
            sprung = True


@kernel
def _add_beyond(turn, move, beyond, cross, diagonal):
    """Add what springs do whose second derivative by a twist is `beyond` (6, 6).

    Args:
        turn, move: (9 numbers) rotation and displacement of that twist, per strain of an element
        cross: (3, 6), diagonal: (3, 3) of the element: added to, the last columns of `cross` filled
    """
    by_turn = added(transposed_times(turn, matrix(beyond)),
                    transposed_times(move, matrix(beyond[3:])))
    by_move = added(transposed_times(turn, matrix(beyond[:, 3:])),
                    transposed_times(move, matrix(beyond[3:, 3:])))
    put_matrix(added(matrix(cross), by_turn), cross)
    put_matrix(by_move, cross[:, 3:])
    put_matrix(added(matrix(diagonal), added(times(by_turn, turn), times(by_move, move))), diagonal)


@kernel
def _widened_by_weights(positions, weight, twist_jacobian, rolled, diagonal):
    """Do what `widened` does where springs act on nodes alone, the same in all directions.

    A twist (turn, shift) of what lies beyond sees  sum of weight |turn x place + shift|^2 / 2, that
    is the total weight, the first and the second moments of the weights.
    """
    total, first = 0.0, (0.0, 0.0, 0.0)
    xx = yy = zz = xy = xz = yz = 0.0  # of the tensor of inertia
    for k in range(weight.size - 1):
        e = weight.size - 2 - k
        w, place = weight[e + 1], vector(positions[e + 1])
        x, y, z = place
        total, first = total + w, plus(first, (w * x, w * y, w * z))
        xx, yy, zz = xx + w * (y * y + z * z), yy + w * (x * x + z * z), zz + w * (x * x + y * y)
        xy, xz, yz = xy - w * x * y, xz - w * x * z, yz - w * y * z
        inertia = (xx, xy, xz, xy, yy, yz, xz, yz, zz)
        twist, out, own = twist_jacobian[e], rolled[e], diagonal[e]
        for j in range(3):
            turn = (twist[0, j], twist[1, j], twist[2, j])
            shift = plus((twist[3, j], twist[4, j], twist[5, j]), crossed(place, turn))
            twist[3, j], twist[4, j], twist[5, j] = shift
            moment = plus(applied(inertia, turn), crossed(first, shift))
            force = plus(crossed(turn, first), (total * shift[0], total * shift[1],
                                              total * shift[2]))
            for i in range(3):
                out[j, i] += moment[i]
            out[j, 3], out[j, 4], out[j, 5] = force
            for i in range(j + 1):
                both = (moment[0] * twist[0, i] + moment[1] * twist[1, i] + moment[2] * twist[2, i]
                        + force[0] * twist[3, i] + force[1] * twist[4, i] + force[2] * twist[5, i])
                own[j, i] += both
                if i < j:
                    own[i, j] += both


@kernel
def _add_tip(attached, where, beyond):
    """Add the springs of the free end, at `where` (3,), to `beyond` (6, 6); whether it has any."""
    if attached is None:
        return False
    if not np.any(attached.tip_matrix):
        return False
    rigid, local = np.empty((6, 6)), np.empty((6, 6))
    _carry(where, rigid)
    _multiply(attached.tip_matrix, rigid, local)
    _add_transposed(rigid, local, beyond)
    return True


@kernel
def _add_node(attached, node, where, beyond):
    """Add the springs of a node, at `where` (3,), to `beyond` (6, 6)."""
    rigid, local, spring = np.empty((6, 6)), np.empty((6, 6)), np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            spring[3 + i, 3 + j] = attached.spring[node, i, j]
    if attached.node_matrix.shape[0]:
        for i in range(6):
            for j in range(6):
                spring[i, j] += attached.node_matrix[node, i, j]
    _carry(where, rigid)
    _multiply(spring, rigid, local)
    _add_transposed(rigid, local, beyond)


@kernel
def _springs_inside(attached, place, e, h, strains, scale, rotations, positions, beyond, cross,
                    diagonal):
    """Add the springs of points inside element e; return the place of the point before it."""
    if attached is None:
        return place
    beside = attached.moment.shape[0] > 0
    while place >= 0 and attached.element[attached.order[place]] == e:
        part, arm = np.empty((6, 3)), np.empty(3)
        rigid, local = np.empty((6, 6)), np.empty((6, 6))
        c = attached.order[place]
        part_of_element(h, attached.fraction[c], strains[e], scale[e], rotations[e], part, arm)
        for i in range(3):
            arm[i] += positions[e, i]
        _carry(arm, rigid)
        _multiply(attached.matrix[c], rigid, local)
        for i in range(3):
            for k in range(6):
                for j in range(6):
                    cross[e, i, k] += part[j, i] * local[j, k]
            for j in range(3):
                for k in range(6):
                    for m in range(6):
                        diagonal[e, i, j] += part[k, i] * attached.matrix[c, k, m] * part[m, j]
        if beside:
            _add_own(attached.own[c], scale[e], rigid, part, cross[e], diagonal[e])
        _add_transposed(rigid, local, beyond)
        place -= 1
    return place


@kernel
def _add_own(own, scale, rigid, part, cross, diagonal):
    """Add a direct dependence on the element's own strain: own (3, 9), see `Attached`."""
    for i in range(3):
        for k in range(6):
            for j in range(6):
                cross[i, k] += scale[i] * own[i, j] * rigid[j, k]
        for j in range(3):
            both = 0.0
            for k in range(6):
                both += scale[i] * own[i, k] * part[k, j]
            diagonal[i, j] += both + scale[i] * scale[j] * own[i, 6 + j]
            diagonal[j, i] += both


@kernel
def _carry(x, rigid):
    """Fill (6, 6): the twist at x that a rigid twist given at the gripper's origin makes."""
    for i in range(6):
        for j in range(6):
            rigid[i, j] = 1.0 if i == j else 0.0
    rigid[3, 1], rigid[3, 2] = x[2], -x[1]
    rigid[4, 0], rigid[4, 2] = -x[2], x[0]
    rigid[5, 0], rigid[5, 1] = x[1], -x[0]


@kernel
def _multiply(a, b, out):
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@kernel
def _add_transposed(a, b, out):
    """Add a^T b to `out`, all (6, 6)."""
    for i in range(6):
        for j in range(6):
            for k in range(6):
                out[i, j] += a[k, i] * b[k, j]


@kernel
def _add_spring(matrix, x, weight):
    """Add weight J^T J, where a node at x moves by J (rotation, displacement), J = (-x^, I)."""
    square = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    for i in range(3):
        for j in range(3):
            matrix[i, j] -= weight * x[i] * x[j]
        matrix[i, i] += weight * square
        matrix[3 + i, 3 + i] += weight
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # x^ has x_i at (k, j) and -x_i at (j, k); the upper right block is x^
        matrix[k, 3 + j] += weight * x[i]
        matrix[j, 3 + k] -= weight * x[i]
        matrix[3 + j, k] += weight * x[i]
        matrix[3 + k, j] -= weight * x[i]
