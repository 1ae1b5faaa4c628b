# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shape and contact forces at once: a semismooth Newton method (Alart and Curnier 1991).

With the compliance of the DLO at its contacts, from solves with Newton's Hessian, all multipliers
follow to first order, with the reaction of a held far end: no gap where it bears, no sliding where
it sticks, mu times the force where it slides. Where that cannot be trusted each multiplier becomes
the force that it has (augmented Lagrangian).

In `semismooth_newton` the springs of contacts push with the forces themselves, whatever their gaps
are, so that a gap of the start is closed by the forces and not fought by the springs. It begins
where a DLO that goes on bearing would be carried by its gripper. What it finds is a start: the
minimizer alone tells whether something else touches, and whether the shape falls.
"""

from typing import Any

import numpy as np

from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.contact import ContactSet, trial_traction
from dlo_planner.energy.gap import closest_point, near_nodes, next_touching, node_gap
from dlo_planner.energy.grip import constraint_value, move_multipliers
from dlo_planner.energy.inertia import has_inertia
from dlo_planner.energy.potential import at_elements, evaluate, project, unknowns_of
from dlo_planner.energy.problem import new_configuration, with_gripper
from dlo_planner.energy.scene import translated
from dlo_planner.energy.terms import forbids, row_count
from dlo_planner.geometry.kinematics import forward_kinematics, part_of_element, point_inside
from dlo_planner.geometry.record import Record, copy, put_sum
from dlo_planner.kernels import kernel
from dlo_planner.minimize.active_set import free_to_roll
from dlo_planner.minimize.contact_table import (
    HARDLY,
    is_candidate,
    kkt_residual,
    touching,
    update_friction,
    with_contacts,
    with_springs,
)
from dlo_planner.minimize.dense import lu_factor, lu_solve
from dlo_planner.minimize.hessian import (
    assemble,
    factorize,
    is_definite,
    largest_turn,
    new_hessian,
    solve,
    solve_held,
)
from dlo_planner.minimize.kkt import add_to, dot, put_scaled
from dlo_planner.minimize.newton import HELD_NEUTRAL, is_held
from dlo_planner.model.arrays import Floats, Ints

_SOFT = 1e-3      # of a spring's compliance, added: contacts that depend on each other share
_REFINED = 2      # times: what is soft counts a thousandth as much after each
_CHANGES = 8      # times that contacts are let go or taken back
_FARTHEST = 0.02  # of the length: a prediction that moves a contact farther is none
_TOILS = 2        # rounds in vain, after which what is soft goes with its forces
_FARTHEST_TURN = 0.3  # rad: the same, of what a node turns by
_STEPS = 24
_LARGEST_TURN = 0.3  # rad: of a node in the gripper, by a step; a longer one is a guess
_FALLS = 0.5         # of the error before: what falls less does not converge
_STALE = 1e3         # 1/rad: of a residual, what an old factorization leaves per rad turned since
_GRACE = 3           # first steps, in which it may do so
_LONG = 6            # steps after which contacts that still change may go round in circles
_PATIENCE = 8
STAGES = (24, 15, 0.1, 10.0)
_ALIKE = 1e-4
_NEAR = 1e-3


@kernel
def update_multipliers(system, state, table, share, q, vain):
    """Move the multipliers of `system`, in place, to what the laws ask for.

    After some rounds in vain q (m, 3) goes with them: what is soft, like the plane in which a
    column buckles, would go anywhere on its way to where the new multipliers belong.
    """
    normal, shear = forces(table, state)
    used = share > 0.0 and table.gap.size > 0
    if used:
        target, across, hessian = normal.copy(), shear.copy(), new_hessian(system)
        step = np.empty_like(q)
        used = complementarity_step(system, system, state, table, hessian, used, vain > _TOILS,
                                    not is_held(system), target, across, step, _no_reaction(system))
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
def forces(table, state):
    """Return the forces of the contacts in a table: normal (A,) and across (A, 3), N."""
    shear = np.zeros((table.gap.size, 3))
    for a in range(table.gap.size):
        if table.rubbing[a] >= 0:
            shear[a] = state.attached.force[table.rubbing[a]]
    return table.force.copy(), shear


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
            for i in range(3):
                contacts.shear[c, i] = shear[a, i]


@kernel
def complementarity_step(system, anchored, state, table, hessian, fresh, neutral, exchanges, normal,
                         shear, step, reaction):
    """Fill the forces that satisfy the linearized laws, and the step to where they do.

    And the change of the reaction (K,) of a held far end. Slips count from the anchors of the
    Problem `anchored`. `exchanges`: whether contacts are let go.
    """
    if fresh:
        assemble(system, state, hessian)
        if not _stands(system, hessian, neutral):
            return False
    count = table.gap.size
    first = np.empty(count + 1, dtype=np.int64)  # row of the normal; of a friction's two, the next
    first[0] = 0
    for a in range(count):
        first[a + 1] = first[a] + (1 if table.rubbing[a] < 0 else 3)
    size = first[count]
    axes = _contact_axes(table, first)
    law = _linear_laws(system, anchored, state, table, first, axes, normal)
    loads, answers = _answers(system, state, hessian, table, first, axes)
    miss, right = np.zeros_like(reaction), np.empty_like(step)
    constraint_value(system.effects.hold, state.rotations[-1], state.positions[-1], miss)
    put_scaled(-1.0, state.gradient, right)
    solve_held(system, hessian, right, miss, step, reaction)
    for i in range(size):
        law.free[i] = dot(loads[i], step)
    law.compliance[:] = _products(loads, answers)
    turns = _CHANGES if exchanges or has_inertia(system.effects.anchor) else 0
    known, change, bears = _contact_forces(law, turns, _REFINED if exchanges else 0)
    if not known:
        return False  # what slides does so by itself: no forces hold it there
    moved = law.free + law.compliance @ change
    farthest = _FARTHEST * np.sum(system.lengths)
    for i in range(size):
        if not abs(moved[i]) < farthest:
            return False
    for a in range(count):
        i = first[a]
        force = _force_after(law, a, change, moved)
        normal[a] = force[0] if bears[a] else 0.0
        for j in range(3 if table.rubbing[a] >= 0 else 0):
            shear[a, j] = -(force[1] * axes[i + 1, j] + force[2] * axes[i + 2, j])
    for i in range(size):
        add_to(right, change[i], loads[i])
    solve_held(system, hessian, right, miss, step, reaction)
    return True


@kernel
def _stands(system, hessian, neutral):
    """Factorize an assembled Hessian; return whether it is definite, but for what is `neutral`.

    Newton's method finds what is neutral nearby; a descent goes far along it, in many short steps.
    """
    if factorize(system, hessian, 0.0) > 0:
        if not (neutral and is_definite(system, hessian, HELD_NEUTRAL)):
            return False
        factorize(system, hessian, 0.0)
    return True


class ContactLaws(Record):
    """What A contacts do and obey, to first order: K rows, of each a normal, or two across as well.

    Forces are those on the DLO. Loads that change by e (K,) move contacts by free + compliance e.
    """

    first: Ints  # (A + 1,) row of each contact's normal
    gap: Floats  # (K,) gap, and how far it has slid, m
    force: Floats  # (K,) N
    spring: Floats  # (A, 3, 3) by how much its springs take back when it moves, N/m
    friction: Floats  # (A,) coefficient
    free: Floats  # (K,) m
    compliance: Floats  # (K, K) m/N
    stiffness: float  # of a spring, N/m
    grip: float  # of a spring of friction, N/m
    bears: Any  # (A,) which bear to begin with


@kernel
def _contact_axes(table, first):
    """Return (K, 3): normal, and two axes across it."""
    axes = np.zeros((first[-1], 3))
    for a in range(table.gap.size):
        i, n = first[a], table.normal[a]
        axes[i] = n
        if table.rubbing[a] < 0:
            continue
        least = np.argmin(np.abs(n))
        axes[i + 1, least] = 1.0
        axes[i + 1] -= n[least] * n
        axes[i + 1] /= np.sqrt(np.sum(axes[i + 1] ** 2))
        for j in range(3):
            axes[i + 2, j] = (n[(j + 1) % 3] * axes[i + 1, (j + 2) % 3]
                              - n[(j + 2) % 3] * axes[i + 1, (j + 1) % 3])
    return axes


@kernel
def _linear_laws(system, anchored, state, table, first, axes, normal):
    """Return the ContactLaws at a state, without `free` and `compliance`."""
    contacts, count, size = system.effects.contact.contacts, table.gap.size, first[-1]
    gap, force, spring = np.empty(size), np.empty(size), np.zeros((count, 3, 3))
    friction, bears = np.zeros(count), np.ones(count, dtype=np.bool_)
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for a in range(count):
        i, c = first[a], table.rubbing[a]
        gap[i], force[i], spring[a, 0, 0] = table.gap[a], normal[a], contacts.stiffness
        bears[a] = normal[a] > 2.0 * HARDLY * contacts.stiffness * abs(table.gap[a])
        if c < 0:
            continue
        friction[a] = system.effects.contact.scene.friction[table.obstacle[a]]
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        size_of = trial_traction(contacts, c, x, trial)
        part = min(1.0, contacts.multiplier[c] / size_of) if size_of > 0.0 else 1.0
        from_ = anchored.effects.contact.contacts.anchor[c]
        for j in (1, 2):
            along = np.sum(trial * axes[i + j])
            gap[i + j] = np.sum((x - from_) * axes[i + j])
            force[i + j] = -part * along
            for k in (1, 2):
                spring[a, j, k] = contacts.grip * part * ((j == k) - (
                    along * np.sum(trial * axes[i + k]) / size_of**2 if part < 1.0 else 0.0))
    return ContactLaws(first, gap, force, spring, friction, np.empty(size), np.empty((size, size)),
                       contacts.stiffness, contacts.grip, bears)


@kernel
def _contact_forces(law, turns, times):
    """Return whether there are changes (K,) of the loads, these, and who bears (A,).

    Contacts side by side depend on each other: with no gap at any of them, some would pull as hard
    as others push. One that pulls is let go, one let go that is pressed in bears again (primal-dual
    active set method: Hintermueller, Ito and Kunisch 2002).
    """
    size, count = law.free.size, law.friction.size
    bears = law.bears.copy() if turns > 0 else np.ones(count, dtype=np.bool_)
    rubs = size > count
    grip = np.ones(count)
    for a in range(count if rubs else 0):
        if law.first[a + 1] > law.first[a] + 1:
            grip[a] = 1.0 / max(_loose(law, a, 1), _loose(law, a, 2))
    soft = np.zeros(size)
    for a in range(count):
        i = law.first[a]
        soft[i] = _SOFT / law.stiffness
        for i in range(law.first[a] + 1, law.first[a + 1]):
            soft[i] = _SOFT * min(1.0 / grip[a], law.compliance[i, i])
    change = np.zeros(size)
    known, ends = _exchanged_forces(law, soft, grip, min(8, 20) if rubs else turns, times, change, bears, rubs)
    if known and (ends or not rubs) or turns == 0:
        return known, change, bears
    free_response = _own_compliance(law)
    if not np.min(free_response) > 0.0:
        return known, change, bears
    for a in range(count):
        i = law.first[a]
        if law.first[a + 1] > i + 1:
            grip[a] = 1.0 / max(free_response[i + 1], free_response[i + 2])
    change[:] = 0.0
    bears[:] = True
    part, known = 1e-2, False
    there, there_bears = change.copy(), bears.copy()
    for _ in range(STAGES[0]):
        going, ends = _exchanged_forces(law, part * free_response, grip, STAGES[1], 0, there, there_bears, rubs)
        if going and ends:
            known = True
            change[:] = there
            bears[:] = there_bears
            part *= STAGES[2]
            if part < 1e-11:
                break
        else:
            there[:] = change
            there_bears[:] = bears
            part *= STAGES[3]
            if part > 1e3:
                break
    return known, change, bears


@kernel
def _exchanged_forces(law, soft, grip, turns, times, change, bears, rubs):
    """Fill changes (K,) of loads; return whether there are any, and whether they obey the laws.

    Contacts give by soft (K,), m/N, of the change of their forces.
    """
    size, count = law.free.size, law.friction.size
    last, same = bears.copy(), False
    force, slip, order = np.empty(size), np.empty(size), np.empty(size, dtype=np.int64)
    gives = np.empty((count, 3, 3))
    _put_motion(law, change, force, slip)
    begin = force.copy()
    matrix, right = np.empty((size, size)), np.empty(size)
    for turn in range(turns + 1):
        _put_equations(law, bears, force, slip, grip, soft, begin, matrix, right, gives)
        if lu_factor(matrix, order) == 0:  # those before do
            bears[:] = last
            return turn > 0, False
        change[:] = right
        lu_solve(matrix, order, change)
        last[:] = bears
        _put_motion(law, change, force, slip)
        for i in range(size):
            slip[i] += soft[i] * (force[i] - begin[i])
        same = True
        for a in range(count):
            i = law.first[a]
            # after some turns nothing bears again: so they come to an end
            bears[a] = (force[i] > 0.0 if bears[a]
                        else slip[i] < 0.0 and (turn < turns // 2 or rubs))
            same = same and bears[a] == last[a] and (not bears[a]
                                                     or _keeps(law, a, force, slip, grip[a]))
        if same:
            break
    bears[:] = last
    for _ in range(times):
        for a in range(count):
            i, n = law.first[a], law.first[a + 1] - law.first[a]
            for j in range(n):
                for k in range(n):
                    right[i + j] += gives[a, j, k] * (force[i + k] - begin[i + k])
        begin[:] = force
        change[:] = right
        lu_solve(matrix, order, change)
        _put_motion(law, change, force, slip)
    return True, same


@kernel
def _keeps(law, a, force, slip, grip):
    """Whether friction at a contact that bears keeps its law."""
    i = law.first[a]
    limit, size, wrong = law.friction[a] * force[i], 0.0, 0.0
    for j in range(i + 1, law.first[a + 1]):
        size += (force[j] - grip * slip[j]) ** 2
    part = limit / np.sqrt(size) if size > limit * limit else 1.0
    for j in range(i + 1, law.first[a + 1]):
        wrong += (force[j] - part * (force[j] - grip * slip[j])) ** 2
    return wrong <= (_ALIKE * limit) ** 2


@kernel
def _put_motion(law, change, force, slip):
    """Fill forces (K,) N, and gaps and slips (K,) m, that follow from a change (K,) of loads."""
    slip[:] = law.free
    for i in range(slip.size):
        for k in range(slip.size):
            slip[i] += law.compliance[i, k] * change[k]
    for a in range(law.friction.size):
        force[law.first[a]:law.first[a + 1]] = _force_after(law, a, change, slip)
    slip += law.gap


@kernel
def _force_after(law, a, change, moved):
    i, n = law.first[a], law.first[a + 1] - law.first[a]
    force = law.force[i:i + n] + change[i:i + n]
    for j in range(n):
        for k in range(n):
            force[j] -= law.spring[a, j, k] * moved[i + k]
    return force


@kernel
def _loose(law, a, j):
    """Return about how far a contact moves by a unit load without its springs, m/N."""
    moves = law.compliance[law.first[a] + j, law.first[a] + j]
    return moves / max(1e-3, 1.0 - law.spring[a, j, j] * moves)


@kernel
def _own_compliance(law):
    """Return (K,) how far each contact moves by a unit force, without all springs of contacts."""
    size = law.free.size
    matrix, order = np.eye(size), np.empty(size, dtype=np.int64)
    for a in range(law.friction.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        for j in range(n):
            for k in range(n):
                if law.spring[a, j, k] != 0.0:
                    for r in range(size):
                        matrix[r, i + k] -= law.compliance[r, i + j] * law.spring[a, j, k]
    out = np.zeros(size)
    if lu_factor(matrix, order) == 0:
        return out
    for i in range(size):
        column = law.compliance[:, i].copy()
        lu_solve(matrix, order, column)
        out[i] = column[i]
    return out


@kernel
def _put_equations(law, bears, force, slip, grip, soft, begin, matrix, right, gives):
    """Fill matrix (K, K) and right side (K,) for the changes of the loads: laws at forces and slips.

    Laws are homogeneous, of a contact  by_force force + by_slip slip = 0.  gives: (A, 3, 3), what
    the right side changes by where contacts give from elsewhere.
    """
    by_force, by_slip, by_load = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for a in range(bears.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        _put_law(law, a, bears[a], force, slip, grip[a], by_force, by_slip)
        for j in range(n):
            right[i + j] = 0.0
            matrix[i + j] = 0.0
            for k in range(n):
                gives[a, j, k] = by_slip[j, k] * soft[i + k]
                by_force[j, k] += gives[a, j, k]
            for k in range(n):
                by_load[j, k] = by_slip[j, k]
                for m in range(n):
                    by_load[j, k] -= by_force[j, m] * law.spring[a, m, k]
                right[i + j] += (gives[a, j, k] * begin[i + k] - by_load[j, k] * law.free[i + k]
                                 - by_force[j, k] * law.force[i + k] - by_slip[j, k] * law.gap[i + k])
                if by_load[j, k] != 0.0:
                    for m in range(right.size):
                        matrix[i + j, m] += by_load[j, k] * law.compliance[i + k, m]
            for k in range(n):
                matrix[i + j, i + k] += by_force[j, k]


@kernel
def _put_law(law, a, bears, force, slip, grip, by_force, by_slip):
    """Fill by_force, by_slip (3, 3) of contact a: no force, or no gap, and sticking or sliding.

    What slides does so to first order (Alart and Curnier): force = limit d, d the direction of the
    trial force  force - grip slip.
    """
    i, n = law.first[a], law.first[a + 1] - law.first[a]
    by_force[:] = 0.0
    by_slip[:] = 0.0
    for j in range(n):
        if not bears:
            by_force[j, j] = 1.0
        else:
            by_slip[j, j] = law.stiffness if j == 0 else grip
    if n == 1 or not bears:
        return
    first, second = force[i + 1] - grip * slip[i + 1], force[i + 2] - grip * slip[i + 2]
    size, limit = np.sqrt(first * first + second * second), law.friction[a] * max(0.0, force[i])
    if size <= limit:
        return
    along = (0.0, first / size, second / size)
    for j in (1, 2):
        by_force[j, 0] = -law.friction[a] * along[j]
        for k in (1, 2):
            part = limit / size * ((j == k) - along[j] * along[k])
            by_force[j, k] = (j == k) - part
            by_slip[j, k] = grip * part


@kernel
def linearize_contact_law(system, state, table, first, axes, laws):
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
    """Return (K, m, 3) unit forces at the contacts along `axes`, as loads, and what they answer."""
    loads, none = np.empty((axes.shape[0], state.q.shape[0], 3)), np.zeros(3)
    answers = np.empty_like(loads)
    for a in range(table.gap.size):
        for i in range(first[a], first[a] + (1 if table.rubbing[a] < 0 else 3)):
            # friction acts at the axis
            unit_load(system, state, hessian, table.element[a], table.fraction[a],
                      table.arm[a] if i == first[a] else none, axes[i], loads[i])
            solve(system, hessian, loads[i], answers[i])
    return loads, answers


@kernel
def unit_load(system, state, hessian, element, fraction, beside, axis, load):
    """Fill load (m, 3): change of the displacement along `axis` of a point, by the unknowns."""
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
    size, flat = loads.shape[0], 3 * loads.shape[1]
    products = np.zeros((size, size))
    columns, rows = loads.reshape((size, flat)).T.copy(), answers.reshape((size, flat))
    for i in range(size):
        out = products[i, :i + 1]  # slices are vectorized
        for k in range(flat):
            part, column = rows[i, k], columns[k, :i + 1]
            for j in range(i + 1):
                out[j] += part * column[j]
        for j in range(i):
            products[j, i] = out[j]
    return products


@kernel
def tangent_predictor(system, base, slid, strains, twist):
    """Return whether a DLO that goes on bearing follows its gripper, its unknowns (m, 3) there.

    And the Problem, its contacts free to roll.

    To first order, and if nothing is in the way.
    """
    before, lengths = _before(system, base, slid, twist), system.lengths
    start, after = new_configuration(before), new_configuration(system)
    unknowns_of(system, strains.copy(), start.q)  # they are read-only
    place(before, start)
    now, then = system.effects.contact, before.effects.contact
    system = with_contacts(system, free_to_roll(before, start, now.contacts), now.scene)
    before = with_contacts(before, free_to_roll(before, start, then.contacts), then.scene)
    state = new_configuration(before)
    copy(start.q, state.q)
    evaluate(before, state)
    hessian = new_hessian(before)
    assemble(before, state, hessian)
    if not _stands(before, hessian, strains.size > 0):
        return False, state.q, system
    loads, step, load = np.zeros_like(strains), np.empty_like(state.q), np.empty_like(state.q)
    for e in range(strains.shape[0]):
        for i in range(3):
            for column in range(hessian.cross.shape[2]):
                loads[e, i] -= hessian.cross[e, i, column] * twist[column]
    project(system.basis, loads, load)
    solve(before, hessian, load, step)
    if not largest_turn(before, hessian, step) < _LARGEST_TURN:
        return False, state.q, system
    put_sum(state.q, 1.0, step, after.q)
    place(system, after)
    for k in range(state.positions.shape[0]):
        for i in range(3):
            state.positions[k, i] -= twist[3 + i]
    met = sweeps_through(system.effects.contact.scene, lengths, state.strains, state.rotations,
                         state.positions, after.rotations, after.positions)
    return not met, after.q, system


@kernel
def _before(system, base, slid, twist):
    """Return the Problem before its gripper has moved by a twist.

    What slides goes on along its way, and is held back across it as in the step before: friction
    has the direction of the whole step's way. Without it a DLO may slip aside that does not.
    """
    now, shift = system.effects.contact.contacts, twist[3:].copy()
    contacts = ContactSet(now.stiffness, now.node, now.element, now.obstacle, now.multiplier,
                          now.fraction, now.anchor + shift - slid, now.normal, now.shear, now.grip)
    moved = with_contacts(system, contacts, translated(system.effects.contact.scene, -shift))
    return with_gripper(moved, base, system.origin - shift)


@kernel
def semismooth_newton(system, q, tolerance, exact, previous):
    """Return whether it is found, and what is known of it then."""
    loaded, age, before, hold = system, np.inf, np.inf, system.effects.hold
    reaction, gone = _no_reaction(system), _no_reaction(system)
    begin, hessian = new_configuration(system), new_hessian(system)
    begin.q[:] = q
    neutral = age > 0.0  # literals would be compiled for by themselves
    if not _bears(system.effects.contact.contacts):
        return False, begin, np.inf, np.inf, system, hessian, age, 0
    place(system, begin)
    # 1/N: how many times the smallest stiffness of all of the DLO a force is
    softness = np.sum(system.lengths) ** 2 / np.min(system.stiffness)
    state, step = begin, np.empty_like(q)
    last = touching(system.effects.contact.scene, system.effects.contact.contacts, system.lengths,
                    begin)
    vain, near = 0, -exact
    slid = np.zeros(0, dtype=np.bool_)
    for steps in range(_STEPS):
        loaded = _loaded(loaded, state, previous, near)
        state, residual, table, violation = kkt_residual(loaded, state.q)
        if table.gap.size == 0:
            break
        normal, shear = forces(table, state)
        same = _same(table, last)
        slides = _sliding(loaded, state, table)
        stays = same and np.array_equal(slides, slid)
        slid = slides
        rubs = np.max(table.rubbing) >= 0
        if residual < tolerance and violation < exact and near > 0.0:
            near = -exact
            for a in range(table.gap.size):
                if is_candidate(loaded.effects.contact.contacts, table, a):
                    normal[a] = 0.0
            put_forces(loaded, table, normal, shear)
            loaded = _loaded(loaded, state, previous, near)
            state, residual, table, violation = kkt_residual(loaded, state.q)
            normal, shear = forces(table, state)
        if residual < tolerance and violation < exact:
            if not same or rubs:  # the factorization is that of other contacts
                age = np.inf
            if forbids(system.effects, system, begin, state):
                break
            return True, state, residual, violation, loaded, hessian, age, steps
        wrong = max(residual / tolerance, violation / exact)
        vain = 0 if wrong < _FALLS * before or not same else vain + 1
        if steps >= _GRACE and vain > (_PATIENCE if rubs else 0):
            break
        before, last = min(wrong, before) if same else wrong, table
        # near the end the factorization before is as good; what slides turns its friction
        fresh = not same or not _STALE * age * residual < tolerance or rubs
        sticking = loaded
        if rubs:
            sticking = _sticking(loaded, state, table)
            evaluate(sticking, state)
            normal, shear = forces(table, state)
        if not complementarity_step(sticking, loaded, state, table, hessian, fresh, neutral, neutral,
                                    normal, shear, step, reaction):
            break
        if rubs:
            near = min(violation, _NEAR * np.sum(system.lengths))
        change = largest_turn(sticking, hessian, step) + softness * _difference(table.force, normal)
        age = change if fresh else age + change
        put_forces(loaded, table, normal, shear)
        # contacts that come and go in turn are those of neither shape: from the middle on
        part = 0.5 if steps >= _LONG and steps % 2 > 0 and not same else 1.0
        put_sum(state.q, part, step, state.q)
        move_multipliers(hold, part, reaction)
        gone += part * reaction
        place(loaded, state)
    move_multipliers(hold, -1.0, gone)
    return False, state, np.inf, np.inf, system, hessian, age, _STEPS


@kernel
def _sliding(system, state, table):
    contacts = system.effects.contact.contacts
    slides = np.zeros(table.gap.size, dtype=np.bool_)
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for a in range(table.gap.size):
        c = table.rubbing[a]
        if c >= 0:
            point_inside(system.lengths, state.strains, state.rotations, state.positions,
                         contacts.element[c], contacts.fraction[c], rotation, x)
            slides[a] = trial_traction(contacts, c, x, trial) > contacts.multiplier[c]
    return slides


@kernel
def _sticking(system, state, table):
    """Return the Problem whose friction, at `state`, is its multipliers, however far it has slid."""
    old, rotation, x = system.effects.contact.contacts, np.empty((3, 3)), np.empty(3)
    anchor = old.anchor.copy()
    for a in range(table.gap.size):
        c = table.rubbing[a]
        if c >= 0:
            point_inside(system.lengths, state.strains, state.rotations, state.positions,
                         old.element[c], old.fraction[c], rotation, x)
            anchor[c] = x
    contacts = ContactSet(old.stiffness, old.node, old.element, old.obstacle, old.multiplier,
                          old.fraction, anchor, old.normal, old.shear, old.grip)
    return with_contacts(system, contacts, system.effects.contact.scene)


@kernel
def _no_reaction(system):
    """Return zeros (K,), one for each row that a grip of the far end holds."""
    return np.zeros(row_count(system.needs.border))


@kernel
def _difference(one, other):
    """Return the largest difference of two arrays (A,)."""
    largest = 0.0
    for a in range(one.size):
        largest = max(largest, abs(one[a] - other[a]))
    return largest


@kernel
def _same(table, other):
    """Whether the same points bear, and rub."""
    same = table.gap.size == other.gap.size
    for a in range(table.gap.size if same else 0):
        same = same and (table.obstacle[a] == other.obstacle[a]
                         and table.inside[a] == other.inside[a]
                         and (table.rubbing[a] >= 0) == (other.rubbing[a] >= 0)
                         and (table.inside[a] >= 0 or table.element[a] == other.element[a]))
    return same


@kernel
def correction(system, strains, positions):
    """Return how far, in m, a step of `semismooth_newton` moves nodes where elements are halved.

    Infinite where there is no such step. Friction is that of the Problem's contacts.
    """
    twice, state = np.empty((2 * strains.shape[0], 3)), new_configuration(system)
    for e in range(twice.shape[0]):
        twice[e] = strains[e // 2]
    unknowns_of(system, twice, state.q)
    place(system, state)
    loaded = _loaded(system, state, np.zeros((0, 6)), -np.inf)
    state, _, table, _ = kkt_residual(loaded, state.q)
    normal, shear = forces(table, state)
    step = np.zeros_like(state.q)
    touches = table.gap.size > 0
    if not touches:
        return np.inf
    if not complementarity_step(
            loaded, loaded, state, table, new_hessian(system), touches, not touches,
            not is_held(system), normal, shear, step, _no_reaction(system)):
        return np.inf
    if not np.min(normal) > 0.0:
        return np.inf
    state.q[:] += step
    place(loaded, state)
    farthest = 0.0
    for k in range(positions.shape[0]):
        away = 0.0
        for i in range(3):
            away += (state.positions[2 * k, i] - positions[k, i]) ** 2
        farthest = max(farthest, away)
    return np.sqrt(farthest)


@kernel
def place(system, state):
    """Refill strains, rotations and positions of `state` for its q, and nothing else."""
    values = at_elements(system.basis, state.q)
    for e in range(system.lengths.size):
        for i in range(3):
            state.strains[e, i] = system.natural[e, i] + system.scale[e, i] * values[e, i]
    forward_kinematics(system.lengths, state.strains, system.base, state.rotations, state.positions,
                       state.arcs)


@kernel
def _bears(contacts):
    """Whether any force of contact is known."""
    for o in range(contacts.node.shape[0]):
        for k in range(contacts.node.shape[1]):
            if contacts.node[o, k] > 0.0:
                return True
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0 and contacts.multiplier[c] > 0.0:
            return True
    return False


@kernel
def _loaded(system, state, previous, near):
    """Return the Problem whose contacts, at `state`, push with the forces that are its multipliers.

    What has none does not push. Beside nodes that bear those begin to that are nearer than `near`,
    m: with a force that counts for nothing, the laws tell it. Beside a point that rolls nodes have
    no say. Friction is that of the contacts there.
    """
    given = system.effects.contact.contacts
    scene, k, lengths = system.effects.contact.scene, given.stiffness, system.lengths
    force, yielded = np.zeros_like(given.node), np.zeros_like(given.node)
    x, normal, hessian, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        node, last, longest = near_nodes(scene, o, state.strains)
        while node <= last:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           hessian)
            yielded[o, node], force[o, node] = k * gap, max(0.0, given.node[o, node])
            if force[o, node] == 0.0 and gap < near and _lies_beside(given.node[o], node):
                force[o, node] = HARDLY * k * abs(gap)
            node = next_touching(lengths, given.node[o], node, gap * longest)
    contacts = with_springs(given, 0.0, force, given.multiplier.copy())
    if len(previous):
        contacts = update_friction(system, contacts, state, previous)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            gap, _, _ = closest_point(scene, contacts, c, lengths, state.strains, state.rotations,
                                      state.positions, normal, hessian)
            contacts.multiplier[c] = _pushing(contacts.multiplier[c], k * gap)
    for o in range(scene.kind.size):
        for node in range(force.shape[1]):
            contacts.node[o, node] = _pushing(force[o, node], yielded[o, node])
    return with_contacts(system, with_springs(contacts, k, contacts.node, contacts.multiplier),
                         scene)


@kernel
def _lies_beside(forces, node):
    """Whether a node that bears, one of forces (N + 1,), is next to a node, or the next but one."""
    most = 0.0
    for k in range(max(0, node - 2), min(forces.size, node + 3)):
        most = max(most, forces[k])
    return most > 0.0


@kernel
def _pushing(force, yielded):
    """Return the multiplier with which a spring that has lost the force `yielded` has a force."""
    return force + yielded if force > 0.0 else min(0.0, yielded)
