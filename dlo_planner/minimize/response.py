# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How an equilibrium answers to small changes: implicit differentiation.

The gradient of the potential stays zero when the gripper moves, so H dq = - d(gradient), with the
Hessian of the equilibrium: a few solves with one factorization, far cheaper than another search.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import trial_traction
from dlo_planner.energy.grip import put_misses_by_twist, put_sliding_force
from dlo_planner.energy.potential import at_elements, evaluate, project, value_at
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    new_configuration,
    unknown_count,
    with_gripper,
)
from dlo_planner.energy.terms import constraint_jacobian, row_count
from dlo_planner.geometry.kinematics import part_of_element, point_inside, put_own_twist
from dlo_planner.geometry.so3 import coefficients_in, minus, vector
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_solver import firm
from dlo_planner.minimize.contact_table import touching
from dlo_planner.minimize.dense import lu_factor, lu_solve
from dlo_planner.minimize.hessian import (
    Hessian,
    assemble,
    factorize,
    new_hessian,
    solve,
    solve_held,
)
from dlo_planner.minimize.kkt import dots
from dlo_planner.minimize.semismooth import unit_loads
from dlo_planner.model.arrays import Floats


@kernel
def strain_answers(system: Problem, hessian: Hessian, slopes: Floats) -> Floats:
    """Return (k, N, 3) the answers of the strains to slopes (k, N, 3) of the potential by them."""
    out = np.empty_like(slopes)
    m = unknown_count(system)
    load, answer = np.empty((m, 3)), np.empty((m, 3))
    held = row_count(system.needs.border)
    miss, reaction = np.zeros(held), np.empty(held)
    basis, scale = system.basis, system.scale
    for k in range(slopes.shape[0]):
        project(basis, -scale * slopes[k], load)
        solve_held(system, hessian, load, miss, answer, reaction)
        for e in range(slopes.shape[1]):
            x, y, z = value_at(basis, answer, e)
            out[k, e, 0], out[k, e, 1], out[k, e, 2] = (scale[e, 0] * x, scale[e, 1] * y,
                                                        scale[e, 2] * z)
    return out


@kernel
def linearize(system: Problem, q: Floats) -> tuple[Problem, Configuration, Floats, Hessian, int]:
    """Return a Problem at its equilibrium q (m, 3), contacts firm, and its `gripper_answers`.

    The last one is how many of a gripper's twists have answers, see `node_twists`.
    """
    there = firm(system.effects.contact, system, q)
    state, answers, hessian = gripper_answers(there, q)
    return there, state, answers, hessian, hessian.cross.shape[2]


@kernel
def gripper_answers(system: Problem, q: Floats) -> tuple[Configuration, Floats, Hessian]:
    """Return the Configuration at q (m, 3), its change (6, m, 3) by the gripper, the Hessian."""
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    factorize(system, hessian, 0.0)
    answers = np.zeros((6, q.shape[0], 3))
    load = np.empty_like(q)
    held = row_count(system.needs.border)
    moved, reaction = np.empty((held, 6)), np.empty(held)  # the grip does not go with the gripper
    constraint_jacobian(system.effects, state, moved)
    for column in range(hessian.cross.shape[2]):
        project(system.basis, -hessian.cross[:, :, column], load)
        solve_held(system, hessian, load, moved[:, column].copy(), answers[column], reaction)
    return state, answers, hessian


@kernel
def hanging_answers(system: Problem, grippers: Floats, q: Floats, slopes: Floats) -> Floats:
    """Return (n, 3 + k, N, 3) how the strains of n shapes that hang freely answer, 1/m.

    To the turns of each one's gripper, then to slopes (n, k, N, 3) of the potential by them.

    Args:
        grippers: (n, 3, 3) rotations
        q: (n, m, 3) the equilibria
    """
    count, size = slopes.shape[1], slopes.shape[2]
    out = np.empty((q.shape[0], 3 + count, size, 3))
    scale = system.scale
    for j in range(q.shape[0]):
        held = with_gripper(system, grippers[j], system.origin)
        _, answers, hessian = gripper_answers(held, q[j])
        for column in range(3):
            for e in range(size):
                x, y, z = value_at(system.basis, answers[column], e)
                out[j, column, e, 0], out[j, column, e, 1], out[j, column, e, 2] = (
                    scale[e, 0] * x, scale[e, 1] * y, scale[e, 2] * z)
        out[j, 3:] = strain_answers(held, hessian, slopes[j])
    return out


