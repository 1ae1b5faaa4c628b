# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions that arrive calm, and how they are found."""

import json
import pickle
from dataclasses import replace
from itertools import pairwise
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest
from calm_cases import RODS, calm, cell, tasks

from dlo_planner import (
    Capsule,
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Limits,
    Plane,
    Pose,
    Rod,
    Sphere,
    Trajectory,
    replay,
)
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import PER_WAYPOINT, PlanStatus, truncate
from dlo_planner.progress import Progress
from dlo_planner.results import ValidationReport
from dlo_planner.trajectory import calm_search, shaping
from dlo_planner.trajectory.calm_search import CalmSearch, holes_passed
from dlo_planner.trajectory.dynamic_check import goals_between, in_motion, worst_miss
from dlo_planner.trajectory.modal_response import Case, Response, slowest_period
from dlo_planner.trajectory.shaping import LegTask, calm_law, compensated, margin, predicted
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.timed_path import TimedPath, smoothed
from dlo_planner.trajectory.topp import fastest_rates
from dlo_planner.trajectory.trajectory import _tolerance

# m and s at most; motions are verified with a damping ratio of 1 % and with none
PROMISED = {'wire': (1e-3, 24.0), 'hose': (1.2e-3, 15.5), 'leaf spring': (1e-3, 26.0)}


def missed(name, rod, trajectory):
    """Return (n,): how far a Rod misses in a motion, m."""
    _, plan = cell(name)
    direct = DirectSimulator(rod)
    first = direct.solve(plan.grippers[0], plan.shapes[0])
    times = np.arange(0, trajectory.duration, slowest_period(rod) / 25)
    grippers, done = trajectory.at(times)[0], trajectory.progress(times)
    motion = direct.simulate(grippers, times[1], first)
    assert motion.converged
    last = np.clip(np.searchsorted(plan.times, done, side='right') - 1, 0, len(plan) - 2)
    return np.array([worst_miss(shape, goals_between(plan, k))
                     for k, shape in zip(last, motion.shapes, strict=True)])


@pytest.mark.sweep
@pytest.mark.parametrize('name', list(PROMISED))
def test_from_a_start_pose_of_its_own_it_threads_calmly(name):
    miss, seconds = PROMISED[name]
    trajectory = calm(name)
    assert trajectory.duration <= seconds
    assert trajectory.motion.position_error <= miss and trajectory.motion.departure <= miss
    for ratio in (0.0, 0.01):  # and each by itself, not as the search saw it
        rod = replace(RODS[name], damping=(ratio / 0.01 * RODS[name].damping[0], 0.0))
        assert missed(name, rod, trajectory).max() <= miss


def added(name, rod, trajectory):
    """Return (n,) by how much motion moves a Rod aside where it passes the center, m.

    From where it would hang on the same way. The shift of the gripper belongs to the motion: who
    goes slowly does without.
    """
    _, plan = cell(name)
    direct = DirectSimulator(rod)
    first = direct.solve(plan.grippers[0], plan.shapes[0])
    times = np.arange(0, trajectory.duration, slowest_period(rod) / 25)
    motion = direct.simulate(trajectory.at(times)[0], times[1], first)
    assert motion.converged
    plain = TimedPath(trajectory.path, tuple(replace(law, shift=None) for law in trajectory.laws),
                      trajectory.limits)
    hanging = direct.track(plain.at(times)[0], initial=first)
    passing = holes_passed(plan, trajectory.progress(times))[0]
    out = []
    for s, moved, calm_one in zip(passing, motion.shapes, hanging, strict=True):
        if np.isfinite(s):
            away = (moved.positions_at([s]) - calm_one.positions_at([s]))[0]
            along = calm_one.frame_at(s)[0][:, 0]
            out.append(np.linalg.norm(away - (away @ along) * along))
    return np.array(out)


