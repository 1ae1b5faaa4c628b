# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Time integration: the family of schemes, and the compiled steps of a DLO that hangs freely.

Every scheme says where inertia draws a coordinate, and how strongly. All are members of one family
(generalized alpha: Chung and Hulbert 1993, for constrained bodies Arnold and Bruels 2007). The
acceleration at the end of a step is a linear function of the position there,
y'' = stiffness (y - anchor), so a step is a minimization (Eq. 9 to 11 of the paper), and that
acceleration is in balance with the forces at the same instant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, unknown_count
from dlo_planner.energy.terms import Structure, potential, stored, with_terms
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import SETTLED, decrement_of
from dlo_planner.minimize.hessian import LEAST_SHIFT, assembled_definite, safe_shift
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import (
    NEUTRAL,
    minimize,
    new_workspace,
    newton_descent,
    next_to,
    thorough,
)
from dlo_planner.model.arrays import Floats

_PER_STEP = 0.5  # of the energy that a motion may still gain


@kernel
def entered(books: Floats, energies: Floats, part: float, noise: float) -> bool:
    """Whether an instant has no more energy than there can be; if so, `books` (5,) has it.

    A step may use up half of what the motion may still gain: were it all, no later one could go on,
    however short it is.

    Args:
        books: renewed
        energies: of the instant, as of a Trail, J
        part, noise: of the energy that has moved which may be gained, and J in addition
    """
    static, kinetic, work, lost = energies[1], energies[2], energies[3], energies[5]
    balance = kinetic + static - work + lost
    left = allowed(books, energies, part, noise) - (books[4] - books[0])
    if not balance - books[4] <= max(_PER_STEP * left, 0.0):
        return False
    books[0], books[4] = min(books[0], balance), balance
    books[1], books[2] = min(books[1], static), max(books[2], static)
    books[3] = max(books[3], kinetic)
    return True


@kernel
def allowed(books: Floats, energies: Floats, part: float, noise: float) -> float:
    """Return the energy, J, that a motion may gain until an instant; arguments as `entered`."""
    low, high = min(books[1], energies[1]), max(books[2], energies[1])
    most: float = part * (max(books[3], energies[2]) + high - low + energies[5]) + noise
    return most


def given_back(books: Floats, balance: float, began: float) -> None:
    """Enter that the rates of an instant are renewed: what that adds is no gain of a step.

    As far as steps before have lost it. So a motion never has more than there was and was done.

    Parameters
    ----------
    books : ndarray, shape (5,)
        Changed.
    balance, began : float
        Balance with these rates, and where the motion began, J.
    """
    lost = max(began - books[4], 0.0)
    books[0] = min(books[0] + min(max(balance - books[4], 0.0), lost), balance)
    books[4] = balance


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


