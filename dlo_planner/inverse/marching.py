"""The hanging shape seen from its free end: one march, no iteration over the whole rod.

Nothing pulls at the free end, so force and moment are known there, and if the end's direction is
given, every element follows from the one before (an initial value problem). This is the exact
solution for a DLO whose free end alone is prescribed: where a threading begins.
"""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.arc import jacobians, rotation_and_chord

_ROUNDS = 30


@kernel
def march_from_end(system, end):
    """Return strains (N, 3) and gripper rotation (3, 3) in equilibrium, from the end's rotation.

    Args:
        system: its `base` is not used
        end: (3, 3) rotation of the free end
    """
    n = system.lengths.size
    strains = np.empty((n, 3))
    rotation = end.copy()
    turn, near, shifting = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    chord = np.empty(3)
    force, moment = np.zeros(3), np.zeros(3)
    u = system.natural[n - 1].copy()
    for e in range(n - 1, -1, -1):
        h = system.lengths[e]
        force += system.pull[e + 1]
        for _ in range(_ROUNDS):
            rotation_and_chord(h * u[0], h * u[1], h * u[2], h, turn, chord)
            start = rotation @ turn.T
            jacobians(h * u, h, near, shifting)
            wanted = system.natural[e] - (near.T @ (start.T @ moment)
                                          + shifting.T @ (start.T @ force)) / system.stiffness
            change = np.max(np.abs(wanted - u))
            u = wanted
            if change * h < 1e-15:
                break
        strains[e] = u
        rotation_and_chord(h * u[0], h * u[1], h * u[2], h, turn, chord)
        rotation = rotation @ turn.T
        moment += np.cross(rotation @ chord, force)
    return strains, rotation
