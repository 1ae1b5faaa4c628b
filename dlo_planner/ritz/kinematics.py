# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From strains to frames and positions, and from loads on the nodes back to the strains.

Node k is reached from the gripper through the elements 0 ... k-1 (Eq. 15, 17 of the paper with
exact arcs in place of the infinitesimal rotations of Eq. 16). A change du_e of element e turns
everything beyond it, as one rigid body, by  turning_e du_e  (world frame). All that follows
rests on this: gradients are one sweep from the free end, and the Hessian is semi-separable:
for e < f,  d2V / du_f du_e = cross_f turning_e,  with 3 x 3 blocks that each depend on one
element only.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.ritz.arc import jacobians, rotation_and_chord, slope
from dlo_planner.ritz.matrix3 import (
    applied,
    columns_scaled,
    cross,
    inner,
    matrix,
    plus,
    put_matrix,
    put_vector,
    times,
    transposed_applied,
    vector,
)
from dlo_planner.ritz.record import Record


class Attached(Record):
    """What acts on the DLO elsewhere than as a force on a node: C points inside elements, the tip.

    Attributes
    ----------
    element : ndarray of int, shape (C,)
        Index of the element of each point.
    fraction : ndarray, shape (C,)
        Place of each point, as a part of the element's length.
    order : ndarray of int, shape (C,)
        The points by their elements.
    force : ndarray, shape (C, 3)
        Derivative of the potential by the point's position, N.
    matrix : ndarray, shape (C, 6, 6)
        Its second derivative by the twist (rotation, displacement) of the frame there, the part
        that is not due to `force` being carried along.
    spring : ndarray, shape (N + 1, 3, 3)
        Second derivative by the node positions, N/m.
    sprung : ndarray of bool, shape (N + 1,)
        Where there is such a spring.
    moment : ndarray, shape (C, 3)
        Derivative by the rotation of the frame at the point.
    first : ndarray, shape (C, 3, 3)
        Sum of force r^T of what is fixed to it at offsets r.
    own : ndarray, shape (C, 3, 9)
        Second derivative by the strain of the element itself, beyond that by the twist: with the
        twist and the strain. All (0, ...) where all forces act on the axis.
    node_moment : ndarray
        As `moment`, at the nodes where sprung; (0, 3) where all forces act on the axis.
    node_first : ndarray
        As `first`, at the nodes.
    node_matrix : ndarray
        As `matrix`, at the nodes.
    tip_force : ndarray, shape (3,)
        Derivative by the displacement of the free end, N.
    tip_moment : ndarray, shape (3,)
        Derivative by the rotation of the free end, N m.
    tip_first : ndarray, shape (3, 3)
        Sum of force r^T of what is fixed to the free end at offsets r.
    tip_matrix : ndarray, shape (6, 6)
        As `matrix`.
    """

    element: Ints
    fraction: Floats
    order: Ints
    force: Floats
    matrix: Floats
    spring: Floats
    sprung: Bools
    moment: Floats
    first: Floats
    own: Floats
    node_moment: Floats
    node_first: Floats
    node_matrix: Floats
    tip_force: Floats
    tip_moment: Floats
    tip_first: Floats
    tip_matrix: Floats


@kernel
def nothing_attached(nodes: int, element: Ints, beside: bool = False) -> Attached:
    """Return an empty Attached for points in the given elements (C,).

    Args:
        element: (C,) ascending
        nodes: how many may be sprung, N + 1 or 0
        beside: whether forces may act beside the axis
    """
    c = element.size
    d, n = (c, nodes) if beside else (0, 0)
    return Attached(element.copy(), np.zeros(c), np.arange(c), np.zeros((c, 3)),
                    np.zeros((c, 6, 6)), np.zeros((nodes, 3, 3)), np.zeros(nodes, dtype=np.bool_),
                    np.zeros((d, 3)), np.zeros((d, 3, 3)), np.zeros((d, 3, 9)), np.zeros((n, 3)),
                    np.zeros((n, 3, 3)), np.zeros((n, 6, 6)), np.zeros(3), np.zeros(3),
                    np.zeros((3, 3)), np.zeros((6, 6)))


