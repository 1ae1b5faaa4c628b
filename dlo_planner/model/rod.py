"""The deformable linear object: length, mass, stiffness, natural shape."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidRod
from dlo_planner.model.checks import number


@dataclass(frozen=True)
class Rod:
    """An inextensible, unshearable elastic rod (Kirchhoff), straight or naturally curved.

    Material frame (t, n, b); strains are (torsion, curvature about n, curvature about b), 1/m.

    Attributes:
        length: metres
        mass_per_length: kg/m
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

    Raises:
        InvalidRod: naming the argument, its value and what would be right
    """

    length: float
    mass_per_length: float
    bending_stiffness: float | tuple[float, float]
    torsional_stiffness: float
    natural_curvature: tuple[float, float] | Callable = (0.0, 0.0)
    natural_twist: float | Callable = 0.0
    point_masses: tuple[tuple[float, float], ...] = ()
    tip_mass: float = 0.0
    damping: float | tuple[float, float] = 0.0
    radius: float | None = None

    def __post_init__(self):
        def put(name, value):
            object.__setattr__(self, name, value)

        put('length', number('Rod.length', self.length, InvalidRod, above=0))
        put('mass_per_length',
            number('Rod.mass_per_length', self.mass_per_length, InvalidRod, minimum=0))
        pair = np.atleast_1d(np.asarray(self.bending_stiffness, dtype=object))
        if pair.size not in (1, 2):
            raise InvalidRod(f'Rod.bending_stiffness = {self.bending_stiffness!r}: '
                             'expected EI or (EI_n, EI_b)')
        pair = tuple(number('Rod.bending_stiffness', v, InvalidRod, above=0) for v in pair)
        put('bending_stiffness', pair if len(pair) == 2 else pair * 2)
        put('torsional_stiffness',
            number('Rod.torsional_stiffness', self.torsional_stiffness, InvalidRod, above=0))
        put('tip_mass', number('Rod.tip_mass', self.tip_mass, InvalidRod, minimum=0))
        if self.radius is not None:
            put('radius', number('Rod.radius', self.radius, InvalidRod, above=0))
        pair = np.atleast_1d(np.asarray(self.damping, dtype=object))
        if pair.size not in (1, 2):
            raise InvalidRod(f'Rod.damping = {self.damping!r}: expected b or (a, b)')
        pair = tuple(number('Rod.damping', v, InvalidRod, minimum=0) for v in pair)
        put('damping', pair if len(pair) == 2 else (0.0, *pair))
        put('point_masses', self._checked_point_masses())
        if not callable(self.natural_curvature):
            put('natural_curvature', self._checked_pair(self.natural_curvature))
        if not callable(self.natural_twist):
            put('natural_twist', number('Rod.natural_twist', self.natural_twist, InvalidRod))
        self.natural_strains(np.linspace(0, self.length, 9))  # callables are judged now, not later

    def _checked_point_masses(self):
        try:
            masses = [(s, m) for s, m in self.point_masses]
        except (TypeError, ValueError):
            raise InvalidRod(f'Rod.point_masses = {self.point_masses!r}: '
                             'expected ((s, kg), ...)') from None
        return tuple((number('Rod.point_masses s', s, InvalidRod, minimum=0, maximum=self.length),
                      number('Rod.point_masses kg', m, InvalidRod, minimum=0)) for s, m in masses)

    @staticmethod
    def _checked_pair(value, where=''):
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
            strains[:, 1:] = [self._checked_pair(self.natural_curvature(v), f'({v:g})') for v in s]
        else:
            strains[:, 1:] = self.natural_curvature
        return strains

    @classmethod
    def circular(cls, length, diameter, density, youngs_modulus, poisson_ratio, **more):
        """Return a rod of solid round section (wire).

        EI = E pi d^4 / 64, GJ = G pi d^4 / 32, G = E / (2 (1 + nu)).

        Args:
            length, diameter: metres
            density: kg/m^3
            youngs_modulus: Pa
            poisson_ratio: -1 < nu <= 0.5
            more: any other argument of `Rod`
        """
        d = number('diameter', diameter, InvalidRod, above=0)
        rho = number('density', density, InvalidRod, minimum=0)
        modulus, shear = _moduli(youngs_modulus, poisson_ratio)
        return cls(length, rho * np.pi * d**2 / 4, modulus * np.pi * d**4 / 64,
                   shear * np.pi * d**4 / 32, **{'radius': d / 2, **more})

    @classmethod
    def tube(cls, length, outer_diameter, inner_diameter, density, youngs_modulus, poisson_ratio,
             **more):
        """Return a rod of annular section (hose); arguments as in `circular`."""
        outer = number('outer_diameter', outer_diameter, InvalidRod, above=0)
        inner = number('inner_diameter', inner_diameter, InvalidRod, minimum=0)
        if inner >= outer:
            raise InvalidRod(
                f'inner_diameter = {inner!r}: expected less than outer_diameter {outer!r}')
        rho = number('density', density, InvalidRod, minimum=0)
        modulus, shear = _moduli(youngs_modulus, poisson_ratio)
        fourth = outer**4 - inner**4
        return cls(length, rho * np.pi * (outer**2 - inner**2) / 4, modulus * np.pi * fourth / 64,
                   shear * np.pi * fourth / 32, **{'radius': outer / 2, **more})

    @classmethod
    def rectangular(cls, length, width, thickness, density, youngs_modulus, poisson_ratio, **more):
        """Return a rod of solid rectangular section (leaf spring), `width` along the n axis.

        EI_n = E w t^3 / 12 (soft if t < w), EI_b = E t w^3 / 12; GJ from Saint-Venant's series
        (Timoshenko and Goodier, Theory of Elasticity, art. 109).

        Args:
            length, width, thickness: metres
            density: kg/m^3
            youngs_modulus: Pa
            poisson_ratio: -1 < nu <= 0.5
            more: any other argument of `Rod`
        """
        w = number('width', width, InvalidRod, above=0)
        t = number('thickness', thickness, InvalidRod, above=0)
        rho = number('density', density, InvalidRod, minimum=0)
        modulus, shear = _moduli(youngs_modulus, poisson_ratio)
        bending = (modulus * w * t**3 / 12, modulus * t * w**3 / 12)
        return cls(length, rho * w * t, bending, shear * _rectangle_torsion_constant(w, t),
                   **{'radius': max(w, t) / 2, **more})


def _moduli(youngs_modulus, poisson_ratio):
    modulus = number('youngs_modulus', youngs_modulus, InvalidRod, above=0)
    nu = number('poisson_ratio', poisson_ratio, InvalidRod, above=-1, maximum=0.5)
    return modulus, modulus / (2 * (1 + nu))


def _rectangle_torsion_constant(a, b):
    long, short = max(a, b), min(a, b)
    n = np.arange(1, 400, 2)
    series = np.sum(np.tanh(np.pi * n * long / (2 * short)) / n**5)
    return long * short**3 / 3 * (1 - 192 / np.pi**5 * short / long * series)
