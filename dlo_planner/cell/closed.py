"""The driver that looks: the strategy of `inverse.closed_loop` with all that it takes.

It looks at rest, plans for the DLO as it is estimated, goes calmly to the standoff, looks again and
goes in; on the way it looks and corrects a few times a second. What it computes takes no time in
the cell: the gripper stands still meanwhile.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.cell.camera import Camera, Image
from dlo_planner.cell.drivers import PERIOD, Command, ways
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import Unknowns
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.closed_loop import ClosedLoop, Phase
from dlo_planner.inverse.correction import correct
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.observation import Observation
from dlo_planner.inverse.observer import Observer
from dlo_planner.inverse.plan import PlanStatus, first_part, joined
from dlo_planner.inverse.robustness import Spread
from dlo_planner.inverse.stamped import gripper_at
from dlo_planner.inverse.steering import Steered
from dlo_planner.inverse.trajectory import Trajectory
from dlo_planner.model.pose import Pose

_STAMPS = 0.1       # s by which stamps may be wrong: looks of a gripper that moved are left out
_FOR_MOTION = 0.25  # part of the room, for what the DLO in motion is off its equilibrium
_STANDOFF = 0.05    # of the length
_LEAST_TOLERANCE = 1e-3  # m, of the motion to the standoff
_SWAY = 5e-4        # m, of a DLO that has arrived calmly
_SAG, _WEIGHT = 0.5, 9.81  # of the length: how far weight bends a soft DLO; m/s^2
_REMEMBERED = 250   # periods of control: where the gripper was when an image was taken
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
        stamps: s, by which the stamps of images may be wrong
        period: s between two corrections on the way
    """

    spread: Spread
    noise: float = 1e-3
    bias: float = 0.0
    outliers: float = _LEAST_OUTLIERS
    hole: float = 0.0
    limits: Limits | None = None
    look: float = 2.0
    stamps: float = 0.0
    period: float = 0.5

    @classmethod
    def knowing(cls, unknowns: Unknowns, camera: Camera, **options) -> 'Looking':
        """Return the driver that knows how uncertain things are, but not what they are."""
        bent, *varying = unknowns.natural_curvature
        spread = Spread(unknowns.stiffness, unknowns.stiffness, unknowns.mass, unknowns.length,
                        float(bent), unknowns.gripper_position, unknowns.gripper_rotation,
                        max([_VARIATION, *varying]))
        return cls(spread, camera.noise, camera.bias, max(camera.outliers, _LEAST_OUTLIERS),
                   unknowns.hole_position, stamps=abs(camera.stamp_error), **options)

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
        self._loop = ClosedLoop((1 - _FOR_MOTION) * task.room, driver.look, driver.period)
        self._motion, self._began, self._correction = None, 0.0, None
        self._sent = deque(maxlen=_REMEMBERED)  # (time, Pose)

    def __call__(self, images: Sequence[Image], time: float) -> Pose | None:
        loop, finished, bound = self._loop, False, None
        if loop.phase is Phase.LOOK:
            self._look(images, time)
        elif loop.phase is Phase.PLAN and not loop.at_standoff:
            finished = True
            self._go_there(time)
        else:
            if self._moved(images, time):
                return self._here
            finished = True
            if loop.phase is not Phase.ENTER:
                bound = self._aim()
        self._loop = loop.advanced(time, bound, finished=finished)
        if self._loop.phase is Phase.STOP:
            raise Infeasible(f'room = {self._task.room:.3g} m: the DLO may miss by {bound:.3g} m '
                             'with 95 %', 0, 'miss', bound - self._loop.room)
        if self._loop.phase is Phase.ENTER:
            self._go_in(bound, time)
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

    def _go_there(self, time):
        """Go to the standoff."""
        here = self._estimated()
        way, _ = ways(here, _STANDOFF * here.rod.length)
        there = first_part(way, way.stops[0] + 1, PlanStatus.COMPLETE)
        tolerance = max(_LEAST_TOLERANCE, _FOR_MOTION * self._task.room)
        self._go(Trajectory(there, self._driver.limits, tolerance=tolerance), there.shapes[-1],
                 time)

    def _aim(self):
        """Plan from the standoff through; return the predicted miss with 95 %, m."""
        way, through = ways(self._estimated(), 0.0)
        self._plan = joined(replace(way, stops=()), through)
        stated, estimate = self._task.cutout.centre, self._estimate
        self._commanded = replace(
            through, grippers=[estimate.commanded(pose) for pose in through.grippers],
            passes=[tuple((stated, *rest) for _, *rest in passes) for passes in through.passes])
        looked_at = np.unique(np.linspace(0, len(through) - 1, _LOOKED_AT).astype(int))
        return float(estimate.miss(self._commanded, looked_at).bound.max())

    def _go_in(self, bound, time):
        room = self._task.room
        tolerance = max(_FOR_MOTION * room, 0.5 * (room - bound))
        trajectory = Trajectory(self._plan, self._driver.limits, tolerance=tolerance)
        self.promised = trajectory.motion.miss + bound
        self._go(trajectory, self._plan.shapes[-1], time)

    def _estimated(self):
        """Return the Task as it is estimated, from where the gripper is now."""
        estimate = self._estimate
        return replace(self._task, rod=estimate.rod, start=estimate.actual(self._here),
                       cutout=estimate.moved_cutout(self._task.cutout))

    def _go(self, trajectory, there, time):
        """Begin a motion at whose end the DLO has the Shape `there`."""
        self._motion = Steered.of(trajectory, there, self._estimate.gripper_offset.inverse())
        self._began, self._correction = time, None
        self._sent.append((time, self._here))

    def _moved(self, images, time):
        """Go on, with a look and a correction now and then; return False at the end."""
        if self._motion is None or time - self._began >= self._motion.duration:
            return False
        if images and self._loop.correction_due(time):
            self._look_on_the_way(images[-1])
            if self._loop.phase is Phase.ENTER:
                self._correct(time - self._began)
            self._loop = self._loop.with_correction(time)
        self._here = self._motion.at([time + PERIOD - self._began])[0][0]
        self._sent.append((time + PERIOD, self._here))
        return True

    def _look_on_the_way(self, image):
        """Take an Image in, the less the faster the DLO moves.

        What its stamp may be wrong by displaces all its points alike; inertia bends the DLO as a
        part of its weight would.
        """
        stamps, poses = zip(*self._sent, strict=True)
        stamp = float(np.clip(image.stamp, stamps[0], stamps[-1]))
        speed, inertia = self._moving(stamp)
        noise = np.hypot(self._driver.noise,
                         np.sqrt(len(image.points)) * speed * self._driver.stamps)
        observation = Observation(gripper_at(stamps, poses, stamp), image.points)
        self._estimate = self._observer.update(
            self._estimate, observation, noise=float(noise),
            sway=float(np.hypot(_SWAY, _SAG * self._task.rod.length * inertia / _WEIGHT)))

    def _moving(self, stamp):
        """Return the DLO's speed and the largest acceleration of the last swing, m/s, m/s^2."""
        swing = self._motion.windows[0]
        times = stamp - self._began - np.linspace(0, swing, _LOOKED_AT)
        lengths = np.array([1.0, self._task.rod.length])
        speeds, accelerations = (
            np.linalg.norm(part.reshape(-1, 2, 3), axis=2) @ lengths
            for part in self._motion.trajectory.at(times)[1:])
        return speeds[0], accelerations.max()

    def _correct(self, time):
        """Aim the waypoints that are left anew, if there is time to blend that in."""
        motion, plan = self._motion, self._plan
        if time + motion.windows.sum() > motion.trajectory.duration:
            return
        reached = motion.reached(plan.times[len(plan) - len(self._commanded):])
        first = int(np.searchsorted(reached, time))
        if first < reached.size:
            known = self._correction if self._correction and self._correction.converged else None
            self._correction = correct(self._estimate, self._commanded, first, known)
            self._motion = motion.corrected(time, self._correction, reached[first:])
