# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes and motions in files: npz, or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dlo_planner.errors import InvalidTask
from dlo_planner.files import readable, writable
from dlo_planner.model.checks import shown

_TYPES = {'f': 'float', 'i': 'int', 'u': 'int', 'b': 'bool', 'U': 'str'}  # by NumPy's kinds
_WORDS = {'nan': np.nan, 'inf': np.inf, '-inf': -np.inf}
_CONTENTS = {'float': (int, float), 'int': (int,), 'bool': (bool,), 'str': (str,)}


def write_json(path: str | PathLike[str], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a mapping of arrays of numbers, truth values or strings to a file.

    Each is {"type", "shape", "data"}, its data in one row; Python writes as many digits of a number
    as tell it from all others.
    """
    Path(path).write_text(json.dumps({name: _described(np.asarray(array))
                                      for name, array in arrays.items()}, allow_nan=False),
                          encoding='utf-8')


def read_json(path: str | PathLike[str]) -> dict[str, NDArray[Any]]:
    """Return the mapping of arrays in a file."""
    known = json.loads(Path(path).read_text(encoding='utf-8'))
    if not isinstance(known, dict):
        raise TypeError(f'it holds a {type(known).__name__}, not named arrays')
    return {name: _array(name, one) for name, one in known.items()}


def _described(array: NDArray[Any]) -> dict[str, Any]:
    data = array.ravel().tolist()
    if array.dtype.kind == 'f':
        data = [one if np.isfinite(one) else str(one) for one in data]
    return {'type': _TYPES[array.dtype.kind], 'shape': list(array.shape), 'data': data}


def _array(name: str, one: Any) -> NDArray[Any]:
    kind, data = one['type'], one['data']
    if kind == 'float':
        data = [_WORDS[item] if isinstance(item, str) else item for item in data]
    for item in data:
        if not isinstance(item, _CONTENTS[kind]) or isinstance(item, bool) != (kind == 'bool'):
            raise TypeError(f'{name} holds {item!r}, which is no {kind}')
    return np.array(data, dtype=kind).reshape(one['shape'])


T = TypeVar('T')

_FORMAT = 2  # 1: files of 0.1.0, which do not say what they hold
_MOST = 2**32  # bytes in a file, unpacked


def save(path: str | PathLike[str], arrays: Mapping[str, Any], kind: str) -> None:
    """Write a mapping of arrays: as JSON where `path` ends with .json, else as compressed npz.

    Both keep every number exactly.
    """
    target = writable(path)
    if not _is_json(path) and target.suffix != '.npz':
        target = writable(target.with_name(f'{target.name}.npz'))
    marked = {'format': _FORMAT, 'kind': kind, **arrays}
    try:
        if _is_json(path):
            write_json(target, {name: np.asarray(one) for name, one in marked.items()})
        else:
            np.savez_compressed(target, **marked)
    except (OSError, ValueError) as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, '
                          f'{error}') from None


def load(path: str | PathLike[str], read: Callable[[dict[str, NDArray[Any]]], T], kind: str) -> T:
    """Return what `read` makes of the mapping of arrays in a file saved for a `kind`."""
    readable(path)
    written = 'a JSON' if _is_json(path) else 'an npz'
    try:
        arrays = read_json(path) if _is_json(path) else _read_npz(path)
        known, held = int(arrays.pop('format', -1)), str(arrays.pop('kind', kind))
    except Exception as error:  # whatever another file makes of the reader
        raise InvalidTask(f'path = {shown(str(path))}: expected {written} file, {error}') from None
    if not 1 <= known <= _FORMAT:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file saved by this package, '
                          f'format {_FORMAT}, it has {known if known >= 0 else "none"}')
    if held != kind:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file that holds a {kind}, it '
                          f'holds a {held}')
    try:
        return read(arrays)
    except Exception as error:  # the same
        raise InvalidTask(f'path = {shown(str(path))}: expected another kind of file, or it is '
                          f'damaged: {error}') from None


def _is_json(path: str | PathLike[str]) -> bool:
    return Path(path).suffix.lower() == '.json'


def _read_npz(path: str | PathLike[str]) -> dict[str, NDArray[Any]]:
    with np.load(path) as stored:
        size = sum(one.file_size for one in stored.zip.infolist())
        if size > _MOST:
            raise ValueError(f'of at most {_MOST} bytes, not {size}')
        return dict(stored)
