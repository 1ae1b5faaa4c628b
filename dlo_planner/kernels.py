# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The decorator of all kernels: numba's, with caches that cannot be stale.

numba keeps a kernel's machine code as long as the kernel's own file does not change, and it holds
the code of all that the kernel calls, wherever that is written. Here the caches lie in a folder
named by a fingerprint of all kernel files' contents: what was compiled from others is not found.
"""

import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import (
    Cache,
    CompileResultCacheImpl,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.core.dispatcher import Dispatcher

_PACKAGE = Path(__file__).parent
_MARK = b'from dlo_planner.kernels import'  # in every file that has kernels
_KEPT = 4  # folders of earlier fingerprints: other branches, Pythons and versions of numba


def kernel(function: Callable | None = None, **options: Any) -> Callable:
    """Compile a function when it is first called, and keep what was compiled for the next process.

    Args:
        options: of `numba.njit`, but `cache`

    Where nothing can be written it is compiled anew in each process.
    """
    if function is None:
        return partial(kernel, **options)
    made = numba.njit(function, **options)
    if isinstance(made, Dispatcher) and cache_folder() is not None:  # not with NUMBA_DISABLE_JIT
        made._cache = _KernelCache(function)
    return made


@cache
def fingerprint(package: Path = _PACKAGE) -> str:
    """Return the name of what kernels are compiled from: their sources, and the compiler."""
    sources = {path: path.read_bytes() for path in sorted(package.rglob('*.py'))}
    parts = [f'{sys.implementation.cache_tag} {numba.__version__} {llvmlite.__version__}'.encode()]
    for path, source in sources.items():
        if _MARK in source or path == package / 'kernels.py':
            parts += [path.relative_to(package).as_posix().encode(),
                      hashlib.sha256(source).digest()]
    return hashlib.sha256(b'\0'.join(parts)).hexdigest()[:16]


@cache
def cache_folder() -> Path | None:
    """Return the folder in which caches are kept, None where there is none and none can be made.

    It is the first that can be written of NUMBA_CACHE_DIR, the package's own `__pycache__`, the
    user's cache folder, and one among temporary files that is the user's alone.
    """
    return next(iter(cache_folders()[-1:]), None)


@cache
def cache_folders() -> tuple[Path, ...]:
    """Return all folders in which caches are looked for, that of `cache_folder` last.

    The others cannot be written, but hold caches: kernels that were compiled when the package was
    installed are used by all, and where nothing can be written.
    """
    filled = []
    for parent in (_asked_for, _in_package, _of_user, _temporary):
        with suppress(OSError, RuntimeError):  # nowhere to write; no home
            folder = parent() / f'kernels-{fingerprint()}'
            if any(folder.glob('*.nbi')) and not os.access(folder, os.W_OK):
                filled.append(folder)
                continue
            if not folder.is_dir():
                folder.mkdir(parents=True, exist_ok=True)
                _prune(folder)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)  # used last now
            return (*filled, folder)
    return tuple(filled)


def _asked_for() -> Path:
    if not numba.config.CACHE_DIR:
        raise FileNotFoundError('NUMBA_CACHE_DIR')
    return Path(numba.config.CACHE_DIR) / 'dlo_planner'


def _in_package() -> Path:
    return _PACKAGE / '__pycache__'


def _of_user() -> Path:
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'dlo_planner'


def _temporary() -> Path:
    """Return a folder that nobody else can have filled: what lies in it is run."""
    folder = Path(tempfile.gettempdir()) / f'dlo_planner-{os.getuid()}'
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(folder)
    return folder


def _prune(newest: Path) -> None:
    """Delete the folders beside `newest` that have not been used for longest."""
    others = [path for path in newest.parent.glob('kernels-*') if path != newest]
    with suppress(FileNotFoundError):  # another process does the same
        for path in sorted(others, key=lambda path: path.stat().st_mtime)[:-_KEPT]:
            shutil.rmtree(path, ignore_errors=True)


class _Locator(_CacheLocator):
    def __init__(self, function):
        self._py_file = function.__code__.co_filename  # for numba's warnings
        self._line = function.__code__.co_firstlineno

    def get_cache_path(self):
        return str(cache_folder())

    def get_source_stamp(self):
        return fingerprint()

    def get_disambiguator(self):
        return str(self._line)


class _KernelCacheImpl(CompileResultCacheImpl):
    def __init__(self, function):
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Locator(function)
        self._filename_base = self.get_filename_base(
            f'{function.__module__}.{function.__qualname__}', getattr(sys, 'abiflags', ''))


class _KernelCache(Cache):
    _impl_class = _KernelCacheImpl

    def __init__(self, function):
        super().__init__(function)
        self._others = [IndexDataCacheFile(str(folder), self._impl.filename_base, fingerprint())
                        for folder in cache_folders()[:-1]]

    def load_overload(self, sig, target_context):
        """Return what was compiled before, None if there is nothing or it cannot be read."""
        own, found = self._cache_file, None
        for file in (own, *self._others):
            self._cache_file = file
            with suppress(OSError, EOFError, pickle.UnpicklingError):
                found = found or super().load_overload(sig, target_context)
        self._cache_file = own
        return found

    def save_overload(self, sig, data):
        """Keep what was compiled; where that cannot be done any more it stays in memory."""
        with suppress(OSError):
            super().save_overload(sig, data)
