# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bodies that a step need not look at: the answer is as if it did."""

import numpy as np
import pytest

from dlo_planner import Box, Capsule, DirectSimulator, Plane, Pose, Rod, Sphere
from dlo_planner.minimize.reach import bodies_near, stays_within

STIFF = Rod(0.8, 0.05, 1.0, 0.7, radius=0.004)
BAR = Capsule((0.1, -0.2, 0.0), (0.1, 0.2, 0.0), 0.01)


def level(z):
    return Pose((0, 0, z), (0, 0, 0, 1))


def lowered(obstacles, heights=(0.0139, 0.01)):
    """Return the Shapes of a DLO that is pressed on a bar near its gripper: its tip goes up."""
    direct = DirectSimulator(STIFF, n_elements=32, basis='local', obstacles=obstacles)
    shape, found = None, []
    for height in heights:
        shape = direct.solve(level(height), initial=shape)
        found.append(shape)
    return found


def test_those_are_near_that_some_point_is_near(rng):
    balls = [Sphere(place, 0.01) for place in rng.uniform((-0.1, -0.2, -0.2), (0.9, 0.2, 0.2),
                                                          (400, 3))]
    balls = [one for one in balls if np.hypot(*one.center[1:]) > 0.03][:150]
    direct = DirectSimulator(STIFF, n_elements=32, basis='local', obstacles=balls)
    shape = direct.solve(level(0.0))
    before = np.column_stack([shape.positions, np.zeros((33, 3))])
    system = direct.mesh.system(np.eye(3), np.zeros(3))
    margin, everyone = 0.03, np.arange(150)
    near = bodies_near(system, before, everyone, margin)
    places = np.array([shape.at(s).position for s in np.linspace(0, 0.8, 801)])
    away = np.array([np.linalg.norm(places - ball.center, axis=1).min() - 0.014 for ball in balls])
    assert set(np.flatnonzero(away < margin)) <= set(near)
    assert set(near) <= set(np.flatnonzero(away < margin + 0.03))  # an element more
    assert len(bodies_near(system, before[:0], everyone, margin)) == 150  # nobody knows where it is


def test_how_far_nodes_have_moved():
    before = np.zeros((3, 6))
    after = np.array([(0, 0, 0), (0.03, 0, 0.04), (0, 0, 0)])
    assert stays_within(0.0501, before, after)
    assert not stays_within(0.0499, before, after)


def test_bodies_that_are_not_touched_change_nothing(rng):
    places = rng.uniform((-0.2, -0.4, -0.4), (1.0, 0.4, 0.4), (150, 3))
    balls = [Sphere(place, 0.01) for place in places if np.hypot(*place[1:]) > 0.1]
    alone, among = lowered([BAR]), lowered([*balls, BAR])
    for one, other in zip(alone, among, strict=True):
        assert other.converged
        np.testing.assert_allclose(other.positions, one.positions, atol=1e-12)
        assert [contact.obstacle for contact in other.contacts] == [len(balls)]
        assert other.contacts[0].force == pytest.approx(one.contacts[0].force, rel=1e-9)


def test_what_it_comes_to_all_the_same_is_touched():
    # the tip goes ten times as far as the gripper, to what was not near before
    lid = Box(Pose((0.75, 0, 0.06), (0, 0, 0, 1)), (0.2, 0.2, 0.04))
    free, _ = lowered([BAR]), None
    assert free[1].positions[-1, 2] - free[0].positions[-1, 2] > 5 * (0.0139 - 0.01)
    far = [Plane((0, 0, -1), (0, 0, 1))]
    shapes = lowered([BAR, lid, *far])
    assert shapes[1].converged
    assert {contact.obstacle for contact in shapes[1].contacts} == {0, 1}
    assert shapes[1].positions[-1, 2] < free[1].positions[-1, 2] - 1e-3
