# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Kirchhoff equations of a hanging rod as a boundary value problem, left to SciPy.

Nothing of the package is used but the rod's numbers: state (x, quaternion, moment), the force is
the weight beyond s, clamped at s = 0, free at s = L.
"""

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.spatial.transform import Rotation


def true_rod(rod, gripper, guess, gravity=(0.0, 0.0, -9.81), tol=1e-10):
    """Return positions at guess.s; `guess` (a Shape) only tells which branch is meant."""
    return equilibrium(rod, gripper, guess, gravity, tol)(guess.s)[:3].T


def equilibrium(rod, gripper, guess, gravity=(0.0, 0.0, -9.81), tol=1e-10):
    """Return a function of s: (position, quaternion, moment), (10,); `guess` as of `true_rod`."""
    stiffness = rod.stiffness

    def slope(s, y):
        quaternion = y[3:7] / np.linalg.norm(y[3:7], axis=0)
        turn = Rotation.from_quat(quaternion.T)
        tangent = turn.apply([1.0, 0.0, 0.0]).T
        strain = turn.inv().apply(y[7:].T).T / stiffness[:, None] + rod.natural_strains(s).T
        moment = -np.cross(tangent.T, _weight_beyond(rod, gravity, s).T).T
        return np.vstack([tangent, _rate(quaternion, strain), moment])

    def ends(start, end):
        return np.concatenate([start[:3] - gripper.position, start[3:7] - gripper.quaternion,
                               end[7:]])

    quaternions = Rotation.from_matrix(np.array(guess.frames)).as_quat()
    for k in range(len(quaternions)):  # one sheet of the double cover, the gripper's
        other = gripper.quaternion if k == 0 else quaternions[k - 1]
        quaternions[k] *= np.sign(quaternions[k] @ other)
    moments = np.einsum('kij,kj->ki', guess.frames,
                        (guess.strains - rod.natural_strains(guess.s)) * stiffness)
    first = np.vstack([guess.positions.T, quaternions.T, moments.T])
    found = solve_bvp(slope, ends, guess.s, first, tol=tol, max_nodes=200_000)
    assert found.success, found.message
    return found.sol


def is_minimum(rod, solution, gravity=(0.0, 0.0, -9.81)):
    """Whether an `equilibrium` of a rod, clamped at s = 0 and free at its tip, is a minimum.

    That is Jacobi's condition: where the part beyond s is turned by a small angle at s, it answers
    with a moment, S times the angle. S vanishes at the free end and obeys a Riccati equation; the
    equilibrium is a minimum if S stays finite up to the clamp.
    """
    def slope(s, packed):
        y, answer = solution(s), packed.reshape(3, 3)
        turn = Rotation.from_quat(y[3:7] / np.linalg.norm(y[3:7])).as_matrix()
        tangent, weight = turn[:, 0], _weight_beyond(rod, gravity, np.array([s]))[:, 0]
        twisted = np.cross(y[7:], np.eye(3), axisb=0, axisc=0)  # moment x
        rate = turn @ np.diag(1 / rod.stiffness) @ turn.T @ (answer + twisted)
        return (weight @ tangent * np.eye(3) - np.outer(tangent, weight) - answer @ rate).ravel()

    def blows_up(_, packed):
        return np.abs(packed).max() - largest

    blows_up.terminal = True
    # of the order of what the rod bears in a part of itself that is short against all its waves
    largest = 1e6 * rod.stiffness.max() / rod.length
    way = solve_ivp(slope, (rod.length, 0.0), np.zeros(9), 'LSODA', rtol=1e-8,
                    atol=1e-10 * largest / 1e6, events=blows_up)
    return way.success and not way.t_events[0].size


def _weight_beyond(rod, gravity, s):
    """Return the weight (3, n) of what is beyond s (n,), N."""
    return np.array(gravity)[:, None] * (rod.mass_per_length * (rod.length - s) + rod.tip_mass)


def true_held_rod(rod, shape, gravity=(0.0, 0.0, -9.81), tol=1e-8, pinned=False,
                  far_pinned=False):
    """Return positions at shape.s of the rod whose far end is held where that of `shape` is.

    Both ends clamped, both pinned, or the far one alone. The force at the gripper is an unknown
    parameter; `shape` only tells which branch is meant.
    """
    gravity, stiffness = np.array(gravity), rod.stiffness

    def slope(s, y, force):
        turn = Rotation.from_quat((y[3:7] / np.linalg.norm(y[3:7], axis=0)).T)
        tangent = turn.apply([1.0, 0.0, 0.0]).T
        strain = turn.inv().apply(y[7:].T).T / stiffness[:, None] + rod.natural_strains(s).T
        inner = -force[:, None] - gravity[:, None] * rod.mass_per_length * s  # beyond s on before
        return np.vstack([tangent, _rate(y[3:7], strain), -np.cross(tangent.T, inner.T).T])

    def ends(start, end, force):
        turned = (Rotation.from_quat(quaternions[-1]).inv()
                  * Rotation.from_quat(end[3:7] / np.linalg.norm(end[3:7]))).as_rotvec()
        first = start[7:] if pinned else start[4:7] - first_quaternion[1:]
        unit = [start[3:7] @ start[3:7] - 1.0]
        return np.concatenate([start[:3] - shape.positions[0], unit, first,
                               end[:3] - shape.positions[-1],
                               end[7:] if pinned or far_pinned else turned])

    quaternions = _one_sheet(Rotation.from_matrix(np.array(shape.frames)).as_quat())
    first_quaternion = quaternions[0]
    moments = np.einsum('kij,kj->ki', shape.frames,
                        (shape.strains - rod.natural_strains(shape.s)) * stiffness)
    first = np.vstack([shape.positions.T, quaternions.T, moments.T])
    found = solve_bvp(slope, ends, shape.s, first, p=shape.gripper_wrench[:3], tol=tol,
                      max_nodes=100_000)
    assert found.success, found.message
    return found.sol(shape.s)[:3].T


def _rate(quaternion, strain):
    """Return dq/ds (4, n) of quaternions (4, n), xyzw, that turn with `strain` (3, n)."""
    x, y, z, w = quaternion
    a, b, c = strain
    return 0.5 * np.array([w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a,
                           -x * a - y * b - z * c])


def _one_sheet(quaternions):
    """Return quaternions (n, 4) whose signs make them continuous."""
    for k in range(1, len(quaternions)):
        quaternions[k] *= np.sign(quaternions[k] @ quaternions[k - 1])
    return quaternions
