# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Newton's method that can only end in a minimum, or say that it did not: one loop for all DLOs.

Hanging freely, held in other places, on obstacles, in motion: `newton_descent` is what seeks the
shape. What differs is said by Options, or follows from what acts; what is absent is None and is
compiled away.

The guards around the plain method (Nocedal and Wright, Numerical Optimization, ch. 3):
* a shift of the Hessian until all its pivots are positive; where inertia draws a DLO from afar,
  Gauss and Newton's Hessian before (ch. 10): places of a start that the DLO cannot take give forces
  along it that are many times larger than the true ones, and a shift that outweighs them hinders
  all other motions;
* a cap on how far any node may turn in one step (without it a heavily loaded wire winds extra turns
  into itself);
* a decrease of the potential in every step.
Where the gradient vanishes but a pivot is negative, the shape is a saddle: it is left along its
lowest mode, and the descent goes on. Where a symmetric DLO may fall to either side, rounding errors
would choose one as they grow from step to step. So its symmetry is broken, by little but far more
than those, to the side that `lanczos.reference_mode` states, from where the descent is first found
to be unstable.

With other grips each step solves the equilibrium and the linearized grips together (sequential
quadratic programming, ch. 18). It is judged by the augmented Lagrangian with the new reaction, of
which it is a descent direction where the Hessian is positive on what the grip leaves free. Then:
* far from its target the grip gives a little under the reaction (stabilized SQP, Wright 1998): so a
  straight DLO, whose end cannot come nearer to first order, is pressed until it buckles;
* no step leaves the grip by much;
* a DLO that falls is brought back into its grip before it falls on: a fall follows the potential of
  the held DLO, not a way through shapes that the grip forbids.

What is known to be near is sought without these guards: each step has to leave much less of the
residual (Kelley, Iterative Methods for Linear and Nonlinear Equations, ch. 5: the chord method,
which keeps its factorization), and what is not quite so simple is given up.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dlo_planner.energy.grip import (
    constraint_value,
    constraint_violation,
    move_multipliers,
    shortest_span,
)
from dlo_planner.energy.inertia import has_inertia, inertial_stiffness
from dlo_planner.energy.plastic import yields
from dlo_planner.energy.potential import evaluate, unknowns_of, value_at
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    bending_energy,
    hinged,
    is_to_end,
    new_configuration,
)
from dlo_planner.energy.strands import may_forbid as strands_may_forbid
from dlo_planner.energy.strands import pushes_out
from dlo_planner.energy.terms import forbids, may_forbid, row_count
from dlo_planner.geometry.kinematics import carried_frames, trace_of_product
from dlo_planner.geometry.record import Record, copy, put_sum, replaced, scaled_by
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import (
    BLURRED,
    Minimum,
    gradient_noise,
    relative,
    residual_of,
)
from dlo_planner.minimize.hessian import (
    LEAST_SHIFT,
    Hessian,
    assemble,
    assembled_definite,
    has_safe_pivots,
    inertia_correction,
    is_definite,
    is_fused,
    largest_turn,
    new_hessian,
    solve,
    solve_held,
)
from dlo_planner.minimize.kkt import dot, put_scaled, set_give
from dlo_planner.minimize.lanczos import lowest_mode, reference_mode
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.progress import uninterrupted

