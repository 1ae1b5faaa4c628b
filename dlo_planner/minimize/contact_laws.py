# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact laws of all contacts together, to first order: unilateral contact, Coulomb's friction.

To first order a DLO moves at its contacts by  free + compliance * load  (Delassus operator), so
forces that obey the laws are found in the space of contacts alone, without another look at the DLO:
by a semismooth Newton method (Alart and Curnier 1991). Each iteration solves K equations for the
active set, and the state (stick or slip, in which direction), that the one before has found.

Neighboring contacts of an inextensible DLO hardly move each other apart: their compliances are
nearly dependent, and active sets may cycle. Then each contact gets a proximal compliance, by which
it yields to a change of its force (proximal point method: Rockafellar 1976). It is divided by ten
or more each time that the iteration converges, multiplied by ten each time that it does not.

The augmentation parameter of friction is the tangential stiffness of the DLO itself at the contact:
with a much larger one a contact that sticks would be taken for one that slides to and fro.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import trial_traction
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import NEGLIGIBLE
from dlo_planner.minimize.dense import factorized, lu_factor, lu_solve
from dlo_planner.model.arrays import Bools, Floats, Ints

# The proximal compliance of the first attempt: a part of the compliance of a contact's spring, or
# of the contact's own where that is less than this part of the spring's; it counts as _HARDEST of
# the spring's at least.
_SOFT, _HARDEST = 1e-3, 1e-6
_REFINED = 2     # proximal steps after it: each leaves about a thousandth of its effect
_LEAST_OWN = 1e-3  # part of a compliance that counts at least as the DLO's, not that of springs
_TOLERANCE = 1e-4  # of Coulomb's limit: by how much a friction force may differ from the law
# Proximal compliances of further attempts, of the DLO's own: the first, and the limits of others.
_FIRST, _LEAST, _MOST = 1e-2, 1e-11, 1e3
# Their factors after an attempt that converges, that converges in _QUICK iterations, that fails.
_SHRINK, _SHRINK_FAST, _GROW = 0.1, 1e-3, 10.0
_QUICK = 2
_ATTEMPTS, _ITERATIONS = 24, 15
_PROXIMAL = 1e-5  # of a contact's own compliance: what it yields by at least
_STICKING = 1.0 - 1e-6  # part of its limit that the friction of what sticks may have
_FEW, _SWEEPS = 6, 60    # iterations together, then sweeps contact by contact
_SETTLED = 1e-9          # of the largest force: changes in a sweep that leave nothing to be done


class ContactLaws(Record):
    """The linearized problem of A contacts: their state, and how they respond to loads.

    K rows: the normal of each contact, and two tangents where it rubs. Forces act on the DLO. Its
    contacts have springs, which are part of the compliance: they move by  free + compliance * load,
    and their forces change by  load - spring * motion.
    """

    first: Ints         # (A + 1,) row of each contact's normal
    gap: Floats         # (K,) gaps and slips so far, m
    force: Floats       # (K,) N
    spring: Floats      # (A, 3, 3) N/m
    friction: Floats    # (A,) coefficients
    free: Floats        # (K,) motion without a change of the loads, m
    compliance: Floats  # (K, K) m/N
    stiffness: float    # of a contact's spring along its normal, N/m
    bears: Bools        # (A,) the active set to begin with


@kernel
def contact_axes(table):
    """Return (A + 1,) the row of each contact's normal; of K rows their contacts and axes.

    A contact that rubs has three rows, two of them for tangents. Of each row there is its contact
    (K,), how far beside the axis of the DLO its force acts (K, 3), m, and its direction (K, 3).
    """
    rows = np.where(table.rubbing < 0, 1, 3)
    of = np.repeat(np.arange(rows.size), rows)
    first, axes, beside = np.append(0, np.cumsum(rows)), np.zeros((of.size, 3)), np.zeros(
        (of.size, 3))
    for a in range(rows.size):
        i, n = first[a], table.normal[a]
        axes[i], beside[i] = n, table.arm[a]  # friction acts at the axis
        if table.rubbing[a] < 0:
            continue
        least = np.argmin(np.abs(n))
        axes[i + 1, least] = 1.0
        axes[i + 1] -= n[least] * n
        axes[i + 1] /= np.sqrt(np.sum(axes[i + 1] ** 2))
        for j in range(3):
            axes[i + 2, j] = (n[(j + 1) % 3] * axes[i + 1, (j + 2) % 3]
                              - n[(j + 2) % 3] * axes[i + 1, (j + 1) % 3])
    return first, of, beside, axes