@pytest.mark.sweep
@pytest.mark.parametrize('factor', [0.9, 1.1])
@pytest.mark.parametrize('name', list(PROMISED))
def test_a_stiffness_wrong_by_a_tenth_at_most_doubles_the_miss(name, factor):
    trajectory, rod = calm(name), RODS[name]
    wrong = replace(rod, torsional_stiffness=factor * rod.torsional_stiffness,
                    bending_stiffness=tuple(factor * stiffness for stiffness in rod.stiffness[1:]))
    # what its own shapes at rest miss by is no matter of calm
    assert added(name, wrong, trajectory).max() <= 2 * PROMISED[name][0]


@pytest.mark.sweep
def test_a_law_is_judged_with_what_the_leg_before_leaves():
    way, through = tasks('hose')[-2:]
    law = calm_law(through, 1.2e-3)
    quick = calm_law(way, 2e-2)
    begins = through.taken_over(way, way.after(quick, way.rest))
    assert predicted(through, law, begins) > 3 * predicted(through, law)
    # a law that knows of it is calm all the same
    helped = calm_law(through, 1.2e-3, begins)
    assert predicted(through, helped, begins) <= 1.2e-3


def test_a_dlo_of_another_stiffness_is_known_by_its_own_modes():
    for task in tasks('hose'):
        soft, stiff = task.wrong
        assert (soft.rates[:, 0] < task.response.rates[:, 0]).all()
        assert (stiff.rates[:, 0] > task.response.rates[:, 0]).all()
        # it hangs otherwise: the same way excites it otherwise
        assert np.abs(soft.bends - task.response.bends).max() > 0.05 * np.abs(soft.bends).max()


@pytest.mark.every(3)
@pytest.mark.parametrize('name', list(PROMISED))
def test_limits_are_kept(name):
    trajectory = calm(name)
    times = np.linspace(0, trajectory.duration, 20_001)
    _, velocities, accelerations = trajectory.at(times)
    jerks = np.diff(accelerations, axis=0) / times[1]
    limits = trajectory.limits.sizes
    for rates, most in zip((velocities, accelerations, jerks), limits, strict=True):
        sizes = np.linalg.norm(rates.reshape(-1, 2, 3), axis=2).max(axis=0)
        assert (sizes <= most * (1 + 1e-9)).all()


@pytest.mark.sweep
def test_it_is_continuous_with_its_shift():
    trajectory = calm('wire')
    assert any(law.shift is not None for law in trajectory.laws)
    times, step = np.linspace(0.01, trajectory.duration - 0.01, 997), 1e-4
    positions = [np.array([pose.position for pose in trajectory.at(times + h)[0]])
                 for h in (-step, step)]
    _, velocities, accelerations = trajectory.at(times)
    np.testing.assert_allclose((positions[1] - positions[0]) / (2 * step), velocities[:, :3],
                               atol=1e-5)
    rates = [trajectory.at(times + h)[1] for h in (-step, step)]
    np.testing.assert_allclose((rates[1] - rates[0]) / (2 * step), accelerations, atol=2e-3)
    for rest in trajectory.at([0.0, trajectory.duration])[1:]:
        np.testing.assert_allclose(rest, 0, atol=1e-9)


@pytest.mark.sweep
def test_the_margin_is_where_the_prediction_doubles():
    task = tasks('wire')[-1]
    law = calm_law(task, 1e-3)
    assert predicted(task, law) <= 1e-3
    allowed = 2e-3
    part = margin(task, law, allowed)
    assert 0.05 <= part <= 0.3
    assert margin(task, law, 0.0) == 0.0 <= margin(task, law, 1e-3) <= part
    assert margin(task, law, 1.0) == pytest.approx(0.3)
    # a DLO without windows of its periods is not calm
    quick = replace(law, windows=np.array([0.1]), shift=None)
    assert predicted(task, quick) > 5e-3


