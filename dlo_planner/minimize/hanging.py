# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that hangs freely: nothing holds or obstructs it. From one gripper's pose to its shape.

All of it is one kernel: of the time that such a shape takes, most would else be spent between
kernels. Many shapes in a loop need no Python at all.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.effects import potential, stored
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.system import System, turned_system
from dlo_planner.kernels import kernel
from dlo_planner.minimize.leash import leash_on, no_leash
from dlo_planner.minimize.newton import leashed_newton
from dlo_planner.minimize.workspace import new_workspace
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.ritz.arrays import copy
from dlo_planner.ritz.truncation import truncation


@kernel
def hang(system: System, base: Floats, origin: Floats, strains: Floats, tolerance: float,
         max_iterations: int, frames: Floats, before: Floats, nodes: Ints, most: float) -> tuple[
             Floats, Floats, Floats, Floats, float, float, float, float, int, int]:
    """Return the equilibrium that the DLO falls into from given strains.

    Args:
        system: System without constraints; its `base` and `origin` are not used
        base: (3, 3), read-only, rotation of the gripper; origin: (3,), read-only, its position, m
        strains: (N, 3), read-only, where the descent starts, 1/m
        tolerance, max_iterations: as `newton`
        frames, before, nodes, most: of the Leash, see `leash_on`

    Returns
    -------
    strains : ndarray, shape (N, 3)
        Strains of the elements, 1/m.
    rotations : ndarray, shape (N + 1, 3, 3)
        Frames of the nodes.
    positions : ndarray, shape (N + 1, 3)
        Positions of the nodes, world, m.
    wrench : ndarray, shape (6,)
        Force and moment of the gripper on the DLO, N, N m.
    elastic, energy : float
        Energy that is stored in the DLO, and all with the dead loads' potential, J.
    residual, stability, iterations, kicks
        As of `newton.leashed_newton`.
    """
    work = new_workspace(system)
    turned = turned_system(system, np.empty((3, 3)), np.empty(3))
    unknowns_of(turned, strains.copy(), work.start)
    state, residual, stability, iterations, kicks = hung(
        turned, base, origin, tolerance, max_iterations,
        leash_on(frames, before, base, nodes, most), work)
    wrench = np.empty(6)
    elastic, energy = told(turned, state, wrench)
    return (state.strains, state.rotations, state.positions, wrench, elastic, energy, residual,
            stability, iterations, kicks)


@kernel(inline='always')
def hung(turned, base, origin, tolerance, max_iterations, leash, work):
    """Return State, residual, stability, iterations and kicks of what `hang` finds.

    Args:
        turned: System whose `base` and `origin` are written over
        base, origin, tolerance, max_iterations: as of `hang`
        leash: Leash; work: Workspace, whose `start` it begins with, and of which the State is one
    """
    for i in range(3):
        turned.origin[i] = origin[i]
        for j in range(3):
            turned.base[i, j] = base[i, j]
    check = tolerance > 0.0  # a literal would be compiled for by itself
    return leashed_newton(turned, work.start, tolerance, max_iterations, check, leash, work)


@kernel
def told(system, state, wrench):
    """Put a State's positions into the world, fill wrench (6,); return elastic and all energy, J.

    The wrench is that of the gripper on the DLO.
    """
    positions = state.positions
    for k in range(positions.shape[0]):
        for i in range(3):
            positions[k, i] += system.origin[i]
    elastic = stored(system.effects, system, state.strains)
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    return elastic, elastic + potential(system.effects, system, positions)


@kernel
def hang_many(system: System, bases: Floats, origins: Floats, start: Floats, tolerance: float,
              max_iterations: int, strains: Floats, rotations: Floats, positions: Floats,
              wrenches: Floats, energies: Floats, proofs: Floats, iterations: Ints) -> None:
    """Fill the equilibria that the DLO falls into from one shape in many grippers, as `hang`.

    Args:
        bases: (n, 3, 3), read-only, rotations of the grippers; origins: (n, 3), read-only, m
        start: (N, 3), read-only, strains, 1/m
        strains: (n, N, 3), rotations: (n, N + 1, 3, 3), positions: (n, N + 1, 3), wrenches: (n, 6),
            energies: (n, 2) elastic and all, proofs: (n, 3) residual, stability, `truncation`,
            iterations: (n,): all filled
    """
    work, leash = new_workspace(system), no_leash()
    turned = turned_system(system, np.empty((3, 3)), np.empty(3))
    unknowns = np.empty_like(work.start)
    unknowns_of(turned, start.copy(), unknowns)
    for k in range(bases.shape[0]):
        copy(unknowns, work.start)
        state, residual, stability, iterations[k], _ = hung(
            turned, bases[k], origins[k], tolerance, max_iterations, leash, work)
        proofs[k, 0], proofs[k, 1] = residual, stability
        energies[k, 0], energies[k, 1] = told(turned, state, wrenches[k])
        put_shape(system, state, strains[k], rotations[k], positions[k], proofs[k])


@kernel
def put_shape(system, state, strains, rotations, positions, proof):
    """Fill strains (N, 3), rotations (N + 1, 3, 3), positions (N + 1, 3), and proof[2]."""
    copy(state.strains, strains)
    copy(state.positions, positions)
    for k in range(rotations.shape[0]):
        copy(state.rotations[k], rotations[k])
    proof[2] = truncation(system.lengths, strains, system.natural, system.scale, system.basis)
