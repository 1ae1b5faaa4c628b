# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a camera sees of the DLO, made an Estimate of it: the closed loop without ROS.

Measured gripper poses and clouds of points come with stamps of one clock. A cloud counts as seen
where the gripper was at its stamp; the faster the gripper moved then, the less it counts. One that
does not agree with what was expected is not believed; two of the last eight are a doubt, or one
that is far from it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from threading import Condition
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.blas import one_thread
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.identify.carried import carried
from dlo_planner.identify.estimate import Estimate, way_between
from dlo_planner.identify.observation import Observation, gripper_at
from dlo_planner.identify.observer import Observer
from dlo_planner.identify.residuals import point_residuals
from dlo_planner.identify.smoother import WORST_CAMERA, LookErrors, Off
from dlo_planner.identify.vibration import LEAST_PERIODS, STATED, FreeVibration, enough
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.plan import Plan
from dlo_planner.trajectory.modal_response import slowest_period
from dlo_planner.trajectory.timed_path import TimedPath
from dlo_planner.uncertainty.parameters import Uncertainty
from dlo_planner.uncertainty.state import CAMERA, CameraError

_REMEMBERED = 1000   # gripper poses: 2 s of them at 500 Hz
_ABOUT = 0.25        # s before and after a stamp; speed and acceleration are fitted to them.
_SAG, _WEIGHT = 0.5, 9.81  # of the length: how far weight bends a soft DLO; m/s^2
_MOST_POINTS = 100   # More points of a cloud add little and take long.
_LEAST_POINTS = 3
_PATIENCE = 0.1      # s; the gripper's pose may come so much later than a cloud of its time.
_STILL, _EVEN = 2e-3, 5e-3  # m/s, m/s^2; noise of the poses alone gives as much.
_SET_BACK = 1.0      # s; with a stamp that is older by so much the clock was set back.
_GAP, _SAME = 0.5, 1e-3  # s between poses; m and rad by which one is still the same
_LONGEST_SWING = 2.0  # s
_NEAR = 12           # A motion is fitted to so many poses.
_UNKNOWN = 0.25      # This fraction of how far motion bends a DLO is not known by simulation.
_SWING_STEP = 0.1    # s
_BENT = 33           # places along the DLO
_LASTS = 2.5         # s; a motion is looked at for so long after its end.
_LEAST_SWINGS = 3    # From so many looks on an amplitude of vibration is estimated.
_ACROSS = 2          # axes along which a point is off its DLO
_OWN = 4.0           # Points farther off than so many median distances are not the DLO's.
_DOUBT, _OF = 2, 8   # Fewer looks that disagree, of so many last ones, are left to chance.
_OFTEN = 0.05        # s between two clouds to which a vibration is fitted.
_CLOUDS = 50         # A vibration is fitted to so many clouds at most.
_NO_CHANCE = 10.0    # times the innovation that one look in 10,000 exceeds; one such is enough.
# Fraction of the stamps' error that differs from look to look: filters and queues make some 20 ms.
_JITTER = 0.4
_FAR = 6.0           # A cut-out may be seen off by so many deviations along an axis.


