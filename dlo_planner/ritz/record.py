# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Named bundles of arrays that kernels take by reference.

numba passes a named tuple field by field, array by array, through every call: with a dozen arrays
that is what compiling mostly does, and a call from Python costs more than small kernels take. A
Record is one pointer (numba's structref, see `boxed`). Its fields never change, the arrays'
contents may. Where kernels are plain Python, so is a Record.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Self, TypeVar

from dlo_planner.kernels import COMPILED

if COMPILED:
    from dlo_planner.ritz.boxed import Base, declare, read
else:
    Base = object  # type: ignore[assignment, misc]

_Kernel = TypeVar('_Kernel', bound=Callable[..., Any])


class Record(Base):
    """Base of a bundle: its fields are the annotations of the class, in order.

    In kernels `Kind(...)` makes one. For Python, the module of the class has a kernel that does it,
    named by `makes`.
    """

    FIELDS: ClassVar[tuple[str, ...]] = ()
    _make: ClassVar[Callable[..., Any]]

    def __init_subclass__(cls) -> None:
        cls.FIELDS = tuple(cls.__annotations__)
        if COMPILED:
            declare(cls, cls.FIELDS)

    def __new__(cls, *values: Any) -> Self:
        """Return the record of all fields in order."""
        record = cls._make(*values) if COMPILED else super().__new__(cls)
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


def makes(kind: type[Record]) -> Callable[[_Kernel], _Kernel]:
    """Decorate the kernel that makes the Record `kind` of its fields for Python.

    Its parameters are written out: numba looks at the types in a tuple slowly.
    """
    def take(kernel: _Kernel) -> _Kernel:
        kind._make = staticmethod(kernel)
        return kernel
    return take
