# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The DLO: its properties, its surface, a plug at its end, a part of it as a DLO of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from inspect import currentframe
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import DoubtfulInput, InvalidRod
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, row, shown
from dlo_planner.model.section import MODELS, MODULI, SIZES, Section
from dlo_planner.model.value import FrozenDict, Value, brief, put
from dlo_planner.model.varying import (
    VARYING,
    Along,
    AlongRod,
    Extended,
    Followed,
    Mapped,
    is_row,
    pair,
    varying,
)

# ------------------------------------------------------------------------------------------------
# The deformable linear object: length, mass, stiffness, natural shape.


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
        level = _level_of_user()
        for doubt in doubts(self) if level else ():
            warn(doubt, DoubtfulInput, stacklevel=level)

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
        rho = number('density', density, InvalidRod, minimum=0, unit='kg/m^3')
        return cls(length, rho * section.area, section.bending_stiffness,
                   section.torsional_stiffness, **{**given, **more})


_NUMBERS: dict[str, dict[str, Any]] = {
    'length': {'above': 0, 'unit': 'm'}, 'tip_mass': {'minimum': 0, 'unit': 'kg'},
    'yield_torsion': {'above': 0, 'unit': '1/m'}, 'hardening': {'minimum': 0, 'below': 1},
    'max_bend_curvature': {'above': 0, 'unit': '1/m'}}
_OPTIONAL = ('yield_torsion', 'max_bend_curvature')


def _size(name: str, value: object) -> float:
    return number(name, value, InvalidRod, minimum=SIZES[0], maximum=SIZES[1], unit='m')


# ------------------------------------------------------------------------------------------------
# What of a DLO is possible, but probably not meant.


_SLENDER = 0.1                # thickness by length: the model leaves out shear
_LIMP = 1e6                   # w L^3 / EI: of what bends so easily
_DENSITIES = (300.0, 25e3)    # kg/m^3, of solids: from foam and cork to platinum
_LONGEST, _THICKEST = 100.0, 0.5  # m: what a gripper holds is less
_OWN = ('dataclasses', __name__)  # modules through which whoever states a Rod comes here


def doubts(rod: Rod, gravity: ArrayLike = (0.0, 0.0, -9.81)) -> list[str]:
    """Return what of a Rod is probably not meant, or beyond the model, one sentence each.

    Every door says it: Python as a `DoubtfulInput` warning, the terminal and the node's log.
    """
    middle, thickness = [0.5 * rod.length], 2 * Surface.of(rod).radius
    per_length = float(rod.masses_per_length(middle)[0])
    weight = per_length * np.linalg.norm(np.asarray(gravity, dtype=float))
    with np.errstate(over='ignore'):  # of what is 1e75 m long, as Rod may be
        limpness = float(weight * rod.length**3 / rod.stiffnesses(middle)[0, 1:].min())
    area = np.pi * rod.radii(middle)[0]**2 if rod.section is None else rod.section.area
    density = per_length / area if area > 0 else 0.0
    found = []
    if rod.length > _LONGEST:
        found.append(f'{rod.length:g} m long, more than {_LONGEST:g} m: is its length in m, not in '
                     'mm?')
    if thickness > _SLENDER * rod.length:
        found.append(f'{thickness:g} m thick, {rod.length:g} m long: the model, which leaves out '
                     'shear, is for what is ten times as long as thick; are both in m?')
    elif thickness > _THICKEST:
        found.append(f'{thickness:g} m thick, more than {_THICKEST:g} m: is its diameter in m, not '
                     'in mm?')
    if limpness > _LIMP:
        found.append(f'w L^3 / EI = {limpness:.3g}: it hangs like a chain; is its stiffness in Pa '
                     'or N m^2?')
    if density > 0 and not _DENSITIES[0] <= density <= _DENSITIES[1]:
        found.append(f'density {density:.3g} kg/m^3 by its mass and section, solids have '
                     f'{_DENSITIES[0]:g} to {_DENSITIES[1]:g}: is it in kg/m^3, its mass in kg/m, '
                     'its diameter in m?')
    return [f'rod: {one}' for one in found]


def _level_of_user() -> int:
    """Return the `stacklevel`, seen from `Rod`, of who states a Rod; 0 if it is the package.

    Parts of a DLO, and the thousands that a search tries, are no statement of anybody.
    """
    level, frame = 0, currentframe()
    while frame is not None and frame.f_globals.get('__name__') in _OWN:
        level, frame = level + 1, frame.f_back
    home = '' if frame is None else str(frame.f_globals.get('__name__', ''))
    return 0 if not home or home.startswith(_PACKAGE) else level


_PACKAGE = f'{__name__.partition(".")[0]}.'


