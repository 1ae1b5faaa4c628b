"""A rod cut into elements: everything about it that does not depend on the gripper."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from dlo_planner.direct.history import History, mapped
from dlo_planner.direct.mesh import with_breaks
from dlo_planner.energy.contact import Contacts
from dlo_planner.energy.distance import build_scene
from dlo_planner.energy.hold import Hold
from dlo_planner.energy.loads import node_forces, node_masses, node_moments
from dlo_planner.energy.plastic import Layers
from dlo_planner.energy.potential import System
from dlo_planner.model.section import yielding_layers
from dlo_planner.model.value import Value, freeze, put, same
from dlo_planner.ritz.series import orthonormal_basis

# Springs of constraints yield by 1 / these of the length under the DLO's own forces. Soft ones at
# a held end would let a twisted DLO buckle too early; stiff ones at contacts cost iterations.
_STIFF_CONTACT, _STIFF_HOLD = 1e5, 1e7


class Discretisation(Value):
    """A rod on a mesh, in a basis, with all that acts on it but the grippers (immutable).

    Attributes:
        surroundings: Surroundings, with the rod
        s: (N + 1,) arc lengths of the nodes, m
        basis: 'chebyshev', 'fourier' or 'local'; n_terms: N_c, unused by 'local'
        spring: stiffness of contacts, N/m
    """

    PARTS = ('surroundings', 's', 'basis', 'n_terms')

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
        share, limit = _layers(rod)
        weight = np.linalg.norm(pull, axis=1).sum()
        bend = min(rod.stiffness[1:]) / rod.length**2
        scene = build_scene(surroundings.obstacles, rod.radius or 0.0)
        put(self, spring=_STIFF_CONTACT * (weight + bend) / rod.length,
            _hold_spring=(_STIFF_CONTACT * weight + _STIFF_HOLD * bend) / rod.length,
            _start=History.none(s, len(share), scene.kind.size, surroundings))
        put(self, _system=System(
            lengths, rod.mean_natural_strains(s), stiffness, scale,
            orthonormal_basis(basis, n_terms, s), pull, np.eye(3), np.zeros((0, 3)), np.zeros(0),
            Layers(share, limit, self._start.set.copy()), self._free, scene,
            self._contacts(self._start, np.zeros(3)), np.zeros((0, 3)), 0.0))

    def __reduce__(self):
        return type(self), tuple(getattr(self, name) for name in self.PARTS)

    @property
    def rod(self):
        """The Rod."""
        return self.surroundings.rod

    @property
    def _free(self):
        none = np.zeros((0, 3))
        return Hold(none, none, np.zeros(3), none, self._hold_spring)

    def _contacts(self, history, origin):
        points = {name: values.copy() for name, values in history.points.items()}
        points['anchor'] -= origin
        return Contacts(self.spring, history.node_force.copy(), points['element'],
                        points['obstacle'], points['multiplier'], points['fraction'],
                        points['anchor'], points['normal'], self.spring)

    def system(self, rotation, origin=None, history=None, far_end=None):
        """Return the kernel's System, its multipliers fresh copies.

        Args:
            rotation: (3, 3) of the gripper
            origin: (3,) its position; only obstacles and a far end need it
            history: History on this mesh; None: no past
            far_end: FarEnd or None
        """
        system = self._system._replace(base=np.array(rotation, dtype=float, order='C'))
        if history is not None and system.layers.share.size:
            system = system._replace(layers=system.layers._replace(set=history.set.copy()))
        if origin is None or not (system.scene.kind.size or far_end is not None):
            return system
        origin = np.array(origin, dtype=float)
        return system._replace(
            scene=system.scene._replace(origin=origin),
            contacts=self._contacts(history or self._start, origin),
            hold=self._free if far_end is None else self._hold(far_end, origin, history))

    def _hold(self, far_end, origin, history):
        points = 1 if far_end.grip == 'pinned' else 3
        offset = 0.1 * self.s[-1] * np.array([[0, 0, 0], [1, 0, 0], [0, 1.0, 0]])[:points]
        target = far_end.pose.position - origin + offset @ far_end.pose.rotation.T
        force = np.zeros((points, 3))
        if history is not None and history.hold.shape == force.shape:
            force = history.hold.copy()
        return Hold(offset, target, np.array(far_end.slide), force, self._hold_spring)

    @cached_property
    def load(self):
        """(3,) sum of the dead loads' `pull`, N."""
        return self._system.pull.sum(axis=0)

    @cached_property
    def moments(self):
        """(N + 1, 3) dead moments on the nodes, N m."""
        return node_moments(self.surroundings, self.s)

    @cached_property
    def isometric(self):
        """Whether half the square of the unknowns is the elastic energy."""
        system = self._system
        return not system.basis.shape[1] or bool((system.stiffness == system.stiffness[0]).all())

    @property
    def static(self):
        """The System without gripper, past and far end."""
        return self._system

    def unknowns(self, strains):
        """Return q (m, 3) whose strains are nearest to `strains` (N, 3)."""
        system = self._system
        values = (strains - system.natural) / system.scale
        if system.basis.shape[1]:
            values = system.basis.T @ (values * system.lengths[:, None])
        return values

    @property
    def start(self):
        """The History of a DLO without a past, on this mesh."""
        return self._start

    def past(self, history, own=None):
        """Return `history` (a History or None) on this mesh, as far as it belongs to this DLO.

        A permanent set belongs to a rod; contacts and grips to a rod and all that acts on it: all
        by value. What does not belong here is forgotten.

        Args:
            own: History that counts if `history` is None or of another rod; None: no past
        """
        if history is None or not self._suits(history):
            history = own
        if history is None or not self._suits(history):
            return self._start
        bodies = self._system.scene.kind.size
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
        return self._system.basis.shape[1] or self.s.size - 1

    @property
    def natural(self):
        """(N, 3) stress-free strains of the elements, 1/m."""
        return self._system.natural

    @cached_property
    def finer(self):
        """The same rod, every element halved, one unknown strain per half."""
        s = np.empty(2 * self.s.size - 1)
        s[::2] = self.s
        s[1::2] = 0.5 * (self.s[1:] + self.s[:-1])
        return Discretisation(self.surroundings, s, 'local', 0)

    def of(self, rod):
        """Return the Discretisation of another Rod (as long or not) with the same elements."""
        s = np.append(self.s[:-1] * (rod.length / self.s[-1]), rod.length)
        s = with_breaks(s, rod.breaks)
        return Discretisation(replace(self.surroundings, rod=rod), s, self.basis, self.n_terms)

    def strains_from(self, s, strains):
        """Return (N, 3), new: strains given on a mesh `s`, averaged over this one's elements."""
        if s is self.s or np.array_equal(s, self.s):
            return np.array(strains)
        return mapped(s, strains, self.s)

    def stress_free(self, history):
        """Return (N, 3) the strains at which no moment acts, 1/m: natural ones plus the set."""
        layers = self._system.layers
        share = layers.share[:, [0, 1, 1]]
        return self.natural + np.einsum('ejk,jk->ek', self.past(history).set, share)


def _layers(rod):
    """Return share (J, 2) and limit (J, 3) of a rod; J = 0 if it does not yield."""
    if not rod.yields:
        return np.zeros((0, 2)), np.zeros((0, 3))
    share, multiples = yielding_layers(rod.section_model, rod.hardening)
    bending = rod.yield_curvature or (np.inf, np.inf)
    torsion = rod.yield_torsion or np.inf
    return share, np.column_stack([multiples[:, 0] * torsion, multiples[:, 1] * bending[0],
                                   multiples[:, 1] * bending[1]])
