# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The deformable linear object: length, mass, stiffness, natural shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dlo_planner.deprecated import warn_renamed
from dlo_planner.errors import InvalidRod
from dlo_planner.model.along import Along
from dlo_planner.model.along_rod import VARYING, AlongRod
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, row, shown
from dlo_planner.model.section import MODELS, MODULI, SIZES, Section
from dlo_planner.model.stated import is_row, pair, varying
from dlo_planner.model.value import brief, put


@dataclass(frozen=True, eq=False, repr=False)
class Rod(AlongRod):
    """An inextensible, unshearable elastic rod (Kirchhoff), straight or naturally curved.

    Material frame (t, n, b); strains are (torsion, curvature about n, curvature about b), 1/m.

    A quantity marked (*) may vary along the DLO: it is a number, a table of rows (s, value), linear
    between the rows (two rows at the same s are a jump), or a callable of s in m. Each component of
    a pair may be one of these too. The jumps of a callable are found by bisection; a feature that
    is narrower than 1/2000 of the length has to be stated with `Piecewise(function, breaks)`.

    Attributes
    ----------
    length : float
        Length in m.
    mass_per_length : float, tuple or callable
        Mass per length in kg/m (*).
    bending_stiffness : float, tuple or callable
        EI in N m^2; one number, or (EI_n, EI_b), where EI_n resists curvature about n (*); numbers
        are always stored as the pair.
    torsional_stiffness : float, tuple or callable
        GJ in N m^2 (*).
    natural_curvature : float, tuple or callable
        Stress-free (k_n, k_b) in 1/m (*).
    natural_twist : float, tuple or callable
        Stress-free torsion in 1/m (*).
    point_masses : tuple of (float, float)
        Masses fixed to it: ((s in m, mass in kg), ...).
    tip_mass : float
        Tip mass in kg at s = length.
    damping : float or (float, float)
        Rayleigh damping (a, b): a in 1/s times mass, b in s times stiffness; one number is b. It
        acts on motions and leaves statics alone.
    radius : float, tuple or callable or None
        Radius of the outside in m (*), which contact and pictures need. If None, a thin line.
    yield_curvature : float or (float, float) or None
        Curvature since the stress-free shape beyond which bending is plastic, 1/m; one number, or
        (about n, about b). If None, never.
    yield_torsion : float or None
        Torsion since the stress-free shape beyond which it is plastic, 1/m; None: never.
    section_model : str or None
        How yielding proceeds. 'fibers': fiber by fiber of its section; 'round' or 'rectangular': of
        such a section with this stiffness and these thresholds; 'ideal': at once, and the moment
        stays (as in the paper). If None, 'fibers' with a section, else 'ideal'.
    hardening : float
        Part of the stiffness that never yields, 0 <= hardening < 1.
    max_bend_curvature : float or None
        Largest curvature that is allowed, 1/m. If None, there is no limit.
    section : Section or None
        Cross-section, from which fibers and the strain and stress at the surface follow.
    nodes : tuple of float
        Further arc lengths in m at which every mesh has a node.

    Raises
    ------
    InvalidRod
        An argument makes no sense; the message names it, its value and what would be right.
    """

    length: float
    mass_per_length: Along
    bending_stiffness: Along
    torsional_stiffness: Along
    natural_curvature: Along = (0.0, 0.0)
    natural_twist: Along = 0.0
    point_masses: tuple[tuple[float, float], ...] = ()
    tip_mass: float = 0.0
    damping: float | tuple[float, float] = 0.0
    radius: Along | None = None
    yield_curvature: float | tuple[float, float] | None = None
    yield_torsion: float | None = None
    section_model: str | None = None
    hardening: float = 0.0
    max_bend_curvature: float | None = None
    section: Section | None = None
    nodes: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        put(self, **{name: number(f'Rod.{name}', getattr(self, name), InvalidRod, **limits)
                     for name, limits in _NUMBERS.items()
                     if not (getattr(self, name) is None and name in _OPTIONAL)})
        put(self, **{name: varying(f'Rod.{name}', getattr(self, name), parts, **limits)
                     for name, (parts, limits) in VARYING.items()
                     if not (getattr(self, name) is None and name == 'radius')})
        damping: Any = self.damping
        if not is_row(damping):
            damping = (0.0, damping)
        elif len(damping) == 1:
            damping = (0.0, damping[0])
        put(self, damping=pair('Rod.damping', damping, 'b or (a, b)', minimum=0),
            point_masses=self._checked_point_masses())
        if self.yield_curvature is not None:
            put(self, yield_curvature=pair('Rod.yield_curvature', self.yield_curvature,
                                            'a threshold or (about n, about b)', above=0))
        instance('Rod.section', self.section, Section, InvalidRod, optional=True)
        put(self, section_model=self._checked_model())
        put(self, nodes=tuple(row('Rod.nodes', self.nodes, InvalidRod, least=0, minimum=0,
                                  maximum=self.length).tolist()))
        probes = np.linspace(0, self.length, 9)
        for name in VARYING:  # callables are judged now, not later
            self._values(name, probes)
        super().__post_init__()

    def __repr__(self) -> str:
        per_length, (twist, first, second) = self.mass_per_length, self.stiffness
        bent = callable(self.natural_curvature) or np.any(self.natural_curvature)
        varies = callable(self.bending_stiffness) or callable(self.torsional_stiffness)
        return brief(self, f'{self.length:.4g} m',
                     'varying mass' if callable(per_length) else f'{per_length:.3g} kg/m',
                     'varying stiffness, mean' if varies else '',
                     f'EI {first:.3g} N m^2' if first == second
                     else f'EI {first:.3g}, {second:.3g} N m^2', f'GJ {twist:.3g} N m^2',
                     '' if self.radius is None else 'varying radius' if callable(self.radius)
                     else f'radius {self.radius:.3g} m',
                     'naturally bent' if bent else '',
                     'yields' if self.yields else '')

    def _checked_point_masses(self) -> tuple[tuple[float, float], ...]:
        expected = f'Rod.point_masses = {shown(self.point_masses)}: expected ((s, kg), ...)'
        try:
            masses = [(s, m) for s, m in self.point_masses]
        except Exception:  # whatever its iteration raises
            raise InvalidRod(expected) from None
        return tuple((number('Rod.point_masses s', s, InvalidRod, minimum=0, maximum=self.length),
                      number('Rod.point_masses kg', m, InvalidRod, minimum=0)) for s, m in masses)

    def _checked_model(self) -> str:
        model = self.section_model
        if model is None:
            return 'ideal' if self.section is None else 'fibers'
        if isinstance(model, str) and model == 'fibres':
            warn_renamed("section_model 'fibres'", "'fibers'")
            model = 'fibers'
        choice('Rod.section_model', model, MODELS, InvalidRod)
        if model == 'fibers' and self.section is None:
            raise InvalidRod("Rod.section_model = 'fibers': expected 'round', 'rectangular' or "
                             "'ideal' where Rod.section is None")
        return model

    @property
    def section_outline(self) -> tuple[str, float]:
        """Section that yields ('round', 'tube', 'rectangular', 'ideal'), and bore over radius."""
        if self.section is None or self.section_model != 'fibers':
            return str(self.section_model), 0.0
        return self.section.kind, self.section.inner / self.section.half_n

    @cached_property
    def stiffness(self) -> Floats:
        """Stiffness (3,) GJ, EI_n, EI_b in N m^2, in the order of the strains.

        If they vary along the DLO: those of a uniform DLO with the same total compliance.
        """
        stiffness = self.mean_stiffnesses(np.array([0.0, self.length]))[0]
        stiffness.flags.writeable = False
        result: Floats = stiffness
        return result

    @property
    def yields(self) -> bool:
        """Whether there is a threshold beyond which the DLO deforms permanently."""
        return self.yield_curvature is not None or self.yield_torsion is not None

    @classmethod
    def circular(cls, length: float, diameter: float, density: float, youngs_modulus: float,
                 poisson_ratio: float, *, yield_stress: float | None = None, **more: Any) -> Rod:
        """Return a rod of solid round section (wire).

        EI = E pi d^4 / 64, GJ = G pi d^4 / 32, G = E / (2 (1 + nu)).

        Parameters
        ----------
        length, diameter : float
            Length and diameter in m.
        density : float
            Density in kg/m^3.
        youngs_modulus : float
            Young's modulus in Pa.
        poisson_ratio : float
            Poisson's ratio nu, -1 < nu <= 0.5.
        yield_stress : float, optional
            Yield stress in Pa; gives yield_curvature and yield_torsion (von Mises).
        more : object
            Any other argument of `Rod`.
        """
        d = _size('diameter', diameter)
        section = Section.of('round', d / 2, d / 2, youngs_modulus, poisson_ratio)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def tube(cls, length: float, outer_diameter: float, inner_diameter: float, density: float,
             youngs_modulus: float, poisson_ratio: float, *, yield_stress: float | None = None,
             **more: Any) -> Rod:
        """Return a rod of annular section (hose); arguments as in `circular`."""
        outer = _size('outer_diameter', outer_diameter)
        inner = number('inner_diameter', inner_diameter, InvalidRod, minimum=0)
        if inner >= outer:
            raise InvalidRod(
                f'inner_diameter = {inner!r}: expected less than outer_diameter {outer!r}')
        section = Section.of('tube', outer / 2, outer / 2, youngs_modulus, poisson_ratio,
                             inner / 2)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def rectangular(cls, length: float, width: float, thickness: float, density: float,
                    youngs_modulus: float, poisson_ratio: float, *,
                    yield_stress: float | None = None, **more: Any) -> Rod:
        """Return a rod of solid rectangular section (leaf spring), `width` along the n axis.

        EI_n = E w t^3 / 12 (soft if t < w), EI_b = E t w^3 / 12; GJ from Saint-Venant's series.

        Parameters
        ----------
        length, width, thickness : float
            Length, width and thickness in m.
        density : float
            Density in kg/m^3.
        youngs_modulus : float
            Young's modulus in Pa.
        poisson_ratio : float
            Poisson's ratio nu, -1 < nu <= 0.5.
        yield_stress : float, optional
            Yield stress in Pa; gives yield_curvature and yield_torsion.
        more : object
            Any other argument of `Rod`.
        """
        w = _size('width', width)
        t = _size('thickness', thickness)
        section = Section.of('rectangular', w / 2, t / 2, youngs_modulus, poisson_ratio)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def _of_section(cls, section: Section, length: float, density: float,
                    yield_stress: float | None, more: dict[str, Any]) -> Rod:
        given = {'radius': max(section.half_n, section.half_b), 'section': section}
        if yield_stress is not None:
            stress = number('yield_stress', yield_stress, InvalidRod, minimum=MODULI[0],
                            maximum=MODULI[1])
            given['yield_curvature'], given['yield_torsion'] = section.thresholds(stress)
        rho = number('density', density, InvalidRod, minimum=0)
        return cls(length, rho * section.area, section.bending_stiffness,
                   section.torsional_stiffness, **{**given, **more})


_NUMBERS = {
    'length': {'above': 0}, 'tip_mass': {'minimum': 0},
    'yield_torsion': {'above': 0}, 'hardening': {'minimum': 0, 'below': 1},
    'max_bend_curvature': {'above': 0}}
_OPTIONAL = ('yield_torsion', 'max_bend_curvature')


def _size(name: str, value: object) -> float:
    return number(name, value, InvalidRod, minimum=SIZES[0], maximum=SIZES[1])
