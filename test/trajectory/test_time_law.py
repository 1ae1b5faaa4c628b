# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Laws in time: smoothed, within limits, the fastest ones."""

import pickle

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from dlo_planner import InvalidTask, Limits, Pose
from dlo_planner.plan.path import GripperPath
from dlo_planner.trajectory.time_law import DEGREE, Shift, TimeLaw
from dlo_planner.trajectory.timed_path import _bounds, _jerks, _sizes, _slopes, most_used, smoothed
from dlo_planner.trajectory.topp import DeviationBound, fastest_rates

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
    edges = np.linspace(0, law.duration, 38)
    known, near = law.bounds(edges[:-1], edges[1:]), []
    for k, (a, b) in enumerate(zip(edges, edges[1:], strict=False)):
        found = np.abs(law.at(np.linspace(a, b, 2001))[2:]).max(axis=1)
        assert (found <= known[:, k] * (1 + 1e-9) + 1e-9).all()
        near.append(found >= 0.5 * known[:, k])
    assert np.mean(near) > 0.7
    np.testing.assert_allclose(law.bounds(edges[:1], edges[-1:])[:, 0], known.max(axis=1))
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


KNOTS = np.concatenate([[0.0] * DEGREE, np.linspace(0, 3, 13), [3.0] * DEGREE])


@pytest.fixture
def shift(rng):
    coefficients = np.zeros((KNOTS.size - DEGREE - 1, 3))
    coefficients[DEGREE:-DEGREE] = 1e-3 * rng.normal(size=(len(coefficients) - 2 * DEGREE, 3))
    return Shift(KNOTS, coefficients)


def test_it_is_at_rest_at_both_ends_and_stays_there(shift):
    for order in range(4):
        np.testing.assert_allclose(shift.at(np.array([0.0, 3.0]), order), 0, atol=1e-12)
    np.testing.assert_array_equal(shift.at(np.array([-1.0, 4.0])), 0)
    assert np.abs(shift.at(np.array([1.5]))).max() > 1e-5


def test_derivatives_are_those_of_the_shift(shift):
    times, step = np.linspace(0.1, 2.9, 57), 1e-6
    for order in range(3):
        by = (shift.at(times + step, order) - shift.at(times - step, order)) / (2 * step)
        np.testing.assert_allclose(shift.at(times, order + 1), by, atol=1e-5, rtol=1e-5)


def test_bounds_are_not_below_what_is_sampled_and_not_far_above(shift):
    times = np.linspace(0, 3, 3001)
    for order, bound in enumerate(shift.most):
        found = np.linalg.norm(shift.at(times, order), axis=1).max()
        assert found <= bound <= 3 * found


def test_bad_ones_are_named():
    with pytest.raises(InvalidTask, match=r'Shift.coefficients'):
        Shift(KNOTS, np.zeros((3, 3)))
    with pytest.raises(InvalidTask, match=r'Shift.knots'):
        Shift('knots', np.zeros((3, 3)))


def wandering(rng):
    """Return a Leg through some poses."""
    position, turn, grippers = np.zeros(3), Rotation.identity(), []
    for _ in range(rng.integers(2, 8)):
        grippers.append(Pose.from_rotation(position, turn.as_matrix()))
        position = position + [0.1, *(0.04 * rng.normal(size=2))]
        turn = Rotation.from_rotvec(0.3 * rng.normal(size=3)) * turn
    return GripperPath.through(grippers, np.cumsum(rng.uniform(0.5, 2, len(grippers))), 1.0).legs[0]


def sampled(leg, law, limits):
    """Return the largest parts (3, 2) of limits at many instants; jerks are short means."""
    times = np.linspace(0, law.duration, 20_001)
    u, rate, change, _ = law.at(times)[:, :, None]
    _, _, first, second = leg.at(u[:, 0])
    speed, acceleration = rate * first, change * first + rate**2 * second
    return np.array([np.linalg.norm(v.reshape(-1, 2, 3), axis=2).max(axis=0) for v in (
        speed, acceleration, np.diff(acceleration, axis=0) / times[1])]) / limits.sizes


@pytest.mark.parametrize('limits', [
    Limits(), Limits(0.05, np.inf, np.inf, np.inf, np.inf, np.inf),
    Limits(np.inf, np.inf, 0.02, 0.05, np.inf, np.inf),
    Limits(np.inf, np.inf, np.inf, np.inf, 0.02, 0.1)], ids=['all', 'speed', 'change', 'jerk'])
def test_it_is_never_below_samples_and_not_far_above(rng, limits):
    for windows in ([0.3], [0.8, 0.5], [0.4, 1.1, 0.2]):
        leg = wandering(rng)
        law = TimeLaw(*fastest_rates(leg, Limits()), windows)
        used, found = most_used(leg, law, limits), sampled(leg, law, limits)
        assert used >= found.max() * (1 - 1e-9)
        if np.isfinite(limits.linear_jerk):
            assert used <= 2.5 * found.max()  # jerks are bounded: as if from -most to most
        else:
            assert used <= 1.006 * found.max()


