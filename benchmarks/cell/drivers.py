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

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cell.other_tasks import OtherTask
from dlo_planner.cell.camera import Camera, Image
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import Unknowns
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError, Infeasible, InvalidTask
from dlo_planner.execute.execution import Execution
from dlo_planner.execute.guards import Feedback, Guards
from dlo_planner.execute.loop_motions import LoopTask
from dlo_planner.execute.task_loop import TaskLoop
from dlo_planner.identify.closed_loop import Phase
from dlo_planner.identify.estimator import DloEstimator, EstimatorConfig
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.plan.requirements import Limits, Requirements
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.uncertainty.parameters import Uncertainty

Command = Callable[[Sequence[Image], float, Pose], Pose | None]
Driver = Callable[[Task], Command]
PERIOD = 0.01   # s, of the control
_WAYPOINTS = 40   # of a threading
_STANDOFF = 0.05    # of the length
_LOOKING = 0.05     # s of computing that an image takes
_CORRECTING = 0.3   # s of computing that a correction takes, in which the gripper goes on
_PLANNING = 2.0     # s of computing that a plan takes, in which the gripper stands
_LEAST_OUTLIERS = 0.02  # part of the points: even a good camera sees some
_TICKS = 2          # periods of control between two commands: 50 in a second, as of the node
_HORIZON = 1.0      # s of the coming motion that the robot is told, as by the node
_GUARDS = Guards(path_shape=0.05)  # as of the node
_VARIATION = 0.03   # 1/m: no DLO is bent quite evenly


@dataclass(frozen=True)
class OpenLoop:
    """The driver that does not look."""

    # function (task) -> Trajectory, or Poses, one for the end of each period
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


@dataclass(frozen=True)
class Looking:
    """The driver of a closed loop; `Looking.knowing` makes one for an `Unknowns` and a `Camera`."""

    # how well the camera sees and the robot measures, and how uncertain the DLO is
    seeing: EstimatorConfig = EstimatorConfig()
    limits: Limits | None = None  # limits of the gripper. If None, the default ones
    look: float = 2.0  # duration of a look at rest, s

    @classmethod
    def knowing(cls, unknowns: Unknowns, camera: Camera, limits: Limits | None = None,
                **seeing: Any) -> 'Looking':
        """Return the driver that knows standard deviations of what is unknown, not the values."""
        bent, *varying = unknowns.natural_curvature
        spread = Uncertainty(unknowns.stiffness, unknowns.stiffness, unknowns.mass, unknowns.length,
                             float(bent), unknowns.gripper_position, unknowns.gripper_rotation,
                             max([_VARIATION, *varying]), unknowns.mass_gradient)
        return cls(EstimatorConfig(spread, **{
            'noise': camera.noise, 'bias': camera.bias,
            'outliers': max(camera.outliers, _LEAST_OUTLIERS), 'cutout': unknowns.hole_position,
            'stamps': abs(camera.stamp_error), **seeing}), limits)

    def __call__(self, task: Task) -> Command:
        """Return the command for a Task."""
        return _Looking(self, task)


class _Looking:
    """The command of the driver: the pose of the gripper, period by period."""

    def __init__(self, driver: Looking, task: Task) -> None:
        simulator = DirectSimulator(task.rod, obstacles=task.obstacles)
        self._observing = DloEstimator(simulator, driver.seeing)
        goal = task.goal if isinstance(task, OtherTask) else Thread(
            task.cutout, np.linspace(0, task.depth, _WAYPOINTS))
        self._loop = TaskLoop(
            LoopTask(InverseSimulator(simulator), goal, _STANDOFF * task.rod.length,
                     driver.limits or Limits(), None if task.cutouts else task.room),
            self._observing, task.start, guards=_GUARDS, look=driver.look, period=_TICKS * PERIOD,
            horizon=_HORIZON)
        self._cutout = task.cutout
        self._coming: deque[tuple[float, Image]] = deque()
        self.busy, self._count, self._pose = 0.0, 0, task.start
        self.ahead: tuple[Floats, list[Pose]] | None = None
        self._told: object = None
        self._aiming: tuple[float, Any, Any] | None = None  # when it is done: work, result

    @property
    def promised(self) -> float:
        """The largest miss that is expected, m."""
        return self._loop.promised

    @property
    def phase(self) -> str:
        """What it does, and how often looks came to disagree."""
        return f'{self._loop.phase.value} {self._loop.tries}'

    def __call__(self, images: Sequence[Image], time: float, gripper: Pose) -> Pose | None:
        loop, self.busy, self.ahead = self._loop, 0.0, None
        self._observing.gripper(time, gripper)
        loop.gripper(Feedback(gripper, time, 0.0, self._observing.off, time))
        self._coming.extend((time + _LOOKING, image) for image in images)
        while self._coming and self._coming[0][0] <= time:
            self._look(self._coming.popleft()[1])
        if self._aiming is not None and self._aiming[0] <= time:
            loop.finish(*self._aiming[1:])
            self._aiming = None
        self._count += 1
        if self._count % _TICKS != 1:
            return self._pose
        pose = loop.tick(time)
        self._tell(loop.execution or loop.last)
        if loop.phase is Phase.STOP:
            raise Infeasible(f'{loop.cause.name}: {loop.reason}', 0, 'miss', 0.0)
        work = loop.work
        if work is not None and (self._aiming is None or self._aiming[1] is not work):
            try:
                result = work()
            except DloPlannerError as error:
                result = error
            if loop.waits:
                self.busy = _PLANNING
                loop.finish(work, result)
            else:
                self._aiming = time + _CORRECTING, work, result
        if pose is not None:
            self._pose = pose
        return pose

    def _tell(self, execution: Execution | None) -> None:
        """Have the robot told what is new of the coming time."""
        if execution is None or execution.ahead is None or execution.ahead is self._told:
            return
        assert execution.stamp is not None  # it has begun
        self._told = execution.ahead
        self.ahead = execution.stamp + execution.ahead.times, execution.ahead.poses

    def _look(self, image: Image) -> None:
        if not self._observing.due(image.stamp):
            return
        with suppress(InvalidTask):  # no look at the hole, or at the DLO: it counts as none
            if image.hole is not None:
                self._observing.hole(self._cutout.center, image.hole)
        with suppress(InvalidTask):
            self._observing.look(image.stamp, image.points)
