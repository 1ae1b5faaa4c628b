# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The waypoint solver: equilibrium and goals in one Newton system, of a DLO that hangs freely.

Unknowns: the strains q, a turn and a shift of the gripper. Equations: the gradient of the potential
vanishes, and so do the residuals of the goals (`plan.goal_rows`); with as many independent ones as
unknowns that is Newton's method, what they leave free stays as it is. The Hessian is the direct
simulator's, so an inverse solve costs about as much as a direct one (paper, section 5.2).

One waypoint may leave the gripper a roll, for a straight round DLO may roll about the gripper's
axis, a bent weightless one about the direction in which it passes. It stays as it was since a
reference, about the mean of both axes.

More goals than the gripper can have are missed least (`nearest_goals`), by Gauss and Newton's
method on their residuals, an equilibrium a step. The gripper is kept in a ball about where it was,
so that it cannot leap (a fixed trust region: Nocedal and Wright, Numerical Optimization, ch. 4). If
the minimum is farther away, the step goes towards it as far as the ball allows. Where much is
missed, these steps come nearer by the same part each: the next ones follow from two of them
(Anderson 1965, J. ACM 12).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.search import MAX_ITERATIONS, TOLERANCE
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import UNWATCHED, hanging_shape
from dlo_planner.energy.potential import evaluate, project, unknowns_of
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    new_configuration,
    unknown_count,
    with_gripper,
)
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import copy, put_sum, scaled_by
from dlo_planner.geometry.so3 import (
    inner,
    matrix,
    put_matrix,
    put_vector,
    rotation_and_chord,
    rotation_vector,
    times,
    times_transposed,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import CONVERGED, residual_of
from dlo_planner.minimize.hessian import (
    Hessian,
    assemble,
    assembled_definite,
    factorize,
    inertia_correction,
    is_fused,
    largest_turn,
    new_hessian,
    solve,
)
from dlo_planner.minimize.kkt import add_to
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import (
    NEUTRAL,
    WELL_STABLE,
    Workspace,
    largest_turn_between,
    minimize,
    new_workspace,
    thorough,
)
from dlo_planner.minimize.response import gripper_answers, node_twists, twists_inside
from dlo_planner.minimize.riccati import answer_to_turn
from dlo_planner.minimize.solve import outputs
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import pose_of
from dlo_planner.model.value import freeze
from dlo_planner.plan.goal_rows import (
    POSITION,
    ROLL,
    GoalTable,
    element_at,
    fill_residuals,
    fill_rows,
    goals_at,
)

_LARGEST_TURN = 0.6  # rad per step, of the gripper and of any node
_LARGEST_SHIFT = 0.5  # of the length per step, of the gripper
_HALVINGS = 8
_LEAVES = 5.0        # 1/rad: of a misfit, what an old factorization leaves per rad turned since
_OLD = 1e-4          # rad, turned since: an older factorization tells nothing of stability
_PER_TURN = 100.0    # change of an eigenvalue per rad, at most
_FREE = 1e-14        # of the squares of all rows: what no goal tells stays as it is
_EXACT = 1e-10       # rad, and of the length: what goals may miss
_POLISHED = 0.1      # of that: what misses more gets a step more: where it began shall not tell
_NEWTON_STEPS = 60
_BALL_ITERATIONS, _BALL_HALVINGS = 25, 6  # of the search in a ball
_STILL = 1e-9     # rad, and of the length: a step that ends it
_ENOUGH = 1e-6    # relative decrease of the penalty that ends it as well
_HARDLY, _SMALL = 1e-8, 1e-4  # the same, and a part of what is within reach: not worth a step
_NONE, _STAYS, _MOVED = 0, 1, 2
MESHES = 6        # that an accuracy may take
ORIGIN = np.zeros(3)
freeze(ORIGIN)


@kernel
def free_axis(reference: Floats, direction: Floats) -> Floats:
    """Return the axis (3,) about which the gripper shall not turn: its own and a direction's mean.

    Both bodies' free rotations have a part about it, so the condition is regular unless the
    gripper points against the direction; then it is the gripper's own axis.
    """
    axis = np.empty(3)
    for i in range(3):
        axis[i] = reference[i, 0] + direction[i]
    size = np.sqrt(inner(axis, axis))
    for i in range(3):
        axis[i] = axis[i] / size if size > 0.1 else reference[i, 0]
    return axis


@kernel
def solve_goals(system: Problem, q: Floats, nodes: Floats, goals: GoalTable, origin: Floats,
                tolerance: float, exact: float, max_iterations: int) -> Any:
    """Find an equilibrium that has goals.

    Args:
        system: Problem without obstacles, far end, plasticity; the gripper starts in its `base`
        q: (m, 3) scaled unknowns to start from
        nodes: (N + 1,) arc lengths, m, read-only
        goals: g of them, all of weights of 1/rad and 1 / length, or 0
        origin: (3,) position of the gripper; moved, m
        tolerance, exact: of the residual, and of what the goals miss
        max_iterations: Newton steps at most

    Returns:
        state, positions from the gripper; base (3, 3); arc lengths of the goals (g,), m; residual,
        stability (smallest eigenvalue of the Hessian), iterations, converged
    """
    length, count = nodes[nodes.size - 1], goals.kind.size
    here = with_gripper(system, system.base.copy(), system.origin)
    there = with_gripper(system, system.base.copy(), system.origin)
    state, trial = new_configuration(here), new_configuration(here)
    hessian, m = new_hessian(here), q.shape[0]
    load, answers = np.empty((m, 3)), np.empty((4, m, 3))
    missed, new_missed = np.empty(3 * count), np.empty(3 * count)
    where, new_where = np.empty(count), np.empty(count)
    places, new_places = np.empty((count, 3, 3)), np.empty((count, 3, 3))
    twists, rows = np.zeros((count, 6, 7)), np.empty((3 * count, 7))
    shift, step6 = np.empty(3), np.empty(6)
    state.q[:] = q
    evaluate(here, state)
    _go_to_first(goals, nodes, here, state, origin)
    _miss(here, state, goals, nodes, origin, missed, where, places)
    merit = residual_of(here, state) + _size(missed)
    converged, polished = False, False
    iterations, negative, since = 0, 1, np.inf  # rad turned since factorized
    while True:
        residual = residual_of(here, state)
        converged = residual < tolerance and _size(missed) < exact
        done = converged and (polished or _size(missed) < _POLISHED * exact)
        if done and negative == 0 and since < _OLD:
            break
        # near the end the factorization before is as good
        fresh = done or negative > 0 or not (converged or _LEAVES * since * merit < tolerance)
        polished = converged
        if fresh:
            negative, since = 0, 0.0
            if not assembled_definite(here, state, hessian, 0.0):
                negative = factorize(here, hessian, 0.0)
        if done or iterations >= max_iterations:
            break
        iterations += 1
        _answers(here, state, hessian, fresh, load, answers)
        _fill_twists(here, state, answers, nodes, goals, where, twists)
        fill_rows(goals, length, here.base, where, places, twists, rows)
        if not _least_squares(rows, missed, length, step6):
            break
        step = answers[3]
        for column in range(3):
            add_to(step, step6[column], answers[column])
        turned = np.sqrt(inner(step6[:3], step6[:3]))
        shifted = np.sqrt(inner(step6[3:], step6[3:]))
        size = max(turned, largest_turn(here, hessian, step))
        if not np.isfinite(size + shifted):
            break
        portion = min(1.0, _LARGEST_TURN / max(size, 1e-300),
                      _LARGEST_SHIFT * length / max(shifted, 1e-300))
        accepted = False
        for _ in range(_HALVINGS):
            turn_by(here.base, portion * step6[:3], there.base)
            put_sum(state.q, portion, step, trial.q)
            for i in range(3):
                shift[i] = origin[i] + portion * step6[3 + i]
            evaluate(there, trial)
            _miss(there, trial, goals, nodes, shift, new_missed, new_where, new_places)
            new_merit = residual_of(there, trial) + _size(new_missed)
            if new_merit < merit * (1 - 0.1 * portion) or new_merit < tolerance:
                accepted = True
                break
            portion *= 0.5
        if accepted:
            since += size
            merit = new_merit
            origin[:] = shift
            missed, new_missed = new_missed, missed
            where, new_where = new_where, where
            places, new_places = new_places, places
            state, trial = trial, state
            here, there = there, here
        elif fresh:
            break
        else:  # the Hessian has changed by too much
            since = np.inf
    stability = _stability_near(here, state, hessian, negative, since)
    return state, here.base, where, residual, stability, iterations, converged


@kernel
def _miss(system: Problem, state: Configuration, goals: GoalTable, nodes: Floats, origin: Floats,
          missed: Floats, where: Floats, places: Floats) -> None:
    fill_residuals(goals, nodes, system.lengths, state.strains, state.rotations, state.positions,
                   origin, system.base, missed, where, places)


@kernel
def _size(missed: Floats) -> float:
    total = 0.0
    for i in range(missed.size):
        total += missed[i] * missed[i]
    size: float = np.sqrt(total)
    return size


@kernel
def _go_to_first(goals: GoalTable, nodes: Floats, system: Problem, state: Configuration,
                 origin: Floats) -> None:
    """Move the gripper so that a first goal is kept that is a place."""
    if goals.kind[0] != POSITION or not goals.weight[0] > 0.0:
        return
    frame, point = np.empty((3, 3)), np.empty(3)
    e = element_at(nodes, min(goals.s[0], nodes[nodes.size - 1]))
    point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                 (goals.s[0] - nodes[e]) / system.lengths[e], frame, point)
    for i in range(3):
        origin[i] = goals.target[0, i] - point[i]


