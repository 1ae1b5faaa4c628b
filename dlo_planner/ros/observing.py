# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a camera sees of the DLO, made an Estimate of it: the closed loop without ROS.

Gripper poses and clouds of points come with stamps of one clock. A cloud counts as seen where the
gripper was at its stamp; the faster the gripper moved then, the less it counts.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from threading import Condition

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.observer import Observer
from dlo_planner.identify.stamped import gripper_at
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.motion.periods import slowest_period
from dlo_planner.plan.plan import Plan
from dlo_planner.verify.uncertainty import Uncertainty

_REMEMBERED = 1000   # gripper poses: 2 s of them at 500 Hz
_ABOUT = 0.25        # s before and after a stamp: of which speed and acceleration are told
_SAG, _WEIGHT = 0.5, 9.81  # of the length: how far weight bends a soft DLO; m/s^2
_MOST_POINTS = 100   # of a cloud: more tell little more and take long
_LEAST_POINTS = 3
_SAMPLED = 65        # places of the DLO from which points are measured
_PATIENCE = 0.1      # s that the gripper's pose may come later than a cloud of its time
_STILL, _EVEN = 2e-3, 5e-3  # m/s, m/s^2: what noise of the poses alone gives
_SET_BACK = 1.0      # s: a stamp that is so much older than the last
_GAP, _SAME = 0.5, 1e-3  # s between poses; m and rad by which one is still the same
_LONGEST_SWING = 2.0 # s
_NEAR = 12           # poses of which a motion is told


@dataclass(frozen=True)
class Seeing:
    """How well the camera sees, and how uncertain the DLO is.

    Attributes
    ----------
    spread : Uncertainty
        Uncertainty, of the DLO and of how the gripper holds it.
    noise, bias, outliers, sway : float
        See `Observer`.
    cutout : float
        Cutout in m, how well the place of a cut-out is known.
    stamps : float
        Stamps in s, by which stamps of clouds may be wrong.
    period : float
        Seconds between two clouds that are looked at.
    correct : bool
        Whether what is executed is corrected.
    correction_period : float
        Seconds between two corrections.
    largest_correction : float
        Largest correction in m: a plan that is farther off has to be made anew.
    """

    spread: Uncertainty = field(default_factory=Uncertainty)
    noise: float = 1e-3
    bias: float = 0.0
    outliers: float = 0.1
    sway: float = 5e-4
    cutout: float = 0.0
    stamps: float = 0.02
    period: float = 0.2
    correct: bool = True
    correction_period: float = 0.5
    largest_correction: float = 0.02


class Observing:
    """The Estimate of a DLO from all that was seen since the last `reset`; for several threads.

    Parameters
    ----------
    simulator : DirectSimulator
        DirectSimulator of the DLO as stated.
    seeing : Seeing
        Seeing, kept as an attribute.
    known : Estimate, optional
        Estimate by which it was stated so; what that was sure of stays sure.

    Raises
    ------
    InvalidTask
        The DLO cannot be observed, or nothing of it is uncertain.
    """

    def __init__(self, simulator: DirectSimulator, seeing: Seeing,
                 known: Estimate | None = None) -> None:
        self.seeing = seeing
        self._observer = Observer(simulator, seeing.spread, noise=seeing.noise, bias=seeing.bias,
                                  cutout=seeing.cutout, outliers=seeing.outliers,
                                  sway=seeing.sway)
        self._first = self._observer.begin()
        if known is not None and known.names == self._first.names:
            self._first = replace(self._first, covariance=known.covariance)
        self._lock = Condition()
        self._grippers: deque[tuple[float, Pose]] = deque(maxlen=_REMEMBERED)  # (stamp, Pose)
        self.reset()

    @property
    def estimate(self) -> Estimate:
        """The newest Estimate: the prior before anything was seen."""
        return self._estimate

    @property
    def off(self) -> float:
        """Median distance of the points of the last look from the DLO as it is estimated, m."""
        return self._off

    def reset(self) -> None:
        """Forget what was seen since it began."""
        with self._lock:
            self._estimate, self._last, self._off = self._first, -np.inf, np.nan

    def gripper(self, stamp: float, pose: Pose) -> None:
        """Take in where the gripper frame was at a stamp (s).

        One that is older than the last is lost. One that is much older says that the clock was set
        back, as where a recording begins anew: what was known is of another time.
        """
        with self._lock:
            if self._grippers and stamp < self._grippers[-1][0] - _SET_BACK:
                self._grippers.clear()
            if not self._grippers or stamp > self._grippers[-1][0]:
                self._grippers.append((stamp, pose))
                self._lock.notify_all()

    def due(self, stamp: float) -> bool:
        """Return whether a cloud of this stamp (s) should be looked at."""
        return abs(stamp - self._last) >= self.seeing.period

    def look(self, stamp: float, points: Floats) -> Estimate:
        """Return the Estimate after one more cloud.

        Parameters
        ----------
        stamp : float
            Stamp in s, when it was taken.
        points : ndarray, shape (n, 3)
            Points in m, world.

        Raises
        ------
        InvalidTask
            There are too few points, or no gripper pose of that time is known, or no equilibrium of
            the DLO explains what is seen.
        """
        if len(points) < _LEAST_POINTS:
            raise InvalidTask(f'observed_points has {len(points)} points: expected {_LEAST_POINTS} '
                              'at least')
        with self._lock:  # a cloud may be quicker than the gripper's next pose
            self._lock.wait_for(lambda: self._grippers and self._grippers[-1][0] >= stamp,
                                _PATIENCE)
            known, estimate = list(self._grippers), self._estimate
        if not known or not known[0][0] <= stamp <= known[-1][0]:
            span = f'{known[0][0]:.3f} to {known[-1][0]:.3f} s' if known else 'none'
            raise InvalidTask(f'observed_points.header.stamp = {stamp:.3f} s: expected a time of '
                              f'which gripper poses are known: {span}')
        stamps, poses = zip(*known, strict=True)
        _judge_gap(stamps, poses, stamp)
        speed, acceleration = self._moving(stamps, poses, stamp)
        chosen = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(
            int))
        seen = Observation(gripper_at(stamps, poses, stamp), points[chosen])
        noise, sway = self._weighed(len(chosen), speed, acceleration)
        after = self._observer.update(estimate, seen, noise=noise, sway=sway)
        off = self._off_it(after, seen)
        with self._lock:
            if self._estimate is not estimate:  # it was reset meanwhile
                return self._estimate
            self._last, self._off = stamp, off
            if after.converged:
                self._estimate = after
        if not after.converged:
            raise InvalidTask('observed_points: no equilibrium of the DLO explains them')
        return after

    def _off_it(self, estimate: Estimate, seen: Observation) -> float:
        shape = estimate.shape(seen.gripper)
        if not shape.converged:
            return np.inf
        nodes = shape.positions_at(np.linspace(0, 1, _SAMPLED) * shape.s[-1])
        return _median_distance(seen.points - estimate.camera_bias, nodes)

    def _moving(self, stamps: Sequence[float], poses: Sequence[Pose],
                stamp: float) -> tuple[float, float]:
        """Return the speed, m/s, and the largest acceleration during the last swing, m/s^2."""
        rod = self._observer.uncertain.simulator.rod
        times = np.arange(stamp, stamp - min(slowest_period(rod), _LONGEST_SWING), -_ABOUT)
        found = [motion_at(stamps, poses, time, rod.length) for time in times]
        return found[0][0], max(acceleration for _, acceleration in found)

    def _weighed(self, count: int, speed: float, acceleration: float) -> tuple[float, float]:
        """Return noise and sway (m) of a look: more of both in motion."""
        seeing, length = self.seeing, self._observer.uncertain.simulator.rod.length
        late = np.sqrt(count) * seeing.stamps * max(speed - _STILL, 0.0)
        bent = _SAG * length * max(acceleration - _EVEN, 0.0) / _WEIGHT
        return float(np.hypot(seeing.noise, late)), float(np.hypot(seeing.sway, bent))


