# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact with obstacles: the DLO's surface stays outside, and friction resists its sliding.

Every node is watched, and the nearest point inside an element wherever it comes nearer to an
obstacle than the nodes do; of a rectangular DLO each of its edges, and its faces where they are
nearer (`energy.outline`). Each such point has a gap g to each obstacle and a multiplier m >= 0:
the augmented Lagrangian  (max(0, m - k g)^2 - m^2) / (2 k)  pushes with the force max(0, m - k g);
the minimizer's outer loop moves m until the gaps under force are zero.

The nearest point slides along the DLO as the shape changes, which the second derivative accounts
for: d2g - (d(dg/ds))^2 / g_ss. A point beside the axis exerts a moment as well.

Friction is `energy.friction`'s; each point of contact that rubs has a point of friction of its own.
"""

from typing import Any

import numpy as np

from dlo_planner.energy.distance import signed_distance
from dlo_planner.energy.friction import add_friction
from dlo_planner.energy.outline import (
    gap_at,
    is_face,
    longest_stretch,
    nodes_of,
    radius_at_node,
)
from dlo_planner.energy.passage import passes_through
from dlo_planner.energy.pushing import push, push_beside, push_node
from dlo_planner.energy.rolling import watched
from dlo_planner.energy.scene import AXIS, SHEET, Scene
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.ritz.attached import sort_points
from dlo_planner.ritz.kinematics import point_inside
from dlo_planner.ritz.record import Record, makes

_MOST_LEAPS = 64  # of a look along a way: nearer to an obstacle it is not told to be clear


class Contacts(Record):
    """Points where the DLO may touch, and what is known of their forces.

    Attributes
    ----------
    stiffness : float
        k, N/m.
    node : ndarray, shape (M, N + 1)
        Multipliers of nodes against obstacles, N.
    element : ndarray of int, shape (C,)
        Elements of the points inside elements, ascending.
    obstacle : ndarray of int, shape (C,)
        The one they are nearest to, or -1 - o for a point of friction on obstacle o.
    multiplier : ndarray, shape (C,)
        m, or the limit of the friction force, N.
    fraction : ndarray, shape (C,)
        Of the element, of points that are fixed there: 1 for a node, its end, less for what is
        inside; 0 of points that roll along the DLO, where it is nearest.
    anchor : ndarray, shape (C, 3)
        Where a point of friction sticks, m, relative to the gripper; what is across `normal`
        counts.
    normal : ndarray, shape (C, 3)
        Normal of the obstacle at a point of friction.
    shear : ndarray, shape (C, 3)
        Multiplier of a point of friction, N, across the normal, against the friction on the DLO.
    grip : float
        Stiffness of points of friction, N/m.
    """

    stiffness: float
    node: Floats
    element: Ints
    obstacle: Ints
    multiplier: Floats
    fraction: Floats
    anchor: Floats
    normal: Floats
    shear: Floats
    grip: float


@makes(Contacts)
@kernel
def _new_contacts(stiffness, node, element, obstacle, multiplier, fraction, anchor, normal, shear,
                  grip):
    return Contacts(stiffness, node, element, obstacle, multiplier, fraction, anchor, normal, shear,
                    grip)


class Contact(Record):
    """Obstacles and where they are touched.

    Attributes
    ----------
    scene : Scene
        The obstacles.
    contacts : Contacts
        Where they may be touched.
    """

    scene: Scene
    contacts: Contacts


@makes(Contact)
@kernel
def _new_contact(scene, contacts):
    return Contact(scene, contacts)


@kernel
def moved_scene(scene, shift):
    """Return the same Scene for a gripper displaced by shift (3,), m."""
    return Scene(scene.source, scene.kind, scene.axes, scene.center, scene.size, scene.friction,
                 scene.hole_of, scene.hole_center, scene.hole_axis, scene.hole_size, scene.radius,
                 scene.origin + shift, scene.feature, scene.offset, scene.rounding, scene.span,
                 scene.radii)


def obstructed(effect: Contact | None) -> bool:
    """Whether there are obstacles."""
    return effect is not None and effect.scene.kind.size > 0


def needs(effect: Contact) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    amid, beside = obstructed(effect), bool((effect.scene.feature != AXIS).any())
    return {'displaced': amid, 'attached': True, 'sprung': amid, 'beside': beside,
            'element': effect.contacts.element}


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
def noise(effect, system, state, length):
    """Return forces in N whose relative rounding errors those of contacts have."""
    if effect is None:
        return 0.0
    touching = False
    attached = state.attached
    for c in range(attached.element.size):
        for i in range(3):
            touching |= attached.force[c, i] != 0.0
    for k in range(attached.sprung.size):
        touching |= attached.sprung[k]
    if not touching:
        return 0.0
    far = np.sqrt(np.sum(effect.scene.origin**2))
    return (effect.contacts.stiffness + effect.contacts.grip) * (length + far)


@kernel
def blocks(effect, system, before, after):
    """Whether an obstacle is between two States."""
    if effect is None:
        return False
    if effect.scene.kind.size == 0:
        return False
    return passes_through(effect.scene, system.lengths, before.strains, before.rotations,
                          before.positions, after.rotations, after.positions)


@kernel
def acts(effect, system, strains, positions, before):
    """Whether an obstacle may be touched on the straight way between two places of a DLO.

    Each node is looked at as a ball that holds all of the section, and of the elements up to the
    middles of their lengths.

    Args:
        positions, before: (N + 1, 3) of the nodes, from the scene's origin, m
    """
    if effect is None:
        return False
    for o in range(effect.scene.kind.size):
        if _near(effect.scene, o, system.lengths, positions, before):
            return True
    return False


@kernel
def _near(scene, o, lengths, positions, before):
    """Whether body `o` may be touched, see `acts`."""
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
        if (scene.kind[o] == SHEET or gap + back <= 0.0) and not _clear_way(
                scene, o, x, shift, around, normal, hessian):
            return True
    return False


@kernel
def _clear_way(scene, o, x, shift, around, normal, hessian):
    """Whether a ball is told to stay away from body `o` on its way from x (3,) by `shift` (3,).

    From each point it goes on as far as it is away there.

    Args:
        around: radius of the ball, m; normal, hessian: scratch
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
def may_block(effect):
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
        if is_face(scene, o):
            continue
        offset[0], offset[1] = scene.offset[o, 0], scene.offset[o, 1]
        varies = scene.radii.shape[0] > 0
        radius = radius_at_node(scene, o, 0)
        begin, end = nodes_of(scene, o, lengths.size)
        longest = longest_stretch(scene, o, strains)
        node = max(1, begin)
        while node <= end:
            for i in range(3):
                x[i] = (scene.origin[i] + positions[node, i] + rotations[node, i, 1] * offset[0]
                        + rotations[node, i, 2] * offset[1])
            if varies:
                radius = radius_at_node(scene, o, node)
            gap = signed_distance(scene, o, x, normal, hessian) - radius
            force = contacts.node[o, node] - k * gap
            if force > 0.0:
                energy += 0.5 * force * force / k
                push_node(scene, o, node, force, k, rotations[node], offset, normal, hessian,
                          second,
                           pull, attached)
            energy -= 0.5 * contacts.node[o, node] ** 2 / k
            node = next_touching(lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        e, o = contacts.element[c], contacts.obstacle[c]
        attached.force[c] = 0.0
        attached.matrix[c] = 0.0
        if attached.moment.shape[0]:
            attached.moment[c] = 0.0
            attached.first[c] = 0.0
            attached.own[c] = 0.0
        if o < 0:
            attached.element[c] = e
            energy += add_friction(contacts, c, lengths, strains, rotations, positions, attached)
            continue
        gap, e, fraction = watched(scene, contacts, c, lengths, strains, rotations, positions,
                                   normal, hessian)
        attached.element[c], attached.fraction[c] = e, fraction
        point_inside(lengths, strains, rotations, positions, e, fraction, frame, x)
        force = contacts.multiplier[c] - k * gap
        if force > 0.0:
            energy += 0.5 * force * force / k
            if scene.feature[o] == AXIS:
                push(c, force, k, contacts.fraction[c] == 0.0, strains[e], frame, normal, hessian,
                     attached)
            else:
                gap_at(scene, o, frame, x, 0.0, offset, x.copy(), normal, hessian)
                push_beside(scene, o, c, force, k, contacts.fraction[c] == 0.0, strains[e],
                            frame, offset, normal, hessian, second, attached)
        energy -= 0.5 * contacts.multiplier[c] ** 2 / k
    sort_points(attached)
    return energy


@kernel
def next_touching(lengths, multiplier, node, gap):
    """Return the next node after `node` that may touch an obstacle, N + 1 if none does.

    No node is nearer to it by more than the DLO between them is long. Far obstacles cost nothing.

    Args:
        multiplier: (N + 1,) of the nodes; one that has some is never left out
        gap: m, of `node`, per length of what may touch along the DLO (`outline.longest_stretch`)
    """
    last = lengths.size
    distance = 0.0
    while node <= last:
        if node < last:
            distance += lengths[node]
        node += 1
        if distance >= gap or node <= last and multiplier[node] > 0.0:
            break
    return node
