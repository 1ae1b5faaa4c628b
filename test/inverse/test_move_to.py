# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From pose to pose with a far end that is held: as Kirchhoff's equations have it, or refused."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Sphere,
    replay,
)
from dlo_planner.tasks import MoveTo

ROD = Rod(1.0, 0.05, 0.1, 0.08, radius=2e-3)
START = Pose((0.0, 0.0, 0.0), (0, 0, 0, 1))
HELD = FarEnd(Pose((0.75, 0.1, -0.05), (0, 0, 0, 1)))
WAY = [Pose.from_rotation((0.1, 0.05, 0.1), Rotation.from_euler('yz', [0.3, -0.2]).as_matrix()),
       Pose.from_rotation((0.0, 0.15, 0.0), Rotation.from_euler('x', 0.4).as_matrix())]
INVERSE = InverseSimulator(DirectSimulator(ROD, basis='local', n_elements=128))


def between_two_grips(rod, gripper, end, guess):
    """Return positions (3, 33) and the gripper's force (3,): Kirchhoff's equations by collocation.

    Unknown: places, quaternions (w last), moments; the force at the gripper. `guess`: a Shape.
    """
    stiffness = np.array([rod.torsional_stiffness, *np.broadcast_to(rod.bending_stiffness, 2)])
    weight = rod.mass_per_length * np.array([0, 0, -9.81])

    def slopes(s, y, force):
        quaternion, moment = y[3:7], y[7:]
        turn = Rotation.from_quat(quaternion.T)
        strain = turn.inv().apply(moment.T) / stiffness
        tangent = turn.apply([1.0, 0, 0])
        inside = -force - s[:, None] * weight
        vector, real = quaternion[:3].T, quaternion[3]
        rate = np.column_stack([real[:, None] * strain + np.cross(vector, strain),
                                -(vector * strain).sum(axis=1)]) / 2
        return np.vstack([tangent.T, rate.T, -np.cross(tangent, inside).T])

    def ends(first, last, force):
        there = Rotation.from_quat(last[3:7]) * Rotation.from_quat(end.quaternion).inv()
        return np.concatenate([first[:3] - gripper.position, first[3:7] - gripper.quaternion,
                               last[:3] - end.position, there.as_rotvec()])

    turns = Rotation.from_matrix(np.array(guess.frames)).as_quat()
    for k in range(len(turns)):
        turns[k] *= np.sign(turns[k] @ (turns[k - 1] if k else gripper.quaternion))
    strains = np.vstack([guess.element_strains, guess.element_strains[-1:]])
    moments = np.einsum('nij,nj->ni', guess.frames, strains * stiffness)
    found = solve_bvp(slopes, ends, guess.s, np.vstack([guess.positions.T, turns.T, moments.T]),
                      guess.gripper_wrench[:3], tol=1e-6, max_nodes=5000)
    assert found.success, found.message
    return found.sol(np.linspace(0, 1, 33))[:3], found.p


def test_the_shapes_are_those_of_kirchhoffs_equations():
    plan = INVERSE.plan(MoveTo(WAY, HELD), start=START)
    assert len(plan) > 6 and plan.status.value == 'complete' and len(plan.stops) == 1
    np.testing.assert_array_equal(plan.grippers[0].matrix, START.matrix)
    np.testing.assert_allclose(plan.grippers[-1].matrix, WAY[-1].matrix, atol=1e-12)
    for k in range(0, len(plan), 3):
        shape = plan.shapes[k]
        assert shape.converged and shape.far_end == HELD
        places, force = between_two_grips(ROD, plan.grippers[k], HELD.pose, shape)
        np.testing.assert_allclose(shape.positions_at(np.linspace(0, 1, 33)), places.T, atol=2e-4)
        np.testing.assert_allclose(shape.gripper_wrench[:3], force, atol=0.01)
    report = replay(INVERSE.simulator, plan)
    assert report.converged and report.deviation < 1e-6
    assert np.isnan(plan.bore_moment).all()


