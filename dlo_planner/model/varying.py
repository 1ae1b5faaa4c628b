# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What varies along a DLO: numbers, tables, functions of arc length, and their profiles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import scipy
from numpy.polynomial.legendre import legval
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidRod
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import NO_SEQUENCE, array, number, returned, row, shown
from dlo_planner.model.value import FrozenDict, Value, put

# ------------------------------------------------------------------------------------------------
# Quantities that vary along a DLO: numbers, tables and functions of arc length s, as values.


# A number, a pair, rows (s, value), or a function of s.
Along: TypeAlias = float | tuple[Any, ...] | Callable[[float], Any]


@dataclass(frozen=True, eq=False, repr=False)
class Piecewise(Value):
    """A function of arc length with stated jumps, which may be arbitrarily close together.

    Attributes
    ----------
    function : callable
        Callable of s (m).
    breaks : ndarray, shape (n,)
        Arc lengths in m at which it jumps.

    Raises
    ------
    InvalidRod
        The function cannot be called, or the breaks are not numbers.
    """

    function: Callable[[float], Any]
    breaks: Floats

    if TYPE_CHECKING:  # what may be given
        def __init__(self, function: Callable[[float], Any], breaks: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InvalidRod(f'Piecewise.function = {shown(self.function)}: expected a function '
                             'of s')
        put(self, breaks=row('Piecewise.breaks', self.breaks, InvalidRod, least=0))
        super().__post_init__()

    def __call__(self, s: float) -> Any:
        """Return the value at `s` (m)."""
        return self.function(s)


@dataclass(frozen=True, eq=False, repr=False)
class Table(Value):
    """Linear interpolation between the rows of a table; two rows at the same s are a jump.

    Before the first row and after the last one the values stay.
    """

    s: Floats       # (n,) m, ascending
    values: Floats  # (n,) or (n, k)

    @property
    def breaks(self) -> Floats:
        """(m,) arc lengths where it jumps or bends, m."""
        return np.unique(self.s)

    def __call__(self, s: float) -> Any:
        """Return the value at `s` (m)."""
        after = int(np.searchsorted(self.s, s, side='right'))  # at a jump: what comes after it
        if after in (0, self.s.size):
            return self.values[min(after, self.s.size - 1)]
        first = self.s[after - 1]
        share = (s - first) / (self.s[after] - first)
        return (1 - share) * self.values[after - 1] + share * self.values[after]


@dataclass(frozen=True, eq=False, repr=False)
class Components(Value):
    """Numbers, tables and functions side by side, one per component."""

    parts: tuple[Any, ...]

    @property
    def breaks(self) -> Floats:
        """(m,) arc lengths where one of them is known to jump, m."""
        return np.concatenate([breaks_of(part) for part in self.parts])

    def __call__(self, s: float) -> Floats:
        """Return the value at `s` (m)."""
        return np.array([part(s) if callable(part) else part for part in self.parts])


def stepwise(s: Floats, values: Floats) -> Table:
    """Return what is constant on each element of a mesh: nodes (N + 1,), m, and values (N, ...)."""
    return Table(np.repeat(s, 2)[1:-1], np.repeat(values, 2, axis=0))


@dataclass(frozen=True, eq=False, repr=False)
class Mapped(Value):
    """A function of arc length times a factor, as one of the distance from a place."""

    base: Callable[[float], Any]
    factor: float | Floats = 1.0  # one number, or one for each component
    at: float = 0.0               # m
    direction: int = 1            # 1: on from there, -1: back

    @property
    def breaks(self) -> Floats:
        """(n,) distances where it is known to jump, m."""
        return self.direction * (breaks_of(self.base) - self.at)

    def __call__(self, s: float) -> Any:
        """Return the value at the distance `s` (m)."""
        return self.factor * np.asarray(self.base(self.at + self.direction * s))


@dataclass(frozen=True, eq=False, repr=False)
class Extended(Value):
    """A number, pair or function of s up to `end` (m), and a constant from there on."""

    base: Along
    end: float
    beyond: float | tuple[float, ...]

    @property
    def breaks(self) -> Floats:
        """(n,) arc lengths where it is known to jump, m."""
        return np.append(breaks_of(self.base), self.end)

    def __call__(self, s: float) -> Any:
        """Return the value at `s` (m)."""
        if s >= self.end:
            return self.beyond
        return self.base(s) if callable(self.base) else self.base


@dataclass(frozen=True, eq=False, repr=False)
class Followed(Value):
    """A number, pair or function of s up to `end` (m), and another one of the distance beyond."""

    base: Along
    end: float
    beyond: Along

    @property
    def breaks(self) -> Floats:
        """(n,) arc lengths where it is known to jump, m."""
        first = breaks_of(self.base)
        return np.concatenate([first[first < self.end], [self.end],
                               self.end + breaks_of(self.beyond)])

    def __call__(self, s: float) -> Any:
        """Return the value at `s` (m)."""
        content, at = (self.beyond, s - self.end) if s >= self.end else (self.base, s)
        return content(at) if callable(content) else content


@dataclass(frozen=True, eq=False, repr=False)
class Expanded(Value):
    """A number, pair or function of s, plus a series of Legendre polynomials on [0, length]."""

    base: Along
    coefficients: Floats  # (m, k), or (m,) of a number, of P_0 ... P_{m-1} in 2 s / length - 1
    length: float         # m

    @property
    def breaks(self) -> Floats:
        """(n,) arc lengths where it is known to jump, m."""
        return breaks_of(self.base)

    def __call__(self, s: float) -> Floats:
        """Return the value at `s` (m)."""
        base = self.base(s) if callable(self.base) else self.base
        result: Floats = np.asarray(base) + legval(2 * s / self.length - 1, self.coefficients)
        return result


def breaks_of(content: object) -> Floats:
    """Return the arc lengths (n,) at which a number or a function states jumps, m."""
    return np.asarray(getattr(content, 'breaks', ()), dtype=float).ravel()


def scaled(content: Along, factor: float) -> Along:
    """Return a number, a tuple of numbers or a function of s, times `factor`."""
    if callable(content):
        return Mapped(content, factor)
    return tuple(factor * part for part in content) if isinstance(content, tuple) else (
        factor * content)


# ------------------------------------------------------------------------------------------------
# A function of arc length, resolved: polynomials between its jumps, with exact means.
#
# A mesh that reads a function at its own points is blind to what lies between them, and so is a
# finer mesh beside it. So each function is looked at once, on its own: panels are halved until
# polynomials through their Gauss points tell the function within 1e-8 of its size, which finds
# jumps by bisection; meshes take integrals of these polynomials.


_PANELS = 256        # to begin with: what is wider than 1/2000 of the length is seen
_POINTS = 5          # of Gauss in each panel
_CLOSE = 1e-8        # part of the largest value: two descriptions that differ by less are the same
_JUMP = 1e-6         # the same, between the two sides of a point
_NARROWEST = 2e-13   # of the length: a panel that is not halved any further
_ONE_PLACE = 1e-9    # of the length: jumps nearer to each other are one
_MOST = 16_000       # panels
_SHORT = 10          # terms of a Legendre series that _PANELS panels tell within _CLOSE

_X, _ = np.polynomial.legendre.leggauss(_POINTS)
_AT = 0.5 * (1 + _X)                                      # of a panel, in [0, 1]
_POWERS = np.linalg.inv(np.vander(_AT, increasing=True))  # values -> coefficients of powers
_INSIDE = 1e-6  # of a panel: a jump nearer to its end is at its end
_HALVES = np.concatenate([0.5 * _AT, 0.5 + 0.5 * _AT, [_INSIDE, 1 - _INSIDE]])
_AT_HALVES = np.vander(_HALVES, _POINTS, increasing=True) @ _POWERS
_AT_ENDS = np.vander([0.0, 1.0], _POINTS, increasing=True) @ _POWERS


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Value):
    """A quantity with k components along a DLO, as polynomials on m panels."""

    edges: Floats   # (m + 1,) of the panels, m
    values: Floats  # (m, 5, k) at their Gauss points
    breaks: Floats  # (n,) arc lengths inside the DLO at which it jumps, m

    @cached_property
    def _first(self) -> Any:
        """Antiderivative (k components) of the polynomials."""
        width = np.diff(self.edges)
        powers = np.einsum('ij,mjk->imk', _POWERS, self.values)
        powers = powers / width[None, :, None] ** np.arange(_POINTS)[:, None, None]
        edges = np.array(self.edges)  # SciPy 1.11 takes no read-only array here
        return scipy.interpolate.PPoly(powers[::-1], edges).antiderivative()

    @cached_property
    def _second(self) -> Any:
        return self._first.antiderivative()

    def part(self, begin: float, end: float) -> Profile:
        """Return the Profile between two arc lengths (m), which begins at the first of them."""
        edges, width = np.clip(self.edges, begin, end) - begin, np.diff(self.edges)
        inside = np.diff(edges) > 0
        share = ((edges[:-1, None] + begin - self.edges[:-1, None] + np.diff(edges)[:, None] * _AT)
                 / width[:, None])[inside]
        values = np.einsum('mpi,ij,mjk->mpk', share[..., None] ** np.arange(_POINTS), _POWERS,
                           self.values[inside])
        room = _ONE_PLACE * (end - begin)
        breaks = self.breaks[(self.breaks > begin + room) & (self.breaks < end - room)]
        return Profile(np.append(edges[:-1][inside], end - begin), values, breaks - begin)

    def means(self, s: Floats) -> Floats:
        """Return the means (N, k) over the elements between nodes `s` (N + 1,)."""
        result: Floats = np.diff(self._first(s), axis=0) / np.diff(s)[:, None]
        return result

    def on_nodes(self, s: Floats) -> Floats:
        """Return what of the integral counts for each node (N + 1, k): its total and its center."""
        first, twice = self._first(s), np.diff(self._second(s), axis=0) / np.diff(s)[:, None]
        nodes = np.zeros_like(first)
        nodes[:-1] += twice - first[:-1]
        nodes[1:] += first[1:] - twice
        result: Floats = nodes
        return result


