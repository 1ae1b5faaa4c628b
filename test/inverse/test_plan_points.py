"""The deepest that a threading comes; waypoints one by one; plans in files."""

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
    joined,
)

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
        assert point.clearance == plan.clearance[k] and point.miss == plan.miss[k]
    with pytest.raises(IndexError):
        plan[len(plan)]


def test_a_plan_in_a_file(tmp_path):
    inverse = planner(np.inf)
    plan = inverse.thread(HOLE, depths=DEPTHS)
    whole = joined(inverse.start_phase(HOLE, plan, Pose((-1.2, 0, 1), (0, 0, 0, 1))), plan)
    for made in (plan, whole):
        made.save(tmp_path / 'plan.npz')
        again = Plan.load(tmp_path / 'plan.npz')
        for name in ('depths', 'times', 'miss', 'misalignment', 'clearances'):
            np.testing.assert_array_equal(getattr(again, name), getattr(made, name))
        assert again.stops == made.stops and again.status is made.status
        assert again.sheets[0][0] == made.sheets[0][0] and again.fraction == made.fraction
        assert [len(one) for one in again.passes] == [len(one) for one in made.passes]
        for one, other in zip(again, made, strict=True):
            np.testing.assert_allclose(one.gripper.matrix, other.gripper.matrix, atol=1e-14)
            np.testing.assert_array_equal(one.shape.positions, other.shape.positions)
    direct = DirectSimulator(WIRE)
    known, stored = (Trajectory(one, tolerance=2e-3, simulator=direct) for one in (whole, again))
    assert stored.duration == pytest.approx(known.duration, rel=1e-6)
    with pytest.raises(InvalidTask, match='simulator'):
        Trajectory(again)
    (tmp_path / 'other.npz').write_bytes(b'no plan')
    with pytest.raises(InvalidTask, match='path'):
        Plan.load(tmp_path / 'other.npz')
