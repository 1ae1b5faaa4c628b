# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks as penalties: found exactly where they can be, slopes against differences, errors named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Minimize,
    NotConverged,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Thread,
    Workspace,
)
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.inverse.tasks.minimize import PenaltyFunction
from dlo_planner.penalties import (
    AwayFrom,
    BentAtMost,
    DirectionAt,
    FrameAt,
    GripperNear,
    InHole,
    KeepTangent,
    PositionAt,
    Through,
    minimize_penalty,
)
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.clearance import clearance, hole_clearances
from dlo_planner.plan.requirements import STABILITY
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.tasks import Requirements

STIFF = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2), radius=0.003)
START = Pose((0, 0, 1), (0, 0, 0, 1))
ANY = [PositionAt(0.8, (0.6, 0.2, 0.8)), DirectionAt(0.6, (1, 0.5, -0.2), 0.3),
       GripperNear(START, 0.1)]


SPHERE = Sphere((0.5, 0.1, 0.85), 0.03)
LIBRARY = {
    'at': ANY[:2], 'through': [Through((0.55, 0.15, 0.9), 0.2, 2.0)],
    'aiming': [Through((1.3, 0.3, 0.8))],
    'away': [AwayFrom([SPHERE, Plane((0, 0, 0.2), (0, 0, 1))], 0.4, 0.003)],
    'hole': [InHole(CutOut(Pose.looking_along((0.5, 0.1, 0.85), (1, 0.2, -0.3)), radius=0.03),
                    0.1, 0.003)],
    'bend': [BentAtMost(0.4)], 'keep': [KeepTangent(0.2, 0.7, (1, 0.2, 0.3), 2.0)],
    'frame': [FrameAt(0.7, Pose((0.5, 0.1, 0.8), (0.1, -0.2, 0.3, 0.9)), 2.0)],
    'own': [lambda shape: shape.positions[-1], lambda shape: shape.strains[5]]}


@pytest.mark.parametrize('name', LIBRARY)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_slopes_against_differences(name, basis, rng):
    search = PenaltyFunction(DirectSimulator(STIFF, basis=basis), LIBRARY[name], START, None)
    x = 0.3 * rng.normal(size=6)
    assert np.abs(search.residuals(x)).max() > 0.01
    slopes, step = search.jacobian(x), 1e-6
    for k, change in enumerate(step * np.eye(6)):
        wanted = (search.residuals(x + change) - search.residuals(x - change)) / (2 * step)
        np.testing.assert_allclose(slopes[:, k], wanted, atol=1e-6)


def test_a_frame_comes_to_its_pose():
    goal = Pose((0.85, 0.15, 0.85), (0.05, 0.1, 0.1, 0.98))
    found = minimize_penalty(DirectSimulator(STIFF), FrameAt(1.0, goal), START)
    assert found.converged and found.penalty < 1e-12
    axes, position = found.shape.frame_at(1.0)
    np.testing.assert_allclose(axes, goal.rotation, atol=1e-6)
    np.testing.assert_allclose(position, goal.position, atol=1e-6)


def test_a_kept_tangent_is_the_mean_over_the_stretch():
    shape = DirectSimulator(STIFF).solve(START)
    along = np.array([1.0, -0.2, 0.1])
    keep = KeepTangent(0.3, 0.6, along, 3.0)
    off = [shape.at(s).direction - along / np.linalg.norm(along) for s in np.linspace(0.3, 0.6, 9)]
    assert np.sum(keep.residuals(shape)**2) == pytest.approx(9 * np.mean(np.sum(np.square(off), 1)))
    whole = KeepTangent(0.0, 0.0, START.direction)  # the gripper's own
    assert np.abs(whole.residuals(shape)).max() < 1e-12


