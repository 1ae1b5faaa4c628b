# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shape that misses weighted goals least within reach of the gripper: a step that cannot leap.

For more goals than the gripper can have. Gauss and Newton's method on their residuals, an
equilibrium a step, the gripper kept in a ball about where it was (a fixed trust region: Nocedal and
Wright, Numerical Optimization, ch. 4). If the minimum is farther away, the step goes towards it as
far as the ball allows. Where much is missed, these steps come nearer by the same part each: the
next ones follow from two of them (Anderson 1965, J. ACM 12).
"""

from typing import Any

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.search import MAX_ITERATIONS, TOLERANCE
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import hanging_shape
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, with_gripper
from dlo_planner.inverse.waypoint_newton import orthonormal, turn_by
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import CONVERGED
from dlo_planner.minimize.newton import NEUTRAL, Workspace, minimize, new_workspace, thorough
from dlo_planner.minimize.response import gripper_answers, node_twists, twists_inside
from dlo_planner.minimize.solve import outputs
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import pose_of
from dlo_planner.model.value import freeze
from dlo_planner.plan.goal_rows import ROLL, GoalTable, element_at, fill_residuals, fill_rows

_ITERATIONS = 25
_STILL = 1e-9     # rad, and of the length: a step that ends the search
_ENOUGH = 1e-6    # relative decrease of the penalty that ends it as well
_HARDLY, _SMALL = 1e-8, 1e-4  # the same, and a part of what is within reach: not worth a step
_HALVINGS = 6
_MESHES = 6       # that an accuracy may take
_NONE, _STAYS, _MOVED = 0, 1, 2


def nearest_goals(simulator: DirectSimulator, goals: GoalTable, shape: Shape, turn: float,
                  shift: float) -> Shape | None:
    """Return the Shape that misses goals least whose gripper is within reach, or None."""
    for _ in range(_MESHES):
        mesh = shape.state.mesh
        assert mesh is not None  # only a shape that was loaded has none
        nearest = nearest_on(mesh, goals, shape, turn, shift)
        if nearest is None or simulator.accuracy is None:  # its mesh is the same everywhere
            return nearest
        shape = nearest
        if simulator.discretization(shape.gripper, shape) is mesh:
            break
        shape = simulator.solve(shape.gripper, shape)
        if not shape.converged:
            return None
    return shape


def nearest_on(mesh: Discretization, goals: GoalTable, shape: Shape, turn: float,
               shift: float) -> Shape | None:
    """Return what `nearest_goals` returns, on the mesh of the shape."""
    gripper, strains = shape.gripper, mesh.strains_from(shape.s, shape.element_strains)
    freeze(strains)
    status, base, origin, found = _nearest_goals(
        mesh.free, gripper.rotation, gripper.position, strains, mesh.s, goals,
        np.array([turn] * 3 + [shift] * 3), TOLERANCE, MAX_ITERATIONS)
    if status == _MOVED:
        return hanging_shape(mesh, pose_of(origin, base), *found[:-1])
    return shape if status == _STAYS else None


@kernel
def _nearest_goals(system: Problem, base: Floats, origin: Floats, strains: Floats, nodes: Floats,
                   goals: GoalTable, scale: Floats, tolerance: float,
                   max_iterations: int) -> tuple[int, Floats, Floats, tuple[Any, ...]]:
    """Do what `nearest_goals` does; `nodes` (N + 1,), m, and `scale` (6,), rad and m: its reach."""
    rows, misses = 3 * goals.kind.size, (nodes, np.empty(goals.kind.size),
                                            np.empty((goals.kind.size, 3, 3)))
    here, there, begin = base.copy(), np.empty((3, 3)), base.copy()
    place, target = origin.copy(), np.empty(3)
    work, turned = new_workspace(system), with_gripper(system, base.copy(), origin.copy())
    kept = (strains.copy(), np.empty((nodes.size, 3, 3)), np.empty((nodes.size, 3)), np.empty(6))
    wrench, numbers, told_of = np.empty(6), np.empty(5), np.zeros(5)
    q, x = np.empty_like(work.start), np.zeros(6)
    unknowns_of(turned, kept[0], q)
    right, ahead, slopes = np.empty(rows), np.empty(rows), np.empty((rows, 6))
    status, value, last = _NONE, np.inf, np.full((2, 6), np.nan)
    for attempt in range(_ITERATIONS):
        turned.base[:], turned.origin[:] = here, place
        _linearize(turned, q, goals, misses, attempt == 0, right, slopes)
        slopes *= scale
        if attempt == 0:
            value = np.dot(right, right)
        step = _step_within_ball(slopes, right, x)
        ahead[:] = np.dot(slopes, step) + right
        size = np.abs(step).max()
        if (size < _STILL / scale[0]
                or value - np.dot(ahead, ahead) < _HARDLY * value and size < _SMALL):
            status = max(status, _STAYS)
            break  # it is there
        new, state = _closer(turned, (begin, origin), scale, (x, step, last, value), q, goals,
                             misses, (there, target, ahead, wrench, numbers), work, tolerance,
                             max_iterations)
        if not new <= value:
            break
        size = np.abs(step).max()
        done = size < _STILL / scale[0] or value - new < _ENOUGH * value and size < 1e-3
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
            way: tuple[Floats, Floats, Floats, float], q: Floats, goals: GoalTable, misses: Any,
            out: tuple[Floats, Floats, Floats, Floats, Floats], work: Workspace, tolerance: float,
            max_iterations: int) -> tuple[float, Configuration]:
    """Return the penalty after the first of some steps that does not raise it, and that place.

    Shapes: q (m, 3).
    """
    (x, step, last, value), (there, target, missed, wrench, numbers) = way, out
    options = thorough(tolerance, 0.0, max_iterations, tolerance > 0.0, tolerance < 0.0)
    new, state, taken = np.inf, work.state, _extrapolated(step, last[0], last[1])
    last[0] = step
    for k in range(-1, _HALVINGS):
        if k >= 0:
            taken[:] = 0.5**k * step
        elif not np.linalg.norm(x + taken) <= 1.0:
            continue
        twist = scale * (x + taken)
        turn_by(begin[0], twist[:3], there)
        there[:], target[:] = orthonormal(there), begin[1] + twist[3:]
        work.start[:] = q
        turned.base[:], turned.origin[:] = there, target
        state, residual, stability, numbers[4], _, _ = minimize(turned, work.start, options, work)
        numbers[0], numbers[1] = outputs(turned, state, target, state.positions, wrench)
        numbers[2], numbers[3] = residual, stability
        _miss(turned, state, goals, misses, missed)
        hangs = residual < CONVERGED and stability > -NEUTRAL
        new = np.dot(missed, missed) if hangs else np.inf
        if new <= value:
            break
    last[1], step[:] = taken, taken
    return new, state


@kernel
def _linearize(system: Problem, q: Floats, goals: GoalTable, misses: Any, first: bool,
               right: Floats, slopes: Floats) -> None:
    """Fill the slopes (m, 6) of goals at an equilibrium q by the gripper's twist.

    What is missed (m,) there, too, where it is the `first`.
    """
    state, answers, _ = gripper_answers(system, q)
    nodes, where, places = misses
    if first:
        state.positions += system.origin
        _miss(system, state, goals, misses, right)
        state.positions -= system.origin
    at_nodes, twists = node_twists(system, state, answers, 3), np.zeros((where.size, 6, 6))
    for g in range(where.size):
        if goals.kind[g] != ROLL and goals.weight[g] > 0.0:
            s = min(where[g], nodes[nodes.size - 1])
            e = element_at(nodes, s)
            twists[g] = twists_inside(system, state, answers, 3, at_nodes[e], e,
                                      (s - nodes[e]) / system.lengths[e])
    fill_rows(goals, nodes[nodes.size - 1], system.base, where, places, twists, slopes)
    for g in range(where.size):
        if goals.kind[g] == ROLL:  # about the axis alone: what turns across it rolls nothing
            for j in range(3):
                slopes[3 * g, j] = goals.weight[g] * goals.target[g, j]


@kernel
def _miss(system: Problem, state: Configuration, goals: GoalTable, misses: Any,
          out: Floats) -> None:
    """Fill what a Configuration with positions in the world misses (m,)."""
    fill_residuals(goals, misses[0], system.lengths, state.strains, state.rotations,
                   state.positions, np.zeros(3), system.base, out, misses[1], misses[2])


@kernel
def _extrapolated(step: Floats, before: Floats, taken: Floats) -> Floats:
    """Return the step (6,) to where steps would vanish if they changed as from the one before.

    Shapes: step, before (6,), taken (6,).
    """
    change = step - before
    size = np.dot(change, change)
    share = np.dot(change, step) / size if size > 0.0 else 0.0
    return step - share * (taken + change)


@kernel
def _step_within_ball(rows: Floats, right: Floats, x: Floats) -> Any:
    """Return the step (6,) that minimizes |rows step + right| with |x + step| <= 1.

    The multiplier of the constraint is found by bisection, along the axes of the quadratic form.
    """
    square = np.dot(rows.T, rows)
    large = max(np.trace(square), 1e-300)
    sizes, axes = np.linalg.eigh(square + 1e-12 * large * np.eye(6))
    slope, where = np.dot(axes.T, np.dot(rows.T, right)), np.dot(axes.T, x)
    if _reach(sizes, slope, where, 0.0) <= 1.0:
        return np.dot(axes, -slope / sizes)
    low, high = 0.0, large
    while _reach(sizes, slope, where, high) > 1.0:
        high *= 10.0
    for _ in range(60):
        middle = 0.5 * (low + high) if low > 0.0 else 0.01 * high
        if _reach(sizes, slope, where, middle) > 1.0:
            low = middle
        else:
            high = middle
    return np.dot(axes, (-slope - high * where) / (sizes + high))


@kernel
def _reach(sizes: Floats, slope: Floats, where: Floats, multiplier: float) -> Any:
    """Return how far from the middle of the ball a step with this multiplier ends."""
    total = 0.0
    for i in range(sizes.size):
        total += ((sizes[i] * where[i] - slope[i]) / (sizes[i] + multiplier)) ** 2
    return np.sqrt(total)