# ------------------------------------------------------------------------------------------------
# The outside of a DLO: what contact and clearance need to know of a Rod.


_BESIDE = 1e-7  # of an element: so near to its ends the radius is asked for
_JUMP = 1e-3    # of the radius: what changes by more at a node has an end face there


@dataclass(frozen=True, eq=False, repr=False)
class Surface(Value):
    """How far the outside of a DLO is from its axis.

    Attributes
    ----------
    radius : float
        Radius in m, the largest.
    half : (float, float) or None
        (half_n, half_b) of a rectangular section, m. If None, round.
    rod : Rod or None
        Rod whose radius varies along s, or None.
    """

    radius: float = 0.0
    half: tuple[float, float] | None = None
    rod: Rod | None = None

    @classmethod
    def of(cls, rod: Rod) -> Surface:
        """Return the Surface of a Rod.

        A rectangular `Rod.section` counts where `Rod.radius` is its bounding half size; another
        radius is that of a round cover.
        """
        if rod.radius is None:
            return cls()
        section = rod.section
        if callable(rod.radius):
            breaks = np.asarray(getattr(rod.radius, 'breaks', ()), dtype=float)
            beside = np.outer(breaks, (1 - _BESIDE, 1, 1 + _BESIDE)).ravel()
            probes = np.append(np.linspace(0, rod.length, 1025), beside)
            return cls(float(rod.radii(np.clip(probes, 0, rod.length)).max()), None, rod)
        radius = float(rod.radii([0.0])[0])
        if (section is not None and section.kind == 'rectangular'
                and radius == max(section.half_n, section.half_b)):
            return cls(radius, (section.half_n, section.half_b))
        return cls(radius)

    @property
    def bound(self) -> float:
        """The largest distance of the outside from the axis, m."""
        return self.radius if self.half is None else float(np.hypot(*self.half))

    def least_radii(self, s: Floats) -> Floats:
        """Return (N,) how near the outside is to the axis in elements of a mesh s (N + 1,), m."""
        if self.rod is None:
            return np.full(s.size - 1, self.least)
        radii: Floats = self.radii(s).min(axis=1)
        return radii

    @property
    def least(self) -> float:
        """The smallest distance of the outside from the axis, m."""
        return self.radius if self.half is None else min(self.half)

    def radii(self, s: Floats) -> Floats:
        """Return (N, 2) the radius in m at both ends of the N elements of a mesh `s` (N + 1,), m.

        They are those of balls inside the DLO: near an end face of a thicker part, a jump of the
        radius at a node, a ball reaches as far as the face. (0, 2) where the radius is constant.
        """
        if self.rod is None:
            return np.zeros((0, 2))
        outside = self._outside(self.rod, s)
        radii = outside.copy()
        ends = np.column_stack([s[:-1], s[1:]])
        for node, side in self._faces(outside):
            thin, thick = np.sort([outside[node - 1, 1], outside[node, 0]])
            away = side * (ends - s[node])
            near = (0.5 * away.sum(axis=1) > 0) & (away.min(axis=1) < thick)
            radii[near] = np.minimum(radii[near], np.maximum(away[near], thin))
        return radii

    def rims(self, s: Floats) -> list[tuple[float, tuple[int, int]]]:
        """Return [(radius in m, (first, last) node)] of the rims of end faces on a mesh `s`, m.

        A rim goes on along the DLO as far as balls inside it do not reach the outside.
        """
        if self.rod is None:
            return []
        outside = self._outside(self.rod, s)
        rims = []
        for node, side in self._faces(outside):
            radius = float(max(outside[node - 1, 1], outside[node, 0]))
            other = node
            while 0 < other < s.size - 1 and side * (s[other] - s[node]) < radius and (
                    outside[other if side > 0 else other - 1].min() >= radius * (1 - _JUMP)):
                other += side
            rims.append((radius, (min(node, other), max(node, other))))
        return rims

    def _outside(self, rod: Rod, s: Floats) -> Floats:
        beside = _BESIDE * np.diff(s)
        return np.column_stack([rod.radii(s[:-1] + beside), rod.radii(s[1:] - beside)])

    def _faces(self, outside: Floats) -> Iterator[tuple[int, int]]:
        """Yield node and way, 1 or -1, into the thicker part, of each jump of the radius."""
        for node in range(1, len(outside)):
            before, behind = outside[node - 1, 1], outside[node, 0]
            if abs(behind - before) > _JUMP * max(before, behind):
                yield node, 1 if behind > before else -1


# ------------------------------------------------------------------------------------------------
# A rigid body fixed to the tip of a DLO: a plug, a connector, a nut.


