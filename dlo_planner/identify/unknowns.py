# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The properties of a rod that a fit seeks: names, units, bounds, and how values are written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.identify.parameters import STIFFNESS, STRAINS, RodParameters, Uncertainty
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import choice, items, row
from dlo_planner.model.rod import Rod

_BENT = 0.1    # rad along the length: one unit of a natural strain
_DAMPED = 0.1  # twice the damping ratio that is one unit of damping
_SLOWEST = 3.516  # w L^2 sqrt(m / EI) of a cantilever
_FARTHEST = 60.0  # of all unknowns
_OFF = 0.5  # a bound: without damping a motion may go anywhere
_LOGARITHMS = (*STIFFNESS, 'mass_per_length', 'tip_mass')
_NAMES = (*_LOGARITHMS, *STRAINS, 'damping')
_UNCERTAINTY = {'bending_stiffness_n': 'bending_stiffness',
                'bending_stiffness_b': 'bending_stiffness', 'mass_per_length': 'mass',
                'tip_mass': 'mass'}


class Unknowns:
    """Unknowns x (n,), 0 for the first guess: `RodParameters` in units of about one size.

    Stiffness and masses are logarithms; a unit of natural strains bends or twists the DLO by 0.1
    rad, one of damping is about 5 % of critical damping of the slowest vibration. Natural strains
    at `knots` (k,), m, are straight between; else constant. InvalidTask: names that make no sense.
    """

    lower: Floats    # (n,) bounds of x
    upper: Floats
    begin: Floats    # (n,) where to begin: 0, but off the bounds
    stiff: Floats    # (n,) 1 for stiffness, 0 else

    def __init__(self, rod: Rod, names: Iterable[str], knots: ArrayLike | None = None) -> None:
        self.rod, self.names = rod, items('parameters', names, str, least=1)
        self.knots = None if knots is None else _checked_knots(knots, rod)
        for name in self.names:
            choice('parameters', name, _NAMES)
        _check(rod, self.names, self.knots)
        units = {name: np.full(len(STRAINS[name]) * (1 if self.knots is None else self.knots.size),
                               _BENT / rod.length) for name in STRAINS}
        units |= {name: np.ones(1) for name in _LOGARITHMS}
        if 'damping' in self.names:
            units['damping'] = _damping_units(rod)
        self.units = np.concatenate([units[name] for name in self.names])
        self.size, ends = self.units.size, np.cumsum([units[name].size for name in self.names])
        self._slices = {name: slice(end - units[name].size, end)
                        for name, end in zip(self.names, ends, strict=True)}
        each = np.repeat(self.names, [units[name].size for name in self.names])
        self.parameters = RodParameters(
            rod, each.tolist(), (k for name in self.names for k in range(units[name].size)),
            self.knots if {*self.names} & {*STRAINS} else None)
        self.stiff = np.isin(each, tuple(STIFFNESS)).astype(float)
        self.lower, self.upper = np.full(self.size, -_FARTHEST), np.full(self.size, _FARTHEST)
        if 'damping' in self.names:  # it does not feed a motion
            damped = self._slices['damping']
            self.lower[damped] = -np.array(rod.damping) / units['damping']
            self.upper[damped] = np.inf
        self.begin = np.where(self.lower > -_OFF, self.lower + _OFF, 0.0)

    def of(self, x: Floats) -> Rod:
        """Return the Rod at unknowns x (n,)."""
        return self.parameters.at(self.units * x)

    def values(self, x: Floats) -> dict[str, Any]:
        """Return dict of the parameters' values at x, SI units."""
        rod = self.of(x)
        return {name: self._written(name, self._numbers(rod, name)) for name in self.names}

    def deviations(self, x: Floats, spread: Floats) -> dict[str, Any]:
        """Return dict of standard deviations of the values at x, those of x being `spread` (n,).

        What is known by its logarithm is log-normal: known badly, its deviation is larger yet.
        """
        rod, out = self.of(x), {}
        for name, where in self._slices.items():
            numbers = self.units[where] * spread[where]
            if name in _LOGARITHMS:
                with np.errstate(over='ignore'):
                    numbers = self._numbers(rod, name) * np.exp(0.5 * numbers**2) * np.sqrt(
                        np.expm1(numbers**2))
            out[name] = self._written(name, numbers)
        return out

    def _numbers(self, rod: Rod, name: str) -> Floats:
        """Return the numbers that tell a property of a Rod; means where what is scaled varies."""
        if name in STIFFNESS:
            return rod.stiffness[np.flatnonzero(STIFFNESS[name])]
        if name in STRAINS:
            at = np.zeros(1) if self.knots is None else self.knots
            return rod.natural_strains(at)[:, list(STRAINS[name])].ravel()
        if name == 'mass_per_length':
            return np.array([_own_mass(rod) / rod.length])
        return np.atleast_1d(getattr(rod, name)).astype(float)

    def _written(self, name: str, numbers: Floats) -> Any:
        """Return the numbers of a parameter as its value is written: alone, as pair, per knot."""
        values = tuple(numbers.tolist())
        if name in STRAINS and self.knots is not None:
            width = len(STRAINS[name])
            return values if width == 1 else tuple(
                values[k:k + 2] for k in range(0, len(values), 2))
        return values[0] if len(values) == 1 else values

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
                out[where] = self.units[where] / known
        return out


def _check(rod: Rod, names: Sequence[str], knots: Floats | None) -> None:
    if len(set(names)) < len(names):
        raise InvalidTask(f'parameters = {names!r}: expected each name once')
    if 'bending_stiffness' in names and {*names} & {'bending_stiffness_n', 'bending_stiffness_b'}:
        raise InvalidTask(f'parameters = {names!r}: expected bending_stiffness or its components, '
                          'not both')
    for name in STRAINS:
        if name in names and knots is None and callable(getattr(rod, name)):
            raise InvalidTask(f'Rod.{name}: expected numbers where it is to be found, or knots')
    if 'tip_mass' in names and not rod.tip_mass:
        raise InvalidTask('Rod.tip_mass = 0: expected a first guess where it is to be found')
    if 'mass_per_length' in names and not _own_mass(rod):
        raise InvalidTask('Rod.mass_per_length = 0: expected a first guess where it is to be found')
    if knots is not None and not {*names} & {*STRAINS}:
        raise InvalidTask(f'knots: expected natural_curvature or natural_twist among the '
                          f'parameters, got {names!r}')


def _own_mass(rod: Rod) -> float:
    """Return the mass that is spread along a Rod, kg."""
    return float(rod.node_masses(np.array([0.0, rod.length])).sum())


def _damping_units(rod: Rod) -> Floats:
    mass = _own_mass(rod) + rod.tip_mass + sum(kg for _, kg in rod.point_masses)
    if mass == 0:
        raise InvalidTask('Rod.mass_per_length = 0: expected some mass where damping is to be '
                          'found')
    rate = _SLOWEST * np.sqrt(rod.stiffness[1:].min() / (mass * rod.length**3))
    return np.array([_DAMPED * rate, _DAMPED / rate])


def _checked_knots(knots: ArrayLike, rod: Rod) -> Floats:
    knots = row('knots', knots, least=1, minimum=0, maximum=rod.length)
    if (np.diff(knots) <= 0).any():
        raise InvalidTask(f'knots = {knots.tolist()!r}: expected arc lengths that grow')
    return knots
