# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The decorator of all kernels: compiled by numba once, plain Python where that is not wanted.

Machine code is kept between processes: `cache` says under which key, `folders` where. A kernel may
read constants, Records and other kernels by name; `fingerprint` says what it may not.

Without numba, or with NUMBA_DISABLE_JIT=1 (for a debugger, or to measure coverage), a kernel is the
Python function that is written: the same numbers, some hundred times slower.
"""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, ParamSpec, TypeVar, overload

try:
    import numba
except ImportError as error:
    numba = None
    warnings.warn(f'dlo_planner computes in plain Python, some hundred times slower, because numba '
                  f'cannot be imported ({error}): pip install numba', RuntimeWarning, stacklevel=2)

COMPILED = numba is not None and not numba.config.DISABLE_JIT
if COMPILED:
    from dlo_planner.kernels.dispatcher import Kernel


_P = ParamSpec('_P')
_R = TypeVar('_R')


@overload
def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]: ...


@overload
def kernel(**options: Any) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]: ...


def kernel(function: Any = None, **options: Any) -> Any:
    """Compile a function when it is first called, and keep what was compiled for the next process.

    Where nothing can be written it is compiled anew in each process.

    Parameters
    ----------
    options : object
        Options of `numba.njit`, but `cache`.
    """
    if function is None:
        return partial(kernel, **options)
    if not COMPILED:
        return function
    # Python's lock is free while a kernel runs: threads work side by side, and a node sends its
    # commands on time while a shape is sought
    return Kernel.of(function, {'nogil': True} | options)
