# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The hanging shape from its free end: one integration, no iteration over the whole rod.

Force and moment are zero at the free end. If the end's direction is given, every element follows
from the one before (an initial value problem). This is the exact solution for a DLO whose free end
alone is prescribed, as where a threading begins.
"""

import numpy as np

from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.problem import Configuration, Problem
from dlo_planner.geometry.so3 import (
    applied,
    cross,
    matrix,
    plus,
    put_matrix,
    rotation_and_chord,
    slope,
    times_transposed,
    transposed_applied,
    vector,
)
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_ROUNDS = 30


def hanging(system: Problem, end: Floats) -> tuple[Configuration, Floats]:
    """Return the Configuration and the gripper's rotation (3, 3) that `integrate_from_tip` finds.

    Shapes: end (3, 3).
    """
    strains, base = integrate_from_tip(system, end)
    return configuration_at(system._replace(base=base), strains), base


@kernel
def integrate_from_tip(system: Problem, end: Floats) -> tuple[Floats, Floats]:
    """Return strains (N, 3) and gripper rotation (3, 3) in equilibrium, from the end's rotation.

    Args:
        system: its `base` is not used
        end: (3, 3) rotation of the free end
    """
    n = system.lengths.size
    lengths, natural, stiffness = system.lengths, system.natural, system.stiffness
    pull = system.effects.load.pull
    strains = np.empty((n, 3))
    frame, force, moment = matrix(end), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    u = np.empty(3)
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        force = plus(force, vector(pull[e + 1]))
        for i in range(3):
            if e == n - 1:
                u[i] = natural[e, i]
            elif e < n - 2:
                u[i] = 2 * strains[e + 1, i] - strains[e + 2, i]
        # in the frame of the element's far end
        far_force = transposed_applied(frame, force)
        far_moment = transposed_applied(frame, moment)
        for _ in range(_ROUNDS):
            turn, _ = rotation_and_chord(h * u[0], h * u[1], h * u[2], h)
            bend = slope(h * u[0], h * u[1], h * u[2], h, applied(turn, far_force),
                         applied(turn, far_moment))
            change = 0.0
            for i in range(3):
                wanted = natural[e, i] - bend[i] / stiffness[e, i]
                change = max(change, abs(wanted - u[i]))
                u[i] = wanted
            if change * h < 1e-15:
                break
        strains[e] = u
        turn, chord = rotation_and_chord(h * u[0], h * u[1], h * u[2], h)
        frame = times_transposed(frame, turn)
        moment = plus(moment, cross(applied(frame, chord), force))
    rotation = np.empty((3, 3))
    put_matrix(frame, rotation)
    return strains, rotation
