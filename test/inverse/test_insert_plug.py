# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plug led into its socket: the way, what the hand gives, and refusals; judged apart."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.plugs import (
    CLEARANCE,
    DEPTHS,
    FAR_END,
    PLUG,
    ROD,
    front_wrench,
    settings,
    shot,
    socket_around,
)
from dlo_planner import (
    Box,
    CutOut,
    DirectSimulator,
    FarEnd,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Limits,
    Plan,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Trajectory,
    Uncertainty,
    Workspace,
    replay,
    robustness,
)
from dlo_planner.model.pose import displaced
from dlo_planner.rods import with_plug
from dlo_planner.tasks import (
    InsertPlug,
    MoveTo,
    Plug,
    concatenate,
    task_from_yaml,
    task_to_yaml,
)

SOCKET = Pose.looking_along((0.2, 0.2, 0.05), (0, -1, 0))
TASK = InsertPlug(SOCKET, PLUG, DEPTHS, far_end=FAR_END)
ABOVE = Pose((0.2, 0.35, 0.12), TASK.gripper_at(0.0).quaternion)
GRAVITY = (0.0, 0.0, -9.81)


def inverse(*obstacles, **options):
    """Return the InverseSimulator of the cable among obstacles."""
    return InverseSimulator(DirectSimulator(ROD, n_elements=32, basis='local',
                                            obstacles=obstacles), **options)


@cache
def planned():
    """Return the Plan from above the socket, through its wall."""
    return inverse(socket_around(SOCKET)).plan(TASK, start=ABOVE)


def test_the_front_goes_straight_along_the_axis():
    plan = planned()
    fronts = np.array([pose.position for pose in plan.plug_poses])
    beyond = (fronts - SOCKET.position) @ SOCKET.rotation[:, 0]
    insert = plan.stages[-1].first
    assert [stage.name for stage in plan.stages] == ['approach', 'insert']
    assert plan.grippers[0] == ABOVE
    np.testing.assert_allclose(beyond[insert:], DEPTHS, atol=1e-12)
    on_axis = plan.stops[0]  # the hand stops where the axis begins
    np.testing.assert_allclose(beyond[on_axis], -0.1, atol=1e-12)
    off = fronts - SOCKET.position - beyond[:, None] * SOCKET.rotation[:, 0]
    assert np.abs(off[on_axis:]).max() < 1e-12 < np.abs(off[0]).max()
    for pose in plan.plug_poses[on_axis:]:
        np.testing.assert_allclose(pose.rotation, SOCKET.rotation, atol=1e-12)
    assert all(shape.far_end == FAR_END for shape in plan.shapes) and not plan.arms


def test_the_hand_gives_what_shooting_gives():
    task, _ = next(settings(1, 3))
    simulator = DirectSimulator(ROD, n_elements=96, basis='local')
    plan = InverseSimulator(simulator).plan(replace(task, depths=[0.0]))
    k = plan.stages[-1].first
    gripper = plan.grippers[k]
    found = shot(gripper, FAR_END.pose, 1.01 * plan.shapes[k].gripper_wrench)
    there, own = front_wrench(gripper, found), plan.plug_wrenches[k]
    for part in (slice(3), slice(3, 6)):
        away = np.linalg.norm((own - there)[part]) / np.linalg.norm(there[part])
        assert away < 1e-3


def test_a_rigid_end_of_the_dlo_needs_the_same():
    # the plug as a part of the DLO, held at its front by what holds the far end, from the other end
    k = planned().stages[-1].first
    front = planned().plug_poses[k]
    rigid = DirectSimulator(with_plug(ROD, PLUG.length, PLUG.mass, radius=PLUG.radius))
    turned = FAR_END.pose.compose(Pose((0, 0, 0), (0, 0, 1, 0)))
    shape = rigid.solve(turned, far_end=FarEnd(front))
    assert shape.converged
    own, there = planned().plug_wrenches[k], shape.far_wrench
    np.testing.assert_allclose(own[:3], there[:3], atol=5e-3 * np.linalg.norm(there[:3]))
    np.testing.assert_allclose(own[3:], there[3:], atol=5e-3 * np.linalg.norm(there[3:]))


def test_the_weight_of_the_plug_hangs_in_its_middle():
    heavy, gripper = Plug(0.04, 0.01, 0.5), Pose((0.04, 0, 0), (0, 0, 0, 1))
    wrench = heavy.wrench(gripper, np.zeros(6), GRAVITY)
    # the front is at the origin, the plug lies along +x from it: it would turn down about y
    np.testing.assert_allclose(heavy.front(gripper).position, 0, atol=1e-15)
    np.testing.assert_allclose(wrench, [0, 0, 0.5 * 9.81, 0, -0.02 * 0.5 * 9.81, 0], atol=1e-12)


