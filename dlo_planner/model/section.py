# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The section of a DLO: its stiffness from its sizes, and the fibers and layers that yield."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidRod
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, choice, number
from dlo_planner.model.value import Value, put

# ------------------------------------------------------------------------------------------------
# The cross-section: its stiffness, its stress, and how it yields beyond the first fiber.


KINDS = ('round', 'tube', 'rectangular')
MODELS = ('fibers', 'round', 'rectangular', 'ideal')
SIZES = 1e-12, 1e9     # m, of a section from side to side: beyond, stiffness is out of range
MODULI = 1e-6, 1e30    # Pa
_TANGENTS = 400  # terms of Saint-Venant's series


@dataclass(frozen=True, eq=False, repr=False)
class Section(Value):
    """A solid or hollow cross-section of one material.

    Attributes
    ----------
    kind : str
        'round', 'tube' or 'rectangular'.
    half_n : float
        Distance from the axis to the surface along n, m (round: the radius).
    half_b : float
        Distance from the axis to the surface along b, m (round: the radius).
    youngs_modulus : float
        Young's modulus in Pa.
    shear_modulus : float
        Shear modulus in Pa.
    inner : float
        Radius of a tube's bore, m.

    Raises
    ------
    InvalidRod
        An argument makes no sense; the message names it, its value and what would be right.
    """

    kind: str
    half_n: float
    half_b: float
    youngs_modulus: float
    shear_modulus: float
    inner: float = 0.0

    def __post_init__(self) -> None:
        choice('Section.kind', self.kind, KINDS, InvalidRod)
        put(self, **{name: number(f'Section.{name}', getattr(self, name), InvalidRod,
                                  minimum=SIZES[0] / 2, maximum=SIZES[1] / 2)
                     for name in ('half_n', 'half_b')})
        put(self, **{name: number(f'Section.{name}', getattr(self, name), InvalidRod,
                                  minimum=MODULI[0], maximum=MODULI[1])
                     for name in ('youngs_modulus', 'shear_modulus')})
        put(self, inner=number('Section.inner', self.inner, InvalidRod, minimum=0,
                               below=min(self.half_n, self.half_b)))
        if self.kind != 'rectangular' and self.half_n != self.half_b:
            raise InvalidRod(f'Section.half_b = {self.half_b:g}: expected half_n = '
                             f'{self.half_n:g} where the section is {self.kind}')
        super().__post_init__()

    @classmethod
    def of(cls, kind: str, half_n: float, half_b: float, youngs_modulus: float,
           poisson_ratio: float, inner: float = 0.0) -> Section:
        """Return the section of a material; raises InvalidRod if an argument makes no sense."""
        modulus = number('youngs_modulus', youngs_modulus, InvalidRod, minimum=10 * MODULI[0],
                         maximum=MODULI[1])
        nu = number('poisson_ratio', poisson_ratio, InvalidRod, above=-1, maximum=0.5)
        return cls(kind, half_n, half_b, modulus, modulus / (2 * (1 + nu)), inner)

    @property
    def area(self) -> float:
        """Area in m^2."""
        if self.kind == 'rectangular':
            return 4 * self.half_n * self.half_b
        return np.pi * (self.half_n**2 - self.inner**2)

    @property
    def bending_stiffness(self) -> tuple[float, float]:
        """Bending stiffness (EI_n, EI_b) in N m^2."""
        if self.kind == 'rectangular':
            return (self.youngs_modulus * 4 / 3 * self.half_n * self.half_b**3,
                    self.youngs_modulus * 4 / 3 * self.half_b * self.half_n**3)
        return (self.youngs_modulus * np.pi / 4 * (self.half_n**4 - self.inner**4),) * 2

    @property
    def torsional_stiffness(self) -> float:
        """Torsional stiffness GJ in N m^2; J of a rectangle from Saint-Venant's series.

        Timoshenko and Goodier, Theory of Elasticity, art. 109.
        """
        if self.kind == 'rectangular':
            return self.shear_modulus * self._rectangle()[0]
        return self.shear_modulus * np.pi / 2 * (self.half_n**4 - self.inner**4)

    def _rectangle(self) -> tuple[float, float]:
        """Return J in m^4 and the largest shear strain per torsion in m."""
        long, short = 2 * max(self.half_n, self.half_b), 2 * min(self.half_n, self.half_b)
        n = np.arange(1, _TANGENTS, 2)
        angle = np.pi * n * long / (2 * short)
        constant = long * short**3 / 3 * (
            1 - 192 / np.pi**5 * short / long * np.sum(np.tanh(angle) / n**5))
        shear = short * (1 - 8 / np.pi**2 * np.sum(1 / (n**2 * np.cosh(np.minimum(angle, 300)))))
        return constant, shear

    @property
    def shear_arm(self) -> float:
        """Largest shear strain at the surface per torsion, m."""
        return self._rectangle()[1] if self.kind == 'rectangular' else self.half_n

    def surface_strain(self, strains: ArrayLike) -> Floats:
        """Return the largest axial and the largest shear strain (n, 2) of (n, 3) strains.

        Parameters
        ----------
        strains : array_like, shape (n, 3)
            Torsion and curvatures about n and b since the stress-free shape, 1/m.
        """
        strains = array('strains', strains, (None, 3), InvalidRod)
        if self.kind == 'rectangular':
            axial = np.abs(strains[:, 1]) * self.half_b + np.abs(strains[:, 2]) * self.half_n
        else:
            axial = np.hypot(strains[:, 1], strains[:, 2]) * self.half_n
        return np.column_stack([axial, np.abs(strains[:, 0]) * self.shear_arm])

    def thresholds(self, yield_stress: float) -> tuple[tuple[float, float], float]:
        """Return ((k_n, k_b), torsion) in 1/m at which the outermost fiber yields.

        Torsion by von Mises: shear yields at yield_stress / sqrt(3).
        """
        yield_stress = number('yield_stress', yield_stress, InvalidRod, above=0)
        strain = yield_stress / self.youngs_modulus
        shear = yield_stress / np.sqrt(3) / self.shear_modulus
        return (strain / self.half_b, strain / self.half_n), shear / self.shear_arm


