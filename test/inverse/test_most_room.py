# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading with the most room: soft DLOs pass obliquely, stiff ones along the normal as ever."""

import pickle
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from references.kirchhoff import equilibrium, is_minimum
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
    Sheet,
    Thread,
    Uncertainty,
    robustness,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import step
from dlo_planner.inverse import most_room, reachable
from dlo_planner.inverse.reachable import reachable_shapes
from dlo_planner.inverse.route import Threading
from dlo_planner.inverse.tasks.thread import ThreadLookedAt
from dlo_planner.model.rod import Surface
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.clearance import scene_about, sheet_of
from dlo_planner.plan.margin import expected_misses, rating, uncertain_state, unseen, upright_room
from dlo_planner.progress import Progress
from dlo_planner.tasks import Requirements

GRAVITY = (0.0, 0.0, -9.80665)
WIRE = Rod(0.2, 0.0174, 1.22e-4, 1.0e-4, radius=1.5e-3)  # as measured
BENT = Rod(1.0, 0.05, 0.005, 0.004, radius=3e-3, natural_curvature=(1.5, -0.8))


def hole(elevation, radius=0.01, heading=0.0):
    """Return a CutOut whose normal has an elevation and a heading, degrees."""
    up, around = np.deg2rad([elevation, heading])
    return CutOut(Pose.looking_along((0.1, 0.2, 1.0), (
        np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up))), radius=radius)


def plan(rod, cutout, **options):
    simulator = DirectSimulator(rod, gravity=GRAVITY)
    return InverseSimulator(simulator).thread(cutout, **options)


@pytest.fixture(scope='module')
def level():
    """The plan of the wire through a level hole, which no shape passes along the normal."""
    return plan(WIRE, hole(0))


def own_clearance(positions, cutout, radius):
    """Return the distance of a curve (n, 3) from a thin sheet with a round hole."""
    away = positions - cutout.center
    heights = away @ cutout.normal
    across = np.linalg.norm(away - heights[:, None] * cutout.normal, axis=1)
    gaps = np.where(across < cutout.radius, np.hypot(cutout.radius - across, heights),
                    np.abs(heights))
    crossed = np.flatnonzero(heights[1:] * heights[:-1] < 0)
    assert (across[crossed] < cutout.radius).all()  # it passes in the hole alone
    return gaps.min() - radius


@pytest.mark.every(2)
@pytest.mark.parametrize('elevation', [10, 0, -10, -20])
def test_the_measured_wire_gets_through(elevation):
    found = plan(WIRE, hole(elevation))
    assert found.status.value == 'complete'
    assert found.clearance.min() > 4e-3
    assert found.margin.min() > -2e-3
    assert found.position_error.max() < 1e-9
    assert 0.6 < found.misalignment.max() < 1.1
    # along the normal it is refused, or hardly stands
    if elevation >= 0:
        with pytest.raises(Infeasible, match='stability'):
            plan(WIRE, hole(elevation), max_misalignment=0)
    else:
        along = plan(WIRE, hole(elevation), max_misalignment=0)
        assert along.misalignment.max() < 1e-8
        assert along.margin.min() < found.margin.min() - 1e-3


@pytest.mark.every(2)
@pytest.mark.parametrize(('rod', 'cutout'), [
    (WIRE, hole(0)), (BENT, hole(-25, 0.05, 40)), (BENT, hole(-80, 0.03, 0))],
    ids=['wire', 'bent', 'bent steep'])
def test_every_shape_is_one_that_stands_and_has_room(rod, cutout):
    found = plan(rod, cutout)
    assert found.misalignment.max() > 0.2
    s = np.linspace(0, rod.length, 2001)
    for k in (0, 19, 39):
        shape = found.shapes[k]
        solution = equilibrium(rod, shape.gripper, shape, GRAVITY, tol=1e-6)
        positions = solution(s)[:3].T
        assert np.abs(solution(shape.s)[:3].T - shape.positions).max() < 2e-3 * rod.length
        assert is_minimum(rod, solution, GRAVITY)
        clearance = own_clearance(positions, cutout, rod.radius)
        assert found.clearance[k] == pytest.approx(clearance, abs=1e-3 * rod.length)


