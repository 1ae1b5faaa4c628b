# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The machine code of kernels on disk: a file for each kernel, types, compiler and processor.

The name of a file is the key of all that is in it, its content is written at once and carries
zlib's checksum: a process finds what was compiled from these very sources, whole, or nothing. The
place of the package and the times of its files do not matter.

Kernels that were compiled when the package was installed are for any processor of the kind: they
are used where there are none for this one.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import tempfile
import zlib
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from time import time
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import compiler
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.core.types import Callable

from dlo_planner.kernels.fingerprint import Unseen, fingerprint
from dlo_planner.kernels.folders import folders, prune

_KERNELS: list[Dispatcher] = []  # all that have been decorated
_DAY = 86400.0  # s, after which a file is marked as used again
# Settings of numba that change what it compiles.
_SETTINGS = ('BOUNDSCHECK', 'DEBUGINFO_DEFAULT', 'EXTEND_VARIABLE_LIFETIMES', 'LOOP_VECTORIZE',
             'SLP_VECTORIZE', 'USING_SVML')
# Instructions of x86-64-v2, which processors have had since 2009.
_V2 = ('cx16', 'popcnt', 'sahf', 'sse3', 'ssse3', 'sse4.1', 'sse4.2')


class KernelCache(NullCache):  # type: ignore[misc]  # numba is not annotated
    """What numba asks for the machine code of one kernel, and gives it to."""

    def __init__(self, kernel: Dispatcher) -> None:
        self._kernel = kernel
        _KERNELS.append(kernel)

    @property
    def cache_path(self) -> str:
        """The folder that is written."""
        return str(folders().write)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled before, None if there is nothing or it cannot be read."""
        target_context.refresh()
        for name in self._files(sig, accepted(target_context.codegen().magic_tuple())):
            for folder in folders().read:
                content = _read(folder / name)
                # pickles of numba's types, classes and environments: whatever fails is compiled
                with suppress(Exception):
                    result = content and _rebuilt(target_context, *pickle.loads(content))
                    if result and tuple(result.signature.args) == _arguments(sig):
                        return result
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; where that cannot be done it stays in memory."""
        folder = folders().write
        dynamic = data.library.has_dynamic_globals or any(not one.can_cache for one in data.lifted)
        if folder is None or dynamic:
            return
        for name in self._files(sig, (data.codegen.magic_tuple(),)):
            with suppress(OSError):
                _write(folder / name, dumps(data._reduce()))
                _prune_once(folder)

    def _files(self, sig: Any, targets: Iterable[tuple[str, ...]]) -> list[str]:
        """Return the names of the files for some types and processors, none if there can be none.

        A kernel that is handed over as an argument is in no fingerprint.
        """
        arguments = _arguments(sig)
        if any(isinstance(one, Callable) for one in arguments):
            return []
        try:
            sources = fingerprint(self._kernel)
        except Unseen:
            return []
        types = _digest(str(arguments))
        return [f'{_stem(self._kernel, sources, target)}-{types}.kernel' for target in targets]


def _rebuilt(target_context: Any, library: tuple[str, str, tuple[bytes, bytes]], described: Any,
             *rest: Any) -> Any:
    """Return a kernel with its machine code; its bitcode is read when another kernel is compiled.

    Bitcode holds all that a kernel calls: reading it takes longer than loading the machine code.
    """
    name, kind, (machine_code, bitcode) = library
    engine = target_context.codegen()._engine
    engine._defined_symbols |= {
        described.llvm_func_name, described.llvm_cpython_wrapper_name,
        described.llvm_cfunc_wrapper_name, *(one.env_name for one in rest[-1])}
    result = compiler.CompileResult._rebuild(
        target_context, (name, kind, (machine_code, _no_bitcode())), described, *rest)

    @cache
    def read() -> Any:
        module = llvm.parse_bitcode(bitcode)
        engine._load_defined_symbols(module)
        return module

    result.library._get_module_for_linking = read
    return result


@cache
def _no_bitcode() -> bytes:
    return bytes(llvm.parse_assembly('').as_bitcode())


def _stem(kernel: Dispatcher, sources: str, target: tuple[str, ...]) -> str:
    """Return how the names of a kernel's files begin, of these sources and this compiler."""
    function = kernel.py_func
    name = f'{function.__module__}.{function.__qualname__}'.replace('<locals>.', '')
    return f'{name}-{_digest(sources, environment(), target)}'


def current_stems() -> set[str]:
    """Return how the names of files begin that are valid in this process, of imported kernels."""
    target = cpu_target.target_context.codegen().magic_tuple()
    return {_stem(kernel, fingerprint(kernel), target) for kernel in _KERNELS}


def _digest(*parts: object) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def _arguments(sig: Any) -> tuple[Any, ...]:
    return tuple(sig) if isinstance(sig, (tuple, list)) else tuple(sig.args)


@cache
def environment() -> tuple[Any, ...]:
    """Return what compiles: the versions of Python, numba, LLVM and numpy, and numba's settings."""
    numpy = np.__version__.split('.')[:2]
    settings = [(name, repr(getattr(numba.config, name, None))) for name in _SETTINGS]
    optimized = str(getattr(numba.config.OPT, '_raw_value', numba.config.OPT))
    return (sys.implementation.cache_tag, getattr(sys, 'abiflags', ''), numba.__version__,
            llvmlite.__version__, *numpy, optimized, *settings)


def accepted(target: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return the processors whose machine code this one runs, the best first.

    Parameters
    ----------
    target : tuple of str
        Target of the process, as numba writes it: triple, name, features.
    """
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
    """Compile for the processor of `generic` from now on.

    Raises
    ------
    RuntimeError
        This one does not run that, or a kernel has been imported already.
    """
    if not _runs_generic():
        raise RuntimeError(f'this processor does not run what is compiled for {generic()[0]}')
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = generic()
    if cpu_target.target_context.codegen().magic_tuple()[1:] != generic():
        raise RuntimeError('a kernel was imported before')


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
