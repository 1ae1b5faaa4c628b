# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rod cut into elements: everything about it that does not depend on the gripper."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from dlo_planner.direct.acting import always, constraints, others, standing
from dlo_planner.direct.history import History, mapped
from dlo_planner.direct.mesh import with_breaks
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.distance import build_scene
from dlo_planner.energy.effects import needs_of
from dlo_planner.energy.loads import node_forces, node_masses, node_moments
from dlo_planner.energy.plastic import set_strains
from dlo_planner.energy.potential import System
from dlo_planner.energy.yielding import yielding_layers
from dlo_planner.model.arrays import Floats
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import Value, freeze, put, same
from dlo_planner.ritz.series import orthonormal_basis

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
    """

    PARTS = ('surroundings', 's', 'basis', 'n_terms')

    surroundings: Surroundings
    s: Floats
    basis: str
    n_terms: int
    spring: float

    def __init__(self, surroundings, s, basis, n_terms):
        put(self, surroundings=surroundings, s=s, basis=basis, n_terms=n_terms)
        freeze(s)
        rod = surroundings.rod
        lengths = np.diff(s)
        stiffness = rod.mean_stiffnesses(s)
        if basis == 'local':
            scale = 1 / np.sqrt(stiffness * lengths[:, None])
        else:  # series describe moments, which do not jump where the stiffness does
            scale = np.sqrt(rod.stiffness) / stiffness
        pull = (-node_masses(rod, s)[:, None] * surroundings.gravity
                - node_forces(surroundings, s))
        weight = np.linalg.norm(pull, axis=1).sum()
        bend = min(rod.stiffness[1:]) / rod.length**2
        for name, stiff, most in _SPRINGS:
            put(self, **{name: min(stiff * (weight + bend), most * bend) / rod.length})
        effects = always(rod, pull)
        put(self, _bare=System(
            lengths, rod.mean_natural_strains(s), stiffness, scale,
            orthonormal_basis(basis, n_terms, s), np.eye(3), np.zeros(3), effects,
            needs_of(effects, s.size), np.zeros((0, 3)), 0.0))
        springs, bodies = 0, 0
        if not self.hangs:
            springs, bodies = self._layers.set.shape[1], self._scene.kind.size
        put(self, _start=History.none(s, springs, bodies, surroundings))

    @property
    def _system(self):
        """The System with what acts: kernels are compiled for one that hangs, and for others."""
        return self._bare if self.hangs else self.full

    @cached_property
    def full(self):
        """The System with all effects that a simulator may bring."""
        return self._bare._replace(**others(self, self._layers, self._scene))

    @cached_property
    def _layers(self):
        return yielding_layers(self.rod, self._bare.stiffness)

    @cached_property
    def _scene(self):
        return build_scene(self.surroundings.obstacles, Surface.of(self.rod), self.s)

    def __reduce__(self):
        return type(self), tuple(getattr(self, name) for name in self.PARTS)

    @property
    def rod(self):
        """The Rod."""
        return self.surroundings.rod

    @property
    def lever(self):
        """A grip that is turned by 1 rad is missed by so much, m."""
        return _LEVER * self.s[-1]

    def system(self, rotation, origin=None, history=None, far_end=None):
        """Return the kernel's System, its multipliers fresh copies.

        Parameters
        ----------
        rotation
            (3, 3) rotation of the gripper.
        origin
            (3,) position of the gripper; only obstacles and a far end need it.
        history
            History on this mesh. If None, no past.
        far_end
            FarEnd or None.
        """
        system = self._system if far_end is None else self.full
        fields = {'base': np.array(rotation, dtype=float, order='C')}
        if origin is not None:
            fields['origin'] = origin = np.array(origin, dtype=float)
        if history is not None and self.yields:
            fields['plastic'] = system.plastic._replace(set=history.set.copy())
        if origin is not None and self.obstructed and far_end is None and not self.yields:
            return standing(self, fields['base'], origin, history)
        if origin is not None and (self.obstructed or far_end is not None):
            fields |= constraints(self, self._scene._replace(origin=origin), origin, history,
                                  far_end)
        return system._replace(**fields)

    @cached_property
    def load(self):
        """(3,) sum of the dead loads' `pull`, N."""
        return self._bare.load.pull.sum(axis=0)

    @cached_property
    def loaded(self):
        """Whether any dead load acts."""
        return bool(self._bare.load.pull.any())

    @cached_property
    def moments(self):
        """(N + 1, 3) dead moments on the nodes, N m."""
        return node_moments(self.surroundings, self.s)

    @cached_property
    def hangs(self):
        """Whether nothing but dead forces acts, and nothing that happened to the DLO matters."""
        around = self.surroundings
        return not (self.obstructed or self.yields or around.has_moments or around.pinned)

    @property
    def obstructed(self):
        """Whether there are obstacles."""
        return bool(self.surroundings.obstacles)

    @property
    def yields(self):
        """Whether the DLO yields anywhere."""
        return self.rod.yields

    @cached_property
    def told_by_truncation(self):
        """Whether `ritz.truncation` bounds the error: nothing varies along the DLO."""
        around = self.surroundings
        return not (around.rod.varies or around.point_loads or callable(around.load))

    def has_nodes(self, s):
        """Whether its nodes are at `s` (n,), m."""
        return s is self.s or np.array_equal(s, self.s)

    @cached_property
    def relaxed(self):
        """(N, 3), read-only: `natural`."""
        relaxed = self.natural.copy()
        freeze(relaxed)
        return relaxed

    @cached_property
    def isometric(self):
        """Whether half the square of the unknowns is the elastic energy."""
        system = self._bare
        return not system.basis.shape[1] or bool((system.stiffness == system.stiffness[0]).all())

    @cached_property
    def sampled(self):
        """(n,) nodes by which two shapes on this mesh are compared, see SAMPLES."""
        return np.searchsorted(self.s, SAMPLES * self.s[-1])

    @cached_property
    def static(self):
        """The System without gripper, past and far end."""
        return self._system

    def unknowns(self, strains):
        """Return q (m, 3) whose strains are nearest to `strains` (N, 3)."""
        system = self._bare
        values = (strains - system.natural) / system.scale
        if system.basis.shape[1]:
            values = system.basis.T @ (values * system.lengths[:, None])
        return values

    def strains_of(self, q):
        """Return (N, 3) the strains of unknowns q (m, 3)."""
        system = self._bare
        return system.natural + system.scale * (system.basis @ q if system.basis.shape[1] else q)

    @property
    def start(self):
        """The History of a DLO without a past, on this mesh."""
        return self._start

    def past(self, history, own=None):
        """Return `history` (a History or None) on this mesh, as far as it belongs to this DLO.

        A permanent set belongs to a rod; contacts and grips to a rod and all that acts on it: all
        by value. What does not belong here is forgotten.

        Parameters
        ----------
        own
            History that counts if `history` is None or of another rod. If None, no past.
        """
        if history is None or not self._suits(history):
            history = own
        if history is None or not self._suits(history):
            return self._start
        bodies = len(self._start.node_force)
        known = history.of is None or same(history.of, self.surroundings)
        if not known or len(history.node_force) != bodies:
            history = history.set_alone(bodies)
        return history.on(self.s)

    def _suits(self, history):
        """Whether a permanent set can be this rod's: its own, or of a rod that is not known."""
        return (history.set.shape[1] == self._start.set.shape[1]
                and (history.of is None or same(history.of.rod, self.rod)))

    @property
    def n_unknowns(self):
        """Number of unknowns per strain component."""
        return self._bare.basis.shape[1] or self.s.size - 1

    @property
    def natural(self):
        """(N, 3) stress-free strains of the elements, 1/m."""
        return self._bare.natural

    @cached_property
    def finer(self):
        """The same rod, every element halved, one unknown strain per half."""
        s = np.empty(2 * self.s.size - 1)
        s[::2] = self.s
        s[1::2] = 0.5 * (self.s[1:] + self.s[:-1])
        return Discretization(self.surroundings, s, 'local', 0)

    @cached_property
    def alone(self):
        """The same rod on the same mesh, without obstacles."""
        return Discretization(replace(self.surroundings, obstacles=()), self.s, self.basis,
                              self.n_terms)

    def of(self, rod):
        """Return the Discretization of another Rod (as long or not) with the same elements."""
        s = np.append(self.s[:-1] * (rod.length / self.s[-1]), rod.length)
        s = with_breaks(s, rod.breaks)
        return Discretization(replace(self.surroundings, rod=rod), s, self.basis, self.n_terms)

    def varied(self, **fields):
        """Return the same discretization with other `lengths`, `natural`, `stiffness`, `pull`.

        For estimates, which vary a DLO many times a second: its Rod stays the nominal one, and so
        do the scales of the unknowns, which only say how they are written.
        """
        other = object.__new__(type(self))
        s = self.s
        if 'lengths' in fields:
            s = np.concatenate([[0.0], np.cumsum(fields['lengths'])])
        put(other, surroundings=self.surroundings, s=s, basis=self.basis, n_terms=self.n_terms,
            _start=self._start, **{name: getattr(self, name) for name, *_ in _SPRINGS})
        freeze(s)
        put(other, _bare=self._bare._replace(**fields))
        if self.yields:
            put(other, _layers=self._layers)
        return other

    def strains_from(self, s, strains):
        """Return (N, 3), new: strains given on a mesh `s`, averaged over this one's elements."""
        if self.has_nodes(s):
            return np.array(strains)
        return mapped(s, strains, self.s)

    def start_from(self, shape):
        """Return (N, 3), read-only: the strains of a Shape, of any mesh, to begin a search with."""
        if self.has_nodes(shape.s):
            return shape.element_strains
        strains = self.strains_from(shape.s, shape.element_strains)
        freeze(strains)
        return strains

    def stress_free(self, history):
        """Return (N, 3) the strains at which no moment acts, 1/m: natural ones plus the set."""
        if not self.yields:
            return np.array(self.natural)
        layers = self._layers._replace(set=self.past(history).set.copy())
        return self.natural + set_strains(self._bare.stiffness, layers)
