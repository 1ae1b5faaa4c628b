"""The deformable linear object: length, mass, stiffness, natural shape."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidRod
from dlo_planner.model.checks import choice, number
from dlo_planner.model.section import MODELS, Section


@dataclass(frozen=True)
class Rod:
    """An inextensible, unshearable elastic rod (Kirchhoff), straight or naturally curved.

    Material frame (t, n, b); strains are (torsion, curvature about n, curvature about b), 1/m.

    Attributes:
        length: metres
        mass_per_length: kg/m, or a callable of s (m) returning it
        bending_stiffness: EI in N m^2; one number, or (EI_n, EI_b), where EI_n resists curvature
            about n; always stored as the pair
        torsional_stiffness: GJ in N m^2
        natural_curvature: stress-free (k_n, k_b) in 1/m, or a callable of s (m) returning them
        natural_twist: stress-free torsion in 1/m, or a callable of s
        point_masses: ((s in m, mass in kg), ...)
        tip_mass: kg at s = length
        damping: (a, b) of Rayleigh: a in 1/s times mass, b in s times stiffness; one number is b;
            it acts on motions and leaves statics alone
        radius: of the outside, metres, where contact and pictures need it; None = thin line
        yield_curvature: curvature since the stress-free shape beyond which bending is plastic,
            1/m; one number, or (about n, about b); None: never
        yield_torsion: the same for torsion, 1/m
        section_model: how it goes on yielding: 'ideal' (the moment stays), or with an elastic
            core, 'round' or 'rectangular'; see `model.section`
        hardening: part of the stiffness that never yields, 0 <= hardening < 1
        max_bend_curvature: curvature not to be exceeded, 1/m; None: any
        section: Section, where strain and stress at the surface are asked for

    Raises:
        InvalidRod: naming the argument, its value and what would be right
    """

    length: float
    mass_per_length: float | Callable
    bending_stiffness: float | tuple[float, float]
    torsional_stiffness: float
    natural_curvature: tuple[float, float] | Callable = (0.0, 0.0)
    natural_twist: float | Callable = 0.0
    point_masses: tuple[tuple[float, float], ...] = ()
    tip_mass: float = 0.0
    damping: float | tuple[float, float] = 0.0
    radius: float | None = None
    yield_curvature: float | tuple[float, float] | None = None
    yield_torsion: float | None = None
    section_model: str = 'ideal'
    hardening: float = 0.0
    max_bend_curvature: float | None = None
    section: Section | None = None

    def __post_init__(self):
        def put(name, value):
            object.__setattr__(self, name, value)

        put('length', number('Rod.length', self.length, InvalidRod, above=0))
        if not callable(self.mass_per_length):
            put('mass_per_length',
                number('Rod.mass_per_length', self.mass_per_length, InvalidRod, minimum=0))
        put('bending_stiffness',
            _pair('Rod.bending_stiffness', self.bending_stiffness, 'EI or (EI_n, EI_b)', above=0))
        put('torsional_stiffness',
            number('Rod.torsional_stiffness', self.torsional_stiffness, InvalidRod, above=0))
        put('tip_mass', number('Rod.tip_mass', self.tip_mass, InvalidRod, minimum=0))
        if np.size(self.damping) == 1:
            put('damping', (0.0, np.ravel(np.asarray(self.damping, dtype=object))[0]))
        put('damping', _pair('Rod.damping', self.damping, 'b or (a, b)', minimum=0))
        put('point_masses', self._checked_point_masses())
        if self.yield_curvature is not None:
            put('yield_curvature', _pair('Rod.yield_curvature', self.yield_curvature,
                                         'a threshold or (about n, about b)', above=0))
        for name in ('radius', 'yield_torsion', 'max_bend_curvature'):
            if getattr(self, name) is not None:
                put(name, number(f'Rod.{name}', getattr(self, name), InvalidRod, above=0))
        choice('Rod.section_model', self.section_model, MODELS, InvalidRod)
        put('hardening', number('Rod.hardening', self.hardening, InvalidRod, minimum=0))
        if self.hardening >= 1:
            raise InvalidRod(f'Rod.hardening = {self.hardening!r}: expected less than 1')
        if self.section is not None and not isinstance(self.section, Section):
            raise InvalidRod(f'Rod.section = {self.section!r}: expected a Section')
        if not callable(self.natural_curvature):
            put('natural_curvature', self._checked_curvature(self.natural_curvature))
        if not callable(self.natural_twist):
            put('natural_twist', number('Rod.natural_twist', self.natural_twist, InvalidRod))
        probes = np.linspace(0, self.length, 9)
        self.natural_strains(probes)  # callables are judged now, not later
        self.masses_per_length(probes)

    def _checked_point_masses(self):
        try:
            masses = [(s, m) for s, m in self.point_masses]
        except (TypeError, ValueError):
            raise InvalidRod(f'Rod.point_masses = {self.point_masses!r}: '
                             'expected ((s, kg), ...)') from None
        return tuple((number('Rod.point_masses s', s, InvalidRod, minimum=0, maximum=self.length),
                      number('Rod.point_masses kg', m, InvalidRod, minimum=0)) for s, m in masses)

    @staticmethod
    def _checked_curvature(value, where=''):
        try:
            first, second = value
        except (TypeError, ValueError):
            raise InvalidRod(f'Rod.natural_curvature{where} = {value!r}: '
                             'expected (k_n, k_b)') from None
        return tuple(number(f'Rod.natural_curvature{where}', v, InvalidRod)
                     for v in (first, second))

    @property
    def stiffness(self):
        """(3,) GJ, EI_n, EI_b in N m^2, in the order of the strains."""
        return np.array([self.torsional_stiffness, *self.bending_stiffness])

    @property
    def yields(self):
        """Whether there is a threshold beyond which the DLO is set for good."""
        return self.yield_curvature is not None or self.yield_torsion is not None

    def masses_per_length(self, s):
        """Return the mass per length at arc lengths `s` (n,) as (n,), kg/m."""
        s = np.asarray(s, dtype=float)
        if not callable(self.mass_per_length):
            return np.full(s.size, self.mass_per_length)
        return np.array([number(f'Rod.mass_per_length({v:g})', self.mass_per_length(v), InvalidRod,
                                minimum=0) for v in s])

    def natural_strains(self, s):
        """Return the stress-free strains at arc lengths `s` (n,) as (n, 3), 1/m."""
        s = np.asarray(s, dtype=float)
        strains = np.empty((s.size, 3))
        if callable(self.natural_twist):
            strains[:, 0] = [number(f'Rod.natural_twist({v:g})', self.natural_twist(v), InvalidRod)
                             for v in s]
        else:
            strains[:, 0] = self.natural_twist
        if callable(self.natural_curvature):
            strains[:, 1:] = [self._checked_curvature(self.natural_curvature(v), f'({v:g})')
                              for v in s]
        else:
            strains[:, 1:] = self.natural_curvature
        return strains

    @classmethod
    def circular(cls, length, diameter, density, youngs_modulus, poisson_ratio, *,
                 yield_stress=None, **more):
        """Return a rod of solid round section (wire).

        EI = E pi d^4 / 64, GJ = G pi d^4 / 32, G = E / (2 (1 + nu)).

        Args:
            length, diameter: metres
            density: kg/m^3
            youngs_modulus: Pa
            poisson_ratio: -1 < nu <= 0.5
            yield_stress: Pa; gives yield_curvature and yield_torsion (von Mises)
            more: any other argument of `Rod`
        """
        d = number('diameter', diameter, InvalidRod, above=0)
        section = Section.of('round', d / 2, d / 2, youngs_modulus, poisson_ratio)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def tube(cls, length, outer_diameter, inner_diameter, density, youngs_modulus, poisson_ratio,
             *, yield_stress=None, **more):
        """Return a rod of annular section (hose); arguments as in `circular`."""
        outer = number('outer_diameter', outer_diameter, InvalidRod, above=0)
        inner = number('inner_diameter', inner_diameter, InvalidRod, minimum=0)
        if inner >= outer:
            raise InvalidRod(
                f'inner_diameter = {inner!r}: expected less than outer_diameter {outer!r}')
        section = Section.of('tube', outer / 2, outer / 2, youngs_modulus, poisson_ratio,
                             inner / 2)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def rectangular(cls, length, width, thickness, density, youngs_modulus, poisson_ratio, *,
                    yield_stress=None, **more):
        """Return a rod of solid rectangular section (leaf spring), `width` along the n axis.

        EI_n = E w t^3 / 12 (soft if t < w), EI_b = E t w^3 / 12; GJ from Saint-Venant's series.

        Args:
            length, width, thickness: metres
            density: kg/m^3
            youngs_modulus: Pa
            poisson_ratio: -1 < nu <= 0.5
            yield_stress: Pa; gives yield_curvature and yield_torsion
            more: any other argument of `Rod`
        """
        w = number('width', width, InvalidRod, above=0)
        t = number('thickness', thickness, InvalidRod, above=0)
        section = Section.of('rectangular', w / 2, t / 2, youngs_modulus, poisson_ratio)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def _of_section(cls, section, length, density, yield_stress, more):
        given = {'radius': max(section.half_n, section.half_b), 'section': section}
        if yield_stress is not None:
            stress = number('yield_stress', yield_stress, InvalidRod, above=0)
            given['yield_curvature'], given['yield_torsion'] = section.thresholds(stress)
        rho = number('density', density, InvalidRod, minimum=0)
        return cls(length, rho * section.area, section.bending_stiffness,
                   section.torsional_stiffness, **{**given, **more})


def _pair(name, value, expected, **limits):
    values = np.atleast_1d(np.asarray(value, dtype=object))
    if values.size not in (1, 2):
        raise InvalidRod(f'{name} = {value!r}: expected {expected}')
    values = tuple(number(name, v, InvalidRod, **limits) for v in values)
    return values if len(values) == 2 else values * 2
