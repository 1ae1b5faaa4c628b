# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks as values: planned, pickled, written and read again, done by a pool, one's own too."""

import json
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    HoldContact,
    Infeasible,
    Insert,
    InvalidTask,
    InverseSimulator,
    Limits,
    Minimize,
    Plan,
    Pose,
    Rod,
    SlideContact,
    Sphere,
    Thread,
    ThreadSequence,
    ThreadTwo,
    Workspace,
)
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks.thread_sequence import threading_of
from dlo_planner.model.value import put
from dlo_planner.penalties import DirectionAt, PositionAt
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.settings.tasks import (
    close_task,
    open_task,
    read_task,
    task_from_yaml,
    task_to_yaml,
    write_task,
)
from dlo_planner.tasks import Approach, Requirements

DEPTHS = (0.0, 0.1, 0.25)
BACK = Pose((-1.3, 0, 1), (0, 0, 0, 1))
WIRE = Rod(1.0, 0.02, 1.0, 0.7, radius=2e-3)
HOLE, SECOND, THIRD = (CutOut(Pose.looking_along((x, 0, 1.0 - 0.1 * x), (1, 0, -0.2)), radius=0.1)
                       for x in (0.4, 0.6, 0.75))
BALL = Sphere((0.5, 0, 0.4), 0.5)
CONTACT = Pose((0.5, 0, 0.9), (0, 0, 0, 1))
FREE = InverseSimulator(DirectSimulator(WIRE, n_elements=16, n_terms=8))
OVER_BALL = InverseSimulator(DirectSimulator(WIRE, n_elements=16, n_terms=8, obstacles=[BALL]))
FIRST = FREE.thread(HOLE, depths=DEPTHS).shapes[0]
TASKS = {
    'Thread': (FREE, Thread(HOLE, DEPTHS, gripper_clearance=0.01), None),
    'ThreadTwo': (FREE, ThreadTwo(HOLE, SECOND, DEPTHS), None),
    'ThreadSequence': (FREE, ThreadSequence((HOLE, SECOND, THIRD), (1, 2, 1), DEPTHS), None),
    'Insert': (FREE, Insert(HOLE, DEPTHS), None),
    'Approach': (FREE, Approach(HOLE, FIRST, 0.04), BACK),
    'HoldContact': (OVER_BALL, HoldContact(CONTACT, 0.5), None),
    'SlideContact': (OVER_BALL, SlideContact(CONTACT, [0.5, 0.52], 'least_energy'), None),
    'Minimize': (FREE, Minimize([PositionAt(1.0, (0.9, 0, 0.9)), DirectionAt(1.0, (1, 0, 0))]),
                 Pose((0, 0, 1), (0, 0, 0, 1)))}
KINDS = pytest.mark.parametrize('kind', TASKS)


@dataclass(frozen=True, eq=False, repr=False)
class LiftTo(Task):
    """One's own: the free end at heights, one after the other, the gripper level at x = 0."""

    heights: 'Heights'  # noqa: F821  a name that type checkers alone may know

    def __post_init__(self):
        put(self, heights=tuple(self.heights))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        builder = context.builder(np.zeros(len(self.heights)))
        hanging = context.without_obstacles.solve(Pose((0, 0, 0), (0, 0, 0, 1)))
        for height in self.heights:
            up = (0, 0, height - hanging.positions[-1, 2])
            builder.add(Waypoint(hanging.moved(up)))
        return builder.finished()


def planned(job):
    inverse, task, start = job
    return inverse.plan(task, start=start)


def same_plans(one, other):
    return all(a.gripper == b.gripper and np.array_equal(a.shape.positions, b.shape.positions)
               and a.time == b.time for a, b in zip(one, other, strict=True))


