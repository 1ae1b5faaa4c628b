# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of loads and springs on a chain of elements, by its strains."""

import numpy as np

from dlo_planner.geometry.kinematics import (
    acts_inside,
    at_tip,
    last_point,
    moments_on_nodes,
    part_of_element,
    plus_at_node,
)
from dlo_planner.geometry.so3 import (
    ZERO,
    added,
    applied,
    coefficients_in,
    columns_scaled,
    crossed_columns,
    jacobians_with,
    matrix,
    outer,
    plus,
    put_matrix,
    second_derivatives,
    second_derivatives_with,
    times,
    transposed,
    transposed_applied,
    transposed_times,
    vector,
    without_trace,
)
from dlo_planner.geometry.so3 import cross as crossed
from dlo_planner.kernels import kernel

# ------------------------------------------------------------------------------------------------
# Second derivatives of loads on a chain of elements, by its strains.
#
# A change du_e of element e moves everything beyond it as one rigid body, so the Hessian is semi-
# separable: for e < f,  d2V / du_f du_e = cross_f twist_jacobian_e.  Dead loads only notice the
# rotation (blocks 3 wide); springs notice the displacement as well (twists, 6 wide).


@kernel
def second_order(lengths, strains, arcs, scale, rotations, positions, pull, attached,
                 twist_jacobian, cross, diagonal, base):
    """Fill the three blocks per element of the Hessian of a potential of dead loads.

    All derivatives are by the scaled strains, u = natural + scale * (unknown).

    Args:
        arcs: (N, 7) of these strains, see `kinematics.forward_kinematics`
        pull: (N + 1, 3) derivative of the potential by the node positions, constant
        twist_jacobian: (N, 3 or 6, 3) filled: world rotation of all that lies beyond, per scaled
            strain; in the last three rows, if any, displacement of the element's far end
        cross: (N, 3, 3 or 6) filled (first three columns): change of this element's gradient per
            world rotation of all that lies between the gripper and it
        diagonal: (N, 3, 3) filled: second derivative by this element's own strain
        base: (3, 3) filled: change of the moment about the gripper's origin per rotation of it
    """
    n = lengths.size
    place, beside, wide = last_point(attached), moments_on_nodes(attached), cross.shape[2] > 3
    force, moment = at_tip(attached)
    # first moment of the loads beyond: sum of pull r^T, r from the element's far end
    first = _first_at_tip(attached)
    for k in range(n):
        e = n - 1 - k
        h = lengths[e]
        force = plus(force, vector(pull[e + 1]))
        if beside:
            moment = plus_at_node(attached, e + 1, moment)
            first = _first_at_node(attached, e + 1, first)
        turned, shifted, coupling, pivot = element_blocks(
            h, vector(strains[e]), coefficients_in(arcs[e]), vector(scale[e]),
            matrix(rotations[e]), force, moment, without_trace(first))
        put_matrix(turned, twist_jacobian[e])
        if wide:
            put_matrix(shifted, twist_jacobian[e, 3:])
        across, own = cross[e], diagonal[e]
        across[0, 0], across[0, 1], across[0, 2] = coupling[0], coupling[1], coupling[2]
        across[1, 0], across[1, 1], across[1, 2] = coupling[3], coupling[4], coupling[5]
        across[2, 0], across[2, 1], across[2, 2] = coupling[6], coupling[7], coupling[8]
        own[0, 0], own[1, 1], own[2, 2] = pivot[0], pivot[1], pivot[2]
        own[0, 1] = own[1, 0] = pivot[3]
        own[0, 2] = own[2, 0] = pivot[4]
        own[1, 2] = own[2, 1] = pivot[5]
        along = (positions[e + 1, 0] - positions[e, 0], positions[e + 1, 1] - positions[e, 1],
                 positions[e + 1, 2] - positions[e, 2])
        first = added(first, outer(force, along))
        moment = plus(moment, crossed(along, force))
        if acts_inside(attached, place, e):
            place, force, moment, first = _points_inside(
                attached, place, e, h, strains, scale, rotations, force, moment, first, cross,
                diagonal)
    put_matrix(transposed(without_trace(first)), base)