class Trail(Record):
    """Points in time of a motion, in r rows; the first PAST are past, the next one is now.

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


_EXACT = 1e-4  # relative error of the eigenvalue


@kernel
def resisting(system: Problem, how: Coefficients, where: Floats, calm: Floats, base: Floats,
               origin: Floats) -> Problem:
    """Return the Problem of a DLO at rest with masses drawn to `where` (N + 1, 3) from the gripper.

    Its damped springs are drawn to the strains `calm` (N, 3).
    """
    strength = how.stiffness + how.slow * how.velocity_gain
    firm = how.viscous * how.velocity_gain
    natural = np.empty_like(system.natural)
    for e in range(natural.shape[0]):
        for i in range(3):  # K b u' is a spring of its own, drawn to where u' = 0
            natural[e, i] = (system.natural[e, i] + firm * calm[e, i]) / (1 + firm)
    effects = system.effects
    return Problem(system.lengths, natural, system.stiffness * (1 + firm), system.scale,
                   system.basis, base, origin,
                   with_terms(effects, InertiaTerm(where, how.masses * strength), effects.hold,
                              effects.contact),
                   Structure(how.masses.size > 0, system.needs.attached, system.needs.border),
                   system.proximal_point, system.proximal_weight)


@kernel
def stability_at(system: Problem, how: Coefficients, base: Floats, origin: Floats, nodes: Floats,
                 bends: Floats) -> float:
    """Return the smallest eigenvalue of the Hessian that a step had at its end.

    How the DLO moves there tells what the step drew it to.

    Args:
        system, how: as of `swing_along`
        base: (3, 3), origin: (3,) of the gripper, read-only
        nodes: (4, N + 1, 3), bends: (4, N, 3) of a row of a Trail
    """
    where, calm = np.empty_like(nodes[0]), np.empty_like(bends[0])
    strength = how.stiffness + how.slow * how.velocity_gain
    for k in range(where.shape[0]):
        for i in range(3):
            force = nodes[2, k, i] + how.slow * nodes[1, k, i]  # per mass
            where[k, i] = nodes[0, k, i] - origin[i] - force / strength
    for e in range(calm.shape[0]):
        for i in range(3):
            calm[e, i] = bends[0, e, i] - bends[1, e, i] / how.velocity_gain
    # copied, since arrays that can be written are of another type: all else is compiled for them
    moving = resisting(system, how, where, calm, base.copy(), origin.copy())
    work = new_workspace(moving)
    unknowns_of(moving, bends[0], work.state.q)
    evaluate(moving, work.state)
    shift = 0.0
    if not assembled_definite(moving, work.state, work.hessian, shift):
        shift = safe_shift(moving, work.hessian, LEAST_SHIFT)
    value, _ = lowest_mode(moving, work.hessian, shift, _EXACT)
    stability: float = value
    return stability


@kernel
def swing_along(system: Problem, how: Coefficients, trail: Trail, books: Floats, limits: Floats,
                tolerance: float, max_iterations: int) -> int:
    """Fill rows of a Trail as long as each step is good; return the row of the last good one.

    The row after that, if there is one, is of a step that is not.

    Args:
        system: Problem of the DLO at rest, without obstacles, far end, plasticity
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
def swing(system: Problem, how: Coefficients, trail: Trail, row: int, tolerance: float,
          max_iterations: int, check: bool) -> None:
    """Fill a row of a Trail with the DLO at the end of a step, and how it moves then.

    `check` says whether its stability is looked at.
    """
    origin = trail.origins[row]
    moving = _drawn(system, how, trail, row)
    q = np.empty((unknown_count(system), 3))
    unknowns_of(moving, _guess(how, trail.bends, row, 1.0), q)
    work = new_workspace(moving)
    state, residual, stability, iterations, _, _, _ = newton_descent(
        moving, q, next_to(tolerance, 0.0, check, tolerance < 0.0), work)
    if residual == np.inf:  # it is not near
        _less_potential(how, trail.bends, row, moving, state, q)
        for attempt in range(2):  # without forces of inertia that are in the way; with them
            state, residual, stability, more, _, _ = minimize(
                moving, q, thorough(tolerance, 0.0, max_iterations, check, attempt == 0), work)
            iterations += more
            if SETTLED <= residual < np.inf:
                told = decrement_of(moving, state)
                residual = told if told < SETTLED else residual
            if residual < SETTLED:
                break
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
def account(system: Problem, how: Coefficients, trail: Trail, row: int) -> None:
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
def damped(system: Problem, how: Coefficients, nodes: Floats, bends: Floats, row: int) -> float:
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
def set_off(system: Problem, calm: Coefficients, how: Coefficients, trail: Trail, going: bool,
            tolerance: float, max_iterations: int) -> None:
    """Fill row PAST of a Trail with how a DLO moves that grips and forces let go from there.

    Done there: velocities, accelerations, energies. Rows beyond are of very short steps, ahead and
    back; the grips are given in rows PAST to PAST + 3, the last one back in time.

    Args:
        system: Problem of the DLO at rest; trail: Trail of PAST + 4 rows
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
def _drawn(system: Problem, how: Coefficients, trail: Trail, row: int) -> Problem:
    """Return the Problem of a step: that of the DLO at rest, with inertia and damping."""
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
def _less_potential(how: Coefficients, bends: Floats, row: int, moving: Problem,
                    state: Configuration, q: Floats) -> None:
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


INTEGRATORS = ('generalized_alpha', 'paper')


@dataclass(frozen=True)
class Scheme:
    """Coefficients of the family, for one step length dt in s."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    dt: float

    @classmethod
    def named(cls, name: str, dt: float, high_frequency: float = 0.85) -> Self:
        """Return the scheme `name` of INTEGRATORS.

        'generalized_alpha' is of second order; `high_frequency` is what one step leaves of the
        fastest vibrations (1: all of them), and slow ones are hardly damped. 'paper' is Eq. 8 to
        10: constant acceleration over a step, taken at its end; as a Newmark method beta = 1/2,
        gamma = 1, of first order, and it damps: a vibration of angular frequency w loses the part
        w dt / 4 of its amplitude per radian. 'euler' (for a `uniform` course) is the implicit one.
        """
        if name == 'euler':
            return cls(0.0, 0.0, 1.0, 1.0, dt)
        if name == 'paper':
            return cls(0.0, 0.0, 0.5, 1.0, dt)
        alpha_m = (2 * high_frequency - 1) / (high_frequency + 1)
        alpha_f = high_frequency / (high_frequency + 1)
        return cls(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2,
                   0.5 - alpha_m + alpha_f, dt)

    @property
    def first_order(self) -> bool:
        """Whether it is of first order only."""
        return self.gamma == 1.0

    @property
    def stiffness(self) -> float:
        """Acceleration at the end per distance from the anchor, 1/s^2: 2 / dt^2 in Eq. 9."""
        return (1 - self.alpha_m) / ((1 - self.alpha_f) * self.beta * self.dt**2)

    @property
    def velocity_gain(self) -> float:
        """Velocity at the end per distance from the anchor, 1/s."""
        return self.gamma / (self.beta * self.dt)

    def anchor(self, before: 'KinematicState') -> tuple[Floats, Floats]:
        """Return position and velocity (arrays) at the end of a step that feels no force."""
        dt = self.dt
        free = self._mean_acceleration(before, 0.0)
        position = (before.position + dt * before.velocity
                    + dt**2 * ((0.5 - self.beta) * before.mean + self.beta * free))
        velocity = before.velocity + dt * ((1 - self.gamma) * before.mean + self.gamma * free)
        return position, velocity

    def after(self, before: 'KinematicState', position: Floats) -> 'KinematicState':
        """Return the KinematicState at the end of a step that ends at `position`."""
        anchor, velocity = self.anchor(before)
        away = position - anchor
        acceleration = self.stiffness * away
        return KinematicState(position, velocity + self.velocity_gain * away, acceleration,
                              self._mean_acceleration(before, acceleration))

    def error(self, times: Sequence[float], positions: Sequence[Floats]) -> float:
        """Return the local error (m) of a step, to leading order: the largest of a node.

        What the scheme's position differs by from Taylor's series of the true one:
        (1/6 - beta - (alpha_f - alpha_m) / 2) dt^3 x'''. Accelerations are no measure of it: they
        are those that keep the DLO's length, and tell of changes of the step as well.

        Parameters
        ----------
        times : sequence
            Four times, s, the last one at the end of the step.
        positions : sequence
            4 arrays (N + 1, 3) at these times, m.
        """
        return self.third * float(third_difference(np.array(times), np.array(positions), 3))

    @property
    def third(self) -> float:
        """Local error per divided difference of four places, s^3, see `error`."""
        return 6 * abs(1 / 6 - self.beta - 0.5 * (self.alpha_f - self.alpha_m)) * self.dt**3

    def _mean_acceleration(self, before: 'KinematicState', acceleration: Floats | float) -> Floats:
        return ((1 - self.alpha_f) * acceleration + self.alpha_f * before.acceleration
                - self.alpha_m * before.mean) / (1 - self.alpha_m)


