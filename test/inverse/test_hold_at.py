# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that is held inside: its front is threaded, what is behind the gripper is in the way."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    Insert,
    InvalidTask,
    InverseSimulator,
    Limits,
    Observer,
    Plan,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Thread,
    Trajectory,
    Uncertainty,
    replay,
    robustness,
)
from dlo_planner.closed_loop import LoopTask
from dlo_planner.direct.grasp import grasped_at
from dlo_planner.identify import correct
from dlo_planner.inverse.held_inside import front_of
from dlo_planner.model.rod import Surface
from dlo_planner.plan.checks import utilization
from dlo_planner.plan.continuity import same
from dlo_planner.plan.plan import concatenate
from dlo_planner.rods import GraspedInside
from dlo_planner.settings.tasks import task_from_yaml, task_to_yaml
from dlo_planner.tasks import Approach, Requirements
from dlo_planner.trajectory.modal_response import slowest_period, slowest_period_of
from dlo_planner.view.pages import Replanner

# w L^3 / EI = 30: of its whole length no shape is level where it ends, of 0.35 m there are
ROD = Rod(1.0, 0.045, 0.0147, 0.0118, radius=2.25e-3)
DIRECT = DirectSimulator(ROD)
INVERSE = InverseSimulator(DIRECT)
HOLE = CutOut(Pose.looking_along((0.5, 0, 1), (1, 0, 0)), radius=8e-3)
AT = 0.65


@pytest.fixture(scope='module')
def held():
    """Return the plan through HOLE."""
    return INVERSE.thread(HOLE, hold_at=AT)


def test_a_demanded_margin_is_that_of_the_part_in_front(held):
    least = float(held.margin.min())
    assert 0 < least < held.clearance.min()
    task = Thread(HOLE, hold_at=AT, max_misalignment=0)
    kept = INVERSE.plan(task, requirements=Requirements(margin=least - 1e-5))
    np.testing.assert_allclose(kept.margin, held.margin)
    with pytest.raises(Infeasible) as caught:
        INVERSE.plan(task, requirements=Requirements(margin=least + 1e-5))
    assert caught.value.constraint == 'margin'


def test_a_wire_that_cannot_be_threaded_from_its_end_is_where_it_is_held_inside(held):
    with pytest.raises(Infeasible, match='would not stay'):
        INVERSE.thread(HOLE, max_misalignment=0)
    assert held.fraction == 1 and len(held) == 40 and held.stability.min() > 0.5
    np.testing.assert_allclose(held.depths, np.linspace(0, 0.95 * 0.35, 40))
    for depth, shape, gripper in zip(held.depths, held.shapes, held.grippers, strict=True):
        assert shape.s[-1] == 1.0 and grasped_at(shape) == AT
        there = shape.at(1.0 - depth)
        np.testing.assert_allclose(there.position, HOLE.center, atol=1e-9)
        np.testing.assert_allclose(there.rotation[:, 0], HOLE.normal, atol=1e-9)
        np.testing.assert_allclose(shape.at(AT).matrix, gripper.matrix, atol=1e-12)


def test_the_front_is_the_plan_of_a_dlo_of_its_length_and_the_rest_hangs(held):
    own = InverseSimulator(DirectSimulator(replace(ROD, length=0.35))).thread(HOLE)
    tail = DirectSimulator(replace(ROD, length=0.65))
    for one, other in zip(held.shapes, own.shapes, strict=True):
        np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.parts[1].positions, other.positions, rtol=0, atol=1e-12)
        turned = one.gripper.rotation @ np.diag([-1.0, 1.0, -1.0])
        behind = tail.solve(Pose.from_rotation(one.gripper.position, turned))
        np.testing.assert_allclose(one.positions[64::-1], behind.positions, rtol=0, atol=1e-9)
    np.testing.assert_allclose(held.times, own.times, rtol=1e-12)