@pytest.mark.parametrize(('wrong', 'said'), [
    (lambda: KeepTangent(0.5, 0.4, (1, 0, 0)), 'KeepTangent.end = 0.4'),
    (lambda: KeepTangent(-0.1, 0.4, (1, 0, 0)), 'KeepTangent.begin = -0.1'),
    (lambda: KeepTangent(0.1, 0.4, (0, 0, 0)), 'KeepTangent.direction'),
    (lambda: minimize_penalty(DirectSimulator(STIFF), KeepTangent(0.1, 1.2, (1, 0, 0)), START),
     'KeepTangent.end = 1.2')])
def test_a_stretch_that_is_none_is_named(wrong, said):
    with pytest.raises(InvalidTask, match=said):
        wrong()


def test_it_finds_what_threading_finds():
    hole = CutOut(Pose.looking_along((0.5, 0, 1), (1, 0.3, 0)))
    direct = DirectSimulator(STIFF)
    plan = InverseSimulator(direct).thread(hole, depths=[0.4])
    turn = Rotation.from_rotvec([0.05, -0.1, 0.08]).as_matrix()
    nearby = Pose.from_rotation(plan.grippers[0].position + [0.02, -0.03, 0.01],
                                turn @ plan.grippers[0].rotation)
    found = minimize_penalty(direct, [PositionAt(0.6, hole.center), DirectionAt(0.6, hole.normal)],
                             nearby)
    assert found.converged and found.penalty < 1e-18
    there = found.shape.at(0.6)
    np.testing.assert_allclose(there.position, hole.center, atol=1e-9)
    np.testing.assert_allclose(there.direction, hole.normal, atol=1e-9)


def test_a_users_function_and_an_object_agree():
    direct = DirectSimulator(STIFF)
    target = np.array([0.7, 0.1, 0.9])
    near = GripperNear(START, 0.05)
    one = minimize_penalty(direct, [PositionAt(1.0, target), near], START)
    other = minimize_penalty(direct, [lambda shape: shape.positions[-1] - target, near], START)
    np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, atol=1e-4)
    # the slopes of a function come from the sensitivities too, not from more equilibria
    assert other.iterations <= one.iterations + 1


def test_what_cannot_be_met_is_as_near_as_it_can_be():
    far = minimize_penalty(DirectSimulator(STIFF), [PositionAt(1.0, (0.5, 0, 0.5)),
                                                    PositionAt(0.9, (0.5, 0, 0.8))], START)
    apart = np.linalg.norm(far.shape.at(1.0).position - far.shape.at(0.9).position)
    assert apart == pytest.approx(0.1, abs=1e-3)  # as long as the DLO is, not 0.3
    assert far.penalty == pytest.approx(2 * (0.3 - apart) ** 2 / 4, rel=1e-3)


def test_through_two_points_and_away_from_a_third():
    points = (0.3, 0.05, 1.0), (0.55, 0.1, 0.9)
    ball = Sphere((0.75, 0.12, 0.75), 0.02)
    task = [*(Through(point, 0.05) for point in points), GripperNear(START, 1e-4)]
    near = minimize_penalty(DirectSimulator(STIFF), task, START)
    gap = clearance([ball], STIFF.radius, near.shape)
    found = minimize_penalty(DirectSimulator(STIFF), [*task, AwayFrom(
        [ball], gap + 0.02, STIFF.radius)], START)
    passages = [through.passage(found.shape) for through in task[:2]]
    assert 0.05 < passages[0] < passages[1] - 0.1  # one after the other, not one for both
    for point, passage in zip(points, passages, strict=True):
        assert np.linalg.norm(found.shape.at(passage).position - point) < 1e-6
        assert np.linalg.norm(found.shape.positions_at(np.linspace(0, 1, 4001))
                              - point, axis=1).min() < 2e-4
    assert clearance([ball], STIFF.radius, found.shape) > gap + 0.019


def test_a_single_number_counts_as_it_is():
    def height(shape):
        return -float(shape.at(0.5).position[2]) + 4 * np.sum(shape.gripper.position**2)

    here = DirectSimulator(STIFF)
    found = minimize_penalty(here, height, Pose((0, 0, 0), (0, 0, 0, 1)))
    assert found.converged and found.penalty < height(here.solve(Pose.identity())) - 0.1
    for step in 0.02 * np.vstack([np.eye(6), -np.eye(6)]):  # nothing near is better
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        there = Pose.from_rotation(found.gripper.position + step[3:],
                                   turn @ found.gripper.rotation)
        assert height(here.solve(there, found.shape)) >= found.penalty - 1e-9


