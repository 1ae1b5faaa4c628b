# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What numba asks for machine code before it compiles a kernel, and gives it to afterwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, cached_property
from typing import Any

import llvmlite.binding as llvm
from numba.core import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

from dlo_planner.kernels import files, linking
from dlo_planner.kernels.fingerprint import Unseen, fingerprint
from dlo_planner.kernels.folders import folders
from dlo_planner.kernels.lean import Library

KERNELS: dict[Callable[..., Any], Dispatcher] = {}  # all that have been decorated, by function


class KernelCache(NullCache):  # type: ignore[misc]  # numba is not annotated
    """The machine code of one kernel, in files."""

    def __init__(self, kernel: Dispatcher) -> None:
        self._kernel = kernel
        KERNELS[kernel.py_func] = kernel

    @cached_property
    def sources(self) -> str:
        """The fingerprint of the kernel; Unseen is raised where there is none."""
        return fingerprint(self._kernel)

    @property
    def cache_path(self) -> str:
        """The folder that is written."""
        return str(folders().write)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled before, None if there is nothing or it cannot be read."""
        target_context.refresh()
        return self.load(_arguments(sig), target_context)

    def load(self, kinds: tuple[Any, ...], target_context: Any) -> Any:
        """Do what `load_overload` does in a context that is up to date."""
        for large, called, reduced in self._kept(kinds, 'kernel'):
            with suppress(Exception):
                for one in called:
                    linking.load(one)
                result = _rebuilt(target_context, *reduced)
                if tuple(result.signature.args) == kinds:
                    if large:
                        linking.keep_apart(self._kernel, result)
                    return result
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; where that cannot be done it stays in memory."""
        large = linking.is_large(self._kernel, data)
        if large:
            data.library.emit()
            linking.keep_apart(self._kernel, data)
        if not data.library.has_dynamic_globals and all(one.can_cache for one in data.lifted):
            called = linking.called_by(data.library)
            reduced = data._replace(type_annotation='')._reduce()  # a text for people
            self._keep(_arguments(sig), 'kernel', (large, called, reduced))

    def for_python(self, result: Any) -> Any:
        """Return what Python calls for a kernel that was compiled: loaded, or made and kept."""
        context, described = result.target_context.subtarget(enable_nrt=True), result.fndesc
        kinds = tuple(result.signature.args)
        for library, constants, called in self._kept(kinds, 'python'):
            with suppress(Exception):
                for one in called:
                    linking.load(one)
                loaded = _loaded(context.codegen(), library, described.llvm_cpython_wrapper_name)
                result.environment.consts[:] = constants
                return context.get_executable(loaded, described, result.environment)
        made = Library(context.codegen(), f'{described.llvm_func_name} for Python')
        made.enable_object_caching()
        made.add_linking_library(result.library)  # no code, if that is called where it is
        context.create_cpython_wrapper(made, described, result.environment, None,
                                       self._kernel.targetoptions.get('nogil', False))
        callable_ = context.get_executable(made, described, result.environment)
        made._get_module_for_linking = linking.no_code
        self._keep(kinds, 'python', (made.serialize_using_object_code(),
                                     list(result.environment.consts), linking.called_by(made)))
        return callable_

    def _kept(self, kinds: tuple[Any, ...], suffix: str) -> Iterator[Any]:
        """Yield what files hold, the best processor first."""
        with suppress(Unseen):
            yield from files.kept(self._key(kinds, suffix))

    def _keep(self, kinds: tuple[Any, ...], suffix: str, content: object) -> None:
        with suppress(Unseen):
            files.keep(self._key(kinds, suffix), content)

    def _key(self, kinds: tuple[Any, ...], suffix: str) -> files.Key:
        """Return what names a file.

        Raises
        ------
        Unseen
            A kernel that is handed over as an argument is in no fingerprint.
        """
        if any(isinstance(one, types.Callable) for one in kinds):
            raise Unseen('a kernel as argument')
        return files.Key(files.name_of(self._kernel), self.sources, kinds, suffix)


def _arguments(sig: Any) -> tuple[Any, ...]:
    return tuple(sig) if isinstance(sig, (tuple, list)) else tuple(sig.args)


def _rebuilt(target_context: Any, library: tuple[str, str, tuple[bytes, bytes]], described: Any,
             *rest: Any) -> Any:
    """Return a kernel with its machine code; bitcode is read when another kernel is compiled."""
    name, kind, (machine_code, bitcode) = library
    engine = target_context.codegen()._engine
    engine._defined_symbols |= {described.llvm_func_name, *(one.env_name for one in rest[-1])}
    no_code = linking.no_code().as_bitcode()
    result = CompileResult._rebuild(
        target_context, (name, kind, (machine_code, no_code)), described, *rest)
    if machine_code:
        result.library.emit()

    @cache
    def read() -> Any:
        module = llvm.parse_bitcode(bitcode)
        engine._load_defined_symbols(module)
        return module

    result.library._get_module_for_linking = read
    return result


def _loaded(codegen: Any, library: tuple[str, str, tuple[bytes, bytes]], symbol: str) -> Any:
    """Return a library with the machine code of one symbol."""
    loaded = codegen.unserialize_library(library)
    loaded.emit()
    codegen._engine._defined_symbols.add(symbol)
    return loaded
