# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan as a smooth motion in time: its path, and a time law for each leg of the path.

Whether it keeps its limits is proved: speeds, accelerations and jerks are bounded at all times.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import row
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.path import GripperPath, Leg
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.stage import GRIPPER, holds_along
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.topp import fastest_rates

_TIGHT = 5e-3    # by which part a bound may exceed the largest value that was found
_BISECTIONS = 40     # halvings of an interval of time, at most
_PARTS = 8       # of the time between two knots, in which jerks are bounded


def most_used(leg: Leg, law: TimeLaw, limits: Limits,
              powers: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> float:
    """Return an upper bound of the largest part of the limits that any arm uses at any time.

    Parts of the limits of speed, acceleration and jerk count with `powers` of them.
    """
    return max(_most_used(arm, law, limits, powers) for arm in leg.all_arms)


def _most_used(leg: Leg, law: TimeLaw, limits: Limits,
               powers: tuple[float, float, float]) -> float:
    """Return the same of one arm.

    Speed and acceleration are computed at the ends of an interval of time, and their slopes within
    it are bounded. The interval is halved until its bound is at most 0.5 % above the largest value
    found. Jerks are bounded only. The shift of the law is left out.
    """
    most, power = limits.sizes, np.array(powers[:2])[:, None]
    times = np.unique(np.concatenate([[0.0], law.arrivals(leg.knots[1:-1]), [law.duration]]))
    a, b = times[:-1], times[1:]
    largest = proved = _largest_jerk(leg, law, a, b, most[2]) ** powers[2]
    for _ in range(_BISECTIONS):
        ends = law.at(np.append(a, b))
        used = _sizes(leg, ends) / most[:2]
        largest = max(largest, (used**power).max())
        slopes = _slopes(_bounds(leg, law, ends, a, b))
        bound = ((used.reshape(2, -1, 2, 2).mean(axis=0) + 0.5 * (b - a)[:, None, None]
                  * slopes / most[:2]) ** power).max(axis=(1, 2))
        wide = bound > (1 + _TIGHT) * largest
        proved = max(proved, bound[~wide].max(initial=0.0))
        if not wide.any():
            return float(max(largest, proved))
        a, b, middle = a[wide], b[wide], 0.5 * (a + b)[wide]
        a, b = np.append(a, middle), np.append(middle, b)
    return float(max(proved, bound.max()))


def _largest_jerk(leg: Leg, law: TimeLaw, a: Floats, b: Floats, most: Floats) -> float:
    """Return a bound of the largest jerk as a part of the limits `most` (2,)."""
    shares = np.linspace(0, 1, _PARTS + 1)
    edges = a[:, None] + (b - a)[:, None] * shares
    a, b = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    return float((_jerks(_bounds(leg, law, law.at(np.append(a, b)), a, b)) / most).max())


def _sizes(leg: Leg, at: Floats) -> Floats:
    """Return (n, 2, 2): speed and acceleration, each linear and angular, from u, rates (4, n)."""
    _, _, first, second = leg.at(at[0])
    rate, change = at[1][:, None], at[2][:, None]
    both = np.stack([rate * first, change * first + rate**2 * second], axis=1)
    result: Floats = np.linalg.norm(both.reshape(-1, 2, 2, 3), axis=3)
    return result


class _Bounds(NamedTuple):
    """Bounds between n pairs of times."""

    leg: Floats  # (n, 2, 3) of the leg's derivatives by u, linear and angular, first to third
    rate: Floats  # (n,) of u'
    change: Floats  # (n,) of u''
    jerk: Floats  # (n,) of u'''


def _bounds(leg: Leg, law: TimeLaw, ends: Floats, a: Floats, b: Floats) -> _Bounds:
    """Return the _Bounds between times a and b (n,); ends (4, 2 n): of the law at a, then at b."""
    (change, jerk), half = law.bounds(a, b), 0.5 * (b - a)
    sizes = np.abs(ends).reshape(4, 2, -1).max(axis=1)
    return _Bounds(leg.bounds(*np.split(ends[0], 2)), sizes[1] + half * change,
                   np.minimum(sizes[2] + half * jerk, change), jerk)


def _slopes(bounds: _Bounds) -> Floats:
    """Return (n, 2, 2): bounds of the slopes of `_sizes` between the times."""
    first, second = np.moveaxis(bounds.leg, 2, 0)[:2]
    return np.stack([bounds.change[:, None] * first + bounds.rate[:, None] ** 2 * second,
                     _jerks(bounds)], axis=1)


def _jerks(bounds: _Bounds) -> Floats:
    """Return (n, 2): bounds of the linear and angular jerk between the times."""
    first, second, third = np.moveaxis(bounds.leg, 2, 0)
    rate, change = bounds.rate[:, None], bounds.change[:, None]
    result: Floats = bounds.jerk[:, None] * first + 3 * rate * change * second + rate**3 * third
    return result


_SHORTEST = 0.01  # of a leg's duration: the least width of a window that only bounds the jerk
_ROUNDS = 30      # of slowing down
# powers of what is used of speed, acceleration and jerk: in a law that is slower by f they are less
# by f, f^2 and, where the path bends, f^3; what its windows make of the jerk is less by f^2 only,
# so it is slowed down again, by 1 % at least
_SLOWED, _LEAST_SLOWED = (1.0, 1 / 2, 1 / 3), 1.01
_MOST = 100_000   # times in one call


class TimedPath(Value):
    """The gripper's motion in time, from rest to rest, with continuous acceleration.

    Parameters
    ----------
    path : GripperPath
    laws : tuple of TimeLaw or None
        TimeLaw of each of its legs; None for a dwell, which takes as long as in the plan.
    limits : Limits
        Limits that the motion keeps.

    Attributes
    ----------
    duration : float
        Duration in s.
    starts : ndarray, shape (k + 1,)
        Times at which the k legs begin, s, and the duration.
    """

    _PARTS: tuple[str, ...] = ('path', 'laws', 'limits')
    _REMEMBERED = ('starts', 'duration')

    path: GripperPath
    laws: tuple[TimeLaw | None, ...]
    limits: Limits
    starts: Floats
    duration: float

    def __init__(self, path: GripperPath, laws: tuple[TimeLaw | None, ...], limits: Limits) -> None:
        spans = [np.ptp(leg.knots) if law is None else law.duration
                 for leg, law in zip(path.legs, laws, strict=True)]
        starts = np.append(0.0, np.cumsum(spans))
        put(self, path=path, laws=tuple(laws), limits=limits, starts=starts,
            duration=float(starts[-1]))

    def __repr__(self) -> str:
        return brief(self, f'{self.duration:.4g} s', f'{len(self.path.legs)} legs')

    def at(self, times: ArrayLike) -> tuple[list[Pose], Floats, Floats]:
        """Return Poses (list), velocities (n, 6) and accelerations (n, 6) at `times` (n,) s.

        Linear before angular, m/s, rad/s, m/s^2, rad/s^2, all in world axes: the angular ones are
        of the rotation that takes world coordinates, velocity = skew part of dR/dt R^T, and its
        derivative. At rest outside [0, duration].

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        which, since = self._split(times)
        poses = np.empty(since.size, dtype=object)
        speeds, accelerations = np.zeros((2, since.size, 6))
        for k in np.unique(which):
            places, leg = np.flatnonzero(which == k), self.path.legs[k]
            done, rate, change, _ = self._progress(k, since[places])[:, :, None]
            position, turns, first, second = leg.at(done[:, 0])
            speeds[places], accelerations[places] = rate * first, change * first + rate**2 * second
            shift = None if self.laws[k] is None else self.laws[k].shift
            if shift is not None:
                position = position + shift.at(since[places])
                speeds[places, :3] += shift.at(since[places], 1)
                accelerations[places, :3] += shift.at(since[places], 2)
            for index, *pose in zip(places, position, turns, strict=True):
                poses[index] = Pose.from_rotation(*pose)
        return list(poses), speeds, accelerations

    def poses(self, times: ArrayLike) -> list[Pose]:
        """Return the Poses of `at` alone, in less time.

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        return [Pose.from_rotation(*frame) for frame in zip(*self.frames(times), strict=True)]

    def arm(self, name: str) -> TimedPath:
        """Return the motion of one arm alone, at the same times.

        Parameters
        ----------
        name : str
            'gripper', or one of the other arms, `path.arms`.

        Raises
        ------
        InvalidTask
            There is no arm of this name.
        """
        path, laws = self.path.arm(name), self.laws
        if name != GRIPPER:  # a shift against vibrations is that of the gripper
            laws = tuple(law if law is None else replace(law, shift=None) for law in laws)
        return TimedPath(path, laws, self.limits)

    def frames(self, times: ArrayLike) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and rotations (n, 3, 3) of `poses`: many cost little more."""
        which, since = self._split(times)
        positions, rotations = np.empty((since.size, 3)), np.empty((since.size, 3, 3))
        for k in np.unique(which):
            places, law = which == k, self.laws[k]
            positions[places], rotations[places] = self.path.legs[k].poses(
                self._reached(k, since[places]))
            if law is not None and law.shift is not None:
                positions[places] += law.shift.at(since[places])
        return positions, rotations

    def progress(self, times: ArrayLike) -> Floats:
        """Return the plan's times (n,), as in `Plan.times`, that are reached at `times` (n,) s.

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        which, since = self._split(times)
        done = np.empty(since.size)
        for k in np.unique(which):
            done[which == k] = self._reached(k, since[which == k])
        return done

    def _reached(self, k: int, since: Floats) -> Floats:
        law = self.laws[k]
        return self._progress(k, since)[0] if law is None else law.reached(since)

    def _progress(self, k: int, since: Floats) -> Floats:
        law, leg = self.laws[k], self.path.legs[k]
        if law is not None:
            return law.at(since)
        done = np.minimum(leg.knots[0] + since, leg.knots[-1])
        return np.stack([done, *np.zeros((3, since.size))])

    def _split(self, times: ArrayLike) -> tuple[Ints, Floats]:
        """Return indices of legs (n,) and the times (n,) since their beginnings."""
        times = np.clip(row('times', times, most=_MOST), 0, self.duration)
        which = np.minimum(np.searchsorted(self.starts[1:], times), len(self.laws) - 1)
        return which, times - self.starts[which]


def standing(pose: Pose, duration: float, limits: Limits) -> TimedPath:
    """Return the motion of an arm that stands still for a duration, s."""
    leg = Leg(np.array([0.0, duration]), np.array([pose.position] * 2),
              np.array([pose.rotation] * 2))
    return TimedPath(GripperPath(leg.knots, (leg,)), (None,), limits)


def holds_in(timed: TimedPath, holds: Holds, times: ArrayLike) -> list[Holds]:
    """Return what Holds are at times (n,) s of a motion: where their arms are, the others stay."""
    arms = {name: timed.arm(name).poses(times) for name in timed.path.arms}
    return holds_along(holds, arms, np.size(times))


def fastest_law(leg: Leg, limits: Limits) -> TimeLaw | None:
    """Return the fastest law of a Leg within limits, whatever the DLO does; None for a dwell.

    The largest rates within the limits, smoothed by a window as wide as the limits of jerk need.
    """
    if leg.still:
        return None
    return smoothed(leg, limits, *fastest_rates(leg, limits), np.zeros(0))


def smoothed(leg: Leg, limits: Limits, parameters: Floats, rates: Floats,
             windows: Floats) -> TimeLaw:
    """Return a TimeLaw slowed down evenly until it keeps the limits.

    Shapes: parameters, rates (m,), windows (k,).
    """
    law = TimeLaw(parameters, rates, windows) if len(windows) else _within_jerk(
        leg, limits, parameters, rates)
    for _ in range(_ROUNDS):
        used = most_used(leg, law, limits, _SLOWED)
        if used <= 1:
            break
        law = law.slower(max(used, _LEAST_SLOWED))
    return law


def _within_jerk(leg: Leg, limits: Limits, parameters: Floats, rates: Floats) -> TimeLaw:
    """Return the TimeLaw with one window, about as wide as the limits of jerk need."""
    plain = TimeLaw(parameters, rates, np.array([1e-3]))
    first = np.array([np.linalg.norm(arm.at(parameters).first.reshape(-1, 2, 3), axis=2).max(axis=0)
                      for arm in leg.all_arms])
    most = (np.abs(np.diff(rates)) / plain.steps).max() * first / limits.sizes[2]
    return TimeLaw(parameters, rates,
                   np.array([max(2 * most.max(), _SHORTEST * plain.duration)]))