@kernel
def contact_laws(system, state, table, first, axes, normal, free, compliance):
    """Return the ContactLaws at a state, with forces `normal` (A,).

    Its springs are those in the Hessian that `compliance` is of.
    """
    contacts, count, size = system.effects.contact.contacts, table.gap.size, first[-1]
    gap, force, spring = np.empty(size), np.empty(size), np.zeros((count, 3, 3))
    friction, bears = np.zeros(count), np.ones(count, dtype=np.bool_)
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for a in range(count):
        i, c = first[a], table.rubbing[a]
        gap[i], force[i], spring[a, 0, 0] = table.gap[a], normal[a], contacts.stiffness
        bears[a] = normal[a] > 2.0 * NEGLIGIBLE * contacts.stiffness * abs(table.gap[a])
        if c < 0:
            continue
        friction[a] = system.effects.contact.scene.friction[table.obstacle[a]]
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        whole = trial_traction(contacts, c, x, trial)
        part = contacts.multiplier[c] / whole if whole > contacts.multiplier[c] else 1.0
        for j in (1, 2):
            along = np.sum(trial * axes[i + j])
            gap[i + j] = np.sum((x - contacts.anchor[c]) * axes[i + j])
            force[i + j] = -part * along
            for k in (1, 2):
                turned = (along / whole * np.sum(trial * axes[i + k]) / whole if part < 1.0
                          else 0.0)
                spring[a, j, k] = contacts.grip * part * ((j == k) - turned)
    return ContactLaws(first, gap, force, spring, friction, free, compliance, contacts.stiffness,
                       bears)


@kernel
def contact_forces(law, iterations):
    """Return whether a change of the loads is found, the change (K,), and the active set (A,).

    A contact that pulls leaves the active set, one that is pressed in joins it (primal-dual active
    set method: Hintermueller, Ito and Kunisch 2002).
    """
    size, count = law.free.size, law.friction.size
    rubs, change, bears = size > count, np.zeros(size), law.bears.copy()
    proximal = np.full(size, _SOFT / law.stiffness)
    # A DLO that is pressed along itself yields by far less than springs. That it yields as little
    # along itself to friction is so of all that is laid down: there springs find the better forces.
    for i in law.first[:-1]:
        if law.compliance[i, i] < proximal[i]:
            proximal[i] = _SOFT * max(law.compliance[i, i], _HARDEST / law.stiffness)
    known, taken = _semismooth(law, proximal, _forces(law, change),
                               _augmentation(law, rubs), iterations, _REFINED, change, bears)
    if not rubs or known and taken > 0:
        return known, change, bears
    unique, compliance, _ = _own_response(law)
    own = np.diag(compliance)
    if not (unique and np.min(own) > 0.0):
        return known, change, bears
    augmentation = _stiffness_along(law, own)
    known, part = False, _FIRST
    change[:] = 0.0
    bears[:] = True
    trial, trial_bears = change.copy(), bears.copy()
    for _ in range(_ATTEMPTS):
        found, taken = _semismooth(law, part * own, _forces(law, trial), augmentation, _ITERATIONS,
                                   0, trial, trial_bears)
        if found and taken > 0:
            known, part = True, part * (_SHRINK if taken > _QUICK else _SHRINK_FAST)
            change[:] = trial
            bears[:] = trial_bears
        else:
            part *= _GROW
            trial[:] = change
            trial_bears[:] = bears
        if not _LEAST < part < _MOST:
            break
    return known, change, bears


