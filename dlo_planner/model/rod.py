"""The deformable linear object: length, mass, stiffness, natural shape."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidRod
from dlo_planner.model.checks import array, choice, instance, number, returned, shown
from dlo_planner.model.section import MODELS, MODULI, SIZES, Section
from dlo_planner.model.value import Value, brief, put


@dataclass(frozen=True, eq=False, repr=False)
class Rod(Value):
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
        radius: of the outside, metres, where contact and pictures need it: a number, a table
            ((s, radius), ...) or a callable of s; None = thin line
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
    radius: float | tuple | Callable | None = None
    yield_curvature: float | tuple[float, float] | None = None
    yield_torsion: float | None = None
    section_model: str = 'ideal'
    hardening: float = 0.0
    max_bend_curvature: float | None = None
    section: Section | None = None

    def __post_init__(self):
        put(self, **{name: number(f'Rod.{name}', getattr(self, name), InvalidRod, **limits)
                     for name, limits in _NUMBERS.items()
                     if not (getattr(self, name) is None and name in _OPTIONAL
                             or callable(getattr(self, name)) and name in _FUNCTIONS
                             or name == 'radius' and _is_row(self.radius))})
        if self.radius is not None and _is_row(self.radius):
            put(self, radius=_table('Rod.radius', self.radius))
        damping = self.damping
        if not _is_row(damping):
            damping = (0.0, damping)
        elif len(damping) == 1:
            damping = (0.0, damping[0])
        put(self, damping=_pair('Rod.damping', damping, 'b or (a, b)', minimum=0),
            bending_stiffness=_pair('Rod.bending_stiffness', self.bending_stiffness,
                                    'EI or (EI_n, EI_b)', above=0),
            point_masses=self._checked_point_masses())
        if self.yield_curvature is not None:
            put(self, yield_curvature=_pair('Rod.yield_curvature', self.yield_curvature,
                                            'a threshold or (about n, about b)', above=0))
        choice('Rod.section_model', self.section_model, MODELS, InvalidRod)
        instance('Rod.section', self.section, Section, InvalidRod, optional=True)
        if not callable(self.natural_curvature):
            put(self, natural_curvature=_curvature('Rod.natural_curvature',
                                                   self.natural_curvature))
        probes = np.linspace(0, self.length, 9)
        self.natural_strains(probes)  # callables are judged now, not later
        self.masses_per_length(probes)
        if self.radius is not None:
            self.radii(probes)
        super().__post_init__()

    def __repr__(self):
        per_length, (first, second) = self.mass_per_length, self.bending_stiffness
        bent = callable(self.natural_curvature) or any(self.natural_curvature)
        return brief(self, f'{self.length:.4g} m',
                     'varying mass' if callable(per_length) else f'{per_length:.3g} kg/m',
                     f'EI {first:.3g} N m^2' if first == second
                     else f'EI {first:.3g}, {second:.3g} N m^2',
                     f'GJ {self.torsional_stiffness:.3g} N m^2',
                     '' if self.radius is None else f'radius {self.radius:.3g} m'
                     if isinstance(self.radius, float) else 'varying radius',
                     'naturally bent' if bent else '',
                     'yields' if self.yields else '')

    def _checked_point_masses(self):
        expected = f'Rod.point_masses = {shown(self.point_masses)}: expected ((s, kg), ...)'
        try:
            masses = [(s, m) for s, m in self.point_masses]
        except Exception:  # whatever its iteration raises
            raise InvalidRod(expected) from None
        return tuple((number('Rod.point_masses s', s, InvalidRod, minimum=0, maximum=self.length),
                      number('Rod.point_masses kg', m, InvalidRod, minimum=0)) for s, m in masses)

    @property
    def stiffness(self) -> np.ndarray:
        """(3,) GJ, EI_n, EI_b in N m^2, in the order of the strains."""
        return np.array([self.torsional_stiffness, *self.bending_stiffness])

    @property
    def yields(self) -> bool:
        """Whether there is a threshold beyond which the DLO is set for good."""
        return self.yield_curvature is not None or self.yield_torsion is not None

    def masses_per_length(self, s: ArrayLike) -> np.ndarray:
        """Return the mass per length at arc lengths `s` (n,) as (n,), kg/m."""
        s = array('s', s, (None,), InvalidRod)
        known, name = self.mass_per_length, 'Rod.mass_per_length'
        if not callable(known):
            return np.full(s.size, known)
        return np.array([number(f'{name}({v:g})', returned(name, known, v, InvalidRod), InvalidRod,
                                minimum=0) for v in s])

    def radii(self, s: ArrayLike) -> np.ndarray:
        """Return the radius of the outside at arc lengths `s` (n,) as (n,), m."""
        s = array('s', s, (None,), InvalidRod)
        known = self.radius
        if callable(known):
            return np.array([number(f'Rod.radius({v:g})', returned('Rod.radius', known, v,
                                                                   InvalidRod), InvalidRod, above=0)
                             for v in s])
        if isinstance(known, tuple):
            return np.interp(s, *np.array(known).T)
        return np.full(s.size, 0.0 if known is None else known)

    def natural_strains(self, s: ArrayLike) -> np.ndarray:
        """Return the stress-free strains at arc lengths `s` (n,) as (n, 3), 1/m."""
        s = array('s', s, (None,), InvalidRod)
        strains = np.empty((s.size, 3))
        twist, curvature = self.natural_twist, self.natural_curvature
        strains[:, 0] = twist if not callable(twist) else [
            number(f'Rod.natural_twist({v:g})', returned('Rod.natural_twist', twist, v, InvalidRod),
                   InvalidRod) for v in s]
        strains[:, 1:] = curvature if not callable(curvature) else [
            _curvature(f'Rod.natural_curvature({v:g})',
                       returned('Rod.natural_curvature', curvature, v, InvalidRod)) for v in s]
        return strains

    @classmethod
    def circular(cls, length: float, diameter: float, density: float, youngs_modulus: float,
                 poisson_ratio: float, *, yield_stress: float | None = None, **more) -> 'Rod':
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
        d = _size('diameter', diameter)
        section = Section.of('round', d / 2, d / 2, youngs_modulus, poisson_ratio)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def tube(cls, length: float, outer_diameter: float, inner_diameter: float, density: float,
             youngs_modulus: float, poisson_ratio: float, *, yield_stress: float | None = None,
             **more) -> 'Rod':
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
                    yield_stress: float | None = None, **more) -> 'Rod':
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
        w = _size('width', width)
        t = _size('thickness', thickness)
        section = Section.of('rectangular', w / 2, t / 2, youngs_modulus, poisson_ratio)
        return cls._of_section(section, length, density, yield_stress, more)

    @classmethod
    def _of_section(cls, section, length, density, yield_stress, more):
        given = {'radius': max(section.half_n, section.half_b), 'section': section}
        if yield_stress is not None:
            stress = number('yield_stress', yield_stress, InvalidRod, minimum=MODULI[0],
                            maximum=MODULI[1])
            given['yield_curvature'], given['yield_torsion'] = section.thresholds(stress)
        rho = number('density', density, InvalidRod, minimum=0)
        return cls(length, rho * section.area, section.bending_stiffness,
                   section.torsional_stiffness, **{**given, **more})


_NUMBERS = {
    'length': {'above': 0}, 'mass_per_length': {'minimum': 0}, 'torsional_stiffness': {'above': 0},
    'natural_twist': {}, 'tip_mass': {'minimum': 0}, 'radius': {'above': 0},
    'yield_torsion': {'above': 0}, 'hardening': {'minimum': 0, 'below': 1},
    'max_bend_curvature': {'above': 0}}
_OPTIONAL = ('radius', 'yield_torsion', 'max_bend_curvature')
_FUNCTIONS = ('mass_per_length', 'natural_twist', 'radius')


def _is_row(value):
    """Whether it has places by index: a tuple, list, (n,) array, or an array of ROS parameters."""
    return (hasattr(value, '__getitem__') and hasattr(value, '__len__')
            and not isinstance(value, str | bytes | dict) and getattr(value, 'ndim', 1) == 1)


def _table(name, values):
    expected = f'{name} = {shown(values)}: expected ((s, value), ...)'
    try:
        rows = [(s, value) for s, value in values]
    except (TypeError, ValueError):
        raise InvalidRod(expected) from None
    if not rows:
        raise InvalidRod(expected)
    return tuple((number(f'{name} s', s, InvalidRod), number(f'{name} value', value, InvalidRod,
                                                             above=0)) for s, value in rows)


def _pair(name, value, expected, **limits):
    if _is_row(value):
        if len(value) not in (1, 2):
            raise InvalidRod(f'{name} = {shown(value)}: expected {expected}')
        first, last = value[0], value[-1]
    else:
        first = last = value
    return number(name, first, InvalidRod, **limits), number(name, last, InvalidRod, **limits)


def _size(name, value):
    return number(name, value, InvalidRod, minimum=SIZES[0], maximum=SIZES[1])


def _curvature(name, value):
    try:
        first, second = value
    except Exception:  # whatever its iteration raises
        raise InvalidRod(f'{name} = {shown(value)}: expected (k_n, k_b)') from None
    return number(name, first, InvalidRod), number(name, second, InvalidRod)
