# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What acts on a DLO elsewhere than as a force on a node: on points inside elements, on the tip."""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.ritz.matrix3 import plus, vector
from dlo_planner.ritz.record import Record

_NOTHING = (0.0, 0.0, 0.0)


class Attached(Record):
    """What acts on C points inside elements, on nodes that are sprung, and on the tip.

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
def last_point(attached):
    """Return the place in the order of the last point inside an element, -1 if there is none."""
    if attached is None:
        return -1
    return attached.element.size - 1


@kernel
def acts_inside(attached, place, element):
    """Whether the point at a place in the order is in an element: most have none.

    To ask this where no array is made is quicker: there no references are counted.
    """
    if attached is None:
        return False
    return place >= 0 and attached.element[attached.order[place]] == element


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