# steps
LARGEST_TURN = 0.8  # rad per step, of any node
_TRIALS, _HALVED = 20, 6  # points on a step; the first are each at half the way of the one before
_CLOSER = 4          # halvings of the way that is left to an obstacle
_UNTOLD = 100.0      # rounding errors of the energy: a gain below these is not told by it
_FALLS = 0.5         # of the square of the decrement: what a step leaves of it then, at most
_VAIN = 5            # steps that one counts for which leads nowhere: each trial was in vain
_OFTEN = 3           # steps in a row that an obstacle cuts, or a kink where the DLO touches
_CREEPING = 0.02     # of a step: what is left of it before a kink
_MOST_COMMON = 1.0   # rad: what turns by more in a step is bent anew
_IDLE = 20           # steps in a row whose gain drowns in rounding errors and that bring nothing
_TRACE = 1e-100      # an unknown as small has no effect at any scale
# eigenvalues
NEUTRAL = 1e-7       # those nearer to zero than this count as zero
HELD_NEUTRAL = 1e-3  # the same with constraints: a mesh splits what is neutral by about as much
_NEARLY = 10 * NEUTRAL  # the same where the gradient has not vanished yet
WELL_STABLE = 0.01   # an eigenvalue that a small step cannot make doubtful
HARDLY = 1e-4        # rad: a step that changes the Hessian by about as little
_PER_TURN = 100.0    # change of an eigenvalue per rad since the Hessian was factorized, at most
_DOUBT = 0.5         # of an eigenvalue: with more it is looked at again at once
_EXACTLY, _ROUGHLY = 1e-4, 1e-2  # relative error of an eigenvalue
# saddles
FALLING = 2e-3       # a shift beyond this is needed by what falls, not by what is neutral
KICK_TURN = 0.3      # rad, of a saddle along its lowest mode
MOST_KICKS = 10
_LEAN = 1e-5         # rad, of a DLO that is about to fall
_ALIKE = 0.5         # of the lower side's fall: a side that falls by more is as good
# near its end
_FEW = 8             # steps in which what is near has to be found
# Of the residual, or, held, of the turn of the step before: what a step may leave at most
_LESS = 0.5
_QUICK = 0.05        # of the residual: the same, or the Hessian is renewed
_ROUNDED = 10.0      # tolerances: what a step does not make less there is rounding
_SETTLED = 1e-9      # of the decrement: the same, where inertia is stiff
_NEXT = 0.05         # rad, of any node: what may follow from a step of a motion
_NEXT_HELD = 0.3     # the same, of a step of two grips
_SAME = 2e-5         # rad: a step that changes the Hessian of a held DLO by about as little
_MISSED = 0.08       # of the span: a grip that is farther away has not moved a little
# grips
# (of a span: the shortest part of the DLO between two grips)
_GIVE = 1e-2         # of the span: how far a grip gives under the DLO's own forces, at most
_FAR = 0.1           # of the span: so far from its target it gives as much
_LEFT = 0.05         # of the span: a step that misses the grip by more is too long
_ASTRAY = 3e-3       # of the span: a DLO that falls is brought back from there
_PROXIMAL = 1e-9     # least shift: what is neutral, as a round DLO that may spin, stays where it is
_MOST_PROXIMAL = 1e-7  # the same, far from the equilibrium
_ALIKE_STIFF = 1e-9  # stiffnesses that differ by less are the same
_NEARER = 0.1        # of a step: how much nearer it has to come where the potential does not tell
_ROUGH = 1e-3        # tolerance of the residual, and of the length, on the way to a target
# The same as _NEXT_HELD (rad) and _MISSED (of the span) of what is near after parts of a way: their
# end is only where the next one begins. In cold solves between 400 random pairs of clamps those
# themselves take a quarter more time, a third of both here 7 % more, three times of either 3 % less
# at most; all but one end in the same shapes, that one in its mirror image
_NEXT_PART, _MISSED_PART = 1.5, 0.25
_SOON = 3            # steps: what is found so soon may be sought twice as far away
_PER_PART = 60       # Newton steps in a part of the way: more is no way


class Options(Record):
    """What a search has to reach, and what it may do."""

    gtol: float  # largest residual at the end
    ctol: float  # by how much a constraint may be violated there, m
    maxiter: int  # newton steps at most
    check: bool  # whether the smallest eigenvalue is found at the end, and a saddle left
    bounded: bool  # whether it is enough to know that it is well above zero; then it is infinite
    falls: bool  # whether it comes from a saddle: it may go far, along valleys that curve
    # whether forces of inertia are left out of a Hessian that they make indefinite
    gauss_newton: bool
    # by how much any node may turn in all steps together, rad, in a search for what is near;
    # infinite: it may be anywhere
    reach: float
    missed: float  # by how much a grip may be missed there, of the span
    # by how much a node may turn before the Hessian of such a search is factorized again, rad
    max_age: float
    nodes: Ints  # (k,) nodes that are looked at; empty: it may go anywhere
    frames: Floats  # (k, 3, 3) their frames before, in the gripper as it is now
    # by how much any of them may turn, rad. A step of the gripper that is too long for the shape to
    # follow is made again in parts; most of the work of finding that out would be the way down to a
    # shape that is not wanted. Nor may it fall off a saddle then
    max_rotation: float


@kernel
def thorough(gtol, ctol, maxiter, check, gauss_newton):
    """Return the Options of a search with all its guards."""
    return Options(gtol, ctol, maxiter, check, False, False, gauss_newton, np.inf, _MISSED, 0.0,
                   np.empty(0, dtype=np.int64), np.empty((0, 3, 3)), np.inf)