@kernel
def hanging_slopes(system: Problem, grippers: Floats, strains: Floats) -> Floats:
    """Return (n, N, 3) the potential's slopes by the strains (n, N, 3) of n shapes, J m.

    Args:
        system: in no basis, so that its unknowns are those of elements
        grippers: (n, 3, 3) rotations
    """
    out, state = np.empty_like(strains), new_configuration(system)
    for j in range(strains.shape[0]):
        held = with_gripper(system, grippers[j], system.origin)
        for e in range(strains.shape[1]):
            for i in range(3):
                state.q[e, i] = (strains[j, e, i] - system.natural[e, i]) / system.scale[e, i]
        evaluate(held, state)
        for e in range(strains.shape[1]):
            for i in range(3):
                out[j, e, i] = state.gradient[e, i] / system.scale[e, i]
    return out


@kernel
def _load_at(system, state, hessian, node, force):
    """Return (m, 3) the derivatives by the unknowns of a force (3,) times the place of a node."""
    last = np.full(1, node - 1)
    return unit_loads(system, state, hessian, last, np.ones(1), np.zeros((1, 3)),
                      force.reshape((1, 3)))[:, :, 0]


@kernel
def hold_answers(system: Problem, state: Configuration, hessian: Hessian) -> Floats:
    """Return (6 A, m, 3) the change of the unknowns by the twist of each hold, others at rest.

    Args:
        hessian: of `system` at `state`, factorized
    """
    hold, held = system.effects.hold, row_count(system.needs.border)
    moved, miss, reaction = np.empty((held, 6)), np.zeros(held), np.empty(held)
    put_misses_by_twist(hold, state, moved)
    load, answers = np.zeros_like(state.q), np.zeros((6 * hold.node.size, *state.q.shape))
    turned, force = np.empty(3), np.empty(3)
    for a in range(hold.node.size):
        slides = put_sliding_force(hold, a, force)
        for column in range(6):
            for row in range(hold.first[a], hold.first[a + 1]):
                miss[row] = moved[row, column]
            load[:] = 0.0
            if slides and column < 3:  # what a sleeve exerts across its axis turns with that
                j, k = (column + 1) % 3, (column + 2) % 3
                turned[column], turned[j], turned[k] = 0.0, -force[k], force[j]
                load -= _load_at(system, state, hessian, hold.node[a], turned)
            solve_held(system, hessian, load, miss, answers[6 * a + column], reaction)
        for row in range(hold.first[a], hold.first[a + 1]):
            miss[row] = 0.0
    return answers


@kernel
def node_twists(system: Problem, state: Configuration, answers: Floats, columns: int) -> Floats:
    """Return (N + 1, 6, 6) the twists of the nodes' frames by that of the gripper.

    Args:
        columns: of the gripper's twist, 3 where its displacement moves all alike, else 6; 4: its
            turns, and a change of the strains while it rests; -6: it rests, a hold moves
    """
    n, basis = system.lengths.size, system.basis
    rests, columns = columns < 0, abs(columns)
    out = np.zeros((n + 1, 6, 6))
    parts = np.empty((n, 6, 3))
    lengths, strains, arcs, positions = system.lengths, state.strains, state.arcs, state.positions
    for e in range(n):
        h = lengths[e]
        put_own_twist(h, h * strains[e, 0], h * strains[e, 1], h * strains[e, 2],
                      coefficients_in(arcs[e]), system.scale[e], state.rotations[e], parts[e])
    for i in range(6):
        out[0, i, i] = 1.0 if (i < 3 or columns != 4) and not rests else 0.0
    for column in range(columns):
        values = at_elements(basis, answers[column])
        for e in range(n):
            x, y, z = values[e, 0], values[e, 1], values[e, 2]
            t0, t1, t2 = out[e, 0, column], out[e, 1, column], out[e, 2, column]
            a0, a1, a2 = minus(vector(positions[e + 1]), vector(positions[e]))
            at, part = out[e + 1], parts[e]
            at[0, column] = t0 + _by_strains(part, 0, x, y, z)
            at[1, column] = t1 + _by_strains(part, 1, x, y, z)
            at[2, column] = t2 + _by_strains(part, 2, x, y, z)
            at[3, column] = out[e, 3, column] + t1 * a2 - t2 * a1 + _by_strains(part, 3, x, y, z)
            at[4, column] = out[e, 4, column] + t2 * a0 - t0 * a2 + _by_strains(part, 4, x, y, z)
            at[5, column] = out[e, 5, column] + t0 * a1 - t1 * a0 + _by_strains(part, 5, x, y, z)
    for e in range(n):
        for i in range(6):
            for column in range(columns, 6):
                out[e + 1, i, column] = out[0, i, column]
    return out


