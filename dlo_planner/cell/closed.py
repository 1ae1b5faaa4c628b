"""The driver that looks: the strategy of `inverse.closed_loop` with all that it takes.

It looks at rest, plans for the DLO as it is estimated, goes calmly to the standoff, looks again and
goes in. What it computes takes no time in the cell: the gripper stands still meanwhile.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.cell.camera import Camera, Image
from dlo_planner.cell.drivers import Command, sampled, ways
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import Unknowns
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.closed_loop import ClosedLoop, Phase
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.observation import Observation
from dlo_planner.inverse.observer import Observer
from dlo_planner.inverse.plan import PlanStatus, first_part, joined
from dlo_planner.inverse.robustness import Spread
from dlo_planner.inverse.trajectory import Trajectory
from dlo_planner.model.pose import Pose

_STAMPS = 0.1       # s by which stamps may be wrong: looks of a gripper that moved are left out
_FOR_MOTION = 0.25  # part of the room, for what the DLO in motion is off its equilibrium
_STANDOFF = 0.05    # of the length
_SWAY = 5e-4        # m, of a DLO that has arrived calmly
_LOOKED_AT = 5      # waypoints whose miss is predicted
_LEAST_OUTLIERS = 0.02
_VARIATION = 0.03   # 1/m: no DLO is bent quite evenly


@dataclass(frozen=True)
class Looking:
    """The driver of a closed loop.

    Attributes:
        spread: Spread of what is uncertain
        noise: m, of the camera; bias: m, of the same; outliers: part of its points
        hole: m, how well the place of the hole is known
        limits: Limits of the gripper; None: the default ones
        look: s of a look
    """

    spread: Spread
    noise: float = 1e-3
    bias: float = 0.0
    outliers: float = _LEAST_OUTLIERS
    hole: float = 0.0
    limits: Limits | None = None
    look: float = 2.0

    @classmethod
    def knowing(cls, unknowns: Unknowns, camera: Camera, **options) -> 'Looking':
        """Return the driver that knows how uncertain things are, but not what they are."""
        bent, *varying = unknowns.natural_curvature
        spread = Spread(unknowns.stiffness, unknowns.stiffness, unknowns.mass, unknowns.length,
                        float(bent), unknowns.gripper_position, unknowns.gripper_rotation,
                        max([_VARIATION, *varying]))
        return cls(spread, camera.noise, camera.bias, max(camera.outliers, _LEAST_OUTLIERS),
                   unknowns.hole_position, **options)

    def __call__(self, task: Task) -> Command:
        """Return the command for a Task."""
        return _Looking(self, task)


class _Looking:
    """A command: where the gripper is to be, period by period.

    Attributes:
        promised: m, the largest miss that is expected: that of the motion, and what the estimate
            leaves open (95 %)
    """

    def __init__(self, driver, task):
        self.promised = np.nan
        self._driver, self._task, self._here = driver, task, task.start
        self._observer = Observer(
            task.rod, driver.spread, noise=driver.noise, bias=driver.bias, cutout=driver.hole,
            outliers=driver.outliers, sway=_SWAY)
        self._estimate = self._observer.begin()
        self._loop = ClosedLoop((1 - _FOR_MOTION) * task.room, driver.look)
        self._poses = iter(())

    def __call__(self, images: Sequence[Image], time: float) -> Pose | None:
        loop, finished, bound = self._loop, False, None
        if loop.phase is Phase.LOOK:
            self._look(images, time)
        elif loop.phase is Phase.PLAN and not loop.at_standoff:
            finished = True
            self._go_there()
        else:
            pose = next(self._poses, None)
            if pose is not None:
                self._here = pose
                return pose
            finished = True
            if loop.phase is not Phase.ENTER:
                bound = self._aim()
        self._loop = loop.advanced(time, bound, finished=finished)
        if self._loop.phase is Phase.STOP:
            raise Infeasible(f'room = {self._task.room:.3g} m: the DLO may miss by {bound:.3g} m '
                             'with 95 %', 0, 'miss', bound - self._loop.room)
        if self._loop.phase is Phase.ENTER:
            self._go_in(bound)
        return None if self._loop.phase is Phase.DONE else self._here

    def _look(self, images, time):
        since = time if self._loop.since is None else self._loop.since
        for image in images:
            if self._loop.at_standoff and image.stamp < since + _STAMPS:
                continue
            observation = Observation(self._here, image.points)
            self._estimate = self._observer.update(self._estimate, observation)
            if image.hole is not None and self._driver.hole:
                self._estimate = self._observer.see_cutout(
                    self._estimate, self._task.cutout.centre, image.hole)

    def _go_there(self):
        """Go to the standoff."""
        here = self._estimated()
        way, _ = ways(here, _STANDOFF * here.rod.length)
        there = first_part(way, way.stops[0] + 1, PlanStatus.COMPLETE)
        self._go(Trajectory(there, self._driver.limits))

    def _aim(self):
        """Plan from the standoff through; return the predicted miss with 95 %, m."""
        way, through = ways(self._estimated(), 0.0)
        self._plan = joined(replace(way, stops=()), through)
        stated, estimate = self._task.cutout.centre, self._estimate
        commanded = replace(
            through, grippers=[estimate.commanded(pose) for pose in through.grippers],
            passes=[tuple((stated, *rest) for _, *rest in passes) for passes in through.passes])
        looked_at = np.unique(np.linspace(0, len(through) - 1, _LOOKED_AT).astype(int))
        return float(estimate.miss(commanded, looked_at).bound.max())

    def _go_in(self, bound):
        room = self._task.room
        tolerance = max(_FOR_MOTION * room, 0.5 * (room - bound))
        trajectory = Trajectory(self._plan, self._driver.limits, tolerance=tolerance)
        self.promised = trajectory.motion.miss + bound
        self._go(trajectory)

    def _estimated(self):
        """Return the Task as it is estimated, from where the gripper is now."""
        estimate = self._estimate
        return replace(self._task, rod=estimate.rod, start=estimate.actual(self._here),
                       cutout=estimate.moved_cutout(self._task.cutout))

    def _go(self, trajectory):
        self._poses = iter([self._estimate.commanded(pose) for pose in sampled(trajectory)])
