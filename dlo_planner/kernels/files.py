# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The machine code of kernels on disk: a file for each kernel, types, compiler and processor.

The name of a file is the key of all that is in it, its content is written at once and carries
zlib's checksum: a process finds what was compiled from these very sources, whole, or nothing. The
place of the package and the times of its files do not matter.

Kernels that were compiled when the package was installed are for any processor of the kind: they
are used where there are none for this one.

Files are looked for in several folders, and kept in the first that can be written. In order:
NUMBA_CACHE_DIR, the user's cache folder, one among temporary files that is the user's alone, and
the folder in the package that is filled when it is installed (`dlo_planner.prebuild`).
"""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
import sys
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from pkgutil import get_data
from time import time
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from dlo_planner.kernels.fingerprint import fingerprint

_DAY = 86400.0  # s, after which a file is marked as used again
# Settings of numba that change what it compiles.
_SETTINGS = ('BOUNDSCHECK', 'DEBUGINFO_DEFAULT', 'EXTEND_VARIABLE_LIFETIMES', 'LOOP_VECTORIZE',
             'SLP_VECTORIZE', 'USING_SVML')
_COMPILER = 'dispatcher.py', 'references.py'


class Key(NamedTuple):
    """What is looked for: all but the compiler and the processor."""

    kernel: str  # its name
    sources: str  # its fingerprint
    kinds: tuple[Any, ...]  # types of its arguments

    def file(self, target: tuple[str, ...]) -> str:
        """Return the name of the file for a processor."""
        stem = _stem(self.kernel, self.sources, target)
        return f'{stem}-{_digest(str(self.kinds))}.kernel'


def kept(key: Key) -> Iterator[Any]:
    """Yield what is in the files of a kernel, the best processor first."""
    for name in map(key.file, accepted(_target())):
        for folder in folders().read:
            content = _read(folder / name)
            try:
                held = content and pickle.loads(content)
            except Exception:  # numba's types, classes, environments: whatever fails is compiled
                continue
            if held:
                yield held


def keep(key: Key, content: object) -> None:
    """Write a file of a kernel; where that cannot be done nothing happens."""
    folder = folders().write
    if folder is not None:
        with suppress(OSError):
            _write(folder / key.file(_target()), dumps(content))
            _prune_once(folder)


def _stem(kernel: str, sources: str, target: tuple[str, ...]) -> str:
    """Return how the names of a kernel's files begin, of these sources and this compiler."""
    return f'{kernel}-{_digest(sources, environment(), target)}'


def name_of(kernel: Dispatcher) -> str:
    """Return the name of a kernel in the names of its files."""
    function = kernel.py_func
    return f'{function.__module__}.{function.__qualname__}'.replace('<locals>.', '')


def current_stems(kernels: Iterable[Dispatcher]) -> set[str]:
    """Return how the names of the files of kernels begin that are valid in this process."""
    return {_stem(name_of(kernel), fingerprint(kernel), _target()) for kernel in kernels}


def _target() -> tuple[str, ...]:
    """Return what numba compiles for: triple, name and features of a processor."""
    target: tuple[str, ...] = cpu_target.target_context.codegen().magic_tuple()
    return target


def _digest(*parts: object) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


@cache
def environment() -> tuple[Any, ...]:
    """Return what compiles: versions, the sources here that change numba, and its settings."""
    numpy = np.__version__.split('.')[:2]
    settings = [(name, repr(getattr(numba.config, name, None))) for name in _SETTINGS]
    optimized = str(getattr(numba.config.OPT, '_raw_value', numba.config.OPT))
    written = b''.join(get_data(__package__, name) or b'' for name in _COMPILER)
    return (_digest(written), sys.implementation.cache_tag,
            getattr(sys, 'abiflags', ''), numba.__version__, llvmlite.__version__, *numpy,
            optimized, *settings)


