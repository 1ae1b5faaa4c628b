# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`nearest.nearest_within` of a DLO that hangs freely, in one kernel."""

from typing import Any, TypeAlias

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.sensitivity import gripper_answers, node_twists, twists_inside
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import MAX_ITERATIONS, TOLERANCE, hanging_shape
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, with_gripper
from dlo_planner.inverse.solvers.points.aims import Aims, fill_misses, fill_slopes, inside
from dlo_planner.inverse.solvers.points.aligned import turn_by
from dlo_planner.inverse.solvers.points.coupled import orthonormal
from dlo_planner.inverse.solvers.points.nearest import (
    ENOUGH,
    HALVINGS,
    HARDLY,
    ITERATIONS,
    SMALL,
    STILL,
    extrapolated,
    step_within_ball,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import CONVERGED
from dlo_planner.minimize.newton import NEUTRAL, Workspace, new_workspace, thorough
from dlo_planner.minimize.solve import solve_step
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import pose_of


def nearest_hanging(mesh: Discretization, aims: Aims, shape: Shape, turn: float,
                    shift: float) -> Shape | None:
    """Return the Shape of least penalty whose gripper is within reach, or None.

    Parameters
    ----------
    mesh : Discretization
        That of the shape; it hangs freely.
    aims : Aims
    shape : Shape
        Shape where the step begins.
    turn, shift : float
        As of `nearest_within`.
    """
    gripper = shape.gripper
    status, base, origin, found = _nearest_hanging(
        mesh.static, gripper.rotation, gripper.position, mesh.start_from(shape), mesh.s, aims,
        np.array([turn] * 3 + [shift] * 3), TOLERANCE, MAX_ITERATIONS)
    if status == _MOVED:
        return hanging_shape(mesh, pose_of(origin, base), found)
    return shape if status == _STAYS else None


_NONE, _STAYS, _MOVED = 0, 1, 2
Misses: TypeAlias = tuple[Floats, Floats, Floats]  # nodes (N + 1,), m; where, places of fill_misses


@kernel
def _nearest_hanging(system: Problem, base: Floats, origin: Floats, strains: Floats, nodes: Floats,
                     aims: Aims, scale: Floats, tolerance: float,
                     max_iterations: int) -> tuple[int, Floats, Floats, tuple[Any, ...]]:
    """Do what `nearest_within` does; `nodes` (N + 1,), m, and `scale` (6,), rad and m: its reach.

    Returns
    -------
    tuple
        One of _NONE, _STAYS, _MOVED; rotation (3, 3) and position (3,) of the gripper; and what
        `minimize.solve.solve_free` returns, of which the other arguments are.
    """
    rows, misses = 3 * aims.weights.size + 4, (nodes, np.empty(aims.weights.size),
                                               np.empty((aims.weights.size, 3, 3)))
    here, there, begin = base.copy(), np.empty((3, 3)), base.copy()
    place, target = origin.copy(), np.empty(3)
    work, turned = new_workspace(system), with_gripper(system, base.copy(), origin.copy())
    kept = (strains.copy(), np.empty((nodes.size, 3, 3)), np.empty((nodes.size, 3)), np.empty(6))
    wrench, numbers, told_of = np.empty(6), np.empty(5), np.zeros(5)
    q, x = np.empty_like(work.start), np.zeros(6)
    unknowns_of(turned, kept[0], q)
    right, ahead, slopes = np.empty(rows), np.empty(rows), np.empty((rows, 6))
    status, value, last = _NONE, np.inf, np.full((2, 6), np.nan)
    for attempt in range(ITERATIONS):
        turned.base[:], turned.origin[:] = here, place
        _linearize(turned, q, aims, misses, attempt == 0, right, slopes)
        slopes *= scale
        if attempt == 0:
            value = np.dot(right, right)
        step = step_within_ball(slopes, right, x)
        ahead[:] = np.dot(slopes, step) + right
        size = np.abs(step).max()
        if (size < STILL / scale[0]
                or value - np.dot(ahead, ahead) < HARDLY * value and size < SMALL):
            status = max(status, _STAYS)
            break  # it is there
        new, state = _closer(turned, (begin, origin), scale, (x, step, last, value), q, aims,
                             misses, (there, target, ahead, wrench, numbers), work, tolerance,
                             max_iterations)
        if not new <= value:
            break
        size = np.abs(step).max()
        done = size < STILL / scale[0] or value - new < ENOUGH * value and size < 1e-3
        status, value = _MOVED, new
        x += step
        right[:], here[:], place[:], q[:] = ahead, there, target, state.q
        kept[0][:], kept[1][:], kept[2][:] = state.strains, state.rotations, state.positions
        kept[3][:], told_of[:] = wrench, numbers
        if done:
            break
    return status, here, place, (kept[0], kept[1], kept[2], kept[3], told_of[0], told_of[1],
                                 told_of[2], told_of[3], int(told_of[4]), 0)


@kernel
def _closer(turned: Problem, begin: tuple[Floats, Floats], scale: Floats,
            way: tuple[Floats, Floats, Floats, float], q: Floats, aims: Aims, misses: Misses,
            out: tuple[Floats, Floats, Floats, Floats, Floats], work: Workspace, tolerance: float,
            max_iterations: int) -> tuple[float, Configuration]:
    """Return the penalty after the first of `steps_to_try` that does not raise it, and that place.

    Parameters
    ----------
    begin : tuple
        Rotation (3, 3) and position (3,) of the gripper, from which all steps count.
    way : tuple
        Steps so far (6,); the next one (6,), and the one before with what was taken (2, 6), nan
        if there is none: both changed; and the penalty before.
    q : ndarray, shape (m, 3)
        Unknowns before.
    out : tuple
        Filled: rotation (3, 3) and position (3,) of the gripper, misses (m,), wrench (6,), and
        elastic and all energy, residual, stability, iterations (5,).
    """
    (x, step, last, value), (there, target, missed, wrench, numbers) = way, out
    options = thorough(tolerance, 0.0, max_iterations, tolerance > 0.0, tolerance < 0.0)
    new, state, taken = np.inf, work.state, extrapolated(step, last[0], last[1])
    last[0] = step
    for k in range(-1, HALVINGS):
        if k >= 0:
            taken[:] = 0.5**k * step
        elif not np.linalg.norm(x + taken) <= 1.0:
            continue
        twist = scale * (x + taken)
        turn_by(begin[0], twist[:3], there)
        there[:], target[:] = orthonormal(there), begin[1] + twist[3:]
        work.start[:] = q
        state, numbers[0], numbers[1], residual, stability, numbers[4], _, _ = solve_step(
            turned, there, target, options, work, wrench)
        numbers[2], numbers[3] = residual, stability
        _miss(turned, state, aims, misses, missed)
        hangs = residual < CONVERGED and stability > -NEUTRAL
        new = np.dot(missed, missed) if hangs else np.inf
        if new <= value:
            break
    last[1], step[:] = taken, taken
    return new, state


@kernel
def _linearize(system: Problem, q: Floats, aims: Aims, misses: Misses, first: bool, right: Floats,
               slopes: Floats) -> None:
    """Fill the slopes (m, 6) of Aims at an equilibrium q by the gripper's twist.

    What is missed (m,) there, too, where it is the `first`.
    """
    state, answers, _ = gripper_answers(system, q)
    nodes, where, places = misses
    if first:
        state.positions += system.origin
        _miss(system, state, aims, misses, right)
        state.positions -= system.origin
    at_nodes, twists = node_twists(system, state, answers, 3), np.empty((where.size, 6, 6))
    for k in range(where.size):
        e, fraction = inside(nodes, system.lengths, min(where[k], nodes[nodes.size - 1]))
        twists[k] = twists_inside(system, state, answers, 3, at_nodes[e], e, fraction)
    fill_slopes(aims, nodes[nodes.size - 1], where, places, twists, slopes)


@kernel
def _miss(system: Problem, state: Configuration, aims: Aims, misses: Misses, out: Floats) -> None:
    """Fill what a Configuration with positions in the world misses (m,)."""
    fill_misses(aims, misses[0], system.lengths, state.strains, state.rotations, state.positions,
                system.base, out, misses[1], misses[2])
