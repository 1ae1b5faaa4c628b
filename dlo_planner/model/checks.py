# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Judging what users give, and values that were computed, by name.

Each function returns the value as it is to be used: what is checked is what is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from difflib import get_close_matches
from itertools import islice
from numbers import Real
from typing import Any, TypeGuard, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.value import Constant, freeze

_Kind = TypeVar('_Kind')
_MOST = 1_000_000  # items of a sequence; some iterators never end
# what has items, or a buffer of numbers, but means something else
NO_SEQUENCE = (str, bytes, bytearray, memoryview, dict)
_LONGEST = 120    # characters of a value in a message
_EXTREME = 1e75   # beyond it, and below its inverse, products of four leave the range of floats


def shown(value: object) -> str:
    """Return a short repr of anything, for messages."""
    if isinstance(value, str | bytes):
        value = value[:_LONGEST]  # of a long one not all is looked at
    try:
        text = repr(value)
    except Exception:  # it must not hide what is wrong with the argument
        text = f'<{type(value).__name__} without a repr>'
    return text if len(text) <= _LONGEST else f'{text[:_LONGEST - 4]} ...'


def number(name: str, value: object, error: type[Exception] = InvalidTask, *,
           minimum: float = -np.inf, above: float = -np.inf, maximum: float = np.inf,
           below: float = np.inf, unit: str = '') -> float:
    """Return `value` as a finite float within the limits, or raise `error`; `unit`: of both.

    Numbers are Python's and NumPy's real ones; strings and booleans are none. Their size is at most
    1e75, and 1e-75 at least where they have to be above 0: products of a few stay finite.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not is_number(value):
        raise error(f'{name} = {shown(value)}: expected a number')
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        result = np.inf
    if not (np.isfinite(result) and minimum <= result <= maximum and above < result < below):
        limits = ('>=', minimum), ('>', above), ('<=', maximum), ('<', below)
        said = ' and '.join(f'{sign} {limit:g} {unit}'.rstrip()
                            for sign, limit in limits if np.isfinite(limit))
        raise error(f'{name} = {shown(value)}: expected a finite number {said}'.rstrip())
    if abs(result) > _EXTREME or above == 0 and result < 1 / _EXTREME:
        raise error(f'{name} = {shown(value)}: expected a size of at most {_EXTREME:g}'
                    f'{f" and at least {1 / _EXTREME:g}" if above == 0 else ""}')
    return result


def is_number(value: object) -> TypeGuard[Real]:
    """Whether it is a real number of Python or NumPy; durations, which NumPy counts in, are not."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_ | np.timedelta64)


def numbers_in(value: Any) -> NDArray[Any]:
    """Return `np.asarray` of it; raise TypeError for bytes, which that takes for numbers."""
    given = np.asarray(value)
    if given.dtype == np.uint8 and not isinstance(value, np.ndarray) and _of_bytes(value):
        raise TypeError
    return given


def _of_bytes(value: Any) -> bool:
    if isinstance(value, bytes | bytearray | memoryview):
        return True
    return isinstance(value, tuple | list) and any(map(_of_bytes, value))


def returned(name: str, function: Callable[[float], Any], s: float,
             error: type[Exception] = InvalidTask) -> Any:
    """Return what a user's function of arc length returns at `s`; raise `error` if it cannot."""
    try:
        return function(float(s))
    except Exception as problem:  # it is somebody else's function: any may come
        raise error(f'{name}({s:g}): {shown(function)} raised {type(problem).__name__}: '
                    f'{shown(str(problem))}') from problem


def array(name: str, value: Any, shape: tuple[int | None, ...],
          error: type[Exception] = InvalidTask, finite: bool | None = True) -> Floats:
    """Return `value` as a new float array, or raise `error`.

    `finite` says whether infinite entries, or, if it is None, nan too, are refused or let in.
    """
    result = _numbers(name, value, shape, error)
    if not result.size:
        raise error(f'{name} has shape {result.shape}: expected {_sizes(shape)}')
    if np.abs(result).max() <= _EXTREME:
        return result
    if finite is not None and np.isnan(result).any() or finite and not np.isfinite(result).all():
        raise error(f'{name} = {shown(result.tolist())}: expected finite {_sizes(shape)}')
    if (np.abs(result[np.isfinite(result)]) > _EXTREME).any():
        raise error(f'{name} = {shown(result.tolist())}: expected numbers of a size up to '
                    f'{_EXTREME:g}')
    return result


