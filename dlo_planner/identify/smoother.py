# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The most likely state after the looks so far, and its covariance.

An iterated extended Kalman filter (Bell and Cathey 1993: each update is a Gauss-Newton search) in
information form. A filter that keeps each look linearized at the estimate of its time becomes too
sure of itself: the difference between two linearizations looks like information about what no look
shows, such as stiffness against weight. So the looks from the last few poses of the gripper are
remembered and searched together (a smoother with a fixed lag); older ones stay linearized. The
robot's wandering error is an unknown at each of these poses, linked to the one before.

Each look is judged before it is believed: by how far it moves the state, in units of what was
expected (the normalized innovation of a Kalman filter: Bar-Shalom, Li, Kirubarajan 2001, 5.4), by
how far the points stay off the DLO after it, and by how many of them are none of the DLO's. What
changes slowly, as a light touch does, is in no single look: so the last ones are judged together,
by how far they have moved the free end from where those before them expect it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtri

from dlo_planner.direct.accuracy import surely_within
from dlo_planner.direct.shape import Shape
from dlo_planner.identify.estimate import Estimate, RobotError, way_between
from dlo_planner.identify.noise_model import Mixture, mixture, mixture_cost
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.residuals import from_either_end, point_residuals
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.uncertainty.state import CALIBRATION, PointSlopes, slopes_by_gripper

_POSES = 4        # of the gripper, whose looks are remembered
_LOOKS = 8        # remembered at each of them
_SAME = 0.02      # of the noise: poses that move the DLO by less are one
_CONSTANT = 0.25    # of the robot's time: its error hardly changes meanwhile
_FORGETTING = 0.9   # of what earlier looks say of the consistency, from look to look
_PRIOR_DOF = 12.0   # degrees of freedom by which it is believed to be good before any look
_ITERATIONS = 30
_HALVINGS = 8
_SETTLED = 1e-3   # mean square of the last step, in standard deviations of the estimate
_STEADY = 1.05    # ratio of two successive scales of the residuals that count as equal
_FARTHEST = 0.15  # of the length: by which one step may move a node
_HARDLY = 2e-4    # of the length: derivatives of a DLO that moved by less are the same to as much
_ENOUGH = 1e-4    # part of the decrease predicted for a step that it has to give (Armijo)
_STILL = 1e-6     # of the noise: a smaller sway counts as none
_RARE = 1e-4      # part of the looks that exceed a limit of consistency by chance
_EVEN = 33        # places along a DLO, between which it follows its gripper evenly
_PAST = 32        # looks that are judged together, at most
_SEEN = 0.02      # part of a variance by which a look has to lower it to tell of that direction
# chi-squares of two degrees: by chance the largest of `_PAST` partial sums exceeds the first in one
# look in 10,000, the second in one in 100 (counted in a million random walks)
_DRIFTS = 23.9, 13.9
WORST_CAMERA = 12.0  # times as far off as stated: 12 mm and 6 mrad by the defaults, or it is broken
_TURNS = 50         # of expectation and maximization
_SCALED = 0.05      # change of the scale that makes no difference
_MODEL = 1.5      # ratio of variances that the model's own errors may add to the residuals
_MORE_OUTLIERS = 0.1  # part of the points by which more may be none of the DLO's than are stated


class LookErrors(NamedTuple):
    """What moves all points of a look together, another one in each, in standard deviations."""

    sway: float = 0.0  # of the free end about its rest along each world axis, m
    # rotation vector, rad, and way, m, of the gripper in the time by which the stamp may be wrong,
    # world axes: the DLO follows it
    late: tuple[float, ...] = (0.0,) * 6
    # of the gripper, rad/s and m/s, world axes: by a delay of all stamps the DLO is behind
    velocity: tuple[float, ...] = (0.0,) * 6

    @property
    def moves(self) -> bool:
        """Whether the gripper moves."""
        return any(self.late) or any(self.velocity)


