# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact with obstacles: what a DLO touches, and the forces that it leaves to the next step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.direct.terms import Held, Left, Part, Solved, filed
from dlo_planner.energy.contact import (
    Contact as ContactTerm,
)
from dlo_planner.energy.contact import (
    ContactSet,
    obstructed,
    trial_traction,
)
from dlo_planner.energy.gap import penetration_of_point
from dlo_planner.energy.problem import Configuration as KernelState
from dlo_planner.energy.problem import Problem, with_gripper
from dlo_planner.energy.scene import Scene, build_scene, translated
from dlo_planner.energy.terms import potential, stored
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import touching, with_contacts
from dlo_planner.minimize.convergence import gradient_noise
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import figure, integer, results
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import Value, brief, freeze, put

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization

@dataclass(frozen=True, eq=False, repr=False)
class Contact(Value):
    """One place where a DLO touches an obstacle.

    Attributes
    ----------
    obstacle : int
        Index of the obstacle in the simulator's `obstacles`.
    s : float
        Arc length of the place, m.
    position : ndarray, shape (3,)
        Point of the DLO's axis there, m, world.
    normal : ndarray, shape (3,)
        Unit vector from the obstacle to the DLO.
    force : float
        Force in N, along the normal, on the DLO, > 0.
    friction : ndarray, shape (3,)
        Friction in N, on the DLO, across the normal.
    penetration : float
        Depth of the DLO's surface in the obstacle, m, >= 0.
    """

    obstacle: int
    s: float
    position: np.ndarray
    normal: np.ndarray
    force: float
    friction: np.ndarray
    penetration: float

    def __post_init__(self) -> None:
        put(self, obstacle=integer('Contact.obstacle', self.obstacle, minimum=0, maximum=2**31),
            **{name: figure(f'Contact.{name}', getattr(self, name))
               for name in ('s', 'force', 'penetration')},
            **{name: results(f'Contact.{name}', getattr(self, name), (3,))
               for name in ('position', 'normal', 'friction')})
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f'obstacle {self.obstacle}', f's {self.s:.4g} m',
                     f'force {self.force:.3g} N', f'penetration {self.penetration:.2g} m')

    @property
    def vector(self) -> np.ndarray:
        """(3,) N, the whole force on the DLO."""
        result: np.ndarray = self.force * self.normal + self.friction
        return result


def contacts_of(discretization: Discretization, system: Problem, state: KernelState,
                gripper: Pose) -> tuple[Contact, ...]:
    """Return the ContactSet (a tuple, by s) of a kernel's result."""
    if not discretization.obstructed:
        return ()
    return contacts_in(discretization, contact_rows(system, state), gripper.position)


def contacts_in(mesh: Discretization, rows: Sequence[Floats | Ints],
                origin: Floats) -> tuple[Contact, ...]:
    """Return the ContactSet (a tuple, by s) of `contact_rows`, the gripper at `origin` (3,), m."""
    found = [_contact(obstacle=source, s=float(mesh.s[e]) + along, position=origin + x,
                      normal=normal, force=force, friction=friction, penetration=max(0.0, -gap))
             for source, e, along, x, normal, force, friction, gap in zip(
                 *(row.tolist() if row.ndim == 1 else row for row in rows), strict=True)]
    return tuple(sorted(found, key=lambda contact: contact.s))


def _contact(**fields: Any) -> Contact:
    """Return the Contact that a simulator makes: quicker, nothing is to be judged."""
    contact = object.__new__(Contact)
    freeze((fields['position'], fields['normal'], fields['friction']))
    put(contact, **fields)
    return contact


@kernel
def contact_rows(system: Problem, state: KernelState) -> Any:
    """Return of A contacts: obstacle, element, m along it, place, normal, force, friction, gap.

    Places (A, 3) are relative to the gripper; friction (A, 3) is that on the DLO.
    """
    scene, lengths = system.effects.contact.scene, system.lengths
    table = touching(scene, system.effects.contact.contacts, lengths, state)
    count = table.gap.size
    along, places, friction = np.empty(count), np.empty((count, 3)), np.zeros((count, 3))
    rotation = np.empty((3, 3))
    for a in range(count):
        e = table.element[a]
        along[a] = table.fraction[a] * lengths[e]
        point_inside(lengths, state.strains, state.rotations, state.positions, e,
                     table.fraction[a], rotation, places[a])
        if table.rubbing[a] >= 0:
            friction[a] -= state.attached.force[table.rubbing[a]]
    return (scene.source[table.obstacle], table.element, along, places, table.normal, table.force,
            friction, table.gap)


