# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where ever finer chains lead to, and how well that is known.

A chain of n cells is off by a / n^2 (steps of time shrink with n as their order asks). The limit is
found by least squares over all chains, because contacts add noise: whether one falls on a joint or
on the middle of a piece changes with n. This noise is of the size of the error, 1 / n^2, so squares
are weighted by n^4. That is Richardson's extrapolation for noisy data (Eca and Hoekstra, Journal of
Computational Physics 262, 2014). What the limit changes where one of the chains is left out says
how well it is known: the jackknife (Efron and Stein, Annals of Statistics 9, 1981).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def limit(cells: Sequence[int], found: Floats) -> Floats:
    """Return the limit (...) of what chains of so many cells found (chains, ...)."""
    errors = 1 / np.square(np.asarray(cells, dtype=float))
    trusted = errors**-2 / (errors**-2).sum()
    mean = trusted @ errors
    away = errors - mean
    return np.tensordot(trusted * (1 - mean * away / (trusted @ away**2)), found, axes=1)


def doubt(cells: Sequence[int], found: Floats) -> float:
    """Return two standard errors of the limit (..., 3) of places, the largest of all places, m.

    Raises:
        ValueError: fewer than three chains
    """
    if len(cells) < 3:
        raise ValueError(f'cells = {tuple(cells)}: expected three chains at least')
    kept = range(len(cells))
    without = np.array([limit([cells[k] for k in kept if k != left],
                              np.delete(found, left, axis=0)) for left in kept])
    moved = without - without.mean(axis=0)
    return 2 * largest(np.sqrt((1 - 1 / len(cells)) * np.square(moved).sum(axis=0)))


def largest(differences: Floats) -> float:
    """Return the length of the longest of vectors (..., 3)."""
    return float(np.linalg.norm(differences, axis=-1).max())
