# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Named bundles of arrays that kernels take by reference, and sums of arrays (n, 3)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, Self

from dlo_planner.kernels import COMPILED, kernel

# ------------------------------------------------------------------------------------------------
# Named bundles of arrays that kernels take by reference.
#
# numba passes a named tuple field by field, array by array, through every call: with a dozen
# arrays that is what compiling mostly does, and a call from Python costs more than small kernels
# take. A Record is one pointer (numba's structref). Its fields never change, the
# arrays' contents may. Where kernels are plain Python, so is a Record.


if COMPILED:
    from numba import types
    from numba.experimental import structref
    from numba.extending import overload

    class Base(structref.StructRefProxy):  # type: ignore[misc]  # numba is not annotated
        """What numba gives to Python for such a pointer."""

        FIELDS: ClassVar[tuple[str, ...]]

        @classmethod
        def __fingerprint__(cls) -> tuple[Any, ...]:
            """Return what machine code that makes one depends on."""
            return cls.FIELDS, _RecordType.preprocess_fields.__code__.co_code

    class _RecordType(types.StructRef):  # type: ignore[misc]
        def preprocess_fields(self, fields: Iterable[tuple[str, Any]]
                              ) -> tuple[tuple[str, Any], ...]:
            return tuple((name, types.unliteral(kind)) for name, kind in fields)

    def declare(cls: type, fields: tuple[str, ...]) -> None:
        """Tell numba of a class of Records."""
        name = f'{cls.__name__}Type'
        kind = structref.register(type(name, (_RecordType,), {'__module__': cls.__module__}))
        setattr(sys.modules[cls.__module__], name, kind)  # numba's pickles look for it there
        kind.made_by = cls
        structref.define_proxy(cls, kind, fields)

    def _fields(record: Any) -> Any:
        raise NotImplementedError('for kernels only')

    # (numba compares its signature with that of the written function: no annotations)
    @overload(_fields)
    def _fields_of(record):
        """Write the function that returns all fields of this kind of record."""
        names = [name for name, _ in record._fields]
        scope: dict[str, Any] = {}
        values = ''.join(f'record.{name}, ' for name in names)
        exec(f'def read(record):\n    return ({values})', scope)
        return scope['read']

    @kernel(forceinline=True)
    def read(record: Any) -> Any:
        """Return all fields of a Record, as a tuple."""
        return _fields(record)
else:
    Base = object  # type: ignore[assignment, misc]


class Record(Base):
    """Base of a bundle: its fields are the annotations of the class, in order.

    In kernels `Kind(...)` makes one. For Python a kernel does it that is written at the first one.
    """

    FIELDS: ClassVar[tuple[str, ...]] = ()
    _make: ClassVar[Callable[..., Any] | None] = None

    def __init_subclass__(cls) -> None:
        cls.FIELDS, cls._make = tuple(cls.__annotations__), None
        if COMPILED:
            declare(cls, cls.FIELDS)

    def __new__(cls, *values: Any) -> Self:
        """Return the record of all fields in order."""
        if COMPILED and cls._make is None:
            cls._make = staticmethod(_maker(cls))
        record = cls._make(*values) if cls._make else super().__new__(cls)
        record.__dict__.update(zip(cls.FIELDS, values, strict=True))
        result: Self = record
        return result

    def __getattr__(self, name: str) -> Any:
        """Read the fields of a record that comes from a kernel, once."""
        if name not in self.FIELDS or not COMPILED:
            raise AttributeError(name)
        self.__dict__.update(zip(self.FIELDS, read(self), strict=True))
        return self.__dict__[name]

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to set a field: the kernels would not see it."""
        if name in self.FIELDS:
            raise AttributeError(f'{type(self).__name__}.{name} cannot be set: use _replace')
        super().__setattr__(name, value)

    def _replace(self, **changes: Any) -> Self:
        """Return the same record with other values of some fields."""
        getattr(self, self.FIELDS[0])  # all are read with the first one
        fields = {**self.__dict__, **changes}
        return type(self)(*[fields[name] for name in self.FIELDS])

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self.FIELDS)


def _maker(kind: type[Record]) -> Callable[..., Any]:
    """Return the kernel that makes a Record of its fields for Python.

    Its parameters are written out: numba looks at the types in a tuple slowly.
    """
    fields = ', '.join(kind.FIELDS)
    scope: dict[str, Any] = {'__name__': kind.__module__, 'Kind': kind}
    exec(f'def _new_{kind.__name__}({fields}):\n    return Kind({fields})', scope)
    result: Callable[..., Any] = kernel(scope[f'_new_{kind.__name__}'])
    return result


def replaced(record: Any, *changes: Any) -> Any:
    """Return the same Record with other values of some fields: a name, its value, and so on.

    For kernels, whose constants the names are; elsewhere there is `_replace`.
    """
    return Record._replace(record, **dict(zip(changes[::2], changes[1::2], strict=True)))


if COMPILED:
    @overload(replaced, prefer_literal=True)
    def _replaced_by(record, *changes):
        """Write the function that makes such a record."""
        values = {getattr(name, 'literal_value', None): f'changes[{2 * k + 1}]'
                  for k, name in enumerate(changes[::2])}
        fields = ', '.join(values.pop(name, f'record.{name}') for name, _ in record._fields)
        scope: dict[str, Any] = {'Kind': record.made_by}
        exec(f'def make(record, *changes):\n    return Kind({fields})', scope)
        return None if values else scope['make']  # a field that there is none of


# ------------------------------------------------------------------------------------------------
# Sums of arrays (n, 3), in loops: an array expression takes a compiler a hundred times longer.


@kernel
def copy(a, out):
    """Fill out (n, 3) with a (n, 3)."""
    for e in range(out.shape[0]):
        for i in range(3):
            out[e, i] = a[e, i]


@kernel
def put_sum(a, factor, b, out):
    """Fill out (n, 3) with a (n, 3) and a factor times b (n, 3)."""
    for e in range(out.shape[0]):
        for i in range(3):
            out[e, i] = a[e, i] + factor * b[e, i]


@kernel
def scaled_by(factor, a):
    """Multiply a (n, 3) by a factor."""
    for e in range(a.shape[0]):
        for i in range(3):
            a[e, i] *= factor