@kernel
def _answers(system: Problem, state: Configuration, hessian: Hessian, fresh: bool, load: Floats,
             answers: Floats) -> None:
    """Fill answers (4, m, 3): changes of the equilibrium per gripper rotation about x, y, z.

    Those are known where the Hessian is not `fresh`. The fourth is Newton's step in a gripper that
    rests. `load` (m, 3) is for use here.
    """
    copy(state.gradient, load)
    scaled_by(-1.0, load)
    solve(system, hessian, load, answers[3])
    for column in range(3 if fresh else 0):
        if is_fused(system):
            answer_to_turn(hessian, column, answers[column])
        else:
            project(system.basis, -hessian.cross[:, :, column], load)
            solve(system, hessian, load, answers[column])


@kernel
def _fill_twists(system: Problem, state: Configuration, answers: Floats, nodes: Floats,
                 goals: GoalTable, where: Floats, twists: Floats) -> None:
    """Fill twists (g, 6, 7) at the goals: by turns and shifts of the gripper, and Newton's step."""
    at_nodes = node_twists(system, state, answers, 4)
    for g in range(where.size):
        if goals.kind[g] == ROLL:
            continue
        s = min(where[g], nodes[nodes.size - 1])
        e = element_at(nodes, s)
        twist = twists_inside(system, state, answers, 4, at_nodes[e], e,
                              (s - nodes[e]) / system.lengths[e])
        for i in range(6):
            for j in range(3):
                twists[g, i, j] = twist[i, j]
                twists[g, i, 3 + j] = 1.0 if i == 3 + j else 0.0
            twists[g, i, 6] = twist[i, 3] - (1.0 if i == 3 else 0.0)  # it began as a shift


