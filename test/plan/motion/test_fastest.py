# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The fastest rates against closed forms: trapezoids, triangles, circles, and what a DLO bears."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import InvalidTask, Limits, Pose
from dlo_planner.plan.path import GripperPath
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.topp import Bearing, fastest_rates

LONG = 0.6
FREE = {'angular_speed': np.inf, 'angular_acceleration': np.inf}
POLYGON = np.cos(np.pi / 16)  # part of a disc's radius to which accelerations are kept


def leg_through(grippers, times=None):
    times = np.arange(len(grippers)) if times is None else times
    leg, = GripperPath.through(grippers, times, 1.0).legs
    return leg


STRAIGHT = leg_through([Pose((x, 0, 0), (0, 0, 0, 1)) for x in (0, LONG)])


def trapezoid(speed, acceleration, way):
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
    seconds, known = trapezoid(speed, acceleration * POLYGON, LONG)
    assert duration(u, rates) == pytest.approx(seconds, rel=0.01)
    np.testing.assert_allclose(LONG * rates, known(LONG * u), rtol=0.01, atol=1e-6)
    assert rates[0] == rates[-1] == 0


def test_a_turn_in_place_keeps_the_angular_limits():
    turned = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec((0, 0, 1.2)).as_matrix())
    leg = leg_through([Pose.identity(), turned])
    u, rates = fastest_rates(leg, Limits(angular_speed=0.4, angular_acceleration=0.3))
    seconds, known = trapezoid(0.4, 0.3 * POLYGON, 1.2)
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
def test_a_bearing_of_the_acceleration_that_binds(sign):
    limits = Limits(0.3, linear_acceleration=0.5, **FREE)
    places = np.array([0.0, 0.4, 1.0])
    slopes, none = np.full((3, 2), sign * np.array([2.0, 1e-3])), np.zeros((3, 2))
    bearing = Bearing(places, slopes, none, np.full((3, 2), 0.5))
    u, rates = fastest_rates(STRAIGHT, limits, bearing)
    seconds, _ = trapezoid(0.3, 0.25 * LONG, LONG)  # |2 u''| <= 0.5
    assert duration(u, rates) == pytest.approx(seconds, rel=0.01)
    loose = Bearing(places, slopes, none, np.full((3, 2), 50.0))
    assert duration(*fastest_rates(STRAIGHT, limits, loose)) == pytest.approx(
        duration(*fastest_rates(STRAIGHT, limits)))


@pytest.mark.parametrize('sign', [1, -1])
def test_a_bearing_of_the_squared_rate_that_binds(sign):
    places = np.array([0.0, 1.0])
    bends = sign * np.array([[4.0], [16.0]])
    bearing = Bearing(places, np.zeros((2, 1)), bends, np.full((2, 1), 0.04))
    u, rates = fastest_rates(STRAIGHT, Limits(0.3, linear_acceleration=5.0, **FREE), bearing)
    middle = (u > 0.1) & (u < 0.9)
    np.testing.assert_allclose(rates[middle], np.sqrt(0.04 / (4 + 12 * u[middle])), rtol=1e-3)


def test_a_way_that_cannot_be_borne_is_refused_by_name():
    never = Bearing(np.array([0.0, 1.0]), np.ones((2, 1)), np.ones((2, 1)), np.full((2, 1), -1.0))
    with pytest.raises(InvalidTask, match='limits: no motion'):
        fastest_rates(STRAIGHT, Limits(), never)
