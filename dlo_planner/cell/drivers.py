"""Who moves the gripper.

A driver is a function (task) -> command; a command is a function (images, time) -> Pose or None. It
is called once in each period of control with the Images that have come since, and returns where
the gripper is to be at the end of the period; None: it is done. Both may raise `Infeasible`. What
a command has as `promised` is the largest miss that it expects, in m. For a bench on several
processes a driver has to be picklable.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dlo_planner.cell.camera import Image
from dlo_planner.cell.tasks import Task
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.plan import Plan, joined
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.trajectory import Limits, Trajectory
from dlo_planner.model.pose import Pose

Command = Callable[[Sequence[Image], float], Pose | None]
Driver = Callable[[Task], Command]
PERIOD = 0.004  # s, of the control
_WAYPOINTS = 40
_STANDOFF = 0.05  # m


@dataclass(frozen=True)
class OpenLoop:
    """The driver that looks at nothing.

    Attributes:
        motion: function (task) -> Trajectory, or Poses, one for each period, the first at once
    """

    motion: Callable[[Task], Trajectory | Sequence[Pose]]

    def __call__(self, task: Task) -> Command:
        """Return the command for a Task."""
        return _Replayed(self.motion(task))


class _Replayed:
    def __init__(self, motion):
        self.promised = np.nan
        if isinstance(motion, Trajectory):
            self.promised = motion.motion.miss if motion.motion else np.nan
            motion = sampled(motion)
        self._poses = iter(motion)

    def __call__(self, images, time):
        return next(self._poses, None)


def planned(task: Task, limits: Limits | None = None) -> Trajectory:
    """Return start phase and threading as one motion, as the planner makes it.

    Raises:
        Infeasible: there is no plan
    """
    return Trajectory(joined(*ways(task)), limits)


def ways(task: Task, standoff: float = _STANDOFF) -> tuple[Plan, Plan]:
    """Return the start phase and the threading.

    Args:
        task: Task; standoff: m, see `InverseSimulator.start_phase`

    Raises:
        Infeasible: there is no plan
    """
    inverse = InverseSimulator(DirectSimulator(task.rod, obstacles=[task.sheet]))
    depths = np.linspace(0, task.depth, _WAYPOINTS)
    through = inverse.thread(task.cutout, start=task.start, depths=depths)
    return inverse.start_phase(task.cutout, through, task.start, standoff=standoff), through


def sampled(trajectory: Trajectory) -> list[Pose]:
    """Return the poses of a Trajectory, one for each period, without the first."""
    count = int(np.ceil(trajectory.duration / PERIOD))
    return trajectory.at(PERIOD * np.arange(1, count + 1))[0]