@pytest.mark.parametrize('wide', [0.9, 1.1])  # frequencies above or below the windows' hurt more
def test_frequencies_may_be_off_both_ways(wide):
    def off_by(factor):
        case = Case(task.response.faster(factor), task.passed, task.last)
        return case.deviation(law, case.response.rest)[0]

    task = tasks('wire')[-1]
    for case, factor in zip(task.cases, (1.0, 0.95, 1.05), strict=False):
        np.testing.assert_allclose(case.response.rates, factor * task.response.rates)
    task = LegTask(task.leg, task.response, task.limits, task.holes, task.last)
    u, rates = fastest_rates(task.leg, task.limits)
    law = TimeLaw(u, rates / 2, wide * 2 * np.pi / task.response.rates[-1, :2])
    as_they_are, low, high = (off_by(factor) for factor in (1.0, 0.95, 1.05))
    assert predicted(task, law) == max(as_they_are, 0.5 * low, 0.5 * high)
    for allowed in (1.05 * as_they_are, 1.5 * as_they_are):
        part = margin(task, law, allowed)
        assert part < 0.3
        beyond = [off_by(1 + sign * (part + 0.01)) for sign in (1, -1)]
        assert max(off_by(1 + part), off_by(1 - part)) <= allowed
        assert max(beyond) > allowed


def test_a_center_is_passed_from_its_first_waypoint_to_its_last():
    one, other = (np.array([x, 0.0, 0.0]) for x in (0.0, 1.0))
    plan = SimpleNamespace(times=np.arange(4.0), via_points=(
        (), ((one, 1.0, None),), ((one, 0.8, None), (other, 1.0, None)), ((other, 0.7, None),)))
    np.testing.assert_allclose(holes_passed(plan, np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0])), [
        [np.nan, 1.0, 0.9, 0.8, np.nan, np.nan], [np.nan, np.nan, np.nan, 1.0, 0.85, 0.7]])


def test_what_counts_is_what_passes_a_center_or_all_of_the_dlo():
    way, through = tasks('wire')
    assert not way.passed and through.passed and through.last and not way.last
    np.testing.assert_array_equal(way.sizes, way.response.sizes)
    assert (through.sizes <= through.response.sizes * (1 + 1e-9)).all()
    # at the end of the first leg only a part of the tolerance may be left of a vibration
    law = calm_law(way, 1e-3)
    alone = LegTask(way.leg, way.response, way.limits, way.holes, True, way.wrong)
    assert predicted(way, law) == pytest.approx(2 * predicted(alone, law))


ROD = Rod(0.3, 0.05, 5e-3, 4e-3, radius=2e-3)
DIRECT = DirectSimulator(ROD)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)


@pytest.fixture(scope='module')
def plan():
    """Return a quick plan of a short rod, which needs few steps."""
    return InverseSimulator(DIRECT).thread(HOLE, depths=np.linspace(0, 0.25, 8))


@pytest.fixture(scope='module')
def fine():
    """Return the same with so many waypoints that it hardly misses between them."""
    return InverseSimulator(DIRECT).thread(HOLE, depths=np.linspace(0, 0.25, 30))


def test_the_default_tolerance_is_a_quarter_of_the_room(plan):
    way = Trajectory(plan)
    assert way.tolerance == pytest.approx(0.25 * plan.clearances[:, :, 0].min())
    assert way.motion.position_error <= way.tolerance and way.mode_margin > 0
    free = InverseSimulator(DIRECT).thread(CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0))),
                                           depths=[0.0, 0.1])
    assert Trajectory(free).tolerance == 1e-3
    endless = Trajectory(plan, tolerance=np.inf)
    assert endless.motion is None and np.isnan(endless.mode_margin)
    assert endless.duration <= way.duration and np.isnan(endless.slowest_period)


def test_a_trajectory_says_why_it_takes_so_long(plan, tmp_path):
    way = Trajectory(plan)
    assert way.least_duration == Trajectory(plan, tolerance=np.inf).duration < way.duration
    slowest = max(shape.modes(1).periods[0] for shape in plan.shapes)
    assert way.slowest_period == pytest.approx(slowest, rel=0.02)
    assert 'slowest vibration on the way' in way.summary()
    saved = tmp_path / 'way.json'
    way.save(saved)
    assert Trajectory.load(saved) == way
    older = json.loads(saved.read_text())  # files that were written before do not say it
    del older['least_duration'], older['slowest_period']
    saved.write_text(json.dumps(older))
    loaded = Trajectory.load(saved)
    assert loaded.duration == way.duration and np.isnan(loaded.least_duration)


