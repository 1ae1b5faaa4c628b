# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rod cut into elements: all about it that does not depend on the gripper, and what it carries.

What a DLO carries from one step to the next stands on the elements on which the step was made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dlo_planner.energy.contact import Contact, ContactSet
from dlo_planner.energy.grip import HoldRows, no_holds
from dlo_planner.energy.inertia import no_inertia
from dlo_planner.energy.loads import node_forces, node_masses, node_moments
from dlo_planner.energy.plastic import (
    PlasticSection,
    elastic_part,
    set_strains,
    yielding_layers,
)
from dlo_planner.energy.problem import Problem, with_gripper
from dlo_planner.energy.scene import Scene, build_scene
from dlo_planner.energy.strands import NO_RAYS, Strands, no_strands, smooth_strands
from dlo_planner.energy.terms import TERMS, free_terms, structure_of
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.basis import equidistribute, orthonormal_basis, very_twisted
from dlo_planner.minimize.solve import placed
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import row, shown
from dlo_planner.model.holds import Holds, held_rows, place_of, places_of
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import FrozenDict, Value, changed, freeze, put, same

# Springs of constraints yield by 1 / these of the length under the DLO's own forces: those of
# contacts cost iterations the stiffer they are, tension between two grips multiplies what they
# round, and so does a load on a soft DLO: no more than this times the force that bends it
_SPRINGS = (('spring', 1e5, 1e8), ('held_spring', 1e3, 1e8), ('hold_spring', 1e2, np.inf))
# times EI / r^3: that of pairs that touch. The force that bends a strand around another one, EI
# / 16 r^2, presses them a hundredth of their distance into each other; then multipliers bear it
_PAIR_SPRING = 3.0
SAMPLES = np.linspace(0, 1, 33)[1:-1]  # of the length: where shapes are compared
_LEVER = 0.1  # of the length
_COARSE = 16  # elements of a mesh on which a first shape is sought
_SAME = 1e-9        # of the length
_SAME_NODE = 1e-12  # the same: nodes of two meshes that are one


# ------------------------------------------------------------------------------------------------
# What a DLO carries from one step to the next: its plastic strain, and the forces on it.


class ContactPoints(NamedTuple):
    """C points of contact inside elements and of friction, as of a `ContactSet`; world axes."""

    of: Ints        # (C, 2) element; obstacle, or -1 - o: a point of friction on obstacle o
    values: Floats  # (C, 14), by the names below

    @property
    def element(self) -> Ints:
        """(C,) in which they are."""
        return self.of[:, 0]

    @property
    def obstacle(self) -> Ints:
        """(C,) on which they are, or -1 - o."""
        return self.of[:, 1]

    @property
    def multiplier(self) -> Floats:
        """(C,) N."""
        return self.values[:, 0]

    @property
    def fraction(self) -> Floats:
        """(C,) of the element."""
        return self.values[:, 1]

    @property
    def anchor(self) -> Floats:
        """(C, 3) m, where they have come to."""
        return self.values[:, 2:5]

    @property
    def normal(self) -> Floats:
        """(C, 3) of the obstacle."""
        return self.values[:, 5:8]

    @property
    def shear(self) -> Floats:
        """(C, 3) N, friction."""
        return self.values[:, 8:11]

    @property
    def slid(self) -> Floats:
        """(C, 3) m, by how much they slid in the step."""
        return self.values[:, 11:]

    def as_before(self) -> ContactPoints:
        """Return them where they were before they slid."""
        values = np.array(self.values)
        values[:, 2:5] -= self.slid
        return self._replace(values=values)

    def on(self, old: Floats, s: Floats) -> ContactPoints:
        """Return the same points on other nodes: s (n + 1,) instead of `old` (N + 1,), m."""
        if not self.element.size:
            return self
        inside = self.obstacle >= 0  # anywhere in the element: its middle, if it is not known
        rolls = inside & (self.fraction < 0.0)
        before = old[self.element]
        at = before + (np.where(inside & ~rolls, 0.5, np.abs(self.fraction))
                       * (old[self.element + 1] - before))
        tiny = _SAME_NODE * s[-1]
        element = np.minimum(np.maximum(np.searchsorted(s, at - tiny) - 1, 0), s.size - 2)
        begin, end = s[element], s[element + 1]
        fraction = np.where(np.abs(at - end) < tiny, 1.0,
                            np.minimum(np.maximum((at - begin) / (end - begin), 0.0), 1.0))
        begin = -np.minimum(np.maximum(fraction, _SAME_NODE), 1.0 - _SAME_NODE)
        values = np.array(self.values)  # inside they are fixed, or <= 0: they roll
        values[:, 1] = np.where(rolls, begin, np.where(inside, self.fraction, fraction))
        return ContactPoints(np.column_stack((element, self.obstacle)), values)


