# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A part of a DLO as a DLO of its own."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from dlo_planner.model.along import SeenFrom
from dlo_planner.model.point_load import PointLoad
from dlo_planner.model.rod import Rod

_NEAR = 0.05  # of the length: a load so near to the end is one at the end

BACK = np.array([1.0, -1.0, 1.0])  # strains, seen along the DLO in the other direction


def before(rod: Rod, end: float) -> Rod:
    """Return the Rod from 0 to `end` (m), without what is fixed to it beyond."""
    return replace(rod, length=end, tip_mass=rod.tip_mass if end == rod.length else 0.0,
                   nodes=tuple(s for s in rod.nodes if s <= end),
                   point_masses=tuple((s, mass) for s, mass in rod.point_masses if s <= end))


def of_length(rod: Rod, length: float) -> Rod:
    """Return a Rod of another length (m); what is fixed at the end or beyond it goes to the end."""
    end = min(rod.length, length)

    def there(s: float) -> float:
        return length if s >= end else s
    return replace(rod, length=length, nodes=tuple(there(s) for s in rod.nodes),
                   point_masses=tuple((there(s), mass) for s, mass in rod.point_masses))


def loads_of_length(loads: Iterable[PointLoad], rod: Rod, length: float) -> tuple[PointLoad, ...]:
    """Return the PointLoads of a Rod as one of another length (m) has them.

    What acts near the end and would be beyond it goes to the end, as in `of_length`.
    """
    end, near = min(rod.length, length), (1 - _NEAR) * rod.length
    return tuple(one if one.s is None or one.s < max(end, near) else replace(one, s=length)
                 for one in loads)


def part_of_loads(loads: Iterable[PointLoad], rod: Rod, at: float,
                  direction: int) -> tuple[PointLoad, ...]:
    """Return the PointLoads of `part_of_rod`, as that part knows them."""
    places = [(rod.length if one.s is None else one.s, one) for one in loads]
    return tuple(replace(one, s=abs(s - at)) for s, one in places
                 if (s - at) * direction > 0 or s == at and direction > 0)


def part_of_rod(rod: Rod, at: float, direction: int) -> Rod:
    """Return the Rod from `at` to one end: way = 1 on to L, -1 back to 0."""
    length = at if direction < 0 else rod.length - at
    masses = []
    for s, mass in rod.point_masses:
        if (s - at) * direction > 0 or (s == at and direction > 0):
            masses.append((abs(s - at), mass))
    signs = tuple(BACK[1:]) if direction < 0 else (1.0, 1.0)
    curvature = rod.natural_curvature
    changed: dict[str, Any] = {name: SeenFrom(getattr(rod, name), at, direction)
               for name in ('mass_per_length', 'natural_twist', 'bending_stiffness',
                            'torsional_stiffness', 'radius') if callable(getattr(rod, name))}
    nodes = tuple(abs(s - at) for s in rod.nodes if (s - at) * direction > 0)
    return replace(rod, length=length, point_masses=tuple(masses), nodes=nodes,
                   tip_mass=rod.tip_mass if direction > 0 else 0.0,
                   natural_curvature=SeenFrom(curvature, at, direction, signs)
                   if callable(curvature) else tuple(np.array(signs) * curvature), **changed)
