# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Carried from shape to shape by two arms: over what is in the way, or refused; judged apart."""

from functools import cache

import numpy as np
import pytest

from benchmarks.carries import CLEARANCE, MAX_FORCE, MAX_MOMENT, ROD, judged, planned, settings
from dlo_planner import (
    Box,
    Capsule,
    DirectSimulator,
    FarEnd,
    Hold,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Sphere,
    replay,
)
from dlo_planner.tasks import Carry, MoveTo, task_from_yaml, task_to_yaml

LENGTH = ROD.length
AHEAD = (0, 0, 0, 1)
BEGIN = Pose((-0.35, -0.3, 0.6), AHEAD), Pose((0.35, -0.3, 0.6), AHEAD)
END = Pose((-0.35, 0.3, 0.6), AHEAD), Pose((0.35, 0.3, 0.6), AHEAD)
BOX = Box(Pose((0.0, 0.0, 0.3), AHEAD), (0.4, 0.1, 0.6), name='box')


def simulator(*obstacles):
    """Return the DirectSimulator of the cable among obstacles."""
    return DirectSimulator(ROD, n_elements=32, basis='local', obstacles=obstacles)


def carry(to=END, begin=BEGIN, **options):
    """Return the task that carries both ends."""
    return Carry(to[0], to[1], far_end=FarEnd(begin[1]), **options)


@cache
def over():
    """Return the Plan over the box."""
    return InverseSimulator(simulator(BOX)).plan(
        carry(max_force=MAX_FORCE, max_moment=MAX_MOMENT, clearance=CLEARANCE), start=BEGIN[0])


def closely(plan, count=120):
    """Return the poses of both grips at times of a plan."""
    return tuple([Pose.from_rotation(*frame) for frame in zip(*path.at(
        np.linspace(*plan.times[[0, -1]], count)), strict=True)] for path in plan.paths.values())


def room_beside_the_box(shape):
    """Return the distance (m) of the DLO from BOX, by its points."""
    points = shape.positions_at(np.linspace(0, LENGTH, 301))
    beyond = np.abs(points - BOX.pose.position) - 0.5 * np.array(BOX.size)
    return float((np.linalg.norm(np.maximum(beyond, 0), axis=1)
                  + np.minimum(beyond.max(axis=1), 0)).min() - ROD.radius)


def test_it_is_lifted_over_what_is_in_the_way():
    plan = over()
    assert plan.starts == (('carry', 0),) and set(plan.arms) == {'far_end'}
    assert plan.grippers[0] == BEGIN[0] and plan.far_end_poses[0] == BEGIN[1]
    np.testing.assert_allclose(plan.grippers[-1].matrix, END[0].matrix, atol=1e-12)
    np.testing.assert_allclose(plan.far_end_poses[-1].matrix, END[1].matrix, atol=1e-12)
    heights = np.array([pose.position[2] for pose in plan.grippers])
    assert heights.max() > 0.7 and len(plan.stops) >= 2
    # followed closely, it stays away from the box and comes into the same shape, without a leap
    direct, ways = simulator(), closely(plan)
    shapes = direct.track(ways[0], far_ends=[FarEnd(pose) for pose in ways[1]])
    assert all(shape.converged and not shape.jumped for shape in shapes)
    assert min(map(room_beside_the_box, shapes)) > CLEARANCE - 1e-4
    moves = [np.abs(b.positions - a.positions).max()
             for a, b in zip(shapes, shapes[1:], strict=False)]
    assert max(moves) < 0.05
    np.testing.assert_allclose(shapes[-1].positions, plan.shapes[-1].positions, atol=1e-8)
    assert max(np.abs(wrench[:3]).max() for shape in shapes
               for wrench in (shape.gripper_wrench, shape.far_wrench)) < MAX_FORCE
    assert plan.clearance.min() >= CLEARANCE and plan.largest_force.max() <= MAX_FORCE


def test_the_way_is_shortened_and_ends_in_the_same_shape():
    plan = over()
    way = sum(np.linalg.norm(b.position - a.position)
              for a, b in zip(plan.grippers, plan.grippers[1:], strict=False))
    lifted = 0.6 + 2 * (max(pose.position[2] for pose in plan.grippers) - 0.6)
    assert way < 0.95 * lifted
    lone = simulator().solve(END[0], far_end=END[1])
    np.testing.assert_allclose(plan.shapes[-1].positions, lone.positions, atol=1e-5 * LENGTH)


def test_where_nothing_is_in_the_way_it_goes_straight():
    plan = InverseSimulator(simulator()).plan(carry(), start=BEGIN[0])
    assert plan.stops == () and len(plan) < 10
    heights = [pose.position[2] for pose in (*plan.grippers, *plan.far_end_poses)]
    np.testing.assert_allclose(heights, 0.6, atol=1e-12)


@pytest.mark.parametrize('k', [1, 8])
def test_random_carries_are_kept(k):
    setting = list(settings(k + 1, 7))[k]
    plan, why, _ = planned(setting)
    assert plan is not None, why
    ways = tuple(way[::4] for way in closely(plan, 480))
    assert judged(setting, ways).kept


