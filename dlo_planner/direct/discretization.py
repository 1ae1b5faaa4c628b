# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rod cut into elements: everything about it that does not depend on the gripper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.memory import NO_POINTS, Memory, mapped
from dlo_planner.energy.contact import Contact, ContactSet
from dlo_planner.energy.grip import GripConstraint, no_grip
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
from dlo_planner.energy.terms import TERMS, free_terms, structure_of
from dlo_planner.geometry.basis import equidistribute, orthonormal_basis, very_twisted
from dlo_planner.minimize.solve import placed
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.model.supports import FarEnd, Surroundings, held_rows
from dlo_planner.model.value import FrozenDict, Value, freeze, put, same

# Springs of constraints yield by 1 / these of the length under the DLO's own forces: those of
# contacts cost iterations the stiffer they are, tension between two grips multiplies what they
# round, and so does a load on a soft DLO: no more than this times the force that bends it
_SPRINGS = (('spring', 1e5, 1e8), ('held_spring', 1e3, 1e8), ('hold_spring', 1e2, np.inf))
SAMPLES = np.linspace(0, 1, 33)[1:-1]  # of the length: where shapes are compared
_LEVER = 0.1  # of the length


class Discretization(Value):
    """A rod on a mesh, in a basis, with all that acts on it but the grippers (immutable).

    Its Problems: `free`, without what acts only where it is touched or reached (obstacles, a yield
    stress) and without a grip of the far end; `held`, the same with such a grip; `full`, with all.
    """

    _PARTS = ('surroundings', 's', 'basis', 'n_terms', 'variation')

    surroundings: Surroundings
    s: Floats           # (N + 1,) nodes, m
    basis: str          # 'chebyshev', 'fourier' or 'local'
    n_terms: int        # of the series; unused by 'local'
    variation: Mapping[str, Floats] | None  # what `varied` was called with
    spring: float       # N/m, of contacts where one end is held,
    held_spring: float  # where both are
    hold_spring: float  # of a grip of the far end
    free: Problem
    _nominal: Discretization | None

    def __init__(self, surroundings: Surroundings, s: Floats, basis: str, n_terms: int,
                 variation: Mapping[str, Floats] | None = None,
                 nominal: Discretization | None = None) -> None:
        put(self, surroundings=surroundings, s=s, basis=basis, n_terms=n_terms, variation=variation,
            _nominal=nominal)
        freeze(s)
        if nominal is not None:
            put(self, free=nominal.free, **{name: getattr(nominal, name) for name, *_ in _SPRINGS})
        else:
            self._compute()
        if variation is not None:
            freeze(list(variation.values()))
            # copies: kernels are compiled for arrays that may be written
            fields = {name: np.array(values) for name, values in variation.items()}
            if nominal is not None and 'lengths' in fields:
                # a series is orthonormal on its elements: strains are projected by their lengths
                fields['basis'] = nominal.free.basis / np.sqrt(s[-1] / nominal.s[-1])
            put(self, free=self.free._replace(**fields))

    def _compute(self) -> None:
        rod, around, s = self.surroundings.rod, self.surroundings, self.s
        lengths = s[1:] - s[:-1]
        stiffness = rod.mean_stiffnesses(s)
        scale = unknown_scale(self.basis, stiffness, lengths, rod.stiffness)
        pull = -node_masses(rod, s)[:, None] * around.gravity - node_forces(around, s)
        weight = np.sqrt(np.einsum('ki,ki->k', pull, pull)).sum()
        bend = min(rod.stiffness[1:]) / rod.length**2
        for name, stiff, most in _SPRINGS:
            put(self, **{name: min(stiff * (weight + bend), most * bend) / rod.length})
        effects = free_terms(pull)
        put(self, free=Problem(
            lengths, rod.mean_natural_strains(s), stiffness, scale,
            orthonormal_basis(self.basis, self.n_terms, s), np.eye(3), np.zeros(3), effects,
            structure_of(effects, s.size), np.zeros((0, 3)), 0.0))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self._PARTS)

    # ---- the Problem ----------------------------------------------------------------------------

    @cached_property
    def full(self) -> Problem:
        """The Problem with all that may act."""
        return self._with_terms(self.rod, self.surroundings.obstacles, self.section)

    @cached_property
    def held(self) -> Problem:
        """The Problem with a grip of the far end, without what may act; of the type of `full`."""
        around = self.surroundings
        if not around.obstacles and not self.yields:
            return self.full
        rod = around.free.rod
        return self._with_terms(rod, (), yielding_layers(rod, self.free.stiffness))

    def _with_terms(self, rod: Rod, obstacles: tuple[Obstacle, ...],
                    section: PlasticSection) -> Problem:
        scene = self.scene if obstacles else build_scene((), Surface.of(rod), self.s)
        none = np.zeros((scene.kind.size, self.s.size))
        contacts = ContactSet(self.spring, none, *(one.copy() for one in NO_POINTS[:-1]),
                              self.spring)
        loads = {name: term.made(self.surroundings, self.s) for name, term in TERMS.items()
                 if hasattr(term, 'made')}
        return self.free._replace(elastic=elastic_part(rod), plastic=section, anchor=no_inertia(),
                                  hold=self._free_end, contact=Contact(scene, contacts), **loads)

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
        return past.plastic, past.node_force, *past.points[:-1]

    def system(self, rotation: Floats, origin: ArrayLike | None = None,
               memory: Memory | None = None, far_end: FarEnd | None = None, *,
               culled: bool = False, springs: bool = True) -> Problem:
        """Return the kernel's Problem in a gripper, its multipliers fresh copies.

        `culled`: without what may act; `springs`: whether a grip has some beside its forces.
        Shapes: rotation (3, 3), origin (3,).
        """
        base = np.array(rotation, dtype=float, order='C')
        place = np.zeros(3) if origin is None else np.array(origin, dtype=float)
        if far_end is None and (culled or self.hangs):
            free: Problem = with_gripper(self.free, base, place)
            return free
        past = self.start if memory is None else memory
        left: tuple[Any, ...] = (
            self._nothing if culled else (past.plastic, past.node_force, *past.points[:-1]))
        result: Problem = placed(
            self.held if culled else self.full, base, place,
            self._grip(far_end, place, past.hold, springs),
            self.spring if far_end is None else self.held_spring, *left)
        return result

    @cached_property
    def _free_end(self) -> GripConstraint:
        return no_grip(self.hold_spring, self.hold_spring * self.lever**2)

    def _grip(self, far_end: FarEnd | None, origin: Floats, force: Floats,
              springs: bool) -> GripConstraint:
        """Return the GripConstraint of the far end, with the forces (K,) that are known, N."""
        if far_end is None:
            return self._free_end
        stiffness = self.hold_spring if springs else 0.0
        rows, = self.grip_rows(far_end.grip, [far_end.pose.rotation])
        return GripConstraint(
            far_end.pose.position - origin, np.array(far_end.pose.rotation, order='C'),
            np.array(far_end.share), rows,
            np.array(force) if force.shape == (len(rows),) else np.zeros(len(rows)), stiffness,
            stiffness * self.lever**2)

    def grip_rows(self, grip: str, axes: Sequence[Floats] | Floats) -> Floats:
        """Return (n, K, 6) what a grip holds at each of n rotations (3, 3), all in m."""
        rows = np.array([held_rows(grip, one) for one in axes])
        rows[:, :, :3] *= self.lever
        return rows

    @property
    def lever(self) -> float:
        """A grip that is turned by 1 rad is missed by so much, m."""
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
    def may_hang(self) -> bool:
        """Whether nothing but dead forces acts where nothing is touched and nothing yields."""
        around = self.surroundings
        return not (around.has_moments or around.pinned or around.other_loads)

    @cached_property
    def hangs(self) -> bool:
        """Whether nothing but dead forces ever acts, and nothing that happened matters."""
        return self.may_hang and not self.obstructed and not self.yields

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
        return self.free.basis.shape[1] or self.s.size - 1

    def unknowns(self, strains: Floats) -> Floats:
        """Return q (m, 3) whose strains are nearest to `strains` (N, 3)."""
        system = self.free
        values: Floats = (strains - system.natural) / system.scale
        if system.basis.shape[1]:
            values = system.basis.T @ (values * system.lengths[:, None])
        return values

    def strains_of(self, q: Floats) -> Floats:
        """Return (N, 3) the strains of unknowns q (m, 3)."""
        system = self.free
        return system.natural + system.scale * (system.basis @ q if system.basis.shape[1] else q)

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
        if memory is None or not self._suits(memory):
            memory = own
        if memory is None or not self._suits(memory):
            return self.start
        known = memory.of is None or same(memory.of, self.surroundings)
        if not known or len(memory.node_force) != len(self.start.node_force):
            bodies = len(self.start.node_force)
            memory = replace(memory.permanent_part(), node_force=np.zeros((bodies, memory.s.size)))
        return memory.resampled(self.s)

    def _suits(self, memory: Memory) -> bool:
        """Whether a set can be this rod's: its own, or of a rod that is not known."""
        return bool(memory.plastic.shape[1] == self.start.plastic.shape[1]
                    and (memory.of is None or same(memory.of.rod, self.rod)))

    # ---- others like it -------------------------------------------------------------------------

    @cached_property
    def finer(self) -> Discretization:
        """The same rod, every element halved, one unknown strain per half."""
        s = np.sort(np.append(self.s, 0.5 * (self.s[1:] + self.s[:-1])))
        return Discretization(self.surroundings, s, 'local', 0)

    @cached_property
    def local(self) -> Discretization:
        """The same elements, one unknown strain in each."""
        if self.basis == 'local':
            return self
        return Discretization(self.surroundings, self.s, 'local', 0)

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


