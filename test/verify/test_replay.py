# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Clearance and report of a plan, against brute force."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Trajectory,
    Workspace,
    replay,
)
from dlo_planner.errors import DeadlineExceeded
from dlo_planner.plan.clearance import clearance
from dlo_planner.trajectory.modal_response import slowest_period

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))
DIRECT = DirectSimulator(WIRE)
ROUND = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)


@pytest.fixture(scope='module')
def plan():
    return InverseSimulator(DIRECT).thread(ROUND, depths=np.linspace(0, 0.9, 40))


@pytest.fixture(scope='module')
def proved(plan):
    """Return a report in which nothing is left out, and what was told of its progress."""
    told = []
    report = replay(DIRECT, plan, limits=Limits(), workspace=Workspace((-3, -3, -3), (3, 3, 3)),
                    progress=lambda done, total: told.append((done, total)))
    return report, told


@pytest.fixture
def good(proved):
    return proved[0]


def brute(shape, outside):
    """Return the least of a function of (n, 3) points over the DLO, looked at closely."""
    return outside(shape.positions_at(np.linspace(0, shape.s[-1], 40_001))).min() - WIRE.radius


def test_clearance_in_a_round_hole(plan):
    def outside(points):
        across = np.maximum(ROUND.radius - np.hypot(points[:, 1], points[:, 2] - 1), 0)
        return np.hypot(across, points[:, 0])

    for index in (0, 13, 39):
        assert plan.clearance[index] == pytest.approx(brute(plan.shapes[index], outside), abs=1e-8)
    # aligned with the axis, the whole radius is left
    np.testing.assert_allclose(plan.clearance, ROUND.radius - WIRE.radius, rtol=1e-3)


def test_the_clearance_of_a_replay_is_that_of_obstacles_too(plan):
    middle, = plan.shapes[10].positions_at([0.5])
    ball = Sphere(middle - (0, 0, 0.013), 0.01)
    report = replay(DIRECT, plan, obstacles=[ball])
    assert report.clearance == pytest.approx(min(
        clearance([ball], WIRE.radius, shape) for shape in plan.shapes), abs=1e-6)
    assert report.clearance < 0.5 * plan.clearance.min()


def test_report_of_a_good_plan(plan, good):
    report = good
    assert report.converged
    assert report.position_error < 1e-6 and report.misalignment < 1e-6
    assert report.stability == pytest.approx(plan.stability.min(), abs=1e-3)
    assert report.clearance == pytest.approx(plan.clearance.min())
    assert report.contact_force == 0
    # the default tolerance: a quarter of the room at the rim
    assert report.tolerance == pytest.approx(0.25 * plan.clearance.min(), rel=1e-3)
    assert report.position_error < report.max_tracking_error <= report.tolerance
    assert report.departure <= report.tolerance and 0 < report.mode_margin <= 0.3
    assert report.safe and report.reason == '' and 'safe' in repr(report)


def test_the_trajectory_that_was_looked_at_is_the_one_to_be_executed(plan, good):
    report = good
    first, = DIRECT.track(plan.grippers[:1])  # what the replay begins with
    assert report.trajectory == Trajectory(plan, Limits(), simulator=DIRECT, initial=first)
    assert report.duration == report.trajectory.duration
    moved = report.trajectory.motion
    assert report.max_tracking_error == moved.position_error
    for name in ('clearance', 'contact_force'):
        assert getattr(report, f'dynamic_{name}') == getattr(moved, name)
    # one that was made before is looked at as it is
    again = replay(DIRECT, plan, trajectory=report.trajectory)
    assert again.trajectory is report.trajectory and again.safe


def test_a_plan_for_another_dlo_misses(plan):
    softer = DirectSimulator(Rod.circular(1.0, 1.4e-3, 8960.0, 110e9, 0.34))
    report = replay(softer, plan)
    assert report.position_error > 1e-2
    assert report.clearance < 0 < plan.clearance.min()  # its own shapes are looked at


def test_what_was_not_looked_at_is_nan_and_named(plan, good):
    unsized = InverseSimulator(DIRECT).thread(CutOut(ROUND.pose), depths=[0.0, 0.3])
    report = replay(DIRECT, unsized)
    assert set(report.not_looked_at) == {
        'clearance', 'max_tracking_error', 'swing', 'arrival', 'departure', 'dynamic_clearance',
        'dynamic_contact_force', 'duration', 'step', 'workspace_margin', 'mode_margin',
        'bend_margin', 'dynamic_bend_margin'}
    assert all(np.isnan(getattr(report, name)) for name in report.not_looked_at)
    assert report.trajectory is None and not report.safe
    report = good
    assert report.not_looked_at == ('bend_margin', 'dynamic_bend_margin')  # there is no limit
    assert report.workspace_margin == pytest.approx(min(
        3 - np.abs(gripper.position).max() for gripper in plan.grippers))
    assert 0 < report.max_tracking_error < report.swing < 2e-2
    assert 0 <= report.arrival <= report.swing and 0 < report.departure <= report.swing
    assert 0 < report.dynamic_clearance < report.clearance
    assert report.step <= slowest_period(WIRE) / 25


