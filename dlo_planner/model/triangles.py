# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Surfaces made of triangles: whether they enclose a solid, and what can be mended in them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.checks import choice, shown
from dlo_planner.model.files import readable

UNITS = {'m': 1.0, 'cm': 0.01, 'mm': 0.001, 'in': 0.0254}  # in m
_NAMED_UNITS = {'meters': 'm', 'meter': 'm', 'millimeters': 'mm', 'millimeter': 'mm',
                'centimeters': 'cm', 'centimeter': 'cm', 'inches': 'in', 'inch': 'in'}
KINDS_OF_FILE = ('.stl', '.obj', '.ply', '.glb', '.3mf')
_SAME = 1e-9    # of a mesh's size: vertices that near to each other are one, files have float32
_FLAT = 1e-14   # of a mesh's size squared: a triangle with less area has no normal
MOST = 2_000_000  # triangles; a file with more takes minutes and gigabytes
_LARGEST = 2**28  # bytes of a file: some 5 million triangles of a binary STL


class Surface(NamedTuple):
    """Triangles that share vertices."""

    vertices: Floats  # (n, 3), m
    faces: Ints  # (m, 3) indices of vertices, counterclockwise as seen from outside


def closed(name: str, vertices: Floats, faces: Ints) -> None:
    """Raise InvalidTask unless triangles enclose a solid, seen counterclockwise from outside.

    Parameters
    ----------
    name : str
        What the triangles are called.
    vertices : ndarray, shape (n, 3)
        Vertices in m.
    faces : ndarray, shape (m, 3)
        Indices of vertices.
    """
    outside = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if outside.size:
        raise InvalidTask(f'{name}.faces[{outside[0]}] = {faces[outside[0]].tolist()}: expected '
                          f'indices of vertices, 0 to {len(vertices) - 1}')
    flat = np.flatnonzero(_areas(vertices, faces) <= _FLAT * np.ptp(vertices, axis=0).max() ** 2)
    if flat.size:
        raise InvalidTask(f'{name}.faces[{flat[0]}] = {faces[flat[0]].tolist()}: expected a '
                          f'triangle with an area, {flat.size} of {len(faces)} have none')
    edges = _edges(faces)
    _, which, often = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True,
                                return_counts=True)
    open_, many = int((often == 1).sum()), int((often > 2).sum())
    if open_ or many:
        what = ' and '.join(f'{n} {said}' for n, said in (
            (open_, 'open edges'), (many, 'edges of more than two')) if n)
        raise InvalidTask(f'{name} is not watertight: {len(faces)} triangles have {what}; '
                          'expected two triangles at each edge. What is a sheet of triangles has '
                          'to be given a thickness, and holes have to be filled')
    turns = np.bincount(which.ravel(), weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0))
    odd = int((turns != 0).sum())
    if odd:
        raise InvalidTask(f'{name}: at {odd} edges both triangles are seen in opposite directions; '
                          'expected all of them counterclockwise as seen from outside')
    if volume(vertices, faces) <= 0.0:
        raise InvalidTask(f'{name} is inside out: its volume is {volume(vertices, faces):.3g} m3; '
                          'expected triangles that are counterclockwise as seen from outside')


