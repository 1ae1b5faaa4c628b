# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From the present pose to the beginning of a threading."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
    Sheet,
    Trajectory,
)
from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import clearance
from dlo_planner.tasks import concatenate
from dlo_planner.trajectory.calm_search import CalmSearch
from dlo_planner.trajectory.dynamic_check import InMotion

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0.2, 0.1, 1.0), (1, 0.3, 0)), radius=0.01)


@pytest.fixture(scope='module')
def inverse():
    return InverseSimulator(DirectSimulator(WIRE))


@pytest.fixture(scope='module')
def plan(inverse):
    return inverse.thread(HOLE)


@pytest.mark.parametrize('turn', [(0, 0, 0), (0, 0, 2.5), (0.5, 1.0, -0.5)])
def test_the_dlo_stays_behind_the_sheet(inverse, plan, turn):
    start = Pose((-1.3, 0.4, 1.2), Rotation.from_rotvec(turn).as_quat())
    way = inverse.approach(HOLE, plan, start, standoff=0.08)
    assert way.grippers[0] == start
    np.testing.assert_allclose(way.grippers[-1].matrix, plan.grippers[0].matrix, atol=1e-12)
    for shape in inverse.simulator.track(way.grippers)[:-1]:
        assert shape.converged
        assert ((HOLE.center - shape.positions) @ HOLE.normal).min() > WIRE.radius
    # the free end waits before the center, aligned, and then goes straight in
    before = [one for one in way.shapes if np.linalg.norm(
        one.positions[-1] - (HOLE.center - 0.08 * HOLE.normal)) < 1e-6]
    assert len(before) == 1
    np.testing.assert_allclose(before[0].tangents[-1], HOLE.normal, atol=1e-6)
    assert (np.diff(way.times) >= 0).all()


@pytest.mark.parametrize('standoff', [0.0, WIRE.radius, 0.5 * WIRE.radius])
def test_a_standoff_below_the_dlos_radius(inverse, plan, standoff):
    start = Pose((-1.3, 0.4, 1.2), (0, 0, 0, 1))
    way = inverse.approach(HOLE, plan, start, standoff=standoff)
    np.testing.assert_allclose(way.grippers[-1].matrix, plan.grippers[0].matrix, atol=1e-12)


def test_it_keeps_out_of_a_thick_plate():
    # behind its middle is not behind its face: from 5 cm beside a hole of 2 cm it meets that
    rod, hole = Rod(1.0, 0.01, 5.0, 4.0, radius=2e-3), CutOut(Pose.looking_along(
        (0, 0, 1), (1, 0, 0)), radius=0.02)
    plate = Sheet(hole.pose, 3.0, 3.0, 0.2, (hole,))
    inverse = InverseSimulator(DirectSimulator(rod, obstacles=[plate]))
    plan = inverse.thread(hole, depths=[0.0, 0.1])
    place, turn = plan.grippers[0].position, plan.grippers[0].quaternion
    way = inverse.approach(hole, plan, Pose(place + (-0.12, 0.02, 0), turn), standoff=0.02)
    assert min(clearance([plate], Surface.of(rod), shape) for shape in way.shapes) > 1e-3
    with pytest.raises(Infeasible, match='the DLO is .* m in .*[Ss]heet'):
        inverse.approach(hole, plan, Pose(place + (-0.12, 0.05, 0), turn), standoff=0.02)


def test_it_goes_back_no_farther_than_it_must(inverse, plan):
    far = inverse.approach(HOLE, plan, Pose((-1.3, 0.4, 1.2), (0, 0, 0, 1)), standoff=0.05)
    near = inverse.approach(HOLE, plan, plan.grippers[0], standoff=0.05)
    for way, begin in ((far, 1.3), (near, 1.0)):
        back = max((HOLE.center - gripper.position) @ HOLE.normal for gripper in way.grippers)
        assert back < begin + 0.35


def test_a_dlo_beyond_the_sheet_is_refused(inverse, plan):
    with pytest.raises(Infeasible, match='behind the sheet') as caught:
        inverse.approach(HOLE, plan, Pose((0.0, 0, 1.0), (0, 0, 0, 1)))
    assert caught.value.constraint == 'clearance' and caught.value.amount > 0


def test_gripper_clearance_ends_the_plan_or_refuses(inverse, plan):
    def room(one):
        return [(HOLE.center - gripper.position) @ HOLE.normal for gripper in one.grippers]

    kept = inverse.thread(HOLE, gripper_clearance=0.2)
    assert 1 < len(kept) < len(plan) and min(room(kept)) >= 0.2
    assert kept.fraction == 1
    depths = np.linspace(0, 0.9, 10)
    rooms = room(inverse.thread(HOLE, depths=depths))
    with pytest.raises(Infeasible, match='gripper_clearance') as caught:
        inverse.thread(HOLE, depths=depths, gripper_clearance=0.2)
    assert caught.value.waypoint == np.argmax(np.array(rooms) < 0.2) > 2
    assert caught.value.amount == pytest.approx(0.2 - rooms[caught.value.waypoint])


def test_a_dlo_that_is_hardly_beyond_the_sheet_is_refused(inverse, plan):
    start = Pose((-1.3, 0.4, 1.2), (0, 0, 0, 1))
    beyond = ((inverse.simulator.solve(start).positions - HOLE.center) @ HOLE.normal).max()
    start = Pose(start.position + (0.02 - beyond) * HOLE.normal, start.quaternion)
    with pytest.raises(Infeasible, match='not behind the sheet') as refused:
        inverse.approach(HOLE, plan, start, standoff=0.08)
    assert (refused.value.waypoint, refused.value.constraint) == (0, 'clearance')


