# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO touches: what the kernels found, as `Contact` values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.energy.system import State, System
from dlo_planner.kernels import kernel
from dlo_planner.minimize.touching import touching
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import integer
from dlo_planner.model.computed import figure, results
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, freeze, put
from dlo_planner.ritz.kinematics import point_inside

if TYPE_CHECKING:  # it imports this file
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


def contacts_of(discretization: Discretization, system: System, state: State,
                gripper: Pose) -> tuple[Contact, ...]:
    """Return the Contacts (a tuple, by s) of a kernel's result."""
    if not discretization.obstructed:
        return ()
    return contacts_in(discretization, contact_rows(system, state), gripper.position)


def contacts_in(mesh: Discretization, rows: Sequence[Floats | Ints],
                origin: Floats) -> tuple[Contact, ...]:
    """Return the Contacts (a tuple, by s) of `contact_rows`, the gripper at `origin` (3,), m."""
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
def contact_rows(system: System, state: State) -> Any:
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