def _numbers(name: str, value: Any, shape: tuple[int | None, ...],
             error: type[Exception]) -> Floats:
    """Return real numbers of a shape as a new float array, whatever their size; else raise."""
    try:
        given = numbers_in(value)
    except Exception:  # whatever its conversion raises
        raise error(f'{name} = {shown(value)}: expected {_sizes(shape)}') from None
    if np.ma.is_masked(value):
        raise error(f'{name} = {shown(value)}: expected {_sizes(shape)}, none masked')
    numbers = _of_numbers(given) if given.dtype == object and given.size else given
    if numbers is None or numbers.dtype.kind not in 'iuf':
        raise error(f'{name} = {shown(value)}: expected {_sizes(shape)}')
    if numbers.ndim != len(shape) or any(size is not None and got != size for got, size
                                         in zip(numbers.shape, shape, strict=True)):
        raise error(f'{name} has shape {numbers.shape}: expected {_sizes(shape)}')
    with np.errstate(over='ignore'):  # of longer floats
        return np.array(numbers, dtype=float)


def _sizes(shape: tuple[int | None, ...]) -> str:
    if len(shape) == 1 and shape[0]:
        return f'{shape[0]} numbers'
    return f'numbers ({", ".join("n" if size is None else str(size) for size in shape)})'


def _of_numbers(given: NDArray[Any]) -> Floats | None:
    """Return an object array of numbers as floats, None if there is anything else in it."""
    if not all(map(is_number, given.flat)):
        return None
    try:
        return given.astype(float)
    except (TypeError, ValueError, OverflowError):
        return None


def row(name: str, value: Any, error: type[Exception] = InvalidTask, *, least: int = 1,
        most: int | None = None, minimum: float = -np.inf, above: float = -np.inf,
        maximum: float = np.inf, below: float = np.inf) -> Floats:
    """Return one number, or `least` to `most` of them, as a new float array (n,), or raise `error`.

    The limits are those of each, as for `number`.
    """
    if is_number(value) or isinstance(value, np.ndarray) and value.ndim == 0:
        value = [value]
    if not least and isinstance(value, tuple | list | np.ndarray) and len(value) == 0:
        return np.zeros(0)
    values = array(name, value, (None,), error, finite=None)
    if values.size < least or most is not None and values.size > most:
        raise error(f'{name} has {values.size} numbers: expected {least} at least'
                    f'{"" if most is None else f" and {most} at most"}')
    inside = (values >= minimum) & (values <= maximum) & (values > above) & (values < below)
    inside &= np.abs(values) <= _EXTREME
    if above == 0:
        inside &= values >= 1 / _EXTREME
    for index in np.flatnonzero(~inside):
        number(f'{name}[{index}]', float(values[index]), error, minimum=minimum, above=above,
               maximum=maximum, below=below)
    return values


def vector(name: str, value: Any, size: int) -> Floats:
    """Return `value` as a new float array of shape (size,), all finite, or raise InvalidTask."""
    given: Any = value
    if type(value) is np.ndarray and value.dtype == float and value.ndim == 1:
        given = value.tolist()
    if (type(given) in (tuple, list) and len(given) == size
            and all(type(one) in (float, int) and -_EXTREME <= one <= _EXTREME for one in given)):
        return np.array(given, dtype=float)
    return array(name, value, (size,))


def direction(name: str, value: Any) -> Floats:
    """Return a vector (3,) of any length but zero as a new unit vector, or raise InvalidTask."""
    value = vector(name, value, 3)
    size = np.abs(value).max()
    if size == 0:
        raise InvalidTask(f'{name} = {value.tolist()}: expected a vector that is not zero')
    value = value / size
    unit: Floats = value / np.linalg.norm(value)
    return unit


def integer(name: str, value: Any, *, minimum: int, maximum: int) -> int:
    """Return `value` as an int in [minimum, maximum], or raise InvalidTask."""
    whole = isinstance(value, int | np.integer) and is_number(value)
    if not whole or not minimum <= value <= maximum:
        raise InvalidTask(f'{name} = {shown(value)}: expected an integer from {minimum} to '
                          f'{maximum}')
    return int(value)


def choice(name: str, value: object, options: Iterable[str],
           error: type[Exception] = InvalidTask) -> str:
    """Return `value` if it is one of the strings `options`, or raise `error`."""
    if not isinstance(value, str) or value not in options:
        raise error(f'{name} = {shown(value)}: expected one of {", ".join(map(repr, options))}')
    return value


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """Return ', did you mean ...?' with the known name that is nearest, '' if none is near."""
    by_lower = {one.lower(): one for one in known}
    text = given[:_LONGEST].lower() if isinstance(given, str) else ''
    near = get_close_matches(text, by_lower, 1)
    return f', did you mean {by_lower[near[0]]}?' if near else ''