def test_what_is_slowed_down_keeps_its_limits(rng):
    limits = Limits(0.1, 0.3, 0.05, 0.2, 0.3, 1.0)
    for windows in ([], [0.2], [1.0, 0.7]):
        leg = wandering(rng)
        law = smoothed(leg, limits, *fastest_rates(leg, limits), np.array(windows))
        assert sampled(leg, law, limits).max() <= 1 and most_used(leg, law, limits) <= 1
        assert most_used(leg, law, limits) > 0.95  # and no slower than that needs
        if windows:
            np.testing.assert_allclose(law.windows, windows)


class Steady:
    """A parameter of constant acceleration: no jerk of its own hides what the path adds."""

    def __init__(self, rate, change):
        self.rate, self.change = rate, change

    def bounds(self, a, _):
        return np.stack([np.full_like(a, abs(self.change)), np.zeros_like(a)])

    def at(self, times):
        u = self.rate * times + 0.5 * self.change * times**2
        return np.stack([u, self.rate + self.change * times, np.full_like(u, self.change), 0 * u])


@pytest.mark.parametrize(('rate', 'change'), [(1.0, 0.0), (0.2, 0.6), (1.3, -0.3)])
def test_slopes_and_jerks_are_bounded_within_every_interval(rate, change):
    angles, law = np.linspace(0, 2, 21), Steady(rate, change)
    circle, faster = ([Pose.from_rotation(place(a), Rotation.from_rotvec((0, 0, a)).as_matrix())
                       for a in angles] for place in (
        lambda a: (0.3 * np.cos(a), 0.3 * np.sin(a), 0), lambda a: (a**2, 0, 0)))
    for grippers in (circle, faster):
        leg, = GripperPath.through(grippers, angles, 1.0).legs
        edges = np.interp(angles, law.at(np.linspace(0, 1.4, 4001))[0], np.linspace(0, 1.4, 4001))
        edges = edges[edges < 1.3]
        ends = law.at(np.append(edges[:-1], edges[1:]))
        bounds = _bounds(leg, law, ends, edges[:-1], edges[1:])
        slopes, jerks = _slopes(bounds), _jerks(bounds)
        largest = np.zeros((2, 2))
        for k, (a, b) in enumerate(zip(edges, edges[1:], strict=False)):
            times = np.linspace(a + 1e-6, b - 1e-6, 201)
            step = times[1] - times[0]
            u, *rates = law.at(times)
            _, _, first, second = leg.at(u)
            changes = np.diff(rates[1][:, None] * first + rates[0][:, None] ** 2 * second, axis=0)
            sizes = _sizes(leg, np.stack([u, *rates]))
            steepest = np.abs(np.diff(sizes, axis=0)).max(axis=0) / step
            jerk = np.linalg.norm(changes.reshape(-1, 2, 3), axis=2).max(axis=0) / step
            assert (steepest <= slopes[k] * (1 + 1e-6) + 1e-6).all()
            assert (jerk <= jerks[k] * (1 + 1e-6) + 1e-6).all()
            largest = np.maximum(largest, [steepest[0] / np.maximum(slopes[k, 0], 1e-9),
                                           jerk / np.maximum(jerks[k], 1e-9)])
        assert largest.max() > 0.7  # and not bounded by far


class Swaying:
    """A parameter whose rate sways as a sine."""

    def bounds(self, a, b):
        return np.array([[2.0], [4.0]]) * np.ones_like(a)

    def at(self, times):
        sine, cosine = np.sin(2 * times), np.cos(2 * times)
        return np.stack([2 * times - 0.5 * cosine, 2 + sine, 2 * cosine, -4 * sine])


@pytest.mark.parametrize('peak', [0.25 * np.pi, 0.5 * np.pi], ids=['rate', 'change'])
def test_peaks_between_the_ends_are_bounded(peak):
    leg, law = wandering(np.random.default_rng(0)), Swaying()
    for half in (0.02, 0.2):
        ends = np.array([peak - half, peak + half])
        known = _bounds(leg, law, law.at(ends), ends[:1], ends[1:])
        _, rate, change, _ = np.abs(law.at(np.linspace(peak - half, peak + half, 1001))).max(axis=1)
        assert rate <= known.rate[0] <= rate + 4 * half
        assert change <= known.change[0] <= change + 8 * half


def test_a_bound_that_was_proved_early_still_counts(monkeypatch):
    # all that is found is 1; within the first second no more than 1.004 is proved at once, within
    # the other one 1.00375 after two halvings
    class Law:
        duration = 2.0

        def at(self, times):
            return np.stack([times, *np.zeros((3, len(times)))])

        def arrivals(self, knots):
            return np.array([1.0])

    known = {'_sizes': lambda _, ends: np.ones((ends.shape[1], 2, 2)),
             '_bounds': lambda _, __, ends, a, ___: ends[0, :a.size],  # where intervals begin
             '_slopes': lambda begins: np.ones((1, 2, 2)) * np.where(
                 begins < 1, 0.008, 0.03)[:, None, None],
             '_largest_jerk': lambda *_: 0.0}
    for name, function in known.items():
        monkeypatch.setattr(f'dlo_planner.trajectory.timed_path.{name}', function)
    leg = wandering(np.random.default_rng(0))
    assert most_used(leg, Law(), Limits(1, 1, 1, 1, 1, 1)) == pytest.approx(1.004, abs=1e-12)


