# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near a shape is to an equilibrium, and how near rounding errors let it come."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.effects import noise as noise_of_effects
from dlo_planner.energy.system import State, System, bending_energy
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import dot
from dlo_planner.ritz.attached import attached_forces

_EPS = 2.2e-16


@kernel
def residual_of(system: System, state: State) -> float:
    """Return the gradient's size, relative to the elastic energy and that of a 1 rad bend."""
    return relative(state, bending_energy(system))


@kernel
def relative(state: State, bend: float) -> float:
    """Return what `residual_of` does, of `bend` = `bending_energy`."""
    return np.sqrt(dot(state.gradient, state.gradient) / (dot(state.q, state.q) + bend))


@kernel
def gradient_noise(system: System, state: State) -> float:
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
