# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bending and torsion, Eq. 2b, 2c: quadratic in the deviation from the natural strains.

Of a DLO that yields this is the part that never does; `energy.plastic` has the rest.
"""

from functools import cache

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


class Elastic(Record):
    """What is elastic of a DLO."""

    part: Floats  # (3,) part of the stiffness that never yields: all of it where nothing yields
    couple: Floats  # (N, 3) moments that pull at the strains, N m; (0, 3): none


@cache
def purely_elastic() -> Elastic:
    """Return the Elastic of a DLO that never yields."""
    return Elastic(np.ones(3), np.zeros((0, 3)))


def with_couples(elastic: Elastic, couple: Floats) -> Elastic:
    """Return an Elastic at whose strains the moments `couple` (N, 3) in N m pull as well."""
    before = elastic.couple if len(elastic.couple) else np.zeros_like(couple)
    return elastic._replace(couple=before + couple)


def hinged(effect: Elastic, _: float) -> Elastic:
    """Return the same with one more element before the first."""
    return effect._replace(couple=np.concatenate([effect.couple[:1] * 0.0, effect.couple]))


@kernel
def add_forces(effect, system, state):
    """Add dW/du to `state.slope`; return W in J, and the sum of the sizes of its terms."""
    lengths, natural, stiffness = system.lengths, system.natural, system.stiffness
    strains, slope, part, couple = state.strains, state.slope, effect.part, effect.couple
    energies = 0.0, 0.0, 0.0  # three sums: each addition waits for the one before
    for e in range(lengths.size):
        a, b, c = (strains[e, 0] - natural[e, 0], strains[e, 1] - natural[e, 1],
                   strains[e, 2] - natural[e, 2])
        x, y, z = (part[0] * (lengths[e] * stiffness[e, 0] * a),
                   part[1] * (lengths[e] * stiffness[e, 1] * b),
                   part[2] * (lengths[e] * stiffness[e, 2] * c))
        slope[e, 0] += x
        slope[e, 1] += y
        slope[e, 2] += z
        energies = energies[0] + x * a, energies[1] + y * b, energies[2] + z * c
    energy = 0.5 * (energies[0] + energies[1] + energies[2])
    size = energy
    for e in range(couple.shape[0]):
        for i in range(3):
            slope[e, i] -= lengths[e] * couple[e, i]
            work = lengths[e] * couple[e, i] * (strains[e, i] - natural[e, i])
            energy -= work
            size += abs(work)
    return energy, size


@kernel
def add_stiffness(effect, system, state, diagonal):
    """Add d2W by the scaled strains to diagonal (N, 3, 3)."""
    lengths, stiffness, scale, part = system.lengths, system.stiffness, system.scale, effect.part
    for e in range(lengths.size):
        for i in range(3):
            diagonal[e, i, i] += part[i] * (lengths[e] * stiffness[e, i] * scale[e, i] ** 2)


@kernel
def stored(effect, system, strains):
    """Return the energy that strains (N, 3) store, J."""
    lengths, natural, stiffness, part = (system.lengths, system.natural, system.stiffness,
                                         effect.part)
    energy = 0.0
    for e in range(lengths.size):
        for i in range(3):
            away = strains[e, i] - natural[e, i]
            energy += 0.5 * part[i] * (lengths[e] * stiffness[e, i] * away) * away
    return energy