# names of what is known of points of contact, in files
_OF = 'element', 'obstacle', 'multiplier', 'fraction'
_VECTORS = 'anchor', 'normal', 'shear', 'slid'
_NO_NUMBER, NOWHERE = np.zeros(0), np.zeros((0, 3))
NO_STRANDS, NO_FRAMES = np.zeros((0, 7)), np.zeros((0, 3, 3))
freeze((NO_STRANDS, NO_FRAMES))
NO_POINTS = ContactPoints(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 14)))
freeze(NO_POINTS)


@dataclass(frozen=True, eq=False, repr=False)
class Memory(Value):
    """The past of a Shape on N elements, as far as the next step depends on it."""

    s: Floats              # (N + 1,) arc lengths of the nodes, m
    plastic: Floats        # (N, J) plastic strain of each spring, 1/m; (N, 0): elastic
    dissipated: float      # J, lost to plastic deformation so far
    hold: Floats           # (K,) N, forces of what holds it beside the gripper
    node_force: Floats     # (M, N + 1) N, of each body on each node
    points: ContactPoints
    positions: Floats      # (N + 1, 3) m, of the nodes at its end; (0, 3) without a step so far
    tangents: Floats       # the same
    of: Surroundings | None = field(default=None, compare=False)  # None: not known, as of a file
    set_error: float = 0.0  # m, how far nodes may be off by what earlier steps did to the set
    hinge: float = -1.0      # m, arc length where a step has left a plastic hinge; < 0: nowhere
    original_set: tuple[Floats, Floats] | None = field(default=None, compare=False)
    # s, plastic, where that was made on another mesh
    # (P, 7) arc lengths in m of places that bear on each other, the first before the second; the
    # force in N; friction in N along the tangents of `energy.strands.tangents`, and by how much the
    # first slid on the second in the step, m
    strands: Floats = field(default_factory=lambda: NO_STRANDS)
    # (N + 1, 3, 3) of the nodes at its end, of strands that rub on each other; else (0, 3, 3)
    frames: Floats = field(default_factory=lambda: NO_FRAMES)

    @classmethod
    def empty(cls, s: Floats, springs: int, bodies: int, of: Surroundings) -> Memory:
        """Return the past of a DLO that has none, with so many springs and bodies."""
        plastic, force, past = (np.zeros((s.size - 1, springs)), np.zeros((bodies, s.size)),
                                cls.__new__(cls))
        freeze((plastic, force))  # nobody else has them: they need not be judged
        put(past, s=s, plastic=plastic, dissipated=0.0, hold=_NO_NUMBER, node_force=force,
            points=NO_POINTS, positions=NOWHERE, tangents=NOWHERE, of=of, set_error=0.0,
            hinge=-1.0, original_set=None, strands=NO_STRANDS, frames=NO_FRAMES)
        return past

    @cached_property
    def idle(self) -> bool:
        """Whether nothing of it has a say in the next step of a DLO that nothing else holds."""
        return not (self.points.element.size or self.dissipated or self.plastic.any()
                    or self.node_force.any() or self.strands.size)

    @cached_property
    def pristine(self) -> bool:
        """Whether nothing has happened to the DLO so far."""
        return self.idle and not (len(self.positions) or self.hold.size)

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
        between = np.sum(self.strands[:, 3:5] * self.strands[:, 5:], axis=1)
        return float(np.abs(np.sum(force * way, axis=1)).sum() + np.abs(between).sum())

    def permanent_part(self) -> Memory:
        """Return what belongs to the rod: no forces, and not the way so far."""
        return changed(self, hold=_NO_NUMBER, node_force=np.zeros_like(self.node_force),
                       points=NO_POINTS, positions=NOWHERE, tangents=NOWHERE, strands=NO_STRANDS,
                       frames=NO_FRAMES)

    def with_forces(self, other: Memory) -> Memory:
        """Return the same past with the forces of another one."""
        return changed(self, hold=other.hold, node_force=other.node_force, points=other.points,
                       strands=other.strands)

    def under(self, later: Memory) -> Memory:
        """Return the same past under the forces after the step; what slid in it slides."""
        return changed(self, hold=later.hold, node_force=later.node_force, strands=later.strands,
                       points=later.points.as_before())

    def halved(self, s: Floats) -> Memory:
        """Return its forces alone where each element is halved, `s` (2 N + 1,), before its step.

        For an elastic DLO.
        """
        force = np.zeros((len(self.node_force), s.size))
        force[:, ::2] = self.node_force
        past = Memory.__new__(Memory)  # nobody else has its arrays
        put(past, s=s, plastic=np.zeros((s.size - 1, 0)), dissipated=0.0, hold=self.hold,
            node_force=force, points=self.points.as_before().on(self.s, s), positions=NOWHERE,
            tangents=NOWHERE, of=self.of,
            set_error=self.set_error, hinge=self.hinge, original_set=None, strands=self.strands,
            frames=NO_FRAMES)
        freeze((past.plastic, force, past.points))
        return past

    def resampled(self, s: Floats) -> Memory:
        """Return the same past on another mesh `s` (n + 1,), m."""
        if s is self.s or np.array_equal(s, self.s):
            return self
        positions, tangents, force = self.positions, self.tangents, self.node_force
        if len(positions):
            curve = scipy.interpolate.CubicHermiteSpline(self.s, positions, tangents)
            positions, tangents = curve(s), curve(s, 1)
        force = _shared_out(self.s, s, force)
        of_set = self.original_set or (self.s, self.plastic)
        lasts = self.has_set
        plastic = set_on(s, *of_set) if lasts else np.zeros((s.size - 1, self.plastic.shape[1]))
        return changed(self, s=s, plastic=plastic, node_force=force,
                       points=self.points.on(self.s, s), positions=positions, tangents=tangents,
                       frames=_frames_at(self.s, self.frames, s),
                       original_set=of_set if lasts else None)

    def packed(self) -> dict[str, Any]:
        """Return its arrays by the names that they have in files."""
        points = {f'point_{name}': getattr(self.points, name) for name in _OF + _VECTORS}
        return {'s': self.s, 'set': self.plastic, 'set_error': self.set_error,
                'hinge': self.hinge,
                'lost': self.dissipated, 'hold': self.hold,
                'node_force': self.node_force, **points, 'positions': self.positions,
                'tangents': self.tangents,
                **({'strands': self.strands} if self.strands.size else {}),
                **({'frames': self.frames} if self.frames.size else {})}

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
        of = [_filed(arrays, 'point_element', (count,), 0, s.size - 2, int),
              _filed(arrays, 'point_obstacle', (count,), -bodies, bodies - 1, int)]
        columns = [_filed(arrays, 'point_multiplier', (count,)),
                   _filed(arrays, 'point_fraction', (count,), -1.0, 1.0),  # see `ContactSet`
                   *(_filed(arrays, f'point_{name}', (count, 3)) for name in _VECTORS)]
        points = ContactPoints(np.column_stack(of), np.column_stack(columns))
        return cls(s, _filed(arrays, 'set', strain), float(_filed(arrays, 'lost', (), 0.0)),
                   _filed(arrays, 'hold', (np.size(arrays.get('hold', ())),)),
                   _filed(arrays, 'node_force', (bodies, s.size)), points,
                   _filed(arrays, 'positions', ends), _filed(arrays, 'tangents', ends),
                   set_error=float(_filed(arrays, 'set_error', (), 0.0)),
                   hinge=float(_filed({'hinge': -1.0, **arrays}, 'hinge', (), -1.0, length)),
                   strands=_filed({'strands': NO_STRANDS, **arrays}, 'strands', (
                       len(arrays.get('strands', ())), 7)),
                   frames=_filed({'frames': NO_FRAMES, **arrays}, 'frames', (
                       s.size if 'frames' in arrays else 0, 3, 3), -1.1, 1.1))


