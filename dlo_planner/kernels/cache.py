# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What numba asks for machine code before it compiles a kernel, and gives it to afterwards.

Kept are units (see `dispatcher`) and what Python calls. Before machine code that calls units is
read from a file, those are loaded or compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from operator import attrgetter
from typing import Any, NamedTuple

from numba.core import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

from dlo_planner.kernels import files
from dlo_planner.kernels.fingerprint import Unseen, fingerprint
from dlo_planner.kernels.folders import folders

KERNELS: dict[Callable[..., Any], Dispatcher] = {}  # all that have been decorated, by function


class Unit(NamedTuple):
    """A kernel that others call by a symbol: where it is written, its types and that symbol."""

    module: str
    name: str
    kinds: tuple[Any, ...]
    symbol: str

    @classmethod
    def of(cls, kernel: Dispatcher, kinds: tuple[Any, ...]) -> Unit:
        """Return the unit of a kernel; its symbol follows from its sources and types."""
        function = kernel.py_func
        return cls(function.__module__, function.__qualname__, kinds,
                   key_of(kernel, kinds).file(()))

    @property
    def kernel(self) -> Any:
        """The kernel."""
        return attrgetter(self.name)(import_module(self.module))

    def load(self) -> None:
        """Load or compile it: machine code that calls it is about to be read."""
        self.kernel.compile(self.kinds)
        if self.symbol not in UNITS:
            raise LookupError(self.symbol)


UNITS: dict[str, Unit] = {}  # of this process, by symbol


class KernelCache(NullCache):  # type: ignore[misc]  # numba is not annotated
    """The machine code of one kernel, in files."""

    def __init__(self, kernel: Dispatcher, units_only: bool) -> None:
        self._kernel, self._units_only = kernel, units_only
        KERNELS[kernel.py_func] = kernel

    @property
    def cache_path(self) -> str:
        """The folder that is written."""
        return str(folders().write)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled before, None if there is nothing or it cannot be read."""
        kinds = _arguments(sig)
        with suppress(Unseen):
            for called, reduced in files.kept(key_of(self._kernel, kinds)):
                with suppress(Exception):
                    target_context.refresh()
                    for one in called:
                        one.load()
                    result = CompileResult._rebuild(target_context, *reduced)
                    if tuple(result.signature.args) == kinds:
                        return result
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; where that cannot be done it stays in memory."""
        if data.library.has_dynamic_globals or data.lifted:
            return
        with suppress(Unseen):
            key = key_of(self._kernel, _arguments(sig))
            if not self._units_only or key.file(()) in UNITS:
                data = data._replace(type_annotation='')  # a text for people
                files.keep(key, (_called_by(data.library), data._reduce()))


def key_of(kernel: Dispatcher, kinds: tuple[Any, ...]) -> files.Key:
    """Return what names the file of a kernel."""
    if any(isinstance(one, types.Callable) for one in kinds):
        raise Unseen('a kernel as argument')
    return files.Key(files.name_of(kernel), _sources(kernel), kinds)


_sources = cache(fingerprint)


def _called_by(library: Any) -> tuple[Unit, ...]:
    """Return the units whose symbols machine code holds."""
    return tuple(UNITS[one.name] for one in library._final_module.functions
                 if one.is_declaration and one.name in UNITS)


def _arguments(sig: Any) -> tuple[Any, ...]:
    return tuple(sig) if isinstance(sig, (tuple, list)) else tuple(sig.args)
