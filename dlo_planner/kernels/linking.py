# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which kernels are copied into those that call them, and which are called where they are.

numba links the machine-independent code of all that a function calls into it, and optimizes the
whole again. LLVM inlines what is small; what is large is compiled once more for each caller, to the
same code. Here a large kernel stays where it is: the caller holds its symbol, which the process
resolves, and before the caller's machine code is read from a file, the kernels that it calls are.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba.core import types

from dlo_planner.kernels.fingerprint import Unseen

_SMALL = 100  # instructions of a kernel that is copied; LLVM inlines up to about 50


class Called(NamedTuple):
    """A kernel that another one calls: where it is written, its fingerprint, types and symbol."""

    module: str
    name: str
    sources: str
    kinds: tuple[Any, ...]
    symbol: str


_LARGE: dict[str, Called] = {}  # of this process, by symbol


def is_large(kernel: Any, result: Any) -> bool:
    """Whether a kernel that was compiled is too large to be copied into others.

    Parameters
    ----------
    kernel : Kernel
        The kernel.
    result : numba.core.compiler.CompileResult
        What was compiled of it.
    """
    handed_over = any(isinstance(one, types.Callable) for one in result.signature.args)
    if handed_over or '<locals>' in kernel.py_func.__qualname__:
        return False  # another process would not find it
    if kernel.targetoptions.get('forceinline'):
        return False
    code = result.library._final_module.get_function(result.fndesc.llvm_func_name)
    return str(code).count('\n  ') > _SMALL  # each on a line of its own


def keep_apart(kernel: Any, result: Any) -> None:
    """Have others call a kernel in place of copying it."""
    function, symbol = kernel.py_func, result.fndesc.llvm_func_name
    with suppress(Unseen):  # those that call it are in no file
        _LARGE[symbol] = Called(function.__module__, function.__qualname__, kernel.sources,
                                tuple(result.signature.args), symbol)
    result.library._get_module_for_linking = no_code


@cache
def no_code() -> Any:
    """Return a module that adds nothing to the one that it is linked with."""
    return llvm.parse_assembly('')


def called_by(library: Any) -> tuple[Called, ...]:
    """Return the kernels whose symbols machine code holds."""
    return tuple(_LARGE[one.name] for one in library._final_module.functions
                 if one.is_declaration and one.name in _LARGE)


def load(called: Called) -> None:
    """Load or compile a kernel that machine code calls which is about to be read.

    Raises
    ------
    LookupError
        It has another symbol now, or is copied into those that call it, as it may be where it is
        compiled for another processor: the machine code that calls it is of no use.
    """
    result = kernel_of(called).loaded(called.kinds, called.sources)
    if result.fndesc.llvm_func_name != called.symbol or called.symbol not in _LARGE:
        raise LookupError(called.symbol)


def kernel_of(called: Called) -> Any:
    """Return the kernel that is called."""
    kernel: Any = import_module(called.module)
    for name in called.name.split('.'):
        kernel = getattr(kernel, name)
    return kernel
