# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of loads and springs on a chain of elements, by its strains."""

from dlo_planner.geometry.kinematics import NOTHING, acts_inside, last_point, plus_moment
from dlo_planner.geometry.so3 import (
    ZERO,
    added,
    applied,
    coefficients,
    coefficients_in,
    columns_scaled,
    crossed_columns,
    jacobians_with,
    matrix,
    outer,
    plus,
    put_matrix,
    rotation_and_chord_with,
    rows_scaled,
    second_derivatives,
    times,
    transposed,
    transposed_applied,
    transposed_times,
    vector,
    without_trace,
)
from dlo_planner.geometry.so3 import cross as crossed
from dlo_planner.kernels import kernel

# A change du_e of element e moves everything beyond it as one rigid body, so the Hessian is semi-
# separable: for e < f,  d2V / du_f du_e = cross_f twist_jacobian_e.  Dead loads only notice the
# rotation (blocks 3 wide); springs notice the displacement as well (twists, 6 wide). A twist is
# stated at the gripper's origin: node l moves by  displacement + rotation x position_l.
#
# What acts on a point inside an element sees the part of the element before the point, an element
# like any other.

_NO_SPRINGS = ZERO, ZERO, ZERO  # second derivatives by (turn, turn), (turn, shift), (shift, shift)


@kernel
def fill_blocks(displaced, lengths, strains, arcs, scale, rotations, positions, pull, weight,
                attached, twist_jacobian, cross, diagonal, base):
    """Fill the three blocks per element of the Hessian of a potential of loads and springs.

    All derivatives are by the scaled strains, u = natural + scale * (unknown).

    Args:
        displaced: whether displacements matter: the blocks are 6 wide; None where they never do
        arcs: (N, 7) of these strains, see `kinematics.forward_kinematics`
        pull: (N + 1, 3) derivative of the potential by the node positions
        weight: (N + 1,) springs of nodes that are the same in all directions, N/m
        attached: OffNodeLoads or None
        twist_jacobian: (N, 3 or 6, 3) filled: twist of all that lies beyond, per scaled strain
        cross: (N, 3, 3 or 6) filled: change of this element's gradient per twist of all that lies
            between the gripper and it
        diagonal: (N, 3, 3) filled: second derivative by this element's own strain
        base: (3, 3) filled: change of the moment about the gripper's origin per rotation of it, by
            dead loads
    """
    place = last_point(attached)
    # of all beyond: force, moment and first moment, the sum of pull r^T, about the element's far
    # end; springs, as a twist stated at the origin sees them
    force, moment, first, springs = NOTHING, NOTHING, ZERO, _NO_SPRINGS
    for k in range(lengths.size):
        e = lengths.size - 1 - k
        h, frame = lengths[e], matrix(rotations[e])
        force = plus(force, vector(pull[e + 1]))
        moment = plus_moment(attached, e + 1, moment)
        first = _plus_first(attached, e + 1, first)
        turn, shift, coupling, pivot = element_blocks(
            h, vector(strains[e]), coefficients_in(arcs[e]), vector(scale[e]), frame, force, moment,
            without_trace(first))
        own = _symmetric(pivot)
        if displaced:
            springs, coupling, own = _with_springs_beyond(
                attached, e + 1, vector(positions[e + 1]), weight, springs, turn, shift, coupling,
                own, twist_jacobian[e], cross[e])
        put_matrix(turn, twist_jacobian[e])
        put_matrix(coupling, cross[e])
        put_matrix(own, diagonal[e])
        along = (positions[e + 1, 0] - positions[e, 0], positions[e + 1, 1] - positions[e, 1],
                 positions[e + 1, 2] - positions[e, 2])
        first = added(first, outer(force, along))
        moment = plus(moment, crossed(along, force))
        if acts_inside(attached, place, e):
            place, force, moment, first, springs = _add_points_inside(
                displaced, attached, place, e, h, vector(strains[e]), vector(scale[e]), frame,
                vector(positions[e]), force, moment, first, springs, cross[e], diagonal[e])
    put_matrix(transposed(without_trace(first)), base)


