# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A magnet at a place in the world and beads of iron or magnets on the DLO: a new term, worked out.

`test_new_term.py` adds it to a copy of the package, by the lines that any new term takes.

The field of a pole at p attracts each node with a weight w_k by the potential

    V = - sum of w_k / sqrt(|x_k - p|^2 + a^2)

(J; a is the pole's own size, w in J m, negative where it repels). It depends on where the gripper
is, unlike dead loads, and its second derivatives are springs between nodes and pole, negative along
the way to it: all that an effect on nodes can bring.
"""

from typing import Any

import numpy as np

from dlo_planner.geometry.kinematics import spring_at
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.supports import Pole, Surroundings  # type: ignore[attr-defined]


class Magnet(Record):
    """A pole, and what it attracts.

    Attributes
    ----------
    pole : ndarray, shape (3,)
        Its place in the world, m.
    size : float
        a, m.
    weight : ndarray, shape (N + 1,)
        w of the nodes, J m.
    """

    pole: Floats
    size: float
    weight: Floats


def made(surroundings: Surroundings, s: Floats) -> Magnet | None:
    """Return what a Pole among the loads of a simulator attracts: the node at its `s`, or the tip.

    Meshes have a node where a load has its `s`.
    """
    weight = np.zeros(s.size)
    for one in surroundings.other_loads:
        if isinstance(one, Pole):
            weight[-1 if one.s is None else np.abs(s - one.s).argmin()] = one.weight
            return Magnet(one.place, one.size, weight)
    return None


def needs(effect: Magnet) -> dict[str, Any]:
    """Return what the solver has to provide for: springs on nodes, so displacements matter."""
    return {'displaced': True, 'attached': True}


def hinged(effect: Magnet, _: float) -> Magnet:
    """Return the same with one more element before the first."""
    return effect._replace(weight=np.concatenate([[0.0], effect.weight]))


@kernel
def add_forces(effect, system, state):
    """Add dV/dx to `state.pull` and d2V to the springs; return V in J and the sum of its terms."""
    if effect is None:
        return 0.0, 0.0
    energy, size, arm = 0.0, 0.0, np.empty(3)
    for k in range(1, effect.weight.size):  # the first node is the gripper's
        square = effect.size**2
        for i in range(3):
            arm[i] = system.origin[i] + state.positions[k, i] - effect.pole[i]
            square += arm[i] * arm[i]
        part = effect.weight[k] / np.sqrt(square)
        energy -= part
        size += abs(part)
        spring = spring_at(state.attached, k)
        for i in range(3):
            state.pull[k, i] += part / square * arm[i]
            spring[i, i] += part / square
            for j in range(3):
                spring[i, j] -= 3.0 * part / square**2 * arm[i] * arm[j]
    return energy, size


@kernel
def potential(effect, system, positions):
    """Return V in J of a DLO at positions (N + 1, 3), world, m."""
    energy = 0.0
    if effect is None:
        return energy
    for k in range(1, effect.weight.size):
        square = effect.size**2
        for i in range(3):
            square += (positions[k, i] - effect.pole[i]) ** 2
        energy -= effect.weight[k] / np.sqrt(square)
    return energy
