# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The exact distance from a surface of triangles: a tree of boxes over them.

The sign is that of the angle-weighted pseudonormal of the nearest face, edge or vertex (Baerentzen
and Aanaes, Signed distance computation using the angle weighted pseudonormal, 2005). The distance
changes by no more than the place does: proofs along a way rely on that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.triangles import Surface

_LEAF = 4       # triangles that are looked at one by one
_DEPTH = 64     # boxes that wait; a tree that is halved at each box is no deeper for 2^60
_ON = 1e-12     # of the largest coordinate: so near to the surface the way to it has no direction
_FLAT = 1e-10   # 1 - cosine between the faces at an edge: below it the edge bends nothing
_EVEN = 1e-24   # of lengths squared: lines that are parallel, a place that is on an edge
FACE, EDGE_AB, EDGE_BC, EDGE_CA, CORNER_A, CORNER_B, CORNER_C = range(7)


class Trees(Record):
    """Trees over the triangles of several surfaces, one after the other; F triangles, K boxes."""

    box: Floats  # (K, 6) least and largest coordinates of what is in it, m
    # (K, 2) its two halves; of a leaf -1 - the first of its triangles, and the one behind the last
    child: Ints
    corner: Floats  # (F, 9) corners of the triangles, m
    # (F, 7, 3) pseudonormals of the face, its edges ab, bc, ca and its corners; unit vectors
    normal: Floats
    flat: Floats  # (F, 3) 1 where an edge bends nothing, else 0
    # (F,) half of how thick the solid is behind the triangle, m: how deep there a point still knows
    # its way out
    inner: Floats


class Tree(NamedTuple):
    """What `Trees` has of one surface."""

    box: Floats
    child: Ints
    corner: Floats
    normal: Floats
    flat: Floats
    inner: Floats


def tree_of(surface: Surface) -> Tree:
    """Return the tree over a closed surface, in the frame of its vertices."""
    corners = surface.vertices[surface.faces]
    normals, flat = _pseudonormals(surface)
    order, box, child = _halved(np.ascontiguousarray(corners.min(axis=1)),
                                np.ascontiguousarray(corners.max(axis=1)))
    count = len(corners)
    tree = Tree(box, child, np.ascontiguousarray(corners[order]).reshape(-1, 9),
                np.ascontiguousarray(normals[order]), np.ascontiguousarray(flat[order]),
                np.zeros(count))
    return tree._replace(inner=_thickness(Trees(*tree), float(np.ptp(corners, axis=(0, 1)).max())))


def joined(trees: list[Tree]) -> tuple[Trees, list[int]]:
    """Return several trees as one Record, and the box at the root of each."""
    if len(trees) == 1:  # those of large ones are not copied
        return Trees(*trees[0]), [0]
    roots, boxes, triangles, children = [], 0, 0, [np.zeros((0, 2), dtype=np.int64)]
    for tree in trees:
        leaf = tree.child[:, :1] < 0
        children.append(np.where(leaf, tree.child + np.array([-triangles, triangles]),
                                 tree.child + boxes))
        roots.append(boxes)
        boxes, triangles = boxes + len(tree.box), triangles + len(tree.corner)

    def together(name: str, *shape: int) -> Floats:
        return np.concatenate([np.zeros((0, *shape)), *(getattr(tree, name) for tree in trees)])

    return Trees(together('box', 6), np.ascontiguousarray(np.concatenate(children)),
                 together('corner', 9), together('normal', 7, 3), together('flat', 3),
                 together('inner')), roots


