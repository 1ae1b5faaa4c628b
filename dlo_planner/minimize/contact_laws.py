# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The laws of all contacts at once, to first order: no gap and no pull, Coulomb's friction.

A DLO answers to loads at its contacts linearly: they move by free + compliance load (the Delassus
operator). What forces then obey the laws is sought among contacts alone, without another look at
the DLO: a semismooth Newton method (Alart and Curnier 1991), of which each turn solves K equations
for who bears and what sticks or slides which way as the turn before has found it.

Side by side contacts on a DLO that does not stretch hardly move by themselves: from one turn to the
next they would take each other's place without an end. So where turns do not end each contact gives
a little under the change of its force (proximal point iteration: Rockafellar 1976), a tenth as much
each time that this ends, more where it does not, until it gives nothing. How far a trial force of
friction follows a slip is what the contact's own compliance tells: with a stiffer spring one that
sticks would be taken for one that slides forth and back in turn.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.energy.contact import trial_traction
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import HARDLY
from dlo_planner.minimize.dense import lu_factor, lu_solve, lu_solve_columns
from dlo_planner.model.arrays import Floats, Ints

_SOFT = 1e-3     # of a spring's compliance: how much a contact gives in the first turns
_REFINED = 2     # times: what it gives counts a thousandth as much after each
_OWN = 1e-3      # least part of a compliance that is not that of the springs
_ALIKE = 1e-4    # of the limit: what a force of friction may be off by
_GIVES, _FIRM = 1e-2, 1e-11  # of the own compliance: how much contacts give at first and at last
_EASY = 2                    # turns that show that contacts may give much less
_LESS, _MUCH_LESS, _MORE = 0.1, 1e-3, 10.0  # times as much after turns that end, that end at once,
#                              and that do not end
_TIMES, _TURNS = 24, 15      # how often, and turns each time
_NO_CONTACT = 1e3            # of the own compliance: what gives so much is none


class ContactLaws(Record):
    """What A contacts obey, and how they move, to first order.

    K rows: of each contact a normal, and two across it where it rubs. Forces are those on the DLO.
    """

    first: Ints         # (A + 1,) row of each contact's normal
    gap: Floats         # (K,) gap, and by how much it has slid, m
    force: Floats       # (K,) N, of which springs take back
    spring: Floats      # (A, 3, 3) so much when it moves, N/m
    friction: Floats    # (A,) coefficients
    free: Floats        # (K,) m, how it moves where the loads do not change,
    compliance: Floats  # (K, K) m/N, and by a change of them
    stiffness: float    # of a spring, N/m
    bears: Any          # (A,) whether it does to begin with


@kernel
def contact_axes(table, first):
    """Return (K, 3): normals, and two axes across them where a contact rubs."""
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
def contact_laws(system, anchors, state, table, first, axes, normal, free, compliance):
    """Return the ContactLaws at a state, with forces `normal` (A,) and springs of its Hessian.

    Slips count from anchors (C, 3).
    """
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
        whole = trial_traction(contacts, c, x, trial)
        part = contacts.multiplier[c] / whole if whole > contacts.multiplier[c] else 1.0
        for j in (1, 2):
            along = np.sum(trial * axes[i + j])
            gap[i + j] = np.sum((x - anchors[c]) * axes[i + j])
            force[i + j] = -part * along
            for k in (1, 2):
                turned = (along / whole * np.sum(trial * axes[i + k]) / whole if part < 1.0
                          else 0.0)
                spring[a, j, k] = contacts.grip * part * ((j == k) - turned)
    return ContactLaws(first, gap, force, spring, friction, free, compliance, contacts.stiffness,
                       bears)


