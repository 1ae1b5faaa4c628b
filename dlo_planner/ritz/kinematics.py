# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From strains to frames and positions, and from loads on the nodes back to the strains.

Node k is reached from the gripper through the elements 0 ... k-1 (Eq. 15, 17 of the paper with
exact arcs in place of the infinitesimal rotations of Eq. 16). A change du_e of element e turns
everything beyond it, as one rigid body, by  twist_jacobian_e du_e  (world frame). All that follows
rests on this: gradients are one sweep from the free end, and the Hessian is semi-separable:
for e < f,  d2V / du_f du_e = cross_f twist_jacobian_e,  with 3 x 3 blocks that each depend on one
element only.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arc import (
    coefficients,
    coefficients_in,
    jacobians,
    put_coefficients,
    rotation_and_chord,
    rotation_and_chord_with,
    slope_with,
)
from dlo_planner.ritz.attached import (
    acts_inside,
    at_tip,
    last_point,
    moments_on_nodes,
    plus_at_node,
)
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
        arcs: (N, 7) filled with `arc.coefficients` of the elements
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
        own = slope_with(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h,
                         transposed_applied(frame, force), transposed_applied(frame, moment),
                         coefficients_in(arcs[e]))
        for j in range(3):
            gradient[e, j] += h * own[j]
        moment = plus(moment, cross((positions[e + 1, 0] - positions[e, 0],
                                     positions[e + 1, 1] - positions[e, 1],
                                     positions[e + 1, 2] - positions[e, 2]), force))
        if acts_inside(attached, place, e):
            place, force, moment = _add_points(attached, place, e, h, strains, rotations, force,
                                               moment, gradient)
    put_vector(plus(force, vector(pull[0])), by_shift)
    put_vector(moment, by_turn)


@kernel
def _add_points(attached, place, e, h, strains, rotations, force, moment, gradient):
    """Add what acts inside element e to its gradient; return place, force and moment before it."""
    if attached is None:
        return place, force, moment
    while place >= 0 and attached.element[attached.order[place]] == e:
        part, arm = np.empty((6, 3)), np.empty(3)
        c = attached.order[place]
        point_force = vector(attached.force[c])
        part_of_element(h, attached.fraction[c], strains[e], _UNSCALED, rotations[e], part, arm)
        for j in range(3):
            gradient[e, j] += inner((part[3, j], part[4, j], part[5, j]), point_force)
        if attached.moment.shape[0]:
            moment = plus(moment, vector(attached.moment[c]))
            for j in range(3):
                gradient[e, j] += inner((part[0, j], part[1, j], part[2, j]),
                                        vector(attached.moment[c]))
        moment = plus(moment, cross(vector(arm), point_force))
        force = plus(force, point_force)
        place -= 1
    return place, force, moment


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
    rotation_jacobian, chord_jacobian = jacobians(x, y, z, length)
    frame = matrix(rotation)
    put_vector(applied(frame, chord), arm)
    w0, w1, w2 = length * scale[0], length * scale[1], length * scale[2]
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