def test_held_at_its_beginning_is_held_nowhere_else():
    stiff = InverseSimulator(DirectSimulator(Rod(1.0, 0.045, 0.3, 0.2, radius=2.25e-3)))
    assert Thread(HOLE, hold_at=0) == Thread(HOLE) and Thread(HOLE).hold_at is None
    assert stiff.thread(HOLE, hold_at=0.0) == stiff.thread(HOLE)


def test_what_is_behind_the_gripper_is_in_the_way(held):
    behind = held.shapes[20].positions[20]
    ball = Sphere(behind, 0.05)
    with pytest.raises(Infeasible, match='Sphere 0.*kept to depth') as refused:
        InverseSimulator(DirectSimulator(ROD, obstacles=[ball])).thread(HOLE, hold_at=AT)
    error = refused.value
    assert error.constraint == 'clearance' and 5 < error.waypoint <= 20
    assert len(error.plan) == error.waypoint and error.plan.shapes[0].s[-1] == 1.0
    # for the part in front it is no obstacle
    InverseSimulator(DirectSimulator(replace(ROD, length=0.35), obstacles=[ball])).thread(HOLE)
    aside = Sphere(behind + np.array([0, 0.054, 0]), 0.05)
    clear = InverseSimulator(DirectSimulator(ROD, obstacles=[aside])).thread(HOLE, hold_at=AT)
    surface = np.array([np.linalg.norm(shape.positions_at(np.linspace(0, 1, 4001)) - aside.center,
                                       axis=1).min() for shape in clear.shapes]
                       ) - aside.radius - ROD.radius
    assert clear.clearance.min() < 2.5e-3 < clear.clearances.min()
    np.testing.assert_allclose(clear.clearance, np.minimum(
        surface, clear.clearances.min(axis=(1, 2))), atol=1e-6)


def test_it_is_in_the_way_between_the_waypoints_too(held):
    # thinner than a step, and the part behind is drawn past it
    a, b = (held.shapes[k].positions[10] for k in (20, 30))
    bar = Sphere(0.5 * (a + b) + np.array([0, 1.5e-3, 0]), 1e-3, name='pin {3}')
    inverse = InverseSimulator(DirectSimulator(ROD, obstacles=[bar]))
    with pytest.raises(Infeasible) as refused:
        inverse.thread(HOLE, hold_at=AT, depths=held.depths[[0, 20, 30]])
    assert refused.value.constraint == 'clearance'
    assert re.search(r'on the way there the DLO is [\d.e-]+ m in pin \{3\}', str(refused.value))
    with pytest.raises(Infeasible, match='on the way there'):
        inverse.check(replace(held, **{name: getattr(held, name)[10::20] for name in (
            'depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'times',
            'via_points', 'clearances', 'clearance', 'insertion_force', 'yield_utilization',
            'insertion_status')}))


def test_it_must_not_hang_through_the_hole_nor_into_the_sheet():
    soft = InverseSimulator(DirectSimulator(replace(ROD, bending_stiffness=1.5e-3,
                                                    torsional_stiffness=1.2e-3)))
    down, depths = Pose.looking_along((0.5, 0, 0.5), (0, 0, -1)), np.linspace(0, 0.15, 5)
    with pytest.raises(Infeasible, match='behind the gripper hangs through the cut-out'):
        soft.thread(CutOut(down, radius=0.3), hold_at=AT, depths=depths)
    with pytest.raises(Infeasible, match='in the sheet around a cut-out'):
        soft.thread(CutOut(down, radius=0.008), hold_at=AT, depths=depths)


def test_it_must_not_fall_on_the_way():
    # it hangs over to one side; the hole is where it would hang over to the other
    now = GraspedInside(ROD, AT).track([Pose.looking_along((0, 0, 1), (np.cos(a), 0, np.sin(a)))
                                        for a in np.radians(np.linspace(0, -60, 7))])[-1]
    down = Pose.looking_along((0, 0, 0.5), (-np.cos(np.radians(70)), 0, -np.sin(np.radians(70))))
    asked = {'hold_at': AT, 'depths': (0, 0.05, 0.1), 'initial': now}
    with pytest.raises(Infeasible, match='behind the gripper does not follow: .*jumped') as refused:
        INVERSE.thread(CutOut(down), start=now.gripper, **asked)
    assert refused.value.constraint == 'continuity' and 0.1 < refused.value.amount < 2
    plan = INVERSE.thread(CutOut(down), **asked)  # turned about the vertical it does not
    assert not any(shape.jumped for shape in plan.shapes)