_SAME_NODE = 1e-12   # of the length: nodes of two meshes that are one
_POINT = 'point_'
_OF_CONTACTS = ('element', 'obstacle', 'multiplier', 'fraction', 'anchor', 'normal', 'shear')
NO_POINTS = {'element': np.zeros(0, dtype=np.int64), 'obstacle': np.zeros(0, dtype=np.int64),
             'multiplier': np.zeros(0), 'fraction': np.zeros(0), 'anchor': np.zeros((0, 3)),
             'normal': np.zeros((0, 3)), 'shear': np.zeros((0, 3)), 'slid': np.zeros((0, 3))}
freeze(NO_POINTS)


class Touch(Part):
    """Contact with friction, `energy.contact`. It leaves two kinds of things.

    node_force: (M, N + 1) force of each body on each node, N
    point_...: contacts inside elements and points of friction, world frame, see `ContactSet`; and
        point_slid: (C, 3) by how much they slid in the step, m
    """

    name = 'contact'
    lets_go = True
    rests = True

    def acts(self, around: Surroundings) -> bool:
        """Whether there are obstacles."""
        return bool(around.obstacles)

    def given(self, mesh: Discretization) -> Scene:
        """Return the Scene, for a gripper at the origin."""
        scene: Scene = build_scene(mesh.surroundings.obstacles, Surface.of(mesh.rod), mesh.s)
        return scene

    def record(self, mesh: Discretization, left: Left, held: Held) -> ContactTerm:
        """Return the Contact with the forces that are left, relative to the gripper."""
        origin = np.zeros(3) if held.origin is None else held.origin
        spring = mesh.spring if held.far_end is None else mesh.held_spring
        points = {name: values.copy() for name, values in _points(left).items()}
        points['anchor'] -= origin
        return ContactTerm(mesh.given(self.name)._replace(origin=origin), ContactSet(
            spring, left['node_force'].copy(), points['element'], points['obstacle'],
            points['multiplier'], points['fraction'], points['anchor'], points['normal'],
            points['shear'], spring))

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether there are obstacles around a gripper that is somewhere."""
        return held.origin is not None and mesh.obstructed

    def placed(self, mesh: Discretization, base: Floats, left: Left, held: Held) -> Problem | None:
        """Return the Problem by one kernel, where the far end is free."""
        if held.far_end is not None or held.origin is None:
            return None
        system: Problem = standing(mesh.static, base, held.origin, mesh.spring, left['node_force'],
                                   *(left[_POINT + name] for name in _OF_CONTACTS))
        return system

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return no forces."""
        bodies = mesh.given(self.name).kind.size if mesh.obstructed else 0
        return {'node_force': np.zeros((bodies, s.size)), **_NO_POINTS}

    def judged(self, left: Left, nodes: int) -> Left:
        """Return the forces, with elements and obstacles that there are."""
        bodies, points = len(left.get('node_force', ())), np.size(left.get('point_element', ()))
        limits = {'element': (0, nodes - 2), 'obstacle': (-bodies, bodies - 1), 'fraction': (0, 1)}
        known = {}
        for name, none in NO_POINTS.items():
            low, high = limits.get(name, (-np.inf, np.inf))
            known[_POINT + name] = filed(left, _POINT + name, (points, *none.shape[1:]),
                                         kind=int if none.dtype.kind == 'i' else float,
                                         lowest=low, highest=high)
        return {'node_force': filed(left, 'node_force', (bodies, nodes)), **known}

    def resampled(self, left: Left, s: Floats, wanted: Floats) -> Left:
        """Return forces where a node stays, and inside elements."""
        if not len(left['node_force']):  # nothing is in the way
            return {'node_force': np.zeros((0, wanted.size)), **_NO_POINTS}
        same = np.abs(s[:, None] - wanted) < _SAME_NODE * wanted[-1]
        return {'node_force': left['node_force'] @ same, **_left(_points_on(left, s, wanted))}

    def fits(self, left: Left, start: Left) -> bool:
        """Whether there are as many bodies."""
        return len(left['node_force']) == len(start['node_force'])

    def cleared(self, left: Left) -> Left:
        """Return no forces on as many bodies."""
        return {'node_force': np.zeros_like(left['node_force']), **_NO_POINTS}

    def idle(self, left: Left) -> bool:
        """Whether there are no forces, and no points."""
        return not left['point_element'].size and not left['node_force'].any()

    def leaves(self, solved: Solved) -> Left:
        """Return the forces; what slid sticks from now on to where it has come to."""
        return _forces(solved, True)

    def underway(self, solved: Solved) -> Left:
        """Return the forces; friction still counts from where the step began."""
        return _forces(solved, False)

    def with_contacts(self, before: Left, after: Left) -> Left:
        """Return the forces after the step; what slid in it slides, its anchors those of before."""
        points = _points(after)
        points['anchor'] = points['anchor'] - points['slid']
        return {'node_force': after['node_force'], **_left(points)}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return the contacts."""
        return {'contacts': contacts_of(solved.mesh, solved.system, solved.state, solved.gripper)}

    def violation(self, solved: Solved) -> float:
        """Return how deep the gripper holds the axis in an obstacle: no force can push it out.

        The surface beside it may reach into one, as where a thick DLO leaves a thin gripper.
        """
        if not solved.mesh.obstructed:
            return 0.0
        return float(penetration_of_point(solved.mesh.given(self.name),
                                          np.array(solved.gripper.position)))

    def constrains(self, system: Problem) -> bool:
        """Whether there are obstacles."""
        return obstructed(system.contact)


def _points(left: Left) -> dict[str, Any]:
    """Return the points of what is left, by the names of `ContactSet`."""
    return {name: left[_POINT + name] for name in NO_POINTS}


def _left(points: Left) -> dict[str, Any]:
    """Return points as they are left."""
    return {_POINT + name: values for name, values in points.items()}


_NO_POINTS = _left(NO_POINTS)


def _forces(solved: Solved, ended: bool) -> Left:
    """Return what a step leaves, or, if it has not `ended`, a part of it."""
    if not solved.mesh.obstructed:
        return {'node_force': solved.left['node_force'], **_NO_POINTS}
    return left_of(forces_after(solved.system, solved.state, np.array(solved.gripper.position),
                                 ended))


def left_of(forces: Sequence[Any]) -> Left:
    """Return what `forces_after` tells, as it is left."""
    node, *points = forces
    if not points[0].size:
        return {'node_force': node, **_NO_POINTS}
    return {'node_force': node, **_left(dict(zip(NO_POINTS, points, strict=True)))}


def forces_left(left: Left) -> list[Any]:
    """Return the arrays that `standing` and `halved` take of what is left, in their order."""
    return [left['node_force'], *(left[_POINT + name] for name in NO_POINTS)]


def friction_work(left: Left) -> float:
    """Return the work in J of friction in the step that left it, with the forces at its end."""
    rubs = left[_POINT + 'obstacle'] < 0
    force, way = left[_POINT + 'shear'][rubs], left[_POINT + 'slid'][rubs]
    return float(np.abs(np.sum(force * way, axis=1)).sum())


@kernel
def standing(system: Problem, base: Floats, origin: Floats, spring: float, node: Floats,
              element: Ints, obstacle: Ints, multiplier: Floats, fraction: Floats, anchor: Floats,
              normal: Floats, shear: Floats) -> Any:
    """Return the same Problem in another gripper, with ContactSet of read-only arrays."""
    held = with_contacts(system, ContactSet(
        spring, node.copy(), element.copy(), obstacle.copy(), multiplier.copy(), fraction.copy(),
        anchor - origin, normal.copy(), shear.copy(), spring),
        translated(system.effects.contact.scene, origin))
    return with_gripper(held, base, origin)


@kernel
def halved(system: Problem, base: Floats, origin: Floats, spring: float, node: Floats,
            element: Ints, obstacle: Ints, multiplier: Floats, fraction: Floats, anchor: Floats,
            normal: Floats, shear: Floats, slid: Floats) -> Any:
    """Return what `standing` does, with halved elements; slid: (C, 3) by how much points slid.

    What slid slides: its anchors are those of before. Of a DLO that does not yield and hangs free
    of other grips.
    """
    bodies, nodes = node.shape
    force, places, fractions = np.zeros((bodies, 2 * nodes - 1)), 2 * element, fraction.copy()
    for o in range(bodies):
        for k in range(nodes):
            force[o, 2 * k] = node[o, k]
    for c in range(element.size):
        if obstacle[c] < 0:
            beyond = 1 if fraction[c] > 0.5 else 0
            places[c] += beyond
            fractions[c] = 2.0 * fraction[c] - beyond
    return standing(system, base, origin, spring, force, places, obstacle, multiplier, fractions,
                    anchor - slid, normal, shear)


def _points_on(left: Left, old: Floats, s: Floats) -> Left:
    """Return the points on other nodes."""
    points = _points(left)
    if not points['element'].size:
        return points
    element, fraction = points['element'], points['fraction']
    inside = points['obstacle'] >= 0  # anywhere in the element: its middle
    fraction = np.where(inside, 0.5, fraction)
    at = old[element] + fraction * np.diff(old)[element]
    tiny = _SAME_NODE * s[-1]
    element = np.clip(np.searchsorted(s, at - tiny) - 1, 0, s.size - 2)
    fraction = (at - s[element]) / np.diff(s)[element]
    fraction = np.where(np.abs(at - s[element + 1]) < tiny, 1.0, np.clip(fraction, 0.0, 1.0))
    fraction = np.where(inside, points['fraction'], fraction)  # fixed, or 0: it rolls
    return points | {'element': element, 'fraction': fraction}


@kernel
def forces_after(system: Problem, state: KernelState, origin: Floats, ended: bool) -> Any:
    """Return the forces on nodes (M, N + 1), N, and the points inside elements and of friction.

    What slid sticks from now on to where it has come to; the last array (C, 3) tells by how much.

    Args:
        origin: (3,) the gripper's position, m
        ended: whether the step has; before, friction still counts from where it began
    """
    contacts = system.effects.contact.contacts
    anchor, shear, slid = contacts.anchor + origin, contacts.shear.copy(), np.zeros_like(
        contacts.anchor)
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            continue
        shear[c] = state.attached.force[c]
        if not ended:
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        sticks = trial_traction(contacts, c, x, trial) <= contacts.multiplier[c]
        out = 0.0
        for i in range(3):
            out += (x[i] - contacts.anchor[c, i]) * contacts.normal[c, i]
        for i in range(3):
            away = x[i] - contacts.anchor[c, i]
            slid[c, i] = out * contacts.normal[c, i] if sticks else away
            anchor[c, i] += slid[c, i]
    return (contacts.node, contacts.element, contacts.obstacle, contacts.multiplier,
            contacts.fraction, anchor, contacts.normal, shear, slid)


@kernel
def ended(system: Problem, state: KernelState, origin: Floats) -> Any:
    """Return all that a Shape and its past take from a step that has ended, in plain arrays.

    Args:
        origin: (3,) the gripper's position, m
    """
    n = system.lengths.size
    positions, tangents, wrench = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty(6)
    for k in range(n + 1):
        for i in range(3):
            positions[k, i] = origin[i] + state.positions[k, i]
            tangents[k, i] = state.rotations[k, i, 0]
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    elastic = stored(system.effects, system, state.strains)
    energy = elastic + potential(system.effects, system, positions)
    return ((state.strains, state.rotations, positions, tangents, wrench, elastic, energy,
             gradient_noise(system, state)),
            forces_after(system, state, origin, n > 0), contact_rows(system, state))
