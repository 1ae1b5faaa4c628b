# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From strains to frames and positions, and from what acts on a DLO back to its strains."""

from __future__ import annotations

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.geometry.so3 import (
    applied,
    coefficients,
    coefficients_in,
    columns_scaled,
    cross,
    inner,
    jacobians_with,
    matrix,
    plus,
    put_coefficients,
    put_matrix,
    put_vector,
    rotation_and_chord,
    rotation_and_chord_with,
    slope,
    times,
    times_transposed,
    transposed_applied,
    vector,
)
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats, Ints

# ------------------------------------------------------------------------------------------------
# What acts on a DLO other than as a force on a node: on points inside elements, moments on nodes.


NOTHING = (0.0, 0.0, 0.0)
_HALF_TURN = np.pi  # rad


class OffNodeLoads(Record):
    """What acts on C points inside elements; and on nodes, but for forces: those are `pull`'s."""

    element: Ints  # (C,) index of the element of each point
    fraction: Floats  # (C,) place of each point, as a part of the element's length
    order: Ints  # (C,) the points by their elements
    force: Floats  # (C, 3) derivative of the potential by the point's position, N
    moment: Floats  # (C, 3) derivative by the rotation of the frame at the point, N m
    first: Floats  # (C, 3, 3) sum of force r^T of what is fixed to that frame at offsets r
    # (C, 6, 6) second derivative by the twist (rotation, displacement) of that frame, the part that
    # is not due to forces being carried along
    matrix: Floats
    # (C, 3, 9) second derivative by the strain of the element itself, beyond that by the twist:
    # with the twist and the strain
    own: Floats
    sprung: Bools  # (N + 1,) the nodes that have what follows, as of points
    node_moment: Floats
    node_first: Floats
    node_matrix: Floats


@kernel
def folded(lengths: Floats, strains: Floats, natural: Floats) -> bool:
    """Return whether any element is bent by more than half a turn: a curve of arcs tells no more.

    What it is by nature does not count, as of a coil, nor does torsion: an element is an exact
    helix, however far it twists.

    Args:
        lengths: (N,) m; strains, natural: (N, 3) 1/m
    """
    most = 0.0
    for e in range(lengths.size):
        one, other = strains[e, 1] - natural[e, 1], strains[e, 2] - natural[e, 2]
        square = lengths[e] * lengths[e] * (one * one + other * other)
        if not square <= most:  # what is not a number has to be seen, too
            most = square
    return not most <= _HALF_TURN * _HALF_TURN


@kernel
def nothing_attached(nodes: int, element: Ints) -> OffNodeLoads:
    """Return an empty OffNodeLoads of N + 1 nodes and points in the elements (C,), ascending."""
    c = element.size
    return OffNodeLoads(element.copy(), np.zeros(c), np.arange(c), np.zeros((c, 3)),
                        np.zeros((c, 3)), np.zeros((c, 3, 3)), np.zeros((c, 6, 6)),
                        np.zeros((c, 3, 9)), np.zeros(nodes, dtype=np.bool_),
                        np.empty((nodes, 3)), np.empty((nodes, 3, 3)), np.empty((nodes, 6, 6)))


@kernel
def new_attached(like):
    """Return an empty OffNodeLoads with the sizes of `like`; None for None."""
    out = like
    if like is not None:
        out = nothing_attached(like.sprung.size, like.element)
    return out


@kernel
def reset(attached):
    """Forget what acts on nodes; points are written anew by whose they are."""
    if attached is None:
        return
    for k in range(attached.sprung.size):
        attached.sprung[k] = False


@kernel
def attached_forces(attached, length):
    """Return the sum of forces on points, N, and of moments on nodes over a `length` in m."""
    if attached is None:
        return 0.0
    forces = 0.0
    for k in range(attached.sprung.size):
        if attached.sprung[k]:
            for i in range(3):
                forces += abs(attached.node_moment[k, i]) / length
    for c in range(attached.element.size):
        for i in range(3):
            forces += abs(attached.force[c, i])
    return forces


@kernel
def spring_at(attached, node):
    """Return the (3, 3) spring of a node, to be added to, as is all else that acts on it."""
    if not attached.sprung[node]:
        attached.sprung[node] = True
        _clear(attached.node_moment, attached.node_first, attached.node_matrix, node)
    return attached.node_matrix[node, 3:, 3:]


