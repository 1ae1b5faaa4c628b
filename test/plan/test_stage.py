# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Stages of a plan: what holds the DLO in each, what moves, their figures, joined and in files."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    FarEnd,
    Hold,
    Insert,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
)
from dlo_planner.model.holds import BORE
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import PlanStatus, concatenate, truncate
from dlo_planner.plan.stage import arm_of, moving
from dlo_planner.tasks import MoveTo

ROD = Rod(1.0, 0.05, 0.1, 0.08, radius=2e-3)
INVERSE = InverseSimulator(DirectSimulator(ROD, basis='local', n_elements=32))
START = Pose((0.0, 0.0, 0.0), (0, 0, 0, 1))
THERE = Pose((0.1, 0.05, 0.1), (0, 0, 0, 1))
HELD = FarEnd(Pose((0.75, 0.1, -0.05), (0, 0, 0, 1)))
MOVED = Pose((0.85, 0.0, 0.05), (0, 0, 0, 1))


@cache
def moved_plan(by='fixture'):
    """Return the Plan of a DLO whose far end moves, too."""
    simulator = INVERSE.simulator
    grippers = [START, Pose((0.05, 0.025, 0.05), (0, 0, 0, 1)), THERE]
    ends = [(0.75, 0.1, -0.05), (0.8, 0.05, 0.0), (0.85, 0.0, 0.05)]
    holds = [Hold(Pose((0.3, 0.0, -0.1), (0, 0, 0, 1)), 'pinned', 0.35)]
    shapes = simulator.track(grippers, holds=[
        [*holds, Hold(Pose(end, (0, 0, 0, 1)), by=by)] for end in ends])
    n = len(grippers)
    return Plan(np.zeros(n), grippers, shapes, np.zeros(n), np.zeros(n), np.arange(3.0),
                ((),) * n, np.zeros((n, 0, 3)), (), 1.0, PlanStatus.COMPLETE)


@cache
def inserted():
    """Return the Plan of an insertion."""
    hole = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.01)
    return INVERSE.plan(Insert(hole, depths=(0.0, 0.1, 0.2)))


def test_a_stage_says_what_moves_and_what_stands_still():
    plan = moved_plan('left arm')
    stage, = plan.stages
    assert (stage.name, len(stage), stage.first) == ('held by hold at 0.35 m, left arm', 3, 0)
    assert list(stage.arms) == ['left arm'] and stage.arms['left arm'][2] == MOVED
    assert [hold.s for hold in stage.resting] == [0.35]
    assert stage.grippers == plan.grippers
    assert [pose.position[0] for pose in plan.far_end_poses] == [0.75, 0.8, 0.85]
    assert [len(poses) for poses in plan.hold_poses] == [2, 2, 2]
    still, = INVERSE.plan(MoveTo([THERE], HELD), start=START).stages
    assert still.arms == {} and still.resting == (HELD,)


def test_all_arms_go_by_one_parameter_and_stop_together():
    plan = moved_plan()
    assert set(plan.paths) == {'gripper', 'far_end'}
    path, end = plan.paths.values()
    assert [leg.knots.tolist() for leg in path.legs] == [leg.knots.tolist() for leg in end.legs]
    for k, u in enumerate(plan.times):
        position, rotation = end.at(u)
        np.testing.assert_allclose(position[0], plan.far_end_poses[k].position, atol=1e-15)
        np.testing.assert_allclose(rotation[0], plan.far_end_poses[k].rotation, atol=1e-15)
    with pytest.raises(InvalidTask, match="name = 'left': expected one of"):
        path.arm('left')


def test_all_arms_stop_where_one_of_them_begins_or_turns():
    times = np.arange(5.0)
    grippers = [Pose((0.1 * u, 0.0, 0.0), (0, 0, 0, 1)) for u in times]

    def legs(ends):
        arms = {'far_end': [Pose((0.7, *place), (0, 0, 0, 1)) for place in ends]}
        return [leg.knots.tolist() for leg in GripperPath.through(
            grippers, times, 1.0, arms=arms).legs]

    straight = [(0.05 * u, 0.0) for u in times]
    assert legs(straight) == [[0, 1, 2, 3, 4]]
    assert legs([(0.0, 0.0), *straight[:-1]]) == [[0, 1], [1, 2, 3, 4]]
    assert legs([*straight[:3], *[straight[2]] * 2]) == [[0, 1, 2], [2, 3, 4]]
    assert legs([*straight[:3], straight[1], straight[0]]) == [[0, 1, 2], [2, 3, 4]]