@kernel
def next_to(gtol, ctol, check, held):
    """Return the Options of a search for what is near: held in other places, or in a motion."""
    reach, max_age = (_NEXT_HELD, _SAME) if held else (_NEXT, _NEXT)
    return replaced(thorough(gtol, ctol, _FEW, check, not held), 'bounded', not held,
                    'reach', reach, 'max_age', max_age)


@kernel
def within(options, frames, before, base, nodes, most):
    """Return the Options of a DLO that may not turn far from how it hung in another gripper."""
    return replaced(options, 'nodes', nodes, 'frames', carried_frames(frames, before, base, nodes),
                    'max_rotation', most)


@kernel
def _left(options, rotations):
    """Whether a DLO with frames `rotations` (N + 1, 3, 3) has turned too far."""
    if options.nodes.size == 0 or options.max_rotation > np.pi:
        return False
    least = 1.0 + 2.0 * np.cos(options.max_rotation)
    for k in range(options.nodes.size):
        if trace_of_product(rotations[options.nodes[k]], options.frames[k]) < least:
            return True
    return False


class Workspace(Record):
    """Arrays that a descent refills; what it returns are some of them. K rows are held."""

    state: Configuration  # where it is,
    trial: Configuration  # and where it looks
    hessian: Hessian      # at `state`
    start: Floats         # (m, 3) unknowns where it begins,
    step: Floats          # and changes of them
    correction: Floats
    miss: Floats          # (K,) by how much a grip is missed, m
    reaction: Floats      # (K,) change of its forces, N


@kernel
def new_workspace(system):
    """Return an empty Workspace of the right sizes."""
    state, rows = new_configuration(system), row_count(system.needs.border)
    return Workspace(state, new_configuration(system), new_hessian(system), np.empty_like(state.q),
                     np.empty_like(state.q), np.empty_like(state.q), np.empty(rows),
                     np.empty(rows))


class Descent(NamedTuple):
    """Where a descent ended that stops at saddles, too; as a Minimum but for these."""

    state: Configuration
    residual: float
    stability: float
    iterations: int
    mode: Floats         # (m, 3) lowest mode of the Hessian, where that was looked at
    leant: bool = False  # whether its symmetry was broken
    constraint_violation: float = 0.0  # m


def newton(system: Problem, q: Floats, tolerance: float, max_iterations: int, check: bool,
           exact: float = 0.0) -> Minimum:
    """Descend from q to a minimum of the potential that keeps to all grips.

    Shapes: q (m, 3).
    """
    state, residual, stability, iterations, kicks, violated = uninterrupted(_minimum(
        system, q, tolerance, exact, max_iterations, check))
    return Minimum(state, residual, stability, iterations, kicks, system, violated)


def descend(system: Problem, q: Floats, tolerance: float, max_iterations: int,
            check: bool) -> Descent:
    """Descend from q (m, 3) to where the gradient vanishes, be it a minimum or a saddle.

    Arguments as `newton`.
    """
    options = thorough(tolerance, 0.0, max_iterations, check, False)
    return Descent(*uninterrupted(newton_descent(system, q, options, new_workspace(system))))


@kernel
def _minimum(system: Problem, q: Floats, tolerance: float, exact: float, max_iterations: int,
             check: bool) -> tuple[Configuration, float, float, int, int, float]:
    return minimize(system, q.copy(), thorough(tolerance, exact, max_iterations, check, False),
                    new_workspace(system))


@kernel
def minimize(system: Problem, q: Floats, options: Options,
             work: Workspace) -> tuple[Configuration, float, float, int, int, float]:
    """Do as `newton_descent` does, but go on from saddles.

    `q` is where it began for the last time at the end.
    """
    kicks = iterations = 0
    neutral = HELD_NEUTRAL if is_held(system) else NEUTRAL
    most = options.maxiter
    while True:
        state, residual, stability, steps, mode, leant, missed = newton_descent(
            system, q, options, work)
        iterations += steps
        if leant and not is_held(system):
            kicks = max(kicks, 1)
        done = (not options.check or stability > -neutral or options.nodes.size > 0
                or options.reach < np.inf)
        if (done or iterations >= most or kicks >= MOST_KICKS
                or not leave_saddle(system, state, mode, q)):
            break
        kicks += 1
        options = replaced(options, 'maxiter', most - iterations, 'falls', kicks > 0)
    return state, residual, stability, iterations, kicks, missed


