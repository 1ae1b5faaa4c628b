# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a value is: it does not change, and two that say the same are equal.

All that users get or give is such a value. Its arrays are read-only, so that nothing which was
computed from it can be changed through it.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import MISSING, Field, FrozenInstanceError, fields, is_dataclass
from math import isnan
from operator import is_
from typing import Any, NoReturn, Self, TypeVar

import numpy as np

_Kind = TypeVar('_Kind', bound='Value')
_LONGEST, _SHOWN = 160, 4  # characters of a repr; items of a sequence in it


class Value:
    """Base of `@dataclass(frozen=True, eq=False, repr=False)`, and of classes with `_PARTS`.

    Arrays in fields become read-only, equality and hash go by the content of all fields that are
    compared (`field(compare=True)`), copies are the value itself, pickles come back read-only
    (with the fields, and of what was computed since, what `_REMEMBERED` lists). A class with a
    `__post_init__` of its own ends it with `super().__post_init__()`; a class that is no dataclass
    lists what is compared in `_PARTS`, and makes itself with `put`.
    """

    _PARTS: tuple[str, ...] = ()
    _REMEMBERED: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, content in self.__dict__.items():
            own = owned(content)
            if own is not content:
                self.__dict__[name] = own

    def __setattr__(self, name: str, value: object) -> None:
        raise FrozenInstanceError(f'{type(self).__name__}.{name} cannot be set: values do not '
                                  'change')

    def __delattr__(self, name: str) -> None:
        raise FrozenInstanceError(f'{type(self).__name__}.{name} cannot be deleted: values do not '
                                  'change')

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, name), getattr(other, name)) for name in parts_of(self))

    def __hash__(self) -> int:
        return hash((type(self).__name__, *(_hashable(getattr(self, name))
                                            for name in parts_of(self))))

    def __repr__(self) -> str:
        """Say what differs from the defaults."""
        said = []
        items: tuple[Field[Any], ...] = fields(self) if is_dataclass(self) else ()
        for item in items:
            content = getattr(self, item.name)
            if item.repr and not (item.default is not MISSING and same(content, item.default)):
                said.append(f'{item.name}={figures(content)}')
        return brief(self, *said)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def __getstate__(self) -> dict[str, Any]:
        kept = {item.name for item in fields(self)} if is_dataclass(self) else set(self._PARTS)
        return {name: content for name, content in self.__dict__.items()
                if name in kept or name in self._REMEMBERED}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for content in state.values():
            freeze(content)


class Constant(Value):
    """A function that returns the same whatever it is called with; unlike a lambda it travels."""

    _PARTS = ('content',)

    content: Any

    def __init__(self, content: object) -> None:
        put(self, content=content)

    def __call__(self, *_: object) -> Any:
        """Return it."""
        return self.content


_SETTLED = Value, float, int, str, type(None)  # what needs no look


class FrozenDict(dict[Any, Any]):
    """A dict that does not change."""

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError('values do not change: expected dict(...) of it to be changed')

    __setitem__ = __delitem__ = __ior__ = update = pop = popitem = clear = setdefault = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)


def parts_of(value: Value) -> Sequence[str]:
    """Return the names of the fields by which values of a class are equal."""
    if is_dataclass(value):
        return [item.name for item in fields(value) if item.compare]
    return value._PARTS


def put(value: Value, **contents: object) -> None:
    """Set fields of a value while it is made."""
    value.__dict__.update(contents)


def changed(value: _Kind, **contents: object) -> _Kind:
    """Return the same dataclass with other contents of some fields, which are not judged.

    Else as `dataclasses.replace`, which looks at every array of every field once more.
    """
    other = object.__new__(type(value))
    known = value.__dict__
    other.__dict__.update({name: known[name] for name in fields_of(type(value)) if name in known})
    other.__dict__.update({name: owned(content) for name, content in contents.items()})
    return other


def fields_of(kind: type[Value]) -> Sequence[str]:
    """Return the names of the fields of a dataclass."""
    names: Sequence[str] = kind.__dataclass_fields__  # type: ignore[attr-defined]
    return names


