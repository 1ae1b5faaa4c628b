# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How errors of seen points are distributed, and what that makes of residuals.

Fits offer robust losses (M-estimators): outliers count little, and what is left tells the noise.
Looks of a camera are weighed one by one: a point belongs to the DLO, with normal noise, or it is an
outlier, anywhere near the DLO; the share of outliers is given. Each is weighed by the probability
that it belongs (Dempster, Laird and Rubin 1977). As long as the shape fits badly, a scale of the
residuals replaces the noise: from the median of the squared distances, which outliers hardly move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from dlo_planner.identify.residuals import EXACTLY, MeasurementModel, Residuals
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_SMALL = 1e-10  # relative change of the sum of squares, or of the unknowns, that ends a search
_EVALUATIONS = 60
_GAIN = 1e-2  # of the cost of one residual: a step that gains less moves by 1/10 of a deviation
_STEP = 1e-4  # of the unknowns: differences of motions tell no shorter step
_ROUNDS, _SETTLED = 30, 1e-3  # of the noise
_FIRST_NOISE, _NO_NOISE = 1e-2, 1e-10  # of the length: taken at first; what rounding leaves
# SciPy's first step is as long as the unknowns are. From zeros it would be about one deviation of
# one of them, and many steps would go by until it has grown
_REACH = 0.3
_HIDDEN = 0.2  # of the noise: what moves a point by less at most is hidden by it
_MEDIAN = 0.6744897501960817  # of the size of a standard normal number

_LARGEST = 0.97    # correlation of neighbors: more is not distinguishable from a drift
_WIDTH = 1.1447    # of Andrews, for Bartlett's kernel
_FREEDOM = 1.5     # degrees of freedom of Bartlett's kernel, per instants in its width
_LEAST_FREEDOM = 2.5
_NOTHING = 1e-12   # of the largest eigenvalue
_MEDIAN_2, _MEDIAN_3 = 1.3862943611198906, 2.3659738843753377  # of a chi-square of 2, 3 degrees
_BADLY = 4.0  # times the noise's square: above it the shape fits badly
_TURNS = 40   # of expectation and maximization
_BY_MEDIAN = 3  # of them with a scale by the median
_FOUND = 1e-6   # standard deviations: the last step
_ABOUT = 0.2  # of the length: side of the cube about a point of the DLO in which outliers lie

