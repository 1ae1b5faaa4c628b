# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans as values: cut, joined, timed, and what they say of their shapes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, InvalidTask, InverseSimulator, Pose, Rod
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import concatenate, truncate
from dlo_planner.plan.waypoint import waypoint_at
from dlo_planner.tasks import PlanStatus

DIRECT = DirectSimulator(Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2),
                             radius=0.003), n_elements=24)
HOLE = CutOut(Pose.looking_along((0.1, 0.2, 1.0), (1, 0.2, 0)), radius=0.02)
DEPTHS = np.linspace(0, 0.8, 9)


@pytest.fixture(scope='module')
def plan():
    return InverseSimulator(DIRECT).thread(HOLE, depths=DEPTHS, linear_speed=0.05,
                                           angular_speed=0.2)


def test_a_part_says_how_much_of_the_whole_it_is(plan):
    part = truncate(plan, 6, PlanStatus.PARTIAL)
    assert len(part) == 6 and part.fraction == pytest.approx(6 / 9)
    assert truncate(part, 3, PlanStatus.PARTIAL).fraction == pytest.approx(3 / 9)
    assert truncate(plan, 6, PlanStatus.COMPLETE).fraction == 1
    np.testing.assert_array_equal(part.depths, DEPTHS[:6])
    for name in ('grippers', 'shapes', 'misalignment', 'position_error', 'times', 'via_points',
                 'clearances'):
        assert len(getattr(part, name)) == 6


def back(plan):
    """Return a plan the other way round."""
    turned = {name: getattr(plan, name)[::-1] for name in (
        'depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'via_points',
        'clearances')}
    return replace(plan, **turned, times=plan.times[-1] - plan.times[::-1])


@pytest.mark.parametrize('first', [True, False])
def test_two_plans_are_as_complete_as_the_lesser(plan, first):
    part = truncate(plan, 6, PlanStatus.PARTIAL)
    there = back(truncate(plan, 6, PlanStatus.COMPLETE))
    whole = concatenate(part, there) if first else concatenate(there, part)
    assert whole.fraction == pytest.approx(6 / 9)
    assert concatenate(plan, back(plan)).fraction == 1


def test_the_second_plan_begins_where_the_first_ends(plan):
    turned = back(plan)
    late = replace(turned, times=turned.times + 100.0)  # its clock does not count
    whole = concatenate(plan, late)
    assert len(whole) == 17
    np.testing.assert_allclose(whole.times[:9], plan.times)
    np.testing.assert_allclose(np.diff(whole.times[8:]), np.diff(turned.times))
    assert whole.grippers[8] is plan.grippers[8] and whole.grippers[9] is turned.grippers[1]
    assert whole.clearances.shape == (17, 1, 3)
    np.testing.assert_array_equal(whole.clearances[9:], turned.clearances[1:])


@pytest.mark.parametrize('first', [True, False])
def test_a_plan_that_begins_elsewhere_is_not_joined(plan, first):
    with pytest.raises(InvalidTask, match='other begins at'):
        concatenate(plan, plan)
    empty = truncate(plan, 0, PlanStatus.PARTIAL)
    with pytest.raises(InvalidTask, match='one' if first else 'other'):
        concatenate(empty, plan) if first else concatenate(plan, empty)


def straight_on(plan, angle):
    """Return a plan whose gripper goes on from a plan's end, turned aside by an angle."""
    end, before = plan.grippers[-1], plan.grippers[-2]
    turn = Rotation.from_matrix(end.rotation @ before.rotation.T)
    way = end.position - before.position
    across = np.cross(way, turn.as_rotvec())
    ahead = Rotation.from_rotvec(angle * across / np.linalg.norm(across))
    way = ahead.apply(way)
    there = Pose.from_rotation(end.position + way, (
        Rotation.from_rotvec(ahead.apply(turn.as_rotvec())).as_matrix() @ end.rotation))
    shapes = plan.shapes[-1], replace(plan.shapes[-1], gripper=there)
    return replace(truncate(plan, 2, PlanStatus.COMPLETE), grippers=[end, there], shapes=shapes)


@pytest.mark.parametrize(('degrees', 'stops'), [(0.0, False), (4.0, False), (6.0, True),
                                                (90.0, True), (180.0, True)])
