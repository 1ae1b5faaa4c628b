# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The robot of the cell: it follows commands smoothly and a little late.

Commands with stamps are interpolated at exact times, as the controller of a robot does; a command
without is followed from when it comes. It follows one of the two: where a planner sends both, the
single ones may be behind, and one after the other it would leap.
"""

import math
from operator import mul

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

_LAG = 0.03     # s, of each of two stages by which the node's robot follows
_KEPT = 2.0     # s before the newest commands that are kept: the plant may be late
_FRESH = 0.5    # s after their first, in which commands with stamps are replaced by newer ones
_AT_REST = 0.1  # s after the last of them, from which on they are over


class Robot:
    """The gripper's way, by what is commanded: `pose` is where its encoders see it.

    `lag` is the time constant of each of the two stages by which it follows, s; 0: at once.
    """

    def __init__(self, pose: Pose, lag: float = _LAG) -> None:
        self.pose = self._behind = pose
        self._lag = lag
        self._wanted: Pose | None = None
        self._ahead = Timetable()

    def follow(self, pose: Pose) -> None:
        """Go to a Pose, if commands have no stamps: none with one has ever come."""
        if not self._ahead.poses:
            self._wanted = pose

    def follow_ahead(self, times: Floats, poses: list[Pose]) -> None:
        """Be at poses (list) at times (n,) in s, ascending, which replace what was to come then."""
        self._ahead.take(times, poses)

    def waits(self, time: float) -> bool:
        """Return whether at a time (s) the newest commands are old, and not yet all done.

        Who tells it the coming second does so five times a second.
        """
        return not self._ahead.over and time > self._ahead.since + _FRESH

    def moved(self, time: float, seconds: float) -> Pose:
        """Return the Pose at a time (s), so many seconds after the last."""
        ahead = self._ahead.at(time)
        self._wanted = self._wanted if ahead is None else ahead
        if self._wanted is not None and not self._lag:
            self.pose = self._behind = self._wanted
        elif self._wanted is not None:
            share = 1 - np.exp(-seconds / self._lag)
            self._behind = nearer(self._behind, self._wanted, share)
            self.pose = nearer(self.pose, self._behind, share)
        return self.pose


class Timetable:
    """Poses with stamps, of which newer ones replace what was to come from their first on."""

    def __init__(self) -> None:
        self._times: Floats = np.zeros(0)
        self.poses: list[Pose] = []
        self._asked = self.since = -np.inf  # s; since: the first of the newest commands

    @property
    def over(self) -> bool:
        """Whether the last time at which it was asked is after its end."""
        return not self.poses or self._asked >= self._times[-1] + _AT_REST

    def take(self, times: Floats, poses: list[Pose]) -> None:
        """Take in poses (list) at times (n,), ascending."""
        if not len(times):
            return
        since, kept = np.searchsorted(self._times, (times[0] - _KEPT, times[0]))
        self.since = float(times[0])
        self._times = np.append(self._times[since:kept], times)
        self.poses = [*self.poses[since:kept], *poses]

    def at(self, time: float) -> Pose | None:
        """Return the Pose at a time, evenly between two; None before the first, after the last."""
        self._asked = time
        after = int(np.searchsorted(self._times, time, side='right'))
        if not after or self.over:
            return None
        if after == len(self._times):
            return self.poses[-1]
        begin, end = self._times[after - 1:after + 1]
        return nearer(self.poses[after - 1], self.poses[after],
                      float((time - begin) / (end - begin)))


def nearer(one: Pose, other: Pose, share: float) -> Pose:
    """Return the Pose that is by a share of the way from one to another, evenly turned.

    Shoemake 1985, the shorter way around; numbers, as SciPy's `Slerp` takes ten times as long.
    """
    begin, end = one.quaternion.tolist(), other.quaternion.tolist()
    sign = -1.0 if sum(map(mul, begin, end)) < 0 else 1.0
    # by their difference and sum, as exact for small angles as for large ones
    half = math.atan2(math.dist(begin, [sign * x for x in end]),
                      math.dist(begin, [-sign * x for x in end]))
    whole = math.sin(2 * half)
    first, last = 1 - share, share
    if whole:
        first, last = math.sin(2 * half * first) / whole, math.sin(2 * half * last) / whole
    return Pose(one.position + share * (other.position - one.position),
                [first * x + sign * last * y for x, y in zip(begin, end, strict=True)])
