# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Oscillators whose frequencies and axes change slowly, step by step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


class Oscillators(NamedTuple):
    """The m modes of a DLO at t + 1 instants of a time law; the last three are for `vibrated`.

    Attributes
    ----------
    times : ndarray, shape (t + 1,)
        Times in s.
    parameters : ndarray, shape (t + 1,)
        Parameters of the leg.
    rates : ndarray, shape (t, m)
        Angular frequencies between the instants, 1/s.
    damping : ndarray, shape (t, m)
        Damping ratios.
    turns : ndarray, shape (t, m, m)
        How the modes turn into one another.
    """

    times: Floats
    parameters: Floats
    rates: Floats
    damping: Floats
    turns: Floats


@kernel
def turned(turning: np.ndarray, place: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return (t, m, m) the rotations (1 + A)^-1 (1 - A) of skew matrices A = half turning[place].

    Gauss elimination without pivots, which never vanish: the symmetric part of 1 + A is 1.

    Args:
        turning: (n, m, m) skew; place: (t,) indices into it; half: (t,)
    """
    modes = turning.shape[1]
    out = np.empty((half.size, modes, modes))
    left = np.empty((modes, modes))
    for t in range(half.size):
        for i in range(modes):
            for j in range(modes):
                one = 1.0 if i == j else 0.0
                left[i, j] = one + half[t] * turning[place[t], i, j]
                out[t, i, j] = 2.0 * one - left[i, j]
        for k in range(modes):
            for i in range(modes):
                if i == k:
                    continue
                factor = left[i, k] / left[k, k]
                for j in range(k, modes):
                    left[i, j] -= factor * left[k, j]
                for j in range(modes):
                    out[t, i, j] -= factor * out[t, k, j]
        for i in range(modes):
            for j in range(modes):
                out[t, i, j] /= left[i, i]
    return out


@kernel
def vibrated(step: float, rates: np.ndarray, damping: np.ndarray, turns: np.ndarray,
             force: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return y and y'/w (2, c, t + 1, m) of m oscillators under c sets of forces.

    y'' + 2 zeta w y' + w^2 y = force. Exact for a force that is steady in each step. Damping ratios
    above 0.99 count as 0.99.

    Args:
        step: of time, s
        rates: (t, m) angular frequencies w in each step, 1/s; damping: (t, m) ratios zeta
        turns: (t, m, m) rotations of the coordinates from the axes of a step to those of the next
        force: (c, t, m) per mass
        begin: (2, c, m) y and y'/w before the first step
    """
    count, modes = rates.shape
    cases = force.shape[0]
    out = np.zeros((2, cases, count + 1, modes))
    out[:, :, 0] = begin
    place, speed = begin[0].copy(), begin[1] * rates[0]
    there, fast = np.empty(modes), np.empty(modes)
    for k in range(count):
        for m in range(modes):
            w = rates[k, m]
            zeta = min(damping[k, m], 0.99)
            free = np.sqrt(1.0 - zeta * zeta)
            decay = np.exp(-zeta * w * step)
            cosine, sine = decay * np.cos(free * w * step), decay * np.sin(free * w * step) / free
            for c in range(cases):
                still = force[c, k, m] / (w * w)
                away, rate = place[c, m] - still, speed[c, m] / w
                place[c, m] = still + away * cosine + (rate + zeta * away) * sine
                speed[c, m] = w * (rate * cosine - (away + zeta * rate) * sine)
        for c in range(cases):
            for i in range(modes):
                there[i] = fast[i] = 0.0
                for j in range(modes):
                    there[i] += turns[k, i, j] * place[c, j]
                    fast[i] += turns[k, i, j] * speed[c, j]
            for i in range(modes):
                place[c, i] = there[i]
                speed[c, i] = fast[i]
                out[0, c, k + 1, i] = there[i]
                out[1, c, k + 1, i] = fast[i] / rates[k, i]
    return out
