# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Records as numba has them: pointers to structures that it lays out."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, ClassVar

from numba import types
from numba.experimental import structref
from numba.extending import overload

from dlo_planner.kernels import kernel


class Base(structref.StructRefProxy):  # type: ignore[misc]  # numba is not annotated
    """What numba gives to Python for such a pointer."""

    FIELDS: ClassVar[tuple[str, ...]]

    @classmethod
    def __fingerprint__(cls) -> tuple[Any, ...]:
        """Return what machine code that makes one depends on."""
        return cls.FIELDS, _RecordType.preprocess_fields.__code__.co_code


class _RecordType(types.StructRef):  # type: ignore[misc]
    def preprocess_fields(self, fields: Iterable[tuple[str, Any]]) -> tuple[tuple[str, Any], ...]:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


def declare(cls: type, fields: tuple[str, ...]) -> None:
    """Tell numba of a class of Records."""
    name = f'{cls.__name__}Type'
    kind = structref.register(type(name, (_RecordType,), {'__module__': cls.__module__}))
    setattr(sys.modules[cls.__module__], name, kind)  # numba's pickles look for it there
    structref.define_proxy(cls, kind, fields)


def _fields(record: Any) -> Any:
    raise NotImplementedError('for kernels only')


# (numba compares its signature with that of the written function: no annotations)
@overload(_fields)
def _fields_of(record):
    """Write the function that returns all fields of this kind of record."""
    names = [name for name, _ in record._fields]
    scope: dict[str, Any] = {}
    exec('def read(record):\n    return (' + ''.join(f'record.{name}, ' for name in names) + ')',
         scope)
    return scope['read']


@kernel
def read(record: Any) -> Any:
    """Return all fields of a Record, as a tuple."""
    return _fields(record)