@kernel
def clear_point(attached, c):
    """Forget what acts on a point."""
    _clear(attached.moment, attached.first, attached.matrix, c)
    for i in range(3):
        attached.force[c, i] = 0.0
        for j in range(9):
            attached.own[c, i, j] = 0.0


@kernel
def _clear(moment, first, matrix, k):
    for i in range(3):
        moment[k, i] = 0.0
        for j in range(3):
            first[k, i, j] = 0.0
    for i in range(6):
        for j in range(6):
            matrix[k, i, j] = 0.0


@kernel
def sort_points(attached):
    """Put the points of an OffNodeLoads in the order of their elements; few are ever out of it."""
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
def plus_moment(attached, node, moment):
    """Return a moment (3 numbers), and that which acts on a node."""
    if attached is None:
        return moment
    if attached.sprung[node]:
        return plus(moment, vector(attached.node_moment[node]))
    return moment


# ------------------------------------------------------------------------------------------------
# From strains to frames and positions, and from loads on the nodes back to the strains.
#
# Node k is reached from the gripper through the elements 0 ... k-1 (Eq. 15, 17 of the paper with
# exact arcs in place of the infinitesimal rotations of Eq. 16). A change du_e of element e turns
# everything beyond it, as one rigid body, by  twist_jacobian_e du_e  (world frame). All that
# follows rests on this: gradients are one sweep from the free end, and the Hessian is semi-
# separable: for e < f,  d2V / du_f du_e = cross_f twist_jacobian_e,  with 3 x 3 blocks that each
# depend on one element only.


@kernel
def forward_kinematics(lengths: Floats, strains: Floats, base: Floats, rotations: Floats,
                       positions: Floats, arcs: Floats) -> None:
    """Fill the frames and positions of all nodes from the strains, starting at the gripper.

    Args:
        lengths: (N,) of the elements, m
        strains: (N, 3) torsion, curvature about n, about b; 1/m
        base: (3, 3) the gripper's rotation, columns t, n, b
        rotations: (N + 1, 3, 3) filled; columns t, n, b in the world
        positions: (N + 1, 3) filled; relative to the gripper, world axes, m
        arcs: (N, 7) filled with `so3.coefficients` of the elements
    """
    frame, place = matrix(base), (0.0, 0.0, 0.0)
    put_matrix(frame, rotations[0])
    put_vector(place, positions[0])
    for e in range(lengths.size):
        h = lengths[e]
        x, y, z = h * strains[e, 0], h * strains[e, 1], h * strains[e, 2]
        c = coefficients(x * x + y * y + z * z)
        put_coefficients(c, arcs[e])
        turn, chord = rotation_and_chord_with(x, y, z, h, c)
        place = plus(place, applied(frame, chord))
        frame = times(frame, turn)
        put_matrix(frame, rotations[e + 1])
        put_vector(place, positions[e + 1])


@kernel
def add_gradient(lengths, strains, arcs, rotations, positions, pull, attached, gradient, by_shift,
                 by_turn):
    """Add dV/du (N, 3) of a potential whose derivative by the node positions is `pull` (N + 1, 3).

    Args:
        arcs: (N, 7) of these strains, see `forward_kinematics`
        attached: what acts elsewhere, or None
        by_shift, by_turn: (3,) filled: derivative by the gripper's displacement and by its rotation
            about its own origin, world frame
    """
    place = last_point(attached)
    # sum of pull beyond the element, and their moment about the element's end
    force, moment = NOTHING, NOTHING
    for k in range(lengths.size):
        e = lengths.size - 1 - k
        h, frame = lengths[e], matrix(rotations[e])
        force = plus(force, vector(pull[e + 1]))
        moment = plus_moment(attached, e + 1, moment)
        own = slope(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h,
                    transposed_applied(frame, force), transposed_applied(frame, moment),
                    coefficients_in(arcs[e]))
        for j in range(3):
            gradient[e, j] += h * own[j]
        moment = plus(moment, cross((positions[e + 1, 0] - positions[e, 0],
                                     positions[e + 1, 1] - positions[e, 1],
                                     positions[e + 1, 2] - positions[e, 2]), force))
        if acts_inside(attached, place, e):
            place, force, moment = _add_points(attached, place, e, h, strains, frame, force,
                                               moment, gradient)
    put_vector(plus(force, vector(pull[0])), by_shift)
    put_vector(moment, by_turn)


