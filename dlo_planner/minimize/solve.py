# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of DLOs that hang freely in one compiled loop: in many grippers, or of many rods.

Of the time that such a shape takes, Python between kernels would be a third.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.problem import Problem, with_gripper
from dlo_planner.energy.terms import potential, stored
from dlo_planner.geometry.basis import truncation_error
from dlo_planner.geometry.record import Record, copy
from dlo_planner.kernels import kernel
from dlo_planner.minimize.newton import minimize, new_workspace, thorough
from dlo_planner.model.arrays import Floats, Ints


@kernel
def solve_step(system, base, origin, options, work, wrench):
    """Descend from `work.start` in a gripper; return the Configuration in the world, and outputs.

    That is elastic and all energy, residual, stability, iterations, kicks and violation. `base` and
    `origin` of the Problem are written over; wrench (6,) is filled.
    """
    for i in range(3):
        system.origin[i] = origin[i]
        for j in range(3):
            system.base[i, j] = base[i, j]
    state, residual, stability, iterations, kicks, violation = minimize(system, work.start, options,
                                                                        work)
    elastic, energy = outputs(system, state, wrench)
    return state, elastic, energy, residual, stability, iterations, kicks, violation


@kernel
def outputs(system, state, wrench):
    """Put a Configuration's positions into the world, fill the gripper's wrench (6,) on the DLO.

    Returns elastic and all energy, J.
    """
    positions = state.positions
    for k in range(positions.shape[0]):
        for i in range(3):
            positions[k, i] += system.origin[i]
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    elastic = stored(system.effects, system, state.strains)
    return elastic, elastic + potential(system.effects, system, positions)


@kernel
def solve_free_many(system: Problem, bases: Floats, origins: Floats, start: Floats,
                    tolerance: float, max_iterations: int, strains: Floats, rotations: Floats,
                    positions: Floats, wrenches: Floats, energies: Floats, proofs: Floats,
                    iterations: Ints) -> None:
    """Fill the equilibria that the DLO falls into from one shape in many grippers.

    Args:
        bases: (n, 3, 3), read-only, rotations of the grippers; origins: (n, 3), read-only, m
        start: (N, 3), read-only, strains, 1/m
        strains: (n, N, 3), rotations: (n, N + 1, 3, 3), positions: (n, N + 1, 3), wrenches: (n, 6),
            energies: (n, 2) elastic and all, proofs: (n, 3) residual, stability,
            `truncation_error`, iterations: (n,): all filled
    """
    work = new_workspace(system)
    options = thorough(tolerance, 0.0, max_iterations, tolerance > 0.0, tolerance < 0.0)
    turned = with_gripper(system, np.empty((3, 3)), np.empty(3))
    unknowns = np.empty_like(work.start)
    unknowns_of(turned, start.copy(), unknowns)
    for k in range(bases.shape[0]):
        copy(unknowns, work.start)
        iterations[k] = _fill(turned, bases[k], origins[k], options, work, strains[k], rotations[k],
                              positions[k], wrenches[k], energies[k], proofs[k])


@kernel
def _fill(system, base, origin, options, work, strains, rotations, positions, wrench, energies,
          proof):
    """Do what `solve_step` does, into arrays of one DLO; return the iterations."""
    state, energies[0], energies[1], proof[0], proof[1], iterations, _, _ = solve_step(
        system, base, origin, options, work, wrench)
    copy(state.strains, strains)
    copy(state.positions, positions)
    for k in range(rotations.shape[0]):
        copy(state.rotations[k], rotations[k])
    proof[2] = truncation_error(system.lengths, strains, system.natural, system.scale, system.basis)
    return iterations


class RodTable(Record):
    """What differs between DLOs of as many elements and terms; n rods, u different lengths."""

    mesh: Ints  # (n,) which of the u meshes each rod has
    lengths: Floats  # (u, N) of the elements, m
    basis: Floats  # (u, N, N_c) orthonormal; (u, N, 0): local
    # (n, N, 3) as of a Problem, like what follows; read-only, like all from which a descent starts
    natural: Floats
    stiffness: Floats  # (n, N, 3) stiffness, N m^2
    scale: Floats  # (n, N, 3) scale of the unknowns
    pull: Floats  # (n, N + 1, 3) derivative of the dead loads' potential by the node positions, N


@kernel
def solve_free_rods(system: Problem, rods: RodTable, bases: Floats, origins: Floats,
                    tolerance: float, max_iterations: int, strains: Floats, rotations: Floats,
                    positions: Floats, wrenches: Floats, energies: Floats, proofs: Floats,
                    iterations: Ints) -> None:
    """Fill the equilibria that n DLOs fall into from their natural shapes.

    Arguments as of `solve_free_many`, but a RodTable. Of the Problem lengths, natural, stiffness,
    scale, basis and pull are written over.
    """
    last = -1
    natural, work = rods.natural, new_workspace(system)
    options = thorough(tolerance, 0.0, max_iterations, tolerance > 0.0, tolerance < 0.0)
    turned = with_gripper(system, np.empty((3, 3)), np.empty(3))
    for k in range(bases.shape[0]):
        if rods.mesh[k] != last:
            last = rods.mesh[k]
            _put_mesh(system, rods, last)
        _put_rod(system, rods, k)
        unknowns_of(turned, natural[k].copy(), work.start)
        iterations[k] = _fill(turned, bases[k], origins[k], options, work, strains[k], rotations[k],
                              positions[k], wrenches[k], energies[k], proofs[k])


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