_RIGID = 1e6  # times the rod's stiffness
_FLUSH = 1e-12  # of the length


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
    faces = begin, end  # masses are at them, or not next to them: a node is at each
    places = tuple(next((face for face in faces if abs(place - face) < _FLUSH * end), place)
                   for place in (begin + center - arm, begin + center + arm))
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
                      *((s, 0.5 * mass) for s in places)), **changed)


def _arm(rod: Rod, size: float, mass: float, radius: float | None, center: float,
         inertia: float | None) -> float:
    """Return how far from the body's center, m, the two masses are that stand for it."""
    most = mass * min(center, size - center) ** 2
    if inertia is None:
        across = rod.radii([rod.length])[0] if radius is None else radius
        inertia = min(mass * (3 * across**2 + size**2) / 12, most)
    else:
        inertia = number('inertia', inertia, InvalidRod, minimum=0, maximum=most)
    return float(np.sqrt(inertia / mass)) if mass else 0.0


# ------------------------------------------------------------------------------------------------
# A part of a DLO as a DLO of its own.


BACK = np.array([1.0, -1.0, 1.0])  # strains, seen along the DLO in the other direction


def before(rod: Rod, end: float, carried: float = 0.0) -> Rod:
    """Return the Rod from 0 to `end` (m), without what is fixed to it beyond.

    carried: part of the masses at `end` that something else carries.
    """
    part = replace(rod, length=end, tip_mass=(1 - carried) * rod.tip_mass if end == rod.length
                   else 0.0, nodes=tuple(s for s in rod.nodes if s <= end),
                   point_masses=tuple((s, mass * (1 - carried if s == end else 1))
                                      for s, mass in rod.point_masses if s <= end))
    return _profiled(part, rod, 0.0)


def _profiled(part: Rod, rod: Rod, begin: float) -> Rod:
    """Return a part of a Rod, from `begin` (m) on, that knows its Profiles: a new look is slow."""
    put(part, _profiles=FrozenDict({name: profile.part(begin, begin + part.length)
                                    for name, profile in rod._profiles.items()}))
    return part


def of_length(rod: Rod, length: float) -> Rod:
    """Return a Rod of another length (m); what is fixed at the end or beyond it goes to the end."""
    end = min(rod.length, length)

    def there(s: float) -> float:
        return length if s >= end else s
    return replace(rod, length=length, nodes=tuple(there(s) for s in rod.nodes),
                   point_masses=tuple((there(s), mass) for s, mass in rod.point_masses))


def part_of_rod(rod: Rod, at: float, direction: int) -> Rod:
    """Return the Rod from `at` to one end: way = 1 on to L, -1 back to 0."""
    length = at if direction < 0 else rod.length - at
    masses = []
    for s, mass in rod.point_masses:
        if (s - at) * direction > 0 or (s == at and direction > 0):
            masses.append((abs(s - at), mass))
    signs = BACK[1:] if direction < 0 else np.ones(2)
    curvature = rod.natural_curvature
    changed: dict[str, Any] = {name: Mapped(getattr(rod, name), 1.0, at, direction)
               for name in ('mass_per_length', 'natural_twist', 'bending_stiffness',
                            'torsional_stiffness', 'radius') if callable(getattr(rod, name))}
    nodes = tuple(abs(s - at) for s in rod.nodes if (s - at) * direction > 0)
    part = replace(rod, length=length, point_masses=tuple(masses), nodes=nodes,
                   tip_mass=rod.tip_mass if direction > 0 else 0.0,
                   natural_curvature=Mapped(curvature, signs, at, direction)
                   if callable(curvature) else tuple(signs * curvature), **changed)
    return _profiled(part, rod, at) if direction > 0 else part


def followed_by(rod: Rod, at: float, end: Rod) -> Rod:
    """Return the Rod that is `rod` up to `at` (m), and `end` from there on: see `part_of_rod`.

    What holds for all of it, as limits and damping, is that of `rod`; a Section that of `end`.
    """
    changed: dict[str, Any] = {}
    for name in ('mass_per_length', 'natural_curvature', 'natural_twist', 'bending_stiffness',
                 'torsional_stiffness', 'radius'):
        one, other = getattr(rod, name), getattr(end, name)
        if callable(one) or callable(other) or one != other:
            changed[name] = Followed(one, at, other)
    return replace(
        rod, length=at + end.length, tip_mass=end.tip_mass, section=end.section,
        section_model=end.section_model,
        point_masses=(*((s, mass) for s, mass in rod.point_masses if s < at),
                      *((at + s, mass) for s, mass in end.point_masses)),
        nodes=(*(s for s in rod.nodes if s < at), *(at + s for s in end.nodes)), **changed)
