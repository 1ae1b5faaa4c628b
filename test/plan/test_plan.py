# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans: their points, files, and what passes the centers between."""

import json
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from oblique_plans import HOLE as LEVEL
from oblique_plans import oblique_plan
from scipy.spatial.transform import Rotation

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
    Trajectory,
    Uncertainty,
    Workspace,
)
from dlo_planner.model.pose import displaced
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import concatenate, rooms_in_holes, times_at_speed, truncate
from dlo_planner.plan.waypoint import waypoint_at
from dlo_planner.tasks import PlanStatus
from dlo_planner.trajectory.dynamic_check import goals_between, worst_miss

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


def test_times_keep_the_speed_limits(plan):
    twisted = [displaced(pose, np.array([0.3 * (k % 3), 0, 0, 0, 0, 0]))
               for k, pose in enumerate(plan.grippers)]
    for grippers, times in ((plan.grippers, plan.times),
                            (twisted, times_at_speed(twisted, 0.05, 0.2))):
        ways, turns = np.array([
            (np.linalg.norm(other.position - one.position),
             Rotation.from_matrix(one.rotation.T @ other.rotation).magnitude())
            for one, other in pairwise(grippers)]).T
        np.testing.assert_allclose(np.diff(times), np.maximum(ways / 0.05, turns / 0.2))
    assert (turns / 0.2 > ways / 0.05).any()  # here the turns take longer


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


@pytest.mark.parametrize('first', [True, False])
def test_a_way_that_passes_no_hole_changes_no_margin(plan, first):
    known = replace(plan, uncertainty=Uncertainty(gripper_rotation=1e-4))
    way = replace(back(plan), via_points=[()] * len(plan), clearances=np.full((9, 1, 3), np.inf))
    whole = concatenate(back(way), back(known)) if first else concatenate(known, way)
    assert whole.uncertainty == known.uncertainty
    there = whole.margin[9:] if first else whole.margin[:9]
    np.testing.assert_allclose(there, back(known).margin[1:] if first else known.margin)
    assert (there > (back(plan).margin[1:] if first else plan.margin)).all()


def test_plans_of_two_uncertainties_are_not_joined(plan):
    other = replace(back(plan), uncertainty=Uncertainty(mass=0.1))
    with pytest.raises(InvalidTask, match=r'other.uncertainty = .*: expected that of one, None'):
        concatenate(plan, other)


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
        np.testing.assert_allclose(normal, shape.at(s).direction, atol=1e-12)
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


WIRE = Rod.circular(1.0, 2e-3, 8960.0, 110e9, 0.34)
POINT_HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
POINT_DEPTHS = np.linspace(0, 0.9, 10)


def planner(farthest):
    return InverseSimulator(DirectSimulator(WIRE), workspace=Workspace(
        upper=(farthest, np.inf, np.inf)))


def test_it_comes_as_deep_as_its_gripper_may():
    inverse = planner(-0.33)
    with pytest.raises(Infeasible) as refused:
        inverse.thread(POINT_HOLE, depths=POINT_DEPTHS)
    plan = inverse.thread(POINT_HOLE, depths=POINT_DEPTHS, as_deep_as_possible=True)
    known = len(refused.value.plan)
    np.testing.assert_array_equal(plan.depths[:known], POINT_DEPTHS[:known])
    assert POINT_DEPTHS[known - 1] < plan.depths[-1] < POINT_DEPTHS[known]
    # a straight gripper's way: what is missing is less than the halved steps
    assert -0.33 - 0.1 / 2**5 < plan.grippers[-1].position[0] <= -0.33
    assert plan.fraction == pytest.approx(plan.depths[-1] / POINT_DEPTHS[-1])


def test_all_depths_are_the_same_plan_and_none_is_refused():
    free = planner(np.inf)
    plan = free.thread(POINT_HOLE, depths=POINT_DEPTHS, as_deep_as_possible=True)
    assert plan == free.thread(POINT_HOLE, depths=POINT_DEPTHS) and plan.fraction == 1
    with pytest.raises(Infeasible):
        planner(-1.5).thread(POINT_HOLE, depths=POINT_DEPTHS, as_deep_as_possible=True)


