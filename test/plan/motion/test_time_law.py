# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving averages of a motion against convolution, its derivatives, and what they calm."""

import pickle

import numpy as np
import pytest
from scipy.integrate import trapezoid

from dlo_planner import InvalidTask
from dlo_planner.trajectory.time_law import Shift, TimeLaw

PARAMETERS, RATES = np.array([0.5, 1.1, 2.9, 4.0]), np.array([0.0, 0.8, 0.5, 0.0])
WINDOWS = [[0.4], [0.9, 0.31], [0.5, 0.5], [1.3, 0.2, 0.77, 0.9], [8.0, 0.01]]


def law_of(windows, **more):
    return TimeLaw(PARAMETERS, RATES, windows, **more)


@pytest.mark.parametrize('windows', WINDOWS)
def test_it_is_the_convolution_with_every_window(windows):
    law, step = law_of(windows), 1e-3 * min(1.0, max(windows))
    spans = 2 * np.diff(PARAMETERS) / (RATES[1:] + RATES[:-1])
    assert law.duration == pytest.approx(spans.sum() + sum(windows))
    times = np.arange(0, law.duration, step)
    rate = np.interp(times, np.append(0, np.cumsum(spans)), RATES, right=0.0)
    for width in windows:
        window = np.ones(max(1, round(width / step)))
        rate = np.convolve(rate, window / window.size)[:times.size]
    place, found, *_ = law.at(times)
    assert np.abs(found - rate).max() < 6 * step * 2  # half a step for each window, slopes <= 2
    np.testing.assert_allclose(place, PARAMETERS[0] + np.cumsum(rate) * step, atol=6 * step)


@pytest.mark.parametrize('windows', WINDOWS)
def test_derivatives_are_those_of_the_way(windows):
    law = law_of(windows)
    step = 2e-6 * law.duration
    times = np.linspace(0.01, 0.99, 400) * law.duration
    known, before, after = (law.at(times + h) for h in (0, -step, step))
    for order in range(3):
        off = np.abs((after[order] - before[order]) / (2 * step) - known[order + 1])
        # the highest ones leap: at few instants they are those of neither side
        assert np.quantile(off, 0.97) < 1e-4 * max(1.0, np.abs(known[order + 1]).max())


@pytest.mark.parametrize('windows', WINDOWS)
def test_it_goes_from_rest_to_rest_and_never_back(windows):
    law = law_of(windows)
    ends = law.at(np.array([-1.0, 0.0, law.duration, law.duration + 5]))
    np.testing.assert_allclose(ends[0], PARAMETERS[[0, 0, -1, -1]], atol=1e-12)
    np.testing.assert_allclose(ends[1:3], 0, atol=1e-7)
    assert (law.at(np.linspace(0, law.duration, 5001))[1] > -1e-9).all()


def left(law, period):
    """Return the amplitude that is left of an oscillator without damping, times its w."""
    times = np.linspace(0, law.duration, 200_001)
    forced = law.at(times)[2] * np.exp(2j * np.pi / period * times)
    return np.abs(trapezoid(forced, times))


@pytest.mark.parametrize('period', [0.3, 0.7, 1.9])
def test_a_window_of_a_period_leaves_no_vibration_of_it(period):
    without = left(law_of([0.11]), period)
    assert without > 2e-3
    assert left(law_of([0.11, period]), period) < 1e-3 * without
    assert left(law_of([2 * period]), period) < 1e-2 * without  # nor one of a multiple
    # off by 5 %, a second window of that period leaves less
    off = 1.05 * period
    one, two = (left(law_of([0.11] + count * [period]), off) for count in (1, 2))
    assert two < 0.2 * one < 0.2 * left(law_of([0.11]), off)


@pytest.mark.parametrize('windows', WINDOWS)
def test_bounds_and_arrivals(windows):
    law = law_of(windows)
    found = np.abs(law.at(np.linspace(0, law.duration, 20_001))[2:]).max(axis=1)
    assert (found <= law.bounds * (1 + 1e-9)).all()
    if len(windows) == 1:
        np.testing.assert_allclose(found[0], law.bounds[0], rtol=0.2)
    u = np.linspace(0.6, 3.9, 23)
    np.testing.assert_allclose(law.at(law.arrivals(u))[0], u, atol=1e-9)
    slow = law.slower(2.0)
    assert slow.steps == pytest.approx(2 * law.steps) and slow.windows == pytest.approx(windows)


def test_it_is_a_value_and_bad_ones_are_named():
    shift = Shift(np.array([0.0] * 5 + [1.0] * 5), np.zeros((5, 3)))
    law = law_of([0.4], shift=shift)
    again = pickle.loads(pickle.dumps(law))
    assert again == law and law != law_of([0.4]) and law.slower(2.0).shift is None
    np.testing.assert_array_equal(again.at(np.array([1.0])), law.at(np.array([1.0])))
    for more, named in (((PARAMETERS, RATES[1:], [1.0]), 'TimeLaw.rates'),
                        ((PARAMETERS, RATES, 1.0), 'TimeLaw.windows'),
                        (('u', RATES, [1.0]), 'TimeLaw.parameters')):
        with pytest.raises(InvalidTask, match=named):
            TimeLaw(*more)
