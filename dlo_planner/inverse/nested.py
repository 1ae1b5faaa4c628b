# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's nested optimization (sections 5.1, 5.2): outer over the gripper, inner direct.

Slower than `waypoint_newton`, and independent of it: nothing but `DirectSimulator.solve` is used.
"""

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
                     reference: Floats, penalty: float = 1.0) -> Shape:
    """Return the Shape whose tangent at `s` is `normal`, minimizing c arccos(t . n)^2.

    The outer variables are two rotations of the gripper since `reference`, across `free_axis`.
    The penalty is written as a sum of squares, c |angle vector|^2, and left to least squares.

    Shapes: normal (3,), reference (3, 3).
    """
    latest = initial
    # steps are judged by the size of the variables: tilts of zero would be sought to 1e-308
    offset = 1.0
    across = null_space(free_axis(np.array(reference), np.array(normal))[None, :])

    def gripper(tilts: Floats) -> Pose:
        turn = Rotation.from_rotvec(across @ (tilts - offset)).as_matrix()
        return Pose.from_rotation((0.0, 0.0, 0.0), turn @ reference)

    def root_penalty(tilts: Floats) -> Floats:
        nonlocal latest
        shape = simulator.solve(gripper(tilts), latest)
        if shape.converged:
            latest = shape
        tangent = shape.at(s).direction
        axis = np.cross(tangent, normal)
        sine = np.linalg.norm(axis)
        angle = np.arctan2(sine, tangent @ normal)
        vector = axis * (angle / sine) if sine > 0 else axis
        root: Floats = np.sqrt(penalty) * vector
        return root

    start = across.T @ Rotation.from_matrix(initial.gripper.rotation @ reference.T).as_rotvec()
    solution = least_squares(root_penalty, start + offset, jac='3-point', method='lm', xtol=1e-14,
                             ftol=1e-14, gtol=1e-14, diff_step=1e-5, max_nfev=500)
    return simulator.solve(gripper(solution.x), latest)
