# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the machine code of a kernel depends on, as one number.

It covers the bytecode of the kernel and of all kernels and overloads that it reaches, their options
and defaults, and the values of the constants that they read, as numba sees them: by global name or
in a closure. It does not cover paths, times of files, line numbers, comments and docstrings.

What cannot be followed is refused by `Unseen`, so that nothing stale can be found: a module of
one's own (`module.f`: import the name), and values without an order or a definite text (sets,
dictionaries, lists, objects). test_fingerprint.py holds the package to it.
"""

from __future__ import annotations

import dis
import hashlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.typing.templates import builtin_registry

_EXACT = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), slice)
_VERSIONED = ('builtins', 'math', 'cmath', 'operator', 'numpy', 'numba')  # in the cache's key
_LOAD_GLOBAL, _EXTENDED_ARG = dis.opmap['LOAD_GLOBAL'], dis.opmap['EXTENDED_ARG']
# Kinds of parameters and functions; numba itself changes another flag where a profiler runs.
_KINDS = (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS | inspect.CO_GENERATOR | inspect.CO_COROUTINE
          | inspect.CO_ASYNC_GENERATOR | inspect.CO_NESTED)


class _Own(NamedTuple):
    """What a function is but for the functions that it reaches, and those, in order."""

    parts: bytes
    reached: tuple[FunctionType, ...]


class Unseen(TypeError):
    """A kernel depends on what a fingerprint cannot cover."""


def fingerprint(kernel: Dispatcher) -> str:
    """Return the name of all that the machine code of a kernel depends on, in its sources."""
    total = hashlib.sha256()
    for part in _walked(kernel, []):
        total.update(part)
        total.update(b'\0')
    return total.hexdigest()[:32]


def dependencies(kernel: Dispatcher) -> list[Callable[..., Any]]:
    """Return the functions that `fingerprint` covers: the kernel's own first."""
    functions: list[FunctionType] = []
    for _ in _walked(kernel, functions):
        pass
    return list(functions)


def _walked(kernel: Dispatcher, functions: list[FunctionType]) -> Iterator[bytes]:
    """Yield what a fingerprint covers; `functions` takes each function when it is first reached."""
    first: list[FunctionType] = []
    yield from _of_value(kernel, first)
    numbers: dict[FunctionType, int] = {}
    waiting = first
    while waiting:
        function = waiting.pop()
        if function in numbers:  # it may be recursive
            yield repr(numbers[function]).encode()
            continue
        numbers[function] = len(numbers)
        functions.append(function)
        own = _own(function)
        yield own.parts
        waiting.extend(reversed(own.reached))


def _of_value(value: Any, reached: list[FunctionType]) -> Iterator[bytes]:
    """Yield all that is known of a value; functions in it are appended to `reached`."""
    kind = type(value)
    yield f'{kind.__module__}.{kind.__qualname__}'.encode()
    if kind in _EXACT:
        yield repr(value).encode()
    elif isinstance(value, tuple):
        yield repr((len(value), getattr(value, '_fields', None))).encode()
        for item in value:
            yield from _of_value(item, reached)
    elif isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
        yield repr((value.dtype.descr, value.shape, value.flags.c_contiguous,
                    value.flags.f_contiguous, value.flags.aligned)).encode()
        yield value.tobytes()
    elif isinstance(value, Dispatcher):
        yield repr(sorted(value.targetoptions.items(), key=str)).encode()
        reached.append(value.py_func)
    elif isinstance(value, np.dtype):
        yield repr(value.descr).encode()
    elif _is_versioned(value):
        yield f'{getattr(value, "__module__", None)}.{value.__name__}'.encode()
    else:
        yield from _of_written(value, reached)


def _is_versioned(value: Any) -> bool:
    """Whether the version of a library tells what this is."""
    if isinstance(value, np.ufunc):
        return True
    if isinstance(value, ModuleType):
        home = value.__name__
    elif isinstance(value, (type, FunctionType, BuiltinFunctionType)) or hasattr(value, '__name__'):
        home = getattr(value, '__module__', None) or ''
    else:
        return False
    return home.split('.')[0] in _VERSIONED


def _of_written(value: Any, reached: list[FunctionType]) -> Iterator[bytes]:
    """Yield what is known of a class or function for which overloads write what is compiled."""
    if not isinstance(value, (type, FunctionType)):
        raise Unseen(f'{value!r} of {type(value).__qualname__}: a kernel reads numbers, tuples, '
                     'arrays, kernels and Records, each by its own name')
    stated = getattr(value, '__fingerprint__', None)
    written = [function.templates[0]._overload_func for name, function in builtin_registry.globals
               if name is value] if stated is None else []
    if stated is None and not written:
        raise Unseen(f'{value.__module__}.{value.__qualname__} is neither a kernel nor a Record')
    yield f'{value.__module__}.{value.__qualname__}'.encode()
    if stated is not None:
        yield from _of_value(stated(), reached)
    reached.extend(written)


@cache
def _own(function: FunctionType) -> _Own:
    """Return a function's bytecode and the values of what it reads."""
    reached: list[FunctionType] = []
    return _Own(b'\0'.join(_of_function(function, reached)), tuple(reached))


def _of_function(function: FunctionType, reached: list[FunctionType]) -> Iterator[bytes]:
    """Yield what `_own` returns."""
    yield f'{function.__module__}.{function.__qualname__}'.encode()
    names, parts = _scanned(function.__code__, function.__doc__ is not None)
    yield parts
    yield from _of_value((function.__defaults__, tuple(sorted((function.__kwdefaults__
                                                               or {}).items()))), reached)
    scope = function.__globals__
    built_in = scope['__builtins__']
    built_in = vars(built_in) if isinstance(built_in, ModuleType) else built_in
    for name in names:
        if name not in scope and name not in built_in:
            raise Unseen(f'{name}, which {function.__qualname__} reads, is not defined')
        yield from _of_value(scope[name] if name in scope else built_in[name], reached)
    for cell in function.__closure__ or ():
        yield from _of_value(cell.cell_contents, reached)


@cache
def _scanned(code: CodeType, documented: bool) -> tuple[tuple[str, ...], bytes]:
    """Return the global names that a code object loads, and all else that it is."""
    names: dict[str, None] = {}
    high, loads_first = 0, False
    raw = code.co_code
    for op, low in zip(raw[::2], raw[1::2], strict=True):
        argument = high | low
        high = argument << 8 if op == _EXTENDED_ARG else 0
        if op == _LOAD_GLOBAL:
            names[code.co_names[argument >> 1]] = None
        elif argument == 0 and op in dis.hasconst:
            loads_first = True
    parts = [raw, repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars,
                        code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount,
                        code.co_flags & _KINDS)).encode()]
    docstring = documented and not loads_first
    for constant in (None, *code.co_consts[1:]) if docstring else code.co_consts:
        if isinstance(constant, CodeType):
            more, part = _scanned(constant, False)
            names.update(dict.fromkeys(more))
            parts.append(part)
        else:
            parts += _of_value(constant, [])
    return tuple(names), b'\0'.join(parts)