def test_the_direction_is_that_of_the_dlo_in_the_hole(level):
    normal = hole(0).normal
    for shape, points, angle in zip(level.shapes, level.via_points, level.misalignment,
                                    strict=True):
        (center, s, direction), = points
        np.testing.assert_allclose(shape.at(s).position, center, atol=1e-12)
        np.testing.assert_allclose(shape.at(s).direction, direction, atol=1e-12)
        assert angle == pytest.approx(np.arccos(direction @ normal), abs=1e-7)
    assert max(np.abs(goal.residuals(shape)).max() for shape, goals in zip(
        level.shapes, level.goals, strict=True) for goal in goals) < 1e-9


@pytest.mark.parametrize('ratio', [0.1, 0.9])
@pytest.mark.parametrize('bend', [(0.0, 0.0), (0.3, -0.2)])
def test_a_stiff_dlo_passes_as_before(ratio, bend):
    stiffness = 0.05 * 9.80665 / ratio
    rod = Rod(1.0, 0.05, stiffness, 0.75 * stiffness, radius=3e-3, natural_curvature=bend)
    for elevation in (-70, 0, 35):
        cutout = hole(elevation, 0.03)
        assert plan(rod, cutout) == plan(rod, cutout, max_misalignment=0)


def test_no_more_oblique_than_allowed():
    cutout = hole(-20)
    found = plan(WIRE, cutout, max_misalignment=0.5)
    assert found.misalignment.max() < 0.5 + 1e-6
    any_angle = plan(WIRE, cutout)
    assert any_angle.misalignment.max() > 0.6
    assert any_angle.margin.min() > found.margin.min()
    with pytest.raises(Infeasible, match='room'):
        plan(WIRE, hole(0), max_misalignment=0.1)


@pytest.mark.parametrize('most', [0.3, 0.7])
def test_a_smooth_way_is_no_more_oblique_than_allowed(most):
    # smoothed, the way on the grid passed at 0.7052 rad where 0.7 were allowed
    found = plan(WIRE, hole(-10), max_misalignment=most)
    assert 0.9 * most < found.misalignment.max() <= most


def test_no_way_is_bent_round_its_limit(monkeypatch):
    # a search right up to the limit: the smoothest way exceeds it, and is refused for another
    monkeypatch.setattr(most_room, '_STEEPEST', 1.0)
    found = plan(WIRE, hole(-10), max_misalignment=0.7)
    assert 0.68 < found.misalignment.max() <= 0.7


@pytest.mark.parametrize('angle', [-0.1, 2.0, np.nan, 'x'])
def test_an_angle_that_makes_no_sense_is_refused(angle):
    with pytest.raises(InvalidTask, match='max_misalignment'):
        Thread(hole(0), max_misalignment=angle)


def test_a_hole_without_a_size_is_passed_along_its_normal():
    cutout = replace(hole(-20), radius=None)
    found = plan(WIRE, cutout)
    assert found.misalignment.max() < 1e-8
    assert np.isnan(found.margin).all()


def test_the_margin_is_the_clearance_less_the_expected_miss(level):
    uncertainty = Uncertainty(bending_stiffness=0.02, gripper_rotation=1e-3,
                              natural_curvature=0.02)
    known = replace(level, uncertainty=uncertainty)
    simulator = DirectSimulator(WIRE, gravity=GRAVITY)
    expected = robustness(simulator, level, uncertainty).first_order
    np.testing.assert_allclose(
        known.margin, level.clearances.min(axis=(1, 2)) - 2 * expected, rtol=1e-6)
    assert (known.margin > level.margin).any()  # less is unknown than usually


def test_the_expected_miss_is_that_of_small_changes():
    simulator = DirectSimulator(BENT, gravity=GRAVITY, n_elements=60)
    shape = simulator.solve(Pose.looking_along((0, 0, 0), (1, 0, 0.2)))
    step, s = 1e-4, np.array([0.3, 0.7, 1.0])
    squares = np.zeros(3)
    for change in ({'bending_stiffness': 0.005 * np.exp(step)}, {
            'natural_curvature': (1.5 + step, -0.8)}, {'natural_curvature': (1.5, -0.8 + step)}):
        moved = DirectSimulator(replace(BENT, **change), gravity=GRAVITY, n_elements=60).solve(
            shape.gripper, shape)
        off = (moved.positions_at(s) - shape.positions_at(s)) / step
        along = np.array([shape.at(one).direction for one in s])
        off -= (off * along).sum(axis=1)[:, None] * along
        squares += (off**2).sum(axis=1) * (0.02 if 'bending_stiffness' in change else 0.1)**2
    uncertain = uncertain_state(simulator.surroundings, Uncertainty(
        bending_stiffness=0.02, natural_curvature=0.1))
    np.testing.assert_allclose(expected_misses(uncertain, [shape], s)[0], np.sqrt(squares),
                               rtol=2e-3)


