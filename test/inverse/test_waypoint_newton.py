# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Goals and equilibrium at once: found as SciPy and the direct simulation find them."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import kernel_arrays
from dlo_planner.inverse import waypoint_newton
from dlo_planner.inverse.continuation import Aligned, BranchPoint, TwoPoints
from dlo_planner.inverse.waypoint_newton import follow, free_axis, goal_shape
from dlo_planner.model.pose import displaced, turned_by
from dlo_planner.penalties import DirectionAt, PositionAt, Through
from dlo_planner.plan.goal_rows import (
    DIRECTION,
    POSITION,
    ROLL,
    ROTATION,
    THROUGH,
    GoalTable,
    fill_residuals,
    fill_rows,
)

RODS = [Rod(1.0, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4),
        Rod(1.0, 0.02, 0.1, 0.08, tip_mass=0.005)]
OPTIONS = [{'n_elements': 40, 'basis': 'local'}, {'n_elements': 48, 'n_terms': 12}, {}]
GRIPPER = Pose.looking_along((0.3, -0.2, 0.1), (1, 0.3, 0.4))
BEFORE = displaced(GRIPPER, np.array([0.03, -0.02, 0.01, 0.0, 0.0, 0.0]))
NORMAL = np.array([0.6, 0.0, 0.8])


def hanging(rod, options):
    simulator = DirectSimulator(rod, **options)
    return simulator, simulator.solve(GRIPPER)


def table(*goals):
    """Return the GoalTable of (kind, s, target, weight), the gripper's turn since BEFORE."""
    kinds, s, targets, weights = zip(*goals, strict=True)
    return GoalTable(np.array(kinds), np.array(s, dtype=float), np.array(targets, dtype=float),
                     np.tile(np.array(BEFORE.rotation), (len(goals), 1, 1)),
                     np.array(weights, dtype=float))


def of(goals, shape, sensitivity=None):
    """Return residuals of goals, or their derivatives."""
    count, length = goals.kind.size, float(shape.s[-1])
    residuals, where, places = np.empty(3 * count), np.empty(count), np.empty((count, 3, 3))
    base = np.array(shape.gripper.rotation)
    fill_residuals(goals, shape.s, *kernel_arrays(shape), np.zeros(3), base, residuals, where,
                   places)
    if sensitivity is None:
        return residuals
    rows = np.empty((3 * count, 6))
    fill_rows(goals, length, base, where, places,
              np.array([sensitivity.at(min(s, length)) for s in where]), rows)
    return rows


def goals_around(shape):
    """Return goals of all kinds, one beyond the end, one before it may be, one of no weight."""
    off, (end, tip) = np.array([0.01, 0.02, -0.03]), shape.frame_at(1.0)
    return table((POSITION, 0.35, shape.frame_at(0.35)[1] + off, 1.0),
                 (DIRECTION, 0.35, NORMAL, 0.7), (POSITION, 1.2, tip + off, 0.5),
                 (THROUGH, 0.35, shape.frame_at(0.7)[1] - off, 2.0),
                 (THROUGH, 0.35, tip + 0.2 * end[:, 0] + off, 0.5),
                 (THROUGH, 0.35, shape.frame_at(0.2)[1] + off, 3.0), (THROUGH, 0.1, off, 0.0),
                 (ROTATION, 0.0, off, 2.0), (ROLL, 0.0, BEFORE.direction, 0.1))


def test_residuals_are_those_of_the_penalties():
    shape = hanging(RODS[0], OPTIONS[0])[1]
    goals, (end, tip) = goals_around(shape), shape.frame_at(1.0)
    residuals = of(goals, shape).reshape(-1, 3)
    penalties = [PositionAt(0.35, goals.target[0]), DirectionAt(0.35, NORMAL, 0.7), None,
                 *(Through(goals.target[k], 0.35, goals.weight[k]) for k in (3, 4, 5))]
    for penalty, found in zip(penalties, residuals, strict=False):
        if penalty is not None:
            np.testing.assert_allclose(found, penalty.residuals(shape), atol=1e-15)
    np.testing.assert_allclose(residuals[2], 0.5 * (tip + 0.2 * end[:, 0] - goals.target[2]),
                               atol=1e-15)
    assert not residuals[6].any() and not residuals[8, 1:].any()
    turn = Rotation.from_matrix(GRIPPER.rotation @ BEFORE.rotation.T).as_rotvec()
    np.testing.assert_allclose(residuals[7], 2 * turn, atol=1e-12)
    assert residuals[8, 0] == pytest.approx(0.1 * BEFORE.direction @ turn, abs=1e-12)


