# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO comes to rest among obstacles from anywhere: pseudo-transient continuation.

Newton's method for shape and contact forces together (`minimize.semismooth`) finds what is near.
From afar the DLO follows its gradient flow, in the metric of elasticity, by linearly implicit
steps,

    (H + shift I) dq = -gradient + loads of contacts,

and contacts obey their linearized laws, but yield by `softness` times the change of their forces.
So a DLO that is set on a table nearly upright buckles before its force grows without bounds.
Both become small as the flow comes to rest, and then this is nearly Newton's method (Kelley and
Keyes, SIAM J. Numer. Anal. 35, 1998). A step is good if the gradient after it is about what it
should be; shift and softness are chosen by that, no potential is asked: friction has none.

Nodes near obstacles are candidates for contact, so that a step meets an obstacle as its laws say:
those that are about as near as a step may bring a node deeper; more where one has come deeper. A
grip that is far from its place comes nearer by 1 / (1 + shift) in a step, and a step that would
turn a node too far is made in part.
"""

import numpy as np

from dlo_planner.energy.gap import radius_at_node
from dlo_planner.energy.grip import move_multipliers
from dlo_planner.energy.inertia import inertial_stiffness
from dlo_planner.energy.problem import bending_energy, is_to_end, new_configuration
from dlo_planner.energy.terms import forbids
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import put_sum
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import enlarge_active_set, update_active_set
from dlo_planner.minimize.contact_laws import slides
from dlo_planner.minimize.contact_table import (
    kkt_residual,
    with_contacts,
    with_stiffness,
)
from dlo_planner.minimize.hessian import assemble, is_definite, largest_turn, new_hessian
from dlo_planner.minimize.kkt import add_to, dot
from dlo_planner.minimize.semismooth import (
    complementarity_step,
    crosses_a_sheet,
    forces,
    forces_without_candidates,
    loaded_by_contacts,
    no_reaction,
    place,
    put_forces,
    turn_into_loads,
)

_TURN = 0.3       # rad: no step turns a node by more
_FARTHEST = 0.1   # of the length: no step moves a contact by more
_NEAR = 0.02      # of the length: nodes with larger gaps are no candidates
# lengths by which contacts yield under the DLO's own forces, at most and at least
_SOFTEST, _STIFFEST = 0.01, 1e-12
_LEAST_SHIFT = 1e-3  # where shifts begin, relative to elasticity and loads
_MOST_SHIFT = 1e9    # times the least one: then nothing moves
_LARGER, _SMALLER = 4.0, 0.25  # most and least that shift and softness are multiplied by
_SOFTER = 1 / 16  # times the least shift, where any shift is too cautious and none is not stable
# A step brings contacts deeper by this part of the DLO's radius, within limits, of the length.
_PART, _LEAST_DEEPER, _DEEPER = 0.25, 1e-4, 5e-3
_CHOICES = 12     # steps in which points inside elements are chosen anew; then they are kept
_AIM, _BAD = 0.3, 1.0  # wrong part of the gradient after a step: as it should be; too large


@kernel
def relax(system, q, previous, follows, rough, most, flow, most_turn):
    """Return Problem with its contact forces, unknowns, steps, where the flow comes to rest.

    And the places (N + 1, 6) from which friction counts then, if it does. At rest the residual is
    below `rough`, and no gap below -rough times the length; the flow also ends after `most` steps,
    and where all of them have turned nodes by more than `most_turn`, rad. `flow` (3,) are shift and
    softness, here and where it ends, and by how much nodes have turned.
    Friction counts from where the DLO was before, or, if it `follows`, from each step of the flow:
    that is the answer of another way of loading, in which points slip, stick and slip again.
    """
    length, hold = np.sum(system.lengths), system.effects.hold
    given = system.effects.contact.contacts
    rigidity = bending_energy(system) / length
    loads, reaction = np.sum(np.abs(system.effects.load.pull)), no_reaction(system)
    inertia = inertial_stiffness(system.effects.anchor) * length
    # the shift is relative to elasticity, whatever inertia adds to it
    compliance, least = (length / (loads + inertia + rigidity),
                         _LEAST_SHIFT * (1.0 + loads / rigidity))
    thin = _thickness(system.effects.contact.scene, system.lengths)
    softest = min(_SOFTEST, thin / length)
    weak, near, farthest = 1.0 / (softest * compliance), thin, _NEAR * length
    always = rough > 0.0  # literals would be compiled for by themselves
    state, step, hessian = new_configuration(system), np.empty_like(q), new_hessian(system)
    trial, right, wrong = new_configuration(system), np.empty_like(q), np.empty_like(q)
    state.q[:] = q
    place(system, state)
    loaded = with_stiffness(system, weak, weak)
    loaded = loaded_by_contacts(loaded, state, previous, near, always, always)
    state, residual, table, _ = kkt_residual(loaded, state.q)
    loaded, state, residual, table, previous = _watched(loaded, state, table, previous, follows,
                                                        near, follows)
    shift, softness, steps, stands = flow[0], min(flow[1], softest), 0, False
    largest, cautious, worked = _MOST_SHIFT * least, False, np.zeros(1)
    while steps < most and shift < largest and flow[2] <= most_turn:
        if stands and residual < rough and deepest(table) < rough * length:
            break
        steps += 1
        if is_to_end(worked, system, 1 + table.gap.size):
            break
        used = shift
        normal, shear = forces(table, state)
        assemble(loaded, state, hessian)
        good, error = is_definite(loaded, hessian, shift), np.inf
        if good:
            good = complementarity_step(loaded, state, table, hessian, 1, softness * compliance,
                                        1.0 / (1.0 + shift), _FARTHEST, normal, shear, step, right,
                                        reaction)
        turn, part = largest_turn(loaded, hessian, step) if good else np.inf, 0.0
        if turn < np.inf:
            part = min(1.0, _TURN / max(_TURN, turn))
        if part > 0.0:
            first, across = forces(table, state)
            normal, shear = first + part * (normal - first), across + part * (shear - across)
            put_sum(state.q, part, step, trial.q)
            place(system, trial)
            if (crosses_a_sheet(loaded, state)
                    or not forbids(system.effects, system, state, trial)):
                after = with_stiffness(loaded, weak, weak)
                put_forces(after, table, normal, shear)
                move_multipliers(hold, part, reaction)
                after = loaded_by_contacts(after, trial, previous, near, always, always)
                there, _, its_table, _ = kkt_residual(after, trial.q)
                put_sum(there.gradient, part * shift, step, wrong)
                add_to(wrong, part - 1.0, state.gradient)
                left, error = dot(wrong, wrong), 0.0
                whole = part * part * max(dot(right, right), shift * shift * dot(step, step))
                if left != 0.0:  # else it rests already, as a DLO upright on its tip may
                    error = np.sqrt(left / whole) if whole > 0.0 else np.inf
                after, there, its_residual, its_table, later = _watched(
                    after, there, its_table, previous, follows, near, steps > _CHOICES)
                deeper = (deepest(its_table) - deepest(table)) / max(thin, deepest(table))
                if error < _BAD <= deeper and near < farthest:  # something was not seen coming
                    near = min(_LARGER * near, farthest)
                    move_multipliers(hold, -part, reaction)
                    loaded, state, residual, table, previous = _watched(
                        loaded, state, table, previous, follows, near, always)
                    continue
                error = max(error, deeper)
                if not error < _BAD:
                    error = np.inf  # it may be no number
                    move_multipliers(hold, -part, reaction)
        if used == 0.0 and cautious and not error < _BAD:
            least *= _SOFTER
        cautious = used > 0.0 and error < _SMALLER * _AIM
        factor = error / _AIM
        factor = min(factor * factor, _LARGER) if factor > 1.0 else max(np.sqrt(factor), _SMALLER)
        shift = max(shift, least) * factor if factor > 1.0 else shift * factor
        shift = shift if shift >= least else 0.0
        if error < _BAD:
            stands, near = used == 0.0 and part == 1.0, max(thin, 0.5 * near)
            flow[2] += part * turn
            loaded, state, residual, table, previous = after, there, its_residual, its_table, later
        if factor < 1.0 or error >= _BAD:  # contacts that yield more again would go to and fro
            softness = min(max(softness, _STIFFEST) * factor, softest)
    flow[0], flow[1] = shift if shift < largest else 0.0, softness
    normal, shear = forces_without_candidates(loaded, table, state)
    put_forces(loaded, table, normal, shear)
    loaded = with_stiffness(loaded, given.stiffness, given.grip)
    turn_into_loads(loaded, state, not always)
    return loaded, state.q, steps, previous


@kernel
def _watched(system, state, table, previous, follows, near, keeps):
    """Watch the points inside elements that matter at a state, and count friction from there on.

    Return Problem, Configuration, residual, table of contacts, and the places friction counts from.
    `keeps`: whether the points that are watched stay.
    """
    normal, shear = forces_without_candidates(system, table, state)
    put_forces(system, table, normal, shear)
    contacts, _ = (enlarge_active_set(system, state) if keeps
                   else update_active_set(system, state))
    if follows and len(previous):
        previous = _places(state)
        _move_anchors(system, contacts, state)
    system = with_contacts(system, contacts, system.effects.contact.scene)
    system = loaded_by_contacts(system, state, previous, near, near > 0.0, near > 0.0)
    state, residual, table, _ = kkt_residual(system, state.q)
    return system, state, residual, table, previous


@kernel
def _places(state):
    """Return (N + 1, 6) positions and tangents of the nodes."""
    places = np.empty((state.positions.shape[0], 6))
    for k in range(places.shape[0]):
        for i in range(3):
            places[k, i], places[k, 3 + i] = state.positions[k, i], state.rotations[k, i, 0]
    return places


@kernel
def _move_anchors(system, contacts, state):
    """Move the anchors of points that slide to where these are, in place."""
    rotation, x = np.empty((3, 3)), np.empty(3)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            continue
        force = np.sqrt(np.sum(contacts.shear[c] ** 2))
        if slides(force, contacts.multiplier[c]):
            point_inside(system.lengths, state.strains, state.rotations, state.positions,
                         contacts.element[c], contacts.fraction[c], rotation, x)
            for i in range(3):
                contacts.anchor[c, i] = x[i]


@kernel
def _thickness(scene, lengths):
    """Return how much deeper, in m, a step may bring a contact."""
    thin, length = _DEEPER * np.sum(lengths), np.sum(lengths)
    for o in range(scene.kind.size):
        beside = np.sqrt(scene.offset[o, 0] ** 2 + scene.offset[o, 1] ** 2)
        for k in range(lengths.size + 1):
            thin = min(thin, _PART * (beside + radius_at_node(scene, o, k)))
    return max(thin, _LEAST_DEEPER * length)


@kernel
def deepest(table):
    """Return how deep, in m, a contact is inside its obstacle."""
    depth = 0.0
    for a in range(table.gap.size):
        depth = max(depth, -table.gap[a])
    return depth
