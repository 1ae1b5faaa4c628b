# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""No plan leaps: what the gripper may do between two waypoints is bounded by the step in depth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from references.hanging import no_pair
from scipy.spatial.transform import Rotation
from sweeps import MASS
from sweeps.cutouts import leaps, random_cutout, steps

from dlo_planner import (
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
)
from dlo_planner.plan.continuity import discontinuity, excess, without_doubt

FOLDED = Rod(0.997, 0.1683, (0.16045, 0.78075), 0.053854, natural_curvature=(-1.7084, 0.1736))
OBLIQUE = CutOut(Pose.looking_along((0, 0, 1), (-0.58489, -0.06167, -0.80877)))


def test_where_the_family_folds_another_roll_is_taken():
    depths = np.linspace(0, 0.8 * FOLDED.length, 160)
    plan = InverseSimulator(DirectSimulator(FOLDED)).thread(OBLIQUE, depths=depths)
    turns, shifts = steps(plan, FOLDED.length)
    assert plan.fraction == 1 and plan.position_error.max() < 1e-9
    assert plan.misalignment.max() < 1e-8
    assert turns.max() < 0.1 and shifts.max() < 0.03
    replayed = DirectSimulator(FOLDED).track(plan.grippers)
    assert all(shape.converged and not shape.jumped for shape in replayed)


@pytest.mark.parametrize('waypoints', [20, 39])
def test_a_narrow_way_is_rolled_along(waypoints):
    bent = Rod(1.0, 0.05, (3.8384478655661844, 2.9982709478076406), 0.9807901221383606,
               natural_curvature=(2.258140625317773, -3.6757538582281963),
               natural_twist=-0.19184982119478816)
    hole = CutOut(Pose((0, 0, 0), (0.05490103, 0.0811599, -0.5576044, 0.82430351)))
    plan = InverseSimulator(DirectSimulator(bent, basis='local')).thread(
        hole, depths=np.linspace(0, 0.95, waypoints))
    assert plan.fraction == 1 and not leaps(plan) and plan.stability.min() > 0.1
    assert max(np.linalg.norm(shape.at(1 - depth).position)
               for depth, shape in zip(plan.depths, plan.shapes, strict=True)) < 1e-9


@pytest.mark.every(2)
@pytest.mark.parametrize('seed', [0, 11])
def test_random_plans_do_not_leap(seed):
    rng, depths = np.random.default_rng(seed), np.linspace(0, 0.95, 100)
    refused = 0
    for index in range(20 if seed else 42):
        rod, cutout = random_cutout(rng)
        if not seed and index not in (8, 40):  # the rolls of these two have to change on the way
            continue
        try:
            plan = InverseSimulator(DirectSimulator(rod)).thread(cutout, depths=depths)
        except Infeasible:
            refused += 1
            continue
        assert not leaps(plan)
    assert refused <= 2


def test_pairs_do_not_leap_and_keep_their_directions():
    rng, refused = np.random.default_rng(0), 0
    for _ in range(9):
        rod, first = random_cutout(rng)
        way = first.normal + 0.6 * rng.normal(size=3)
        way /= np.linalg.norm(way)
        second = CutOut(Pose.looking_along(first.center + rng.uniform(0.1, 0.5) * way,
                                           way + 0.5 * rng.normal(size=3)))
        try:
            plan = InverseSimulator(DirectSimulator(rod)).thread_two(
                first, second, depths=np.linspace(0, 0.85, 40))
        except Infeasible as error:
            assert error.amount > 0
            assert no_pair(rod, np.array([0, 0, -9.81 * MASS]), first, second)
            refused += 1
            continue
        assert not leaps(plan)
        for shape, passes in zip(plan.shapes, plan.via_points, strict=True):
            for cutout, (_, s, _) in zip((first, second), passes, strict=False):
                assert shape.frame_at(s)[0][:, 0] @ cutout.normal > 0
    assert refused < 6


def test_cutouts_are_not_passed_backwards():
    wire = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    ahead, behind = (CutOut(Pose.looking_along((x, 0, 1), (1, 0, 0))) for x in (0.0, -0.2))
    with pytest.raises(Infeasible) as caught:
        InverseSimulator(DirectSimulator(wire)).thread_two(ahead, behind)
    assert caught.value.constraint in ('direction', 'reach') and caught.value.amount >= 0


