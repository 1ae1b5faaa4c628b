# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through one cut-out."""

import numpy as np
import pytest
from references.hanging import ends_with_gravity_at, hanging_and_stable, sphere
from references.kirchhoff import true_rod
from scipy.spatial.transform import Rotation
from sweeps import MASS
from sweeps.cutouts import BASES, random_cutout, threaded

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
    Trajectory,
    replay,
)
from dlo_planner.inverse.continuation import Aligned, BranchPoint
from dlo_planner.plan.path import GripperPath
from dlo_planner.tasks import PlanStatus

GOAL = CutOut(Pose.looking_along((0.3, -0.2, 1.0), (1.0, 0.0, 0.0)))
STRIP = Rod(1.0, 0.2, (0.5, 2.0), 0.4, natural_curvature=(0.6, -0.3), natural_twist=0.5,
            tip_mass=0.01)
RODS = {
    'round': Rod(1.0, 0.4, 1.0, 0.75),
    'strip': STRIP,
    'stiff': Rod(1.0, 0.001, 1.0, 0.75),
    'soft': Rod(1.0, 0.9, 1.0, 0.75),
}
NORMALS = [(1, 0, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1), (1, 2, -1), (-1, 0.5, 0.4)]


def simulator(name, basis='local'):
    return DirectSimulator(RODS[name], basis=basis)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('normal', NORMALS)
@pytest.mark.parametrize('name', ['round', 'strip', 'stiff'])
def test_directly_simulated_dlo_passes_the_cutout(name, normal, basis):
    direct = simulator(name, basis)
    goal = CutOut(Pose.looking_along((0.3, -0.2, 1.0), normal))
    plan = InverseSimulator(direct).thread(goal, depths=np.linspace(0, 0.95, 12))
    assert plan.status is PlanStatus.COMPLETE
    assert plan.fraction == 1.0
    assert plan.residual.max() < 1e-8
    assert plan.stability.min() > 0
    for depth, gripper, known in zip(plan.depths, plan.grippers, plan.shapes, strict=True):
        shape = direct.solve(gripper, known)
        pierced = shape.at(1.0 - depth)
        assert np.linalg.norm(pierced.position - goal.center) < 1e-8
        assert np.linalg.norm(np.cross(pierced.direction, goal.normal)) < 1e-8
        assert pierced.direction @ goal.normal > 0


@pytest.mark.every(5)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('name', RODS)
@pytest.mark.parametrize('normal', [(1, 0, 0), (1, 2, -1)])
def test_two_methods_agree(name, normal, basis):
    inverse = InverseSimulator(simulator(name, basis))
    goal = CutOut(Pose.looking_along((0.3, -0.2, 1.0), normal))
    depths = [0.0, 0.21, 0.5, 0.9]
    plans = [inverse.thread(goal, depths=depths, method=method)
             for method in ('coupled', 'nested')]
    for one, two in zip(*(plan.grippers for plan in plans), strict=True):
        np.testing.assert_allclose(one.matrix, two.matrix, atol=1e-8)


def test_threading_the_true_rod():
    # the planned gripper, in SciPy's hands, threads the continuous rod
    direct = DirectSimulator(STRIP, accuracy=1e-6)
    plan = InverseSimulator(direct).thread(GOAL, depths=[0.0, 0.4, 0.8])
    for depth, gripper, shape in zip(plan.depths, plan.grippers, plan.shapes, strict=True):
        points = true_rod(STRIP, gripper, shape)
        at = [np.interp(1.0 - depth, shape.s, column) for column in points.T]
        assert np.linalg.norm(np.array(at) - GOAL.center) < 1e-5


def test_weightless_straight_rod_goes_straight_through():
    direct = DirectSimulator(RODS['round'], gravity=(0, 0, 0))
    plan = InverseSimulator(direct).thread(GOAL, depths=[0.0, 0.25, 1.0])
    for depth, gripper in zip(plan.depths, plan.grippers, strict=True):
        np.testing.assert_allclose(gripper.position,
                                   GOAL.center - (1.0 - depth) * GOAL.normal, atol=1e-9)


def test_plan_turns_with_the_world(rng):
    turn = Rotation.from_rotvec([0.0, 0.0, 1.1])  # about gravity
    goal = Pose.looking_along((0.3, 0.1, 0.8), (1.0, 0.4, 0.2))
    turned = Pose(turn.as_matrix() @ goal.position,
                  (turn * Rotation.from_quat(goal.quaternion)).as_quat())
    inverse = InverseSimulator(simulator('strip'))
    one, two = (inverse.thread(CutOut(pose), depths=[0.0, 0.3, 0.6]) for pose in (goal, turned))
    for here, there in zip(one.grippers, two.grippers, strict=True):
        np.testing.assert_allclose(there.position, turn.as_matrix() @ here.position, atol=1e-9)