def _pseudonormals(surface: Surface) -> tuple[Floats, Floats]:
    """Return (m, 7, 3) normals of each triangle's features, and (m, 3) which edges are flat."""
    vertices, faces = surface
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face = _unit(np.cross(b - a, c - a))
    normals = np.empty((len(faces), 7, 3))
    normals[:, 0] = face
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, which = np.unique(edges, axis=0, return_inverse=True)
    which = which.ravel()
    sums = _summed(which, np.repeat(face, 3, axis=0))
    along = np.einsum('ij,ij->i', _unit(sums)[which], np.repeat(face, 3, axis=0))
    normals[:, 1:4] = _unit(sums)[which].reshape(-1, 3, 3)
    # of half the angle between both faces
    flat = (1.0 - along < 0.25 * _FLAT).astype(float).reshape(-1, 3)
    around = np.zeros_like(vertices)
    for k, (here, one, other) in enumerate(((a, b, c), (b, c, a), (c, a, b))):
        p, q = _unit(one - here), _unit(other - here)
        angle = np.arctan2(np.linalg.norm(np.cross(p, q), axis=1), np.einsum('ij,ij->i', p, q))
        around += _summed(faces[:, k], angle[:, None] * face, len(vertices))
    normals[:, 4:] = _unit(around)[faces]
    return normals, flat


def _unit(vectors: Floats) -> Floats:
    """Return vectors (n, 3) of length 1; what has none stays zero."""
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True)
    result: Floats = vectors / np.where(sizes > 0, sizes, 1.0)
    return result


def _summed(which: Ints, vectors: Floats, least: int = 0) -> Floats:
    """Return (m, 3) the sums of vectors (n, 3) by their numbers `which` (n,)."""
    return np.column_stack([np.bincount(which, weights=vectors[:, k], minlength=least)
                            for k in range(3)])


@kernel
def _halved(low: Floats, high: Floats) -> tuple[Ints, Floats, Ints]:
    """Return the order (F,) of triangles in the leaves, boxes (K, 6) and their halves (K, 2).

    Each box is cut at the middle one of the centers along its longest side.

    Args:
        low, high: (F, 3) least and largest coordinates of each triangle
    """
    count = low.shape[0]
    order = np.arange(count)
    most = 2 * count
    box, child, part = np.empty((most, 6)), np.empty((most, 2), np.int64), np.empty((most, 2),
                                                                                    np.int64)
    part[0, 0], part[0, 1] = 0, count
    made = 1
    for k in range(most):  # a box is made before those in it
        if k >= made:
            break
        begin, end = part[k, 0], part[k, 1]
        axis, widest = 0, -1.0
        for j in range(3):
            least = least_middle = np.inf
            largest = largest_middle = -np.inf
            for q in range(begin, end):
                i = order[q]
                least, largest = min(least, low[i, j]), max(largest, high[i, j])
                middle = low[i, j] + high[i, j]
                least_middle = min(least_middle, middle)
                largest_middle = max(largest_middle, middle)
            box[k, j], box[k, 3 + j] = least, largest
            if largest_middle - least_middle > widest:
                axis, widest = j, largest_middle - least_middle
        if end - begin <= _LEAF:
            child[k, 0], child[k, 1] = -1 - begin, end
            continue
        own = order[begin:end].copy()
        order[begin:end] = own[np.argsort(low[own, axis] + high[own, axis])]
        half = (begin + end) // 2
        child[k, 0], child[k, 1] = made, made + 1
        part[made, 0], part[made, 1] = begin, half
        part[made + 1, 0], part[made + 1, 1] = half, end
        made += 2
    return order, box[:made].copy(), child[:made].copy()


@kernel
def _thickness(trees: Trees, size: float) -> Floats:
    """Return `Trees.inner` (F,) of a surface that is `size` m large."""
    inner, middle, beyond = np.empty(trees.corner.shape[0]), np.empty(3), np.empty(3)
    for t in range(inner.size):
        for i in range(3):
            middle[i] = (trees.corner[t, i] + trees.corner[t, 3 + i] + trees.corner[t, 6 + i]) / 3.0
            beyond[i] = middle[i] - 2.0 * size * trees.normal[t, FACE, i]
        inner[t] = size * _first_pierced(trees, middle, beyond, t)
    return inner


