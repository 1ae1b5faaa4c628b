# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One implicit step of a DLO that moves among obstacles.

Inertia holds every node to where it would go by itself, so a step is near its guess, whatever it
touches: Newton's method finds it, in which all contacts obey their laws at once about linear
geometry (`minimize.interior_point`). No flow, no shift and no exchange of points: what does not
converge in a few steps, or does not stand, wants a shorter step of time.
"""

import numpy as np

from dlo_planner.energy.grip import constraint_violation, move_multipliers
from dlo_planner.energy.inertia import inertial_stiffness
from dlo_planner.energy.problem import bending_energy, is_to_end, new_configuration
from dlo_planner.energy.terms import forbids
from dlo_planner.geometry.record import put_sum, replaced
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import kkt_residual
from dlo_planner.minimize.convergence import SETTLED, TOUCHING, as_rounded, gradient_noise
from dlo_planner.minimize.hessian import largest_turn, new_hessian
from dlo_planner.minimize.interior_point import (
    exact_step,
    interior_step,
    new_answer,
    put_change,
    step_laws,
    world_forces,
)
from dlo_planner.minimize.kkt import dot
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.quasi_static import (
    loads_on,
    with_bearing,
    with_candidates,
    with_forces,
)
from dlo_planner.minimize.relaxation import deepest
from dlo_planner.minimize.semismooth import crosses_a_sheet, forces, no_reaction, place

_MOST = 8         # Newton steps: they converge within four, or a shorter step of time does better
_TURN = 0.5       # rad: a step that turns a node by more is far outside of what it is exact for
_KEPT = 9e-7      # of the length: violation of contacts at the end
_ASIDE = 1e-3     # of the length: what is nearer than the DLO moves, and this, may come to bear
# By how much contacts give under changes of their forces, of what they do under a DLO that is far
# from rest, and, if that is less, of what the mass of a node does. What lies between two neighbours
# has to give far more, else their shares of a force take many steps to settle.
_FIRMER, _YIELDS = 1e-2, 2e-5
_COST = 10        # of a step, relative to one of Newton's method for a DLO that hangs freely
_ABOUT = 1e-4     # relative error of an eigenvalue


@kernel
def moved_among(system, q, previous, tolerance, exact, check):
    """Return whether a step ends near its guess q (m, 3), and what `solve_contact` does.

    `previous` (N + 1, 6): places of the nodes before the step, and tangents there.
    """
    given, hold, length = (system.effects.contact.contacts, system.effects.hold,
                           np.sum(system.lengths))
    # (springs of what is held would push against what a step turns to second order)
    free = replaced(system, 'effects', replaced(
        system.effects, 'hold', replaced(hold, 'stiffness', 0.0, 'turn_stiffness', 0.0)))
    right, bend = np.empty_like(q), bending_energy(free)
    whole, tolerance = loads_on(free), max(tolerance, 0.5 * TOUCHING)
    state, trial, hessian = new_configuration(free), new_configuration(free), new_hessian(free)
    state.q[:] = q
    place(free, state)
    near = _ASIDE * length + _way(previous, state)
    reaction, gone, worked = no_reaction(free), no_reaction(free), np.zeros(1)
    give = _YIELDS * system.lengths.size / inertial_stiffness(system.effects.anchor)
    stability, left, violation, steps, always = np.inf, np.inf, np.inf, 0, length > 0.0
    loaded = with_candidates(free, state, previous, near, whole, 0.0, _TURN)
    state, _, table, _ = kkt_residual(loaded, state.q)
    while steps < _MOST and not is_to_end(worked, free, _COST):
        steps += 1
        _, shear = forces(table, state)
        laws = step_laws(loaded, state, table, shear, 1.0, reaction.size)
        laws = replaced(laws, 'give', min(_FIRMER * laws.give, give))
        answer, force = new_answer(q.shape[0], table.gap.size), np.zeros((table.gap.size, 3))
        found, shift = exact_step(loaded, state, hessian, laws, 0.0, 1.0, 1.0, always, force,
                                  answer, reaction)
        if found < 0 or shift > 0.0:
            _forget_forces(state)
            found, shift = exact_step(loaded, state, hessian, laws, 0.0, 1.0, 1.0, always, force,
                                      answer, reaction)
        if found == 0:
            found, shift = interior_step(loaded, state, hessian, laws, 0.0, 1.0, 1.0, always, force,
                                         answer, reaction)
        if found < 1 or shift > 0.0 or not largest_turn(loaded, hessian, answer.step) < _TURN:
            break
        put_change(loaded, state, hessian, laws, force, 1.0, right)
        decrement = np.sqrt(max(dot(right, answer.step), 0.0) / (dot(state.q, state.q) + bend))
        put_sum(state.q, 1.0, answer.step, trial.q)
        place(free, trial)
        if not crosses_a_sheet(loaded, state) and forbids(free.effects, free, state, trial):
            break
        near = max(near, _ASIDE * length + _way(state.positions, trial))
        normal, shear = world_forces(laws, force)
        loaded = with_forces(loaded, table, normal, shear, whole)
        move_multipliers(hold, 1.0, reaction)
        gone += reaction
        state, residual, _, _ = kkt_residual(loaded, trial.q)
        rests, end, firm = False, state, loaded
        if decrement < SETTLED or as_rounded(residual, gradient_noise(loaded, state), tolerance):
            firm = with_bearing(loaded, state.q, given, always)
            end, left, _, violation = kkt_residual(firm, state.q)
            rests = ((decrement < SETTLED or as_rounded(left, gradient_noise(firm, end), tolerance))
                     and violation < _KEPT * length and constraint_violation(hold, end) <= exact)
            # (rounding errors of places are forces in short steps, which move nothing)
            left = decrement if decrement < SETTLED else left
        loaded = with_candidates(loaded, state, previous, near, whole, 0.0, _TURN)
        state, _, table, _ = kkt_residual(loaded, state.q)
        if rests and deepest(table) < _KEPT * length:
            if check:
                stability, _ = lowest_mode(loaded, hessian, 0.0, _ABOUT)
            return True, end, left, stability, steps, firm, violation
    move_multipliers(hold, -1.0, gone)
    return False, state, np.inf, np.nan, steps, system, np.inf


@kernel
def _forget_forces(state):
    """Leave out of the Hessian at a Configuration what forces do as the DLO turns.

    Places of a guess that the DLO cannot take give forces of inertia that are many times larger
    than the true ones, and contacts have those of a step that may have been longer. Without them it
    is Gauss and Newton's (Nocedal and Wright, Numerical Optimization, ch. 10).
    """
    attached = state.attached
    for k in range(state.pull.shape[0]):
        for i in range(3):
            state.pull[k, i] = attached.node_moment[k, i] = 0.0
            for j in range(3):
                attached.node_first[k, i, j] = 0.0
    for c in range(attached.force.shape[0]):
        for i in range(3):
            attached.force[c, i] = attached.moment[c, i] = 0.0
            for j in range(3):
                attached.first[c, i, j] = 0.0


@kernel
def _way(places, state):
    """Return the longest way of a node from its place, the first of (N + 1, 3 or more), m."""
    longest = 0.0
    for k in range(places.shape[0]):
        square = 0.0
        for i in range(3):
            square += (state.positions[k, i] - places[k, i]) ** 2
        longest = max(longest, square)
    return np.sqrt(longest)
