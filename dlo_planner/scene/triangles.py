# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of triangles: each solid in them is an obstacle, called by the part that it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.triangles import UNITS, Part, Surface, load, mended, volume
from dlo_planner.scene.content import Asked, Content, solid_of

_RULE = 'mm'  # of what states no unit: what CAD programs write into STL, OBJ and PLY
_MOST = 2000  # solids of a file
_FAR, _NEAR = 20.0, 1e-3  # m: a cell is neither larger nor smaller


def read(path: Path, asked: Asked) -> Content:
    """Return what a file of triangles says, in m; each closed surface is a body of its own."""
    content = Content()
    parts, said = load(path)
    unit = asked.unit or said or _RULE
    if asked.unit is None and said is None:
        content.notes.append(f'{path.name} states no unit: {_RULE} are assumed; unit=, on the '
                             'terminal --scene-unit, says another')
    elif said is not None and asked.unit not in (None, said):
        content.notes.append(f'{path.name} says {said}, read in {asked.unit} as was asked for')
    vertices = UNITS[unit] * np.concatenate([part.vertices for part in parts])
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + k for part, k in zip(parts, first[:-1], strict=True)])
    size = float(np.ptp(vertices, axis=0).max())
    if not _NEAR <= size <= _FAR:
        content.notes.append(f'{path.name} is {size:.3g} m large in {unit}: is that meant?')
    solids = _solids(mended(vertices, faces))
    if len(solids) > _MOST:
        raise InvalidTask(f'{path}: expected at most {_MOST} solids, it has {len(solids)}')
    names = _names(path, parts, first, vertices, solids)
    for name, solid in zip(names, solids, strict=True):
        try:
            content.obstacles.append(solid_of(name, *solid, asked.friction))
        except InvalidTask as error:
            raise InvalidTask(f'{path}: {error}') from None
    return content


def _solids(whole: Surface) -> list[Surface]:
    """Return the solids of a surface: its closed parts, those with the walls of cavities in them.

    A part that is seen from within, and in no other one, was turned by who wrote it.
    """
    vertices, faces = whole
    count = len(vertices)
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    _, label = connected_components(coo_matrix(
        (np.ones(len(edges)), edges.T), shape=(count, count)), directed=False)
    of_face = label[faces[:, 0]]
    parts = [faces[of_face == k] for k in np.unique(of_face)]
    outer = [part for part in parts if volume(vertices, part) >= 0]
    boxes = [(vertices[part].min(axis=(0, 1)), vertices[part].max(axis=(0, 1))) for part in outer]
    for part in parts:
        if volume(vertices, part) >= 0:
            continue
        low, high = vertices[part].min(axis=(0, 1)), vertices[part].max(axis=(0, 1))
        around = [k for k, (least, most) in enumerate(boxes)
                  if k < len(boxes) and (least < low).all() and (most > high).all()]
        if around:
            k = min(around, key=lambda one: float(np.prod(boxes[one][1] - boxes[one][0])))
            outer[k] = np.concatenate([outer[k], part])
        else:
            outer.append(part[:, ::-1])
    return [_alone(vertices, part) for part in outer]


def _alone(vertices: Floats, faces: Ints) -> Surface:
    """Return a part of a surface with its own vertices alone."""
    used, number = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], number.reshape(-1, 3))


def _names(path: Path, parts: Sequence[Part], first: Ints, vertices: Floats,
           solids: Sequence[Surface]) -> list[str]:
    """Return how solids are called: by the part that they are of, else by the file."""
    tree, names = cKDTree(vertices), []
    for k, solid in enumerate(solids):
        _, at = tree.query(solid.vertices[0])
        part = parts[int(np.searchsorted(first, at, side='right')) - 1].name
        name = ' '.join(part.split()) or path.stem
        names.append(name if part or len(solids) == 1 else f'{name}/{k}')
    return names