def _frames_at(old: Floats, frames: Floats, s: Floats) -> Floats:
    """Return frames (n + 1, 3, 3) at the nodes `s` of those on nodes `old`; none of none."""
    if not len(frames):
        return frames
    from scipy.spatial.transform import Rotation, Slerp  # noqa: PLC0415  (few DLOs need it)
    turning = Slerp(old, Rotation.from_matrix(frames))
    turned: Floats = turning(np.clip(s, old[0], old[-1])).as_matrix()
    return turned


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


def _shared_out(old: Floats, s: Floats, force: Floats) -> Floats:
    """Return forces (M, n + 1) on the nodes `s` next to those on nodes `old`, (M, N + 1).

    Each goes to the two nodes beside it, by its lever, and none to the gripper's.
    """
    at = np.clip(np.searchsorted(s, old - _SAME_NODE * s[-1]), 2, s.size - 1)
    part = np.clip((old - s[at - 1]) / (s[at] - s[at - 1]), 0.0, 1.0)
    part[np.abs(old - s[at]) < _SAME_NODE * s[-1]] = 1.0
    shared = np.zeros((len(force), s.size))
    np.add.at(shared.T, at, (force * part).T)
    np.add.at(shared.T, at - 1, (force * (1.0 - part)).T)
    return shared


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


def stretched(mesh: Discretization, before: Holds, holds: Holds,
              first: Discretization) -> Discretization:
    """Return a Discretization whose nodes in rings are where `holds` say, not as `before`.

    All between nodes that stay is stretched evenly. Where a ring would pass a place at which
    something jumps it is that of `first` with nodes in the rings.
    """
    old, new, around = places_of(before), places_of(holds), mesh.surroundings
    if old == new and mesh.basis == 'local':
        return mesh
    breaks = np.setdiff1d(around.breaks, new)
    length = float(mesh.s[-1])
    known = np.sort(np.concatenate([[0.0], old, breaks, [length]]))
    wanted = np.concatenate([[0.0], new, breaks, [length]])
    order = np.argsort(np.concatenate([[0.0], old, breaks, [length]]), kind='stable')
    wanted = wanted[order] if len(old) == len(new) else wanted
    if (len(old) != len(new) or mesh.basis != 'local' or (np.diff(wanted) <= 0).any()
            or not np.isin(known, mesh.s).all()):
        return first.with_nodes(new)
    return Discretization(around, np.interp(mesh.s, known, wanted), 'local', 0)


