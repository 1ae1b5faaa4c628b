"""A plan as a smooth motion in time: its path, gone through within the robot's limits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.inverse.path import GripperPath
from dlo_planner.inverse.plan import Plan
from dlo_planner.model.checks import instance, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put

_TIGHT = 5e-3    # by how much slower than the limits allow it may be
_ROUNDS = 40     # halvings of the time between two looks
_MOST = 100_000  # times asked for at once


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Value):
    """Of the gripper; each may be infinite.

    Attributes:
        linear_speed: m/s; angular_speed: rad/s
        linear_acceleration: m/s^2; angular_acceleration: rad/s^2
        ramp: part of the time in which the gripper starts, and stops, 0 < ramp <= 0.5. Short ones
            set the DLO swinging: where the miss in motion counts, long ones are faster in the end.

    Raises:
        InvalidTask: naming the argument
    """

    linear_speed: float = 0.1
    angular_speed: float = 0.5
    linear_acceleration: float = 0.5
    angular_acceleration: float = 2.0
    ramp: float = 0.3

    def __post_init__(self):
        for name in ('linear_speed', 'angular_speed', 'linear_acceleration',
                     'angular_acceleration'):
            value = getattr(self, name)
            put(self, **{name: np.inf if isinstance(value, float) and value == np.inf
                         else number(f'Limits.{name}', value, above=0)})
        put(self, ramp=number('Limits.ramp', self.ramp, above=0, maximum=0.5))
        super().__post_init__()


class Trajectory(Value):
    """The gripper's way in time: at rest at both ends, continuous acceleration between.

    Its path runs through the plan's poses (`inverse.path`). Each leg of it, from stop to stop, is
    started and ended by smooth ramps and slowed down evenly until the limits hold; at a dwell the
    gripper stays for as long as in the plan. A leg that no limit slows down, because those that
    concern it are infinite, takes as long as in the plan.

    Args:
        plan: Plan with two poses at least
        limits: Limits; None: the default ones

    Attributes:
        path: GripperPath
        limits: Limits
        duration: s

    Raises:
        InvalidTask: naming the argument
    """

    PARTS = ('path', 'limits')
    REMEMBERED = ('duration', '_laws')

    def __init__(self, plan: Plan, limits: Limits | None = None):
        instance('plan', plan, Plan)
        limits = Limits() if limits is None else instance('limits', limits, Limits)
        path = GripperPath.of(plan)
        laws = tuple(_TimeLaw(leg, limits) for leg in path.legs)
        put(self, path=path, limits=limits, _laws=laws,
            duration=float(sum(law.duration for law in laws)))

    def __repr__(self):
        return brief(self, f'{self.duration:.4g} s', f'{len(self.path.legs)} legs')

    def at(self, times: ArrayLike) -> tuple[list[Pose], np.ndarray, np.ndarray]:
        """Return Poses (list), velocities (n, 6) and accelerations (n, 6) at `times` (n,) s.

        Linear before angular, m/s, rad/s, m/s^2, rad/s^2, all in world axes: the angular ones are
        of the rotation that takes world coordinates, velocity = skew part of dR/dt R^T, and its
        derivative. At rest outside [0, duration].

        Raises:
            InvalidTask: a time is no finite number
        """
        which, since = self._split(times)
        poses, speeds, accelerations = [None] * since.size, *np.zeros((2, since.size, 6))
        for k in np.unique(which):
            here = np.flatnonzero(which == k)
            position, turns, speeds[here], accelerations[here] = self._laws[k].at(since[here])
            for index, *pose in zip(here, position, turns, strict=True):
                poses[index] = Pose.from_rotation(*pose)
        return poses, speeds, accelerations

    def progress(self, times: ArrayLike) -> np.ndarray:
        """Return the plan's own times (n,), as in `Plan.times`, that are reached at `times` s."""
        which, since = self._split(times)
        done = np.empty(since.size)
        for k in np.unique(which):
            done[which == k] = self._laws[k].progress(since[which == k])[0]
        return done

    def _split(self, times):
        """Return indices of legs (n,) and the times (n,) since their beginnings."""
        times = np.clip(row('times', times, most=_MOST), 0, self.duration)
        ends = np.cumsum([law.duration for law in self._laws])
        which = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
        return which, times - np.append(0.0, ends[:-1])[which]


