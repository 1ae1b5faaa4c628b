# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The deepest that a threading comes; waypoints one by one; plans in files."""

import json

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
    Trajectory,
    Workspace,
)
from dlo_planner.tasks import concatenate

WIRE = Rod.circular(1.0, 2e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
DEPTHS = np.linspace(0, 0.9, 10)


def planner(farthest):
    return InverseSimulator(DirectSimulator(WIRE), workspace=Workspace(
        upper=(farthest, np.inf, np.inf)))


def test_it_comes_as_deep_as_its_gripper_may():
    inverse = planner(-0.33)
    with pytest.raises(Infeasible) as refused:
        inverse.thread(HOLE, depths=DEPTHS)
    plan = inverse.thread(HOLE, depths=DEPTHS, as_deep_as_possible=True)
    known = len(refused.value.plan)
    np.testing.assert_array_equal(plan.depths[:known], DEPTHS[:known])
    assert DEPTHS[known - 1] < plan.depths[-1] < DEPTHS[known]
    # a straight gripper's way: what is missing is less than the halved steps
    assert -0.33 - 0.1 / 2**5 < plan.grippers[-1].position[0] <= -0.33
    assert plan.fraction == pytest.approx(plan.depths[-1] / DEPTHS[-1])


def test_all_depths_are_the_same_plan_and_none_is_refused():
    free = planner(np.inf)
    plan = free.thread(HOLE, depths=DEPTHS, as_deep_as_possible=True)
    assert plan == free.thread(HOLE, depths=DEPTHS) and plan.fraction == 1
    with pytest.raises(Infeasible):
        planner(-1.5).thread(HOLE, depths=DEPTHS, as_deep_as_possible=True)


def test_waypoints_one_by_one():
    plan = planner(np.inf).thread(HOLE, depths=DEPTHS)
    points = list(plan)
    assert len(points) == len(plan) and plan[-1] == points[-1] and plan[2:4] == tuple(points[2:4])
    for k, point in enumerate(points):
        assert point.depth == DEPTHS[k] and point.gripper == plan.grippers[k]
        assert point.time == plan.times[k] and point.shape is plan.shapes[k]
        assert point.clearance == plan.clearance[k]
        assert point.position_error == plan.position_error[k]
    with pytest.raises(IndexError):
        plan[len(plan)]


@pytest.mark.every(2)
@pytest.mark.parametrize('name', ['plan.npz', 'plan.json'])
def test_a_plan_in_a_file(tmp_path, name):
    inverse = planner(np.inf)
    plan = inverse.thread(HOLE, depths=DEPTHS)
    whole = concatenate(inverse.approach(HOLE, plan, Pose((-1.2, 0, 1), (0, 0, 0, 1)),
                                         standoff=0.05), plan)
    for made in (plan, whole):
        made.save(tmp_path / name)
        again = Plan.load(tmp_path / name)
        for what in ('depths', 'times', 'position_error', 'misalignment', 'clearances'):
            np.testing.assert_array_equal(getattr(again, what), getattr(made, what))
        assert again.stops == made.stops and again.status is made.status
        assert again.sheets[0][0] == made.sheets[0][0] and again.fraction == made.fraction
        assert [len(one) for one in again.via_points] == [len(one) for one in made.via_points]
        for one, other in zip(again, made, strict=True):
            np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, atol=1e-14)
            np.testing.assert_array_equal(one.shape.positions, other.shape.positions)
    direct = DirectSimulator(WIRE)
    known, stored = (Trajectory(one, tolerance=2e-3, simulator=direct) for one in (whole, again))
    assert stored.duration == pytest.approx(known.duration, rel=1e-6)
    with pytest.raises(InvalidTask, match='simulator'):
        Trajectory(again)
    (tmp_path / name).write_bytes(b'no plan')
    with pytest.raises(InvalidTask, match=f'path = .*{name}'):
        Plan.load(tmp_path / name)


def test_both_kinds_of_files_say_the_same(tmp_path):
    inverse = planner(np.inf)
    bore = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    for made in (inverse.thread(HOLE, depths=DEPTHS), inverse.insert(bore, depths=DEPTHS[:4])):
        loaded = []
        for name in ('plan.npz', 'plan.json'):
            made.save(tmp_path / name)
            loaded.append(Plan.load(tmp_path / name))
        assert loaded[0] == loaded[1]
        loaded[1].save(tmp_path / 'again.JSON')
        assert (tmp_path / 'again.JSON').read_bytes() == (tmp_path / 'plan.json').read_bytes()


