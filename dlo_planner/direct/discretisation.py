"""A rod cut into elements: everything about it that does not depend on the gripper."""

from functools import cached_property

import numpy as np

from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import System
from dlo_planner.ritz.series import orthonormal_basis


class Discretisation:
    """A rod on a mesh, in a basis, under gravity (immutable by convention).

    Attributes:
        rod: the Rod; gravity: (3,) m/s^2
        s: (N + 1,) arc lengths of the nodes, m
        basis: 'chebyshev', 'fourier' or 'local'; n_terms: N_c, unused by 'local'
    """

    def __init__(self, rod, s, basis, n_terms, gravity):
        self.rod, self.s, self.basis, self.n_terms, self.gravity = rod, s, basis, n_terms, gravity
        lengths = np.diff(s)
        scale = np.tile(1 / np.sqrt(rod.stiffness), (lengths.size, 1))
        if basis == 'local':
            scale /= np.sqrt(lengths)[:, None]
        pull = -node_masses(rod, s)[:, None] * gravity
        middle = 0.5 * (s[1:] + s[:-1])
        self._system = System(lengths, rod.natural_strains(middle), rod.stiffness, scale,
                              orthonormal_basis(basis, n_terms, s), pull, np.eye(3),
                              np.zeros((0, 3)), np.zeros(0))

    def system(self, rotation):
        """Return the kernel's System for a gripper turned by `rotation` (3, 3)."""
        return self._system._replace(base=np.array(rotation, dtype=float, order='C'))

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
        return Discretisation(self.rod, s, 'local', 0, self.gravity)

    def strains_from(self, s, strains):
        """Return (N, 3), new: strains given on a mesh `s`, averaged over this one's elements."""
        if s is self.s or np.array_equal(s, self.s):
            return np.array(strains)
        total = np.vstack([np.zeros(3), np.cumsum(strains * np.diff(s)[:, None], axis=0)])
        at_nodes = np.column_stack([np.interp(self.s, s, column) for column in total.T])
        return np.diff(at_nodes, axis=0) / np.diff(self.s)[:, None]