@kernel
def _first_pierced(trees, p, q, itself):
    """Return where the line from p to q (3,) first passes through a triangle but one; 0: nowhere.

    A share of it. A line that slips between two triangles makes the solid behind thin, not thick.
    """
    box, child = trees.box, trees.child
    waiting = np.empty(_DEPTH, np.int64)
    waiting[0], top, first, found = 0, 1, 1.0, False
    while top > 0:
        top -= 1
        k = waiting[top]
        begin, end = 0.0, first
        for i in range(3):
            way = q[i] - p[i]
            if way == 0.0:
                if not box[k, i] <= p[i] <= box[k, 3 + i]:
                    end = -1.0
                continue
            one, other = (box[k, i] - p[i]) / way, (box[k, 3 + i] - p[i]) / way
            begin, end = max(begin, min(one, other)), min(end, max(one, other))
        if begin > end:
            continue
        if child[k, 0] >= 0:
            waiting[top], waiting[top + 1] = child[k, 0], child[k, 1]
            top += 2
            continue
        for t in range(-1 - child[k, 0], child[k, 1]):
            share = _pierced(trees.corner, t, p, q)
            if t != itself and 0.0 < share < first:
                first, found = share, True
    return first if found else 0.0


# ------------------------------------------------------------------------------------------------
# The nearest point of a surface.


@kernel(forceinline=True)
def _square_to_box(box, k, x, y, z):
    """Return the squared distance of a point from box k, m2; 0 inside."""
    a = max(box[k, 0] - x, 0.0, x - box[k, 3])
    b = max(box[k, 1] - y, 0.0, y - box[k, 4])
    c = max(box[k, 2] - z, 0.0, z - box[k, 5])
    return a * a + b * b + c * c