@kernel
def contact_forces(law, exchanges, turns):
    """Return whether there are changes (K,) of the loads, these, and who bears (A,).

    One that pulls is let go, one let go that is pressed in bears again (primal-dual active set
    method: Hintermueller, Ito and Kunisch 2002), in so many turns; with none all bear, and what
    sticks or slides goes on. `exchanges`: whether contacts give as good as nothing at the end.
    """
    size, count = law.free.size, law.friction.size
    rubs, change = size > count, np.zeros(size)
    bears = law.bears.copy() if turns > 0 else np.ones(count, dtype=np.bool_)
    known, ends = _exchanged(law, np.full(size, _SOFT / law.stiffness), _stiffness_of(law, rubs),
                             turns, _REFINED if exchanges else 0, change, bears)
    if turns == 0 or not rubs or known and ends > 0:
        return known, change, bears
    own = _own_compliance(law)
    if not np.min(own) > 0.0:
        return known, change, bears
    grip = np.ones(count)
    for a in range(count):
        if law.first[a + 1] > law.first[a] + 1:
            grip[a] = 1.0 / max(own[law.first[a] + 1], own[law.first[a] + 2])
    known, gives = False, _GIVES
    change[:] = 0.0
    bears[:] = True
    there, there_bears = change.copy(), bears.copy()
    for _ in range(_TIMES):
        found, ends = _exchanged(law, gives * own, grip, _TURNS, 0, there, there_bears)
        if found and ends > 0:
            known, gives = True, gives * (_LESS if ends > _EASY else _MUCH_LESS)
            change[:] = there
            bears[:] = there_bears
        else:
            gives *= _MORE
            there[:] = change
            there_bears[:] = bears
        if not _FIRM < gives < _NO_CONTACT:
            break
    return known, change, bears


@kernel
def force_after(law, a, change, moved):
    """Return the force (n,) of contact a after a change (K,) of loads, by which all have moved."""
    i, n = law.first[a], law.first[a + 1] - law.first[a]
    force = law.force[i:i + n] + change[i:i + n]
    for j in range(n):
        for k in range(n):
            force[j] -= law.spring[a, j, k] * moved[i + k]
    return force


@kernel
def _stiffness_of(law, rubs):
    """Return (A,) about what a contact that rubs resists a slip with, without its springs, N/m."""
    grip = np.ones(law.friction.size)
    for a in range(grip.size if rubs else 0):
        softest = 0.0
        for i in range(law.first[a] + 1, law.first[a + 1]):
            j, moves = i - law.first[a], law.compliance[i, i]
            softest = max(softest, moves / max(_OWN, 1.0 - law.spring[a, j, j] * moves))
        if softest > 0.0:
            grip[a] = 1.0 / softest
    return grip


