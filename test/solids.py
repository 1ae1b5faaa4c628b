# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of solids: blocks, plates with holes, prisms, tori; by Delaunay, not by the package."""

import numpy as np
from scipy.spatial import Delaunay


def circle(radius, count, center=(0.0, 0.0)):
    """Return points (count, 2) on a circle."""
    turns = 2 * np.pi * np.arange(count) / count
    return np.array(center) + radius * np.column_stack([np.cos(turns), np.sin(turns)])


def rectangle(width, height, center=(0.0, 0.0), roll=0.0):
    """Return the corners (4, 2) of a rectangle."""
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    corners = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (width, height)
    return np.array(center) + corners @ turn.T


def inside(polygon, points):
    """Return whether points (n, 2) are inside a convex polygon, counterclockwise."""
    ahead = np.roll(polygon, -1, axis=0) - polygon
    away = points[:, None] - polygon
    return (ahead[:, 0] * away[..., 1] - ahead[:, 1] * away[..., 0] > 0).all(axis=1)


def along(polygon, step):
    """Return points (n, 2) on the sides of a polygon, its corners among them."""
    out = []
    for one, other in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        count = max(int(np.linalg.norm(other - one) / step), 1)
        out.append(one + np.arange(count)[:, None] / count * (other - one))
    return np.concatenate(out)


def plate(outline, holes, thickness, step=0.01):
    """Return vertices (n, 3) and faces of a plate between z = 0 and its thickness.

    Outline and holes are convex polygons (k, 2), counterclockwise.
    """
    rims = [along(outline, step), *(along(hole, step) for hole in holes)]
    flat = np.concatenate(rims)
    found = Delaunay(flat).simplices
    middles = flat[found].mean(axis=1)
    kept = np.ones(len(found), dtype=bool)
    for hole in holes:
        kept &= ~inside(hole, middles)
    faces = found[kept]
    a, b, c = (flat[faces[:, k]] for k in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    faces[turned] = faces[turned][:, ::-1]
    count, first, walls = len(flat), 0, []
    for k, rim in enumerate(rims):
        for i in range(len(rim)):
            one, other = first + i, first + (i + 1) % len(rim)
            one, other = (one, other) if k == 0 else (other, one)
            walls += [(one, other, other + count), (one, other + count, one + count)]
        first += len(rim)
    vertices = np.vstack([np.column_stack([flat, np.full(count, z)]) for z in (0.0, thickness)])
    return vertices, np.vstack([faces[:, ::-1], faces + count, walls])


def block(size, center=(0.0, 0.0, 0.0)):
    """Return vertices and faces of a block with full sizes (3,)."""
    vertices, faces = plate(rectangle(*size[:2]), [], size[2], step=np.inf)
    return vertices + np.array(center) - (0, 0, 0.5 * size[2]), faces


def torus(large, small, around, across):
    """Return vertices and faces of a ring about z, 2 x around x across triangles."""
    u, v = np.meshgrid(*(2 * np.pi * np.arange(n) / n for n in (around, across)), indexing='ij')
    out = large + small * np.cos(v)
    vertices = np.column_stack([(out * np.cos(u)).ravel(), (out * np.sin(u)).ravel(),
                                small * np.sin(v).ravel()])
    number = np.arange(around * across).reshape(around, across)
    right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    both = np.roll(right, -1, axis=1)
    faces = np.concatenate([np.stack([number, right, both], axis=-1).reshape(-1, 3),
                            np.stack([number, both, up], axis=-1).reshape(-1, 3)])
    return vertices, faces


def stl(vertices, faces):
    """Return the bytes of a binary STL."""
    record = np.zeros(len(faces), dtype=[('normal', '<f4', 3), ('corners', '<f4', (3, 3)),
                                         ('more', '<u2')])
    record['corners'] = np.asarray(vertices)[faces]
    return b'\0' * 80 + len(faces).to_bytes(4, 'little') + record.tobytes()
