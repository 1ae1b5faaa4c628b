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

More goals than the gripper can have are missed least: the same steps are those of Gauss and Newton
(Nocedal and Wright, Numerical Optimization, ch. 10). The gripper then stays in a ball about where
it was, so that it cannot jump; if the minimum is farther away, it goes as far as the ball allows.
Where much is missed, these steps come nearer by the same part each: the next one follows from two
of them (Anderson 1965, J. ACM 12).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.continuation import largest_turn_between
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.equilibrium import UNWATCHED, hanging_shape
from dlo_planner.direct.search import TOLERANCE
from dlo_planner.direct.shape import Shape, check_movable
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.potential import evaluate, project, unknowns_of
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    is_to_end,
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
from dlo_planner.minimize.convergence import residual_of
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
from dlo_planner.minimize.newton import NEUTRAL, WELL_STABLE
from dlo_planner.minimize.response import node_twists, twists_inside
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
from dlo_planner.progress import uninterrupted

_LARGEST_TURN = 0.6  # rad per step, of the gripper and of any node
_LARGEST_SHIFT = 0.5  # of the length per step, of the gripper
_HALVINGS = 8
_LEAVES = 5.0        # 1/rad: of a misfit, what an old factorization leaves per rad turned since
_OLD = 1e-4          # rad, turned since: an older factorization says nothing of stability
_PER_TURN = 100.0    # change of an eigenvalue per rad, at most
_FREE = 1e-14        # of the squares of all rows: what no goal tells stays as it is
_EXACT = 1e-10       # rad, and of the length: what goals may miss
_POLISHED = 0.1      # of that: what misses more gets a step more: where it began shall not tell
_NEWTON_STEPS = 60
_STILL = 1e-5        # of its reach: the last step of a gripper that misses goals
_ENOUGH = 25         # steps of it at most
_BALANCED = 0.1      # of the residual: Newton's method converges from there
_AHEAD = 4.0         # how far ahead two steps may tell of the next, in steps
_ROUNDING = 1e-8     # of what is missed: more is more
_BISECTIONS = 60     # of a multiplier
MESHES = 6           # that an accuracy may take
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
                reach: Floats, tolerance: float, exact: float, max_iterations: int,
                worked: Floats) -> Any:
    """Find an equilibrium that has goals, or misses them least within reach (6,), rad and m.

    The gripper starts in the Problem's base, at origin (3,), which is moved; q (m, 3) are the
    unknowns, nodes (N + 1,) m. `exact`: what the goals may miss or, where they may be missed (a
    finite reach), the last step in parts of it. `worked` (1,): see `is_to_end`.

    Returned are state, positions from the gripper; base; arc lengths of the goals (g,), m;
    residual, stability (smallest eigenvalue of the Hessian), iterations, converged.
    """
    length, count, soft = nodes[nodes.size - 1], goals.kind.size, reach[0] < np.inf
    here = with_gripper(system, system.base.copy(), system.origin)
    there = with_gripper(system, system.base.copy(), system.origin)
    state, trial = new_configuration(here), new_configuration(here)
    hessian, m = new_hessian(here), q.shape[0]
    load, answers = np.empty((m, 3)), np.empty((4, m, 3))
    missed, new_missed = np.empty(3 * count), np.empty(3 * count)
    where, new_where = np.empty(count), np.empty(count)
    places, new_places = np.empty((count, 3, 3)), np.empty((count, 3, 3))
    twists, rows = np.zeros((count, 6, 7)), np.empty((3 * count, 7))
    shift, step6, scale = np.empty(3), np.empty(6), reach.copy()
    if not soft:  # a shift by the length counts as a turn of 1 rad
        scale[:3], scale[3:] = 1.0, length
    # of a gripper that misses goals: its way, its last step and what was made of it, in parts of
    # reach; what would be missed in equilibrium, and the longest step after which that is less
    gone, last, taken = np.zeros(6), np.full(6, np.nan), np.zeros(6)
    least, longest = np.inf, np.inf
    begin, begun = system.base.copy(), origin.copy()
    state.q[:] = q
    evaluate(here, state)
    if not soft:
        _go_to_first(goals, nodes, here, state, origin)
    _miss(here, state, goals, nodes, origin, missed, where, places)
    error = np.inf if soft else _size(missed)
    merit = residual_of(here, state) + (0.0 if soft else error)
    converged, polished = False, False
    iterations, negative, since = 0, 1, np.inf  # rad turned since factorized
    while True:
        if is_to_end(worked, here, 3):  # with a factorization for four answers
            return state, here.base, where, np.inf, -np.inf, iterations, False
        residual = residual_of(here, state)
        converged = residual < tolerance and error < exact
        done = converged and (polished or error < _POLISHED * exact)
        if done and negative == 0 and since < _OLD:
            break
        # near the end the factorization before is as good
        fresh = done or negative > 0 or not (
            converged or _LEAVES * since * (residual + error) < tolerance)
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
        if not _least_squares(rows, missed, scale, gone, soft, step6):
            break
        if soft:
            error = np.abs(step6 / scale).max()
            now = _size(missed + rows[:, 6])
            if now > least * (1.0 + _ROUNDING) + tolerance:
                longest = 0.5 * np.abs(taken).max()
            least = now
            _extrapolate(step6 / scale, gone, longest, last, taken)
            if iterations > _ENOUGH:  # it stays there, in equilibrium
                error, taken[:] = 0.0, 0.0
            step6[:] = scale * taken
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
            new_merit = residual_of(there, trial) + (0.0 if soft else _size(new_missed))
            if (new_merit < merit * (1 - 0.1 * portion) or new_merit < tolerance
                    or soft and new_merit < _BALANCED):
                accepted = True
                break
            portion *= 0.5
        if accepted:
            since += size
            merit = new_merit
            origin[:] = shift
            if soft:
                taken *= portion
                put_vector(rotation_vector(times_transposed(matrix(there.base), matrix(begin))),
                           gone)
                gone[3:] = origin - begun
                gone /= reach
            else:
                error = _size(new_missed)
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
            twists[g, i, 6] = twist[i, 3]


