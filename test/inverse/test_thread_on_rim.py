# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One hand threads a long DLO, and the rim holds what has passed while it goes back."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from references.kirchhoff import true_rod

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
    Sphere,
)
from dlo_planner.direct.grasp import piece_of
from dlo_planner.plan.continuity import apart
from dlo_planner.settings.tasks import task_from_yaml, task_to_yaml
from dlo_planner.tasks import ThreadInGrasps

CABLE = Rod(0.6, 0.035, 1.2e-3, 1.0e-3, radius=2e-3, damping=0.01)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=8e-3)
FEED = Pose.looking_along((-0.2, -0.1, 1.0), (0, 0, -1))
FRICTION, COUNTED = 0.5, 0.45  # of the rim, and what is counted on


def sheet(friction):
    return Sheet.around(HOLE, 0.3, 0.3, 1e-3, friction=friction)


def direct(friction, *others):
    return DirectSimulator(CABLE, basis='local', n_elements=64,
                           obstacles=[sheet(friction), *others])


INVERSE = InverseSimulator(direct(FRICTION))
TASK = ThreadInGrasps(HOLE, 0.25, FEED, hold_at=0.42, stroke=0.12, grip_distance=0.04, on_rim=True)


@pytest.fixture(scope='module')
def plan():
    """Return the plan of TASK."""
    return INVERSE.plan(TASK)


def test_one_hand_lays_the_dlo_on_the_rim_and_takes_it_up_again(plan):
    assert [stage.name for stage in plan.stages] == [
        'thread', 'lay 1', 'rim alone 1', 'lift 1', 'pull 1']
    assert [str(event) for event in plan.events] == [
        'open first at s = 0.42 m', 'close first at s = 0.31 m']
    assert plan.depths[-1] == pytest.approx(0.25) and set(plan.arms) == {'first'}
    for one, other in pairwise(plan.stages):
        assert apart(one.shapes[-1], other.shapes[0]) < 1e-3 * CABLE.length
    thread, _, _, _, pull = plan.stages
    for stage in (thread, pull):  # it touches nothing, and keeps to the center
        assert stage.metric('clearance').min() > 0.6 * (HOLE.radius - CABLE.radius)
        for k, shape in enumerate(stage.shapes, start=stage.first):
            assert not shape.contacts
            np.testing.assert_allclose(shape.frame_at(CABLE.length - plan.depths[k])[1],
                                       HOLE.center, atol=1e-4)


def test_the_friction_of_the_rim_bears_what_has_passed(plan):
    stage = plan.stages[2]
    shape, = stage.shapes
    assert shape.converged and shape.stability > 0 and not shape.holds
    contacts = shape.contacts
    assert contacts and all(
        np.linalg.norm(one.friction) <= COUNTED * one.force * (1 + 1e-9) for one in contacts)
    needed, = stage.metric('friction_needed')
    assert needed == pytest.approx(max(np.linalg.norm(one.friction) / one.force
                                       for one in contacts)) and 0.05 < needed <= COUNTED + 1e-9
    # the edge of the rim is as far from the DLO as that is thick, and its forces bear the weight
    for one in contacts:
        across = np.linalg.norm(one.position[1:] - HOLE.center[1:])
        edge = np.hypot(HOLE.radius - across, max(0.0, abs(one.position[0]) - 5e-4))
        assert edge == pytest.approx(CABLE.radius, abs=1e-5)
    weight = 9.81 * CABLE.mass_per_length * CABLE.length
    total = shape.gripper_wrench[:3] + sum(one.vector for one in contacts)
    np.testing.assert_allclose(total, (0, 0, weight), atol=1e-4 * weight)
    # what hangs beyond is what SciPy's two-point solver says of a rod that begins there
    at = contacts[-1].s + 1e-3
    part = piece_of(shape, at, 1)
    beyond = replace(CABLE, length=CABLE.length - at)
    s = np.linspace(0, beyond.length, 81)
    guess = piece_of(shape, at, 1)
    true = true_rod(beyond, part.gripper, guess)
    assert np.linalg.norm(true - part.positions, axis=1).max() < 2e-3 * CABLE.length
    assert part.positions_at(s)[-1, 0] > 0.02  # it has passed


@pytest.mark.every(2)
@pytest.mark.parametrize('friction', [0.15, 0.02])
def test_a_rim_that_does_not_hold_is_refused_by_name(friction):
    with pytest.raises(Infeasible, match='with 90% of its friction the DLO would slide off') as no:
        InverseSimulator(direct(friction)).plan(TASK)
    error = no.value
    assert error.constraint == 'friction' and error.unit == 'm' and error.amount > 0.01
    assert [stage.name for stage in error.plan.stages] == ['thread']


def test_what_is_in_the_way_is_in_the_way_of_a_dlo_on_the_rim(plan):
    slack = plan.stages[2].shapes[0].positions_at([0.25])[0]
    with pytest.raises(Infeasible, match='lamp') as refused:
        InverseSimulator(direct(FRICTION, Sphere(slack, 0.02, name='lamp'))).plan(TASK)
    assert refused.value.constraint == 'clearance'


def test_what_the_rim_takes_is_stated():
    for obstacles in ([], [sheet(0.0)]):
        simulator = DirectSimulator(CABLE, basis='local', n_elements=64, obstacles=obstacles)
        with pytest.raises(InvalidTask, match='on_rim = True: expected a Sheet with this cut-out'):
            InverseSimulator(simulator).plan(TASK)
    with pytest.raises(InvalidTask, match='on_rim = True: expected False with begins_free'):
        replace(TASK, feed=None, begins_free=True)
    with pytest.raises(InvalidTask, match=r'stroke = 0.005: expected at least'):
        INVERSE.plan(replace(TASK, stroke=0.005))


def test_files_and_texts_keep_it(plan, tmp_path):
    plan.save(tmp_path / 'plan.npz')
    again = Plan.load(tmp_path / 'plan.npz')
    np.testing.assert_array_equal(again.friction_needed, plan.friction_needed)
    assert [str(one) for one in again.events] == [str(one) for one in plan.events]
    assert task_from_yaml(task_to_yaml(TASK)) == TASK
    assert INVERSE.check(plan) is plan
