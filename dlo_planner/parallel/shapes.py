# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes as arrays: what travels between processes, and what programs work with."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.discretization import mapped
from dlo_planner.direct.shape import Contact, SelfContact, Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import array, items, results, row, shown
from dlo_planner.model.holds import Holds, holds_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import brief, put, same
from dlo_planner.pictured import Answer

_FIGURES = ('energy', 'elastic_energy', 'dissipated', 'residual', 'stability', 'violation')
_FLAGS = ('converged', 'jumped')
Columns = dict[str, NDArray[Any]]  # arrays of some shapes, by the names of `Shapes`
_CONTACT = 14  # columns: which shape, and the 13 numbers of a Contact
_SELF_CONTACT = 14  # the same of a SelfContact
TABLES = {'contact_table': _CONTACT, 'self_contact_table': _SELF_CONTACT}
_EACH = 'one for each of Shapes.grippers,'


@dataclass(frozen=True, eq=False, repr=False)
class Shapes(Answer):
    """Static shapes of one DLO on one mesh; n shapes of N elements, N + 1 nodes, world frame, SI.

    An array has one row per shape, of what `Shape` says under the same name. A shape that was
    computed on a finer mesh is given at the nodes `s` all the same, exactly on its arcs; its
    strains are averaged over the elements then. `len`, indices, slices and loops work: one entry
    is a Shape (without the past of its contacts and grips, and its error estimate is not known).

    Attributes
    ----------
    grippers : tuple of Pose
        The n poses.
    s : ndarray, shape (N + 1,) or (n, N + 1)
        Arc lengths of the nodes, m; those of each where DLOs of different lengths are together.
    positions : ndarray, shape (n, N + 1, 3)
        Positions in m.
    frames : ndarray, shape (n, N + 1, 3, 3)
    element_strains : ndarray, shape (n, N, 3)
        Element strains in 1/m.
    gripper_wrench : ndarray, shape (n, 6)
        N and N m.
    energy, elastic_energy, dissipated : ndarray, shape (n,)
        Energy, elastic energy and dissipated in J.
    residual, stability : ndarray, shape (n,)
    violation : ndarray, shape (n,)
        Violation in m.
    iterations : ndarray, shape (n,)
        Newton steps.
    converged, jumped : ndarray, shape (n,)
        True or False.
    contact_table : ndarray, shape (m, 14)
        All contacts by shape and s: index of the shape, then obstacle, s, position, normal, force,
        friction, penetration as in `Contact`.
    self_contact_table : ndarray, shape (m, 14)
        Where DLOs touch themselves, likewise: index of the shape, then s, other_s, position,
        normal, force, friction, penetration as in `SelfContact`.
    holds : tuple
        The A Holds beside the gripper, the same of all shapes.
    wrenches : ndarray, shape (n, A, 6)
        N and N m, of each of them.

    Raises
    ------
    InvalidTask
        The sizes do not fit; the message names the attribute.
    """

    grippers: tuple[Pose, ...]
    s: Floats
    positions: Floats
    frames: Floats
    element_strains: Floats
    gripper_wrench: Floats
    energy: Floats
    elastic_energy: Floats
    dissipated: Floats
    residual: Floats
    stability: Floats
    violation: Floats
    iterations: Floats
    converged: Floats
    jumped: Floats
    contact_table: Floats = ()  # type: ignore[assignment]
    self_contact_table: Floats = ()  # type: ignore[assignment]
    holds: Holds = ()
    wrenches: Floats | None = None

    def __post_init__(self) -> None:
        grippers = items('Shapes.grippers', self.grippers, Pose)
        n = len(grippers)
        s = _nodes(self.s, n)
        nodes = s.shape[-1]
        sizes = {'positions': (nodes, 3), 'frames': (nodes, 3, 3),
                 'element_strains': (nodes - 1, 3), 'gripper_wrench': (6,),
                 **{name: () for name in _FIGURES}}
        holds, wrenches = self.holds, self.wrenches
        if not isinstance(holds, tuple) or holds:
            holds = holds_of(None, holds, s[..., -1].min(initial=np.inf), 'Shapes.holds')
        if not holds and (wrenches is None or isinstance(wrenches, list | tuple) and all(
                isinstance(one, list | tuple) and not one for one in wrenches)):  # as of files
            wrenches = np.zeros((n, 0, 6))
        tables = {name: given if _length(given := getattr(self, name)) else np.zeros((0, width))
                  for name, width in TABLES.items()}
        put(self, grippers=grippers, s=s,
            iterations=self._counts(n), holds=holds,
            wrenches=results('Shapes.wrenches', wrenches, (n, len(holds), 6)),
            **{name: results(f'Shapes.{name}', tables[name], (None, width))
               for name, width in TABLES.items()},
            **{name: results(f'Shapes.{name}', getattr(self, name), (n, *size))
               for name, size in sizes.items()},
            **{name: as_it_is(f'Shapes.{name}', getattr(self, name), (n,), 'b',
                              f'True or False, {_EACH}').astype(bool) for name in _FLAGS})
        for name in TABLES:
            of = getattr(self, name)[:, 0]
            if of.size and not (of[0] >= 0 and of[-1] < n and (of == np.floor(of)).all()
                                and (np.diff(of) >= 0).all()):
                raise InvalidTask(f'Shapes.{name}: expected indices of shapes, not falling, in '
                                  f'its first column, got {shown(of.tolist())}')
        super().__post_init__()

    def _counts(self, n: int) -> Ints:
        given = as_it_is('Shapes.iterations', self.iterations, (n,), 'iu',
                         f'integers, {_EACH}').astype(int)
        if (given < 0).any():
            raise InvalidTask(f'Shapes.iterations = {shown(given.tolist())}: expected none below 0')
        return given

    def __repr__(self) -> str:
        n = len(self)
        return brief(self, f'{n} shapes', f'{self.s.shape[-1] - 1} elements',
                     f'{int(self.converged.sum())} converged',
                     f'{int(self.jumped.sum())} jumped' if self.jumped.any() else '',
                     *([f'residual {self.residual.max():.1g}',
                        f'stability {self.stability.min():.2g}'] if n else []),
                     f'{len(self.contact_table)} contacts' if len(self.contact_table) else '')

    def __len__(self) -> int:
        return len(self.grippers)

    def __iter__(self) -> Iterator[Shape]:
        return (self._shape(k) for k in range(len(self)))

    def __getitem__(self, index: int | slice) -> 'Shape | Shapes':
        """Return one Shape, or the Shapes of a slice."""
        if isinstance(index, slice):
            return self._chosen(range(len(self))[index])
        return self._shape(range(len(self))[index])

    def _chosen(self, chosen: Sequence[int]) -> 'Shapes':
        order, tables = np.array(chosen, dtype=int), dict[str, Any]()
        for name, width in TABLES.items():
            parts = [self._rows(name, k) for k in chosen]
            table = np.concatenate([np.zeros((0, width)), *parts])
            table[:, 0] = np.repeat(np.arange(len(parts)), [len(one) for one in parts])
            tables[name] = table
        return replace(self, grippers=tuple(self.grippers[k] for k in chosen),
                       s=self.s if self.s.ndim == 1 else self.s[order], **tables,
                       **{name: getattr(self, name)[order] for name in _PER_SHAPE})

    def _rows(self, name: str, k: int) -> Floats:
        """Return the rows of a table that are of shape k."""
        table = getattr(self, name)
        rows: Floats = table[table[:, 0] == k]
        return rows

    def _shape(self, k: int) -> Shape:
        named: dict[str, Any] = {
            **{name: getattr(self, name)[k] for name in (
                'positions', 'frames', 'element_strains', 'gripper_wrench')},
            **{name: float(getattr(self, name)[k]) for name in _FIGURES},
            **{name: bool(getattr(self, name)[k]) for name in _FLAGS}}
        s = self.s if self.s.ndim == 1 else self.s[k]
        touching, of_itself = (self._rows(name, k) for name in TABLES)
        return Shape(self.grippers[k], s, contacts=tuple(map(_contact, touching)),
                     self_contacts=tuple(map(_self_contact, of_itself)),
                     iterations=int(self.iterations[k]), holds=self.holds,
                     wrenches=self._wrenches[k], **named)

    @property
    def _wrenches(self) -> Floats:
        """(n, A, 6) `wrenches`, which are there once it is made."""
        assert self.wrenches is not None
        return self.wrenches

    @property
    def tangents(self) -> Floats:
        """(n, N + 1, 3) unit tangents of the nodes."""
        return self.frames[..., 0]

    @classmethod
    def of(cls, shapes: Iterable[Shape], s: Floats | None = None) -> 'Shapes':
        """Return the Shapes of one DLO, given one by one, all in the same holds.

        Parameters
        ----------
        shapes : iterable of Shape
            One Shape or more.
        s : ndarray, shape (N + 1,), optional
            Arc lengths of the nodes, m, from 0 to the length. If None, those of the first.

        Raises
        ------
        InvalidTask
            There is none, a DLO is grasped inside, or holds or lengths differ.
        """
        shapes = items('shapes', shapes, Shape, least=1)
        s = shapes[0].s if s is None else row('s', s, least=2, minimum=0)
        for k, shape in enumerate(shapes):
            if shape.parts is not None:
                raise InvalidTask(f'shapes[{k}] = {shape!r}: expected a DLO that the gripper holds '
                                  'at its beginning')
            if not same(shape.holds, shapes[0].holds):
                raise InvalidTask(f'shapes[{k}] = {shape!r}: expected the holds of the first, '
                                  f'{shown(shapes[0].holds)}')
            if abs(shape.s[-1] - s[-1]) > _SAME * s[-1]:
                raise InvalidTask(f'shapes[{k}] = {shape!r}: expected the length of s, '
                                  f'{s[-1]:g} m')
        return cls(tuple(shape.gripper for shape in shapes), s, holds=shapes[0].holds,
                   **columns(shapes, s))

    @classmethod
    def joined(cls, parts: Iterable['Shapes']) -> 'Shapes':
        """Return the Shapes of several, one after the other.

        Raises
        ------
        InvalidTask
            There is none, or their nodes differ.
        """
        parts = items('parts', parts, Shapes, least=1)
        s, each = parts[0].s, any(part.s.ndim == 2 for part in parts)
        for k, part in enumerate(parts):
            if part.s.shape[-1] != s.shape[-1] or not (each or np.array_equal(part.s, s)):
                raise InvalidTask(f'parts[{k}] = {part!r}: expected the nodes of the first')
            if not same(part.holds, parts[0].holds):
                raise InvalidTask(f'parts[{k}] = {part!r}: expected the holds of the first')
        if each:
            s = np.concatenate([np.broadcast_to(part.s, (len(part), part.s.shape[-1]))
                                for part in parts])
        return cls(tuple(gripper for part in parts for gripper in part.grippers), s,
                   holds=parts[0].holds, **stacked([{name: getattr(part, name) for name in (
                       *_PER_SHAPE, *TABLES)} for part in parts]))


