# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of loads on a chain of elements, by its strains.

A change du_e of element e moves everything beyond it as one rigid body, so the Hessian is
semi-separable: for e < f,  d2V / du_f du_e = cross_f twist_jacobian_e.  Dead loads only notice the
rotation (blocks 3 wide); springs notice the displacement as well (twists, 6 wide).
"""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.arc import (
    coefficients_in,
    jacobians_with,
    second_derivatives,
    second_derivatives_with,
)
from dlo_planner.ritz.attached import (
    acts_inside,
    at_tip,
    last_point,
    moments_on_nodes,
    plus_at_node,
)
from dlo_planner.ritz.kinematics import part_of_element
from dlo_planner.ritz.matrix3 import (
    ZERO,
    added,
    columns_scaled,
    matrix,
    outer,
    plus,
    put_matrix,
    times,
    transposed,
    transposed_applied,
    transposed_times,
    vector,
    without_trace,
)
from dlo_planner.ritz.matrix3 import cross as crossed


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

    Returns
    -------
        turned: (9 numbers) world rotation of all that lies beyond, per scaled strain
        shifted: (9 numbers) displacement of its far end, likewise
        coupling: (9 numbers) turned^T rolling, and the lever of the force
        pivot: (6 numbers: 00, 11, 22, 01, 02, 12) second derivative by the scaled strain
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
    """Add what forces at offsets from a point do as that point's frame turns.

    Args:
        own_first: (3, 3) sum of force r^T; part: (6, 3) twist of the frame by the element's strain
        cross: (3, 3 or 6), diagonal: (3, 3) of the element: added to
    """
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
