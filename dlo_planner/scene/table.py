# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A scene as a table of text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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


def table_of(obstacles: Sequence[Obstacle], cutouts: Sequence[CutOut],
             notes: Sequence[str]) -> str:
    """Return the text: a line for each obstacle and for each cut-out, then the notes."""
    lines = [f'{_count(len(obstacles), "obstacle")}, {_count(len(cutouts), "cut-out")}']
    rows = [('name', 'kind', 'at [m]', 'size [m]', 'friction')] if obstacles else []
    rows += [(one.name, type(one).__name__, _numbers(_place(one)), _size(one),
              f'{one.friction:.3g}') for one in obstacles]
    lines += _columns(rows)
    for hole in cutouts:
        size = (f'radius {hole.radius:.4g} m' if hole.radius is not None else 'no size'
                if hole.width is None or hole.height is None else
                f'{hole.width:.4g} x {hole.height:.4g} m')
        at = ','.join(_number(value) for value in (*hole.center, *hole.normal))
        lines.append(f'cut-out {at}  {size}')
    return '\n'.join([*lines, *(f'note: {note}' for note in notes)])


def _count(count: int, what: str) -> str:
    return f'{count} {what}{"" if count == 1 else "s"}'


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
        holes = f', {_count(len(one.cutouts), "hole")}' if one.cutouts else ''
        return _by((one.thickness, one.width, one.height)) + holes
    extent = np.ptp(one.surface.vertices, axis=0)
    return f'{_by(extent)}, {len(one.surface.faces)} triangles'


def _by(sizes: Iterable[float]) -> str:
    return ' x '.join(map(_number, sizes))
