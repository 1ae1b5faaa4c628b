# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Inertia, Eq. 12, 13: each mass is drawn to where it would be without forces.

Whatever the time integrator, a step minimizes the static potential plus

    W_dyn = sum of weight |x - anchor|^2 / 2

over the nodes; the integrator (`direct.integrator`) says where the anchors are and how strong.
The section's own rotational inertia is neglected (of order (d/L)^2).
"""

from typing import Any

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


class InertiaTerm(Record):
    """Where the masses of the nodes are drawn to."""

    place: Floats  # (N + 1, 3) relative to the gripper, m; (0, 3) without inertia
    weight: Floats  # (N + 1,) how strongly, N/m; (0,) without inertia


def no_inertia() -> InertiaTerm:
    """Return the InertiaTerm of a DLO at rest."""
    return InertiaTerm(np.zeros((0, 3)), np.zeros(0))


def needs(effect: InertiaTerm) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    return {'displaced': effect.weight.size > 0}


def hinged(effect: InertiaTerm, _: float) -> InertiaTerm:
    """Return the same with one more element before the first."""
    return InertiaTerm(*(np.concatenate([0.0 * one[:1], one])
                         for one in (effect.place, effect.weight)))


@kernel
def has_inertia(effect):
    """Whether inertia draws the DLO: it is in motion."""
    if effect is None:
        return False
    return effect.weight.size > 0


@kernel
def inertial_stiffness(effect):
    """Return how strongly all nodes together are drawn, N/m."""
    if effect is None:
        return 0.0
    return np.sum(effect.weight)


@kernel
def add_forces(effect, system, state):
    """Add dW/dx to `state.pull` and d2W to `state.weight`; return W in J, twice."""
    if effect is None:
        return 0.0, 0.0
    anchor, weight = effect.place, effect.weight
    positions, pull, total = state.positions, state.pull, state.weight
    energy = 0.0
    for k in range(weight.size):
        total[k] += weight[k]
        for i in range(3):
            away = positions[k, i] - anchor[k, i]
            pull[k, i] += weight[k] * away
            energy += 0.5 * weight[k] * away * away
    return energy, energy


@kernel
def roundoff(effect, system, state, length):
    """Return forces in N whose relative rounding errors the nodes' forces have."""
    forces = 0.0
    if effect is None:
        return forces
    for k in range(effect.weight.size):
        forces += effect.weight[k] * length
    return forces
