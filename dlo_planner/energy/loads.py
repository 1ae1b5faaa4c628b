# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Dead loads: gravity on the DLO's own mass and on the masses it carries, Eq. 2a, and others."""

from __future__ import annotations

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import Surroundings


class Load(Record):
    """Forces on the nodes that turn no way with the DLO."""

    # (N + 1, 3) derivative of their potential by the node positions, N: minus the forces
    pull: Floats


def hinged(effect: Load, _: float) -> Load:
    """Return the same with one more element before the first."""
    return Load(np.concatenate([0.0 * effect.pull[:1], effect.pull]))


@kernel
def add_forces(effect, system, state):
    """Add the loads to `state.pull`; return `dead_load`."""
    pull, total = effect.pull, state.pull
    for k in range(pull.shape[0]):
        for i in range(3):
            total[k, i] += pull[k, i]
    return dead_load(pull, state.positions)


@kernel
def potential(effect, system, positions):
    """Return the potential in J of a DLO at positions (N + 1, 3), world, m."""
    return dead_load(effect.pull, positions)[0]


def node_masses(rod: Rod, s: Floats) -> Floats:
    """Return the masses (N + 1,) in kg that stand for the rod on its nodes.

    Each element's own mass goes to its two nodes, as does a point mass to the two around it: the
    total and the center are right.
    """
    masses = rod.node_masses(s)
    masses[-1] += rod.tip_mass
    for where, mass in rod.point_masses:
        _share(masses, s, where, mass)
    return masses


def node_forces(surroundings: Surroundings, s: Floats) -> Floats:
    """Return the forces (N + 1, 3) in N on the nodes, of all loads but the weight.

    Shapes: s (N + 1,).
    """
    forces = np.zeros((s.size, 3))
    load = surroundings.load
    if callable(load):
        forces += surroundings.load_profile.on_nodes(s)
    elif load is not None:
        half = 0.5 * np.diff(s)[:, None] * load
        forces[:-1] += half
        forces[1:] += half
    for one in surroundings.dead_loads:
        _share(forces, s, s[-1] if one.s is None else one.s, one.force)
    return forces


def node_moments(surroundings: Surroundings, s: Floats) -> Floats:
    """Return the dead moments (N + 1, 3) in N m on the nodes.

    Shapes: s (N + 1,).
    """
    moments = np.zeros((s.size, 3))
    for one in surroundings.dead_loads:
        _share(moments, s, s[-1] if one.s is None else one.s, one.moment)
    return moments


def _share(nodes: Floats, s: Floats, where: float, amount: float | Floats) -> None:
    """Add an amount at arc length `where` to the two nodes around it, so that its place is kept."""
    e = min(max(int(np.searchsorted(s, where, side='right')) - 1, 0), s.size - 2)
    share = (where - s[e]) / (s[e + 1] - s[e])
    nodes[e] += (1 - share) * amount
    nodes[e + 1] += share * amount


@kernel
def dead_load(pull, positions):
    """Return V = sum of pull . x and sum |pull . x|, its rounding scale, both in J."""
    energy = 0.0
    size = 0.0
    for k in range(pull.shape[0]):
        part = (pull[k, 0] * positions[k, 0] + pull[k, 1] * positions[k, 1]
                + pull[k, 2] * positions[k, 2])
        energy += part
        size += abs(part)
    return energy, size