_PER_SHAPE = tuple(item.name for item in fields(Shapes)
                   if item.name not in ('grippers', 's', 'holds', *TABLES))
_SAME = 1e-9  # of the length


def columns(shapes: Sequence[Shape], s: Floats) -> Columns:
    """Return the arrays of some Shape at the nodes `s` (N + 1,): those of `Shapes` by name."""
    n, places = len(shapes), [_at(shape, s) for shape in shapes]
    table = [[k, c.obstacle, c.s, *c.position, *c.normal, c.force, *c.friction, c.penetration]
             for k, shape in enumerate(shapes) for c in shape.contacts]
    return {'positions': np.array([one[0] for one in places]).reshape(n, s.size, 3),
            'frames': np.array([one[1] for one in places]).reshape(n, s.size, 3, 3),
            'element_strains': np.array([one[2] for one in places]).reshape(n, s.size - 1, 3),
            'gripper_wrench': np.array([shape.gripper_wrench for shape in shapes]).reshape(n, 6),
            **{name: np.array([getattr(shape, name) for shape in shapes], dtype=float)
               for name in _FIGURES},
            **{name: np.array([getattr(shape, name) for shape in shapes], dtype=bool)
               for name in _FLAGS},
            'iterations': np.array([shape.iterations for shape in shapes], dtype=int),
            'wrenches': (np.array([shape.wrenches for shape in shapes]) if n
                         else np.zeros((0, 0, 6))),
            'contact_table': np.array(table, dtype=float).reshape(-1, _CONTACT),
            'self_contact_table': np.array(
                [[k, c.s, c.other_s, *c.position, *c.normal, c.force, *c.friction,
                  c.penetration] for k, shape in enumerate(shapes) for c in shape.self_contacts],
                dtype=float).reshape(-1, _SELF_CONTACT)}


