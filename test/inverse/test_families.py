# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Following a family of shapes without a leap: many at once, along a route, by even rolls."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod, Trajectory, replay
from dlo_planner.inverse import continuation
from dlo_planner.inverse.continuation import LONGEST_STEP, Aligned, Family, Passing
from dlo_planner.inverse.equilibria import Crossings, start_candidates
from dlo_planner.inverse.route import Route, find_route
from dlo_planner.inverse.tasks.thread import even_rolls
from dlo_planner.plan.continuity import largest_turn
from dlo_planner.plan.path import GripperPath

CUTOUT = CutOut(Pose.looking_along((0.1, -0.2, 0.3), (1.0, 0.4, 0.1)))
ROD = Rod(0.8, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
DEPTHS = 0.01 * np.array([1, 2, 3.5, 4, 6, 6, 5.5, 9, 12, 12.1, 15])


def followed(**options):
    """Return the condition and the first Passing."""
    simulator = DirectSimulator(ROD, **{'n_elements': 40, 'basis': 'local'} | options)
    aligned = Aligned(simulator, CUTOUT.normal)
    guess, reference, depth = next(start_candidates(simulator, CUTOUT.normal, None))
    return aligned, aligned.from_guess(guess, depth, reference)


def one_by_one(aligned, passing, depths=DEPTHS):
    found = []
    for depth in depths:
        passing = aligned.at(passing, depth, final=True)
        found.append(passing)
    return found


@pytest.mark.parametrize('options', [{}, {'basis': 'chebyshev', 'n_terms': 12}])
def test_they_are_those_found_one_by_one_bit_for_bit(options):
    aligned, first = followed(**options)
    many, few = aligned.onward(first, DEPTHS), one_by_one(aligned, first)
    assert len(many) == len(few) == len(DEPTHS)
    for one, other in zip(many, few, strict=True):
        for name in ('positions', 'frames', 'element_strains', 'gripper_wrench', 'energy',
                     'elastic_energy', 'residual', 'stability', 'iterations', 'converged',
                     'error_estimate'):
            assert np.array_equal(getattr(one.shape, name), getattr(other.shape, name)), name
        assert np.array_equal(one.gripper[0], other.gripper[0]) and one.depth == other.depth
        np.testing.assert_allclose(one.place, other.place, atol=1e-15)
        np.testing.assert_allclose(one.axes, other.axes, atol=1e-15)
        assert one.since.depth == other.since.depth
        assert not one.shape.positions.flags.writeable


def test_a_search_goes_on_from_where_another_one_ended():
    aligned, first = followed()
    begin = aligned.onward(first, DEPTHS[:4])
    rest = aligned.onward(begin[-1], DEPTHS[4:])
    for one, other in zip(begin + rest, one_by_one(aligned, first), strict=True):
        assert np.array_equal(one.shape.positions, other.shape.positions)


def test_a_long_step_is_left_to_others():
    aligned, first = followed()
    longest = LONGEST_STEP * ROD.length
    assert len(aligned.onward(first, np.array([0.01, 0.02, 0.02 + 1.01 * longest, 0.1]))) == 2
    assert len(aligned.onward(first, np.array([0.01, 0.02, 0.02 + 0.99 * longest]))) == 3
    assert aligned.onward(first, np.array([1.01 * longest])) == []
    assert aligned.onward(first, np.array([])) == []


@pytest.mark.parametrize('accuracy', [None, 9e-6])
def test_with_an_accuracy_they_end_where_another_mesh_is_needed(accuracy):
    heavy = Rod(0.8, 0.5, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
    simulator = DirectSimulator(heavy, accuracy=accuracy)  # None: its own
    aligned, depths = Aligned(simulator, CUTOUT.normal), np.linspace(0.01, 0.6, 30)
    guess, reference, depth = next(start_candidates(simulator, CUTOUT.normal, None))
    first = aligned.from_guess(guess, depth, reference)
    many, few = aligned.onward(first, depths), one_by_one(aligned, first, depths)
    mesh = first.shape.state.mesh
    other = [k for k, passing in enumerate(few) if passing.shape.state.mesh is not mesh]
    assert len(many) == (other[0] if other else len(depths))
    assert bool(other) == (accuracy is not None)  # both are looked at
    for one, another in zip(many, few, strict=False):
        assert one.shape.state.mesh is mesh
        assert np.array_equal(one.shape.positions, another.shape.positions)


def test_a_plan_is_the_same_whichever_way_its_shapes_are_found(monkeypatch):
    inverse = InverseSimulator(DirectSimulator(ROD, n_elements=32))
    calls = []
    follow = continuation.follow
    monkeypatch.setattr(continuation, 'follow',
                        lambda *given, **more: calls.append(0) or follow(*given, **more))
    depths = np.linspace(0, 0.7, 71)
    plan = inverse.thread(CUTOUT, depths=depths)
    assert 0 < len(calls) < 20
    monkeypatch.setattr(Aligned, 'onward', lambda *_: [])
    slow = inverse.thread(CUTOUT, depths=depths)
    for one, other in zip(plan.shapes, slow.shapes, strict=True):
        assert np.array_equal(one.positions, other.positions)
    assert np.array_equal(plan.times, slow.times)


TREND_CUTOUT = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0)))