def test_with_an_obstacle():
    direct = DirectSimulator(STIFF, obstacles=[Plane((0, 0, 0.7), (0, 0, 1))])
    found = minimize_penalty(direct, [PositionAt(1.0, (0.75, 0.1, 0.703)), GripperNear(
        START, 0.01)], START)
    assert found.shape.converged
    assert np.linalg.norm(found.shape.positions[-1] - (0.75, 0.1, 0.703)) < 1e-2
    assert all(contact.penetration < 1e-8 for contact in found.shape.contacts)


@pytest.mark.parametrize('weight', [1e-6, 1.0, 1e6])
def test_weights_are_only_weights(weight):
    direct = DirectSimulator(STIFF)
    there = direct.solve(START).positions[-1]
    for target in (there + 5e-13, there + [-0.2, 0.1, 0.0]):
        near = GripperNear(START, 0.05 * weight)
        one = minimize_penalty(direct, [PositionAt(1.0, target), GripperNear(START, 0.05)], START)
        other = minimize_penalty(direct, [PositionAt(1.0, target, weight), near], START)
        assert one.converged and other.converged
        np.testing.assert_allclose(other.gripper.matrix, one.gripper.matrix, atol=1e-6)
        assert other.penalty == pytest.approx(weight**2 * one.penalty, rel=1e-5,
                                              abs=weight**2 * 1e-24)

    def height(shape):
        return weight * (np.sum((shape.positions[-1] - there) ** 2) + 7.0)

    found = minimize_penalty(direct, height, Pose((0.1, 0, 1), (0, 0, 0, 1)))
    assert found.converged and found.penalty == pytest.approx(7 * weight, rel=1e-8)


def test_what_cannot_be_met_does_not_converge_half_way():
    found = minimize_penalty(DirectSimulator(STIFF), PositionAt(1.0, (0.5, 0.3, 0.8)), START,
                             max_iterations=2)
    assert not found.converged and found.penalty > 1e-6


def test_where_the_past_counts_the_answer_is_that_of_one_step():
    soft = Rod(1.0, 0.05, 0.05, 0.04, yield_curvature=2.0, hardening=0.2)
    direct = DirectSimulator(soft)
    found = minimize_penalty(direct, [PositionAt(1.0, (0.6, 0.1, 0.6)), GripperNear(START, 0.05)],
                             START)
    again = direct.solve(found.gripper, direct.solve(START))
    assert found.converged and again.dissipated > 0
    np.testing.assert_allclose(found.shape.positions, again.positions, atol=1e-9)


def standing(seed):
    """Return a simulator of a soft DLO, penalties of its tip, and a start that points up."""
    rng = np.random.default_rng(seed)
    stiffness = 9.81 * 0.1 / rng.uniform(3, 20)
    start = Pose.looking_along((0, 0, 0), (*rng.normal(0, 0.3, 2), 1.0))
    return (DirectSimulator(Rod(1.0, 0.1, stiffness, 0.75 * stiffness)),
            [PositionAt(1.0, rng.uniform(-0.6, 0.6, 3)), GripperNear(start, 0.3)], start)


def test_what_hardly_stands_is_not_converged():
    turned = Rotation.from_rotvec([0.7e-5, -0.7e-5, 0.0]).as_matrix()
    converged, fallen = 0, 0
    # at the edge of what is stable slopes are so large that any seems flat: 0 falls, 19 may stand
    for seed in (0, 1, 2, 3, 4, 5, 19):
        direct, penalties, start = standing(seed)
        found = minimize_penalty(direct, penalties, start, max_iterations=100)
        converged, fallen = converged + found.converged, fallen + (found.shape.stability < 1e-4)
        if found.converged:
            assert found.shape.stability >= STABILITY
            aside = Pose.from_rotation(found.gripper.position, turned @ found.gripper.rotation)
            moved = direct.solve(aside, found.shape).positions - found.shape.positions
            assert np.abs(moved).max() < 0.05
    assert converged > 3 and fallen > 1