@pytest.mark.parametrize('seed', [1, 6])
def test_sequences_do_not_leap(seed):
    rng = np.random.default_rng(seed)
    rod = Rod(1.0, MASS, tuple(np.exp(rng.uniform(np.log(0.05), np.log(2), 2))), 0.3,
              natural_curvature=tuple(0.6 * rng.normal(size=2)))
    centers, way = [np.zeros(3)], rng.normal(size=3)
    for _ in range(2):
        way = way / np.linalg.norm(way) + 0.4 * rng.normal(size=3)
        centers.append(centers[-1] + 0.25 * way / np.linalg.norm(way))
    holes = [CutOut(Pose.looking_along(center, way)) for center in centers]
    plan = InverseSimulator(DirectSimulator(rod, n_elements=32)).thread_sequence(
        holes, depths=np.linspace(0, 0.8, 50))
    assert not leaps(plan)
    assert all(shape.converged for shape in plan.shapes)


@pytest.mark.parametrize('call', [
    lambda inverse, holes, **given: inverse.thread(holes[0], **given),
    lambda inverse, holes, **given: inverse.thread_two(*holes[:2], **given),
    lambda inverse, holes, **given: inverse.thread_sequence(holes, **given),
    lambda inverse, holes, **given: inverse.insert(holes[0], **given)],
    ids=['thread', 'thread_two', 'thread_sequence', 'insert'])
def test_a_deadline_ends_the_search(call):
    rod = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2))
    holes = [CutOut(Pose.looking_along((x, 0.0, 1.0), (1, 0, 0))) for x in (0.0, 0.2, 0.4)]
    with pytest.raises(DeadlineExceeded, match='deadline') as caught:
        call(InverseSimulator(DirectSimulator(rod)), holes, deadline=1e-6)
    assert caught.value.elapsed > caught.value.seconds == 1e-6


@pytest.mark.parametrize(('stability', 'jumped', 'looks', 'leaps_there'), [
    (0.2, False, 0, False), (0.05, False, 1, False), (0.05, True, 1, True), (0.2, True, 0, False)])
def test_where_a_step_is_hardly_stable_the_direct_simulation_decides(stability, jumped, looks,
                                                                     leaps_there):
    shape = replace(DirectSimulator(Rod(1.0, 0.1, 0.3, 0.2)).solve(Pose.identity()),
                    stability=stability)
    tracked = []

    def track(grippers, initial):
        tracked.append(initial)
        return [replace(shape, jumped=jumped)]

    for before, here in ((shape, replace(shape, stability=1.0)), (replace(shape, stability=1.0),
                                                                 shape)):
        away = discontinuity(SimpleNamespace(track=track), before, here)
        assert (away is not None) == leaps_there
    assert len(tracked) == 2 * looks


@pytest.mark.parametrize('step', [0.0, 0.02, -0.02])
@pytest.mark.parametrize('length', [1.0, 0.3])
def test_a_step_may_turn_and_move_the_gripper_by_so_much_and_no_more(step, length):
    # twice what 99 % of 500 random plans need
    turn, shift = 0.05 + 10 * abs(step), (0.02 + 3 * abs(step)) * length
    here = (np.eye(3), np.zeros(3))

    def beyond(by_turn, by_shift):
        there = (Rotation.from_rotvec((0, by_turn * turn, 0)).as_matrix(),
                 np.array([0.0, 0.0, by_shift * shift]))
        return excess(here, there, step, length)

    assert beyond(0.999, 0.999) == 0.0
    assert beyond(1.1, 0.5) == pytest.approx(0.1 * turn * length)
    assert beyond(0.5, 1.1) == pytest.approx(0.1 * shift)
    most, least = without_doubt(np.array([step]), length)
    assert most[:, 0] == pytest.approx([turn, shift, 0.1]) and least == 0.1


def test_a_shape_that_changes_more_than_its_gripper_turns_is_looked_at():
    direct = DirectSimulator(Rod(1.0, 0.1, 0.3, 0.2), n_elements=16, n_terms=6)
    before = direct.solve(Pose.identity())
    looked = []

    def track(grippers, initial):
        looked.append(grippers)
        return direct.track(grippers, initial=initial)

    counting = SimpleNamespace(track=track)
    for turn, bent, looks in ((0.3, 0.65, False), (0.3, 0.75, True), (0.0, 0.09, False),
                              (0.0, 0.11, True)):
        there = Pose.from_rotation(np.zeros(3), Rotation.from_rotvec((0, turn, 0)).as_matrix())
        turns = Rotation.from_rotvec((0, bent, 0)).as_matrix()
        frames = np.array([turns @ one for one in before.frames])
        shape = replace(before, gripper=there, frames=frames, state=before.state)
        looked.clear()
        discontinuity(counting, before, shape)
        assert bool(looked) == looks, (turn, bent)
