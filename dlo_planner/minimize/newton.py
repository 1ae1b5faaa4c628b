# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Newton's method that can only end in a minimum, or say that it did not.

Three guards around the plain method (Nocedal and Wright, Numerical Optimization, ch. 3):
a shift of the Hessian until all its pivots are positive, a cap on how far any node may turn in
one step (without it a heavily loaded wire winds extra turns into itself), and a decrease of the
potential in every step. Where the gradient vanishes but a pivot is negative, the shape is a
saddle: it is kicked along its lowest mode and goes on falling.

Where a symmetric DLO may fall to either side, rounding errors would choose one as they grow from
step to step. So it leans, by little but far more than those, to the side that
`spectrum.preferred` states, from where the descent is first found to be unstable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.energy.effects import blocks, may_block
from dlo_planner.energy.inertia import is_drawn
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import State, System, bending_energy
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import dot
from dlo_planner.minimize.leash import Leash, left, no_leash
from dlo_planner.minimize.linear import (
    assembled_definite,
    largest_turn,
    solve,
)
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.residual import relative
from dlo_planner.minimize.saddle import kicked, lean
from dlo_planner.minimize.shifting import LEAST_SHIFT, safe_shift
from dlo_planner.minimize.spectrum import lowest_mode
from dlo_planner.minimize.workspace import Workspace, new_workspace
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arrays import put_sum, scaled_by

LARGEST_TURN = 0.8  # rad per step, of any node
FALLING = 2e-3     # a shift that is needed beyond this tells that it is, not that it is neutral
NEUTRAL = 1e-7      # eigenvalues nearer to zero than this count as zero
_NEARLY = 10 * NEUTRAL  # the same where the gradient has not vanished yet
MOST_KICKS = 10
_IDLE = 20           # steps in a row whose gain drowns in rounding errors and that bring nothing
_TRIALS, _HALVED = 20, 6  # points on a step; the first are each at half the way of the one before
_VAIN = 5            # steps that one counts for which leads nowhere: each trial was in vain
_OFTEN = 3           # steps in a row that an obstacle cuts, or a kink where the DLO touches
_CREEPING = 0.02     # of a step: what is left of it before a kink
_CLOSER = 4          # halvings of the way that is left to it
_UNTOLD = 100.0      # rounding errors of the energy: a gain below these is not told by it
HARDLY = 1e-4       # rad: a step that changes the Hessian by about as little
_TRACE = 1e-100      # an unknown as small has no effect at any scale
WELL_STABLE = 0.01  # an eigenvalue that such a step cannot make doubtful


def newton(system: System, q: Floats, tolerance: float, max_iterations: int,
           check: bool) -> Minimum:
    """Descend from q to a minimum of the potential.

    Parameters
    ----------
    system : System
        The DLO.
    q : ndarray, shape (m, 3)
        Start, scaled unknowns; not changed.
    tolerance : float
        Largest residual at the end.
    max_iterations : int
        Newton steps at most.
    check : bool
        Whether to find the smallest eigenvalue at the end, and to leave a saddle.
    """
    state, residual, stability, iterations, kicks = leashed_newton(
        system, q.copy(), tolerance, max_iterations, check, no_leash(), new_workspace(system))
    return Minimum(state, residual, stability, iterations, kicks, system)


@kernel(inline='always')
def leashed_newton(system: System, q: Floats, tolerance: float, max_iterations: int, check: bool,
                   leash: Leash, work: Workspace) -> tuple[State, float, float, int, int]:
    """Do as `newton` does, but give up where the DLO leaves a Leash, or falls off a saddle on it.

    Then the residual is infinite, or the stability negative. `q` is where it began for the last
    time at the end, and the State one of the Workspace.

    Returns
    -------
    state : State
        State at the end.
    residual : float
        Size of the scaled gradient.
    stability : float
        Smallest eigenvalue of the Hessian; nan if not `check`.
    iterations : int
        Newton steps made.
    kicks : int
        How often a saddle was left, 1 at least where the descent had to lean to a side.
    """
    kicks = iterations = 0
    while True:
        state, residual, stability, steps, mode, leant = leashed_descent(
            system, q, tolerance, max_iterations - iterations, check, leash, work)
        iterations += steps
        if leant:
            kicks = max(kicks, 1)
        done = not check or stability > -NEUTRAL or leash.nodes.size > 0
        if (done or iterations >= max_iterations or kicks >= MOST_KICKS
                or not kicked(system, state, mode, q)):
            break
        kicks += 1
    return state, residual, stability, iterations, kicks


class Descent(NamedTuple):
    """Where a descent ended that stops at saddles, too.

    Attributes
    ----------
    state, residual, stability, iterations
        As of a Minimum.
    mode : ndarray, shape (m, 3)
        Lowest mode of the Hessian, where that was looked at.
    leant : bool
        Whether it had to lean to a side.
    violation : float
        By how much a constraint is violated, m.
    """

    state: State
    residual: float
    stability: float
    iterations: int
    mode: Floats
    leant: bool = False
    violation: float = 0.0


def descend(system: System, q: Floats, tolerance: float, max_iterations: int,
            check: bool) -> Descent:
    """Descend from q (m, 3) to where the gradient vanishes, be it a minimum or a saddle.

    Arguments as `newton`.
    """
    return Descent(*leashed_descent(system, q, tolerance, max_iterations, check, no_leash(),
                                    new_workspace(system)))