def test_the_wrenches_of_all_grips_carry_the_weight():
    plan = moved_plan()
    assert plan.wrenches.shape == (3, 3, 6)
    total = plan.wrenches[:, :, :3].sum(axis=1)
    np.testing.assert_allclose(total, [[0, 0, 0.05 * 9.81]] * 3, atol=1e-8)
    np.testing.assert_array_equal(
        plan.largest_force, np.linalg.norm(plan.wrenches[:, :, :3], axis=2).max(axis=1))
    assert plan.stages[0].metric('largest_force').tolist() == plan.largest_force.tolist()
    with pytest.raises(InvalidTask, match="name = 'speed': expected one of position_error"):
        plan.stages[0].metric('speed')


def test_a_hand_is_fed_with_the_wrenches_between_waypoints():
    plan = moved_plan()
    middle = 0.5 * (plan.times[0] + plan.times[1])
    fed = plan.gripper_wrench_at([plan.times[0] - 1.0, middle, plan.times[2], plan.times[-1] + 1.0])
    own = [shape.gripper_wrench for shape in plan.shapes]
    np.testing.assert_allclose(fed, [own[0], 0.5 * (own[0] + own[1]), own[2], own[-1]], atol=1e-12)
    with pytest.raises(InvalidTask, match='times'):
        plan.gripper_wrench_at([np.nan])


def test_where_something_else_holds_another_stage_begins():
    plan = inserted()
    assert [(stage.name, stage.first, len(stage)) for stage in plan.stages] == [
        ('free', 0, 1), ('held by bore', 1, 2)]
    assert plan.shapes[1].holds[0].by == BORE and plan.arms == {}
    # there is no wrench of a bore where it does not hold
    assert np.isnan(plan.wrenches[0, 1]).all() and np.isfinite(plan.wrenches[1:]).all()
    with pytest.raises(InvalidTask, match='expected a stage to begin at waypoint 1'):
        replace(plan, starts=(('all of it', 0),))
    with pytest.raises(InvalidTask, match='expected the first waypoint of each'):
        replace(plan, starts=(('late', 1),))
    assert [one.name for one in truncate(plan, 1, PlanStatus.PARTIAL).stages] == ['free']


def test_plans_are_joined_stage_by_stage():
    there = replace(INVERSE.plan(MoveTo([THERE], HELD), start=START), starts=(('there', 0),))
    back = replace(INVERSE.plan(MoveTo([START], HELD), start=THERE, initial=there.shapes[-1]),
                   starts=(('back', 0), ('last', 1)))
    whole = concatenate(there, back)
    n = len(there)
    assert whole.starts == (('there', 0), ('last', n))  # the only waypoint of 'back' was there
    assert concatenate(there, replace(back, starts=(('back', 0),))).starts == (
        ('there', 0), ('back', n))
    nameless = [replace(one, starts=()) for one in (there, back)]
    assert concatenate(*nameless).starts == ()
    elsewhere = INVERSE.plan(MoveTo([START], FarEnd(MOVED)), start=THERE)
    with pytest.raises(InvalidTask, match='other begins with .* expected it where one ends'):
        concatenate(there, elsewhere)
    with pytest.raises(InvalidTask, match='other begins held by .* expected what one ends'):
        concatenate(there, INVERSE.plan(MoveTo([START]), start=THERE))


def test_files_keep_stages_and_those_of_before_are_read(tmp_path):
    named = replace(moved_plan('left arm'), starts=(('up', 0), ('on', 2)))
    for name in ('plan.npz', 'plan.json'):
        named.save(tmp_path / name)
        again = Plan.load(tmp_path / name)
        assert again.starts == named.starts and again.arms == named.arms
        np.testing.assert_array_equal(again.wrenches, named.wrenches)


def test_an_arm_has_one_name_and_holds_all_the_time():
    plan = moved_plan()
    assert [arm_of(hold) for hold in plan.shapes[0].holds] == ['hold at 0.35 m', 'far_end']
    # one that moves and then lets go has no path
    let_go = INVERSE.simulator.track([THERE], initial=plan.shapes[1])
    gone = replace(plan, shapes=(*plan.shapes[:2], *let_go))
    with pytest.raises(InvalidTask, match="the hold by 'far_end' moves: expected exactly one"):
        moving(gone.shapes)
    # two clips of one name that stand still are none that moves; one of them may not
    clips = [Hold(Pose((x, 0.0, -0.1), (0, 0, 0, 1)), 'pinned', s, by='clip')
             for x, s in ((0.3, 0.35), (0.5, 0.6))]
    still = INVERSE.simulator.track([START, THERE], holds=clips)
    assert moving(still) == {}
    led = [clips[0], Hold(Pose((0.5, 0.05, -0.1), (0, 0, 0, 1)), 'pinned', 0.6, by='clip')]
    moved = INVERSE.simulator.track([START, START], holds=[clips, led])
    with pytest.raises(InvalidTask, match="the hold by 'clip' moves: expected exactly one"):
        moving(moved)
