"""Judging values that come from outside: one sentence that names argument, value and remedy."""

import numpy as np

from dlo_planner.errors import InvalidTask


def number(name, value, error=InvalidTask, *, minimum=None, above=None, maximum=None):
    """Return `value` as a finite float within the limits, or raise `error`.

    Args:
        name: how the caller knows the argument
        value: anything
        error: the class to raise
        minimum, above, maximum: closed lower, open lower and closed upper limit
    """
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise error(f'{name} = {value!r}: expected a number') from None
    wanted = []
    if minimum is not None:
        wanted.append(f'>= {minimum:g}')
    if above is not None:
        wanted.append(f'> {above:g}')
    if maximum is not None:
        wanted.append(f'<= {maximum:g}')
    good = (np.isfinite(result)
            and (minimum is None or result >= minimum)
            and (above is None or result > above)
            and (maximum is None or result <= maximum))
    if not good:
        raise error(f'{name} = {value!r}: expected a finite number {" and ".join(wanted)}'.rstrip())
    return result


def vector(name, value, size, error=InvalidTask):
    """Return `value` as a new float array of shape (size,), all finite, or raise `error`."""
    try:
        result = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise error(f'{name} = {value!r}: expected {size} numbers') from None
    if result.shape != (size,):
        raise error(f'{name} has shape {result.shape}: expected {size} numbers')
    if not np.isfinite(result).all():
        raise error(f'{name} = {result.tolist()}: expected {size} finite numbers')
    return result


def integer(name, value, error=InvalidTask, *, minimum, maximum):
    """Return `value` as an int in [minimum, maximum], or raise `error`."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not minimum <= value <= maximum:
        raise error(f'{name} = {value!r}: expected an integer from {minimum} to {maximum}')
    return int(value)


def choice(name, value, options, error=InvalidTask):
    """Return `value` if it is one of `options`, or raise `error`."""
    if value not in options:
        raise error(f'{name} = {value!r}: expected one of {", ".join(map(repr, options))}')
    return value