@pytest.mark.parametrize('options', [{'basis': 'local', 'n_elements': 64}, {'n_elements': 64}, {}])
@pytest.mark.parametrize('bent', [(0.0, 0.0), (0.5, -0.8)])
def test_plans_are_the_same_with_fewer_steps(options, bent, monkeypatch):
    rod = Rod(1.0, 0.1, (0.3, 0.5), 0.4, natural_curvature=bent)
    inverse, depths = InverseSimulator(DirectSimulator(rod, **options)), np.linspace(0, 0.8, 41)
    ahead = inverse.thread(TREND_CUTOUT, depths=depths)
    monkeypatch.setattr(Passing, 'trend', lambda passing, depth: None)
    monkeypatch.setattr(Aligned, 'onward', lambda *_: [])  # it knows of trends by itself
    from_before = inverse.thread(TREND_CUTOUT, depths=depths)
    for one, other in zip(ahead.grippers, from_before.grippers, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-9)
    np.testing.assert_allclose(ahead.stability, from_before.stability, rtol=1e-3)
    steps = [sum(shape.iterations for shape in plan.shapes) for plan in (ahead, from_before)]
    assert steps[0] < steps[1]


@pytest.mark.parametrize('options', [{'n_elements': 48, 'basis': 'local'}, {}])
def test_two_cutouts_are_passed_alike_with_no_more_steps(options, monkeypatch):
    rod = Rod(1.0, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
    inverse = InverseSimulator(DirectSimulator(rod, **options))
    task = {'second': hole((0.3, 0.05, 0.95)), 'depths': np.linspace(0.35, 0.8, 31)}
    ahead = inverse.thread_two(hole((0.0, 0.0, 1.0)), **task)
    monkeypatch.setattr(Passing, 'trend', lambda passing, depth: None)
    from_before = inverse.thread_two(hole((0.0, 0.0, 1.0)), **task)
    for one, other in zip(ahead.grippers, from_before.grippers, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-8)
    np.testing.assert_allclose(ahead.position_errors, 0, atol=1e-9)
    np.testing.assert_allclose(ahead.stability, from_before.stability, rtol=1e-3)
    steps = [sum(shape.iterations for shape in plan.shapes) for plan in (ahead, from_before)]
    assert steps[0] <= steps[1]


def hole(center):
    return CutOut(Pose.looking_along(center, (1, 0, 0)))


AXIS = np.array([0.0, 0.0, 1.0])


def turned(angle):
    return Rotation.from_rotvec(angle * AXIS).as_matrix()


def passing(angle, place=(0.0, 0.0, 0.0), length=1.0):
    gripper = SimpleNamespace(rotation=turned(angle))
    return Passing(SimpleNamespace(gripper=gripper, s=np.array([0.0, length])), np.array(place))


class Turning(Family):
    """A task whose gripper is turned by a given function of the depth, and by its rolls."""

    def __init__(self, angle, length=1.0):
        self.angle, self.depths, self.rolled = angle, [], 0.0
        self.simulator = SimpleNamespace(rod=SimpleNamespace(length=length))

    def axis(self, shape):
        del shape
        return AXIS

    def at(self, before, depth, roll, final):
        del before, final
        self.depths.append(depth)
        angle = self.angle(depth)
        if angle is None:
            return None
        self.rolled += roll
        return passing(angle + self.rolled, length=self.simulator.rod.length)


@pytest.mark.parametrize('goal', [0.5, -0.5])
def test_smooth_ways_are_followed_to_their_end(goal):
    task = Turning(lambda depth: 4.0 * depth)
    here, depth, too_far, _ = task.follow(passing(0.0), 0.0, goal)
    assert depth == goal == task.depths[-1] and too_far == 0.0
    assert np.abs(np.diff([0.0, *task.depths])).max() <= 1 / 16 + 1e-12
    np.testing.assert_allclose(here.shape.gripper.rotation, turned(4.0 * goal))


@pytest.mark.parametrize('length', [1.0, 7.0])
def test_a_fold_is_not_leapt_over(length):
    task = Turning(lambda depth: 0.0 if depth <= 0.3 * length else 1.0, length)
    here, depth, too_far, _ = task.follow(passing(0.0, length=length), 0.0, 0.9 * length)
    assert here is None and depth == pytest.approx(0.3 * length, abs=2e-3 * length)
    assert too_far == pytest.approx((1.0 - largest_turn(0.0)) * length, rel=0.02)


def test_where_nothing_is_found_it_ends_there():
    task = Turning(lambda depth: None if depth > 0.3 else 0.0)
    here, depth, too_far, _ = task.follow(passing(0.0), 0.0, 0.9)
    assert here is None and too_far == 0.0 and 0.297 < depth <= 0.3


@pytest.mark.parametrize('goal', [0.6, -0.6])
def test_a_route_is_followed_by_rolls_that_are_no_leaps(goal):
    depths = np.linspace(0.0, goal, 13)
    route = Route(depths, np.array([turned(2.0 * abs(d)) for d in depths]), np.eye(3), 1.0, True)
    task, here, depth = Turning(lambda depth: 0.0), passing(0.0), 0.0
    for wanted in np.linspace(0.0, goal, 61)[1:]:
        roll = route.roll(task, here, depth, wanted)
        assert 0 <= roll <= 0.5 * largest_turn(wanted - depth) + 1e-12
        here, depth, *_ = task.follow(here, depth, wanted, route)
        assert abs(task.rolled - 2.0 * abs(wanted)) < 0.15
    far = Route(np.zeros(1), np.array([turned(-3.0)]), np.eye(3), 1.0, True)
    assert far.roll(task, passing(0.0), 0.0, 0.01) == pytest.approx(-0.5 * largest_turn(0.01))


def curve(angles, stability=1.0, place=0.0):
    """Return Crossings with grippers turned by these angles (m,)."""
    m = len(angles)
    return Crossings(np.array([turned(angle) for angle in angles]), np.tile(np.eye(3), (m, 1, 1)),
                     np.column_stack([np.broadcast_to(place, m), np.zeros((m, 2))]),
                     np.broadcast_to(np.array(stability, dtype=float), m).copy(),
                     np.zeros((m, 2), dtype=int), np.zeros(m))


def angles_of(route):
    return [float(Rotation.from_matrix(g).as_rotvec() @ AXIS) for g in route.grippers]


def test_the_way_of_least_motion_is_found():
    layers = [curve([0.0, 0.5]), curve([0.3, 0.6]), curve([0.7, -0.2])]
    route = find_route(layers, [0.0, 0.1, 0.2], np.zeros(2), 1.0)
    assert route.complete
    np.testing.assert_allclose(angles_of(route), [0.5, 0.6, 0.7], atol=1e-9)
    route = find_route(layers, [0.0, 0.1, 0.2], np.array([0.0, np.inf]), 1.0)
    np.testing.assert_allclose(angles_of(route), [0.0, 0.3, 0.7], atol=1e-9)


def test_a_stronger_shape_is_worth_a_detour():
    layers = [curve([0.0]), curve([0.0, 0.1], [0.0, 0.5]), curve([0.0])]
    route = find_route(layers, [0.0, 0.1, 0.2], np.zeros(1), 1.0)
    np.testing.assert_allclose(angles_of(route), [0.0, 0.1, 0.0], atol=1e-9)


def test_it_goes_as_deep_as_it_can_and_nowhere_without_a_start():
    layers = [curve([0.0]), curve([0.2]), curve([2.0]), curve([2.0])]
    route = find_route(layers, [0.0, 0.1, 0.2, 0.3], np.zeros(1), 1.0)
    assert not route.complete and list(route.depths) == [0.0, 0.1]
    far = [curve([0.0]), curve([0.0], place=0.5)]
    assert not find_route(far, [0.0, 0.1], np.zeros(1), 1.0).complete
    assert find_route(far, [0.0, 0.1], np.zeros(1), 5.0).complete
    assert find_route(layers, [0.0, 0.1, 0.2, 0.3], np.full(1, np.inf), 1.0) is None
    assert not find_route([curve([0.0]), curve([])], [0.0, 0.1], np.zeros(1), 1.0).complete


ROLL_AXIS = np.array([1.0, 0.0, 0.0])
TASK = SimpleNamespace(axis=lambda _: ROLL_AXIS)
HOSE = Rod.tube(0.5, 0.016, 0.010, 1150.0, 8e6, 0.49, natural_curvature=(0.0, 0.5))


def rolled(turned):
    """Return passings whose grippers have turned so far, rad."""
    return [SimpleNamespace(shape=SimpleNamespace(gripper=Pose.from_rotation(
        (0, 0, 0), Rotation.from_rotvec(angle * ROLL_AXIS).as_matrix()))) for angle in turned]


def test_rolls_in_jerks_become_even():
    depths = np.linspace(0, 0.4, 41)
    jerks = 0.1 * np.floor(np.linspace(0, 8, 41))
    found = list(even_rolls(TASK, depths, rolled(jerks)))
    steps = [np.diff(route.turned) for route in found]
    for route in found:
        assert route.turned.sum() == pytest.approx(jerks.sum())  # about the same way
        assert np.abs(route.turned - jerks).max() < 0.1
        assert route.roll(TASK, None, 0.1, 0.2) == pytest.approx(
            route.turned[20] - route.turned[10])
    assert np.ptp(steps[0]) < 0.2 * np.ptp(np.diff(jerks))
    assert (np.diff([np.ptp(step) for step in steps]) > 0).all()  # ever less even


def test_even_rolls_stay_and_none_are_none():
    depths, even = np.linspace(0, 0.4, 9), np.linspace(0, 0.8, 9)
    for route in even_rolls(TASK, depths, rolled(even)):
        np.testing.assert_allclose(route.turned, even, atol=1e-9)
    assert not list(even_rolls(TASK, depths, rolled(0 * even)))
    assert not list(even_rolls(TASK, depths[:2], rolled(even[:2])))


def test_a_dlo_that_hardly_stands_is_threaded_without_corners():
    normal = (0.0241, -0.6319, 0.7747)  # steeply upwards: the hose nearly falls aside
    hole = CutOut(Pose.looking_along((0, 0, 1), normal), radius=0.014)
    start = Pose((-0.159, 0.492, 0.591), (-0.2302, -0.3503, -0.4986, 0.7587))
    direct = DirectSimulator(HOSE)
    plan = InverseSimulator(direct).thread(hole, start=start, depths=np.linspace(0, 0.35, 40))
    assert plan.stability.min() > 0.04
    turns = [Rotation.from_matrix(after.rotation @ before.rotation.T).magnitude()
             for before, after in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert sum(turns) > 0.5  # it rolls
    assert np.abs(np.diff(turns)).max() < 0.02  # and evenly
    assert len(GripperPath.of(plan).legs) == 1
    report = replay(direct, plan)
    assert report.converged and report.position_error < 1e-6 and report.misalignment < 1e-6
    assert Trajectory(plan, tolerance=np.inf).duration < 10
