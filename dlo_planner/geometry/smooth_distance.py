# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A smooth distance from triangles, for contact: cubic B-splines over a grid about their surface.

Where a DLO goes from facet to facet its exact distance has a second derivative that jumps between
0 and the inverse of the radius; no Newton iteration follows that over something round. The spline
has two continuous derivatives. It is there about the places that the axis of a DLO may have in
contact. Farther away coarser splines tell how far at least, at a tenth of what the exact distance
costs: nothing touches there, but a look along a DLO goes on from it as far as it is away. Where
none is the exact distance is used.

Coefficients are the samples of the exact distance less a part of their second differences. A sixth
of those makes the spline exact to the fourth order; a little more lets it be too small rather than
too large beside what is convex. At creases nothing is taken away: there a spline of the samples
themselves is too small by itself. What is left by which it is too large anywhere is measured at the
middles of all cells where an axis may bear, and subtracted everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_planner.geometry.bvh import Trees, nearest_on_surface, signed_from_surface
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints

_CELLS = 8           # along a block
_SIDE = _CELLS + 3   # coefficients along a block
_PER_RADIUS = 2.0    # cells in the DLO's radius: an edge is a bow of three cells then
_BELOW, _BEYOND = 1.0, 3.0  # cells beyond the places of an axis in contact, towards 0 and outwards
_MOST_BLOCKS = 6000  # with coefficients, 32 MB; where more were needed the cells are larger
_MOST_LOOKED_AT = 2_000_000  # blocks of the whole box
_LARGER = 1.25       # times: the next size of cells that is tried
_COARSER = 4.0       # times: the cells of the next spline outwards
_FAR = 0.5           # of the size of a surface: so far away there is a spline
_CONVEX = 1.0 / 6.0 + 0.03  # of a second difference that is positive
_BEARS = 0.5         # cells: so near to the places of an axis in contact the error is measured


class Grids(Record):
    """Splines about several surfaces; G grids, B blocks with coefficients."""

    low: Floats  # (G, 3) corner of the grid, m
    step: Floats  # (G,) size of its cells, m
    count: Ints  # (G, 3) blocks along each axis
    first: Ints  # (G,) where its blocks begin in `block`
    further: Ints  # (G,) how many grids behind it are coarser ones about the same surface
    block: Ints  # (n,) number of the coefficients of each block, -1: none
    weight: NDArray[np.float32]  # (B, 11, 11, 11) coefficients, m


class Grid(NamedTuple):
    """What `Grids` has of one surface, and by how much it is wrong."""

    low: Floats
    step: float
    counts: Ints
    further: int
    block: Ints
    weight: NDArray[np.float32]
    error: float  # by how much it may be less than the exact distance, m; it is never more


def grids_of(trees: Trees, radii: tuple[float, float]) -> list[Grid]:
    """Return splines about a surface for a DLO with radii between two, m, both above 0.

    The first one is where the DLO touches, the others are coarser and farther away.
    """
    far = _FAR * float(np.ptp(trees.box[0].reshape(2, 3), axis=0).max())
    step = radii[0] / _PER_RADIUS
    grid = _grid(trees, step, radii[1], radii[0] - _BEARS * step, radii[1] + _BEARS * step)
    grids, beyond = [grid], radii[1] + _BEYOND * grid.step
    while beyond < far:
        grid = _grid(trees, _COARSER * grid.step, beyond, beyond, np.inf)
        grids.append(grid)
        beyond += _BEYOND * grid.step
    return [one._replace(further=len(grids) - 1 - k) for k, one in enumerate(grids)]


