# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Time integration: the family of schemes, and the one compiled loop that makes the steps.

Every scheme says where inertia draws a coordinate, and how strongly. All are members of one family
(generalized alpha: Chung and Hulbert 1993, for constrained bodies Arnold and Bruels 2007). The
acceleration at the end of a step is a linear function of the position there,
y'' = stiffness (y - anchor), so a step is a minimization (Eq. 9 to 11 of the paper), and that
acceleration is in balance with the forces at the same instant.

The loop is the same for all DLOs: what does not act (contact, a held far end, plasticity) is absent
from the Problem, and nothing of it is compiled. What a step leaves to the next one (reactions of
the grip, the plastic strain, forces and anchors of contacts) is kept in the rows of a StepBuffer.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.elastic import Elastic
from dlo_planner.energy.grip import HoldRows
from dlo_planner.energy.inertia import InertiaTerm
from dlo_planner.energy.plastic import add_plastic, yields
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    is_to_end,
    new_configuration,
    unknown_count,
)
from dlo_planner.energy.strands import (
    ROWS,
    escapes,
    new_touch,
    put_trial,
    renew_friction,
    rubbing_since,
    spring_energy,
    watching,
)
from dlo_planner.energy.terms import (
    Coupling,
    may_act,
    may_forbid,
    potential,
    stored,
)
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import Record, copy, replaced
from dlo_planner.geometry.so3 import matrix, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import enlarge_active_set
from dlo_planner.minimize.contact_table import touching
from dlo_planner.minimize.convergence import SETTLED, decrement_of
from dlo_planner.minimize.hessian import (
    LEAST_SHIFT,
    assembled_definite,
    inertia_correction,
    new_hessian,
)
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import (
    is_held,
    minimize,
    new_workspace,
    newton_descent,
    next_to,
    thorough,
)
from dlo_planner.minimize.solve import (
    is_equilibrium,
    obstructed_minimum,
    outcome,
    placed,
    with_set,
)
from dlo_planner.model.arrays import Bools, Floats, Ints

PAST = 2  # rows before that of now: places of the nodes alone, which tell how exact a step is

_PER_STEP = 0.5      # of the energy that a motion may still gain
AFTER = 4            # steps since an impact until the scheme is as ever
_LANDING = 1e-6      # of the length: what comes nearer to an obstacle by more in a step lands there
_GRAZING = 0.02      # rad: so it may come nearer where it slides along what is curved
_OF_WAY = 0.04       # of the way of a step where the DLO bears: what its error may be
STRAIGHT = 1e-9      # of the length: what is bent by less is straight to rounding
_EXACT = 1e-4        # relative error of an eigenvalue
# In so many elements at most a DLO that bears may be pressed in by no more than so many times the
# depth aimed at: one that is pressed along itself would be pushed out in the next step by forces of
# any size, with energy that nobody gave. On many it yields, and a depth of `kept` is gone soon.
_FEW, _PRESSED = 3, 100.0
# Pairs of strands are watched that may come to bear in a step: as far as both can move, with so
# many times the speed that they have, and as near as that, of the radius, beyond both radii
_WAYS, _WATCHED = 3.0, 0.5
# Friction between strands is limited by forces that it changes: searches of a step until these
# agree, and by how much they may differ, of the largest. Where inertia bears most each gains one
# digit or two; what does not end has jammed, and is freed by a shorter step
_SEARCHES, _AGREE = 6, 1e-4
ELASTIC, STATIC, KINETIC, WORK, DAMPED, DISSIPATED, FRICTION_LOSS, CONTACT_WORK = range(8)