@kernel
def new_attached(like):
    """Return an empty Attached with the sizes of `like`; None for None."""
    out = like
    if like is not None:
        out = nothing_attached(like.sprung.size, like.element,
                               like.moment.shape[0] + like.node_moment.shape[0] > 0)
    return out


@kernel
def cleared(attached):
    """Forget what acts on nodes and on the tip; points are written anew by whose they are."""
    if attached is None:
        return
    for k in range(attached.sprung.size):
        attached.sprung[k] = False
    for i in range(3):
        attached.tip_force[i] = attached.tip_moment[i] = 0.0
        for j in range(3):
            attached.tip_first[i, j] = 0.0
    for i in range(6):
        for j in range(6):
            attached.tip_matrix[i, j] = 0.0


@kernel
def attached_forces(attached, length):
    """Return the sum of what acts elsewhere than on the nodes, N; moments over a `length` in m."""
    if attached is None:
        return 0.0
    forces = 0.0
    for i in range(3):
        forces += abs(attached.tip_force[i])
        forces += abs(attached.tip_moment[i]) / length
    for c in range(attached.element.size):
        for i in range(3):
            forces += abs(attached.force[c, i])
    return forces


@kernel
def spring_at(attached, node):
    """Return the (3, 3) spring of a node, to be added to."""
    if not attached.sprung[node]:
        attached.sprung[node] = True
        for i in range(3):
            for j in range(3):
                attached.spring[node, i, j] = 0.0
        if attached.node_moment.shape[0]:
            attached.node_moment[node] = 0.0
            attached.node_first[node] = 0.0
            attached.node_matrix[node] = 0.0
    return attached.spring[node]


@kernel
def sort_points(attached):
    """Put the points of an Attached in the order of their elements; few are ever out of it."""
    order, element = attached.order, attached.element
    for p in range(1, order.size):
        c, k = order[p], p
        while k > 0 and element[order[k - 1]] > element[c]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = c


@kernel
def march(lengths: Floats, strains: Floats, base: Floats, rotations: Floats,
          positions: Floats) -> None:
    """Fill the frames and positions of all nodes from the strains, starting at the gripper.

    Args:
        lengths: (N,) of the elements, m
        strains: (N, 3) torsion, curvature about n, about b; 1/m
        base: (3, 3) the gripper's rotation, columns t, n, b
        rotations: (N + 1, 3, 3) filled; columns t, n, b in the world
        positions: (N + 1, 3) filled; relative to the gripper, world axes, m
    """
    frame, place = matrix(base), (0.0, 0.0, 0.0)
    put_matrix(frame, rotations[0])
    put_vector(place, positions[0])
    for e in range(lengths.size):
        h = lengths[e]
        turn, chord = rotation_and_chord(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h)
        place = plus(place, applied(frame, chord))
        frame = times(frame, turn)
        put_matrix(frame, rotations[e + 1])
        put_vector(place, positions[e + 1])


@kernel
def add_gradient(lengths, strains, rotations, positions, pull, attached, gradient, by_shift,
                 by_turn):
    """Add dV/du (N, 3) of a potential whose derivative by the node positions is `pull` (N + 1, 3).

    Args:
        attached: what acts elsewhere, or None
        by_shift, by_turn: (3,) filled: derivative by the gripper's displacement and by its rotation
            about its own origin, world frame
    """
    n = lengths.size
    place, beside = last_point(attached), moments_on_nodes(attached)
    # sum of pull beyond the element, and their moment about the element's far end
    force, moment = at_tip(attached)
    for k in range(n):
        e = n - 1 - k
        h = lengths[e]
        force = plus(force, vector(pull[e + 1]))
        if beside:
            moment = plus_at_node(attached, e + 1, moment)
        frame = matrix(rotations[e])
        own = slope(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h,
                    transposed_applied(frame, force), transposed_applied(frame, moment))
        for j in range(3):
            gradient[e, j] += h * own[j]
        moment = plus(moment, cross((positions[e + 1, 0] - positions[e, 0],
                                     positions[e + 1, 1] - positions[e, 1],
                                     positions[e + 1, 2] - positions[e, 2]), force))
        if place >= 0:
            place, force, moment = _add_points(attached, place, e, h, strains, rotations, force,
                                               moment, gradient)
    put_vector(plus(force, vector(pull[0])), by_shift)
    put_vector(moment, by_turn)


