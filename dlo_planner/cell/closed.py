# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver that looks: it carries out the strategy of `identify.closed_loop`.

It looks at rest, plans for the estimated DLO, goes calmly to the standoff, looks again and enters.
On the way it looks and corrects a few times a second. Its computations take no time in the cell, as
if the gripper stood still meanwhile.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlo_planner.cell.camera import Camera, Image
from dlo_planner.cell.drivers import PERIOD, Command, ways
from dlo_planner.cell.tasks import Task
from dlo_planner.cell.truth import Unknowns
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import Infeasible
from dlo_planner.identify.closed_loop import ClosedLoop, Phase
from dlo_planner.identify.correction import Correction, correct
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.observer import Observer
from dlo_planner.identify.stamped import gripper_at
from dlo_planner.identify.steering import Steered
from dlo_planner.model.pose import Pose
from dlo_planner.plan.assembly import concatenate, truncate
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.trajectory import Trajectory
from dlo_planner.plan.plan import PlanStatus
from dlo_planner.verify.uncertainty import Uncertainty

_STAMPS = 0.1       # s after an arrival whose images are left out: their stamps may be wrong
_FOR_MOTION = 0.25  # part of the room that is kept for the deviation of the DLO in motion
_STANDOFF = 0.05    # of the length
_LEAST_TOLERANCE = 1e-3  # m, of the motion to the standoff
_SWAY = 5e-4        # m, of a DLO that has arrived calmly
_SAG, _WEIGHT = 0.5, 9.81  # of the length: how far weight bends a soft DLO; m/s^2
_REMEMBERED = 250   # periods of control whose poses are remembered: 1 s, longer than any latency
_WAYPOINTS = 5      # whose miss is predicted, evenly from the entry to the depth
_INSTANTS = 5       # of the last swing at which the acceleration is looked at
_LEAST_OUTLIERS = 0.02  # part of the points: even a good camera sees some
_VARIATION = 0.03   # 1/m: no DLO is bent quite evenly


@dataclass(frozen=True)
class Looking:
    """The driver of a closed loop; `Looking.knowing` makes one for an `Unknowns` and a `Camera`.

    Attributes
    ----------
    spread : Uncertainty
        Uncertainty of the DLO and of the gripper's pose.
    noise, bias : float
        Standard deviations of the camera, m.
    outliers : float
        Part of its points, see `Observer`.
    hole : float
        Standard deviation of the place of the hole, m.
    limits : Limits or None
        Limits of the gripper. If None, the default ones.
    look : float
        Duration of a look, s.
    stamps : float
        By how much the stamps of images may be wrong, s.
    period : float
        Time between two corrections on the way, s.
    """

    spread: Uncertainty
    noise: float = 1e-3
    bias: float = 0.0
    outliers: float = _LEAST_OUTLIERS
    hole: float = 0.0
    limits: Limits | None = None
    look: float = 2.0
    stamps: float = 0.0
    period: float = 0.5

    @classmethod
    def knowing(cls, unknowns: Unknowns, camera: Camera, **options: Any) -> 'Looking':
        """Return the driver that knows the standard deviations of what is unknown, not the values.

        Parameters
        ----------
        unknowns : Unknowns
            Unknowns; a gradient of the mass has no counterpart in the driver's Uncertainty.
        camera : Camera
        options : object
            Further attributes.
        """
        bent, *varying = unknowns.natural_curvature
        spread = Uncertainty(unknowns.stiffness, unknowns.stiffness, unknowns.mass, unknowns.length,
                        float(bent), unknowns.gripper_position, unknowns.gripper_rotation,
                        max([_VARIATION, *varying]))
        return cls(spread, camera.noise, camera.bias, max(camera.outliers, _LEAST_OUTLIERS),
                   unknowns.hole_position, stamps=abs(camera.stamp_error), **options)

    def __call__(self, task: Task) -> Command:
        """Return the command for a Task."""
        return _Looking(self, task)