def mapped(s: Floats, values: Floats, wanted: Floats) -> Floats:
    """Return (n, k): `values` (N, k), constant on the elements of `s`, averaged over `wanted`'s."""
    total = np.vstack([np.zeros(values.shape[1]),
                       np.cumsum(values * np.diff(s)[:, None], axis=0)])
    at_nodes = np.column_stack([np.interp(wanted, s, column) for column in total.T]
                               or [np.zeros((wanted.size, 0))])
    return np.diff(at_nodes, axis=0) / np.diff(wanted)[:, None]


# ------------------------------------------------------------------------------------------------
# A rod on a mesh.


class Discretization(Value):
    """A rod on a mesh, in a basis, with all that acts on it but the grippers (immutable).

    Its Problems: `free`, without what acts only where it is touched or reached (obstacles, a yield
    stress) and held by the gripper alone; `held`, the same with other holds; `full`, with all.
    """

    _PARTS = ('surroundings', 's', 'basis', 'n_terms', 'variation')

    surroundings: Surroundings
    s: Floats           # (N + 1,) nodes, m
    basis: str          # 'chebyshev', 'fourier' or 'local'
    n_terms: int        # of the series; unused by 'local'
    variation: Mapping[str, Floats] | None  # what `varied` was called with
    free: Problem
    _nominal: Discretization | None

    def __init__(self, surroundings: Surroundings, s: Floats, basis: str, n_terms: int,
                 variation: Mapping[str, Floats] | None = None,
                 nominal: Discretization | None = None) -> None:
        put(self, surroundings=surroundings, s=s, basis=basis, n_terms=n_terms, variation=variation,
            _nominal=nominal)
        freeze(s)
        put(self, free=self._computed() if nominal is None else nominal.free)
        if variation is not None:
            freeze(list(variation.values()))
            # copies: kernels are compiled for arrays that may be written
            fields = {name: np.array(values) for name, values in variation.items()}
            if nominal is not None and 'lengths' in fields:
                # a series is orthonormal on its elements: strains are projected by their lengths
                fields['basis'] = nominal.free.basis / np.sqrt(s[-1] / nominal.s[-1])
            put(self, free=self.free._replace(**fields))

    def _computed(self) -> Problem:
        """Return the Problem of the nominal DLO that hangs freely."""
        rod, around, s = self.surroundings.rod, self.surroundings, self.s
        lengths = s[1:] - s[:-1]
        stiffness = rod.mean_stiffnesses(s)
        effects = free_terms(-node_masses(rod, s)[:, None] * around.gravity
                             - node_forces(around, s))
        return Problem(
            lengths, rod.mean_natural_strains(s), stiffness,
            unknown_scale(self.basis, stiffness, lengths),
            orthonormal_basis(self.basis, self.n_terms, s, stiffness), np.eye(3), np.zeros(3),
            effects, structure_of(effects, s.size), np.zeros((0, 3)), 0.0)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self._PARTS)

    # ---- the Problem ----------------------------------------------------------------------------

    @cached_property
    def bending_back(self) -> float:
        """Elastic energy in J below which the DLO bends by less than a right angle in all.

        The square of all that it bends since its stress-free shape is at most twice the energy
        times its compliance (Schwarz's inequality). 0 where it may be bent without: for good, or by
        nature.
        """
        if self.yields:
            return 0.0
        lengths = np.diff(self.s)
        natural = float(lengths @ np.hypot(*self.natural[:, 1:].T))
        compliance = float(lengths @ (1.0 / self.free.stiffness[:, 1:].min(axis=1)))
        return 0.5 * max(0.5 * np.pi - natural, 0.0) ** 2 / compliance

    @cached_property
    def full(self) -> Problem:
        """The Problem with all that may act."""
        full = self._with_terms(self.rod, self.surroundings.obstacles, self.section)
        if not self.touches_itself:
            return full
        return full._replace(strands=no_strands(np.array(self.radii), self.pair_spring))

    @cached_property
    def held(self) -> Problem:
        """The Problem with other holds, without what may act; of the type of `full`."""
        around = self.surroundings
        if not around.obstacles and not self.yields and not self.touches_itself:
            return self.full
        rod = around.free.rod
        return self._with_terms(rod, (), yielding_layers(rod, self.free.stiffness))

    def _with_terms(self, rod: Rod, obstacles: tuple[Obstacle, ...],
                    section: PlasticSection) -> Problem:
        scene = self.scene if obstacles else build_scene((), Surface.of(rod), self.s)
        none = np.zeros((scene.kind.size, self.s.size))
        points = [getattr(NO_POINTS, name).copy() for name in _OF + _VECTORS[:-1]]
        contacts = ContactSet(self.spring, none, *points, self.spring)
        loads = {name: term.made(self.surroundings, self.s) for name, term in TERMS.items()
                 if hasattr(term, 'made')}
        return self.free._replace(elastic=elastic_part(rod), plastic=section, anchor=no_inertia(),
                                  hold=self._no_holds, contact=Contact(scene, contacts),
                                  strands=no_strands(np.zeros(0), 0.0), **loads)

    @property
    def static(self) -> Problem:
        """The Problem at rest: kernels are compiled for one that hangs freely, and for others."""
        return self.free if self.hangs else self.full

    @cached_property
    def scene(self) -> Scene:
        """The obstacles, for a gripper at the origin."""
        around = self.surroundings
        return build_scene(around.obstacles, Surface.of(around.rod), self.s)

    @cached_property
    def section(self) -> PlasticSection:
        """The springs that yield, without plastic strain; none if nothing yields."""
        if self._nominal is not None:
            return self._nominal.section  # an estimate is of a DLO that is about as strong
        return yielding_layers(self.rod, self.free.stiffness)

    @cached_property
    def start(self) -> Memory:
        """The Memory of a DLO without a past, on this mesh."""
        springs = self.section.set.shape[1] if self.yields else 0
        bodies = self.scene.kind.size if self.surroundings.obstacles else 0
        return Memory.empty(self.s, springs, bodies, self.surroundings)

    @cached_property
    def _nothing(self) -> tuple[Any, ...]:
        """What a Memory holds of a DLO on which nothing acts that may."""
        past = Memory.empty(self.s, 0, 0, self.surroundings)
        return past.plastic, past.node_force, *past.points

    def system(self, rotation: Floats, origin: ArrayLike | None = None,
               memory: Memory | None = None, holds: Holds = (), *,
               culled: bool = False, springs: bool = True) -> Problem:
        """Return the kernel's Problem in a gripper, its multipliers fresh copies.

        `culled`: without what may act; `springs`: whether holds have some beside their forces.
        Shapes: rotation (3, 3), origin (3,).
        """
        base = np.array(rotation, dtype=float, order='C')
        place = np.zeros(3) if origin is None else np.array(origin, dtype=float)
        if not holds and (culled or self.hangs):
            free: Problem = with_gripper(self.free, base, place)
            return free
        past = self.start if memory is None else memory
        full, *left = self.placing(place, past, holds, culled, springs)
        result: Problem = placed(full, base, place, *left)
        if self.touches_itself and not culled:
            result = result._replace(strands=self._known_strands(past))
        return result

    def placing(self, origin: Floats, past: Memory, holds: Holds, culled: bool,
                springs: bool) -> tuple[Any, ...]:
        """Return what `minimize.solve.placed` takes but the gripper; arguments as of `system`."""
        left: tuple[Any, ...] = (
            self._nothing if culled else (past.plastic, past.node_force, *past.points))
        return (self.held if culled else self.full,
                self._hold_rows(holds, origin, past.hold, springs) if holds else self._no_holds,
                self.held_spring if holds else self.spring, *left)

    def _known_strands(self, memory: Memory) -> Strands:
        """Return the Strands that a Memory knows of, but for what is behind grips."""
        pairs = self.pairs_at(memory.strands)
        own = (pairs[:, 0] >= 0) & (pairs[:, 1] < self.s.size - 1)
        return smooth_strands(pairs[own], np.array(memory.strands[own, 2]),
                              self.radii[pairs[own]].sum(axis=1), np.array(self.radii),
                              NO_RAYS.copy(), self.pair_spring)

    def pairs_at(self, strands: Floats) -> Ints:
        """Return (P, 2) the strands in which places of a Memory's `strands` are.

        They are elements, or -1 and N: what is straight behind the grips.
        """
        at, last = strands[:, :2], self.s.size - 2
        pairs: Ints = np.clip(np.searchsorted(self.s, at, side='right') - 1, 0, last)
        pairs[at < 0.0], pairs[at > self.s[-1]] = -1, last + 1
        return pairs

    @cached_property
    def pair_spring(self) -> float:
        """Spring in N/m of pairs of places that touch each other."""
        return float(_PAIR_SPRING * self.free.stiffness[:, 1:].max() / self.radii.max() ** 3)

    @cached_property
    def _springs(self) -> dict[str, float]:
        """The springs of constraints, N/m."""
        if self._nominal is not None:
            return self._nominal._springs
        rod, pull = self.rod, self.free.load.pull
        weight = np.sqrt(np.einsum('ki,ki->k', pull, pull)).sum()
        bend = min(rod.stiffness[1:]) / rod.length**2
        return {name: float(min(stiff * (weight + bend), most * bend) / rod.length)
                for name, stiff, most in _SPRINGS}

    @cached_property
    def spring(self) -> float:
        """Spring in N/m of contacts where the gripper alone holds it."""
        return self._springs['spring']

    @cached_property
    def held_spring(self) -> float:
        """Spring in N/m of contacts where more than the gripper holds it."""
        return self._springs['held_spring']

    @cached_property
    def hold_spring(self) -> float:
        """Spring in N/m of what holds it beside the gripper."""
        return self._springs['hold_spring']

    @cached_property
    def _no_holds(self) -> HoldRows:
        return no_holds(self.hold_spring, self.hold_spring * self.lever**2)

    def _hold_rows(self, holds: Holds, origin: Floats, force: Floats, springs: bool) -> HoldRows:
        """Return the HoldRows of Holds, with the forces (K,) that are known, N."""
        stiffness = 0.0
        if springs:
            stiffness = self.hold_spring if holds[0].s is None else self._spring_of(holds)
        node, first, share = self.held_nodes(holds)
        rows, target, axes = np.empty((first.item(-1), 6)), np.empty(share.shape), np.empty(
            (len(holds), 3, 3))
        for k, hold in enumerate(holds):
            rows[first[k]:first[k + 1]] = hold.held
            target[k], axes[k] = hold.pose.position, hold.pose.rotation
        rows[:, :3] *= self.lever
        return HoldRows(
            node, first, target - origin, axes, share, rows,
            np.array(force) if force.size == len(rows) else np.zeros(len(rows)), stiffness,
            stiffness * self.lever**2)

    def _spring_of(self, holds: Holds) -> float:
        """Return the `hold_spring` of a DLO as long as the shortest part between two grips, N/m."""
        length, at, shortest = self.s.item(-1), 0.0, 1.0
        for hold in holds:
            place = place_of(hold, length)
            shortest, at = min(shortest, (place - at) / length), place
        return self.hold_spring / shortest**3

    def held_nodes(self, holds: Holds) -> tuple[Ints, Ints, Floats]:
        """Return nodes (A,), where the rows (A + 1,) begin, and shares (A, 3) of A Holds.

        All as of HoldRows; they are kept for the next step, and nobody writes into them.
        """
        kinds: tuple[Any, ...] = ()
        for hold in holds:
            kinds += hold.s, hold.grip
        known = self._held_nodes.get(kinds)
        if known is None:
            s = self.s if self._nominal is None else self._nominal.s
            tiny = _SAME_NODE * s.item(-1)
            node = [s.size - 1 if hold.s is None else int(s.searchsorted(hold.s - tiny))
                    for hold in holds]
            known = (np.array(node, dtype=np.int64),
                     np.cumsum([0, *(len(hold.held) for hold in holds)]),
                     np.array([hold.share for hold in holds]).reshape(-1, 3))
            self._held_nodes.clear()  # those of one set of holds are kept
            self._held_nodes[kinds] = known
        return known

    @cached_property
    def _held_nodes(self) -> dict[tuple[Any, ...], tuple[Ints, Ints, Floats]]:
        return {}

    def grip_rows(self, holds: Holds, axes: Floats) -> Floats:
        """Return (n, K, 6) what Holds hold at n times rotations (n, A, 3, 3), all in m."""
        rows = np.concatenate([held_rows(hold.grip, axes[:, k]) for k, hold in enumerate(holds)],
                              axis=1)
        rows[:, :, :3] *= self.lever
        return rows

    @property
    def lever(self) -> float:
        """A hold that is turned by 1 rad is missed by so much, m."""
        return float(_LEVER * self.s[-1])

    # ---- what is known of it --------------------------------------------------------------------

    @property
    def rod(self) -> Rod:
        """The Rod."""
        return self.surroundings.rod

    @cached_property
    def yields(self) -> bool:
        """Whether the DLO yields anywhere."""
        return self.rod.yields

    @cached_property
    def obstructed(self) -> bool:
        """Whether there are obstacles."""
        return bool(self.surroundings.obstacles)

    @cached_property
    def touches_itself(self) -> bool:
        """Whether its strands keep each other off."""
        return self.surroundings.self_contact

    @property
    def rubs_itself(self) -> bool:
        """Whether its strands rub on each other."""
        return self.surroundings.self_friction > 0.0

    @cached_property
    def radii(self) -> Floats:
        """(N,) how far its surface is from the axis at least in the elements, m."""
        return Surface.of(self.rod).least_radii(self.s)

    @cached_property
    def may_hang(self) -> bool:
        """Whether nothing but dead forces acts where nothing is touched and nothing yields."""
        around = self.surroundings
        return not (around.has_moments or around.pinned or around.other_loads)

    @cached_property
    def hangs(self) -> bool:
        """Whether nothing but dead forces ever acts, and nothing that happened matters."""
        return (self.may_hang and not self.obstructed and not self.yields
                and not self.touches_itself)

    @cached_property
    def load(self) -> Floats:
        """(3,) sum of the dead loads' `pull`, N."""
        result: Floats = self.free.load.pull.sum(axis=0)
        return result

    @cached_property
    def loaded(self) -> bool:
        """Whether any dead load acts."""
        return bool(self.free.load.pull.any())

    @cached_property
    def moments(self) -> Floats:
        """(N + 1, 3) dead moments on the nodes, N m."""
        return node_moments(self.surroundings, self.s)

    @cached_property
    def bounded_by_truncation(self) -> bool:
        """Whether `truncation_error` bounds the error: nothing varies, little natural twist."""
        around = self.surroundings
        return not (around.rod.varies or around.point_loads or callable(around.load)
                    or bool(very_twisted(np.abs(self.natural[:, 0]) @ self.free.lengths)))

    @property
    def natural(self) -> Floats:
        """(N, 3) stress-free strains of the elements, 1/m."""
        return self.free.natural

    def stress_free(self, memory: Memory | None) -> Floats:
        """Return (N, 3) the strains at which no moment acts, 1/m: natural ones plus the set."""
        strains = np.array(self.natural)
        if self.yields:
            section = self.section._replace(set=self.past(memory).plastic.copy())
            strains += set_strains(self.free.stiffness, section)
        return strains

    # ---- strains and unknowns -------------------------------------------------------------------

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns per strain component."""
        return self.free.basis.shape[2] or self.s.size - 1

    def unknowns(self, strains: Floats) -> Floats:
        """Return q (m, 3) whose strains are nearest to `strains` (N, 3)."""
        system = self.free
        values: Floats = (strains - system.natural) / system.scale
        if system.basis.shape[1]:
            values = np.einsum('iej,ei->ji', system.basis, values * system.lengths[:, None],
                               order='C')
        return values

    def strains_of(self, q: Floats) -> Floats:
        """Return (N, 3) the strains of unknowns q (m, 3)."""
        system = self.free
        if system.basis.shape[1]:
            q = np.einsum('iej,ji->ei', system.basis, q, order='C')
        return system.natural + system.scale * q

    def has_nodes(self, s: Floats) -> bool:
        """Whether its nodes are at `s` (n,), m."""
        return s is self.s or np.array_equal(s, self.s)

    def strains_from(self, s: Floats, strains: Floats) -> Floats:
        """Return (N, 3), new: strains given on a mesh `s`, averaged over this one's elements."""
        if self.has_nodes(s):
            return np.array(strains)
        return mapped(s, strains, self.s)

    @cached_property
    def sampled(self) -> Ints:
        """(n,) nodes by which two shapes on this mesh are compared, see SAMPLES."""
        at: Ints = np.searchsorted(self.s, SAMPLES * self.s[-1])
        return at

    def past(self, memory: Memory | None, own: Memory | None = None) -> Memory:
        """Return a Memory on this mesh, as far as it belongs to the DLO here; else `own`, or none.

        A set belongs to a rod; contacts and grips to a rod and all that acts on it: all by value.
        """
        if memory is not None and memory.of is self.surroundings and memory.s is self.s:
            return memory  # most steps: the one before was made here
        if memory is not None and memory.of is self.surroundings and memory.pristine:
            return self.start
        if memory is None or not self._suits(memory):
            memory = own
        if memory is None or not self._suits(memory):
            return self.start
        known = memory.of is None or same(memory.of, self.surroundings)
        if not known or len(memory.node_force) != len(self.start.node_force):
            bodies = len(self.start.node_force)
            memory = changed(memory.permanent_part(), node_force=np.zeros((bodies, memory.s.size)))
        return memory.resampled(self.s)

    def _suits(self, memory: Memory) -> bool:
        """Whether a set can be this rod's: its own, or of a rod that is not known."""
        return bool(memory.plastic.shape[1] == self.start.plastic.shape[1]
                    and (memory.of is None or same(memory.of.rod, self.rod)))

    # ---- others like it -------------------------------------------------------------------------

    @cached_property
    def finer(self) -> Discretization:
        """The same rod, every element halved, one unknown strain per half."""
        s = np.empty(2 * self.s.size - 1)
        s[::2], s[1::2] = self.s, 0.5 * (self.s[1:] + self.s[:-1])
        return Discretization(self.surroundings, s, 'local', 0)

    @cached_property
    def coarser(self) -> Discretization | None:
        """The same rod on 16 elements, one unknown strain in each; None if it has few anyway.

        And where something begins or acts inside, whose places a coarse mesh does not have.
        """
        count = self.s.size - 1
        if count < 2 * _COARSE or len(self.surroundings.breaks):
            return None
        kept = np.round(np.linspace(0, count, _COARSE + 1)).astype(int)
        return Discretization(self.surroundings, self.s[kept], 'local', 0)

    @cached_property
    def restriction(self) -> Floats:
        """(16, N): matrix that averages strains of this mesh over the elements of `coarser`."""
        assert self.coarser is not None
        return mapped(self.s, np.eye(self.s.size - 1), self.coarser.s)

    @cached_property
    def prolongation(self) -> Floats:
        """(N, 16): matrix that interpolates strains of `coarser` linearly."""
        assert self.coarser is not None
        middles, wanted = (0.5 * (s[1:] + s[:-1]) for s in (self.coarser.s, self.s))
        of = np.searchsorted(self.coarser.s, wanted) - 1  # the element in which each finer one lies
        one = np.eye(middles.size)
        result: Floats = one[of] + (wanted - middles[of])[:, None] * np.gradient(
            one, middles, axis=0)[of]
        return result

    @cached_property
    def local(self) -> Discretization:
        """The same elements, one unknown strain in each."""
        if self.basis == 'local':
            return self
        return Discretization(self.surroundings, self.s, 'local', 0)

    @cached_property
    def _with_nodes(self) -> dict[tuple[float, ...], Discretization]:
        return {}

    def with_nodes(self, places: tuple[float, ...]) -> Discretization:
        """Return a Discretization that has nodes at arc lengths (m) where something holds inside.

        Strains jump there, and so do their slopes, which no series follows: it is a local one.
        """
        if not places or self.basis == 'local' and np.isin(places, self.s).all():
            return self
        known = self._with_nodes.get(places)
        if known is None:
            s = with_breaks(self.s, np.union1d(self.surroundings.breaks, places))
            known = Discretization(self.surroundings, s, 'local', 0)
            self._with_nodes.clear()  # those of one set of holds are kept
            self._with_nodes[places] = known
        return known

    def within(self, surroundings: Surroundings) -> Discretization:
        """Return the same elements of the rod of other Surroundings, as long or not."""
        length = surroundings.rod.length
        s = np.append(self.s[:-1] * (length / self.s[-1]), length)
        return Discretization(surroundings, with_breaks(s, surroundings.breaks), self.basis,
                              self.n_terms)

    def of(self, rod: Rod) -> Discretization:
        """Return the Discretization of another Rod (as long or not) with the same elements."""
        return self.within(self.surroundings.of_rod(rod))

    def varied(self, **fields: Floats) -> Discretization:
        """Return the same discretization with other `lengths`, `natural`, `stiffness`, `pull`.

        For estimates, which vary a DLO many times a second: its Rod stays the nominal one, and so
        do the scales of the unknowns, which only say how they are written.
        """
        s = self.s
        if 'lengths' in fields:
            s = np.concatenate([[0.0], np.cumsum(fields['lengths'])])
        return Discretization(self.surroundings, s, self.basis, self.n_terms, FrozenDict(fields),
                              self)