def test_shorthands_are_plans_of_tasks():
    pairs = {
        'Thread': FREE.thread(HOLE, depths=DEPTHS, gripper_clearance=0.01),
        'ThreadTwo': FREE.thread_two(HOLE, SECOND, depths=DEPTHS),
        'ThreadSequence': FREE.thread_sequence([HOLE, SECOND, THIRD], weights=(1, 2, 1),
                                               depths=DEPTHS),
        'Insert': FREE.insert(HOLE, depths=DEPTHS),
        'Approach': FREE.approach(HOLE, FREE.thread(HOLE, depths=DEPTHS), BACK, standoff=0.04),
        'HoldContact': OVER_BALL.hold_contact(CONTACT, 0.5),
        'SlideContact': OVER_BALL.slide_contact(CONTACT, [0.5, 0.52], condition='least_energy')}
    for kind, plan in pairs.items():
        assert same_plans(plan, planned(TASKS[kind])), kind


def test_a_minimum_is_a_plan_of_one_waypoint():
    inverse, task, start = TASKS['Minimize']
    plan, found = planned(TASKS['Minimize']), inverse.minimize_penalty(list(task.penalties), start)
    assert found.converged and plan.grippers == (found.gripper,)
    assert np.abs(plan.shapes[0].positions[-1] - (0.9, 0, 0.9)).max() < 1e-6


@KINDS
def test_a_task_travels(kind, tmp_path):
    _, task, _ = TASKS[kind]
    written = json.dumps(task.to_dict())
    for again in (pickle.loads(pickle.dumps(task)), Task.from_dict(json.loads(written)),
                  type(task).from_dict(task.to_dict()), task_from_yaml(task_to_yaml(task))):
        assert type(again) is type(task)
        assert json.dumps(again.to_dict()) == written
        if kind != 'Approach':  # the shape of a file does not know its rod
            assert again == task and hash(again) == hash(task)
    write_task(tmp_path / 'task.yaml', task)
    assert json.dumps(read_task(tmp_path / 'task.yaml').to_dict()) == written


def test_a_pool_plans_as_one_process_does():
    jobs = [TASKS[kind] for kind in ('Thread', 'ThreadTwo', 'HoldContact')] + [
        (FREE, LiftTo((1.0, 1.1)), None)]
    with ProcessPoolExecutor(2, mp_context=get_context('fork')) as pool:
        for job, plan in zip(jobs, pool.map(planned, jobs), strict=True):
            assert same_plans(plan, planned(job))


def test_ones_own_task_is_like_any_other():
    task = LiftTo((1.0, 1.2, 1.4))
    plan = FREE.plan(task)
    assert [shape.positions[-1, 2] for shape in plan.shapes] == pytest.approx([1.0, 1.2, 1.4])
    assert Task.from_dict(task.to_dict()) == task == task_from_yaml(task_to_yaml(task))
    assert close_task(open_task(task_to_yaml(task))) == task  # as the node reads it
    low = Requirements(Workspace((-1, -1, 0), (1, 1, 1.3 + FIRST.s[-1])))
    deep = Requirements(Workspace((-1, -1, 0), (1, 1, plan.grippers[1].position[2] + 0.05)))
    assert len(FREE.plan(task, requirements=replace(low, workspace=None))) == 3
    with pytest.raises(Infeasible, match='workspace') as refused:
        FREE.plan(task, requirements=deep)
    assert refused.value.waypoint == 2 and len(refused.value.plan) == 2


def test_requirements_of_the_call_count_instead_of_the_simulators():
    narrow = InverseSimulator(FREE.simulator, workspace=Workspace((-0.1,) * 3, (0.1,) * 3))
    with pytest.raises(Infeasible, match='workspace'):
        narrow.plan(Thread(HOLE, DEPTHS))
    wide = Requirements(limits=Limits(0.2, 1.0))
    assert narrow.requirements.workspace is narrow.workspace
    plan, slower = narrow.plan(Thread(HOLE, DEPTHS), requirements=wide), FREE.plan(
        Thread(HOLE, DEPTHS))
    assert plan.times == pytest.approx(0.5 * slower.times)


