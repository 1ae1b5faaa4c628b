# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a fit seeks: properties of a rod, as numbers x that are 0 for the rod of the first guess.

Stiffness and masses are sought by their logarithms, natural strains in units that bend or twist the
DLO by 0.1 rad, damping in units of about 5 % of critical damping of the slowest vibration.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.checks import choice, items, row
from dlo_planner.model.rod import Rod
from dlo_planner.model.section import Section
from dlo_planner.model.varying import Along, Scaled, Table, scaled
from dlo_planner.verify.uncertainty import Uncertainty

_BENT = 0.1    # rad along the length: how far a natural strain is moved as one unit
_DAMPED = 0.1  # twice the damping ratio that is one unit of damping
_SLOWEST = 3.516  # w L^2 sqrt(m / EI) of a cantilever
_FARTHEST = 60.0  # of all unknowns
_OFF = 0.5  # a bound: without damping a motion may go anywhere

_SCALES = {  # attribute of the Rod, and which of its components a logarithm scales
    'bending_stiffness': ('bending_stiffness', (1.0, 1.0)),
    'bending_stiffness_n': ('bending_stiffness', (1.0, 0.0)),
    'bending_stiffness_b': ('bending_stiffness', (0.0, 1.0)),
    'torsional_stiffness': ('torsional_stiffness', (1.0,)),
    'mass_per_length': ('mass_per_length', (1.0,)), 'tip_mass': ('tip_mass', (1.0,))}
_STRAINS = {'natural_curvature': 2, 'natural_twist': 1}  # components
_UNCERTAINTY = {'bending_stiffness_n': 'bending_stiffness',
                'bending_stiffness_b': 'bending_stiffness', 'mass_per_length': 'mass',
                'tip_mass': 'mass'}
PARAMETERS = (*_SCALES, *_STRAINS, 'damping')