def test_roll_stays_near_the_start_and_moves_smoothly():
    start = Pose((0, 0, 0), Rotation.from_euler('x', 70, degrees=True).as_quat())
    inverse = InverseSimulator(simulator('round'))
    plan = inverse.thread(GOAL, start=start)
    other = inverse.thread(GOAL)
    # a round rod: the same way, rolled by 70 degrees
    for one, two in zip(plan.grippers, other.grippers, strict=True):
        np.testing.assert_allclose(one.position, two.position, atol=1e-9)
        roll = Rotation.from_matrix(two.rotation.T @ one.rotation).magnitude()
        assert np.degrees(roll) == pytest.approx(70, abs=1e-6)
    turns = [Rotation.from_matrix(a.rotation.T @ b.rotation).magnitude()
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert max(turns) < 0.2


def test_twisted_strip_turns_no_more_than_it_must():
    strip = Rod(1.0, 0.05, (1.0, 4.7), 0.6, natural_curvature=(1.0, 1.8), natural_twist=-1.9)
    goal = CutOut(Pose.looking_along((0, 0, 1), (0.2, 0.92, 0.33)))
    plan = InverseSimulator(DirectSimulator(strip)).thread(goal, depths=np.linspace(0, 0.9, 30))
    turns = [Rotation.from_matrix(a.rotation.T @ b.rotation).magnitude()
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert max(turns) < 0.15  # 0.03 m of a DLO that curves by 2 / m and twists by 2 / m


def test_too_soft_a_wire_is_refused_with_evidence(wire):
    direct = DirectSimulator(wire)
    with pytest.raises(Infeasible) as caught:
        InverseSimulator(direct).thread(GOAL)
    error = caught.value
    assert error.waypoint == 0
    assert error.constraint == 'stability'
    assert error.amount == pytest.approx(0.24, abs=0.01)
    assert error.plan.status is PlanStatus.PARTIAL
    assert 'stability -0.24' in str(error)


def test_refusal_comes_where_stability_ends(wire):
    direct = DirectSimulator(wire)
    inverse = InverseSimulator(direct)
    depths = np.linspace(0.9, 0.3, 13)
    feasible = []
    for depth in depths:
        try:
            feasible.append(inverse.thread(GOAL, depths=[depth]).stability[0])
        except Infeasible:
            feasible.append(-1.0)
    signs = np.sign(feasible)
    assert signs[0] > 0 > signs[-1]
    assert (np.diff(signs) <= 0).all()
    positive = np.array(feasible)[signs > 0]
    assert (np.diff(positive) < 0).all()  # it fades before it is gone
    assert positive[-1] < 0.15


def test_plan_with_an_accuracy():
    direct = DirectSimulator(STRIP, accuracy=1e-5)
    plan = InverseSimulator(direct).thread(GOAL, depths=[0.0, 0.3, 0.6])
    assert all(shape.error_estimate <= 1e-5 for shape in plan.shapes)
    assert plan.misalignment.max() < 1e-8


@pytest.mark.parametrize('name', RODS)
def test_one_depth_needs_no_others(name):
    direct = simulator(name)
    inverse = InverseSimulator(direct)
    alone = inverse.thread(GOAL, depths=[0.62])
    many = inverse.thread(GOAL, depths=np.linspace(0, 0.62, 5))
    for plan in (alone, many):
        # its gripper alone, without the plan's shape to start from, threads the DLO
        there = direct.solve(plan.grippers[-1]).at(0.38)
        np.testing.assert_allclose(there.position, GOAL.center, atol=1e-8)
        np.testing.assert_allclose(there.direction, GOAL.normal, atol=1e-8)
    if name != 'strip':  # the free rotation of a round DLO is its roll: the gripper's place is one
        np.testing.assert_allclose(alone.grippers[0].position, many.grippers[-1].position,
                                   atol=1e-8)
        np.testing.assert_allclose(alone.grippers[0].direction, many.grippers[-1].direction,
                                   atol=1e-8)


def test_a_dlo_that_is_set_is_threaded_as_it_is():
    # its own weight bends it by 0.5 / m at most, it yields at 0.8 / m
    soft = Rod.circular(0.4, 1.5e-3, 8960.0, 110e9, 0.34, yield_stress=66e6,
                        section_model='ideal')  # fibers left under stress yield again earlier
    new = DirectSimulator(soft, basis='local', n_elements=64)
    bent = new.solve(Pose((0, 0, 1), (0, 0, 0, 1)), far_end=Pose((0.3, 0.1, 1), (0, 0, 0, 1)))
    assert bent.dissipated > 0
    used = new.with_set(bent)
    goal = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    depths = [0.05, 0.2, 0.35]
    plan = InverseSimulator(used).thread(goal, depths=depths)
    fresh = InverseSimulator(new).thread(goal, depths=depths)
    assert np.linalg.norm(plan.grippers[0].position - fresh.grippers[0].position) > 1e-3
    for gripper, depth, shape in zip(plan.grippers, depths, plan.shapes, strict=True):
        real = used.solve(gripper)
        assert real.dissipated == bent.dissipated  # it does not yield any further
        np.testing.assert_allclose(real.at(0.4 - depth).position, goal.center, atol=1e-6)
        np.testing.assert_allclose(real.positions, shape.positions, atol=1e-6)


def test_random_cutouts_replay_or_their_refusal_is_confirmed():
    rng = np.random.default_rng(3)
    outcomes = [threaded(*random_cutout(rng), BASES[k % 2]).what for k in range(60)]
    assert set(outcomes) == {'replayed', 'confirmed'}
    assert outcomes.count('replayed') > 50


@pytest.mark.parametrize('basis', BASES)
def test_a_start_is_found_where_the_dlo_hardly_stands(basis):
    rng = np.random.default_rng(1)
    for _ in range(175):
        task = random_cutout(rng)  # the last one: stability 4e-4, in a sixth of all rolls
    assert threaded(*task, basis).what == 'replayed'


@pytest.mark.parametrize('seed', range(3))
def test_what_confirms_knows_the_shapes_and_their_stability(seed):
    rod, _ = random_cutout(np.random.default_rng(seed))
    direct = DirectSimulator(rod, basis='local', n_elements=96)
    frames, stable = hanging_and_stable(rod, np.array([0, 0, -9.81 * MASS]),
                                        ends_with_gravity_at(sphere(40)))
    seen = 0
    for k in range(40):
        guess = direct.solve(Pose.from_rotation((0, 0, 0), frames[0, k]))
        if np.abs(guess.frames[-1] - frames[-1, k]).max() < 0.02:
            seen += 1
            assert stable[k] and guess.stability > 0
            np.testing.assert_allclose(guess.frames, frames[:, k], atol=2e-3)
    assert 5 < seen <= stable.sum()


AHEAD = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0)))