def test_by_how_much_there_is_no_room_is_not_made_up():
    task = Threading((hole(0),), np.linspace(0, 0.5, 3), None, PlanChecker((0.1, 0.5), Progress()))
    refused = most_room.NoRoom(0.3, 'nothing has room').refusal(task)
    assert refused.waypoint == 2
    assert np.isnan(refused.amount) and str(refused).endswith('nothing has room (room)')


def test_a_demand_for_a_margin_refuses():
    simulator = DirectSimulator(WIRE, gravity=GRAVITY)
    inverse = InverseSimulator(simulator)
    good = inverse.plan(Thread(hole(-20)), requirements=Requirements(margin=1e-3))
    assert good.margin.min() >= 1e-3
    with pytest.raises(Infeasible, match='margin = 0.008 m') as caught:
        inverse.plan(Thread(hole(-20)), requirements=Requirements(margin=8e-3))
    assert caught.value.constraint == 'margin'


def test_margins_are_kept_in_files_and_pickles(level, tmp_path):
    level.margin  # noqa: B018  it is computed
    level.save(tmp_path / 'plan.npz')
    loaded = Plan.load(tmp_path / 'plan.npz')
    np.testing.assert_array_equal(loaded.margin, level.margin)
    with pytest.raises(ValueError, match='read-only'):
        loaded.margin[0] = 1.0
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(level)).margin, level.margin)
    with pytest.raises(ValueError, match='read-only'):
        level.margin[0] = 1.0


def test_a_file_keeps_what_is_uncertain(tmp_path):
    uncertainty = Uncertainty(bending_stiffness=0.05, gripper_rotation=1e-3)
    found = InverseSimulator(DirectSimulator(WIRE, gravity=GRAVITY)).plan(
        Thread(hole(-20), depths=[0.0, 0.01]), requirements=Requirements(uncertainty=uncertainty))
    for name in ('plan.npz', 'plan.json'):
        found.save(tmp_path / name)
        again = Plan.load(tmp_path / name)
        assert again.uncertainty == uncertainty
        assert again == found


def test_a_dlo_that_must_not_be_bent_passes_as_straight_as_it_has_to():
    # the way with the most room bends it to 19 1/m
    rod = replace(WIRE, max_bend_curvature=15.0)
    found = plan(rod, hole(-20, 0.015))
    assert min(shape.bend_margin for shape in found.shapes) >= 0
    assert found.clearance.min() > 1e-3
    assert plan(WIRE, hole(-20, 0.015)).margin.min() > found.margin.min()
    with pytest.raises(Infeasible, match='bent as little as it has to be'):
        plan(replace(BENT, max_bend_curvature=1.0), hole(-20))


def test_a_thick_sheet_and_a_rectangular_hole():
    cutout = replace(hole(-20), radius=None, width=0.03, height=0.02)
    plate = Sheet(cutout.pose, 1.0, 1.0, 0.006, (cutout,))
    simulator = DirectSimulator(WIRE, gravity=GRAVITY, obstacles=[plate])
    found = InverseSimulator(simulator).thread(cutout)
    assert found.misalignment.max() > 0.2
    half = 0.5 * np.array([0.006, 0.03, 0.02])
    for shape, clearance in zip(found.shapes[::4], found.clearance[::4], strict=True):
        away = (shape.positions_at(np.linspace(0, 0.2, 8001)) - cutout.center
                ) @ cutout.pose.rotation
        beside = np.maximum(np.abs(away[:, 0]) - half[0], 0.0)
        inside = np.maximum((half - np.abs(away))[:, 1:].min(axis=1), 0.0)
        own = np.hypot(beside, inside).min() - WIRE.radius
        assert clearance == pytest.approx(own, abs=1e-5)
        assert own > 1e-3


