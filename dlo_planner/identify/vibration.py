# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a DLO vibrates while its gripper stands, from clouds of its points.

Its deviation from a shape at rest is a sum of its slowest modes, each a decaying oscillation, and
of what does not move: the shape at rest is hardly known where the DLO has slipped. Both are fitted
together, linear but for a common factor of the frequencies; points that do not belong to the DLO
count little (Cauchy's weights).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.modes import Modes
from dlo_planner.direct.shape import Shape
from dlo_planner.identify.residuals import point_residuals
from dlo_planner.model.arrays import Floats

_MODES = 4         # slowest ones: two in each plane of a round DLO
_STATIC = 4        # powers of s / L along each axis, of what does not move
STATED = 1.0, 0.03  # factor of the frequencies, and its standard deviation, before it is seen
LEAST_PERIODS = 1.5  # of the slowest mode, that have to be seen
ONE_PERIOD = 1.0   # periods from which on an amplitude can be separated from what rests
_MANY = 1.64       # standard deviations, which 95 % of normal numbers do not exceed
_LEAST_CLOUDS = 8
_OF_RATE = 0.4     # of the clouds in a second: a higher frequency is not resolvable
_LEAST_POINTS = 60
_LEAST_SHARE = 0.7  # of the length, beyond which some points have to be
_FACTORS = 0.9, 1.1  # of the frequencies, at most
_TURNS = 8         # of weighing
_MEDIAN = 1.1774   # of the length of two standard normal numbers
_LEAST = 1e-9      # m, of what is left
_CAUCHY = 2.385    # standard deviations: 95 % efficient
_OWN = 6.0         # times the median distance: what is farther off is none of the DLO's points
_WEAK = 1e-6       # of the largest: keeps the fit regular where a mode is hardly seen


@dataclass(frozen=True, eq=False)
class FreeVibration:
    """The vibration of a DLO in a gripper that stands; m modes."""

    modes: Modes  # modes about the shape at rest
    stamp: float  # time in s of the state
    state: Floats  # (2, m) coordinates y of the modes then, and y' over the angular frequency
    # by what the frequencies of the modes have to be multiplied, and the standard deviation
    factor: tuple[float, float]
    misfit: float  # standard deviation, m, of what it leaves of a point along each axis
    deviation: float  # standard deviation of the amplitude, m: what noise alone would give

    @classmethod
    def of(cls, shape: Shape, clouds: Sequence[tuple[float, Floats]],
           factor: tuple[float, float] = STATED,
           periods: float = LEAST_PERIODS) -> FreeVibration | None:
        """Return the vibration that clouds show; None where they are too few to tell.

        They have to last for some `periods` of the slowest mode.
        """
        modes = shape.modes(_MODES)
        if not enough(clouds, float(modes.frequencies[0]), periods):
            return None
        length, last = shape.s[-1], clouds[-1][0]
        seen = point_residuals(shape, np.concatenate([points for _, points in clouds]))
        size = np.linalg.norm(seen.off, axis=1)
        own = size <= _OWN * np.median(size)
        if own.sum() < _LEAST_POINTS or seen.s[own].max() < _LEAST_SHARE * length:
            return None
        times = np.repeat([stamp - last for stamp, _ in clouds],
                          [len(points) for _, points in clouds])[own]
        away, s, tangents = seen.off[own], seen.s[own] / length, seen.frames[own, :, 0]
        static = (s[:, None, None, None] ** np.arange(_STATIC)) * np.eye(3)[:, :, None]
        static = _across(static.reshape(len(s), 3, -1), tangents)
        moved = _across(np.moveaxis(np.array(
            [[np.interp(s * length, modes.s, part) for part in one.T]
             for one in modes.displacements]), 2, 0).transpose(0, 2, 1), tangents)
        middle = 0.5 * (times.min() + times.max())
        found, factor, misfit, variances = _fitted(moved, static, away, times - middle, modes,
                                                   factor)
        count = 2 * len(modes)
        squares = np.tile((modes.displacements[:, -1] ** 2).sum(axis=1), 2)
        out = cls(modes, last + middle, found[:count].reshape(2, -1), factor, misfit,
                  float(np.sqrt(squares @ variances[:count])))
        return replace(out, stamp=last, state=out.after(-middle))

    @property
    def rates(self) -> Floats:
        """Angular frequencies (m,), 1/s."""
        return 2 * np.pi * self.factor[0] * self.modes.frequencies

    def after(self, seconds: float) -> Floats:
        """Return (2, m) the state some seconds later."""
        return self.decayed(self.state, seconds)

    def decayed(self, state: Floats, seconds: float) -> Floats:
        """Return (2, m) what becomes of a state (2, m) in some seconds."""
        phase = self.rates * seconds
        (y, v), decay = state, np.exp(-self.modes.damping_ratios * phase)
        result: Floats = decay * np.stack([y * np.cos(phase) + v * np.sin(phase),
                                           v * np.cos(phase) - y * np.sin(phase)])
        return result

    def end(self, state: Floats) -> Floats:
        """Return (2, 3) where the free end is off its rest in a state, m, and a quarter later."""
        return state @ self.modes.displacements[:, -1]

    @property
    def amplitude(self) -> float:
        """Largest distance of the free end from its rest in a period, m, at most."""
        ends = np.linalg.norm(self.modes.displacements[:, -1], axis=1)
        return float(np.linalg.norm(ends * np.linalg.norm(self.state, axis=0)))

    @property
    def between(self) -> tuple[float, float]:
        """Amplitude without what noise adds to it, m, and what it is at most with 95 %.

        Noise alone has the mean square `deviation`^2; about half of it is in each plane of the
        slowest modes, whose four numbers say how much it varies.
        """
        noise = self.deviation**2
        least = max(self.amplitude**2 - noise, 0.0)
        varies = np.sqrt(noise**2 / 2 + least * noise)
        return float(np.sqrt(least)), float(np.sqrt(least + _MANY * varies))


def enough(clouds: Sequence[tuple[float, Floats]], frequency: float = 0.0,
           periods: float = LEAST_PERIODS) -> bool:
    """Return whether clouds last for so many periods of a frequency (Hz), and are dense enough."""
    if len(clouds) < _LEAST_CLOUDS:
        return False
    span = clouds[-1][0] - clouds[0][0]
    return not frequency or periods <= span * frequency <= _OF_RATE * len(clouds)


def _across(vectors: Floats, tangents: Floats) -> Floats:
    """Return the part of vectors (n, 3, k) across tangents (n, 3): a line shows no other."""
    result: Floats = vectors - tangents[:, :, None] * np.einsum(
        'ni,nik->nk', tangents, vectors)[:, None]
    return result


def _fitted(moved: Floats, static: Floats, away: Floats, times: Floats,
            modes: Modes,
            known: tuple[float, float]) -> tuple[Floats, tuple[float, float], float, Floats]:
    """Return coefficients, the factor of the frequencies, what is left, m, and the variances.

    By Gauss-Newton steps for the factor, points (n, 3) weighed in each.
    """
    count, factor, weights = len(modes), known[0], np.ones(len(away))
    x, scale = np.zeros(2 * count + static.shape[2]), 1.0
    for _ in range(_TURNS):
        rates = 2 * np.pi * factor * modes.frequencies
        phase = (rates * times[:, None])[:, None]
        decay = moved * np.exp(-modes.damping_ratios * phase)
        cosine, sine = decay * np.cos(phase), decay * np.sin(phase)
        by_factor = phase / factor * (cosine * x[count:2 * count] - sine * x[:count])
        rows = np.concatenate([cosine, sine, static, by_factor.sum(axis=2)[:, :, None]], axis=2)
        normal = np.einsum('n,nik,nil->kl', weights, rows, rows)
        normal += np.diag(np.append(np.full(x.size, _WEAK * normal.diagonal().max()),
                                    (scale / known[1]) ** 2))
        right = np.einsum('n,nik,ni->k', weights, rows, away)
        right[-1] -= (scale / known[1]) ** 2 * (factor - known[0])
        step = np.linalg.solve(normal, right)
        x, change = step[:-1], step[-1]
        factor = float(np.clip(factor + change, *_FACTORS))
        left = np.linalg.norm(away - rows @ step, axis=1)
        scale = max(float(np.median(left)) / _MEDIAN, _LEAST)
        weights = 1 / (1 + (left / (_CAUCHY * scale)) ** 2)
    variances = scale**2 * np.linalg.inv(normal).diagonal()
    return x, (factor, float(np.sqrt(variances[-1]))), scale, variances
