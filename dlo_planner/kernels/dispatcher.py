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
from typing import Any

from numba.core import types
from numba.core.dispatcher import OmittedArg
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

from dlo_planner.kernels.cache import KernelCache
from dlo_planner.kernels.lean import compiling
from dlo_planner.kernels.pipeline import Pipeline


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that other kernels can call at once, Python when it first does."""

    _cache: KernelCache
    _called: dict[tuple[Any, ...], Any]  # what Python calls, by types

    @classmethod
    def of(cls, function: Callable[..., Any], options: dict[str, Any]) -> Kernel:
        """Return the kernel of a function, with numba's options."""
        options = {'nopython': True, 'boundscheck': None, 'no_cpython_wrapper': True,
                   'no_cfunc_wrapper': True} | options
        kernel = cls(function, targetoptions=options, pipeline_class=Pipeline)
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
        self.compile(kinds)
        return self.overloads[kinds]

    def compile(self, sig: Any) -> Any:
        """Load or compile what is for types of arguments; numba asks for it, too.

        numba's own way takes the time of all that is below each level anew.
        """
        with compiling(), self._compiling_counter:
            if not self._can_compile:
                raise RuntimeError('compilation disabled')
            kinds, returned = normalize_signature(sig)
            if kinds in self.overloads:
                return self.overloads[kinds].entry_point
            result = self._cache.load(kinds, self.targetctx)
            if result is None:
                self._cache_misses[kinds] += 1
                result = self._compiler.compile(kinds, returned)
                self.add_overload(result)
                self._cache.save_overload(sig, result)
            else:
                self._cache_hits[kinds] += 1
                self.targetctx.insert_user_function(result.entry_point, result.fndesc,
                                                    [result.library])
                self.add_overload(result)
            return result.entry_point

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call by the types of arguments; numba makes a version for each constant."""
        return super().get_call_template(tuple(types.unliteral(one) for one in args), kws)

    def add_overload(self, result: Any) -> None:
        """Take what was compiled: kernels can call it."""
        self.overloads[tuple(result.signature.args)] = result

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        """Return what Python calls for arguments of these types; numba asks for it once."""
        super()._compile_for_args(*args, **kws)
        kinds = tuple(types.Omitted(one.value) if isinstance(one, OmittedArg)
                      else self.typeof_pyval(one) for one in args)
        with compiling():
            if kinds not in self._called:  # another thread may have asked
                called = self._called[kinds] = self._cache.for_python(self.overloads[kinds])
                self._insert([kind._code for kind in kinds], called, False)  # keeps no reference
        return self._called[kinds]