@kernel
def _add_points(attached, place, e, h, strains, frame, force, moment, gradient):
    """Add what acts inside element e to its gradient; return place, force and moment before it.

    A point is the end of an element as well: of the part of this one that is before it.
    """
    if attached is None:
        return place, force, moment
    while acts_inside(attached, place, e):
        c = attached.order[place]
        load, couple = vector(attached.force[c]), vector(attached.moment[c])
        length = attached.fraction[c] * h
        x, y, z = length * strains[e, 0], length * strains[e, 1], length * strains[e, 2]
        arc = coefficients(x * x + y * y + z * z)
        own = slope(x, y, z, length, transposed_applied(frame, load),
                    transposed_applied(frame, couple), arc)
        for j in range(3):
            gradient[e, j] += length * own[j]
        _, chord = rotation_and_chord_with(x, y, z, length, arc)
        moment = plus(plus(moment, couple), cross(applied(frame, chord), load))
        force = plus(force, load)
        place -= 1
    return place, force, moment


@kernel
def part_of_element(h, fraction, strain, scale, rotation, twist, arm):
    """Fill what moves a point inside an element, at `fraction` of its length h."""
    length = fraction * h
    x, y, z = length * strain[0], length * strain[1], length * strain[2]
    _, chord = rotation_and_chord(x, y, z, length)
    put_vector(applied(matrix(rotation), chord), arm)
    put_own_twist(length, x, y, z, coefficients(x * x + y * y + z * z), scale, rotation, twist)


@kernel
def put_own_twist(h, x, y, z, c, scale, rotation, twist):
    """Fill (6, 3) the twist of an arc's end by its own unknowns; c: `coefficients` of its turn."""
    rotation_jacobian, chord_jacobian = jacobians_with(x, y, z, h, c)
    frame = matrix(rotation)
    w0, w1, w2 = h * scale[0], h * scale[1], h * scale[2]
    put_matrix(columns_scaled(times(frame, rotation_jacobian), w0, w1, w2), twist[:3])
    put_matrix(columns_scaled(times(frame, chord_jacobian), w0, w1, w2), twist[3:])


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


@kernel
def points_inside(lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
                  elements: Ints, fractions: Floats) -> tuple[Floats, Floats]:
    """Return axes (n, m, 3, 3) and positions (n, m, 3), m, of n shapes at fractions of elements.

    Shapes: strains (n, N, 3), rotations (n, N + 1, 3, 3), positions (n, N + 1, 3); elements and
    fractions (m,).
    """
    n, count = strains.shape[0], elements.size
    axes, places = np.empty((n, count, 3, 3)), np.empty((n, count, 3))
    for j in range(n):
        for k in range(count):
            point_inside(lengths, strains[j], rotations[j], positions[j], elements[k], fractions[k],
                         axes[j, k], places[j, k])
    return axes, places


@kernel
def frame_along(nodes: Floats, strains: Floats, rotations: Floats, positions: Floats,
                s: float) -> tuple[Floats, Floats]:
    """Return rotation (3, 3) and position (3,) at arc length `s`, on its exact arc.

    Args:
        nodes: (N + 1,), read-only as all of these, arc lengths of the nodes, m
        strains: (N, 3) 1/m; rotations: (N + 1, 3, 3); positions: (N + 1, 3), m
    """
    element = min(int(np.searchsorted(nodes, s, side='right')) - 1, nodes.size - 2)
    h, begin = s - nodes[element], rotations[element]
    turn, chord = rotation_and_chord(h * strains[element, 0], h * strains[element, 1],
                                     h * strains[element, 2], h)
    frame = (begin[0, 0], begin[0, 1], begin[0, 2], begin[1, 0], begin[1, 1], begin[1, 2],
             begin[2, 0], begin[2, 1], begin[2, 2])
    rotation, position = np.empty((3, 3)), np.empty(3)
    way = applied(frame, chord)
    for i in range(3):
        position[i] = positions[element, i] + way[i]
    put_matrix(times(frame, turn), rotation)
    return rotation, position


@kernel
def positions_along(nodes: Floats, strains: Floats, rotations: Floats, positions: Floats,
                    s: Floats) -> Floats:
    """Return the positions (m, 3) of `frame_along` at arc lengths `s` (m,)."""
    out = np.empty((s.size, 3))
    for k in range(s.size):
        out[k] = frame_along(nodes, strains, rotations, positions, s[k])[1]
    return out


# ------------------------------------------------------------------------------------------------
# Where a DLO, or the straight line on which it would go on, is nearest to a point.