@kernel(forceinline=True)
def element_blocks(h, strain, c, scale, frame, force, moment, rolling):
    """Return what the strain of one element does to all that lies beyond it.

    That is its rotation and displacement at the element's end; the change of the element's
    gradient per rotation of what lies before it; the second derivative by its own strain, as
    (xx, yy, zz, xy, xz, yz).

    Args:
        h: length, m; strain, scale: (3 numbers); c: `so3.coefficients`
        frame: (9 numbers) rotation at its beginning
        force, moment: (3 numbers) of the loads beyond, about its end, as derivatives of the
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
    own = second_derivatives(x, y, z, h, transposed_applied(frame, force),
                                  transposed_applied(frame, moment), c)
    both = times(rolled, turned)
    pivot = (w0 * w0 * own[0] + both[0], w1 * w1 * own[4] + both[4], w2 * w2 * own[8] + both[8],
             w0 * w1 * own[1] + 0.5 * (both[1] + both[3]),
             w0 * w2 * own[2] + 0.5 * (both[2] + both[6]),
             w1 * w2 * own[5] + 0.5 * (both[5] + both[7]))
    return turned, s, coupling, pivot


@kernel
def _symmetric(m):
    """Return the matrix of 6 numbers (xx, yy, zz, xy, xz, yz)."""
    return m[0], m[3], m[4], m[3], m[1], m[5], m[4], m[5], m[2]


@kernel
def _add_matrix(m, out):
    """Add a matrix to an array (3, 3)."""
    put_matrix(added(matrix(out), m), out)


@kernel
def _plus_first(attached, node, first):
    """Return a first moment (9 numbers), and that of what is fixed to a node."""
    if attached is None:
        return first
    if attached.sprung[node]:
        return added(first, matrix(attached.node_first[node]))
    return first


@kernel(forceinline=True)
def _with_springs_beyond(attached, node, where, weight, springs, turn, shift, coupling, own, twist,
                         cross):
    """Return the springs beyond an element, with those of its last node, and its blocks with them.

    Fills the parts of `twist` and `cross` that are the displacement's.
    """
    if weight[node] != 0.0:
        springs = _plus_weight(springs, weight[node], where)
    springs = _plus_node(springs, attached, node, where)
    shift = added(shift, crossed_columns(where, turn))
    by_turn, by_shift, by_strain = _through_springs(springs, turn, shift)
    put_matrix(shift, twist[3:])
    put_matrix(by_shift, cross[:, 3:])
    return springs, added(coupling, by_turn), added(own, by_strain)


@kernel
def _add_points_inside(displaced, attached, place, e, h, strain, scale, frame, begin, force, moment,
                       first, springs, cross, diagonal):
    """Add what acts inside element e; return `place` and what lies beyond the element's beginning.

    That is at `begin` (3 numbers), its rotation is `frame`.
    """
    if attached is None:
        return place, force, moment, first, springs
    while acts_inside(attached, place, e):
        point = attached.order[place]
        load, couple = vector(attached.force[point]), vector(attached.moment[point])
        own_first, length = matrix(attached.first[point]), attached.fraction[point] * h
        x, y, z = length * strain[0], length * strain[1], length * strain[2]
        arc = coefficients(x * x + y * y + z * z)
        turn, shift, coupling, pivot = element_blocks(length, strain, arc, scale, frame, load,
                                                      couple, without_trace(own_first))
        own = _symmetric(pivot)
        _, chord = rotation_and_chord_with(x, y, z, length, arc)
        arm = applied(frame, chord)
        if displaced:
            where = plus(begin, arm)
            shift = added(shift, crossed_columns(where, turn))
            spring = _seen_from_origin(_springs_in(attached.matrix[point]), where)
            by_turn, by_shift, by_strain = _through_springs(spring, turn, shift)
            coupling, own = added(coupling, by_turn), added(own, by_strain)
            _add_matrix(by_shift, cross[:, 3:])
            _add_own(attached.own[point], scale, where, turn, shift, cross, diagonal)
            springs = _plus_springs(springs, spring)
        _add_matrix(coupling, cross)
        _add_matrix(own, diagonal)
        first = added(added(first, own_first), outer(load, arm))
        moment = plus(plus(moment, couple), crossed(arm, load))
        force = plus(force, load)
        place -= 1
    return place, force, moment, first, springs


@kernel
def _springs_in(spring):
    """Return springs of a second derivative (6, 6) by a twist."""
    return matrix(spring), matrix(spring[:, 3:]), matrix(spring[3:, 3:])


@kernel(forceinline=True)
def _plus_springs(a, b):
    return added(a[0], b[0]), added(a[1], b[1]), added(a[2], b[2])


@kernel(forceinline=True)
def _plus_node(springs, attached, node, where):
    """Return springs, and those of a node but for its weight."""
    if attached is None:
        return springs
    if not attached.sprung[node]:
        return springs
    own = _seen_from_origin(_springs_in(attached.node_matrix[node]), where)
    return _plus_springs(springs, own)


@kernel(forceinline=True)
def _plus_weight(springs, w, x):
    """Return springs, and w |displacement|^2 / 2 of a node at x."""
    (xx, xy, xz, yx, yy, yz, zx, zy, zz), mixed, shifting = springs
    a, b, c = x
    wa, wb, wc = w * a, w * b, w * c
    turning = (xx + wb * b + wc * c, xy - wa * b, xz - wa * c,
               yx - wa * b, yy + wa * a + wc * c, yz - wb * c,
               zx - wa * c, zy - wb * c, zz + wa * a + wb * b)
    mixed = added(mixed, (0.0, -wc, wb, wc, 0.0, -wa, -wb, wa, 0.0))
    return turning, mixed, added(shifting, (w, 0.0, 0.0, 0.0, w, 0.0, 0.0, 0.0, w))


@kernel(forceinline=True)
def _seen_from_origin(springs, x):
    """Return springs as a twist stated at the origin sees them, instead of one stated at x."""
    turning, mixed, shifting = springs
    moved = added(mixed, crossed_columns(x, shifting))
    turning = added(turning, added(crossed_columns(x, transposed(mixed)),
                                   transposed(crossed_columns(x, transposed(moved)))))
    return turning, moved, shifting


@kernel(forceinline=True)
def _through_springs(springs, turn, shift):
    """Return what springs beyond an element do, whose strain makes a turn and a shift there.

    That is the change of the element's gradient by a turn, by a shift, and by its own strain.
    """
    turning, mixed, shifting = springs
    by_turn = added(transposed_times(turn, turning), transposed(times(mixed, shift)))
    by_shift = added(transposed_times(turn, mixed), transposed_times(shift, shifting))
    return by_turn, by_shift, added(times(by_turn, turn), times(by_shift, shift))


@kernel
def _add_own(own, scale, where, turn, shift, cross, diagonal):
    """Add how a point at `where` depends on its element's own strain: own (3, 9)."""
    mixed = matrix(own[:, 3:])
    by_turn = rows_scaled(scale, added(matrix(own), transposed(
        crossed_columns(where, transposed(mixed)))))
    by_shift = rows_scaled(scale, mixed)
    _add_matrix(by_turn, cross)
    _add_matrix(by_shift, cross[:, 3:])
    both = added(times(by_turn, turn), times(by_shift, shift))
    twice = columns_scaled(rows_scaled(scale, matrix(own[:, 6:])), scale[0], scale[1], scale[2])
    _add_matrix(added(twice, added(both, transposed(both))), diagonal)