def _judge_gap(stamps: Sequence[float], poses: Sequence[Pose], stamp: float) -> None:
    """Raise InvalidTask where the gripper moved at a stamp (s), and it is not known how."""
    after = max(int(np.searchsorted(stamps, stamp)), 1)
    if len(stamps) == 1 or stamps[after] - stamps[after - 1] <= _GAP:
        return
    off = poses[after - 1].inverse().compose(poses[after])
    if max(float(np.linalg.norm(off.position)), angle_between(off.rotation, np.eye(3))) > _SAME:
        raise InvalidTask(f'observed_points.header.stamp = {stamp:.3f} s: expected gripper poses '
                          f'at most {_GAP:g} s apart then, not '
                          f'{stamps[after] - stamps[after - 1]:.3g} s')


def deviation(plan: Plan, time: float, points: Floats) -> float:
    """Return the median distance of points (n, 3), m, from the DLO as planned at a time.

    Between two waypoints the nodes are taken to go straight; the median does not mind outliers.

    Parameters
    ----------
    plan : Plan
    time : float
        Time in s, of `Plan.times`.
    """
    times = plan.times
    k = int(np.clip(np.searchsorted(times, time, side='right') - 1, 0, max(len(plan) - 2, 0)))
    shapes = [plan.shapes[k], plan.shapes[min(k + 1, len(plan) - 1)]]
    span = times[min(k + 1, len(plan) - 1)] - times[k]
    share = float(np.clip((time - times[k]) / span, 0, 1)) if span > 0 else 0.0
    samples = np.linspace(0, 1, _SAMPLED)
    one, other = (shape.positions_at(samples * shape.s[-1]) for shape in shapes)
    return _median_distance(points, (1 - share) * one + share * other)


def _median_distance(points: Floats, nodes: Floats) -> float:
    """Return the median distance of points (n, 3) from the line through nodes (k, 3)."""
    ahead = np.diff(nodes, axis=0)
    off = points[:, None] - nodes[:-1]
    along = np.einsum('mkj,kj->mk', off, ahead) / np.maximum((ahead**2).sum(axis=1), 1e-300)
    near = off - np.clip(along, 0, 1)[:, :, None] * ahead
    return float(np.median(np.linalg.norm(near, axis=2).min(axis=1)))


def motion_at(stamps: Sequence[float] | Floats, poses: Sequence[Pose], stamp: float,
              length: float) -> tuple[float, float]:
    """Return about how fast a body moves, m/s, and with what acceleration, m/s^2.

    A parabola is laid through what is known near that time; the far end of a DLO of this `length`
    (m) counts, where the body turns.
    """
    low, high = np.searchsorted(stamps, (stamp - _ABOUT, stamp + _ABOUT))
    if high - low < 3:
        return 0.0, 0.0
    near = np.unique(np.linspace(low, high - 1, min(high - low, _NEAR)).astype(int))
    times = np.array([stamps[k] - stamp for k in near])
    last = poses[near[-1]].rotation
    turns = Rotation.from_matrix([poses[k].rotation @ last.T for k in near]).as_rotvec()
    rows = np.hstack([[poses[k].position for k in near], length * turns])
    fit = np.polynomial.polynomial.polyfit(times, rows, 2)
    sizes = np.linalg.norm(fit.reshape(3, 2, 3), axis=2).sum(axis=1)
    return float(sizes[1]), float(2 * sizes[2])