@dataclass(frozen=True, eq=False)
class Off:
    """By how much a DLO is off its equilibrium at the stamp, at k even arc lengths, world axes."""

    bent: Floats | None = None     # (k, 3) m, in motion, see `Observer.update`; None: it is not
    # (k, 3) m, how far it goes in the time by which the stamp may be wrong; None: it is at rest
    late: Floats | None = None
    velocity: Floats | None = None  # (k, 3) m/s, of its points; None: it is at rest

    @classmethod
    def of(cls, shape: Shape, errors: LookErrors, bent: Floats | None) -> Off:
        """Return that of a DLO in a Shape, which follows its gripper."""
        if not errors.moves:
            return cls(bent)
        s = np.linspace(0.0, shape.s[-1], _EVEN if bent is None else len(bent))
        by_gripper = slopes_by_gripper(shape)(s)
        return cls(bent, by_gripper @ np.array(errors.late), by_gripper @ np.array(errors.velocity))

    def at(self, delay: float) -> Floats | None:
        """Return (k, 3) m if stamps are too late by a delay, s; None: it is not off."""
        if not delay or self.velocity is None:
            return self.bent
        behind: Floats = -delay * self.velocity
        return behind if self.bent is None else self.bent + behind


def evenly(values: Floats, parts: Floats) -> Floats:
    """Return (m, 3) of values (k, 3) at even places of a length, at parts (m,) of it."""
    even = np.linspace(0.0, 1.0, len(values))
    return np.stack([np.interp(parts, even, column) for column in values.T], axis=1)


@dataclass(frozen=True, eq=False)
class Look:
    """Points of a look less those of a shape."""

    away: Floats    # (m, d) m: across the DLO (d = 2) without arc lengths, along the axes (3) else
    axes: Floats    # (m, d, 3) directions of these components
    s: Floats       # (m,) arc lengths of the DLO's points, m
    tangents: Floats  # (m, 3) there
    rows: Floats    # (m, d, k) derivatives along `axes` by the LookErrors
    inside: Bools   # (m,) which arc lengths are known, and not those of the end

    @classmethod
    def of(cls, shape: Shape, points: Floats, s: Floats | None, sway: float, beside: Off,
           delay: float) -> Look:
        """Return the Look of points (m, 3), at s (m,) if known, with stamps late by a delay, s."""
        # the distance along the DLO is left out beyond an end as well: the end itself is hardly
        # ever among the points
        off, at, frames, _ = point_residuals(shape, points, s, beside.at(delay))
        axes = frames[:, :, 1:].transpose(0, 2, 1) if s is None else np.tile(
            np.eye(3), (at.size, 1, 1))
        rows, length = [np.zeros((*axes.shape[:2], 0))], shape.s[-1]
        if sway:
            rows.append(axes * (sway * (at / length) ** 2)[:, None, None])
        if beside.late is not None and beside.late.any():
            rows.append(axes @ evenly(beside.late, at / length)[:, :, None])
        return cls(np.einsum('mij,mj->mi', axes, off), axes, at, frames[:, :, 0],
                   np.concatenate(rows, axis=2),
                   np.zeros(at.size, dtype=bool) if s is None else at < length)


class Information(NamedTuple):
    """The information of looks about a state x, to second order about the present one x0.

    Their cost is (x - x0)^T matrix (x - x0) / 2 - vector^T (x - x0), up to a constant.
    """

    matrix: Floats  # (n, n)
    vector: Floats  # (n,)
    scale: float    # noise by which the points were weighed, m

    @classmethod
    def of(cls, look: Look, slopes: Floats, fit: Mixture) -> Information:
        """Return the Information of a Look whose points have slopes (m, d, n) along its axes."""
        root = (np.sqrt(fit.weights) / fit.scale)[:, None]
        rows = (slopes * root[:, :, None]).reshape(-1, slopes.shape[2])
        matrix, vector = rows.T @ rows, rows.T @ (look.away * root).ravel()
        count = look.rows.shape[2]
        if count:  # eliminated, as it is another one in each look (Schur complement)
            across = rows.T @ (look.rows * root[:, :, None]).reshape(-1, count)
            matrix = matrix - across @ fit.inner @ across.T
            vector = vector - across @ fit.most_likely
        return cls(matrix, vector, fit.scale)