def test_a_plan_stands_as_well_as_is_required():
    for seed in range(19, 40):  # the first of which hardly stands
        direct, penalties, start = standing(seed)
        try:
            least_stable = InverseSimulator(direct).plan(
                Minimize(penalties, 100), start=start, requirements=Requirements(stability=0.0))
        except (NotConverged, Infeasible):
            continue
        stability = least_stable.stability.min()
        if stability < 1e-4:
            break
    for requirements in (None, Requirements(stability=0.02)):
        with pytest.raises(Infeasible, match='hardly stay') as refused:
            InverseSimulator(direct).plan(Minimize(penalties, 100), start=start,
                                          requirements=requirements)
        least = STABILITY if requirements is None else 0.02
        assert refused.value.constraint == 'stability'
        assert refused.value.amount == pytest.approx(least - stability, rel=1e-3)
    with pytest.raises(InvalidTask, match=r'Requirements\.stability'):
        Requirements(stability=-1.0)


@pytest.mark.parametrize('stability', [0.9 * STABILITY, -1e-8, np.nan])
def test_no_waypoint_is_less_stable_than_the_margin(stability):
    shape = DirectSimulator(STIFF, n_elements=32).solve(START)
    demands = PlanChecker((1.0, 1.0), stability=Requirements().stability)
    assert demands.violation(Waypoint(replace(shape, stability=1.1 * STABILITY))) is None
    broken = demands.violation(Waypoint(replace(shape, stability=stability)))
    assert broken.name == 'stability' and '0.0003 is required' in broken.message


def test_a_least_penalty_keeps_the_workspace():
    direct, wanted = DirectSimulator(STIFF, n_elements=32), [PositionAt(1.0, (0.7, 0.1, 0.8))]
    place = InverseSimulator(direct).minimize_penalty(wanted, START).gripper.position
    room = Workspace(upper=place + (1.0, 1.0, -0.01))
    with pytest.raises(Infeasible) as refused:
        InverseSimulator(direct, workspace=room).minimize_penalty(wanted, START)
    assert refused.value.constraint == 'workspace.upper.z'
    assert refused.value.amount == pytest.approx(0.01)


def test_a_search_that_gave_up_is_no_plan():
    inverse = InverseSimulator(DirectSimulator(STIFF, n_elements=32))
    wanted = [PositionAt(1.0, (0.7, 0.1, 0.8)), GripperNear(START, 0.1)]
    assert len(inverse.plan(Minimize(wanted), start=START)) == 1
    with pytest.raises(NotConverged, match='the search ended with a slope of'):
        inverse.plan(Minimize(wanted, max_iterations=2), start=START)


def test_every_task_asks_for_the_same_stability():
    stiffness = 9.81 * 0.1 / 7.0
    soft = InverseSimulator(DirectSimulator(Rod(1.0, 0.1, stiffness, 0.75 * stiffness)))
    up = CutOut(Pose.looking_along((0, 0, 1), (0.5, 0, 1)))
    plan = soft.thread(up, depths=[0, 0.1])
    least = plan.stability.min()
    assert 0 < least < 1
    with pytest.raises(Infeasible) as refused:
        soft.plan(Thread(up, depths=[0, 0.1]),
                  requirements=Requirements(stability=min(1.0, 1.5 * least)))
    assert refused.value.constraint in ('stability', 'start')


def test_progress_and_deadline():
    calls = []
    found = minimize_penalty(DirectSimulator(STIFF), ANY, START,
                             progress=lambda *step: calls.append(step), max_iterations=50)
    assert calls == [(k + 1, 50) for k in range(found.iterations)]
    inverse = InverseSimulator(DirectSimulator(STIFF))
    with pytest.raises(DeadlineExceeded, match='deadline'):
        inverse.minimize_penalty(ANY, START, deadline=1e-9)


