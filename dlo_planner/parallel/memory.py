# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where shapes are filled in: memory of this process, or such as others of this machine reach.

What processes send to each other is copied four times on the way. So they write into a file that
lies in memory, and is gone with the last process that has it open (Linux: `memfd_create`): those
that a pool forks meanwhile have it until they end. Who cannot open it, as on another machine, sends
results; so do all where the system has no such file to give.
"""

from __future__ import annotations

import os
from itertools import accumulate
from mmap import mmap
from typing import Any
from uuid import uuid4

import numpy as np

from dlo_planner.direct.batch import Filled

_WHOLE = 64  # bytes: an array begins at a multiple of it
File = tuple[str, str, int]  # path and name of a file, and how many shapes it has


class Place:
    """Where the shapes from `begin` to `end` are to be filled in.

    Parameters
    ----------
    filled : Filled or None
        Those, in this process.
    file : File or None
        The file that has all of them. If None, no other process can fill them in: for it there is
        no such Place, but None.
    begin, end : int
    """

    def __init__(self, filled: Filled | None, file: File | None, begin: int, end: int) -> None:
        self.filled, self._file, self._begin, self._end = filled, file, begin, end

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled without a file it becomes None: the worker then sends its results."""
        if self._file is None:
            return type(None), ()
        return Place, (None, self._file, self._begin, self._end)

    def takes(self, found: Filled) -> bool:
        """Fill in shapes that were found elsewhere; return whether that can be done."""
        if found is self.filled:
            return True
        if self._file is None:
            return False
        path, name, n = self._file
        try:
            descriptor = _opened(path, name)
            if descriptor is None:
                return False
            try:
                each = zip(found.stored, _places(found, n), strict=False)
                return all(os.pwrite(descriptor, rows.data, place + self._begin * rows[0].nbytes)
                           == rows.nbytes for rows, place in each)
            finally:
                os.close(descriptor)
        except OSError:
            return False


class Room:
    """Memory for n shapes of so many elements; a context manager, after which no one can open it.

    Parameters
    ----------
    n, elements : int
    shared : bool
        Whether other processes are to reach it.
    """

    def __init__(self, n: int, elements: int, shared: bool) -> None:
        self._descriptor: int | None = None
        self._file: File | None = None
        places = _places(Filled.new(1, elements), n)
        memory = self._reserved(places[-1], n) if shared and n else None
        if memory is None:
            self.filled = Filled.new(n, elements)
            return
        begins = iter(places)
        self.filled = Filled.new(n, elements, lambda shape, kind: np.ndarray(
            shape, kind, memory, next(begins)))

    def _reserved(self, size: int, n: int) -> mmap | None:
        """Return memory of a file for n shapes, None where the system does not give it."""
        if not hasattr(os, 'memfd_create'):
            return None
        name, descriptor = f'dlo_planner-{uuid4().hex}', None
        try:
            descriptor = os.memfd_create(name)
            os.posix_fallocate(descriptor, 0, size)  # now, or a write would end the process
            memory = mmap(descriptor, 0)
        except OSError:
            if descriptor is not None:
                os.close(descriptor)
            return None
        self._descriptor = descriptor
        self._file = f'/proc/{os.getpid()}/fd/{descriptor}', f'/memfd:{name} (deleted)', n
        return memory

    def __enter__(self) -> Room:
        return self

    def __exit__(self, *_: object) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)

    def part(self, begin: int, end: int) -> Place:
        """Return where the shapes from `begin` to `end` are to be filled in."""
        return Place(self.filled.part(begin, end), self._file, begin, end)


def _opened(path: str, name: str) -> int | None:
    """Return the descriptor of a file of another process, None if that is not it any more."""
    if os.readlink(path) != name:  # of another machine's process; strangers' files are not opened
        return None
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    if os.readlink(f'/proc/self/fd/{descriptor}') == name:
        return descriptor
    os.close(descriptor)
    return None


def _places(filled: Filled, n: int) -> list[int]:
    """Return where the arrays of n shapes like some `filled` begin in a file, and its size."""
    sizes = [-(-n * rows[0].nbytes // _WHOLE) * _WHOLE for rows in filled.stored]
    return [0, *accumulate(sizes)]