def brief(value: Value, *parts: str) -> str:
    """Return the repr of a value in a line: its class and some texts.

    Parameters
    ----------
    parts : str
        Texts; empty ones are left out. Where the line would be too long it ends before one, for a
        number that is cut in two is another one; a first one that is too long by itself is cut.
    """
    parts = tuple(part for part in parts if part)
    text = ', '.join(parts)
    if len(text) > _LONGEST:
        known = [', '.join(parts[:k]) for k in range(1, len(parts))]
        text = max((one for one in known if len(one) <= _LONGEST), key=len,
                   default=text[:_LONGEST]) + ' ...'
    return f'{type(value).__name__}({text})'


def figures(content: Any) -> str:
    """Return a content in a few characters: up to four numbers in six digits, else how many."""
    if isinstance(content, float):
        return f'{content:.6g}'
    if isinstance(content, np.ndarray):
        content = content.tolist() if content.size <= _SHOWN else content
    if isinstance(content, np.ndarray):
        return 'x'.join(map(str, content.shape)) + ' numbers'
    if isinstance(content, tuple | list | dict):
        if len(content) > _SHOWN or content and isinstance(next(iter(content)), Value | tuple):
            return f'{len(content)} items'
        if isinstance(content, dict):
            return ', '.join(f'{key}: {figures(part)}' for key, part in content.items())
        return '(' + ', '.join(map(figures, content)) + ')'
    if callable(content) and hasattr(content, '__name__'):
        return str(content.__name__)
    return repr(content)


def owned(content: Any) -> Any:
    """Return a content that nobody else can change: arrays that could be written are copied.

    Arrays in tuples, lists and dicts too; what is read-only already stays what it is.
    """
    if isinstance(content, np.ndarray):
        if _can_be_written(content):
            content = content.copy()
            content.flags.writeable = False
    elif isinstance(content, tuple | list):
        parts = [part if isinstance(part, _SETTLED) else owned(part) for part in content]
        if not all(map(is_, parts, content)):
            make = getattr(type(content), '_make', type(content))  # of a NamedTuple
            return make(parts)
    elif isinstance(content, dict):
        known = {key: owned(part) for key, part in content.items()}
        if any(known[key] is not part for key, part in content.items()):
            return type(content)(known)
    return content


def _can_be_written(array: Any) -> bool:
    """Whether an array, or one that it is a view of, is not read-only."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return True
        array = array.base
    return False


def freeze(content: object) -> None:
    """Make arrays read-only, those in tuples, lists and dicts too."""
    if isinstance(content, np.ndarray):
        content.flags.writeable = False
    elif isinstance(content, tuple | list):
        for part in content:
            if not isinstance(part, Value):  # which has done it itself
                freeze(part)
    elif isinstance(content, dict):
        for part in content.values():
            freeze(part)


def read_only(given: Any) -> Any:
    """Return an array of floats as kernels take it from Python, of one kind for all.

    Read-only, in the order of C; what could be written is copied.
    """
    array = np.ascontiguousarray(given, dtype=float)
    if array.flags.writeable:
        array = array.copy() if array is given else array
        array.flags.writeable = False
    return array


def same(one: Any, other: Any) -> bool:
    """Whether two contents of fields are equal; nan equals nan."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)
                and one.shape == other.shape
                and np.array_equal(one, other, equal_nan=one.dtype.kind == 'f'))
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if is_dataclass(one) and not isinstance(one, Value) and type(one) is type(other):
        return all(same(getattr(one, item.name), getattr(other, item.name))
                   for item in fields(one) if item.compare)
    return bool(one == other) or _is_nan(one) and _is_nan(other)


def _hashable(content: Any) -> Hashable:
    if isinstance(content, np.ndarray):
        # -0.0 equals 0.0, and 1 equals 1.0
        return content.shape, (content + 0.0 if content.dtype.kind in 'iuf' else content).tobytes()
    if isinstance(content, tuple | list):
        return tuple(map(_hashable, content))
    if isinstance(content, dict):
        return frozenset((key, _hashable(part)) for key, part in content.items())
    return 'nan' if _is_nan(content) else content


def _is_nan(content: object) -> bool:
    return isinstance(content, float) and isnan(content)