def unknown_scale(basis: str, stiffness: Floats, lengths: Floats) -> Floats:
    """Return (..., N, 3) strain per unknown, so that the elastic energy is half their square sum.

    Shapes: stiffness (..., N, 3), lengths (..., N).
    """
    return 1 / np.sqrt(stiffness * lengths[..., None] if basis == 'local' else stiffness)


# ------------------------------------------------------------------------------------------------
# Where nodes are: at equal distances, or graded to the bend; always where something jumps.


_NEAR = 0.3  # of an element: a node nearer to a jump moves there
_DIGITS = 8  # of a bend in rad over the length that count


def even_mesh(length: float, elements: int, breaks: Floats) -> Floats:
    """Return nodes (elements + 1,): between jumps equal elements, about as long everywhere."""
    if not len(breaks) or len(breaks) + 1 > elements:
        s = np.arange(elements + 1.0) * np.float64(length / elements)
        s[-1] = length
        return s
    ends = np.concatenate([[0.0], breaks, [length]])
    parts = np.diff(ends)
    shares = np.ones(parts.size, dtype=int)
    for _ in range(elements - parts.size):
        shares[np.argmax(parts / shares)] += 1
    pieces = [np.linspace(a, b, n, endpoint=False)
              for a, b, n in zip(ends[:-1], ends[1:], shares, strict=True)]
    return np.append(np.concatenate(pieces), length)


