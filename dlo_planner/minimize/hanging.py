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
from dlo_planner.energy.system import System, turned_system, unknown_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.leash import leash_on
from dlo_planner.minimize.newton import leashed_newton
from dlo_planner.model.arrays import Floats, Ints
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
    turned = turned_system(system, base.copy(), origin.copy())
    q = np.empty((unknown_count(system), 3))
    unknowns_of(turned, strains.copy(), q)
    leash = leash_on(frames, before, base, nodes, most)
    check = most > 0.0  # a literal would be compiled for by itself
    return fallen(turned, system, origin, q, tolerance, max_iterations, check, leash)


@kernel(inline='always')
def fallen(system, static, origin, q, tolerance, max_iterations, check, leash):
    """Return what `hang` does, from unknowns q (m, 3) on.

    Args:
        static: System whose energy is given: that of the DLO at rest
    """
    state, residual, stability, iterations, kicks = leashed_newton(
        system, q, tolerance, max_iterations, check, leash)
    positions, wrench = state.positions, np.empty(6)
    for k in range(positions.shape[0]):
        for i in range(3):
            positions[k, i] += origin[i]
    elastic = stored(static.effects, static, state.strains)
    energy = elastic + potential(static.effects, static, positions)
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    return (state.strains, state.rotations, positions, wrench, elastic, energy, residual,
            stability, iterations, kicks)


@kernel
def hang_many(system: System, bases: Floats, origins: Floats, start: Floats, tolerance: float,
              max_iterations: int, frames: Floats, nodes: Ints, strains: Floats, rotations: Floats,
              positions: Floats, wrenches: Floats, energies: Floats, proofs: Floats,
              iterations: Ints) -> None:
    """Fill the equilibria that the DLO falls into from one shape in many grippers, as `hang`.

    Args:
        bases: (n, 3, 3), read-only, rotations of the grippers; origins: (n, 3), read-only, m
        start: (N, 3), read-only, strains, 1/m
        frames, nodes: of no Leash: (0, 3, 3), read-only, and (0,)
        strains: (n, N, 3), rotations: (n, N + 1, 3, 3), positions: (n, N + 1, 3), wrenches: (n, 6),
            energies: (n, 2) elastic and all, proofs: (n, 3) residual, stability, `truncation`,
            iterations: (n,): all filled
    """
    for k in range(bases.shape[0]):
        (strains[k], rotations[k], positions[k], wrenches[k], energies[k, 0], energies[k, 1],
         proofs[k, 0], proofs[k, 1], iterations[k], _) = hang(
            system, bases[k], origins[k], start, tolerance, max_iterations, frames, bases[k], nodes,
            np.inf)
        proofs[k, 2] = truncation(system.lengths, strains[k], system.natural, system.scale,
                                  system.basis)
