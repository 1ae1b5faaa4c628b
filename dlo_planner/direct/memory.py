# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO carries from one step to the next: its plastic strain, and the forces on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import row, shown
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import Value, freeze

_SAME = 1e-9        # of the length
_SAME_NODE = 1e-12  # the same: nodes of two meshes that are one


class ContactPoints(NamedTuple):
    """C points of contact inside elements and of friction, as of a `ContactSet`; world axes."""

    element: Ints
    obstacle: Ints      # -1 - o: a point of friction on obstacle o
    multiplier: Floats  # N
    fraction: Floats
    anchor: Floats      # (C, 3) m, where they have come to
    normal: Floats      # (C, 3)
    shear: Floats       # (C, 3) N
    slid: Floats        # (C, 3) m, by how much they slid in the step

    def on(self, old: Floats, s: Floats) -> ContactPoints:
        """Return the same points on other nodes: s (n + 1,) instead of `old` (N + 1,), m."""
        if not self.element.size:
            return self
        inside = self.obstacle >= 0  # anywhere in the element: its middle
        at = old[self.element] + (np.where(inside, 0.5, self.fraction)
                                  * np.diff(old)[self.element])
        tiny = _SAME_NODE * s[-1]
        element = np.clip(np.searchsorted(s, at - tiny) - 1, 0, s.size - 2)
        fraction = (at - s[element]) / np.diff(s)[element]
        fraction = np.where(np.abs(at - s[element + 1]) < tiny, 1.0, np.clip(fraction, 0.0, 1.0))
        return self._replace(element=element,  # inside they are fixed, or 0: they roll
                             fraction=np.where(inside, self.fraction, fraction))


_NO_INDEX, _NO_NUMBER, NOWHERE = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 3))
NO_POINTS = ContactPoints(_NO_INDEX, _NO_INDEX, _NO_NUMBER, _NO_NUMBER, *[NOWHERE] * 4)
freeze(NO_POINTS)


@dataclass(frozen=True, eq=False, repr=False)
class Memory(Value):
    """The past of a Shape on N elements, as far as the next step depends on it."""

    s: Floats              # (N + 1,) arc lengths of the nodes, m
    plastic: Floats        # (N, J) plastic strain of each spring, 1/m; (N, 0): elastic
    dissipated: float      # J, lost to plastic deformation so far
    hold: Floats           # (K,) N, forces of the far end's grip
    node_force: Floats     # (M, N + 1) N, of each body on each node
    points: ContactPoints
    positions: Floats      # (N + 1, 3) m, of the nodes at its end; (0, 3) without a step so far
    tangents: Floats       # the same
    of: Surroundings | None = field(default=None, compare=False)  # None: not known, as of a file
    set_error: float = 0.0  # m, how far nodes may be off by what earlier steps did to the set
    original_set: tuple[Floats, Floats] | None = field(default=None, compare=False)
    # s, plastic, where that was made on another mesh

    @classmethod
    def empty(cls, s: Floats, springs: int, bodies: int, of: Surroundings) -> Memory:
        """Return the past of a DLO that has none, with so many springs and bodies."""
        return cls(s, np.zeros((s.size - 1, springs)), 0.0, _NO_NUMBER, np.zeros((bodies, s.size)),
                   NO_POINTS, NOWHERE, NOWHERE, of)

    @cached_property
    def idle(self) -> bool:
        """Whether nothing of it has a say in the next step, whose far end is free."""
        return not (self.points.element.size or self.dissipated or self.plastic.any()
                    or self.node_force.any())

    @property
    def has_set(self) -> bool:
        """Whether the DLO is for good another one than it was made."""
        return bool(self.plastic.any())

    @property
    def in_contact(self) -> bool:
        """Whether contacts have pressed on the DLO."""
        return bool(self.node_force.any() or self.points.multiplier.any())

    @property
    def friction_work(self) -> float:
        """Work in J of friction in the step that left it, with the forces at its end."""
        rubs = self.points.obstacle < 0
        force, way = self.points.shear[rubs], self.points.slid[rubs]
        return float(np.abs(np.sum(force * way, axis=1)).sum())

    def permanent_part(self) -> Memory:
        """Return what belongs to the rod: no forces, and not the way so far."""
        return replace(self, hold=_NO_NUMBER, node_force=np.zeros_like(self.node_force),
                       points=NO_POINTS, positions=NOWHERE, tangents=NOWHERE)

    def with_forces(self, other: Memory) -> Memory:
        """Return the same past with the forces of another one."""
        return replace(self, hold=other.hold, node_force=other.node_force, points=other.points)

    def under(self, later: Memory) -> Memory:
        """Return the same past under the forces after the step; what slid in it slides."""
        points = later.points
        return replace(self.with_forces(later),
                       points=points._replace(anchor=points.anchor - points.slid))

    def resampled(self, s: Floats) -> Memory:
        """Return the same past on another mesh `s` (n + 1,), m; forces where a node stays."""
        if s is self.s or np.array_equal(s, self.s):
            return self
        positions, tangents, force = self.positions, self.tangents, self.node_force
        if len(positions):
            curve = scipy.interpolate.CubicHermiteSpline(self.s, positions, tangents)
            positions, tangents = curve(s), curve(s, 1)
        if len(force):
            force = force @ (np.abs(self.s[:, None] - s) < _SAME_NODE * s[-1])
        else:
            force = np.zeros((0, s.size))
        of_set = self.original_set or (self.s, self.plastic)
        lasts = self.has_set
        plastic = set_on(s, *of_set) if lasts else np.zeros((s.size - 1, self.plastic.shape[1]))
        return replace(self, s=s, plastic=plastic, node_force=force,
                       points=self.points.on(self.s, s), positions=positions, tangents=tangents,
                       original_set=of_set if lasts else None)

    def packed(self) -> dict[str, Any]:
        """Return its arrays by the names that they have in files."""
        points = {f'point_{name}': array for name, array in self.points._asdict().items()}
        return {'s': self.s, 'set': self.plastic, 'set_error': self.set_error,
                'lost': self.dissipated, 'hold': self.hold,
                'node_force': self.node_force, **points, 'positions': self.positions,
                'tangents': self.tangents}

    @classmethod
    def unpacked(cls, arrays: Mapping[str, Any], length: float) -> Memory:
        """Return the past from a file, if it can be of a DLO of that length, m."""
        s = row('past_s', arrays['s'], least=2, minimum=0)
        if s[0] != 0 or (np.diff(s) <= 0).any() or abs(s[-1] - length) > _SAME * length:
            raise InvalidTask(f'past_s = {shown(s.tolist())}: expected arc lengths that grow from '
                              f'0 to {length:g}')
        count, bodies = np.size(arrays.get('point_element', ())), len(arrays.get('node_force', ()))
        strain = s.size - 1, *(np.shape(arrays.get('set', ()))[1:2] or (0,))
        ends = (s.size if np.size(arrays.get('positions', ())) else 0, 3)
        points = ContactPoints(
            _filed(arrays, 'point_element', (count,), 0, s.size - 2, int),
            _filed(arrays, 'point_obstacle', (count,), -bodies, bodies - 1, int),
            _filed(arrays, 'point_multiplier', (count,)),
            _filed(arrays, 'point_fraction', (count,), 0.0, 1.0),
            *(_filed(arrays, f'point_{name}', (count, 3)) for name in ContactPoints._fields[4:]))
        return cls(s, _filed(arrays, 'set', strain), float(_filed(arrays, 'lost', (), 0.0)),
                   _filed(arrays, 'hold', (min(np.size(arrays.get('hold', ())), 6),)),
                   _filed(arrays, 'node_force', (bodies, s.size)), points,
                   _filed(arrays, 'positions', ends), _filed(arrays, 'tangents', ends),
                   set_error=float(_filed(arrays, 'set_error', (), 0.0)))