@kernel
def _least_squares(rows: Floats, missed: Floats, scale: Floats, gone: Floats, bounded: bool,
                   out: Floats) -> bool:
    """Fill out (6,): the gripper's motion after which least is missed (n,), to first order.

    Rows (n, 7) are of turns, shifts and the strains' step, which is made in any case; `scale` (6,)
    are units. If bounded, |gone + out / scale| <= 1, by a multiplier.
    """
    square, right = np.zeros((6, 6)), np.zeros(6)
    trace = 0.0
    for i in range(6):
        for k in range(missed.size):
            right[i] -= scale[i] * rows[k, i] * (missed[k] + rows[k, 6])
        for j in range(i + 1):
            for k in range(missed.size):
                square[i, j] += scale[i] * rows[k, i] * scale[j] * rows[k, j]
        trace += square[i, i]
    if not trace > 0.0:
        return False
    _solve_shifted(square, _FREE * trace, right, out)
    if bounded and _size(gone + out) > 1.0:
        low, high = _FREE * trace, trace
        for _ in range(_BISECTIONS):
            middle = np.sqrt(low * high)
            _solve_shifted(square, middle, right - middle * gone, out)
            if _size(gone + out) > 1.0:
                low = middle
                if high <= low * (1.0 + 1e-9):
                    high *= 10.0
            else:
                high = middle
    for i in range(6):
        out[i] *= scale[i]
    return True


@kernel
def _solve_shifted(square: Floats, shift: float, right: Floats, out: Floats) -> None:
    """Fill out (6,): (square + shift) out = right, by Cholesky, from the lower half of square."""
    lower = square.copy()
    for i in range(6):
        lower[i, i] += shift
        for j in range(i + 1):
            for k in range(j):
                lower[i, j] -= lower[i, k] * lower[j, k]
            if j < i:
                lower[i, j] /= lower[j, j]
        lower[i, i] = np.sqrt(max(lower[i, i], shift))
    for i in range(6):
        out[i] = right[i]
        for k in range(i):
            out[i] -= lower[i, k] * out[k]
        out[i] /= lower[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            out[i] -= lower[k, i] * out[k]
        out[i] /= lower[i, i]


@kernel
def _extrapolate(step: Floats, gone: Floats, longest: float, last: Floats, taken: Floats) -> None:
    """Fill what is `taken` (6,): where steps would vanish if they changed as from the `last` one.

    The step itself at first, and where that leads out of the ball; made as short as `longest`.
    """
    change = step - last
    square = np.dot(change, change)
    share = np.dot(change, step) / square if square > 0.0 else 0.0
    taken[:] = step - share * (taken + change)
    if not (abs(share) < _AHEAD and _size(gone + taken) <= 1.0):
        taken[:] = step
    taken *= min(1.0, longest / max(np.abs(taken).max(), 1e-300))
    last[:] = step


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
                 reach: Floats, most: Floats, least: float, watched: Ints, tolerance: float,
                 exact: float, max_iterations: int) -> Any:
    """Find equilibria that have goals at one set of arc lengths after another.

    A shape at which the gripper or the DLO might jump, or that is hardly stable, ends the search:
    who called it looks closer. One set of arc lengths, without limits, is the search for one shape.

    Shapes: ahead (k,), s (k, g), free (3,), most (3, k), watched (j,).
    """
    count, n = s.shape[0], strains.shape[1]
    all_strains, all_frames = np.empty((count, n, 3)), np.empty((count, n + 1, 3, 3))
    positions, wrenches = np.empty((count, n + 1, 3)), np.empty((count, 6))
    numbers, grippers, where = np.empty((5, count)), np.empty((count, 3, 3)), np.empty(s.shape)
    axes, origins, point = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty(3)
    base, before = bases[1].copy(), bases[0].copy()
    u, earlier, known = strains[1].copy(), strains[0].copy(), frames.copy()
    now, place, q, found = origin.copy(), origin.copy(), np.empty((unknown_count(system), 3)), 0
    worked = np.zeros(1)
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
            here, q, nodes, wanted, place, reach, tolerance, exact, max_iterations, worked)
        if not converged or not stability > least:
            break
        after = orthonormal(after)
        elastic, energy = outputs(here, state, here.origin, state.positions, wrenches[k])
        at = min(there[0], nodes[nodes.size - 1])
        e = element_at(nodes, at)
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     (at - nodes[e]) / system.lengths[e], axes[k], point)
        if goals.kind[0] != POSITION:  # the first goal is where the gripper's position counts from
            for i in range(3):
                place[i] = -point[i]
        turn = rotation_vector(times_transposed(matrix(after), matrix(base)))
        angle = np.sqrt(inner(turn, turn))
        if (angle > most[0, k] or _size(place - now) > most[1, k] or largest_turn_between(
                known, state.rotations, base, after, watched) > most[2, k] + angle):
            break
        all_strains[k], all_frames[k], positions[k] = (state.strains, state.rotations,
                                                       state.positions)
        grippers[k], origins[k], where[k] = after, place, there
        numbers[0, k], numbers[1, k], numbers[2, k], numbers[3, k], numbers[4, k] = (
            elastic, energy, residual, stability, iterations)
        before, base, now = base, after, place.copy()
        earlier, u, known = u, all_strains[k].copy(), all_frames[k].copy()
        found += 1
    return (found, (all_strains, all_frames, positions, wrenches, numbers), grippers, where, axes,
            origins)


