# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of simple solids, and their distance by brute force."""

import numpy as np

from dlo_planner.model.triangles import Surface, hull, mended


def blocks(lines, filled):
    """Return the surface of the cells of a grid that are filled.

    lines: three sequences of coordinates, m; filled: (i, j, k) bools, one a cell
    """
    filled = np.pad(np.asarray(filled, dtype=bool), 1)
    places, faces = [], []
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        for cell in np.argwhere(filled[1:-1, 1:-1, 1:-1]):
            for side in (0, 1):
                step = np.zeros(3, dtype=int)
                step[axis] = 2 * side - 1
                if filled[tuple(cell + 1 + step)]:
                    continue
                corners = np.empty((4, 3))
                for corner, (a, b) in zip(corners, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
                    corner[axis] = lines[axis][cell[axis] + side]
                    corner[one], corner[other] = lines[one][cell[one] + a], lines[other][
                        cell[other] + b]
                count = len(places)
                places += list(corners if side else corners[::-1])
                faces += [(count, count + 1, count + 2), (count, count + 2, count + 3)]
    return mended(np.array(places), np.array(faces))


def box(size):
    """Return a box about the origin with full sizes (3,), m."""
    return blocks([(-0.5 * one, 0.5 * one) for one in size], np.ones((1, 1, 1)))


def ball(radius, number=600):
    """Return the hull of points spread over a sphere (Fibonacci's spiral)."""
    k = np.arange(number) + 0.5
    turn, height = np.pi * (1 + np.sqrt(5)) * k, 1 - 2 * k / number
    across = np.sqrt(1 - height**2)
    return hull('points', radius * np.column_stack([across * np.cos(turn), across * np.sin(turn),
                                                    height]))


def ring(radius, thick, around=24, across=12):
    """Return a torus about z: radius of its middle line, and of its section, m."""
    a, b = np.meshgrid(2 * np.pi * np.arange(around) / around,
                       2 * np.pi * np.arange(across) / across, indexing='ij')
    wide = radius + thick * np.cos(b)
    vertices = np.stack([wide * np.cos(a), wide * np.sin(a), thick * np.sin(b)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing='ij')
    corner = [(((i + di) % around) * across + (j + dj) % across).ravel()
              for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces = np.concatenate([np.column_stack([corner[0], corner[1], corner[2]]),
                            np.column_stack([corner[0], corner[2], corner[3]])])
    return Surface(vertices, faces)


def wedge():
    """Return a solid with a sharp edge and a sharp tip."""
    points = np.array([(0, 0, 0), (0.3, 0, 0), (0, 0.05, 0), (0.02, 0.01, 0.2)], dtype=float)
    return hull('points', points)


def distances(surface, points):
    """Return the exact signed distances of points (n, 3) by a look at every triangle."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    result = np.empty(len(points))
    for k, p in enumerate(points):
        found = [_to_line(p, one, other) for one, other in ((a, b), (b, c), (c, a))]
        height = np.einsum('ij,ij->i', p - a, normals)
        foot = p - height[:, None] * normals
        inside = np.ones(len(a), dtype=bool)
        for one, other in ((a, b), (b, c), (c, a)):
            inside &= np.einsum('ij,ij->i', np.cross(other - one, foot - one), normals) >= 0
        found.append(np.where(inside, np.abs(height), np.inf))
        result[k] = np.min(found) * (-1.0 if _winding(p, a, b, c) > 0.5 else 1.0)
    return result


def _to_line(p, a, b):
    share = np.clip(np.einsum('ij,ij->i', p - a, b - a) / np.einsum('ij,ij->i', b - a, b - a), 0, 1)
    return np.linalg.norm(p - a - share[:, None] * (b - a), axis=1)


def _winding(p, a, b, c):
    """Return how often a surface goes round a point (van Oosterom and Strackee 1983)."""
    x, y, z = a - p, b - p, c - p
    lx, ly, lz = (np.linalg.norm(one, axis=1) for one in (x, y, z))
    dot = lambda u, v: np.einsum('ij,ij->i', u, v)  # noqa: E731
    return np.sum(np.arctan2(dot(x, np.cross(y, z)), lx * ly * lz + dot(x, y) * lz
                             + dot(y, z) * lx + dot(z, x) * ly)) / (2 * np.pi)


def from_boxes(places, lines, filled):
    """Return distances (n,) of places (n, 3) from the filled cells of `blocks`; <= 0: inside."""
    best = np.full(len(places), np.inf)
    for cell in np.argwhere(np.asarray(filled, dtype=bool)):
        low = np.array([lines[k][cell[k]] for k in range(3)])
        high = np.array([lines[k][cell[k] + 1] for k in range(3)])
        beyond = np.maximum(low - places, places - high)
        out = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        best = np.minimum(best, np.where(out > 0, out, beyond.max(axis=1)))
    return best


SOLIDS = {'box': box((0.1, 0.2, 0.3)), 'ball': ball(0.1, 300), 'ring': ring(0.1, 0.03),
          'wedge': wedge(), 'bracket': blocks(
              [(0.0, 0.05, 0.08, 0.1), (0.0, 0.04), (0.0, 0.02, 0.06)],
              [[[1, 1]], [[1, 0]], [[1, 1]]])}