@kernel
def is_held(system):
    """Whether a grip beside the gripper, or a hinge at that, has a say."""
    return row_count(system.needs.border) > 0 or hinged(system)


@kernel
def newton_descent(system: Problem, q: Floats, options: Options,
                   work: Workspace) -> tuple[Configuration, float, float, int, Floats, bool, float]:
    """Descend from q (m, 3) to where the gradient vanishes, be it a minimum or a saddle.

    Where what is near is not, or a DLO turns too far, it is given up: the residual is infinite. The
    multipliers of the Problem's grip are where the search begins, and are moved.
    """
    state, trial, hessian, step = work.state, work.trial, work.hessian, work.step
    hold, border, miss, reaction = system.effects.hold, hessian.border, work.miss, work.reaction
    gtol, ctol, check = options.gtol, options.ctol, options.check
    bend, held = bending_energy(system), is_held(system)
    length = shortest_span(hold, system.lengths)
    near, drawn = options.reach < np.inf, options.gauss_newton
    kinks = may_forbid(system.effects) and has_inertia(system.effects.anchor)
    turns = not near and (drawn or (held or options.falls) and _spins_freely(system))
    most_give = _most_give(hold, system, bend, length) if held and not near else 0.0
    least = _PROXIMAL if held and not near else 0.0
    flush_subnormals(q, state.q)
    energy, noise = evaluate(system, state)
    mode, stability = work.correction, np.nan
    shift, shifted = least, np.inf  # the second: that of the last factorization
    # turn since that and in all, rad; contraction and turn of the last step
    age, way, contraction, last = np.inf, 0.0, np.inf, np.inf
    iterations = obstructed = idle = 0
    stalled = leans = False
    worked = np.zeros(1)
    told = np.inf  # the decrement, where it tells that nothing is left to go
    while True:
        if is_to_end(worked, system, 1):
            iterations = options.maxiter
        # where is it? (1) is the end
        missed = constraint_value(hold, state, miss)
        residual = min(relative(state, bend), told)
        noisy = gradient_noise(system, state) if held else 0.0
        converged = missed <= ctol and residual < max(gtol, noisy)
        arrived = converged or stalled or iterations >= options.maxiter
        if near and (missed > options.missed * length or arrived
                     and (noisy > BLURRED or not (converged or stalled))):
            residual = np.inf
            break
        if arrived and not check:
            break
        if arrived and shifted == 0.0:  # a factorization that is not old tells a stable shape
            if options.bounded and _surely_stable(system, hessian, age):
                stability = np.inf
                break
            if not options.bounded and age < HARDLY:
                stability, mode = lowest_mode(system, hessian, 0.0, _EXACTLY)
                if stability > WELL_STABLE:
                    break

        # (2) the Hessian, until it is positive definite on what a grip leaves free
        whole = age < np.inf
        if arrived or not near or age > options.max_age or contraction > _QUICK:
            set_give(border, 0.0 if arrived else most_give * min(1.0, missed / (_FAR * length)))
            if arrived:
                shift = 0.0
            elif held and not near:
                # neutral steps are as large as rounding errors over the shift, and spoil what
                # their square is; one that vanishes with the residual costs nothing (Fan and Yuan)
                shift = max(shift, min(residual, _MOST_PROXIMAL))
            definite = whole = assembled_definite(system, state, hessian, shift)
            forceless = drawn and shift == 0.0 and not definite and not arrived
            if forceless and (iterations == 0 or not near):
                definite = _definite_without_forces(system, state, hessian)
            if near and not (definite and has_safe_pivots(hessian, border)) or (
                    forceless and not definite):
                residual, stability = np.inf, -np.inf
                break
            if not definite:
                shift = max(LEAST_SHIFT, 4.0 * shift)
                if options.nodes.size and not arrived and not is_definite(system, hessian, shift):
                    residual, stability, leans = np.inf, -np.inf, True  # it falls
                    break
                shift = inertia_correction(system, hessian, shift)
            age, shifted = 0.0 if whole else np.inf, shift
        if arrived:
            stability, mode = lowest_mode(system, hessian, shift,
                                          _ROUGHLY if options.bounded else _EXACTLY)
            break
        if shift > FALLING and not leans:
            leans = True
            if options.nodes.size:
                residual, stability = np.inf, -np.inf
                break
            leant, high, its_noise = break_symmetry(system, hessian, state, trial)
            if leant:
                state, trial, energy, noise = trial, state, high, its_noise
                continue

        # (3) the step: Newton's, or back into the grip (not into obstacles or other strands, whose
        # springs only the potential knows)
        back = (held and leans and missed > _ASTRAY * length and not may_forbid(system.effects)
                and not pushes_out(system.effects.strands, system, state))
        put_scaled(0.0 if back else -1.0, state.gradient, trial.gradient)
        solve_held(system, hessian, trial.gradient, miss, step, reaction)
        gain, turn = -dot(state.gradient, step), largest_turn(system, hessian, step)
        decrement = np.sqrt(max(gain, 0.0) / (dot(state.q, state.q) + bend)) if whole else np.inf
        if drawn and not near and shift == 0.0 and decrement < _SETTLED:
            told, stalled = decrement, True
            continue
        if (check and not held and shift > 0.0 and gain < _UNTOLD * noise
                and not assembled_definite(system, state, hessian, _NEARLY)):
            stalled = True  # rounding errors hide the way down from a saddle: its mode has to tell
            continue

        # (4) near its end it has to come much nearer at once, with the factorization there is
        if near:
            iterations, way, fresh, age = iterations + 1, way + turn, age == 0.0, age + turn
            move_multipliers(hold, 1.0, reaction)
            put_sum(state.q, 1.0, step, trial.q)
            evaluate(system, trial)
            left = constraint_value(hold, trial, miss)
            contraction = (relative(trial, bend) + left / length) / (residual + missed / length)
            # what is taut resists what steps leave of their way by forces that say nothing of it:
            # held, the next step tells. As in Deuflhard's test, corrections are compared instead
            # of residuals; here successive Newton corrections, by their largest turn
            falls = turn < _LESS * last if held else contraction < _LESS
            last = turn
            if falls and way < options.reach:
                state, trial = trial, state
            elif not held and (residual < _ROUNDED * gtol or decrement < _SETTLED):
                told, stalled = decrement, True
            elif held or fresh or not way < options.reach:
                residual = np.inf
                break
            continue

        # (5) else as far as the potential falls, with the reaction as it will be
        part = LARGEST_TURN / turn if turn > LARGEST_TURN else 1.0
        scaled_by(part, step)
        untold = not held and gain * part < _UNTOLD * noise
        slope, more = _with_reaction(hold, border, part, reaction, miss, step)
        slope, energy = slope - gain * part, energy + more
        farthest = missed if back else max(2.0 * missed, _LEFT * length)
        gone, energy, noise, blocked = _line_search(
            system, hessian, state, trial, step, energy, noise, np.inf if back else slope,
            farthest, residual + missed / length, turns, work.correction, drawn)
        iterations += 1
        idle = idle + 1 if untold and not _nearer(state, trial) else 0
        obstructed = obstructed + 1 if blocked or kinks and gone < _CREEPING else 0
        # the reaction goes as far as the DLO does, and without what it owes to a shift
        _settle_reaction(hold, border, part, reaction, miss, gone, shift / (1.0 + shift))
        if gone > 0.0:
            state, trial, age = trial, state, turn
            if _left(options, state.rotations):
                residual, stability = np.inf, -np.inf
                break
            shift = least if shift < 1e-3 else 0.1 * shift
            # a contact there has to be known before it goes on; rounding errors lead nowhere
            stalled = obstructed > _OFTEN or idle > _IDLE
        else:
            iterations += _VAIN - 1
            stalled = shift > 1e6 or not drawn and shift <= _MOST_PROXIMAL and missed <= ctol
            shift = max(1e-2, 10.0 * shift)
        if held and (gone < 1.0 or shift > _PROXIMAL):
            energy, noise = evaluate(system, state)
    if near and check and not stability > WELL_STABLE:
        residual = np.inf
    return state, residual, stability, iterations, mode, leans, missed