@pytest.mark.every(2)
@pytest.mark.parametrize('name', ['plan.npz', 'plan.json'])
def test_a_plan_in_a_file(tmp_path, name):
    inverse = planner(np.inf)
    plan = inverse.thread(POINT_HOLE, depths=POINT_DEPTHS)
    whole = concatenate(inverse.approach(POINT_HOLE, plan, Pose((-1.2, 0, 1), (0, 0, 0, 1)),
                                         standoff=0.05), plan)
    for made in (plan, whole):
        made.save(tmp_path / name)
        again = Plan.load(tmp_path / name)
        for what in ('depths', 'times', 'position_error', 'misalignment', 'clearances'):
            np.testing.assert_array_equal(getattr(again, what), getattr(made, what))
        assert again.stops == made.stops and again.status is made.status
        assert again.sheets[0][0] == made.sheets[0][0] and again.fraction == made.fraction
        assert [len(one) for one in again.via_points] == [len(one) for one in made.via_points]
        for one, other in zip(again, made, strict=True):
            np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, atol=1e-14)
            np.testing.assert_array_equal(one.shape.positions, other.shape.positions)
    direct = DirectSimulator(WIRE)
    known, stored = (Trajectory(one, tolerance=np.inf, simulator=direct) for one in (whole, again))
    assert stored.duration == pytest.approx(known.duration, rel=1e-6)
    with pytest.raises(InvalidTask, match='simulator'):
        Trajectory(again)
    (tmp_path / name).write_bytes(b'no plan')
    with pytest.raises(InvalidTask, match=f'path = .*{name}'):
        Plan.load(tmp_path / name)


def test_both_kinds_of_files_say_the_same(tmp_path):
    inverse = planner(np.inf)
    bore = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    for made in (inverse.thread(POINT_HOLE, depths=POINT_DEPTHS),
                 inverse.insert(bore, depths=POINT_DEPTHS[:4])):
        loaded = []
        for name in ('plan.npz', 'plan.json'):
            made.save(tmp_path / name)
            loaded.append(Plan.load(tmp_path / name))
        assert loaded[0] == loaded[1]
        loaded[1].save(tmp_path / 'again.JSON')
        assert (tmp_path / 'again.JSON').read_bytes() == (tmp_path / 'plan.json').read_bytes()


@pytest.fixture(scope='module')
def saved(tmp_path_factory):
    """Return what the file of a plan says."""
    path = tmp_path_factory.mktemp('plan') / 'plan.json'
    planner(np.inf).thread(POINT_HOLE, depths=POINT_DEPTHS).save(path)
    return path.read_text()


@pytest.mark.parametrize(('name', 'odd'), [
    ('format', {'type': 'int', 'shape': [], 'data': [99]}),
    ('format', {'type': 'int', 'shape': [], 'data': [True]}), ('depths', None), ('depths', [0.0]),
    ('depths', {'type': 'object', 'shape': [], 'data': [{}]}),
    ('depths', {'type': 'float', 'shape': [10], 'data': ['1'] * 10}),
    ('depths', {'type': 'float', 'shape': [10**9, 10**9], 'data': [1.0]}),
    ('times', {'type': 'float', 'shape': [1], 'data': [0.0]}),
    ('status', {'type': 'str', 'shape': [], 'data': ['done']}),
    ('sheets', {'type': 'str', 'shape': [], 'data': ['[3]']}),
    ('passes', {'type': 'float', 'shape': [1, 8], 'data': [99.0] * 8})])
def test_odd_files_are_refused_by_their_name(saved, tmp_path, name, odd):
    known = json.loads(saved)
    known[name] = odd
    (tmp_path / 'plan.json').write_text(json.dumps(known))
    with pytest.raises(InvalidTask, match=r'path = .*plan\.json'):
        Plan.load(tmp_path / 'plan.json')
    for content in ('[' * 100_000, '[1]', '{"format": 1}', '', '\x00'):
        (tmp_path / 'plan.json').write_text(content)
        with pytest.raises(InvalidTask, match=r'path = .*plan\.json'):
            Plan.load(tmp_path / 'plan.json')


def test_where_an_arc_length_stands_in_the_hole():
    inverse = planner(np.inf)
    plan = inverse.thread(POINT_HOLE, depths=POINT_DEPTHS)
    way = concatenate(inverse.approach(POINT_HOLE, plan, Pose((-1.2, 0, 1), (0, 0, 0, 1)),
                                         standoff=0.05), plan)
    np.testing.assert_allclose(plan.arc_lengths, 1 - POINT_DEPTHS)
    assert np.isnan(way.arc_lengths[:-len(plan) + 1]).sum() > 2
    direct = inverse.simulator
    for s in (1.0, 0.8, 0.73, 0.45, 0.1):
        gripper = plan.at_arc_length(s)
        shape = direct.solve(gripper, plan.shapes[np.argmin(np.abs(plan.arc_lengths - s))])
        assert np.linalg.norm(shape.at(s).position - POINT_HOLE.center) < 2e-3
        if s <= way.arc_lengths[-len(plan) + 1]:  # a joined plan passes from its second waypoint on
            np.testing.assert_allclose(way.at_arc_length(s).matrix, gripper.matrix, atol=1e-3)
    exact = inverse.thread(POINT_HOLE, depths=[0.2, 0.27]).grippers[1]
    assert np.linalg.norm(plan.at_arc_length(0.73).position - exact.position) < 1e-3
    for s in (0.05, 1.01):
        with pytest.raises(InvalidTask, match='0.1 to 1 m'):
            plan.at_arc_length(s)