def test_the_quickest_law_is_found_before_slower_ones_are_judged(monkeypatch):
    task = tasks('wire')[0]
    first = next(iter(task.laws()))
    calmest = min(predicted(task, law) for law in first)
    judged = []
    real = shaping.predicted
    monkeypatch.setattr(shaping, 'predicted', lambda *rest: judged.append(rest[1]) or real(*rest))
    law = calm_law(task, 1.5 * calmest)  # not calm by far: else no slower set would be made at all
    assert {id(one) for one in judged[:len(first)]} == {id(one) for one in first}
    assert len(judged) <= 2 * len(first)  # each once more at most, as it is kept
    assert law.duration <= 1.01 * max(one.duration for one in first)


def test_laws_that_are_no_motion_any_more_are_not_tried():
    task = tasks('wire')[0]
    # hardly a deviation at any speed, so a bound that is a part of it asks for a million seconds
    still = replace(task, response=replace(task.response, bends=1e-14 * task.response.bends))
    laws = list(still.laws())
    assert max(one.duration for some in laws for one in some) < 20 * laws[0][0].duration


def test_of_several_holes_the_narrowest_one_gives_the_tolerance():
    rooms = np.array([[[0.02], [np.inf]], [[0.03], [0.004]], [[0.05], [-0.001]]])
    assert _tolerance(None, SimpleNamespace(clearances=rooms)) == pytest.approx(0.25 * 0.004)


def test_what_cannot_be_calm_is_refused_with_the_figure_that_fails(fine, monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)  # else it takes long
    with pytest.raises(Infeasible, match='the DLO does not come to rest: .* in motion') as caught:
        Trajectory(fine, tolerance=2e-5)
    error = caught.value
    assert error.constraint in ('miss', 'departure', 'clearance')
    assert error.amount > 0 and error.plan is fine


def test_what_no_speed_keeps_between_coarse_waypoints_is_refused_before_a_law(monkeypatch):
    monkeypatch.setattr(CalmSearch, '_timed', None)
    way = InverseSimulator(DIRECT).thread(HOLE, depths=np.linspace(0, 0.2, 4))
    with pytest.raises(Infeasible, match='however slow it is, between the waypoints') as caught:
        Trajectory(way, tolerance=1e-5)
    path = Trajectory(way, tolerance=np.inf)
    slow = DIRECT.track(path.poses(np.linspace(0, path.duration, 300)))
    passing = [shape for shape in slow if (shape.positions[-1] - HOLE.center) @ HOLE.normal > 0]
    strays = max(np.linalg.norm(shape.positions_at(np.linspace(0, ROD.length, 4000)) - HOLE.center,
                                axis=1).min() for shape in passing)
    assert (caught.value.constraint, caught.value.unit) == ('miss', 'm')
    assert caught.value.amount == pytest.approx(strays, rel=0.05)


@pytest.mark.parametrize(('damping', 'calm'), [((10.0, 0.1), True), ((80.0, 1.0), False)])
def test_a_dlo_that_creeps_to_rest_is_answered_for_or_refused_after_few_laws(
        damping, calm, monkeypatch):
    # the damping ratio of its slowest vibration is some 2, and 10: modes do not tell how far it
    # lags behind
    laws, timed = [], CalmSearch._timed
    monkeypatch.setattr(CalmSearch, '_timed', lambda *given: laws.append(0) or timed(*given))
    way = InverseSimulator(DirectSimulator(replace(damped_wire(), damping=damping))).thread(
        HOLE, depths=np.linspace(0, 0.2, 4))
    try:
        motion = Trajectory(way).motion
        assert calm and motion.position_error < 0.25 * HOLE.radius
    except Infeasible as refused:
        assert not calm and 'it lags behind: the damping ratio' in str(refused)
    assert len(laws) <= 3


def test_a_dlo_that_stands_nowhere_is_refused_before_a_law_is_made(plan, monkeypatch):
    monkeypatch.setattr(CalmSearch, '_timed', None)
    monkeypatch.setattr(CalmSearch, '_strays', 0.0)  # that alone would be reason enough
    yielding = DIRECT.with_rod(replace(ROD, yield_curvature=0.1))
    with pytest.raises(Infeasible, match='where the motion begins, .* plastic hinge') as caught:
        Trajectory(plan, simulator=yielding)
    assert caught.value.constraint == 'motion'


