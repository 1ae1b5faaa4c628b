# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes, motions, plans and replays say where a DLO would pass through itself."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Infeasible,
    InverseSimulator,
    PointLoad,
    Pose,
    Rod,
    Shape,
    replay,
)
from dlo_planner.direct import self_passage
from dlo_planner.direct.grips import between
from dlo_planner.direct.shape import kernel_arrays
from dlo_planner.geometry.writhe import link, writhe
from dlo_planner.plan import builder
from dlo_planner.plan.continuity import passes_itself
from dlo_planner.results import Motion
from dlo_planner.tasks import MoveTo

LOOK = Pose.looking_along
FAR = FarEnd(LOOK((-0.2, 0.04, 0), (-1, 0.8, 0)))
OVER, UNDER = (LOOK((-0.2, -0.04, z), (1, 0.8, 0)) for z in (0.02, -0.023))


def linked(shape):
    # with how both straight ends cross each other, which changes as the grips move
    ahead = 1e4 * shape.s[-1] * shape.frames[[0, -1], :, 0]
    ends = np.array([shape.positions[0] - ahead[0], shape.positions[0],
                     shape.positions[-1], shape.positions[-1] + ahead[1]])
    return link(*kernel_arrays(shape), 0.0) + writhe(ends, False)


@pytest.fixture(scope='module')
def loop():
    """Return a simulator, and a hose in a loop, its beginning above its end."""
    simulator = DirectSimulator(Rod.circular(1, 0.006, 1200, 5e7, 0.4), gravity=(0, 0, 0))
    near, far = LOOK((-0.2, 0.1, 0.06), (1, -0.2, 0.1)), LOOK((-0.2, -0.1, 0), (-1, -0.2, 0))
    shape = simulator.solve(near, far_end=far)
    for k in range(1, 21):
        end = between(far, FAR.pose, k / 20)
        shape = simulator.solve(between(near, OVER, k / 20), shape, far_end=end)
        assert shape.passed_itself is False
    return simulator, simulator.solve(OVER, shape, far_end=FAR)


def test_a_step_through_itself_says_so(loop, tmp_path):
    simulator, before = loop
    assert before.converged and before.passed_itself is False and not before.lies_in_itself
    through = simulator.solve(UNDER, before, far_end=FAR)
    assert through.converged and not through.jumped and not through.lies_in_itself
    assert through.passed_itself is True and 'passed through itself' in through.status
    assert linked(before) - linked(through) == pytest.approx(2, abs=1e-3)  # the grip has moved
    through.save(tmp_path / 'shape.npz')
    assert Shape.load(tmp_path / 'shape.npz').passed_itself is True
    beside = simulator.solve(LOOK((-0.2, -0.04, 0.06), (1, 0.8, 0)), before, far_end=FAR)
    assert beside.passed_itself is False and linked(beside) == pytest.approx(1, abs=1e-3)
    # of a part of the DLO, which no simulator of the whole can follow, the straight way decides
    whole = DirectSimulator(Rod.circular(1.2, 0.006, 1200, 5e7, 0.4), gravity=(0, 0, 0))
    assert passes_itself(whole, before, through) and not passes_itself(whole, before, beside)


def test_it_says_so_in_the_one_step_of_a_track_in_which_it_does(loop):
    simulator, before = loop
    ways = np.arange(1, 21) / 20
    shapes = simulator.track([between(OVER, UNDER, way) for way in ways], initial=before,
                             far_ends=[FAR] * 20)
    said = np.array([shape.passed_itself for shape in shapes])
    links = np.array([linked(shape) for shape in [before, *shapes]])
    np.testing.assert_array_equal(said, np.abs(np.diff(links)) > 1)
    assert said.sum() == 1


def test_a_plan_through_itself_is_refused_and_replay_fails(loop, monkeypatch):
    simulator, before = loop
    task, begin = MoveTo([UNDER], far_end=FAR), {'start': OVER, 'initial': before}
    with pytest.raises(Infeasible, match='waypoint 1: .* pass through itself') as refused:
        InverseSimulator(simulator).plan(task, **begin)
    assert refused.value.constraint == 'self_passage'
    with monkeypatch.context() as patch:  # a plan from elsewhere
        patch.setattr(builder, 'passes_itself', lambda *_: False)
        plan = InverseSimulator(simulator).plan(task, **begin)
    report = replay(simulator, plan, initial=before)
    assert not report.converged and not report.safe
    assert report.reason == 'on the way to waypoint 1 the DLO passes through itself'
    away = MoveTo([LOOK((-0.2, -0.04, 0.06), (1, 0.8, 0))], far_end=FAR)
    plan = InverseSimulator(simulator).plan(away, **begin)
    assert replay(simulator, plan, initial=before).converged


def test_a_motion_through_itself_says_so(loop, tmp_path):
    simulator, before = loop
    motion = simulator.simulate([between(OVER, UNDER, k / 20) for k in range(21)], 0.05, before,
                                far_ends=[FAR] * 21)
    said = [shape.passed_itself for shape in motion.shapes]
    assert motion.status == 'self-passage' and not motion.converged and len(motion) == 21
    first = said.index(True)
    assert 6 < first < 14 and all(said[first:]) and f'{0.05 * first:g} s' in motion.message
    motion.save(tmp_path / 'motion.npz')
    assert Motion.load(tmp_path / 'motion.npz').shapes[-1].passed_itself is True
    back = simulator.simulate([OVER] * 3, 0.05, before, far_ends=[FAR] * 3)
    assert back.status == 'complete' and back.shapes[-1].passed_itself is False


