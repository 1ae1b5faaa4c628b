"""From strains to frames and positions, and from loads on the nodes back to the strains.

Node k is reached from the gripper through the elements 0 ... k-1 (Eq. 15, 17 of the paper with
exact arcs in place of the infinitesimal rotations of Eq. 16). A change du_e of element e turns
everything beyond it, as one rigid body, by  turning_e du_e  (world frame). All that follows
rests on this: gradients are one sweep from the free end, and the Hessian is semi-separable:
for e < f,  d2V / du_f du_e = cross_f turning_e,  with 3 x 3 blocks that each depend on one
element only.
"""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.arc import jacobians, rotation_and_chord
from dlo_planner.ritz.record import Record


class Attached(Record):
    """What acts on the DLO elsewhere than as a force on a node: C points inside elements, the tip.

    Attributes:
        element: (C,) and fraction: (C,) of its length; order: (C,) the points by their elements
        force: (C, 3) derivative of the potential by the point's position, N
        matrix: (C, 6, 6) its second derivative by the twist (rotation, displacement) of the frame
            there, the part that is not due to `force` being carried along
        spring: (N + 1, 3, 3) second derivative by the node positions, N/m, where sprung (N + 1,)
        moment: (C, 3) derivative by the rotation of the frame at the point; first: (C, 3, 3) sum of
            force r^T of what is fixed to it at offsets r; own: (C, 3, 9) second derivative by the
            strain of the element itself, beyond that by the twist: with the twist and the strain.
            All (0, ...) where all forces act on the axis
        node_moment, node_first, node_matrix: likewise (N + 1, ...), at the nodes where sprung
        tip_force, tip_moment: (3,) derivative by displacement and rotation of the free end
        tip_first: (3, 3) sum of force r^T of what is fixed to the free end at offsets r
        tip_matrix: (6, 6) as `matrix`
    """

    element: np.ndarray
    fraction: np.ndarray
    order: np.ndarray
    force: np.ndarray
    matrix: np.ndarray
    spring: np.ndarray
    sprung: np.ndarray
    moment: np.ndarray
    first: np.ndarray
    own: np.ndarray
    node_moment: np.ndarray
    node_first: np.ndarray
    node_matrix: np.ndarray
    tip_force: np.ndarray
    tip_moment: np.ndarray
    tip_first: np.ndarray
    tip_matrix: np.ndarray


@kernel
def nothing_attached(nodes, element, beside=False):
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


@kernel
def add_gradient(lengths, strains, rotations, positions, pull, attached, gradient):
    """Add dV/du (N, 3) of a potential whose derivative by the node positions is `pull` (N + 1, 3).

    `attached` adds what acts elsewhere.

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
    place = attached.element.size - 1
    beside, beside_node = attached.moment.shape[0] > 0, attached.node_moment.shape[0] > 0
    part = np.empty((6, 3))
    arm = np.empty(3)
    for i in range(3):
        force[i] = attached.tip_force[i]
        moment[i] = attached.tip_moment[i]
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        for i in range(3):
            phi[i] = h * strains[e, i]
            force[i] += pull[e + 1, i]
            if beside_node and attached.sprung[e + 1]:
                moment[i] += attached.node_moment[e + 1, i]
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
        while place >= 0 and attached.element[attached.order[place]] == e:
            c = attached.order[place]
            own = attached.force[c]
            part_of_element(h, attached.fraction[c], strains[e], _UNSCALED, rotations[e], part,
                             arm)
            for j in range(3):
                gradient[e, j] += part[3, j] * own[0] + part[4, j] * own[1] + part[5, j] * own[2]
            if beside:
                for i in range(3):
                    moment[i] += attached.moment[c, i]
                    for j in range(3):
                        gradient[e, j] += part[i, j] * attached.moment[c, i]
            moment[0] += arm[1] * own[2] - arm[2] * own[1]
            moment[1] += arm[2] * own[0] - arm[0] * own[2]
            moment[2] += arm[0] * own[1] - arm[1] * own[0]
            for i in range(3):
                force[i] += own[i]
            place -= 1
    return force + pull[0], moment


_UNSCALED = np.ones(3)


@kernel
def part_of_element(h, fraction, strain, scale, rotation, twist, arm):
    """Fill what moves a point inside an element, at `fraction` of its length h.

    Args:
        strain, scale: (3,); rotation: (3, 3) at the element's beginning
        twist: (6, 3) filled: rotation and displacement of the frame there per scaled strain
        arm: (3,) filled: the point from the element's beginning
    """
    near, shifting = np.empty((3, 3)), np.empty((3, 3))
    turn, chord = np.empty((3, 3)), np.empty(3)
    length = fraction * h
    phi = np.empty(3)
    for i in range(3):
        phi[i] = length * strain[i]
    rotation_and_chord(phi[0], phi[1], phi[2], length, turn, chord)
    jacobians(phi, length, near, shifting)
    for i in range(3):
        r0, r1, r2 = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        arm[i] = r0 * chord[0] + r1 * chord[1] + r2 * chord[2]
        for j in range(3):
            factor = length * scale[j]
            twist[i, j] = factor * (r0 * near[0, j] + r1 * near[1, j] + r2 * near[2, j])
            twist[3 + i, j] = factor * (r0 * shifting[0, j] + r1 * shifting[1, j]
                                        + r2 * shifting[2, j])


@kernel
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