def resolved(name: str, function: Callable[[float], Any], length: float, stated: ArrayLike = (),
             error: type[Exception] = InvalidRod) -> Profile:
    """Return the Profile of a function of s on [0, length]."""
    stated = np.unique(stated)
    stated = stated[(stated > 0) & (stated < length)]
    edges = np.union1d(np.linspace(0, length, _PANELS + 1), stated)
    left, width = edges[:-1], np.diff(edges)
    values = _at(function, left, width, _AT)
    size = np.abs(values).max(axis=(0, 1))
    panels = []
    while left.size:
        halves = _at(function, left, width, _HALVES)
        size = np.maximum(size, np.abs(halves).max(axis=(0, 1)))
        off = np.abs(np.einsum('ij,mjk->mik', _AT_HALVES, values) - halves).max(axis=1)
        good = (off <= _CLOSE * size).all(axis=1) | (width < _NARROWEST * length)
        panels.append((left[good], width[good], values[good]))
        left, width, halves = left[~good], 0.5 * width[~good], halves[~good]
        if left.size + sum(len(one[0]) for one in panels) > _MOST:
            raise error(f'{name}: expected a function that {_MOST} polynomials of degree '
                        f'{_POINTS - 1} can follow along the DLO, this one varies too wildly near '
                        f's = {left[0]:.6g} m')
        values = np.concatenate([halves[:, :_POINTS], halves[:, _POINTS:2 * _POINTS]])
        left = np.concatenate([left, left + width])
        width = np.concatenate([width, width])
    left, width, values = (np.concatenate(parts) for parts in zip(*panels, strict=True))
    order = np.argsort(left)
    left, width, values = left[order], width[order], values[order]
    return Profile(np.append(left, length), values, _breaks(left, width, values, size, length))


