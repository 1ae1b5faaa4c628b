# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A scene as a table of text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Hull,
    Mesh,
    Obstacle,
    Plane,
    Sheet,
    Sphere,
)
from dlo_planner.scene.content import counted


def table_of(head: str, obstacles: Sequence[Obstacle], cutouts: Mapping[str, CutOut],
             notes: Sequence[str]) -> str:
    """Return the text: a head, a line for each obstacle and for each cut-out, then the notes."""
    lines = [head]
    rows = [('name', 'kind', 'at [m]', 'size [m]', 'friction')] if obstacles else []
    rows += [(one.name, type(one).__name__, _numbers(_place(one)), _size(one),
              f'{one.friction:.3g}') for one in obstacles]
    lines += _columns(rows)
    lines += _columns([('cut-out', 'at and along', 'size [m]'), *(
        (name, ','.join(_number(value) for value in (*hole.center, *hole.normal)), _room(hole))
        for name, hole in cutouts.items())] if cutouts else [])
    return '\n'.join([*lines, *(f'note: {note}' for note in notes)])


def _columns(rows: Iterable[tuple[str, ...]]) -> list[str]:
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ['  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows]


def _number(value: float) -> str:
    """Return a number with six decimals at most: micrometers."""
    return f'{round(float(value), 6) + 0.0:.6f}'.rstrip('0').rstrip('.')


def _numbers(values: Floats) -> str:
    return ' '.join(map(_number, values))


def _place(one: Obstacle) -> Floats:
    """Return where an obstacle is, (3,) m: its center, the middle of what is long."""
    if isinstance(one, Plane):
        return one.point
    if isinstance(one, Sphere):
        return one.center
    if isinstance(one, Capsule | Cylinder):
        return 0.5 * (one.start + one.end)
    if isinstance(one, Mesh | Hull):
        corners = one.surface.vertices @ one.pose.rotation.T + one.pose.position
        middle: Floats = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return middle
    return one.pose.position


def _size(one: Obstacle) -> str:
    """Return the size of an obstacle in words."""
    if isinstance(one, Plane):
        return f'normal {_numbers(one.normal)}'
    if isinstance(one, Sphere):
        return f'radius {_number(one.radius)}'
    if isinstance(one, Capsule | Cylinder):
        long = float(np.linalg.norm(one.end - one.start))
        return f'radius {_number(one.radius)}, long {_number(long)}'
    if isinstance(one, Box):
        return _by(one.size)
    if isinstance(one, Ellipsoid):
        return _by(2 * one.half_axes)
    if isinstance(one, Sheet):
        holes = f', {counted(len(one.cutouts), "hole")}' if one.cutouts else ''
        return _by((one.thickness, one.width, one.height)) + holes
    extent = np.ptp(one.surface.vertices, axis=0)
    return f'{_by(extent)}, {len(one.surface.faces)} triangles'


def _room(hole: CutOut) -> str:
    if hole.radius is not None:
        return f'radius {_number(hole.radius)}'
    if hole.width is None or hole.height is None:
        return 'not known'
    return _by((hole.width, hole.height))


def _by(sizes: Iterable[float]) -> str:
    return ' x '.join(map(_number, sizes))
