# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Leaving a saddle, or leaning to a side where a descent is about to fall to either."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.effects import blocks
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import State, System, new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.linear import assemble, largest_turn, new_hessian
from dlo_planner.minimize.spectrum import preferred
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arrays import copy, put_sum

KICK_TURN = 0.3  # rad, of a saddle along its lowest mode
_LEAN = 1e-5     # rad, of a DLO that is about to fall
_ALIKE = 0.5     # of the lower side's fall: a side that falls by more is as good


@kernel
def lean(system, hessian, state, trial):
    """Fill `trial` with the shape of `state` leant to the preferred side.

    Returns whether it can be, and what `evaluate` does.
    """
    preferred(system, trial.gradient)
    amount = _LEAN / largest_turn(system, hessian, trial.gradient)
    put_sum(state.q, amount, trial.gradient, trial.q)
    energy, noise = evaluate(system, trial)
    return not blocks(system.effects, system, state, trial), energy, noise


def kick(system: System, state: State, mode: Floats) -> Floats | None:
    """Return unknowns (m, 3) beside a saddle, on the lower side; None if no side is lower.

    Where both sides are about as low, it is the one to which the mode points.

    Parameters
    ----------
    system : System
        The DLO.
    state : State
        State at the saddle.
    mode : ndarray, shape (m, 3)
        Its lowest mode.
    """
    q = np.empty_like(mode)
    return q if kicked(system, state, mode, q) else None


@kernel
def kicked(system: System, state: State, mode: Floats, q: Floats) -> bool:
    """Fill q (m, 3) with what `kick` returns; return whether there is such a thing."""
    hessian, trial = new_hessian(system), new_state(system)
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
    return np.inf if blocks(system.effects, system, state, trial) else high