def _read(path: Path) -> bytes | None:
    """Return the content of a file that was written whole, and mark it as used."""
    try:
        content = zlib.decompress(path.read_bytes())
    except (OSError, zlib.error):
        return None
    with suppress(OSError):
        if time() - path.stat().st_mtime > _DAY:
            os.utime(path)
    return content


def _write(path: Path, content: bytes) -> None:
    """Write a file at once: another process sees all of it, or nothing."""
    handle, name = tempfile.mkstemp(dir=path.parent, suffix='.part')
    try:
        with os.fdopen(handle, 'wb') as file:
            file.write(zlib.compress(content))
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


@cache
def _prune_once(folder: Path) -> None:
    prune(folder)


# ------------------------------------------------------------------------------------------------
# For which processors kernels are compiled: this one, and any of the kind at installation.


# Instructions of x86-64-v2, which processors have had since 2009.
_V2 = ('cx16', 'popcnt', 'sahf', 'sse3', 'ssse3', 'sse4.1', 'sse4.2')


def accepted(target: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return the processors whose machine code this one runs, the best first."""
    asked = numba.config.CPU_NAME is not None or numba.config.CPU_FEATURES is not None
    return (target,) if asked or not _runs_generic() else (target, (target[0], *generic()))


@cache
def generic() -> tuple[str, str]:
    """Return the name and features of the processor that an installation is compiled for."""
    x86 = llvm.get_process_triple().startswith('x86_64')
    return ('x86-64-v2' if x86 else 'generic'), ''


@cache
def _runs_generic() -> bool:
    if generic()[0] == 'generic':
        return True
    features = llvm.get_host_cpu_features()
    return all(features.get(name, False) for name in _V2)


def compile_generic() -> None:
    """Compile for the processor of `generic` from now on."""
    if not _runs_generic():
        raise RuntimeError(f'this processor does not run what is compiled for {generic()[0]}')
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = generic()
    if cpu_target.target_context.codegen().magic_tuple()[1:] != generic():
        raise RuntimeError('a kernel was imported before')


# ------------------------------------------------------------------------------------------------
# Folders.


IN_PACKAGE = Path(__file__).parent.parent / 'compiled' / sys.implementation.cache_tag
_only: list[Path] = []
_ROOM = 512e6  # bytes of kernels of earlier sources, Pythons and versions of numba that are kept


class Folders(NamedTuple):
    """Where to look, in order; and where to write, None for nowhere."""

    read: tuple[Path, ...]
    write: Path | None


@cache
def folders() -> Folders:
    """Return the folders of this process; the one to write is made."""
    if _only:
        return Folders((_only[-1],), _only[-1])
    filled: list[Path] = []
    for parent in (_asked_for, _of_user, _temporary):
        with suppress(OSError, RuntimeError):  # nowhere to write; no home
            folder = parent() / 'kernels'
            with suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=folder).close()
                return Folders((*filled, folder, IN_PACKAGE), folder)
            if folder.is_dir():
                filled.append(folder)
    return Folders((*filled, IN_PACKAGE), None)


def use_only(folder: Path) -> None:
    """Read and write nothing but this folder from now on."""
    _only.append(folder)
    folders.cache_clear()


def _asked_for() -> Path:
    if not numba.config.CACHE_DIR:
        raise FileNotFoundError('NUMBA_CACHE_DIR')
    return Path(numba.config.CACHE_DIR) / 'dlo_planner'


def _of_user() -> Path:
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'dlo_planner'


def _temporary() -> Path:
    """Return a folder that nobody else can have filled: what lies in it is run."""
    folder = Path(tempfile.gettempdir()) / f'dlo_planner-{os.getuid()}'
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o022:
        raise PermissionError(folder)
    return folder


def prune(folder: Path, room: float = _ROOM) -> None:
    """Delete the files in a folder that have not been used for longest, until the rest has room."""
    files = []
    for path in folder.iterdir():
        with suppress(OSError):  # another process does the same
            status = path.stat()
            files.append((status.st_mtime, status.st_size, path))
    for _, size, path in sorted(files, reverse=True):
        room -= size
        if room < 0:
            path.unlink(missing_ok=True)