def stacked(parts: Sequence[Columns]) -> Columns:
    """Return the arrays of several `columns` as one."""
    counts = np.cumsum([0, *(len(part['converged']) for part in parts)])
    return {**{name: np.concatenate([part[name] for part in parts]) for name in _PER_SHAPE},
            **{name: np.concatenate([part[name] + first * (np.arange(width) == 0)
                                     for part, first in zip(parts, counts, strict=False)])
               for name, width in TABLES.items()}}


def _at(shape: Shape, s: Floats) -> tuple[Floats, Floats, Floats]:
    """Return positions, frames and strains of a Shape on the nodes `s`."""
    if shape.s is s or np.array_equal(shape.s, s):
        return shape.positions, shape.frames, shape.element_strains
    ends = np.minimum(s, shape.s[-1])
    frames, positions = zip(*(shape.frame_at(float(value)) for value in ends), strict=True)
    return np.array(positions), np.array(frames), mapped(shape.s, shape.element_strains, s)


def _contact(line: Floats) -> Contact:
    return Contact(int(line[1]), line[2], line[3:6], line[6:9], line[9], line[10:13], line[13])


def _self_contact(line: Floats) -> SelfContact:
    return SelfContact(line[1], line[2], line[3:6], line[6:9], line[9], line[10:13], line[13])