@pytest.mark.parametrize('options', [{'basis': 'local', 'n_elements': 64}, {'n_elements': 64}, {}])
@pytest.mark.parametrize('bent', [(0.0, 0.0), (0.5, -0.8)])
def test_plans_are_the_same_with_fewer_steps(options, bent, monkeypatch):
    rod = Rod(1.0, 0.1, (0.3, 0.5), 0.4, natural_curvature=bent)
    inverse, depths = InverseSimulator(DirectSimulator(rod, **options)), np.linspace(0, 0.8, 41)
    ahead = inverse.thread(AHEAD, depths=depths)
    monkeypatch.setattr(BranchPoint, 'trend', lambda branch_point, depth: None)
    monkeypatch.setattr(Aligned, 'batch_ahead', lambda *_: [])  # it knows of trends by itself
    from_before = inverse.thread(AHEAD, depths=depths)
    for one, other in zip(ahead.grippers, from_before.grippers, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-9)
    np.testing.assert_allclose(ahead.stability, from_before.stability, rtol=1e-3)
    steps = [sum(shape.iterations for shape in plan.shapes) for plan in (ahead, from_before)]
    assert steps[0] < steps[1]


HOSE = Rod.tube(0.5, 0.016, 0.010, 1150.0, 8e6, 0.49, natural_curvature=(0.0, 0.5))


def test_a_dlo_that_hardly_stands_is_threaded_without_corners():
    normal = (0.0241, -0.6319, 0.7747)  # steeply upwards: the hose nearly falls aside
    hole = CutOut(Pose.looking_along((0, 0, 1), normal), radius=0.014)
    start = Pose((-0.159, 0.492, 0.591), (-0.2302, -0.3503, -0.4986, 0.7587))
    direct = DirectSimulator(HOSE)
    plan = InverseSimulator(direct).thread(hole, start=start, depths=np.linspace(0, 0.35, 40))
    assert plan.stability.min() > 0.04
    turns = [Rotation.from_matrix(after.rotation @ before.rotation.T).magnitude()
             for before, after in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert sum(turns) > 0.5  # it rolls
    assert np.abs(np.diff(turns)).max() < 0.02  # and evenly
    assert len(GripperPath.of(plan).legs) == 1
    report = replay(direct, plan)
    assert report.converged and report.position_error < 1e-6 and report.misalignment < 1e-6
    assert Trajectory(plan, tolerance=np.inf).duration < 10
