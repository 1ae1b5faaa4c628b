# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A minimum to which inertia draws a DLO from a start that is not near.

Places of a start that the DLO cannot take give forces along it that are many times larger than
the true ones, and the Hessian is not definite. A shift that outweighs them hinders all other
motions, and takes long to vanish. So those forces are left out where they are in the way (Gauss and
Newton's Hessian, which is always definite), and what is left is a descent. Where rounding errors
hide the gain, the simplified decrement has to fall (Deuflhard's natural monotonicity test).
"""

import numpy as np

from dlo_planner.energy.potential import at_element, evaluate, unknowns_of
from dlo_planner.energy.system import bending_energy, new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import dot
from dlo_planner.minimize.decrement import relative_decrement
from dlo_planner.minimize.linear import assembled_definite, largest_turn, new_hessian, solve
from dlo_planner.minimize.nearby import SETTLED_NEARBY, WELL_STABLE, definite_without_forces
from dlo_planner.minimize.newton import LARGEST_TURN, without_traces
from dlo_planner.minimize.residual import relative
from dlo_planner.minimize.spectrum import lowest_mode

_TRIALS = 12      # points on a step, each at half the way of the one before
_UNTOLD = 100.0   # rounding errors of the energy: a gain below these is not told by it
_FALLS = 0.5      # of the square of the decrement: what a step leaves of it then, at most


@kernel
def drawn_newton(system, q, tolerance, max_iterations, check):
    """Return the minimum that is reached from q (m, 3), as `nearby` does, or that there is none.

    Arguments as `nearby`, and the steps at most.
    """
    state, trial = new_state(system), new_state(system)
    hessian, step, correction = new_hessian(system), np.empty_like(q), np.empty_like(q)
    bend = bending_energy(system)
    without_traces(q, state.q)
    energy, noise = evaluate(system, state)
    residual = np.inf
    for steps in range(max_iterations):
        residual = relative(state, bend)
        whole = assembled_definite(system, state, hessian, 0.0)
        if not whole and not definite_without_forces(system, state, hessian):
            break
        solve(system, hessian, state.gradient, step)
        told = relative_decrement(system, state, step)
        if whole and (residual < tolerance or told < SETTLED_NEARBY):
            stability = np.nan
            if check:
                stability, _ = lowest_mode(system, hessian, 0.0, 1e-2)
            return not stability <= WELL_STABLE, state, min(residual, told), stability, steps
        slope = dot(state.gradient, step)
        fraction = min(1.0, LARGEST_TURN / max(largest_turn(system, hessian, step), 1e-300))
        falls = False
        for _ in range(_TRIALS):
            _put_turned(system, state, step, -fraction, trial.q)
            new, new_noise = evaluate(system, trial)
            falls = new <= energy - 1e-4 * fraction * slope
            if not falls and fraction * slope < _UNTOLD * noise:
                solve(system, hessian, trial.gradient, correction)
                falls = dot(trial.gradient, correction) < _FALLS * slope
                if not falls:
                    break
            if falls:
                state, trial, energy, noise = trial, state, new, new_noise
                break
            fraction *= 0.5
        if not falls:
            break
    return False, state, residual, np.nan, max_iterations


@kernel
def _put_turned(system, state, step, fraction, out):
    """Fill `out` (m, 3) with the unknowns of a State moved by a fraction of a step, to first order.

    Nothing resists torsion as inertia resists displacements, so all beyond may turn about its axis
    by angles whose square matters. Curvature stays in the world then: it is turned back.
    """
    strains, angle = np.empty((system.lengths.size, 3)), 0.0
    moved = np.empty(3)
    for e in range(system.lengths.size):
        for i in range(3):
            moved[i] = fraction * system.scale[e, i] * at_element(system.basis, step, e, i)
        turn = system.lengths[e] * moved[0]
        middle = angle + 0.5 * turn
        angle += turn
        one = state.strains[e, 1] + moved[1] - middle * state.strains[e, 2]
        other = state.strains[e, 2] + moved[2] + middle * state.strains[e, 1]
        c, s = np.cos(middle), np.sin(middle)
        strains[e, 0] = state.strains[e, 0] + moved[0]
        strains[e, 1] = c * one + s * other
        strains[e, 2] = c * other - s * one
    unknowns_of(system, strains, out)