class SchemeCoefficients(Record):
    """Of a `Scheme` of integration and of a DLO's damping, as kernels want them.

    `stiffness` is 2 / dt^2 in Eq. 9.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    dt: float             # s
    stiffness: float      # 1/s^2, acceleration per displacement
    velocity_gain: float  # 1/s, velocity per displacement
    third: float          # s^3, local error per divided difference of four places
    slow: float           # 1/s, damping in proportion to mass
    viscous: float        # s, damping in proportion to stiffness
    masses: Floats        # (N + 1,) kg, of the nodes


class StepOptions(Record):
    """How steps are solved, and until when they are good."""

    tolerance: float  # largest residual at the end of a search
    rounding: float   # what rounding errors may leave of it
    blurred: float    # the same as `tolerance` among obstacles, where Newton's decrement is judged
    ctol: float       # m, by how much a constraint may be violated: what is aimed at,
    kept: float       # and what still counts
    maxiter: int      # Newton steps at most
    nearby: bool      # whether a shape near the start is sought first, without all guards
    spring: float     # N/m, of contacts
    node: Ints        # (A,) which nodes are held,
    first: Ints       # (A + 1,) where the rows of each begin,
    share: Floats     # (A, 3) how much each axis counts: as of HoldRows
    slides: Bools     # (A,) whether the node slides along what holds it
    error: float      # m, largest local error
    bearing: float    # m, the same where the DLO bears on an obstacle and moves far,
    reach: float      # m, unless no node moves by more: then it may have any error there
    gain: float       # part of the energy that has moved which may be gained,
    noise: float      # and J in addition
    began: float      # J, energy balance when the motion began
    damps: bool       # whether a step that is not good otherwise may damp all vibrations
    follows: bool     # whether steps are short enough to follow vibrations
    rubs: float       # coefficient of friction between strands


class StepBuffer(Record):
    """Points in time of a motion, in r rows; the first PAST are past, the next one is now.

    A nodes are held, K motions of them; M bodies may be touched. Units: m, s, N, kg, rad, J.
    """

    times: Floats         # (r,)
    bases: Floats         # (r, 3, 3), (r, 3) of the gripper: rotation, position
    origins: Floats
    targets: Floats       # (r, A, 3), (r, A, 3, 3) of holds: position, rotation
    axes: Floats
    held: Floats          # (r, K, 6) what they hold, as of HoldRows
    reach: Floats         # (r,) by how much they may be missed; below zero: one is out of reach
    nodes: Floats         # (5, r, N + 1, 3) position, velocity, acceleration, means of the last
                          # and of velocities, as they change momenta
    bends: Floats         # (5, r, N, 3) the same of the strains
    frames: Floats        # (r, N + 1, 3, 3)
    wrenches: Floats      # (r, 6) of the gripper and (r, A, 6) of holds on the DLO
    hold_wrenches: Floats
    mean_wrenches: Floats # (r, 1 + A, 6) of all, as they change the momentum
    proofs: Floats        # (r, 4) residual, stability, local error, violation of constraints
    iterations: Ints      # (r,)
    evaluations: Ints     # (r,) of methods that count them
    energies: Floats      # (r, 8) at ELASTIC, STATIC (elastic and loads), KINETIC; WORK of the
                          # grips; lost by damping, plasticity, friction; CONTACT_WORK
                          # along the chords of steps
    converged: Bools      # (r,)
    impulsive: Ints       # (r,) how many steps more are not by the scheme itself, after an impact
    after_impact: Bools        # (r,) whether it bears, or has and steps were not exact since
    reactions: Floats     # (r, K) forces of holds
    plastic: Floats       # (r, N, J) plastic strain
    node_forces: Floats   # (r, M, N + 1)
    starts: Ints          # (3, r + 1) where points, contacts and pairs of strands that rub begin
                          # in what follows, of each row
    point_of: Ints        # (c, 2) element and obstacle; (c, 14) multiplier, fraction, anchor
    points: Floats        # (world), normal, shear, slid: as of `ContactPoints` after the step
    contact_of: Ints      # (c, 2) obstacle and element; (c, 15) what else `contact_rows` returns
    contacts: Floats
    rub_of: Ints          # (c, 2) pair of elements; (c, 4) its friction, N, and slip in the step,
    rubs: Floats          # m, as of `Strands`
    stopped: Bools        # (2,) after the last good step: no room for its contacts; something acts


# ------------------------------------------------------------------------------------------------
# The loop.


@kernel
def integrate(system: Problem, full: Problem, culled: bool, how: SchemeCoefficients,
              after: SchemeCoefficients, impact: SchemeCoefficients, buffer: StepBuffer,
              budget: Floats, options: StepOptions, guess: Floats) -> int:
    """Fill rows of a StepBuffer as long as each step is good; return the row of the last good one.

    The row after that, if there is one, is of a step that is not, unless the buffer says `stopped`.

    Args:
        system, full: Problem of the DLO at rest, and with all that may act; culled: whether
            `system` is without, and steps end where something acts
        how, impact, after: of the scheme; of an implicit Euler's, for steps in which something
            lands, since of an impulse a scheme that carries accelerations would make energy; of
            one of second order that forgets within few steps what quick vibrations impacts leave
        budget: (5,) of the motion so far: least balance, least and most potential energy, most
            kinetic energy, last balance, J; renewed
        guess: (N, 3) strains with which the first search begins, 1/m; (0, 3): extrapolated
    """
    worked = np.zeros(1)
    for row in range(PAST + 1, buffer.times.size):
        if is_to_end(worked, system, 4 * (1 + buffer.starts[1, row] - buffer.starts[1, row - 1])):
            return row - 1
        _take_step(system, how, after, impact, buffer, row, budget, options, guess)
        if culled:
            buffer.stopped[1] = may_act(full.effects, full, buffer.bends[0, row],
                                        buffer.nodes[0, row], buffer.nodes[0, row - 1])
        if buffer.stopped[0] or buffer.stopped[1] or not (
                buffer.converged[row] and is_good(buffer, row, budget, options)):
            return row - 1
    return buffer.times.size - 1


@kernel
def _bears(buffer, row):
    """Whether the DLO bears on an obstacle in a row."""
    return buffer.starts[1, row + 1] > buffer.starts[1, row]


@kernel
def _take_step(system, how, after, impact, buffer, row, budget, options, guess):
    """Fill a row: by `impact` where something lands, by `after` in a few steps after that.

    Also by `impact` where contacts have stirred up what is too quick for the step, or several grips
    have as they buckle the DLO, and `how` would make energy of it or cannot be solved.
    """
    left, trial = buffer.impulsive[row - 1], budget.copy()
    if how.gamma == 1.0 or left <= AFTER:
        buffer.impulsive[row] = max(left - 1, 0)
        scheme = after if left > 1 else how
        _solve_step(system, scheme, buffer, row, options, guess)
        account(system, scheme, how, buffer, row, options)
        stirred = _bears(buffer, row) or buffer.after_impact[row - 1]
        held = buffer.held.shape[1] > 0 and not _may_touch_itself(system.effects.strands)
        if how.gamma == 1.0 or not (stirred or held):
            return
        if not stirred or options.follows and not _lands(system, how, buffer, row):
            if left > 0:
                credit_renewal(trial, _balance(buffer.energies[row]), options.began, options.noise)
            good = buffer.converged[row] and is_good(buffer, row, trial, options)
            # Refuse, so that the step is halved: it may be good then. A straight DLO between grips
            # is not halved: it buckles in any step.
            buckles = not stirred and _must_buckle(system, buffer, row - 1)
            if good or not buckles and (not options.damps
                                        or not stirred and options.reach < np.inf):
                budget[:] = trial if good else budget
                return
    buffer.impulsive[row] = 1
    _solve_step(system, impact, buffer, row, options, guess)
    account(system, impact, how, buffer, row, options)
    buffer.impulsive[row] = AFTER + _lands(system, how, buffer, row)


@kernel
def _must_buckle(system, buffer, row):
    """Whether the DLO is held by several grips, and straight in a row: then it can only buckle."""
    return buffer.held.shape[1] > 0 and is_straight(buffer.nodes[0, row], np.sum(system.lengths))


@kernel
def is_straight(nodes: Floats, length: float) -> bool:
    """Whether no node of a DLO of a `length` (m), (N + 1, 3), is off the chord, but for rounding.

    That is, by STRAIGHT of the length.
    """
    last, square_of_chord = nodes.shape[0] - 1, 0.0
    for i in range(3):
        square_of_chord += (nodes[last, i] - nodes[0, i]) ** 2
    most = (STRAIGHT * length) ** 2 * square_of_chord
    for k in range(last):
        square = 0.0
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            square += ((nodes[k, j] - nodes[0, j]) * (nodes[last, m] - nodes[0, m])
                       - (nodes[k, m] - nodes[0, m]) * (nodes[last, j] - nodes[0, j])) ** 2
        if not square < most:
            return False
    return True


@kernel
def _lands(system, how, buffer, row):
    """Whether a contact in a row is of a point that was still coming when the step began."""
    nearer = _LANDING * np.sum(system.lengths) / how.dt
    for a in range(buffer.starts[1, row], buffer.starts[1, row + 1]):
        contact, e = buffer.contacts[a], buffer.contact_of[a, 1]
        part, out, square = contact[0] / system.lengths[e], 0.0, 0.0
        for i in range(3):
            speed = ((1.0 - part) * buffer.nodes[1, row - 1, e, i]
                     + part * buffer.nodes[1, row - 1, e + 1, i])
            out += contact[4 + i] * speed
            square += speed * speed
        if out < -nearer - _GRAZING * np.sqrt(square):
            return True
    return False


@kernel
def _solve_step(system, how, buffer, row, options, guess):
    """Fill the shape in a row, from one start or, if that fails, another."""
    check = options.tolerance > 0.0  # True; a literal would be compiled for by itself
    if guess.shape[0] and row == PAST + 1 and implicit_step(system, how, buffer, row, row - 1,
                                                            guess, options, check):
        return
    ahead = _guess(how, buffer.bends, row, 0.0 if buffer.impulsive[row] else 1.0)
    if implicit_step(system, how, buffer, row, row - 1, ahead, options, check):
        return
    if buffer.node_forces.shape[1] and not buffer.stopped[0]:
        # from where the DLO is known to be outside of obstacles
        implicit_step(system, how, buffer, row, row - 1, buffer.bends[0, row - 1].copy(), options,
                      check)


@kernel
def is_good(buffer, row, budget, options):
    """Whether a step is exact enough and gains no energy; if so, `budget` has it."""
    return (_is_exact(buffer, row, options) and _pushes_little(buffer, row, budget, options)
            and within_energy_budget(budget, buffer.energies[row], options.gain, options.noise))


@kernel
def _is_exact(buffer, row, options):
    """Whether the local error of a step is small enough.

    Where the DLO bears, and until it is small for the first time after that (which is entered in
    the row), it may also be a small part of the way of the step, and any in a short step:
    velocities leap where something lands, sticks or lifts off, and no shorter step tells more of a
    leap than when it is.
    """
    error = buffer.proofs[row, 2]
    exact = error <= options.error
    buffer.after_impact[row] = _bears(buffer, row) or buffer.impulsive[row] > 0 or (
        buffer.after_impact[row - 1] and not exact)
    if exact or not buffer.after_impact[row]:
        return exact
    way = _longest_way(buffer, row)
    return error <= min(options.bearing, _OF_WAY * way) or way <= options.reach


@kernel
def _longest_way(buffer, row):
    """Return the largest distance that a node moves in the step to a row, m."""
    longest = 0.0
    for k in range(buffer.nodes.shape[2]):
        square = 0.0
        for i in range(3):
            square += (buffer.nodes[0, row, k, i] - buffer.nodes[0, row - 1, k, i]) ** 2
        longest = max(longest, square)
    return np.sqrt(longest)


@kernel
def _pushes_little(buffer, row, budget, options):
    """Whether the work of contacts along the chords of steps is small.

    What the motion keeps of it in this step, and the energy that it has beyond what it began with,
    are each at most what it may gain.
    """
    energies, before = buffer.energies[row], buffer.energies[row - 1]
    push = energies[CONTACT_WORK] - before[CONTACT_WORK]
    # of it: the rest is lost in the same step
    kept = _mechanical(energies) - _mechanical(before)
    excess = _mechanical(energies) - options.began
    return push == 0.0 or max(min(push, kept), excess) <= allowed_gain(
        budget, energies, options.gain, options.noise)


@kernel
def lost(energies: Floats) -> float:
    """Return the energy lost so far, J, of a row of a StepBuffer's."""
    total: float = energies[DAMPED] + energies[DISSIPATED] + energies[FRICTION_LOSS]
    return total


