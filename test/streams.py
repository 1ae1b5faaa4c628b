# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a stream of poses uses of its limits, by differences: written apart from the node."""

import numpy as np
from scipy.spatial.transform import Rotation

ROUNDED = 1.002  # of a limit: differences of rounded numbers, three times over a period


def shares(poses, limits, period, rests=(True, True)):
    """Return (3, 2): largest speed, acceleration, jerk (linear, angular) as parts of the limits.

    Args:
        rests: whether the gripper stands still before the first pose, after the last
    """
    poses = [poses[0]] * 4 * rests[0] + list(poses) + [poses[-1]] * 4 * rests[1]
    places = np.array([pose.position for pose in poses])
    turns = Rotation.from_quat([pose.quaternion for pose in poses])
    linear = [np.diff(places, n, axis=0) / period**n for n in (1, 2, 3)]
    spin = (turns[1:] * turns[:-1].inv()).as_rotvec() / period
    angular = [np.diff(spin, n, axis=0) / period**n for n in (0, 1, 2)]
    most = [[limits.linear_speed, limits.angular_speed],
            [limits.linear_acceleration, limits.angular_acceleration],
            [limits.linear_jerk, limits.angular_jerk]]
    return np.array([[np.linalg.norm(rows, axis=1).max() for rows in pair]
                     for pair in zip(linear, angular, strict=True)]) / most


def largest(poses, limits, period, **more):
    """Return the largest of `shares`."""
    return shares(poses, limits, period, **more).max()
