"""A DLO that hangs freely: nothing acts on it but dead loads. From one gripper's pose to its shape.

All of it is one kernel: of the time that such a shape takes, most would else be spent between
kernels. `shapes` in a loop need no Python at all.
"""

import numpy as np

from dlo_planner.energy.elastic import add_elastic
from dlo_planner.energy.loads import dead_load
from dlo_planner.energy.potential import turned_system, unknown_count, unknowns_of
from dlo_planner.kernels import kernel
from dlo_planner.minimize.leash import leash_on
from dlo_planner.minimize.newton import leashed_newton


@kernel
def hang(system, base, origin, strains, tolerance, max_iterations, frames, before, nodes, most):
    """Return the equilibrium that the DLO falls into from given strains.

    Args:
        system: System without obstacles, far end, plasticity; its `base` is not used
        base: (3, 3), read-only, rotation of the gripper; origin: (3,), read-only, its position, m
        strains: (N, 3), read-only, where the descent starts, 1/m
        tolerance, max_iterations: as `newton`
        frames, before, nodes, most: of the Leash, see `leash_on`

    Returns:
        strains: (N, 3); rotations: (N + 1, 3, 3); positions: (N + 1, 3), world, m
        wrench: (6,) force and moment of the gripper on the DLO
        elastic: J; load: J, potential of the dead loads, zero at the gripper
        residual, stability, iterations, kicks: as `newton`
    """
    turned = turned_system(system, base.copy())
    q = np.empty((unknown_count(system), 3))
    unknowns_of(turned, strains.copy(), q)
    leash = leash_on(frames, before, base, nodes, most)
    check = most > 0.0  # a literal would be compiled for by itself
    state, residual, stability, iterations, kicks = leashed_newton(
        turned, q, tolerance, max_iterations, check, leash)
    elastic = add_elastic(system.lengths, state.strains, system.natural, system.stiffness,
                          state.slope)
    load, _ = dead_load(system.pull, state.positions)
    positions, wrench = np.empty_like(state.positions), np.empty(6)
    for k in range(positions.shape[0]):
        for i in range(3):
            positions[k, i] = state.positions[k, i] + origin[i]
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    return (state.strains, state.rotations, positions, wrench, elastic, load, residual, stability,
            iterations, kicks)