@kernel(forceinline=True)
def element_blocks(h, strain, c, scale, frame, force, moment, rolling):
    """Return what the strain of one element does to all that lies beyond it.

    Args:
        h: length, m; strain, scale: (3 numbers); c: `arc.coefficients`
        frame: (9 numbers) rotation at its beginning
        force, moment: (3 numbers) of the loads beyond, about its far end, as derivatives of the
            potential
        rolling: (9 numbers) second derivative of the potential by rotations of all that lies
            beyond: of dead loads first - trace I, of their first moment
    """
    x, y, z = h * strain[0], h * strain[1], h * strain[2]
    rotation_jacobian, chord_jacobian = jacobians_with(x, y, z, h, c)
    w0, w1, w2 = h * scale[0], h * scale[1], h * scale[2]
    turned = times(frame, columns_scaled(rotation_jacobian, w0, w1, w2))
    s = times(frame, columns_scaled(chord_jacobian, w0, w1, w2))
    rolled = transposed_times(turned, rolling)
    f0, f1, f2 = force
    coupling = (rolled[0] + s[3] * f2 - s[6] * f1, rolled[1] + s[6] * f0 - s[0] * f2,
                rolled[2] + s[0] * f1 - s[3] * f0,
                rolled[3] + s[4] * f2 - s[7] * f1, rolled[4] + s[7] * f0 - s[1] * f2,
                rolled[5] + s[1] * f1 - s[4] * f0,
                rolled[6] + s[5] * f2 - s[8] * f1, rolled[7] + s[8] * f0 - s[2] * f2,
                rolled[8] + s[2] * f1 - s[5] * f0)
    own = second_derivatives_with(x, y, z, h, transposed_applied(frame, force),
                                  transposed_applied(frame, moment), c)
    both = times(rolled, turned)
    pivot = (w0 * w0 * own[0] + both[0], w1 * w1 * own[4] + both[4], w2 * w2 * own[8] + both[8],
             w0 * w1 * own[1] + 0.5 * (both[1] + both[3]),
             w0 * w2 * own[2] + 0.5 * (both[2] + both[6]),
             w1 * w2 * own[5] + 0.5 * (both[5] + both[7]))
    return turned, s, coupling, pivot


@kernel
def _first_at_tip(attached):
    if attached is None:
        return ZERO
    return matrix(attached.tip_first)


@kernel
def _first_at_node(attached, node, first):
    if attached is None:
        return first
    if attached.sprung[node]:
        return added(first, matrix(attached.node_first[node]))
    return first


@kernel
def _points_inside(attached, place, e, h, strains, scale, rotations, force, moment, first, cross,
                   diagonal):
    """Add what acts inside element e; return place, force, moment and first moment before it."""
    if attached is None:
        return place, force, moment, first
    beside = attached.moment.shape[0] > 0
    frame = matrix(rotations[e])
    while place >= 0 and attached.element[attached.order[place]] == e:
        part, arm = np.empty((6, 3)), np.empty(3)
        point = attached.order[place]
        point_force, length = vector(attached.force[point]), attached.fraction[point] * h
        part_of_element(h, attached.fraction[point], strains[e], scale[e], rotations[e], part,
                        arm)
        own = second_derivatives(
            length * strains[e, 0], length * strains[e, 1], length * strains[e, 2], length,
            transposed_applied(frame, point_force),
            transposed_applied(frame, vector(attached.moment[point])) if beside else _NO_MOMENT)
        for j in range(3):
            lever = crossed((part[3, j], part[4, j], part[5, j]), point_force)
            cross[e, j, 0] += lever[0]
            cross[e, j, 1] += lever[1]
            cross[e, j, 2] += lever[2]
            for i in range(3):
                diagonal[e, i, j] += (length * length * scale[e, i] * scale[e, j]
                                      * own[3 * i + j])
        if beside:
            _carry_along(attached.first[point], part, cross[e], diagonal[e])
            first = added(first, matrix(attached.first[point]))
            moment = plus(moment, vector(attached.moment[point]))
        first = added(first, outer(point_force, vector(arm)))
        moment = plus(moment, crossed(vector(arm), point_force))
        force = plus(force, point_force)
        place -= 1
    return place, force, moment, first


_NO_MOMENT = (0.0, 0.0, 0.0)


@kernel
def _carry_along(own_first, part, cross, diagonal):
    """Add what forces at offsets from a point do as that point's frame turns."""
    trace = own_first[0, 0] + own_first[1, 1] + own_first[2, 2]
    rolled = np.empty((3, 3))
    for j in range(3):
        for i in range(3):
            rolled[j, i] = -trace * part[i, j]
            for k in range(3):
                rolled[j, i] += part[k, j] * own_first[k, i]
            cross[j, i] += rolled[j, i]
    for i in range(3):
        for j in range(3):
            both = (rolled[i, 0] * part[0, j] + rolled[i, 1] * part[1, j]
                    + rolled[i, 2] * part[2, j])
            diagonal[i, j] += 0.5 * both
            diagonal[j, i] += 0.5 * both


# ------------------------------------------------------------------------------------------------
# Second derivatives of springs on a chain of elements, by its strains, see `second_order`.


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
    """Add what springs do whose second derivative by a twist is `beyond` (6, 6)."""
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