@pytest.mark.parametrize(('name', 'odd'), [
    ('format', {'type': 'int', 'shape': [], 'data': [99]}),
    ('format', {'type': 'int', 'shape': [], 'data': [True]}), ('depths', None), ('depths', [0.0]),
    ('depths', {'type': 'object', 'shape': [], 'data': [{}]}),
    ('depths', {'type': 'float', 'shape': [10], 'data': ['1'] * 10}),
    ('depths', {'type': 'float', 'shape': [10**9, 10**9], 'data': [1.0]}),
    ('times', {'type': 'float', 'shape': [1], 'data': [0.0]}),
    ('status', {'type': 'str', 'shape': [], 'data': ['done']}),
    ('sheets', {'type': 'str', 'shape': [], 'data': ['[3]']}),
    ('passes', {'type': 'float', 'shape': [1, 8], 'data': [99.0] * 8})])
def test_odd_files_are_refused_by_their_name(tmp_path, name, odd):
    plan = planner(np.inf).thread(HOLE, depths=DEPTHS)
    plan.save(tmp_path / 'plan.json')
    known = json.loads((tmp_path / 'plan.json').read_text())
    known[name] = odd
    (tmp_path / 'plan.json').write_text(json.dumps(known))
    with pytest.raises(InvalidTask, match=r'path = .*plan\.json'):
        Plan.load(tmp_path / 'plan.json')
    for content in ('[' * 100_000, '[1]', '{"format": 1}', '', '\x00'):
        (tmp_path / 'plan.json').write_text(content)
        with pytest.raises(InvalidTask, match=r'path = .*plan\.json'):
            Plan.load(tmp_path / 'plan.json')


def test_where_an_arc_length_stands_in_the_hole():
    inverse = planner(np.inf)
    plan = inverse.thread(HOLE, depths=DEPTHS)
    way = concatenate(inverse.approach(HOLE, plan, Pose((-1.2, 0, 1), (0, 0, 0, 1)),
                                         standoff=0.05), plan)
    np.testing.assert_allclose(plan.arc_lengths, 1 - DEPTHS)
    assert np.isnan(way.arc_lengths[:-len(plan) + 1]).sum() > 2
    direct = inverse.simulator
    for s in (1.0, 0.8, 0.73, 0.45, 0.1):
        gripper = plan.at_arc_length(s)
        shape = direct.solve(gripper, plan.shapes[np.argmin(np.abs(plan.arc_lengths - s))])
        assert np.linalg.norm(shape.at(s).position - HOLE.center) < 2e-3
        if s <= way.arc_lengths[-len(plan) + 1]:  # a joined plan passes from its second waypoint on
            np.testing.assert_allclose(way.at_arc_length(s).matrix, gripper.matrix, atol=1e-3)
    exact = inverse.thread(HOLE, depths=[0.2, 0.27]).grippers[1]
    assert np.linalg.norm(plan.at_arc_length(0.73).position - exact.position) < 1e-3
    for s in (0.05, 1.01):
        with pytest.raises(InvalidTask, match='0.1 to 1 m'):
            plan.at_arc_length(s)


def test_each_waypoint_has_goals_whose_residuals_are_its_misses():
    inverse = planner(np.inf)
    plan = inverse.thread(HOLE, depths=DEPTHS[:3])
    way = inverse.approach(HOLE, plan, Pose.looking_along((-1.5, 0, 1), (1, 0, 0)), standoff=0.05)
    whole = concatenate(way, plan)
    assert [[type(goal).__name__ for goal in goals] for goals in whole.goals] == (
        [['FrameAt']] * len(way) + [['PositionAt', 'DirectionAt']] * 2)
    aside = [shape.moved((0.0, 3e-3, 0.0)) for shape in whole.shapes]
    for goals, shape, moved in zip(whole.goals, whole.shapes, aside, strict=True):
        assert all(np.linalg.norm(goal.residuals(shape)) < 1e-9 for goal in goals)
        assert np.linalg.norm(goals[0].residuals(moved)) == pytest.approx(3e-3)