def unknown_scale(basis: str, stiffness: Floats, lengths: Floats, mean: Floats) -> Floats:
    """Return (..., N, 3) strain per unknown, so that the elastic energy is half their square sum.

    Shapes: stiffness (..., N, 3), lengths (..., N), the rod's mean stiffness (..., 3).
    """
    if basis == 'local':
        return 1 / np.sqrt(stiffness * lengths[..., None])
    return np.sqrt(mean) / stiffness  # moments, which do not jump where the stiffness does


# ------------------------------------------------------------------------------------------------
# Where nodes are: at equal distances, or graded to the bend; always where something jumps.


_NEAR = 0.3  # of an element: a node nearer to a jump moves there
_DIGITS = 8  # of a bend in rad over the length that count


def even_mesh(length: float, elements: int, breaks: Floats | tuple[()] = ()) -> Floats:
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


def graded_mesh(s: Floats, strains: Floats, elements: int,
                breaks: Floats | tuple[()] = ()) -> Floats:
    """Return nodes that share out evenly the error of arcs with strains (N, 3)."""
    known = np.round(strains * s[-1], _DIGITS) / s[-1]  # a mesh is not graded to rounding errors
    return nodes_at(s, equidistribute(np.diff(s), known), elements, breaks)


def nodes_at(s: Floats, shares: Floats, elements: int,
             breaks: Floats | tuple[()] = ()) -> Floats:
    """Return nodes (elements + 1,), and those of jumps, between which `shares` rise alike."""
    nodes = np.interp(np.arange(elements + 1.0) * (1.0 / elements), shares, s)
    nodes[0], nodes[-1] = 0.0, s[-1]
    return with_breaks(nodes, breaks)


def with_breaks(s: Any, breaks: Floats | tuple[()]) -> Floats:
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
