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
from typing import cast

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.identify.misfit import nearest
from dlo_planner.identify.predicted_miss import at_arc_lengths
from dlo_planner.identify.uncertain import Uncertain
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.kinematics import point_inside

_ABOUT = 0.1  # of the length: half side of the cube about the DLO in which outliers lie
_MEDIAN = {2: 1.3862943611198906, 3: 2.3659738843753377}  # of a chi-square, by degrees of freedom
_BADLY = 4.0  # times the noise's square: above it the shape fits badly


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
    """

    away: Floats
    axes: Floats
    frames: Floats
    s: Floats
    square: Floats

    def cost(self, scale: float, outliers: float, sway: float, length: float) -> float:
        """Return minus the logarithm of the likelihood, up to a constant.

        Parameters
        ----------
        scale : float
            Noise of a point along each axis, m.
        outliers : float
            Part of the points that do not belong to the DLO.
        sway : float
            Standard deviation of the free end's sway, m.
        length : float
            Length of the DLO, m.
        """
        d = self.away.shape[1]
        square, more = self.square, 0.0
        if sway:
            square, more = self._without_sway(scale, outliers, sway, length)
        if outliers == 0:
            return 0.5 * float(square.sum()) / scale**2 + more
        # for each point -log((1 - e) N(r) + e / V), up to a constant
        own = -0.5 * square / scale**2
        none = np.log(outliers / (1 - outliers)) + d * np.log(
            np.sqrt(2 * np.pi) * scale / (2 * _ABOUT * length))
        return -float(np.logaddexp(own, none).sum()) + more

    def swaying(self, length: float) -> Floats:
        """Return (m, d, 3): derivatives by the free end's sway of the DLO along `axes`."""
        return self.axes * ((self.s / length) ** 2)[:, None, None]

    def _without_sway(self, scale: float, outliers: float, sway: float,
                      length: float) -> tuple[Floats, float]:
        """Return squared distances (m,) after the most likely sway, and the cost of that sway."""
        weights = _weights(self.square, self.away.shape[1], scale, outliers, length)
        rows = self.swaying(length)
        most_likely = _sway(rows, self.away, weights, scale, sway)[0]
        return (np.sum((self.away - rows @ most_likely) ** 2, axis=1),
                0.5 * float(most_likely @ most_likely) / sway**2)


@dataclass(frozen=True, eq=False)
class Look:
    """Distances with derivatives of the predicted points.

    Attributes
    ----------
    distances : Distances
    slopes : ndarray, shape (m, d, n)
        Derivatives of the predicted points along `axes` by the state.
    swaying : ndarray, shape (m, d, 3)
        The same by the sway of the free end.
    """

    distances: Distances
    slopes: Floats
    swaying: Floats


@dataclass(frozen=True, eq=False)
class Information:
    """The information of looks about a state x, to second order about the present one x0.

    Their cost is (x - x0)^T matrix (x - x0) / 2 - vector^T (x - x0), up to a constant.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
    vector : ndarray, shape (n,)
    misfit : float
        Root mean square distance, weighed by the probability to belong to the DLO, m.
    outliers : float
        Mean probability of the points not to belong to the DLO.
    scale : float
        Noise by which the points were weighed, m.
    """

    matrix: Floats
    vector: Floats
    misfit: float
    outliers: float
    scale: float


def squares(shape: Shape, points: Floats, s: Floats | None) -> Distances:
    """Return the Distances of points from a Shape.

    Parameters
    ----------
    shape : Shape
    points : ndarray, shape (m, 3)
        Points in m, world axes, less the camera's bias.
    s : ndarray, shape (m,) or None
        Their arc lengths, m. If None, not known.
    """
    nodes, kernels = np.array(shape.s), shape.for_kernels  # copies: see `Shape.for_kernels`
    at: Floats = nearest(nodes, *kernels, points)[0] if s is None else np.clip(
        s, 0.0, shape.s[-1])
    frames, places = _points_at(nodes, *kernels, at)
    off = points - places
    axes = frames[:, :, 1:].transpose(0, 2, 1) if s is None else np.tile(np.eye(3),
                                                                         (at.size, 1, 1))
    # the distance along the DLO is left out beyond an end as well: the end itself is hardly ever
    # among the points
    away = np.einsum('mij,mj->mi', axes, off)
    return Distances(away, axes, frames, at, np.sum(away**2, axis=1))


