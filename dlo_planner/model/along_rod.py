# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What of a rod may vary along it: its values at arc lengths, and their means over elements."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidRod
from dlo_planner.model.along import Along, Table, breaks_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, number, returned, row, shown
from dlo_planner.model.profile import resolved, straight
from dlo_planner.model.stated import ONE, pair
from dlo_planner.model.value import FrozenDict, Value

VARYING = {  # how a value is written, and limits
    'mass_per_length': (ONE, {'minimum': 0}), 'bending_stiffness': ('EI or (EI_n, EI_b)',
                                                                    {'above': 0}),
    'torsional_stiffness': (ONE, {'above': 0}), 'natural_curvature': ('(k_n, k_b)', {}),
    'natural_twist': (ONE, {}), 'radius': (ONE, {'above': 0})}
_NATURAL = ('natural_twist', 'natural_curvature')
_STIFF = ('torsional_stiffness', 'bending_stiffness')


class AlongRod(Value):
    """Base of `Rod`: reads what is a number, a table or a function of arc length."""

    REMEMBERED = ('_profiles',)  # functions are asked hundreds of times for them

    length: float
    mass_per_length: Along
    nodes: tuple[float, ...]

    @property
    def varies(self) -> bool:
        """Whether any property varies along the DLO."""
        return any(callable(getattr(self, name)) for name in VARYING)

    def masses_per_length(self, s: ArrayLike) -> Floats:
        """Return the mass per length at arc lengths `s` (n,) as (n,), kg/m."""
        return self._values('mass_per_length', s)[:, 0]

    def natural_strains(self, s: ArrayLike) -> Floats:
        """Return the stress-free strains at arc lengths `s` (n,) as (n, 3), 1/m."""
        return np.hstack([self._values(name, s) for name in _NATURAL])

    def stiffnesses(self, s: ArrayLike) -> Floats:
        """Return GJ, EI_n and EI_b at arc lengths `s` (n,) as (n, 3), N m^2."""
        return np.hstack([self._values(name, s) for name in _STIFF])

    def radii(self, s: ArrayLike) -> Floats:
        """Return the radius at arc lengths `s` (n,) as (n,), m; 0 of a thin line."""
        return self._values('radius', s)[:, 0]

    def mean_natural_strains(self, s: ArrayLike) -> Floats:
        """Return the means (N, 3) of the stress-free strains between nodes `s` (N + 1,), 1/m."""
        return self._means(_NATURAL, _mesh(s))

    def mean_stiffnesses(self, s: ArrayLike) -> Floats:
        """Return GJ, EI_n and EI_b (N, 3) with the compliance of the parts between nodes, N m^2.

        Their inverses are the means of the inverses, which is exact under a constant moment.
        """
        return self._means(_STIFF, _mesh(s))

    def node_masses(self, s: ArrayLike) -> Floats:
        """Return the masses (N + 1,) in kg at the nodes `s` that represent the rod's own mass.

        The mass of each element is shared by its two nodes, with the right total and center.
        """
        s = _mesh(s)
        if callable(self.mass_per_length):
            result: Floats = self._profiles['mass_per_length'].on_nodes(s)[:, 0]
            return result
        half = 0.5 * (s[1:] - s[:-1]) * self.mass_per_length
        masses = np.zeros(len(s))
        masses[:-1] += half
        masses[1:] += half
        return masses

    @cached_property
    def breaks(self) -> Floats:
        """Arc lengths (n,) inside the DLO at which every mesh has a node, m, ascending."""
        inner = [s for s in self.nodes if 0 < s < self.length]
        breaks = np.unique(np.concatenate([inner] + [
            profile.breaks for profile in self._profiles.values()]))
        breaks.flags.writeable = False
        return breaks

    @cached_property
    def _profiles(self) -> FrozenDict:
        """Dict of Profiles of what varies; that of a stiffness is one of its inverse."""
        profiles = {}
        for name in VARYING:
            content = getattr(self, name)
            if isinstance(content, Table) and name not in _STIFF:
                profiles[name] = straight(content, self.length)
            elif callable(content):
                profiles[name] = resolved(f'Rod.{name}', self._one(name), self.length,
                                          breaks_of(content), InvalidRod)
        return FrozenDict(profiles)

    def _means(self, names: tuple[str, str], s: Floats) -> Floats:
        """Return means (N, 3) of what has one component and of what has two."""
        values = np.empty((len(s) - 1, 3))
        values[:, :1], values[:, 1:] = (self._mean(name, s) for name in names)
        return values

    def _mean(self, name: str, s: Floats) -> Any:
        if not callable(getattr(self, name)):
            return getattr(self, name)
        means = self._profiles[name].means(s)
        return 1 / means if name in _STIFF else means

    def _one(self, name: str) -> Callable[[float], Floats]:
        """Return the function of s for which the Profile of a quantity stands."""
        inverse = name in _STIFF
        return lambda s: 1 / self._at(name, s) if inverse else self._at(name, s)

    def _values(self, name: str, s: ArrayLike) -> Floats:
        s = array('s', s, (None,), InvalidRod)
        content = getattr(self, name)
        if not callable(content):
            return np.tile(np.array(content or 0.0 if name == 'radius' else content, dtype=float),
                           (s.size, 1))
        return np.array([self._at(name, v) for v in s])

    def _at(self, name: str, s: float) -> Floats:
        """Return what a function states at `s`, (k,), judged."""
        parts, limits = VARYING[name]
        value = returned(f'Rod.{name}', getattr(self, name), s, InvalidRod)
        if parts == ONE:
            return np.array([number(f'Rod.{name}({s:g})', value, InvalidRod, **limits)])
        return np.array(pair(f'Rod.{name}({s:g})', value, parts, None, **limits))


def _mesh(s: ArrayLike) -> Floats:
    """Return nodes (N + 1,), ascending, as an array; raise InvalidRod if they are none."""
    if (type(s) is np.ndarray and s.dtype == float and s.ndim == 1 and s.size > 1
            and abs(s[0]) + abs(s[-1]) < np.inf and (s[1:] > s[:-1]).all()):
        return s
    s = row('s', s, InvalidRod, least=2)
    if (np.diff(s) <= 0).any():
        raise InvalidRod(f's = {shown(s.tolist())}: expected arc lengths that grow')
    return s
