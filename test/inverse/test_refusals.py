# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a task does not take into account, it refuses; it never drops it in silence."""

import pickle
import re

import numpy as np
import pytest
from references.hanging import hanging_and_stable
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    FarEnd,
    Infeasible,
    Insert,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Thread,
    Uncertainty,
    Workspace,
    robustness,
)
from dlo_planner.inverse.equilibria import is_axisymmetric
from dlo_planner.inverse.tasks.thread import certificate
from dlo_planner.rods import GraspedInside
from dlo_planner.tasks import MoveTo

ROD = Rod(1.0, 0.05, 0.3, 0.25, radius=0.002)
HOLE = CutOut(Pose.looking_along((1.0, 0.0, 1.0), (1, 0.2, 0)), radius=0.02)
START = Pose((-0.3, 0, 1), (0, 0, 0, 1))


def with_initial(inverse, initial):
    """Yield functions that plan from an initial Shape."""
    plan = inverse.thread(HOLE, depths=[0.0])
    yield lambda: inverse.thread(HOLE, depths=[0.0], initial=initial)
    yield lambda: inverse.approach(HOLE, plan, START, initial=initial, standoff=0.05)


@pytest.mark.parametrize('method', ['dfp', 'downhill_simplex'])
def test_plans_are_made_by_newton_alone(method):
    with pytest.raises(InvalidTask, match='method'):
        InverseSimulator(DirectSimulator(ROD, method=method))
    with pytest.raises(InvalidTask, match='method'):
        InverseSimulator(DirectSimulator(ROD, method=method, strains='paper'))


def test_an_initial_shape_that_is_held_or_another_is_named():
    direct = DirectSimulator(ROD)
    held = direct.solve(START, far_end=FarEnd(Pose((0.6, 0, 1), (0, 0, 0, 1))))
    grasped = GraspedInside(ROD, 0.5).solve(START)
    longer = DirectSimulator(Rod(1.1, 0.05, 0.3, 0.25)).solve(START)
    for initial, named in ((held, 'initial is held at its far end'),
                           (grasped, 'initial.*grasped inside'), (longer, 'initial has length'),
                           ('shape', 'initial = ')):
        for plan in with_initial(InverseSimulator(direct), initial):
            with pytest.raises(InvalidTask, match=named):
                plan()


def test_an_initial_shape_of_another_rod_is_only_a_start():
    direct = DirectSimulator(ROD)
    start = DirectSimulator(Rod(1.0, 0.05, 0.15, 0.12)).solve(START)
    wanted = InverseSimulator(direct).thread(HOLE, depths=[0.0])
    for plan in with_initial(InverseSimulator(direct), start):
        np.testing.assert_allclose(plan().grippers[-1].matrix, wanted.grippers[0].matrix, atol=1e-9)


def test_a_set_of_the_initial_shape_counts():
    direct = DirectSimulator(Rod(1.0, 0.05, 0.03, 0.025, yield_curvature=2.0, hardening=0.1),
                             n_elements=64)
    level = Pose((0, 0, 1), (0, 0, 0, 1))
    bent = direct.solve(level)
    up = CutOut(Pose.looking_along((0, 0, 1), (0, 0, -1)))
    wanted = InverseSimulator(direct.with_set(bent)).thread(up, start=level, depths=[0.0, 0.1])
    fresh = InverseSimulator(direct).thread(up, start=level, depths=[0.0, 0.1])
    found = InverseSimulator(direct).thread(up, start=level, depths=[0.0, 0.1], initial=bent)
    assert bent.dissipated > 0
    np.testing.assert_allclose(found.shapes[0].positions, wanted.shapes[0].positions, atol=1e-9)
    assert np.abs(found.shapes[0].positions - fresh.shapes[0].positions).max() > 0.01


def test_a_tolerance_is_of_the_rod_that_was_planned_for():
    plan = InverseSimulator(DirectSimulator(ROD)).thread(HOLE, depths=[0.0, 0.3])
    spread = Uncertainty(mass=0.01)
    assert robustness(DirectSimulator(ROD), plan, spread).by_cause.max() > 0
    for other in (DirectSimulator(Rod(1.0, 0.05, 0.5, 0.25, radius=0.002)),
                  DirectSimulator(ROD, gravity=(0, 0, -1)), DirectSimulator(ROD, load=(0, 1, 0))):
        with pytest.raises(InvalidTask, match='simulator'):
            robustness(other, plan, spread)