@dataclass(frozen=True)
class KinematicState:
    """A coordinate in motion: arrays of one shape.

    Attributes
    ----------
    position : ndarray
        At one instant.
    velocity : ndarray
        At one instant.
    acceleration : ndarray
        At one instant.
    mean : ndarray
        The acceleration averaged over the last step, as the scheme carries it along.
    """

    position: Floats
    velocity: Floats
    acceleration: Floats
    mean: Floats

    def __post_init__(self) -> None:
        for one in self.arrays:  # not `freeze`: there are thousands
            one.flags.writeable = False

    @property
    def arrays(self) -> tuple[Floats, ...]:
        """The four arrays."""
        return tuple(self.__dict__.values())

    @classmethod
    def of(cls, arrays: Floats) -> Self:
        """Return the course with the four parts of a read-only array (4, ...): quicker."""
        course = object.__new__(cls)
        course.__dict__.update(zip(_PARTS, arrays, strict=True))
        return course

    @classmethod
    def begun(cls, position: Floats, velocity: Floats, acceleration: Floats) -> Self:
        """Return the course of something that begins to move freely."""
        return cls(position, velocity, acceleration, acceleration)

    def uniform(self) -> Self:
        """Return the same course as if nothing accelerated it."""
        none = np.zeros_like(self.position)
        return replace(self, acceleration=none, mean=none)


_PARTS = tuple(item.name for item in fields(KinematicState))