def test_it_has_to_keep_every_demand(held):
    weak = replace(ROD, max_bend_curvature=12.0)  # the part in front bends by 3 / m, the rest 7
    bend = 12.0 - InverseSimulator(DirectSimulator(weak)).thread(HOLE, hold_at=AT).bend_margin
    fronts = [np.hypot(*part.strains[0, 1:]) for part in (one.parts[1] for one in held.shapes)]
    most = 0.5 * (bend.max() + max(fronts))
    assert bend.max() > max(fronts) + 1
    with pytest.raises(Infeasible, match='max_bend_curvature'):
        InverseSimulator(DirectSimulator(replace(ROD, max_bend_curvature=most))).thread(
            HOLE, hold_at=AT)
    yields = DirectSimulator(replace(ROD, yield_curvature=most))
    plan = InverseSimulator(yields).thread(HOLE, hold_at=AT)
    assert plan.yields and plan.yield_utilization.max() == pytest.approx(bend.max() / most, 0.01)
    assert plan.yield_utilization[3] == utilization(plan.shapes[3], np.array([np.inf, most, most]))
    with pytest.raises(Infeasible, match='would yield'):
        InverseSimulator(yields, allow_plastic=False).thread(HOLE, hold_at=AT)


def test_a_thick_sheet_among_the_obstacles_is_the_one_around_the_hole():
    sheet = Sheet(HOLE.pose, 1.0, 1.0, 0.01, (HOLE,))
    plan = InverseSimulator(DirectSimulator(ROD, obstacles=[sheet])).thread(HOLE, hold_at=AT)
    assert plan.sheets[0][0] is sheet and plan.clearances.shape == (40, 1, 3)
    assert 0.005 < plan.clearance.min() <= 8e-3 - ROD.radius


def test_depths_are_of_the_free_end():
    with pytest.raises(InvalidTask, match=r'depths\[1\] = 0.4: expected .* <= 0.35'):
        INVERSE.thread(HOLE, hold_at=AT, depths=(0, 0.4))
    near = INVERSE.thread(HOLE, hold_at=AT, gripper_clearance=0.1)
    assert 20 < len(near) < 40 and all(
        (HOLE.center - one.position) @ HOLE.normal >= 0.1 for one in near.grippers)
    # held farther from its end it becomes too soft: as deep as it gets
    ball = Sphere(INVERSE.thread(HOLE, hold_at=AT).shapes[20].positions[20], 0.05)
    deep = InverseSimulator(DirectSimulator(ROD, obstacles=[ball])).thread(
        HOLE, hold_at=AT, as_deep_as_possible=True)
    assert 0.1 < deep.fraction < 0.7 and deep.clearance.min() >= 0


@pytest.mark.parametrize(('at', 'named'), [
    (1.0, 'hold_at = 1.0: expected .* < 1'), (2, 'hold_at = 2'), (-0.1, 'hold_at = -0.1'),
    (np.nan, 'hold_at = nan'), ('x', 'hold_at = \'x\'')])
def test_other_places_are_refused_by_name(at, named):
    with pytest.raises(InvalidTask, match=named):
        INVERSE.thread(HOLE, hold_at=at)


def test_the_shape_now_has_to_be_held_there(held):
    start = Pose(held.grippers[0].position - np.array([0.1, 0, 0]), held.grippers[0].quaternion)
    now = GraspedInside(ROD, AT).solve(start)
    plan = INVERSE.thread(HOLE, hold_at=AT, initial=now, start=start)
    assert same(plan.shapes[-1], held.shapes[-1])
    for wrong, at in ((GraspedInside(ROD, 0.5).solve(start), 0.5), (DIRECT.solve(start), 0)):
        with pytest.raises(InvalidTask, match=f'initial = .*at 0.65 m, it is held at {at} m'):
            INVERSE.thread(HOLE, hold_at=AT, initial=wrong)
    with pytest.raises(InvalidTask, match='initial = .*not grasped inside'):
        INVERSE.thread(HOLE, initial=now)