@kernel
def flush_subnormals(q, out):
    """Copy q (m, 3) to `out` with zeros for what is far too small to mean anything.

    Where a motion stays in a plane, each shape leaves out of it the square of what the one before
    did: soon subnormal numbers, which a CPU is many times slower with.
    """
    for e in range(q.shape[0]):
        for i in range(3):
            out[e, i] = q[e, i] if abs(q[e, i]) > _TRACE else 0.0


@kernel
def _nearer(state, trial):
    """Whether the gradient of `trial` is smaller."""
    return dot(trial.gradient, trial.gradient) < 0.9 * dot(state.gradient, state.gradient)


@kernel
def _line_search(system, hessian, state, trial, step, energy, noise, slope, farthest, error, turns,
                 correction, drawn):
    """Fill `trial` on the way along `step` where the potential has fallen enough.

    Where the gain drowns in rounding errors the gradient has to tell, or, where inertia is stiff,
    the simplified decrement (Deuflhard's natural monotonicity test). A step that mostly brings a
    held end back may lead up the potential of a DLO that could not stand without its grip. There it
    has to bring both conditions nearer to their solution.

    Returns the part of the step gone (0 if there is no such point), its energy, noise, and if an
    obstacle was met.
    """
    fraction, farther, blocked, held = 1.0, 0.0, False, is_held(system)
    for trials in range(_TRIALS):
        _retract(system, state, step, fraction, turns, trial.q)
        new, new_noise = evaluate(system, trial)
        if forbids(system.effects, system, state, trial):
            farther = fraction
            fraction *= 0.5
            blocked = True
            continue
        if farther > 0.0:
            fraction = _closer(system, state, trial, step, fraction, farther, turns)
            farther = 0.0
            new, new_noise = evaluate(system, trial)
        within_noise = abs(fraction * slope) < _UNTOLD * noise
        falls = new <= energy + 1e-4 * fraction * slope
        if held:
            missed = constraint_violation(system.effects.hold, trial)
            if slope == np.inf:
                falls = True
            elif slope >= 0.0:
                left = residual_of(system, trial) + missed / shortest_span(system.effects.hold,
                                                                           system.lengths)
                falls = left <= (1.0 - _NEARER * fraction) * error
            falls = missed <= farthest and (falls or within_noise)
        elif not falls and within_noise:
            if drawn:
                solve(system, hessian, trial.gradient, correction)
                falls = dot(trial.gradient, correction) < -_FALLS * slope
            else:
                falls = _nearer(state, trial)
        if falls:
            return fraction, new, new_noise, blocked
        if within_noise and not held:
            break
        fraction *= 0.5 if held or trials < _HALVED else 0.1  # what is left is a kink
    return 0.0, energy, noise, blocked


