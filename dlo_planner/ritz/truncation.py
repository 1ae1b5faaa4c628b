# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a shape can be off because its mesh and its series end: a figure, not a bound."""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

OF_AN_ARC = 12  # h^3 |u'| / 12: how far an arc's end is off
_TWISTED = np.pi  # with more, elements misplace by turns, not by gradients


@kernel
def truncation(lengths: Floats, strains: Floats, natural: Floats, scale: Floats,
               basis: Floats) -> float:
    """Return how far, in m, the free end may be off by mesh and series.

    Arcs of constant strain misplace the end of an element by h^3 |u'| / 12, and a series that ends
    too early by what its last two terms still do.
    """
    n, terms = basis.shape
    last = np.zeros(3)  # of the series, as strains
    total = lengths[0]
    mesh = 0.0
    for e in range(1, n):
        h = lengths[e]
        total += h
        change = 0.0
        for i in range(3):
            change += abs(strains[e, i] - natural[e, i] - strains[e - 1, i] + natural[e - 1, i])
        mesh += h * h * h * change / (0.5 * (h + lengths[e - 1]))
    series = 0.0
    for j in range(max(terms - 2, 0), terms):
        last[:] = 0.0
        for e in range(n):
            for i in range(3):
                last[i] += (basis[e, j] * lengths[e] * (strains[e, i] - natural[e, i])
                            / scale[e, i])
        for i in range(3):
            series += abs(last[i]) * scale[0, i]
    if terms:
        series *= total * np.sqrt(total) / terms**2
    return mesh / OF_AN_ARC + series


def very_twisted(turn: Any) -> Any:
    """Whether `truncation` says too little of a DLO with so much natural twist, in rad."""
    return np.abs(turn) > _TWISTED