def _grid(trees: Trees, step: float, outer: float, least: float, most: float) -> Grid:
    """Return a spline with cells of a size, m, or larger ones, to some cells beyond `outer`, m.

    Its error is measured where it is `least` to `most` m away.
    """
    low, high = np.array(trees.box[0, :3]), np.array(trees.box[0, 3:])
    while True:
        beyond = outer + _BEYOND * step
        corner = low - beyond - _CELLS * step
        count = np.ceil((high - low + 2 * (beyond + _CELLS * step)) / (_CELLS * step)).astype(
            np.int64)
        if count.prod() <= _MOST_LOOKED_AT:
            block, active = _blocks(trees, corner, step, count, -_BELOW * step, beyond)
            if active <= _MOST_BLOCKS:
                break
        step *= _LARGER
    weight = np.zeros((active, _SIDE, _SIDE, _SIDE), dtype=np.float32)
    _fill(trees, corner, step, count, block, weight)
    none = np.zeros(1, dtype=np.int64)
    under, over = _errors(trees, Grids(corner[None], np.array([step]), count[None], none, none,
                                       block, weight), least, most)
    weight -= np.float32(max(over, 0.0))
    return Grid(corner, step, count, 0, block, weight, max(over, 0.0) - min(under, 0.0))


def joined(grids: list[Grid]) -> Grids:
    """Return several grids as one Record."""
    first = np.cumsum([0, *(grid.block.size for grid in grids)])[:len(grids)].astype(np.int64)
    before = np.cumsum([0, *(len(grid.weight) for grid in grids)])
    blocks = [np.where(grid.block < 0, -1, grid.block + shift)
              for grid, shift in zip(grids, before, strict=False)]
    weight = grids[0].weight if len(grids) == 1 else np.concatenate(
        [np.zeros((0, _SIDE, _SIDE, _SIDE), dtype=np.float32), *(grid.weight for grid in grids)])
    return Grids(np.array([grid.low for grid in grids]).reshape(-1, 3),
                 np.array([grid.step for grid in grids], dtype=float),
                 np.array([grid.counts for grid in grids], dtype=np.int64).reshape(-1, 3), first,
                 np.array([grid.further for grid in grids], dtype=np.int64),
                 np.concatenate([np.zeros(0, dtype=np.int64), *blocks]), weight)


@kernel
def _blocks(trees: Trees, low: Floats, step: float, count: Ints, inner: float, outer: float
            ) -> tuple[Ints, int]:
    """Return (n,) the numbers of blocks with a place `inner` to `outer` m away, and how many."""
    block = np.full(count[0] * count[1] * count[2], -1)
    active, at, middle, place = 0, 0, np.empty(3), np.empty(3)
    around = 0.5 * np.sqrt(3.0) * _CELLS * step
    for i in range(count[0]):
        for j in range(count[1]):
            for k in range(count[2]):
                middle[0] = low[0] + (i + 0.5) * _CELLS * step
                middle[1] = low[1] + (j + 0.5) * _CELLS * step
                middle[2] = low[2] + (k + 0.5) * _CELLS * step
                t, feature, square = nearest_on_surface(trees, 0, middle, outer + around, place)
                if t >= 0:
                    out = 0.0
                    for a in range(3):
                        out += (middle[a] - place[a]) * trees.normal[t, feature, a]
                    if out >= 0.0 or -np.sqrt(square) + around >= inner:
                        block[at] = active
                        active += 1
                at += 1
    return block, active