@kernel
def _closer(system, state, trial, step, clear, blocked, turns):
    """Fill the unknowns of `trial` nearer to what is in the way; return the part of the step.

    Springs are felt only where the DLO touches: half the way at a time it would hardly get there.
    """
    for _ in range(_CLOSER):
        middle = 0.5 * (clear + blocked)
        _retract(system, state, step, middle, turns, trial.q)
        evaluate(system, trial)
        if forbids(system.effects, system, state, trial):
            blocked = middle
        else:
            clear = middle
    _retract(system, state, step, clear, turns, trial.q)
    return clear


@kernel
def _retract(system, state, step, fraction, turns, out):
    """Fill `out` (m, 3) with the unknowns of a Configuration after a step's part, to first order.

    Torsion turns all that lies beyond about the DLO's axis. Where little resists it, by large
    angles while the axis hardly moves: curvature stays in the world and turns in the material
    frame, and a straight line of the unknowns leaves that way with the square of the angle. So
    where it `turns` curvature is turned back by the angle (a retraction: Absil et al.). So it is
    with the turn that all curvature has in common, as of what falls round the vertical.
    """
    if not turns:
        put_sum(state.q, fraction, step, out)
        return
    strains, angles = np.empty((system.lengths.size, 3)), np.empty(system.lengths.size)
    angle = turned = square = 0.0
    for e in range(system.lengths.size):
        x, y, z = value_at(system.basis, step, e)
        torsion = fraction * system.scale[e, 0] * x
        turn = system.lengths[e] * torsion
        if e == 0 and hinged(system):
            turn = 0.0
        middle = angle + 0.5 * turn
        angle += turn
        one, other = state.strains[e, 1], state.strains[e, 2]
        strains[e, 0] = state.strains[e, 0] + torsion
        strains[e, 1] = fraction * system.scale[e, 1] * y - middle * other
        strains[e, 2] = fraction * system.scale[e, 2] * z + middle * one
        angles[e] = middle
        turned += system.lengths[e] * (one * strains[e, 2] - other * strains[e, 1])
        square += system.lengths[e] * (one * one + other * other)
    # (what two grips hold does not turn as a whole)
    common = turned / square if not is_held(system) and abs(turned) < _MOST_COMMON * square else 0.0
    for e in range(system.lengths.size):
        one = state.strains[e, 1] + strains[e, 1] + common * state.strains[e, 2]
        other = state.strains[e, 2] + strains[e, 2] - common * state.strains[e, 1]
        c, s = np.cos(angles[e] - common), np.sin(angles[e] - common)
        strains[e, 1] = c * one + s * other
        strains[e, 2] = c * other - s * one
    unknowns_of(system, strains, out)


