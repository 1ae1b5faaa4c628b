# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Slow motions along obstacles go on, and end where statics say."""

import numpy as np
import pytest

from dlo_planner import Box, Cylinder, DirectSimulator, Plane, Pose, Rod, Sphere
from dlo_planner.direct.stepping import _pushed

LEVEL = Pose((0, 0, 0), (0, 0, 0, 1))


def scene_of(seed):
    """Return a simulator, a way and the time (s) of each of its parts, all at random."""
    rng = np.random.default_rng(seed)
    stiffness = 0.3 * 10 ** rng.uniform(-2.5, 0)
    weight = 8 * stiffness * 10 ** rng.uniform(-1, 1)
    rod = Rod(1.0, stiffness, rng.uniform(0.2, 1) * stiffness, weight / 9.81,
              radius=rng.uniform(0.002, 0.01), damping=(0, 10 ** rng.uniform(-3, -1.5)))
    friction = [0.0, 0.0, 0.3][rng.integers(3)]
    obstacles = [one_of_them(rng, friction) for _ in range(rng.integers(1, 4))]
    mesh = [{}, {'n_elements': 32}, {'n_elements': 32, 'basis': 'local'},
            {'n_elements': 24}][rng.integers(4)]
    way = [Pose.looking_along((0, 0, 0), (1, 0, 0))]
    for _ in range(2):
        place = rng.uniform((-0.2, -0.1, -0.1), (0.2, 0.1, 0.3))
        way.append(Pose.looking_along(place, (1, rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5))))
    dt = [0.5, 2.0, 10.0, 60.0][rng.integers(4)]
    return DirectSimulator(rod, obstacles=obstacles, **mesh), [*way, way[0]], dt


def one_of_them(rng, friction):
    kind = rng.integers(4)
    place = np.array([rng.uniform(*ends) for ends in ((0.3, 0.9), (-0.15, 0.15), (-0.5, -0.15))])
    if kind == 0:
        return Sphere(place, rng.uniform(0.03, 0.1), friction=friction)
    if kind == 1:
        return Cylinder(place - [0, 1, 0], place + [0, 1, 0], rng.uniform(0.01, 0.08),
                        friction=friction)
    if kind == 2:
        return Box(Pose(place, (0, 0, 0, 1)), rng.uniform(0.05, 0.12, 3), friction=friction)
    return Plane((0, 0, rng.uniform(-0.5, -0.2)), (0, 0, 1), friction=friction)


# 26, 77, 148: an element near the end gets flat; 98, 51: a DLO slips along a bar and off it
@pytest.mark.parametrize('seed', [77, 98, 148, 26])
def test_a_slow_motion_along_obstacles_ends_at_rest(seed):
    simulator, way, dt = scene_of(seed)
    motion = simulator.simulate(way, dt)
    assert motion.status == 'complete', motion.message
    assert any(shape.contacts for shape in motion.shapes)
    rest = simulator.solve(way[-1], motion.shapes[-1])
    assert rest.converged
    np.testing.assert_allclose(motion.shapes[-1].positions, rest.positions, atol=1e-4)
    deepest = max(contact.penetration for shape in motion.shapes for contact in shape.contacts)
    assert deepest < 1e-7
    assert_no_gain(motion)


def assert_no_gain(motion):
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert motion.numerical_loss.min() > -1e-3 * moved


@pytest.mark.parametrize('seed', [51, 39])
def test_a_dlo_slips_off_an_obstacle_without_a_gain_of_energy(seed):
    simulator, way, dt = scene_of(seed)
    motion = simulator.simulate(way, dt)
    assert motion.status == 'complete', motion.message
    assert_no_gain(motion)


def test_a_point_rolls_to_where_the_rest_of_the_dlo_lies():
    rod = Rod(1.0, 0.1, 0.02, 0.015, radius=0.005, damping=1e-3)
    simulator = DirectSimulator(rod, obstacles=[Plane((0, 0, -0.2), (0, 0, 1))])
    motion = simulator.simulate([LEVEL, Pose((0, 0, 0.3), (0, 0, 0, 1)), LEVEL], 100.0)
    assert motion.status == 'complete', motion.message
    rest = simulator.solve(LEVEL, motion.shapes[-1])
    np.testing.assert_allclose(motion.shapes[-1].positions, rest.positions, atol=1e-4)


def test_contacts_do_no_work_where_nothing_is_curved():
    # on a floor a chord is the way itself: energy must not come from there
    rod = Rod(1.0, 0.1, 0.02, 0.015, radius=0.005, damping=1e-3)
    simulator = DirectSimulator(rod, n_elements=24, obstacles=[Plane((0, 0, -0.2), (0, 0, 1))])
    one, two = simulator.track([LEVEL, Pose((0.02, 0, 0.0), (0, 0, 0, 1))])
    assert one.contacts and two.contacts
    assert _pushed(one, two) < 1e-12