@dataclass(frozen=True)
class EstimatorConfig:
    """How well the camera sees, how uncertain the DLO is, and how often it is looked at.

    Deviations are standard deviations of what is independent and normal; see `Observer`.

    Attributes
    ----------
    spread : Uncertainty
        Of the DLO, and of how the gripper holds it.
    noise : float
        Of a seen point along each axis, m.
    bias : float
        Of the camera's constant error along each axis, m. Where looks tell that a camera is farther
        off than `bias` and `camera_rotation` state, both count as larger alike
        (`Estimate.camera_scale`).
    camera_rotation : float
        Of the camera's constant rotation about each axis, rad.
    outliers : float
        Part of the points that are none of the DLO's.
    sway : float
        Of the free end about its rest while the gripper stands, m.
    cutout : float
        Of the place of each cut-out along each axis, m; 0: it is where it is stated.
    stamps : float
        Of the constant delay of the stamps of clouds, s; they are taken as wrong by 0.4 times as
        much more, another one in each.
    robot_position, robot_rotation : float
        Of the robot's error, m along and rad about each axis.
    robot_way, robot_time : float
        Way, m, and time, s, in which that error changes.
    slip_position, slip_rotation : float
        How far the DLO may have slipped in the gripper where looks do not agree any more, m along
        and rad about each axis.
    kink : float
        By how much it may be bent for good then, about each axis of its section, at any one place,
        rad.
    period : float
        Between two clouds that are looked at, s.
    pose_holds : float
        How long the last gripper pose holds for clouds that are newer, where the gripper stands, s.
    correct : bool
        Whether what is executed is corrected.
    correction_period : float
        Between two corrections, s.
    largest_correction : float
        By which a gripper may be displaced, m: a plan that is farther off has to be made anew.
    """

    spread: Uncertainty = field(default_factory=Uncertainty)
    noise: float = 1e-3
    # Hand-eye calibrations leave millimeters and up to some tenths of a degree, by method and
    # motions (compared by Enebuse et al. 2022, PLOS ONE 17, e0273261): these are those of a careful
    # one, 1.7 mm and 0.05 degrees in all, assumed and not measured by us. Larger ones are told by
    # looks and then count as larger. A rotation of 3 mrad from the beginning would keep a wire of
    # 1 m out of any hole of 10 mm that the camera does not see
    bias: float = 1e-3
    camera_rotation: float = 5e-4
    outliers: float = 0.1
    sway: float = 5e-4
    cutout: float = 0.0
    # Exposure, transfer and processing take one to three images of a camera with 30 in a second,
    # and seldom all of it is taken off
    stamps: float = 0.05
    robot_position: float = 2e-4
    robot_rotation: float = 3e-4
    robot_way: float = 0.4
    robot_time: float = np.inf
    slip_position: float = 5e-3
    slip_rotation: float = 0.05
    kink: float = 0.1
    period: float = 0.2
    # poses of a robot that stands come seldom, or once; in a second one hardly goes unseen
    pose_holds: float = 1.0
    correct: bool = True
    correction_period: float = 0.5
    largest_correction: float = 0.02


@dataclass(frozen=True, eq=False)
class Swing:
    """By how much inertia bends a DLO in a motion of the gripper."""

    dt: float      # s between the n times from 0 on
    bent: Floats   # (n, k, 3) off its rest at k even arc lengths, m, axes of the gripper
    period: float  # slowest of the DLO, s

    @classmethod
    def of(cls, way: TimedPath, simulator: DirectSimulator, first: Shape) -> Swing:
        """Return the Swing of a DLO along a way, at rest in the Shape `first` before."""
        count = int(np.ceil((way.duration + _LASTS) / _SWING_STEP)) + 1
        grippers = way.poses(np.minimum(_SWING_STEP * np.arange(count), way.duration))
        motion = simulator.simulate(grippers, _SWING_STEP, first)
        if not motion.converged:
            raise NotConverged(f'the DLO in motion: {motion.message}')
        s = np.linspace(0, first.s[-1], _BENT)
        bent = [(moved.positions_at(s) - still.positions_at(s)) @ moved.gripper.rotation
                for moved, still in zip(
                    motion.shapes, simulator.track(grippers, initial=first), strict=True)]
        return cls(_SWING_STEP, np.array(bent), slowest_period(simulator.rod))

    def at(self, time: float) -> tuple[Floats, float]:
        """Return `bent` (k, 3) at a time, s, and the largest there was in the period before, m."""
        if np.isinf(time):
            return np.zeros_like(self.bent[0]), 0.0
        if time > self.dt * (len(self.bent) - 1):
            return np.zeros_like(self.bent[0]), float(
                np.linalg.norm(self.bent[-int(np.ceil(_LASTS / self.dt)):], axis=2).max())
        place = float(np.clip(time / self.dt, 0, len(self.bent) - 1))
        low = min(int(place), len(self.bent) - 2)
        begin = max(int(low - self.period / self.dt), 0)
        most = np.linalg.norm(self.bent[begin:low + 2], axis=2).max()
        share = place - low
        return (1 - share) * self.bent[low] + share * self.bent[low + 1], float(most)