@kernel
def within_energy_budget(budget: Floats, energies: Floats, part: float, noise: float) -> bool:
    """Whether an instant has no more energy than there can be; if so, `budget` (5,) has it.

    A step may use up half of what the motion may still gain, a `part` of the energy that has moved
    and `noise`, J: were it all, no later one could go on, however short it is.
    """
    balance = _balance(energies)
    left = allowed_gain(budget, energies, part, noise) - (budget[4] - budget[0])
    if not balance - budget[4] <= max(_PER_STEP * left, 0.0):
        return False
    budget[0], budget[4] = min(budget[0], balance), balance
    budget[1] = min(budget[1], energies[STATIC])
    budget[2] = max(budget[2], energies[STATIC])
    budget[3] = max(budget[3], energies[KINETIC])
    return True


@kernel
def allowed_gain(budget: Floats, energies: Floats, part: float, noise: float) -> float:
    """Return the energy, J, that a motion may gain until an instant; see `within_energy_budget`."""
    low, high = min(budget[1], energies[STATIC]), max(budget[2], energies[STATIC])
    most: float = part * (max(budget[3], energies[KINETIC]) + high - low + lost(energies)) + noise
    return most


@kernel
def credit_renewal(budget: Floats, balance: float, began: float, noise: float) -> bool:
    """Enter that the rates of an instant are renewed: what that adds is no gain of a step.

    As far as steps before have lost it. So a motion never has more than there was and was done. If
    it is more (but for `noise`, J) it is made up: return False.

    Shapes: budget (5,).
    """
    gained, spent = max(balance - budget[4], 0.0), max(began - budget[4], 0.0)
    if gained > spent + noise:
        return False
    budget[0] = min(budget[0] + min(gained, spent), balance)
    budget[4] = balance
    return True


@kernel
def _balance(energies):
    """Return the energy that is there, less what was put in, plus what was taken out, J."""
    return _mechanical(energies) - energies[CONTACT_WORK]


@kernel
def _mechanical(energies):
    """Return the same, J, with the work of contacts along the chords of steps."""
    return energies[KINETIC] + energies[STATIC] - energies[WORK] + lost(energies)


# ------------------------------------------------------------------------------------------------
# One step: the potential that it minimizes, the search, and what it leaves.


@kernel
def implicit_step(system: Problem, how: SchemeCoefficients, buffer: StepBuffer, row: int,
                  memory: int, guess: Floats, options: StepOptions, check: bool) -> bool:
    """Fill a row with the DLO at the end of a step; return whether it is an equilibrium.

    What steps before have left is in row `memory`; `check`: whether its stability is looked at.
    """
    problem = step_problem(system, how, buffer, row, memory, options)
    q = np.empty((unknown_count(system), 3))
    unknowns_of(problem, guess, q)
    if _is_blocked(system.effects.contact, problem, buffer, row, q):
        state = new_configuration(problem)
        state.q[:] = q
        evaluate(problem, state)
        record_step(how, problem, state, buffer, row, memory, np.inf, np.nan, 0, np.inf, options)
        return False
    state, residual, stability, iterations, loaded, violation = _minimum(
        system.effects.contact, problem, how, q, buffer, row, memory, options, check)
    for search in range(_SEARCHES):
        changed = renew_friction(problem.effects.strands, problem.lengths, state,
                                 buffer.nodes[0, memory], buffer.frames[memory], options.rubs)
        if changed <= _AGREE or residual == np.inf:
            break
        if search == _SEARCHES - 1:
            residual = np.inf
            break
        q[:] = state.q
        state, residual, stability, more, loaded, violation = _minimum(
            system.effects.contact, problem, how, q, buffer, row, memory, options, check)
        iterations += more
    if _escapes(problem.effects.strands, problem, buffer, row, state):
        residual = np.inf
    return record_step(how, loaded, state, buffer, row, memory, residual, stability, iterations,
                       violation, options)