def test_what_is_bent_for_good_stays_so():
    yields = replace(ROD, yield_curvature=4.0, hardening=0.2)
    start = Pose.looking_along((0.05, 0, 1), (1, 0, 0.02))
    now = GraspedInside(yields, AT, basis='local', n_elements=24).solve(start)
    assert now.dissipated > 0 and now.parts[0].dissipated > 0.9 * now.dissipated
    inverse = InverseSimulator(DirectSimulator(yields, basis='local', n_elements=24))
    plan, fresh = (inverse.thread(HOLE, hold_at=AT, depths=(0, 0.05, 0.1), start=start, initial=one)
                   for one in (now, None))
    # elastic from the set that there is: near where it would be by small steps that yield no more
    there = GraspedInside(yields, AT, basis='local', n_elements=24).solve(plan.grippers[0], now)
    away, without = (np.linalg.norm(shape.positions - there.positions_at(shape.s), axis=1).max()
                     for shape in (plan.shapes[0], fresh.shapes[0]))
    assert away < 0.1 * without and without > 0.01
    with pytest.raises(InvalidTask, match='expected one without a permanent set .* at 0.65 m'):
        whole = DirectSimulator(yields, basis='local', n_elements=24)
        InverseSimulator(whole.with_set(whole.solve(start))).thread(HOLE, hold_at=AT)


def test_it_travels_as_text_and_in_files(held, tmp_path):
    task = Thread(HOLE, hold_at=AT)
    assert task_from_yaml(task_to_yaml(task)) == task and 'hold_at: 0.65' in task_to_yaml(task)
    held.save(tmp_path / 'plan.npz')
    loaded = Plan.load(tmp_path / 'plan.npz')
    assert grasped_at(loaded.shapes[3]) == AT
    np.testing.assert_array_equal(loaded.shapes[3].positions, held.shapes[3].positions)
    assert replay(DIRECT, loaded).converged
    goal, = (one for one in concatenate(way(held), held).goals[0])  # nothing passes there yet
    assert not goal.residuals(way(held).shapes[0]).any()


def way(held):
    """Return the way to a plan's first pose."""
    start = Pose(held.grippers[0].position - np.array([0.2, 0.05, -0.1]), (0, 0, 0, 1))
    return INVERSE.approach(HOLE, held, start, standoff=0.05)


def test_the_way_there_is_of_the_whole_dlo(held):
    coming = way(held)
    assert same(coming.shapes[-1], held.shapes[0]) and coming.stops
    assert all(grasped_at(shape) == AT for shape in coming.shapes)
    assert coming.via_points[0] == () and coming.position_error.max() == 0
    both = INVERSE.check(concatenate(coming, held))
    assert replay(DIRECT, both).converged
    # it has to end as the threading begins, all of it
    back, front = held.shapes[0].parts
    bent = DirectSimulator(replace(ROD, length=0.65, natural_curvature=(0, 0.5))).solve(
        back.gripper)
    with pytest.raises(Infeasible, match='behind the gripper does not come into') as refused:
        INVERSE.plan(Approach(HOLE, GraspedInside(ROD, AT).joined(bent, front), 0.05),
                     start=coming.grippers[0])
    assert refused.value.constraint == 'start' and refused.value.amount == pytest.approx(
        np.linalg.norm(bent.positions - back.positions, axis=1).max(), rel=1e-6)
    # the part behind the gripper is looked at, too
    ball = Sphere(coming.shapes[2].positions[10], 0.02)
    with pytest.raises(Infeasible, match='start phase, waypoint [12].*Sphere'):
        InverseSimulator(DirectSimulator(ROD, obstacles=[ball])).plan(
            Approach(HOLE, held.shapes[0], 0.05), start=coming.grippers[0])