def test_rounding_does_not_make_rolls_differ():
    for rod, alike in ((ROD, True), (Rod(1.0, 0.05, (0.3, 0.3 * (1 + 1e-12)), 0.25), True),
                       (Rod(1e-4, 5e-8, 3e-12, 2e-12, natural_curvature=(1e-7, 0)), True),
                       (Rod(1.0, 0.05, (0.3, 0.301), 0.25), False),
                       (Rod(1e3, 0.05, 3e9, 2e9, natural_curvature=(1e-5, 0)), False)):
        assert is_axisymmetric(rod) == alike


def test_contact_tasks_meet_an_accuracy():
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
    contact = Pose((0.5, 0, 0.72), (0, 0, 0, 1))
    rough, fine = (InverseSimulator(DirectSimulator(ROD, obstacles=[bar], **how)).hold_contact(
        contact, 0.6, forces=[0.6]) for how in ({'basis': 'local'}, {'accuracy': 1e-4}))
    assert fine.shapes[0].contacts and fine.shapes[0].error_estimate <= 1e-4
    np.testing.assert_allclose(fine.grippers[0].matrix, rough.grippers[0].matrix, atol=1e-3)


LONG = Rod.circular(2.0, 1.5e-3, 8960.0, 110e9, 0.34)  # it hangs down from any gripper


@pytest.fixture(scope='module')
def tangents():
    """Return heights (257, n) of the tangents of all stable LONGs that hang, by Runge-Kutta."""
    ends = Rotation.random(1500, random_state=np.random.default_rng(1)).as_matrix()
    weight = np.array([0, 0, -9.81 * LONG.node_masses(np.array([0.0, 2.0])).sum() / 2.0])
    frames, stable = hanging_and_stable(LONG, weight, ends, steps=256)
    return frames[:, stable][..., 2, 0]


def test_a_refusal_says_where_there_are_stable_shapes(tangents):
    inverse = InverseSimulator(DirectSimulator(LONG))
    for z, said in ((-1.0, 'no stable one is along the normal at depth 0 m, where the plan begins'),
                    (1.0, 'no stable one is along the normal at any depth')):
        hole = CutOut(Pose.looking_along((0, 0, 1), (0.5, 0, z)))
        with pytest.raises(Infeasible) as refused:
            inverse.thread(hole)
        told = pickle.loads(pickle.dumps(refused.value)).certificate
        assert said in told
        some = re.search(r'between ([\d.]+) and', told)
        none_until = 1.9 if some is None else 0.9 * float(some.group(1))
        # what turns about the vertical is another gripper
        along = abs(tangents - hole.normal[2]) < 0.02
        assert not along[round(256 * (1 - none_until / 2)):].any()
        assert (some is not None) == along[round(256 * 0.05):].any()


def test_where_there_is_a_way_the_certificate_shows_it():
    inverse = InverseSimulator(DirectSimulator(ROD), workspace=Workspace(upper=(0.2, 9, 9)))
    with pytest.raises(Infeasible) as refused:
        inverse.thread(HOLE)
    assert refused.value.constraint == 'workspace.upper.x' or refused.value.certificate == ''
    assert certificate(DirectSimulator(ROD), HOLE, np.linspace(0, 0.5, 9)).endswith(
        'in reach of each other')


def test_a_refusal_of_two_cut_outs_says_how_many_shapes_pass_both():
    inverse = InverseSimulator(DirectSimulator(LONG))
    above = CutOut(Pose.looking_along((0, 0, 2.5), (0, 0, 1)))
    with pytest.raises(Infeasible) as refused:
        inverse.thread_two(CutOut(Pose.looking_along((0, 0, 1), (0, 0, 1))), above)
    assert refused.value.constraint == 'reach'
    told = pickle.loads(pickle.dumps(refused.value)).certificate
    assert 'no stable one passes both' in told
    assert float(re.search(r'by ([\d.e-]+) m', told).group(1)) > 0


@pytest.mark.parametrize('task', [
    Thread(HOLE, [0.0, 0.2]), MoveTo([Pose((0.1, 0, 0), (0, 0, 0, 1))]),
    Insert(CutOut(HOLE.pose, radius=2e-3), [0.0, 0.2])], ids=lambda task: type(task).__name__)
def test_a_shape_that_misses_only_the_accuracy_is_said_to(task):
    # no stable shape was found, it was said, or that the DLO falls into another
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    inverse = InverseSimulator(DirectSimulator(wire, accuracy=1e-9))
    with pytest.raises(Infeasible, match='in equilibrium there') as refused:
        inverse.plan(task, start=Pose.identity())
    assert refused.value.constraint == 'accuracy' and refused.value.unit == 'm'
    assert 0 < refused.value.amount < 1e-9
