# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threads of BLAS: one, in processes of this package, and wherever it decomposes a matrix.

Matrices have at most some hundred rows here. More threads gain nothing on an idle machine; on a
busy one they wait for each other, and an eigenproblem of 3 ms takes 30 to 300 ms.
"""

import ctypes
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import product
from pathlib import Path

_MAPS = Path('/proc/self/maps')  # of Linux: elsewhere threads are as they are
_BLAS = re.compile(r'/\S*(?:openblas|libblas)\S*\.so\S*')
_NAMES = ('OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS')


def one_thread_of_blas() -> None:
    """Give BLAS one thread in this process and its children; what is set already is left.

    To be called before NumPy is imported, and by processes of this package only: a program that
    uses the library decides by itself, and has `one_thread` while it computes.
    """
    for name in _NAMES:
        os.environ.setdefault(name, '1')


class _Inside:
    """How many are inside of `one_thread`, and how many threads there were before the first."""

    def __init__(self) -> None:
        self.lock, self.count, self.before = threading.Lock(), 0, list[int]()

    def enter(self) -> None:
        with self.lock:
            if not self.count:
                self.before = [get() for get, _ in _controls()]
                for _, put in _controls():
                    put(1)
            self.count += 1

    def leave(self) -> None:
        with self.lock:
            self.count = max(self.count - 1, 0)  # (it may have been forked inside)
            if not self.count:
                self._give_back()

    def _give_back(self) -> None:
        for (_, put), threads in zip(_controls(), self.before, strict=True):
            put(threads)

    def begin_anew(self) -> None:
        """Be as if nobody were inside: in a forked process, where other threads have ended."""
        self.lock = threading.Lock()  # one of them may have had it
        if self.count:
            self.count = 0
            self._give_back()


_INSIDE = _Inside()
if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_INSIDE.begin_anew)


@contextmanager
def one_thread() -> Iterator[None]:
    """Give OpenBLAS one thread in this process meanwhile, then as many as before.

    As a decorator: while a function runs. Python's threads may be inside at once: who comes first
    lowers it, who leaves last gives it back.
    """
    _INSIDE.enter()
    try:
        yield
    finally:
        _INSIDE.leave()


@cache
def _controls() -> list[tuple[Callable[[], int], Callable[[int], object]]]:
    """Return functions of the OpenBLAS libraries that are loaded: threads now, and to set them."""
    paths = sorted({*_BLAS.findall(_MAPS.read_text())}) if _MAPS.exists() else []
    found = []
    for path, (before, after) in product(paths, product(('', 'scipy_'), ('', '64_'))):
        library = ctypes.CDLL(path)
        names = [f'{before}openblas_{verb}_num_threads{after}' for verb in ('get', 'set')]
        if all(hasattr(library, name) for name in names):
            found.append((getattr(library, names[0]), getattr(library, names[1])))
    return found