def test_progress(plan):
    seen = []
    Trajectory(plan, progress=lambda done, total: seen.append((done, total)))
    assert seen and all(0 < done <= total for done, total in seen)


def test_an_obstacle_that_is_only_met_in_motion_refuses(plan, monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 2)
    way = Trajectory(plan, obstacles=[Sphere((0, 0, 5), 0.1)])
    assert 0 < way.motion.clearance < 0.01  # the rim is nearer than the ball
    inside = Sphere(plan.shapes[3].positions[-20], 0.02)
    with pytest.raises(Infeasible) as caught:
        Trajectory(plan, obstacles=[inside])
    assert caught.value.constraint == 'clearance'


def test_what_only_a_shift_brings_into_the_way_is_not_said_of_every_speed(monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)
    way = InverseSimulator(DirectSimulator(damped_wire())).thread(
        HOLE, depths=np.linspace(0, 0.5, 30))
    low = min(shape.positions[:, 2].min() for shape in way.shapes) - 0.75e-3
    for gap, slow in ((1e-4, False), (-1e-3, True)):
        with pytest.raises(Infeasible, match='limits: ') as caught:
            Trajectory(way, tolerance=2e-4, obstacles=[Plane((0, 0, low - gap), (0, 0, 1))])
        assert ('however slow it is' in str(caught.value)) == slow
        assert caught.value.constraint == 'clearance'
    assert caught.value.amount == pytest.approx(1e-3)  # as deep as the plan is


def test_what_hangs_straight_down_and_goes_down_does_not_vibrate():
    down = CutOut(Pose.looking_along((0, 0, 0), (0, 0, -1)), radius=0.01)
    plumb = DirectSimulator(replace(damped_wire(), tip_mass=0.05))
    way = Trajectory(InverseSimulator(plumb).thread(down, depths=np.linspace(0, 0.5, 6)))
    assert way.motion.departure < 1e-12 and way.mode_margin == pytest.approx(0.3)


@pytest.mark.sweep
def test_the_least_duration_is_none_that_a_calm_motion_beats():
    inverse = InverseSimulator(DirectSimulator(replace(damped_wire(), length=0.5)))
    through = inverse.thread(HOLE, depths=[0.0, 0.1])
    start = Pose.looking_along(through.grippers[0].position - (0.4, 0, 0), (-1, 0, 0.1))
    way = Trajectory(inverse.approach(HOLE, through, start, standoff=0.05), tolerance=0.1)
    assert way.least_duration <= way.duration


@pytest.mark.sweep
def test_two_cutouts_are_passed_calmly():
    rod = damped_wire()
    first, second = (CutOut(Pose.looking_along((x, 0, 1 - 0.1 * x), (1, 0, 0)), radius=0.02)
                     for x in (0.0, 0.3))
    direct = DirectSimulator(rod)
    plan = InverseSimulator(direct).thread_two(first, second, depths=np.linspace(0, 0.6, 25))
    way = Trajectory(plan, tolerance=4e-3, simulator=direct)
    assert way.motion.position_error <= 4e-3 and way.motion.departure <= 4e-3
    fast = in_motion(direct, plan, Trajectory(plan, tolerance=np.inf), plan.shapes[0], (),
                     Progress(None, None))
    assert fast.position_error > 2 * way.motion.position_error


def damped_wire():
    return Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))


def test_a_plan_in_contact_with_friction_has_no_modes_and_is_slowed_down():
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02, friction=0.2)
    rod = damped_wire()
    direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=[bar])
    plan = InverseSimulator(direct).slide_contact(Pose((0.5, 0, 0.72), (0, 0, 0, 1)),
                                                  [0.6, 0.57, 0.54])
    way = Trajectory(plan, tolerance=5e-3, simulator=direct)
    assert np.isnan(way.mode_margin) and way.motion.converged
    assert way.motion.departure <= 5e-3 and way.motion.contact_force > 0