@kernel
def leashed_descent(system: System, q: Floats, tolerance: float, max_iterations: int, check: bool,
                    leash: Leash, work: Workspace) -> tuple[State, float, float, int, Floats,
                                                            bool]:
    """Return what is in the Descent of `descend`, as a tuple; arguments as `leashed_newton`."""
    state, trial, hessian, step = work.state, work.trial, work.hessian, work.step
    mode, bend = work.start, bending_energy(system)
    without_traces(q, state.q)
    energy, noise = evaluate(system, state)
    stability, turn = np.nan, np.inf  # rad, of the last step
    shift = shifted = 0.0  # the second: that of the factorization which it was made with
    iterations = obstructed = idle = 0
    stalled = leans = False
    kinks = may_block(system.effects) and is_drawn(system.effects.anchor)
    while True:
        residual = relative(state, bend)
        arrived = residual < tolerance or stalled or iterations >= max_iterations
        if arrived and not check:
            break
        if arrived and shifted == 0.0 and turn < HARDLY:
            # After so small a step the factorization before it tells a stable shape as well.
            stability, mode = lowest_mode(system, hessian, 0.0, 1e-4)
            if stability > WELL_STABLE:
                break
        shift = 0.0 if arrived else shift
        if not assembled_definite(system, state, hessian, shift):
            shift = safe_shift(system, hessian, max(LEAST_SHIFT, 4.0 * shift))
        if arrived:
            stability, mode = lowest_mode(system, hessian, shift, 1e-4)
            break
        if shift > FALLING and not leans:
            leans = True
            if leash.nodes.size:
                residual, stability = np.inf, -np.inf
                break
            leant, high, its_noise = lean(system, hessian, state, trial)
            if leant:
                state, trial, energy, noise = trial, state, high, its_noise
                continue
        its_turn, gain = _newton_step(system, hessian, state, step)
        if (check and shift > 0.0 and gain < _UNTOLD * noise
                and not assembled_definite(system, state, hessian, _NEARLY)):
            stalled = True  # rounding errors hide the way down from a saddle: its mode has to tell
            continue
        turn, shifted = its_turn, shift
        untold = gain * LARGEST_TURN < _UNTOLD * noise * max(its_turn, LARGEST_TURN)
        energy, noise, part, blocked = _fall(system, state, trial, step, energy, noise)
        iterations += 1
        idle = idle + 1 if untold and not _nearer(state, trial) else 0
        obstructed = obstructed + 1 if blocked or kinks and part < _CREEPING else 0
        if part > 0.0:
            state, trial = trial, state
            if left(leash, state.rotations):
                residual, stability = np.inf, -np.inf
                break
            shift = 0.0 if shift < 1e-3 else 0.1 * shift
            # a contact there has to be known before it goes on; rounding errors lead nowhere
            stalled = obstructed > _OFTEN or idle > _IDLE
        else:
            iterations, stalled = iterations + _VAIN - 1, shift == 0.0 or shift > 1e6
            shift = max(1e-2, 10.0 * shift)
    return state, residual, stability, iterations, mode, leans


@kernel
def _nearer(state, trial):
    """Whether the gradient of `trial` is smaller."""
    return dot(trial.gradient, trial.gradient) < 0.9 * dot(state.gradient, state.gradient)


@kernel
def _newton_step(system, hessian, state, step):
    """Fill step (m, 3), cut to LARGEST_TURN; return its turn and the slope down it before that."""
    solve(system, hessian, state.gradient, step)
    scaled_by(-1.0, step)
    gain, turn = -dot(state.gradient, step), largest_turn(system, hessian, step)
    if turn > LARGEST_TURN:
        scaled_by(LARGEST_TURN / turn, step)
    return turn, gain


@kernel
def without_traces(q, out):
    """Copy q (m, 3) to `out` with zeros for what is far too small to mean anything.

    Where a motion stays in a plane, each shape leaves out of it the square of what the one before
    did: soon subnormal numbers, which a CPU is many times slower with.
    """
    for e in range(q.shape[0]):
        for i in range(3):
            out[e, i] = q[e, i] if abs(q[e, i]) > _TRACE else 0.0


@kernel
def _fall(system, state, trial, step, energy, noise):
    """Fill `trial` on the way along `step` where the potential has fallen enough.

    Returns its energy, noise, the part of the step, 0 if there is no such point, and whether an
    obstacle was met.
    """
    slope = dot(state.gradient, step)
    fraction, farther = 1.0, 0.0
    blocked = False
    for trials in range(_TRIALS):
        put_sum(state.q, fraction, step, trial.q)
        new, new_noise = evaluate(system, trial)
        if blocks(system.effects, system, state, trial):
            farther = fraction
            fraction *= 0.5
            blocked = True
            continue
        if farther > 0.0:
            fraction = _closer(system, state, trial, step, fraction, farther)
            farther = 0.0
            new, new_noise = evaluate(system, trial)
        # Where the gain drowns in rounding errors the gradient has to tell.
        within_noise = abs(fraction * slope) < _UNTOLD * noise
        if (new <= energy + 1e-4 * fraction * slope
                or (within_noise and _nearer(state, trial))):
            return new, new_noise, fraction, blocked
        if within_noise:
            break
        fraction *= 0.5 if trials < _HALVED else 0.1  # what is left is a kink
    return energy, noise, 0.0, blocked


@kernel
def _closer(system, state, trial, step, clear, blocked):
    """Fill the unknowns of `trial` nearer to what is in the way; return the part of the step.

    Springs are felt only where the DLO touches: half the way at a time it would hardly get there.

    Args:
        clear, blocked: parts of the step of which one meets no obstacle, the other one does
    """
    for _ in range(_CLOSER):
        middle = 0.5 * (clear + blocked)
        put_sum(state.q, middle, step, trial.q)
        evaluate(system, trial)
        if blocks(system.effects, system, state, trial):
            blocked = middle
        else:
            clear = middle
    put_sum(state.q, clear, step, trial.q)
    return clear
