# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a shape in motion is to the end of its step, where inertia hides the residual.

The springs of inertia are stiffer by (own time of the DLO / step)^2 than the DLO is. Rounding
errors of places, times these, are forces which a residual relative to elasticity counts in full,
though they move nothing. Newton's decrement counts what they would move:

    decrement^2 = g^T H^-1 g = |dq|_H^2

is twice the energy that the next Newton step gains, whatever the unknowns are (Deuflhard, Newton
Methods for Nonlinear Problems, ch. 3). It is stated relative as the residual is, so both are the
same where H is elasticity's alone; rounding errors of places leave eps (own time / step) of it,
and not the square.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.system import State, System, bending_energy
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import dot
from dlo_planner.minimize.linear import assembled_definite, new_hessian, solve
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.model.arrays import Floats

SETTLED = 1e-8  # decrement that is promised


@kernel
def decrement_of(system: System, state: State) -> float:
    """Return Newton's decrement, relative as the residual; infinite where there is no minimum.

    With a held far end it is that of what the grip leaves free.
    """
    hessian, step = new_hessian(system), np.empty_like(state.q)
    if not assembled_definite(system, state, hessian, 0.0):
        return np.inf
    solve(system, hessian, state.gradient, step)
    return relative_decrement(system, state, step)


@kernel
def relative_decrement(system: System, state: State, step: Floats) -> float:
    """Return what `decrement_of` does; `step` (m, 3) is H^-1 times the gradient."""
    twice = max(dot(state.gradient, step), 0.0)
    return np.sqrt(twice / (dot(state.q, state.q) + bending_energy(system)))


def settled(found: Minimum) -> Minimum:
    """Return a Minimum of a step, its residual the decrement where that is as promised."""
    decrement = decrement_of(found.system, found.state)
    return found._replace(residual=decrement) if decrement < SETTLED else found
