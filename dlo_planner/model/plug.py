# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rigid body fixed to the tip of a DLO: a plug, a connector, a nut."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dlo_planner.deprecated import renamed_arguments
from dlo_planner.errors import InvalidRod
from dlo_planner.model.along import Extended
from dlo_planner.model.checks import instance, number
from dlo_planner.model.rod import Rod

_RIGID = 1e6  # times the rod's stiffness


@renamed_arguments(centre='center')
def with_plug(rod: Rod, length: float, mass: float, *, radius: float | None = None,
              center: float | None = None, inertia: float | None = None) -> Rod:
    """Return the Rod whose last part is a rigid body fixed to its tip.

    Arc length continues through the body, so that it takes part in everything: it has weight,
    thickness and inertia, it makes contact, and it goes through a hole first. It is a million times
    as stiff as the rod. Two point masses stand for it, with the right mass, center and inertia
    across; inertia about the axis is neglected, as for the rod.

    Parameters
    ----------
    rod : Rod
        The DLO without the body; its tip mass stays in its place.
    length : float
        Length of the body along the tangent, m.
    mass : float
        Mass in kg.
    radius : float, optional
        Radius in m. If None, as thick as the rod at its tip.
    center : float, optional
        Center of its mass, from where it begins, m. If None, in the middle.
    inertia : float, optional
        Inertia about an axis across through its center, kg m^2. If None, that of an even cylinder,
        or the largest that two points inside it can have, if that is less.

    Raises
    ------
    InvalidRod
        An argument makes no sense.
    """
    instance('rod', rod, Rod, InvalidRod)
    size = number('length', length, InvalidRod, above=0)
    mass = number('mass', mass, InvalidRod, minimum=0)
    center = 0.5 * size if center is None else number('center', center, InvalidRod, minimum=0,
                                                      maximum=size)
    if radius is not None:
        radius = number('radius', radius, InvalidRod, above=0)
        if rod.radius is None:
            raise InvalidRod('Rod.radius = None: expected the radius of the rod itself too')
        if rod.section is not None and rod.section.kind == 'rectangular':
            raise InvalidRod(f'radius = {radius:g}: expected None at a rectangular rod, which '
                             'touches with its section')
    begin, end = rod.length, rod.length + size
    arm = _arm(rod, size, mass, radius, center, inertia)
    places = (begin + center - arm, begin + center + arm)
    rigid = _RIGID * float(rod.stiffness.max())
    beyond: dict[str, Any] = {'mass_per_length': 0.0, 'bending_stiffness': (rigid, rigid),
              'torsional_stiffness': rigid, 'natural_curvature': (0.0, 0.0), 'natural_twist': 0.0}
    if radius is not None:
        beyond['radius'] = radius
    changed: dict[str, Any] = {name: Extended(getattr(rod, name), begin, value)
                               for name, value in beyond.items()}
    return replace(
        rod, length=end, tip_mass=0.0, nodes=(*rod.nodes, begin, *places),
        point_masses=(*rod.point_masses, (begin, rod.tip_mass),
                      *((min(s, end), 0.5 * mass) for s in places)), **changed)


def _arm(rod: Rod, size: float, mass: float, radius: float | None, center: float,
         inertia: float | None) -> float:
    """Return how far from the body's center, m, the two masses are that stand for it."""
    most = mass * min(center, size - center) ** 2
    if inertia is None:
        across = radius or (0.0 if rod.radius is None else rod.radii([rod.length])[0])
        inertia = min(mass * (3 * across**2 + size**2) / 12, most)
    else:
        inertia = number('inertia', inertia, InvalidRod, minimum=0, maximum=most)
    return float(np.sqrt(inertia / mass)) if mass else 0.0
