# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cords that stretch, touch and swing, against closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.special import j0, jn_zeros

from benchmarks.cosserat.cord import Cord, recorded, settled
from benchmarks.cosserat.stretch import Stretch
from benchmarks.cosserat.swinging import swung
from benchmarks.cosserat.touching import pressed

pytestmark = pytest.mark.sweep  # the package has tests of its own

DENSITY, RADIUS, G = 1000.0, 5e-3, 9.81
AREA = np.pi * RADIUS**2


def cord(nodes, beside, n, far_grip, young=1e6, radius=RADIUS, grip='pinned'):
    nodes = np.array([np.interp(np.linspace(0, len(nodes) - 1, n + 1), range(len(nodes)), row)
                      for row in np.transpose(nodes)]).T
    return Cord(1.0, radius, DENSITY, young, young / 3, nodes, np.tile(beside, (n, 1)), grip,
                far_grip, np.zeros(3), np.array([0.0, 0.0, -G]))


def test_arc_lengths_there_and_back():
    free = np.linspace(0, 1, 5)
    stretch = Stretch.along(free, np.array([0.0, 0.01, 0.02, 0.1]))
    np.testing.assert_allclose(stretch.to_free(stretch.to_stretched(free)), free)
    assert stretch.length == pytest.approx(1 + 0.25 * 0.13)
    mass = stretch.times(3.0, -1)
    assert sum(mass(s) * h for s, h in zip(stretch.stretched[:-1] + 1e-9, np.diff(
        stretch.stretched), strict=True)) == pytest.approx(3.0)


def test_a_hanging_cord_is_as_long_as_its_weight_makes_it():
    hanging = cord([(0, 0, 0), (0, 0, -1)], (1, 0, 0), 20, None, young=1e5)
    shape, stretch = settled(hanging)
    assert stretch.length - 1 == pytest.approx(DENSITY * G / (2 * 1e5), rel=1e-3)
    assert shape.positions[-1, 2] == pytest.approx(-stretch.length, rel=1e-6)
    positions, directors = recorded(hanging, shape, stretch)
    assert positions.shape == (21, 3)
    np.testing.assert_allclose(np.linalg.norm(directors, axis=1), 1)


def test_elastic_catenary():
    """Thin, so that it hardly resists bending: T s / EA + T / w (asinh ...), as in textbooks."""
    radius, young, span = 5e-4, 1e6, 0.8
    area = np.pi * radius**2
    w, axial = DENSITY * area * G, young * area

    def along(tension, s):
        return (tension * s / axial + tension / w
                * (np.arcsinh((w * s - w / 2) / tension) + np.arcsinh(w / 2 / tension)))

    tension = brentq(lambda t: along(t, 1.0) - span, 1e-3 * w, 1e3 * w)
    sag = ((w / 8 - w / 4) / axial + (tension - np.hypot(tension, w / 2)) / w)
    hanging = cord([(0, 0, 0), (0.4, 0, -0.3), (0.8, 0, 0)], (0, 1, 0), 60, 'pinned', young, radius)
    shape, stretch = settled(hanging)
    middle = shape.positions_at([stretch.to_stretched(0.5)])[0]
    assert middle == pytest.approx([0.4, 0, sag], abs=5e-4)


def test_two_cords_touch_with_opposite_forces():
    lower = cord([(-0.4, 0, 0), (0, 0, -0.25), (0.4, 0, 0)], (0, 1, 0), 31, 'pinned')
    upper = cord([(0, -0.4, -0.1), (0, 0, -0.2), (0, 0.4, -0.1)], (1, 0, 0), 31, 'pinned')
    found = pressed((lower, upper))
    middles = [shape.positions_at([stretch.to_stretched(0.5)])[0] for shape, stretch in found]
    assert middles[1][2] - middles[0][2] == pytest.approx(2 * RADIUS, abs=1e-4)
    weight = DENSITY * AREA * G
    lifts = [shape.gripper_wrench[2] + shape.far_wrench[2] - weight for shape, _ in found]
    assert lifts[0] == pytest.approx(-lifts[1], rel=1e-4)
    assert lifts[0] > 0.01 * weight


def test_cords_that_are_apart_do_not_touch():
    lower = cord([(-0.4, 0, -1), (0, 0, -1.25), (0.4, 0, -1)], (0, 1, 0), 11, 'pinned')
    upper = cord([(0, -0.4, 0), (0, 0, -0.25), (0, 0.4, 0)], (1, 0, 0), 11, 'pinned')
    for shape, _ in pressed((lower, upper)):
        assert (shape.gripper_wrench[2] + shape.far_wrench[2]
                == pytest.approx(DENSITY * AREA * G, rel=1e-6))


def test_a_swinging_chain():
    """omega = j / 2 sqrt(g / L), j the first zero of J0; with masses on the nodes 6e-4 less."""
    j = jn_zeros(0, 1)[0]
    omega, s = 0.5 * j * np.sqrt(G), np.linspace(0, 1, 21)
    side = 5e-3 * j0(j * np.sqrt(1 - s))
    chain = cord(np.column_stack([side, 0 * s, -s]), (0, 1, 0), 20, None, young=1e8, radius=5e-5)
    times = np.linspace(0, 2 * 2 * np.pi / omega, 81)
    positions, directors = swung(chain, times)
    assert np.isfinite(directors).all()

    def left(frequency):
        waves = np.column_stack([np.cos(frequency * times), np.sin(frequency * times)])
        return np.linalg.lstsq(waves, positions[:, -1, 0], rcond=None)[1][0]

    found = minimize_scalar(left, bounds=(0.99 * omega, 1.01 * omega), options={'xatol': 1e-8})
    assert found.x == pytest.approx(omega, rel=2e-4)
