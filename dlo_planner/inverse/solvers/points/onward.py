# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Aligned shapes at one depth after another, in one compiled loop, as long as nothing is in doubt.

A shape at which the gripper or the DLO might leap, or that is hardly stable, ends the loop: who
called it looks closer. One depth, without limits, is the search for one shape.
"""

from typing import Any

import numpy as np

from dlo_planner.energy.problem import Problem
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.so3 import inner, matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.inverse.solvers.points.coupled import aligned_hanging
from dlo_planner.kernels import kernel
from dlo_planner.minimize.newton import largest_turn_between
from dlo_planner.model.arrays import Floats, Ints


@kernel
def aligned_onward(system: Problem, bases: Floats, strains: Floats, frames: Floats, place: Floats,
                   ahead: Floats, elements: Ints, fractions: Floats, normal: Floats,
                   reference: Floats, most: Floats, least: float, nodes: Ints, tolerance: float,
                   max_iterations: int) -> tuple[int, tuple[Any, ...], Floats, Floats, Floats]:
    """Find equilibria whose tangents are `normal` inside one element after another.

    Parameters
    ----------
    system, normal, tolerance, max_iterations
        As of `aligned_hanging`.
    bases, strains : ndarray, shapes (2, 3, 3) and (2, N, 3)
        Rotations of the gripper before the last one and last, and strains there, 1/m; read-only.
    frames, place : ndarray, shapes (N + 1, 3, 3) and (3,)
        Of the last one's nodes, and where the gripper is from where the tangent was, m; read-only.
    ahead, elements, fractions : ndarray, shape (k,)
        How many times the change before each search begins ahead, and where tangents are.
    reference : ndarray, shape (3, 3)
        Rotation of the gripper since which the first one is not turned freely; read-only. Further
        ones are not since the one before.
    most : ndarray, shape (3, k)
        By how much the gripper may turn (rad) and move (m), and nodes may turn beside that (rad).
    least : float
        Stability with which nothing is in doubt.
    nodes : ndarray, shape (j,)
        At which turns are looked at.

    Returns
    -------
    tuple
        How many were found; of each what `solve.solve_free` returns but the last number, as
        arrays; bases (k, 3, 3); axes (k, 3, 3) and position (k, 3) where the tangent is.
    """
    count, n = elements.size, strains.shape[1]
    all_strains, all_frames = np.empty((count, n, 3)), np.empty((count, n + 1, 3, 3))
    positions, wrenches = np.empty((count, n + 1, 3)), np.empty((count, 6))
    numbers, grippers = np.empty((5, count)), np.empty((count, 3, 3))
    axes, places = np.empty((count, 3, 3)), np.empty((count, 3))
    base, before, axis = bases[1].copy(), bases[0].copy(), np.empty(3)
    u, earlier, here = strains[1].copy(), strains[0].copy(), frames.copy()
    now, found, since = place.copy(), 0, reference.copy()
    for k in range(count):
        _free_axis(since, normal, axis)
        one, after, converged = aligned_hanging(
            system, base, u, before, earlier, ahead[k], elements[k], fractions[k], normal, since,
            axis, tolerance, max_iterations)
        if not converged or not one[7] > least:
            break
        point_inside(system.lengths, one[0], one[1], one[2], elements[k], fractions[k], axes[k],
                     places[k])
        angle = _angle(base, after)
        if (angle > most[0, k] or _distance(now, places[k]) > most[1, k]
                or largest_turn_between(here, one[1], base, after, nodes) > most[2, k] + angle):
            break
        grippers[k], now[:] = after, -places[k]
        all_strains[k], all_frames[k], positions[k], wrenches[k] = one[0], one[1], one[2], one[3]
        _put(one, numbers[:, k])
        before, base, since = base, after, after
        earlier, u, here = u, one[0], one[1]
        found += 1
    return (found, (all_strains, all_frames, positions, wrenches, numbers), grippers, axes, places)


@kernel
def _free_axis(reference: Floats, normal: Floats, axis: Floats) -> None:
    """Fill axis (3,) as `aligned.free_axis`."""
    for i in range(3):
        axis[i] = reference[i, 0] + normal[i]
    size = np.sqrt(inner(axis, axis))
    for i in range(3):
        axis[i] = axis[i] / size if size > 0.1 else reference[i, 0]


@kernel
def _put(one: tuple[Any, ...], numbers: Floats) -> None:
    """Fill numbers (5,): energies, residual, stability, iterations."""
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = (one[4], one[5], one[6], one[7],
                                                                  one[8])


@kernel
def _angle(base: Floats, after: Floats) -> float:
    """Return the angle in rad between two rotations (3, 3)."""
    turn = np.empty(3)
    put_vector(rotation_vector(times_transposed(matrix(after), matrix(base))), turn)
    angle: float = np.sqrt(inner(turn, turn))
    return angle


@kernel
def _distance(gripper: Floats, place: Floats) -> float:
    """Return how far the gripper moves (m) to where `place` (3,) is the origin."""
    way = np.empty(3)
    for i in range(3):
        way[i] = -place[i] - gripper[i]
    distance: float = np.sqrt(inner(way, way))
    return distance
