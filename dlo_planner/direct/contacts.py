"""Where a DLO touches: what the kernels found, as `Contact` values."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.history import NO_POINTS
from dlo_planner.energy.contact import nearest_inside
from dlo_planner.energy.outline import node_gap
from dlo_planner.model.checks import figure, integer, results
from dlo_planner.model.value import Value, brief, put
from dlo_planner.ritz.kinematics import point_inside


@dataclass(frozen=True, eq=False, repr=False)
class Contact(Value):
    """One place where a DLO touches an obstacle; each edge of a rectangular one by itself.

    Attributes:
        obstacle: index of the obstacle in the simulator's `obstacles`
        s: arc length of the place, m
        position: (3,) of the DLO's axis there, m, world
        normal: (3,) unit vector from the obstacle to the DLO
        force: N, along the normal, on the DLO, > 0
        friction: (3,) N, on the DLO, across the normal
        penetration: m, how far the DLO's surface is inside the obstacle, >= 0
    """

    obstacle: int
    s: float
    position: np.ndarray
    normal: np.ndarray
    force: float
    friction: np.ndarray
    penetration: float

    def __post_init__(self):
        put(self, obstacle=integer('Contact.obstacle', self.obstacle, minimum=0, maximum=2**31),
            **{name: figure(f'Contact.{name}', getattr(self, name))
               for name in ('s', 'force', 'penetration')},
            **{name: results(f'Contact.{name}', getattr(self, name), (3,))
               for name in ('position', 'normal', 'friction')})
        super().__post_init__()

    def __repr__(self):
        return brief(self, f'obstacle {self.obstacle}', f's {self.s:.4g} m',
                     f'force {self.force:.3g} N', f'penetration {self.penetration:.2g} m')

    @property
    def vector(self) -> np.ndarray:
        """(3,) N, the whole force on the DLO."""
        return self.force * self.normal + self.friction


def contacts_of(discretisation, system, state, gripper):
    """Return the Contacts (a tuple, by s) of a kernel's result."""
    scene, contacts = system.scene, system.contacts
    if not scene.kind.size:
        return ()
    normal, bend = np.empty(3), np.empty((3, 3))
    rubbing = {}
    for c in np.flatnonzero(contacts.obstacle < 0):
        where = contacts.element[c] + contacts.fraction[c]
        rubbing[where] = rubbing.get(where, 0) - state.attached.force[c]
    found = []

    def add(o, where, force, gap, x):
        friction = np.zeros(3)
        if rubbing and scene.friction[o]:
            near = min(rubbing, key=lambda other: abs(other - where))
            if abs(near - where) < 1e-3:
                friction = np.array(rubbing.pop(near))
        e = min(int(where), system.lengths.size - 1)
        s = discretisation.s[e] + (where - e) * system.lengths[e]
        found.append(Contact(int(scene.source[o]), float(s), x, normal.copy(), float(force),
                             friction, float(max(0.0, -gap))))

    for o, node in zip(*np.nonzero(contacts.node > 0), strict=True):
        gap = node_gap(scene, o, node, state.rotations, state.positions, np.zeros(2), np.empty(3),
                       normal, bend)
        force = contacts.node[o, node] - contacts.stiffness * gap
        if force > 0:
            add(o, float(node), force, gap, gripper.position + state.positions[node])
    rotation, x = np.empty((3, 3)), np.empty(3)
    for c in np.flatnonzero(contacts.obstacle >= 0):
        o, e = contacts.obstacle[c], contacts.element[c]
        gap, fraction = nearest_inside(scene, o, e, system.lengths, state.strains,
                                       state.rotations, state.positions, normal, bend)
        force = float(np.linalg.norm(state.attached.force[c]))
        if force > 0:
            point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                         fraction, rotation, x)
            add(o, e + fraction, force, gap, gripper.position + x)
    return tuple(sorted(found, key=lambda contact: contact.s))


def points_of(system, state, gripper):
    """Return `History.points` of a kernel's result.

    The anchors of points that slid follow them, up to what friction can hold.
    """
    contacts = system.contacts
    if not contacts.element.size:
        return NO_POINTS
    points = {'element': contacts.element, 'obstacle': contacts.obstacle,
              'multiplier': contacts.multiplier, 'fraction': contacts.fraction,
              'anchor': contacts.anchor + gripper.position, 'normal': contacts.normal}
    rotation, x = np.empty((3, 3)), np.empty(3)
    for c in np.flatnonzero(contacts.obstacle < 0):
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        stretch = x + gripper.position - points['anchor'][c]
        stretch -= (stretch @ contacts.normal[c]) * contacts.normal[c]
        size = np.linalg.norm(stretch)
        longest = contacts.multiplier[c] / contacts.grip
        if size > longest:
            points['anchor'][c] += (1 - longest / size) * stretch
        points['anchor'][c] += ((x + gripper.position - points['anchor'][c])
                                @ contacts.normal[c]) * contacts.normal[c]
    return points