def test_a_fall_on_the_way_is_refused(inverse, plan, monkeypatch):
    track = DirectSimulator.track
    monkeypatch.setattr(DirectSimulator, 'track', lambda *given, **more: [
        replace(shape, jumped=True) for shape in track(*given, **more)])
    with pytest.raises(Infeasible, match='fall into another shape') as refused:
        inverse.approach(HOLE, plan, Pose((-1.3, 0.4, 1.2), (0, 0, 0, 1)), standoff=0.08)
    assert (refused.value.waypoint, refused.value.constraint) == (1, 'continuity')


def test_a_way_to_another_shape_is_refused(inverse, plan):
    other = DirectSimulator(replace(SHORT, length=1.0)).solve(plan.grippers[0])
    with pytest.raises(Infeasible) as refused:
        inverse.plan(Approach(HOLE, other, 0.08), start=Pose((-1.3, 0.4, 1.2), (0, 0, 0, 1)))
    assert refused.value.constraint == 'start'


SHORT = Rod(0.3, 0.05, 5e-3, 4e-3, radius=2e-3)
NOW = Pose((-0.25, 0.0, 1.03), (0, 0, 0, 1))


def standoff_of(way, through):
    """Return the standoff of a plan as a part of the length."""
    stop, = way.stops
    return np.linalg.norm(way.grippers[stop].position - through.grippers[0].position) / SHORT.length


@pytest.fixture(scope='module')
def short():
    """Return an InverseSimulator, and the Plan of a threading."""
    inverse = InverseSimulator(DirectSimulator(SHORT))
    hole = CutOut(HOLE.pose, radius=0.01)
    return inverse, hole, inverse.thread(hole, start=NOW, depths=np.linspace(0, 0.25, 8))


@pytest.mark.sweep
def test_without_a_standoff_it_is_the_one_of_the_quickest_calm_motion(short):
    inverse, hole, through = short
    parts = (0.05, 0.1, 0.15)
    seconds = [Trajectory(concatenate(inverse.approach(
        hole, through, NOW, standoff=part * SHORT.length), through)).duration for part in parts]
    found = inverse.approach(hole, through, NOW)
    assert standoff_of(found, through) == pytest.approx(parts[int(np.argmin(seconds))])
    assert Trajectory(concatenate(found, through)).duration == pytest.approx(min(seconds))


def test_where_motion_does_not_tell_the_standoff_is_a_tenth_of_the_length(short, monkeypatch):
    inverse, hole, through = short

    moved = []

    def never(self, timed):
        moved.append(timed)
        return [InMotion(False, *[np.inf] * 10)]

    monkeypatch.setattr(CalmSearch, '_moved', never)
    way = inverse.approach(hole, through, NOW)
    assert standoff_of(way, through) == pytest.approx(0.1)
    assert len(moved) == 6  # it does not look for long

    def late(*_):
        raise DeadlineExceeded('late', 1.0, 1.0)

    monkeypatch.setattr(CalmSearch, '_moved', late)
    way = inverse.approach(hole, through, NOW)
    assert standoff_of(way, through) == pytest.approx(0.1)


def test_the_best_until_the_deadline_counts(short, monkeypatch):
    inverse, hole, through = short
    go_on, calls = CalmSearch.go_on, []

    def twice(self, *given):
        calls.append(self)
        if len(calls) == 2:
            raise DeadlineExceeded('late', 1.0, 1.0)
        return go_on(self, *given)

    monkeypatch.setattr(CalmSearch, 'go_on', twice)
    assert standoff_of(inverse.approach(hole, through, NOW), through) == pytest.approx(0.1)
    assert len(calls) == 2


@pytest.mark.parametrize(('stiffness', 'bent', 'seed'), [
    (0.045, (-0.54, 0.87), 8), (0.036, (-1.13, 0.07), 20)])
def test_where_the_straight_turn_would_let_it_fall_another_does_not(stiffness, bent, seed):
    rng = np.random.default_rng(seed)
    bends = 10 ** rng.uniform(-2, 0)
    rod = Rod(1.0, 0.05, (bends, bends * rng.uniform(1, 2)), 0.7 * bends, radius=0.004,
              natural_curvature=tuple(rng.uniform(-1.5, 1.5, 2)),
              natural_twist=rng.uniform(-2, 2))
    assert bends == pytest.approx(stiffness, rel=0.03)
    assert rod.natural_curvature == pytest.approx(bent, abs=0.01)
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, *rng.uniform(-0.3, 0.3, 2))), radius=0.02)
    simulator = DirectSimulator(rod)
    inverse = InverseSimulator(simulator)
    plan = inverse.thread(hole, max_misalignment=0)
    first = plan.grippers[0]
    here = Pose.from_rotation(
        first.position - rng.uniform(0.3, 1.0) * hole.normal + rng.uniform(-0.4, 0.4, 3),
        Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3)).as_matrix() @ first.rotation)
    # the gripper turns evenly: the DLO falls
    turn = Rotation.from_matrix(first.rotation @ here.rotation.T).as_rotvec()
    even = [Pose.from_rotation(here.position, Rotation.from_rotvec(share * turn).as_matrix()
                               @ here.rotation) for share in np.linspace(0, 1, 9)]
    assert any(shape.jumped for shape in simulator.track(even))
    way = inverse.approach(hole, plan, here, standoff=0.1)
    followed = simulator.track(way.grippers)
    assert all(shape.converged and not shape.jumped for shape in followed)
    np.testing.assert_allclose(followed[-1].positions, plan.shapes[0].positions, atol=1e-6)
    assert all(((hole.center - shape.positions) @ hole.normal).min() > -2e-3
               for shape in followed[:-1])