@dataclass(frozen=True, eq=False)
class Keyframe:
    """Looks at one pose of the gripper, oldest first."""

    gripper: Pose     # as measured
    looks: tuple[tuple[Floats, Floats | None], ...]  # points (m, 3), arc lengths (m,) or None
    shape: Shape      # at the window's `state` and at
    error: Floats     # (p,) that of the robot, in its deviations
    noise: float      # m, of these looks
    errors: LookErrors
    off: Off = Off()
    link: float = 0.0   # correlation of the robot's error with that of the keyframe before
    lasts: float = 0.0  # s from its first look to its last
    slopes: PointSlopes | None = None  # of a shape that is hardly another

    def takes(self, other: Keyframe) -> bool:
        """Return whether looks of another Keyframe can be added to this one."""
        if self.off.bent is not None or other.off.bent is not None:
            return False
        near = _SAME * self.noise
        return (self.noise, self.errors) == (other.noise, other.errors) and (
            float(np.linalg.norm(self.gripper.position - other.gripper.position)) <= near
            and self.shape.s[-1] * angle_between(self.gripper.rotation,
                                                 other.gripper.rotation) <= near)

    def stacked(self) -> Iterator[tuple[Floats, np.ndarray | None]]:
        """Yield points (m, 3) and arc lengths (m,) or None, look by look if they sway."""
        if self.errors != LookErrors():
            yield from self.looks
            return
        for known in (True, False):
            some = [look for look in self.looks if (look[1] is not None) == known]
            if some:
                points, s = zip(*some, strict=True)
                yield np.concatenate(points), np.concatenate(s) if known else None


@dataclass(frozen=True, eq=False)
class Consistency:
    """How well looks agree with what was expected before them: chi-squares, and their means."""

    innovations: float = 0.0  # by which looks moved the state, and their degrees of freedom
    expected: float = 0.0
    residuals: float = 0.0    # of the points' distances from the DLO after each look
    points: float = 0.0
    drift: float = 0.0        # by which the last looks together moved the free end

    def after(self, innovation: float, expected: float, residual: float,
              points: float, drift: float) -> Consistency:
        """Return the Consistency after one more look; what is older counts less and less."""
        kept = _FORGETTING
        return Consistency(kept * self.innovations + innovation, kept * self.expected + expected,
                           kept * self.residuals + residual, kept * self.points + points, drift)

    @property
    def inflation(self) -> float:
        """By what the covariance has to be multiplied, at least 1 (after Birge 1932)."""
        return max(1.0, _ratio(self.innovations, self.expected),
                   _ratio(self.residuals, self.points), self.drift / _DRIFTS[1])


def _ratio(chi_square: float, degrees: float) -> float:
    """Return a chi-square by its mean and two deviations, which it hardly exceeds by chance."""
    degrees += _PRIOR_DOF
    return float((chi_square + _PRIOR_DOF) / (degrees + 2 * np.sqrt(2 * degrees)))


