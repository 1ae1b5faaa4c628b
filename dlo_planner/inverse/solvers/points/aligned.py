# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Equilibrium and alignment in one Newton system: the shape and the gripper's rotation at once.

Unknowns: the strains q and a rotation w of the gripper. Equations: the gradient of the potential
vanishes; the tangent at one arc length is the goal's normal (two rows); and the gripper has not
turned about a given axis since a reference (one row, for one rotation is left free: a straight
round DLO may roll about the gripper's axis, a bent weightless one about the normal). Gravity
does not depend on the gripper's position, which follows afterwards (paper, section 5.2). The
Hessian is the direct simulator's, so an inverse solve costs about as much as a direct one.
"""

import math
from typing import Any

import numpy as np

from dlo_planner.energy.potential import evaluate, project, value_at
from dlo_planner.energy.problem import Configuration, Problem, new_configuration, with_gripper
from dlo_planner.geometry.record import copy, put_sum, scaled_by
from dlo_planner.geometry.so3 import (
    applied,
    columns_scaled,
    inner,
    jacobians,
    matrix,
    put_matrix,
    put_vector,
    rotation_and_chord,
    times,
    times_transposed,
    vector,
)
from dlo_planner.geometry.so3 import cross as crossed
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import residual_of
from dlo_planner.minimize.hessian import (
    Hessian,
    assemble,
    assembled_definite,
    at_once,
    factorize,
    largest_turn,
    new_hessian,
    safe_shift,
    solve,
)
from dlo_planner.minimize.kkt import add_to
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.minimize.newton import WELL_STABLE
from dlo_planner.minimize.riccati import answer_to_turn
from dlo_planner.model.arrays import Floats

_SINGULAR = 1e-14
_LARGEST_TURN = 0.6  # rad per step, of the gripper and of any node
LEAVES = 5.0        # 1/rad: of a misfit, what an old factorization leaves per rad turned since
OLD = 1e-4          # rad, turned since: an older factorization tells nothing of stability
_PER_TURN = 100.0    # change of an eigenvalue per rad, at most


def free_axis(reference: Floats, normal: Floats) -> Floats:
    """Return the axis (3,) about which the gripper shall not turn: its own and the normal's mean.

    Both bodies' free rotations have a part about it, so the condition is regular unless the
    gripper points against the normal; then it is the gripper's own axis.
    """
    axis = reference[:, 0] + normal
    size = math.sqrt(axis @ axis)
    return axis / size if size > 0.1 else np.array(reference[:, 0])


@kernel
def aligned_newton(system: Problem, q: Floats, element: int, fraction: float, normal: Floats,
                   reference: Floats, axis: Floats, tolerance: float,
                   max_iterations: int) -> tuple[Configuration, Floats, float, float, float, int,
                                                 bool]:
    """Find the equilibrium whose tangent inside `element` is `normal`.

    Args:
        system: its `base` is where the gripper's rotation starts
        q: (m, 3) scaled unknowns to start from
        element, fraction: where the tangent is prescribed
        normal: (3,) unit vector
        reference: (3, 3) gripper rotation since which it must not turn about `axis`
        axis: (3,) world, see `free_axis`
        tolerance: of the residual and of the misalignment in rad
        max_iterations: Newton steps at most

    Returns:
        state, base (3, 3) gripper rotation, residual, misalignment (rad), stability (smallest
        eigenvalue of the Hessian), iterations, converged
    """
    here = with_gripper(system, system.base.copy(), system.origin)
    there = with_gripper(system, system.base.copy(), system.origin)
    state, trial = new_configuration(here), new_configuration(here)
    hessian = new_hessian(here)
    across = _perpendicular(normal)
    m = state.q.shape[0]
    part, tangent = np.empty((3, 3)), np.empty(3)
    load, answers, turned = np.empty((m, 3)), np.empty((4, m, 3)), np.empty((4, 3))
    rows, right, turn = np.empty((3, 3)), np.empty(3), np.empty(3)
    state.q[:] = q
    evaluate(here, state)
    miss = _miss(here, state, element, fraction, across, reference, axis, part, tangent)
    merit = _merit(here, state, miss)
    converged = False
    iterations, negative, since = 0, 1, np.inf  # rad turned since the Hessian was factorized
    while True:
        residual = residual_of(here, state)
        misaligned = np.arctan2(np.sqrt(miss[0]**2 + miss[1]**2), inner(tangent, normal))
        converged = residual < tolerance and misaligned < tolerance
        stale = converged and negative == 0 and since < OLD
        if stale:
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
        for column in range(0 if fresh else 3, 4):
            _fill_turn(here, hessian, part, element, answers[column], turned[column])
        _fill_rows(here.base, miss, tangent, across, reference, axis, turned, rows, right)
        if not _solved(rows, right, turn):
            break
        step = answers[3]
        for column in range(3):
            add_to(step, turn[column], answers[column])
        size = max(np.sqrt(inner(turn, turn)), largest_turn(here, hessian, step))
        if not np.isfinite(size):
            break
        portion = min(1.0, _LARGEST_TURN / size) if size > 0 else 1.0
        moved = False
        for _ in range(8):
            turn_by(here.base, portion * turn, there.base)
            put_sum(state.q, portion, step, trial.q)
            evaluate(there, trial)
            new_miss = _miss(there, trial, element, fraction, across, reference, axis, part,
                             tangent)
            new_merit = _merit(there, trial, new_miss)
            if new_merit < merit * (1 - 0.1 * portion) or new_merit < tolerance:
                moved = True
                break
            portion *= 0.5
        if moved:
            since += size
            merit, miss = new_merit, new_miss
            state, trial = trial, state
            here, there = there, here
        elif fresh:
            break
        else:  # the Hessian has changed by too much
            since = np.inf
            _miss(here, state, element, fraction, across, reference, axis, part, tangent)
    stability = stability_near(here, state, hessian, negative, since)
    return state, here.base, residual, misaligned, stability, iterations, converged


@kernel
def stability_near(system: Problem, state: Configuration, hessian: Hessian, negative: int,
                   since: float) -> Any:
    """Return the smallest eigenvalue of the Hessian, factorized with `negative` eigenvalues.

    Where the DLO has turned `since`, in rad, that is of the shape before, which tells a stable one.
    """
    stability = -np.inf
    if since > 0.0:
        stability, _ = lowest_mode(system, hessian, 0.0, 1e-4)
    if not stability > WELL_STABLE + _PER_TURN * since:
        if since > 0.0:
            assemble(system, state, hessian)
            negative = factorize(system, hessian, 0.0)
        shift = safe_shift(system, hessian, 1e-3) if negative > 0 else 0.0
        stability, _ = lowest_mode(system, hessian, shift, 1e-4)
    return stability


@kernel
def _perpendicular(normal: Floats) -> Floats:
    across = np.empty((2, 3))
    helper = np.zeros(3)
    helper[np.argmin(np.abs(normal))] = 1.0
    across[0] = np.cross(normal, helper)
    across[0] /= np.sqrt(inner(across[0], across[0]))
    across[1] = np.cross(normal, across[0])
    return across


@kernel
def _miss(system: Problem, state: Configuration, element: int, fraction: float, across: Floats,
          reference: Floats, axis: Floats, part: Floats, tangent: Floats) -> Floats:
    """Return the three conditions' misfits; fill tangent and the turning of the part element."""
    h = fraction * system.lengths[element]
    u, scale = state.strains[element], system.scale[element]
    turn, _ = rotation_and_chord(h * u[0], h * u[1], h * u[2], h)
    turning, _ = jacobians(h * u[0], h * u[1], h * u[2], h)
    frame = matrix(state.rotations[element])
    put_vector(applied(frame, (turn[0], turn[3], turn[6])), tangent)
    put_matrix(columns_scaled(times(frame, turning), h * scale[0], h * scale[1], h * scale[2]),
               part)
    m = times_transposed(matrix(system.base), matrix(reference))
    # about the axis: 2 sin(angle) times the rotation's own
    return np.array([inner(across[0], tangent), inner(across[1], tangent),
                     inner(vector(axis), (m[7] - m[5], m[2] - m[6], m[3] - m[1]))])


@kernel
def _merit(system: Problem, state: Configuration, miss: Floats) -> Any:
    return residual_of(system, state) + np.sqrt(inner(miss, miss))


@kernel
def answer(system: Problem, state: Configuration, hessian: Hessian, fresh: bool, load: Floats,
            answers: Floats) -> None:
    """Fill answers (4, m, 3): changes of the equilibrium per gripper rotation about x, y, z.

    Those are known where the Hessian is not `fresh`. The fourth is Newton's step in a gripper that
    rests. `load` (m, 3) is for use here.
    """
    copy(state.gradient, load)
    scaled_by(-1.0, load)
    solve(system, hessian, load, answers[3])
    for column in range(3 if fresh else 0):
        if at_once(system):
            answer_to_turn(hessian, column, answers[column])
        else:
            project(system.basis, -hessian.cross[:, :, column], load)
            solve(system, hessian, load, answers[column])


@kernel
def _fill_rows(base: Floats, miss: Floats, tangent: Floats, across: Floats, reference: Floats,
               axis: Floats, turned: Floats, rows: Floats, right: Floats) -> None:
    """Fill rows (3, 3) and right (3,): the conditions on a rotation of the gripper, linearized."""
    for row in range(2):
        lever = crossed(vector(tangent), vector(across[row]))
        for column in range(3):
            rows[row, column] = lever[column] + inner(lever, vector(turned[column]))
        right[row] = -miss[row] - inner(lever, vector(turned[3]))
    # the axial vector of w^ M is (tr(M) I - M) w
    m = times_transposed(matrix(base), matrix(reference))
    trace = m[0] + m[4] + m[8]
    for column in range(3):
        rows[2, column] = trace * axis[column] - (
            axis[0] * m[column] + axis[1] * m[3 + column] + axis[2] * m[6 + column])
    right[2] = -miss[2]


@kernel
def _solved(rows: Floats, right: Floats, out: Floats) -> bool:
    """Fill out (3,) with the solution of rows (3, 3) out = right (3,), if there is one."""
    a, b, c = vector(rows[0]), vector(rows[1]), vector(rows[2])
    bc, ca, ab = crossed(b, c), crossed(c, a), crossed(a, b)
    volume = inner(a, bc)
    if not abs(volume) >= _SINGULAR:
        return False
    for i in range(3):
        out[i] = (right[0] * bc[i] + right[1] * ca[i] + right[2] * ab[i]) / volume
    return True


@kernel
def _fill_turn(system: Problem, hessian: Hessian, part: Floats, element: int, step: Floats,
               theta: Floats) -> None:
    """Fill the rotation (3,) of the frame inside `element` that the step (m, 3) makes."""
    for i in range(3):
        theta[i] = 0.0
    turnings, basis = hessian.twist_jacobian, system.basis
    for e in range(element + 1):
        turning = part if e == element else turnings[e]
        x, y, z = value_at(basis, step, e)
        for i in range(3):
            theta[i] += turning[i, 0] * x + turning[i, 1] * y + turning[i, 2] * z


@kernel
def turn_by(base: Floats, turn: Floats, out: Floats) -> None:
    """Fill out (3, 3) = exp(turn^) base."""
    rotation, _ = rotation_and_chord(turn[0], turn[1], turn[2], 1.0)
    put_matrix(times(rotation, matrix(base)), out)
