# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""When the gripper is where: the shortest times under a linear and an angular speed limit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose


def times_at_speed(grippers: Sequence[Pose], linear_speed: float, angular_speed: float) -> Floats:
    """Return (n,) times in s: each leg takes as long as the slower of its two motions.

    Parameters
    ----------
    grippers : sequence of Pose
        The n poses.
    linear_speed : float
        Linear speed in m/s.
    angular_speed : float
        Angular speed in rad/s.
    """
    if len(grippers) < 2:
        return np.zeros(len(grippers))
    positions = np.array([pose.position for pose in grippers])
    rotations = Rotation.from_matrix([pose.rotation for pose in grippers])
    distance = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    angle = (rotations[1:] * rotations[:-1].inv()).magnitude()
    legs = np.maximum(distance / linear_speed, angle / angular_speed)
    return np.concatenate([[0.0], np.cumsum(legs)])
