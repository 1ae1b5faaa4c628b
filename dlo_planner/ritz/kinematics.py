"""From strains to frames and positions, and from loads on the nodes back to the strains.

Node k is reached from the gripper through the elements 0 ... k-1 (Eq. 15, 17 of the paper with
exact arcs in place of the infinitesimal rotations of Eq. 16). A change du_e of element e turns
everything beyond it, as one rigid body, by  turning_e du_e  (world frame). All that follows
rests on this: gradients are one sweep from the free end, and the Hessian is semi-separable:
for e < f,  d2V / du_f du_e = cross_f turning_e,  with 3 x 3 blocks that each depend on one
element only.
"""

import numpy as np
from numba import njit

from dlo_planner.ritz.arc import (
    add_second_derivatives,
    jacobians,
    rotation_and_chord,
)


@njit(cache=True)
def march(lengths, strains, base, rotations, positions):
    """Fill the frames and positions of all nodes from the strains, starting at the gripper.

    Args:
        lengths: (N,) of the elements, m
        strains: (N, 3) torsion, curvature about n, about b; 1/m
        base: (3, 3) the gripper's rotation, columns t, n, b
        rotations: (N + 1, 3, 3) filled; columns t, n, b in the world
        positions: (N + 1, 3) filled; relative to the gripper, world axes, m
    """
    turn = np.empty((3, 3))
    chord = np.empty(3)
    for i in range(3):
        positions[0, i] = 0.0
        for j in range(3):
            rotations[0, i, j] = base[i, j]
    for e in range(lengths.size):
        h = lengths[e]
        rotation_and_chord(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h, turn, chord)
        for i in range(3):
            r0, r1, r2 = rotations[e, i, 0], rotations[e, i, 1], rotations[e, i, 2]
            positions[e + 1, i] = positions[e, i] + r0 * chord[0] + r1 * chord[1] + r2 * chord[2]
            for j in range(3):
                rotations[e + 1, i, j] = r0 * turn[0, j] + r1 * turn[1, j] + r2 * turn[2, j]


@njit(cache=True)
def add_gradient(lengths, strains, rotations, positions, pull, gradient):
    """Add dV/du (N, 3) of a potential whose derivative by the node positions is `pull` (N + 1, 3).

    Returns the derivative by the gripper's displacement and by its rotation about its own
    origin, (3,) each, world frame.
    """
    turning = np.empty((3, 3))
    shifting = np.empty((3, 3))
    phi = np.empty(3)
    force = np.empty(3)   # sum of pull beyond the element
    moment = np.empty(3)  # their moment about the element's far end
    near_force = np.empty(3)
    near_moment = np.empty(3)
    n = lengths.size
    for i in range(3):
        force[i] = 0.0
        moment[i] = 0.0
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        for i in range(3):
            phi[i] = h * strains[e, i]
            force[i] += pull[e + 1, i]
        jacobians(phi, h, turning, shifting)
        for j in range(3):
            near_force[j] = (rotations[e, 0, j] * force[0] + rotations[e, 1, j] * force[1]
                             + rotations[e, 2, j] * force[2])
            near_moment[j] = (rotations[e, 0, j] * moment[0] + rotations[e, 1, j] * moment[1]
                              + rotations[e, 2, j] * moment[2])
        for j in range(3):
            gradient[e, j] += h * (
                turning[0, j] * near_moment[0] + turning[1, j] * near_moment[1]
                + turning[2, j] * near_moment[2] + shifting[0, j] * near_force[0]
                + shifting[1, j] * near_force[1] + shifting[2, j] * near_force[2])
        d0 = positions[e + 1, 0] - positions[e, 0]
        d1 = positions[e + 1, 1] - positions[e, 1]
        d2 = positions[e + 1, 2] - positions[e, 2]
        moment[0] += d1 * force[2] - d2 * force[1]
        moment[1] += d2 * force[0] - d0 * force[2]
        moment[2] += d0 * force[1] - d1 * force[0]
    return force + pull[0], moment


@njit(cache=True)
def second_order(lengths, strains, scale, rotations, positions, pull, turning, cross, diagonal):
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
    f0 = f1 = f2 = 0.0
    m0 = m1 = m2 = 0.0
    # first moment of the loads beyond: sum of pull r^T, r from the element's far end
    first = np.zeros((3, 3))
    stiff = np.empty((3, 3))
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        f0 += pull[e + 1, 0]
        f1 += pull[e + 1, 1]
        f2 += pull[e + 1, 2]
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
    trace = first[0, 0] + first[1, 1] + first[2, 2]
    for i in range(3):
        first[i, i] -= trace
    return first.T.copy()


@njit(cache=True)
def add_node_stiffness(lengths, strains, scale, rotations, positions, weight, turning, cross,
                       diagonal):
    """Widen the blocks of `second_order` by springs of stiffness `weight` (N + 1,) on the nodes.

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
        _add_spring(beyond, where, weight[e + 1])
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


@njit(cache=True)
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


@njit(cache=True)
def point_inside(lengths, strains, rotations, positions, element, fraction, rotation, position):
    """Fill rotation (3, 3) and position (3,) at `fraction` of `element`, on its exact arc."""
    turn = np.empty((3, 3))
    chord = np.empty(3)
    h = fraction * lengths[element]
    u = strains[element]
    rotation_and_chord(h * u[0], h * u[1], h * u[2], h, turn, chord)
    for i in range(3):
        row = rotations[element, i]
        position[i] = (positions[element, i] + row[0] * chord[0] + row[1] * chord[1]
                       + row[2] * chord[2])
        for j in range(3):
            rotation[i, j] = row[0] * turn[0, j] + row[1] * turn[1, j] + row[2] * turn[2, j]
