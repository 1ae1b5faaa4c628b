# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact with obstacles: what a DLO touches, and the forces that it leaves to the next step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
    source, element, along, places, normals, forces, frictions, gaps = rows
    at = s[element] + along
    order = np.argsort(at, kind='stable')
    vectors = (places + origin)[order], normals[order], frictions[order]
    freeze(vectors)  # so are their rows
    found = []
    for obstacle, where, force, depth, position, normal, friction in zip(
            source[order].tolist(), at[order].tolist(), forces[order].tolist(),
            np.maximum(-gaps[order], 0.0).tolist(), *vectors, strict=True):
        contact = Contact.__new__(Contact)  # to judge it takes as long as to find it
        put(contact, obstacle=obstacle, s=where, position=position, normal=normal, force=force,
            friction=friction, penetration=depth)
        found.append(contact)
    return tuple(found)