def test_rows_are_differences_of_residuals():
    simulator, shape = hanging(RODS[0], OPTIONS[0])
    goals, size = goals_around(shape), 1e-5
    rows = of(goals, shape, Sensitivity(shape))
    for column, twist in enumerate(np.eye(6) * size):
        ahead, back = (of(goals, simulator.solve(displaced(GRIPPER, sign * twist), shape))
                       for sign in (1, -1))
        found = (ahead - back) / (2 * size)
        np.testing.assert_allclose(rows[:21, column], found[:21], atol=1e-6)
        np.testing.assert_allclose(rows[21:24, column], found[21:24], atol=0.06)  # 0.04 rad away
        np.testing.assert_allclose(rows[24:, column], found[24:], atol=1e-4)


@pytest.mark.parametrize('options', OPTIONS)
@pytest.mark.parametrize('rod', RODS)
def test_an_aligned_shape_is_an_equilibrium(rod, options):
    simulator, shape = hanging(rod, options)
    normal = turned_by(np.array([0.05, -0.1, 0.08])) @ shape.frame_at(0.6)[0][:, 0]
    found = Aligned(simulator, normal).from_guess(shape, 0.4, shape.gripper.rotation).shape
    np.testing.assert_allclose(found.frame_at(0.6)[0][:, 0], normal, atol=1e-9)
    turned = Rotation.from_matrix(found.gripper.rotation @ shape.gripper.rotation.T).as_rotvec()
    assert np.linalg.norm(turned) > 0.01  # but about the axis that is left free
    assert free_axis(np.array(shape.gripper.rotation), normal) @ turned == pytest.approx(
        0, abs=1e-10)
    is_that_of(simulator, found)


def is_that_of(simulator, found):
    direct = simulator.solve(found.gripper, found)
    np.testing.assert_allclose(found.positions, direct.positions, atol=1e-9)
    np.testing.assert_allclose(found.gripper_wrench, direct.gripper_wrench, atol=1e-8)
    assert found.converged and found.energy == pytest.approx(direct.energy, abs=1e-10)
    assert found.elastic_energy == pytest.approx(direct.elastic_energy, abs=1e-10)
    assert found.stability == pytest.approx(direct.stability, rel=1e-3)
    assert found.error_estimate == pytest.approx(direct.error_estimate, rel=1e-3)


@pytest.mark.parametrize('options', OPTIONS)
@pytest.mark.parametrize('roll', [0.0, 0.05, -0.2])
def test_two_points_are_passed_by_an_equilibrium(options, roll):
    simulator, shape = hanging(RODS[0], options)
    chord = 0.97 * (shape.frame_at(0.8)[1] - shape.frame_at(0.35)[1]) + [0.01, -0.02, 0.015]
    two = TwoPoints(simulator, chord)
    before = BranchPoint(shape, (0.8,), depth=0.65)
    found = two.at(before, 0.65, roll)
    passed = found.shape.frame_at(found.further[0])[1] - found.shape.frame_at(0.35)[1]
    np.testing.assert_allclose(passed, chord, atol=2e-10)
    is_that_of(simulator, found.shape)
    made = Rotation.from_matrix(found.shape.gripper.rotation @ shape.gripper.rotation.T).as_rotvec()
    assert two.axis(shape) @ made == pytest.approx(roll, abs=5e-3)  # since the axis rolls as well
    end = two.from_end(found.shape, 0.65)
    passed = end.shape.frame_at(1.0)[1] - end.shape.frame_at(1.0 - end.depth)[1]
    np.testing.assert_allclose(passed, chord, atol=2e-10)


