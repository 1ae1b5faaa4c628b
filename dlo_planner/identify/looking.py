# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The information in looks at a DLO: distances of seen points from a predicted shape, weighed.

A point belongs to the DLO, with normal noise, or it is an outlier, anywhere near the DLO; the share
of outliers is given. A point is weighed by the probability that it belongs to the DLO (Dempster,
Laird and Rubin 1977). As long as the shape fits badly, a scale of the residuals replaces the noise:
from the median of the squared distances, which outliers hardly move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.identify.misfit import nearest
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.verify.response import at_arc_lengths
from dlo_planner.verify.uncertain import Uncertain

_ABOUT = 0.1  # of the length: half side of the cube about the DLO in which outliers lie
_MEDIAN_2, _MEDIAN_3 = 1.3862943611198906, 2.3659738843753377  # of a chi-square of 2, 3 degrees
_BADLY = 4.0  # times the noise's square: above it the shape fits badly
_TURNS = 40   # of expectation and maximization
_BY_MEDIAN = 3  # of them with a scale by the median
_FOUND = 1e-6   # standard deviations: the last step


class Own(NamedTuple):
    """What is another one in each look, in standard deviations.

    Attributes
    ----------
    sway : float
        Of the free end about its rest along each world axis, m.
    late : tuple of float
        Rotation vector, rad, and way, m, of the gripper in the time by which the stamp may be
        wrong, world axes: the DLO moves along with it.
    """

    sway: float = 0.0
    late: tuple[float, ...] = (0.0,) * 6


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of m points from a shape.

    Attributes
    ----------
    away : ndarray, shape (m, d)
        Components in m of the vectors from the DLO to the points: across the DLO (d = 2) if arc
        lengths are not known, along the world axes (d = 3) if they are.
    axes : ndarray, shape (m, d, 3)
        Directions of these components.
    frames : ndarray, shape (m, 3, 3)
        Frames of the DLO at the arc lengths s (m,), m.
    square : ndarray, shape (m,)
        Squared lengths of `away`, m^2.
    arms : ndarray, shape (m, 3)
        From the gripper to the DLO at these arc lengths, m, world axes.
    """

    away: Floats
    axes: Floats
    frames: Floats
    s: Floats
    square: Floats
    arms: Floats

    def cost(self, scale: float, outliers: float, own: Own, length: float) -> float:
        """Return minus the logarithm of the likelihood, up to a constant."""
        d = self.away.shape[1]
        _, square, likely, _, _ = _most_likely(self.away, self.by_own(own, length), 0.0, scale,
                                               outliers, 2 * _ABOUT * length)
        more = 0.5 * float(likely @ likely)
        if outliers == 0:
            return 0.5 * float(square.sum()) / scale**2 + more
        # for each point -log((1 - e) N(r) + e / V), up to a constant
        of_dlo = -0.5 * square / scale**2
        none = np.log(outliers / (1 - outliers)) + d * np.log(
            np.sqrt(2 * np.pi) * scale / (2 * _ABOUT * length))
        return -float(np.logaddexp(of_dlo, none).sum()) + more

    def by_own(self, own: Own, length: float) -> Floats:
        """Return (m, d, k): derivatives along `axes` by what is another one in each look.

        By the sway (3) and by how late the stamp is (1), each in its standard deviation, where it
        is not 0.
        """
        parts = [np.zeros((*self.away.shape, 0))]
        if own.sway:
            parts.append(self.axes * (own.sway * (self.s / length) ** 2)[:, None, None])
        if any(own.late):
            turn, shift = np.array(own.late[:3]), np.array(own.late[3:])
            parts.append(self.axes @ (shift + np.cross(turn, self.arms))[:, :, None])
        return np.concatenate(parts, axis=2)


@dataclass(frozen=True, eq=False)
class Look:
    """Distances with derivatives of the predicted points.

    Attributes
    ----------
    distances : Distances
    slopes : ndarray, shape (m, d, n)
        Derivatives of the predicted points along `axes` by the state.
    """

    distances: Distances
    slopes: Floats


class Fit(NamedTuple):
    """How points fit a shape.

    Attributes
    ----------
    weights : ndarray, shape (m,)
        Probabilities of the points to belong to the DLO.
    scale : float
        Noise by which they were weighed, m.
    rows : ndarray, shape (m, d, k)
        See `Distances.by_own`.
    most_likely, inner : ndarray, shapes (k,), (k, k)
        The most likely values of what is the look's own, and their covariance.
    misfit : float
        Root mean square distance, weighed, m.
    residual, degrees : float
        Chi-square of the weighed distances after that, by the noise as stated, and its degrees of
        freedom.
    """

    weights: Floats
    scale: float
    rows: Floats
    most_likely: Floats
    inner: Floats
    misfit: float
    residual: float
    degrees: float

    @property
    def outliers(self) -> float:
        """Mean probability of the points not to belong to the DLO."""
        return float(1 - self.weights.mean())


@dataclass(frozen=True, eq=False)
class Information:
    """The information of looks about a state x, to second order about the present one x0.

    Their cost is (x - x0)^T matrix (x - x0) / 2 - vector^T (x - x0), up to a constant.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
    vector : ndarray, shape (n,)
    scale : float
        Noise by which the points were weighed, m.
    """

    matrix: Floats
    vector: Floats
    scale: float


def squares(shape: Shape, points: Floats, s: Floats | None,
            bent: Floats | None = None) -> Distances:
    """Return the Distances of points from a Shape.

    Shapes: points (m, 3), s (m,), bent (k, 3).
    """
    nodes, kernels = np.array(shape.s), kernel_arrays(shape)  # copies: see `kernel_arrays`
    at: Floats = nearest(nodes, *kernels, points)[0] if s is None else np.clip(
        s, 0.0, shape.s[-1])
    frames, places = _points_at(nodes, *kernels, at)
    if bent is not None:
        even = np.linspace(0, nodes[-1], len(bent))
        off_rest = np.stack([np.interp(at, even, part) for part in bent.T], axis=1)
        if s is None:  # the nearest place of the bent DLO
            at = nearest(nodes, *kernels, points - off_rest)[0]
            frames, places = _points_at(nodes, *kernels, at)
            off_rest = np.stack([np.interp(at, even, part) for part in bent.T], axis=1)
        places += off_rest
    off = points - places
    axes = frames[:, :, 1:].transpose(0, 2, 1) if s is None else np.tile(np.eye(3),
                                                                         (at.size, 1, 1))
    # the distance along the DLO is left out beyond an end as well: the end itself is hardly ever
    # among the points
    away = np.einsum('mij,mj->mi', axes, off)
    return Distances(away, axes, frames, at, np.sum(away**2, axis=1),
                     places - shape.gripper.position)


def looked_at(uncertain: Uncertain, shape: Shape, slopes: Floats, off: Distances,
              known: bool) -> Look:
    """Return the Look of Distances.

    Shapes: slopes (N + 1, 3, n).
    """
    length = shape.s[-1]
    by_state = at_arc_lengths(slopes, shape.s, off.s)
    columns, numbers = uncertain.columns('camera')
    by_state[:, numbers, columns] += 1.0
    if known:  # a node moves along with the length, a point of known arc length does not
        inside = off.s < length
        for column in uncertain.columns('length')[0]:
            by_state[inside, :, column] -= off.frames[inside, :, 0] * (
                off.s[inside] / length)[:, None]
    return Look(off, off.axes @ by_state)


def fit_of(off: Distances, noise: float, outliers: float, own: Own, length: float) -> Fit:
    """Return the Fit of Distances; arguments as of `Distances.cost`, `noise` as stated."""
    d, rows = off.away.shape[1], off.by_own(own, length)
    weights, square, likely, inner, scale = _most_likely(off.away, rows, noise, 0.0, outliers,
                                                         2 * _ABOUT * length)
    total = max(float(weights.sum()), np.finfo(float).tiny)
    return Fit(weights, scale, rows, likely, inner,
               float(np.sqrt(weights @ np.sum(off.away**2, axis=1) / total)),
               float(weights @ square) / noise**2, max(d * total - rows.shape[2], 1.0))


def information_of(look: Look, noise: float, outliers: float, own: Own,
                   length: float) -> Information:
    """Return the Information of a Look; arguments as of `fit_of`."""
    off = look.distances
    fit = fit_of(off, noise, outliers, own, length)
    root = (np.sqrt(fit.weights) / fit.scale)[:, None]
    rows = (look.slopes * root[:, :, None]).reshape(-1, look.slopes.shape[2])
    matrix, vector = rows.T @ rows, rows.T @ (off.away * root).ravel()
    count = fit.rows.shape[2]
    if count:  # eliminated, as it is another one in each look (Schur complement)
        across = rows.T @ (fit.rows * root[:, :, None]).reshape(-1, count)
        matrix = matrix - across @ fit.inner @ across.T
        vector = vector - across @ fit.most_likely
    return Information(matrix, vector, fit.scale)


def from_either_end(shape: Shape, points: Floats, s: Floats) -> Floats:
    """Return the arc lengths (m,), from the other end if the points (m, 3) fit better so."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(points - shape.positions_at(np.clip(
        one, 0.0, shape.s[-1])), axis=1)) for one in both]
    return both[int(off[1] < off[0])]