def test_each_waypoint_has_goals_whose_residuals_are_its_misses():
    inverse = planner(np.inf)
    plan = inverse.thread(POINT_HOLE, depths=POINT_DEPTHS[:3])
    way = inverse.approach(POINT_HOLE, plan, Pose.looking_along((-1.5, 0, 1), (1, 0, 0)),
                           standoff=0.05)
    whole = concatenate(way, plan)
    assert [[type(goal).__name__ for goal in goals] for goals in whole.goals] == (
        [['FrameAt']] * len(way) + [['PositionAt', 'DirectionAt']] * 2)
    aside = [shape.moved((0.0, 3e-3, 0.0)) for shape in whole.shapes]
    for goals, shape, moved in zip(whole.goals, whole.shapes, aside, strict=True):
        assert all(np.linalg.norm(goal.residuals(shape)) < 1e-9 for goal in goals)
        assert np.linalg.norm(goals[0].residuals(moved)) == pytest.approx(3e-3)


@pytest.fixture(scope='module')
def shape():
    return DirectSimulator(Rod(1.0, 0.1, 2.0, 1.5)).solve(Pose((0, 0, 1), (0, 0, 0, 1)))


def missed(shape, *passed):
    """Return the miss between two waypoints, which pass centers: (center, s) of each."""
    plan = SimpleNamespace(shapes=(shape, shape), via_points=tuple(
        tuple((np.array(center), s, None) for center, s in some) for some in passed))
    return worst_miss(shape, goals_between(plan, 0))


@pytest.mark.parametrize(('s', 'then'), [(0.4, 0.7), (0.7, 0.4), (0.55, 0.55), (0.64, 0.64)])
def test_any_arc_length_near_those_planned_may_be_in_the_center(shape, s, then):
    frame = shape.at(0.55)
    center = frame.position + 0.003 * frame.rotation[:, 1]
    assert missed(shape, [(center, s)], [(center, then)]) == pytest.approx(3e-3)


def test_no_arc_length_far_before_is(shape):
    center = shape.positions_at([0.4])[0]
    away = np.linalg.norm(shape.positions_at([0.5])[0] - center)
    for s, then in ((0.6, 0.7), (0.7, 0.6)):
        assert missed(shape, [(center, s)], [(center, then)]) == pytest.approx(away)


def test_a_center_of_one_waypoint_alone_counts_once_the_free_end_is_beyond_it(shape):
    first, end = shape.positions_at([0.5])[0], shape.at(1.0)
    ahead = end.position + 0.05 * end.direction
    reached = shape.positions_at([0.9])[0] + 2e-3 * shape.at(0.9).rotation[:, 1]
    for center, away in ((ahead, 0.0), (reached, 2e-3)):
        later = [(first, 0.5), (center, 0.85)]
        for one, other in (([(first, 0.5)], later), (later, [(first, 0.5)])):
            assert missed(shape, one, other) == pytest.approx(away, abs=1e-9)


def test_an_oblique_plan_says_so_and_aims_along_its_own_direction(tmp_path):
    made = oblique_plan()
    assert 'misaligned by 1 rad' in repr(made)
    assert 'misaligned' not in repr(replace(made, misalignment=np.full(len(made), 1e-9)))
    rims = (made.clearances[:, 0, 0], rooms_in_holes(made)[:, 0])
    np.testing.assert_allclose(rims[0], 8.5e-3, rtol=1e-6)
    # a straight axis through the center of a circle of radius R is R cos(angle) from it
    np.testing.assert_allclose(rims[1], 10e-3 * np.cos(made.misalignment) - 1.5e-3, atol=1e-4)
    for goals, shape, angle in zip(made.goals, made.shapes, made.misalignment, strict=True):
        place, along = goals
        assert max(np.linalg.norm(goal.residuals(shape)) for goal in goals) < 1e-9
        assert np.arccos(along.direction @ LEVEL.normal) == pytest.approx(angle, abs=1e-9)
    made.save(tmp_path / 'plan.npz')
    again = Plan.load(tmp_path / 'plan.npz')
    np.testing.assert_array_equal(again.misalignment, made.misalignment)
    np.testing.assert_array_equal(again.via_points[0][0][2], made.via_points[0][0][2])


def test_an_approach_that_ends_in_the_hole_knows_how_oblique_its_end_is():
    made = oblique_plan()
    inverse = InverseSimulator(DirectSimulator(made.shapes[0].rod))
    first = made.grippers[0]
    way = inverse.approach(LEVEL, made, Pose(first.position - (0.15, 0, 0), first.quaternion),
                           standoff=0.02)
    rooms = rooms_in_holes(concatenate(way, made))
    assert np.isinf(rooms[:len(way) - 1]).all()
    assert rooms[len(way) - 1] == pytest.approx(rooms_in_holes(made)[0], rel=1e-6)