@kernel
def _least_squares(rows: Floats, missed: Floats, length: float, out: Floats) -> bool:
    """Fill out (6,): the motion of the gripper after which least is missed, to first order.

    Args:
        rows: (n, 7), of turns, shifts and the step of the strains, which is made in any case
        missed: (n,)
        length: a shift by it counts as a turn of 1 rad, m
    """
    square, scale = np.zeros((6, 6)), np.ones(6)
    scale[3:] = length
    trace = 0.0
    for i in range(6):
        out[i] = 0.0
        for k in range(missed.size):
            out[i] -= scale[i] * rows[k, i] * (missed[k] + rows[k, 6])
        for j in range(i + 1):
            for k in range(missed.size):
                square[i, j] += scale[i] * rows[k, i] * scale[j] * rows[k, j]
        trace += square[i, i]
    if not trace > 0.0:
        return False
    for i in range(6):  # Cholesky
        square[i, i] += _FREE * trace
        for j in range(i + 1):
            for k in range(j):
                square[i, j] -= square[i, k] * square[j, k]
            if j < i:
                square[i, j] /= square[j, j]
        square[i, i] = np.sqrt(max(square[i, i], _FREE * trace))
    for i in range(6):
        for k in range(i):
            out[i] -= square[i, k] * out[k]
        out[i] /= square[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            out[i] -= square[k, i] * out[k]
        out[i] /= square[i, i]
    for i in range(6):
        out[i] *= scale[i]
    return True


@kernel
def _stability_near(system: Problem, state: Configuration, hessian: Hessian, negative: int,
                    since: float) -> Any:
    """Return the smallest eigenvalue of the Hessian, factorized with `negative` eigenvalues.

    Where the DLO has turned `since`, in rad, that is of the shape before, which tells a stable one.
    """
    stability = -np.inf
    if since > 0.0:
        stability, _ = lowest_mode(system, hessian, 0.0, 1e-4)
    if not stability > WELL_STABLE + _PER_TURN * since:
        if since > 0.0:
            assemble(system, state, hessian)
            negative = factorize(system, hessian, 0.0)
        shift = inertia_correction(system, hessian, 1e-3) if negative > 0 else 0.0
        stability, _ = lowest_mode(system, hessian, shift, 1e-4)
    return stability


@kernel
def follow_goals(system: Problem, bases: Floats, strains: Floats, frames: Floats, origin: Floats,
                 ahead: Floats, nodes: Floats, goals: GoalTable, s: Floats, free: Floats,
                 most: Floats, least: float, watched: Ints, tolerance: float, exact: float,
                 max_iterations: int) -> Any:
    """Find equilibria that have goals at one set of arc lengths after another.

    A shape at which the gripper or the DLO might leap, or that is hardly stable, ends the search:
    who called it looks closer. One set of arc lengths, without limits, is the search for one shape.

    Shapes: ahead (k,), s (k, g), free (3,), most (3, k), watched (j,).
    """
    count, n = s.shape[0], strains.shape[1]
    all_strains, all_frames = np.empty((count, n, 3)), np.empty((count, n + 1, 3, 3))
    positions, wrenches = np.empty((count, n + 1, 3)), np.empty((count, 6))
    numbers, grippers, where = np.empty((5, count)), np.empty((count, 3, 3)), np.empty(s.shape)
    axes, places = np.empty((count, 3, 3)), np.empty((count, 3))
    base, before = bases[1].copy(), bases[0].copy()
    u, earlier, known = strains[1].copy(), strains[0].copy(), frames.copy()
    now, place, q, found = origin.copy(), origin.copy(), np.empty((unknown_count(system), 3)), 0
    for k in range(count):
        wanted = goals_at(goals, s[k].copy())
        for g in range(wanted.kind.size if k else 0):
            if wanted.kind[g] == ROLL:
                wanted.target[g] = free_axis(base, free)
                wanted.frame[g] = base
        here, begin = with_gripper(system, base.copy(), system.origin), u.copy()
        _go_ahead(before, earlier, ahead[k], here.base, begin)
        unknowns_of(here, begin, q)
        state, after, there, residual, stability, iterations, converged = solve_goals(
            here, q, nodes, wanted, place, tolerance, exact, max_iterations)
        if not converged or not stability > least:
            break
        after = orthonormal(after)
        elastic, energy = outputs(here, state, here.origin, state.positions, wrenches[k])
        at = min(there[0], nodes[nodes.size - 1])
        e = element_at(nodes, at)
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     (at - nodes[e]) / system.lengths[e], axes[k], places[k])
        if goals.kind[0] != POSITION:  # the first goal is where the gripper's position counts from
            for i in range(3):
                place[i] = -places[k, i]
        angle = _angle(base, after)
        if (angle > most[0, k] or _distance(now, place) > most[1, k] or largest_turn_between(
                known, state.rotations, base, after, watched) > most[2, k] + angle):
            break
        all_strains[k], all_frames[k], positions[k] = (state.strains, state.rotations,
                                                       state.positions)
        grippers[k], where[k] = after, there
        numbers[0, k], numbers[1, k], numbers[2, k], numbers[3, k], numbers[4, k] = (
            elastic, energy, residual, stability, iterations)
        before, base, now = base, after, place.copy()
        earlier, u, known = u, all_strains[k].copy(), all_frames[k].copy()
        found += 1
    return (found, (all_strains, all_frames, positions, wrenches, numbers), grippers, where, axes,
            places)


