# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the kernel of steps reads and fills: a scheme of integration, and rows of instants."""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.ritz.record import Record, makes

PAST = 2  # rows before that of now: places of the nodes alone, which tell how exact a step is


class Coefficients(Record):
    """Of a `Scheme` of integration and of a DLO's damping, as kernels want them.

    Attributes
    ----------
    alpha_m : float
        Coefficient of the Scheme.
    alpha_f : float
        Coefficient of the Scheme.
    beta : float
        Coefficient of the Scheme.
    gamma : float
        Coefficient of the Scheme.
    dt : float
        Time step, s.
    stiffness : float
        Acceleration per displacement in the Scheme, 1/s^2.
    velocity_gain : float
        Velocity per displacement in the Scheme, 1/s.
    third : float
        Local error per divided difference of four places, s^3: `Scheme.third`.
    slow : float
        Damping in proportion to mass, 1/s.
    viscous : float
        Damping in proportion to stiffness, s.
    masses : ndarray, shape (N + 1,)
        Masses of the nodes, kg.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    dt: float
    stiffness: float
    velocity_gain: float
    third: float
    slow: float
    viscous: float
    masses: np.ndarray


@makes(Coefficients)
@kernel
def _new_coefficients(alpha_m: float, alpha_f: float, beta: float, gamma: float, dt: float,
                      stiffness: float, velocity_gain: float, third: float, slow: float,
                      viscous: float, masses: Floats) -> Coefficients:
    return Coefficients(alpha_m, alpha_f, beta, gamma, dt, stiffness, velocity_gain, third, slow,
                        viscous, masses)


class Trail(Record):
    """Instants of a motion, one in each of r rows; the first PAST are past, the next one is now.

    Attributes
    ----------
    times : ndarray, shape (r,)
        s.
    bases, origins, twists : ndarray, shape (r, 3, 3), (r, 3), (r, 6)
        Of the gripper: rotation, position, m, velocity, m/s, and angular velocity, rad/s.
    nodes : ndarray, shape (4, r, N + 1, 3)
        Position, velocity, acceleration and mean acceleration of the nodes: a `KinematicState`.
    bends : ndarray, shape (4, r, N, 3)
        The same of the strains.
    frames : ndarray, shape (r, N + 1, 3, 3)
        Rotations of the nodes.
    wrenches : ndarray, shape (r, 6)
        Of the gripper on the DLO.
    proofs : ndarray, shape (r, 3)
        Residual, stability, local error of the step there, m.
    iterations : ndarray, shape (r,)
        Of the search.
    energies : ndarray, shape (r, 6)
        Elastic, with the loads, kinetic; work and power of the gripper; what is lost to damping:
        J, W.
    """

    times: np.ndarray
    bases: np.ndarray
    origins: np.ndarray
    twists: np.ndarray
    nodes: np.ndarray
    bends: np.ndarray
    frames: np.ndarray
    wrenches: np.ndarray
    proofs: np.ndarray
    iterations: np.ndarray
    energies: np.ndarray


@makes(Trail)
@kernel
def _new_trail(times: Floats, bases: Floats, origins: Floats, twists: Floats, nodes: Floats,
               bends: Floats, frames: Floats, wrenches: Floats, proofs: Floats, iterations: Ints,
               energies: Floats) -> Trail:
    return Trail(times, bases, origins, twists, nodes, bends, frames, wrenches, proofs, iterations,
                 energies)