class _Looking:
    """The command of the driver: the pose of the gripper, period by period.

    Attributes
    ----------
    promised
        The largest miss that is expected, m: the 95 % bound of the estimate, what the simulated
        motion adds, and by how much the DLO may still swing from the motion to the standoff; nan
        before the DLO enters.
    """

    def __init__(self, driver: Looking, task: Task) -> None:
        self.promised = np.nan
        self._driver, self._task, self._here = driver, task, task.start
        self._observer = Observer(
            task.rod, driver.spread, noise=driver.noise, bias=driver.bias, cutout=driver.hole,
            outliers=driver.outliers, sway=_SWAY)
        self._estimate = self._observer.begin()
        self._loop = ClosedLoop((1 - _FOR_MOTION) * task.room, driver.look, driver.period)
        self._motion: Steered | None = None
        self._began, self._left = 0.0, 0.0  # s; m of swing that the last motion leaves
        self._correction: Correction | None = None
        self._sent: deque[tuple[float, Pose]] = deque(maxlen=_REMEMBERED)

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
            assert bound is not None  # it stops for that
            raise Infeasible(f'room = {self._task.room:.3g} m: the DLO may miss by {bound:.3g} m '
                             'with 95 %', 0, 'miss', bound - self._loop.room)
        if self._loop.phase is Phase.ENTER and bound is not None:
            self._go_in(bound, time)
        return None if self._loop.phase is Phase.DONE else self._here

    def _look(self, images: Sequence[Image], time: float) -> None:
        since = time if self._loop.since is None else self._loop.since
        for image in images:
            if self._loop.at_standoff and image.stamp < since + max(_STAMPS, self._driver.stamps):
                continue
            observation = Observation(self._here, image.points)
            self._estimate = self._observer.update(self._estimate, observation)
            if image.hole is not None and self._driver.hole:
                self._estimate = self._observer.see_cutout(
                    self._estimate, self._task.cutout.center, image.hole)

    def _go_there(self, time: float) -> None:
        """Plan the motion to the standoff and begin it."""
        here = self._estimated()
        way, _ = ways(here, _STANDOFF * here.rod.length)
        there = truncate(way, way.stops[0] + 1, PlanStatus.COMPLETE)
        tolerance = max(_LEAST_TOLERANCE, _FOR_MOTION * self._task.room)
        trajectory = Trajectory(there, self._driver.limits, tolerance=tolerance)
        self._left = 0.0 if trajectory.motion is None else trajectory.motion.departure
        self._go(trajectory, there.shapes[-1], time)

    def _aim(self) -> float:
        """Plan the way from the standoff to the depth; return the 95 % bound of its miss, m."""
        way, through = ways(self._estimated(), 0.0)
        self._plan = concatenate(replace(way, stops=()), through)
        stated, estimate = self._task.cutout.center, self._estimate
        self._commanded = replace(
            through, grippers=tuple(estimate.commanded(pose) for pose in through.grippers),
            via_points=tuple(tuple((stated, s, normal) for _, s, normal in passes)
                         for passes in through.via_points))
        looked_at = np.unique(np.linspace(0, len(through) - 1, _WAYPOINTS).astype(int))
        return float(estimate.miss(self._commanded, looked_at).bound.max())

    def _go_in(self, bound: float, time: float) -> None:
        room = self._task.room
        tolerance = max(_FOR_MOTION * room, 0.5 * (room - bound))
        trajectory = Trajectory(self._plan, self._driver.limits, tolerance=tolerance)
        moves = np.nan if trajectory.motion is None else trajectory.motion.bound
        self.promised = moves + bound + self._left
        self._go(trajectory, self._plan.shapes[-1], time)

    def _estimated(self) -> Task:
        """Return the Task with the estimated DLO and hole, from the gripper's estimated pose."""
        estimate = self._estimate
        return replace(self._task, rod=estimate.rod, start=estimate.actual(self._here),
                       cutout=estimate.moved_cutout(self._task.cutout))

    def _go(self, trajectory: Trajectory, there: Shape, time: float) -> None:
        """Begin a motion at whose end the DLO has the Shape `there`."""
        self._motion = Steered.of(trajectory, there, self._estimate.gripper_offset.inverse())
        self._began, self._correction = time, None
        self._sent.append((time, self._here))

    def _moved(self, images: Sequence[Image], time: float) -> bool:
        """Go on by one period, and look and correct if it is time; return False at the end."""
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

    def _look_on_the_way(self, image: Image) -> None:
        """Update the estimate with an Image; it counts the less the faster the DLO moves.

        A wrong stamp displaces all its points alike. Inertia bends the DLO like a part of its
        weight.
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

    def _moving(self, stamp: float) -> tuple[float, float]:
        """Return bounds of the DLO's speed, m/s, and acceleration in the last swing, m/s^2."""
        assert self._motion is not None  # it moves
        swing = self._motion.windows[0]
        times = stamp - self._began - np.linspace(0, swing, _INSTANTS)
        lengths = np.array([1.0, self._task.rod.length])
        speeds, accelerations = (
            np.linalg.norm(part.reshape(-1, 2, 3), axis=2) @ lengths
            for part in self._motion.trajectory.at(times)[1:])
        return speeds[0], accelerations.max()

    def _correct(self, time: float) -> None:
        """Aim the remaining waypoints anew, if there is time left to blend that in."""
        motion, plan = self._motion, self._plan
        assert motion is not None  # it moves
        if time + motion.windows.sum() > motion.trajectory.duration:
            return
        reached = motion.reached(plan.times[len(plan) - len(self._commanded):])
        first = int(np.searchsorted(reached, time))
        if first < reached.size:
            known = self._correction if self._correction and self._correction.converged else None
            self._correction = correct(self._estimate, self._commanded, first, known)
            self._motion = motion.corrected(time, self._correction, reached[first:])
