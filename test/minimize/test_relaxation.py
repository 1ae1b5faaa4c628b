# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO comes to rest among obstacles from afar: laid down, set upright, slipping, falling."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Plane, Pose, Rod, Sphere

G = 9.81
CABLE = Rod(1.0, 0.045, (1e-2, 1e-2), 8e-3, radius=3e-3)
HOSE = Rod(1.0, 0.05, (5e-4, 5e-4), 4e-4, radius=3e-3)
DOWN = (0.3, 0.0, -1.0)


def check_laws(rod, shape, friction):
    """Forces balance the weight, and keep Coulomb's law."""
    force = shape.gripper_wrench[:3] + sum((one.vector for one in shape.contacts), np.zeros(3))
    np.testing.assert_allclose(force, [0, 0, rod.mass_per_length * rod.length * G], atol=1e-6)
    for one in shape.contacts:
        assert one.force >= 0.0
        assert np.linalg.norm(one.friction) <= friction * one.force * (1 + 1e-6) + 1e-9
    assert shape.positions[:, 2].min() > rod.radius - 1e-6


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_a_cable_that_hangs_down_is_set_on_a_table(friction):
    table = DirectSimulator(CABLE, n_elements=64, obstacles=[Plane((0, 0, 0), (0, 0, 1), friction)])
    shape = None
    for height in np.arange(1.05, 0.64, -0.02):
        shape = table.solve(Pose.looking_along((0, 0, height), DOWN), shape)
        assert shape.converged, shape.status
        check_laws(CABLE, shape, friction)
    assert shape.contacts


def test_a_soft_hose_is_laid_on_a_rough_table():
    table = DirectSimulator(HOSE, n_elements=64, obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    shape = None
    for height in (0.40, 0.38, 0.36, 0.34):
        shape = table.solve(Pose.looking_along((0, 0, height), (1, 0, 0)), shape)
        assert shape.converged and shape.residual < 1e-7, shape.status
        check_laws(HOSE, shape, 0.3)


def test_a_cable_falls_off_a_ball_and_comes_to_rest():
    ball = Sphere((0.5, 0.004, -0.25), 0.1, 0.2)
    direct = DirectSimulator(CABLE, n_elements=64, obstacles=[ball])
    shape = direct.solve(Pose.looking_along((0, 0, 0), (1, 0, 0)))
    assert shape.converged, shape.status


@pytest.mark.parametrize('friction', [0.0, 0.3])
@pytest.mark.parametrize('height', [0.98, 0.7])
def test_a_straight_cable_upright_on_its_tip_is_no_stable_shape(height, friction):
    table = DirectSimulator(CABLE, n_elements=64, obstacles=[Plane((0, 0, 0), (0, 0, 1), friction)])
    shape = table.solve(Pose.looking_along((0, 0, height), (0, 0, -1)))
    assert not shape.converged or shape.stability > -1e-3
    assert np.isfinite(shape.positions).all()