def straight(table: Table, length: float) -> Profile:
    """Return the Profile of a Table on [0, length]: known without a look at it."""
    inside = (table.s > 0) & (table.s < length)
    edges = np.unique(np.concatenate([[0.0], table.s[inside], [length]]))
    values = _at(lambda s: np.atleast_1d(table(s)), edges[:-1], np.diff(edges), _AT)
    rows = table.values.reshape(table.s.size, -1)
    change = (np.abs(np.diff(rows, axis=0)) > _JUMP * np.abs(rows).max(axis=0)).any(axis=1)
    return Profile(edges, values, table.s[1:][inside[1:] & (np.diff(table.s) == 0) & change])


def smooth(content: Expanded, length: float) -> Profile:
    """Return the Profile on [0, length] of a constant plus a short series, without a look at it."""
    edges = np.linspace(0, length, _PANELS + 1)
    places = edges[:-1, None] + np.diff(edges)[:, None] * _AT
    values: Floats = np.asarray(content.base) + np.moveaxis(
        legval(2 * places / content.length - 1,
               content.coefficients.reshape(len(content.coefficients), -1)), 0, -1)
    return Profile(edges, values, np.zeros(0))


def _at(function: Callable[[float], Any], left: Floats, width: Floats, places: Floats) -> Floats:
    """Return the function's values (m, p, k) at `places` (p,) of panels."""
    return np.array([[function(a + h * x) for x in places]
                     for a, h in zip(left.tolist(), width.tolist(), strict=True)])


def _breaks(left: Floats, width: Floats, values: Floats, size: Floats, length: float) -> Floats:
    """Return where the polynomials of neighbors do not meet, or where a panel is a point."""
    ends = np.einsum('ij,mjk->mik', _AT_ENDS, values)
    jumps = (np.abs(ends[1:, 0] - ends[:-1, 1]) > _JUMP * size).any(axis=1)
    breaks: Floats = np.sort(np.concatenate([left[1:][jumps],
                                             left[width < 2 * _NARROWEST * length]]))
    breaks = breaks[(breaks > _ONE_PLACE * length) & (breaks < (1 - _ONE_PLACE) * length)]
    if not breaks.size:
        return breaks
    result: Floats = breaks[np.append(True, np.diff(breaks) > _ONE_PLACE * length)]
    return result


