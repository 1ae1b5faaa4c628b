# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Drivers, which move the gripper.

A driver is a function (task) -> command; a command is a function (images, time, gripper) -> Pose
or None. The command is called once in each period of control with the Images that have arrived
since the last call, the time in s, and the Pose of the gripper as its robot measures it then. It
returns the pose of the gripper at the end of the period, or None when it is done. Both may raise
`Infeasible`, `NotConverged` or `DeadlineExceeded`. For a bench on several processes a driver has to
be picklable.

A command may have four attributes, which are read after each call: `promised`, the largest miss
that it expects, m; `busy`, the time that the call would take a real machine, s, for which the
robot is told its last pose on, and only then what the call returned; `phase`, a word for what it is
at; `ahead`, stamps (n,) in s and n Poses, which the robot follows from then on instead of what it
returns, or None.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dlo_planner.cell.camera import Image
from dlo_planner.cell.tasks import Task
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.tasks import Approach
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.plan.requirements import Limits, Requirements
from dlo_planner.trajectory.trajectory import Trajectory

Command = Callable[[Sequence[Image], float, Pose], Pose | None]
Driver = Callable[[Task], Command]
PERIOD = 0.01   # s, of the control
_WAYPOINTS = 40   # of a threading


@dataclass(frozen=True)
class OpenLoop:
    """The driver that does not look.

    Attributes
    ----------
    motion : callable
        Function (task) -> Trajectory, or Poses, one for the end of each period.
    """

    motion: Callable[[Task], Trajectory | Sequence[Pose]]

    def __call__(self, task: Task) -> Command:
        """Return the command for a Task."""
        return _Replayed(self.motion(task))


class _Replayed:
    def __init__(self, motion: Trajectory | Sequence[Pose]) -> None:
        self.promised = np.nan
        if isinstance(motion, Trajectory):
            self.promised = motion.motion.bound if motion.motion else np.nan
            motion = sampled(motion)
        self._poses = iter(motion)

    def __call__(self, images: Sequence[Image], time: float, gripper: Pose) -> Pose | None:
        return next(self._poses, None)


def planned(task: Task, limits: Limits | None = None) -> Trajectory:
    """Return start phase and threading of the DLO as stated, as one motion."""
    return Trajectory(concatenate(*ways(task, limits=limits)), limits)


def ways(task: Task, standoff: float | None = None,
         limits: Limits | None = None) -> tuple[Plan, Plan]:
    """Return the start phase and the threading."""
    inverse = InverseSimulator(DirectSimulator(task.rod, obstacles=[task.sheet]))
    depths = np.linspace(0, task.depth, _WAYPOINTS)
    through = inverse.thread(task.cutout, start=task.start, depths=depths)
    way = inverse.plan(Approach(task.cutout, through.shapes[0], standoff, through),
                       start=task.start, requirements=Requirements(limits=limits or Limits()))
    return way, through


def sampled(trajectory: Trajectory) -> list[Pose]:
    """Return the poses of a Trajectory at the ends of the periods of control."""
    count = int(np.ceil(trajectory.duration / PERIOD))
    return trajectory.poses(PERIOD * np.arange(1, count + 1))