@kernel
def yielding_forces(law, softness):
    """Return what `contact_forces` does, where each contact yields by `softness`, m/N.

    Where active sets cycle the laws are solved contact by contact (projected Gauss-Seidel). After
    so many sweeps forces may still be inexact; who calls improves them in the next step.
    """
    size, change, bears = law.free.size, np.zeros(law.free.size), law.bears.copy()
    unique, compliance, free = _own_response(law)
    proximal = np.empty(size)
    for i in range(size):
        proximal[i] = softness + _PROXIMAL * abs(compliance[i, i])
        compliance[i, i] += proximal[i]
    taken = 0
    if unique:
        unique, taken = _semismooth(law, proximal, law.force,
                                    _stiffness_along(law, np.abs(np.diag(compliance))), _FEW, 0,
                                    change, bears)
    if unique and taken > 0:
        return _released_stands(law, change, bears), change, bears
    if not unique:
        return False, change, bears
    force = law.force.copy()
    if not _found_in_turn(law, compliance, free + law.gap, force):
        return False, change, bears
    for i in range(size):
        slip = free[i] - proximal[i] * (force[i] - law.force[i])
        for k in range(size):
            slip += compliance[i, k] * (force[k] - law.force[k])
        change[i] = slip
    moved = change.copy()
    for a in range(bears.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        bears[a] = force[i] > 0.0
        for j in range(n):
            change[i + j] = force[i + j] - law.force[i + j]
            for k in range(n):
                change[i + j] += law.spring[a, j, k] * moved[i + k]
    return _released_stands(law, change, bears), change, bears


@kernel
def _released_stands(law, change, bears):
    """Whether the DLO is stable without the springs of contacts that are let go.

    These are springs of contacts that do not bear, and along friction that has its limit. What is
    factorized is positive definite with all springs. Without some of them, s_i along row i, it is
    so where I - sqrt(s_i) C_ij sqrt(s_j) of these rows is (Sylvester, Haynsworth).
    """
    size, force, released = law.free.size, _forces(law, change), 0
    first, rows = np.empty(size, dtype=np.int64), np.zeros((size, 2))  # what is not zero of a row
    for a in range(law.friction.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        for j in range(0 if bears[a] else n):
            first[released], rows[released, 0] = i + j, np.sqrt(law.spring[a, j, j])
            released += 1
        along = np.sqrt(np.sum(force[i + 1:i + n] ** 2)) if bears[a] else 0.0
        if along > 0.0 and slides(along, law.friction[a] * force[i]):
            spring = 0.0
            for j in range(1, n):
                for k in range(1, n):
                    spring += force[i + j] * law.spring[a, j, k] * force[i + k] / along**2
            first[released] = i + 1
            for j in range(2):
                rows[released, j] = np.sqrt(max(spring, 0.0)) * force[i + 1 + j] / along
            released += 1
    left = np.eye(released)
    for a in range(released):
        for b in range(a + 1):
            for i in range(2):
                for j in range(2 if rows[a, i] != 0.0 else 0):
                    if rows[b, j] != 0.0:
                        left[a, b] -= (rows[a, i] * law.compliance[first[a] + i, first[b] + j]
                                       * rows[b, j])
    return factorized(left, np.empty_like(left), 0.0, 0) == 0


@kernel
def _found_in_turn(law, compliance, begin, force):
    """Improve forces (K,), contact by contact; return whether they stay finite.

    Gaps and slips are begin (K,) with those of `law`, and change by the compliance (K, K).
    """
    change = np.zeros(force.size)
    worst = most = np.inf
    for i in range(force.size):
        if not compliance[i, i] > 0.0:
            return False
    for _ in range(_SWEEPS):
        worst = most = 0.0
        for a in range(law.friction.size):
            i = law.first[a]
            new = max(0.0, force[i] - _row(compliance, i, change, begin) / compliance[i, i])
            worst, most = max(worst, abs(new - force[i])), max(most, new)
            force[i], change[i] = new, new - law.force[i]
            if law.first[a + 1] == i + 1:
                continue
            stiffness = 1.0 / (max(compliance[i + 1, i + 1], compliance[i + 2, i + 2])
                               + abs(compliance[i + 1, i + 2]))
            one = force[i + 1] - stiffness * _row(compliance, i + 1, change, begin)
            other = force[i + 2] - stiffness * _row(compliance, i + 2, change, begin)
            limit, whole = law.friction[a] * new, np.sqrt(one * one + other * other)
            part = limit / whole if whole > limit else 1.0
            worst = max(worst, abs(part * one - force[i + 1]), abs(part * other - force[i + 2]))
            force[i + 1], force[i + 2] = part * one, part * other
            change[i + 1], change[i + 2] = (force[i + 1] - law.force[i + 1],
                                            force[i + 2] - law.force[i + 2])
        if worst <= _SETTLED * most or not worst < np.inf:
            break
    return most < np.inf


@kernel
def _row(matrix, i, vector, begin):
    """Return component i of begin + matrix vector."""
    total = begin[i]
    for k in range(vector.size):
        total += matrix[i, k] * vector[k]
    return total


@kernel
def _stiffness_along(law, own):
    """Return (A,) the tangential stiffness, N/m, of contacts with compliances own (K,)."""
    stiffness = np.ones(law.friction.size)
    for a in range(stiffness.size):
        if law.first[a + 1] > law.first[a] + 1:
            stiffness[a] = 1.0 / max(own[law.first[a] + 1], own[law.first[a] + 2])
    return stiffness


@kernel
def slides(force, limit):
    """Whether a friction force has its limit, N."""
    return force >= _STICKING * limit


@kernel
def force_after(law, a, change, moved):
    """Return the force (n,) of contact a after a change (K,) of loads and the motion (K,)."""
    i, n = law.first[a], law.first[a + 1] - law.first[a]
    force = law.force[i:i + n] + change[i:i + n]
    for j in range(n):
        for k in range(n):
            force[j] -= law.spring[a, j, k] * moved[i + k]
    return force


@kernel
def _augmentation(law, rubs):
    """Return (A,) augmentation parameters of friction, N/m.

    About the DLO's own tangential stiffness: its springs are taken off row by row.
    """
    augmentation = np.ones(law.friction.size)
    for a in range(augmentation.size if rubs else 0):
        softest = 0.0
        for i in range(law.first[a] + 1, law.first[a + 1]):
            j, moves = i - law.first[a], law.compliance[i, i]
            softest = max(softest, moves / max(_LEAST_OWN, 1.0 - law.spring[a, j, j] * moves))
        if softest > 0.0:
            augmentation[a] = 1.0 / softest
    return augmentation


@kernel
def _own_response(law):
    """Return whether they are known, compliance (K, K) and free motion (K,) without springs.

    With springs S a DLO moves by u = free + C load, and its forces change by f = load - S u. So it
    moves by u = (I - C S)^-1 (free + C f), and (I - C S)^-1 = I + D S with D = (I - C S)^-1 C.
    """
    size = law.free.size
    matrix, order = np.eye(size), np.empty(size, dtype=np.int64)
    compliance, free = law.compliance.copy(), law.free.copy()
    for a in range(law.friction.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        for j in range(n):
            for k in range(n):
                for r in range(size if law.spring[a, j, k] != 0.0 else 0):
                    matrix[r, i + k] -= law.compliance[r, i + j] * law.spring[a, j, k]
    known = lu_factor(matrix, order) != 0
    if known:
        lu_solve(matrix, order, compliance)
        lu_solve(matrix, order, free.reshape((size, 1)))
    return known, compliance, free


@kernel
def _semismooth(law, proximal, begin, augmentation, iterations, refinements, change, bears):
    """Improve the change (K,) of loads and the active set (A,).

    Return whether they are found, and after how many iterations they obey the laws, or 0. Contacts
    yield by proximal (K,), m/N, times the change of their forces since `begin` (K,), then since the
    last refinement, a proximal step with the active set that is found. Without friction no contact
    joins the active set in the second half of the iterations, so that they end.
    """
    size, count = law.free.size, law.friction.size
    last, same, taken, rubs = bears.copy(), False, 0, size > count
    force, slip, order = np.empty(size), np.empty(size), np.empty(size, dtype=np.int64)
    matrix, right, by_center = np.empty((size, size)), np.empty(size), np.empty((count, 3, 3))
    _put_response(law, change, force, slip)
    center = begin.copy()
    for iteration in range(iterations + 1):
        _put_equations(law, bears, force, slip, augmentation, proximal, center, matrix, right,
                       by_center)
        sign = lu_factor(matrix, order)
        if sign == 0 or sign < 0 and not rubs:  # the active set before is kept
            bears[:] = last
            return iteration > 0, 0
        change[:] = right
        lu_solve(matrix, order, change.reshape((size, 1)))
        last[:] = bears
        _put_response(law, change, force, slip)
        for i in range(size):
            slip[i] += proximal[i] * (force[i] - center[i])
        same, taken = True, iteration + 1
        for a in range(count):
            i = law.first[a]
            bears[a] = (force[i] > 0.0 if bears[a]
                        else slip[i] < 0.0 and (iteration < iterations // 2 or rubs))
            same = same and bears[a] == last[a] and (
                not bears[a] or _obeys_coulomb(law, a, force, slip, augmentation[a]))
        if same:
            break
    bears[:] = last
    for _ in range(refinements):
        for a in range(count):
            i, n = law.first[a], law.first[a + 1] - law.first[a]
            for j in range(n):
                for k in range(n):
                    right[i + j] += by_center[a, j, k] * (force[i + k] - center[i + k])
        center[:] = force
        change[:] = right
        lu_solve(matrix, order, change.reshape((size, 1)))
        _put_response(law, change, force, slip)
    return True, taken if same else 0


@kernel
def _forces(law, change):
    """Return the forces (K,), N, after a change (K,) of the loads."""
    force, slip = np.empty_like(change), np.empty_like(change)
    _put_response(law, change, force, slip)
    return force


@kernel
def _put_response(law, change, force, slip):
    """Fill forces (K,), N, and gaps and slips (K,), m, after a change (K,) of the loads."""
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
def _obeys_coulomb(law, a, force, slip, augmentation):
    """Whether the friction force is the projection of its trial force onto the disk of Coulomb."""
    i = law.first[a]
    limit, size, wrong = law.friction[a] * force[i], 0.0, 0.0
    for j in range(i + 1, law.first[a + 1]):
        size += (force[j] - augmentation * slip[j]) ** 2
    part = limit / np.sqrt(size) if size > limit * limit else 1.0
    for j in range(i + 1, law.first[a + 1]):
        wrong += (force[j] - part * (force[j] - augmentation * slip[j])) ** 2
    return wrong <= (_TOLERANCE * limit) ** 2


@kernel
def _put_equations(law, bears, force, slip, augmentation, proximal, center, matrix, right,
                   by_center):
    """Fill matrix (K, K) and right side (K,) for the change of loads: laws linearized at a state.

    The state is force, slip (K,). Motions are u = free + C load, forces f = force + load - S u,
    gaps g = gap + u, the laws  by_force f + by_slip (g + proximal (f - center)) = 0.
    by_center (A, 3, 3): filled, derivative of the right side by center (K,).
    """
    by_force, by_slip, by_load = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for a in range(bears.size):
        i, n = law.first[a], law.first[a + 1] - law.first[a]
        _put_linearized_law(law, a, bears[a], force, slip, augmentation[a], by_force, by_slip)
        for j in range(n):
            right[i + j] = 0.0
            matrix[i + j] = 0.0
            for k in range(n):
                by_center[a, j, k] = by_slip[j, k] * proximal[i + k]
                by_force[j, k] += by_center[a, j, k]
            for k in range(n):
                by_load[j, k] = by_slip[j, k]
                for m in range(n):
                    by_load[j, k] -= by_force[j, m] * law.spring[a, m, k]
                right[i + j] += (by_center[a, j, k] * center[i + k]
                                 - by_load[j, k] * law.free[i + k]
                                 - by_force[j, k] * law.force[i + k]
                                 - by_slip[j, k] * law.gap[i + k])
                part = by_load[j, k]
                for m in range(right.size if part != 0.0 else 0):
                    matrix[i + j, m] += part * law.compliance[i + k, m]
            for k in range(n):
                matrix[i + j, i + k] += by_force[j, k]


@kernel
def _put_linearized_law(law, a, bears, force, slip, augmentation, by_force, by_slip):
    """Fill by_force, by_slip (3, 3): the linearized law is  by_force f + by_slip g = 0.

    Not in the active set: no force. In it: no gap; no slip if it sticks; if it slides, a force of
    the size of Coulomb's limit along the trial force, f - augmentation g (Alart and Curnier).
    """
    i, n = law.first[a], law.first[a + 1] - law.first[a]
    by_force[:] = 0.0
    by_slip[:] = 0.0
    for j in range(n):
        if not bears:
            by_force[j, j] = 1.0
        else:
            by_slip[j, j] = law.stiffness if j == 0 else augmentation
    if n == 1 or not bears:
        return
    first = force[i + 1] - augmentation * slip[i + 1]
    second = force[i + 2] - augmentation * slip[i + 2]
    size, limit = np.sqrt(first * first + second * second), law.friction[a] * max(0.0, force[i])
    if size <= limit:
        return
    along = (0.0, first / size, second / size)
    for j in (1, 2):
        by_force[j, 0] = -law.friction[a] * along[j]
        for k in (1, 2):
            part = limit / size * ((j == k) - along[j] * along[k])
            by_force[j, k] = (j == k) - part
            by_slip[j, k] = augmentation * part
