# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a motion that is being executed comes to rest: along its own path, within its limits."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.identify.steering import Steered
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.timed_path import TimedPath

_SAMPLES = 60     # of a deceleration that are looked at
_LONGER = 1.2     # from one duration that is tried to the next
# How much of the limits of acceleration and jerk may be used. The motion itself may be at both, and
# a stop must not take long for that.
_ALLOWED = (1.02, 1.5)
_LONGEST = 20.0   # s
_GUESSED = 1.5    # speeds over acceleration: hardly any deceleration is shorter


@dataclass(frozen=True)
class Deceleration:
    """Time along a path that runs slower and slower until it stands still.

    Its rate is 1 - 10 x^3 + 15 x^4 - 6 x^5, x the part of `length` that has passed: the motion's
    acceleration goes on without a jump at both ends.

    Attributes
    ----------
    start : float
        Start in s along the path where it begins.
    length : float
        Length in s that it takes; the path's time goes on by half of it.
    """

    start: float
    length: float

    def at(self, since: float | Floats) -> float | Floats:
        """Return s along the path, `since` s after the beginning; before it, time runs evenly."""
        x = np.clip(np.asarray(since) / self.length, 0, 1)
        return (self.start + np.minimum(since, 0.0)
                + self.length * (x - 2.5 * x**4 + 3 * x**5 - x**6))


def decelerate(way: TimedPath | Steered, start: float, shortest: float) -> Deceleration:
    """Return a short Deceleration of `way` within its limits of acceleration.

    It exceeds those of jerk by half at most.

    Parameters
    ----------
    way : TimedPath
    start : float
        Start in s along it.
    shortest : float
        Shortest in s that it takes at least.
    """
    speeds = np.linalg.norm(way.at([start])[1].reshape(2, 3), axis=1)
    length = max(shortest, *(_GUESSED * speeds / way.limits.sizes[1]))
    while _used(way, Deceleration(start, length)) > 1 and length < _LONGEST:
        length *= _LONGER
    return Deceleration(start, length)


def _used(way: TimedPath | Steered, deceleration: Deceleration) -> float:
    """Return the largest part that a Deceleration uses of what it may."""
    limits: Limits = way.limits
    length = deceleration.length
    x = np.linspace(0, 1, _SAMPLES)
    rate = (1 - 10 * x**3 + 15 * x**4 - 6 * x**5)[:, None]
    change = (-30 * x**2 * (1 - x)**2)[:, None] / length
    _, speeds, accelerations = way.at(deceleration.at(x * length))
    acceleration = accelerations * rate**2 + speeds * change
    jerk = np.diff(acceleration, axis=0) / (length / (_SAMPLES - 1))
    return max(float(np.linalg.norm(rows[:, part], axis=1).max() / (limit * allowed))
               for rows, row, allowed in zip((acceleration, jerk), limits.sizes[1:], _ALLOWED,
                                             strict=True)
               for part, limit in zip((slice(0, 3), slice(3, 6)), row, strict=True))