def known_keys(name: str, content: Mapping[Any, Any], known: Iterable[str]) -> None:
    """Raise InvalidTask that names the first key of a dict that is none of those known."""
    known = tuple(known)
    for key in content:
        if key not in known:
            said = key if isinstance(key, str) and len(key) <= _LONGEST else shown(key)
            raise InvalidTask(f'{name}.{said}: expected one of {", ".join(known)}'
                              f'{did_you_mean(key, known)}')


def flag(name: str, value: object) -> bool:
    """Return `value` as a bool if it is one, or raise InvalidTask."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidTask(f'{name} = {shown(value)}: expected True or False')
    return bool(value)


def instance(name: str, value: object, kinds: type | tuple[type, ...],
             error: type[Exception] = InvalidTask, *, optional: bool = False) -> Any:
    """Return `value` if it is of one of the classes `kinds` (or None if `optional`), or raise."""
    if isinstance(value, kinds) or optional and value is None:
        return value
    names = _named(kinds) + (' or None' if optional else '')
    raise error(f'{name} = {shown(value)}: expected {names}')


@overload
def items(name: str, value: object, kinds: type[_Kind], *,
          least: int = 0) -> tuple[_Kind, ...]: ...


@overload
def items(name: str, value: object, kinds: tuple[type, ...], *,
          least: int = 0) -> tuple[Any, ...]: ...


def items(name: str, value: object, kinds: type | tuple[type, ...], *,
          least: int = 0) -> tuple[Any, ...]:
    """Return an iterable of instances of `kinds` as a tuple of `least` items or more, or raise."""
    if isinstance(value, NO_SEQUENCE) or not isinstance(value, Iterable):
        raise InvalidTask(f'{name} = {shown(value)}: expected a sequence of {_named(kinds)}')
    try:
        result = tuple(islice(value, _MOST + 1))
    except Exception:  # whatever its iteration raises
        raise InvalidTask(
            f'{name} = {shown(value)}: expected a sequence of {_named(kinds)}') from None
    if len(result) > _MOST:
        raise InvalidTask(f'{name} = {shown(value)}: expected at most {_MOST} of {_named(kinds)}')
    if len(result) < least:
        raise InvalidTask(f'{name} = {shown(value)}: expected {least} or more of {_named(kinds)}')
    if set(map(type, result)) != {kinds}:  # a look at each of many takes a while
        for index, item in enumerate(result):
            if not isinstance(item, kinds):
                instance(f'{name}[{index}]', item, kinds)
    return result


def callback(name: str, value: Any, error: type[Exception] = InvalidTask) -> Any:
    """Return `value` if it is callable or None, or raise `error`."""
    if value is not None and not callable(value):
        raise error(f'{name} = {shown(value)}: expected a function or None')
    return value


def _named(kinds: type | tuple[type, ...]) -> str:
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    return ', '.join(kind.__name__ for kind in kinds)


# ------------------------------------------------------------------------------------------------
# Values that were computed before: they may be infinite, or nan where they are not known.


def figure(name: str, value: object) -> float:
    """Return a number that was computed as a float: it may be infinite, or nan if not known."""
    if is_number(value):
        with suppress(TypeError, ValueError, OverflowError):
            return float(value)
    raise InvalidTask(f'{name} = {shown(value)}: expected a number, infinity or nan')


def estimate(name: str, function: Any, n: int) -> Callable[..., Floats]:
    """Return a function that says n errors when they are asked for, nan if it is None; or raise."""
    function = Constant(np.full(n, np.nan)) if function is None else function
    if not callable(function):
        raise InvalidTask(f'{name} = {shown(function)}: expected a function')
    if isinstance(function, Constant):
        freeze(function.content)
    result: Callable[..., Floats] = function
    return result


def results(name: str, value: Any, shape: tuple[int | None, ...]) -> Floats:
    """Return an array (..) that was computed; its entries may be infinite, or nan if not known."""
    if (type(value) is np.ndarray and value.dtype == np.float64 and value.ndim == len(shape)
            and all(size is None or size == got
                    for size, got in zip(shape, value.shape, strict=True))):
        return value
    return _numbers(name, value, shape, InvalidTask)