@pytest.mark.sweep
def test_a_contact_is_held_and_a_sequence_threaded_in_motion():
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
    over = InverseSimulator(DirectSimulator(damped_wire(), basis='local', n_elements=24,
                                            obstacles=[bar]))
    contact = Pose((0.5, 0, 0.72), (0, 0, 0, 1))
    for plan in (over.slide_contact(contact, [0.7, 0.65, 0.6]),
                 over.hold_contact(contact, 0.7, condition=None, forces=[0.2, 0.22])):
        # without a simulator it is the plan's own, with the bar that is touched
        way = Trajectory(plan)
        assert way.motion.position_error <= way.tolerance and way.motion.contact_force > 0.05
    holes = [CutOut(Pose.looking_along((x, 0, 1 - 0.3 * x * x), (1, 0, 0)), radius=0.02)
             for x in (0.0, 0.2, 0.4)]
    plan = InverseSimulator(DirectSimulator(damped_wire())).thread_sequence(
        holes, depths=np.linspace(0, 0.6, 13))
    way = Trajectory(plan)
    # three centers are not hit, even slowly: what the motion adds is what counts
    assert plan.position_error.max() > way.tolerance
    still = plan.position_error.max()
    assert still < way.motion.position_error <= still + way.tolerance


SHORT = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
LEAF = Rod.rectangular(0.8, 0.020, 0.0005, 7850.0, 206e9, 0.29)
# on the way there the leaf spring comes near to falling aside: 0.85 to 0.35 Hz
ASIDE = CutOut(Pose.looking_along((0, 0, 1), (0.3268, -0.8378, 0.4373)), radius=0.0136)
ABOVE = Pose.looking_along((-0.34008, 0.88092, 0.77364), (0.3813, -0.8164, 0.4337))


def approach(rod, hole, start, depth):
    inverse = InverseSimulator(DirectSimulator(rod))
    through = inverse.thread(hole, start=start, depths=[0, depth], max_misalignment=0)
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


def shaped(task, slower=1.0):
    """Return a law with windows of the two slowest modes at the end, and with its Shift."""
    u, rates = fastest_rates(task.leg, task.limits)
    windows = 2 * np.pi / task.response.rates[-1, :2]
    law = smoothed(task.leg, task.limits, u, rates / slower, windows)
    return law, replace(law, shift=compensated(task, law))


def left(task, law):
    """Return by how much the DLO still vibrates where the law ends, m."""
    place, speed = task.response.excited(law, task.response.rest)[2][:, -1]
    return float((task.response.sizes[-1] * np.hypot(place, speed)).sum())


@pytest.mark.parametrize('name', ['wire', 'hose', 'leaf spring'])
def test_the_miss_and_the_vibration_left_fall(name):
    task = tasks(name)[-1]
    plain, helped = shaped(task, 1.5)
    assert predicted(task, plain) > 3 * predicted(task, helped)
    assert left(task, plain) > 3 * left(task, helped)
    # the shift is small beside the deviation that it mends, some millimeters
    assert helped.shift.most[0] < 5 * predicted(task, plain)


def test_the_simulation_agrees():
    task = tasks('wire')[-1]
    direct, plan = cell('wire')
    first = int(np.searchsorted(plan.times, task.leg.knots[0]))
    part = replace(plan, stops=(), **{name: getattr(plan, name)[first:] for name in PER_WAYPOINT})
    path = GripperPath(part.times, (task.leg,))
    shape = direct.solve(part.grippers[0], part.shapes[0])
    laws = shaped(task, 0.7)
    found = [in_motion(direct, part, TimedPath(path, (law,), task.limits), shape, (),
                       Progress(None, None)) for law in laws]
    # coarser waypoints and a second mesh are in both
    assert found[0].position_error > 2 * found[1].position_error
    # the response is right to a part of the largest deviation
    for one, law in zip(found, laws, strict=True):
        known = task.cases[0].deviation(law, task.rest[0])[0]
        assert abs(one.position_error - known) < 0.1 * one.swing


