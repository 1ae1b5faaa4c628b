# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The DLO's nearest place to a point, beside closed forms and a search over samples."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.direct.shape import kernel_arrays
from dlo_planner.geometry.kinematics import nearest_place
from dlo_planner.penalties import Through

LEVEL = Pose((0, 0, 0), (0, 0, 0, 1))


def arc(curvature, n_elements=7):
    """Return a weightless DLO of 1 m that is bent to a circle in the x-y plane."""
    rod = Rod(1.0, 0.0, 1.0, 0.7, natural_curvature=(0.0, curvature))
    simulator = DirectSimulator(rod, n_elements=n_elements, basis='local', gravity=(0, 0, 0))
    return simulator.solve(LEVEL)


def found(shape, point, after=0.0):
    place, point = np.empty((3, 3)), np.array(point, dtype=float)
    point.flags.writeable = False
    return nearest_place(shape.s, *kernel_arrays(shape), point, after, place), place


@pytest.mark.every(5)
@pytest.mark.parametrize('angle', [0.01, 0.3, 1.1, 2.0, 2.9])
@pytest.mark.parametrize('radius', [0.2, 0.9, 1.7])
def test_of_a_circle_it_is_at_the_angle_of_the_point(angle, radius):
    curvature = 3.0
    shape = arc(curvature)
    out = radius / curvature
    point = (out * np.sin(angle), (1 - radius * np.cos(angle)) / curvature, 0.05)
    s, place = found(shape, point)
    assert s == pytest.approx(angle / curvature, abs=1e-13)
    np.testing.assert_allclose(place[1], (np.cos(angle), np.sin(angle), 0), atol=1e-13)
    np.testing.assert_allclose(place[2], curvature * np.array([-np.sin(angle), np.cos(angle), 0]),
                               atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(place[0]), np.hypot((1 - radius) / curvature, 0.05),
                               atol=1e-13)


def test_ahead_of_the_free_end_it_aims():
    shape = arc(0.5)
    tip, tangent = shape.positions[-1], shape.tangents[-1]
    s, place = found(shape, tip + 0.3 * tangent + 0.02 * np.array([0, 0, 1.0]))
    assert s == pytest.approx(1.3, abs=1e-13)
    np.testing.assert_allclose(place, [(0, 0, -0.02), tangent, (0, 0, 0)], atol=1e-13)


def test_what_lies_before_an_arc_length_does_not_count():
    shape = arc(0.5)
    point = shape.positions[2] + (0, -0.1, 0)
    assert found(shape, point)[0] == pytest.approx(shape.s[2], abs=0.02)
    assert found(shape, point, 0.5)[0] == 0.5
    assert found(shape, point, 1.0)[0] == 1.0


def test_of_a_hanging_dlo_it_is_the_nearest_of_many_samples():
    rng = np.random.default_rng(5)
    shape = DirectSimulator(Rod(1.0, 0.1, (0.05, 0.5), 0.1), n_elements=24).solve(
        Pose.looking_along((0, 0, 0), (1, 0.5, 0.4)))
    for point in shape.positions[rng.integers(1, 25, 20)] + rng.normal(0, 0.05, (20, 3)):
        s, place = found(shape, point)
        away = np.linalg.norm(shape.positions_at(np.linspace(0, 1, 4001)) - point, axis=1)
        assert np.linalg.norm(place[0]) <= away.min() + 1e-12
        if s < 1.0:
            np.testing.assert_allclose(place[0], shape.frame_at(s)[1] - point, atol=1e-14)
            assert s == 0.0 or abs(place[0] @ place[1]) < 1e-12
        assert Through(point).passage(shape) == s
