# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The outside of a DLO: what contact and clearance need to know of a Rod."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value

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
