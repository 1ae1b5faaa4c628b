# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rod cut into elements: everything about it that does not depend on the gripper."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.memory import ACTING, Memory, always, changing, others, past_on
from dlo_planner.direct.mesh import mapped, with_breaks
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.direct.terms import Held, Part
from dlo_planner.energy.loads import node_forces, node_masses, node_moments
from dlo_planner.energy.problem import Problem
from dlo_planner.energy.terms import structure_of
from dlo_planner.geometry.basis import orthonormal_basis, very_twisted
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import Value, freeze, put

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.shape import Shape

# Springs of constraints yield by 1 / these of the length under the DLO's own forces: those of
# contacts cost iterations the stiffer they are, tension between two grips multiplies what they
# round, and so does a load on a soft DLO: no more than this times the force that bends it
_SPRINGS = (('spring', 1e5, 1e8), ('held_spring', 1e3, 1e8), ('hold_spring', 1e2, np.inf))
SAMPLES = np.linspace(0, 1, 33)[1:-1]  # of the length: where shapes are compared
_LEVER = 0.1  # of the length


class Discretization(Value):
    """A rod on a mesh, in a basis, with all that acts on it but the grippers (immutable).

    Attributes
    ----------
    surroundings : Surroundings
        The rod and what acts on it.
    s : ndarray, shape (N + 1,)
        Arc lengths of the nodes, m.
    basis : str
        'chebyshev', 'fourier' or 'local'.
    n_terms : int
        N_c, number of terms of the series; unused by 'local'.
    spring, held_spring : float
        Stiffness of contacts, N/m: where one end is held, where both are.
    hold_spring : float
        Stiffness of a grip of the far end, N/m.
    bare : Problem
        The Problem with what acts on every DLO.
    start : Memory
        The Memory of a DLO without a past, on this mesh.
    """

    _PARTS = ('surroundings', 's', 'basis', 'n_terms')

    surroundings: Surroundings
    s: Floats
    basis: str
    n_terms: int
    spring: float
    held_spring: float
    hold_spring: float
    bare: Problem
    start: Memory
    _given: dict[str, Any]

    def __init__(self, surroundings: Surroundings, s: Floats, basis: str, n_terms: int) -> None:
        put(self, surroundings=surroundings, s=s, basis=basis, n_terms=n_terms)
        freeze(s)
        rod = surroundings.rod
        lengths = s[1:] - s[:-1]
        stiffness = rod.mean_stiffnesses(s)
        if basis == 'local':
            scale = 1 / np.sqrt(stiffness * lengths[:, None])
        else:  # series describe moments, which do not jump where the stiffness does
            scale = np.sqrt(rod.stiffness) / stiffness
        pull = (-node_masses(rod, s)[:, None] * surroundings.gravity
                - node_forces(surroundings, s))
        weight = np.sqrt(np.einsum('ki,ki->k', pull, pull)).sum()
        bend = min(rod.stiffness[1:]) / rod.length**2
        for name, stiff, most in _SPRINGS:
            put(self, **{name: min(stiff * (weight + bend), most * bend) / rod.length})
        effects = always(rod, pull)
        put(self, bare=Problem(
            lengths, rod.mean_natural_strains(s), stiffness, scale,
            orthonormal_basis(basis, n_terms, s), np.eye(3), np.zeros(3), effects,
            structure_of(effects, s.size), np.zeros((0, 3)), 0.0), _given={})
        put(self, start=Memory.empty(self))

    @cached_property
    def full(self) -> Problem:
        """The Problem with all effects that a simulator may bring."""
        return self.bare._replace(**others(self, self.start.left))

    def given(self, name: str) -> Any:
        """Return what an effect of this name has that depends on neither grips nor past."""
        if name not in self._given:
            self._given[name] = next(part for part in ACTING if part.name == name).given(self)
        return self._given[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self._PARTS)

    @property
    def rod(self) -> Rod:
        """The Rod."""
        return self.surroundings.rod

    @property
    def lever(self) -> float:
        """A grip that is turned by 1 rad is missed by so much, m."""
        return float(_LEVER * self.s[-1])

    def system(self, rotation: Floats, origin: ArrayLike | None = None,
               history: Memory | None = None, far_end: FarEnd | None = None) -> Problem:
        """Return the kernel's Problem, its multipliers fresh copies.

        Shapes: rotation (3, 3).
        """
        system = self.static if far_end is None else self.full
        left = (self.start if history is None else history).left
        base: Any = np.array(rotation, dtype=float, order='C')
        fields = {'base': base}
        if origin is not None:
            fields['origin'] = origin = np.array(origin, dtype=float)
        held = Held(origin, far_end)
        parts = changing(self, held)
        if len(parts) == 1 and (quick := parts[0].placed(self, base, left, held)) is not None:
            return quick
        return system._replace(**fields, **{part.name: part.record(self, left, held)
                                            for part in parts})

    @cached_property
    def load(self) -> Floats:
        """(3,) sum of the dead loads' `pull`, N."""
        result: Floats = self.bare.load.pull.sum(axis=0)
        return result

    @cached_property
    def loaded(self) -> bool:
        """Whether any dead load acts."""
        return bool(self.bare.load.pull.any())

    @cached_property
    def moments(self) -> Floats:
        """(N + 1, 3) dead moments on the nodes, N m."""
        return node_moments(self.surroundings, self.s)

    @cached_property
    def hangs(self) -> bool:
        """Whether nothing but dead forces acts, and nothing that happened to the DLO matters."""
        around = self.surroundings
        return not (any(part.acts(around) for part in ACTING) or around.has_moments
                    or around.pinned)

    @cached_property
    def free(self) -> Discretization:
        """The mesh without what may act and may not, see `direct.culling`; itself if it `hangs`.

        It does not hang freely where anything else acts than that.
        """
        if self.hangs:
            return self
        return Discretization(self.surroundings.free, self.s, self.basis, self.n_terms)

    def on(self, free: Discretization) -> Discretization:
        """Return the Discretization, with all that may act here, whose `free` is that."""
        mesh = Discretization(self.surroundings, free.s, free.basis, free.n_terms)
        put(mesh, free=free)
        return mesh

    @cached_property
    def left_anyway(self) -> tuple[str, ...]:
        """Names of what those effects leave to the next step that act on `free`, too."""
        return tuple(name for part in ACTING if not part.acts(self.surroundings)
                     for name in part.cleared(self.start.left))

    @cached_property
    def stores(self) -> tuple[Part, ...]:
        """The Parts that store energy, besides elasticity."""
        return tuple(part for part in ACTING if part.stores and part.acts(self.surroundings))

    @cached_property
    def only_touches(self) -> bool:
        """Whether obstacles act, and no other effect has a say in what a step leaves."""
        return all(part.rests and part.acts(self.surroundings) == (part.name == 'contact')
                   for part in ACTING)

    @property
    def obstructed(self) -> bool:
        """Whether there are obstacles."""
        return bool(self.surroundings.obstacles)

    @property
    def yields(self) -> bool:
        """Whether the DLO yields anywhere."""
        return self.rod.yields

    @cached_property
    def told_by_truncation(self) -> bool:
        """Whether `truncation` bounds the error: nothing varies, little natural twist."""
        around = self.surroundings
        return not (around.rod.varies or around.point_loads or callable(around.load)
                    or bool(very_twisted(np.abs(self.natural[:, 0]) @ self.bare.lengths)))

    def has_nodes(self, s: Floats) -> bool:
        """Whether its nodes are at `s` (n,), m."""
        return s is self.s or np.array_equal(s, self.s)

    @cached_property
    def relaxed(self) -> Floats:
        """(N, 3), read-only: `natural`."""
        relaxed = self.natural.copy()
        freeze(relaxed)
        return relaxed

    @cached_property
    def isometric(self) -> bool:
        """Whether half the square of the unknowns is the elastic energy."""
        system = self.bare
        return not system.basis.shape[1] or bool((system.stiffness == system.stiffness[0]).all())

    @cached_property
    def sampled(self) -> Ints:
        """(n,) nodes by which two shapes on this mesh are compared, see SAMPLES."""
        at: Ints = np.searchsorted(self.s, SAMPLES * self.s[-1])
        return at

    @cached_property
    def static(self) -> Problem:
        """The Problem at rest: kernels are compiled for one that hangs freely, and for others."""
        return self.bare if self.hangs else self.full

    def unknowns(self, strains: Floats) -> Floats:
        """Return q (m, 3) whose strains are nearest to `strains` (N, 3)."""
        system = self.bare
        values: Floats = (strains - system.natural) / system.scale
        if system.basis.shape[1]:
            values = system.basis.T @ (values * system.lengths[:, None])
        return values

    def strains_of(self, q: Floats) -> Floats:
        """Return (N, 3) the strains of unknowns q (m, 3)."""
        system = self.bare
        return system.natural + system.scale * (system.basis @ q if system.basis.shape[1] else q)

    def past(self, history: Memory | None, own: Memory | None = None) -> Memory:
        """Return `memory.past_on` this mesh."""
        return past_on(self, history, own)

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns per strain component."""
        return self.bare.basis.shape[1] or self.s.size - 1

    @property
    def natural(self) -> Floats:
        """(N, 3) stress-free strains of the elements, 1/m."""
        return self.bare.natural

    @cached_property
    def finer(self) -> Discretization:
        """The same rod, every element halved, one unknown strain per half."""
        s = np.sort(np.append(self.s, 0.5 * (self.s[1:] + self.s[:-1])))
        return Discretization(self.surroundings, s, 'local', 0)

    @cached_property
    def without_obstacles(self) -> Discretization:
        """The same rod on the same mesh, without obstacles."""
        return Discretization(replace(self.surroundings, obstacles=()), self.s, self.basis,
                              self.n_terms)

    def of(self, rod: Rod) -> Discretization:
        """Return the Discretization of another Rod (as long or not) with the same elements."""
        s = np.append(self.s[:-1] * (rod.length / self.s[-1]), rod.length)
        s = with_breaks(s, rod.breaks)
        return Discretization(self.surroundings.of_rod(rod), s, self.basis, self.n_terms)

    def varied(self, **fields: Floats) -> Discretization:
        """Return the same discretization with other `lengths`, `natural`, `stiffness`, `pull`.

        For estimates, which vary a DLO many times a second: its Rod stays the nominal one, and so
        do the scales of the unknowns, which only say how they are written.
        """
        other = object.__new__(type(self))
        s = self.s
        if 'lengths' in fields:
            s = np.concatenate([[0.0], np.cumsum(fields['lengths'])])
            # a series is orthonormal on its elements: strains are projected on it by their lengths
            fields['basis'] = self.bare.basis / np.sqrt(s[-1] / self.s[-1])
        put(other, surroundings=self.surroundings, s=s, basis=self.basis, n_terms=self.n_terms,
            start=self.start, **{name: getattr(self, name) for name, *_ in _SPRINGS})
        freeze(s)
        put(other, bare=self.bare._replace(**fields))
        put(other, free=other if self.hangs else self.free.varied(**fields))
        put(other, _given={part.name: self.given(part.name) for part in ACTING
                           if part.of_rod and part.acts(self.surroundings)})
        return other

    def strains_from(self, s: Floats, strains: Floats) -> Floats:
        """Return (N, 3), new: strains given on a mesh `s`, averaged over this one's elements."""
        if self.has_nodes(s):
            return np.array(strains)
        return mapped(s, strains, self.s)

    def start_from(self, shape: Shape) -> Floats:
        """Return (N, 3), read-only: the strains of a Shape, of any mesh, to begin a search with."""
        if self.has_nodes(shape.s):
            return shape.element_strains
        strains = self.strains_from(shape.s, shape.element_strains)
        freeze(strains)
        return strains

    def stress_free(self, history: Memory | None) -> Floats:
        """Return (N, 3) the strains at which no moment acts, 1/m: natural ones plus the set."""
        left = self.past(history).left if self.stores else {}
        return sum((part.strains(self, left) for part in self.stores), np.array(self.natural))