LONG = 0.6
FREE = {'angular_speed': np.inf, 'angular_acceleration': np.inf}
POLYGON = np.cos(np.pi / 16)  # part of a disc's radius to which accelerations are kept


def leg_through(grippers, times=None):
    times = np.arange(len(grippers)) if times is None else times
    leg, = GripperPath.through(grippers, times, 1.0).legs
    return leg


STRAIGHT = leg_through([Pose((x, 0, 0), (0, 0, 0, 1)) for x in (0, LONG)])


def trapezoid_of(speed, acceleration, way):
    """Return the time of the fastest motion from rest to rest, and its rates at ways s."""
    def rates(s):
        return np.minimum(speed, np.sqrt(2 * acceleration * np.minimum(s, way - s)))

    top = min(speed, np.sqrt(acceleration * way))
    return way / top + top / acceleration, rates


def duration(u, rates):
    return TimeLaw(u, rates, [1e-6]).duration


@pytest.mark.parametrize(('speed', 'acceleration'), [(0.2, 0.5), (0.05, 0.5), (5.0, 0.5)])
def test_a_straight_way_is_a_trapezoid_or_a_triangle(speed, acceleration):
    u, rates = fastest_rates(STRAIGHT, Limits(speed, linear_acceleration=acceleration, **FREE))
    seconds, known = trapezoid_of(speed, acceleration * POLYGON, LONG)
    assert duration(u, rates) == pytest.approx(seconds, rel=0.01)
    np.testing.assert_allclose(LONG * rates, known(LONG * u), rtol=0.01, atol=1e-6)
    assert rates[0] == rates[-1] == 0


def test_a_turn_in_place_keeps_the_angular_limits():
    turned = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec((0, 0, 1.2)).as_matrix())
    leg = leg_through([Pose.identity(), turned])
    u, rates = fastest_rates(leg, Limits(angular_speed=0.4, angular_acceleration=0.3))
    seconds, known = trapezoid_of(0.4, 0.3 * POLYGON, 1.2)
    assert duration(u, rates) == pytest.approx(seconds, rel=0.01)
    np.testing.assert_allclose(1.2 * rates, known(1.2 * u), rtol=0.01, atol=1e-6)


def test_on_a_circle_the_centripetal_acceleration_limits_the_speed():
    radius, acceleration = 0.3, 0.05
    angles = np.linspace(0, 2.5, 26)
    leg = leg_through([Pose((radius * np.cos(a), radius * np.sin(a), 0), (0, 0, 0, 1))
                       for a in angles])
    u, rates = fastest_rates(leg, Limits(1.0, linear_acceleration=acceleration, **FREE))
    speeds = np.linalg.norm(leg.at(u)[2][:, :3], axis=1) * rates
    middle = (u > 8) & (u < 17)
    np.testing.assert_allclose(speeds[middle], np.sqrt(acceleration * radius), rtol=0.025)


@pytest.mark.parametrize('sign', [1, -1])
def test_a_bound_of_the_acceleration_that_binds(sign):
    limits = Limits(0.3, linear_acceleration=0.5, **FREE)
    places = np.array([0.0, 0.4, 1.0])
    slopes, none = np.full((3, 2), sign * np.array([2.0, 1e-3])), np.zeros((3, 2))
    bound = DeviationBound(places, slopes, none, np.full((3, 2), 0.5))
    u, rates = fastest_rates(STRAIGHT, limits, bound)
    seconds, _ = trapezoid_of(0.3, 0.25 * LONG, LONG)  # |2 u''| <= 0.5
    assert duration(u, rates) == pytest.approx(seconds, rel=0.01)
    loose = DeviationBound(places, slopes, none, np.full((3, 2), 50.0))
    assert duration(*fastest_rates(STRAIGHT, limits, loose)) == pytest.approx(
        duration(*fastest_rates(STRAIGHT, limits)))


@pytest.mark.parametrize('sign', [1, -1])
def test_a_bound_of_the_squared_rate_that_binds(sign):
    places = np.array([0.0, 1.0])
    bends = sign * np.array([[4.0], [16.0]])
    bound = DeviationBound(places, np.zeros((2, 1)), bends, np.full((2, 1), 0.04))
    u, rates = fastest_rates(STRAIGHT, Limits(0.3, linear_acceleration=5.0, **FREE), bound)
    middle = (u > 0.1) & (u < 0.9)
    np.testing.assert_allclose(rates[middle], np.sqrt(0.04 / (4 + 12 * u[middle])), rtol=1e-3)


def test_a_way_that_no_motion_keeps_is_refused_by_name():
    one = np.ones((2, 1))
    never = DeviationBound(np.array([0.0, 1.0]), one, one, -one)
    with pytest.raises(InvalidTask, match='limits: no motion'):
        fastest_rates(STRAIGHT, Limits(), never)