def volume(vertices: Floats, faces: Ints) -> float:
    """Return the volume in m3 inside of triangles, negative where they are seen from within."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float(np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6.0)


def mended(vertices: Floats, faces: Ints) -> Surface:
    """Return the same surface with what can be mended without a guess.

    Vertices at one place become one, triangles without area and those that are there twice go, and
    triangles beside each other are seen from one side. A part that was turned, or all if the
    volume is negative, is turned round. Holes stay: what fills them would be invented.
    """
    size = float(np.ptp(vertices, axis=0).max())
    cells = np.round(vertices / (_SAME * size)) if size > 0 else vertices
    _, first, number = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    vertices, faces = vertices[first], number.ravel()[faces]
    faces = faces[_areas(vertices, faces) > _FLAT * size**2]
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(once)]
    if len(faces):
        faces = _oriented(vertices, faces)
    used, number = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], number.reshape(-1, 3))


def hull(name: str, points: Floats) -> Surface:
    """Return the convex hull of points (n, 3), m; raise InvalidTask where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError  # noqa: PLC0415  (other bodies need none)

    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        raise InvalidTask(f'{name} = {shown(points.tolist())}: expected four points or more that '
                          'do not lie in a plane') from None
    faces = found.simplices.astype(np.int64)
    a, b, c = (points[faces[:, k]] for k in range(3))
    turned = np.einsum('ij,ij->i', np.cross(b - a, c - a), found.equations[:, :3]) < 0
    faces[turned] = faces[turned][:, ::-1]
    used, number = np.unique(faces, return_inverse=True)
    return Surface(points[used], number.reshape(-1, 3))


def read(path: str | PathLike[str], unit: str | None) -> Surface:
    """Return the mended triangles of a file, in m: STL, OBJ, PLY, GLB or 3MF.

    Parameters
    ----------
    path : str or PathLike
    unit : str or None
        Unit of the numbers in it: 'm', 'mm', 'cm' or 'in'. None: the file says it (GLB, 3MF).

    Raises
    ------
    InvalidTask
        No such file, another kind of file, no triangles in it, or a unit that nobody has said.
    MissingExtra
        trimesh is not there.
    """
    if unit is not None:
        choice('unit', unit, UNITS)
    parts, said = load(path)
    unit = unit or said
    if unit is None:
        raise InvalidTask(f'unit = None: expected the unit of the numbers in {shown(str(path))}, '
                          f'which does not say it: one of {", ".join(map(repr, UNITS))}')
    return mended(*joined(parts, UNITS[unit]))


class Part(NamedTuple):
    """A part of a file of triangles, as it stands there."""

    name: str  # '' if it has none
    vertices: Floats  # (n, 3) in the unit of the file
    faces: Ints  # (m, 3) indices of vertices


class Loaded(NamedTuple):
    """What a file of triangles holds."""

    parts: tuple[Part, ...]  # in the frame of the file
    unit: str | None  # of 'm', 'mm', 'cm', 'in'; None: the file does not say it


def load(path: str | PathLike[str]) -> Loaded:
    """Return the parts of a file: STL, OBJ, PLY, GLB or 3MF, each where it stands in the file.

    Parameters
    ----------
    path : str or PathLike

    Raises
    ------
    InvalidTask
        No such file, another kind of file, one that is cut off, or no triangles in it.
    MissingExtra
        trimesh is not there.
    """
    file = readable(path, _LARGEST)
    kind = file.suffix.lower()
    if kind not in KINDS_OF_FILE:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file that ends with one of '
                          f'{" ".join(KINDS_OF_FILE)}')
    trimesh = extra('trimesh', 'mesh', 'files of meshes')
    try:
        # parts of an OBJ are its objects: what has two materials is one body
        loaded = trimesh.load(BytesIO(file.read_bytes()), file_type=kind[1:], force='scene',
                              process=False, **(_OF_OBJ if kind == '.obj' else {}))
        parts = tuple(_placed(node, matrix, loaded.geometry[geometry])
                      for node in loaded.graph.nodes_geometry
                      for matrix, geometry in [loaded.graph[node]])
        said = loaded.units
    except ImportError as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected what is installed to read it, '
                          f'{error}; pip install \'dlo_planner[mesh]\'') from None
    except Exception as error:  # whatever a reader raises on what is no such file
        raise InvalidTask(f'path = {shown(str(path))}: expected triangles of a {kind} file, '
                          f'{type(error).__name__}: {shown(str(error))}') from None
    parts = tuple(part for part in parts if len(part.faces))
    count = sum(len(part.faces) for part in parts)
    if not count:
        raise InvalidTask(f'path = {shown(str(path))}: expected triangles, it has none'
                          f'{_cut_off(file)}')
    if count > MOST or not all(np.isfinite(part.vertices).all() for part in parts):
        raise InvalidTask(f'path = {shown(str(path))}: expected at most {MOST} triangles with '
                          f'finite places, it has {count}')
    return Loaded(parts, _NAMED_UNITS.get(str(said).lower()))