@kernel
def _go_ahead(earlier_base: Floats, earlier: Floats, ahead: float, base: Floats,
              strains: Floats) -> None:
    """Go on with base (3, 3) and strains (N, 3), 1/m, as they have changed since earlier ones.

    Args:
        earlier_base, earlier: (3, 3), (N, 3)
        ahead: how many times that change; as it was where the base would turn far
    """
    if ahead <= 0.0:
        return
    turn = np.empty(3)
    put_vector(rotation_vector(times_transposed(matrix(base), matrix(earlier_base))), turn)
    turn *= ahead
    if not np.sqrt(inner(turn, turn)) < _LARGEST_TURN:
        return
    turn_by(base.copy(), turn, base)
    for e in range(strains.shape[0]):
        for i in range(3):
            strains[e, i] += ahead * (strains[e, i] - earlier[e, i])


@kernel
def turn_by(base: Floats, turn: Floats, out: Floats) -> None:
    """Fill out (3, 3) = exp(turn^) base."""
    rotation, _ = rotation_and_chord(turn[0], turn[1], turn[2], 1.0)
    put_matrix(times(rotation, matrix(base)), out)


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


@kernel
def _angle(base: Floats, after: Floats) -> float:
    """Return the angle in rad between two rotations (3, 3)."""
    turn = np.empty(3)
    put_vector(rotation_vector(times_transposed(matrix(after), matrix(base))), turn)
    angle: float = np.sqrt(inner(turn, turn))
    return angle


