# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The limits of what goes out: measured on the poses themselves, as a robot receives them.

Start, stops, corrections and previews are all judged by `used`: differences of the poses
that would be sent, one in each period. The Limiter is the last to see a command.

A motion comes to rest, or begins again, along its own path: time along it runs slower and slower,
or quicker and quicker, by the polynomial 10 x^3 - 15 x^4 + 6 x^5, so that the motion's acceleration
goes on without a jump at both ends.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlo_planner.geometry.so3 import matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.identify.online_trajectory import CorrectedTrajectory
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.timed_path import TimedPath

_ROUNDING = 1e-3   # by which part a command may exceed a limit: of differences of rounded numbers
_CHOICES = 14      # durations of each phase of a stop that are tried
_TRIED = 60        # stops that are looked at as a whole
_ENDLESS = 1e9     # stands for a limit that is infinite
_PARTS = slice(0, 3), slice(3, 6)  # linear, angular
_SHORTEST = 2     # periods
_LONGEST = 20.0   # s
_GUESSED = 1.5    # speeds over acceleration: hardly any stop is shorter
_LEAST, _MOST = 1.03, 1.5  # from one duration that is tried to the next
_SEEN = 3         # periods before and after it that a jerk needs to be seen

# a product of two of these polynomials, over one period, is integrated exactly
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS

Rising = tuple[int, int]  # periods since time began to run, periods until it runs evenly


def velocities(positions: Floats, rotations: Floats, period: float) -> Floats:
    """Return (n - 1, 6) linear and angular velocities between frames that are a period (s) apart.

    In m/s and rad/s, world axes.

    Shapes: positions (n, 3), rotations (n, 3, 3).
    """
    return np.hstack([np.diff(positions, axis=0), _turns(rotations)]) / period


@kernel
def _turns(rotations: Floats) -> Floats:
    """Return (n - 1, 3) the rotation vectors from each of n rotations (n, 3, 3) to the next."""
    out = np.empty((rotations.shape[0] - 1, 3))
    for k in range(rotations.shape[0] - 1):
        put_vector(rotation_vector(times_transposed(matrix(rotations[k + 1]),
                                                    matrix(rotations[k]))), out[k])
    return out


