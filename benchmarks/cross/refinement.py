# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where ever finer chains lead to, and how well that is known.

A chain of n cells is off by a / n^2 (steps of time shrink with n as their order asks). The limit is
found by least squares over all chains, because contacts add noise: whether one falls on a joint or
on the middle of a piece changes with n. This noise is of the size of the error, 1 / n^2, so squares
are weighted by n^4. That is Richardson's extrapolation for noisy data (Eca and Hoekstra, Journal of
Computational Physics 262, 2014). What the limit changes where one of the chains is left out says
how well it is known.
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
    """Return by how much the limit (..., 3) of places moves at most without one of the chains, m.

    Raises:
        ValueError: fewer than three chains
    """
    if len(cells) < 3:
        raise ValueError(f'cells = {tuple(cells)}: expected three chains at least')
    all_of_them, kept = limit(cells, found), range(len(cells))
    moved = [limit([cells[k] for k in kept if k != without], np.delete(found, without, axis=0))
             - all_of_them for without in kept]
    return largest(np.array(moved))


def largest(differences: Floats) -> float:
    """Return the length of the longest of vectors (..., 3)."""
    return float(np.linalg.norm(differences, axis=-1).max())
