# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Slopes, exponents and ratios are what they are called."""

from itertools import count

import numpy as np
import pytest

from benchmarks.timing import Timed, Work, exponent, measure, slope


def test_slope_and_exponent():
    sizes = np.array([64, 256, 1024.0])
    assert slope(sizes, 3 + 0.5 * sizes) == pytest.approx(0.5)
    assert exponent(sizes, 7 * sizes**1.25) == pytest.approx(1.25)


def test_what_tells_nothing_is_refused():
    with pytest.raises(ValueError, match='two different'):
        slope([4, 4], [1, 2])
    with pytest.raises(ValueError, match='above 0'):
        exponent([1, 2], [0, 1])


class Clock:
    """A clock that goes on by what the calls say they take."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now

    def takes(self, seconds):
        def call():
            self.now += seconds
        return call


def test_ratios_are_per_unit_of_work():
    clock = Clock()
    timed = measure([Work(clock.takes(6.0), 3)], {'ruler': Work(clock.takes(1.0), 2)}, 0.0, clock)
    assert timed.median == pytest.approx(2.0)
    assert timed.ratios['ruler'] == pytest.approx(4.0)


def test_a_machine_that_gets_slower_changes_times_but_no_ratio():
    clock, slower = Clock(), count(1)

    def ruler():
        clock.now += next(slower)

    def work():
        clock.now += 5 * next(slower)

    timed = measure([Work(work)], {'ruler': Work(ruler)}, 0.0, clock)
    assert timed.least < timed.median < timed.worst + 1
    assert 5 < timed.ratios['ruler'] < 7


def test_the_worst_is_of_the_slowest_call():
    clock = Clock()
    calls = [Work(clock.takes(seconds)) for seconds in (1.0, 2.0, 9.0)]
    timed = measure(calls, {}, 0.0, clock)
    assert (timed.median, timed.worst) == (2.0, 9.0)
    assert isinstance(timed, Timed)