@kernel
def _spins_freely(system):
    """Return whether a DLO is round and naturally straight, so that turning it costs nothing."""
    if yields(system.effects.plastic):
        return False
    for e in range(system.lengths.size):
        stiffness, natural = system.stiffness[e], system.natural[e]
        if (abs(stiffness[1] - stiffness[2]) > _ALIKE_STIFF * stiffness[1]
                or abs(natural[1]) + abs(natural[2]) > 0.0):
            return False
    return True


@kernel
def _surely_stable(system, hessian, age):
    """Whether a factorization tells that no eigenvalue is small where nodes turned by `age` since.

    Its factors may get lost. Where its blocks are at hand, pivots tell (Sylvester), for less than
    the smallest eigenvalue costs.
    """
    bound = WELL_STABLE + _PER_TURN * age
    if bound >= WELL_STABLE + _DOUBT:
        return False
    if system.basis.shape[1] > 0 or is_fused(system):
        return lowest_mode(system, hessian, 0.0, _ROUGHLY)[0] > bound
    return is_definite(system, hessian, -bound)


@kernel
def _definite_without_forces(system, state, hessian):
    """Do what `assembled_definite` does, but leave out what forces do as the DLO turns."""
    for k in range(state.pull.shape[0]):
        for i in range(3):
            state.pull[k, i] = 0.0
    definite = assembled_definite(system, state, hessian, 0.0)
    evaluate(system, state)
    return definite


@kernel
def _most_give(hold, system, bend, span):
    """Return by how much a grip that is far from its target gives way, m/N."""
    if hold is None:
        return 0.0
    forces = np.sum(np.abs(system.effects.load.pull))
    if not may_forbid(system.effects):  # (which push as well, deep inside them as much)
        forces += _tension(hold)  # what is taut would miss its grip if that gave under so much
    stiff = bend * (np.sum(system.lengths) / span)
    # (a column that inertia holds buckles under 2 sqrt(EI k), k its stiffness per length: a beam on
    # an elastic foundation)
    drawn = inertial_stiffness(system.effects.anchor) * span**3 / np.sum(system.lengths)
    return _GIVE * span**2 / (forces * span + stiff + 2.0 * np.sqrt(stiff * drawn))


@kernel
def _tension(hold):
    """Return the largest pull in N along the ways from grip to grip; 0 where all press.

    Between two grips pulls what all grips from there to the tip exert.
    """
    largest = 0.0
    for a in range(hold.node.size):
        pull = square = 0.0
        for i in range(3):
            way = hold.target[a, i] - hold.target[a - 1, i] if a > 0 else hold.target[a, i]
            square += way * way
            for row in range(hold.first[a], hold.multiplier.size):
                pull -= hold.multiplier[row] * hold.rows[row, 3 + i] * way
        if square > 0.0:
            largest = max(largest, max(pull, 0.0) / np.sqrt(square))
    return largest


@kernel
def _with_reaction(hold, border, part, reaction, miss, step):
    """Give a grip its new forces; return what they change of the merit's slope and value, J.

    The change of the forces (K,) is cut to a part of itself, as the step (m, 3) is.
    """
    if hold is None:
        return 0.0, 0.0
    slope = more = 0.0
    for row in range(reaction.size):
        reaction[row] *= part
        hold.multiplier[row] += reaction[row]
        more += reaction[row] * miss[row]
        slope += reaction[row] * dot(border.rows[row], step)
    return slope, more


@kernel
def _settle_reaction(hold, border, part, reaction, miss, gone, excess):
    """Take back of a grip's new forces what is beyond the part of the step that was gone.

    And of what brings the end back, which a shift makes as large as itself, the `excess`.
    """
    if hold is None:
        return
    for row in range(reaction.size):
        bringing = 0.0
        for other in range(reaction.size):
            bringing += border.schur[row, other] * miss[other]
        hold.multiplier[row] -= (1.0 - gone) * reaction[row] + gone * excess * part * bringing