def _nodes(value: Any, n: int) -> Floats:
    """Return the arc lengths (N + 1,), or (n, N + 1), of the nodes of n shapes; InvalidTask."""
    if isinstance(value, np.ndarray) and value.ndim == 2:
        s = array('Shapes.s', value, (n, None)) if n else np.array(value, dtype=float)
        if s.shape[1] < 2:
            raise InvalidTask(f'Shapes.s has shape {s.shape}: expected two nodes or more')
    else:
        s = row('Shapes.s', value, least=2, minimum=0)
    if (s[..., 0] != 0).any() or (np.diff(s) <= 0).any():
        raise InvalidTask(f'Shapes.s = {shown(s.tolist())}: expected arc lengths that grow '
                          'from 0')
    return s


def _length(value: Any) -> int:
    """Return how many items a value has; 1 where it has no length, so that it is looked at."""
    try:
        return len(value)
    except TypeError:
        return 1


def as_it_is(name: str, value: object, shape: tuple[int, ...], kinds: str,
             expected: str) -> NDArray[Any]:
    """Return a new array of a shape whose entries are of some kinds ('b', 'iu', 'U') already."""
    try:
        given = np.array(value)
    except Exception:  # whatever its conversion raises
        raise InvalidTask(f'{name} = {shown(value)}: expected {expected} {shape}') from None
    if given.shape != shape or given.size and given.dtype.kind not in kinds:
        raise InvalidTask(f'{name} = {shown(value)}: expected {expected} {shape}')
    return given