@kernel
def _go_ahead(earlier_base: Floats, earlier: Floats, ahead: float, base: Floats,
              strains: Floats) -> None:
    """Go on with base (3, 3) and strains (N, 3) `ahead` times the change since earlier ones.

    The base as it was where it would turn far.
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


class Found(NamedTuple):
    """What `follow` finds."""

    shape: Shape
    where: Floats  # (g,) arc lengths of the goals, m; beyond L where the DLO ends before
    axes: Floats  # (3, 3) axes of the DLO at the first goal


def follow(mesh: Discretization, shape: Shape, goals: GoalTable, s: Floats, free: Floats, *,
           trend: tuple[Shape, float] | None = None, further: Sequence[float] = (),
           origin: Floats = ORIGIN, place: Floats = ORIGIN,
           reach: tuple[float, float] | None = None, most: Floats | None = None,
           least: float = -np.inf) -> list[Found]:
    """Return the shapes that have goals at sets of arc lengths s (k, g), until one is in doubt.

    reach: how far the gripper may go where they may be missed, rad and m; None: they may not, and
    the DLO has to be stable. origin (3,): of the gripper, from `place` (3,), m: where the first
    goal is that is no given one, or what given ones count from.
    """
    check_movable(mesh.surroundings)  # it is solved in a gripper at the origin
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
    least = least if reach is None else max(least, -NEUTRAL)
    turn, shift = (np.inf, np.inf) if reach is None else reach
    within = np.array((turn, turn, turn, shift, shift, shift))
    count, found, bases, where, axes, origins = uninterrupted(follow_goals(
        mesh.free, *pair, frames, np.array(origin), np.array([ahead, *further], dtype=float),
        mesh.s, goals, np.array(s), np.array(free), within, limits, float(least), watched,
        TOLERANCE, _EXACT if reach is None else _STILL, _NEWTON_STEPS))
    strains, rotations, positions, wrenches, numbers = found
    freeze((*found, bases))  # shapes have parts of them
    out = []
    for k in range(count):
        elastic, energy, residual, stability, iterations = numbers[:, k].tolist()
        at = place + origins[k]
        out.append(Found(hanging_shape(
            mesh, pose_of(at, bases[k]), strains[k], rotations[k], at + positions[k], wrenches[k],
            elastic, energy + float(at @ wrenches[k, :3]), residual, stability, int(iterations)),
            where[k], axes[k]))
    return out


def goal_shape(simulator: DirectSimulator, guess: Shape, goals: GoalTable, s: ArrayLike,
               free: Floats = ORIGIN, trend: tuple[Shape, float] | None = None,
               origin: Floats = ORIGIN, place: Floats = ORIGIN,
               reach: tuple[float, float] | None = None) -> Found | None:
    """Return what `follow` finds at `s`, on a mesh as fine as the simulator's, or None."""
    mesh, shape = guess.state.made_on, guess
    where = np.full((1, goals.kind.size), s, dtype=float)
    for _ in range(MESHES):
        found = follow(mesh, shape, goals, where, free, trend=trend, origin=origin, place=place,
                       reach=reach)
        if not found or simulator.accuracy is None:  # its mesh is the same everywhere
            break
        shape = found[0].shape
        origin = shape.gripper.position - place
        better = simulator.discretization(shape.gripper, shape)
        if better is mesh:
            break
        mesh, trend = better, None
    return found[0] if found else None