# ---- what is made of the plan --------------------------------------------------------------------


def test_a_replay_holds_the_dlo_where_the_plan_does(held):
    for simulator in (DIRECT, GraspedInside(ROD, AT)):
        report = replay(simulator, held)
        assert report.converged and report.deviation < 1e-9 and report.position_error < 1e-9
    stiffer = DirectSimulator(replace(ROD, bending_stiffness=0.0147 * 1.05))
    other = replay(stiffer, held)
    shapes = GraspedInside(stiffer.rod, AT).track(held.grippers)
    assert other.deviation == pytest.approx(max(np.linalg.norm(
        one.positions - two.positions, axis=1).max() for one, two in zip(
            shapes, held.shapes, strict=True)), rel=1e-2)
    assert other.position_error == pytest.approx(max(np.linalg.norm(
        shape.at(1 - depth).position - HOLE.center) for shape, depth in zip(
            shapes, held.depths, strict=True)), rel=1e-6)
    with pytest.raises(InvalidTask, match='simulator holds the DLO at 0.5 m: expected 0.65 m'):
        replay(GraspedInside(ROD, 0.5), held)
    with pytest.raises(InvalidTask, match='simulator holds the DLO at 0.5 m: expected 0 m'):
        replay(GraspedInside(ROD, 0.5), InverseSimulator(DirectSimulator(replace(
            ROD, bending_stiffness=0.3))).thread(HOLE, depths=(0, 0.1)))
    # what the part behind comes into is seen in the replay
    ball = Sphere(held.shapes[20].positions[20], 0.05)
    assert replay(DIRECT, held, obstacles=[ball]).clearance < 0


def test_in_motion_both_parts_are_calm(held):
    short = InverseSimulator(DIRECT).thread(HOLE, hold_at=AT, depths=np.linspace(0, 0.1, 6))
    quick = Limits(linear_speed=0.5, linear_acceleration=5.0, linear_jerk=200.0)
    calm = Trajectory(short, quick)
    tail = DirectSimulator(replace(ROD, length=0.65, damping=0.0), n_elements=24, basis='local')

    def swing_behind(trajectory):
        times = np.arange(0, trajectory.duration + 0.8, 0.02)
        grippers = [Pose.from_rotation(pose.position, pose.rotation @ np.diag([-1.0, 1.0, -1.0]))
                    for pose in trajectory.poses(times)]
        motion = tail.simulate(grippers, 0.02)
        rest = motion.times >= trajectory.duration
        last = tail.solve(grippers[-1])
        return max(np.linalg.norm(shape.positions - last.positions, axis=1).max()
                   for shape, after in zip(motion.shapes, rest, strict=True) if after)

    assert calm.motion.departure <= calm.tolerance
    assert swing_behind(calm) <= 1.05 * calm.tolerance
    # the period that it takes is that of the longer part, 0.65 m
    slowest = 1 / GraspedInside(ROD, AT).solve(short.grippers[0]).parts[0].modes(1).frequencies[0]
    assert calm.slowest_period == pytest.approx(slowest, rel=0.05)
    assert slowest_period_of(GraspedInside(ROD, AT)) == slowest_period(tail.rod)
    assert swing_behind(Trajectory(short, quick, tolerance=np.inf)) > 2 * calm.tolerance


def test_the_motion_of_what_is_behind_counts_in_each_figure(held):
    short = InverseSimulator(DIRECT).thread(HOLE, hold_at=AT, depths=np.linspace(0, 0.1, 6))
    trajectory = Trajectory(short, tolerance=np.inf)
    ball = Sphere(short.shapes[-1].positions[10] + np.array([0.036, 0, 0]), 0.03)
    report = replay(DIRECT, short, trajectory=trajectory, obstacles=[ball])
    times = np.linspace(0, trajectory.duration + 1.0, 121)
    shapes = GraspedInside(ROD, AT).simulate(trajectory.poses(times), times[1]).shapes
    away = min(np.linalg.norm(shape.positions - ball.center, axis=1).min() for shape in shapes)
    assert report.dynamic_clearance == pytest.approx(away - 0.03 - ROD.radius, abs=3e-4)
    assert report.dynamic_clearance < report.clearance


