# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Equilibrium and alignment of a DLO that hangs freely: one kernel from one shape to the next.

`aligned.aligned_newton`, which begins ahead in the trend, with the results of a Shape.
"""

from typing import Any

import numpy as np

from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.problem import Problem, unknown_count, with_gripper
from dlo_planner.geometry.so3 import inner, matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.inverse.solvers.points.aligned import aligned_newton, turn_by
from dlo_planner.kernels import kernel
from dlo_planner.minimize.solve import outputs
from dlo_planner.model.arrays import Floats

_LARGEST_TURN = 0.6  # rad, of the gripper: no search begins farther ahead


@kernel
def aligned_hanging(system: Problem, base: Floats, strains: Floats, earlier_base: Floats,
                    earlier: Floats, ahead: float, element: int, fraction: float,
                    normal: Floats, reference: Floats, axis: Floats, tolerance: float,
                    max_iterations: int) -> tuple[tuple[Any, ...], Floats, bool]:
    """Find the equilibrium whose tangent inside `element` is `normal`.

    Args:
        system: Problem without obstacles, far end, plasticity; its `base` is not used
        base: (3, 3), rotation of the gripper before
        strains: (N, 3), strains before, 1/m
        earlier_base, earlier: the same once more before
        ahead: how many times that change the search starts ahead of where the DLO was before
        element, fraction, normal, reference, axis, tolerance, max_iterations: as `aligned_newton`

    Returns:
        what `minimize.solve.solve_free` returns, of a gripper in the origin
        base: (3, 3) rotation of the gripper; converged
    """
    here = with_gripper(system, base.copy(), system.origin)
    q, begin = np.empty((unknown_count(system), 3)), strains.copy()
    go_ahead(earlier_base, earlier, ahead, here.base, begin, np.empty(3))
    unknowns_of(here, begin, q)
    state, turned, residual, _, stability, iterations, converged = aligned_newton(
        here, q, element, fraction, normal, reference, axis, tolerance, max_iterations)
    wrench = np.empty(6)
    elastic, energy = outputs(system, state, wrench)
    return (state.strains, state.rotations, state.positions, wrench, elastic, energy, residual,
            stability, iterations, 0), orthonormal(turned), converged


@kernel
def go_ahead(earlier_base: Floats, earlier: Floats, ahead: float, base: Floats, strains: Floats,
             turn: Floats) -> None:
    """Go on with base (3, 3) and strains (N, 3), 1/m, as they have changed since earlier ones.

    Args:
        earlier_base, earlier: (3, 3), (N, 3)
        ahead: how many times that change
        turn: (3,) filled: the turn of the base, rad; 0 where it would be a large one
    """
    for i in range(3):
        turn[i] = 0.0
    if ahead <= 0.0:
        return
    put_vector(rotation_vector(times_transposed(matrix(base), matrix(earlier_base))), turn)
    turn *= ahead
    if not np.sqrt(inner(turn, turn)) < _LARGEST_TURN:
        turn[:] = 0.0
        return
    turn_by(base.copy(), turn, base)
    for e in range(strains.shape[0]):
        for i in range(3):
            strains[e, i] += ahead * (strains[e, i] - earlier[e, i])


@kernel
def orthonormal(rotation: Floats) -> Floats:
    """Return the rotation (3, 3) nearest to one that is it but for rounding (Newton's method)."""
    out = 1.5 * rotation
    for i in range(3):
        for j in range(3):
            drift = 0.0
            for k in range(3):
                drift += rotation[k, i] * rotation[k, j]
            for k in range(3):
                out[k, j] -= 0.5 * rotation[k, i] * drift
    return out
