# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A function of arc length, resolved: polynomials between its jumps, with exact means.

A mesh that reads a function at its own points is blind to what lies between them, and so is a finer
mesh beside it. So each function is looked at once, on its own: panels are halved until polynomials
through their Gauss points tell the function within 1e-8 of its size, which finds jumps by
bisection; meshes take integrals of these polynomials.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidRod
from dlo_planner.model.along import Table
from dlo_planner.model.arrays import Floats
from dlo_planner.model.value import Value

_PANELS = 256        # to begin with: what is wider than 1/2000 of the length is seen
_POINTS = 5          # of Gauss in each panel
_CLOSE = 1e-8        # part of the largest value: two descriptions that differ by less are the same
_JUMP = 1e-6         # the same, between the two sides of a point
_NARROWEST = 2e-13   # of the length: a panel that is not halved any further
_ONE_PLACE = 1e-9    # of the length: jumps nearer to each other are one
_MOST = 16_000       # panels

_X, _ = np.polynomial.legendre.leggauss(_POINTS)
_AT = 0.5 * (1 + _X)                                      # of a panel, in [0, 1]
_POWERS = np.linalg.inv(np.vander(_AT, increasing=True))  # values -> coefficients of powers
_INSIDE = 1e-6  # of a panel: a jump nearer to its end is at its end
_HALVES = np.concatenate([0.5 * _AT, 0.5 + 0.5 * _AT, [_INSIDE, 1 - _INSIDE]])
_AT_HALVES = np.vander(_HALVES, _POINTS, increasing=True) @ _POWERS
_AT_ENDS = np.vander([0.0, 1.0], _POINTS, increasing=True) @ _POWERS


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Value):
    """A quantity with k components along a DLO.

    Attributes
    ----------
    edges : ndarray, shape (m + 1,)
        Edges of the panels, m.
    values : ndarray, shape (m, 5, k)
        At their Gauss points.
    breaks : ndarray, shape (n,)
        Arc lengths inside the DLO at which it jumps, m.
    """

    edges: Floats
    values: Floats
    breaks: Floats

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
    """Return the Profile of a function of s on [0, length].

    Parameters
    ----------
    name : str
        Name by which the user knows it.
    function : callable
        Callable of s (m) that returns (k,) finite numbers, or raises `error`.
    stated : array_like, optional
        Arc lengths, m, where it is known to jump.

    Raises
    ------
    error
        It varies too wildly to be described.
    """
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
    inside = table.s[(table.s > 0) & (table.s < length)]
    edges = np.unique(np.concatenate([[0.0], inside, [length]]))
    values = _at(lambda s: np.atleast_1d(table(s)), edges[:-1], np.diff(edges), _AT)
    return Profile(edges, values, np.unique(inside[1:][inside[1:] == inside[:-1]]))


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