@kernel
def _distance(one: Floats, other: Floats) -> float:
    total = 0.0
    for i in range(3):
        total += (one[i] - other[i]) ** 2
    distance: float = np.sqrt(total)
    return distance


class Found(NamedTuple):
    """What `follow` finds."""

    shape: Shape  # in a gripper at the origin
    where: Floats  # (g,) arc lengths of the goals, m; beyond L where the DLO ends before
    axes: Floats  # (3, 3) and (3,) axes and position of the DLO at the first goal, m
    place: Floats


def follow(mesh: Discretization, shape: Shape, goals: GoalTable, s: Floats, free: Floats, *,
           trend: tuple[Shape, float] | None = None, further: Sequence[float] = (),
           origin: Floats = ORIGIN, most: Floats | None = None, least: float = -np.inf
           ) -> list[Found]:
    """Return the shapes that have goals at some sets of arc lengths, until one is in doubt.

    Shapes: s (k, g), origin (3,).
    """
    begin = mesh.strains_from(shape.s, shape.element_strains)
    earlier, ahead = trend or (shape, 0.0)
    if trend is None or not mesh.has_nodes(earlier.s):
        earlier, ahead = shape, 0.0
    before = begin if earlier is shape else earlier.element_strains
    # of one type for the kernel, whether they may be written or not
    frames = np.array(shape.frames) if mesh.has_nodes(shape.s) else np.zeros((mesh.s.size, 3, 3))
    watched = np.array(UNWATCHED.nodes if most is None else mesh.sampled)
    pair = np.array([earlier.gripper.rotation, shape.gripper.rotation]), np.array([before, begin])
    freeze(pair)
    limits = np.full((3, len(s)), np.inf) if most is None else most
    count, found, bases, where, axes, places = follow_goals(
        mesh.free, *pair, frames, np.array(origin), np.array([ahead, *further], dtype=float),
        mesh.s, goals, np.array(s), np.array(free), limits, float(least), watched, TOLERANCE,
        _EXACT, _NEWTON_STEPS)
    strains, rotations, positions, wrenches, numbers = found
    out = []
    for k in range(count):
        elastic, energy, residual, stability, iterations = numbers[:, k].tolist()
        out.append(Found(hanging_shape(
            mesh, pose_of(ORIGIN, bases[k]), strains[k], rotations[k], positions[k], wrenches[k],
            elastic, energy, residual, stability, int(iterations)), where[k], axes[k], places[k]))
    return out


def nearest_goals(simulator: DirectSimulator, goals: GoalTable, shape: Shape, turn: float,
                  shift: float) -> Shape | None:
    """Return the Shape that misses goals least whose gripper is within reach, or None."""
    for _ in range(MESHES):
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
    for attempt in range(_BALL_ITERATIONS):
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
    for k in range(-1, _BALL_HALVINGS):
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
        _miss(turned, state, goals, misses[0], np.zeros(3), missed, misses[1], misses[2])
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
        _miss(system, state, goals, nodes, np.zeros(3), right, where, places)
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
