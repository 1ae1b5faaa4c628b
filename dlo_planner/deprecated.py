# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Names of the version before: they work, with a warning, until the next version."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

_Function = TypeVar('_Function', bound=Callable[..., Any])
_Class = TypeVar('_Class', bound=type)


def renamed_arguments(**new_names: str) -> Callable[[_Function], _Function]:
    """Return a decorator with which a function still takes arguments by their old names.

    Parameters
    ----------
    new_names : str
        Old name = new name.
    """
    def decorate(function: _Function) -> _Function:
        @wraps(function)
        def with_new_names(*args: Any, **kwargs: Any) -> Any:
            for old, new in new_names.items():
                if old in kwargs:
                    warn_renamed(f'argument {old}', new)
                    if new in kwargs:
                        raise TypeError(f'{old} and {new} are one argument: expected {new} alone')
                    kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)
        return cast(_Function, with_new_names)
    return decorate


def renamed_fields(**new_names: str) -> Callable[[_Class], _Class]:
    """Return a decorator with which a class still takes and gives fields by their old names.

    Its attribute `renamed_fields` says them, for stored contents.

    Parameters
    ----------
    new_names : str
        Old name = new name.
    """
    def decorate(cls: _Class) -> _Class:
        cls.__init__ = renamed_arguments(**new_names)(cls.__init__)  # type: ignore[misc]
        for old, new in new_names.items():
            setattr(cls, old, renamed(old, new))
        cls.renamed_fields = new_names  # type: ignore[attr-defined]
        return cls
    return decorate


def renamed(old: str, new: str) -> property:
    """Return a property of an old name that gives the value or the method of the new one."""
    def get(self: object) -> Any:
        warn_renamed(f'{type(self).__name__}.{old}', new)
        return getattr(self, new)
    return property(get, doc=f'Deprecated name of `{new}`.')


def warn_renamed(old: str, new: str) -> None:
    """Warn whoever, outside the package, used an old name: only there the warning is shown."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and _inside(frame.f_globals.get('__name__', '')):
        level, frame = level + 1, frame.f_back
    warnings.warn(f'{old} is now {new}; the old name goes with the next version',
                  DeprecationWarning, stacklevel=level)


def _inside(module: str) -> bool:
    return module.split('.', maxsplit=1)[0] == __name__.split('.')[0]
