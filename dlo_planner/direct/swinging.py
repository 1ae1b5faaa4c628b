# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One step of a motion of a DLO that hangs freely, in one kernel: what `stepping` does otherwise.

Of a short step more time would be spent between kernels and on small arrays than in the search.
"""

import numpy as np

from dlo_planner.energy.effects import Needs, with_anchor
from dlo_planner.energy.inertia import Anchor
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.energy.system import System, unknown_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hanging import fallen
from dlo_planner.minimize.leash import no_leash
from dlo_planner.ritz.record import Record, makes


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
    drag : float
        Velocity per displacement in the Scheme, 1/s.
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
    drag: float
    slow: float
    viscous: float
    masses: np.ndarray


@makes(Coefficients)
@kernel
def _new_coefficients(alpha_m, alpha_f, beta, gamma, dt, stiffness, drag, slow, viscous, masses):
    return Coefficients(alpha_m, alpha_f, beta, gamma, dt, stiffness, drag, slow, viscous, masses)


@kernel
def swing(system, base, origin, how, nodes, bends, tolerance, max_iterations, check):
    """Return the shape at the end of a step, as `hang` does, and how the DLO moves then.

    Args:
        system: System of the DLO at rest, without obstacles, far end, plasticity
        base, origin: of the gripper at the end of the step, as in `hang`
        how: Coefficients
        nodes, bends: tuples of 4 arrays (N + 1, 3) and (N, 3), read-only, of a `Course`: position,
            velocity, acceleration and mean acceleration of the nodes and of the strains
        tolerance, max_iterations, check: as `newton`

    Returns:
        what `hang` returns, as a tuple
        velocity, acceleration, mean of the nodes; the same of the strains
        kinetic energy, J, and power that damping takes, W
    """
    where, speed = _without_force(how, nodes)
    bent, rate = _without_force(how, bends)
    strength = how.stiffness + how.slow * how.drag
    for k in range(where.shape[0]):
        for i in range(3):
            where[k, i] -= how.slow * speed[k, i] / strength + origin[i]
    firm = how.viscous * how.drag
    natural = np.empty_like(system.natural)
    for e in range(natural.shape[0]):
        for i in range(3):  # K b u' is a spring of its own, drawn to where u' = 0
            calm = bent[e, i] - rate[e, i] / how.drag
            natural[e, i] = (system.natural[e, i] + firm * calm) / (1 + firm)
    moving = System(system.lengths, natural, system.stiffness * (1 + firm), system.scale,
                    system.basis, base.copy(), origin.copy(),
                    with_anchor(system.effects, Anchor(where, how.masses * strength)),
                    Needs(how.masses.size > 0, system.needs.attached, system.needs.border),
                    system.proximal_point, system.proximal_weight)
    guess = np.empty_like(natural)
    for e in range(guess.shape[0]):
        for i in range(3):
            guess[e, i] = bends[0][e, i] + how.dt * (bends[1][e, i]
                                                     + 0.5 * how.dt * bends[2][e, i])
    q = np.empty((unknown_count(system), 3))
    unknowns_of(moving, guess, q)
    shape = fallen(moving, system, origin, q, tolerance, max_iterations, check, no_leash())
    of_nodes, of_bends = _course(how, nodes, shape[2]), _course(how, bends, shape[0])
    kinetic = viscous = 0.0
    for k in range(how.masses.size):
        for i in range(3):
            kinetic += 0.5 * how.masses[k] * of_nodes[0][k, i] ** 2
    for e in range(natural.shape[0]):
        for i in range(3):
            viscous += system.lengths[e] * system.stiffness[e, i] * of_bends[0][e, i] ** 2
    damping = 2 * how.slow * kinetic + how.viscous * viscous
    return shape, of_nodes, of_bends, kinetic, damping


@kernel
def _without_force(how, course):
    """Return position and velocity at the end of a step that feels no force, `Scheme.anchor`."""
    position, velocity = np.empty(course[0].shape), np.empty(course[0].shape)
    dt = how.dt
    for k in range(position.shape[0]):
        for i in range(3):
            mean = course[3][k, i]
            free = (how.alpha_f * course[2][k, i] - how.alpha_m * mean) / (1 - how.alpha_m)
            position[k, i] = (course[0][k, i] + dt * course[1][k, i]
                              + dt**2 * ((0.5 - how.beta) * mean + how.beta * free))
            velocity[k, i] = course[1][k, i] + dt * ((1 - how.gamma) * mean + how.gamma * free)
    return position, velocity


@kernel
def _course(how, course, position):
    """Return velocity, acceleration, mean at the end of a step, see `Scheme.after`."""
    anchor, velocity = _without_force(how, course)
    acceleration, mean = np.empty(position.shape), np.empty(position.shape)
    for k in range(position.shape[0]):
        for i in range(3):
            away = position[k, i] - anchor[k, i]
            acceleration[k, i] = how.stiffness * away
            velocity[k, i] += how.drag * away
            mean[k, i] = ((1 - how.alpha_f) * acceleration[k, i] + how.alpha_f * course[2][k, i]
                          - how.alpha_m * course[3][k, i]) / (1 - how.alpha_m)
    return velocity, acceleration, mean