def test_where_the_dlo_is_hardly_stable_it_is_not_led_into_another_shape():
    # on the way down the stability goes through 1e-4, and beyond are two stable shapes: a step
    # that goes over that leads into one of them, the DLO comes into the other
    setting = list(settings(6, 7))[5]
    plan, why, _ = planned(setting)
    assert plan is None and 'stability' in why
    assert 'neither the straight way nor one lifted by 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1 m' in why


def test_what_is_between_two_waypoints_is_seen():
    # both ends go past a thin wire that no waypoint touches
    poses = InverseSimulator(simulator()).plan(carry(), start=BEGIN[0])
    lowest = [shape.positions[16] for shape in poses.shapes]
    middle = 0.5 * (lowest[2] + lowest[3])
    wire = Capsule(middle - [0, 0, 0.02], middle + [0, 0, 0.02], 5e-4, name='wire')
    inverse = InverseSimulator(simulator(wire))
    task = MoveTo([END[0]], FarEnd(BEGIN[1]), far_ends=[END[1]])
    with pytest.raises(Infeasible, match='waypoint 3: on the way there the DLO is .* in wire'):
        inverse.plan(task, start=BEGIN[0])
    free = InverseSimulator(simulator()).plan(task, start=BEGIN[0])
    assert all(np.linalg.norm(shape.positions - middle, axis=1).min() > 0.02
               for shape in free.shapes)


def test_the_clearance_is_kept_between_two_waypoints():
    shapes = InverseSimulator(simulator()).plan(carry(), start=BEGIN[0]).shapes
    place = 0.5 * (shapes[2].positions[16] + shapes[3].positions[16]) - [0, 0, 0.02]
    inverse = InverseSimulator(simulator(Sphere(place, 0.005, name='ball')))
    task = carry(clearance=0.03)
    straight = MoveTo([END[0]], FarEnd(BEGIN[1]), far_ends=[END[1]])
    near = inverse.plan(straight, start=BEGIN[0])
    assert near.clearance.min() > 0.03  # at the waypoints
    plan = inverse.plan(task, start=BEGIN[0])
    ways = closely(plan)
    followed = simulator().track(ways[0], far_ends=[FarEnd(pose) for pose in ways[1]])
    assert min(np.linalg.norm(shape.positions_at(np.linspace(0, 1, 301)) - place, axis=1).min()
               for shape in followed) > 0.03 + 0.005 + ROD.radius - 1e-4
    assert plan.stops  # round it, not by it


def test_limits_are_kept_between_two_waypoints():
    # both ends turn towards each other and away again within one step
    poses = Pose((-0.3, 0.0, 0.6), AHEAD), Pose((-0.3, 0.07, 0.6), AHEAD)
    ends = Pose((0.3, 0.07, 0.6), AHEAD), Pose((0.3, 0.0, 0.6), AHEAD)
    inverse = InverseSimulator(simulator())

    def moved(limit):
        return inverse.plan(MoveTo([poses[1]], FarEnd(ends[0]), max_moment=limit,
                                   far_ends=[ends[1]]), start=poses[0])

    free = moved(None)
    assert len(free) == 2
    grippers, others = closely(free, 21)
    shapes = simulator().track(grippers, far_ends=[FarEnd(pose) for pose in others])
    moments = [max(np.linalg.norm(wrench[3:]) for wrench in (one.gripper_wrench, one.far_wrench))
               for one in shapes]
    most, at_ends = max(moments), max(moments[0], moments[-1])
    assert most > at_ends + 1e-4
    with pytest.raises(Infeasible, match='on the way there a grip would exert .* max_moment'):
        moved(0.5 * (most + at_ends))
    assert len(moved(most + 1e-3)) == 2


def test_the_slowest_arm_makes_the_times():
    task = MoveTo([BEGIN[0]], FarEnd(BEGIN[1]), far_ends=[Pose((0.3, -0.1, 0.6), AHEAD)])
    plan = InverseSimulator(simulator()).plan(task, start=BEGIN[0])
    assert plan.times[-1] == pytest.approx(np.hypot(0.05, 0.2) / 0.1, rel=1e-9)
    assert plan.grippers[0] == plan.grippers[-1]


def test_a_replay_follows_all_arms():
    report = replay(simulator(BOX), over(), obstacles=[BOX])
    assert report.converged and report.deviation < 1e-6 and report.clearance > CLEARANCE - 1e-6


def test_a_place_inside_goes_along():
    held = [Hold(Pose((0.0, -0.3, 0.45), AHEAD), 'pinned', 0.5, by='left arm')]
    there = [Hold(Pose((0.0, 0.3, 0.45), AHEAD), 'pinned', 0.5)]
    task = Carry(END[0], END[1], there, FarEnd(BEGIN[1]), held)
    plan = InverseSimulator(simulator()).plan(task, start=BEGIN[0])
    assert set(plan.arms) == {'left arm', 'far_end'} and plan.wrenches.shape[1] == 3
    for shape in plan.shapes:
        place, y = shape.positions_at([0.5])[0], shape.gripper.position[1]
        np.testing.assert_allclose(place, [0.0, y, 0.45], atol=1e-9)


