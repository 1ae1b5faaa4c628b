# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO carries from one step to the next: its permanent set and its contacts."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.model.value import Value, freeze

_SAME = 1e-12  # of the length: nodes of two meshes that are one
_NOWHERE = np.zeros((0, 3))


@dataclass(frozen=True, eq=False, repr=False)
class History(Value):
    """The past of a Shape, as far as the next step depends on it.

    Attributes
    ----------
    s : ndarray, shape (N + 1,)
        Arc lengths of the nodes of its mesh, m.
    set : ndarray, shape (N, J)
        Plastic strain of each spring, 1/m, see `energy.plastic`; (N, 0) if elastic.
    lost : float
        Energy lost to plastic deformation so far, J.
    node_force : ndarray, shape (M, N + 1)
        Force of each obstacle on each node, N.
    points : dict
        Arrays by name: contacts inside elements and points of friction, world frame.
    hold : ndarray, shape (K,)
        Forces of the far end's grip, N, see `energy.hold`.
    positions : ndarray, shape (N + 1, 3)
        Positions of the nodes from which friction counts, m.
    tangents : ndarray, shape (N + 1, 3)
        Tangents of the nodes from which friction counts.
    of : Surroundings or None
        Surroundings in which it happened. If None, not known, as of a shape from a file.
    """

    s: np.ndarray
    set: np.ndarray
    lost: float
    node_force: np.ndarray
    points: dict
    hold: np.ndarray
    positions: np.ndarray
    tangents: np.ndarray
    of: Surroundings | None = field(default=None, compare=False)

    def __post_init__(self):
        for array in (self.s, self.set, self.node_force, self.hold, self.positions,
                      self.tangents):
            array.flags.writeable = False
        if self.points is not NO_POINTS:
            freeze(self.points)

    @classmethod
    def none(cls, s, springs, obstacles, of=None):
        """Return the past of a DLO that has none."""
        n = s.size - 1
        return cls(s, np.zeros((n, springs)), 0.0, np.zeros((obstacles, n + 1)), NO_POINTS,
                   np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), of)

    def on(self, s):
        """Return the same past on another mesh `s` (n + 1,).

        Forces of contact stay where a node stays, and inside elements.
        """
        if s is self.s or np.array_equal(s, self.s):
            return self
        moved = mapped(self.s, self.set, s)
        positions, tangents = self.positions, self.tangents
        if len(positions):
            curve = CubicHermiteSpline(self.s, positions, tangents)
            positions, tangents = curve(s), curve(s, 1)
        same = np.abs(self.s[:, None] - s) < _SAME * s[-1]
        return replace(self, s=s, set=moved, positions=positions, tangents=tangents,
                       node_force=self.node_force @ same, points=self._points_on(s))

    def _points_on(self, s):
        if self.points is NO_POINTS:
            return NO_POINTS
        element, fraction = self.points['element'], self.points['fraction']
        inside = self.points['obstacle'] >= 0  # anywhere in the element: its middle
        fraction = np.where(inside, 0.5, fraction)
        at = self.s[element] + fraction * np.diff(self.s)[element]
        tiny = _SAME * s[-1]
        element = np.clip(np.searchsorted(s, at - tiny) - 1, 0, s.size - 2)
        fraction = (at - s[element]) / np.diff(s)[element]
        fraction = np.where(np.abs(at - s[element + 1]) < tiny, 1.0, np.clip(fraction, 0.0, 1.0))
        fraction = np.where(inside, self.points['fraction'], fraction)  # fixed, or 0: it rolls
        return self.points | {'element': element, 'fraction': fraction}

    def halved(self, s):
        """Return what contacts leave to a mesh `s` (2 N + 1,) with halved elements, and no way.

        What slid slides: its anchors are those of before.
        """
        points, node_force = self.points, np.zeros((len(self.node_force), s.size))
        node_force[:, ::2] = self.node_force
        beyond = (points['obstacle'] < 0) & (points['fraction'] > 0.5)
        fraction = np.where(points['obstacle'] < 0, 2 * points['fraction'] - beyond,
                            points['fraction'])
        points = points | {'element': 2 * points['element'] + beyond, 'fraction': fraction,
                           'anchor': points['anchor'] - points['slid']}
        return replace(self, s=s, set=np.repeat(self.set, 2, axis=0), node_force=node_force,
                       points=points, positions=_NOWHERE, tangents=_NOWHERE)

    def holding(self, later):
        """Return the same past with the forces of contacts and grips after the step.

        What slid in it slides: its anchors are those of before.
        """
        points = later.points
        points = points | {'anchor': points['anchor'] - points['slid']}
        return replace(self, node_force=later.node_force, points=points, hold=later.hold)

    def without_contacts(self, obstacles):
        """Return the same past without forces of contact, for a number of obstacles."""
        return replace(self, points=NO_POINTS, node_force=np.zeros((obstacles, self.s.size)))

    def set_alone(self, obstacles):
        """Return the permanent set without contacts, grips and the way so far."""
        return replace(self.without_contacts(obstacles), hold=np.zeros(0), positions=_NOWHERE,
                       tangents=_NOWHERE)


NO_POINTS = {'element': np.zeros(0, dtype=np.int64), 'obstacle': np.zeros(0, dtype=np.int64),
             'multiplier': np.zeros(0), 'fraction': np.zeros(0), 'anchor': np.zeros((0, 3)),
             'normal': np.zeros((0, 3)), 'shear': np.zeros((0, 3)), 'slid': np.zeros((0, 3))}
freeze(NO_POINTS)


def mapped(s, values, wanted):
    """Return (n, k): `values` (N, k), constant on the elements of `s`, averaged over `wanted`'s."""
    total = np.vstack([np.zeros(values.shape[1]),
                       np.cumsum(values * np.diff(s)[:, None], axis=0)])
    at_nodes = np.column_stack([np.interp(wanted, s, column) for column in total.T]
                               or [np.zeros((wanted.size, 0))])
    return np.diff(at_nodes, axis=0) / np.diff(wanted)[:, None]
