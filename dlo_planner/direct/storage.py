# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values in files: names of arrays, of numbers and texts, or of further names; npz, or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.files import readable, writable
from dlo_planner.model.pose import Pose

_TYPES = {'f': 'float', 'i': 'int', 'u': 'int', 'b': 'bool', 'U': 'str'}  # by NumPy's kinds
NOT_FINITE = {'nan': np.nan, 'inf': np.inf, '-inf': -np.inf}  # JSON has no words of its own
_CONTENTS = {'float': (int, float), 'int': (int,), 'bool': (bool,), 'str': (str,)}


Tree: TypeAlias = Mapping[str, Any]


def flattened(tree: Tree, under: str = '') -> dict[str, NDArray[Any]]:
    """Return the arrays of a tree by their paths: names joined by slashes."""
    out: dict[str, NDArray[Any]] = {}
    for name, content in tree.items():
        if isinstance(content, Mapping):
            out |= flattened(content, f'{under}{name}/')
        else:
            out[under + name] = np.asarray(content)
    return out


def nested(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tree that `flattened` was given."""
    out: dict[str, Any] = {}
    for path, array in arrays.items():
        *names, last = path.split('/')
        inner = out
        for name in names:
            inner = inner.setdefault(name, {})
        inner[last] = array
    return out


def pose_row(pose: Pose) -> Floats:
    """Return position and quaternion (7,) of a Pose."""
    return np.concatenate([pose.position, pose.quaternion])


def pose_of_row(row: Sequence[float] | Floats) -> Pose:
    """Return the Pose of position and quaternion (7,)."""
    return Pose(row[:3], row[3:])


def described(array: NDArray[Any]) -> dict[str, Any]:
    """Return an array of numbers, truth values or texts as plain Python: type, shape and data.

    Python writes as many digits of a number as tell it from all others.
    """
    data = array.ravel().tolist()
    if array.dtype.kind == 'f':
        data = [one if np.isfinite(one) else str(one) for one in data]
    return {'type': _TYPES[array.dtype.kind], 'shape': list(array.shape), 'data': data}


def array_of(name: str, one: Any) -> NDArray[Any]:
    """Return the array that `described` was given."""
    kind, data = one['type'], one['data']
    if kind == 'float':
        data = [NOT_FINITE[item] if isinstance(item, str) else item for item in data]
    for item in data:
        if not isinstance(item, _CONTENTS[kind]) or isinstance(item, bool) != (kind == 'bool'):
            raise TypeError(f'{name} holds {item!r}, which is no {kind}')
    return np.array(data, dtype=kind).reshape(one['shape'])


T = TypeVar('T')

_FORMAT = 2
_MOST = 2**32  # bytes in a file, unpacked


def save(path: str | PathLike[str], tree: Tree, kind: str) -> None:
    """Write a tree: as JSON where `path` ends with .json, else as compressed npz.

    Both keep every number exactly.
    """
    target = writable(path)
    if not _is_json(path) and target.suffix != '.npz':
        target = writable(target.with_name(f'{target.name}.npz'))
    arrays = flattened({'format': _FORMAT, 'kind': kind, **tree})
    try:
        if _is_json(path):
            target.write_text(json.dumps({name: described(one) for name, one in arrays.items()},
                                         allow_nan=False), encoding='utf-8')
        else:
            np.savez_compressed(target, **dict[str, Any](arrays))
    except (OSError, ValueError) as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, '
                          f'{error}') from None


def load(path: str | PathLike[str], read: Callable[[Tree], T], kind: str) -> T:
    """Return what `read` makes of the tree in a file saved for a `kind`."""
    readable(path)
    written = 'a JSON' if _is_json(path) else 'an npz'
    try:
        arrays = _read_json(path) if _is_json(path) else _read_npz(path)
        known, held = int(arrays.pop('format', -1)), str(arrays.pop('kind', ''))
    except Exception as error:  # whatever another file makes of the reader
        raise InvalidTask(f'path = {shown(str(path))}: expected {written} file, {error}') from None
    if known != _FORMAT:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file saved by this package, '
                          f'format {_FORMAT}, it has {known if known >= 0 else "none"}')
    if held != kind:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file that holds a {kind}, it '
                          f'holds a {held}')
    try:
        return read(nested(arrays))
    except Exception as error:  # the same
        raise InvalidTask(f'path = {shown(str(path))}: expected another kind of file, or it is '
                          f'damaged: {error}') from None


def _is_json(path: str | PathLike[str]) -> bool:
    return Path(path).suffix.lower() == '.json'


def _read_json(path: str | PathLike[str]) -> dict[str, NDArray[Any]]:
    known = json.loads(Path(path).read_text(encoding='utf-8'))
    if not isinstance(known, dict):
        raise TypeError(f'it holds a {type(known).__name__}, not named arrays')
    return {name: array_of(name, one) for name, one in known.items()}


def _read_npz(path: str | PathLike[str]) -> dict[str, NDArray[Any]]:
    with np.load(path) as stored:
        size = sum(one.file_size for one in stored.zip.infolist())
        if size > _MOST:
            raise ValueError(f'of at most {_MOST} bytes, not {size}')
        return dict(stored)
