# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Quantities as users state them: numbers, pairs, tables and functions of s, judged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dlo_planner.errors import InvalidRod
from dlo_planner.model.along import Along, Components, Table
from dlo_planner.model.checks import NO_SEQUENCE, array, number, shown

ONE = 'one'  # how a value is written that is a single number


def varying(name: str, content: Any, written: str = ONE, **limits: float) -> Along:
    """Return a quantity as a user states it: a float, a tuple of floats, or a function of s.

    Parameters
    ----------
    name : str
        Name by which the user knows it.
    content : object
        A number, ((s, value), ...) or a callable of s; a pair also by its components.
    written : str, optional
        How a value is: ONE number, or a pair.
    limits : float
        Limits of each number, as for `checks.number`.

    Raises
    ------
    InvalidRod
        Anything else.
    """
    if callable(content):
        result: Along = content
        return result
    if _is_table(content):
        return _table(name, content, written, limits)
    if written == ONE:
        return number(name, content, InvalidRod, **limits)
    parts = pair(name, content, written, varying, **limits)
    return Components(parts) if any(map(callable, parts)) else parts


def pair(name: str, value: Any, written: str, judged: Callable[..., Any] | None = None,
         **limits: float) -> tuple[Any, Any]:
    """Return a pair of numbers. One number gives both, if `written` allows it.

    Parameters
    ----------
    written : str
        'a or (b, c)' where one number does, '(b, c)' where it does not.
    judged : callable, optional
        Function that judges a component. If None, it is a number.

    Raises
    ------
    InvalidRod
        Something else.
    """
    sizes = (1, 2) if ' or ' in written else (2,)
    parts = value if is_row(value) else [value]
    if len(parts) not in sizes:
        raise InvalidRod(f'{name} = {shown(value)}: expected {written}')
    ends = parts[0], parts[-1]
    if judged is None:
        judged = _number
    first, second = (judged(name, part, **limits) for part in ends)
    return first, second


def _number(name: str, value: object, **limits: float) -> float:
    return number(name, value, InvalidRod, **limits)


def is_row(value: object) -> bool:
    """Return whether a value has an index: a tuple, list, (n,) array or array of ROS parameters."""
    return (hasattr(value, '__getitem__') and hasattr(value, '__len__')
            and not isinstance(value, NO_SEQUENCE) and getattr(value, 'ndim', 1) == 1)


def _is_table(content: Any) -> bool:
    """Whether it looks like rows (s, value): pairs that begin with a number."""
    if isinstance(content, np.ndarray) and content.ndim == 2:
        return True
    if not is_row(content) or isinstance(content, np.ndarray) or not len(content):
        return False
    return all(is_row(part) and len(part) == 2 and np.ndim(part[0]) == 0 for part in content)


def _table(name: str, content: Any, written: str, limits: dict[str, float]) -> Table:
    expected = (f'{name} = {shown(content)}: expected rows (s, value) with s ascending, at most '
                'two at the same s')
    try:
        places = [part[0] for part in content]
        values = [part[1] if len(part) == 2 else part[1:] for part in content]
    except Exception:  # whatever its iteration raises
        raise InvalidRod(expected) from None
    s = array(f'{name} s', places, (None,), InvalidRod)
    if (np.diff(s) < 0).any() or np.equal(s[2:], s[:-2]).any():
        raise InvalidRod(expected)
    if written != ONE:
        return Table(s, np.array([pair(name, value, written, None, **limits)
                                  for value in values]))
    return Table(s, np.array([number(name, value, InvalidRod, **limits) for value in values]))
