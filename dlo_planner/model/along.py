"""Functions of arc length that are values: they can be compared and sent to other processes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.model.value import Value


@dataclass(frozen=True, eq=False, repr=False)
class SeenFrom(Value):
    """A function of arc length as one of the distance from `at` (m), one way or the other.

    Attributes:
        known: the function; way: 1 on, -1 back
        signs: factors of the components that it returns; (): none
    """

    known: Callable
    at: float
    way: int
    signs: tuple = ()

    def __call__(self, s):
        """Return the function's value at the distance `s` (m)."""
        value = self.known(self.at + self.way * s)
        return np.asarray(value) * self.signs if self.signs else value


@dataclass(frozen=True, eq=False, repr=False)
class Stepwise(Value):
    """Constant on each element of a mesh.

    Attributes:
        s: (N + 1,) nodes, m
        values: (N, ...) of the elements
    """

    s: np.ndarray
    values: np.ndarray

    def __call__(self, s):
        """Return the value of the element that holds `s` (m)."""
        element = np.searchsorted(self.s, s, side='right') - 1
        return self.values[min(max(int(element), 0), len(self.values) - 1)]


@dataclass(frozen=True, eq=False, repr=False)
class Scaled(Value):
    """A function times a number."""

    known: Callable
    factor: float

    def __call__(self, s):
        """Return the product at `s` (m)."""
        return self.factor * self.known(s)


@dataclass(frozen=True, eq=False, repr=False)
class Shifted(Value):
    """A function plus a constant."""

    known: Callable
    shift: np.ndarray

    def __call__(self, s):
        """Return the sum at `s` (m)."""
        return np.asarray(self.known(s)) + self.shift
