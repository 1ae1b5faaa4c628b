# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion that is corrected while it runs, without setting the DLO swinging.

A correction is multiplied by the response of moving averages to a step. As with the time laws of
`trajectory.time_law`, a vibration whose period is the width of one of the averages is not excited.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.correction import Correction
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.checks import array, instance, items, number, row, shown
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.timed_path import TimedPath

_MODES = 4       # slowest vibrations that are looked at: two in each plane of a round DLO
_DIFFERENT = 1.2  # ratio above which two periods count as different
_EVEN = 0.1      # s, width of the third window, which bounds the jerk
_LEAST = 3       # windows: with fewer the jerk is not bounded
NARROWEST, WIDEST = 0.02, 5.0  # s, of windows
_GRID = 4096     # times between which a waypoint's time is interpolated
_MOST_TIMES = 100_000  # times in one call, as `TimedPath.at` takes
_AT_ONCE = 1e-9  # s: waypoints reached so shortly one after the other are one (a dwell)


@dataclass(frozen=True, eq=False, repr=False)
class Change(Value):
    """Change (m, 6) of the poses at times (m,), s, blended in from `since`, s, on.

    Rotation vectors, rad, then displacements, m, in world axes; no time before the last waypoint's.
    """

    since: float
    times: Floats
    offsets: Floats

    def __post_init__(self) -> None:
        put(self, since=number('Change.since', self.since),
            times=row('Change.times', self.times, most=_MOST_TIMES))
        put(self, offsets=array('Change.offsets', self.offsets, (self.times.size, 6)))
        if (np.diff(self.times) < 0).any():
            raise InvalidTask(f'Change.times = {shown(self.times.tolist())}: expected times in '
                              'ascending order')
        super().__post_init__()

    def at(self, times: Floats, order: int = 0) -> Floats:
        """Return the unblended change (n, 6) at times (n,), s, or a derivative by time."""
        if self._spline is None:
            return np.repeat(self.offsets[:1] * (order == 0), len(times), axis=0)
        known = self._spline.x
        inside = np.clip(times, known[0], known[-1])
        out = self._spline(inside, order)
        if order:
            out[times != inside] = 0.0
        result: Floats = out
        return result

    @cached_property
    def _spline(self) -> CubicSpline | None:
        """CubicSpline of the offsets; None where all waypoints are reached at once."""
        kept = apart_in_time(self.times)  # a dwell reaches two at once
        if kept.sum() == 1:
            return None
        return CubicSpline(self.times[kept], self.offsets[kept], bc_type='clamped')


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedTrajectory(Value):
    """A Trajectory whose remaining part is corrected while it runs.

    Corrections are added to the motion without a limit of their own: the sum may exceed the
    `limits` of the trajectory.

    Attributes
    ----------
    trajectory : TimedPath
        Trajectory, or another TimedPath.
    windows : ndarray, shape (k,)
        Widths of the moving averages that blend corrections in, s, k >= 3, each 0.02 to 5 s.
    changes : tuple of Change
        Changes so far.
    tool : Pose
        Pose of the commanded frame in the trajectory's frame of the gripper, as the inverse of
        `Estimate.gripper_offset`.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    trajectory: TimedPath
    windows: Floats
    changes: tuple[Change, ...] = ()
    tool: Pose = Pose.identity()

    def __post_init__(self) -> None:
        instance('CorrectedTrajectory.trajectory', self.trajectory, TimedPath)
        instance('CorrectedTrajectory.tool', self.tool, Pose)
        put(self, windows=row('CorrectedTrajectory.windows', self.windows, minimum=NARROWEST,
                              maximum=WIDEST),
            changes=items('CorrectedTrajectory.changes', self.changes, Change))
        if self.windows.size < _LEAST:
            raise InvalidTask(f'CorrectedTrajectory.windows has {self.windows.size} entries: '
                              f'expected {_LEAST} at least, or the jerk is not bounded')
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f'{self.duration:.4g} s', f'{len(self.changes)} changes')

    @classmethod
    def of(cls, trajectory: TimedPath, shape: Shape,
           tool: Pose | None = None) -> CorrectedTrajectory:
        """Return a CorrectedTrajectory whose windows are periods of the DLO in a Shape, and 0.1 s.

        The periods are the slowest one and the next that is shorter by more than a factor of 1.2
        (the slowest vibrations in two planes often differ by less).

        Parameters
        ----------
        trajectory : TimedPath
            Trajectory, or another TimedPath.
        shape : Shape
            Shape, at rest, where the DLO must not swing: as a rule at the end.
        tool : Pose, optional
            Tool frame as of the class. If None, the frame of the trajectory.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it, its value and what would be right.
        """
        parts = instance('shape', shape, Shape).parts or (shape,)  # of one that is held inside
        periods = np.sort(1 / np.concatenate([part.modes(_MODES).frequencies
                                              for part in parts]))[::-1]
        others = periods[periods * _DIFFERENT < periods[0]]
        windows = np.concatenate([periods[:1], others[:1] if others.size else periods[:1], [_EVEN]])
        return cls(trajectory, np.clip(windows, NARROWEST, WIDEST),
                   tool=Pose.identity() if tool is None else tool)

    @property
    def duration(self) -> float:
        """Time until the gripper is at rest and the last correction is blended in, s."""
        last = max((one.since for one in self.changes), default=-np.inf)
        return max(self.trajectory.duration, float(last + self.windows.sum()))

    @property
    def limits(self) -> Limits:
        """Limits of the trajectory alone, without corrections."""
        return self.trajectory.limits

    def at(self, times: ArrayLike) -> tuple[list[Pose], Floats, Floats]:
        """Return Poses to command, velocities (n, 6) and accelerations (n, 6) at `times` (n,) s.

        Axes and units are those of `Trajectory.at`. Angular velocities and accelerations have a
        relative error of second order in the angle of the corrections.

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        times = row('times', times, most=_MOST_TIMES)
        poses, speeds, accelerations = self.trajectory.at(times)
        arms, spin = np.array([pose.rotation @ self.tool.position for pose in poses]), speeds[:, 3:]
        speeds[:, :3] += np.cross(spin, arms)
        accelerations[:, :3] += np.cross(accelerations[:, 3:], arms) + np.cross(
            spin, np.cross(spin, arms))
        poses = [pose.compose(self.tool) for pose in poses]
        if not self.changes:
            return poses, speeds, accelerations
        offsets = self._offsets(times)
        poses = list(map(displaced, poses, offsets[0]))
        turned, shifted = np.split(offsets, 2, axis=2)
        turns = Rotation.from_rotvec(turned[0])
        spin = turned[1] + 0.5 * np.cross(turned[0], turned[1])
        carried = turns.apply(speeds[:, 3:])
        accelerations[:, 3:] = (turned[2] + 0.5 * np.cross(turned[0], turned[2])
                                + np.cross(spin, carried) + turns.apply(accelerations[:, 3:]))
        speeds[:, 3:] = spin + carried
        speeds[:, :3] += shifted[1]
        accelerations[:, :3] += shifted[2]
        return poses, speeds, accelerations

    def poses(self, times: ArrayLike) -> list[Pose]:
        """Return the Poses of `at` alone, in less time.

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        return [Pose.from_rotation(*frame) for frame in zip(*self.frames(times), strict=True)]

    def frames(self, times: ArrayLike) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and rotations (n, 3, 3) of `poses`: many cost little more."""
        times = row('times', times, most=_MOST_TIMES)
        positions, rotations = self.trajectory.frames(times)
        positions = positions + rotations @ self.tool.position
        rotations = rotations @ self.tool.rotation
        if not self.changes:
            return positions, rotations
        turned, shifted = np.split(self._offsets(times, 1)[0], 2, axis=1)
        return positions + shifted, Rotation.from_rotvec(turned).as_matrix() @ rotations

    def progress(self, times: ArrayLike) -> Floats:
        """Return the plan's times (n,) that the trajectory has reached at `times` (n,), s."""
        return self.trajectory.progress(times)

    def _offsets(self, times: Floats, orders: int = 3) -> Floats:
        """Return the sum of all changes and its first derivatives, (orders, n, 6)."""
        since = np.array([change.since for change in self.changes])
        step = [step_response(times[:, None] - since, self.windows, order)
                for order in range(orders)]
        inside = np.clip(times, self._whole.x[0], self._whole.x[-1])
        whole = [self._whole(inside, order) for order in range(orders)]
        for part in whole[1:]:
            part[times != inside] = 0.0
        terms = [[(1, 0, 0)], [(1, 1, 0), (1, 0, 1)], [(1, 2, 0), (2, 1, 1), (1, 0, 2)]]
        return np.array([sum(factor * np.einsum('nk,nkj->nj', step[i], whole[j])
                             for factor, i, j in row_) for row_ in terms[:orders]])

    @cached_property
    def _whole(self) -> CubicHermiteSpline:
        """All changes at once, a function of (n,) s -> (n, k, 6): it is asked in each period.

        Each is cubic between its times, so its values and slopes at the times of all tell it.
        """
        knots = np.unique(np.concatenate([change.times for change in self.changes]))
        knots = knots[apart_in_time(knots)]
        if knots.size == 1:
            knots = knots + np.array([0.0, 1.0])
        values, slopes = (np.stack([change.at(knots, order) for change in self.changes], axis=1)
                          for order in range(2))
        return CubicHermiteSpline(knots, values, slopes)

    def reached(self, plan_times: ArrayLike) -> Floats:
        """Return the times (n,) in s at which the trajectory reaches waypoints of its plan.

        Parameters
        ----------
        plan_times : array_like, shape (n,)
            Plan times in s, from `Plan.times`, ascending.

        Raises
        ------
        InvalidTask
            A time is not a finite number.
        """
        plan_times = row('plan_times', plan_times, most=_MOST_TIMES)
        times = np.linspace(0, self.trajectory.duration, _GRID)
        done = np.maximum.accumulate(self.trajectory.progress(times))
        return np.interp(plan_times, done, times)

    def corrected(self, time: float, correction: Correction,
                  reached: ArrayLike) -> CorrectedTrajectory:
        """Return the motion that changes to the poses of a Correction from `time` on.

        A correction that did not converge changes nothing.

        Parameters
        ----------
        time : float
            Time of the motion, s.
        correction : Correction
            Correction, in commanded poses, of the trajectory's plan.
        reached : array_like, shape (m,)
            Ascending times at which the correction's waypoints are reached, s, from `reached`.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        time = number('time', time)
        instance('correction', correction, Correction)
        reached = row('reached', reached, most=_MOST_TIMES)
        if reached.size != len(correction.grippers):
            raise InvalidTask(f'reached has {reached.size} entries: expected one for each waypoint '
                              f'of the correction, {len(correction.grippers)}')
        if not correction.converged:
            return self
        before = sum((change.at(reached) for change in self.changes), np.zeros((reached.size, 6)))
        change = Change(time, reached, correction.offsets - before)
        return replace(self, changes=(*self.changes, change))


def step_response(times: Floats, windows: Floats, order: int = 0) -> Floats:
    """Return (n,) a unit step, averaged over moving windows (k,), at times (n,), or a derivative.

    In closed form: a step's Laplace transform, 1 / s, by (1 - exp(-s w)) / (s w) for each window.
    """
    power, out = len(windows) - order, np.zeros(np.shape(times))
    times = np.minimum(times, np.sum(windows))  # at rest from there on
    for count in range(len(windows) + 1):
        for some in combinations(windows, count):
            since = times - sum(some)
            out += (-1) ** count * np.maximum(since, 0.0) ** power
    out /= factorial(power) * np.prod(windows)
    return out if order else np.clip(out, 0.0, 1.0)


def apart_in_time(times: Floats) -> Bools:
    """Return (n,) which of ascending times are not reached together with the one before."""
    return np.append(True, np.diff(times) > _AT_ONCE)
