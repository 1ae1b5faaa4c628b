# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact with obstacles and friction: where, with which forces and second derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.gap import (
    along_the_dlo,
    closest_point,
    gap_at,
    near_gaps,
    node_gap,
    radius_at,
    radius_at_node,
    sliding,
    taper,
)
from dlo_planner.energy.grip import holds_node
from dlo_planner.energy.scene import AXIS, NODE_FACE, Scene, is_convex, signed_distance
from dlo_planner.geometry.kinematics import clear_point, point_inside, sort_points, spring_at
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints

# ------------------------------------------------------------------------------------------------
# Contact with obstacles: the DLO's surface stays outside, and friction resists its sliding.
#
# Every node is watched, and the nearest point inside an element wherever it comes nearer to an
# obstacle than the nodes do; of a rectangular DLO each of its edges, and its faces where they are
# nearer (`energy.gap`). Each such point has a gap g to each obstacle and a multiplier m >= 0:
# the augmented Lagrangian  (max(0, m - k g)^2 - m^2) / (2 k)  pushes with the force max(0, m - k
# g); the minimizer's outer loop moves m until the gaps under force are zero.
#
# The nearest point slides along the DLO as the shape changes, which the second derivative accounts
# for: d2g - (d(dg/ds))^2 / g_ss. A point beside the axis exerts a moment as well.
#
# Each point of contact that rubs has a point of friction of its own (below).


_MOST_LEAPS = 64  # of a look along a way: nearer to an obstacle it is not told to be clear


class ContactSet(Record):
    """Points where the DLO may touch, and what is known of their forces."""

    stiffness: float  # k, N/m
    node: Floats  # (M, N + 1) multipliers of nodes against obstacles, N
    element: Ints  # (C,) elements of the points inside elements, ascending
    # (C,) the one they are nearest to, or -1 - o for a point of friction on obstacle o
    obstacle: Ints
    multiplier: Floats  # (C,) m, or the limit of the friction force, N
    # (C,) of the element, of points that are fixed there: 1 for a node, its end, less for what is
    # inside; 0 of points that roll along the DLO, where it is nearest; beside a hole, where it may
    # be so twice, less: minus the fraction that it rolls from to the nearest place beside it
    fraction: Floats
    # (C, 3) where a point of friction sticks, m, relative to the gripper; what is across `normal`
    # counts
    anchor: Floats
    normal: Floats  # (C, 3) normal of the obstacle at a point of friction
    # (C, 3) multiplier of a point of friction, N, across the normal, against the friction on the
    # DLO
    shear: Floats
    grip: float  # stiffness of points of friction, N/m


class Contact(Record):
    """Obstacles and where they are touched."""

    scene: Scene  # the obstacles
    contacts: ContactSet  # where they may be touched


def obstructed(effect: Contact | None) -> bool:
    """Whether there are obstacles."""
    return effect is not None and effect.scene.kind.size > 0


def needs(effect: Contact) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    return {'displaced': obstructed(effect), 'attached': True, 'element': effect.contacts.element}


def hinged(effect: Contact, _: float) -> Contact:
    """Return the same with one more element before the first."""
    contacts = effect.contacts
    node = np.ascontiguousarray(np.hstack([contacts.node[:, :1] * 0.0, contacts.node]))
    return effect._replace(contacts=contacts._replace(node=node, element=contacts.element + 1))


def without_hinge(effect: Contact) -> Contact:
    """Return the same without the first element."""
    contacts = effect.contacts
    return effect._replace(contacts=contacts._replace(
        node=np.ascontiguousarray(contacts.node[:, 1:]), element=contacts.element - 1))


@kernel
def add_forces(effect, system, state):
    """Add the forces of all contacts; return their potential in J, and its size."""
    if effect is None:
        return 0.0, 0.0
    energy = 0.0
    if effect.scene.kind.size:
        energy = add_contacts(effect.scene, effect.contacts, system.lengths, state.strains,
                              state.rotations, state.positions, state.pull, state.attached)
    return energy, abs(energy)


@kernel
def roundoff(effect, system, state, length):
    """Return forces in N whose relative rounding errors those of contacts have."""
    if effect is None:
        return 0.0
    touching = False
    attached = state.attached
    for c in range(attached.element.size):
        for i in range(3):
            touching |= attached.force[c, i] != 0.0
    for k in range(attached.sprung.size):
        if attached.sprung[k] and not holds_node(system.effects.hold, k):  # (that springs it, too)
            touching = True
    if not touching:
        return 0.0
    far = np.sqrt(np.sum(effect.scene.origin**2))
    return (effect.contacts.stiffness + effect.contacts.grip) * (length + far)


