"""Who moves the gripper.

A driver is a function (task) -> command; a command is a function (images, time) -> Pose or None. It
is called once in each period of control with the Images that have come since, and returns where
the gripper is to be at the end of the period; None: it is done. Both may raise `Infeasible`. For a
bench on several processes a driver has to be picklable.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dlo_planner.cell.camera import Image
from dlo_planner.cell.tasks import Task
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.plan import Plan
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.trajectory import Limits, Trajectory
from dlo_planner.model.pose import Pose

Command = Callable[[Sequence[Image], float], Pose | None]
Driver = Callable[[Task], Command]
PERIOD = 0.004  # s, of the control
_WAYPOINTS = 40


@dataclass(frozen=True)
class OpenLoop:
    """The driver that looks at nothing.

    Attributes:
        poses: function (task) -> Poses, one for each period, the first at once
    """

    poses: Callable[[Task], Sequence[Pose]]

    def __call__(self, task: Task) -> Command:
        """Return the command for a Task."""
        return _Replayed(list(self.poses(task)))


class _Replayed:
    def __init__(self, poses):
        self._poses = iter(poses)

    def __call__(self, images, time):
        return next(self._poses, None)


def planned(task: Task, limits: Limits | None = None) -> list[Pose]:
    """Return the gripper's poses of start phase and threading, as the planner makes them.

    Raises:
        Infeasible: there is no plan
    """
    inverse = InverseSimulator(DirectSimulator(task.rod, obstacles=[task.sheet]))
    depths = np.linspace(0, task.depth, _WAYPOINTS)
    through = inverse.thread(task.cutout, start=task.start, depths=depths)
    way = inverse.start_phase(task.cutout, through, task.start)
    return sampled(way, limits) + sampled(through, limits)


def sampled(plan: Plan, limits: Limits | None = None) -> list[Pose]:
    """Return the poses of a Plan's Trajectory, one for each period, without the first."""
    trajectory = Trajectory(plan, limits)
    count = int(np.ceil(trajectory.duration / PERIOD))
    return trajectory.at(PERIOD * np.arange(1, count + 1))[0]