@kernel
def last_point(attached):
    """Return the place in the order of the last point inside an element, -1 if there is none."""
    if attached is None:
        return -1
    return attached.element.size - 1


@kernel
def moments_on_nodes(attached):
    """Whether moments may act on nodes."""
    if attached is None:
        return False
    return attached.node_moment.shape[0] > 0


@kernel
def at_tip(attached):
    """Return force and moment, as tuples, that act on the free end."""
    if attached is None:
        return _NOTHING, _NOTHING
    return vector(attached.tip_force), vector(attached.tip_moment)


@kernel
def plus_at_node(attached, node, moment):
    """Return a moment (3 numbers), and that which acts on a node."""
    if attached is None:
        return moment
    if attached.sprung[node]:
        return plus(moment, vector(attached.node_moment[node]))
    return moment


@kernel
def _add_points(attached, place, e, h, strains, rotations, force, moment, gradient):
    """Add what acts inside element e to its gradient; return place, force and moment before it."""
    if attached is None:
        return place, force, moment
    while place >= 0 and attached.element[attached.order[place]] == e:
        part, arm = np.empty((6, 3)), np.empty(3)
        c = attached.order[place]
        there = vector(attached.force[c])
        part_of_element(h, attached.fraction[c], strains[e], _UNSCALED, rotations[e], part, arm)
        for j in range(3):
            gradient[e, j] += inner((part[3, j], part[4, j], part[5, j]), there)
        if attached.moment.shape[0]:
            moment = plus(moment, vector(attached.moment[c]))
            for j in range(3):
                gradient[e, j] += inner((part[0, j], part[1, j], part[2, j]),
                                        vector(attached.moment[c]))
        moment = plus(moment, cross(vector(arm), there))
        force = plus(force, there)
        place -= 1
    return place, force, moment


_NOTHING = (0.0, 0.0, 0.0)
_UNSCALED = np.ones(3)


@kernel
def part_of_element(h, fraction, strain, scale, rotation, twist, arm):
    """Fill what moves a point inside an element, at `fraction` of its length h.

    Args:
        strain, scale: (3,); rotation: (3, 3) at the element's beginning
        twist: (6, 3) filled: rotation and displacement of the frame there per scaled strain
        arm: (3,) filled: the point from the element's beginning
    """
    length = fraction * h
    x, y, z = length * strain[0], length * strain[1], length * strain[2]
    _, chord = rotation_and_chord(x, y, z, length)
    near, shifting = jacobians(x, y, z, length)
    frame = matrix(rotation)
    put_vector(applied(frame, chord), arm)
    w0, w1, w2 = length * scale[0], length * scale[1], length * scale[2]
    put_matrix(columns_scaled(times(frame, near), w0, w1, w2), twist[:3])
    put_matrix(columns_scaled(times(frame, shifting), w0, w1, w2), twist[3:])


@kernel
def point_inside(lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
                 element: int, fraction: float, rotation: Floats, position: Floats) -> None:
    """Fill rotation (3, 3) and position (3,) at `fraction` of `element`, on its exact arc."""
    h = fraction * lengths[element]
    u = strains[element]
    turn, chord = rotation_and_chord(h * u[0], h * u[1], h * u[2], h)
    frame = matrix(rotations[element])
    put_vector(plus(vector(positions[element]), applied(frame, chord)), position)
    put_matrix(times(frame, turn), rotation)
