# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How the nodes of an equilibrium move with the state of an estimate, to first order.

A change of the potential changes the strains; these follow by a solve with the Hessian of the
equilibrium (`direct.sensitivity`). A change of an element's strain moves all nodes beyond it as one
rigid body.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.geometry.kinematics import part_of_element
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.verify.uncertain import Uncertain, Varied, mesh_of

_LONGER = 1e-5  # of the length: step of the difference quotients by the length


def node_slopes(varied: Varied, z: Floats, shape: Shape, error: Floats | None = None) -> Floats:
    """Return (N + 1, 3, n): derivatives of the nodes' positions (m) by the state.

    With an `error` (N + 1, 3, n + 6): by the robot's error as well, see `Uncertain.offset`.

    Shapes: z (n,), error (6,).
    """
    uncertain, sensitivity = varied.uncertain, Sensitivity(shape)
    size = uncertain.size + (0 if error is None else 6)
    strains = np.zeros((size, *shape.element_strains.shape))
    out = np.zeros((*shape.positions.shape, size))
    _by_rod(varied, z, shape, sensitivity, strains, out)
    _by_gripper(uncertain, z, shape, sensitivity, strains, out, error)
    bent = np.flatnonzero(strains.any(axis=(1, 2)))
    out[:, :, bent] += _moved(*kernel_arrays(shape), strains[bent])
    return out


def _by_rod(varied: Varied, z: Floats, shape: Shape, sensitivity: Sensitivity, strains: Floats,
            out: Floats) -> None:
    """Set the strains (n, N, 3) due to the rod; add to `out` the motion at constant strains."""
    uncertain, system = varied.uncertain, mesh_of(shape).static
    give = np.diff(shape.s)[:, None] * system.stiffness
    moment = give * (shape.element_strains - system.natural)
    slopes = np.zeros_like(strains)
    slopes[uncertain.columns('bending_stiffness')[0], :, 1:] = moment[:, 1:]
    slopes[uncertain.columns('torsional_stiffness')[0], :, 0] = moment[:, 0]
    for column, number in zip(*uncertain.columns('natural_curvature'), strict=True):
        axis = 1 + number % 2
        slopes[column, :, axis] = -give[:, axis] * varied.legendre[:, number // 2]
    for column in uncertain.columns('mass')[0]:
        heavier, _ = sensitivity.slope_of(
            pull=system.pull + uncertain.factors(z)[1] * varied.weight)
        slopes[column] = heavier - sensitivity.slope_of()[0]
    for column in uncertain.columns('length')[0]:
        step = _LONGER * shape.s[-1]
        back, ahead = (varied.at(z + d * np.eye(z.size)[column]).static for d in (-step, step))
        (less, before), (more, after) = (sensitivity.slope_of(**{
            name: getattr(side, name) for name in varied.by_length}) for side in (back, ahead))
        slopes[column] = (more - less) / (2 * step)
        out[:, :, column] += (after - before) / (2 * step)
    acts = np.flatnonzero(slopes.any(axis=(1, 2)))
    strains[acts] = sensitivity.strains_by(slopes[acts])


def _by_gripper(uncertain: Uncertain, z: Floats, shape: Shape, sensitivity: Sensitivity,
                strains: Floats, out: Floats, error: Floats | None) -> None:
    """Set the strains (n, N, 3) due to the gripper's errors; add to `out` their rigid motion."""
    n, robot = uncertain.size, np.arange(3 if error is not None else 0)
    said = shape.gripper.rotation @ uncertain.offset(z, error).rotation.T
    columns, numbers = (np.append(one, more) for one, more in zip(
        uncertain.columns('gripper_rotation'), (n + robot, robot), strict=True))
    if columns.size:
        turns = (said @ left_jacobian(uncertain.gripper_twist(z, error)[:3]))[:, numbers]
        strains[columns] = np.moveaxis(sensitivity.strains[:, :, :3] @ turns, 2, 0)
        arms = shape.positions - shape.gripper.position
        out[:, :, columns] += np.cross(turns.T[None], arms[:, None]).transpose(0, 2, 1)
    columns, numbers = (np.append(one, more) for one, more in zip(
        uncertain.columns('gripper_position'), (n + 3 + robot, robot), strict=True))
    out[:, :, columns] += said[:, numbers]
    if shape.contacts:  # else its shape stays
        strains[columns] = np.moveaxis(sensitivity.strains[:, :, 3:] @ said[:, numbers], 2, 0)


def at_arc_lengths(nodes: Floats, s: Floats, wanted: Floats) -> Floats:
    """Return (m, 3, n) at arc lengths `wanted` (m,): linear between `nodes` (N + 1, 3, n)."""
    element = np.clip(np.searchsorted(s, wanted, side='right') - 1, 0, s.size - 2)
    share = ((wanted - s[element]) / (s[element + 1] - s[element]))[:, None, None]
    return (1 - share) * nodes[element] + share * nodes[element + 1]


@kernel
def _moved(lengths: Floats, strains: Floats, rotations: Floats, positions: Floats,
           changes: Floats) -> Floats:
    """Return (N + 1, 3, k): motions of the nodes by changes (k, N, 3) of the strains."""
    count, n = changes.shape[0], lengths.size
    out = np.zeros((n + 1, 3, count))
    turn = np.zeros((count, 3))  # of the frame at the element's beginning
    part, arm, unscaled = np.empty((6, 3)), np.empty(3), np.ones(3)
    for e in range(n):
        part_of_element(lengths[e], 1.0, strains[e], unscaled, rotations[e], part, arm)
        for k in range(count):
            t0, t1, t2 = turn[k, 0], turn[k, 1], turn[k, 2]
            u0, u1, u2 = changes[k, e, 0], changes[k, e, 1], changes[k, e, 2]
            out[e + 1, 0, k] = out[e, 0, k] + t1 * arm[2] - t2 * arm[1]
            out[e + 1, 1, k] = out[e, 1, k] + t2 * arm[0] - t0 * arm[2]
            out[e + 1, 2, k] = out[e, 2, k] + t0 * arm[1] - t1 * arm[0]
            for i in range(3):
                turn[k, i] += part[i, 0] * u0 + part[i, 1] * u1 + part[i, 2] * u2
                out[e + 1, i, k] += part[3 + i, 0] * u0 + part[3 + i, 1] * u1 + part[3 + i, 2] * u2
    return out
