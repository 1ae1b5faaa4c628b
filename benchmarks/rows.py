# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A row of the table: what is timed, per what, and how long it may take."""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

from benchmarks.rulers import FLOORS, warm_solve
from benchmarks.timing import Timed, Work, measure


@dataclass(frozen=True)
class Goal:
    """What a row is to reach.

    Attributes:
        limit: most that is allowed, for 'per s' least
        unit: 'ms', 's' or '' (an exponent): of the median; 'ms at worst'; 'per s': its inverse; or
            a ruler: times as long as it takes
    """

    limit: float
    unit: str

    def value(self, timed: Timed) -> float:
        """Return what is to be compared with the limit."""
        simple = {'ms': 1e3 * timed.median, 'us': 1e6 * timed.median, 's': timed.median,
                  'ms at worst': 1e3 * timed.worst, '': timed.median}
        if self.unit == 'per s':
            return 1 / timed.median
        return simple[self.unit] if self.unit in simple else timed.ratios[self.unit]

    def met(self, timed: Timed) -> bool:
        """Return whether it is reached."""
        value = self.value(timed)
        return value >= self.limit if self.unit == 'per s' else value <= self.limit

    def __str__(self):
        sign = '>=' if self.unit == 'per s' else '<='
        return f'{sign} {self.limit:g} {self.unit}'.strip()


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        name: what is timed
        goals: Goals
        time: function of a budget (s) that returns a Timed, in s per unit of the name
        unit: 's', 'ms', 'us', or '' for a bare number
        guarded: whether its ratio to the floor must not grow
        make: function that prepares its Work; None of what is no call
    """

    name: str
    goals: tuple[Goal, ...]
    time: Callable[[float], Timed]
    unit: str = 'ms'
    guarded: bool = True
    make: Callable[[], Work | list[Work]] | None = None


def row(name: str, make: Callable, *goals: Goal, floor: str = 'warm', unit: str = 'ms',
        others: dict[str, Callable] | None = None, clock: Callable = process_time) -> Row:
    """Return a Row of the Work (or a list of Works) that `make()` prepares.

    Args:
        floor: which of FLOORS its ratio is to
        others: name -> function that prepares another ruler
    """
    def time(budget):
        prepared = make()
        rulers = {'floor': FLOORS[floor](), 'solves': warm_solve()}
        rulers |= {other: prepare() for other, prepare in (others or {}).items()}
        calls = [prepared] if isinstance(prepared, Work) else prepared
        return measure(calls, rulers, budget, clock)

    return Row(name, goals, time, unit, make=make)
