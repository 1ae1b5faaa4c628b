# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How errors are distributed: what a fit minimizes, and what its minimum tells of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from dlo_planner.identify.observed import EXACTLY, Misfits, Observed
from dlo_planner.identify.together import spread_together
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
    """What is left at the most likely unknowns.

    Attributes
    ----------
    deviations : ndarray, shape (n,)
        Deviations of the parameters, infinite where nothing is known.
    correlations : ndarray, shape (n, n)
        Correlations of their errors; 0 between what is known and what is not.
    noise : float
        Noise in m.
    """

    deviations: Floats
    correlations: Floats
    noise: float


class _Information(NamedTuple):
    """What the points tell of n unknowns.

    Attributes
    ----------
    plain : ndarray, shape (n, n)
        J^T J of the residuals in standard deviations, without the loss.
    stiffness : float
        Mean slope of the force that a point exerts, by the loss.
    force : float
        Sum of the squares of these forces.
    size : int
        How many numbers were seen.
    """

    plain: Floats
    stiffness: float
    force: float
    size: int


class Errors:
    """The model of errors: what is minimized, and what its minimum tells.

    Parameters
    ----------
    observed : Observed
    prior : ndarray, shape (k,)
        1 / standard deviations of its parameters.
    noise : float or None
        Noise in m, or None.
    loss : Loss
        One of LOSSES.
    scale : float
        Scale of the loss, in standard deviations of the noise.
    """

    def __init__(self, observed: Observed, prior: Floats, noise: float | None, loss: Loss,
                 scale: float) -> None:
        self._observed, self._given, self._loss, self._scale = observed, noise, loss, scale
        # errors of poses are unknowns in their own standard deviations
        self._prior = np.append(prior, np.ones(observed.size - prior.size))
        self._first = noise or _FIRST_NOISE * observed.rod.length
        self._weighed = bool(self._prior.any()) or loss is not LOSSES['linear']

    @property
    def of_steps(self) -> float:
        """Error that steps of motions may have, of the length: what the noise hides."""
        return max(EXACTLY, _HIDDEN * (self._given or 0.0) / self._observed.rod.length)

    def settled(self, found: OptimizeResult) -> tuple[OptimizeResult, Statistics]:
        """Return SciPy's result and the Statistics where noise and unknowns fit each other."""
        length = self._observed.rod.length
        noise = self._first
        # the noise decides only where there is something else to weigh it against
        for _ in range(_ROUNDS if self._weighed and not self._given else 0):
            before, noise = noise, max(self._left(found.x, noise), _NO_NOISE * length)
            if abs(noise - before) <= _SETTLED * before:
                break
            found = self.minimum(found.x, noise)
        self._observed.differ_centrally()
        return found, self._statistics(found.x, noise)

    def cost(self, x: Floats) -> float:
        """Return what is minimized at x (n,), for the first guess of the noise."""
        return 0.5 * float(np.sum(self._residuals(x, self._first) ** 2))

    def minimum(self, x: Floats, noise: float | None = None) -> OptimizeResult:
        """Return SciPy's result from x (n,) on, for a noise in m; None: the first guess."""
        size = noise or self._first
        self._observed.begin()
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
        return np.append((self._roots(here, noise)[0] * here.away / noise).ravel(),
                         self._prior * x)

    def _slopes(self, x: Floats, noise: float) -> Floats:
        """Return the derivatives of the residuals; of motions they cost far more."""
        here = self._observed.at(x)
        root, first = self._roots(here, noise)
        slopes = (first / root)[:, :, None] * here.slopes / noise
        return np.vstack([slopes.reshape(-1, x.size), np.diag(self._prior)])

    def _roots(self, here: Misfits, noise: float) -> tuple[Floats, Floats]:
        """Return (m, 1) each: how a distance counts relative to its square, and rho'."""
        z = np.sum(here.away**2, axis=1) / (noise * self._scale) ** 2
        value, first, _ = self._loss(z)
        root = np.sqrt(np.divide(value, z, out=np.ones_like(z), where=z > 0))
        return root[:, None], first[:, None]

    def _information(self, x: Floats, noise: float) -> _Information:
        here = self._observed.at(x)
        z = np.sum(here.away**2, axis=1) / (noise * self._scale) ** 2
        _, first, second = self._loss(z)
        counts = here.counts.sum(axis=1)
        # Huber's: mean slope and mean square of the force that a point exerts, along each axis
        stiff = np.sum(counts * first + 2 * z * second) / counts.sum()
        slopes = here.slopes.reshape(-1, x.size) / noise
        plain = slopes.T @ slopes
        force = np.sum(first**2 * np.sum(here.away**2, axis=1)) / noise**2
        return _Information(plain, stiff, force, counts.sum())

    def _left(self, x: Floats, noise: float) -> float:
        """Return the noise (m) that the misfit tells, with what was fitted to it accounted for."""
        here = self._observed.at(x)
        plain, stiff, _, count = self._information(x, noise)
        inverse, _ = self._inverse(stiff * plain + np.diag(self._prior**2))
        fitted = np.trace(inverse @ (stiff * plain))
        left = max(count - fitted, 1.0)
        if self._loss is LOSSES['linear']:
            return float(np.sqrt(np.sum(here.away**2) / left))
        # outliers do not move the median
        distances = np.abs(here.away[here.counts])
        return float(np.median(distances) / _MEDIAN * np.sqrt(count / left))

    def _statistics(self, x: Floats, noise: float) -> Statistics:
        if self._given is None and not self._weighed:
            noise = max(self._left(x, noise), _NO_NOISE * self._observed.rod.length)
        plain, stiff, force, count = self._information(x, noise)
        prior = np.diag(self._prior**2)
        inverse, unknown = self._inverse(stiff * plain + prior)
        fitted = np.trace(inverse @ (stiff * plain))
        spread = 1.0 if self._loss is LOSSES['linear'] else force / max(count - fitted, 1.0)
        # only of the parameters: instants are too few to tell how all else goes together
        to = inverse[:self._observed.n_parameters]
        pulls = spread_together([one @ to.T for one in self._pulls(x, noise)],
                                spread * to @ plain @ to.T)
        return Statistics(*_told(pulls + to @ prior @ to.T, unknown[:len(to)]), float(noise))

    def _pulls(self, x: Floats, noise: float) -> list[Floats]:
        """Return (k, n) of each motion: by what its instants pull the unknowns."""
        here = self._observed.at(x)
        away = self._roots(here, noise)[1] * here.away / noise
        return [np.einsum('kmi,kmij->kj', one, slopes) for one, slopes in zip(
            self._observed.of_motions(away), self._observed.of_motions(here.slopes / noise),
            strict=True)]

    def _inverse(self, information: Floats) -> tuple[Floats, Floats]:
        return _inverse(information, self._observed.precision**2)


def _inverse(information: Floats, least: float) -> tuple[Floats, Floats]:
    """Return the inverse (n, n) where it is known, and a basis (n, j) of what nothing is known of.

    Shapes: information (n, n).
    """
    size = np.sqrt(np.diag(information))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    none = values <= least * values.max()
    inverse = vectors[:, ~none] / values[~none] @ vectors[:, ~none].T / np.outer(size, size)
    unknown = vectors[:, none]
    unknown[(unknown**2).sum(axis=1) <= np.sqrt(least)] = 0.0
    return inverse, unknown


def _told(covariance: Floats, unknown: Floats) -> tuple[Floats, Floats]:
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
