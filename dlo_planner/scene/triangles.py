# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of triangles: each solid in them is an obstacle, called by the part that it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.triangles import UNITS, Part, Surface, joined, load, mended
from dlo_planner.scene.content import Asked, Content, solid_or_hull, solid_parts

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
    if path.suffix.lower() == '.glb':
        content.notes.append(f'{path.name} is read as it stands; in glTF y leads upwards, which a '
                             'pose of 0,0,0,0.70711,0,0,0.70711 turns to z')
    whole = joined(parts, UNITS[unit])
    size = float(np.ptp(whole.vertices, axis=0).max())
    if not _NEAR <= size <= _FAR:
        content.notes.append(f'{path.name} is {size:.3g} m large in {unit}: is that meant?')
    solids = solid_parts(mended(*whole))
    if len(solids) > _MOST:
        raise InvalidTask(f'{path}: expected at most {_MOST} solids, it has {len(solids)}')
    names = _names(path, parts, whole.vertices, solids)
    for name, solid in zip(names, solids, strict=True):
        try:
            content.obstacles.append(solid_or_hull(name, solid, asked, content.notes))
        except InvalidTask as error:
            raise InvalidTask(f'{path}: {error}') from None
    return content


def _names(path: Path, parts: Sequence[Part], vertices: Floats,
           solids: Sequence[Surface]) -> list[str]:
    """Return how solids are called: by the part that they are of, else by the file."""
    tree, names = cKDTree(vertices), []
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    for k, solid in enumerate(solids):
        _, at = tree.query(solid.vertices[0])
        part = parts[int(np.searchsorted(first, at, side='right')) - 1].name
        name = ' '.join(part.split()) or path.stem
        names.append(name if part or len(solids) == 1 else f'{name}/{k}')
    return names