def frames_of(poses: Sequence[Pose]) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) of n Poses."""
    return (np.array([pose.position for pose in poses]),
            np.array([pose.rotation for pose in poses]))


def used(frames: tuple[Floats, Floats], limits: Limits, period: float) -> float:
    """Return the largest part of its limits that a stream of frames uses, one in each period (s).

    Of speed, acceleration and jerk, linear and angular, by differences of positions (n, 3) and
    rotations (n, 3, 3).
    """
    rates, most = velocities(*frames, period), 0.0
    for row in limits.sizes:
        most = max(most, *(float((_sizes(rates[:, part]) / limit).max(initial=0.0))
                           for part, limit in zip(_PARTS, row, strict=True)))
        rates = np.diff(rates, axis=0) / period
    return most


@dataclass(frozen=True)
class Limiter:
    """Lets commands through that keep the limits; from the first one that does not, it stops.

    It stops on the shortest way found on which speed, acceleration and jerk keep the limits, and
    lets nothing through any more.
    """

    limits: Limits  # of the gripper frame
    period: float   # s between two commands
    pose: Pose | None = None  # the last command that went out, of the gripper frame
    rates: Floats = field(default_factory=lambda: np.zeros((2, 6)))  # its velocity, acceleration
    rest: tuple[Pose, ...] | None = None  # what is left of the stop; None: there is none

    def at_rest(self) -> 'Limiter':
        """Return the Limiter of a gripper that has come to rest where it was sent last."""
        return replace(self, rates=np.zeros((2, 6)))

    def after(self, wanted: Pose) -> 'Limiter':
        """Return the Limiter whose `pose` is the next command: the wanted one if allowed."""
        if self.rest is not None:
            return replace(self, pose=self.rest[0] if self.rest else self.pose, rest=self.rest[1:])
        if self.pose is None:
            return replace(self, pose=wanted)
        velocity = velocities(*frames_of([self.pose, wanted]), self.period)[0]
        acceleration = (velocity - self.rates[0]) / self.period
        jerk = (acceleration - self.rates[1]) / self.period
        if _part(np.stack([velocity, acceleration, jerk]), self.limits) > 1 + _ROUNDING:
            return replace(self, rest=self._stop()).after(wanted)
        return replace(self, pose=wanted, rates=np.stack([velocity, acceleration]))

    def stopping(self) -> 'Limiter':
        """Return the Limiter that comes to rest from here, whatever is wanted."""
        if self.rest is not None or self.pose is None:
            return self
        return replace(self, rest=self._stop())

    def _stop(self) -> tuple[Pose, ...]:
        """Return the Poses on which the gripper comes to rest."""
        assert self.pose is not None  # a first command is let through
        ways = [shortest_stop(self.rates[:, part], np.minimum(self.limits.sizes[:, k], _ENDLESS),
                              self.period) for k, part in enumerate(_PARTS)]
        steps = max(len(way) for way in ways)
        rates = np.hstack([np.vstack([way, np.zeros((steps - len(way), 3))]) for way in ways])
        poses, pose = [], self.pose
        for rate in self.period * rates:
            pose = Pose.from_rotation(pose.position + rate[:3], Rotation.from_rotvec(
                rate[3:]).as_matrix() @ pose.rotation)
            poses.append(pose)
        return tuple(poses)


def shortest_stop(rates: Floats, most: Floats, period: float) -> Floats:
    """Return the velocities (n, 3), one in each period, of a short stop within limits.

    Three phases: even jerk, none, even jerk. If none of the stops that are tried keeps the limits,
    the one that exceeds them least.

    Shapes: rates (2, 3), most (3,).
    """
    if not rates.any():
        return np.zeros((0, 3))
    longest = 4 * (most[0] / most[1] + most[1] / most[2] + np.sqrt(most[0] / most[2])) / period
    some = np.unique(np.round(np.geomspace(1, max(longest, 2.0), _CHOICES)).astype(int))
    phases = np.array(list(product(some, [0, *some], some)))
    first, middle, last = phases.T[:, :, None]
    velocity, acceleration = rates
    jerks = (-velocity / period - acceleration * (first + middle + 0.5 * last - 0.5)) / (
        0.5 * period * first * (first + last + 2 * middle))
    ends = -(acceleration / period + first * jerks) / last
    between = acceleration + first * period * jerks
    excess = np.max([_sizes(jerks) / most[2], _sizes(ends) / most[2],
                     _sizes(between) / most[1]], axis=0)
    order = np.lexsort((phases.sum(axis=1), np.maximum(excess, 1.0)))[:_TRIED]
    found: list[tuple[float, Floats]] = []
    for k in order:
        changes = np.repeat([jerks[k], np.zeros(3), ends[k]], phases[k], axis=0)
        slopes = acceleration + period * np.cumsum(changes, axis=0)
        way = velocity + period * np.cumsum(slopes, axis=0)
        found.append((max(float(excess[k]), float(_sizes(way).max() / most[0]), 1.0), way))
        if found[-1][0] <= 1.0:
            break
    return min(found, key=lambda one: one[0])[1]


def _part(rates: Floats, limits: Limits) -> float:
    """Return the largest part of the limits that velocity, acceleration, jerk (3, 6) use."""
    return float(np.max([_sizes(rates[:, part]) / limits.sizes[:, k]
                         for k, part in enumerate(_PARTS)]))


def _sizes(rows: Floats) -> Floats:
    result: Floats = np.linalg.norm(rows, axis=-1)
    return result


Ways = Sequence[TimedPath | CorrectedTrajectory]  # of arms that go by one time


def used_by(ways: Ways, times: ArrayLike, limits: Limits, period: float) -> float:
    """Return the largest part of its limits that an arm uses at times (n,) s of its way, as `used`.

    Times are one for each period (s).
    """
    return max(used(way.frames(times), limits, period) for way in ways)


def decelerate(ways: Ways, done: float, limits: Limits, period: float,
               lead: int = 0, rising: Rising | None = None, lasting: float = 0.0) -> Floats:
    """Return the times along ways, s, one for each coming period, on which all come to rest."""
    def rate(since: Floats, steps: int) -> Floats:
        begun = _smooth((since + rising[0]) / rising[1]) if rising else 1.0
        return begun * (1 - _smooth((since - lead) / steps))

    return _shortest(ways, done, limits, period, rate, lead, lasting)


def accelerate(ways: Ways, done: float, limits: Limits, period: float) -> Floats:
    """Return the times along ways, s, one for each coming period, on which they begin to run."""
    return _shortest(ways, done, limits, period, lambda since, steps: _smooth(since / steps), 0)


def _shortest(ways: Ways, done: float, limits: Limits, period: float,
              rate: Callable[[Floats, int], Floats], lead: int, least: float = 0.0) -> Floats:
    """Return the times along ways in the shortest change of their rate that keeps the limits.

    It takes `least` s at least.
    """
    speeds = np.max([np.linalg.norm(way.at([done])[1].reshape(2, 3), axis=1) for way in ways],
                    axis=0)
    guess = float((_GUESSED * speeds / limits.sizes[1]).max())
    steps, found = max(_SHORTEST, int(np.ceil(max(guess, least) / period))), []
    while True:
        since = np.arange(-_SEEN, lead + steps + _SEEN)[:, None] + _NODES
        times = period * np.append(0.0, np.cumsum(rate(since, steps) @ _WEIGHTS))
        times += done - times[_SEEN]
        part = used_by(ways, times, limits, period)
        found.append((part, times[_SEEN + 1:_SEEN + 1 + lead + steps]))
        if part <= 1 or steps * period > max(_LONGEST, least):
            return min(found, key=lambda one: one[0])[1] if part > 1 else found[-1][1]
        steps = int(np.ceil(steps * np.clip(np.sqrt(part), _LEAST, _MOST)))


def _smooth(x: Floats) -> Floats:
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)