def test_a_tolerance_refuses_what_is_missed():
    inverse, task, _ = TASKS['ThreadSequence']
    task = replace(task, depths=(0.0, 0.2, 0.4, 0.45))
    missed = inverse.plan(task).position_error
    assert missed.max() > 1e-6
    good, less = (Requirements(tolerance=part * missed.max()) for part in (1.01, 0.9))
    assert len(inverse.plan(task, requirements=good)) == 4
    with pytest.raises(Infeasible, match='tolerance') as refused:
        inverse.plan(task, requirements=less)
    assert refused.value.constraint == 'tolerance'
    assert refused.value.amount == pytest.approx(0.1 * missed.max(), rel=1e-6)
    assert refused.value.waypoint == np.argmax(missed > less.tolerance)


@pytest.mark.parametrize('cutouts', [(HOLE,), (HOLE, SECOND), (HOLE, SECOND, THIRD)])
def test_which_task_threads_through_cut_outs(cutouts):
    task = threading_of(cutouts, DEPTHS)
    assert type(task) is (Thread, ThreadTwo, ThreadSequence)[len(cutouts) - 1]
    assert same_plans(FREE.plan(task), FREE.plan(ThreadSequence(cutouts, depths=DEPTHS)))


@pytest.mark.parametrize(('wrong', 'said'), [
    (lambda: Thread(None), 'cutout = None'),
    (lambda: Thread(HOLE, (0.2, 0.1)), r'depths\[1\] = 0.1'),
    (lambda: Thread(HOLE, method='best'), "method = 'best'"),
    (lambda: FREE.plan(Thread(HOLE, (0.2, 1.1))), 'depths'),
    (lambda: FREE.plan(HOLE), 'task = CutOut'),
    (lambda: FREE.plan(Thread(HOLE), requirements=WIRE), 'requirements = Rod'),
    (lambda: FREE.plan(ThreadTwo(HOLE, SECOND), initial=FIRST), 'initial = Shape.*ThreadTwo'),
    (lambda: FREE.plan(Approach(HOLE, FIRST)), 'start = None'),
    (lambda: FREE.plan(HoldContact(CONTACT, 0.5)), 'no obstacles'),
    (lambda: ThreadSequence((HOLE, SECOND), (1,)), 'weights has 1 entries'),
    (lambda: Requirements(tolerance=-1), r'Requirements.tolerance = -1'),
    (lambda: Requirements(deadline=0), r'Requirements.deadline = 0'),
    (lambda: Requirements(limits=0.1), r'Requirements.limits = 0.1'),
    (lambda: Minimize(len).to_dict(), 'cannot be written'),
    (lambda: Thread.from_dict(TASKS['Insert'][1].to_dict()), 'expected a Thread'),
    (lambda: Task.from_dict({'type': 'Thread'}), 'cutout'),
    (lambda: Task.from_dict({'type': 'Thread', 'hole': 1}), 'content.hole: expected one of'),
    (lambda: Task.from_dict({'type': 'Treads'}), "content.type = 'Treads'"),
    (lambda: Task.from_dict({'type': np.array([])}), 'content.type'),
    (lambda: Task.from_dict({'type': 'Shape', 's': np.array([])}), 'content: expected a Shape'),
    (lambda: Task.from_dict({'type': 'Shape', 's': {'type': 'float', 'data': [10**400],
                                                      'shape': [1]}}),
     'content: expected a Shape'),
    (lambda: task_from_yaml('type: ['), 'expected YAML')])
def test_what_makes_no_sense_is_named(wrong, said):
    with pytest.raises(InvalidTask, match=said):
        wrong()


def test_a_task_is_written_by_hand_in_a_few_lines():
    task = task_from_yaml("""
        type: Thread
        cutout: {type: CutOut, pose: {position: [0.4, 0, 1]}, radius: 0.02}
        depths: [0, 1e-1]
        """)
    hole = CutOut(Pose((0.4, 0, 1), (0, 0, 0, 1)), radius=0.02)
    assert task == Thread(hole, (0.0, 0.1))
    assert partial(FREE.plan, task)().fraction == 1
