# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Draws Items into axes of matplotlib, in space or from the side."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.view.axes import SIDES
from dlo_planner.view.item import Item
from dlo_planner.view.primitives import primitives

_DLO, _LINE, _FINE, _GHOST = 2.6, 1.6, 0.7, 1.2  # points
_PLATE = 3.0  # points, of a plate from the side
_EDGE = 0.5   # points, of what is solid
_DOT = 8.0    # points^2


def draw(axes: Any, items: Iterable[Item],
         side: tuple[int, int] = SIDES['x']) -> list[Any]:
    """Draw Items; return the artists, so that a film can replace them.

    Texts are left out: what they say stands in legends and color bars.
    """
    artists = []
    for item in items:
        if item.kind != 'text':
            artists += _drawn(axes, item, list(side))
    return artists


def _drawn(axes: Any, item: Item, side: list[int]) -> list[Any]:
    lines, faces, dots = primitives(item)
    artists = []
    if faces:
        artists.append(_faces(axes, faces, item, side))
    if lines and item.colors is not None and len(item.points) > 1:
        pairs = np.stack([lines[0][:-1], lines[0][1:]], axis=1)
        colors = 0.5 * (item.colors[1:] + item.colors[:-1])
        artists.append(_lines(axes, pairs, colors, _DLO, 1.0, side))
    elif lines:
        color = [0.6 * channel for channel in item.color] if faces else item.color
        artists.append(_lines(axes, lines, [color], _width(item, faces), item.alpha, side))
    if len(dots):
        columns = dots.T if axes.name == '3d' else dots[:, side].T
        artists.append(axes.scatter(*columns, s=_DOT, color=[item.color], alpha=item.alpha))
    return artists


def _width(item: Item, faces: Sequence[Floats]) -> float:
    if faces or item.kind == 'segments':
        return _EDGE if faces else _PLATE if item.group == 'plate' else _FINE
    return _GHOST if item.alpha < 1 else _LINE


def _lines(axes: Any, lines: Iterable[Floats], colors: ArrayLike, width: float,
           alpha: float, side: list[int]) -> Any:
    options = {'colors': colors, 'linewidths': width, 'alpha': alpha, 'capstyle': 'round'}
    if axes.name == '3d':
        kind = extra('mpl_toolkits.mplot3d.art3d', 'figures', 'pictures').Line3DCollection
        return axes.add_collection3d(kind(list(lines), **options))
    kind = extra('matplotlib.collections', 'figures', 'pictures').LineCollection
    return axes.add_collection(kind([np.asarray(line)[:, side] for line in lines], **options))


def _faces(axes: Any, faces: Sequence[Floats], item: Item, side: list[int]) -> Any:
    options = {'facecolors': [(*item.color, item.alpha)], 'edgecolors': 'none'}
    if axes.name == '3d':
        kind = extra('mpl_toolkits.mplot3d.art3d', 'figures', 'pictures').Poly3DCollection
        return axes.add_collection3d(kind(faces, **options))
    kind = extra('matplotlib.collections', 'figures', 'pictures').PolyCollection
    return axes.add_collection(kind([face[:, side] for face in faces], **options))
