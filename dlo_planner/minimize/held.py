# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Newton's method for a DLO whose far end is held: shape and reaction at once.

Each step solves the equilibrium and the linearized grip together (sequential quadratic
programming, Nocedal and Wright, ch. 18), by the direct simulator's sweep with one right side more
per held direction. The step is judged by the augmented Lagrangian with the new reaction, of which
it is a descent direction where the Hessian is positive on what the grip leaves free; a shift makes
it so elsewhere. Three more guards:
* Far from its target the grip gives a little under the reaction (stabilized SQP, Wright 1998): so
  a straight DLO, whose end cannot come nearer to first order, is pressed until it buckles.
* No step leaves the grip by much.
* A DLO that falls is brought back into its grip before it falls on. A fall follows the potential
  of the held DLO, not a way through shapes that the grip forbids.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.effects import blocks, may_block
from dlo_planner.energy.hold import fill_miss, moved_hold, violation
from dlo_planner.energy.potential import at_element, evaluate, project
from dlo_planner.energy.system import (
    State,
    System,
    bending_energy,
    hinged,
    new_state,
    regripped_system,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import dot
from dlo_planner.minimize.linear import (
    assemble,
    largest_turn,
    new_hessian,
    solve_held,
)
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import FALLING, LARGEST_TURN, Descent, without_traces
from dlo_planner.minimize.residual import gradient_noise, residual_of
from dlo_planner.minimize.saddle import kick, lean
from dlo_planner.minimize.shifting import safe_shift
from dlo_planner.minimize.spectrum import lowest_mode
from dlo_planner.model.arrays import Floats

HELD_NEUTRAL = 1e-3  # as NEUTRAL, with constraints: a mesh splits what is neutral by about as much
_GIVE = 1e-2      # of the length: how far a grip gives under the DLO's own forces, at most
_FAR = 0.1        # of the length: so far from its target it gives as much
_LEFT = 0.05      # of the length: a step that misses the grip by more is too long
_ASTRAY = 3e-3    # of the length: a DLO that falls is brought back from there
_PROXIMAL = 1e-9  # least shift: what is neutral, as a round DLO that may spin, stays where it is
_MOST_PROXIMAL = 1e-7  # the same, far from the equilibrium
_ALIKE = 1e-9     # stiffnesses that differ by less are the same
_NEARER = 0.1    # of a step: how much nearer it has to come where the potential does not tell
_OFTEN = 3
_MOST_KICKS = 10
_ROUGH = 1e-3     # tolerance of the residual, and of the length, on the way to a target
_PER_PART = 60    # Newton steps in a part of the way: more is no way


def held_newton(system: System, q: Floats, tolerance: float, exact: float,
                max_iterations: int, check: bool) -> Minimum:
    """Descend from q (m, 3) to a minimum in the grip.

    Arguments as `newton.newton`, and as `descend_held`.
    """
    kicks = iterations = 0
    while True:
        descent = held_descent(system, q, tolerance, exact, max_iterations - iterations, check)
        iterations += descent.iterations
        steady = not check or descent.stability > -HELD_NEUTRAL
        if steady or iterations >= max_iterations or kicks >= _MOST_KICKS:
            break
        kicked = kick(system, descent.state, descent.mode)
        if kicked is None:
            break
        kicks += 1
        q = kicked
    return Minimum(descent.state, descent.residual, descent.stability, iterations, kicks, system,
                   descent.violation)


def held_descent(system: System, q: Floats, tolerance: float, exact: float,
                 max_iterations: int, check: bool) -> Descent:
    """Return `descend_held` by name."""
    state, residual, stability, iterations, mode, missed = descend_held(
        system, q, tolerance, exact, max_iterations, check)
    return Descent(state, residual, stability, iterations, mode, violation=missed)


@kernel
def led(system: System, q: Floats, bases: Floats, targets: Floats, axes: Floats,
        rows: Floats) -> tuple[Floats, int]:
    """Return unknowns (m, 3) where both grips have gone a way of n parts, and the parts gone.

    Args:
        q: (m, 3) where the way begins; the System's multipliers are moved
        bases: (n, 3, 3) rotation of the gripper at the end of each part
        targets: (n, 3), axes: (n, 3, 3), rows: (n, K, 6) of the grip there, see `Hold`
    """
    length = np.sum(system.lengths)
    most, never = int(_PER_PART), length < 0.0  # literals would be compiled for by themselves
    for part in range(bases.shape[0]):
        regripped = regripped_system(system, bases[part], moved_hold(
            system.effects.hold, targets[part], axes[part], rows[part]))
        state, residual, _, _, _, missed = descend_held(regripped, q, _ROUGH, _ROUGH * length,
                                                        most, never)
        if not missed <= _LEFT * length:
            return q, part
        q = state.q
    return q, bases.shape[0]


@kernel
def descend_held(system: System, q: Floats, tolerance: float, exact: float, max_iterations: int,
                 check: bool | np.bool_) -> tuple[State, float, float, int, Floats, float]:
    """Descend from q (m, 3) to an equilibrium in the grip, be it a minimum or a saddle.

    The System's multipliers, of the grip, are where the search begins, and are moved.

    Returns
    -------
    state, residual, stability, iterations, mode
        As of a Descent.
    missed : float
        By how much the grip is missed, m; `exact` at most where it has arrived.
    """
    hold, last, length = system.effects.hold, system.lengths.size, np.sum(system.lengths)
    state, trial, hessian = new_state(system), new_state(system), new_hessian(system)
    step, mode, border = np.empty_like(state.q), np.zeros_like(state.q), hessian.border
    held = hold.multiplier.size
    miss, reaction, before = np.empty(held), np.empty(held), np.empty(held)
    bringing = np.empty(held)
    without_traces(q, state.q)
    energy, noise = evaluate(system, state)
    forces = np.sum(np.abs(system.effects.load.pull))
    if not may_block(system.effects):  # (which push as well, deep inside them as much)
        forces += _tension(hold)  # what is taut would miss its grip if that gave under so much
    most_give = _GIVE * length**2 / (forces * length + bending_energy(system))
    shift, stability = _PROXIMAL, np.nan
    iterations = obstructed = 0
    stalled = leans = False
    while True:
        fill_miss(hold, state.rotations[last], state.positions[last], miss)
        missed = np.sqrt(np.sum(miss * miss))
        residual = residual_of(system, state)
        arrived = (stalled or iterations >= max_iterations or missed < exact
                   and residual < max(tolerance, gradient_noise(system, state)))
        if arrived and not check:
            break
        assemble(system, state, hessian)
        border.give[0] = 0.0 if arrived else most_give * min(1.0, missed / (_FAR * length))
        if not arrived:
            # neutral steps are as large as rounding errors over the shift, and spoil what their
            # square is; a shift that vanishes with the residual costs nothing (Fan and Yuan 2005)
            shift = max(shift, min(residual, _MOST_PROXIMAL))
        shift = safe_shift(system, hessian, 0.0 if arrived else shift)
        if arrived:
            stability, mode = lowest_mode(system, hessian, shift, 1e-4)
            break
        if shift > FALLING and not leans:
            leans = True
            leant, high, its_noise = lean(system, hessian, state, trial)
            if leant:
                state, trial, energy, noise = trial, state, high, its_noise
                continue
        # (not into obstacles, whose springs only the potential knows)
        back = leans and missed > _ASTRAY * length and not may_block(system.effects)
        solve_held(system, hessian, (0.0 if back else -1.0) * state.gradient, miss, step, reaction)
        # the part of the reaction that brings the end back, which a shift makes as large as itself
        for row in range(held):
            bringing[row] = 0.0
            for other in range(held):
                bringing[row] += border.schur[row, other] * miss[other]
        turn = largest_turn(system, hessian, step)
        if turn > LARGEST_TURN:
            step *= LARGEST_TURN / turn
            reaction *= LARGEST_TURN / turn
            bringing *= LARGEST_TURN / turn
        # the potential and its slope with the new reaction
        before[:] = hold.multiplier
        hold.multiplier[:] += reaction
        slope = dot(state.gradient, step)
        for row in range(held):
            energy += reaction[row] * miss[row]
            slope += reaction[row] * dot(border.rows[row], step)
        farthest = missed if back else max(2.0 * missed, _LEFT * length)
        error = residual + missed / length
        gone, energy, noise, blocked = _search(system, state, trial, step, energy, noise,
                                               np.inf if back else slope, farthest, error)
        iterations += 1
        obstructed += blocked
        # The reaction goes as far as the DLO does, and without what it owes to a shift.
        excess = shift / (1.0 + shift)
        hold.multiplier[:] = before + gone * (reaction - excess * bringing)
        if gone > 0.0:
            state, trial = trial, state
            shift = _PROXIMAL if shift < 1e-3 else 0.1 * shift
            stalled = obstructed > _OFTEN  # a contact there has to be known before it goes on
        else:
            stalled = shift > 1e6 or shift <= _MOST_PROXIMAL and missed < exact
            shift = max(1e-2, 10.0 * shift)
        if gone < 1.0 or shift > _PROXIMAL:
            energy, noise = evaluate(system, state)
    return state, residual, stability, iterations, mode, missed


@kernel
def _tension(hold):
    """Return the reaction in N along the way from grip to grip; 0 where it presses."""
    pull = square = 0.0
    for i in range(3):
        square += hold.target[i] * hold.target[i]
        for row in range(hold.multiplier.size):
            pull -= hold.multiplier[row] * hold.rows[row, 3 + i] * hold.target[i]
    return max(pull, 0.0) / np.sqrt(square) if square > 0.0 else 0.0


@kernel
def _search(system, state, trial, step, energy, noise, slope, farthest, error):
    """Fill `trial` on the way along `step` where the potential has fallen enough.

    A step that mostly brings the end back may lead up the potential of a DLO that could not stand
    without its grip. There it has to bring both conditions nearer to their solution.

    Args:
        slope: of the potential along the step, in J; infinite where only the miss counts
        farthest: m, by how much the grip may be missed there
        error: of the equilibrium and of the grip: residual plus miss by length

    Returns the part of the step gone (0 if there is no such point), its energy, noise, and if an
    obstacle was met.
    """
    fraction, blocked, last = 1.0, False, system.lengths.size
    for _ in range(20):
        advance(system, state.q, step, fraction, trial.q)
        new, new_noise = evaluate(system, trial)
        if blocks(system.effects, system, state, trial):
            fraction *= 0.5
            blocked = True
            continue
        missed = violation(system.effects.hold, trial.rotations[last], trial.positions[last])
        near = missed <= farthest
        if slope == np.inf:
            enough = True
        elif slope >= 0.0:
            left = residual_of(system, trial) + missed / np.sum(system.lengths)
            enough = left <= (1.0 - _NEARER * fraction) * error
        else:
            enough = new <= energy + 1e-4 * fraction * slope
        if near and (enough or abs(fraction * slope) < 100 * noise):
            return fraction, new, new_noise, blocked
        fraction *= 0.5
    return 0.0, energy, noise, blocked


@kernel
def advance(system, q, step, fraction, out):
    """Fill out (m, 3) with q (m, 3) moved by a fraction of `step` (m, 3), to first order.

    Torsion turns all that lies beyond about the DLO's axis. A DLO whose torsion is soft turns so
    by large angles while its axis hardly moves: its curvature stays in the world and turns in its
    material frame. A straight line of the unknowns leaves that way with the square of the angle.
    So the curvature of a DLO that bends alike in all directions is turned back by the angle.
    """
    out[:] = q + fraction * step
    if not _spins_freely(system):
        return
    values = np.empty((system.lengths.size, 3))
    angle = 0.0
    for e in range(system.lengths.size):
        h = system.lengths[e]
        turn = h * system.scale[e, 0] * fraction * at_element(system.basis, step, e, 0)
        if e == 0 and hinged(system):
            turn = 0.0
        middle = angle + 0.5 * turn
        angle += turn
        k1, k2 = at_element(system.basis, q, e, 1), at_element(system.basis, q, e, 2)
        d1 = at_element(system.basis, out, e, 1) - middle * k2
        d2 = at_element(system.basis, out, e, 2) + middle * k1
        c, s = np.cos(middle), np.sin(middle)
        values[e, 0] = at_element(system.basis, out, e, 0)
        values[e, 1] = c * d1 + s * d2
        values[e, 2] = c * d2 - s * d1
        if system.basis.shape[1]:
            values[e] *= h
    project(system.basis, values, out)


@kernel
def _spins_freely(system):
    """Return whether a DLO is round and naturally straight, so that turning it costs nothing."""
    if system.effects.plastic.share.shape[0]:
        return False
    for e in range(system.lengths.size):
        stiffness, natural = system.stiffness[e], system.natural[e]
        if (abs(stiffness[1] - stiffness[2]) > _ALIKE * stiffness[1]
                or abs(natural[1]) + abs(natural[2]) > 0.0):
            return False
    return True