@kernel
def step_problem(system: Problem, how: SchemeCoefficients, buffer: StepBuffer, row: int,
                 memory: int, options: StepOptions) -> Problem:
    """Return the Problem of a step: that of the DLO at rest, with inertia and damping.

    Its memory is that of row `memory`.
    """
    where, speed = _without_force(how, buffer.nodes, row)
    bent, rate = _without_force(how, buffer.bends, row)
    strength = how.stiffness + how.slow * how.velocity_gain
    origin = buffer.origins[row]
    for k in range(where.shape[0]):
        for i in range(3):
            where[k, i] -= how.slow * speed[k, i] / strength + origin[i]
    for e in range(bent.shape[0]):
        for i in range(3):
            bent[e, i] -= rate[e, i] / how.velocity_gain
    drawn = incremental_potential(_remembering(system, buffer, row, memory, options), how, where,
                                  bent, buffer.bases[row], origin)
    return _with_strands(system.effects.strands, drawn, how, buffer, row, memory, options)


@kernel
def _with_strands(strands, problem, how, buffer, row, memory, options):
    """Return the same Problem with the pairs of strands that may come to bear in the step."""
    if strands is None:
        return problem
    if strands.strand_radius.size == 0:
        return problem
    farthest = 0.0
    for k in range(buffer.nodes.shape[2]):
        square = 0.0
        for i in range(3):
            square += buffer.nodes[1, memory, k, i] ** 2
        farthest = max(farthest, how.dt * np.sqrt(square))
    near = watching(strands, problem.lengths, buffer.bends[0, memory],
                    _rays(problem, strands, buffer, row), buffer.nodes[0, memory],
                    _WAYS * farthest + _WATCHED * np.max(strands.strand_radius))
    if options.rubs > 0.0:
        begin, end = buffer.starts[2, memory], buffer.starts[2, memory + 1]
        near = rubbing_since(near, problem.lengths, buffer.rub_of[begin:end],
                             buffer.rubs[begin:end], buffer.nodes[0, memory],
                             buffer.frames[memory], options.rubs)
    most, needs = ROWS * near.pair.shape[0], problem.needs
    coupling = Coupling(np.empty((most, 0, 3)), np.empty((most, 0, 3)), np.empty(most),
                        np.empty((0, 0)), np.zeros(1, dtype=np.int64))
    return replaced(problem, 'effects', replaced(problem.effects, 'strands', near),
                    'needs', replaced(needs, 'coupling', coupling))


@kernel
def _rays(problem, strands, buffer, row):
    """Return the rays (2, 3) of Strands with the grips of a row; zeros where there are none."""
    rays, length = np.zeros((2, 3)), np.sum(problem.lengths)
    if buffer.axes.shape[1] and np.any(strands.rays != 0.0):
        for i in range(3):
            rays[0, i] = length * buffer.bases[row, i, 0]
            rays[1, i] = length * buffer.axes[row, buffer.axes.shape[1] - 1, i, 0]
    return rays


@kernel
def _escapes(strands, problem, buffer, row, state):
    """Whether the DLO passes through itself, or touches unwatched, from the row before to here."""
    if strands is None:
        return False
    if strands.strand_radius.size == 0:
        return False
    before = buffer.nodes[0, row - 1] - buffer.origins[row - 1]
    return escapes(strands, problem, _rays(problem, strands, buffer, row - 1), before, state)


@kernel
def incremental_potential(system: Problem, how: SchemeCoefficients, where: Floats, calm: Floats,
                          base: Floats, origin: Floats) -> Problem:
    """Return the Problem of a DLO at rest with masses drawn to `where` (N + 1, 3) from the gripper.

    Its damped springs are drawn to the strains `calm` (N, 3): K b u' is a spring of its own, drawn
    to where u' = 0. What cannot yield is one spring with it; else it stands beside.
    """
    strength = how.stiffness + how.slow * how.velocity_gain
    firm = how.viscous * how.velocity_gain
    natural, couple = system.natural.copy(), system.effects.elastic.couple
    part, stiffer = system.effects.elastic.part, 1.0 + firm
    if firm > 0.0 and yields(system.effects.plastic):
        couple = np.zeros_like(natural)
        for e in range(natural.shape[0]):
            for i in range(3):
                couple[e, i] = firm * system.stiffness[e, i] * (calm[e, i] - natural[e, i])
        part, stiffer = part + firm, 1.0
    else:
        for e in range(natural.shape[0]):
            for i in range(3):
                natural[e, i] = (natural[e, i] + firm * calm[e, i]) / (1 + firm)
    effects = system.effects
    effects = replaced(effects, 'elastic', Elastic(part, couple),
                       'anchor', InertiaTerm(where, how.masses * strength))
    return replaced(system, 'natural', natural, 'stiffness', system.stiffness * stiffer,
                    'base', base, 'origin', origin, 'effects', effects,
                    'needs', replaced(system.needs, 'displaced', how.masses.size > 0))


@kernel
def _remembering(system, buffer, row, memory, options):
    """Return the Problem of the DLO at rest in the grips of a row, with what steps have left."""
    begin, end = buffer.starts[0, memory], buffer.starts[0, memory + 1]
    return placed(system, system.base, buffer.origins[row],
                  _with_holds(system.effects.hold, buffer, row, memory, options), options.spring,
                  buffer.plastic[memory], buffer.node_forces[memory],
                  buffer.point_of[begin:end], buffer.points[begin:end])


@kernel
def _with_holds(hold, buffer, row, memory, options):
    """Return the HoldRows in a row; None for None."""
    if hold is None:
        return hold
    target = buffer.targets[row] - buffer.origins[row]
    return HoldRows(options.node, options.first, target, buffer.axes[row].copy(), options.share,
                    buffer.held[row].copy(), buffer.reactions[memory].copy(), hold.stiffness,
                    hold.turn_stiffness)


