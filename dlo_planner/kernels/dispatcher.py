# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels as numba knows them, compiled in less time than by `numba.njit`.

Two things took most of it. numba copies all that a function calls into the function, then optimizes
it all again; a large kernel is too large to be inlined, so this gains nothing: `linking` has it
called instead. And numba makes for each function a second one that Python can call, which takes
each array and Record apart; most kernels are called by kernels only, so that one is made when
Python calls a kernel for the first time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba.core import types
from numba.core.compiler import Compiler, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.dispatcher import OmittedArg
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NopythonTypeInference

from dlo_planner.kernels.cache import KERNELS, KernelCache
from dlo_planner.kernels.fingerprint import Unseen


@register_pass(mutates_CFG=False, analysis_only=True)
class _NameBySources(AnalysisPass):  # type: ignore[misc]  # numba is not annotated
    """Give the machine code a name that is the same in each process.

    Kernels that are kept in different files call each other by it.
    """

    _name = 'dlo_planner_name_by_sources'

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        with suppress(Unseen):  # what is in no file needs no name
            state.func_id.unique_id = int(KERNELS[state.func_id.func].sources[:16], 16)
        return False


class _Pipeline(Compiler):  # type: ignore[misc]
    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_NameBySources, NopythonTypeInference)
        passes.finalize()
        return [passes]


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that other kernels can call at once, Python when it first does."""

    _cache: KernelCache
    _called: dict[tuple[Any, ...], Any]  # what Python calls, by types

    @classmethod
    def of(cls, function: Callable[..., Any], options: dict[str, Any]) -> Kernel:
        """Return the kernel of a function, with numba's options."""
        options = {'nopython': True, 'boundscheck': None, 'no_cpython_wrapper': True,
                   'no_cfunc_wrapper': True} | options
        kernel = cls(function, targetoptions=options, pipeline_class=_Pipeline)
        kernel._cache, kernel._called = KernelCache(kernel), {}
        return kernel

    @property
    def sources(self) -> str:
        """The fingerprint of all that it is compiled from.

        Raises
        ------
        Unseen
            It reads what cannot be followed.
        """
        return self._cache.sources

    def loaded(self, kinds: tuple[Any, ...], sources: str) -> Any:
        """Return what is kept for types of arguments, compiled where it is not.

        Parameters
        ----------
        kinds : tuple of numba.types.Type
            The types.
        sources : str
            The kernel's fingerprint, which follows from that of a kernel that calls it.
        """
        self._cache.sources = sources
        if kinds not in self.overloads:
            # numba's own way takes the time of all that is below each level anew
            result = self._cache.load(kinds, self.targetctx)
            if result is None:
                self.compile(kinds)
            else:
                self._cache_hits[kinds] += 1
                self.targetctx.insert_user_function(result.entry_point, result.fndesc,
                                                    [result.library])
                self.add_overload(result)
        return self.overloads[kinds]

    def add_overload(self, result: Any) -> None:
        """Take what was compiled: kernels can call it."""
        self.overloads[tuple(result.signature.args)] = result

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        """Return what Python calls for arguments of these types; numba asks for it once."""
        super()._compile_for_args(*args, **kws)
        kinds = tuple(types.Omitted(one.value) if isinstance(one, OmittedArg)
                      else self.typeof_pyval(one) for one in args)
        with global_compiler_lock:
            if kinds not in self._called:  # another thread may have asked
                called = self._called[kinds] = self._cache.for_python(self.overloads[kinds])
                self._insert([kind._code for kind in kinds], called, False)  # keeps no reference
        return self._called[kinds]