def test_a_leg_shorter_than_a_spline_has_no_shift():
    task = tasks('wire')[-1]
    law, _ = shaped(task)
    quick = replace(law, rates=20 * law.rates, windows=np.array([0.01]))
    assert compensated(task, quick) is None


def test_a_leg_of_very_many_periods_has_no_shift():
    task = tasks('wire')[-1]
    law, helped = shaped(task)
    assert helped.shift is not None
    slow = law.slower(60 * 2 * np.pi / task.response.rates.min() / law.duration)
    assert compensated(task, slow) is None


def late(*_, **__):
    raise DeadlineExceeded('deadline = 1 s: not finished after 1 s', 1.0, 1.0)


@pytest.mark.sweep
def test_a_deadline_is_looked_at_often(plan, monkeypatch):
    looks, check = [], Progress.check

    def looked(self):
        looks.append(process_time())
        check(self)

    below = Sphere(plan.shapes[0].positions[-1] - (0, 0, 0.06), 0.05)
    amid = DirectSimulator(ROD, obstacles=[below])
    replay(amid, plan, limits=Limits())  # kernels and modules are there now
    monkeypatch.setattr(Progress, 'check', looked)
    begun = process_time()
    assert replay(amid, plan, limits=Limits()).safe
    seconds = process_time() - begun
    assert max(after - before for before, after in pairwise(
        [begun, *looks, process_time()])) < 0.1 * seconds + 0.1


@pytest.mark.sweep
def test_a_calm_motion_is_returned_though_not_all_is_known_of_it(plan, tmp_path, monkeypatch):
    whole = Trajectory(plan)
    assert whole.status == 'complete' and np.isfinite(whole.motion.error_estimate)
    assert Trajectory(plan, tolerance=np.inf).status == 'not simulated'
    with monkeypatch.context() as patched:
        patched.setattr(CalmSearch, '_margin', late)
        without_margin = Trajectory(plan)
        patched.setattr(calm_search, 'step_error', late)
        neither = Trajectory(plan)
        report = replay(DIRECT, plan, limits=Limits())
    for way, error in ((without_margin, whole.motion.error_estimate), (neither, np.inf)):
        assert 'the deadline came first' in way.status and np.isnan(way.mode_margin)
        assert way.duration == whole.duration and way.motion.error_estimate == error
        assert pickle.loads(pickle.dumps(way)).status == way.status
    assert report.safe and 'mode_margin' in report.not_looked_at
    report.save(tmp_path / 'report.npz')
    assert ValidationReport.load(tmp_path / 'report.npz').trajectory.status == neither.status


@pytest.mark.sweep
def test_a_deadline_before_a_calm_motion_says_what_was_reached(fine, monkeypatch):
    timed, rounds = CalmSearch._timed, []

    def once(self, *given):
        rounds.append(given)
        return timed(self, *given) if len(rounds) == 1 else late()

    with pytest.raises(DeadlineExceeded, match='not finished') as caught:
        Trajectory(fine, deadline=1e-3)
    assert caught.value.seconds == 1e-3
    monkeypatch.setattr(CalmSearch, '_timed', once)
    with pytest.raises(DeadlineExceeded, match='in motion, .* m at best, in .* s') as caught:
        Trajectory(fine, tolerance=2e-5)
    assert caught.value.elapsed == 1.0


def test_the_deadline_of_a_replay_is_said_as_it_was_given(fine):
    with pytest.raises(DeadlineExceeded, match=r'deadline = 0\.4 s: not finished') as caught:
        replay(DIRECT, fine, limits=Limits(), tolerance=2e-5, deadline=0.4)
    assert caught.value.seconds == 0.4


def test_a_refusal_is_an_answer_though_the_deadline_comes(fine, monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)
    monkeypatch.setattr('dlo_planner.verify.replay.in_motion', late)
    report = replay(DIRECT, fine, limits=Limits(), tolerance=2e-5)
    assert not report.safe and 'the DLO does not come to rest' in report.reason
    assert 'swing' in report.not_looked_at
    with pytest.raises(DeadlineExceeded):
        replay(DIRECT, fine, trajectory=Trajectory(fine, tolerance=np.inf))
