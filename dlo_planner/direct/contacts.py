# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO touches: what the kernels found, as `Contact` values."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.history import NO_POINTS
from dlo_planner.energy.contact import obstructed
from dlo_planner.energy.friction import trial_force
from dlo_planner.minimize.touching import touching
from dlo_planner.model.checks import integer
from dlo_planner.model.computed import figure, results
from dlo_planner.model.value import Value, brief, put
from dlo_planner.ritz.kinematics import point_inside


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


def contacts_of(discretization, system, state, gripper):
    """Return the Contacts (a tuple, by s) of a kernel's result."""
    if not obstructed(system.contact):
        return ()
    scene, contacts = system.scene, system.contacts
    table = touching(scene, contacts, system.lengths, state)
    rotation, x = np.empty((3, 3)), np.empty(3)
    found = []
    for a in range(table.gap.size):
        o, e, c = table.obstacle[a], table.element[a], table.rubbing[a]
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     table.fraction[a], rotation, x)
        s = discretization.s[e] + table.fraction[a] * system.lengths[e]
        found.append(Contact(
            int(scene.source[o]), float(s), gripper.position + x, table.normal[a].copy(),
            float(table.force[a]), np.zeros(3) if c < 0 else -state.attached.force[c],
            float(max(0.0, -table.gap[a]))))
    return tuple(sorted(found, key=lambda contact: contact.s))


def points_of(system, state, gripper, ended=True):
    """Return `History.points` of a kernel's result.

    What slid sticks from now on to where it has come to; `slid` tells by how much (C, 3), m.

    Parameters
    ----------
    ended
        Whether the step has ended; before, friction still counts from where it began.
    """
    if not obstructed(system.contact) or not system.contacts.element.size:
        return NO_POINTS
    contacts = system.contacts
    points = {'element': contacts.element, 'obstacle': contacts.obstacle,
              'multiplier': contacts.multiplier, 'fraction': contacts.fraction,
              'anchor': contacts.anchor + gripper.position, 'normal': contacts.normal,
              'shear': contacts.shear.copy(), 'slid': np.zeros_like(contacts.anchor)}
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for c in np.flatnonzero(contacts.obstacle < 0):
        points['shear'][c] = state.attached.force[c]
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        sticks = trial_force(contacts, c, x, trial) <= contacts.multiplier[c]
        away = x - contacts.anchor[c]
        if sticks:
            away = (away @ contacts.normal[c]) * contacts.normal[c]
        if ended:
            points['anchor'][c] += away
            points['slid'][c] = away
    return points


def left_by_contacts(system, state, gripper, history):
    """Return `History.node_force` and `points` of a kernel's result after `history`."""
    if not obstructed(system.contact):
        return history.node_force, NO_POINTS
    return system.contacts.node, points_of(system, state, gripper)


def left_by_hold(system):
    """Return `History.hold` of a kernel's result."""
    return np.zeros(0) if system.hold is None else system.hold.multiplier
