# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels as numba's dispatchers, with machine code of their own where that saves compiling.

numba links all that a function calls into the function and optimizes it again. LLVM inlines what is
small; what is large would be compiled once more for each caller, to the same code. A large kernel
is a unit here: its callers hold its symbol, which this process resolves. Units are kept in files.

numba also writes, for each function, a second one for Python, which takes arrays and Records apart.
Most kernels are called by kernels only, so Python calls a function that does nothing but call the
kernel; it is compiled when Python first does.

Kept in files are units and what Python calls: numba asks for machine code before it compiles, and
gives it afterwards. Before machine code that calls units is read, those are loaded or compiled.
"""

from __future__ import annotations

import copy
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property
from importlib import import_module
from operator import attrgetter
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba.core import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher, OmittedArg
from numba.core.registry import CPUDispatcher

from dlo_planner.kernels import files
from dlo_planner.kernels.fingerprint import Unseen, fingerprint
from dlo_planner.kernels.references import KernelCompiler

_OPTIONS = {'nopython': True, 'boundscheck': None}  # those of numba.njit
_SMALL = 100  # instructions of a kernel that is copied; LLVM inlines up to about 50

KERNELS: dict[Callable[..., Any], Dispatcher] = {}  # all that have been decorated, by function

if hasattr(os, 'register_at_fork'):
    # a child has the thread alone that forked: what another one holds there is never given back
    os.register_at_fork(before=global_compiler_lock.acquire,
                        after_in_parent=global_compiler_lock.release,
                        after_in_child=global_compiler_lock.release)


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
        self.kernel.load(self.kinds)
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
        return str(files.folders().write)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled before, None if there is nothing or it cannot be read."""
        target_context.refresh()
        return self.load(_arguments(sig), target_context)

    def load(self, kinds: tuple[Any, ...], target_context: Any) -> Any:
        """Return the same for a context that knows all of numba."""
        with suppress(Unseen):
            for held in files.kept(key_of(self._kernel, kinds)):
                with suppress(Exception):
                    called, reduced = held
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
                library, *others = data._reduce()
                files.keep(key, (_called_by(data.library), (_not_copied(data, library), *others)))


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


def _not_copied(data: Any, library: Any) -> Any:
    """Return what numba keeps of machine code, without LLVM's of it, which callers would copy.

    numba reads that only to see which functions there are: their names are left.
    """
    name, kind, (code, _) = library
    known = {one.name for one in data.library.get_defined_functions()}
    names = known & {data.fndesc.llvm_func_name, data.fndesc.llvm_cpython_wrapper_name}
    named = llvm.parse_assembly('\n'.join(f'define void @"{one}"() {{ ret void }}'
                                          for one in sorted(names)))
    return name, kind, (code, named.as_bitcode())


def _arguments(sig: Any) -> tuple[Any, ...]:
    return tuple(sig) if isinstance(sig, (tuple, list)) else tuple(sig.args)


class Kernel(CPUDispatcher):  # type: ignore[misc]  # numba is not annotated
    """A compiled function that kernels can call at once, Python when it first does."""

    _cache: KernelCache

    @classmethod
    def of(cls, function: Callable[..., Any], options: dict[str, Any]) -> Kernel:
        """Return the kernel of a function, with numba's options."""
        kernel = cls(function, targetoptions=_OPTIONS | options | {
            'no_cpython_wrapper': True, 'no_cfunc_wrapper': True}, pipeline_class=KernelCompiler)
        kernel._cache = KernelCache(kernel, units_only=True)
        return kernel

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call by the types of arguments; numba makes a version for each constant."""
        return super().get_call_template(
            tuple(map(types.unliteral, args)),
            {name: types.unliteral(one) for name, one in dict(kws).items()})

    def load(self, kinds: tuple[Any, ...]) -> None:
        """Have an overload, for what is read just now under numba's lock.

        As `compile`, which would time every call of LLVM once more for each kernel on the way here.
        """
        if kinds in self.overloads:
            return
        result = self._cache.load(kinds, self.targetctx)
        if result is None:
            self.compile(kinds)
        else:
            self._cache_hits[kinds] += 1
            self.add_overload(result)

    def add_overload(self, result: Any) -> None:
        """Take what was compiled or loaded: kernels can call it, Python cannot."""
        kinds = tuple(result.signature.args)
        self.overloads[kinds] = result
        loaded = result.metadata is None  # which only units are
        if loaded or self._is_unit(result):
            with suppress(Unseen):
                self._call_where_it_is(kinds, result)

    def _is_unit(self, result: Any) -> bool:
        """Whether a kernel is too large to be copied, and another process can find it by name."""
        function = self.py_func
        if self.targetoptions.get('forceinline') or '<locals>' in function.__qualname__:
            return False
        try:
            if attrgetter(function.__qualname__)(sys.modules[function.__module__]) is not self:
                return False
        except (AttributeError, KeyError):
            return False
        code = result.library.get_function(result.fndesc.llvm_func_name)
        return str(code).count('\n  ') > _SMALL  # each on a line of its own

    def _call_where_it_is(self, kinds: tuple[Any, ...], result: Any) -> None:
        """Have kernels call a unit by its symbol, which is the same in each process."""
        unit = Unit.of(self, kinds)
        llvm.add_symbol(unit.symbol,
                        result.library.get_pointer_to_function(result.fndesc.llvm_func_name))
        described = copy.copy(result.fndesc)
        described.mangled_name = unit.symbol
        with suppress(KeyError):  # what is loaded is not known yet
            result.target_context.remove_user_function(result.entry_point)
        result.target_context.insert_user_function(result.entry_point, described)
        UNITS[unit.symbol] = unit

    @cached_property
    def for_python(self) -> Any:
        """The function that Python calls."""
        function = self.py_func
        names = ', '.join(self._compiler.pysig.parameters)
        scope = {'__name__': function.__module__, 'kernel': self}
        exec(f'def for_python({names}):\n    return kernel({names})', scope)
        called: Any = scope['for_python']
        called.__qualname__ = f'{function.__qualname__}.for_python'
        dispatcher = CPUDispatcher(called, targetoptions=_OPTIONS | {
            'nogil': self.targetoptions.get('nogil', False)})
        dispatcher._cache = KernelCache(dispatcher, units_only=False)
        return dispatcher

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        """Return what Python calls for arguments of these types; numba asks for it once."""
        kinds = tuple(types.Omitted(one.value) if isinstance(one, OmittedArg)
                      else self.typeof_pyval(one) for one in args)
        called = self.for_python.compile(kinds)
        self._insert([kind._code for kind in kinds], called, False)
        return called