def test_it_is_refused_by_what_is_in_the_way():
    for place, said in (((0.0, -0.3, 0.3), 'waypoint 0: the DLO is .* m nearer than clearance = '
                         '0.01 m to ball'),
                        ((0.0, 0.3, 0.3), 'at the goal the DLO is .* nearer than .* to ball')):
        ball = Sphere(place, 0.05, name='ball')
        with pytest.raises(Infeasible, match=said):
            InverseSimulator(simulator(ball)).plan(carry(clearance=0.01), start=BEGIN[0])
    wall = Box(Pose((0.0, 0.0, 0.7), AHEAD), (3.0, 0.1, 3.0), name='wall')
    with pytest.raises(Infeasible, match='neither the straight way nor .* farthest .*wall') as seen:
        InverseSimulator(simulator(wall)).plan(carry(), start=BEGIN[0])
    assert 0 < seen.value.plan.fraction < 1


def test_limits_and_reach_are_kept():
    inverse = InverseSimulator(simulator())
    with pytest.raises(Infeasible, match='a grip would exert .* N, at most max_force = 0.3 N'):
        inverse.plan(carry(max_force=0.3), start=BEGIN[0])
    with pytest.raises(Infeasible, match='max_moment = 0.01 N m'):
        inverse.plan(carry(max_moment=0.01), start=BEGIN[0])
    far = Pose((0.7, 0.3, 0.6), AHEAD)
    with pytest.raises(Infeasible, match='at the goal the DLO would be too short: the far end is '
                                         'held 1.05 m from the gripper'):
        inverse.plan(carry((END[0], far)), start=BEGIN[0])


def test_what_makes_no_sense_is_said():
    inverse = InverseSimulator(simulator())
    with pytest.raises(InvalidTask, match='far_end_to = .* expected a far end that is held'):
        inverse.plan(Carry(END[0], END[1]), start=BEGIN[0])
    with pytest.raises(InvalidTask, match='holds_to: .* expected a place that is held'):
        inverse.plan(carry(holds_to=[Hold(END[0], s=0.4)]), start=BEGIN[0])
    pinned = [Hold(Pose((0.0, -0.3, 0.45), AHEAD), 'pinned', 0.5)]
    with pytest.raises(InvalidTask, match="expected the grip 'pinned'"):
        inverse.plan(carry(holds=pinned, holds_to=[Hold(END[0], s=0.5)]), start=BEGIN[0])
    twice = [Hold(one.pose, 'pinned', s, by='arm') for one in pinned for s in (0.4, 0.6)]
    with pytest.raises(InvalidTask, match='held by arm, arm, far_end: expected a name of its own'):
        inverse.plan(carry(holds=twice, holds_to=twice), start=BEGIN[0])
    with pytest.raises(InvalidTask, match='expected none of the tip'):
        carry(holds_to=[FarEnd(END[1])])
    elsewhere = inverse.simulator.solve(BEGIN[0], far_end=END[1])
    with pytest.raises(InvalidTask, match='initial is held by'):
        inverse.plan(carry(), start=BEGIN[0], initial=elsewhere)
    with pytest.raises(InvalidTask, match='far_ends has 2 entries'):
        MoveTo([BEGIN[0]], FarEnd(BEGIN[1]), far_ends=END)
    with pytest.raises(InvalidTask, match='far_end = None: expected the FarEnd that far_ends'):
        MoveTo([BEGIN[0]], far_ends=[END[1]])


def test_the_present_shape_says_how_the_dlo_is_held():
    inverse = InverseSimulator(simulator())
    shape = inverse.simulator.solve(BEGIN[0], holds=[Hold(BEGIN[1], by='right arm')])
    plan = inverse.plan(Carry(END[0], END[1]), start=BEGIN[0], initial=shape)
    assert set(plan.arms) == {'right arm'}


def test_without_gravity_it_is_lifted_along_z():
    begin, end = (tuple(Pose.looking_along(pose.position, (1, 0, tilt)) for pose, tilt in zip(
        poses, (-0.5, 0.5), strict=True)) for poses in (BEGIN, END))
    box = Box(BOX.pose, (0.4, 0.1, 0.7))
    floating = DirectSimulator(ROD, n_elements=32, basis='local', gravity=(0, 0, 0),
                               obstacles=[box])
    plan = InverseSimulator(floating).plan(carry(end, begin), start=begin[0])
    assert max(pose.position[2] for pose in plan.grippers) > 0.61


def test_files_of_task_and_plan(tmp_path):
    task = Carry(END[0], END[1], [Hold(END[0], 'pinned', 0.5)], FarEnd(BEGIN[1]),
                 [Hold(BEGIN[0], 'pinned', 0.5, by='left arm')], 2.0, 0.3, 0.01)
    assert task_from_yaml(task_to_yaml(task)) == task
    plan = over()
    plan.save(tmp_path / 'plan.npz')
    again = Plan.load(tmp_path / 'plan.npz')
    assert again.arms == plan.arms and again.starts == plan.starts
    np.testing.assert_array_equal(again.wrenches, plan.wrenches)