@kernel
def forbids(effect, system, before, after):
    """Whether an obstacle is between two States."""
    if effect is None:
        return False
    if effect.scene.kind.size == 0:
        return False
    return sweeps_through(effect.scene, system.lengths, before.strains, before.rotations,
                          before.positions, after.rotations, after.positions)


@kernel
def may_act(effect, system, strains, positions, before):
    """Whether an obstacle may be touched on the straight way between two places of a DLO.

    Each node is looked at as a ball that holds all of the section, and of the elements up to the
    middles of their lengths.
    """
    if effect is None:
        return False
    for o in range(effect.scene.kind.size):
        if _near(effect.scene, o, system.lengths, positions, before):
            return True
    return False


@kernel
def _near(scene, o, lengths, positions, before):
    """Whether body `o` may be touched, see `may_act`."""
    x, normal, hessian, shift = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    n, farthest, thickest = lengths.size, 0.0, 0.0
    beside = np.sqrt(scene.offset[o, 0] ** 2 + scene.offset[o, 1] ** 2)
    for k in range(n + 1):
        thickest = max(thickest, radius_at_node(scene, o, k))
        away = 0.0
        for i in range(3):
            away += (positions[k, i] - before[k, i]) ** 2
        farthest = max(farthest, away)
    farthest = np.sqrt(farthest)
    around = beside + thickest + 0.5 * np.max(lengths)
    clear = 0.0
    for k in range(n + 1):
        if k > 0:
            clear -= lengths[k - 1]
        if clear > 0.0:  # nothing of it gets so far
            continue
        for i in range(3):
            x[i] = scene.origin[i] + positions[k, i]
        gap = signed_distance(scene, o, x, normal, hessian) - around
        clear, back = gap - farthest, 0.0
        for i in range(3):
            shift[i] = before[k, i] - positions[k, i]
            back += normal[i] * shift[i]
        if not gap > 0.0:
            return True
        # all of a convex body is behind the plane that touches it where it is nearest
        if (not is_convex(scene, o) or gap + back <= 0.0) and not _clear_way(
                scene, o, x, shift, around, normal, hessian):
            return True
    return False


@kernel
def _clear_way(scene, o, x, shift, around, normal, hessian):
    """Whether a ball is told to stay away from body `o` on its way from x (3,) by `shift` (3,).

    From each point it goes on as far as it is away there.
    """
    length, gone, here = np.sqrt(np.sum(shift * shift)), 0.0, np.empty(3)
    for _ in range(_MOST_LEAPS):
        for i in range(3):
            here[i] = x[i] + (gone / length * shift[i] if gone > 0.0 else 0.0)
        gap = signed_distance(scene, o, here, normal, hessian) - around
        if not gap > 0.0:
            return False
        gone += gap
        if gone >= length:
            return True
    return False


@kernel
def may_forbid(effect):
    """Whether anything may be in the way."""
    if effect is None:
        return False
    return effect.scene.kind.size > 0


@kernel
def add_contacts(scene, contacts, lengths, strains, rotations, positions, pull, attached):
    """Add the forces of all contacts to `pull` and `attached`; return their potential in J."""
    energy = 0.0
    k = contacts.stiffness
    x, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    frame, offset, second = np.empty((3, 3)), np.zeros(2), np.empty((9, 9))
    for o in range(scene.kind.size):
        multiplier = contacts.node[o]
        gaps = near_gaps(scene, o, lengths, multiplier, strains, rotations, positions, 0.0)
        for node in range(gaps.size):
            if gaps[node] == np.inf:
                continue
            force = multiplier[node] - k * gaps[node]
            if force > 0.0:
                node_gap(scene, o, node, rotations, positions, offset, x, normal, hessian)
                energy += 0.5 * force * force / k
                push_node(scene, o, node, force, k, rotations[node], offset, normal, hessian,
                          second, pull, attached)
            energy -= 0.5 * multiplier[node] ** 2 / k
    for c in range(contacts.element.size):
        e, o = contacts.element[c], contacts.obstacle[c]
        clear_point(attached, c)
        if o < 0:
            attached.element[c] = e
            energy += add_friction(contacts, c, lengths, strains, rotations, positions, attached)
            continue
        gap, e, fraction = closest_point(scene, contacts, c, lengths, strains, rotations, positions,
                                         normal, hessian)
        attached.element[c], attached.fraction[c] = e, fraction
        point_inside(lengths, strains, rotations, positions, e, fraction, frame, x)
        force = contacts.multiplier[c] - k * gap
        if force > 0.0:
            energy += 0.5 * force * force / k
            rolls = _rolls(scene, contacts, c, lengths, attached)
            if scene.feature[o] == AXIS:
                push(c, force, k, rolls, strains[e], frame, normal, hessian, attached)
            else:
                gap_at(scene, o, frame, x, 0.0, offset, x.copy(), normal, hessian)
                push_beside(scene, o, c, force, k, rolls, strains[e], frame, offset, normal,
                            hessian, second, attached)
        energy -= 0.5 * contacts.multiplier[c] ** 2 / k
    sort_points(attached)
    return energy


