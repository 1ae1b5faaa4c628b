"""The hanging shape seen from its free end: one march, no iteration over the whole rod.

Nothing pulls at the free end, so force and moment are known there, and if the end's direction is
given, every element follows from the one before (an initial value problem). This is the exact
solution for a DLO whose free end alone is prescribed: where a threading begins.
"""

import numpy as np

from dlo_planner.energy.potential import placed
from dlo_planner.kernels import kernel
from dlo_planner.ritz.arc import jacobians, rotation_and_chord

_ROUNDS = 30


def hanging(system, end):
    """Return the State and the gripper's rotation (3, 3) that `march_from_end` finds.

    Args:
        system: without obstacles
        end: (3, 3) rotation of the free end
    """
    strains, base = march_from_end(system, end)
    return placed(system._replace(base=base), strains), base


@kernel
def march_from_end(system, end):
    """Return strains (N, 3) and gripper rotation (3, 3) in equilibrium, from the end's rotation.

    Args:
        system: its `base` is not used
        end: (3, 3) rotation of the free end
    """
    n = system.lengths.size
    lengths, natural, pull, stiffness = (system.lengths, system.natural, system.pull,
                                         system.stiffness)
    strains = np.empty((n, 3))
    rotation, start = end.copy(), np.empty((3, 3))
    turn, near, shifting = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    chord, phi, u, arm = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    force, moment = np.zeros(3), np.zeros(3)
    far_force, far_moment = np.empty(3), np.empty(3)  # in the frame of the element's far end
    own_force, own_moment = np.empty(3), np.empty(3)  # and of its near end
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        for i in range(3):
            force[i] += pull[e + 1, i]
            if e == n - 1:
                u[i] = natural[e, i]
            elif e < n - 2:
                u[i] = 2 * strains[e + 1, i] - strains[e + 2, i]
        _into_frame(rotation, force, far_force)
        _into_frame(rotation, moment, far_moment)
        for _ in range(_ROUNDS):
            for i in range(3):
                phi[i] = h * u[i]
            rotation_and_chord(phi[0], phi[1], phi[2], h, turn, chord)
            jacobians(phi, h, near, shifting)
            for i in range(3):
                own_force[i] = own_moment[i] = 0.0
                for j in range(3):
                    own_force[i] += turn[i, j] * far_force[j]
                    own_moment[i] += turn[i, j] * far_moment[j]
            change = 0.0
            for i in range(3):
                bend = 0.0
                for j in range(3):
                    bend += near[j, i] * own_moment[j] + shifting[j, i] * own_force[j]
                wanted = natural[e, i] - bend / stiffness[e, i]
                change = max(change, abs(wanted - u[i]))
                u[i] = wanted
            if change * h < 1e-15:
                break
        for i in range(3):
            strains[e, i] = u[i]
            phi[i] = h * u[i]
        rotation_and_chord(phi[0], phi[1], phi[2], h, turn, chord)
        for i in range(3):
            for j in range(3):
                start[i, j] = (rotation[i, 0] * turn[j, 0] + rotation[i, 1] * turn[j, 1]
                               + rotation[i, 2] * turn[j, 2])
        rotation[:] = start
        for i in range(3):
            arm[i] = (rotation[i, 0] * chord[0] + rotation[i, 1] * chord[1]
                      + rotation[i, 2] * chord[2])
        moment[0] += arm[1] * force[2] - arm[2] * force[1]
        moment[1] += arm[2] * force[0] - arm[0] * force[2]
        moment[2] += arm[0] * force[1] - arm[1] * force[0]
    return strains, rotation


@kernel
def _into_frame(rotation, vector, out):
    for j in range(3):
        out[j] = (rotation[0, j] * vector[0] + rotation[1, j] * vector[1]
                  + rotation[2, j] * vector[2])
