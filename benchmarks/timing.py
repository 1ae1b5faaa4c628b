# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How long calls take: medians and ratios within one run, in CPU time of this one thread."""

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import NamedTuple

import numpy as np

_LEAST = 1e-3   # s: shorter calls are repeated until they take as long
_ROUNDS = (5, 200)


@dataclass(frozen=True)
class Timed:
    """What was measured of some calls.

    Attributes:
        median, least, worst: s per unit of work: of the calls' own medians (least: of their
            quickest rounds)
        ratios: name of a ruler -> median over the rounds of the calls' median over the ruler's
        rounds: how often everything was measured
    """

    median: float
    least: float
    worst: float
    ratios: dict[str, float]
    rounds: int


def duration(call: Callable, clock: Callable = process_time) -> float:
    """Return how long a call takes, in s."""
    started = clock()
    call()
    return clock() - started


def batch(call: Callable) -> int:
    """Return how often a call has to be repeated so that its time can be read, after a warm up."""
    call()
    return max(1, int(_LEAST / max(duration(call), 1e-7)))


class Work(NamedTuple):
    """A function without arguments, and how many units of work it does."""

    call: Callable
    per: float = 1


def measure(calls: Sequence[Work], rulers: dict[str, Work], budget: float,
            clock: Callable = process_time) -> Timed:
    """Time calls and rulers by turns, so that what disturbs the machine disturbs all of them.

    Args:
        calls: each is timed on its own
        rulers: by name
        budget: s that all of it may take, about
    """
    counts = [batch(work.call) for work in calls]
    known = {name: batch(work.call) for name, work in rulers.items()}
    ended = perf_counter() + budget
    times, ratios = [], {name: [] for name in rulers}
    gc.collect()
    gc.disable()
    try:
        while len(times) < _ROUNDS[0] or len(times) < _ROUNDS[1] and perf_counter() < ended:
            units = {name: _repeated(rulers[name], known[name], clock) for name in rulers}
            times.append([_repeated(work, n, clock)
                          for work, n in zip(calls, counts, strict=True)])
            for name, unit in units.items():
                ratios[name].append(np.median(times[-1]) / unit)
    finally:
        gc.enable()
    each = np.median(times, axis=0)
    return Timed(float(np.median(each)), float(np.median(np.min(times, axis=0))),
                 float(each.max()), {name: float(np.median(row)) for name, row in ratios.items()},
                 len(times))


def _repeated(work, count, clock):
    call, started = work.call, clock()
    for _ in range(count):
        call()
    return (clock() - started) / (count * work.per)


def slope(counts: Sequence[float], seconds: Sequence[float]) -> float:
    """Return the seconds per count of the straight line that fits best (least squares)."""
    if np.ptp(counts) == 0:
        raise ValueError(f'counts = {list(counts)}: expected at least two different ones')
    return float(np.polyfit(counts, seconds, 1)[0])


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return p of the power law  seconds ~ sizes^p  that fits best in the logarithms."""
    if min(seconds) <= 0:
        raise ValueError(f'seconds = {list(seconds)}: expected all above 0')
    return slope(np.log(sizes), np.log(seconds))