def test_what_cannot_be_passed_is_told():
    simulator, shape = hanging(RODS[0], OPTIONS[0])
    before = BranchPoint(shape, (0.8,), depth=0.65)
    assert TwoPoints(simulator, np.array([0.9, 0.0, 0.0])).at(before, 0.65) is None
    just_too_short = TwoPoints(simulator, np.array([0.7, 0.0, 0.3]))
    assert just_too_short.at(before, 0.65) is None


def test_the_frame_of_a_plug_comes_to_its_pose():
    simulator, shape = hanging(RODS[0], OPTIONS[0])
    axes, place = shape.frame_at(1.0)
    goal, there = turned_by(np.array([0.2, -0.1, 0.15])) @ axes, place + [0.02, 0.05, -0.03]
    goals = GoalTable(np.array([POSITION, ROTATION]), np.ones(2), np.array([there, there]),
                      np.array([goal, goal]), np.ones(2))
    found, = follow(shape.state.mesh, shape, goals, np.ones((1, 2)), NORMAL,
                    origin=shape.gripper.position)
    np.testing.assert_allclose(found.shape.frame_at(1.0)[0], goal, atol=1e-9)
    is_that_of(simulator, found.shape)


def begun(options, off):
    """Return a simulator, its Shape, and soft goals `off` (3,) m from it."""
    simulator, shape = hanging(RODS[0], options)
    centers = [shape.frame_at(s)[1] + sign * np.array(off)
               for s, sign in ((0.3, 1), (0.6, -1), (0.9, 1))]
    return simulator, shape, table(
        (POSITION, 0.3, centers[0], 1.0), (THROUGH, 0.3, centers[1], 2.0),
        (THROUGH, 0.3, centers[2], 0.5), (DIRECTION, 0.3, shape.frame_at(0.3)[0][:, 0], 1e-3))


def nearest(simulator, goals, shape, reach):
    """Return the Shape that misses goals least, its gripper within reach of another (rad, m)."""
    found = goal_shape(simulator, shape, goals, goals.s, origin=shape.gripper.position,
                       reach=(reach, reach))
    return found and found.shape


@pytest.mark.parametrize('options', OPTIONS[:2])
def test_the_nearest_is_the_one_that_scipy_finds(options):
    simulator, shape, goals = begun(options, (0.01, -0.02, 0.005))
    found = shape
    for _ in range(4):  # it is 2 rad away
        found = nearest(simulator, goals, found, 1.0)
    scipy = least_squares(lambda x: of(goals, simulator.solve(displaced(GRIPPER, x), shape)),
                          np.zeros(6), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert np.sum(of(goals, found)**2) == pytest.approx(2 * scipy.cost, rel=1e-8)
    is_that_of(simulator, found)


def test_the_nearest_within_reach_stays_within():
    simulator, shape, goals = begun(OPTIONS[0], (0.1, 0.2, -0.1))
    found = nearest(simulator, goals, shape, 0.05)
    assert np.sum(of(goals, found)**2) < 0.9 * np.sum(of(goals, shape)**2)
    away = np.linalg.norm(found.gripper.position - GRIPPER.position)
    assert 0.03 < away < 0.05 * (1 + 1e-6)


def test_where_it_is_the_nearest_already_it_stays():
    simulator, shape, goals = begun(OPTIONS[0], (0.0, 0.0, 0.0))
    found = nearest(simulator, goals, shape, 0.3)
    np.testing.assert_allclose(found.positions, shape.positions, atol=1e-9)


def test_where_no_trial_is_an_equilibrium_there_is_none(monkeypatch):
    simulator, shape, goals = begun(OPTIONS[0], (0.1, 0.2, -0.1))
    monkeypatch.setattr(waypoint_newton, '_NEWTON_STEPS', 0)
    assert nearest(simulator, goals, shape, 0.3) is None


def test_the_free_axis_lies_between_gripper_and_direction():
    rotation = np.array(GRIPPER.rotation)
    axis = free_axis(rotation, NORMAL)
    assert np.linalg.norm(axis) == pytest.approx(1)
    assert axis @ rotation[:, 0] == pytest.approx(axis @ NORMAL)
    np.testing.assert_array_equal(free_axis(rotation, -rotation[:, 0]), rotation[:, 0])
