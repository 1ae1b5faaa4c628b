# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a cross-section is looked at to see what yields: its fibers, and its layers in torsion.

All in units of the section: heights over the neutral axes and distances from the middle are 1 at
the surface. A section is symmetric and so is what bending does to it: the half above one axis
stands for both, and what one mirror image of a fiber does, the other three may do too, so that
bending in a plane of symmetry stays in it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from dlo_planner.model.arrays import Floats

KINDS = ('round', 'tube', 'rectangular')
_RINGS, _MOST_AROUND, _IN_RINGS = 8, 32, 128
_ROWS, _STEP = 89, 35  # of a lattice: of all with up to 96 rows, among those of smallest errors
_LAYERS = 24


@cache
def fibers(kind: str, bore: float = 0.0) -> tuple[Floats, Floats]:
    """Return the heights (J, 2) of J fibers over the axes n and b, and their weights (J,).

    Elastic bending is exact: the sums of weight times height squared are 1 for both axes, that of
    the product of the heights is 0. `docs/validation.md` says how near yielding comes to the
    continuous section.

    Parameters
    ----------
    kind : str
        One of KINDS.
    bore : float, optional
        Radius of a tube's bore as a part of the outer one.
    """
    heights, weights = _in_square() if kind == 'rectangular' else _in_ring(bore)
    return heights, weights / (weights @ heights[:, 0] ** 2)


@cache
def layers(measure: str, bore: float = 0.0) -> tuple[Floats, Floats]:
    """Return the heights (J,) of J layers that are all strained alike, and their weights (J,).

    The sum of weight times height squared is 1.

    Parameters
    ----------
    measure : str
        How much of the section is at a height: 'rectangular', 'round', 'tube': bending in one
        plane; 'torsion': around the middle of a round one.
    bore : float, optional
        As for `fibers`.
    """
    inside = bore if measure == 'torsion' else 0.0
    heights = inside + (1 - inside) * (np.arange(_LAYERS) + 0.5) / _LAYERS
    if measure == 'torsion':
        weights = heights
    elif measure == 'rectangular':
        weights = np.ones(_LAYERS)
    else:
        weights = np.sqrt(1 - heights**2) - np.sqrt(np.maximum(bore**2 - heights**2, 0.0))
    return heights, weights / (weights @ heights**2)


def _in_ring(bore: float) -> tuple[Floats, Floats]:
    """Return heights and weights by Gauss' rule along the radius, evenly around, in turns."""
    rings = max(2, int(np.ceil(_RINGS * (1 - bore))))
    around = min(4 * round(_IN_RINGS / rings / 4), _MOST_AROUND)
    points, parts = np.polynomial.legendre.leggauss(rings)
    radii = bore + (1 - bore) * (points + 1) / 2
    # every other ring is turned by half of a step: of all fibers, no two rows yield at once
    heights, weights = [], []
    for ring, (radius, part) in enumerate(zip(radii, parts, strict=True)):
        turn = np.pi / around * np.arange(0.5 * (ring % 2), around / 2 + 0.1)
        heights.append(radius * np.column_stack([np.sin(turn), np.cos(turn)]))
        weights.append(np.full(turn.size, part * radius / 2))
        if ring % 2 == 0:  # both ends are on an axis
            heights[-1][[0, -1], [0, 1]] = 0.0
            weights[-1][[0, -1]] /= 2
    return _mirrored(np.vstack(heights), np.concatenate(weights))


def _in_square() -> tuple[Floats, Floats]:
    """Return heights and weights on a lattice in a quarter, no two in a row, and its mirror image.

    Such a lattice has as many rows and columns as points (a lattice rule of rank 1).
    """
    row = np.arange(_ROWS)
    quarter = np.column_stack([row + 0.5, row * _STEP % _ROWS + 0.5]) / _ROWS
    return _mirrored(quarter, np.ones(_ROWS))


def _mirrored(quarter: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return fibers with their mirror images: each next to its own, so that sums vanish exactly."""
    return (np.stack([quarter, quarter * [1, -1]], axis=1).reshape(-1, 2), np.repeat(weights, 2))
