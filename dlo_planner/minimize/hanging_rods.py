# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many DLOs that hang freely, each of another rod, from one compiled loop."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.system import System, turned_system
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hanging import hung, put_shape, told
from dlo_planner.minimize.leash import no_leash
from dlo_planner.minimize.workspace import new_workspace
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.ritz.record import Record, makes


class RodTable(Record):
    """What differs between DLOs of as many elements and terms; n rods, u different lengths.

    Attributes
    ----------
    mesh : ndarray of int, shape (n,)
        Which of the u meshes each rod has.
    lengths : ndarray, shape (u, N)
        Of the elements, m.
    basis : ndarray, shape (u, N, N_c)
        Orthonormal; (u, N, 0): local.
    natural : ndarray, shape (n, N, 3)
        As of a System, like what follows; read-only, like all from which a descent starts.
    stiffness : ndarray, shape (n, N, 3)
        Stiffness, N m^2.
    scale : ndarray, shape (n, N, 3)
        Scale of the unknowns.
    pull : ndarray, shape (n, N + 1, 3)
        Derivative of the dead loads' potential by the node positions, N.
    """

    mesh: Ints
    lengths: Floats
    basis: Floats
    natural: Floats
    stiffness: Floats
    scale: Floats
    pull: Floats


@makes(RodTable)
@kernel
def _new_rod_table(mesh, lengths, basis, natural, stiffness, scale, pull):
    return RodTable(mesh, lengths, basis, natural, stiffness, scale, pull)


@kernel
def hang_rods(system: System, rods: RodTable, bases: Floats, origins: Floats, tolerance: float,
              max_iterations: int, strains: Floats, rotations: Floats, positions: Floats,
              wrenches: Floats, energies: Floats, proofs: Floats, iterations: Ints) -> None:
    """Fill the equilibria that n DLOs fall into from their natural shapes, as `hang_many`.

    Args:
        system: System whose lengths, natural, stiffness, scale, basis and pull are written over
        rods: RodTable
        bases: (n, 3, 3), read-only, rotations of the grippers; origins: (n, 3), read-only, m
        tolerance, max_iterations: as in `hang_many`
        strains, rotations, positions, wrenches, energies, proofs, iterations: as in `hang_many`
    """
    last = -1
    natural = rods.natural
    work, leash = new_workspace(system), no_leash()
    turned = turned_system(system, np.empty((3, 3)), np.empty(3))
    for k in range(bases.shape[0]):
        if rods.mesh[k] != last:
            last = rods.mesh[k]
            _put_mesh(system, rods, last)
        _put_rod(system, rods, k)
        unknowns_of(turned, natural[k].copy(), work.start)
        state, residual, stability, iterations[k], _ = hung(
            turned, bases[k], origins[k], tolerance, max_iterations, leash, work)
        proofs[k, 0], proofs[k, 1] = residual, stability
        energies[k, 0], energies[k, 1] = told(turned, state, wrenches[k])
        put_shape(system, state, strains[k], rotations[k], positions[k], proofs[k])


@kernel
def _put_mesh(system, rods, u):
    """Write the mesh `u` into the system."""
    lengths, basis = system.lengths, system.basis
    for e in range(lengths.size):
        lengths[e] = rods.lengths[u, e]
        for j in range(basis.shape[1]):
            basis[e, j] = rods.basis[u, e, j]


@kernel
def _put_rod(system, rods, k):
    """Write the rod `k` into the system."""
    natural, stiffness, scale = system.natural, system.stiffness, system.scale
    pull = system.effects.load.pull
    n = natural.shape[0]
    for e in range(n):
        for i in range(3):
            natural[e, i] = rods.natural[k, e, i]
            stiffness[e, i] = rods.stiffness[k, e, i]
            scale[e, i] = rods.scale[k, e, i]
            pull[e, i] = rods.pull[k, e, i]
    for i in range(3):
        pull[n, i] = rods.pull[k, n, i]
