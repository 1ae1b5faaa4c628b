# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Equilibrium and two centers in one Newton system, of a DLO that hangs freely: one kernel a shape.

Unknowns: the strains q, a rotation w of the gripper and one of the arc lengths s1, s2. Equations:
the gradient of the potential vanishes, x(s2) - x(s1) = P2 - P1, and the gripper rolls by a given
angle about the axis that is left free.
"""

from typing import Any

import numpy as np

from dlo_planner.energy.potential import at_element, evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, new_configuration, with_gripper
from dlo_planner.geometry.kinematics import part_of_element, point_inside
from dlo_planner.geometry.record import put_sum
from dlo_planner.geometry.so3 import inner
from dlo_planner.inverse.solvers.points.aligned import (
    LEAVES,
    OLD,
    answer,
    stability_near,
    turn_by,
)
from dlo_planner.inverse.solvers.points.coupled import go_ahead, orthonormal
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import residual_of
from dlo_planner.minimize.hessian import assembled_definite, factorize, largest_turn, new_hessian
from dlo_planner.minimize.kkt import add_to
from dlo_planner.minimize.solve import outputs
from dlo_planner.model.arrays import Floats

_LARGEST_TURN = 0.6   # rad per step, of the gripper and of any node
_LARGEST_SHIFT = 0.1  # of the length per step, of an arc length
_HALVINGS = 8
_SINGULAR = 1e-14


@kernel
def two_points_hanging(system: Problem, base: Floats, strains: Floats, earlier_base: Floats,
                       earlier: Floats, ahead: float, s: Floats, way: Floats, first: float,
                       second: float, first_free: bool, axis: Floats, roll: float,
                       tolerance: float, exact: float,
                       max_iterations: int) -> tuple[tuple[Any, ...], Floats, float, float, bool]:
    """Find the equilibrium with x(second) - x(first) = `way`.

    Args:
        system, base, strains, earlier_base, earlier, ahead, tolerance, max_iterations: as in
            `coupled.aligned_hanging`
        s: (N + 1,), read-only, of the nodes, m; way: (3,), read-only, m
        first, second: arc lengths, m; first_free: whether the first one is sought, else the second
        axis: (3,) unit vector about which the gripper is to turn by `roll` from `base`, rad
        exact: of x(second) - x(first), m

    Returns:
        what `minimize.solve.solve_free` returns, of a gripper in the origin
        base: (3, 3) rotation of the gripper; first, second: m; converged
    """
    length = s[-1]
    here = with_gripper(system, base.copy(), system.origin)
    there = with_gripper(system, base.copy(), system.origin)
    state, trial = new_configuration(here), new_configuration(here)
    hessian = new_hessian(here)
    load, answers = np.empty_like(state.q), np.empty((4, state.q.shape[0], 3))
    moved = np.empty((2, 4, 3))
    ends, new_ends = np.empty((2, 2, 3)), np.empty((2, 2, 3))  # place and tangent at both
    rows, right, turn, begin = np.empty((4, 4)), np.empty(4), np.empty(3), strains.copy()
    go_ahead(earlier_base, earlier, ahead, here.base, begin, turn)
    unknowns_of(here, begin, state.q)
    evaluate(here, state)
    miss = _miss(system, state, s, first, second, way, ends)
    missing, converged, iterations = roll - inner(axis, turn), False, 0
    merit = _merit(here, state, miss, missing, length)
    negative, since = 1, np.inf  # rad turned since the Hessian was factorized
    while True:
        residual = residual_of(here, state)
        converged = (residual < tolerance and np.sqrt(inner(miss, miss)) < exact
                     and abs(missing) < tolerance)
        if converged and negative == 0 and since < OLD:
            break
        # near the end the factorization before is as good
        fresh = converged or negative > 0 or not LEAVES * since * merit < tolerance
        if fresh:
            negative, since = 0, 0.0
            if not assembled_definite(here, state, hessian, 0.0):
                negative = factorize(here, hessian, 0.0)
        if converged or iterations >= max_iterations:
            break
        iterations += 1
        answer(here, state, hessian, fresh, load, answers)
        _displacements(here, state, answers, s, first, second, moved)
        _fill_rows(miss, missing, ends, moved, axis, first_free, rows, right)
        if not abs(np.linalg.det(rows)) > _SINGULAR * length**3:
            break
        found = np.linalg.solve(rows, right)
        turn[:], shift = found[:3], found[3]
        step = answers[3]
        for column in range(3):
            add_to(step, turn[column], answers[column])
        size = max(np.sqrt(inner(turn, turn)), largest_turn(here, hessian, step))
        if not np.isfinite(size + shift):
            break
        portion = min(1.0, _LARGEST_TURN / max(size, 1e-300),
                      _LARGEST_SHIFT * length / max(abs(shift), 1e-300))
        accepted = False
        for _ in range(_HALVINGS):
            low = first + portion * shift if first_free else first
            high = second if first_free else second + portion * shift
            if 0.0 <= low < high <= length * (1 + 1e-12):
                high = min(high, length)
                turn_by(here.base, portion * turn, there.base)
                put_sum(state.q, portion, step, trial.q)
                evaluate(there, trial)
                new_miss = _miss(system, trial, s, low, high, way, new_ends)
                left = missing - portion * inner(axis, turn)
                new_merit = _merit(there, trial, new_miss, left, length)
                if new_merit < merit * (1 - 0.1 * portion) or new_merit < tolerance:
                    accepted = True
                    break
            portion *= 0.5
        if accepted:
            since += size
            merit, miss, missing, first, second = new_merit, new_miss, left, low, high
            state, trial = trial, state
            here, there = there, here
            ends, new_ends = new_ends, ends
        elif fresh:
            break
        else:  # the Hessian has changed by too much
            since = np.inf
    stability = stability_near(here, state, hessian, negative, since)
    wrench = np.empty(6)
    elastic, energy = outputs(system, state, wrench)
    return (state.strains, state.rotations, state.positions, wrench, elastic, energy, residual,
            stability, iterations, 0), orthonormal(here.base), first, second, converged


@kernel
def _fill_rows(miss: Floats, missing: float, ends: Floats, moved: Floats, axis: Floats,
               first_free: bool, rows: Floats, right: Floats) -> None:
    """Fill rows (4, 4) and right (4,): the conditions on the gripper's turn and an arc length."""
    for i in range(3):
        for column in range(3):
            rows[i, column] = moved[1, column, i] - moved[0, column, i]
            rows[3, column] = axis[column]
        rows[i, 3] = -ends[0, 1, i] if first_free else ends[1, 1, i]
        right[i] = -miss[i] - moved[1, 3, i] + moved[0, 3, i]
    rows[3, 3], right[3] = 0.0, missing


