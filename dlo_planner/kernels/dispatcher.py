# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels as numba's dispatchers, with machine code of their own where that saves compiling.

numba links all that a function calls into the function and optimizes it again. LLVM inlines what is
small; what is large would be compiled once more for each caller, to the same code. A large kernel
is a unit here: its callers hold its symbol, which this process resolves. Units are kept in files.

numba also writes, for each function, a second one for Python, which takes arrays and Records apart.
Most kernels are called by kernels only, so Python calls a function that does nothing but call the
kernel; it is compiled when Python first does.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from operator import attrgetter
from typing import Any

import llvmlite.binding as llvm
from numba.core import types
from numba.core.dispatcher import OmittedArg
from numba.core.registry import CPUDispatcher

from dlo_planner.kernels.cache import UNITS, KernelCache, Unit
from dlo_planner.kernels.fingerprint import Unseen

_OPTIONS = {'nopython': True, 'boundscheck': None}  # those of numba.njit
_SMALL = 100  # instructions of a kernel that is copied; LLVM inlines up to about 50


class Kernel(CPUDispatcher):  # type: ignore[misc]  # numba is not annotated
    """A compiled function that kernels can call at once, Python when it first does."""

    _cache: KernelCache

    @classmethod
    def of(cls, function: Callable[..., Any], options: dict[str, Any]) -> Kernel:
        """Return the kernel of a function, with numba's options."""
        kernel = cls(function, targetoptions=_OPTIONS | options | {
            'no_cpython_wrapper': True, 'no_cfunc_wrapper': True})
        kernel._cache = KernelCache(kernel, units_only=True)
        return kernel

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call by the types of arguments; numba makes a version for each constant."""
        return super().get_call_template(
            tuple(map(types.unliteral, args)),
            {name: types.unliteral(one) for name, one in dict(kws).items()})

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
