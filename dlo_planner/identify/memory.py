# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The looks that an estimate remembers: those from the last poses, and older ones linearized."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.identify.looking import Own
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import Value

_POSES = 4        # of the gripper, whose looks are remembered
_LOOKS = 8        # remembered at each of them
_SAME = 0.02      # of the noise: poses that move the DLO by less are one
_LEAST_LINK = 1e-3  # of the robot's time or way: links between errors stay regular
_ROUGH = 2.5      # times the way of a smooth process: then both change alike in that way
_LEVER = 0.25     # m, of a turn: about that of a wrist, whose joints cause the error
_CONSTANT = 0.25    # of the robot's time: its error hardly changes meanwhile
_FORGETTING = 0.9   # of what earlier looks say of the consistency, from look to look
_PRIOR_DOF = 12.0   # degrees of freedom by which it is believed to be good before any look


@dataclass(frozen=True, eq=False)
class RobotError(Value):
    """The robot's error that is not constant: true pose less constant offset less measured pose.

    That of a robot repeats itself: it is a smooth function of the pose. It may change with time as
    well. A Gaussian process in each of the p components whose deviation is not 0.

    Attributes
    ----------
    deviations : ndarray, shape (6,)
        Standard deviations of the rotation vector, rad, and of the position, m.
    way : float
        Way of the gripper in which its correlation falls to exp(-1/2), m; see `way_between`.
    time : float
        Time in which it falls to 1 / e, s; infinite: the error repeats itself.
    """

    deviations: Floats
    way: float = np.inf
    time: float = np.inf

    @property
    def acting(self) -> Floats:
        """Indices (p,) of the components that are not 0."""
        return cast(Floats, np.flatnonzero(self.deviations))

    def twist(self, e: Floats) -> Floats:
        """Return the error (6,) in rad, m of p numbers e in standard deviations."""
        out = np.zeros(6)
        out[self.acting] = e * self.deviations[self.acting]
        return out

    @property
    def repeats(self) -> bool:
        """Whether what was seen of it is still true later, near the same pose."""
        return bool(np.isinf(self.time))

    def link(self, elapsed: float, moved: float) -> float:
        """Return the correlation of the errors at two looks, `elapsed` s and `moved` m apart.

        Below 1, and that of an Ornstein-Uhlenbeck process, which a filter can follow from look to
        look. It changes more in a short way than the smooth one.
        """
        return float(np.exp(-max(elapsed / self.time + moved / (_ROUGH * self.way), _LEAST_LINK)))

    def change(self, moved: float) -> float:
        """Return the variance of the change in a way in m, over the square of the deviations."""
        return float(-2 * np.expm1(-0.5 * (moved / self.way) ** 2))


def way_between(one: Pose, other: Pose) -> float:
    """Return the way from one Pose to another, m: of the origin, and of a turn by a lever."""
    return float(np.linalg.norm(other.position - one.position)
                 + _LEVER * angle_between(one.rotation, other.rotation))


@dataclass(frozen=True, eq=False)
class Group:
    """Looks at one pose of the gripper, oldest first.

    Attributes
    ----------
    gripper : Pose
        Pose as measured.
    looks : tuple of (ndarray, ndarray or None)
        Of each look: (points (m, 3), arc lengths from the gripper (m,) or None).
    shape : Shape
        Shape from which the next search begins.
    noise : float
        Noise in m, see `Observer`, of these looks.
    own : Own
        What is each look's own.
    bent : ndarray, shape (k, 3) or None
        By how much the DLO was off its rest then, see `Observer.update`.
    link : float
        Correlation of the robot's error with that of the group before.
    lasts : float
        Time from its first look to its last, s.
    """

    gripper: Pose
    looks: tuple[tuple[Floats, Floats | None], ...]
    shape: Shape
    noise: float
    own: Own
    bent: Floats | None = None
    link: float = 0.0
    lasts: float = 0.0

    def takes(self, other: Group) -> bool:
        """Return whether looks of another Group can be added to this one."""
        if self.bent is not None or other.bent is not None:
            return False
        near = _SAME * self.noise
        return (self.noise, self.own) == (other.noise, other.own) and (
            float(np.linalg.norm(self.gripper.position - other.gripper.position)) <= near
            and self.shape.s[-1] * angle_between(self.gripper.rotation,
                                                 other.gripper.rotation) <= near)

    def stacked(self) -> Iterator[tuple[Floats, np.ndarray | None]]:
        """Yield points (m, 3) and arc lengths (m,) or None, look by look if they sway."""
        if self.own != Own():
            yield from self.looks
            return
        for known in (True, False):
            some = [look for look in self.looks if (look[1] is not None) == known]
            if some:
                points, s = zip(*some, strict=True)
                yield np.concatenate(points), np.concatenate(s) if known else None


