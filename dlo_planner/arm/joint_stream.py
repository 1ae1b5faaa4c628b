# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion that is told piece by piece, for the joints of an arm.

What comes out is for the topic of a joint_trajectory_controller. Of its rules, which the tests have
as a stand-in, these count here:

* A message replaces what the controller had as soon as it is heard. Where its first point is still
  to come, the controller goes there from where the joints are; where the present is between two
  points, it goes on between them. So a message begins shortly before now, with points that were
  told before: whenever it is heard, it changes nothing but what is still to come.
* After the last point the joints rest; a message that does not end at rest, or that has ended, is
  refused.
* Positions, velocities and accelerations are interpolated by polynomials of degree 5.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dlo_planner.arm.inverse_kinematics import (
    IKFailure,
    IKSolution,
    check_limits,
    check_reach,
    check_self_collision,
    solve,
)
from dlo_planner.arm.robot import Arm
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.requirements import Limits

_BEFORE = 0.2       # s before now that a message repeats: clocks may differ by so much
_AFTER = 0.2        # s after now that it goes on at least: one that has ended is refused
_ITERATIONS = 30    # of inverse kinematics, from the joints a period before
_JUMP = 0.5         # rad or m that a joint may go in one period
_SAME = 1e-9, 1e-8  # m, rad: poses that are told again, rounded otherwise
_OFF_BEAT = 0.1     # of a period, from which on stamps belong to another beat
_ROUNDED = 1 + 1e-6  # of a joint's speed: differences of what inverse kinematics rounds
_LEFT = 1e-3, 5e-3  # m, rad from the robot to the beginning of a motion, see `Execution`
_PART = 0.5         # of the limits of the gripper, which the way there may use
# Largest speed, acceleration and jerk of the polynomial of degree 5 from rest to rest, as multiples
# of way / time, way / time^2, way / time^3.
_QUINTIC = np.array([15 / 8, 10 / np.sqrt(3), 60.0])
# Differences of the fourth order, by the points two and one before and after.
_SLOPE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
_BEND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12
_SIDE = 2           # points on each side that these need


class JointPoints(NamedTuple):
    """What a joint_trajectory_controller is told, m joints at n times."""

    stamp: float          # s on the clock of the stamps, from which `times` count
    times: Floats         # (n,) s, ascending, a period apart
    positions: Floats     # (n, m) rad or m
    velocities: Floats    # (n, m) rad/s or m/s, the last ones 0
    accelerations: Floats  # (n, m) rad/s^2 or m/s^2, the last ones 0


def settling_time(limits: Limits) -> float:
    """Return in how many s an arm goes to the beginning of a motion that it stands at, nearly.

    It may be 1 mm and 5 mrad off; on the way there a controller's polynomial uses half of the
    limits of the gripper.
    """
    with np.errstate(divide='ignore'):
        needed = _QUINTIC[:, None] * np.array(_LEFT) / (_PART * limits.sizes)
    return float((needed ** (1 / np.arange(1, 4)[:, None])).max())


def followed(arm: Arm, poses: Sequence[Pose], begin: Floats, period: float) -> Floats:
    """Return joint positions (n, m) that lead the tool link through n Poses, a period (s) apart.

    From joint positions `begin` (m,) at or near the first one; the arm stays in that configuration.

    Raises
    ------
    IKFailure
        The tool cannot get there, a joint would leave its limits or be too fast, or links come
        together; with the time, s after the first pose.
    """
    chain, root, out = arm.chain, arm.base, [begin]
    for k, pose in enumerate(poses):
        before, time = out[-1], k * period
        target = (root.rotation.T @ (pose.position - root.position),
                  root.rotation.T @ pose.rotation)
        found = solve(chain, before, target, _ITERATIONS)
        if not found.reached:  # joints that are heavy near their limits may have hindered it
            found = solve(chain, before, target, _ITERATIONS, plain=True)
        _check(arm, found, before, time)
        if k:  # before that it stands
            _check_speeds(arm, (found.positions - before) / period, time)
        out.append(found.positions)
    return np.array(out[1:]).reshape(len(poses), len(begin))


