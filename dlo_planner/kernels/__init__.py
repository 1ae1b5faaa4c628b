# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The decorator of all kernels: compiled by numba once, plain Python where that is not wanted.

Machine code is kept between processes: `dispatcher` says what, `files` where. A kernel may read
constants, Records and other kernels by name; `fingerprint` says what it may not.

Without numba, or with NUMBA_DISABLE_JIT=1 (for a debugger, or to measure coverage), a kernel is the
Python function that is written: the same numbers, some hundred times slower. So it is with a numba
older than WANTED, which cannot compile what takes a Record.
"""

import re
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, ParamSpec, TypeVar, overload

WANTED = 'numba>=0.62'  # as in setup.py
_OLDEST = (0, 62)

try:
    import numba
    _known = tuple(map(int, re.findall(r'\d+', numba.__version__)[:2])) >= _OLDEST
    _lack = '' if _known else f'numba {numba.__version__} is too old'
except ImportError as error:
    _lack = f'numba cannot be imported ({error})'
if _lack:
    warnings.warn('dlo_planner computes in plain Python, some hundred times slower, because '
                  f'{_lack}: pip install "{WANTED}"', RuntimeWarning, stacklevel=2)

COMPILED = not _lack and not numba.config.DISABLE_JIT
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
    """
    if function is None:
        return partial(kernel, **options)
    if not COMPILED:
        return function
    # Python's lock is free while a kernel runs: threads work side by side, and a node sends its
    # commands on time while a shape is sought
    return Kernel.of(function, {'nogil': True} | options)