@dataclass(frozen=True, eq=False)
class LagWindow:
    """What an estimate remembers: the looks from the last poses, and older ones linearized.

    Of the state x (n,) and the robot's errors (p,) at each keyframe, in standard deviations.
    """

    x: Floats       # (n + p,) mean by the prior and by forgotten looks; e at the last of them
    matrix: Floats  # (n + p, n + p) their information matrix
    keyframes: tuple[Keyframe, ...]  # oldest first
    mean: Floats        # (n + p,) by all looks; e at the last keyframe
    covariance: Floats  # (n + p, n + p)
    state: Floats       # (n + p,) where the last search ended; e at the last one forgotten
    # (a, n + p), (a, n + p, n + p): mean and covariance at the last keyframe by all looks but the
    # last, the last two, ..., the last a
    past: tuple[Floats, Floats]
    consistency: Consistency = Consistency()
    reference: Floats | None = None  # (3,) of the CameraError, m: where something was seen first
    camera_scale: float = 1.0  # by which the prior deviations of that are multiplied

    @classmethod
    def of(cls, mean: Floats, covariance: Floats, p: int) -> LagWindow:
        """Return the LagWindow without a look, of the state's mean (n,) and covariance (n, n)."""
        whole = np.eye(mean.size + p)
        whole[:mean.size, :mean.size] = covariance
        mean = np.append(mean, np.zeros(p))
        return cls(mean, cast(Floats, np.linalg.inv(whole)), (), mean, whole, mean,
                   (np.zeros((0, mean.size)), np.zeros((0, *whole.shape))))

    def about(self, reference: Floats) -> LagWindow:
        """Return it with a reference (3,), m, of the CameraError if it has none."""
        return self if self.reference is not None else replace(self, reference=reference)

    def with_likely_camera(self, columns: Ints) -> LagWindow:
        """Return it with the most likely scale of the camera's errors, in `columns` (k,).

        All of them are of one calibration, which is as good as stated or worse: those that looks
        tell say how far off those are that no look tells. The scale is that of the largest marginal
        likelihood, at least 1, by expectation and maximization (empirical Bayes).
        """
        own = np.ix_(columns, columns)
        certain = np.linalg.inv(self.covariance[own])  # what is else in the state is integrated out
        gained = certain - np.eye(columns.size) / self.camera_scale**2
        pull, scale = certain @ self.mean[columns], self.camera_scale
        for _ in range(_TURNS):
            spread = np.linalg.inv(gained + np.eye(columns.size) / scale**2)
            likely = spread @ pull
            scale = float(np.clip(np.sqrt((likely @ likely + np.trace(spread)) / columns.size),
                                  1.0, WORST_CAMERA))
        if abs(scale - self.camera_scale) <= _SCALED * self.camera_scale:
            return self
        more = np.zeros(self.x.size)
        more[columns] = scale**-2 - self.camera_scale**-2
        matrix, known = self.matrix + np.diag(more), np.linalg.inv(self.covariance)
        covariance = symmetric(np.linalg.inv(known + np.diag(more)))
        return replace(self, camera_scale=scale, matrix=matrix,
                       x=solved(matrix, self.matrix @ self.x), covariance=covariance,
                       mean=covariance @ (known @ self.mean),
                       past=(self.past[0][:0], self.past[1][:0]))

    def with_linear(self, rows: Floats, right: Floats) -> LagWindow:
        """Return it with k measurements of unit variance: rows (k, n) @ x = right (k,)."""
        rows = np.hstack([rows, np.zeros((len(rows), self.x.size - rows.shape[1]))])
        matrix = self.matrix + rows.T @ rows
        gain = np.linalg.solve(rows @ self.covariance @ rows.T + np.eye(len(rows)),
                               rows @ self.covariance).T
        covariance = self.covariance - gain @ rows @ self.covariance
        return replace(self, matrix=matrix,
                       x=solved(matrix, self.matrix @ self.x + rows.T @ right),
                       mean=self.mean + gain @ (right - rows @ self.mean),
                       covariance=0.5 * (covariance + covariance.T))

    def with_look(self, new: Keyframe, elapsed: float,
                  robot: RobotError) -> tuple[LagWindow, Keyframe | None]:
        """Return it with a Keyframe of one new look, and the Keyframe to be forgotten or None.

        Looks at the same pose, with the same noise and sway, are joined in one Keyframe, as long as
        the robot's error is hardly another.
        """
        old = self.keyframes
        lasts = old[-1].lasts + elapsed if old else 0.0
        if old and lasts <= _CONSTANT * robot.time and old[-1].takes(new):
            last = replace(old[-1], looks=(*old[-1].looks, *new.looks), lasts=lasts)
            if len(last.looks) <= _LOOKS:
                return replace(self, keyframes=(*old[:-1], last)), None
            half, lasts = _LOOKS // 2, 0.5 * lasts
            first = replace(last, looks=last.looks[:half], lasts=lasts)
            rest = replace(last, looks=last.looks[half:], link=robot.link(lasts, 0.0),
                           lasts=lasts)
            if len(old) > 1:  # older ones go first
                return replace(self, keyframes=(*old[1:-1], first, rest)), old[0]
            return replace(self, keyframes=(rest,)), first
        moved = way_between(old[-1].gripper, new.gripper) if old else 0.0
        keyframes = (*old, replace(new, link=robot.link(lasts if old else elapsed, moved)))
        if len(keyframes) <= _POSES:
            return replace(self, keyframes=keyframes), None
        return replace(self, keyframes=keyframes[1:]), keyframes[0]


def solved(matrix: Floats, right: Floats) -> Floats:
    """Return x (n,) with matrix (n, n) @ x = right (n,)."""
    return cast(Floats, np.linalg.solve(matrix, right))


class _Evaluated(NamedTuple):
    """A state y, and the Shape and the Looks of each keyframe there.

    y (n + p (k + 1),): x, the robot's error at the last forgotten keyframe, those at all k.
    """

    y: Floats
    shapes: list[Shape]
    looks: list[list[Look]]


class _Equations(NamedTuple):
    """The normal equations of a step."""

    matrix: Floats       # information matrix of y
    down: Floats         # minus the gradient of the cost
    scales: list[float]  # noise with which each keyframe is weighed, m


