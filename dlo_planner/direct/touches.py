# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO bears on: its contacts together, obstacle by obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import figure, instance, integer, results
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.value import Value, brief, put

_AT_LIMIT = 1e-3  # of the limit of friction: so near to it a contact slips


@dataclass(frozen=True, eq=False, repr=False)
class Touch(Value):
    """What a DLO has to do with one obstacle that it touches.

    Attributes
    ----------
    obstacle : int
        Index of the obstacle in the simulator's `obstacles`.
    name : str
        Its name, or 'obstacle 2' of one without.
    force : ndarray, shape (3,)
        Force of the obstacle on the DLO, N, world.
    pressed : float
        Sum of the forces of all its contacts along their normals, N.
    length : float
        Length of the DLO that lies on it, m: between neighboring contacts, where the DLO lifts off
        by less than its radius in between.
    contacts : int
        Number of contacts.
    slipping : int
        Number of those whose friction is at its limit; none where there is no friction.
    """

    obstacle: int
    name: str
    force: Floats
    pressed: float
    length: float
    contacts: int
    slipping: int

    def __post_init__(self) -> None:
        instance('Touch.name', self.name, str)
        put(self, force=results('Touch.force', self.force, (3,)),
            **{name: figure(f'Touch.{name}', getattr(self, name))
               for name in ('pressed', 'length')},
            **{name: integer(f'Touch.{name}', getattr(self, name), minimum=0, maximum=2**31)
               for name in ('obstacle', 'contacts', 'slipping')})
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, str(self), f'pressed by {self.pressed:.3g} N')

    def __str__(self) -> str:
        """Say it in a line: 'lies on table over 0.43 m, 2 of 5 contacts slip'."""
        where = (f'lies on {self.name} over {self.length:.3g} m' if self.length > 0
                 else f'touches {self.name}')
        if not self.slipping:
            return where
        if self.contacts == 1:
            return f'{where} and slips'
        return f'{where}, {self.slipping} of {self.contacts} contacts slip'


def touches_of(contacts: Sequence[Any], obstacles: Sequence[Obstacle], s: Floats,
               positions: Floats, radius: float) -> tuple[Touch, ...]:
    """Return a Touch for each obstacle that Contacts, ascending along s, are with; in their order.

    Shapes: s (N + 1,) and positions (N + 1, 3) of the nodes, m.
    """
    found = []
    for index in sorted({one.obstacle for one in contacts}):
        its = [one for one in contacts if one.obstacle == index]
        body = obstacles[index]
        slipping = sum(np.linalg.norm(one.friction) >= (1 - _AT_LIMIT) * body.friction * one.force
                       for one in its) if body.friction else 0
        length = sum(other.s - one.s for one, other in zip(its, its[1:], strict=False)
                     if _rests(one, other, s, positions, radius))
        found.append(Touch(index, body.name or f'obstacle {index}',
                           np.sum([one.vector for one in its], axis=0),
                           sum(one.force for one in its), length, len(its), int(slipping)))
    return tuple(found)


def _rests(one: Any, other: Any, s: Floats, positions: Floats, radius: float) -> bool:
    """Whether all nodes between two contacts are less than `radius` (m) off what both touch."""
    between = positions[(s > one.s) & (s < other.s)]
    heights = [(between - contact.position) @ contact.normal for contact in (one, other)]
    return bool((np.minimum(*heights) < radius).all())