# ------------------------------------------------------------------------------------------------
# Where a cross-section is looked at to see what yields: its fibers, and its layers in torsion.
#
# All in units of the section: heights over the neutral axes and distances from the middle are 1 at
# the surface. A section is symmetric and so is what bending does to it: the half above one axis
# stands for both, and what one mirror image of a fiber does, the other three may do too, so that
# bending in a plane of symmetry stays in it.


_RINGS, _MOST_AROUND, _IN_RINGS = 8, 32, 128
_ROWS, _STEP = 89, 35  # of a lattice: of all with up to 96 rows, among those of smallest errors
_LAYERS = 24


@cache
def fibers(kind: str, bore: float) -> tuple[Floats, Floats]:
    """Return the heights (J, 2) of J fibers over the axes n and b, and their weights (J,).

    Elastic bending is exact: the sums of weight times height squared are 1 for both axes, that of
    the product of the heights is 0. `docs/validation/shapes.md` says how near yielding comes
    to the continuous section.
    """
    heights, weights = _in_square() if kind == 'rectangular' else _in_ring(bore)
    return heights, weights / (weights @ heights[:, 0] ** 2)


@cache
def layers(measure: str, bore: float = 0.0) -> tuple[Floats, Floats]:
    """Return the heights (J,) of J layers that are all strained alike, and their weights (J,).

    The sum of weight times height squared is 1.
    """
    inside = bore if measure == 'torsion' else 0.0
    heights = inside + (1 - inside) * (np.arange(_LAYERS) + 0.5) / _LAYERS
    if measure == 'torsion':
        weights = heights
    elif measure == 'rectangular':
        weights = np.ones(_LAYERS)
    else:
        weights = np.sqrt(1 - heights**2) - np.sqrt(np.maximum(bore**2 - heights**2, 0.0))
    return heights, weights / (weights @ heights**2)


def _in_ring(bore: float) -> tuple[Floats, Floats]:
    """Return heights and weights by Gauss' rule along the radius, evenly around, in turns."""
    rings = max(2, int(np.ceil(_RINGS * (1 - bore))))
    around = min(4 * round(_IN_RINGS / rings / 4), _MOST_AROUND)
    points, parts = np.polynomial.legendre.leggauss(rings)
    radii = bore + (1 - bore) * (points + 1) / 2
    # every other ring is turned by half of a step: of all fibers, no two rows yield at once
    heights, weights = [], []
    for ring, (radius, part) in enumerate(zip(radii, parts, strict=True)):
        turn = np.pi / around * np.arange(0.5 * (ring % 2), around / 2 + 0.1)
        heights.append(radius * np.column_stack([np.sin(turn), np.cos(turn)]))
        weights.append(np.full(turn.size, part * radius / 2))
        if ring % 2 == 0:  # both ends are on an axis
            heights[-1][[0, -1], [0, 1]] = 0.0
            weights[-1][[0, -1]] /= 2
    return _mirrored(np.vstack(heights), np.concatenate(weights))


def _in_square() -> tuple[Floats, Floats]:
    """Return heights and weights on a lattice in a quarter, no two in a row, and its mirror image.

    Such a lattice has as many rows and columns as points (a lattice rule of rank 1).
    """
    row = np.arange(_ROWS)
    quarter = np.column_stack([row + 0.5, row * _STEP % _ROWS + 0.5]) / _ROWS
    return _mirrored(quarter, np.ones(_ROWS))


def _mirrored(quarter: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return fibers with their mirror images: each next to its own, so that sums vanish exactly."""
    return (np.stack([quarter, quarter * [1, -1]], axis=1).reshape(-1, 2), np.repeat(weights, 2))
