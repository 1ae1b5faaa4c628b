# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A folder in which a long computation keeps its results, so that it can be continued later.

A file is written beside its place and then put there in one step: after a crash it is whole, or
not there at all.
"""

import hashlib
import os
import pickle
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, shown
from dlo_planner.model.value import Value

_TASK, _PART = 'task.npz', 'part-{:07d}.npz'


class Store:
    """Keeps numbered parts of one task, each a dict of arrays, in a folder.

    Parameters
    ----------
    folder : str or os.PathLike
        Str or Path; it is made if it is not there.
    name : str
        What identifies the task, see `fingerprint`.
    task : dict
        dict of arrays that describe it.

    Raises
    ------
    InvalidTask
        The folder belongs to another task, or cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str], name: str,
                 task: dict[str, NDArray[Any]]) -> None:
        self.folder = Path(instance('folder', folder, (str, os.PathLike)))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            known = str(self.task()['name']) if (self.folder / _TASK).exists() else None
            if known is None:
                _written(self.folder / _TASK, {'name': np.asarray(name), **task})
        except (OSError, ValueError) as error:
            raise InvalidTask(f'folder = {shown(str(folder))}: expected one that can be written, '
                              f'{error}') from None
        if known not in (None, name):
            raise InvalidTask(f'folder = {shown(str(folder))}: expected one for this task, it '
                              'has parts of another one (its cut-outs, DLO or options differ)')

    def task(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that describe the task."""
        return _read(self.folder / _TASK)

    def keep(self, index: int, part: dict[str, NDArray[Any]]) -> None:
        """Write a part."""
        _written(self.folder / _PART.format(index), part)

    def part(self, index: int) -> dict[str, NDArray[Any]] | None:
        """Return a part; None if it has not been done, or its file is damaged."""
        return part_in(self.folder, index)


def part_in(folder: Path, index: int) -> dict[str, NDArray[Any]] | None:
    """Return the part of a folder; None if it is not there, or its file is damaged."""
    try:
        return _read(folder / _PART.format(index))
    except Exception:  # whatever another file makes of the reader
        return None


def task_in(folder: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Return the arrays that describe the task of a folder; raise InvalidTask."""
    instance('folder', folder, (str, os.PathLike))
    try:
        return _read(Path(folder) / _TASK)
    except Exception as error:  # the same
        raise InvalidTask(f'folder = {shown(str(folder))}: expected one in which a map is kept, '
                          f'{error}') from None


def _read(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path) as stored:
        return dict(stored)


def _written(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix='.', suffix='.npz')
    try:
        with os.fdopen(handle, 'wb') as file:
            np.savez_compressed(file, **dict[str, Any](arrays))
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def fingerprint(*contents: Any) -> str:
    """Return a name of the content of values, arrays and numbers, the same in every process."""
    digest = hashlib.sha256()
    for part in _parts(contents):
        digest.update(len(part).to_bytes(8, 'little') + part)
    return digest.hexdigest()[:32]


def _parts(content: Any) -> Iterator[bytes]:
    """Yield bytes that tell a content from others."""
    yield type(content).__name__.encode()
    if isinstance(content, np.ndarray):
        plain = content + 0.0 if content.dtype.kind == 'f' else content  # -0.0 is 0.0
        yield f'{content.dtype.str} {content.shape}'.encode() + plain.tobytes()
    elif isinstance(content, tuple | list):
        yield str(len(content)).encode()
        for part in content:
            yield from _parts(part)
    elif isinstance(content, dict):
        yield from _parts(sorted(content.items(), key=lambda item: str(item[0])))
    elif isinstance(content, Value):
        for name in content.compared():
            yield from _parts(getattr(content, name))
    elif is_dataclass(content) and not isinstance(content, type):
        for item in fields(content):
            yield from _parts(getattr(content, item.name))
    elif isinstance(content, float | np.floating):
        yield repr(float(content) + 0.0).encode()
    elif content is None or isinstance(content, str | int | bool | np.integer | np.bool_ | Enum):
        yield str(content).encode()
    elif hasattr(content, '__code__'):
        code = content.__code__
        yield f'{content.__module__}.{content.__qualname__} {code.co_consts}'.encode()
        yield code.co_code
    else:
        yield pickle.dumps(content, protocol=4)
