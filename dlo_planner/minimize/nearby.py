# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A minimum that is known to be near: Newton's method that keeps its factorization.

A step of a motion begins so near to its end that the Hessian hardly changes on the way. So each
further step uses the one there is as long as the gradient vanishes quickly (Kelley, Iterative
Methods for Linear and Nonlinear Equations, ch. 5: the chord method). What is not quite so simple is
left to `minimize.newton`, with all its guards.
"""

import numpy as np

from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.decrement import relative_decrement
from dlo_planner.minimize.linear import (
    assembled_definite,
    at_once,
    is_definite,
    largest_turn,
    new_hessian,
    solve,
)
from dlo_planner.minimize.newton import without_traces
from dlo_planner.minimize.residual import residual_of
from dlo_planner.minimize.spectrum import lowest_mode
from dlo_planner.ritz.arrays import put_sum

_FEW = 8            # steps in which it has to be found
_LESS = 0.5         # of the gradient that a step leaves at most
_NEAR = 0.05        # rad, of any node: the first step of a search that is short
_QUICK = 0.05       # what a chord has to leave of the gradient at most, or the Hessian is renewed
_ROUNDED = 10.0     # tolerances: what a step does not make less there is rounding
SETTLED_NEARBY = 1e-9  # of the decrement: the same, where inertia is stiff
WELL_STABLE = 0.01  # the smallest eigenvalue at least, or `newton` looks closely
_PER_TURN = 100.0   # change of an eigenvalue per rad since the Hessian was factorized, at most
_DOUBT = 0.5         # of an eigenvalue: with more it is looked at again at once
_ROUGHLY = 1e-2     # relative error of that eigenvalue


@kernel
def nearby(system, q, tolerance, check=True):
    """Return the minimum next to q (m, 3), if it is as near as a motion's step is.

    Args:
        system: System
        q: start, scaled unknowns; not changed
        tolerance: of the residual
        check: whether its stability is looked at

    Returns
    -------
        found: whether there is one, well stable; if not, only `steps` means anything
        state: there
        residual: scaled gradient, or the decrement where that alone tells
        stability: smallest eigenvalue, to about 1 % of itself; infinite if it is proved to be well
            above zero without being found; nan if not `check`
        steps: made
    """
    state, trial = new_state(system), new_state(system)
    hessian = new_hessian(system)
    step = np.empty_like(state.q)
    without_traces(q, state.q)
    evaluate(system, state)
    residual = residual_of(system, state)
    steps, turned, fresh = 0, np.inf, False
    while residual >= tolerance:
        renewed, guessed = not fresh, False
        if renewed:
            if not assembled_definite(system, state, hessian, 0.0):
                guessed = steps == 0 and definite_without_forces(system, state, hessian)
                if not guessed:
                    return False, state, residual, np.nan, steps
            fresh, turned = True, 0.0
        solve(system, hessian, state.gradient, step)
        turned += largest_turn(system, hessian, step)
        put_sum(state.q, -1.0, step, trial.q)
        evaluate(system, trial)
        steps += 1
        before, residual = residual, residual_of(system, trial)
        if not residual < _LESS * before:
            told = np.inf if guessed else relative_decrement(system, state, step)
            if before < _ROUNDED * tolerance or told < SETTLED_NEARBY:
                residual = min(before, told)
                break
            if renewed or steps == _FEW:
                return False, state, residual, np.nan, steps
            residual, fresh = before, False  # the forces were others where it was factorized
            continue
        if not turned < _NEAR or steps == _FEW:
            return False, state, residual, np.nan, steps
        fresh = residual < max(_QUICK * before, tolerance) and not guessed
        if guessed:
            turned = np.inf  # whether the DLO is stable there is not known from it
        state, trial = trial, state
    if not check:
        return True, state, residual, np.nan, steps
    stability = _stability(system, state, hessian, turned)
    return stability > WELL_STABLE, state, residual, stability, steps


@kernel
def _stability(system, state, hessian, turned):
    """Return the smallest eigenvalue, about; -inf if there is a negative one; inf as `nearby`.

    Args:
        turned: rad since the Hessian was factorized, at most
    """
    bound = WELL_STABLE + _PER_TURN * turned
    if bound < WELL_STABLE + _DOUBT and _above(system, hessian, bound):
        return np.inf
    if not assembled_definite(system, state, hessian, 0.0):
        return -np.inf
    return lowest_mode(system, hessian, 0.0, _ROUGHLY)[0]


@kernel
def _above(system, hessian, bound):
    """Whether all eigenvalues of a definite Hessian are above `bound`; its factors may get lost.

    Where its blocks are at hand, pivots tell (Sylvester), for less than the smallest one costs.
    """
    if system.basis.shape[1] > 0 or at_once(system, hessian.displaced):
        return lowest_mode(system, hessian, 0.0, _ROUGHLY)[0] > bound
    return is_definite(system, hessian, -bound)


@kernel
def definite_without_forces(system, state, hessian):
    """Do what `assembled_definite` does, but leave out what forces do as the DLO turns.

    Where a motion is guessed not quite as long as the DLO is, inertia gives forces along it that
    are many times larger than the true ones, and may seem to make it buckle. One step without
    them (Gauss and Newton's) leads to where they are about right. They are forgotten.
    """
    for k in range(state.pull.shape[0]):
        for i in range(3):
            state.pull[k, i] = 0.0
    return assembled_definite(system, state, hessian, 0.0)
