# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces and second derivatives of one contact, at a node or at a point inside an element."""

import numpy as np

from dlo_planner.energy.outline import sliding
from dlo_planner.energy.rolling import along_the_dlo
from dlo_planner.energy.scene import AXIS, NODE_FACE
from dlo_planner.kernels import kernel
from dlo_planner.ritz.attached import spring_at


@kernel
def push_node(scene, o, node, force, k, rotation, offset, normal, hessian, second, pull, attached):
    """Add the force and the stiffness of a contact at a node."""
    spring = spring_at(attached, node)
    for i in range(3):
        pull[node, i] -= force * normal[i]
    if scene.feature[o] == AXIS:
        for i in range(3):
            for j in range(3):
                spring[i, j] += k * normal[i] * normal[j] - force * hessian[i, j]
        return
    _second(scene, o, False, force, k, normal, rotation, offset, normal, hessian, second)
    for i in range(6):
        for j in range(6):
            attached.node_matrix[node, i, j] += second[i, j]
    _add_moment(force, rotation, offset, normal, attached.node_moment[node],
                attached.node_first[node])


@kernel
def push_beside(scene, o, c, force, k, rolls, strain, rotation, offset, normal, hessian, second,
                attached):
    """Write the force, moment and stiffness of a contact beside the axis, inside an element."""
    inside = rolls and 0.0 < attached.fraction[c] < 1.0  # at an end the point does not slide
    _second(scene, o, inside, force, k, strain, rotation, offset, normal, hessian, second)
    for i in range(3):
        attached.force[c, i] = -force * normal[i]
    attached.matrix[c] = second[:6, :6]
    attached.own[c] = second[6:]
    _add_moment(force, rotation, offset, normal, attached.moment[c], attached.first[c])


@kernel
def _add_moment(force, rotation, offset, normal, moment, first):
    """Add what a force -force normal at an offset from the axis does to the frame there."""
    arm = rotation[:, 1] * offset[0] + rotation[:, 2] * offset[1]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moment[i] -= force * (arm[j] * normal[k] - arm[k] * normal[j])
        for j in range(3):
            first[i, j] -= force * normal[i] * arm[j]


@kernel
def _second(scene, o, along, force, k, strain, rotation, offset, normal, hessian, second):
    """Fill second (9, 9), the second derivative of the potential of a contact beside the axis.

    By the twist (rotation, displacement) of the frame there and by the element's own strain, on
    which the slope of an edge depends directly; the part that is not due to the force being
    carried along.

    Args:
        along: whether the point slides along the DLO
    """
    moves, curves, by = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 9))
    second[:] = 0.0
    for i in range(3):
        for j in range(3):
            second[3 + i, 3 + j] = k * normal[i] * normal[j] - force * hessian[i, j]
    count = sliding(scene, o, along, rotation, strain, offset, normal, hessian, moves, curves)
    for a in range(count):  # change of the slope by coordinate a
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            by[a, i] = moves[a, j] * normal[m] - moves[a, m] * normal[j]
            for j in range(3):
                by[a, 3 + i] += hessian[i, j] * moves[a, j]
    if along and scene.feature[o] != NODE_FACE:
        n0 = n1 = n2 = 0.0
        for i in range(3):
            n0 += rotation[i, 0] * normal[i]
            n1 += rotation[i, 1] * normal[i]
            n2 += rotation[i, 2] * normal[i]
        by[count - 1, 6] = offset[0] * n2 - offset[1] * n1
        by[count - 1, 7] = offset[1] * n0
        by[count - 1, 8] = -offset[0] * n0
    for a in range(count):
        if curves[a, a] <= 0.0:
            continue
        for i in range(9):
            for j in range(9):
                second[i, j] += force / curves[a, a] * by[a, i] * by[a, j]
        for other in range(a + 1, count):
            factor = curves[other, a] / curves[a, a]
            for j in range(9):
                by[other, j] -= factor * by[a, j]
            for j in range(a + 1, count):
                curves[other, j] -= factor * curves[a, j]
    _about_the_axis(rotation[:, 1] * offset[0] + rotation[:, 2] * offset[1], second)


@kernel
def _about_the_axis(arm, second):
    """Change second (9, 9) from displacements of a point to those of the axis, at -arm (3,)."""
    for r in range(9):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            second[r, i] += arm[j] * second[r, 3 + k] - arm[k] * second[r, 3 + j]
    for r in range(9):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            second[i, r] += arm[j] * second[3 + k, r] - arm[k] * second[3 + j, r]


@kernel
def push(c, force, k, rolls, strain, rotation, normal, hessian, attached):
    """Write the force and the stiffness of a contact where the DLO's frame is `rotation`."""
    matrix = attached.matrix[c]
    for i in range(3):
        attached.force[c, i] = -force * normal[i]
        for j in range(3):
            matrix[3 + i, 3 + j] = k * normal[i] * normal[j] - force * hessian[i, j]
    if not (rolls and 0.0 < attached.fraction[c] < 1.0):
        return  # at an end the point does not slide
    _, curve = along_the_dlo(normal, hessian, rotation, strain)
    if curve <= 0.0:
        return
    lever = np.empty(6)  # change of dg/ds by rotation and displacement of the frame there
    for i in range(3):
        first, second = (i + 1) % 3, (i + 2) % 3
        lever[i] = rotation[first, 0] * normal[second] - rotation[second, 0] * normal[first]
        lever[3 + i] = (hessian[i, 0] * rotation[0, 0] + hessian[i, 1] * rotation[1, 0]
                        + hessian[i, 2] * rotation[2, 0])
    for i in range(6):
        for j in range(6):
            matrix[i, j] += force / curve * lever[i] * lever[j]
