# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The bodies that a step can meet: a DLO does not stretch, so it stays within its length.

Contacts of a search are arrays over all of its bodies. A cell has many that no DLO in this gripper
can reach; they are left out while the search lasts, and are there again in what it returns. Where a
DLO goes on bearing as it is moved a little, those are left out too that it would come near only if
it moved by more; whether it did is looked at when the search has ended.
"""

from typing import Any

import numpy as np

from dlo_planner.energy.contact import ContactSet
from dlo_planner.energy.gap import next_touching
from dlo_planner.energy.problem import Problem
from dlo_planner.energy.scene import Scene, signed_distance
from dlo_planner.geometry.record import replaced
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import with_contacts
from dlo_planner.model.arrays import Bools, Floats, Ints


@kernel
def bodies_in_reach(system: Problem, before: Floats) -> Ints:
    """Return (m,) the bodies that a DLO may meet whose nodes come from places `before`, ascending.

    Shapes: before (n, 6), places in m from the gripper, and tangents.
    """
    scene = system.effects.contact.scene
    reach = np.sum(system.lengths)
    for k in range(before.shape[0]):
        reach = max(reach, np.sqrt(np.sum(before[k, :3] ** 2)))
    found, count = np.empty(scene.kind.size, dtype=np.int64), 0
    normal, hessian = np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        thick = scene.radius + scene.rounding[o] + np.sqrt(np.sum(scene.offset[o] ** 2))
        if signed_distance(scene, o, scene.origin, normal, hessian) <= reach + thick:
            found[count] = o
            count += 1
    return found[:count].copy()


@kernel
def bodies_near(system: Problem, before: Floats, bodies: Ints, margin: float) -> Ints:
    """Return those of `bodies` (m,) that a DLO at places `before` is less than `margin` m from.

    Shapes: before (n, 6), of all nodes, m from the gripper, and tangents; none: all are returned.
    """
    if before.shape[0] != system.lengths.size + 1:
        return bodies
    scene = system.effects.contact.scene
    found, count, nobody = np.empty(bodies.size, np.int64), 0, np.zeros(before.shape[0])
    x, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    for o in bodies:
        # no point of an element is farther than half its length from one of its nodes
        around = (margin + scene.radius + scene.rounding[o] + 0.5 * np.max(system.lengths)
                  + np.sqrt(np.sum(scene.offset[o] ** 2)))
        k = 0
        while k < before.shape[0]:
            for i in range(3):
                x[i] = scene.origin[i] + before[k, i]
            gap = signed_distance(scene, o, x, normal, hessian) - around
            if gap <= 0.0:
                found[count] = o
                count += 1
                break
            k = next_touching(system.lengths, nobody, k, gap)
    return found[:count].copy()


@kernel
def stays_within(margin: float, before: Floats, positions: Floats) -> bool:
    """Whether no node has moved by more than `margin` m from places `before` (n, 6)."""
    for k in range(before.shape[0]):
        square = 0.0
        for i in range(3):
            square += (positions[k, i] - before[k, i]) ** 2
        if square > margin * margin:
            return False
    return True


@kernel
def points_on(system: Problem, bodies: Ints) -> Bools:
    """Return (C,) whether each point of contact is on one of the bodies (m,)."""
    obstacle = system.effects.contact.contacts.obstacle
    is_there = np.zeros(system.effects.contact.scene.kind.size, dtype=np.bool_)
    is_there[bodies] = True
    found = np.empty(obstacle.size, dtype=np.bool_)
    for c in range(obstacle.size):
        found[c] = is_there[obstacle[c] if obstacle[c] >= 0 else -1 - obstacle[c]]
    return found


@kernel
def with_bodies(system: Problem, bodies: Ints) -> Problem:
    """Return the Problem with some of its bodies (m,) alone, and their contacts."""
    old, stays = system.effects.contact.contacts, points_on(system, bodies)
    number = np.full(system.effects.contact.scene.kind.size, -1)
    number[bodies] = np.arange(bodies.size)
    obstacle = old.obstacle[stays]
    for c in range(obstacle.size):
        o = obstacle[c]
        obstacle[c] = number[o] if o >= 0 else -1 - number[-1 - o]
    contacts = ContactSet(old.stiffness, old.node[bodies], old.element[stays], obstacle,
                          old.multiplier[stays], old.fraction[stays], old.anchor[stays],
                          old.normal[stays], old.shear[stays], old.grip)
    return with_contacts(system, contacts, _part(system.effects.contact.scene, bodies, number))


@kernel
def _part(scene: Scene, bodies: Ints, number: Ints) -> Scene:
    """Return the Scene of some bodies; `number` (M,) is what each is there, -1: left out."""
    holes = np.flatnonzero(number[scene.hole_of] >= 0)
    # (in two calls: Python passes more than thirty arguments as a tuple, of which numba up to 0.62
    # does not see the names)
    some = replaced(
        scene, 'source', scene.source[bodies], 'kind', scene.kind[bodies],
        'axes', scene.axes[bodies], 'center', scene.center[bodies], 'size', scene.size[bodies],
        'friction', scene.friction[bodies], 'hole_of', number[scene.hole_of[holes]])
    return replaced(
        some, 'hole_center', scene.hole_center[holes], 'hole_axis', scene.hole_axis[holes],
        'hole_size', scene.hole_size[holes], 'feature', scene.feature[bodies],
        'offset', scene.offset[bodies], 'rounding', scene.rounding[bodies],
        'span', scene.span[bodies], 'inner', scene.inner[bodies], 'root', scene.root[bodies],
        'smooth', scene.smooth[bodies])


@kernel
def among_all(system: Problem, found: Problem, bodies: Ints) -> Problem:
    """Return the Problem `found`, of `bodies` (m,) alone, among all that `system` has."""
    contacts = found.effects.contact.contacts
    node = _spread_over(contacts.node, bodies, system.effects.contact.scene.kind.size)
    obstacle = _renumbered(contacts.obstacle, bodies)
    return with_contacts(found, replaced(contacts, 'node', node, 'obstacle', obstacle),
                         system.effects.contact.scene)


@kernel
def forces_among_all(forces: Any, bodies: Ints, count: int) -> Any:
    """Return what `forces_after` does of `bodies` (m,) alone, among all `count` that there are."""
    node, of, points = forces
    of[:, 1] = _renumbered(of[:, 1], bodies)
    return _spread_over(node, bodies, count), of, points


@kernel
def _spread_over(node, bodies, count):
    """Return (count, N + 1) forces on nodes, of which `node` (m, N + 1) has those of `bodies`."""
    result = np.zeros((count, node.shape[1]))
    for k in range(bodies.size):
        result[bodies[k]] = node[k]
    return result


@kernel
def _renumbered(obstacle, bodies):
    """Return (C,) the bodies of points, and of points of friction, by their numbers among all."""
    result = obstacle.copy()
    for c in range(result.size):
        o = result[c]
        result[c] = bodies[o] if o >= 0 else -1 - bodies[-1 - o]
    return result