@kernel
def _rolls(scene, contacts, c, lengths, attached):
    """Whether a point of contact moves along the DLO: through a node, but not beyond an end.

    Nor at a node where the surface has an edge, or where a line beside the axis has a kink, for
    the strain jumps there.
    """
    o, e, fraction = contacts.obstacle[c], attached.element[c], attached.fraction[c]
    if contacts.fraction[c] > 0.0 or 0.0 < fraction < 1.0:
        return contacts.fraction[c] <= 0.0
    beyond = e + 1 if fraction > 0.0 else e - 1
    if scene.feature[o] != AXIS or not 0 <= beyond < lengths.size:
        return False
    return (taper(scene, o, e) * lengths[beyond] == taper(scene, o, beyond) * lengths[e]
            and radius_at(scene, o, e, fraction) == radius_at(scene, o, beyond, 1.0 - fraction))


# ------------------------------------------------------------------------------------------------
# Forces and second derivatives of one contact, at a node or at a point inside an element.


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
    _second(scene, o, rolls, force, k, strain, rotation, offset, normal, hessian, second)
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
    if not rolls:
        return
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


# ------------------------------------------------------------------------------------------------
# Coulomb friction at one point of contact: it sticks to where it is, or slides and is held back.
#
# The force that a sliding by s across the normal meets is the trial force t = shear + grip s, cut
# to the limit mu N:  T = t min(1, mu N / |t|).  With `shear` the force itself at the end of the
# minimizer's outer loop, s vanishes where the point sticks, and where it slides T opposes s (the
# augmented Lagrangian of Simo and Laursen 1992). For a given limit T has a potential, which is
# what the minimizer sees; the outer loop moves limit and shear.


@kernel
def trial_traction(contacts: ContactSet, c: int, x: Floats, trial: Floats) -> float:
    """Fill trial (3,), what would pull point of friction c back to its anchor; return its size.

    Args:
        x: (3,) where the point is, relative to the gripper
    """
    normal = contacts.normal[c]
    out = 0.0
    for i in range(3):
        out += (x[i] - contacts.anchor[c, i]) * normal[i]
    square = 0.0
    for i in range(3):
        slid = x[i] - contacts.anchor[c, i] - out * normal[i]
        trial[i] = contacts.shear[c, i] + contacts.grip * slid
        square += trial[i] * trial[i]
    return np.sqrt(square)


@kernel
def add_friction(contacts, c, lengths, strains, rotations, positions, attached):
    """Write force and stiffness of point of friction c; return its potential in J."""
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    e, limit, normal, grip = (contacts.element[c], contacts.multiplier[c], contacts.normal[c],
                              contacts.grip)
    attached.fraction[c] = contacts.fraction[c]
    point_inside(lengths, strains, rotations, positions, e, contacts.fraction[c], rotation, x)
    size = trial_traction(contacts, c, x, trial)
    if size <= limit:
        for i in range(3):
            attached.force[c, i] = trial[i]
            for j in range(3):
                attached.matrix[c, 3 + i, 3 + j] = grip * ((i == j) - normal[i] * normal[j])
        return 0.5 * size * size / grip
    for i in range(3):
        trial[i] /= size
        attached.force[c, i] = limit * trial[i]
    for i in range(3):
        for j in range(3):
            attached.matrix[c, 3 + i, 3 + j] = grip * limit / size * (
                (i == j) - normal[i] * normal[j] - trial[i] * trial[j])
    return limit * (size - 0.5 * limit) / grip