@kernel
def _is_blocked(contact, problem, buffer, row, q):
    """Whether an obstacle is between the shape in the row before and the unknowns q (m, 3)."""
    if contact is None:
        return False
    if contact.scene.kind.size == 0:
        return False
    state = new_configuration(problem)
    state.q[:] = q
    evaluate(problem, state)
    return _sweeps(problem, buffer, row, state)


@kernel
def _sweeps(problem, buffer, row, state):
    """Whether an obstacle is between the shape in the row before and a Configuration."""
    old, origin = np.empty_like(state.positions), buffer.origins[row]
    for k in range(old.shape[0]):
        for i in range(3):
            old[k, i] = buffer.nodes[0, row - 1, k, i] - origin[i]
    return sweeps_through(problem.effects.contact.scene, problem.lengths, buffer.bends[0, row - 1],
                          buffer.frames[row - 1], old, state.rotations, state.positions)


@kernel
def _minimum(contact, problem, how, q, buffer, row, memory, options, check):
    """Seek the minimum from q (m, 3): what is near first, if nothing touches before and after."""
    if contact is None:
        return _unobstructed(problem, how, q, buffer, row, memory, options, check)
    if contact.scene.kind.size == 0:
        return _unobstructed(problem, how, q, buffer, row, memory, options, check)
    if options.nearby and not _bears(buffer, memory):
        state, residual, stability, iterations, _, _, missed = newton_descent(
            problem, q, next_to(options.tolerance, options.ctol, check, is_held(problem)),
            new_workspace(problem))
        if residual < np.inf and not _touches(problem, state) and not _sweeps(problem, buffer, row,
                                                                              state):
            return state, residual, stability, iterations, problem, missed
        _take_back(problem.effects.hold, buffer, memory)
    state, residual, stability, iterations, _, loaded, violation = obstructed_minimum(
        problem, q, options.blurred, options.ctol, options.maxiter, check,
        buffer.nodes[0, memory], buffer.frames[memory, :, :, 0])
    residual = _or_decrement(loaded, state, residual)
    return state, residual, stability, iterations, loaded, violation


@kernel
def _touches(problem, state):
    """Whether any contact bears at a Configuration, or would: between nodes, too."""
    contact = problem.effects.contact
    if touching(contact.scene, contact.contacts, problem.lengths, state).gap.size > 0:
        return True
    _, joins = enlarge_active_set(problem, state)
    return joins


@kernel
def _unobstructed(problem, how, q, buffer, row, memory, options, check):
    """Do what `_minimum` does, without obstacles: what is near, else with all guards."""
    work, held, tolerance = new_workspace(problem), is_held(problem), options.tolerance
    state, residual, stability, iterations, missed = work.state, np.inf, np.nan, 0, np.inf
    if options.nearby:
        state, residual, stability, iterations, _, _, missed = newton_descent(
            problem, q, next_to(tolerance, options.ctol, check, held), work)
    if residual == np.inf:  # it is not near
        _take_back(problem.effects.hold, buffer, memory)
        if options.nearby and not buffer.impulsive[row]:
            _less_potential(how, buffer.bends, row, problem, state, q)
        for attempt in range(2):  # without forces of inertia that are in the way; with them
            state, residual, stability, more, _, missed = minimize(
                problem, q, thorough(tolerance, options.ctol, options.maxiter, check,
                                     attempt == 0 and not held), work)
            iterations += more
            residual = _or_decrement(problem, state, residual)
            if residual < SETTLED:
                break
    if stability == np.inf and yields(problem.effects.plastic):
        stability = _smallest_eigenvalue(problem, state)
    return state, residual, stability, iterations, problem, missed


@kernel
def _or_decrement(problem, state, residual):
    """Return a residual, or the decrement where that tells that no more is left to go."""
    if SETTLED <= residual < np.inf:
        decrement = decrement_of(problem, state)
        residual = decrement if decrement < SETTLED else residual
    return residual


@kernel
def _smallest_eigenvalue(problem, state):
    """Return the smallest eigenvalue of the Hessian at a Configuration."""
    hessian, shift = new_hessian(problem), 0.0
    if not assembled_definite(problem, state, hessian, shift):
        shift = inertia_correction(problem, hessian, LEAST_SHIFT)
    value, _ = lowest_mode(problem, hessian, shift, _EXACT)
    return value


@kernel
def _take_back(hold, buffer, memory):
    """Give holds the forces again that they had at the beginning of the step."""
    if hold is None:
        return
    hold.multiplier[:] = buffer.reactions[memory]


@kernel
def record_step(how: SchemeCoefficients, problem: Problem, state: Configuration,
                buffer: StepBuffer, row: int, memory: int, residual: float, stability: float,
                iterations: int, violation: float, options: StepOptions) -> bool:
    """Fill a row with a minimum, how the DLO moves there, and what it leaves to the next step.

    Returns whether it is a stable or neutral equilibrium that keeps all constraints.
    """
    (strains, buffer.frames[row], positions, buffer.wrenches[row], buffer.hold_wrenches[row], hold,
     plastic, forces, contacts, _, _, lost, missed, inside, stationary) = outcome(
         problem, state, buffer.origins[row], residual, options.rounding, True)
    copy(positions, buffer.nodes[0, row])
    copy(strains, buffer.bends[0, row])
    _move_on(how, buffer.nodes, row)
    _move_on(how, buffer.bends, row)
    violation = max(violation, inside)
    bound = buffer.held.shape[1] > 0 or may_forbid(problem.effects)
    if buffer.held.shape[1]:
        buffer.reactions[row] = hold
    if plastic.shape[1]:
        buffer.plastic[row] = plastic
    buffer.energies[row, DISSIPATED] = buffer.energies[memory, DISSIPATED] + lost
    buffer.starts[0, row + 1] = buffer.starts[0, row]
    buffer.starts[1, row + 1] = buffer.starts[1, row]
    _keep_friction(problem.effects.strands, problem.lengths, state, buffer, row)
    if may_forbid(problem.effects):
        _keep_contacts(problem.effects.contact, forces, contacts, buffer, row)
    kept = _PRESSED * options.ctol if _bears_on_few(buffer, row) else options.kept
    converged = is_equilibrium(stationary, stability, bound, violation, kept, missed,
                               buffer.reach[row])
    proof = buffer.proofs[row]
    proof[0], proof[1], proof[3] = residual, stability, violation
    buffer.iterations[row], buffer.converged[row] = iterations, converged
    return converged