@kernel
def break_symmetry(system, hessian, state, trial):
    """Fill `trial` with the shape of `state` leant to the preferred side.

    Returns whether it can be, and what `evaluate` does.
    """
    reference_mode(system, trial.gradient)
    amount = _LEAN / largest_turn(system, hessian, trial.gradient)
    put_sum(state.q, amount, trial.gradient, trial.q)
    energy, noise = evaluate(system, trial)
    return not forbids(system.effects, system, state, trial), energy, noise


@kernel
def leave_saddle(system: Problem, state: Configuration, mode: Floats, q: Floats) -> bool:
    """Fill q (m, 3) with unknowns beside a saddle, on its lower side; return whether one is lower.

    Where both are about as low, it is the one to which the mode points.
    """
    hessian, trial = new_hessian(system), new_configuration(system)
    assemble(system, state, hessian)
    copy(state.q, trial.q)
    energy, noise = evaluate(system, trial)
    step = KICK_TURN / max(largest_turn(system, hessian, mode), 1e-12)
    for _ in range(20):
        plus = _height(system, state, trial, step, mode)
        minus = _height(system, state, trial, -step, mode)
        if min(plus, minus) < energy - 10 * noise:
            alike = energy - plus >= _ALIKE * (energy - minus)
            put_sum(state.q, step if alike else -step, mode, q)
            return True
        step *= 0.5
    return False


@kernel
def _height(system, state, trial, step, mode):
    """Return the potential a step along a mode away, infinite where an obstacle is in between."""
    put_sum(state.q, step, mode, trial.q)
    high, _ = evaluate(system, trial)
    return np.inf if forbids(system.effects, system, state, trial) else high


@kernel
def follow_homotopy(system: Problem, displaced: Any, q: Floats, bases: Floats, targets: Floats,
                    axes: Floats, rows: Floats) -> tuple[Floats, Floats, int]:
    """Return unknowns (m, 3) and multipliers (K,) where all grips have gone a way of n parts.

    And how many of these they have gone. What is near after a part, or several, is sought without
    the springs of grips, which would press the DLO by as much as it has to go; where it is not
    near, as where the DLO buckles, with all guards.

    Args:
        system: Problem of the DLO at the beginning; `displaced`: that of its Structure without
            springs of grips
        bases: (n, 3, 3) of the gripper
        targets, axes, rows: of HoldRows, (n, A, 3), (n, A, 3, 3), (n, K, 6)
    """
    hold = system.effects.hold
    springless = replaced(
        system, 'effects', replaced(system.effects, 'hold', replaced(
            hold, 'stiffness', 0.0, 'turn_stiffness', 0.0)),
        'needs', replaced(system.needs, 'displaced', displaced))
    forces, before = hold.multiplier.copy(), np.empty_like(hold.multiplier)
    length = shortest_span(hold, system.lengths)
    guarded = thorough(_ROUGH, _ROUGH * length, _PER_PART, length < 0.0, length < 0.0)
    near = replaced(guarded, 'maxiter', _FEW, 'reach', _NEXT_PART, 'missed', _MISSED_PART,
                    'max_age', _SAME)
    worked, near_work = np.zeros(1), new_workspace(springless)
    kept_apart = may_forbid(system.effects) or strands_may_forbid(system.effects.strands)
    gone, parts, steps, state = 0, 1, 0, near_work.state
    while gone < bases.shape[0]:
        if is_to_end(worked, system, 4):
            break
        k = min(gone + parts, bases.shape[0]) - 1
        before[:], residual = forces, np.inf
        # what is in the way is looked at on the steps of the other search alone
        if not kept_apart:
            state, residual, _, steps, _, _, _ = newton_descent(
                _regripped(springless, bases[k], targets[k], axes[k], rows[k], forces), q, near,
                near_work)
        if residual < np.inf:
            parts *= 2 if steps <= _SOON else 1
        else:
            forces[:] = before
            if parts > 1:
                parts = 1
                continue
            state, _, _, _, _, _, missed = newton_descent(
                _regripped(system, bases[k], targets[k], axes[k], rows[k], forces), q, guarded,
                new_workspace(system))
            if not missed <= _LEFT * length:
                forces[:] = before  # those that belong to q
                break
        gone, q = k + 1, state.q.copy()
    return q, forces, gone


@kernel
def _regripped(system, base, target, axes, rows, multiplier):
    """Return the Problem of a DLO whose grips are elsewhere, with these forces (K,)."""
    hold = replaced(system.effects.hold, 'target', target, 'axes', axes, 'rows', rows,
                    'multiplier', multiplier)
    return replaced(system, 'base', base, 'effects', replaced(system.effects, 'hold', hold))
