# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Quantities that vary along a DLO: numbers, tables and functions of arc length s, as values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidRod
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import row, shown
from dlo_planner.model.value import Value, put

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
        """Return the function's value at `s` (m)."""
        return self.function(s)


@dataclass(frozen=True, eq=False, repr=False)
class Table(Value):
    """Linear interpolation between the rows of a table; two rows at the same s are a jump.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Arc length in m, ascending.
    values : ndarray, shape (n,) or (n, k)
        Values there; before the first row and after the last one they stay.
    """

    s: Floats
    values: Floats

    @property
    def breaks(self) -> Floats:
        """(m,) arc lengths where it jumps or bends, m."""
        return np.unique(self.s)

    def __call__(self, s: float) -> Any:
        """Return the value at `s` (m); at a jump, the one after it."""
        after = int(np.searchsorted(self.s, s, side='right'))
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
        """Return the values (k,) at `s` (m)."""
        return np.array([part(s) if callable(part) else part for part in self.parts])


@dataclass(frozen=True, eq=False, repr=False)
class SeenFrom(Value):
    """A function of arc length as a function of the distance from `at` (m), in one direction.

    Attributes
    ----------
    base : callable
        The function.
    direction : int
        1: on, -1: back.
    signs : tuple of float
        Factors of the components that it returns; (): none.
    """

    base: Callable[[float], Any]
    at: float
    direction: int
    signs: tuple[float, ...] = ()

    @property
    def breaks(self) -> Floats:
        """(m,) distances where it is known to jump, m."""
        return self.direction * (breaks_of(self.base) - self.at)

    def __call__(self, s: float) -> Any:
        """Return the function's value at the distance `s` (m)."""
        value = self.base(self.at + self.direction * s)
        return np.asarray(value) * self.signs if self.signs else value


@dataclass(frozen=True, eq=False, repr=False)
class Stepwise(Value):
    """Constant on each element of a mesh.

    Attributes
    ----------
    s : ndarray, shape (N + 1,)
        Nodes, m.
    values : ndarray, shape (N, ...)
        Values of the elements.
    """

    s: Floats
    values: Floats

    @property
    def breaks(self) -> Floats:
        """(N - 1,) the inner nodes, m."""
        return self.s[1:-1]

    def __call__(self, s: float) -> Any:
        """Return the value of the element that holds `s` (m)."""
        element = np.searchsorted(self.s, s, side='right') - 1
        return self.values[min(max(int(element), 0), len(self.values) - 1)]


@dataclass(frozen=True, eq=False, repr=False)
class Extended(Value):
    """A number, pair or function up to `end` (m), and another constant from there on."""

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
class Scaled(Value):
    """A function times a number, or times one number for each component."""

    base: Callable[[float], Any]
    factor: float | Floats

    @property
    def breaks(self) -> Floats:
        """(n,) arc lengths where it is known to jump, m."""
        return breaks_of(self.base)

    def __call__(self, s: float) -> Floats:
        """Return the product at `s` (m)."""
        return self.factor * np.asarray(self.base(s))


@dataclass(frozen=True, eq=False, repr=False)
class Shifted(Value):
    """A function plus a constant."""

    base: Callable[[float], Any]
    shift: Floats

    @property
    def breaks(self) -> Floats:
        """(n,) arc lengths where it is known to jump, m."""
        return breaks_of(self.base)

    def __call__(self, s: float) -> Floats:
        """Return the sum at `s` (m)."""
        return np.asarray(self.base(s)) + self.shift


@dataclass(frozen=True, eq=False, repr=False)
class Expanded(Value):
    """A number, pair or function plus a series of Legendre polynomials on [0, length].

    Attributes
    ----------
    base : float, tuple or callable
        What the series is added to.
    coefficients : ndarray, shape (m, k)
        Coefficients of P_0 ... P_{m-1} in 2 s / length - 1.
    length : float
        Length in m.
    """

    base: Along
    coefficients: Floats
    length: float

    @property
    def breaks(self) -> Floats:
        """(n,) arc lengths where it is known to jump, m."""
        return breaks_of(self.base)

    def __call__(self, s: float) -> Floats:
        """Return the sum (k,) at `s` (m)."""
        base = self.base(s) if callable(self.base) else self.base
        result: Floats = np.asarray(base) + legval(2 * s / self.length - 1, self.coefficients)
        return result


def breaks_of(content: object) -> Floats:
    """Return the arc lengths (n,) at which a number or a function states jumps, m."""
    return np.asarray(getattr(content, 'breaks', ()), dtype=float).ravel()


def scaled(content: Along, factor: float) -> Along:
    """Return a number, a tuple of numbers or a function of s, times `factor`."""
    if callable(content):
        return Scaled(content, factor)
    return tuple(factor * part for part in content) if isinstance(content, tuple) else (
        factor * content)
