# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The forces of contact and friction that satisfy their laws, to first order.

A step of the outer loop. With the compliance of the DLO at its contacts, from solves with Newton's
Hessian, all multipliers follow at once: no gap where it bears, no sliding where it sticks, mu times
the force where it slides (semismooth Newton method, Alart and Curnier 1991). Where that cannot be
trusted each multiplier becomes the force that it has (augmented Lagrangian).
"""

import numpy as np

from dlo_planner.energy.contact import trial_traction
from dlo_planner.energy.inertia import is_drawn
from dlo_planner.energy.potential import evaluate, project
from dlo_planner.energy.problem import hinged, new_configuration
from dlo_planner.energy.terms import forbids, row_count
from dlo_planner.geometry.kinematics import part_of_element, point_inside
from dlo_planner.geometry.record import put_sum
from dlo_planner.kernels import kernel
from dlo_planner.minimize.dense import softly_solved
from dlo_planner.minimize.hessian import (
    assemble,
    factorize,
    is_definite,
    largest_turn,
    new_hessian,
    solve,
)
from dlo_planner.minimize.newton import HELD_NEUTRAL

_SOFT = 1e-3      # of a spring's compliance, added: contacts that depend on each other share
_REFINED = 2      # times: what is soft counts a thousandth as much after each
_CHANGES = 8      # times that contacts are let go or taken back
_FARTHEST = 0.02  # of the length: a prediction that moves a contact farther is none
_TOILS = 2        # rounds in vain, after which what is soft goes with its forces
_FARTHEST_TURN = 0.3  # rad: the same, of what a node turns by


@kernel
def move_multipliers(system, state, table, share, q, vain):
    """Move the multipliers of `system`, in place, to what the laws ask for.

    After some rounds in vain q (m, 3) goes with them: what is soft, like the plane in which a
    column buckles, would go anywhere on its way to where the new multipliers belong.

    Args:
        state, table: Configuration and Touching at the minimum for the present multipliers
        share: of the way from the forces as they are to those of the linearized laws
        q: unknowns of `state`
        vain: rounds in vain; after some what is neutral may stay so, too, see `stands`

    Returns:
        whether these are known
    """
    normal, shear = table.force.copy(), np.zeros((table.gap.size, 3))
    for a in range(table.gap.size):
        if table.rubbing[a] >= 0:
            shear[a] = state.attached.force[table.rubbing[a]]
    used = share > 0.0 and table.gap.size > 0
    if used:
        target, across, hessian = normal.copy(), shear.copy(), new_hessian(system)
        step = np.empty_like(q)
        used = lawful(system, state, table, hessian, used, vain > _TOILS, target, across, step)
        if used:
            there = new_configuration(system)
            put_sum(q, share, step, there.q)
            evaluate(system, there)
            if (vain > _TOILS and largest_turn(system, hessian, step) < _FARTHEST_TURN
                    and not forbids(system.effects, system, state, there)):
                q[:] = there.q
            for a in range(table.gap.size):
                normal[a] += share * (target[a] - normal[a])
                for i in range(3):
                    shear[a, i] += share * (across[a, i] - shear[a, i])
    put_forces(system, table, normal, shear)
    return used


@kernel
def put_forces(system, table, normal, shear):
    """Make forces, normal (A,) and across (A, 3), the multipliers of `system`, in place."""
    contacts, friction = system.effects.contact.contacts, system.effects.contact.scene.friction
    contacts.node[:] = 0.0
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            contacts.multiplier[c] = 0.0
    for a in range(table.gap.size):
        o, e, c = table.obstacle[a], table.element[a], table.rubbing[a]
        force = max(0.0, normal[a])
        if table.inside[a] < 0:
            contacts.node[o, e + 1] = force
        else:
            contacts.multiplier[table.inside[a]] = force
        if c >= 0:
            limit = friction[o] * force
            contacts.multiplier[c] = limit
            size = max(limit, np.sqrt(np.sum(shear[a] ** 2)))
            for i in range(3):
                contacts.shear[c, i] = shear[a, i] * limit / size if size > 0.0 else 0.0


@kernel
def lawful(system, state, table, hessian, fresh, neutral, normal, shear, step):
    """Fill the forces that satisfy the linearized laws, and the step to where they do.

    Args:
        hessian: filled if `fresh`; else that of a Configuration nearby, factorized
        neutral: whether it need not be definite, see `stands`
        normal: (A,), shear: (A, 3) the forces as they are; filled where it can be trusted
        step: (m, 3) filled

    Returns:
        whether it can
    """
    contacts = system.effects.contact.contacts
    if fresh:
        assemble(system, state, hessian)
        if not stands(system, hessian, neutral):
            return False
    count = table.gap.size
    first = np.empty(count, dtype=np.int64)  # row of the normal; of a friction's two, the next
    size = 0
    for a in range(count):
        first[a] = size
        size += 1 if table.rubbing[a] < 0 else 3
    axes, laws = np.zeros((size, 3)), np.zeros((size, 3))
    linearize(system, state, table, first, axes, laws)
    loads, answers = _answers(system, state, hessian, table, first, axes)
    compliance = _products(loads, answers)
    shift = np.zeros(size)  # of the limits, to those of the multipliers as they are
    for a in range(count):
        if table.rubbing[a] >= 0 and laws[first[a] + 1, 0] > 0.0:
            shift[first[a] + 1] = laws[first[a] + 1, 2] * contacts.stiffness * table.gap[a]
    gradient = state.gradient.copy().reshape(-1)
    free = np.empty(size)
    for i in range(size):
        free[i] = -np.sum(answers[i] * gradient) - np.sum(compliance[i] * shift)
    reaction = _reaction(compliance, table, first, laws)
    matrix, right, soft = _equations(system, table, first, laws, reaction, free)
    known, change = _pushing_only(system, table, first, normal, (matrix, right, soft))
    if not known:
        return False  # what slides does so by itself: no multipliers hold it there
    farthest = _FARTHEST * np.sum(system.lengths)
    for i in range(size):
        if not abs(free[i] - np.sum(reaction[i] * change)) < farthest:
            return False
    for a in range(count):
        i = first[a]
        normal[a] += contacts.stiffness * table.gap[a] + change[i]
        if table.rubbing[a] >= 0:
            for j in range(3):
                shear[a, j] = (contacts.shear[table.rubbing[a], j] + change[i + 1] * axes[i + 1, j]
                               + change[i + 2] * axes[i + 2, j])
    solve(system, hessian, state.gradient, step)
    _add_answers(table, first, laws, shift, change, answers, step)
    return True


@kernel
def stands(system, hessian, neutral):
    """Factorize an assembled Hessian; return whether it is definite, but for what is `neutral`.

    Newton's method finds what is neutral nearby; a descent goes far along it, in many short steps.
    """
    if factorize(system, hessian, 0.0) > 0:
        if not (neutral and is_definite(system, hessian, HELD_NEUTRAL)):
            return False
        factorize(system, hessian, 0.0)
    return True


@kernel
def _pushing_only(system, table, first, normal, equations):
    """Return whether there are changes (K,) of the multipliers; in motion no contact pulls then.

    Contacts side by side depend on each other: with no gap at any of them, some would pull as hard
    as others push. One that pulls is let go, one let go that is pressed in bears again (primal-dual
    active set method: Hintermueller, Ito and Kunisch 2002): its spring has no force there.

    Args:
        normal: (A,) forces as they are; equations: `_equations` of contacts that all bear
    """
    matrix, right, soft = equations
    k, times = system.effects.contact.contacts.stiffness, _refinements(system)
    bears = np.ones(table.gap.size, dtype=np.bool_)
    known, change = softly_solved(matrix.copy(), right, soft, times)
    # at rest a row of contacts shares its friction, which would leave with one let go
    for turn in range(_CHANGES if is_drawn(system.effects.anchor) else 0):
        if not known:
            break
        same = True
        rows, sides, shared = matrix.copy(), right.copy(), soft.copy()
        for a in range(table.gap.size):
            i = first[a]
            multiplier = normal[a] + k * table.gap[a]
            pressed = right[i] + soft[i] * change[i]  # -k times the gap there
            for j in range(change.size):
                pressed -= matrix[i, j] * change[j]
            # after some turns nothing bears again: so they come to an end
            stays = multiplier + change[i] >= 0.0 if bears[a] else (
                pressed > 0.0 and turn < _CHANGES // 2)
            same = same and stays == bears[a]
            bears[a] = stays
            if not stays:
                for j in range(change.size):
                    rows[i, j] = -matrix[i, j]
                rows[i, i] += 1.0 + soft[i]
                sides[i] = -multiplier - right[i]
                shared[i] = 0.0
        if same:
            break
        known, change = softly_solved(rows, sides, shared, times)
    return known, change


@kernel
def _refinements(system):
    """Return how often what is soft is taken away: not between two grips, where all depend."""
    if row_count(system.needs.border) > 0 or hinged(system):
        return 0
    return _REFINED


@kernel
def _add_answers(table, first, laws, shift, change, answers, step):
    """Complete the step (m, 3), negated so far, by what the changes of the multipliers do."""
    part = shift.copy()
    for a in range(table.gap.size):
        i = first[a]
        part[i] -= change[i]
        if table.rubbing[a] >= 0:
            if laws[i + 1, 0] > 0.0:
                part[i + 1] += laws[i + 1, 2] * change[i]
            else:
                part[i + 1] += change[i + 1]
            part[i + 2] += laws[i + 1, 1] * change[i + 2]
    for e in range(step.shape[0]):
        for j in range(3):
            total = -step[e, j]
            for i in range(part.size):
                total -= part[i] * answers[i, 3 * e + j]
            step[e, j] = total


@kernel
def linearize(system, state, table, first, axes, laws):
    """Fill axes (K, 3): normal, direction of friction, third; and laws (K, 3) of the friction.

    Laws: in the second row whether it slides, the limit's part of the trial force, mu; in the third
    the multiplier's components along both axes and the trial force.
    """
    contacts = system.effects.contact.contacts
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        n = table.normal[a]
        axes[i] = n
        if c < 0:
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        size = trial_traction(contacts, c, x, trial)
        limit = contacts.multiplier[c]
        slides = size > limit
        if slides:
            axes[i + 1] = trial / size
        else:
            least = np.argmin(np.abs(n))
            axes[i + 1, least] = 1.0
            axes[i + 1] -= n[least] * n
            axes[i + 1] /= np.sqrt(np.sum(axes[i + 1] ** 2))
        for j in range(3):
            axes[i + 2, j] = (n[(j + 1) % 3] * axes[i + 1, (j + 2) % 3]
                              - n[(j + 2) % 3] * axes[i + 1, (j + 1) % 3])
        laws[i + 1, 0] = 1.0 if slides else 0.0
        laws[i + 1, 1] = limit / size if slides else 1.0
        laws[i + 1, 2] = system.effects.contact.scene.friction[table.obstacle[a]]
        laws[i + 2, 0] = np.sum(contacts.shear[c] * axes[i + 1])
        laws[i + 2, 1] = np.sum(contacts.shear[c] * axes[i + 2])
        laws[i + 2, 2] = np.sum(trial * axes[i + 1])
        if not slides:
            laws[i + 1, 2] = np.sum(trial * axes[i + 2])


@kernel
def _answers(system, state, hessian, table, first, axes):
    """Return (K, 3 m) unit forces at the contacts along `axes`, as loads, and what they answer."""
    size, m = axes.shape[0], state.q.shape[0]
    loads, answers = np.empty((size, 3 * m)), np.empty((size, 3 * m))
    load, answer, none = np.empty((m, 3)), np.empty((m, 3)), np.zeros(3)
    for a in range(table.gap.size):
        for i in range(first[a], first[a] + (1 if table.rubbing[a] < 0 else 3)):
            # friction acts at the axis
            unit_load(system, state, hessian, table.element[a], table.fraction[a],
                      table.arm[a] if i == first[a] else none, axes[i], load)
            solve(system, hessian, load, answer)
            loads[i], answers[i] = load.reshape(-1), answer.reshape(-1)
    return loads, answers


@kernel
def unit_load(system, state, hessian, element, fraction, beside, axis, load):
    """Fill load (m, 3): change of the displacement along `axis` of a point, by the unknowns.

    Args:
        beside: (3,) m, of the point from the DLO's axis
    """
    n = system.lengths.size
    rows = np.zeros((n, 3))
    part, arm = np.empty((6, 3)), np.empty(3)
    part_of_element(system.lengths[element], fraction, state.strains[element],
                    system.scale[element], state.rotations[element], part, arm)
    moment = np.empty(3)
    for i in range(3):
        arm[i] += state.positions[element, i] + beside[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moment[i] = arm[j] * axis[k] - arm[k] * axis[j]
    for e in range(element):
        for j in range(3):
            for k in range(3):
                rows[e, j] += (hessian.twist_jacobian[e, k, j] * moment[k]
                               + hessian.twist_jacobian[e, 3 + k, j] * axis[k])
    for j in range(3):
        for k in range(3):
            one, other = (k + 1) % 3, (k + 2) % 3
            moved = part[3 + k, j] + part[one, j] * beside[other] - part[other, j] * beside[one]
            rows[element, j] += moved * axis[k]
    project(system.basis, rows, load)


@kernel
def _products(loads, answers):
    """Return (K, K), symmetric: the displacement of each contact by a unit force at each other."""
    size = loads.shape[0]
    products = np.empty((size, size))
    for i in range(size):
        for j in range(i + 1):
            total = 0.0
            for u in range(loads.shape[1]):
                total += loads[j, u] * answers[i, u]
            products[i, j] = products[j, i] = total
    return products


@kernel
def _reaction(compliance, table, first, laws):
    """Return (K, K): the displacements at the contacts against changes of the multipliers."""
    reaction = np.empty_like(compliance)
    for a in range(table.gap.size):
        i = first[a]
        reaction[:, i] = -compliance[:, i]
        if table.rubbing[a] >= 0:
            slides = laws[i + 1, 0] > 0.0
            if slides:
                reaction[:, i] += laws[i + 1, 2] * compliance[:, i + 1]
            reaction[:, i + 1] = (0.0 if slides else 1.0) * compliance[:, i + 1]
            reaction[:, i + 2] = laws[i + 1, 1] * compliance[:, i + 2]
    return reaction


@kernel
def _equations(system, table, first, laws, reaction, free):
    """Return matrix (K, K), right side (K,) for the changes of the multipliers, what is soft (K,).

    Args:
        reaction: (K, K) displacement of the contacts against such changes
        free: (K,) displacement that the gradient left over makes
    """
    size = free.size
    k, grip = system.effects.contact.contacts.stiffness, system.effects.contact.contacts.grip
    matrix, right, soft = np.zeros((size, size)), np.empty(size), np.zeros(size)
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        matrix[i] = -k * reaction[i]
        soft[i] = _SOFT
        right[i] = -k * (table.gap[a] + free[i])
        if c < 0:
            continue
        limit = system.effects.contact.contacts.multiplier[c]
        along, across, trial = laws[i + 2]
        part = laws[i + 1, 1]
        if laws[i + 1, 0] > 0.0:
            matrix[i + 1, i + 1] = 1.0
            matrix[i + 1, i] = -laws[i + 1, 2]
            # the limit is that of the force here; the multiplier's change counts from m
            right[i + 1] = limit - along + laws[i + 1, 2] * k * table.gap[a]
            matrix[i + 2] = grip * part * reaction[i + 2]
            matrix[i + 2, i + 2] += 1.0 - part
            right[i + 2] = -across + grip * part * free[i + 2]
        else:
            for j, slid in ((1, trial - along), (2, laws[i + 1, 2] - across)):
                matrix[i + j] = grip * reaction[i + j]
                soft[i + j] = _SOFT
                right[i + j] = slid + grip * free[i + j]
    for i in range(size):
        matrix[i, i] += soft[i]
    return matrix, right, soft
