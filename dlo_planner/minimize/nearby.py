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
from dlo_planner.minimize.linear import assemble, factorize, largest_turn, new_hessian, solve
from dlo_planner.minimize.newton import without_traces
from dlo_planner.minimize.residual import residual_of
from dlo_planner.minimize.spectrum import lowest_mode
from dlo_planner.ritz.arrays import put_sum

_FEW = 8            # steps in which it has to be found
_LESS = 0.5         # of the gradient that a step leaves at most
_NEAR = 0.05        # rad, of any node: the first step of a search that is short
_QUICK = 0.05       # what a chord has to leave of the gradient at most, or the Hessian is renewed
_ROUNDED = 10.0     # tolerances: what a step does not make less there is rounding
_STABLE = 0.01      # the smallest eigenvalue at least, or `newton` looks closely
_PER_TURN = 100.0   # change of an eigenvalue per rad since the Hessian was factorized, at most
_DOUBT = 0.5         # of the eigenvalue: with more it is looked at again at once
_ROUGHLY = 1e-2     # relative error of that eigenvalue


@kernel
def nearby(system, q, tolerance):
    """Return the minimum next to q (m, 3), if it is as near as a motion's step is.

    Args:
        system: System
        q: start, scaled unknowns; not changed
        tolerance: of the residual

    Returns
    -------
        found: whether there is one, well stable; if not, only `steps` means anything
        state: there
        residual: scaled gradient
        stability: smallest eigenvalue, to about 1 % of itself
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
        if not fresh:
            assemble(system, state, hessian)
            if factorize(system, hessian, 0.0) > 0:
                return False, state, residual, np.nan, steps
            fresh, turned = True, 0.0
        solve(system, hessian, state.gradient, step)
        turned += largest_turn(system, hessian, step)
        put_sum(state.q, -1.0, step, trial.q)
        evaluate(system, trial)
        steps += 1
        before, residual = residual, residual_of(system, trial)
        if not residual < _LESS * before and before < _ROUNDED * tolerance:
            residual = before
            break
        if not (turned < _NEAR and residual < _LESS * before) or steps == _FEW:
            return False, state, residual, np.nan, steps
        fresh = residual < max(_QUICK * before, tolerance)
        state, trial = trial, state
    stability, doubt = -np.inf, _PER_TURN * turned
    if doubt < _DOUBT:  # the Hessian is of where it was factorized last
        stability, _ = lowest_mode(system, hessian, 0.0, _ROUGHLY)
    if not stability > _STABLE + doubt:
        assemble(system, state, hessian)
        if factorize(system, hessian, 0.0) > 0:
            return False, state, residual, np.nan, steps
        stability, _ = lowest_mode(system, hessian, 0.0, _ROUGHLY)
    return stability > _STABLE, state, residual, stability, steps
