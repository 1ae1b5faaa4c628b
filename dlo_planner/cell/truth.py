# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The true properties of the cell, which the planner does not know."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, number, vector
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, put

_SHEETS = 3  # of a task, at most: each is elsewhere by itself


@dataclass(frozen=True, eq=False, repr=False)
class Truth(Value):
    """How the true DLO, gripper and sheet differ from what the planner assumes."""

    bending_stiffness: float = 1.0  # factor of EI_n and EI_b
    torsional_stiffness: float = 1.0  # factor of GJ
    mass: float = 1.0  # factor of all masses
    # part of its mean by which the mass per length grows from s = 0 to the free end; the mean stays
    mass_gradient: float = 0.0
    # (2, k) in 1/m, about n and about b: coefficients of Legendre polynomials of 2 s / L - 1, added
    # to the rod's own
    natural_curvature: Floats = ((0.0,), (0.0,))  # type: ignore[assignment]
    length: float = 0.0  # length in m, added at the free end
    # (3,) gripper shift in m, from the commanded to the true place of the gripper, axes of the
    # commanded gripper
    gripper_shift: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    # (3,) rotation vector from the commanded to the true gripper, rad, same axes
    gripper_turn: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    # (k, 3) or (3,) hole shifts in m, true minus stated place of each sheet and its cut-out, world
    # axes; the last one is that of all sheets after it
    hole_shift: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    damping: float = 1.0  # factor of the damping

    def __post_init__(self) -> None:
        for name in ('bending_stiffness', 'torsional_stiffness', 'mass', 'damping'):
            put(self, **{name: number(f'Truth.{name}', getattr(self, name), above=0)})
        for name in ('gripper_shift', 'gripper_turn'):
            put(self, **{name: vector(f'Truth.{name}', getattr(self, name), 3)})
        put(self, hole_shift=array('Truth.hole_shift', np.atleast_2d(self.hole_shift), (None, 3)))
        put(self, length=number('Truth.length', self.length),
            mass_gradient=number('Truth.mass_gradient', self.mass_gradient, minimum=-2, maximum=2),
            natural_curvature=array('Truth.natural_curvature', self.natural_curvature, (2, None)))
        super().__post_init__()

    def shift_of(self, sheet: int) -> Floats:
        """Return the shift (3,) of a sheet, by its number among them, m."""
        shift: Floats = self.hole_shift[min(sheet, len(self.hole_shift) - 1)]
        return shift

    def length_of(self, rod: Rod) -> float:
        """Return the true length in m."""
        if rod.length + self.length <= 0:
            raise InvalidTask(f'Truth.length = {self.length:g}: expected more than minus the '
                              f"DLO's length of {rod.length:g} m")
        return rod.length + self.length

    def stiffnesses(self, rod: Rod, s: ArrayLike) -> Floats:
        """Return the true GJ, EI_n, EI_b (n, 3) in N m^2 at true arc lengths s (n,)."""
        return rod.stiffnesses(np.minimum(s, rod.length)) * (
            self.torsional_stiffness, self.bending_stiffness, self.bending_stiffness)

    def natural_strains(self, rod: Rod, s: ArrayLike) -> Floats:
        """Return the true natural torsion and curvatures (n, 3) in 1/m at arc lengths s (n,)."""
        strains = rod.natural_strains(np.minimum(s, rod.length))
        strains[:, 1:] += legendre.legval(2 * np.asarray(s) / self.length_of(rod) - 1,
                                          self.natural_curvature.T).T
        return strains

    def masses_per_length(self, rod: Rod, s: ArrayLike) -> Floats:
        """Return the true mass per length (n,) in kg/m at arc lengths s (n,)."""
        gradient = 1 + self.mass_gradient * (np.asarray(s) / self.length_of(rod) - 0.5)
        return self.mass * gradient * rod.masses_per_length(np.minimum(s, rod.length))


@dataclass(frozen=True, eq=False, repr=False)
class Unknowns(Value):
    """Standard deviations from which a Truth is drawn; independent and normal."""

    stiffness: float = 0.0  # of the logarithm of the factor that EI and GJ have in common
    mass: float = 0.0  # of the logarithm of the factor
    mass_gradient: float = 0.0  # of the part in `Truth`
    # (k,) 1/m, of the Legendre coefficients of each plane
    natural_curvature: Floats = (0.0,)  # type: ignore[assignment]
    length: float = 0.0  # m
    gripper_position: float = 0.0  # m, along each axis
    gripper_rotation: float = 0.0  # rad, about each axis
    hole_position: float = 0.0  # m, along each axis, of each hole by itself
    damping: float = 0.0  # of the logarithm of the factor

    def __post_init__(self) -> None:
        put(self, natural_curvature=array('Unknowns.natural_curvature', self.natural_curvature,
                                          (None,)))
        put(self, **{item.name: number(f'Unknowns.{item.name}', getattr(self, item.name), minimum=0)
                     for item in fields(self) if item.name != 'natural_curvature'})
        super().__post_init__()

    def draw(self, rng: np.random.Generator) -> Truth:
        """Return one Truth."""
        instance('rng', rng, np.random.Generator)
        stiffness = np.exp(self.stiffness * rng.standard_normal())
        own, = rng.spawn(1)  # what is drawn from rng after it stays as it was without what is new
        damping, others = own.standard_normal(), own.standard_normal((_SHEETS - 1, 3))
        if not self.hole_position:
            others = others[:0]
        return Truth(stiffness, stiffness, np.exp(self.mass * rng.standard_normal()),
                     np.clip(self.mass_gradient * rng.standard_normal(), -1, 1),
                     rng.standard_normal((2, self.natural_curvature.size)) * self.natural_curvature,
                     self.length * rng.standard_normal(),
                     self.gripper_position * rng.standard_normal(3),
                     self.gripper_rotation * rng.standard_normal(3),
                     self.hole_position * np.vstack([rng.standard_normal(3), others]),
                     np.exp(self.damping * damping))


_TILT = np.radians(0.2)
NOTHING_UNKNOWN = Unknowns()
_DAMPING = 0.35  # of the logarithm: half to twice of what is stated
# `--unknown much` and `--unknown more`
UNCERTAIN = Unknowns(0.05, 0.02, natural_curvature=np.array([0.05]), gripper_position=0.5e-3,
                     gripper_rotation=_TILT, damping=_DAMPING)
VERY_UNCERTAIN = Unknowns(0.05, 0.02, 0.03, np.array([0.05, 0.03, 0.03]), 1e-3, 0.5e-3, _TILT,
                          0.5e-3, _DAMPING)