def test_a_twisted_rod_that_loses_two_turns_has_passed_itself():
    # above its critical twist under a tension of 25 EI / L^2 (van der Heijden and Thompson 2000)
    rod = Rod.circular(1.0, 0.004, 1000, 1e7, 0.5)
    tension = 25 * rod.stiffness[1]
    simulator = DirectSimulator(rod, gravity=(0, 0, 0), n_elements=64, basis='local',
                                point_loads=[PointLoad((tension, 0, 0))])

    def twisted(angle):
        c, s = np.cos(angle), np.sin(angle)
        return FarEnd(Pose.from_rotation((1, 0, 0), [[1, 0, 0], [0, c, -s], [0, s, c]]), 'sleeve')

    clamp = LOOK((0, 0, 0), (1, 0, 0))
    shape = simulator.solve(clamp, far_end=FarEnd(LOOK((1, 0, 0), (1, 0, 0)), 'sleeve'))
    for angle in np.arange(1.0, 25.0):
        shape = simulator.solve(clamp, shape, far_end=twisted(angle))
        if shape.jumped:
            break
        assert shape.passed_itself is False
        assert linked(shape) == pytest.approx(angle / (2 * np.pi), abs=1e-6)
    assert 17 < angle < 21
    lost = angle / (2 * np.pi) - linked(shape)
    assert lost == pytest.approx(2, abs=1e-6) and shape.passed_itself is True
    assert 'jumped, passed through itself' in shape.status


def test_how_a_free_end_falls_is_not_known():
    rod = Rod.circular(1, 0.006, 1200, 5e7, 0.4)
    simulator = DirectSimulator(rod, gravity=(0, 0, 0))
    near, far = LOOK((-0.2, 0.1, 0.06), (1, -0.2, 0.1)), LOOK((-0.2, -0.1, 0), (-1, -0.2, 0))
    held = simulator.solve(near, far_end=far)
    free = simulator.solve(near, held)  # let go: it springs straight
    assert free.jumped and np.isnan(free.passed_itself)
    assert 'passed_itself' in free.not_looked_at
    assert 'may have passed through itself' in free.status
    straight = simulator.solve(near, free)
    assert straight.passed_itself is False and 'passed_itself' not in straight.not_looked_at


def test_of_a_fall_in_which_grips_turn_far_the_link_tells_nothing(loop):
    simulator, before = loop
    for turn, known in ((0.5, True), (1.5, False)):
        roll = Rotation.from_euler('x', turn).as_matrix()
        gripper = Pose.from_rotation(OVER.position, OVER.rotation @ roll)
        after = simulator.solve(gripper, before, far_end=FAR)
        assert after.converged and after.passed_itself is False
        said = self_passage.passed_between(before, after, True)
        assert said is False if known else np.isnan(said)


def test_of_a_fall_about_a_ball_joint_the_link_tells_nothing():
    simulator = DirectSimulator(Rod.circular(1, 0.006, 1200, 5e7, 0.4), gravity=(0, 0, 0),
                                grip='pinned')
    near, far = LOOK((-0.2, 0.1, 0.06), (1, -0.2, 0.1)), LOOK((-0.2, -0.1, 0), (-1, -0.2, 0))
    shape = simulator.solve(near, far_end=far)
    assert shape.converged and np.isnan(self_passage.passed_between(shape, shape, True))


def test_what_bends_little_is_not_looked_at(monkeypatch):
    simulator = DirectSimulator(Rod(1.0, 0.05, 0.2, 0.15))
    before = simulator.solve(LOOK((0, 0, 0), (1, 0, 0)))
    monkeypatch.setattr(self_passage, 'passes_between', None)  # would raise
    assert simulator.solve(LOOK((0, 0, 0.01), (1, 0, 0.02)), before).passed_itself is False
    # by its energy: an even bend by a right angle has the least that any such bend has
    mesh = before.mesh
    assert mesh.bending_back == pytest.approx(0.5 * 0.2 * (np.pi / 2) ** 2)
    coiled = DirectSimulator(Rod(1.0, 0.05, 0.2, 0.15, natural_curvature=(2.0, 0.0))).mesh
    assert coiled.bending_back == 0
    for_good = DirectSimulator(Rod(1.0, 0.05, 0.2, 0.15, yield_curvature=3.0)).mesh
    assert for_good.bending_back == 0  # what has yielded bends without any energy


def test_without_a_radius_nobody_knows_whether_it_lies_in_itself():
    shape = DirectSimulator(Rod(1.0, 0.05, 0.2, 0.15)).solve(Pose.identity())
    assert np.isnan(shape.lies_in_itself) and 'itself' not in shape.status
    assert shape.not_looked_at == ('bend_margin', 'self_distance', 'lies_in_itself')
    thick = DirectSimulator(Rod(1.0, 0.05, 0.2, 0.15, radius=0.002)).solve(Pose.identity())
    assert thick.lies_in_itself is False
