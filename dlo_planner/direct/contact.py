# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact with obstacles: what a DLO touches, and the forces that it leaves to the next step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_planner.energy.contact import trial_traction
from dlo_planner.energy.problem import Configuration, Problem
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import touching
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import figure, integer, results
from dlo_planner.model.value import Value, brief, freeze, put


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


def contacts_of(s: Floats, rows: Sequence[Floats | Ints], origin: Floats) -> tuple[Contact, ...]:
    """Return the Contacts, by arc length, of `contact_rows` on nodes s (N + 1,), m.

    Shapes: origin (3,) of the gripper, m.
    """
    found = [_made(obstacle=source, s=float(s[e]) + along, position=origin + x, normal=normal,
                   force=force, friction=friction, penetration=max(0.0, -gap))
             for source, e, along, x, normal, force, friction, gap in zip(
                 *(row.tolist() if row.ndim == 1 else row for row in rows), strict=True)]
    return tuple(sorted(found, key=lambda contact: contact.s))


def _made(**fields: Any) -> Contact:
    """Return a Contact of what a simulator has found: to judge it takes as long as to find it."""
    contact = Contact.__new__(Contact)
    freeze((fields['position'], fields['normal'], fields['friction']))
    put(contact, **fields)
    return contact


@kernel
def contact_rows(system: Problem, state: Configuration) -> Any:
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


@kernel
def forces_after(system: Problem, state: Configuration, origin: Floats, ended: bool) -> Any:
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
