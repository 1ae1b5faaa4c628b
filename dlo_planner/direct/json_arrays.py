# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays in JSON: every number exactly as it was, what is not finite as a word."""

import json
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """Return the mapping of arrays in a file.

    Raises
    ------
    OSError, ValueError, KeyError, TypeError
        It cannot be read, or says something else.
    """
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