@pytest.mark.parametrize(('penalty', 'named'), [
    (lambda: PositionAt(1.5, (0, 0, 0)), r'PositionAt.s = 1.5'),
    (list, 'penalties'), (tuple, 'penalties'),
    (lambda: DirectionAt(-0.1, (1, 0, 0)), r'DirectionAt.s = -0.1'),
    (lambda: [*ANY, PositionAt(np.nan, (0, 0, 0))], 'PositionAt.s'),
    (lambda: Through((0, 0, 0), 1.2), 'Through.after')])
def test_places_beyond_the_ends_are_named(penalty, named):
    with pytest.raises(InvalidTask, match=named):
        minimize_penalty(DirectSimulator(STIFF), penalty(), START)


def test_what_is_not_taken_into_account_is_refused():
    direct = DirectSimulator(STIFF)
    held = direct.solve(START, far_end=Pose((0.9, 0, 1), (0, 0, 0, 1)))
    for search in (minimize_penalty, lambda simulator, *task, **more:
                   InverseSimulator(simulator).minimize_penalty(*task, **more)):
        with pytest.raises(InvalidTask, match='initial is held at its far end'):
            search(direct, ANY, START, initial=held)
    paper = DirectSimulator(STIFF, method='dfp', strains='paper')
    with pytest.raises(InvalidTask, match='strains'):
        minimize_penalty(paper, ANY, START)


def test_nonsense_is_named():
    direct = DirectSimulator(STIFF)
    with pytest.raises(InvalidTask, match='finite'):
        minimize_penalty(direct, lambda shape: np.nan, START)
    blocked = DirectSimulator(STIFF, obstacles=[Plane((0, 0, 1.2), (0, 0, 1))])
    with pytest.raises(NotConverged, match='start'):
        minimize_penalty(blocked, ANY, START)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('after', [0.0, 0.45, 0.7123, 0.999])
def test_only_what_comes_after_counts(after, basis, rng):
    # the DLO is nearest to the point at 0.4 m or so: beyond `after` the nearest is where it begins
    shape = DirectSimulator(STIFF, basis=basis).solve(START)
    point = shape.at(0.4).position + [0, 0.1, 0.02]
    task = Through(point, after)
    s = np.linspace(after, 1, 2001)
    away = np.linalg.norm(shape.positions_at(s) - point, axis=1)
    assert task.passage(shape) == pytest.approx(s[np.argmin(away)], abs=5e-4)
    found = np.linalg.norm(task.residuals(shape))
    assert away.min() - 1e-6 < found < away.min() + 1e-12
    search = PenaltyFunction(DirectSimulator(STIFF, basis=basis), [task], START, None)
    x, step = 0.01 * rng.normal(size=6), 1e-6
    slopes = search.jacobian(x)
    for k, change in enumerate(step * np.eye(6)):
        wanted = (search.residuals(x + change) - search.residuals(x - change)) / (2 * step)
        np.testing.assert_allclose(slopes[:, k], wanted, atol=1e-6)


SIZES = {'round': {'radius': 0.03}, 'wide': {'width': 0.08, 'height': 0.05}}


@pytest.mark.parametrize('off', [0.008, 0.07], ids=['in the hole', 'beside it'])
@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('thickness', [0.0, 0.02])
def test_slopes_in_a_hole_against_differences(thickness, size, off, rng):
    # within the hole the nearest point is at an edge, beside it where the DLO meets a face
    shape = DirectSimulator(STIFF).solve(START)
    for _ in range(3):
        axes, place = shape.frame_at(rng.uniform(0.4, 0.8))
        aside = off * (axes[:, 1] + 0.6 * axes[:, 2])
        hole = CutOut(Pose.looking_along(place + aside, axes[:, 0] + 0.4 * rng.normal(size=3)),
                      **SIZES[size])
        search = PenaltyFunction(DirectSimulator(STIFF), [InHole(hole, 0.1, 0.003, thickness, 2)],
                                 START, None)
        x, step = np.zeros(6), 1e-6
        assert (search.residuals(x)[0] > 0.2) == (off > 0.03)  # twice the distance: in the sheet
        slopes = search.jacobian(x)
        assert np.abs(slopes).max() > 0.1
        for k, change in enumerate(step * np.eye(6)):
            wanted = (search.residuals(x + change) - search.residuals(x - change)) / (2 * step)
            np.testing.assert_allclose(slopes[:, k], wanted, atol=2e-5)