def test_robustness_is_that_of_full_solutions(held):
    uncertain = Uncertainty(bending_stiffness=0.02, gripper_rotation=1e-3)
    some = replace(held, **{name: getattr(held, name)[::13] for name in (
        'depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'times', 'via_points',
        'clearances', 'clearance', 'insertion_force', 'yield_utilization', 'insertion_status')})
    found = robustness(DIRECT, some, uncertain, samples=20)
    assert found.success == 1.0
    rng, misses = np.random.default_rng(7), []
    for _ in range(60):
        stiff = 1 + 0.02 * rng.normal()
        wire = GraspedInside(replace(ROD, bending_stiffness=0.0147 * stiff), AT)
        turn = Pose((0, 0, 0), (*(0.5e-3 * rng.normal(size=3)), 1.0))
        row = []
        for shape in some.shapes:
            solved = wire.solve(shape.gripper.compose(turn))
            s = np.linspace(AT, 1, 2001)
            ahead = solved.positions_at(s) - HOLE.center
            tip, along = solved.positions[-1] - HOLE.center, solved.tangents[-1]
            beyond = tip - max(tip @ -along, 0.0) * -along  # it goes on straight
            row.append(min(np.linalg.norm(ahead, axis=1).min(), np.linalg.norm(beyond)))
        misses.append(row)
    rms = np.sqrt((np.array(misses)**2).mean(axis=0))
    np.testing.assert_allclose(found.first_order, rms, rtol=0.25)
    np.testing.assert_allclose(robustness(GraspedInside(ROD, AT), some, uncertain).first_order,
                               found.first_order)
    softer = DirectSimulator(replace(ROD, bending_stiffness=0.014))
    with pytest.raises(InvalidTask, match='the one for which the plan was made'):
        robustness(softer, some, uncertain)


def test_room_is_that_of_the_part_in_front(held):
    front = front_of(held, Surface.of(ROD))
    own = InverseSimulator(DirectSimulator(replace(ROD, length=0.35))).thread(HOLE)
    np.testing.assert_allclose(front.clearances, own.clearances, atol=1e-9)
    assert [passes[0][1] for passes in front.via_points] == pytest.approx(
        [passes[0][1] for passes in own.via_points])
    with pytest.raises(InvalidTask, match='holds in one place inside'):
        front_of(own, Surface.of(ROD))


def test_what_does_not_know_of_it_refuses_it_by_name(held):
    observer = Observer(DIRECT, Uncertainty(0.05))
    for asked in (lambda: observer.begin().miss(held), lambda: correct(observer.begin(), held)):
        with pytest.raises(InvalidTask, match='plan: expected shapes of the .*DLO that is estimat'):
            asked()
    with pytest.raises(InvalidTask, match='of a DLO that is held at its beginning'):
        Replanner.of(held, INVERSE)
    with pytest.raises(InvalidTask, match='of a DLO grasped inside each of Shape.parts vibrates'):
        held.shapes[0].modes()


BORE = CutOut(HOLE.pose, radius=2.5e-3)
LOADED = replace(ROD, tip_mass=2e-3, point_masses=((0.3, 1e-3), (0.9, 1e-3)))


@pytest.fixture(scope='module', params=['plain', 'with masses'])
def inserted(request):
    """Return the whole DLO, its insertion held inside, and that of a DLO as long as its front."""
    rod = ROD if request.param == 'plain' else LOADED
    front = replace(rod, length=0.35,
                    point_masses=((0.25, 1e-3),) if rod is LOADED else ())
    whole = InverseSimulator(DirectSimulator(rod))
    return whole, whole.insert(BORE, hold_at=AT), InverseSimulator(
        DirectSimulator(front)).insert(BORE)


