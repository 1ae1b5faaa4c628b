# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From gripper poses to the joints of a robot arm; needs the extra `[arm]` (Pinocchio)."""

from dlo_planner.arm.follow import joint_trajectory, rolls_freely
from dlo_planner.arm.joint_trajectory import JointTrajectory
from dlo_planner.arm.robot import Arm

__all__ = ['Arm', 'JointTrajectory', 'joint_trajectory', 'rolls_freely']