@kernel
def nearest_on_surface(trees: Trees, root: int, p: Floats, within: float, place: Floats
                       ) -> tuple[int, int, float]:
    """Return triangle, its feature and the squared distance of the nearest point; fill place (3,).

    Where none is nearer than `within` m, the triangle is -1. (Ericson, Real-Time Collision
    Detection, 2005, 5.1.5, says in which part of a triangle a point is nearest.)

    Args:
        p: (3,) in the frame of the vertices
    """
    box, child, corner = trees.box, trees.child, trees.corner
    x, y, z = p[0], p[1], p[2]
    waiting, far = np.empty(_DEPTH, np.int64), np.empty(_DEPTH)
    waiting[0], far[0] = root, _square_to_box(box, root, x, y, z)
    top, best, found, feature = 1, within * within, -1, 0
    while top > 0:
        top -= 1
        if far[top] >= best:
            continue
        k = waiting[top]
        if child[k, 0] >= 0:
            one, other = child[k, 0], child[k, 1]
            its, others = _square_to_box(box, one, x, y, z), _square_to_box(box, other, x, y, z)
            if its > others:
                one, other, its, others = other, one, others, its
            if others < best:
                waiting[top], far[top] = other, others
                top += 1
            if its < best:
                waiting[top], far[top] = one, its
                top += 1
            continue
        for t in range(-1 - child[k, 0], child[k, 1]):
            which, v, w = _in_triangle(corner, t, x, y, z)
            px = corner[t, 0] + v * (corner[t, 3] - corner[t, 0]) + w * (corner[t, 6]
                                                                         - corner[t, 0])
            py = corner[t, 1] + v * (corner[t, 4] - corner[t, 1]) + w * (corner[t, 7]
                                                                         - corner[t, 1])
            pz = corner[t, 2] + v * (corner[t, 5] - corner[t, 2]) + w * (corner[t, 8]
                                                                         - corner[t, 2])
            square = (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
            if square < best:
                best, found, feature = square, t, which
                place[0], place[1], place[2] = px, py, pz
    return found, feature, best


@kernel
def _in_triangle(corner, t, x, y, z):
    """Return which feature of triangle t is nearest to a point, and the place a + v ab + w ac."""
    ax, ay, az = corner[t, 0], corner[t, 1], corner[t, 2]
    bx, by, bz = corner[t, 3] - ax, corner[t, 4] - ay, corner[t, 5] - az
    cx, cy, cz = corner[t, 6] - ax, corner[t, 7] - ay, corner[t, 8] - az
    px, py, pz = x - ax, y - ay, z - az
    d1, d2 = bx * px + by * py + bz * pz, cx * px + cy * py + cz * pz
    if d1 <= 0.0 and d2 <= 0.0:
        return CORNER_A, 0.0, 0.0
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, (cx * cx + cy * cy
                                                                           + cz * cz)
    d3, d4 = d1 - bb, d2 - bc
    if d3 >= 0.0 and d4 <= d3:
        return CORNER_B, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return EDGE_AB, d1 / (d1 - d3), 0.0
    d5, d6 = d1 - bc, d2 - cc
    if d6 >= 0.0 and d5 <= d6:
        return CORNER_C, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return EDGE_CA, 0.0, d2 / (d2 - d6)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return EDGE_BC, 1.0 - w, w
    whole = va + vb + vc
    return FACE, vb / whole, vc / whole


@kernel
def signed_from_surface(trees: Trees, root: int, p: Floats, within: float, normal: Floats,
                        hessian: Floats) -> float:
    """Return the signed distance in m of p (3,) from a surface; fill its derivatives.

    Beyond `within` m it is that number, without derivatives and sign.

    Fills normal (3,), and hessian (3, 3), which has to be zero, in 1/m.
    """
    place = np.empty(3)
    t, feature, square = nearest_on_surface(trees, root, p, within, place)
    if t < 0:
        return within
    out = size = 0.0
    for i in range(3):
        normal[i] = p[i] - place[i]
        out += normal[i] * trees.normal[t, feature, i]
        size = max(size, abs(p[i]))
    if feature == FACE or np.sqrt(square) <= _ON * size:
        for i in range(3):
            normal[i] = trees.normal[t, feature, i]
        return out if feature == FACE else 0.0
    distance = np.sqrt(square) if out >= 0.0 else -np.sqrt(square)
    for i in range(3):
        normal[i] /= distance
    if feature < CORNER_A and trees.flat[t, feature - 1] > 0.0:
        return distance
    for i in range(3):
        for j in range(3):
            hessian[i, j] = ((i == j) - normal[i] * normal[j]) / distance
    if feature < CORNER_A:  # along the edge nothing turns
        a, b = 3 * (feature - 1), 3 * (feature % 3)
        along = 0.0
        for i in range(3):
            place[i] = trees.corner[t, b + i] - trees.corner[t, a + i]
            along += place[i] * place[i]
        for i in range(3):
            for j in range(3):
                hessian[i, j] -= place[i] * place[j] / (along * distance)
    return distance


# ------------------------------------------------------------------------------------------------
# How near a straight line comes to a surface.


@kernel
def line_to_surface(trees: Trees, root: int, p: Floats, q: Floats, within: float
                    ) -> tuple[float, int]:
    """Return the least distance in m between the line from p to q (3,) and a surface, and where.

    That is a triangle. The distance is 0 where the line pierces it; `within`, and the triangle -1,
    where it is farther away than that.
    """
    box, child, corner = trees.box, trees.child, trees.corner
    waiting, far = np.empty(_DEPTH, np.int64), np.empty(_DEPTH)
    low, high = np.empty(3), np.empty(3)
    for i in range(3):
        low[i], high[i] = min(p[i], q[i]), max(p[i], q[i])
    waiting[0], far[0] = root, _square_between(box, root, low, high)
    top, best, found = 1, within * within, -1
    while top > 0:
        top -= 1
        if far[top] >= best:
            continue
        k = waiting[top]
        if child[k, 0] >= 0:
            one, other = child[k, 0], child[k, 1]
            its, others = _square_between(box, one, low, high), _square_between(box, other, low,
                                                                                high)
            if its > others:
                one, other, its, others = other, one, others, its
            if others < best:
                waiting[top], far[top] = other, others
                top += 1
            if its < best:
                waiting[top], far[top] = one, its
                top += 1
            continue
        for t in range(-1 - child[k, 0], child[k, 1]):
            square = _line_to_triangle(corner, t, p, q, best)
            if square < best:
                best, found = square, t
    return np.sqrt(best), found


@kernel
def _square_between(box, k, low, high):
    """Return the squared distance between box k and the one from low to high (3,)."""
    square = 0.0
    for j in range(3):
        apart = max(box[k, j] - high[j], 0.0, low[j] - box[k, 3 + j])
        square += apart * apart
    return square


@kernel
def _line_to_triangle(corner, t, p, q, best):
    """Return the squared distance of the line from p to q (3,) from triangle t, if below `best`."""
    if _pierced(corner, t, p, q) >= 0.0:
        return 0.0
    for end in range(2):
        x, y, z = (p[0], p[1], p[2]) if end == 0 else (q[0], q[1], q[2])
        _, v, w = _in_triangle(corner, t, x, y, z)
        square = 0.0
        for i in range(3):
            at = p[i] if end == 0 else q[i]
            away = corner[t, i] + v * (corner[t, 3 + i] - corner[t, i]) + w * (
                corner[t, 6 + i] - corner[t, i]) - at
            square += away * away
        best = min(best, square)
    for side in range(3):
        best = min(best, _between_lines(corner, t, 3 * side, 3 * ((side + 1) % 3), p, q))
    return best


@kernel
def _pierced(corner, t, p, q):
    """Return which share of the line from p to q (3,) is before triangle t, -1 if it misses it."""
    b0, b1, b2 = (corner[t, 3] - corner[t, 0], corner[t, 4] - corner[t, 1],
                  corner[t, 5] - corner[t, 2])
    c0, c1, c2 = (corner[t, 6] - corner[t, 0], corner[t, 7] - corner[t, 1],
                  corner[t, 8] - corner[t, 2])
    n0, n1, n2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
    first = (n0 * (p[0] - corner[t, 0]) + n1 * (p[1] - corner[t, 1]) + n2 * (p[2] - corner[t, 2]))
    second = (n0 * (q[0] - corner[t, 0]) + n1 * (q[1] - corner[t, 1]) + n2 * (q[2] - corner[t, 2]))
    if first * second > 0.0 or first == second:
        return -1.0
    share = first / (first - second)
    x, y, z = (p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1]),
               p[2] + share * (q[2] - p[2]))
    feature, v, w = _in_triangle(corner, t, x, y, z)
    if feature == FACE:
        return share
    # on an edge neither of two triangles may have it inside
    x -= corner[t, 0] + v * b0 + w * c0
    y -= corner[t, 1] + v * b1 + w * c1
    z -= corner[t, 2] + v * b2 + w * c2
    size = b0 * b0 + b1 * b1 + b2 * b2 + c0 * c0 + c1 * c1 + c2 * c2
    return share if x * x + y * y + z * z <= _EVEN * size else -1.0


@kernel
def _between_lines(corner, t, a, b, p, q):
    """Return the squared distance of an edge of triangle t from the line from p to q (3,).

    Ericson, 5.1.9.
    """
    d1 = d2 = d3 = e = f = 0.0  # of both directions, and of what is between both beginnings
    for i in range(3):
        u, v, r = corner[t, b + i] - corner[t, a + i], q[i] - p[i], corner[t, a + i] - p[i]
        d1 += u * u
        d2 += u * v
        d3 += v * v
        e += u * r
        f += v * r
    across = d1 * d3 - d2 * d2
    s = 0.0
    if across > _EVEN * d1 * d3:
        s = min(max((d2 * f - e * d3) / across, 0.0), 1.0)
    w = (d2 * s + f) / d3 if d3 > 0.0 else 0.0
    if w < 0.0 or w > 1.0:
        w = min(max(w, 0.0), 1.0)
        s = min(max((d2 * w - e) / d1, 0.0), 1.0)
    square = 0.0
    for i in range(3):
        away = (corner[t, a + i] + s * (corner[t, b + i] - corner[t, a + i])
                - p[i] - w * (q[i] - p[i]))
        square += away * away
    return square