_STEPS = 60  # at most: as many halvings find any place to rounding


@kernel
def nearest_place(s: Floats, lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
                  point: Floats, after: float, place: Floats) -> float:
    """Return the arc length of the DLO's nearest place to a point, m; beyond L if it only aims.

    Args:
        s: (N + 1,), read-only, of the nodes, m
        lengths: (N,), strains: (N, 3), rotations: (N + 1, 3, 3), positions: (N + 1, 3): the shape
        point: (3,), m
        after: arc length beyond which the place is sought, m
        place: (3, 3) filled, by rows: the place less the point, the tangent, its change per m
    """
    n, k, least = lengths.size, lengths.size, np.inf
    for node in range(1, n + 1):
        if s[node] > after:
            away = 0.0
            for i in range(3):
                away += (positions[node, i] - point[i]) ** 2
            if away < least:
                k, least = node, away
    ahead = _put_node(rotations, positions, n, point, place)
    if ahead < 0.0:
        aside = 0.0
        for i in range(3):
            aside += (place[0, i] - ahead * place[1, i]) ** 2
        if aside <= least:
            for i in range(3):
                place[0, i] -= ahead * place[1, i]
            return s[n] - ahead
    slope = _put_node(rotations, positions, k, point, place)
    if slope > 0.0:
        low = min(max((after - s[k - 1]) / lengths[k - 1], 0.0), 1.0)
        return s[k - 1] + lengths[k - 1] * _nearest_inside(
            lengths, strains, rotations, positions, k - 1, low, point, place)
    if slope < 0.0 and k < n:
        return s[k] + lengths[k] * _nearest_inside(lengths, strains, rotations, positions, k, 0.0,
                                                   point, place)
    if k < n:
        _put(lengths, strains, rotations, positions, k, 0.0, point, place)
    return s[k]


@kernel
def _put_node(rotations, positions, k, point, place):
    """Fill `place` at node `k`, as if it went on straight; return half the square's slope."""
    for i in range(3):
        place[0, i] = positions[k, i] - point[i]
        place[1, i] = rotations[k, i, 0]
        place[2, i] = 0.0
    return inner(place[0], place[1])


@kernel
def _put(lengths, strains, rotations, positions, element, fraction, point, place):
    """Fill `place` at a fraction of an element; return half the slope of the square distance."""
    frame, x = np.empty((3, 3)), np.empty(3)
    point_inside(lengths, strains, rotations, positions, element, fraction, frame, x)
    for i in range(3):
        place[0, i] = x[i] - point[i]
        place[1, i] = frame[i, 0]
        place[2, i] = strains[element, 2] * frame[i, 1] - strains[element, 1] * frame[i, 2]
    return inner(place[0], place[1])


@kernel
def _nearest_inside(lengths, strains, rotations, positions, element, low, point, place):
    """Return the fraction of an element, `low` at least, at which it is nearest; fill `place`.

    Newton's method for where the distance does not change, inside an interval that shrinks.
    """
    if _put(lengths, strains, rotations, positions, element, low, point, place) >= 0.0:
        return low
    high, h = 1.0, lengths[element]
    slope = _put(lengths, strains, rotations, positions, element, high, point, place)
    if slope <= 0.0:
        return high
    fraction = high
    for _ in range(_STEPS):
        curvature = 1.0 + inner(place[0], place[2])
        last = fraction
        fraction = fraction - slope / (curvature * h) if curvature > 0.0 else 0.5 * (low + high)
        if not low < fraction < high:
            fraction = 0.5 * (low + high)
        slope = _put(lengths, strains, rotations, positions, element, fraction, point, place)
        if slope < 0.0:
            low = fraction
        else:
            high = fraction
        if slope == 0.0 or abs(fraction - last) < 1e-15:
            break
    return fraction


# ------------------------------------------------------------------------------------------------
# How frames of two shapes differ, each seen from its gripper.


@kernel
def carried_frames(frames, before, base, nodes):
    """Return the frames (k, 3, 3) of nodes as the gripper carries them from `before` to `base`."""
    turn = times_transposed(matrix(base), matrix(before))
    carried = np.empty((nodes.size, 3, 3))
    for k in range(nodes.size):
        put_matrix(times(turn, matrix(frames[nodes[k]])), carried[k])
    return carried


@kernel
def trace_of_product(a, b):
    """Return the trace of a b^T."""
    total = 0.0
    for i in range(3):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return total