@kernel(forceinline=True)
def _by_strains(part, row, x, y, z):
    """Return a component of the twist that an element's own strains (x, y, z) make."""
    return part[row, 0] * x + part[row, 1] * y + part[row, 2] * z


@kernel
def twists_inside(system: Problem, state: Configuration, answers: Floats, columns: int,
                  begin: Floats, element: int, fraction: float) -> Floats:
    """Return (6, 6) the same inside `element`, whose beginning has the twists `begin` (6, 6)."""
    out = begin.copy()
    part, arm = np.empty((6, 3)), np.empty(3)
    _carry_on(system, state, answers, columns, element, fraction, part, arm, out)
    return out


@kernel
def _carry_on(system: Problem, state: Configuration, answers: Floats, columns: int, e: int,
              share: float, part: Floats, arm: Floats, out: Floats) -> None:
    """Turn the twists `out` (6, 6) at the beginning of element e into those at a share of it.

    Args:
        part: (6, 3), arm: (3,) to work with
    """
    basis = system.basis
    part_of_element(system.lengths[e], share, state.strains[e], system.scale[e],
                    state.rotations[e], part, arm)
    for column in range(columns):
        t0, t1, t2 = out[0, column], out[1, column], out[2, column]
        out[3, column] += t1 * arm[2] - t2 * arm[1]
        out[4, column] += t2 * arm[0] - t0 * arm[2]
        out[5, column] += t0 * arm[1] - t1 * arm[0]
        x, y, z = value_at(basis, answers[column], e)
        for i in range(6):
            out[i, column] += part[i, 0] * x + part[i, 1] * y + part[i, 2] * z


@kernel
def add_slip(system: Problem, state: Configuration, hessian: Hessian, answers: Floats,
             carried: bool) -> None:
    """Complete `answers` (k, m, 3) to twists by what slides: T follows mu N.

    Args:
        carried: whether they are those of the gripper, with which all is carried along; k = 6
        hessian: of `system` at `state`, factorized; with the springs of friction alone, which know
            nothing of the forces that the limits depend on
    """
    contacts, k = system.effects.contact.contacts, system.effects.contact.contacts.stiffness
    table = touching(system.effects.contact.scene, contacts, system.lengths, state)
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty((table.gap.size, 3))
    slides = np.empty(table.gap.size, dtype=np.int64)
    size = 0
    for a in range(table.gap.size):
        c = table.rubbing[a]
        if c >= 0:
            point_inside(system.lengths, state.strains, state.rotations, state.positions,
                         contacts.element[c], contacts.fraction[c], rotation, x)
            whole = trial_traction(contacts, c, x, trial[size])
            if whole > contacts.multiplier[c]:
                trial[size] /= whole
                slides[size] = a
                size += 1
    slides = slides[:size]
    element, fraction, response = (table.element[slides], table.fraction[slides],
                                   np.empty((size, *state.q.shape)))
    count = answers.shape[0]
    matrix, change, load = np.eye(size), np.zeros((count, size)), np.empty_like(state.q)
    across = unit_loads(system, state, hessian, element, fraction, table.arm[slides],
                        table.normal[slides])
    along = unit_loads(system, state, hessian, element, fraction, np.zeros((size, 3)), trial)
    for p in range(size):
        a = slides[p]
        load[:] = along[:, :, p]
        solve(system, hessian, load, response[p])
        response[p] *= system.effects.contact.scene.friction[table.obstacle[a]]
        point_inside(system.lengths, state.strains, state.rotations, state.positions, element[p],
                     fraction[p], rotation, x)
        x += table.arm[a]
        normal = table.normal[a]
        for i in range(3 if carried else 0):
            j, m = (i + 1) % 3, (i + 2) % 3
            change[i, p] = x[j] * normal[m] - x[m] * normal[j]  # turned with the gripper
            change[3 + i, p] = normal[i]
        matrix[:, p] -= k * dots(across, response[p])
    for i in range(count):
        change[i] = -k * (change[i] + dots(across, answers[i]))
    order = np.empty(size, dtype=np.int64)
    if lu_factor(matrix, order) == 0:
        return
    for i in range(count):
        lu_solve(matrix, order, change[i].reshape((size, 1)))
        for p in range(size):
            answers[i] -= change[i, p] * response[p]
