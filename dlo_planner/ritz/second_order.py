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
    coefficients,
    first_slopes,
    jacobians_with,
    second_derivatives,
    second_derivatives_with,
)
from dlo_planner.ritz.attached import at_tip, last_point, moments_on_nodes, plus_at_node
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
    transposed_applied,
    transposed_times,
    vector,
    without_trace,
)
from dlo_planner.ritz.matrix3 import cross as crossed


@kernel
def second_order(lengths, strains, scale, rotations, positions, pull, attached, twist_jacobian,
                 cross, diagonal, base):
    """Fill the three blocks per element of the Hessian of a potential of dead loads.

    All derivatives are by the scaled strains, u = natural + scale * (unknown).

    Args:
        pull: (N + 1, 3) derivative of the potential by the node positions, constant
        twist_jacobian: (N, 3 or 6, 3) filled (first three rows): world rotation of all that lies
            beyond, per scaled strain
        cross: (N, 3, 3 or 6) filled (first three columns): change of this element's gradient per
            world rotation of all that lies between the gripper and it
        diagonal: (N, 3, 3) filled: second derivative by this element's own strain
        base: (3, 3) filled: change of the moment about the gripper's origin per rotation of it
    """
    n = lengths.size
    place, beside = last_point(attached), moments_on_nodes(attached)
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
        x, y, z = h * strains[e, 0], h * strains[e, 1], h * strains[e, 2]
        c = coefficients(x * x + y * y + z * z)
        d = first_slopes(x * x + y * y + z * z, c)
        rotation_jacobian, chord_jacobian = jacobians_with(x, y, z, h, c, d)
        frame = matrix(rotations[e])
        w0, w1, w2 = h * scale[e, 0], h * scale[e, 1], h * scale[e, 2]
        turned = columns_scaled(times(frame, rotation_jacobian), w0, w1, w2)
        shifted = columns_scaled(times(frame, chord_jacobian), w0, w1, w2)
        # first - trace I: the Hessian of a dead load by rotations
        rolled = transposed_times(turned, without_trace(first))
        put_matrix(turned, twist_jacobian[e])
        f0, f1, f2 = force
        for j in range(3):
            s0, s1, s2 = shifted[j], shifted[3 + j], shifted[6 + j]
            cross[e, j, 0] = rolled[3 * j] + s1 * f2 - s2 * f1
            cross[e, j, 1] = rolled[3 * j + 1] + s2 * f0 - s0 * f2
            cross[e, j, 2] = rolled[3 * j + 2] + s0 * f1 - s1 * f0
        own = second_derivatives_with(x, y, z, h, transposed_applied(frame, force),
                                      transposed_applied(frame, moment), c, d)
        _put_diagonal(own, times(rolled, turned), (w0, w1, w2), diagonal[e])
        along = (positions[e + 1, 0] - positions[e, 0], positions[e + 1, 1] - positions[e, 1],
                 positions[e + 1, 2] - positions[e, 2])
        first = added(first, outer(force, along))
        moment = plus(moment, crossed(along, force))
        if place >= 0:
            place, force, moment, first = _points_inside(
                attached, place, e, h, strains, scale, rotations, force, moment, first, cross,
                diagonal)
    put_matrix(_transposed(without_trace(first)), base)


@kernel
def _put_diagonal(own, both, w, out):
    """Fill out (3, 3) with own (9 numbers), scaled by w (3), and both (9), made symmetric."""
    out[0, 0] = w[0] * w[0] * own[0] + both[0]
    out[1, 1] = w[1] * w[1] * own[4] + both[4]
    out[2, 2] = w[2] * w[2] * own[8] + both[8]
    out[0, 1] = out[1, 0] = w[0] * w[1] * own[1] + 0.5 * (both[1] + both[3])
    out[0, 2] = out[2, 0] = w[0] * w[2] * own[2] + 0.5 * (both[2] + both[6])
    out[1, 2] = out[2, 1] = w[1] * w[2] * own[5] + 0.5 * (both[5] + both[7])


@kernel
def _transposed(a):
    return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]


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
