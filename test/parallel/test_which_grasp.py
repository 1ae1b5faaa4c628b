# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where to hold a DLO for a task: a map, beside plans made one by one."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context

import numpy as np
import pytest

from benchmarks.plugs import DEPTHS, FAR_END, PLUG, ROD
from dlo_planner import (
    CutOut,
    DirectSimulator,
    FarEnd,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Thread,
)
from dlo_planner.parallel import GraspMap, which_grasp
from dlo_planner.tasks import InsertPlug, MoveTo

WIRE = Rod.circular(1.0, 3e-3, 8960, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.02)
TASK = InsertPlug(Pose.looking_along((0.2, 0.2, 0.05), (0, -1, 0)), PLUG, DEPTHS[:2],
                  max_force=1.0)
UP = Pose.looking_along((-0.02, 0, 0), (0, 0, 1))
ENDS = FAR_END, FarEnd(Pose.looking_along((0, 0, 0), (0, -1, 0)), 'pinned'), FarEnd(
    Pose.looking_along((0.2, 0.9, 0), (0, 1, 0)))
CABLE = InverseSimulator(DirectSimulator(ROD, n_elements=24, basis='local'))


@cache
def of_plug():
    """Return the map of two ways in which a plug sits in the hand, and three far ends."""
    return which_grasp(CABLE, TASK, (PLUG.grasp, UP), ENDS)


def test_each_cell_is_what_its_plan_says():
    found, outcomes = of_plug(), set()
    for g, grasp in enumerate((PLUG.grasp, UP)):
        for f, end in enumerate(ENDS):
            task = replace(TASK, plug=replace(PLUG, grasp=grasp), far_end=end)
            try:
                plan = CABLE.plan(task)
            except Infeasible as refused:
                assert found.outcome[g, f] == refused.constraint
                assert found.amount[g, f] == pytest.approx(refused.amount, rel=1e-9)
                assert np.isnan(found.margin[g, f])
                outcomes.add(refused.constraint)
                continue
            outcomes.add('planned')
            assert found.outcome[g, f] == 'planned'
            assert found.force[g, f] == pytest.approx(plan.largest_force.max())
            assert found.margin[g, f] == pytest.approx(min(
                plan.stability.min(), 1 - plan.largest_force.max() / 1.0))
    assert {'planned', 'equilibrium'} <= outcomes


def test_the_best_has_the_most_margin():
    found = of_plug()
    assert found.margin[found.best] == np.nanmax(found.margin)
    assert f'grasps[{found.best[0]}], far_ends[{found.best[1]}]' in repr(found)
    assert 'best grasp' in found.summary() and 'equilibrium' in found.summary()
    none = which_grasp(CABLE, TASK, (UP,), ENDS[2:])
    assert none.best is None and not none.planned.any()


def test_a_dlo_is_held_inside_where_it_has_the_most_margin():
    inverse = InverseSimulator(DirectSimulator(WIRE, n_elements=24, basis='local'))
    places, depths = (0.0, 0.3, 0.5, 0.8), (0.0, 0.2, 0.3)
    found = which_grasp(inverse, Thread(HOLE, depths), places)
    assert found.outcome.ravel().tolist() == ['planned'] * 3 + ['invalid']
    held = inverse.plan(Thread(HOLE, depths, hold_at=0.3))
    assert found.stability[1, 0] == pytest.approx(held.stability.min(), rel=1e-9)
    assert found.clearance[1, 0] == pytest.approx(held.clearance.min(), rel=1e-9)
    assert found.best == (2, 0)


def test_a_map_is_kept_and_goes_on(tmp_path):
    found, done = of_plug(), []
    which_grasp(CABLE, TASK, (PLUG.grasp, UP), ENDS, folder=tmp_path, chunk=1)
    (tmp_path / 'part-0000002.npz').unlink()
    again = which_grasp(CABLE, TASK, (PLUG.grasp, UP), ENDS, folder=tmp_path, chunk=1,
                        progress=lambda now, total: done.append((now, total)))
    assert done == [(6, 6)] and again == found
    with pytest.raises(InvalidTask, match='folder'):
        which_grasp(CABLE, TASK, (UP,), ENDS, folder=tmp_path, chunk=1)
    found.save(tmp_path / 'map.json')
    assert GraspMap.load(tmp_path / 'map.json') == found


@pytest.mark.sweep
def test_other_processes_find_the_same():
    with ProcessPoolExecutor(2, mp_context=get_context('spawn')) as pool:
        assert which_grasp(CABLE, TASK, (PLUG.grasp, UP), ENDS, pool, chunk=2) == of_plug()


def test_what_cannot_be_held_so_is_refused():
    move = MoveTo([Pose((0, 0, 1), (0, 0, 0, 1))])
    for task, grasps, ends, word in (
            (move, (0.1,), None, 'which has no hold_at'), (move, (UP,), None, 'for an InsertPlug'),
            (Thread(HOLE), (0.0,), ENDS, 'which has no far_end'),
            (Thread(HOLE), (0.0, UP), None, 'expected numbers, m, or Poses'),
            (Thread(HOLE), (0.0, 0.5), None, r'grasps\[1\] = 0.5: expected .* 0.5'),
            (Thread(HOLE), (0.0,) * 20_000, None, 'at most 10000'),
            (Thread(HOLE), (), None, 'grasps')):
        with pytest.raises(InvalidTask, match=word):
            which_grasp(CABLE, task, grasps, ends)


def test_it_is_drawn():
    pytest.importorskip('matplotlib')
    axes = of_plug().plot().axes[0]
    refused = int((~of_plug().planned).sum())
    assert [text.get_text() for text in axes.texts] == ['equilibrium'] * refused
    assert axes.lines[0].get_xydata().tolist() == [list(of_plug().best[::-1])]
    with pytest.raises(InvalidTask, match='color'):
        of_plug().plot(color='red')
