# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Judging values that were computed before: they may be infinite, or nan where they are not known.

Values that users choose are judged by `model.checks`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import is_number, numbers_in, plain, shown


def figure(name: str, value: object, error: type[Exception] = InvalidTask) -> float:
    """Return a number that was computed as a float: it may be infinite, or nan if not known."""
    if not is_number(value):
        raise error(f'{name} = {shown(value)}: expected a number, infinity or nan')
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise error(f'{name} = {shown(value)}: expected a number, infinity or nan') from None


def results(name: str, value: Any, shape: tuple[int | None, ...],
            error: type[Exception] = InvalidTask) -> Floats:
    """Return an array (..) that was computed; its entries may be infinite, or nan if not known."""
    if (type(value) is np.ndarray and value.dtype == np.float64 and value.ndim == len(shape)
            and all(size is None or size == got
                    for size, got in zip(shape, value.shape, strict=True))):
        return value
    quick = plain(value, shape)
    if quick is not None:
        return quick
    sizes = ', '.join('n' if size is None else str(size) for size in shape)
    try:
        given = numbers_in(value)
        if given.dtype.kind not in 'iuf':
            raise TypeError
        given = given.astype(float)  # a new one
    except Exception:  # whatever its conversion raises
        raise error(f'{name} = {shown(value)}: expected numbers ({sizes})') from None
    if given.ndim != len(shape) or any(size is not None and size != got for size, got in
                                       zip(shape, given.shape, strict=True)):
        raise error(f'{name} has shape {given.shape}: expected numbers ({sizes})')
    return given