class _TimeLaw:
    """How a Leg is gone through from rest to rest; `duration` s."""

    def __init__(self, leg, limits):
        self._leg, self._ramp = leg, limits.ramp
        self._span = leg.knots[-1] - leg.knots[0]
        self._pace = self._slowdown(limits)
        self.duration = float(self._span * self._pace)

    def progress(self, times):
        """Return parameters, their rates and the changes of these (n,) at times (n,) s."""
        share = np.clip(times / self.duration, 0, 1)
        late = share > 0.5
        done, rate, change = _started(np.where(late, 1 - share, share), self._ramp)
        done = np.where(late, 1 - done, done) * self._span + self._leg.knots[0]
        if self._leg.still:  # waiting has no ramps
            done = share * self._span + self._leg.knots[0]
        return (done, rate / self._pace,
                np.where(late, -change, change) / (self._span * self._pace**2))

    def at(self, times):
        """Return positions (n, 3), rotations (n, 3, 3), speeds and accelerations (n, 6)."""
        done, rate, change = (v[:, None] for v in self.progress(times))
        position, turn, first, second = self._leg.at(done[:, 0])
        return position, turn, rate * first, change * first + rate**2 * second

    def _slowdown(self, limits):
        """Return the factor by which the leg takes longer than in the plan; no limit is exceeded.

        Each limit asks for a factor at each time, at the pace of the plan. Where the largest is
        sought, an interval is halved until its factor cannot exceed the largest found by more than
        _TIGHT: the factors are known at its ends, and their slopes are bounded.
        """
        self._pace, self.duration = 1.0, float(self._span)
        if self._leg.still:
            return 1.0
        most = np.array([limits.linear_speed, limits.angular_speed, limits.linear_acceleration,
                         limits.angular_acceleration])
        edges = self._edges()
        a, b = edges[:-1], edges[1:]
        largest = 0.0
        for _ in range(_ROUNDS):
            sizes = self._sizes(np.append(a, b)).reshape(2, -1, 4)
            largest = max(largest, _factors(sizes, most).max())
            bound = _factors(sizes.mean(axis=0) + 0.5 * (b - a)[:, None] * self._slopes(a, b), most)
            wide = bound > (1 + _TIGHT) * largest
            if not wide.any():
                break
            a, b, middle = a[wide], b[wide], 0.5 * (a + b)[wide]
            a, b = np.append(a, middle), np.append(middle, b)
        else:
            largest = max(largest, bound.max())
        return (1 + _TIGHT) * largest or 1.0

    def _edges(self):
        """Return times between which the leg has no knot and the ramps are smooth and monotonic."""
        wanted = self._leg.knots
        low, high = np.zeros(wanted.size), np.full(wanted.size, self.duration)
        for _ in range(35):  # the time of each knot, by halving
            middle = 0.5 * (low + high)
            before = self.progress(middle)[0] < wanted
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        ramps = self._ramp * np.array([0.0, 0.5, 1.0])
        marks = self.duration * np.concatenate([ramps, 1 - ramps, [0.5]])
        return np.unique(np.concatenate([high[1:-1], marks]))

    def _sizes(self, times):
        """Return (n, 4): sizes of linear and angular speed, linear and angular acceleration."""
        _, _, speed, acceleration = self.at(times)
        return np.stack([np.linalg.norm(v, axis=1) for v in (
            speed[:, :3], speed[:, 3:], acceleration[:, :3], acceleration[:, 3:])], axis=1)

    def _slopes(self, a, b):
        """Return (n, 4): bounds of the slopes of `_sizes` between times a and b of `_edges`."""
        begin, end = self.progress(a), self.progress(b)
        first, second, third = np.moveaxis(self._leg.bounds(begin[0], end[0]), 2, 0)
        rate = np.maximum(begin[1], end[1])[:, None]
        change = np.maximum(np.abs(begin[2]), np.abs(end[2]))[:, None]
        middle = 0.5 * (a + b) / self.duration
        ramping = np.minimum(middle, 1 - middle) < self._ramp
        jerk = (ramping * _steepest(self._ramp) / self.duration**2)[:, None]
        return np.hstack([change * first + rate**2 * second,
                          jerk * first + 3 * rate * change * second + rate**3 * third])


def _factors(sizes, most):
    """Return by which factor (...,) sizes (..., 4) of `_sizes` ask for more time."""
    speeds, accelerations = np.split(sizes / most, 2, axis=-1)
    return np.maximum(speeds.max(axis=-1), np.sqrt(accelerations.max(axis=-1)))


def _started(share, ramp):
    """Return a smooth start's progress, rate and change of rate (n,) at shares of the whole <= 0.5.

    The rate grows in the ramp as 10 x^3 - 15 x^4 + 6 x^5 and is even then; with an equal ramp at
    the end the progress is 1 in all.
    """
    x, top = np.minimum(share / ramp, 1), 1 / (1 - ramp)
    progress = np.where(share < ramp, ramp * x**4 * (2.5 - 3 * x + x**2), share - 0.5 * ramp)
    return (top * progress, top * x**3 * (10 - 15 * x + 6 * x**2),
            top / ramp * 30 * x**2 * (1 - x) ** 2)


def _steepest(ramp):
    """Return the largest slope of the change of rate in `_started`: of 30 x^2 (1 - x)^2."""
    return 10 / np.sqrt(3) / (ramp**2 * (1 - ramp))