# rho(z) of z = (distance / scale)^2 and its first two derivatives, as in SciPy's least_squares
Loss: TypeAlias = Callable[[Floats], tuple[Floats, Floats, Floats]]
LOSSES: dict[str, Loss] = {
    'linear': lambda z: (z, np.ones_like(z), np.zeros_like(z)),
    'soft_l1': lambda z: (2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    'huber': lambda z: (np.where(z <= 1, z, 2 * np.sqrt(z) - 1), np.maximum(z, 1) ** -0.5,
                        np.where(z <= 1, 0.0, -0.5 * np.maximum(z, 1) ** -1.5)),
    'cauchy': lambda z: (np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2),
    'arctan': lambda z: (np.arctan(z), 1 / (1 + z**2), -2 * z / (1 + z**2) ** 2)}


@dataclass(frozen=True, eq=False)
class Statistics:
    """What is left at the most likely unknowns."""

    deviations: Floats    # (n,) of the parameters, infinite where nothing is known
    correlations: Floats  # (n, n) of their errors; 0 between what is known and what is not
    noise: float          # m
    freedom: float        # how many numbers, seen or known before, nothing was fitted to
    excess: float         # chi-square of them by the noise as stated, over `freedom`; 1 where found


class _Information(NamedTuple):
    """What the points tell of n unknowns."""

    plain: Floats     # (n, n) J^T J of the residuals in standard deviations, without the loss
    stiffness: float  # mean slope of the force that a point exerts, by the loss
    force: float      # sum of the squares of these forces
    inverse: Floats   # (n, n) covariance, by the loss and the prior, where it is known
    unknown: Floats   # (n, j) basis of what nothing is known of
    size: int         # how many numbers were seen
    left: float       # how many of them nothing was fitted to


class MEstimator:
    """Least squares of a MeasurementModel with a robust loss: what is minimized, and what it tells.

    `prior` (k,) are 1 / standard deviations of its parameters, `noise` is in m (None: to be found),
    `scale` that of the loss, in standard deviations of the noise.
    """

    def __init__(self, observed: MeasurementModel, prior: Floats, noise: float | None, loss: Loss,
                 scale: float) -> None:
        self._observed, self._given, self._loss, self._scale = observed, noise, loss, scale
        # errors of poses are unknowns in their own standard deviations
        self._prior = np.append(prior, np.ones(observed.size - prior.size))
        self._first = noise or _FIRST_NOISE * observed.rod.length
        self._weighed = bool(self._prior.any()) or loss is not LOSSES['linear']

    @property
    def step_tolerance(self) -> float:
        """Error that steps of motions may have, of the length: what the noise hides."""
        return max(EXACTLY, _HIDDEN * (self._given or 0.0) / self._observed.rod.length)

    def with_noise(self, found: OptimizeResult) -> tuple[OptimizeResult, Statistics]:
        """Return SciPy's result and the Statistics where noise and unknowns fit each other."""
        length = self._observed.rod.length
        noise = self._first
        # the noise decides only where there is something else to weigh it against
        for _ in range(_ROUNDS if self._weighed and not self._given else 0):
            before, noise = noise, max(self._noise_left(found.x, noise), _NO_NOISE * length)
            if abs(noise - before) <= _SETTLED * before:
                break
            found = self.minimum(found.x, noise)
        self._observed.use_central_differences()
        return found, self._statistics(found.x, noise)

    def cost(self, x: Floats) -> float:
        """Return what is minimized at x (n,), for the first guess of the noise."""
        return 0.5 * float(np.sum(self._residuals(x, self._first) ** 2))

    def minimum(self, x: Floats, noise: float | None = None) -> OptimizeResult:
        """Return SciPy's result from x (n,) on, for a noise in m; None: the first guess."""
        size = noise or self._first
        self._observed.forget()
        # what the derivatives cannot tell, or is far less than the errors, is not sought: motions
        # are costly
        small = max(_SMALL, self._observed.precision**2)
        step, gain = small, small
        if self._observed.motions:
            step, gain = _STEP, _GAIN / self._observed.at(x).counts.sum()
        found = least_squares(lambda x: self._residuals(x - _REACH, size), x + _REACH,
                              lambda x: self._slopes(x - _REACH, size), x_scale='jac', xtol=step,
                              ftol=gain, gtol=1e-12, max_nfev=_EVALUATIONS,
                              bounds=tuple(bound + _REACH for bound in self._observed.bounds))
        found.x = found.x - _REACH
        return found

    def _residuals(self, x: Floats, noise: float) -> Floats:
        """Return the residuals, whose squares add up to what is minimized."""
        here = self._observed.at(x)
        return np.append((self._weights(here, noise)[0] * here.away / noise).ravel(),
                         self._prior * x)

    def _slopes(self, x: Floats, noise: float) -> Floats:
        """Return the derivatives of the residuals; of motions they cost far more."""
        here = self._observed.at(x)
        root, first = self._weights(here, noise)
        slopes = (first / root)[:, :, None] * here.slopes / noise
        return np.vstack([slopes.reshape(-1, x.size), np.diag(self._prior)])

    def _weights(self, here: Residuals, noise: float) -> tuple[Floats, Floats]:
        """Return (m, 1) each: how a distance counts relative to its square, and rho'."""
        z = np.sum(here.away**2, axis=1) / (noise * self._scale) ** 2
        value, first, _ = self._loss(z)
        root = np.sqrt(np.divide(value, z, out=np.ones_like(z), where=z > 0))
        return root[:, None], first[:, None]

    def _information(self, x: Floats, noise: float) -> _Information:
        here = self._observed.at(x)
        square = np.sum(here.away**2, axis=1)
        _, first, second = self._loss(square / (noise * self._scale) ** 2)
        counts = here.counts.sum(axis=1)
        # Huber's: mean slope and mean square of the force that a point exerts, along each axis
        stiff = np.sum(counts * first + 2 * square / (noise * self._scale) ** 2 * second
                       ) / counts.sum()
        slopes = here.slopes.reshape(-1, x.size) / noise
        plain = slopes.T @ slopes
        inverse, unknown = _inverse(stiff * plain + np.diag(self._prior**2),
                                    self._observed.precision**2)
        fitted = np.trace(inverse @ (stiff * plain))
        return _Information(plain, stiff, np.sum(first**2 * square) / noise**2, inverse, unknown,
                            counts.sum(), max(counts.sum() - fitted, 1.0))

    def _noise_left(self, x: Floats, noise: float) -> float:
        """Return the noise (m) that the misfit tells, with what was fitted to it accounted for."""
        here, known = self._observed.at(x), self._information(x, noise)
        if self._loss is LOSSES['linear']:
            return float(np.sqrt(np.sum(here.away**2) / known.left))
        # outliers do not move the median
        distances = np.abs(here.away[here.counts])
        return float(np.median(distances) / _MEDIAN * np.sqrt(known.size / known.left))

    def _statistics(self, x: Floats, noise: float) -> Statistics:
        if self._given is None and not self._weighed:
            noise = max(self._noise_left(x, noise), _NO_NOISE * self._observed.rod.length)
        known = self._information(x, noise)
        excess = 1.0 if self._given is None else self._excess(x, noise, known)
        # Birge's ratio, squared: what is not explained widens all that was found by it
        spread = max(excess, 1.0) if self._loss is LOSSES['linear'] else known.force / known.left
        # only of the parameters: instants are too few to tell how all else goes together
        to = known.inverse[:self._observed.n_parameters]
        scatter = long_run_covariance([one @ to.T for one in self._scores(x, noise)],
                                      spread * to @ known.plain @ to.T)
        return Statistics(*_spreads(scatter + max(excess, 1.0) * (to * self._prior**2 @ to.T),
                                    known.unknown[:len(to)]), float(noise),
                          self._freedom(known), excess)

    def _freedom(self, known: _Information) -> float:
        """Return how many of the numbers that are seen, or known before, nothing was fitted to."""
        told = self._prior.size - known.unknown.shape[1]
        return max(float(known.size + np.count_nonzero(self._prior) - told), 1.0)

    def _excess(self, x: Floats, noise: float, known: _Information) -> float:
        """Return chi-square over its degrees of freedom, for the noise as stated."""
        if self._loss is not LOSSES['linear']:  # outliers are not to count
            return float((self._noise_left(x, noise) / noise) ** 2)
        away = self._observed.at(x).away
        return float((np.sum(away**2) / noise**2 + np.sum((self._prior * x) ** 2))
                     / self._freedom(known))

    def _scores(self, x: Floats, noise: float) -> list[Floats]:
        """Return (k, n) of each motion: by what its instants pull the unknowns."""
        here = self._observed.at(x)
        away = self._weights(here, noise)[1] * here.away / noise
        return [np.einsum('kmi,kmij->kj', one, slopes) for one, slopes in zip(
            self._observed.by_motion(away), self._observed.by_motion(here.slopes / noise),
            strict=True)]


def _inverse(information: Floats, least: float) -> tuple[Floats, Floats]:
    """Return the inverse (n, n) where it is known, and a basis (n, j) of where nothing is known."""
    size = np.sqrt(np.diag(information))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    none = values <= least * values.max()
    inverse = vectors[:, ~none] / values[~none] @ vectors[:, ~none].T / np.outer(size, size)
    unknown = vectors[:, none]
    unknown[(unknown**2).sum(axis=1) <= np.sqrt(least)] = 0.0
    return inverse, unknown


def _spreads(covariance: Floats, unknown: Floats) -> tuple[Floats, Floats]:
    """Return deviations (n,) and correlations (n, n), those of what is not known infinite."""
    nothing = unknown.any(axis=1)
    deviations = np.where(nothing, np.inf, np.sqrt(np.diag(covariance)))
    joint = np.where(np.outer(nothing, nothing), unknown @ unknown.T,
                     np.where(np.outer(~nothing, ~nothing), covariance, 0.0))
    size = np.sqrt(np.diag(joint))
    correlations = np.divide(joint, np.outer(size, size), out=np.eye(size.size),
                             where=np.outer(size, size) > 0)
    np.fill_diagonal(correlations, 1.0)
    return deviations, np.clip(correlations, -1.0, 1.0)


def long_run_covariance(series: Sequence[Floats], alone: Floats) -> Floats:
    """Return the covariance (n, n) of the sum of all series, not less than `alone` (n, n).

    What a model does not know, in a motion, lasts: residuals of one instant are like those of the
    next, and like those of other points. Each instant then tells less than its points do. What a
    residual pulls the unknowns by is summed over the points of an instant: a series (k, n) for each
    motion. The covariance of the sum over all instants is a Bartlett estimate (Newey and West 1987,
    Econometrica 55), its width by Andrews (1991, Econometrica 59, Eq. 5.3, 6.2 and 6.4); `alone` is
    that of what is independent.
    """
    values, vectors = np.linalg.eigh(alone)
    seen = values > _NOTHING * values[-1]
    root = np.sqrt(values[seen])
    units = [pulls @ vectors[:, seen] / root for pulls in series if len(pulls) > 1]
    if not units:
        return alone
    sizes, axes = np.linalg.eigh(_long_run(units))
    more = vectors[:, seen] * root @ axes
    result: Floats = alone + more * np.maximum(sizes - 1.0, 0.0) @ more.T
    return result


def _long_run(series: Sequence[Floats]) -> Floats:
    """Return the covariance (n, n) of the sum of all vectors (k, n), each like its neighbors."""
    shortest, instants = min(map(len, series)), sum(map(len, series))
    width = min(_andrews(series), shortest - 1.0)
    out = sum((one.T @ one for one in series), np.zeros((series[0].shape[1],) * 2))
    for lag in range(1, int(np.ceil(width)) + 1):
        between = sum((one[lag:].T @ one[:-lag] for one in series), np.zeros_like(out))
        out += max(1.0 - lag / (width + 1.0), 0.0) * (between + between.T)
    # at the minimum all pulls add up to nothing, which takes that from the estimate on the average
    share = (width + 1.0) / instants
    # and an estimate from few instants that are apart is uncertain itself: of Student's t
    freedom = max(_FREEDOM / share, _LEAST_FREEDOM)
    return out / (1.0 - share + share**2 / 3) * freedom / (freedom - 2.0)


def _andrews(series: Sequence[Floats]) -> float:
    """Return the best width of Bartlett's kernel, from first-order autoregressions."""
    before = sum(np.sum(one[:-1] ** 2, axis=0) for one in series)
    both = sum(np.sum(one[1:] * one[:-1], axis=0) for one in series)
    rho = np.clip(np.divide(both, before, out=np.zeros_like(both), where=before > 0),
                  -_LARGEST, _LARGEST)
    power = before**2
    bend = np.sum(4 * rho**2 * power / ((1 - rho) ** 6 * (1 + rho) ** 2))
    size = np.sum(power / (1 - rho) ** 4)
    length = np.mean([len(one) for one in series])
    return float(_WIDTH * (bend / size * length) ** (1 / 3)) if size > 0 else 0.0


class Mixture(NamedTuple):
    """How m residuals of one look fit: a mixture of a normal distribution and even outliers."""

    weights: Floats      # (m,) probabilities of the points to belong to the DLO
    scale: float         # noise by which they were weighed, m
    most_likely: Floats  # (k,) most likely values of what moves all points of the look together
    inner: Floats        # (k, k) their covariance
    misfit: float        # root mean square distance, weighed, m
    residual: float      # chi-square of the weighed distances after that, by the noise as stated
    degrees: float       # its degrees of freedom

    @property
    def outliers(self) -> float:
        """Mean probability of the points not to belong to the DLO."""
        return float(1 - self.weights.mean())


def mixture(away: Floats, rows: Floats, noise: float, outliers: float, length: float) -> Mixture:
    """Return the Mixture of distances (m, d), m.

    Their slopes (m, d, k) are by what is another one in each look, normal of unit variance.
    """
    weights, square, likely, inner, scale = _most_likely(away, rows, noise, 0.0, outliers,
                                                         _ABOUT * length)
    total = max(float(weights.sum()), np.finfo(float).tiny)
    return Mixture(weights, scale, likely, inner,
                   float(np.sqrt(weights @ np.sum(away**2, axis=1) / total)),
                   float(weights @ square) / noise**2,
                   max(away.shape[1] * total - rows.shape[2], 1.0))


def mixture_cost(away: Floats, rows: Floats, scale: float, outliers: float,
                 length: float) -> float:
    """Return minus the logarithm of the likelihood of distances, up to a constant."""
    d = away.shape[1]
    _, square, likely, _, _ = _most_likely(away, rows, 0.0, scale, outliers, _ABOUT * length)
    more = 0.5 * float(likely @ likely)
    if outliers == 0:
        return 0.5 * float(square.sum()) / scale**2 + more
    # for each point -log((1 - e) N(r) + e / V), up to a constant
    of_dlo = -0.5 * square / scale**2
    none = np.log(outliers / (1 - outliers)) + d * np.log(
        np.sqrt(2 * np.pi) * scale / (_ABOUT * length))
    return -float(np.logaddexp(of_dlo, none).sum()) + more


@kernel
def _most_likely(away: Floats, rows: Floats, noise: float, scale: float, outliers: float,
                 side: float) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Return which points are likely the DLO's, and what is the look's own, searched in turn.

    First with a scale by the median of the squares, so that a large displacement of all points
    makes no outliers of them. Shapes: away (m, d), rows (m, d, k).
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
