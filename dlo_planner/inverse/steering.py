"""A motion that is corrected while it runs, without setting the DLO swinging.

A correction is blended in by the response of moving averages to a step: a vibration whose period is
the width of one of them is not excited, as in the time laws of `inverse.time_law`.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.correction import Correction
from dlo_planner.inverse.timed_path import TimedPath
from dlo_planner.model.checks import instance, items, number, row
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.value import Value, brief, put

_MODES = 4       # of which the two slowest that differ are not excited
_DIFFERENT = 1.2  # ratio of two periods
_MOST = 1e9      # s
_SHORT, _LONG = 0.02, 5.0  # s: no correction comes faster or slower than this
_GRID = 4096     # times at which it is looked where waypoints are reached


@dataclass(frozen=True, eq=False, repr=False)
class Change(Value):
    """A change of the poses that are left, blended in from a time on.

    Attributes:
        since: s
        times: (m,) s, at which the waypoints that are left are reached
        offsets: (m, 6) by which they change: rotation vector, rad, before displacement, m
    """

    since: float
    times: np.ndarray
    offsets: np.ndarray

    def __post_init__(self):
        put(self, since=number('Change.since', self.since),
            times=row('Change.times', self.times, most=_MOST),
            offsets=np.asarray(self.offsets, dtype=float).reshape(-1, 6))
        if self.times.size != len(self.offsets) or not self.times.size:
            raise InvalidTask(f'Change.offsets has {len(self.offsets)} rows: expected one for each '
                              f'of Change.times, {self.times.size}, and one at least')
        super().__post_init__()

    def at(self, times):
        """Return the whole change (n, 6) that is due at times (n,) s."""
        kept = np.append(True, np.diff(self.times) > 1e-9)  # a dwell reaches two at once
        if kept.sum() == 1:
            return np.repeat(self.offsets[:1], len(times), axis=0)
        known = self.times[kept]
        return CubicSpline(known, self.offsets[kept], bc_type='clamped')(
            np.clip(times, known[0], known[-1]))


@dataclass(frozen=True, eq=False, repr=False)
class Steered(Value):
    """A Trajectory whose rest is corrected as the estimate of the DLO gets better.

    Attributes:
        trajectory: Trajectory, or what is timed alike
        windows: (k,) s, widths of the moving averages that blend in
        changes: tuple of Change so far
        tool: Pose that is commanded, in the trajectory's frame of the gripper

    Raises:
        InvalidTask: naming the argument
    """

    trajectory: TimedPath
    windows: np.ndarray
    changes: tuple[Change, ...] = ()
    tool: Pose = Pose.identity()

    def __post_init__(self):
        instance('Steered.trajectory', self.trajectory, TimedPath)
        instance('Steered.tool', self.tool, Pose)
        put(self, windows=row('Steered.windows', self.windows, minimum=_SHORT, maximum=_LONG),
            changes=items('Steered.changes', self.changes, Change))
        if not self.windows.size:
            raise InvalidTask('Steered.windows: expected a width at least, s')
        super().__post_init__()

    def __repr__(self):
        return brief(self, f'{self.duration:.4g} s', f'{len(self.changes)} changes')

    @classmethod
    def of(cls, trajectory: TimedPath, shape: Shape, tool: Pose | None = None) -> 'Steered':
        """Return a Steered that does not excite a DLO that hangs as in a Shape.

        The windows are the periods of its two slowest vibrations that differ: the slowest in two
        planes are one.

        Raises:
            InvalidTask: naming the argument
        """
        periods = 1 / instance('shape', shape, Shape).modes(_MODES).frequencies
        others = periods[periods * _DIFFERENT < periods[0]]
        windows = np.clip(np.append(periods[0], others[:1]), _SHORT, _LONG)
        return cls(trajectory, windows, tool=Pose.identity() if tool is None else tool)

    @property
    def duration(self) -> float:
        """Time from rest to rest, s, the last correction blended in."""
        last = max((one.since for one in self.changes), default=-np.inf)
        return max(self.trajectory.duration, float(last + self.windows.sum()))

    def at(self, times: ArrayLike) -> list[Pose]:
        """Return the Poses to command at `times` (n,) s.

        Raises:
            InvalidTask: a time is no finite number
        """
        times = row('times', times, most=_MOST)
        poses, offsets = self.trajectory.at(times)[0], np.zeros((times.size, 6))
        for change in self.changes:
            offsets += step_response(times - change.since, self.windows)[:, None] * change.at(times)
        return [displaced(pose.compose(self.tool), offset)
                for pose, offset in zip(poses, offsets, strict=True)]

    def reached(self, plan_times: ArrayLike) -> np.ndarray:
        """Return the times (n,) in s at which waypoints of the trajectory's plan are reached.

        Args:
            plan_times: (n,) s, of `Plan.times`, ascending

        Raises:
            InvalidTask: a time is no finite number
        """
        plan_times = row('plan_times', plan_times, most=_MOST)
        times = np.linspace(0, self.trajectory.duration, _GRID)
        done = np.maximum.accumulate(self.trajectory.progress(times))
        return np.interp(plan_times, done, times)

    def corrected(self, time: float, correction: Correction, reached: ArrayLike) -> 'Steered':
        """Return the motion whose poses become those of a Correction from `time` on.

        Args:
            time: s, of the motion
            correction: Correction of the plan that the trajectory was made of, in poses that are
                commanded
            reached: (m,) s, when each of the correction's waypoints is reached, see `reached`

        One that did not converge changes nothing.

        Raises:
            InvalidTask: an argument makes no sense
        """
        time = number('time', time)
        instance('correction', correction, Correction)
        reached = row('reached', reached, most=_MOST)
        if reached.size != len(correction.grippers):
            raise InvalidTask(f'reached has {reached.size} entries: expected one for each waypoint '
                              f'of the correction, {len(correction.grippers)}')
        if not correction.converged:
            return self
        before = sum((change.at(reached) for change in self.changes), np.zeros((reached.size, 6)))
        change = Change(time, reached, correction.offsets - before)
        return replace(self, changes=(*self.changes, change))


def step_response(times: np.ndarray, windows: np.ndarray) -> np.ndarray:
    """Return the average (n,) of a unit step at 0 over moving windows, one after the other.

    The transform of a window of width w is (1 - exp(-s w)) / (s w); that of a step is 1 / s.

    Args:
        times: (n,) s; windows: (k,) s
    """
    k, out = len(windows), np.zeros(np.shape(times))
    times = np.minimum(times, np.sum(windows))  # 1 from there on
    for count in range(k + 1):
        for some in combinations(windows, count):
            out += (-1) ** count * np.maximum(times - sum(some), 0.0) ** k
    return np.clip(out / (factorial(k) * np.prod(windows)), 0.0, 1.0)
