# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of a DLO and its gripper, and DLOs drawn from it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, of_length
from dlo_planner.model.value import Value, put
from dlo_planner.model.varying import Along, Expanded, Shifted, scaled


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Value):
    """Standard deviations of uncertain quantities, all independent and normal.

    Attributes
    ----------
    bending_stiffness : float
        Relative deviation of EI_n and EI_b alike.
    torsional_stiffness : float
        Relative deviation of GJ.
    mass : float
        Relative deviation of all masses alike.
    length : float
        Deviation in m of the length beyond the gripper.
    natural_curvature : float
        Deviation in 1/m of each of its two components, the same all along.
    gripper_position : float
        Deviation in m along each axis.
    gripper_rotation : float
        Deviation in rad about each axis; constant during a plan, as a calibration is.
    curvature_variation : float
        Deviation in 1/m of each of the natural curvature's two components about its
        mean, as root mean square along the DLO: Legendre polynomials P_1, P_2, ..., the higher the
        less, see `variation_deviations`.
    """

    bending_stiffness: float = 0.0
    torsional_stiffness: float = 0.0
    mass: float = 0.0
    length: float = 0.0
    natural_curvature: float = 0.0
    gripper_position: float = 0.0
    gripper_rotation: float = 0.0
    curvature_variation: float = 0.0

    def __post_init__(self) -> None:
        put(self, **{name: number(f'Uncertainty.{name}', getattr(self, name), minimum=0)
                     for name in CAUSES})
        super().__post_init__()


CAUSES = tuple(field.name for field in fields(Uncertainty))
# one number of a standard normal distribution for each, three or two for some
VARIATION = 5  # Legendre polynomials by which the natural curvature varies
DRAWN = tuple(name for name in CAUSES for _ in range(
    {'natural_curvature': 2, 'curvature_variation': 2 * VARIATION, 'gripper_position': 3,
     'gripper_rotation': 3}.get(name, 1)))


def variation_deviations(count: int) -> Floats:
    """Return (count,): standard deviations of the coefficients of P_1 ... P_count.

    Of a variation whose mean square along the DLO is 1: P_j has the mean square 1 / (2 j + 1), and
    its part of the whole falls like 1 / j^2, as in a curve whose slope is bounded.
    """
    j = np.arange(1, count + 1)
    return np.sqrt((2 * j + 1) / j**2 / np.sum(1 / j**2)) if count else np.zeros(0)


def varied(rod: Rod, uncertainty: Uncertainty, draw: Floats) -> Rod:
    """Return the Rod that (k,) draws stand for; `rod` itself if they leave it alone."""
    by = {name: [d * getattr(uncertainty, name) for d, drawn in zip(draw, DRAWN, strict=True)
                 if drawn == name] for name in CAUSES}
    if not any(np.any(by[name]) for name in CAUSES if not name.startswith('gripper')):
        return rod
    # exp: relative deviations, which never make a stiffness negative
    bend, twist, mass = (float(np.exp(by[name][0])) for name in (
        'bending_stiffness', 'torsional_stiffness', 'mass'))
    length = rod.length + by['length'][0]
    known = rod.natural_curvature
    curve = np.array(by['natural_curvature'])
    natural: Along = Shifted(known, curve) if callable(known) else tuple(curve + known)
    if uncertainty.curvature_variation:
        terms = np.reshape(by['curvature_variation'], (VARIATION, 2))
        terms = terms * variation_deviations(VARIATION)[:, None]
        natural = Expanded(natural, np.vstack([np.zeros(2), terms]), length)
    longer = of_length(rod, length)
    return replace(
        longer, bending_stiffness=scaled(rod.bending_stiffness, bend),
        torsional_stiffness=scaled(rod.torsional_stiffness, twist),
        mass_per_length=scaled(rod.mass_per_length, mass),
        tip_mass=mass * rod.tip_mass,
        point_masses=tuple((s, mass * m) for s, m in longer.point_masses),
        natural_curvature=natural)


def twist(gripper: Pose, uncertainty: Uncertainty, draw: Floats) -> Floats:
    """Return the gripper's deviation (6,), rotation before displacement, world axes."""
    turn, shift = (np.array([d * getattr(uncertainty, name) for d, drawn in zip(
        draw, DRAWN, strict=True) if drawn == name])
        for name in ('gripper_rotation', 'gripper_position'))
    return np.concatenate([gripper.rotation @ turn, gripper.rotation @ shift])
