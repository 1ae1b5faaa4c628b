# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Families of shapes are followed without a leap; routes move least; rolls become even."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Pose
from dlo_planner.inverse.continuation import BranchPoint, SolutionBranch
from dlo_planner.inverse.equilibria import Crossings
from dlo_planner.inverse.route import Route, find_route
from dlo_planner.inverse.tasks.thread import even_rolls
from dlo_planner.plan.continuity import largest_turn

AXIS = np.array([0.0, 0.0, 1.0])


def turned(angle):
    return Rotation.from_rotvec(angle * AXIS).as_matrix()


def branch_point(angle, place=(0.0, 0.0, 0.0), length=1.0):
    gripper = SimpleNamespace(rotation=turned(angle), position=np.array(place))
    return BranchPoint(SimpleNamespace(gripper=gripper, s=np.array([0.0, length])))


class Turning(SolutionBranch):
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
        return branch_point(angle + self.rolled, length=self.simulator.rod.length)


@pytest.mark.parametrize('goal', [0.5, -0.5])
def test_smooth_ways_are_followed_to_their_end(goal):
    task = Turning(lambda depth: 4.0 * depth)
    here, depth, too_far, _ = task.follow(branch_point(0.0), 0.0, goal)
    assert depth == goal == task.depths[-1] and too_far == 0.0
    assert np.abs(np.diff([0.0, *task.depths])).max() <= 1 / 16 + 1e-12
    np.testing.assert_allclose(here.shape.gripper.rotation, turned(4.0 * goal))


@pytest.mark.parametrize('length', [1.0, 7.0])
def test_a_fold_is_not_leapt_over(length):
    task = Turning(lambda depth: 0.0 if depth <= 0.3 * length else 1.0, length)
    here, depth, too_far, _ = task.follow(branch_point(0.0, length=length), 0.0, 0.9 * length)
    assert here is None and depth == pytest.approx(0.3 * length, abs=2e-3 * length)
    assert too_far == pytest.approx((1.0 - largest_turn(0.0)) * length, rel=0.02)


def test_where_nothing_is_found_it_ends_there():
    task = Turning(lambda depth: None if depth > 0.3 else 0.0)
    here, depth, too_far, _ = task.follow(branch_point(0.0), 0.0, 0.9)
    assert here is None and too_far == 0.0 and 0.297 < depth <= 0.3


@pytest.mark.parametrize('goal', [0.6, -0.6])
def test_a_route_is_followed_by_rolls_that_are_no_leaps(goal):
    depths = np.linspace(0.0, goal, 13)
    route = Route(depths, np.array([turned(2.0 * abs(d)) for d in depths]), np.eye(3), 1.0, True)
    task, here, depth = Turning(lambda depth: 0.0), branch_point(0.0), 0.0
    for wanted in np.linspace(0.0, goal, 61)[1:]:
        roll = route.roll(task, here, depth, wanted)
        assert 0 <= roll <= 0.5 * largest_turn(wanted - depth) + 1e-12
        here, depth, *_ = task.follow(here, depth, wanted, route)
        assert abs(task.rolled - 2.0 * abs(wanted)) < 0.15
    far = Route(np.zeros(1), np.array([turned(-3.0)]), np.eye(3), 1.0, True)
    assert far.roll(task, branch_point(0.0), 0.0, 0.01) == pytest.approx(-0.5 * largest_turn(0.01))


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