@pytest.fixture(scope='module')
def way(plan):
    return InverseSimulator(DIRECT).approach(ROUND, plan, Pose((-1.3, 0.2, 1.1), (0, 0, 0, 1)),
                                             standoff=0.05)


def test_a_start_phase_in_motion_is_judged_by_swing_and_clearance(way):
    sheet = Sheet.around(ROUND)
    report = replay(DIRECT, way, obstacles=[sheet],
                    trajectory=Trajectory(way, tolerance=np.inf))
    assert report.converged
    assert np.isnan([report.position_error, report.misalignment, report.max_tracking_error]).all()
    assert set(report.not_looked_at) == {'position_error', 'misalignment', 'max_tracking_error',
                                         'arrival', 'bend_margin', 'dynamic_bend_margin',
                                         'workspace_margin', 'mode_margin'}
    assert 0.01 < report.swing < 0.5  # it swings by centimeters, whatever it passes
    assert report.dynamic_clearance < report.clearance
    calm = replay(DIRECT, way, limits=Limits(), obstacles=[sheet])
    assert calm.safe and calm.departure <= calm.tolerance
    assert calm.swing < 0.5 * report.swing


def test_every_reason_not_to_execute(plan, way, good, monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 2)  # else it takes long
    quick = Trajectory(plan, Limits(2.0, 10.0, 20.0, 100.0, np.inf, np.inf), tolerance=np.inf)
    softer = DirectSimulator(Rod.circular(1.0, 1.2e-3, 8960.0, 110e9, 0.34))
    narrow = Workspace((-3, -3, -3), (3, 3, 0.9))
    ball = Sphere(plan.shapes[-1].positions[-1], 0.02)  # where the free end comes to
    calm = good.trajectory
    for report, said in (
            (replay(DIRECT, plan), 'not looked at in motion'),
            (replay(softer, plan, trajectory=calm), 'does not follow the poses'),
            (replay(DIRECT, plan, trajectory=calm, workspace=narrow), 'beyond its workspace'),
            (replay(DIRECT, plan, trajectory=quick), 'in the sheet'),
            (replay(DIRECT, way, trajectory=Trajectory(way, Limits(0.02, 0.1), tolerance=np.inf)),
             'has no tolerance'),
            (replay(DIRECT, plan, limits=Limits(), obstacles=[ball]), 'however slow it is')):
        assert not report.safe and said in report.reason and said in repr(report)
        assert report.reason[-1] not in '.:'
    # the figures of what cannot be made calm are those of the motion within limits alone
    assert report.trajectory == Trajectory(plan, tolerance=np.inf)
    assert report.dynamic_clearance < 0


def test_a_motion_that_touches_or_fails_is_not_safe(plan, good):
    calm = good.trajectory
    for change, said in (({'contact_force': 0.2}, 'touches something, with 0.2 N'),
                         ({'position_error': 0.009}, 'misses by 0.009 m'),
                         ({'clearance': -0.001}, '0.001 m in the sheet'),
                         ({'bend_margin': -0.1}, 'bent by 0.1 1/m more'),
                         ({'contact_lost': 0.1}, 'loses a contact that the plan keeps, 10.00%'),
                         ({'converged': False}, 'could not be simulated')):
        other = pickle.loads(pickle.dumps(calm))
        object.__setattr__(other, 'motion', replace(calm.motion, **change))
        report = replay(DIRECT, plan, trajectory=other)
        assert not report.safe and said in report.reason
    assert replay(DIRECT, plan, trajectory=calm).safe


def test_a_dlo_that_falls_into_a_planned_shape_does_not_follow(plan, monkeypatch):
    track = DirectSimulator.track
    monkeypatch.setattr(DirectSimulator, 'track', lambda *given, **held: [
        replace(shape, jumped=k == 3) for k, shape in enumerate(track(*given, **held))])
    report = replay(DIRECT, plan)
    assert report.deviation < 1e-6 and not report.converged


BAR = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
TOUCHING = DirectSimulator(WIRE, obstacles=[BAR])


def test_a_contact_plan_begins_in_its_own_first_shape():
    weight = WIRE.mass_per_length * 9.81
    held = InverseSimulator(TOUCHING).hold_contact(
        Pose((0.5, 0, 0.72), (0, 0, 0, 1)), 0.6, forces=[1.7 * weight])
    # set down there in its natural shape it would come to lie below the bar
    assert not TOUCHING.solve(held.grippers[0]).contacts
    report = replay(TOUCHING, held)
    assert report.converged and report.position_error < 1e-4 and report.deviation < 1e-4
    assert report.contact_force > 0
    # set down below the bar, it is somewhere else, and where no bar is too
    for simulator, initial in ((TOUCHING, TOUCHING.solve(Pose(
            held.grippers[0].position - (0, 0, 1), held.grippers[0].quaternion))),
            (DIRECT, None)):
        other = replay(simulator, held, initial=initial)
        assert other.deviation > 0.1 and not other.converged


