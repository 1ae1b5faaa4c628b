# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's nested optimization of a waypoint: outside the gripper, inside direct simulation."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.waypoint_newton import free_axis
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose


def nested_alignment(simulator: DirectSimulator, initial: Shape, s: float, normal: Floats,
                     reference: Floats) -> Shape:
    """Return the Shape whose tangent at `s` is `normal`, by the paper's nested optimization.

    Sections 5.1, 5.2: outside arccos(t . n)^2, a sum of squares, is minimized over two rotations of
    the gripper since `reference`, across `free_axis`; inside is the direct simulation. Slower than
    `waypoint_newton`, and independent of it.
    """
    latest = initial
    # steps are judged by the size of the variables: tilts of zero would be sought to 1e-308
    offset = 1.0
    across = null_space(free_axis(np.array(reference), np.array(normal))[None, :])

    def gripper(tilts: Floats) -> Pose:
        turn = Rotation.from_rotvec(across @ (tilts - offset)).as_matrix()
        return Pose.from_rotation((0.0, 0.0, 0.0), turn @ reference)

    def angle_vector(tilts: Floats) -> Floats:
        nonlocal latest
        shape = simulator.solve(gripper(tilts), latest)
        if shape.converged:
            latest = shape
        tangent = shape.at(s).direction
        axis = np.cross(tangent, normal)
        sine = np.linalg.norm(axis)
        angle = np.arctan2(sine, tangent @ normal)
        return axis * (angle / sine) if sine > 0 else axis

    start = across.T @ Rotation.from_matrix(initial.gripper.rotation @ reference.T).as_rotvec()
    solution = least_squares(angle_vector, start + offset, jac='3-point', method='lm', xtol=1e-14,
                             ftol=1e-14, gtol=1e-14, diff_step=1e-5, max_nfev=500)
    return simulator.solve(gripper(solution.x), latest)