@kernel
def _most_likely(away: Floats, rows: Floats, noise: float, scale: float, outliers: float,
                 side: float) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Return what is most likely of points, by expectation maximization.

    Which belong to the DLO and what is the look's own, a normal distribution of unit variance, are
    searched in turn, first with a scale by the median of the squares, so that a large displacement
    of all points makes no outliers of them.

    Shapes: away (m, d), rows (m, d, k).
    """
    m, d, k = rows.shape
    likely = np.zeros(k)
    matrix: Floats = np.zeros((k, k))
    weights: Floats = np.ones(m)
    square, right = np.empty(m), np.empty(k)
    median, least = (_MEDIAN_2 if d == 2 else _MEDIAN_3), noise if noise else scale
    used = least
    for turn in range(_TURNS):
        for i in range(m):
            square[i] = 0.0
            for j in range(d):
                left = away[i, j]
                for a in range(k):
                    left -= rows[i, j, a] * likely[a]
                square[i] += left * left
        if noise or turn < _BY_MEDIAN:
            left = np.median(square) / median
            used = least if left <= _BADLY * least**2 else np.sqrt(left)
        else:
            used = scale
        if outliers:
            density = (1 - outliers) / (2 * np.pi * used**2) ** (0.5 * d)
            for i in range(m):
                own = density * np.exp(-0.5 * square[i] / used**2)
                weights[i] = own / (own + outliers * side**-d)
        if not k:
            if noise or turn >= _BY_MEDIAN:
                break
            continue
        matrix[:] = 0.0
        right[:] = 0.0
        for i in range(m):
            weight = weights[i] / used**2
            for j in range(d):
                for a in range(k):
                    right[a] += weight * rows[i, j, a] * away[i, j]
                    for b in range(k):
                        matrix[a, b] += weight * rows[i, j, a] * rows[i, j, b]
        for a in range(k):
            matrix[a, a] += 1.0
        step = np.linalg.solve(matrix, right) - likely
        if turn > _BY_MEDIAN and np.abs(step).max() < _FOUND:
            break
        likely += step
    matrix[:] = np.linalg.inv(matrix)
    return weights, square, likely, matrix, used


@kernel
def _points_at(nodes: Floats, lengths: Floats, strains: Floats, rotations: Floats,
               positions: Floats, s: Floats) -> tuple[Floats, Floats]:
    """Return axes (m, 3, 3) and positions (m, 3) at arc lengths s (m,)."""
    m, n = s.size, lengths.size
    axes, places = np.empty((m, 3, 3)), np.empty((m, 3))
    for j in range(m):
        e = min(max(np.searchsorted(nodes, s[j], side='right') - 1, 0), n - 1)
        point_inside(lengths, strains, rotations, positions, e, (s[j] - nodes[e]) / lengths[e],
                     axes[j], places[j])
    return axes, places