@kernel
def _keep_friction(strands, lengths, state, buffer, row):
    """Keep friction of pairs of strands, and by how much they slid in the step."""
    at = buffer.starts[2, row]
    buffer.starts[2, row + 1] = at
    if strands is None:
        return
    touch = new_touch()
    for p in range(strands.rub_limit.size):
        limit = strands.rub_limit[p]
        size = put_trial(strands, lengths, state, p, touch) if limit > 0.0 else -1.0
        if size < 0.0:
            continue
        if at == buffer.rubs.shape[0]:
            buffer.stopped[0] = True
            return
        part = 1.0 if size <= limit else limit / size
        for q in range(2):
            buffer.rub_of[at, q] = strands.pair[p, q]
            buffer.rubs[at, q] = part * touch.trial[q]
            buffer.rubs[at, 2 + q] = strands.rub_slip[p, q] + touch.slip[q]
        at += 1
    buffer.starts[2, row + 1] = at


@kernel
def _bears_on_few(buffer, row):
    """Whether the DLO bears in a row, in few elements, with however many edges."""
    places, begin, end = 0, buffer.starts[1, row], buffer.starts[1, row + 1]
    for a in range(begin, end):
        new = True
        for b in range(begin, a):
            new = new and buffer.contact_of[a, 1] != buffer.contact_of[b, 1]
        places += new
        if places > _FEW:
            return False
    return places > 0


@kernel
def _keep_contacts(contact, forces, contacts, buffer, row):
    """Keep what contacts leave to the next step, and the table of those that bear."""
    if contact is None:
        return
    node, point_of, points = forces
    contact_of, rows = contacts
    buffer.node_forces[row] = node
    starts = buffer.starts
    first, other = starts[0, row], starts[1, row]
    last, end = first + points.shape[0], other + rows.shape[0]
    if last > buffer.points.shape[0] or end > buffer.contacts.shape[0]:
        buffer.stopped[0] = True
        return
    buffer.point_of[first:last], buffer.points[first:last] = point_of, points
    buffer.contact_of[other:end], buffer.contacts[other:end] = contact_of, rows
    starts[0, row + 1], starts[1, row + 1] = last, end


# ------------------------------------------------------------------------------------------------
# The energy of a step, its error, and its stability.


@kernel
def account(system, how, outer, buffer, row, options):
    """Fill a row with its energies, and the local error of the step by the scheme `outer`."""
    nodes, bends, energies = buffer.nodes, buffer.bends, buffer.energies
    elastic = stored(system.effects, system, bends[0, row]) + _stored_plastic(
        system.effects.plastic, system, buffer, row)
    energies[row, ELASTIC] = elastic
    energies[row, STATIC] = (elastic + potential(system.effects, system, nodes[0, row])
                             + _strand_energy(system.effects.strands, system, buffer, row))
    energies[row, KINETIC] = _kinetic(how, nodes, row)
    energies[row, WORK] = energies[row - 1, WORK] + _work(how, buffer, row, options)
    rubbed, pushed = _contact_work(system, buffer, row)
    rubbed += _strand_friction(system.effects.strands, buffer, row)
    energies[row, FRICTION_LOSS] = energies[row - 1, FRICTION_LOSS] + rubbed
    energies[row, CONTACT_WORK] = energies[row - 1, CONTACT_WORK] + pushed
    energies[row, DAMPED] = energies[row - 1, DAMPED]
    damped = _damping_work(system, how, nodes, bends, row)
    if how.gamma > outer.gamma:
        damped = min(damped, max(0.0, _balance(energies[row - 1]) - _balance(energies[row])))
    energies[row, DAMPED] += damped
    buffer.proofs[row, 2] = outer.third * third_difference(buffer.times, nodes[0], row)


@kernel
def _work(how, buffer, row, options):
    """Return the work of the grips in the step to a row, J; fill their mean wrenches there.

    It is that of the wrenches which change the momentum in the step, along the way of the grips:
    wrenches at its ends differ from them where vibrations are too quick for the step.
    """
    past, means = row - 1, buffer.mean_wrenches
    work = _work_along(how, buffer.wrenches[past], buffer.wrenches[row], means[past, 0],
                       means[row, 0], buffer.bases[past], buffer.bases[row], buffer.origins[past],
                       buffer.origins[row], np.zeros(3))
    for a in range(options.node.size):
        away, node = np.zeros(3), options.node[a]
        if options.slides[a]:  # the node is not where the pose is
            for i in range(3):
                for k in range(past, row + 1):
                    away[i] += 0.5 * (buffer.nodes[0, k, node, i] - buffer.targets[k, a, i])
        work += _work_along(how, buffer.hold_wrenches[past, a], buffer.hold_wrenches[row, a],
                            means[past, 1 + a], means[row, 1 + a], buffer.axes[past, a],
                            buffer.axes[row, a], buffer.targets[past, a], buffer.targets[row, a],
                            away)
    return work


@kernel
def _work_along(how, before, now, mean_before, mean, base_before, base, place_before, place, away):
    """Return the work in a step of a wrench on a point `away` (3,) from a moving frame.

    Fills its `mean` (6,) after the step; wrenches, frames and their places before it and now.
    """
    work, turn = 0.0, rotation_vector(times_transposed(matrix(base), matrix(base_before)))
    for i in range(6):
        mean[i] = _mean(how, before[i], now[i], mean_before[i])
        if i < 3:
            j, k = (i + 1) % 3, (i + 2) % 3
            way = place[i] - place_before[i] + turn[j] * away[k] - turn[k] * away[j]
        else:
            way = turn[i - 3]
        work += ((1 - how.gamma) * mean_before[i] + how.gamma * mean[i]) * way
    return work


@kernel
def _stored_plastic(plastic, system, buffer, row):
    """Return the energy in springs that yield, which a step that has ended leaves no loss in, J."""
    if plastic is None:
        return 0.0
    if plastic.share.shape[0] == 0:
        return 0.0
    return add_plastic(system.lengths, buffer.bends[0, row], system.natural,
                       with_set(plastic, buffer.plastic[row]), np.zeros(system.natural.shape))


@kernel
def _strand_energy(strands, system, buffer, row):
    """Return the energy in the springs between strands in a row, J."""
    if strands is None:
        return 0.0
    if strands.strand_radius.size == 0:
        return 0.0
    energy = spring_energy(strands, system, (buffer.bends[0, row], buffer.nodes[0, row]),
                           _rays(system, strands, buffer, row))
    for at in range(buffer.starts[2, row], buffer.starts[2, row + 1]):
        energy += 0.5 * (buffer.rubs[at, 0]**2 + buffer.rubs[at, 1]**2) / strands.pair_spring
    return energy


