# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a motion uses of its limits: never below dense samples, and close to them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Limits, Pose
from dlo_planner.plan.path import GripperPath
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.timed_path import _bounds, _jerks, _sizes, _slopes, most_used, smoothed
from dlo_planner.trajectory.topp import fastest_rates


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
        if windows:
            np.testing.assert_allclose(law.windows, windows)


class Steady:
    """A parameter of constant acceleration: no jerk of its own hides what the path adds."""

    def __init__(self, rate, change):
        self.rate, self.change, self.bounds = rate, change, np.array([abs(change), 0.0])

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
        bounds = _bounds(leg, law, ends, 0.5 * np.diff(edges))
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

    bounds = np.array([2.0, 4.0])

    def at(self, times):
        sine, cosine = np.sin(2 * times), np.cos(2 * times)
        return np.stack([2 * times - 0.5 * cosine, 2 + sine, 2 * cosine, -4 * sine])


@pytest.mark.parametrize('peak', [0.25 * np.pi, 0.5 * np.pi], ids=['rate', 'change'])
def test_peaks_between_the_ends_are_bounded(peak):
    leg, law = wandering(np.random.default_rng(0)), Swaying()
    for half in (0.02, 0.2):
        known = _bounds(leg, law, law.at(np.array([peak - half, peak + half])), np.array([half]))
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
             '_bounds': lambda _, __, ends, half: ends[0, :half.size],  # where intervals begin
             '_slopes': lambda begins: np.ones((1, 2, 2)) * np.where(
                 begins < 1, 0.008, 0.03)[:, None, None],
             '_largest_jerk': lambda *_: 0.0}
    for name, function in known.items():
        monkeypatch.setattr(f'dlo_planner.trajectory.timed_path.{name}', function)
    leg = wandering(np.random.default_rng(0))
    assert most_used(leg, Law(), Limits(1, 1, 1, 1, 1, 1)) == pytest.approx(1.004, abs=1e-12)
