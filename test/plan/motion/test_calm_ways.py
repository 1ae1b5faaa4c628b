# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways that were refused though they can be made calm."""

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sphere,
    Trajectory,
)
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import PlanStatus, truncate
from dlo_planner.trajectory.modal_response import Response

SHORT = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
LEAF = Rod.rectangular(0.8, 0.020, 0.0005, 7850.0, 206e9, 0.29)
# on the way there the leaf spring comes near to falling aside: 0.85 to 0.35 Hz
ASIDE = CutOut(Pose.looking_along((0, 0, 1), (0.3268, -0.8378, 0.4373)), radius=0.0136)
ABOVE = Pose.looking_along((-0.34008, 0.88092, 0.77364), (0.3813, -0.8164, 0.4337))


def approach(rod, hole, start, depth):
    inverse = InverseSimulator(DirectSimulator(rod))
    through = inverse.thread(hole, start=start, depths=[0, depth])
    way = inverse.approach(hole, through, start, standoff=0.05)
    return truncate(way, way.stops[0] + 1, PlanStatus.COMPLETE)


def test_a_way_that_comes_to_no_rim_has_no_room_to_lose_there():
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
    way = approach(SHORT, hole, Pose.looking_along((-0.36, -0.1, 1.02), (1, 0, 0)), 0.1)
    assert np.isinf(way.clearances[:, :, 0]).all()
    motion = Trajectory(way, Limits(0.2, 1.0), tolerance=1e-3).motion
    assert motion.departure < 1e-3
    assert motion.clearance > 0


def test_modes_are_known_densely_where_they_change_fast():
    way = approach(LEAF, ASIDE, ABOVE, 0.1)
    leg = GripperPath.of(way).legs[0]
    quick = DirectSimulator(LEAF, n_elements=32, basis='local')
    response = Response.of(quick, leg, quick.solve(way.grippers[0]))
    slow = response.rates[:, :2]
    assert np.abs(np.diff(np.log(slow), axis=0)).max() < 0.07
    middle = 0.5 * (response.parameters[-2] + response.parameters[-1])
    shape = quick.track([Pose.from_rotation(*(part[0] for part in leg.poses(np.array([middle]))))],
                        initial=response.shapes[-2])[0]
    assert 2 * np.pi * shape.modes(1).frequencies[0] == pytest.approx(
        response.between(slow, np.array([middle]))[0, 0], rel=5e-3)


def test_a_plan_that_comes_nearer_between_its_waypoints_than_at_them():
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
    way = approach(SHORT, hole, Pose.looking_along((-0.5, -0.1, 1.02), (1, 0, 0)), 0.1)
    plan = truncate(way, 2, PlanStatus.COMPLETE)
    before, after = (shape.positions[-1] for shape in plan.shapes)
    beside = np.cross(after - before, (0, 0, 1))
    beside *= 0.012 / np.linalg.norm(beside)
    ball = Sphere(0.5 * (before + after) + beside, 0.01)
    at_waypoints = min(np.linalg.norm(tip - ball.center) for tip in (before, after)) - ball.radius
    motion = Trajectory(plan, Limits(0.2, 1.0), tolerance=1e-3, obstacles=[ball]).motion
    assert motion.calm_clearance < 0.5 * at_waypoints
    assert motion.clearance > 0
    assert motion.clearance == pytest.approx(motion.calm_clearance, abs=1e-3)