def looked_at(uncertain: Uncertain, shape: Shape, slopes: Floats, off: Distances,
              known: bool) -> Look:
    """Return the Look of Distances.

    Parameters
    ----------
    uncertain : Uncertain
    shape : Shape
    slopes : ndarray, shape (N + 1, 3, n)
        Derivatives of the nodes by the state.
    off : Distances
        Distances from the shape.
    known : bool
        Whether arc lengths were seen.
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
    return Look(off, off.axes @ by_state, off.swaying(length))


def information_of(look: Look, noise: float, outliers: float, sway: float,
                   length: float) -> Information:
    """Return the Information of a Look; arguments as of `Distances.cost`, `noise` as stated."""
    off = look.distances
    d, square = off.away.shape[1], off.square
    for _ in range(2 if sway else 1):
        scale = _scale(square, d, noise)
        weights = _weights(square, d, scale, outliers, length)
        if sway:
            most_likely, inner = _sway(look.swaying, off.away, weights, scale, sway)
            square = np.sum((off.away - look.swaying @ most_likely) ** 2, axis=1)
    root = (np.sqrt(weights) / scale)[:, None]
    rows = (look.slopes * root[:, :, None]).reshape(-1, look.slopes.shape[2])
    matrix, vector = rows.T @ rows, rows.T @ (off.away * root).ravel()
    if sway:  # eliminated, as it is another one in each look (Schur complement)
        across = rows.T @ (look.swaying * root[:, :, None]).reshape(-1, 3)
        matrix = matrix - across @ inner @ across.T
        vector = vector - across @ most_likely
    own = max(float(weights.sum()), np.finfo(float).tiny)
    return Information(matrix, vector, float(np.sqrt(weights @ np.sum(off.away**2, axis=1) / own)),
                float(1 - weights.mean()), scale)


def from_either_end(shape: Shape, points: Floats, s: Floats) -> Floats:
    """Return the arc lengths (m,), from the other end if the points (m, 3) fit better so."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(points - shape.positions_at(np.clip(
        one, 0.0, shape.s[-1])), axis=1)) for one in both]
    return both[int(off[1] < off[0])]


def _scale(square: Floats, d: int, noise: float) -> float:
    """Return the noise (m) for the weights: as stated, or larger while the shape fits badly."""
    left = float(np.median(square)) / _MEDIAN[d]
    return noise if left <= _BADLY * noise**2 else float(np.sqrt(left))


def _weights(square: Floats, d: int, scale: float, outliers: float, length: float) -> Floats:
    """Return (m,) probabilities that points at squared distances `square` belong to the DLO."""
    if outliers == 0:
        return np.ones(len(square))
    own = (1 - outliers) * np.exp(-0.5 * square / scale**2) / (
        2 * np.pi * scale**2) ** (0.5 * d)
    result: Floats = own / (own + outliers * (2 * _ABOUT * length) ** -d)
    return result


def _sway(swaying: Floats, away: Floats, weights: Floats, scale: float,
          sway: float) -> tuple[Floats, Floats]:
    """Return the most likely sway (3,), m, and its covariance (3, 3)."""
    root = (np.sqrt(weights) / scale)[:, None]
    rows = (swaying * root[:, :, None]).reshape(-1, 3)
    inner = np.linalg.inv(rows.T @ rows + np.eye(3) / sway**2)
    return inner @ (rows.T @ (away * root).ravel()), cast(Floats, inner)


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
