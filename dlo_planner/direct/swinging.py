# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of a motion of a DLO that hangs freely, one after the other, in one kernel.

What `direct.stepping` does otherwise: of a short step more time would be spent between kernels and
on small arrays than in the search.
"""

from typing import Any

import numpy as np

from dlo_planner.direct.books import entered
from dlo_planner.direct.resisting import resisting
from dlo_planner.direct.trail import PAST, Coefficients, Trail
from dlo_planner.energy.effects import potential, stored
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.system import State, System, unknown_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.decrement import SETTLED, decrement_of
from dlo_planner.minimize.drawn import drawn_newton
from dlo_planner.minimize.leash import no_leash
from dlo_planner.minimize.nearby import nearby
from dlo_planner.minimize.newton import NEUTRAL, leashed_newton
from dlo_planner.minimize.workspace import new_workspace
from dlo_planner.model.arrays import Floats


@kernel
def swing_along(system: System, how: Coefficients, trail: Trail, books: Floats, limits: Floats,
                tolerance: float, max_iterations: int) -> int:
    """Fill rows of a Trail as long as each step is good; return the row of the last good one.

    The row after that, if there is one, is of a step that is not.

    Args:
        system: System of the DLO at rest, without obstacles, far end, plasticity
        how: Coefficients; trail: Trail
        books: (5,) of the motion so far: least balance, least and most potential energy, most
            kinetic energy, last balance, J; renewed
        limits: (4,) residual; local error, m; part of the energy that has moved which may be
            gained, and J in addition
        tolerance, max_iterations: as `newton`
    """
    for row in range(PAST + 1, trail.times.size):
        swing(system, how, trail, row, tolerance, max_iterations, tolerance > 0.0)
        account(system, how, trail, row)
        proof = trail.proofs[row]
        if not (proof[0] < limits[0] and proof[1] > -NEUTRAL and proof[2] <= limits[1]
                and entered(books, trail.energies[row], limits[2], limits[3])):
            return row - 1
    return trail.times.size - 1


@kernel
def swing(system: System, how: Coefficients, trail: Trail, row: int, tolerance: float,
          max_iterations: int, check: bool) -> None:
    """Fill a row of a Trail with the DLO at the end of a step, and how it moves then.

    `check` says whether its stability is looked at.
    """
    origin = trail.origins[row]
    moving = _drawn(system, how, trail, row)
    q = np.empty((unknown_count(system), 3))
    unknowns_of(moving, _guess(how, trail.bends, row, 1.0), q)
    found, state, residual, stability, iterations = nearby(moving, q, tolerance, check)
    if not found:
        _less_potential(how, trail.bends, row, moving, state, q)
        found, state, residual, stability, more = drawn_newton(moving, q, tolerance,
                                                               max_iterations, check)
        iterations += more
    if not found:
        state, residual, stability, more, _ = leashed_newton(
            moving, q, tolerance, max_iterations, check, no_leash(), new_workspace(moving))
        iterations += more
        if residual >= SETTLED:
            told = decrement_of(moving, state)
            residual = told if told < SETTLED else residual
    places, strains = trail.nodes[0, row], trail.bends[0, row]
    trail.frames[row] = state.rotations
    for k in range(places.shape[0]):
        for i in range(3):
            places[k, i] = state.positions[k, i] + origin[i]
    for e in range(strains.shape[0]):
        for i in range(3):
            strains[e, i] = state.strains[e, i]
    for i in range(3):
        trail.wrenches[row, i] = state.base_force[i]
        trail.wrenches[row, 3 + i] = state.base_moment[i]
    trail.proofs[row, 0], trail.proofs[row, 1] = residual, stability
    trail.iterations[row] = iterations
    _move_on(how, trail.nodes, row)
    _move_on(how, trail.bends, row)


@kernel
def account(system: System, how: Coefficients, trail: Trail, row: int) -> None:
    """Fill a row of a Trail with its energies and the local error of the step there."""
    nodes, bends, energies = trail.nodes, trail.bends, trail.energies
    power = then = 0.0
    for i in range(6):
        power += trail.wrenches[row, i] * trail.twists[row, i]
        # the forces of a step of first order are the same all the step long
        then += trail.wrenches[row, i] * trail.twists[row - 1, i]
    if how.gamma != 1.0:
        then = energies[row - 1, 4]
    elastic = stored(system.effects, system, bends[0, row])
    energies[row, 0] = elastic
    energies[row, 1] = elastic + potential(system.effects, system, nodes[0, row])
    energies[row, 2] = _kinetic(how, nodes, row)
    energies[row, 3] = energies[row - 1, 3] + 0.5 * how.dt * (then + power)
    energies[row, 4] = power
    energies[row, 5] = energies[row - 1, 5] + damped(system, how, nodes, bends, row)
    trail.proofs[row, 2] = how.third * third_difference(trail.times, nodes[0], row)


@kernel
def _kinetic(how: Coefficients, nodes: Floats, row: int) -> float:
    """Return the kinetic energy in a row, J."""
    kinetic = 0.0
    for k in range(how.masses.size):
        for i in range(3):
            kinetic += 0.5 * how.masses[k] * nodes[1, row, k, i] ** 2
    return kinetic


@kernel
def damped(system: System, how: Coefficients, nodes: Floats, bends: Floats, row: int) -> float:
    """Return the energy that damping takes at least in the step to a row, J.

    That is what it takes of an even motion from one end of the step to the other. Vibrations too
    quick for the step have rates at its ends that are not those on the way: of what they seem to
    take, the scheme takes next to nothing, and a motion would seem to gain it.
    """
    slow = quick = 0.0
    for k in range(how.masses.size):
        for i in range(3):
            slow += how.masses[k] * (nodes[0, row, k, i] - nodes[0, row - 1, k, i]) ** 2
    for e in range(system.lengths.size):
        for i in range(3):
            quick += system.lengths[e] * system.stiffness[e, i] * (
                bends[0, row, e, i] - bends[0, row - 1, e, i]) ** 2
    return (how.slow * slow + how.viscous * quick) / how.dt


@kernel
def set_off(system: System, calm: Coefficients, how: Coefficients, trail: Trail, going: bool,
            tolerance: float, max_iterations: int) -> None:
    """Fill row PAST of a Trail with how a DLO moves that grips and forces let go from there.

    Done there: velocities, accelerations, energies. Rows beyond are of very short steps, ahead and
    back; the grips are given in rows PAST to PAST + 3, the last one back in time.

    Args:
        system: System of the DLO at rest; trail: Trail of PAST + 4 rows
        calm, how: Coefficients of the short steps, without damping, with that of the rod
        going: whether velocities are to be made those that the grips allow
        tolerance, max_iterations: as `newton`
    """
    now, ahead, again, back = PAST, PAST + 1, PAST + 2, PAST + 3
    check = tolerance < 0.0  # False; a literal would be compiled for by itself
    courses = trail.nodes, trail.bends
    for course in courses:
        for k in range(course.shape[2]):
            for i in range(3):
                course[2, now, k, i] = course[3, now, k, i] = 0.0
                course[0, again, k, i], course[1, again, k, i] = (course[0, now, k, i],
                                                                  -course[1, now, k, i])
                course[2, again, k, i] = course[3, again, k, i] = 0.0
    if going:
        # what damps acts against either way: it would not cancel
        swing(system, calm, trail, ahead, tolerance, max_iterations, check)
        swing(system, calm, trail, back, tolerance, max_iterations, check)
        for course in courses:
            for k in range(course.shape[2]):
                for i in range(3):
                    course[1, now, k, i] = (course[0, ahead, k, i]
                                            - course[0, back, k, i]) / (2 * how.dt)
    swing(system, how, trail, ahead, tolerance, max_iterations, check)
    for course in courses:
        for k in range(course.shape[2]):
            for i in range(3):
                course[2, now, k, i] = course[3, now, k, i] = course[2, ahead, k, i]
    power = 0.0
    for i in range(6):
        power += trail.wrenches[ahead, i] * trail.twists[now, i]
    trail.energies[now, 4] = power
    trail.energies[now, 2] = _kinetic(how, trail.nodes, now)


@kernel
def third_difference(times: Floats, places: Floats, row: int) -> Any:
    """Return the largest divided difference of four places of a node, m/s^3.

    Args:
        times: (r,) s; places: (r, N + 1, 3), m, of which those up to `row` count
    """
    t0, t1, t2, t3 = times[row - 3], times[row - 2], times[row - 1], times[row]
    a = -1 / ((t1 - t0) * (t2 - t0) * (t3 - t0))
    b = 1 / ((t1 - t0) * (t2 - t1) * (t3 - t1))
    c = -1 / ((t2 - t0) * (t2 - t1) * (t3 - t2))
    largest = 0.0
    for k in range(places.shape[1]):
        square = 0.0
        for i in range(3):
            last = places[row, k, i]  # the sum of all four factors is zero
            square += (a * (places[row - 3, k, i] - last) + b * (places[row - 2, k, i] - last)
                       + c * (places[row - 1, k, i] - last)) ** 2
        if not square <= largest:  # what is not a number has to be seen, too
            largest = square
    return np.sqrt(largest)


@kernel
def _drawn(system: System, how: Coefficients, trail: Trail, row: int) -> System:
    """Return the System of a step: that of the DLO at rest, with inertia and damping."""
    where, speed = _without_force(how, trail.nodes, row)
    bent, rate = _without_force(how, trail.bends, row)
    strength = how.stiffness + how.slow * how.velocity_gain
    origin = trail.origins[row]
    for k in range(where.shape[0]):
        for i in range(3):
            where[k, i] -= how.slow * speed[k, i] / strength + origin[i]
    for e in range(bent.shape[0]):
        for i in range(3):
            bent[e, i] -= rate[e, i] / how.velocity_gain
    return resisting(system, how, where, bent, trail.bases[row], origin)


@kernel
def _less_potential(how: Coefficients, bends: Floats, row: int, moving: System, state: State,
                    q: Floats) -> None:
    """Keep `q` (m, 3), as guessed, or fill it as guessed of rates alone, whichever lies lower.

    Rates of strains change by vibrations too quick for the step, which tell nothing of its end.
    """
    state.q[:] = q
    before, _ = evaluate(moving, state)
    unknowns_of(moving, _guess(how, bends, row, 0.0), state.q)
    after, _ = evaluate(moving, state)
    if after < before:
        q[:] = state.q


@kernel
def _guess(how: Coefficients, bends: Floats, row: int, share: float) -> Floats:
    """Return the strains (N, 3) with which the search begins.

    `share` says how much of the change of their rates goes on.
    """
    guess = np.empty((bends.shape[2], 3))
    for e in range(guess.shape[0]):
        for i in range(3):
            guess[e, i] = bends[0, row - 1, e, i] + how.dt * (
                bends[1, row - 1, e, i] + share * 0.5 * how.dt * bends[2, row - 1, e, i])
    return guess


@kernel
def _without_force(how: Coefficients, course: Floats, row: int) -> tuple[Floats, Floats]:
    """Return position and velocity at the end of a step that feels no force, `Scheme.anchor`."""
    position, velocity = np.empty((course.shape[2], 3)), np.empty((course.shape[2], 3))
    dt = how.dt
    for k in range(position.shape[0]):
        for i in range(3):
            mean = course[3, row - 1, k, i]
            free = (how.alpha_f * course[2, row - 1, k, i] - how.alpha_m * mean) / (1 - how.alpha_m)
            position[k, i] = (course[0, row - 1, k, i] + dt * course[1, row - 1, k, i]
                              + dt**2 * ((0.5 - how.beta) * mean + how.beta * free))
            velocity[k, i] = course[1, row - 1, k, i] + dt * ((1 - how.gamma) * mean
                                                              + how.gamma * free)
    return position, velocity


@kernel
def _move_on(how: Coefficients, course: Floats, row: int) -> None:
    """Fill velocity, acceleration, mean at the end of a step, see `Scheme.after`."""
    anchor, velocity = _without_force(how, course, row)
    for k in range(anchor.shape[0]):
        for i in range(3):
            away = course[0, row, k, i] - anchor[k, i]
            acceleration = how.stiffness * away
            course[1, row, k, i] = velocity[k, i] + how.velocity_gain * away
            course[2, row, k, i] = acceleration
            course[3, row, k, i] = ((1 - how.alpha_f) * acceleration
                                    + how.alpha_f * course[2, row - 1, k, i]
                                    - how.alpha_m * course[3, row - 1, k, i]) / (1 - how.alpha_m)
