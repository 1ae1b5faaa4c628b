# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""When an execution has to end, and what is heard of the gripper meanwhile."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.model.pose import Pose


@dataclass(frozen=True)
class Guards:
    """When an execution has to end; 0 switches a guard off, as in joint_trajectory_controller.

    Attributes
    ----------
    path_position, path_angle : float
        Path position and path angle in m, rad: from the command to the gripper, on the way.
    path_shape : float
        Path shape in m: from the plan to the observed DLO, on the way.
    goal_position, goal_angle : float
        Goal position and goal angle in m, rad: from the last command to the gripper, at the end.
    goal_time : float
        Goal time in s after the end of the motion in which the gripper has to come there.
    cmd_timeout : float
        Cmd timeout in s after which the last command is not repeated any more; counts where
        goal_time is 0.
    incoming_command_timeout : float
        Incoming command timeout in s: age of the last gripper pose.
    decelerate_on_cancel : bool
        Whether `cancel` lets the motion run out, or ends it at once.
    longest_pause : float
        Seconds between two commands: after a longer one the rest is another motion.
    enable_timeout : float
        Enable timeout in s: age of the last word that the gripper may move; 0: none is asked for.
    """

    path_position: float = 0.02
    path_angle: float = 0.1
    path_shape: float = 0.0
    goal_position: float = 0.01
    goal_angle: float = 0.05
    goal_time: float = 2.0
    cmd_timeout: float = 0.0
    incoming_command_timeout: float = 0.1
    decelerate_on_cancel: bool = True
    longest_pause: float = 0.5
    enable_timeout: float = 0.0

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
class Heard:
    """A gripper pose that came.

    Attributes
    ----------
    pose : Pose
        Pose of the tool frame.
    arrived : float
        Arrived in s, steady.
    age : float
        Age in s that it had then, by its stamp.
    deviation : float
        Deviation in m, of the observed DLO from the plan; nan: it is not observed.
    stamp : float or None
        Its stamp in s. If None, it is not known.
    """

    pose: Pose
    arrived: float
    age: float = 0.0
    deviation: float = np.nan
    stamp: float | None = None


@dataclass(frozen=True)
class Enabled:
    """What was heard of whether the gripper may move.

    Attributes
    ----------
    value : bool
    arrived : float
        Arrived in s, steady.
    """

    value: bool
    arrived: float