class DloEstimator:
    """The Estimate of a DLO from all that was seen since the last `reset`; for several threads.

    Parameters
    ----------
    simulator : DirectSimulator
        Of the DLO as stated. Obstacles are left out: what is looked at hangs freely.
    seeing : EstimatorConfig
        How well the camera sees, and how uncertain the DLO is.
    known : Estimate, optional
        Estimate by which the DLO was stated so; what that was sure of stays sure.

    Attributes
    ----------
    estimate : Estimate
        The newest one of looks that agree; the prior before any.
    off : float
        Median distance of the points of the last look from the DLO as it is estimated, m; nan
        before any.
    normalized_innovation : float
        Of the last look, see `Estimate`; infinite: no equilibrium explains it.
    seen, looked : float
        Stamps, s, of the last look that agreed, and of any.
    closely : bool
        Whether all clouds are looked at: a slip has to be seen soon.

    Raises
    ------
    InvalidTask
        Nothing of the DLO is uncertain, or an argument makes no sense.
    """

    def __init__(self, simulator: DirectSimulator, seeing: EstimatorConfig,
                 known: Estimate | None = None) -> None:
        self.seeing = seeing
        if seeing.spread == Uncertainty() and not seeing.cutout:
            raise InvalidTask(f'seeing.spread, the uncertainty of the DLO, = {seeing.spread!r}: '
                              'expected a deviation above 0, there is nothing to be estimated')
        self._observer = Observer(simulator, seeing.spread, noise=seeing.noise, bias=seeing.bias,
                                  camera_rotation=seeing.camera_rotation, stamps=seeing.stamps,
                                  cutout=seeing.cutout, outliers=seeing.outliers,
                                  sway=seeing.sway, robot_position=seeing.robot_position,
                                  robot_rotation=seeing.robot_rotation,
                                  robot_way=seeing.robot_way, robot_time=seeing.robot_time)
        self._first = self._observer.begin()
        if known is not None and known.names == self._first.names:
            self._first = replace(self._first, covariance=self._of_dlo(known.covariance))
        self._lock = Condition()
        # (stamp, points, which of them were seen)
        self._clouds: deque[tuple[float, Floats, Bools]] = deque(maxlen=_CLOUDS)
        self._swing: tuple[Swing, Callable[[float], float]] | None = None
        self._grippers: deque[tuple[float, Pose]] = deque(maxlen=_REMEMBERED)  # (stamp, Pose)
        self.closely = False  # whether all clouds are looked at, a slip has to be seen soon
        self.reset()

    @property
    def swing(self) -> float:
        """Amplitude of the free end at rest, m, beyond noise; 0 below three looks that agreed."""
        with self._lock:
            ends = np.array(self._ends).reshape(-1, 4)
        if len(ends) < _LEAST_SWINGS:
            return 0.0
        scatter = ((ends[:, :3] - ends[:, :3].mean(axis=0)) ** 2).sum() / (len(ends) - 1)
        return float(np.sqrt(2 * max(scatter - _ACROSS * ends[:, 3].mean(), 0.0)))

    @property
    def inconsistent(self) -> bool:
        """Whether two of the last eight looks do not agree with the estimate, or one not at all.

        Looks at the DLO, and those at the cut-out.
        """
        return (sum(self._disagree) >= _DOUBT or _NO_CHANCE < self.normalized_innovation < np.inf
                or self.cutout_suspect)

    @property
    def doubted(self) -> bool:
        """The earlier name of `inconsistent`, for one release."""
        return self.inconsistent

    def reopen(self, stamp: float = -np.inf) -> None:
        """Do what `inflate_covariance` does: its earlier name, for one release."""
        self.inflate_covariance(stamp)

    @property
    def cutout_suspect(self) -> bool:
        """Whether the cut-out is seen where it cannot be, or no more where it was seen before."""
        return self._hole_moved or sum(self._holes_disagree) >= _DOUBT

    def bent(self, stamp: float, gripper: Pose) -> tuple[Floats, float] | None:
        """Return by how much (k, 3), m, a DLO in a known motion is off its rest at a stamp, s.

        World axes; and what it was at most in the period before, m. None where it is not known.
        """
        known = self._swing
        if known is None:
            return None
        swing, time_at = known
        bent, most = swing.at(time_at(stamp))
        return (bent @ gripper.rotation.T, most) if most else None

    def reset(self) -> None:
        """Forget what was seen since it began."""
        with self._lock:
            self._clouds.clear()
            self._reopened: Estimate | None = None
            self._begin(self._first)

    def inflate_covariance(self, stamp: float = -np.inf) -> None:
        """Take the DLO as one that may have slipped or been bent, from a stamp (s) on.

        The rest stays known, unless it is in doubt: the camera where no look has ever agreed, for
        then it is not the DLO that changed; the place of the cut-out where it was seen elsewhere.
        """
        with self._lock:
            if self.estimate is not self._reopened:  # else there was no look since
                seeing = self.seeing
                self._reopened = self._observer.reopened(
                    self.estimate, seeing.slip_position, seeing.slip_rotation, kink=seeing.kink,
                    camera=0.0 if self.estimate.looks else WORST_CAMERA,
                    cutout=seeing.slip_position if self.cutout_suspect else 0.0)
            self._begin(self._reopened)
            self._resting = stamp

    def ignore(self) -> None:
        """Let no further look change the estimate: the DLO does not hang freely any more."""
        with self._lock:
            self._resting = np.inf

    @one_thread()
    def vibration(self, gripper: Pose, since: float, factor: tuple[float, float] = STATED,
                  periods: float = LEAST_PERIODS) -> FreeVibration | None:
        """Return how the DLO vibrates since the gripper stands, by all looks; None: unknown.

        They have to last for some `periods` of its slowest mode. What a tracker carried along does
        not tell that it is at rest.
        """
        with self._lock:
            clouds = [(stamp, points[own]) for stamp, points, own in self._clouds
                      if stamp >= since and own.any()]
            estimate = self.estimate
        if not enough(clouds):
            return None
        near = estimate.shape(gripper)  # in equilibrium to what a look needs, not a vibration
        shape = estimate.simulator.solve(near.gripper, near if near.converged else None)
        return None if not shape.converged else FreeVibration.of(
            shape, [(stamp, estimate.camera_error.undone(points)) for stamp, points in clouds],
            factor, periods)

    def _of_dlo(self, covariance: Floats) -> Floats:
        """Return the prior (n, n) with what a covariance knows of the DLO and of its gripper.

        Of the camera and the cut-out it knew their errors as well, which are forgotten.
        """
        uncertain = self._observer.uncertain
        other = np.concatenate([uncertain.columns(name)[0] for name in (*CAMERA, 'cutout')])
        covariance = np.array(covariance)
        covariance[other] = covariance[:, other] = 0.0
        covariance[other, other] = uncertain.deviations[other]**2
        return covariance

    def _begin(self, estimate: Estimate) -> None:
        self.estimate = estimate  # the newest one of looks that agree; the prior before any
        # of the last look, whether it was believed or not: the median distance of the points from
        # the DLO as it is estimated, m, and `Estimate.normalized_innovation`
        self.off = self.normalized_innovation = np.nan
        self.seen = self.looked = -np.inf  # stamps, s, of the last look that agreed, and of any
        self._disagree: deque[bool] = deque(maxlen=_OF)  # whether the last looks did
        self._carries = False  # whether points of the last look were carried along, and not seen
        self._holes_disagree: deque[bool] = deque(maxlen=_OF)  # the same, at the cut-out
        self._holes: deque[Floats] = deque(maxlen=_OF)  # where it was seen
        self._hole_moved = False  # whether that is, on the mean, elsewhere than all looks tell
        self._swing, self._resting = None, -np.inf
        self._ends: list[tuple[float, ...]] = []  # off their rest, m, and the variance of each
        # where the gripper stands, the shape at rest there, the camera's error by which it is
        self._rest: tuple[Pose, Shape, CameraError] | None = None

    def moves(self, swing: Swing, time_at: Callable[[float], float]) -> None:
        """Take in how the DLO bends in a motion that begins; `time_at`: stamp -> its time, s."""
        self._swing = swing, time_at

    def hole(self, stated: Floats, seen: Floats) -> None:
        """Take in where a cut-out's center was seen (unless `seeing.cutout` is 0).

        One that is seen where it cannot be is not believed, nor is one that is no more where it was
        seen before; two of the last eight are a doubt. By a camera that looks at the DLO show to be
        farther off than stated it may be seen as much farther off.
        """
        seeing = self.seeing
        if not seeing.cutout:
            return
        off = float(np.linalg.norm(seen - stated))
        bias = self.estimate.camera_scale * seeing.bias
        most = _FAR * float(np.sqrt(seeing.cutout**2 + bias**2 + seeing.noise**2))
        if not off <= most:
            self._holes_disagree.append(True)
            raise InvalidTask(f'the cut-out was seen {off:.3g} m from where it is stated: expected '
                              f'{most:.3g} m at most, by observe.cutout = {seeing.cutout:g} m')
        with self._lock:
            innovation = self._observer.cutout_innovation
            agrees = not self._holes or innovation(self.estimate, stated, seen) <= 1
            self._holes.append(seen)
            self._holes_disagree.append(not agrees)
            if len(self._holes) == _OF:  # what is hidden by the noise of one look
                self._hole_moved = innovation(self.estimate, stated, np.mean(self._holes, axis=0),
                                              seeing.noise / np.sqrt(_OF)) > 1
            if agrees:
                self.estimate = self._observer.see_cutout(self.estimate, stated, seen)

    def gripper(self, stamp: float, pose: Pose) -> None:
        """Take in where the gripper frame was at a stamp (s), if it is newer than the last.

        One that is much older says that the clock was set back: what was known is of another time.
        """
        with self._lock:
            if self._grippers and stamp < self._grippers[-1][0] - _SET_BACK:
                self._grippers.clear()
            if not self._grippers or stamp > self._grippers[-1][0]:
                self._grippers.append((stamp, pose))
                self._lock.notify_all()

    def due(self, stamp: float) -> bool:
        """Return whether a cloud of this stamp (s) should be looked at."""
        last, period = self._clouds[-1][0] if self._clouds else -np.inf, self.seeing.period
        often = self.closely or stamp < self._resting
        return abs(stamp - last) >= (min(period, _OFTEN) if often else period)

    def look(self, stamp: float, points: Floats) -> Estimate:
        """Return the Estimate after one more cloud (n, 3), or the one before if they disagree."""
        if len(points) < _LEAST_POINTS:
            raise InvalidTask(f'observed_points has {len(points)} points: expected {_LEAST_POINTS} '
                              'at least')
        def known_then() -> bool:
            return bool(self._grippers) and self._grippers[-1][0] >= stamp

        with self._lock:  # a cloud may be quicker than the gripper's next pose
            self._lock.wait_for(known_then, _PATIENCE)
            stands = bool(self._grippers) and self._stands(list(self._grippers), stamp)
            if not stands and self._grippers and stamp <= self._grippers[-1][0] + _GAP:
                self._lock.wait_for(known_then, _GAP)  # poses of one that moves come seldom
            known, estimate = list(self._grippers), self.estimate
        if known and self._stands(known, stamp):
            known.append((stamp, known[-1][1]))
        if not known or not known[0][0] <= stamp <= known[-1][0]:
            span = f'{known[0][0]:.3f} to {known[-1][0]:.3f} s' if known else 'none'
            raise InvalidTask(f'observed_points.header.stamp = {stamp:.3f} s: expected a time of '
                              f'which gripper poses are known: {span}, or, where it stands, '
                              f'observe.pose_holds = {self.seeing.pose_holds:g} s later at most')
        stamps, poses = zip(*known, strict=True)
        _judge_gap(stamps, poses, stamp)
        sway, velocity = self._own(stamps, poses, stamp)
        gripper, delay = gripper_at(stamps, poses, stamp), estimate.delay
        moving, bent = self.bent(stamp - delay, gripper), None
        if moving is not None:
            bent, sway = moving[0], float(np.hypot(self.seeing.sway, _UNKNOWN * moving[1]))
        chosen = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(
            int))
        cloud = points[chosen]
        with self._lock:
            own = ~carried(self._clouds[-1][1] if self._clouds else cloud, cloud)
            self._clouds.append((stamp, cloud, own))
            if stamp < self._resting:
                return estimate
            if not own.all() and not self._carries and self._disagree:
                self._disagree[-1] = False  # then some were carried in that cloud as well
            self._carries = not own.all()
        if own.sum() < _LEAST_POINTS:
            raise InvalidTask(f'observed_points: {own.sum()} of {own.size} points move against '
                              f'each other: expected {_LEAST_POINTS} at least, the others are '
                              'carried along by the tracker, and not seen')
        seen = Observation(gripper, cloud[own])
        elapsed = max(stamp - self.seen, 0.0) if np.isfinite(self.seen) else 0.0
        after = self._observer.update(estimate, seen, elapsed=elapsed, sway=sway,
                                      late=_JITTER * self.seeing.stamps * velocity,
                                      velocity=velocity, bent=bent)
        shape = after.last_shape if after.agrees else estimate.shape(gripper)
        if shape is not None and not shape.converged:
            shape = None
        by = after if after.agrees else estimate
        off = np.inf if shape is None else _median_distance(
            shape, by.camera_error.undone(seen.points),
            Off.of(shape, LookErrors(velocity=tuple(velocity.tolist())), None).at(by.delay))
        with self._lock:
            if self.estimate is not estimate:  # it was reset meanwhile
                return self.estimate
            self.looked, self.off = stamp, off
            self.normalized_innovation = after.normalized_innovation if after.converged else np.inf
            self._disagree.append(not after.agrees)
            if after.agrees:
                self.estimate, self.seen = after, stamp
                if shape is not None and not velocity.any():
                    self._swung(seen, shape)
                else:
                    self._rest = None
        if not after.converged:
            raise InvalidTask('observed_points: no equilibrium of the DLO explains them')
        return self.estimate

    def _stands(self, known: Sequence[tuple[float, Pose]], stamp: float) -> bool:
        """Return whether the last of the gripper's poses (stamp, Pose) holds until a stamp (s).

        It stands where the last two are the same, or no other one is known.
        """
        (last, here), before = known[-1], known[-2:][0][1]
        return last < stamp <= last + self.seeing.pose_holds and way_between(before, here) <= _SAME

    def _swung(self, seen: Observation, shape: Shape) -> None:
        """Take in where the free end is in a look; a point at s swings by (s / L)^2 of it."""
        if self._rest is None or way_between(self._rest[0], seen.gripper) > _SAME:
            self._rest, self._ends = (seen.gripper, shape, self.estimate.camera_error), []
        _, rest, camera = self._rest
        away, s, *_ = point_residuals(rest, camera.undone(seen.points))
        size = np.linalg.norm(away, axis=1)
        own = size <= _OWN * np.median(size)
        share = (s[own] / rest.s[-1]) ** 2
        if (weight := float(share @ share)) > 1.0:  # it is seen there
            end = share @ away[own] / weight
            self._ends.append((*end.tolist(), self.seeing.noise**2 / weight))

    def _own(self, stamps: Sequence[float], poses: Sequence[Pose],
             stamp: float) -> tuple[float, Floats]:
        """Return the sway, m, and how the gripper moves (6,), rad/s and m/s.

        Inertia bends the DLO like a part of its weight, by the acceleration in the last swing.
        """
        seeing, rod = self.seeing, self._observer.uncertain.simulator.rod
        times = np.arange(stamp, stamp - min(slowest_period(rod), _LONGEST_SWING), -_ABOUT)
        found = [motion_at(stamps, poses, time, rod.length) for time in times]
        acceleration = max(one.acceleration for one in found)
        bent = _SAG * rod.length * max(acceleration - _EVEN, 0.0) / _WEIGHT
        moves = found[0].twist * (found[0].speed > _STILL)
        return float(np.hypot(seeing.sway, bent)), moves


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
    """Return the median distance, m, of points (n, 3) from the DLO as planned at a time, s."""
    place = float(np.interp(time, plan.times, np.arange(len(plan))))
    k = int(place)
    shapes = plan.shapes[k], plan.shapes[min(k + 1, len(plan) - 1)]
    one, other = (shape.positions_at(np.linspace(0, shape.s[-1], _BENT)) for shape in shapes)
    return _median_distance(shapes[0], points, (place - k) * (other - one))