def test_a_free_end_comes_along():
    plan = INVERSE.plan(MoveTo([WAY[0]]), start=START)
    shapes = INVERSE.simulator.track(plan.grippers)
    for planned, shape in zip(plan.shapes, shapes, strict=True):
        np.testing.assert_allclose(planned.positions, shape.positions, atol=1e-8)
    again = INVERSE.plan(MoveTo([START]), start=WAY[0], initial=plan.shapes[-1])
    np.testing.assert_allclose(again.shapes[-1].positions, plan.shapes[0].positions, atol=1e-6)


def test_a_grip_that_bears_too_much_is_named():
    shapes = INVERSE.plan(MoveTo(WAY, HELD), start=START).shapes
    near, far = (max(np.linalg.norm(getattr(shape, name)[:3]) for shape in shapes)
                 for name in ('gripper_wrench', 'far_wrench'))
    assert far > 1.001 * near  # no limit of the gripper's force notices this one
    with pytest.raises(Infeasible, match='max_force') as refused:
        INVERSE.plan(MoveTo(WAY, HELD, max_force=0.5 * (near + far)), start=START)
    assert refused.value.constraint == 'max_force' and refused.value.amount > 0
    with pytest.raises(Infeasible, match='max_moment') as refused:
        INVERSE.plan(MoveTo(WAY, HELD, max_moment=1e-3), start=START)
    assert (refused.value.constraint, refused.value.waypoint) == ('max_moment', 0)
    moments = [np.linalg.norm(shapes[0].gripper_wrench[3:]),
               np.linalg.norm(shapes[0].far_wrench[3:])]
    assert refused.value.amount == pytest.approx(max(moments) - 1e-3)


def tilted(angle):
    """Return a Pose at the origin, its x axis down by an angle."""
    return Pose((0, 0, 0), (0, np.sin(0.5 * angle), 0, np.cos(0.5 * angle)))


def test_a_leap_a_contact_and_a_sharp_bend_are_refused():
    leaf = DirectSimulator(Rod(1.0, 1e-3, (0.1, 10.0), 1.0), basis='local', n_elements=64)
    end = FarEnd(Pose((0.95, 0, 0), (0, 0, 0, 1)))
    bowed = leaf.track([tilted(-0.3), tilted(-0.1)], far_ends=[end] * 2)[-1]  # upwards
    assert bowed.converged and bowed.positions[32, 2] > 0.05
    with pytest.raises(Infeasible, match='fall into another shape') as refused:  # it snaps through
        InverseSimulator(leaf).plan(MoveTo([tilted(1.2)], end), start=tilted(-0.1), initial=bowed)
    assert refused.value.constraint == 'continuity' and refused.value.waypoint > 1
    where = INVERSE.plan(MoveTo(WAY, HELD), start=START).shapes[3].positions[64]
    beside = InverseSimulator(DirectSimulator(ROD, basis='local', n_elements=128, obstacles=[
        Sphere(where + [0, 0.02, 0], 0.03)]))
    with pytest.raises(Infeasible) as refused:
        beside.plan(MoveTo(WAY, HELD), start=START)
    assert refused.value.constraint == 'clearance'
    stiff = InverseSimulator(DirectSimulator(Rod(1.0, 0.05, 0.1, 0.08, max_bend_curvature=2.0)))
    with pytest.raises(Infeasible) as refused:
        stiff.plan(MoveTo(WAY, HELD), start=START)
    assert refused.value.constraint == 'max_bend_curvature'


@pytest.mark.parametrize(('change', 'named'), [
    ({'poses': []}, 'poses'), ({'far_end': 3}, 'far_end'), ({'max_force': 0.0}, 'max_force = 0')])
def test_nonsense_is_named(change, named):
    with pytest.raises(InvalidTask, match=named):
        MoveTo(**{'poses': WAY, **change})
    with pytest.raises(InvalidTask, match='start'):
        INVERSE.plan(MoveTo(WAY))
    free = INVERSE.simulator.solve(START)
    with pytest.raises(InvalidTask, match='initial'):
        INVERSE.plan(MoveTo(WAY, HELD), start=START, initial=free)