_UNNAMED = re.compile(r'geometry(_\d+)?')  # how trimesh calls what has no name
_OF_OBJ = {'split_objects': True, 'group_material': False, 'skip_materials': True}
_STL_HEAD, _STL_TRIANGLE = 84, 50  # bytes of a binary STL: the last four of the head say how many


def _placed(name: str, matrix: Floats, geometry: Any) -> Part:
    """Return a part of a scene of trimesh where its node puts it."""
    vertices = np.array(geometry.vertices, dtype=float).reshape(-1, 3)
    faces = np.array(getattr(geometry, 'faces', ()), dtype=np.int64).reshape(-1, 3)  # points: none
    vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Part('' if _UNNAMED.fullmatch(name) else name, vertices,
                faces if np.linalg.det(matrix[:3, :3]) > 0 else faces[:, ::-1])


def joined(parts: Sequence[Part], scale: float | Floats = 1.0) -> Surface:
    """Return all parts of a file as one surface, its vertices times a number, or (3,) numbers."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Surface(scale * np.concatenate([part.vertices for part in parts]),
                   np.concatenate([part.faces + k for part, k in zip(parts, first[:-1],
                                                                     strict=True)]))


def _cut_off(file: Path) -> str:
    """Return in words by how much a binary STL is shorter than its head says, '' if it is not."""
    with file.open('rb') as stream:
        head = stream.read(_STL_HEAD)
    if file.suffix.lower() != '.stl' or len(head) < _STL_HEAD or head.startswith(b'solid'):
        return ''
    count = int.from_bytes(head[-4:], 'little')
    size, whole = file.stat().st_size, _STL_HEAD + _STL_TRIANGLE * count
    return '' if size == whole else (f': it is cut off, its head says {count} triangles, which '
                                     f'are {whole} bytes, and it has {size}')


def _areas(vertices: Floats, faces: Ints) -> Floats:
    """Return (m,) areas of triangles, m2."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas: Floats = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _edges(faces: Ints) -> Ints:
    """Return (3 m, 2) the directed edges of triangles, those of each beside each other."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _oriented(vertices: Floats, faces: Ints) -> Ints:
    """Return triangles turned so that those beside each other are seen from one side.

    Each triangle is two nodes of a graph, as it is and turned; neighbors that agree join alike
    ones. A surface with one side alone stays as it is: it is refused later.
    """
    from scipy.sparse import coo_matrix  # noqa: PLC0415  (what is no mesh needs none)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    edges = _edges(faces)
    pairs, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind='stable')
    often = np.bincount(which.ravel(), minlength=len(pairs))
    first = (np.cumsum(often) - often)[often == 2]
    one, other = order[first], order[first + 1]
    agree = (edges[one] != edges[other]).any(axis=1)  # they go along the edge in both directions
    m = len(faces)
    ends = np.concatenate([other // 3 + np.where(agree, 0, m), other // 3 + np.where(agree, m, 0)])
    graph = coo_matrix((np.ones(2 * one.size), (np.concatenate([one // 3, one // 3 + m]), ends)),
                       shape=(2 * m, 2 * m))
    _, label = connected_components(graph, directed=False)
    part = np.minimum(label[:m], label[m:])  # of the surface
    kept: Bools = label[:m] == part
    faces = np.where(kept[:, None], faces, faces[:, ::-1])
    for one_part in np.unique(part):
        own = part == one_part
        # a part that was seen from one side all over stays so: it may be the wall of a cavity
        if not kept[own].any() or not kept[own].all() and volume(vertices, faces[own]) < 0:
            faces[own] = faces[own][:, ::-1]
    if volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
    return np.ascontiguousarray(faces)