@dataclass(frozen=True, eq=False)
class Consistency:
    """How well looks agree with what was expected before them: chi-squares, and their means.

    Attributes
    ----------
    innovations, expected : float
        Sum of the chi-squares by which looks moved the state, and of their degrees of freedom.
    residuals, points : float
        The same of the points' distances from the DLO after each look.
    """

    innovations: float = 0.0
    expected: float = 0.0
    residuals: float = 0.0
    points: float = 0.0

    def after(self, innovation: float, expected: float, residual: float,
              points: float) -> Consistency:
        """Return the Consistency after one more look; what is older counts less and less."""
        return Consistency(*(_FORGETTING * old + new for old, new in zip(
            (self.innovations, self.expected, self.residuals, self.points),
            (innovation, expected, residual, points), strict=True)))

    @property
    def inflation(self) -> float:
        """By what the covariance has to be multiplied, at least 1 (after Birge 1932)."""
        return max(1.0, _ratio(self.innovations, self.expected),
                   _ratio(self.residuals, self.points))


def _ratio(chi_square: float, degrees: float) -> float:
    """Return a chi-square by its mean and two deviations, which it hardly exceeds by chance."""
    degrees += _PRIOR_DOF
    return float((chi_square + _PRIOR_DOF) / (degrees + 2 * np.sqrt(2 * degrees)))


@dataclass(frozen=True, eq=False)
class Memory:
    """The information in an estimate: of the state x and of the robot's errors e.

    Both in their standard deviations; p numbers of e for each group, none where the robot is exact.

    Attributes
    ----------
    x : ndarray, shape (n + p,)
        Mean by the prior and by forgotten looks, of the state and of the error at the last of them.
    matrix : ndarray, shape (n + p, n + p)
        Their information matrix.
    groups : tuple of Group
        The looks that are remembered, oldest first.
    mean, covariance : ndarray, shapes (n + p,), (n + p, n + p)
        By all looks, of the state and of the robot's error at the last of them.
    consistency : Consistency
    """

    x: Floats
    matrix: Floats
    groups: tuple[Group, ...]
    mean: Floats
    covariance: Floats
    consistency: Consistency = Consistency()

    @classmethod
    def of(cls, mean: Floats, covariance: Floats, p: int) -> Memory:
        """Return the Memory without a look, of the state's mean (n,) and covariance (n, n)."""
        whole = np.eye(mean.size + p)
        whole[:mean.size, :mean.size] = covariance
        mean = np.append(mean, np.zeros(p))
        return cls(mean, cast(Floats, np.linalg.inv(whole)), (), mean, whole)

    def with_linear(self, rows: Floats, right: Floats) -> Memory:
        """Return the Memory with k measurements of unit variance: rows (k, n) @ x = right (k,)."""
        rows = np.hstack([rows, np.zeros((len(rows), self.x.size - rows.shape[1]))])
        matrix = self.matrix + rows.T @ rows
        gain = np.linalg.solve(rows @ self.covariance @ rows.T + np.eye(len(rows)),
                               rows @ self.covariance).T
        covariance = self.covariance - gain @ rows @ self.covariance
        return replace(self, matrix=matrix,
                       x=solved(matrix, self.matrix @ self.x + rows.T @ right),
                       mean=self.mean + gain @ (right - rows @ self.mean),
                       covariance=0.5 * (covariance + covariance.T))

    def with_look(self, new: Group, elapsed: float,
                  robot: RobotError) -> tuple[Memory, Group | None]:
        """Return the Memory with a Group of one new look, and the Group to be forgotten or None.

        Looks at the same pose, with the same noise and sway, are joined in one Group, as long as
        the robot's error is hardly another.
        """
        old = self.groups
        lasts = old[-1].lasts + elapsed if old else 0.0
        if old and lasts <= _CONSTANT * robot.time and old[-1].takes(new):
            last = replace(old[-1], looks=(*old[-1].looks, *new.looks), shape=new.shape,
                           lasts=lasts)
            if len(last.looks) <= _LOOKS:
                return replace(self, groups=(*old[:-1], last)), None
            half, lasts = _LOOKS // 2, 0.5 * lasts
            first = replace(last, looks=last.looks[:half], lasts=lasts)
            rest = replace(last, looks=last.looks[half:], link=robot.link(lasts, 0.0),
                           lasts=lasts)
            if len(old) > 1:  # older ones go first
                return replace(self, groups=(*old[1:-1], first, rest)), old[0]
            return replace(self, groups=(rest,)), first
        moved = way_between(old[-1].gripper, new.gripper) if old else 0.0
        groups = (*old, replace(new, link=robot.link(lasts if old else elapsed, moved)))
        if len(groups) <= _POSES:
            return replace(self, groups=groups), None
        return replace(self, groups=groups[1:]), groups[0]


def solved(matrix: Floats, right: Floats) -> Floats:
    """Return x (n,) with matrix (n, n) @ x = right (n,)."""
    return cast(Floats, np.linalg.solve(matrix, right))