def test_the_gripper_stops_where_two_plans_bend(plan, degrees, stops):
    whole = concatenate(plan, straight_on(plan, np.deg2rad(degrees)))
    assert whole.stops == ((8,) if stops else ())
    legs = GripperPath.of(whole).legs
    # a leg ends where the gripper stops: at the joint, and beyond 60 degrees in any case
    assert (plan.times[-1] in [leg.knots[0] for leg in legs]) == stops
    # stops of both parts are kept, counted from the beginning
    assert concatenate(back(plan), whole).stops == (8, *(stop + 8 for stop in whole.stops))


def test_what_has_no_cutout_has_all_the_room_there_is(plan):
    free = back(InverseSimulator(DIRECT).thread(CutOut(HOLE.pose), depths=DEPTHS))
    assert (concatenate(free, plan).clearances[:9] == np.inf).all()
    assert np.isfinite(concatenate(free, plan).clearances[9:, 0, 0]).all()


def test_velocities_lead_from_each_pose_to_the_next(plan):
    speeds = plan.velocities
    assert (speeds[-1] == 0).all()
    for k, seconds in enumerate(np.diff(plan.times)):
        here, there = plan.grippers[k:k + 2]
        np.testing.assert_allclose(here.position + seconds * speeds[k, :3], there.position,
                                   atol=1e-12)
        turn = Rotation.from_rotvec(seconds * speeds[k, 3:]).as_matrix()  # about world axes
        np.testing.assert_allclose(turn @ here.rotation, there.rotation, atol=1e-12)
    linear, angular = (np.linalg.norm(part, axis=1)[:-1] for part in np.split(speeds, 2, axis=1))
    assert linear.max() <= 0.05 * (1 + 1e-9) and angular.max() <= 0.2 * (1 + 1e-9)
    np.testing.assert_allclose(np.maximum(linear / 0.05, angular / 0.2), 1)


@pytest.mark.parametrize('angle', [0.0, 0.3, 2.0, np.pi - 1e-3])
def test_misalignment_is_an_angle(plan, angle):
    shape = plan.shapes[3]
    axes, position = shape.frame_at(0.4)
    normal = Rotation.from_rotvec(angle * axes[:, 1]).apply(axes[:, 0])
    waypoint = waypoint_at(shape, position + [0.3, 0, 0.4], 0.4, normal)
    assert waypoint.misalignment == pytest.approx(angle, abs=1e-9)
    assert waypoint.position_error == pytest.approx(0.5)
    worse, better = (waypoint.with_via_point(shape.frame_at(0.7)[1] + [0, off, 0], 0.7)
                     for off in (0.9, 0.1))
    assert worse.position_error == pytest.approx(0.9)
    assert better.position_error == pytest.approx(0.5)


def test_misses_are_those_of_every_center(plan):
    for misses, miss, (passes,), shape in zip(plan.position_errors, plan.position_error,
                                              plan.via_points, plan.shapes,
                                              strict=True):
        assert misses == pytest.approx([miss], abs=1e-12)
        center, s, normal = passes
        assert np.linalg.norm(shape.at(s).position - HOLE.center) < 1e-8
        np.testing.assert_array_equal(center, HOLE.center)
        np.testing.assert_array_equal(normal, HOLE.normal)
    moved = plan.shapes[2].moved((0.1, 0.2, -0.3))
    assert moved.energy == pytest.approx(moved.state.mesh.rod.mass_per_length * 9.81 * -0.3
                                         + plan.shapes[2].energy, abs=1e-9)


def test_a_cutout_that_only_one_part_has_leaves_the_other_free(plan):
    turned = back(plan)
    two = replace(turned, clearances=np.tile(turned.clearances, (1, 2, 1)))
    for whole, free, same in ((concatenate(plan, two), slice(0, 9), concatenate(plan, turned)),
                              (concatenate(two, plan), slice(9, 17), concatenate(turned, plan))):
        assert whole.clearances.shape == (17, 2, 3)
        assert (whole.clearances[free, 1] == np.inf).all()
        np.testing.assert_array_equal(whole.clearance, same.clearance)
