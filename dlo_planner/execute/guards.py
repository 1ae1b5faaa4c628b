# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""When an execution has to end, and what is heard of the gripper meanwhile."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.model.pose import Pose


@dataclass(frozen=True)
class Guards:
    """When an execution has to end; 0 switches a guard off, as in joint_trajectory_controller."""

    path_position: float = 0.02  # m, rad: from the command to the gripper, on the way
    path_angle: float = 0.1
    path_shape: float = 0.0      # m, from the plan to the observed DLO, on the way
    goal_position: float = 0.01  # m, rad: from the last command to the gripper, at the end
    goal_angle: float = 0.05
    goal_time: float = 2.0       # s after the end of the motion, in which it has to come there
    cmd_timeout: float = 0.0     # s that the last command is repeated, where goal_time is 0
    incoming_command_timeout: float = 0.1  # s, age of the last gripper pose
    decelerate_on_cancel: bool = True  # whether `cancel` lets the motion run out
    longest_pause: float = 0.5   # s without a command, after which the rest is another motion
    enable_timeout: float = 0.0  # s, age of the last word that the gripper may move; 0: none needed
    heard: str = 'gripper_pose'  # topic by which it is known where the gripper is
    pull_time: float = 0.1  # s for which the pull may be one that overloads a fitting

    def barred(self, enabled: 'Enabled | None', now: float) -> str:
        """Return in words why the gripper may not move at `now` s, '' if it may."""
        limit = self.enable_timeout
        if not limit:
            return ''
        expected = f'expected true on ~/enable, execute.enable_timeout = {limit:g} s old at most'
        if enabled is None:
            return f'enable: nothing came: {expected}'
        if not enabled.value:
            return f'enable: it is false: {expected}'
        age = now - enabled.arrived
        return f'enable: the last one is {age:.3g} s old: {expected}' if age > limit else ''

    @property
    def patience(self) -> float:
        """How long after the end of the motion the gripper is waited for, s; inf: for good."""
        given = [time for time in (self.goal_time, self.cmd_timeout) if time > 0]
        return given[0] if given else np.inf


@dataclass(frozen=True)
class Feedback:
    """A gripper pose that came."""

    pose: Pose                # of the tool frame
    arrived: float            # s, steady clock
    age: float = 0.0          # s that it had then, by its stamp
    deviation: float = np.nan  # m, of the observed DLO from the plan; nan: it is not observed
    stamp: float | None = None  # s; None: not known


@dataclass(frozen=True)
class Enabled:
    """What was heard of whether the gripper may move."""

    value: bool
    arrived: float  # s, steady clock