@kernel
def _fill(trees: Trees, low: Floats, step: float, count: Ints, block: Ints,
          weight: NDArray[np.float32]) -> None:
    """Fill weight (B, 11, 11, 11) with the coefficients of the blocks that have some.

    Samples are kept by blocks, for those beside each other share most of them.
    """
    slot, slots = np.full(block.size, -1), 0
    for b in range(block.size):
        if block[b] < 0:
            continue
        i, j, k = _where(b, count)
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    if not (0 <= i + di < count[0] and 0 <= j + dj < count[1]
                            and 0 <= k + dk < count[2]):
                        continue
                    other = ((i + di) * count[1] + j + dj) * count[2] + k + dk
                    if slot[other] < 0:
                        slot[other] = slots
                        slots += 1
    samples = np.full((slots, _CELLS, _CELLS, _CELLS), np.inf)
    own, p, normal, hessian = (np.empty((_SIDE + 2, _SIDE + 2, _SIDE + 2)), np.empty(3),
                               np.empty(3), np.empty((3, 3)))
    for b in range(block.size):
        if block[b] < 0:
            continue
        i, j, k = _where(b, count)
        for x in range(_SIDE + 2):
            for y in range(_SIDE + 2):
                near = np.inf
                for z in range(_SIDE + 2):
                    nx, ny, nz = _CELLS * i + x - 2, _CELLS * j + y - 2, _CELLS * k + z - 2
                    bx, by, bz = nx // _CELLS, ny // _CELLS, nz // _CELLS
                    inside = (0 <= bx < count[0] and 0 <= by < count[1] and 0 <= bz < count[2])
                    at = slot[(bx * count[1] + by) * count[2] + bz] if inside else -1
                    value = np.inf
                    if at >= 0:
                        value = samples[at, nx % _CELLS, ny % _CELLS, nz % _CELLS]
                    if value == np.inf:
                        p[0], p[1] = low[0] + nx * step, low[1] + ny * step
                        p[2] = low[2] + nz * step
                        value = signed_from_surface(trees, 0, p, near, normal, hessian)
                        if at >= 0:
                            samples[at, nx % _CELLS, ny % _CELLS, nz % _CELLS] = value
                    own[x, y, z] = value
                    near = abs(value) + 1.001 * step  # the next one is no farther away
        coefficients = weight[block[b]]
        for x in range(_SIDE):
            for y in range(_SIDE):
                for z in range(_SIDE):
                    here = own[x + 1, y + 1, z + 1]
                    bends = max(own[x, y + 1, z + 1] + own[x + 2, y + 1, z + 1] - 2.0 * here, 0.0)
                    bends += max(own[x + 1, y, z + 1] + own[x + 1, y + 2, z + 1] - 2.0 * here, 0.0)
                    bends += max(own[x + 1, y + 1, z] + own[x + 1, y + 1, z + 2] - 2.0 * here, 0.0)
                    coefficients[x, y, z] = here - _CONVEX * bends


@kernel
def _where(b, count):
    """Return the place of block b along each axis."""
    return b // (count[1] * count[2]), b // count[2] % count[1], b % count[2]


@kernel
def _errors(trees: Trees, grids: Grids, least: float, most: float) -> tuple[float, float]:
    """Return the least and the largest error in m in the middles of cells that far away."""
    p, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    low, step, count = grids.low[0], grids.step[0], grids.count[0]
    under, over = np.inf, -np.inf
    for b in range(grids.block.size):
        if grids.block[b] < 0:
            continue
        i, j, k = _where(b, count)
        for x in range(_CELLS):
            for y in range(_CELLS):
                for z in range(_CELLS):
                    p[0] = low[0] + (_CELLS * i + x + 0.5) * step
                    p[1] = low[1] + (_CELLS * j + y + 0.5) * step
                    p[2] = low[2] + (_CELLS * k + z + 0.5) * step
                    smooth = smooth_distance(grids, 0, p, normal, hessian)
                    if least <= smooth <= most:
                        exact = signed_from_surface(trees, 0, p, abs(smooth) + step, normal,
                                                    hessian)
                        under, over = min(under, smooth - exact), max(over, smooth - exact)
    if over < under:
        return 0.0, 0.0
    return under, over


@kernel
def smooth_distance(grids: Grids, g: int, p: Floats, normal: Floats, hessian: Floats) -> float:
    """Return the smooth distance in m of p (3,) from the surface of grid g; fill its derivatives.

    Beyond that grid it is what a coarser one tells, which is less than the exact distance; infinite
    where none has coefficients. Fills normal (3,), the unit vector along its slope (which has about
    the size 1), and hessian (3, 3), by which that turns.

    Args:
        p: (3,) in the frame of the surface
    """
    for level in range(1 + grids.further[g]):
        distance = _on_grid(grids, g + level, p, normal, hessian)
        if distance < np.inf:
            return distance
    return np.inf


