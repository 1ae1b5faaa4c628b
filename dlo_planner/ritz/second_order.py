"""Second derivatives of loads on a chain of elements, by its strains.

A change du_e of element e moves everything beyond it as one rigid body, so the Hessian is
semi-separable: for e < f,  d2V / du_f du_e = cross_f turning_e.  Dead loads only notice the
rotation (blocks 3 wide); springs notice the displacement as well (twists, 6 wide).
"""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.arc import add_second_derivatives, jacobians
from dlo_planner.ritz.kinematics import part_of_element


@kernel
def second_order(lengths, strains, scale, rotations, positions, pull, attached, turning, cross,
                 diagonal):
    """Fill the three blocks per element of the Hessian of a potential of dead loads.

    All derivatives are by the scaled strains, u = natural + scale * (unknown).

    Args:
        scale: (N, 3)
        pull: (N + 1, 3) derivative of the potential by the node positions, constant
        turning: (N, 3 or 6, 3) filled (first three rows): world rotation of all that lies
            beyond, per scaled strain
        cross: (N, 3, 3 or 6) filled (first three columns): change of this element's gradient per
            world rotation of all that lies between the gripper and it
        diagonal: (N, 3, 3) filled: second derivative by this element's own strain

    Returns:
        the (3, 3) change of the moment about the gripper's origin per rotation of the gripper
    """
    near = np.empty((3, 3))
    shifting = np.empty((3, 3))
    rolled = np.empty((3, 3))
    own = np.empty((3, 3))
    phi = np.empty(3)
    near_force = np.empty(3)
    near_moment = np.empty(3)
    n = lengths.size
    place = attached.element.size - 1
    beside, beside_node = attached.moment.shape[0] > 0, attached.node_moment.shape[0] > 0
    part = np.empty((6, 3))
    arm = np.empty(3)
    f0, f1, f2 = attached.tip_force
    m0, m1, m2 = attached.tip_moment
    # first moment of the loads beyond: sum of pull r^T, r from the element's far end
    first = attached.tip_first.copy()
    stiff = np.empty((3, 3))
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        f0 += pull[e + 1, 0]
        f1 += pull[e + 1, 1]
        f2 += pull[e + 1, 2]
        if beside_node and attached.sprung[e + 1]:
            m0 += attached.node_moment[e + 1, 0]
            m1 += attached.node_moment[e + 1, 1]
            m2 += attached.node_moment[e + 1, 2]
            for i in range(3):
                for j in range(3):
                    first[i, j] += attached.node_first[e + 1, i, j]
        for i in range(3):
            phi[i] = h * strains[e, i]
        jacobians(phi, h, near, shifting)
        rot = rotations[e]
        for j in range(3):
            near_force[j] = rot[0, j] * f0 + rot[1, j] * f1 + rot[2, j] * f2
            near_moment[j] = rot[0, j] * m0 + rot[1, j] * m1 + rot[2, j] * m2
        # stiff = sum of (pull r^T - (r . pull) I): the Hessian of a dead load by rotations
        trace = first[0, 0] + first[1, 1] + first[2, 2]
        for i in range(3):
            for j in range(3):
                stiff[i, j] = first[i, j]
            stiff[i, i] -= trace
        for i in range(3):
            for j in range(3):
                turning[e, i, j] = h * scale[e, j] * (
                    rot[i, 0] * near[0, j] + rot[i, 1] * near[1, j] + rot[i, 2] * near[2, j])
        # shifting, in the world, times the cross-product matrix of the force
        for j in range(3):
            weight = h * scale[e, j]
            s0 = weight * (rot[0, 0] * shifting[0, j] + rot[0, 1] * shifting[1, j]
                           + rot[0, 2] * shifting[2, j])
            s1 = weight * (rot[1, 0] * shifting[0, j] + rot[1, 1] * shifting[1, j]
                           + rot[1, 2] * shifting[2, j])
            s2 = weight * (rot[2, 0] * shifting[0, j] + rot[2, 1] * shifting[1, j]
                           + rot[2, 2] * shifting[2, j])
            for i in range(3):
                rolled[j, i] = (turning[e, 0, j] * stiff[0, i] + turning[e, 1, j] * stiff[1, i]
                                + turning[e, 2, j] * stiff[2, i])
            cross[e, j, 0] = rolled[j, 0] + s1 * f2 - s2 * f1
            cross[e, j, 1] = rolled[j, 1] + s2 * f0 - s0 * f2
            cross[e, j, 2] = rolled[j, 2] + s0 * f1 - s1 * f0
        for i in range(3):
            for j in range(3):
                own[i, j] = 0.0
        add_second_derivatives(phi, h, near_force, near_moment, own)
        for i in range(3):
            for j in range(3):
                diagonal[e, i, j] = h * h * scale[e, i] * scale[e, j] * own[i, j]
        for i in range(3):
            for j in range(3):
                both = (rolled[i, 0] * turning[e, 0, j] + rolled[i, 1] * turning[e, 1, j]
                        + rolled[i, 2] * turning[e, 2, j])
                diagonal[e, i, j] += 0.5 * both
                diagonal[e, j, i] += 0.5 * both
        d0 = positions[e + 1, 0] - positions[e, 0]
        d1 = positions[e + 1, 1] - positions[e, 1]
        d2 = positions[e + 1, 2] - positions[e, 2]
        first[0, 0] += f0 * d0
        first[0, 1] += f0 * d1
        first[0, 2] += f0 * d2
        first[1, 0] += f1 * d0
        first[1, 1] += f1 * d1
        first[1, 2] += f1 * d2
        first[2, 0] += f2 * d0
        first[2, 1] += f2 * d1
        first[2, 2] += f2 * d2
        m0 += d1 * f2 - d2 * f1
        m1 += d2 * f0 - d0 * f2
        m2 += d0 * f1 - d1 * f0
        while place >= 0 and attached.element[attached.order[place]] == e:
            c = attached.order[place]
            own_force = attached.force[c]
            g0, g1, g2 = own_force
            length = attached.fraction[c] * h
            part_of_element(h, attached.fraction[c], strains[e], scale[e], rot, part, arm)
            for i in range(3):
                phi[i] = length * strains[e, i]
                near_moment[i] = 0.0
                if beside:
                    for j in range(3):
                        near_moment[i] += rot[j, i] * attached.moment[c, j]
                near_force[i] = rot[0, i] * g0 + rot[1, i] * g1 + rot[2, i] * g2
                for j in range(3):
                    own[i, j] = 0.0
            add_second_derivatives(phi, length, near_force, near_moment, own)
            for j in range(3):
                cross[e, j, 0] += part[4, j] * g2 - part[5, j] * g1
                cross[e, j, 1] += part[5, j] * g0 - part[3, j] * g2
                cross[e, j, 2] += part[3, j] * g1 - part[4, j] * g0
                for i in range(3):
                    diagonal[e, i, j] += length * length * scale[e, i] * scale[e, j] * own[i, j]
            if beside:
                _carry_along(attached.first[c], part, cross[e], diagonal[e], first)
                m0 += attached.moment[c, 0]
                m1 += attached.moment[c, 1]
                m2 += attached.moment[c, 2]
            for i in range(3):
                for j in range(3):
                    first[i, j] += own_force[i] * arm[j]
            m0 += arm[1] * g2 - arm[2] * g1
            m1 += arm[2] * g0 - arm[0] * g2
            m2 += arm[0] * g1 - arm[1] * g0
            f0 += g0
            f1 += g1
            f2 += g2
            place -= 1
    trace = first[0, 0] + first[1, 1] + first[2, 2]
    for i in range(3):
        first[i, i] -= trace
    return first.T.copy()