@pytest.mark.parametrize('thickness', [0.0, 0.01])
def test_clearance_in_a_hole_is_that_of_samples(thickness, rng):
    shape = DirectSimulator(STIFF).solve(START)
    passed = 0
    for _ in range(20):
        axes, place = shape.frame_at(rng.uniform(0.3, 0.9))
        hole = CutOut(Pose.looking_along(place + 0.02 * rng.normal(size=3),
                                         axes[:, 0] + 0.4 * rng.normal(size=3)), radius=0.04)
        away = shape.positions_at(np.linspace(0, 1, 20001)) - hole.center
        height = away @ hole.normal
        room = 0.04 - np.sqrt((away**2).sum(axis=1) - height**2)  # to the wall of the hole
        outside = np.maximum(abs(height) - thickness / 2, 0)
        wanted = np.hypot(outside, np.maximum(room, 0))
        wanted = np.where((outside == 0) & (room < 0), room, wanted)
        faces = [room[np.argmin(abs(height - side * thickness / 2))] for side in (-1, 1)]
        wanted = min(wanted.min(), *faces) - 0.003
        passed += wanted > 0
        found = 1 - InHole(hole, 1.0, 0.003, thickness).residuals(shape)[0]
        assert found == pytest.approx(wanted, abs=1e-4)
    assert 4 < passed < 18


def test_a_dlo_beside_a_hole_is_drawn_into_it():
    direct = DirectSimulator(STIFF)
    there = direct.solve(START).at(0.7)
    hole = CutOut(Pose.looking_along(there.position + (0, 0.06, 0.02), (1, 0.3, -0.5)),
                  radius=0.02)
    task = InHole(hole, 0.008, 0.003)
    assert task.residuals(direct.solve(START))[0] > 0.04
    found = minimize_penalty(direct, [task, GripperNear(START, 1e-4)], START)
    off = found.shape.positions_at(np.linspace(0.5, 1, 20001)) - hole.center
    passes = np.abs(off @ hole.normal).argmin()
    assert np.linalg.norm(off[passes]) < 0.02 - 0.003 - 0.0079  # tilted, it has less than that
    assert hole_clearances(Sheet.around(hole, thickness=0), hole.normal, 0.003,
                           found.shape).min() == pytest.approx(0.008, abs=1e-4)


def test_a_hole_without_a_size_is_named():
    with pytest.raises(InvalidTask, match='InHole.cutout'):
        InHole(CutOut(START), 0.01)


def test_what_is_kept_costs_nothing_and_pulls_nowhere():
    shape = DirectSimulator(STIFF).solve(START)
    answer = Sensitivity(shape)
    gap = clearance([SPHERE], 0.003, shape)
    for distance, active in ((gap - 1e-3, False), (gap + 1e-3, True)):
        away = AwayFrom([SPHERE], distance, 0.003)
        np.testing.assert_allclose(away.residuals(shape), max(distance - gap, 0), atol=1e-9)
        assert away.slopes(shape, answer).any() == active
    bends = 1 / shape.bend_radius
    limit = 0.5 * (bends.max() + bends.min())
    task = BentAtMost(limit)
    over = bends > limit
    assert 0 < over.sum() < len(bends)
    assert ((task.residuals(shape) > 0) == over).all()
    assert (task.slopes(shape, answer).any(axis=1) == over).all()
    assert np.sum(task.residuals(shape) ** 2) == pytest.approx(
        np.mean(np.maximum(bends - limit, 0) ** 2))