class LookUpdate:
    """One more look at the DLO, `elapsed` s after the one before; see `Observer.update`."""

    def __init__(self, estimate: Estimate, observation: Observation, outliers: float,
                 elapsed: float, noise: float, errors: LookErrors, bent: Floats | None) -> None:
        if errors.sway <= _STILL * noise:
            errors = errors._replace(sway=0.0)
        self._look = noise, errors, bent
        self._estimate, self._observation = estimate, observation
        self._uncertain, self._robot = estimate.uncertain, estimate.robot
        self._outliers, self._elapsed = outliers, elapsed
        self._n, self._p = self._uncertain.size, self._robot.acting.size
        self._unit = np.append(self._uncertain.deviations,
                               self._robot.deviations[self._robot.acting])
        self._window = window_of(estimate).about(np.array(observation.gripper.position))
        self._reference = cast(Floats, self._window.reference)

    def estimate(self) -> Estimate | None:
        """Return the Estimate, or None if no equilibrium explains the look."""
        before = self._window
        first, error = self._first()
        if not first.converged:
            return None
        s, points = self._observation.s, self._observation.points
        if s is not None:
            s = from_either_end(first, points, s)
        noise, errors, bent = self._look
        window, forgotten = before.with_look(
            Keyframe(self._observation.gripper, ((points, s),), first, error, noise, errors,
                     Off.of(first, errors, bent)), self._elapsed, self._robot)
        joined = bool(before.keyframes) and forgotten is None and (
            len(window.keyframes) == len(before.keyframes))
        if forgotten is not None:
            window = self._folded(window, forgotten)
        self._window = window
        self._slopes = [keyframe.slopes for keyframe in window.keyframes]
        expected = self._expected(before, joined)
        y = np.concatenate([window.state, *(keyframe.error for keyframe in window.keyframes)])
        shapes = [keyframe.shape for keyframe in window.keyframes]
        here: _Evaluated | None = _Evaluated(y, shapes, [
            self._looks(keyframe, shape, y) for keyframe, shape in zip(window.keyframes, shapes,
                                                                       strict=True)])
        last, exact = np.inf, False
        for _ in range(_ITERATIONS):
            if here is None:
                return None
            equations = self._equations(here)
            step = solved(equations.matrix, equations.down)
            slope, scales = float(step @ equations.down), equations.scales
            steady = last <= _STEADY * scales[-1] or scales[-1] == self._look[0]
            if slope < _SETTLED * step.size and steady:
                return self._result(here, step, equations, expected)
            moved = self._moved(here, step, slope, scales)
            exact = moved is None and not exact
            if exact:  # derivatives of a shape that is hardly another were not good enough
                self._slopes = [None] * len(shapes)
            else:
                here, last = moved, scales[-1]
        return None

    def _first(self) -> tuple[Shape, Floats]:
        """Return the Shape at the gripper's pose of this look, and the robot's error there (p,)."""
        window, simulator, gripper = (self._window, self._uncertain.simulator,
                                      self._observation.gripper)
        if window.keyframes and window.keyframes[-1].gripper == gripper:
            last = window.keyframes[-1]
            self._mesh = last.shape.state.made_on
            return last.shape, last.error
        known, error = self._estimate._shape, self._expected(window, False)[0][0, self._n:]
        z = window.state[:self._n] * self._unit[:self._n]
        gripper = gripper.compose(self._uncertain.offset(z, self._robot.twist(error)))
        if known is not None and (simulator.accuracy is None
                                  or surely_within(known, simulator.accuracy)):
            self._mesh = known.state.made_on
        else:
            self._mesh = simulator.discretization(gripper, None)
        return self._uncertain.equilibrium(z, self._mesh, gripper, known), error

    def _expected(self, before: LagWindow, joined: bool) -> tuple[Floats, Floats]:
        """Return means (a, n + p) and covariances of state and robot's error, before the look.

        First those by all looks before it, then those without the last, without the last two, ...
        """
        means, covariances = (np.concatenate([now[None], past])[:_PAST] for now, past in zip(
            (before.mean, before.covariance), before.past, strict=True))
        if joined or not self._p:
            return means, covariances
        moved = way_between(before.keyframes[-1].gripper, self._observation.gripper) if (
            before.keyframes) else 0.0
        link = self._robot.link(self._elapsed, moved)
        transition = np.append(np.ones(self._n), np.full(self._p, link))
        covariances = covariances * np.outer(transition, transition)
        covariances[:, self._n:, self._n:] += (1 - link**2) * np.eye(self._p)
        return means * transition, covariances

    def _errors(self, count: int) -> slice:
        """Return where in y the robot's error is: 0 of the window, 1 to k of the keyframes."""
        return slice(self._n + count * self._p, self._n + (count + 1) * self._p)

    def _state(self, y: Floats, count: int) -> tuple[Floats, Floats]:
        """Return the state (n,) and the robot's error (6,) at a keyframe, from number 1 on."""
        return y[:self._n] * self._unit[:self._n], self._robot.twist(y[self._errors(count)])

    def _at(self, y: Floats, before: Sequence[Shape]) -> _Evaluated | None:
        """Return the _Evaluated at y, searched from Shapes `before`; None: not converged."""
        shapes, looks = [], []
        for count, (keyframe, known) in enumerate(zip(self._window.keyframes, before, strict=True),
                                                  1):
            z, error = self._state(y, count)
            gripper = keyframe.gripper.compose(self._uncertain.offset(z, error))
            shape = self._uncertain.equilibrium(z, self._mesh, gripper, known, followed=False)
            if not shape.converged:
                return None
            shapes.append(shape)
            looks.append(self._looks(keyframe, shape, y))
        return _Evaluated(y, shapes, looks)

    def _looks(self, keyframe: Keyframe, shape: Shape, y: Floats) -> list[Look]:
        """Return the Looks of a keyframe from its Shape at y."""
        return [self._look_at(points, s, keyframe, shape, y) for points, s in keyframe.stacked()]

    def _look_at(self, points: Floats, s: Floats | None, keyframe: Keyframe, shape: Shape,
                 y: Floats) -> Look:
        """Return the Look, at y, of points (m, 3) that were seen in a keyframe."""
        z = y[:self._n] * self._unit[:self._n]
        return Look.of(shape, self._uncertain.camera(z, self._reference).undone(points), s,
                       keyframe.errors.sway, keyframe.off, self._uncertain.delay(z))

    def _equations(self, here: _Evaluated) -> _Equations:
        """Return the _Equations of a step from a state."""
        window, y, scales = self._window, here.y, []
        size = window.x.size
        matrix, down = np.zeros((y.size, y.size)), np.zeros(y.size)
        matrix[:size, :size] = window.matrix
        down[:size] = window.matrix @ (window.x - y[:size])
        for count, (keyframe, shape, looks) in enumerate(zip(
                window.keyframes, here.shapes, here.looks, strict=True), 1):
            self._link(matrix, down, y, count, keyframe)
            own = np.r_[0:self._n, self._errors(count)]
            slopes = self._slopes[count - 1] = self._slopes_at(y, count, shape,
                                                               self._slopes[count - 1])
            for one in self._information(slopes, keyframe, shape, looks):
                matrix[np.ix_(own, own)] += one.matrix
                down[own] += one.vector
            scales.append(one.scale)
        return _Equations(matrix, down, scales)

    def _link(self, matrix: Floats, down: Floats, y: Floats, count: int,
              keyframe: Keyframe) -> None:
        """Add what the robot's error at one keyframe says of the error at the next."""
        if not self._p:
            return
        link = keyframe.link
        own, old = self._errors(count), self._errors(count - 1)
        certain = np.eye(self._p) / (1 - link**2)
        off = certain @ (y[own] - link * y[old])
        matrix[own, own] += certain
        matrix[old, old] += link**2 * certain
        matrix[own, old] -= link * certain
        matrix[old, own] -= link * certain
        down[own] -= off
        down[old] += link * off

    def _slopes_at(self, y: Floats, count: int, shape: Shape,
                   known: PointSlopes | None) -> PointSlopes:
        """Return the PointSlopes of a keyframe's Shape at y, those known of one hardly another."""
        if known is not None and known.shape.s.size == shape.s.size and (
                np.abs(known.shape.positions - shape.positions).max() <= _HARDLY * shape.s[-1]):
            return known
        z, error = self._state(y, count)
        return self._uncertain.slopes(z, shape, error if self._p else None)

    def _information(self, slopes_at: PointSlopes, keyframe: Keyframe, shape: Shape,
                     looks: Sequence[Look]) -> Iterator[Information]:
        """Yield the Information of a keyframe's Looks."""
        uncertain = self._uncertain
        kept = np.append(np.arange(self._n), self._n + self._robot.acting)
        columns, numbers = uncertain.columns('camera')
        s = np.concatenate([look.s for look in looks])
        by_state = slopes_at(s)
        by_state[:, numbers, columns] += 1.0
        turned, delayed = uncertain.columns('camera_rotation'), uncertain.columns('stamps')[0]
        if turned[0].size:
            places = shape.positions_at(np.minimum(s, shape.s[-1]))
            camera = uncertain.camera(np.zeros(self._n), self._reference)
            by_state[:, :, turned[0]] += camera.slopes(places)[:, :, turned[1]]
        if delayed.size and keyframe.off.velocity is not None:
            by_state[:, :, delayed] -= evenly(keyframe.off.velocity, s / shape.s[-1])[:, :, None]
        ends = np.cumsum([look.s.size for look in looks])
        for look, own in zip(looks, np.split(by_state, ends[:-1]), strict=True):
            # a place moves along with the length, a point of known arc length does not
            for column in uncertain.columns('length')[0]:
                own[look.inside, :, column] -= look.tangents[look.inside] * (
                    look.s[look.inside] / shape.s[-1])[:, None]
            yield Information.of(look, look.axes @ own[:, :, kept] * self._unit,
                                 self._mixture(look, keyframe, shape))

    def _mixture(self, look: Look, keyframe: Keyframe, shape: Shape) -> Mixture:
        return mixture(look.away, look.rows, keyframe.noise, self._outliers, shape.s[-1])

    def _moved(self, here: _Evaluated, step: Floats, slope: float,
               scales: Sequence[float]) -> _Evaluated | None:
        """Return the _Evaluated after a step, halved until it lowers the cost; None: never."""
        part, cost = 1.0, self._cost(here, scales)
        for _ in range(_HALVINGS):
            trial = self._at(here.y + part * step, here.shapes)
            if trial is not None and all(
                    np.abs(one.positions - other.positions).max() <= _FARTHEST * one.s[-1]
                    for one, other in zip(here.shapes, trial.shapes, strict=True)) and (
                    self._cost(trial, scales) <= cost - _ENOUGH * part * slope):
                return trial
            part *= 0.5
        return None

    def _cost(self, here: _Evaluated, scales: Sequence[float]) -> float:
        """Return minus the logarithm of the likelihood, up to a constant: what is minimized."""
        window, outliers, y = self._window, self._outliers, here.y
        off = y[:window.x.size] - window.x
        cost = 0.5 * float(off @ window.matrix @ off)
        for count, (keyframe, shape, looks, scale) in enumerate(zip(
                window.keyframes, here.shapes, here.looks, scales, strict=True), 1):
            link = keyframe.link
            wandered = y[self._errors(count)] - link * y[self._errors(count - 1)]
            cost += 0.5 * float(wandered @ wandered) / (1 - link**2)
            cost += sum(mixture_cost(look.away, look.rows, scale, outliers, shape.s[-1])
                        for look in looks)
        return cost

    def _folded(self, window: LagWindow, keyframe: Keyframe) -> LagWindow:
        """Return the LagWindow with a forgotten Keyframe, linearized where it is."""
        y = np.concatenate([window.state, keyframe.error])
        self._window, self._slopes = replace(window, keyframes=(keyframe,)), [keyframe.slopes]
        matrix, down, _ = self._equations(_Evaluated(
            y, [keyframe.shape], [self._looks(keyframe, keyframe.shape, y)]))
        vector, own = down + matrix @ y, np.r_[0:self._n, self._errors(1)]
        if self._p:  # the error before it is forgotten (Schur complement)
            old = np.r_[self._errors(0)]
            across = np.linalg.solve(matrix[np.ix_(old, old)], matrix[np.ix_(old, own)]).T
            vector = vector[own] - across @ vector[old]
            matrix = matrix[np.ix_(own, own)] - across @ matrix[np.ix_(old, own)]
        matrix = symmetric(matrix)
        return replace(window, x=solved(matrix, vector), matrix=matrix, state=y[own])

    def _result(self, here: _Evaluated, step: Floats, equations: _Equations,
                expected: tuple[Floats, Floats]) -> Estimate:
        window, keyframe, shape = self._window, self._window.keyframes[-1], here.shapes[-1]
        points, s = keyframe.looks[-1]
        last = self._mixture(self._look_at(points, s, keyframe, shape, here.y), keyframe,
                             shape)  # alone
        now = np.r_[0:self._n, self._errors(len(window.keyframes))]
        covariance = symmetric(np.linalg.inv(equations.matrix)[np.ix_(now, now)])
        mean = (here.y + step)[now]
        innovation, seen = innovation_of(expected[0][0], expected[1][0], mean, covariance)
        drift = self._drift(shape, expected, mean, covariance)
        # the model's own errors are no news of the noise; what is left counts in full
        residual = max(last.residual / _MODEL, min(last.residual, last.degrees))
        share = min(self._outliers + _MORE_OUTLIERS, 1.0)
        most = share + 4 * np.sqrt(share * (1 - share) / len(self._observation.points))
        normalized = max(innovation / limit_of(seen), residual / limit_of(last.degrees),
                         drift / _DRIFTS[0], last.outliers / most)
        keyframes = tuple(
            replace(one, shape=shape, error=here.y[self._errors(count)], slopes=slopes)
            for count, (one, shape, slopes) in enumerate(zip(
                window.keyframes, here.shapes, self._slopes, strict=True), 1))
        window = replace(window, keyframes=keyframes, mean=mean, covariance=covariance,
                         state=here.y[:window.x.size], past=expected,
                         consistency=window.consistency.after(innovation, seen, residual,
                                                              last.degrees, drift))
        camera = np.concatenate([self._uncertain.columns(name)[0] for name in CALIBRATION])
        if camera.size:
            window = window.with_likely_camera(camera)
        return estimate_of(self._estimate, window, looks=self._estimate.looks + 1, converged=True,
                           misfit=last.misfit, outliers=last.outliers,
                           normalized_innovation=float(normalized), _shape=shape)

    def _drift(self, shape: Shape, expected: tuple[Floats, Floats], mean: Floats,
               covariance: Floats) -> float:
        """Return the chi-square by which looks together moved the free end: the largest of all.

        Of two degrees of freedom, across the DLO. As of one look, the change by several has the
        covariance before them less that after them.
        """
        end, slopes = shape.s[-1:], self._slopes[-1]
        assert slopes is not None  # the last step was made with them
        kept = np.append(np.arange(self._n), self._n + self._robot.acting)
        rows = shape.frame_at(float(end[0]))[0][:, 1:].T @ slopes(end)[0][:, kept] * self._unit
        moved = (mean - expected[0]) @ rows.T
        spread = rows @ (expected[1] - covariance) @ rows.T + (
            _SAME * self._look[0]) ** 2 * np.eye(2)
        return float(np.einsum('ai,aij,aj->a', moved, np.linalg.inv(spread), moved).max())