def _check(arm: Arm, found: IKSolution, before: Floats, time: float) -> None:
    check_reach(found, time)
    moved = np.abs(found.positions - before)
    if moved.max() > _JUMP:
        joint = int(np.argmax(moved))
        raise IKFailure(f'{arm.joints[joint]} would have to go from {before[joint]:.4g} to '
                        f'{found.positions[joint]:.4g} at once', time, 'continuity',
                        float(moved.max() - _JUMP), arm.units[joint])
    check_limits(arm, found.positions, time)
    check_self_collision(arm, found.positions, time)


def _check_speeds(arm: Arm, speeds: Floats, time: float) -> None:
    used = np.abs(speeds) / arm.speeds
    joint = int(np.argmax(used))
    if used[joint] > _ROUNDED:
        unit, most = f'{arm.units[joint]}/s', arm.speeds[joint]
        raise IKFailure(f'{arm.joints[joint]} would move at {abs(speeds[joint]):.4g} {unit}: '
                        f'expected at most {most:.4g}', time, 'joint_speed',
                        float(abs(speeds[joint]) - most), unit)


class JointStream:
    """Turns poses that are sent ahead into what the joints are sent.

    It is used by one thread, and remembers what was told last.

    Parameters
    ----------
    arm : Arm
        The arm that carries the tool link; poses are of that link, in the world.
    begin : ndarray, shape (m,)
        Where its joints are, rad or m.
    period : float
        Between two poses, s.
    settling : float
        Time until the joints are at the first pose, s, see `settling_time`: the controller leads
        them there from where it holds them.
    """

    def __init__(self, arm: Arm, begin: Floats, period: float, settling: float) -> None:
        self.arm, self._period, self._settling = arm, period, settling
        self._begin = begin
        self._settled = -np.inf  # stamp at which the joints are at the first pose
        self._anchor = 0.0       # stamp of the point 0 of what was told
        self._first = 0          # number of the first point of what was told last
        self._told: list[tuple[Pose, Floats]] = []  # its poses and joints, from that one on
        self._reaches = -np.inf  # stamp until which the motion itself is told, and not its end

    @property
    def joints(self) -> Floats:
        """(m,) joint positions that the arm is led to last, rad or m."""
        return self._told[-1][1] if self._told else self._begin

    def resting(self, stamp: float) -> JointPoints:
        """Return what lets the arm rest where it is, from a stamp, s: its first message."""
        self._settled = stamp + self._settling
        self._anchor, self._first = stamp, 0
        self._told = [(self.arm.pose(self._begin), self._begin)]
        still = np.zeros((1, len(self._begin)))
        return JointPoints(stamp, np.array([self._settling]), self._begin[None], still, still)

    def held(self, stamp: float, pose: Pose) -> JointPoints:
        """Return what ends a motion at a Pose at once, as far as the controller can, at a stamp, s.

        Raises
        ------
        IKFailure
            As of `followed`.
        """
        joints = followed(self.arm, [pose], self._nearest(pose)[1], self._period)
        self._anchor, self._first, self._told = stamp, 0, [(pose, joints[0])]
        still = np.zeros_like(joints)
        return JointPoints(stamp, np.array([_AFTER]), joints, still, still)

    def ahead(self, stamp: float, poses: Sequence[Pose], until: float,
              stops: bool) -> JointPoints | None:
        """Return what the joints are told now; None: what they were told is enough for now.

        Parameters
        ----------
        stamp : float
            When the first pose is due, s on the clock of the stamps.
        poses : sequence of Pose
            Of the tool link, a period apart, to rest.
        until : float
            How long after the stamp that is the motion itself, s; then it is a way to rest.
        stops : bool
            Whether it comes to rest now.

        Raises
        ------
        IKFailure
            As of `followed`; what was told before holds, and ends at rest.
        """
        if not self._told:
            self._settled = stamp + self._settling
        settling = stamp < self._settled
        if settling and not stops and self._reaches > self._settled + 0.5 * until:
            return None  # it is on its way to the first pose, from where it will hear of the rest
        number = round((stamp - self._anchor) / self._period)
        off_beat = abs(stamp - self._anchor - number * self._period) > _OFF_BEAT * self._period
        if not self._told or off_beat or number < self._first:
            number = self._begun(stamp, poses[0])
        rows = self._rows(number, poses)
        lead = min(round(_BEFORE / self._period), number - self._first)
        sides = min(_SIDE, number - self._first - lead)
        known = [self._row(number - k) for k in range(lead + sides, 0, -1)]
        least = int(np.ceil(_AFTER / self._period)) + 1 - len(rows)
        whole = [*known, *rows, *rows[-1:] * least]
        self._first, self._told = number - len(known), whole
        self._reaches = max(self._reaches, stamp + until)
        points = self._points(np.array([joints for _, joints in whole]), sides)
        times: Floats = self._period * np.arange(len(points[0]), dtype=float)
        begin = stamp - lead * self._period
        kept = begin + times >= self._settled - 0.5 * self._period if settling else times >= 0
        if not kept.any():
            kept[-1], times[-1] = True, self._settled - begin
        return JointPoints(begin, times[kept], *(part[kept] for part in points))

    def _begun(self, stamp: float, pose: Pose) -> int:
        """Begin to count anew, for a motion that begins at a Pose at a stamp; return its number.

        A robot that rests at the beginning has rested there before; if time was turned back, what
        was told before belongs to another time.
        """
        near = self._nearest(pose)
        rests = not self._told or _same(near[0], self._told[-1][0])
        self._anchor, self._first = stamp, -(round(_BEFORE / self._period) + _SIDE) if rests else 0
        self._told = [near] * (1 - self._first)
        return 0

    def _nearest(self, pose: Pose) -> tuple[Pose, Floats]:
        """Return pose and joints of the last of what was told that is nearest to a Pose, m + rad.

        The beginning where nothing was told.
        """
        return min(reversed(self._told), default=(pose, self._begin), key=lambda one: float(
            np.linalg.norm(one[0].position - pose.position)
            + angle_between(one[0].rotation, pose.rotation)))

    def _row(self, number: int) -> tuple[Pose, Floats]:
        """Return pose and joints of a point of what was told last, which ended at rest."""
        return self._told[min(number - self._first, len(self._told) - 1)]

    def _rows(self, number: int, poses: Sequence[Pose]) -> list[tuple[Pose, Floats]]:
        """Return the Poses with their joints, from a number on; what was told before stays so."""
        known = 0
        while (known < len(poses) and 0 <= number + known - self._first < len(self._told)
               and _same(poses[known], self._told[number + known - self._first][0])):
            known += 1
        rows = [self._row(number + k) for k in range(known)]
        begin = rows[-1][1] if rows else self._row(max(number - 1, self._first))[1]
        new = followed(self.arm, [*(pose for pose, _ in rows[-1:]), *poses[known:]], begin,
                       self._period)[len(rows[-1:]):]
        return [*rows, *zip(poses[known:], new, strict=True)]

    def _points(self, joints: Floats, before: int) -> tuple[Floats, Floats, Floats]:
        """Return positions, velocities and accelerations (n - before, m) of joints (n, m).

        What stands `before` is for the differences alone. At the first point and at the last one
        the joints rest where nothing was told before, and nothing comes after.
        """
        count = len(joints)
        padded = np.concatenate([np.repeat(joints[:1], _SIDE, axis=0), joints,
                                 np.repeat(joints[-1:], _SIDE, axis=0)])
        parts = [padded[k:k + count] for k in range(2 * _SIDE + 1)]
        slopes, bends = (sum(weight * part for weight, part in zip(weights, parts, strict=True))
                         / self._period**order for order, weights in ((1, _SLOPE), (2, _BEND)))
        slopes[-1], bends[-1] = 0.0, 0.0
        return joints[before:], slopes[before:], bends[before:]


def _same(one: Pose, other: Pose) -> bool:
    return bool(np.abs(one.position - other.position).max() <= _SAME[0]
                and angle_between(one.rotation, other.rotation) <= _SAME[1])
