# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Colors that tell how hard a DLO is bent: a colormap that is legible to the color-blind too."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance
from dlo_planner.plan.checks import yield_shares

COLORINGS = ('curvature', 'yield', 'tension')
ALERT = (0.85, 0.11, 0.38)  # what is beyond its limit; nothing in viridis comes near to it
GRAY = (0.6, 0.6, 0.6)
ORANGE = (0.9, 0.62, 0.0)        # these three: Okabe and Ito's palette for all kinds of sight
SKY_BLUE = (0.34, 0.71, 0.91)
VERMILION = (0.84, 0.37, 0.0)
_SMALLEST = 1e-9  # 1/m: what bends less is straight
_SLACK = 1e-12    # N: what is pulled by less is not

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
    # What the brightest color stands for, in the unit of `label`, and the darkest
    top: float = 1.0
    label: str = 'part of the yield limit'  # What is colored, with its unit
    low: float = 0.0


def viridis(share: ArrayLike) -> Floats:
    """Return colors (n, 3) of shares (n,): 0 violet, 1 yellow, beyond it ALERT, nan gray."""
    share = np.asarray(share, dtype=float)
    steps = np.linspace(0.0, 1.0, len(_VIRIDIS))
    colors = np.column_stack([np.interp(share, steps, channel) for channel in _VIRIDIS.T])
    colors[share > 1.0] = ALERT
    colors[np.isnan(share)] = GRAY
    return colors


def coloring(shape: Shape, color: str = 'curvature',
             span: tuple[float, float] | None = None) -> Coloring:
    """Return the Coloring of a Shape; `span`: what the darkest and the brightest color stand for.

    'curvature' up to `Rod.max_bend_curvature` where there is one, 'yield' up to the limit,
    'tension' in N (< 0: pushed). Gray is what is not known.
    """
    instance('shape', shape, Shape)
    if choice('color', color, COLORINGS) == 'yield':
        return _by_yield(shape)
    low, top = color_span([shape], color) if span is None else span
    if color == 'tension':
        values = _tension(shape)
        return Coloring(viridis(np.minimum((values - low) / (top - low), 1.0)),
                        f'tension: {low:.3g} to {top:.3g} N' if np.isfinite(values).all()
                        else 'tension: not known', top, 'tension [N]', low)
    share = np.linalg.norm(shape.strains[:, 1:], axis=1) / top
    limited = _limit(shape) is not None
    return Coloring(viridis(share if limited else np.minimum(share, 1.0)),
                    f'curvature: 0 to {top:.3g} 1/m' + (' (limit)' if limited else ''), top,
                    'curvature [1/m]')


def color_span(shapes: Iterable[Shape], color: str) -> tuple[float, float]:
    """Return what the darkest and the brightest color of all Shapes together stand for."""
    shapes = tuple(shapes)
    if color == 'tension':
        values = np.concatenate([_tension(shape) for shape in shapes])
        low, top = (float(one(values, initial=0.0)) for one in (np.fmin.reduce, np.fmax.reduce))
        return low, max(top, low + _SLACK)
    limits = [limit for shape in shapes if (limit := _limit(shape)) is not None]
    return 0.0, max(limits) if limits else max(_SMALLEST, *(
        float(np.linalg.norm(shape.strains[:, 1:], axis=1).max()) for shape in shapes))


def _limit(shape: Shape) -> float | None:
    return None if shape.rod is None else shape.rod.max_bend_curvature


def _tension(shape: Shape) -> Floats:
    """Return the tension (N_L + 1,) of a Shape in N; nan where it is not known."""
    try:
        return shape.tension
    except InvalidTask:  # in motion, not converged, or from a file
        return np.full(len(shape.s), np.nan)


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