# ------------------------------------------------------------------------------------------------
# Quantities as users state them: numbers, pairs, tables and functions of s, judged.


ONE = 'one'  # how a value is written that is a single number


def varying(name: str, content: Any, written: str = ONE, **limits: Any) -> Along:
    """Return a quantity as a user states it: a float, a tuple of floats, or a function of s."""
    if callable(content):
        result: Along = content
        return result
    if _is_table(content):
        return _table(name, content, written, limits)
    if written == ONE:
        return number(name, content, InvalidRod, **limits)
    parts = pair(name, content, written, varying, **limits)
    return Components(parts) if any(map(callable, parts)) else parts


def _number(name: str, value: object, **limits: Any) -> float:
    return number(name, value, InvalidRod, **limits)


def pair(name: str, value: Any, written: str, judged: Callable[..., Any] = _number,
         **limits: Any) -> tuple[Any, Any]:
    """Return a pair of numbers. One number gives both, if `written` allows it."""
    sizes = (1, 2) if ' or ' in written else (2,)
    parts = value if is_row(value) else [value]
    if len(parts) not in sizes:
        raise InvalidRod(f'{name} = {shown(value)}: expected {written}')
    return judged(name, parts[0], **limits), judged(name, parts[-1], **limits)


def is_row(value: object) -> bool:
    """Return whether a value has an index: a tuple, list, (n,) array or array of ROS parameters."""
    return (hasattr(value, '__getitem__') and hasattr(value, '__len__')
            and not isinstance(value, NO_SEQUENCE) and getattr(value, 'ndim', 1) == 1)


def _is_table(content: Any) -> bool:
    """Whether it looks like rows (s, value): pairs that begin with a number."""
    if isinstance(content, np.ndarray) and content.ndim == 2:
        return True
    if not is_row(content) or isinstance(content, np.ndarray) or not len(content):
        return False
    return all(is_row(part) and len(part) == 2 and np.ndim(part[0]) == 0 for part in content)


def _table(name: str, content: Any, written: str, limits: dict[str, float]) -> Table:
    expected = (f'{name} = {shown(content)}: expected rows (s, value) with s ascending, at most '
                'two at the same s')
    try:
        places = [part[0] for part in content]
        values = [part[1] if len(part) == 2 else part[1:] for part in content]
    except Exception:  # whatever its iteration raises
        raise InvalidRod(expected) from None
    s = array(f'{name} s', places, (None,), InvalidRod)
    if (np.diff(s) < 0).any() or np.equal(s[2:], s[:-2]).any():
        raise InvalidRod(expected)
    if written != ONE:
        return Table(s, np.array([pair(name, value, written, _number, **limits)
                                  for value in values]))
    return Table(s, np.array([_number(name, value, **limits) for value in values]))


# ------------------------------------------------------------------------------------------------
# What of a rod may vary along it: its values at arc lengths, and their means over elements.


VARYING = {  # how a value is written, and limits
    'mass_per_length': (ONE, {'minimum': 0}), 'bending_stiffness': ('EI or (EI_n, EI_b)',
                                                                    {'above': 0}),
    'torsional_stiffness': (ONE, {'above': 0}), 'natural_curvature': ('(k_n, k_b)', {}),
    'natural_twist': (ONE, {}), 'radius': (ONE, {'above': 0})}
_NATURAL = ('natural_twist', 'natural_curvature')
_STIFF = ('torsional_stiffness', 'bending_stiffness')


class AlongRod(Value):
    """Base of `Rod`: reads what is a number, a table or a function of arc length."""

    _REMEMBERED = ('_profiles',)  # functions are asked hundreds of times for them

    length: float
    mass_per_length: Along
    nodes: tuple[float, ...]

    @cached_property
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
            elif isinstance(content, Expanded) and not callable(content.base) and (
                    len(content.coefficients) <= _SHORT):
                profiles[name] = smooth(content, self.length)
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
        return lambda s: 1 / self._at(name, s) if name in _STIFF else self._at(name, s)

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
            return np.array([_number(f'Rod.{name}({s:g})', value, **limits)])
        return np.array(pair(f'Rod.{name}({s:g})', value, parts, _number, **limits))


def _mesh(s: ArrayLike) -> Floats:
    """Return nodes (N + 1,), ascending, as an array; raise InvalidRod if they are none."""
    if (type(s) is np.ndarray and s.dtype == float and s.ndim == 1 and s.size > 1
            and abs(s[0]) + abs(s[-1]) < np.inf and (s[1:] > s[:-1]).all()):
        return s
    s = row('s', s, InvalidRod, least=2)
    if (np.diff(s) <= 0).any():
        raise InvalidRod(f's = {shown(s.tolist())}: expected arc lengths that grow')
    return s
