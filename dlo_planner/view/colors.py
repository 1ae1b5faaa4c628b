# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Colors that tell how hard a DLO is bent: a colormap that is legible to the color-blind too."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance
from dlo_planner.plan.checks import yield_shares

COLORINGS = ('curvature', 'yield')
ALERT = (0.85, 0.11, 0.38)  # what is beyond its limit; nothing in viridis comes near to it
GRAY = (0.6, 0.6, 0.6)
ORANGE = (0.9, 0.62, 0.0)        # these three: Okabe and Ito's palette for all kinds of sight
SKY_BLUE = (0.34, 0.71, 0.91)
VERMILION = (0.84, 0.37, 0.0)
_SMALLEST = 1e-9  # 1/m: what bends less is straight

# viridis (Smith, van der Walt; public domain) at even steps from 0 to 1, red, green, blue.
_VIRIDIS = np.array([
    (0.267, 0.005, 0.329), (0.283, 0.100, 0.422), (0.277, 0.185, 0.490), (0.254, 0.265, 0.530),
    (0.222, 0.339, 0.549), (0.191, 0.407, 0.556), (0.164, 0.471, 0.558), (0.139, 0.534, 0.555),
    (0.121, 0.596, 0.544), (0.135, 0.659, 0.518), (0.208, 0.719, 0.473), (0.328, 0.774, 0.407),
    (0.478, 0.821, 0.318), (0.647, 0.858, 0.210), (0.825, 0.885, 0.106), (0.993, 0.906, 0.144)])


class Coloring(NamedTuple):
    """Colors of a DLO's nodes."""

    colors: Floats  # (N_L + 1, 3) Red, green, blue, 0 to 1
    caption: str  # What the colors mean, with the unit
    # What the brightest color stands for, in the unit of `label`; the darkest stands for 0
    top: float = 1.0
    label: str = 'part of the yield limit'  # What is colored, with its unit


def viridis(share: ArrayLike) -> Floats:
    """Return colors (n, 3) of shares (n,): 0 violet, 1 yellow, beyond it ALERT, nan gray."""
    share = np.asarray(share, dtype=float)
    steps = np.linspace(0.0, 1.0, len(_VIRIDIS))
    colors = np.column_stack([np.interp(share, steps, channel) for channel in _VIRIDIS.T])
    colors[share > 1.0] = ALERT
    colors[np.isnan(share)] = GRAY
    return colors


def coloring(shape: Shape, color: str = 'curvature', top: float | None = None) -> Coloring:
    """Return the Coloring of a Shape."""
    instance('shape', shape, Shape)
    if choice('color', color, COLORINGS) == 'yield':
        return _by_yield(shape)
    curvature = np.linalg.norm(shape.strains[:, 1:], axis=1)
    limit = None if shape.rod is None else shape.rod.max_bend_curvature
    if limit is not None:
        top = limit
    elif top is None:
        top = max(curvature.max(), _SMALLEST)
    share = np.minimum(curvature / top, 1.0) if limit is None else curvature / top
    return Coloring(viridis(share), f'curvature: 0 to {top:.3g} 1/m'
                    + ('' if limit is None else ' (limit)'), top, 'curvature [1/m]')


def _by_yield(shape: Shape) -> Coloring:
    rod, nodes = shape.rod, len(shape.s)
    if rod is None:
        return Coloring(viridis(np.full(nodes, np.nan)), 'part of the yield limit: rod not known')
    if not rod.yields:
        return Coloring(viridis(np.zeros(nodes)), 'part of the yield limit: this rod never yields')
    bends: Any = rod.yield_curvature or (np.inf, np.inf)  # a pair, see Rod
    limits = np.array([rod.yield_torsion or np.inf, *bends])
    share = yield_shares(shape, limits)
    worse = np.maximum(share[1:], share[:-1])  # of the two elements beside a node
    return Coloring(viridis([share[0], *worse, share[-1]]),
                    f'part of the yield limit: 0 to 1, largest {share.max():.2g}')