@kernel
def _carry_along(own_first, part, cross, diagonal, first):
    """Add what forces at offsets from a point do as that point's frame turns.

    Args:
        own_first: (3, 3) sum of force r^T; part: (6, 3) twist of the frame by the element's strain
        cross: (3, 3 or 6), diagonal: (3, 3) of the element, first: (3, 3) of all beyond: added to
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
            first[i, j] += own_first[i, j]


@kernel
def add_stiffness(lengths, strains, scale, rotations, positions, weight, attached, turning, cross,
                  diagonal):
    """Widen the blocks of `second_order` by springs: `weight` (N + 1,) or (0,), and `attached`.

    What lies beyond an element now moves by a twist (rotation, displacement at the gripper's
    origin), so that node l moves by  displacement + rotation x position_l.

    Args:
        turning: (N, 6, 3), cross: (N, 3, 6), diagonal: (N, 3, 3): filled by `second_order` in
            their first three rows (columns); completed here
    """
    near, shifting = np.empty((3, 3)), np.empty((3, 3))
    phi = np.empty(3)
    beyond = np.zeros((6, 6))  # of all nodes beyond: their springs as seen by a twist
    rolled = np.empty((3, 6))
    place = attached.element.size - 1
    part = np.empty((6, 3))
    arm = np.empty(3)
    beside, beside_node = attached.moment.shape[0] > 0, attached.node_moment.shape[0] > 0
    rigid, local, spring = np.empty((6, 6)), np.empty((6, 6)), np.zeros((6, 6))
    _carry(positions[lengths.size], rigid)
    _multiply(attached.tip_matrix, rigid, local)
    _add_transposed(rigid, local, beyond)
    for e in range(lengths.size - 1, -1, -1):
        h = lengths[e]
        for i in range(3):
            phi[i] = h * strains[e, i]
        jacobians(phi, h, near, shifting)
        rot, where, twist = rotations[e], positions[e + 1], turning[e]
        for j in range(3):
            factor = h * scale[e, j]
            for i in range(3):
                twist[3 + i, j] = factor * (rot[i, 0] * shifting[0, j] + rot[i, 1] * shifting[1, j]
                                            + rot[i, 2] * shifting[2, j])
            twist[3, j] -= twist[1, j] * where[2] - twist[2, j] * where[1]
            twist[4, j] -= twist[2, j] * where[0] - twist[0, j] * where[2]
            twist[5, j] -= twist[0, j] * where[1] - twist[1, j] * where[0]
        if weight.size:
            _add_spring(beyond, where, weight[e + 1])
        if attached.sprung.size and attached.sprung[e + 1]:
            for i in range(3):
                for j in range(3):
                    spring[3 + i, 3 + j] = attached.spring[e + 1, i, j]
            if beside_node:
                for i in range(6):
                    for j in range(6):
                        if i < 3 or j < 3:
                            spring[i, j] = attached.node_matrix[e + 1, i, j]
                        else:
                            spring[i, j] += attached.node_matrix[e + 1, i, j]
            _carry(where, rigid)
            _multiply(spring, rigid, local)
            _add_transposed(rigid, local, beyond)
        for i in range(3):
            for k in range(6):
                total = 0.0
                for j in range(6):
                    total += twist[j, i] * beyond[j, k]
                rolled[i, k] = total
                if k < 3:
                    cross[e, i, k] += total
                else:
                    cross[e, i, k] = total
            for j in range(3):
                total = 0.0
                for k in range(6):
                    total += rolled[i, k] * twist[k, j]
                diagonal[e, i, j] += total
        while place >= 0 and attached.element[attached.order[place]] == e:
            c = attached.order[place]
            part_of_element(h, attached.fraction[c], strains[e], scale[e], rot, part, arm)
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
