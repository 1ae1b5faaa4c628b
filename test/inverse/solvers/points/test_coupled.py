# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Task and equilibrium in one Newton system: what it finds is what the direct simulation finds."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.inverse.solvers.points import two_points as two_points_module
from dlo_planner.inverse.solvers.points.aligned import free_axis
from dlo_planner.inverse.solvers.points.one_point import aligned_shape
from dlo_planner.inverse.solvers.points.two_points import Sought, two_points
from dlo_planner.model.pose import turned_by

RODS = [Rod(1.0, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4),
        Rod(1.0, 0.02, 0.1, 0.08, tip_mass=0.005)]
OPTIONS = [{'n_elements': 40, 'basis': 'local'}, {'n_elements': 48, 'n_terms': 12}, {}]


def hanging(rod, options):
    simulator = DirectSimulator(rod, **options)
    return simulator, simulator.solve(Pose.looking_along((0.3, -0.2, 0.1), (1, 0.3, 0.4)))


def step_by_step(*given):
    return two_points_module._step_by_step(*given)


@pytest.mark.parametrize('options', OPTIONS)
@pytest.mark.parametrize('rod', RODS)
@pytest.mark.parametrize('free', ['first', 'second'])
def test_two_points_are_passed_by_an_equilibrium(rod, options, free):
    simulator, shape = hanging(rod, options)
    s = (0.35, 0.8)
    way = shape.frame_at(0.8)[1] - shape.frame_at(0.35)[1]
    way = way * 0.97 + np.array([0.01, -0.02, 0.015])
    found, first, second = two_points(simulator, shape, way, Sought(*s, free))
    assert (first if free == 'second' else second) == s[free == 'first']
    passed = found.frame_at(second)[1] - found.frame_at(first)[1]
    np.testing.assert_allclose(passed, way, atol=2e-10)
    direct = simulator.solve(found.gripper, shape)
    np.testing.assert_allclose(found.positions, direct.positions, atol=1e-9)
    np.testing.assert_allclose(found.gripper_wrench, direct.gripper_wrench, atol=1e-8)
    assert found.energy == pytest.approx(direct.energy, abs=1e-10)
    assert found.stability == pytest.approx(direct.stability, rel=1e-3)
    assert found.converged
    assert found.error_estimate == pytest.approx(direct.error_estimate, rel=1e-3)


@pytest.mark.parametrize('options', OPTIONS)
@pytest.mark.parametrize('roll', [0.0, 0.05, -0.2])
def test_two_points_are_those_of_the_slow_way(options, roll):
    simulator, shape = hanging(RODS[0], options)
    way = shape.frame_at(0.8)[1] - shape.frame_at(0.35)[1] + np.array([0.001, 0.002, -0.001])
    given = simulator, shape, way, Sought(0.35, 0.8, 'second', roll)
    (one, _, s), (other, _, t) = two_points(*given), step_by_step(*given)
    # a roll is the sum of those of all steps, which are not quite the same ones
    close = 1e-9 if roll == 0.0 else 2e-4
    np.testing.assert_allclose(one.gripper.rotation, other.gripper.rotation, atol=max(close, 2e-8))
    assert s == pytest.approx(t, abs=max(close, 2e-8))
    made = one.gripper.rotation @ shape.gripper.rotation.T
    axis = free_axis(shape.gripper.rotation, way / np.linalg.norm(way))
    spin = np.array([made[2, 1] - made[1, 2], made[0, 2] - made[2, 0], made[1, 0] - made[0, 1]])
    assert 0.5 * axis @ spin == pytest.approx(np.sin(roll), abs=1e-4)


def test_what_cannot_be_passed_is_told():
    simulator, shape = hanging(RODS[0], OPTIONS[0])
    assert two_points(simulator, shape, np.array([0.9, 0.0, 0.0]),
                      Sought(0.35, 0.8, 'second')) is None


@pytest.mark.parametrize('options', OPTIONS)
@pytest.mark.parametrize('rod', RODS)
def test_an_aligned_shape_is_an_equilibrium(rod, options):
    simulator, shape = hanging(rod, options)
    normal = turned_by(np.array([0.05, -0.1, 0.08])) @ shape.frame_at(0.6)[0][:, 0]
    found = aligned_shape(simulator, shape, 0.6, normal, shape.gripper.rotation)
    np.testing.assert_allclose(found.frame_at(0.6)[0][:, 0], normal, atol=1e-9)
    direct = simulator.solve(found.gripper, found)
    np.testing.assert_allclose(found.positions, direct.positions, atol=1e-9)
    np.testing.assert_allclose(found.gripper_wrench, direct.gripper_wrench, atol=1e-8)
    assert found.energy == pytest.approx(direct.energy, abs=1e-10)
    assert found.elastic_energy == pytest.approx(direct.elastic_energy, abs=1e-10)
    assert found.stability == pytest.approx(direct.stability, rel=1e-3)