@pytest.fixture(scope='module')
def slide():
    """Return a simulator of a wire with a bend limit over a bar, and a plan that slides along."""
    wire = replace(WIRE, max_bend_curvature=8.0)
    over = DirectSimulator(wire, basis='local', n_elements=24, obstacles=[BAR])
    return over, InverseSimulator(over).slide_contact(
        Pose((0.5, 0, 0.72), (0, 0, 0, 1)), [0.7, 0.65, 0.6])


def test_a_contact_that_is_lost_in_motion_is_not_safe(slide):
    over, _ = slide
    plan = InverseSimulator(over).slide_contact(
        Pose((0.5, 0, 0.72), (0, 0, 0, 1)), [0.7, 0.65, 0.6], condition='least_force',
        min_force=0.0)
    hasty = Trajectory(plan, tolerance=np.inf)
    report = replay(over, plan, trajectory=hasty)
    times = np.linspace(0, hasty.duration, 101)  # the same, looked at by itself
    motion = over.simulate(hasty.at(times)[0], times[1], plan.shapes[0])
    parted = np.mean([not shape.contacts for shape in motion.shapes[1:]])
    assert 0.1 < parted < 1  # while it swings on afterwards as well
    assert 0.1 < report.contact_lost < 1 and 'loses a contact' in report.reason
    assert report.dynamic_bend_margin < report.bend_margin < 8.0


def test_a_range_of_friction_is_validated_where_it_is_stated(slide, monkeypatch):
    over, plan = slide
    report = replay(over, plan, limits=Limits())
    assert not report.safe and 'no friction is stated' in report.reason
    assert np.isnan([report.contact_lost, report.largest_friction]).all()
    assert {'contact_lost', 'largest_friction'} <= set(report.not_looked_at)
    # that of the obstacle is a statement
    rough = replay(over.with_friction(0.2), plan, trajectory=report.trajectory)
    assert rough.safe and rough.contact_lost == 0 and np.isnan(rough.largest_friction)
    report = replay(over, plan, trajectory=report.trajectory, friction=0.3)
    assert report.safe and report.largest_friction == 0.3 and report.contact_lost == 0
    assert 'largest_friction' not in report.not_looked_at
    # glued to the bar, the wire does not follow
    stuck = replay(over, plan, trajectory=report.trajectory, friction=50.0)
    assert not stuck.safe and stuck.largest_friction == 50.0
    with pytest.raises(InvalidTask, match='friction = -1'):
        replay(over, plan, friction=-1.0)
    # both ends count: where it falls without friction alone, the range is not safe
    track = DirectSimulator.track
    monkeypatch.setattr(DirectSimulator, 'track', lambda self, *given, **held: [
        replace(shape, jumped=any(one.friction == 0 for one in self.obstacles))
        for shape in track(self, *given, **held)])
    fallen = replay(over.with_friction(0.2), plan, trajectory=report.trajectory, friction=0.3)
    assert not fallen.safe and not fallen.converged


def test_the_deviation_is_that_of_the_shapes(plan):
    assert replay(DIRECT, plan).deviation < 1e-9
    fine = replay(DirectSimulator(WIRE, accuracy=1e-6), plan)
    assert 1e-7 < fine.deviation < 1e-3 and fine.converged
    softer = DirectSimulator(Rod.circular(1.0, 1.2e-3, 8960.0, 110e9, 0.34))
    apart = replay(softer, plan)
    shapes = softer.track(plan.grippers)
    assert apart.deviation == pytest.approx(max(
        np.linalg.norm(one.positions - other.positions, axis=1).max()
        for one, other in zip(shapes, plan.shapes, strict=True)))
    assert not apart.converged


def test_a_center_that_is_reached_on_the_way_counts_from_there_on():
    first, second = (CutOut(Pose.looking_along((x, 0, 1 - 0.1 * x), (1, 0, 0)), radius=0.02)
                     for x in (0.0, 0.3))
    plan = InverseSimulator(DIRECT).thread_two(first, second, depths=np.linspace(0, 0.6, 13))
    numbers = [len(passes) for passes in plan.via_points]
    assert 1 in numbers and 2 in numbers
    slow = Trajectory(plan, Limits(0.01, 0.05), tolerance=np.inf)
    crawling = replay(DIRECT, plan, trajectory=slow)
    # slow as it is, it is what the coarse waypoints leave: no way of the free end to the center
    assert 1e-6 < crawling.max_tracking_error < 5e-3


def test_progress_and_deadline(plan, proved):
    _, told = proved
    assert (40, 40) in told and max(total for _, total in told) > 150
    with pytest.raises(DeadlineExceeded):
        replay(DIRECT, plan, limits=Limits(0.002), deadline=0.2)


def test_nonsense_is_named(plan):
    for more, named in (({'tolerance': 1e-3}, 'expected limits'),
                        ({'limits': Limits(1e-5)}, 'limits: the motion takes .* 20000 steps')):
        with pytest.raises(InvalidTask, match=named):
            replay(DIRECT, plan, **more)