@kernel
def _merit(system: Problem, state: Configuration, miss: Floats, missing: float,
           length: float) -> Any:
    return residual_of(system, state) + np.sqrt(inner(miss, miss)) / length + abs(missing)


@kernel
def _element(s: Floats, where: float) -> Any:
    """Return the element in which an arc length (m) is."""
    return min(np.searchsorted(s, where, side='right') - 1, s.size - 2)


@kernel
def _miss(system: Problem, state: Configuration, s: Floats, first: float, second: float,
          way: Floats, ends: Floats) -> Any:
    """Return x(second) - x(first) - way; fill ends (2, 2, 3) with place and tangent at both."""
    frame, place, where = np.empty((3, 3)), np.empty(3), first
    for end in range(2):
        e = _element(s, where)
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     (where - s[e]) / system.lengths[e], frame, place)
        for i in range(3):
            ends[end, 0, i], ends[end, 1, i] = place[i], frame[i, 0]
        where = second
    return ends[1, 0] - ends[0, 0] - way


@kernel
def _displacements(system: Problem, state: Configuration, answers: Floats, s: Floats, first: float,
                   second: float, moved: Floats) -> None:
    """Fill moved (2, 4, 3) with the displacements of the DLO at two arc lengths.

    By turns of the gripper about each world axis, with what the strains answer, and by the last of
    the answers (4, m, 3) alone.
    """
    lengths, scale, basis = system.lengths, system.scale, system.basis
    part, arm, value = np.empty((6, 3)), np.empty(3), np.empty(3)
    turn, shift = np.zeros((4, 3)), np.zeros((4, 3))
    for column in range(3):
        turn[column, column] = 1.0
    begin, end = _element(s, first), _element(s, second)
    for e in range(end + 1):
        if e == begin:
            _fill_moved(system, state, answers, e, (first - s[e]) / lengths[e], turn, shift,
                        moved[0])
        if e == end:
            _fill_moved(system, state, answers, e, (second - s[e]) / lengths[e], turn, shift,
                        moved[1])
            break
        part_of_element(lengths[e], 1.0, state.strains[e], scale[e], state.rotations[e], part, arm)
        for column in range(4):
            _carry(turn[column], arm, shift[column])
            for i in range(3):
                value[i] = at_element(basis, answers[column], e, i)
            for i in range(3):
                turn[column, i] += inner(part[i], value)
                shift[column, i] += inner(part[3 + i], value)


@kernel
def _fill_moved(system: Problem, state: Configuration, answers: Floats, e: int, fraction: float,
                turn: Floats, shift: Floats, moved: Floats) -> None:
    """Fill moved (4, 3) at a fraction of the element e, whose beginning has turn and shift."""
    part, arm, value = np.empty((6, 3)), np.empty(3), np.empty(3)
    part_of_element(system.lengths[e], fraction, state.strains[e], system.scale[e],
                    state.rotations[e], part, arm)
    for column in range(4):
        for i in range(3):
            moved[column, i] = shift[column, i]
            value[i] = at_element(system.basis, answers[column], e, i)
        _carry(turn[column], arm, moved[column])
        for i in range(3):
            moved[column, i] += inner(part[3 + i], value)


@kernel
def _carry(turn: Floats, arm: Floats, shift: Floats) -> None:
    """Add to `shift` (3,) what a turn (3,) does at the end of an arm (3,)."""
    shift[0] += turn[1] * arm[2] - turn[2] * arm[1]
    shift[1] += turn[2] * arm[0] - turn[0] * arm[2]
    shift[2] += turn[0] * arm[1] - turn[1] * arm[0]