def window_of(estimate: Estimate) -> LagWindow:
    """Return the LagWindow of an Estimate, a new one where nothing was seen."""
    if estimate._memory is not None:
        window: LagWindow = estimate._memory
        return window
    unit = estimate.uncertain.deviations
    return LagWindow.of(estimate.mean / unit, estimate.covariance / np.outer(unit, unit),
                        estimate.robot.acting.size)


def estimate_of(estimate: Estimate, window: LagWindow, **changes: Any) -> Estimate:
    """Return an Estimate with the mean and covariance of a LagWindow."""
    unit = estimate.uncertain.deviations
    n = unit.size
    return replace(estimate, mean=window.mean[:n] * unit,
                   covariance=window.covariance[:n, :n] * np.outer(unit, unit), _memory=window,
                   **changes)


def innovation_of(before: Floats, expected: Floats, after: Floats,
                  left: Floats) -> tuple[float, float]:
    """Return the chi-square by which a look moved a state, and its degrees of freedom.

    The change has the covariance P- less P+; directions count whose variance the look lowered.
    """
    root = np.linalg.cholesky(expected)
    moved = solve_triangular(root, after - before, lower=True)
    half = solve_triangular(root, left, lower=True)
    values, vectors = np.linalg.eigh(symmetric(solve_triangular(root, half.T, lower=True)))
    gained = 1.0 - values
    seen = gained > _SEEN
    return float(np.sum((vectors.T @ moved)[seen] ** 2 / gained[seen])), float(seen.sum())


def limit_of(degrees: float) -> float:
    """Return what a chi-square of so many degrees of freedom hardly ever exceeds."""
    return float(chdtri(max(degrees, 1.0), _RARE))


def symmetric(matrix: Floats) -> Floats:
    """Return the symmetric part of a matrix (n, n)."""
    return 0.5 * (matrix + matrix.T)