def _median_distance(shape: Shape, points: Floats, bent: Floats | None = None) -> float:
    """Return the median distance of points (n, 3) from a Shape, see `point_residuals`."""
    return float(np.median(np.linalg.norm(point_residuals(shape, points, bent=bent).off, axis=1)))


class RigidMotion(NamedTuple):
    """How a body moves."""

    speed: float         # m/s, of a DLO's tip at most
    acceleration: float  # m/s^2, the same
    twist: Floats        # (6,) angular velocity, rad/s, and velocity, m/s, world axes


def motion_at(stamps: Sequence[float] | Floats, poses: Sequence[Pose], stamp: float,
              length: float) -> RigidMotion:
    """Return about how a DLO of a length, m, moves: by a parabola through what is near a stamp."""
    low, high = np.searchsorted(stamps, (stamp - _ABOUT, stamp + _ABOUT))
    if high - low < 3:
        return RigidMotion(0.0, 0.0, np.zeros(6))
    near = np.unique(np.linspace(low, high - 1, min(high - low, _NEAR)).astype(int))
    times = np.array([stamps[k] - stamp for k in near])
    last = poses[near[-1]].rotation
    turns = Rotation.from_matrix([poses[k].rotation @ last.T for k in near]).as_rotvec()
    rows = np.hstack([[poses[k].position for k in near], length * turns])
    fit = np.polynomial.polynomial.polyfit(times, rows, 2)
    sizes = np.linalg.norm(fit.reshape(3, 2, 3), axis=2).sum(axis=1)
    return RigidMotion(float(sizes[1]), float(2 * sizes[2]),
                       np.concatenate([fit[1, 3:] / length, fit[1, :3]]))
