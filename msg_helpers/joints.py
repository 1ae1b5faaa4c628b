# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""JointTrajectory -> trajectory_msgs/JointTrajectory; sensor_msgs/JointState -> positions."""

from math import isfinite

import numpy as np
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory as JointTrajectoryMsg
from trajectory_msgs.msg import JointTrajectoryPoint

from dlo_planner.arm.joint_trajectory import JointTrajectory
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance

_NANOSECONDS = 10**9


def joint_trajectory_msg(joint_trajectory: JointTrajectory) -> JointTrajectoryMsg:
    """Return the message of a JointTrajectory as joint_trajectory_controller takes it.

    Its stamp is zero, which means: it starts when the controller receives it.
    """
    instance('joint_trajectory', joint_trajectory, JointTrajectory)
    nanoseconds = np.round(joint_trajectory.times * _NANOSECONDS).astype(int).tolist()
    points = [JointTrajectoryPoint(positions=positions, velocities=velocities,
                                   accelerations=accelerations, time_from_start=Duration(
                                       sec=time // _NANOSECONDS, nanosec=time % _NANOSECONDS))
              for time, positions, velocities, accelerations in zip(
                  nanoseconds, joint_trajectory.positions.tolist(),
                  joint_trajectory.velocities.tolist(), joint_trajectory.accelerations.tolist(),
                  strict=True)]
    return JointTrajectoryMsg(joint_names=list(joint_trajectory.joint_names), points=points)


def positions_from_joint_state(joint_state: JointState) -> dict[str, float]:
    """Return joint positions by name, rad or m, of a sensor_msgs/JointState.

    Raises
    ------
    InvalidTask
        Positions and names are not as many, or a position is not finite.
    """
    instance('joint_state', joint_state, JointState)
    names, positions = joint_state.name, joint_state.position
    if len(positions) == 0:
        return {}  # allowed by the message: velocities or efforts only
    if len(names) != len(positions):
        raise InvalidTask(f'joint_state has {len(names)} names and {len(positions)} positions: '
                          'expected as many')
    for name, position in zip(names, positions, strict=True):
        if not isfinite(position):
            raise InvalidTask(f'joint_state: {name} = {position}: expected a finite number')
    return dict(zip(names, map(float, positions), strict=True))