@kernel
def _strand_friction(strands, buffer, row):
    """Return what friction between strands takes in the step to a row, J.

    Of the slip a part is that of its springs, whose energy comes back; what they hold is lost where
    strands part.
    """
    if strands is None:
        return 0.0
    lost, before, begin = 0.0, np.zeros(2), buffer.starts[2, row - 1]
    end = buffer.starts[2, row]
    for old in range(begin, end):
        for q in range(2):
            lost += 0.5 * buffer.rubs[old, q]**2 / strands.pair_spring
    for at in range(buffer.starts[2, row], buffer.starts[2, row + 1]):
        before[:] = 0.0
        for old in range(begin, end):
            if (buffer.rub_of[old, 0] == buffer.rub_of[at, 0]
                    and buffer.rub_of[old, 1] == buffer.rub_of[at, 1]):
                for q in range(2):
                    before[q] = buffer.rubs[old, q]
        work = 0.0
        for q in range(2):
            force, first = buffer.rubs[at, q], before[q]
            lost -= 0.5 * first**2 / strands.pair_spring
            work -= 0.5 * (first + force) * (buffer.rubs[at, 2 + q]
                                             + (force - first) / strands.pair_spring)
        lost += max(work, 0.0)
    return lost


@kernel
def _kinetic(how, nodes, row):
    """Return the kinetic energy in a row, J."""
    kinetic = 0.0
    for k in range(how.masses.size):
        for i in range(3):
            kinetic += 0.5 * how.masses[k] * nodes[1, row, k, i] ** 2
    return kinetic


@kernel
def _damping_work(system, how, nodes, bends, row):
    """Return the energy that damping takes in the step to a row, J.

    That of the forces which change the momenta in the step: where vibrations are too quick for it,
    the forces at its ends are others. A step of first order is an even motion.
    """
    slow = quick = 0.0
    for k in range(how.masses.size):
        for i in range(3):
            slow += how.masses[k] * _mean_rate_by_way(how, nodes, row, k, i)
    for e in range(system.lengths.size):
        for i in range(3):
            quick += system.lengths[e] * system.stiffness[e, i] * _mean_rate_by_way(how, bends, row,
                                                                                    e, i)
    return max(how.slow * slow + how.viscous * quick, 0.0)


@kernel
def _mean_rate_by_way(how, course, row, k, i):
    """Return the mean rate of a coordinate in the step to a row, times its way."""
    way = course[0, row, k, i] - course[0, row - 1, k, i]
    rate = (1 - how.gamma) * course[4, row - 1, k, i] + how.gamma * course[4, row, k, i]
    return way * (way / how.dt if how.gamma == 1.0 else rate)


@kernel
def _contact_work(system, buffer, row):
    """Return the work done against friction in the step to a row, and that which contacts do, J.

    A force across the end of a chord has a part along it, where the DLO slides on a convex
    obstacle: work of first order, and none in truth. An impact's force takes energy. The normal
    force acts beside the axis, on an edge that stays where it is as the section tilts about it.
    """
    rubbed = pushed = 0.0
    rotation, before, turned, place = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    for a in range(buffer.starts[1, row], buffer.starts[1, row + 1]):
        contact, e = buffer.contacts[a], buffer.contact_of[a, 1]
        point_inside(system.lengths, buffer.bends[0, row - 1], buffer.frames[row - 1],
                     buffer.nodes[0, row - 1], e, contact[0] / system.lengths[e], rotation, before)
        point_inside(system.lengths, buffer.bends[0, row], buffer.frames[row], buffer.nodes[0, row],
                     e, contact[0] / system.lengths[e], turned, place)
        for i in range(3):
            moved = place[i] - before[i]
            rubbed -= contact[8 + i] * moved
            for k in range(3):
                arm = 0.0  # in the section
                for j in range(3):
                    arm += turned[j, k] * contact[12 + j]
                moved += (turned[i, k] - rotation[i, k]) * arm
            pushed += contact[7] * contact[4 + i] * moved
    return rubbed, max(0.0, pushed)