@kernel
def _on_grid(grids, g, p, normal, hessian):
    """Return the value of one spline, infinite where it has none; fill its derivatives."""
    step = grids.step[g]
    x, y, z = ((p[0] - grids.low[g, 0]) / step, (p[1] - grids.low[g, 1]) / step,
               (p[2] - grids.low[g, 2]) / step)
    cx, cy, cz = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    bx, by, bz = cx // _CELLS, cy // _CELLS, cz // _CELLS
    if not (0 <= bx < grids.count[g, 0] and 0 <= by < grids.count[g, 1]
            and 0 <= bz < grids.count[g, 2]):
        return np.inf
    own = grids.block[grids.first[g] + (bx * grids.count[g, 1] + by) * grids.count[g, 2] + bz]
    if own < 0:
        return np.inf
    value_x, slope_x, bend_x = _basis(x - cx)
    value_y, slope_y, bend_y = _basis(y - cy)
    value_z, slope_z, bend_z = _basis(z - cz)
    i, j, k = cx - _CELLS * bx, cy - _CELLS * by, cz - _CELLS * bz
    d = d0 = d1 = d2 = d00 = d11 = d22 = d01 = d02 = d12 = 0.0
    for a in range(4):
        v = v1 = v2 = v11 = v22 = v12 = 0.0
        for b in range(4):
            s = s2 = s22 = 0.0
            for c in range(4):
                w = grids.weight[own, i + a, j + b, k + c]
                s += value_z[c] * w
                s2 += slope_z[c] * w
                s22 += bend_z[c] * w
            v += value_y[b] * s
            v1 += slope_y[b] * s
            v11 += bend_y[b] * s
            v2 += value_y[b] * s2
            v12 += slope_y[b] * s2
            v22 += value_y[b] * s22
        d += value_x[a] * v
        d0 += slope_x[a] * v
        d00 += bend_x[a] * v
        d1 += value_x[a] * v1
        d01 += slope_x[a] * v1
        d11 += value_x[a] * v11
        d2 += value_x[a] * v2
        d02 += slope_x[a] * v2
        d12 += value_x[a] * v12
        d22 += value_x[a] * v22
    size = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    if size == 0.0:  # in the middle of the body
        return np.inf
    # of the unit vector along the slope: what is along it turns nothing
    normal[0], normal[1], normal[2] = d0 / size, d1 / size, d2 / size
    h0 = d00 * normal[0] + d01 * normal[1] + d02 * normal[2]
    h1 = d01 * normal[0] + d11 * normal[1] + d12 * normal[2]
    h2 = d02 * normal[0] + d12 * normal[1] + d22 * normal[2]
    out = h0 * normal[0] + h1 * normal[1] + h2 * normal[2]
    scale = 1.0 / (size * step)
    hessian[0, 0], hessian[0, 1], hessian[0, 2] = d00 * scale, d01 * scale, d02 * scale
    hessian[1, 0], hessian[1, 1], hessian[1, 2] = d01 * scale, d11 * scale, d12 * scale
    hessian[2, 0], hessian[2, 1], hessian[2, 2] = d02 * scale, d12 * scale, d22 * scale
    bend = (h0, h1, h2)
    for i in range(3):
        for j in range(3):
            hessian[i, j] -= scale * (normal[i] * bend[j] + bend[i] * normal[j]
                                      - out * normal[i] * normal[j])
    return d


@kernel
def _basis(t):
    """Return the four cubic B-splines at t of a cell, their first and their second slopes."""
    u = 1.0 - t
    return ((u**3 / 6.0, (4.0 - 6.0 * t * t + 3.0 * t**3) / 6.0,
             (4.0 - 6.0 * u * u + 3.0 * u**3) / 6.0, t**3 / 6.0),
            (-0.5 * u * u, 1.5 * t * t - 2.0 * t, 2.0 * u - 1.5 * u * u, 0.5 * t * t),
            (u, 3.0 * t - 2.0, 3.0 * u - 2.0, t))
