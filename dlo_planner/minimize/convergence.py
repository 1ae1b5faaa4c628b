# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a shape is to an equilibrium, and how near rounding errors let it come.

Where inertia is stiff it hides the residual: its springs are stiffer by (own time of the DLO /
step)^2 than the DLO is. Rounding errors of places, times these, are forces which a residual
relative to elasticity counts in full, though they move nothing. Newton's decrement counts what they
would move:

    decrement^2 = g^T H^-1 g = |dq|_H^2

is twice the energy that the next Newton step gains, whatever the unknowns are (Deuflhard, Newton
Methods for Nonlinear Problems, ch. 3). It is stated relative as the residual is, so both are the
same where H is elasticity's alone; rounding errors of places leave eps (own time / step) of it,
and not the square.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.energy.inertia import has_inertia
from dlo_planner.energy.problem import Configuration, Problem, bending_energy
from dlo_planner.energy.terms import may_forbid, row_count
from dlo_planner.energy.terms import roundoff as noise_of_effects
from dlo_planner.geometry.kinematics import attached_forces
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hessian import assembled_definite, new_hessian, solve
from dlo_planner.minimize.kkt import dot


class Minimum(NamedTuple):
    """Where a descent ended, and what proves it to be a minimum, or not."""

    state: Configuration  # configuration there
    residual: float  # size of the scaled gradient
    # smallest eigenvalue of the Hessian, on what a grip leaves free; nan: not known
    stability: float
    iterations: int  # newton steps made, or those of another method
    kicks: int  # how often a saddle was left
    system: Problem  # problem with the multipliers of its constraints as they are at the end
    violation: float = 0.0  # by how much a constraint is violated, m
    evaluations: int = 0  # evaluations of the potential, where the method counts them


_EPS = 2.2e-16


@kernel
def residual_of(system: Problem, state: Configuration) -> float:
    """Return the gradient's size, relative to the elastic energy and that of a 1 rad bend."""
    return relative(state, bending_energy(system))


@kernel
def relative(state: Configuration, bend: float) -> float:
    """Return what `residual_of` does, of `bend` = `bending_energy`."""
    return np.sqrt(dot(state.gradient, state.gradient) / (dot(state.q, state.q) + bend))


@kernel
def gradient_noise(system: Problem, state: Configuration) -> float:
    """Return how large rounding errors may make the residual: a bound, relative as that is.

    A moment is a sum of forces times arms, and the force of a spring has the error of its ends'
    places: each at most eps times what is summed, once per node in the worst case and by its root
    where errors are as often up as down (Higham, Accuracy and Stability, ch. 2.8 and 3).
    """
    n, length = system.lengths.size, np.sum(system.lengths)
    forces = attached_forces(state.attached, length)
    forces += noise_of_effects(system.effects, system, state, length)
    for k in range(n + 1):
        for i in range(3):
            forces += abs(state.pull[k, i])
    lever = 0.0
    for e in range(n):
        for i in range(3):
            lever += (system.lengths[e] * system.scale[e, i]) ** 2
    if system.basis.shape[1]:
        lever *= n / length
    return (_EPS * np.sqrt(n) * forces * length
            * np.sqrt(lever / (dot(state.q, state.q) + bending_energy(system))))


CONVERGED = 1e-8   # residual that is promised
TOUCHING = 1e-7    # the same in contact: stiff springs multiply rounding errors
BLURRED = 1e-5     # a residual that rounding may make larger than this tells nothing


@kernel
def is_stationary(system: Problem, state: Configuration, residual: float,
                  rounding: float) -> bool:
    """Whether a residual is as small as is promised, or, with constraints, as rounding leaves it.

    Forces that rounding errors hide, of a DLO that is nearly taut, are no answer; of one in motion
    inertia tells where it is, however large these errors are. `rounding`: a hundredth of the error
    of the residual, where that is larger than usual.
    """
    touching = may_forbid(system.effects)
    promised = TOUCHING if touching else CONVERGED
    if has_inertia(system.effects.anchor) and residual < promised:
        return True
    left = residual - 100.0 * rounding
    if not touching and row_count(system.needs.border) == 0:
        return left < promised
    return as_rounded(left, gradient_noise(system, state), promised)


@kernel
def as_rounded(residual: float, noise: float, promised: float) -> bool:
    """Whether a residual is as small as promised, or as the `noise` that rounding may leave."""
    return residual < max(promised, noise) and noise < BLURRED


SETTLED = 1e-8  # decrement that is promised


@kernel
def decrement_of(system: Problem, state: Configuration) -> float:
    """Return Newton's decrement, relative as the residual; infinite where there is no minimum.

    Where the DLO is held it is that of what the grips leave free.
    """
    hessian, step = new_hessian(system), np.empty_like(state.q)
    if not assembled_definite(system, state, hessian, 0.0):
        return np.inf
    solve(system, hessian, state.gradient, step)
    twice = max(dot(state.gradient, step), 0.0)
    return np.sqrt(twice / (dot(state.q, state.q) + bending_energy(system)))


def accept_by_decrement(found: Minimum) -> Minimum:
    """Return a Minimum of a step, its residual the decrement where that is as promised."""
    decrement = decrement_of(found.system, found.state)
    return found._replace(residual=decrement) if decrement < SETTLED else found