class Unknowns:
    """Parameters of a Rod as unknowns x (n,).

    Parameters
    ----------
    rod : Rod
        Rod, x = 0.
    names : iterable of str
        Names out of PARAMETERS.
    knots : array_like, optional
        Arc lengths (k,), m, between which natural strains are straight. If None, they are constant.

    Attributes
    ----------
    size : int
        Number of unknowns.
    lower : ndarray, shape (n,)
        Bounds of x.
    upper : ndarray, shape (n,)
        Bounds of x.
    begin : ndarray, shape (n,)
        Where to begin: 0, but off the bounds.
    stiff : ndarray, shape (n,)
        1 for stiffness, 0 else.
    at_rest : ndarray of bool, shape (n,)
        Whether shapes at rest depend on it.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    size: int
    lower: Floats
    upper: Floats
    begin: Floats
    stiff: Floats
    at_rest: Bools

    def __init__(self, rod: Rod, names: Iterable[str], knots: ArrayLike | None = None) -> None:
        self.rod, self.names = rod, items('parameters', names, str, least=1)
        self.knots = None if knots is None else _checked_knots(knots, rod)
        for name in self.names:
            choice('parameters', name, PARAMETERS)
        self._judge()
        sizes = [self._size(name) for name in self.names]
        self.size = sum(sizes)
        self._slices = dict(zip(self.names, map(slice, np.cumsum([0, *sizes[:-1]]),
                                                np.cumsum(sizes)), strict=True))
        each = np.repeat(self.names, sizes)
        self.stiff = np.array([float(name.endswith(('stiffness', 'stiffness_n', 'stiffness_b')))
                               for name in each])
        self.at_rest = each != 'damping'
        self.lower, self.upper = np.full(self.size, -_FARTHEST), np.full(self.size, _FARTHEST)
        if 'damping' in self.names:  # it does not feed a motion
            damped = self._slices['damping']
            self.lower[damped] = -np.array(rod.damping) / self._damping_units()
            self.upper[damped] = np.inf
        self.begin = np.where(self.lower > -_OFF, self.lower + _OFF, 0.0)

    def _judge(self) -> None:
        names, rod = self.names, self.rod
        if len(set(names)) < len(names):
            raise InvalidTask(f'parameters = {names!r}: expected each name once')
        if 'bending_stiffness' in names and len({*names} & {*_UNCERTAINTY}) > len(
                {*names} & {'mass_per_length', 'tip_mass'}):
            raise InvalidTask(f'parameters = {names!r}: expected bending_stiffness or its '
                              'components, not both')
        for name in _STRAINS:
            if name in names and self.knots is None and callable(getattr(rod, name)):
                raise InvalidTask(f'Rod.{name}: expected numbers where it is to be found, or knots')
        if 'tip_mass' in names and not rod.tip_mass:
            raise InvalidTask('Rod.tip_mass = 0: expected a first guess where it is to be found')
        if 'mass_per_length' in names and not rod.node_masses(np.array([0, rod.length])).any():
            raise InvalidTask('Rod.mass_per_length = 0: expected a first guess where it is to be '
                              'found')
        if self.knots is not None and not {*names} & {*_STRAINS}:
            raise InvalidTask(f'knots: expected natural_curvature or natural_twist among the '
                              f'parameters, got {names!r}')

    def _size(self, name: str) -> int:
        if name in _STRAINS:
            return _STRAINS[name] * (1 if self.knots is None else self.knots.size)
        return 2 if name == 'damping' else 1

    def of(self, x: Floats) -> Rod:
        """Return the Rod at unknowns x (n,)."""
        found: dict[str, Any] = {}
        for name, where in self._slices.items():
            if name in _SCALES:
                attribute, share = _SCALES[name]
                known = found.get(attribute, getattr(self.rod, attribute))
                found[attribute] = _scaled(known, np.exp(x[where][0] * np.array(share)))
            elif name in _STRAINS:
                found[name] = self._natural(name, x[where])
            else:
                damping = np.array(self.rod.damping) + self._damping_units() * x[where]
                found[name] = tuple(np.maximum(damping, 0.0))
        return replace(self.rod, section=self._section(x), **found)

    def _section(self, x: Floats) -> Section | None:
        """Return the Section whose material gives the stiffness at x; None without one."""
        section, moduli = self.rod.section, {}
        if section is None or {'bending_stiffness_n', 'bending_stiffness_b'} & {*self.names}:
            return None
        for name, modulus in (('bending_stiffness', 'youngs_modulus'),
                              ('torsional_stiffness', 'shear_modulus')):
            if name in self.names:
                moduli[modulus] = getattr(section, modulus) * np.exp(x[self._slices[name]][0])
        return replace(section, **moduli)

    def _natural(self, name: str, x: Floats) -> Along:
        """Return what the Rod is given of a natural strain: numbers, or a Table."""
        values = self._first(name) + _BENT / self.rod.length * x.reshape(-1, _STRAINS[name])
        if len(values) == 1:
            return tuple(values[0]) if name == 'natural_curvature' else float(values[0, 0])
        assert self.knots is not None  # without them there is one value
        return Table(self.knots, values if name == 'natural_curvature' else values[:, 0])

    def _first(self, name: str) -> Floats:
        """Return (k, components) of a natural strain in the first guess, 1/m."""
        at = np.zeros(1) if self.knots is None else self.knots
        strains = self.rod.natural_strains(at)
        return strains[:, 1:] if name == 'natural_curvature' else strains[:, :1]

    def _damping_units(self) -> Floats:
        rod = self.rod
        mass = rod.node_masses(np.array([0, rod.length])).sum() + rod.tip_mass + sum(
            kg for _, kg in rod.point_masses)
        if mass == 0:
            raise InvalidTask('Rod.mass_per_length = 0: expected some mass where damping is to be '
                              'found')
        rate = _SLOWEST * np.sqrt(rod.stiffness[1:].min() / (mass * rod.length**3))
        return np.array([_DAMPED * rate, _DAMPED / rate])

    def values(self, x: Floats) -> dict[str, Any]:
        """Return dict of the parameters' values at x, SI units."""
        rod, out = self.of(x), {}
        for name, where in self._slices.items():
            if name in _SCALES:
                numbers = _numbers(rod, name)
            elif name in _STRAINS:
                numbers = self._first(name).ravel() + _BENT / rod.length * x[where]
            else:
                numbers = np.array(rod.damping)
            out[name] = self.shaped(name, numbers)
        return out

    def shaped(self, name: str, numbers: Iterable[float]) -> Any:
        """Return the numbers of a parameter as its value is written: alone, as pair, per knot."""
        values = tuple(float(number) for number in numbers)
        if name in _STRAINS and self.knots is not None:
            width = _STRAINS[name]
            return values if width == 1 else tuple(
                values[k:k + 2] for k in range(0, len(values), 2))
        return values[0] if len(values) == 1 else values

    def deviations(self, x: Floats, spread: Floats) -> dict[str, Any]:
        """Return dict of standard deviations of the values at x, those of x being `spread` (n,).

        What is known by its logarithm is log-normal: known badly, its deviation is larger yet.
        """
        rod, out = self.of(x), {}
        for name, where in self._slices.items():
            if name in _SCALES:
                with np.errstate(over='ignore'):
                    wide = np.exp(0.5 * spread[where] ** 2) * np.sqrt(np.expm1(spread[where] ** 2))
                numbers = _numbers(rod, name) * wide
            elif name == 'damping':
                numbers = self._damping_units() * spread[where]
            else:
                numbers = _BENT / rod.length * spread[where]
            out[name] = self.shaped(name, numbers)
        return out

    @property
    def columns(self) -> Ints:
        """(numbers of all values,) the unknown that tells each; a pair with a ratio has one."""
        each: list[int] = []
        for name, where in self._slices.items():
            each += [where.start] * 2 if name == 'bending_stiffness' else range(where.start,
                                                                                where.stop)
        return np.array(each)

    def prior(self, uncertainty: Uncertainty) -> Floats:
        """Return (n,): 1 / standard deviation of each unknown in an Uncertainty, 0 for none."""
        out = np.zeros(self.size)
        for name, where in self._slices.items():
            known = getattr(uncertainty, _UNCERTAINTY.get(name, name), 0.0)
            if known:
                out[where] = (_BENT / self.rod.length if name in _STRAINS else 1.0) / known
        return out


def _scaled(content: Along, factors: Floats) -> Along:
    """Return a number, a pair or a function of s, times factors (1,) or (2,)."""
    if factors.size == 1:
        return scaled(content, float(factors[0]))
    return Scaled(content, factors) if callable(content) else tuple(content * factors)


def _numbers(rod: Rod, name: str) -> Floats:
    """Return the numbers (1,) or (2,) that tell a scaled property; means where it varies."""
    if name == 'mass_per_length':
        masses = rod.node_masses(np.array([0.0, rod.length]))
        return np.array([masses.sum() / rod.length])
    if name == 'tip_mass':
        return np.array([rod.tip_mass])
    columns = {'torsional_stiffness': [0], 'bending_stiffness': [1, 2],
               'bending_stiffness_n': [1], 'bending_stiffness_b': [2]}[name]
    return rod.stiffness[columns]


def _checked_knots(knots: ArrayLike, rod: Rod) -> Floats:
    knots = row('knots', knots, least=1, minimum=0, maximum=rod.length)
    if (np.diff(knots) <= 0).any():
        raise InvalidTask(f'knots = {knots.tolist()!r}: expected arc lengths that grow')
    return knots