@kernel
def _own_compliance(law):
    """Return (K,) how far each row moves by a unit force on it, without any springs; 0: unknown."""
    size = law.free.size
    matrix, order, own = np.eye(size), np.empty(size, dtype=np.int64), np.zeros(size)
    for a in range(law.friction.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        for j in range(n):
            for k in range(n):
                for r in range(size if law.spring[a, j, k] != 0.0 else 0):
                    matrix[r, i + k] -= law.compliance[r, i + j] * law.spring[a, j, k]
    if lu_factor(matrix, order) != 0:
        moves = law.compliance.copy()
        lu_solve_columns(matrix, order, moves)
        for i in range(size):
            own[i] = moves[i, i]
    return own


@kernel
def _exchanged(law, gives, grip, turns, times, change, bears):
    """Fill changes (K,) of loads and who bears (A,), from those that they are.

    Return whether there are any, and the number of turns after which they obey the laws, or 0.
    Contacts give by gives (K,), m/N, of the change of their forces, and after so many `times` as
    good as not. Without friction nothing bears again in the second half of the turns, so that they
    come to an end.
    """
    size, count = law.free.size, law.friction.size
    last, same, ends, rubs = bears.copy(), False, 0, size > count
    force, slip, order = np.empty(size), np.empty(size), np.empty(size, dtype=np.int64)
    matrix, right, given = np.empty((size, size)), np.empty(size), np.empty((count, 3, 3))
    _put_motion(law, change, force, slip)
    begin = force.copy()
    for turn in range(turns + 1):
        _put_equations(law, bears, force, slip, grip, gives, begin, matrix, right, given)
        sign = lu_factor(matrix, order)
        if sign == 0 or sign < 0 and not rubs:  # those before do
            bears[:] = last
            return turn > 0, 0
        change[:] = right
        lu_solve(matrix, order, change)
        last[:] = bears
        _put_motion(law, change, force, slip)
        for i in range(size):
            slip[i] += gives[i] * (force[i] - begin[i])
        same, ends = True, turn + 1
        for a in range(count):
            i = law.first[a]
            bears[a] = (force[i] > 0.0 if bears[a]
                        else slip[i] < 0.0 and (turn < turns // 2 or rubs))
            same = same and bears[a] == last[a] and (not bears[a]
                                                     or _rubs_right(law, a, force, slip, grip[a]))
        if same:
            break
    bears[:] = last
    for _ in range(times):
        for a in range(count):
            i, n = law.first[a], law.first[a + 1] - law.first[a]
            for j in range(n):
                for k in range(n):
                    right[i + j] += given[a, j, k] * (force[i + k] - begin[i + k])
        begin[:] = force
        change[:] = right
        lu_solve(matrix, order, change)
        _put_motion(law, change, force, slip)
    return True, ends if same else 0


@kernel
def _put_motion(law, change, force, slip):
    """Fill forces (K,) N, and gaps and slips (K,) m, that follow from a change (K,) of loads."""
    slip[:] = law.free
    for k in range(slip.size):
        part = change[k]
        for i in range(slip.size):
            slip[i] += part * law.compliance[k, i]  # it is symmetric
    for a in range(law.friction.size):
        force[law.first[a]:law.first[a + 1]] = force_after(law, a, change, slip)
    for i in range(slip.size):
        slip[i] += law.gap[i]


@kernel
def _rubs_right(law, a, force, slip, grip):
    """Whether a contact that bears sticks, or slides as Coulomb's law has it."""
    i = law.first[a]
    limit, size, wrong = law.friction[a] * force[i], 0.0, 0.0
    for j in range(i + 1, law.first[a + 1]):
        size += (force[j] - grip * slip[j]) ** 2
    part = limit / np.sqrt(size) if size > limit * limit else 1.0
    for j in range(i + 1, law.first[a + 1]):
        wrong += (force[j] - part * (force[j] - grip * slip[j])) ** 2
    return wrong <= (_ALIKE * limit) ** 2


@kernel
def _put_equations(law, bears, force, slip, grip, gives, begin, matrix, right, given):
    """Fill matrix (K, K) and right side (K,) for the changes of loads: laws at forces and slips.

    given: (A, 3, 3), by how much the right side changes with the forces `begin` (K,) from where
    contacts give.
    """
    by_force, by_slip, by_load = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for a in range(bears.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        _put_law(law, a, bears[a], force, slip, grip[a], by_force, by_slip)
        for j in range(n):
            right[i + j] = 0.0
            matrix[i + j] = 0.0
            for k in range(n):
                given[a, j, k] = by_slip[j, k] * gives[i + k]
                by_force[j, k] += given[a, j, k]
            for k in range(n):
                by_load[j, k] = by_slip[j, k]
                for m in range(n):
                    by_load[j, k] -= by_force[j, m] * law.spring[a, m, k]
                right[i + j] += (given[a, j, k] * begin[i + k] - by_load[j, k] * law.free[i + k]
                                 - by_force[j, k] * law.force[i + k]
                                 - by_slip[j, k] * law.gap[i + k])
                part = by_load[j, k]
                for m in range(right.size if part != 0.0 else 0):
                    matrix[i + j, m] += part * law.compliance[i + k, m]
            for k in range(n):
                matrix[i + j, i + k] += by_force[j, k]


@kernel
def _put_law(law, a, bears, force, slip, grip, by_force, by_slip):
    """Fill by_force, by_slip (3, 3), whose products with force and slip of contact a are zero.

    No force, or no gap; no slip, or, of what slides, a force of the limit along the trial force
    force - grip slip, linearized (Alart and Curnier).
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