def test_an_angled_plug_leads_the_cable_sideways():
    up = Pose.looking_along((-0.02, 0, 0), (0, 0, 1))
    angled = Plug(0.03, 0.006, 0.02, grasp=up)
    gripper = InsertPlug(SOCKET, angled).gripper_at(0.01)
    np.testing.assert_allclose(gripper.rotation[:, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(gripper.position, SOCKET.position - [0, 0.01 - 0.02, 0], atol=1e-12)
    np.testing.assert_allclose(angled.front(gripper).matrix,
                               Pose(SOCKET.position - [0, 0.01, 0], SOCKET.quaternion).matrix,
                               atol=1e-12)


@pytest.mark.parametrize(('obstacle', 'word'), [
    (Box(Pose.looking_along((0.2, 0.22, 0.05), (0, -1, 0)), (0.004, 0.02, 0.02), name='lid'),
     'm in lid'),
    (Sheet(SOCKET, 0.1, 0.1, 0.002, (CutOut(SOCKET, radius=PLUG.radius - 1e-4),), name='narrow'),
     'm in narrow'),
    # between two waypoints alone, and off the axis by nearly the radius
    (Sphere(SOCKET.position + [PLUG.radius + 0.003, 0.09, 0], 0.004, name='bead'),
     'on the way there the plug comes')])
def test_what_is_before_the_socket_is_named(obstacle, word):
    with pytest.raises(Infeasible, match=word) as refused:
        inverse(obstacle).plan(TASK)
    assert refused.value.constraint == 'plug' and refused.value.amount > 0


def test_a_bead_that_is_just_missed_is_no_obstacle():
    bead = Sphere(SOCKET.position + [PLUG.radius + 0.005, 0.09, 0], 0.004)
    assert len(inverse(bead).plan(TASK))


def test_the_plug_fits_through_its_own_socket_with_little_room():
    assert 0.05 * PLUG.radius > CLEARANCE
    assert len(planned()) > 8
    inverse(socket_around(SOCKET)).check(planned())
    shifted = Sheet.around(CutOut(Pose(SOCKET.position + [2 * CLEARANCE, 0.01, 0],
                                       SOCKET.quaternion), radius=PLUG.radius + CLEARANCE),
                           0.08, 0.08, name='shifted')
    with pytest.raises(Infeasible, match='shifted'):
        inverse(shifted).check(planned())


def test_bodies_that_the_gripper_keeps_out_of_count_for_the_plug():
    post = Sphere(SOCKET.position + [0, 0.04, 0.015], 0.012, name='post')
    with pytest.raises(Infeasible, match='post'):
        inverse(workspace=Workspace(keep_out=[post])).plan(TASK)


def test_what_is_out_of_reach_is_said():
    far = Pose.looking_along((0.2, 0.52, 0.05), (0, -1, 0))
    with pytest.raises(Infeasible, match='before the socket the cable would be too short'):
        inverse().plan(InsertPlug(far, PLUG, DEPTHS, far_end=FAR_END))
    far = Pose.looking_along((0.2, 0.52, 0.05), (0, 1, 0))
    with pytest.raises(Infeasible, match='in the socket the cable would be too short'):
        inverse().plan(InsertPlug(far, PLUG, DEPTHS, far_end=FAR_END))


def test_limits_of_force_are_those_of_the_cable():
    most = planned().largest_force.max()
    with pytest.raises(Infeasible, match='max_force'):
        inverse().plan(replace(TASK, max_force=0.9 * most), start=ABOVE)
    plan = inverse().plan(replace(TASK, max_force=1.1 * most), start=ABOVE)
    assert plan.wrench_limits == (1.1 * most, None)


def test_bad_arguments_are_refused():
    for options, word in (({'depths': [0.0, 0.04]}, r'depths\[1\] = 0.04: expected .*0.03'),
                          ({'depths': [0.01, 0.0]}, r'depths\[1\]'),
                          ({'approach': 0.0}, 'approach = 0'), ({'plug': SOCKET}, 'plug = ')):
        with pytest.raises(InvalidTask, match=word):
            replace(TASK, **options)
    with pytest.raises(InvalidTask, match=r'Plug.radius = 0.02: expected .*0.015'):
        Plug(0.03, 0.02, 0.1)
    held = inverse().simulator.solve(ABOVE, far_end=FarEnd(Pose((0.1, 0, 0), (0, 0, 1, 0))))
    with pytest.raises(InvalidTask, match='initial is held'):
        inverse().plan(TASK, start=ABOVE, initial=held)


def test_what_holds_the_cable_may_be_told_by_its_shape():
    initial = inverse().simulator.solve(ABOVE, far_end=FAR_END)
    plan = inverse().plan(replace(TASK, far_end=None), start=ABOVE, initial=initial)
    np.testing.assert_allclose(plan.plug_wrenches, planned().plug_wrenches, atol=1e-6)


def test_files_keep_plug_and_wrenches(tmp_path):
    for name in ('plan.npz', 'plan.json'):
        planned().save(tmp_path / name)
        known = Plan.load(tmp_path / name)
        assert known.plug == PLUG and np.array_equal(known.plug_wrenches, planned().plug_wrenches)
        assert known.plug_poses == planned().plug_poses and known.starts == planned().starts
        assert known.shapes[0].far_end is not None
    task = task_from_yaml(task_to_yaml(TASK))
    assert task == TASK and task_from_yaml(
        '{type: InsertPlug, socket: [0.2, 0.2, 0.05], plug: {length: 0.03, radius: 0.006, '
        'mass: 0.02}}').plug == PLUG


def test_plans_before_and_after_are_joined():
    back = inverse().plan(MoveTo([ABOVE], far_end=FAR_END), start=planned().grippers[-1])
    whole = concatenate(planned(), back)
    assert whole.plug == PLUG and len(whole.plug_wrenches) == len(whole)
    assert np.isnan(whole.plug_wrenches[len(planned()):]).all()
    assert {metric.name for metric in whole.metrics} >= {'plug_force', 'plug_moment'}
    other = replace(back, plug=Plug(0.04, 0.006, 0.02))
    with pytest.raises(InvalidTask, match=r'other\.plug'):
        concatenate(planned(), other)
    assert 'plug_force' not in {metric.name for metric in back.metrics}


def test_how_wrong_the_wrench_is_by_errors_of_the_grasp():
    # 2 mm and 0.04 rad of the hand alone, against solves with errors drawn at random
    plan = inverse().plan(replace(TASK, depths=[0.0]))
    k, direct = len(plan) - 1, inverse().simulator
    shape, front = plan.shapes[k], plan.plug_poses[k].position
    deviation = np.repeat([0.04, 0.002], 3) / np.sqrt(3)
    rng, seen = np.random.default_rng(0), []
    for _ in range(300):
        gripper, end = (displaced(pose, deviation * rng.normal(size=6))
                        for pose in (shape.gripper, FAR_END.pose))
        wrench = front_wrench(gripper, direct.solve(
            gripper, shape, far_end=FarEnd(end)).gripper_wrench)
        moved = gripper.position - PLUG.length * gripper.rotation[:, 0] - front
        seen.append(wrench + np.append(np.zeros(3), np.cross(moved, wrench[:3])))
    found = robustness(direct, plan, Uncertainty(
        gripper_rotation=deviation[0], gripper_position=deviation[3]))
    assert found.plug_wrenches.shape == (len(plan), 6)
    np.testing.assert_allclose(found.plug_wrenches[k], np.std(seen, axis=0), rtol=0.15)
    assert np.isfinite(found.first_order).all() and found.first_order.max() > 0
    stiff = robustness(direct, plan, Uncertainty(bending_stiffness=0.05))
    ends = []
    for part in (0.95, 1.05):
        torsion, bending, _ = ROD.stiffness
        rod = Rod(ROD.length, ROD.mass_per_length, part * bending, torsion)
        there = DirectSimulator(rod, n_elements=32, basis='local').solve(
            shape.gripper, far_end=FAR_END)
        ends.append(front_wrench(shape.gripper, there.gripper_wrench))
    np.testing.assert_allclose(stiff.plug_wrenches[k], np.abs(ends[1] - ends[0]) / 2, rtol=1e-3,
                               atol=1e-6)


def test_what_hangs_where_it_is_not_thought_to_hang_turns_the_hand():
    # a free cable and a heavy plug: moved by a deviation, their weight has another lever
    heavy = InsertPlug(SOCKET, Plug(0.03, 0.006, 1.0), [0.0])
    plan = inverse().plan(heavy)
    weight = 9.81 * (1.0 + ROD.mass_per_length * ROD.length)
    np.testing.assert_allclose(plan.plug_wrenches[-1, :3], [0, 0, weight], atol=1e-6)
    found = robustness(inverse().simulator, plan, Uncertainty(gripper_position=2e-3))
    turned = 2e-3 * weight
    np.testing.assert_allclose(found.plug_wrenches[-1], [0, 0, 0, turned, turned, 0], atol=1e-6)


def test_no_plug_has_no_error():
    plan = inverse().plan(MoveTo([ABOVE], far_end=FAR_END), start=TASK.gripper_at(-0.1))
    found = robustness(inverse().simulator, plan, Uncertainty(gripper_position=0.001))
    assert np.isnan(found.plug_wrenches).all()


def test_no_shift_against_vibrations_takes_the_plug_off_its_axis():
    soft = Rod.circular(0.5, 0.003, 1500, 3e6, 0.4, damping=0.005)  # swings, held by the hand alone
    direct = DirectSimulator(soft, n_elements=16, basis='local')
    plan = InverseSimulator(direct).plan(InsertPlug(SOCKET, PLUG, DEPTHS, approach=0.3))
    motion = Trajectory(plan, Limits(), simulator=direct, tolerance=2e-4)
    poses = motion.at(np.linspace(0, motion.duration, 200))[0]
    off = np.array([pose.position for pose in poses]) - plan.grippers[0].position
    along = off @ SOCKET.rotation[:, 0]
    assert np.abs(off - along[:, None] * SOCKET.rotation[:, 0]).max() < 1e-9


def test_the_motion_is_calm_and_proved():
    obstacles = [socket_around(SOCKET)]
    coarse = DirectSimulator(ROD, n_elements=12, basis='local', obstacles=obstacles)
    plan = InverseSimulator(coarse).plan(TASK)
    report = replay(coarse, plan, obstacles=obstacles, limits=Limits(), tolerance=5e-3)
    assert report.safe, report.reason