def test_a_wire_that_cannot_be_inserted_from_its_end_is_where_it_is_held_inside(inserted):
    whole, plan, own = inserted
    with pytest.raises(Infeasible, match='would not stay'):
        whole.insert(BORE)
    assert len(plan) == len(own) and plan.stability.min() > 0.3
    np.testing.assert_array_equal(plan.depths, own.depths)
    np.testing.assert_allclose(plan.times, own.times, rtol=1e-12)
    tail = DirectSimulator(replace(whole.simulator.rod, length=0.65, tip_mass=0.0, point_masses=(
        (0.35, 1e-3),) if whole.simulator.rod.point_masses else ()))
    for depth, one, other in zip(plan.depths, plan.shapes, own.shapes, strict=True):
        # what is outside: all behind the gripper, and the front up to the entrance
        assert one.s[-1] == one.rod.length == pytest.approx(1.0 - depth, abs=1e-12)
        assert grasped_at(one) == AT and (depth == 0 or one.far_end is not None)
        np.testing.assert_allclose(one.positions[-1], BORE.center, atol=1e-9)
        np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.far_wrench, other.far_wrench, atol=1e-9)
        behind = tail.solve(Pose.from_rotation(
            one.gripper.position, one.gripper.rotation @ np.diag([-1.0, 1.0, -1.0])))
        np.testing.assert_allclose(one.positions_at(AT - behind.s), behind.positions, atol=1e-6)
        # the gripper bears what hangs on both sides of it, up to the entrance
        masses = sum(mass for s, mass in one.rod.point_masses) + one.rod.tip_mass
        weight = (0.045 * (1.0 - depth) + masses) * 9.81
        assert one.gripper_wrench[2] + one.far_wrench[2] == pytest.approx(weight, rel=1e-6)


def test_an_insertion_held_inside_is_replayed_as_planned(inserted):
    whole, plan, _ = inserted
    for simulator in (whole.simulator, GraspedInside(whole.simulator.rod, AT)):
        report = replay(simulator, plan)
        assert report.converged and report.deviation < 1e-6 and report.position_error < 1e-6
        assert report.clearance == pytest.approx(plan.clearance.min(), abs=1e-6)
    softer = replace(whole.simulator.rod, bending_stiffness=0.5 * 0.0147)
    assert replay(DirectSimulator(softer), plan).deviation > 1e-3
    assert np.isnan(plan.margin[1:]).all()


def test_the_part_behind_is_in_the_way_of_an_insertion_too():
    plan = INVERSE.insert(BORE, hold_at=AT)
    ball = Sphere(plan.shapes[20].positions[20], 0.05)
    with pytest.raises(Infeasible, match='Sphere 0.*kept to depth') as refused:
        InverseSimulator(DirectSimulator(ROD, obstacles=[ball])).insert(BORE, hold_at=AT)
    assert refused.value.constraint == 'clearance' and 5 < refused.value.waypoint <= 20
    shape = refused.value.plan.shapes[-1]
    assert shape.s[-1] == pytest.approx(1.0 - refused.value.plan.depths[-1])


def test_what_an_insertion_held_inside_is_not_is_named():
    plan = INVERSE.insert(BORE, hold_at=AT, depths=(0, 0.05, 0.1))
    assert plan == INVERSE.plan(Insert.from_dict(Insert(BORE, (0, 0.05, 0.1), None, AT).to_dict()))
    assert Insert(BORE, hold_at=0) == Insert(BORE)
    with pytest.raises(InvalidTask, match='held at 0.65 m it goes into a bore'):
        Trajectory(plan)
    with pytest.raises(InvalidTask, match='hold_at = 0.65: expected none for an insertion'):
        LoopTask(INVERSE, Insert(BORE, hold_at=AT), 0.02)
    with pytest.raises(InvalidTask, match=r'depths\[1\] = 0.348: expected at most 0.99 of the len'):
        INVERSE.insert(BORE, hold_at=AT, depths=(0, 0.348))
    with pytest.raises(InvalidTask, match='hold_at = 1.0: expected .* < 1 m'):
        INVERSE.insert(BORE, hold_at=1.0)
    assert Trajectory(plan, tolerance=np.inf).duration > 0
