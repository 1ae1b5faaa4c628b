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
themselves is too small by itself. Where an axis may bear, what is left by which it is too large is
measured in the middles of the cells, and subtracted from the coefficients around them.

A block of coefficients is filled when something first comes there: a DLO passes few of the blocks
of a large surface, and all of them would take as long as thousands of its steps. Each coefficient
depends on distances around it alone, not on what was filled before.
"""

from __future__ import annotations

from mmap import mmap
from typing import Any, NamedTuple

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
# With coefficients, 32 MB if all were filled; where more were needed the cells are larger. (Smaller
# ones than facets need would follow each edge between two, as the exact distance does.)
_MOST_BLOCKS = 6000
_MOST_LOOKED_AT = 2_000_000  # blocks of the whole box
_LARGER = 1.25       # times: the next size of cells that is tried
_COARSER = 4.0       # times: the cells of the next spline outwards
_FAR = 0.5           # of the size of a surface: so far away there is a spline
_CONVEX = 1.0 / 6.0 + 0.03  # of a second difference that is positive
_BEARS = 0.5         # cells: so near to the places of an axis in contact the error is measured
# Times: in the middle of a cell its 8 nearest coefficients have 0.88 of the weight.
_SPREAD = 1.14
_MIDDLE = (1.0 / 48.0, 23.0 / 48.0, 23.0 / 48.0, 1.0 / 48.0)  # weights there, along each axis
# A spline with cells h is too large by 0.06 (h/d + (h/d)^2) h at most where it is d away, found at
# 20,000 places 0.5 h to 12 h beside boxes, plates and pairs of boxes, turned at random.
_OVER = 0.06
_NOT_ZERO = 1e-30  # m, in place of 0, which says that nothing was computed


class Grids(Record):
    """Splines about several surfaces; G grids, B blocks with coefficients, S beside those."""

    low: Floats  # (G, 3) corner of the grid, m
    step: Floats  # (G,) size of its cells, m
    count: Ints  # (G, 3) blocks along each axis
    first: Ints  # (G,) where its blocks begin in `block`
    further: Ints  # (G,) how many grids behind it are coarser ones about the same surface
    bears: Floats  # (G, 2) how far from the surface its error is measured, m; (0, 0): nowhere
    less: Floats  # (G,) what is subtracted everywhere, m
    block: Ints  # (n,) number of the coefficients of each block, -1: none
    weight: NDArray[np.float32]  # (B, 11, 11, 11) coefficients, m; 0: not filled
    around: Ints  # (n,) number of the samples of each block, -1: none
    sample: Floats  # (S, 8, 8, 8) exact distances, m; 0: not looked at


class Grid(NamedTuple):
    """What `Grids` has of one spline about a surface, before anything is filled."""

    low: Floats
    step: float
    counts: Ints
    further: int
    bears: tuple[float, float]
    less: float
    block: Ints
    blocks: int  # how many of them have coefficients
    around: Ints
    samples: int  # how many of them have samples


def grids_of(trees: Trees, radii: tuple[float, float]) -> list[Grid]:
    """Return splines about a surface for a DLO with radii between two, m, both above 0.

    The first one is where the DLO touches, the others are coarser and farther away.
    """
    far = _FAR * float(np.ptp(trees.box[0].reshape(2, 3), axis=0).max())
    grid = _grid(trees, radii[0] / _PER_RADIUS, radii[1])
    bears = radii[0] - _BEARS * grid.step, radii[1] + _BEARS * grid.step
    grids, beyond = [grid._replace(bears=bears)], radii[1] + _BEYOND * grid.step
    while beyond < far:
        grid = _grid(trees, _COARSER * grid.step, beyond)
        over = grid.step / beyond
        grids.append(grid._replace(less=_OVER * (over + over**2) * grid.step))
        beyond += _BEYOND * grid.step
    return [one._replace(further=len(grids) - 1 - k) for k, one in enumerate(grids)]


def _grid(trees: Trees, step: float, outer: float) -> Grid:
    """Return a spline with cells of a size, m, or larger ones, to some cells beyond `outer`, m."""
    low, high = np.array(trees.box[0, :3]), np.array(trees.box[0, 3:])
    while True:
        beyond = outer + _BEYOND * step
        corner = low - beyond - _CELLS * step
        count = np.ceil((high - low + 2 * (beyond + _CELLS * step)) / (_CELLS * step)).astype(
            np.int64)
        if count.prod() <= _MOST_LOOKED_AT:
            block, active = _blocks(trees, corner, step, count, -_BELOW * step, beyond)
            if active <= _MOST_BLOCKS:
                return Grid(corner, step, count, 0, (0.0, 0.0), 0.0, block, active,
                            *_beside(count, block))
        step *= _LARGER


def joined(grids: list[Grid]) -> Grids:
    """Return several grids as one Record, with nothing filled."""
    first = np.cumsum([0, *(grid.block.size for grid in grids)])[:len(grids)].astype(np.int64)
    block, blocks = _one_after_the_other([(grid.block, grid.blocks) for grid in grids])
    around, samples = _one_after_the_other([(grid.around, grid.samples) for grid in grids])
    return Grids(np.array([grid.low for grid in grids]).reshape(-1, 3),
                 np.array([grid.step for grid in grids], dtype=float),
                 np.array([grid.counts for grid in grids], dtype=np.int64).reshape(-1, 3), first,
                 np.array([grid.further for grid in grids], dtype=np.int64),
                 np.array([grid.bears for grid in grids], dtype=float).reshape(-1, 2),
                 np.array([grid.less for grid in grids], dtype=float), block,
                 _zeros(np.dtype(np.float32), blocks, _SIDE, _SIDE, _SIDE), around,
                 _zeros(np.dtype(float), samples, _CELLS, _CELLS, _CELLS))


def _zeros(dtype: np.dtype[Any], *shape: int) -> NDArray[Any]:
    """Return zeros that take memory where they are written, page by page.

    NumPy's ask for pages of 2 MB, of which each block that is filled would take one.
    """
    size = dtype.itemsize * int(np.prod(shape))
    return np.frombuffer(mmap(-1, max(size, 1)), dtype, size // dtype.itemsize).reshape(shape)


def _one_after_the_other(numbered: list[tuple[Ints, int]]) -> tuple[Ints, int]:
    """Return numbers, -1 for none, of several grids in a row, and how many there are in all."""
    total, found = 0, [np.zeros(0, dtype=np.int64)]
    for numbers, count in numbered:
        found.append(np.where(numbers < 0, -1, numbers + total))
        total += count
    return np.concatenate(found), total


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
def _beside(count: Ints, block: Ints) -> tuple[Ints, int]:
    """Return (n,) numbers of all blocks that have coefficients or are beside one, and how many."""
    around, found = np.full(block.size, -1), 0
    for b in range(block.size):
        if block[b] < 0:
            continue
        i, j, k = b // (count[1] * count[2]), b // count[2] % count[1], b % count[2]
        for x in range(max(i - 1, 0), min(i + 2, count[0])):
            for y in range(max(j - 1, 0), min(j + 2, count[1])):
                for z in range(max(k - 1, 0), min(k + 2, count[2])):
                    other = (x * count[1] + y) * count[2] + z
                    if around[other] < 0:
                        around[other] = found
                        found += 1
    return around, found


@kernel
def _fill(trees: Trees, root: int, grids: Grids, g: int, at: Ints, own: int) -> None:
    """Fill the coefficients `own` of the block `at` (3,) of a grid.

    Threads that do this at once write the same numbers; 0 is none of them. Samples are kept, for
    blocks beside each other share most of them.
    """
    less, step = grids.less[g], grids.step[g]
    exact = np.empty((_SIDE + 6, _SIDE + 6, _SIDE + 6))
    for x in range(_SIDE + 6):
        for y in range(_SIDE + 6):
            for z in range(_SIDE + 6):
                near = np.inf  # a place beside one that is known is no farther away than
                if z > 0:
                    near = abs(exact[x, y, z - 1]) + 1.001 * step
                elif y > 0:
                    near = abs(exact[x, y - 1, z]) + 1.001 * step
                elif x > 0:
                    near = abs(exact[x - 1, y, z]) + 1.001 * step
                exact[x, y, z] = _sampled(trees, root, grids, g, _CELLS * at[0] + x - 4,
                                          _CELLS * at[1] + y - 4, _CELLS * at[2] + z - 4, near)
    weight = np.empty((_SIDE + 4, _SIDE + 4, _SIDE + 4))
    for x in range(_SIDE + 4):
        for y in range(_SIDE + 4):
            for z in range(_SIDE + 4):
                here = exact[x + 1, y + 1, z + 1]
                bends = max(exact[x, y + 1, z + 1] + exact[x + 2, y + 1, z + 1] - 2.0 * here, 0.0)
                bends += max(exact[x + 1, y, z + 1] + exact[x + 1, y + 2, z + 1] - 2.0 * here, 0.0)
                bends += max(exact[x + 1, y + 1, z] + exact[x + 1, y + 1, z + 2] - 2.0 * here, 0.0)
                weight[x, y, z] = here - _CONVEX * bends
    over = np.zeros((_SIDE + 1, _SIDE + 1, _SIDE + 1))
    if grids.bears[g, 1] > 0.0:
        _measure(trees, root, grids, g, at, weight, over)
    for x in range(_SIDE):
        for y in range(_SIDE):
            for z in range(_SIDE):
                most = 0.0
                for k in range(8):
                    most = max(most, over[x + k // 4, y + k // 2 % 2, z + k % 2])
                value = np.float32(weight[x + 2, y + 2, z + 2] - _SPREAD * most - less)
                grids.weight[own, x, y, z] = value if value != 0.0 else _NOT_ZERO


@kernel
def _sampled(trees, root, grids, g, x, y, z, within):
    """Return the exact distance in m at a place of the lattice, which is `within` m at most."""
    low, step, count = grids.low[g], grids.step[g], grids.count[g]
    i, j, k = x // _CELLS, y // _CELLS, z // _CELLS
    own = -1
    if 0 <= i < count[0] and 0 <= j < count[1] and 0 <= k < count[2]:
        own = grids.around[grids.first[g] + (i * count[1] + j) * count[2] + k]
    if own >= 0:
        known = grids.sample[own, x % _CELLS, y % _CELLS, z % _CELLS]
        if known != 0.0:
            return known
    p, normal, hessian = np.empty(3), np.empty(3), np.zeros((3, 3))
    p[0], p[1], p[2] = low[0] + x * step, low[1] + y * step, low[2] + z * step
    exact = signed_from_surface(trees, root, p, within, normal, hessian)
    if exact == 0.0:
        exact = _NOT_ZERO
    if own >= 0:
        grids.sample[own, x % _CELLS, y % _CELLS, z % _CELLS] = exact
    return exact


@kernel
def _measure(trees, root, grids, g, at, weight, over):
    """Fill over (12, 12, 12) with how much too large a spline is in the middles of cells, m.

    Args:
        weight: (15, 15, 15) its coefficients, from three before the block on
    """
    low, step = grids.low[g], grids.step[g]
    p, normal, hessian = np.empty(3), np.empty(3), np.zeros((3, 3))
    for x in range(_SIDE + 1):
        for y in range(_SIDE + 1):
            for z in range(_SIDE + 1):
                smooth = 0.0
                for a in range(4):
                    for b in range(4):
                        for c in range(4):
                            share = _MIDDLE[a] * _MIDDLE[b]
                            smooth += share * _MIDDLE[c] * weight[x + a, y + b, z + c]
                if grids.bears[g, 0] <= smooth <= grids.bears[g, 1]:
                    p[0] = low[0] + (_CELLS * at[0] + x - 1.5) * step
                    p[1] = low[1] + (_CELLS * at[1] + y - 1.5) * step
                    p[2] = low[2] + (_CELLS * at[2] + z - 1.5) * step
                    over[x, y, z] = smooth - signed_from_surface(trees, root, p, abs(smooth) + step,
                                                                 normal, hessian)


@kernel
def smooth_distance(trees: Trees, root: int, grids: Grids, g: int, p: Floats, normal: Floats,
                    hessian: Floats) -> float:
    """Return the smooth distance in m of p (3,) from the surface of grid g; fill its derivatives.

    The surface is that of `root` in `trees`, from which coefficients come that are not there yet.

    Beyond that grid it is what a coarser one tells, which is less than the exact distance; infinite
    where none has coefficients. Fills normal (3,), the unit vector along its slope (which has about
    the size 1), and hessian (3, 3), by which that turns.

    Args:
        p: (3,) in the frame of the surface
    """
    for level in range(1 + grids.further[g]):
        distance = _on_grid(trees, root, grids, g + level, p, normal, hessian)
        if distance < np.inf:
            return distance
    return np.inf


@kernel
def _on_grid(trees, root, grids, g, p, normal, hessian):
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
    if not _is_filled(grids.weight, own, i, j, k):
        _fill(trees, root, grids, g, np.array([bx, by, bz]), own)
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
def _is_filled(weight, own, i, j, k):
    """Whether all 64 coefficients of a cell are there; another thread may be filling them."""
    for a in range(4):
        for b in range(4):
            for c in range(4):
                if weight[own, i + a, j + b, k + c] == 0.0:
                    return False
    return True


@kernel
def _basis(t):
    """Return the four cubic B-splines at t of a cell, their first and their second slopes."""
    u = 1.0 - t
    return ((u**3 / 6.0, (4.0 - 6.0 * t * t + 3.0 * t**3) / 6.0,
             (4.0 - 6.0 * u * u + 3.0 * u**3) / 6.0, t**3 / 6.0),
            (-0.5 * u * u, 1.5 * t * t - 2.0 * t, 2.0 * u - 1.5 * u * u, 0.5 * t * t),
            (u, 3.0 * t - 2.0, 3.0 * u - 2.0, t))
