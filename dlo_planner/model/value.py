"""What a value is: it does not change, and two that say the same are equal.

All that users get or give is a frozen dataclass with numpy arrays in it; those are read-only, so
that nothing which was computed from a value can be changed through it.
"""

from dataclasses import fields, is_dataclass
from math import isnan

import numpy as np


class Value:
    """Base of `@dataclass(frozen=True, eq=False)` classes.

    Arrays in fields become read-only, equality and hash go by the content of all fields that are
    compared (`field(compare=True)`), copies are the value itself, pickles come back read-only. A
    class with a `__post_init__` of its own ends it with `super().__post_init__()`.
    """

    def __post_init__(self):
        for item in fields(self):
            freeze(self.__dict__.get(item.name))

    def __eq__(self, other):
        if self is other:
            return True
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, item.name), getattr(other, item.name))
                   for item in fields(self) if item.compare)

    def __hash__(self):
        return hash((type(self).__name__, *(_hashable(getattr(self, item.name))
                                            for item in fields(self) if item.compare)))

    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self

    def __setstate__(self, state):
        self.__dict__.update(state)
        for content in state.values():
            freeze(content)


def put(value, **contents):
    """Set fields of a frozen dataclass while it is made."""
    for name, content in contents.items():
        object.__setattr__(value, name, content)


def freeze(content):
    """Make arrays read-only, those in tuples, lists and dicts too."""
    if isinstance(content, np.ndarray):
        content.flags.writeable = False
    elif isinstance(content, tuple | list):
        for part in content:
            freeze(part)
    elif isinstance(content, dict):
        for part in content.values():
            freeze(part)


def same(one, other):
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


def _hashable(content):
    if isinstance(content, np.ndarray):
        # -0.0 equals 0.0
        return content.shape, (content + 0.0 if content.dtype.kind == 'f' else content).tobytes()
    if isinstance(content, tuple | list):
        return tuple(map(_hashable, content))
    if isinstance(content, dict):
        return frozenset((key, _hashable(part)) for key, part in content.items())
    return 'nan' if _is_nan(content) else content


def _is_nan(content):
    return isinstance(content, float) and isnan(content)