def test_the_flood_finds_what_hangs():
    simulator = DirectSimulator(WIRE, gravity=GRAVITY)
    shapes = reachable_shapes(simulator, 3e-4, lambda: None)
    rises = np.rad2deg(np.arcsin(shapes.frames[:, 0, 2, 0]))
    # a round straight wire hangs in a plane until its gripper points straight up
    assert rises[0] == pytest.approx(-90)
    assert 88 < rises[-1] <= 90
    assert (np.diff(rises) > 0).all()
    for shape in shapes.shapes[::40]:
        assert is_minimum(WIRE, equilibrium(WIRE, shape.gripper, shape, GRAVITY,
                                             tol=1e-6), GRAVITY)


def test_the_flood_of_a_bent_dlo_is_followed_without_a_fall():
    simulator = DirectSimulator(BENT, gravity=GRAVITY)
    shapes = reachable_shapes(simulator, 3e-4, lambda: None)
    assert len(shapes.shapes) > 300
    assert all(isinstance(shape, Shape) and shape.stability > 3e-4 for shape in shapes.shapes)
    for shape in shapes.shapes[::len(shapes.shapes) // 3]:
        assert is_minimum(BENT, equilibrium(BENT, shape.gripper, shape, GRAVITY,
                                             tol=1e-6), GRAVITY)


@pytest.mark.parametrize('limit', [None, 400.0], ids=['elastic', 'may yield'])
def test_a_flood_of_a_soft_cable_goes_in_whole_steps(limit, monkeypatch):
    # begun where the cable hung before, Newton's first step leaves it too far: 12 steps each
    soft, steps = replace(BENT, bending_stiffness=1.2e-3, torsional_stiffness=1e-3,
                          yield_curvature=limit), []
    monkeypatch.setattr(reachable, 'step', lambda *given: steps.append(step(*given)) or steps[-1])
    simulator = DirectSimulator(soft, gravity=GRAVITY)
    shapes = reachable_shapes(simulator, 3e-4, lambda: None).shapes
    assert len(shapes) == 600
    assert len(steps) < 2 * len(shapes)
    own = DirectSimulator(soft, n_elements=64, basis='local', gravity=GRAVITY)
    for k in (100, 350):  # each is what the cable takes, followed in small steps
        angles = np.linspace(0, 1, 40)
        down, turn = shapes[k].gripper, Rotation.from_rotvec((0.1, 0.2, -0.1))
        ways = [Pose.from_rotation((0, 0, 0), (turn**angle).as_matrix() @ down.rotation)
                for angle in (*angles, *angles[::-1])]
        there = own.track(ways, initial=shapes[k])[-1]
        assert not there.jumped
        np.testing.assert_allclose(shapes[k].positions, there.positions, atol=1e-8)


def test_without_weight_there_is_no_flood():
    assert reachable_shapes(DirectSimulator(WIRE, gravity=(0, 0, 0)), 0.0, lambda: None) is None


@pytest.mark.parametrize(('cutout', 'surface', 'room'), [
    (hole(0), Surface(0.002), 0.008), (replace(hole(0), radius=None), Surface(0.002), np.inf),
    (replace(hole(0), radius=None, width=0.03, height=0.02), Surface(0.002), 0.008),
    (hole(0), Surface(0.005, (0.003, 0.004)), 0.005),
    (hole(0, 0.0045), Surface(0.004, (0.003, 0.004)), 0.0015)])
def test_room_of_an_upright_dlo(cutout, surface, room):
    assert upright_room(cutout, surface) == pytest.approx(room)


def test_the_certificate_of_a_soft_cable_names_the_shapes_that_stand():
    stiffness = 0.05 * 9.80665 / 200  # w L^3 / EI = 200
    rod = Rod(1.0, 0.05, stiffness, 0.75 * stiffness, radius=2e-3)
    cutout = CutOut(Pose.looking_along((0, 0, 1), (np.sin(0.03), 0, -np.cos(0.03))), radius=0.02)
    with pytest.raises(Infeasible) as caught:
        plan(rod, cutout, max_misalignment=0)
    words = caught.value.certificate
    assert 'none' not in words.split('no stable one is along the normal at depth 0 m')[0]
    least, most = (float(words.split('between ')[1].split(' m')[0].split(' and ')[k])
                   for k in (0, 1))
    assert 0.5 < least < 0.7 and most == pytest.approx(0.95)
    deep = plan(rod, cutout, depths=[0.85, 0.9], max_misalignment=0)
    assert deep.stability.min() > 0.9
    assert plan(rod, cutout).misalignment.max() > 0.02  # obliquely from the tip on


def test_a_refusal_says_what_would_help():
    stiffness = 0.05 * 9.80665 / 100
    rod = Rod(1.0, 0.05, stiffness, 0.75 * stiffness, radius=2e-3)
    cutout = hole(30, 0.02)
    with pytest.raises(Infeasible, match='obliquely') as caught:
        plan(rod, cutout)
    words = caught.value.advice
    assert pickle.loads(pickle.dumps(caught.value)).advice == words
    free = float(words.split('held at most ')[1].split(' m from its end')[0])
    angle = float(words.split('turned downwards by ')[1].split(' degrees')[0])
    assert 14 < 100 * free**3 < 24  # w f^3 / EI of a hole at 30 degrees
    assert plan(replace(rod, length=0.95 * free), cutout).status.value == 'complete'
    with pytest.raises(Infeasible):
        plan(replace(rod, length=1.08 * free), cutout)
    assert plan(rod, hole(30 - 1.05 * angle, 0.02)).status.value == 'complete'
    with pytest.raises(Infeasible):
        plan(rod, hole(30 - 0.92 * angle, 0.02))
    assert Infeasible('', 0, 'room', 0.0).advice == ''


@pytest.mark.sweep
def test_advice_of_a_hole_that_is_too_small():
    cutout = replace(hole(65), radius=None, width=0.012, height=0.008)
    with pytest.raises(Infeasible) as caught:
        plan(WIRE, cutout)
    found = re.search(r'through a hole of ([\d.]+) m by ([\d.]+) m', caught.value.advice)
    width, height = (1.03 * float(size) for size in found.groups())
    assert width / height == pytest.approx(1.5, rel=0.01)
    assert plan(WIRE, replace(cutout, width=width, height=height)).fraction == 1


def test_meshes_that_differ_from_waypoint_to_waypoint_are_no_leap():
    stiffness = 0.05 * 9.80665 / 241.4
    rod = Rod(1.0, 0.05, stiffness, 0.75 * stiffness, radius=1.1e-3)
    found = plan(rod, hole(-43.4, 0.0113))
    meshes = [shape.s for shape in found.shapes]
    assert any(one.size == other.size and not np.array_equal(one, other)
               for one, other in zip(meshes, meshes[1:], strict=False))


def test_hardly_any_clearance_is_never_the_best():
    # copper of 1.5 mm through 20 mm: it is known so badly that either plan may miss; upright it
    # passes more often than beside the sheet, where it is known better
    clearance, margin = np.array([0.45e-3, 9.25e-3, 3e-3]), np.array([-5e-3, -25e-3, 1e-3])
    rated = rating(clearance, margin, 9.25e-3)
    assert rated[0] < rated[1] < 0 < rated[2]
    assert rating(np.zeros(1), np.array([-1e-9]), 1.0) == pytest.approx(-1)
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    found = plan(wire, hole(0), depths=np.linspace(0, 0.9, 20))
    assert found.misalignment.max() < 1e-8
    assert found == plan(wire, hole(0), depths=np.linspace(0, 0.9, 20), max_misalignment=0)


def test_of_few_waypoints_no_oblique_plan_replaces_one_along_the_normal():
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    cutout, few = hole(0, 0.02), np.linspace(0, 0.5, 6)
    many = plan(wire, cutout, depths=np.linspace(0, 0.5, 30))
    assert many.misalignment.max() > 0.2
    assert plan(wire, cutout, depths=few).misalignment.max() < 1e-8


@pytest.mark.parametrize('depths', [[0.0], [0.1], [0.05, 0.05]])
def test_one_waypoint_may_be_all(depths):
    assert len(plan(WIRE, hole(-20), depths=depths)) == len(depths)


def roll(before, after):
    """Return by how much one Pose is rolled from another, rad: what their directions do not ask."""
    turn = Rotation.align_vectors(after.direction[None], before.direction[None])[0].as_matrix()
    return np.linalg.norm(Rotation.from_matrix(
        after.rotation @ (turn @ before.rotation).T).as_rotvec())


@pytest.mark.every(2)
@pytest.mark.parametrize('before', [True, None])
def test_what_is_not_known_of_a_dlo_that_was_looked_at_is_not_turned(before):
    rod = replace(WIRE, natural_curvature=(0.1, -0.15))  # as a loop estimates it
    inverse = InverseSimulator(DirectSimulator(rod, gravity=GRAVITY))
    depths = np.linspace(0, 0.14, 6)
    first, = inverse.thread(hole(-10), depths=[0.0]).grippers
    start = Pose.from_rotation(first.position, first.rotation @ Rotation.from_euler(
        'x', -1.0).as_matrix())
    free, kept = (inverse.plan(task, start=start, requirements=Requirements(
        uncertainty=unseen(rod))) for task in (
            Thread(hole(-10), depths), ThreadLookedAt(hole(-10), depths,
                                                            obliquely=before)))

    def rolls(plan):
        return sum(roll(*pair) for pair in pairwise(plan.grippers))

    assert kept.misalignment.max() > 0.1
    assert rolls(kept) < 0.1
    assert rolls(free) > 0.3
    assert kept.margin.min() > 0.9 * free.margin.min()
    assert roll(start, kept.grippers[0]) < 0.3
    assert roll(start, free.grippers[0]) > 1


def test_a_dlo_that_was_looked_at_passes_as_it_was_led_there():
    inverse, depths = InverseSimulator(DirectSimulator(WIRE, gravity=GRAVITY)), [0.0, 0.05, 0.1]
    cutout = hole(-30)  # which both ways pass

    def misalignment(task):
        return inverse.plan(task).misalignment.max()

    along, obliquely = (misalignment(ThreadLookedAt(cutout, depths, obliquely=before))
                        for before in (False, True))
    assert along < 1e-6
    assert obliquely > 0.05
    free = misalignment(Thread(cutout, depths))
    assert misalignment(ThreadLookedAt(cutout, depths)) == pytest.approx(free, abs=0.05)
    with pytest.raises(InvalidTask, match='obliquely'):
        ThreadLookedAt(cutout, depths, obliquely=1.5)
    # where there is no way of its kind any more, the other one
    assert misalignment(ThreadLookedAt(hole(0), depths, obliquely=False)) > 0.05


def test_the_gripper_does_not_leap_from_depth_to_depth():
    """It costs nothing to go on from what is too far, but only what is near can be gone on to."""
    turns = np.stack([np.eye(3), *Rotation.from_rotvec(
        [[0, 0, 0.3], [0, 0, 1.0]]).as_matrix()])
    places = np.array([[0, 0, 0], [0.1, 0, 0], [0.4, 0, 0]])
    costs, rotated, shifted = np.array([5.0, 0.0]), turns[[1, 2]], places[[1, 2]]
    for grippers, there in ((rotated, places[[0, 0]]), (turns[[0, 0]], shifted)):
        found, best = most_room._cheapest(turns[:1], places[:1], grippers, there, costs, 3, 0.0)
        assert found[0] > 5.0 and best[0] == 0
        far = most_room._cheapest(turns[:1], places[:1], grippers[1:], there[1:], costs[1:], 3, 0.0)
        assert np.isinf(far[0]).all()


@pytest.mark.parametrize('turn', [0.4, 0.8])
def test_a_dlo_that_comes_back_through_its_hole_does_not_pass_it(turn):
    """An arc of a circle, a part of it beyond the sheet: all of it, or but for its end."""
    rod = Rod(1.0, 0.05, 0.005, 0.004, radius=3e-3, natural_curvature=(2 * np.pi * turn / 0.5, 0.0))
    shape = DirectSimulator(rod, gravity=(0, 0, 0), basis='local', n_elements=40).solve(
        Pose.looking_along((0, 0, 0), (1, 0, 0)))
    axis, place = shape.frames[20], shape.positions[20]
    cutout = CutOut(Pose.looking_along(place, axis[:, 0]), radius=0.9)
    sheet = sheet_of(cutout, 1.0, [])
    rooms = most_room._rooms(
        scene_about(sheet, Surface.of(rod), shape.s), axis[:, 0].copy(),
        place - sheet.pose.position, np.diff(shape.s), *(np.array([one]) for one in (
            shape.element_strains, shape.frames, shape.positions)), 19, 1.0, axis[None],
        place[None], np.eye(3)[None, None], 0.0, 0.0, 1e-4)
    assert np.isfinite(rooms[0, 0]) == (turn < 0.5)