@kernel
def third_difference(times: Floats, places: Floats, row: int) -> Any:
    """Return the largest divided difference of a node's places in four rows up to `row`, m/s^3."""
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
def stability_at(system: Problem, how: SchemeCoefficients, base: Floats, origin: Floats,
                 nodes: Floats, bends: Floats) -> float:
    """Return the smallest eigenvalue of the Hessian that a step of a hanging DLO had at its end.

    How the DLO moves there tells what the step drew it to.
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
    moving = incremental_potential(system, how, where, calm, base.copy(), origin.copy())
    state = new_configuration(moving)
    unknowns_of(moving, bends[0], state.q)
    evaluate(moving, state)
    stability: float = _smallest_eigenvalue(moving, state)
    return stability


# ------------------------------------------------------------------------------------------------
# How a motion begins.


@kernel
def consistent_rates(system: Problem, calm: SchemeCoefficients, how: SchemeCoefficients,
                     buffer: StepBuffer, going: bool, options: StepOptions) -> None:
    """Fill row PAST of a StepBuffer with how a DLO moves that grips and forces let go from there.

    Rows PAST + 1 to PAST + 4 are of very short steps, the last one back in time, without damping
    (`calm`) and with it (`how`); `going`: whether velocities are made those that the grips allow.
    What damping ends at once is none of these, nor of the accelerations: it would ring, and give
    energy.
    """
    now, ahead, later, again, back = PAST, PAST + 1, PAST + 2, PAST + 3, PAST + 4
    check = options.tolerance < 0.0  # False; a literal would be compiled for by itself
    courses, before = (buffer.nodes, buffer.bends), buffer.nodes[1, now].copy()
    for course in courses:
        for k in range(course.shape[2]):
            for i in range(3):
                course[2, now, k, i] = course[3, now, k, i] = 0.0
                course[0, again, k, i], course[1, again, k, i] = (course[0, now, k, i],
                                                                  -course[1, now, k, i])
                course[2, again, k, i] = course[3, again, k, i] = 0.0
    buffer.frames[again] = buffer.frames[now]
    if going:
        # what damps acts against either way: it would not cancel
        for row in (ahead, back):
            buffer.starts[:, row] = buffer.starts[:, ahead]
            implicit_step(system, calm, buffer, row, now, _guess(calm, buffer.bends, row, 1.0),
                          options, check)
        for course in courses:
            for k in range(course.shape[2]):
                for i in range(3):
                    course[1, now, k, i] = (course[0, ahead, k, i]
                                            - course[0, back, k, i]) / (2 * how.dt)
    last = later if going and how.viscous > 0.0 else ahead
    for row in range(ahead, last + 1):
        implicit_step(system, how, buffer, row, row - 1, _guess(how, buffer.bends, row, 1.0),
                      options, check)
    for course in courses:
        for k in range(course.shape[2]):
            for i in range(3):
                course[2, now, k, i] = course[3, now, k, i] = course[2, last, k, i]
                if last == later:
                    course[1, now, k, i] = course[1, ahead, k, i] - how.dt * course[2, last, k, i]
                course[4, now, k, i] = course[1, now, k, i]
    buffer.wrenches[now] = buffer.mean_wrenches[now, 0] = buffer.wrenches[last]
    for a in range(options.node.size):
        for i in range(6):
            wrench = buffer.hold_wrenches[last, a, i]
            buffer.hold_wrenches[now, a, i] = buffer.mean_wrenches[now, 1 + a, i] = wrench
    # (springs of strands are quicker than that time: what they do in it is no work of grips)
    if going and not (buffer.held.shape[1] and _may_touch_itself(system.effects.strands)):
        buffer.energies[now, WORK] += _work_of_impulse(how, buffer, now, ahead, back, before)
    buffer.energies[now, KINETIC] = _kinetic(how, buffer.nodes, now)


@kernel
def _may_touch_itself(strands):
    """Whether strands of the DLO keep each other off."""
    if strands is None:
        return False
    return strands.strand_radius.size > 0


@kernel
def _work_of_impulse(how, buffer, now, ahead, back, before):
    """Return the work of the grips that changes velocities from `before` (N + 1, 3), J.

    A gripper alone moves the DLO as a whole. Between several grips none's own impulse is known, but
    the work of all: what the impulse of all nodes does along their new velocities. It is no less
    than what the kinetic energy grows by.
    """
    turn, work = rotation_vector(times_transposed(matrix(buffer.bases[ahead]),
                                                  matrix(buffer.bases[back]))), 0.0
    places, speeds, alone = buffer.nodes[0, now], buffer.nodes[1, now], buffer.held.shape[1] == 0
    for k in range(how.masses.size):
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            way = speeds[k, i]  # forces that keep the length do no work along it
            if alone:
                way = 0.5 * (speeds[0, i] + before[0, i]) + (
                    turn[j] * (places[k, m] - places[0, m])
                    - turn[m] * (places[k, j] - places[0, j])) / (2 * how.dt)
            work += how.masses[k] * (speeds[k, i] - before[k, i]) * way
    return work


# ------------------------------------------------------------------------------------------------
# The kinematics of a step.


@kernel
def _less_potential(how, bends, row, moving, state, q):
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
def _guess(how, bends, row, share):
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
def _without_force(how, course, row):
    """Return position and velocity at the end of a step that feels no force (anchor)."""
    position, velocity = np.empty((course.shape[2], 3)), np.empty((course.shape[2], 3))
    dt = how.dt
    carries = 0.0 if how.gamma == 1.0 else 1.0  # an implicit Euler's step knows no accelerations
    for k in range(position.shape[0]):
        for i in range(3):
            mean = carries * course[3, row - 1, k, i]
            free = (how.alpha_f * course[2, row - 1, k, i] - how.alpha_m * mean) / (1 - how.alpha_m)
            position[k, i] = (course[0, row - 1, k, i] + dt * course[1, row - 1, k, i]
                              + dt**2 * ((0.5 - how.beta) * mean + how.beta * free))
            velocity[k, i] = course[1, row - 1, k, i] + dt * ((1 - how.gamma) * mean
                                                              + how.gamma * free)
    return position, velocity


@kernel
def _mean(how, before, now, mean):
    """Return the mean of a force or rate after a step, as it changes the momentum, from `mean`."""
    return ((1 - how.alpha_f) * now + how.alpha_f * before - how.alpha_m * mean) / (1 - how.alpha_m)


@kernel
def _move_on(how, course, row):
    """Fill velocity, acceleration and their means at the end of a step."""
    anchor, velocity = _without_force(how, course, row)
    for k in range(anchor.shape[0]):
        for i in range(3):
            away = course[0, row, k, i] - anchor[k, i]
            acceleration = how.stiffness * away
            course[1, row, k, i] = velocity[k, i] + how.velocity_gain * away
            course[2, row, k, i] = acceleration
            for one, mean in ((1, 4), (2, 3)):
                course[mean, row, k, i] = _mean(how, course[one, row - 1, k, i],
                                                course[one, row, k, i],
                                                course[mean, row - 1, k, i])


INTEGRATORS = ('generalized_alpha', 'paper')
_HIGH = 0.85  # of the fastest vibrations: what one step of generalized alpha leaves


class Scheme(NamedTuple):
    """A scheme of integration, and the length of its steps.

    'generalized_alpha' is of second order; one step leaves `_HIGH` of the fastest vibrations, and
    slow ones are hardly damped. 'paper' is Eq. 8 to 10: constant acceleration over a step, taken at
    its end; as a Newmark method beta = 1/2, gamma = 1, of first order, and it damps: a vibration of
    angular frequency w loses the part w dt / 4 of its amplitude per radian. 'euler' is the implicit
    one, 'annihilating' a generalized alpha that leaves nothing of the fastest vibrations.
    """

    name: str  # of INTEGRATORS, or 'euler' or 'annihilating'
    dt: float  # s

    def coefficients(self, damping: tuple[float, float], masses: Floats) -> SchemeCoefficients:
        """Return them for kernels, of a DLO with Rayleigh's damping and these node masses."""
        dt = self.dt
        alpha_m, alpha_f, beta, gamma = 0.0, 0.0, 1.0, 1.0
        if self.name == 'paper':
            beta = 0.5
        elif self.name != 'euler':
            high = _HIGH if self.name == 'generalized_alpha' else 0.0
            alpha_m, alpha_f = (2 * high - 1) / (high + 1), high / (high + 1)
            beta, gamma = 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f
        # The scheme's position differs from Taylor's series of the true one by (1/6 - beta
        # - (alpha_f - alpha_m) / 2) dt^3 d3x/dt3. Accelerations are no measure of it: they are
        # those that keep the DLO's length, and tell of changes of the step as well.
        third = 6 * abs(1 / 6 - beta - 0.5 * (alpha_f - alpha_m)) * dt**3
        return SchemeCoefficients(*(float(one) for one in (
            alpha_m, alpha_f, beta, gamma, dt, (1 - alpha_m) / ((1 - alpha_f) * beta * dt**2),
            gamma / (beta * dt), third, *damping)), masses)