def _filed(arrays: Mapping[str, Any], name: str, shape: tuple[int, ...], lowest: float = -np.inf,
           highest: float = np.inf, kind: type = float) -> Any:
    """Return an array of a file if it holds finite numbers of a `kind` within limits."""
    value = np.asarray(arrays.get(name, ()))
    if (name not in arrays or value.shape != shape
            or value.dtype.kind not in ('iu' if kind is int else 'iuf')
            or not np.isfinite(value).all() or (value < lowest).any() or (value > highest).any()):
        limits = '' if lowest == -np.inf else f' from {lowest:g} to {highest:g}'
        raise InvalidTask(f'past_{name} = {shown(value.tolist())}: expected finite '
                          f'{"integers" if kind is int else "numbers"} of shape {shape}{limits}')
    return value.astype(kind)


def set_on(wanted: Floats, s: Floats, plastic: Floats) -> Floats:
    """Return the set (n, J) on other elements, of `plastic` (N, J), the means over those of `s`.

    It varies along an element as the moment does that made it. Were it the same in both halves of
    one, the half that bears more would yield more, the other one would not flow back.
    """
    total = np.zeros((s.size, plastic.shape[1]))
    np.cumsum(plastic * np.diff(s)[:, None], axis=0, out=total[1:])
    at_nodes = scipy.interpolate.PchipInterpolator(s, total, axis=0)(wanted)
    result: Floats = np.diff(at_nodes, axis=0) / np.diff(wanted)[:, None]
    return result


def mapped(s: Floats, values: Floats, wanted: Floats) -> Floats:
    """Return (n, k): `values` (N, k), constant on the elements of `s`, averaged over `wanted`'s."""
    total = np.vstack([np.zeros(values.shape[1]),
                       np.cumsum(values * np.diff(s)[:, None], axis=0)])
    at_nodes = np.column_stack([np.interp(wanted, s, column) for column in total.T]
                               or [np.zeros((wanted.size, 0))])
    return np.diff(at_nodes, axis=0) / np.diff(wanted)[:, None]
