"""The hanging shape seen from its free end: one march, no iteration over the whole rod.

Nothing pulls at the free end, so force and moment are known there, and if the end's direction is
given, every element follows from the one before (an initial value problem). This is the exact
solution for a DLO whose free end alone is prescribed: where a threading begins.
"""

import numpy as np
from numba import njit

from dlo_planner.energy.potential import evaluate, new_state, unknowns_of
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


def placed(system, strains):
    """Return the State of a System with element strains (N, 3)."""
    state = new_state(system)
    unknowns_of(system, strains, state.q)
    evaluate(system, state)
    return state


@njit(cache=True)
def march_from_end(system, end):
    """Return strains (N, 3) and gripper rotation (3, 3) in equilibrium, from the end's rotation.

    Args:
        system: its `base` is not used
        end: (3, 3) rotation of the free end
    """
    n = system.lengths.size
    strains = np.empty((n, 3))
    rotation, start = end.copy(), np.empty((3, 3))
    turn, near, shifting = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    chord, phi, u = np.empty(3), np.empty(3), np.empty(3)
    own_force, own_moment = np.empty(3), np.empty(3)  # in the element's frame
    force, moment = np.zeros(3), np.zeros(3)
    stiffness, natural = system.stiffness, system.natural
    u[:] = natural[n - 1]
    for e in range(n - 1, -1, -1):
        h = system.lengths[e]
        for i in range(3):
            force[i] += system.pull[e + 1, i]
        for _ in range(_ROUNDS):
            for i in range(3):
                phi[i] = h * u[i]
            rotation_and_chord(phi[0], phi[1], phi[2], h, turn, chord)
            jacobians(phi, h, near, shifting)
            _before(rotation, turn, start)
            _seen(start, force, own_force)
            _seen(start, moment, own_moment)
            change = 0.0
            for j in range(3):
                pulled = 0.0
                for i in range(3):
                    pulled += near[i, j] * own_moment[i] + shifting[i, j] * own_force[i]
                wanted = natural[e, j] - pulled / stiffness[j]
                change = max(change, abs(wanted - u[j]))
                u[j] = wanted
            if change * h < 1e-15:
                break
        strains[e] = u
        rotation_and_chord(h * u[0], h * u[1], h * u[2], h, turn, chord)
        _before(rotation, turn, start)
        rotation[:] = start
        for i in range(3):  # the chord in world axes
            phi[i] = start[i, 0] * chord[0] + start[i, 1] * chord[1] + start[i, 2] * chord[2]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            moment[i] += phi[j] * force[k] - phi[k] * force[j]
    return strains, rotation


@njit(cache=True)
def _before(rotation, turn, start):
    """Fill start (3, 3) = rotation turn^T."""
    for i in range(3):
        for j in range(3):
            start[i, j] = (rotation[i, 0] * turn[j, 0] + rotation[i, 1] * turn[j, 1]
                           + rotation[i, 2] * turn[j, 2])


@njit(cache=True)
def _seen(frame, vector, out):
    """Fill out (3,) = frame^T vector."""
    for i in range(3):
        out[i] = frame[0, i] * vector[0] + frame[1, i] * vector[1] + frame[2, i] * vector[2]