def graded_mesh(s: Floats, strains: Floats, elements: int, breaks: Floats) -> Floats:
    """Return nodes that share out evenly the error of arcs with strains (N, 3)."""
    known = np.round(strains * s[-1], _DIGITS) / s[-1]  # a mesh is not graded to rounding errors
    return nodes_at(s, equidistribute(np.diff(s), known), elements, breaks)


def nodes_at(s: Floats, shares: Floats, elements: int, breaks: Floats) -> Floats:
    """Return nodes (elements + 1,), and those of jumps, between which `shares` rise alike."""
    nodes = np.interp(np.arange(elements + 1.0) * (1.0 / elements), shares, s)
    nodes[0], nodes[-1] = 0.0, s[-1]
    return with_breaks(nodes, breaks)


def with_breaks(s: Any, breaks: Floats) -> Floats:
    """Return nodes with one at each jump: a near one moves there, else one is added."""
    nodes: Floats = s
    if not len(breaks) or np.isin(breaks, s).all():
        return nodes
    inner = s[1:-1]
    after = np.clip(np.searchsorted(breaks, inner), 0, len(breaks) - 1)
    before = np.maximum(after - 1, 0)
    away = np.minimum(np.abs(breaks[after] - inner), np.abs(breaks[before] - inner))
    kept = inner[away > _NEAR * np.minimum(np.diff(s)[1:], np.diff(s)[:-1])]
    return np.concatenate([[0.0], np.union1d(kept, breaks), [s[-1]]])
