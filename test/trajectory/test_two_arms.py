# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that two arms carry, in time: within the limits of both, calm, proved, robust to grasps."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    InvalidTask,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sphere,
    Trajectory,
    Uncertainty,
    replay,
    robustness,
)
from dlo_planner.plan.path import GripperPath, Leg
from dlo_planner.plan.plan import concatenate
from dlo_planner.tasks import Carry, MoveTo
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.timed_path import most_used
from dlo_planner.trajectory.topp import fastest_rates

ROD = Rod.circular(0.6, 0.008, 1500, 2e8, 0.4, damping=0.005)
AHEAD = (0, 0, 0, 1)
BEGIN = Pose((0.0, 0.0, 0.0), AHEAD), Pose((0.45, 0.0, 0.0), AHEAD)
# the far end goes farther than the gripper, and turns
END = Pose((0.0, 0.1, 0.0), AHEAD), Pose.looking_along((0.4, 0.2, 0.05), (1, 0.3, 0))
DIRECT = DirectSimulator(ROD, n_elements=24, basis='local')
BALL = Sphere((0.2, 0.3, -0.15), 0.05, name='ball')
QUICK = Limits(0.3, 1.0, 1.0, 4.0, 20.0, 80.0)


@cache
def carried():
    """Return the Plan."""
    inverse = InverseSimulator(DirectSimulator(ROD, n_elements=24, basis='local', obstacles=[BALL]))
    return inverse.plan(Carry(END[0], END[1], far_end=FarEnd(BEGIN[1]), max_force=8.0),
                        start=BEGIN[0])


@cache
def calm():
    """Return the Trajectory of it."""
    return Trajectory(carried(), QUICK, tolerance=2e-3, simulator=DIRECT, obstacles=[BALL])


def differences(poses, dt):
    """Return linear and angular speeds (n - 1,) of poses, by differences."""
    places = np.array([pose.position for pose in poses])
    turns = np.array([pose.rotation for pose in poses])
    angles = np.arccos(np.clip((np.einsum('nij,nij->n', turns[1:], turns[:-1]) - 1) / 2, -1, 1))
    return np.linalg.norm(np.diff(places, axis=0), axis=1) / dt, angles / dt


def test_both_arms_keep_their_limits_and_end_together():
    trajectory = Trajectory(carried(), QUICK, tolerance=np.inf)
    times = np.linspace(0, trajectory.duration, 2001)
    used = []
    for motion in (trajectory, trajectory.arm('far_end')):
        poses, speeds, accelerations = motion.at(times)
        for measured, stated in zip(differences(poses, times[1]), (speeds[:, :3], speeds[:, 3:]),
                                    strict=True):
            known = np.linalg.norm(stated, axis=1)
            np.testing.assert_allclose(measured, 0.5 * (known[1:] + known[:-1]), atol=2e-3)
        sizes = np.linalg.norm(speeds.reshape(-1, 2, 3), axis=2).max(axis=0)
        assert (sizes <= QUICK.sizes[0] * (1 + 1e-9)).all()
        assert (np.linalg.norm(accelerations.reshape(-1, 2, 3), axis=2).max(axis=0)
                <= QUICK.sizes[1] * (1 + 1e-9)).all()
        used.append(max(sizes / QUICK.sizes[0]))
    # both legs of the far end at its speed limit, but for what the limits of jerk take
    assert trajectory.duration < 1.5 * carried().times[-1]
    assert used[1] > 0.9 > used[0]  # the far end is what takes the time
    np.testing.assert_allclose(poses[-1].matrix, END[1].matrix, atol=1e-9)


def test_rates_and_bounds_are_those_of_the_arm_that_needs_them():
    # the far end goes slowly at first, and three times as fast later
    times = np.arange(5.0)
    grippers = [Pose((0.0, 0.05 * u, 0.0), AHEAD) for u in times]
    ends = [Pose((0.45, y, 0.0), AHEAD) for y in (0.0, 0.02, 0.04, 0.16, 0.31)]
    both, = GripperPath.through(grippers, times, 0.6, arms={'far_end': ends}).legs
    own, other = Leg(both.knots, both.positions, both.rotations), both.others[0]
    places, rates = fastest_rates(both, QUICK)
    later = 3 * len(rates) // 4
    alone = [fastest_rates(leg, QUICK)[1][later] for leg in (own, other)]
    # where the far end is fast both are as slow as that is
    assert rates[later] == pytest.approx(alone[1], rel=1e-3) and alone[0] > 2 * alone[1]
    assert rates[len(rates) // 4] > 2 * rates[later]
    law = TimeLaw(places, rates, np.array([0.1]))
    used = [most_used(leg, law, QUICK) for leg in (own, other)]
    assert most_used(both, law, QUICK) == used[1] > 1.1 * used[0]


def test_the_dlo_arrives_calm_between_both_arms():
    trajectory = calm()
    assert trajectory.status == 'complete' and trajectory.motion.departure <= 2e-3
    assert trajectory.motion.clearance > 0 and np.isnan(trajectory.motion.position_error)
    # simulated apart, in steps of its own
    times = np.linspace(0, trajectory.duration + 1.0, 300)
    ends = [FarEnd(pose) for pose in trajectory.arm('far_end').poses(times)]
    motion = DIRECT.simulate(trajectory.poses(times), times[1], far_ends=ends)
    assert motion.converged
    after = times >= trajectory.duration
    rest = DIRECT.solve(END[0], carried().shapes[-1], far_end=FarEnd(END[1])).positions
    swings = [np.abs(shape.positions - rest).max()
              for shape, later in zip(motion.shapes, after, strict=True) if later]
    assert max(swings) < 2.2e-3
    forces = max(np.linalg.norm(wrench[:3]) for shape in motion.shapes
                 for wrench in (shape.gripper_wrench, shape.far_wrench))
    # the worse of two runs, one of them without damping
    assert 0.9 * forces < trajectory.motion.grip_force < 1.5 * forces


def test_a_grip_that_would_pull_too_hard_in_motion_is_not_safe():
    plan = carried()
    at_rest = plan.largest_force.max()
    assert calm().motion.grip_force > 1.0001 * at_rest
    between = replace(plan, wrench_limits=(0.5 * (at_rest + calm().motion.grip_force), None))
    report = replay(DIRECT, between, trajectory=calm())
    assert 'in motion a grip would exert' in report.reason and 'max_force' in report.reason
    report = replay(DIRECT, replace(plan, wrench_limits=(0.5 * at_rest, None)))
    assert 'at waypoint' in report.reason and 'max_force' in report.reason


def test_a_replay_proves_both_arms():
    report = replay(DIRECT, carried(), trajectory=calm(), obstacles=[BALL])
    assert report.safe, report.reason
    assert report.deviation < 1e-6 and report.clearance > 0
    # of a DLO that is not this one
    other = DirectSimulator(replace(ROD, bending_stiffness=0.12), n_elements=24, basis='local')
    assert not replay(other, carried(), trajectory=calm()).safe


def test_the_file_keeps_all_arms(tmp_path):
    for name in ('motion.npz', 'motion.json'):
        calm().save(tmp_path / name)
        again = Trajectory.load(tmp_path / name)
        assert again == calm() and again.path.arms == ('far_end',)
        assert again.arm('far_end').poses([0.3]) == calm().arm('far_end').poses([0.3])


def test_stages_that_are_held_differently_are_one_after_the_other():
    inverse = InverseSimulator(DIRECT)
    held = inverse.plan(MoveTo([END[0]], FarEnd(BEGIN[1])), start=BEGIN[0])
    free = inverse.plan(MoveTo([END[0]]), start=BEGIN[0])
    mixed = replace(held, shapes=(*held.shapes[:-1], free.shapes[-1]))
    with pytest.raises(InvalidTask, match='expected one stage, in which the same places are held'):
        Trajectory(mixed, QUICK, tolerance=2e-3, simulator=DIRECT)
    with pytest.raises(InvalidTask, match='plan has 2 stages'):
        robustness(DIRECT, mixed, Uncertainty(gripper_position=1e-3))
    there = concatenate(carried(), inverse.plan(
        MoveTo([BEGIN[0]], FarEnd(END[1]), far_ends=[BEGIN[1]]), start=END[0],
        initial=carried().shapes[-1]))
    assert len(Trajectory(there, QUICK, tolerance=np.inf).path.legs) == 2


def test_grasp_errors_of_both_arms_move_the_dlo_as_differences_say():
    uncertainty = Uncertainty(gripper_position=1e-4, gripper_rotation=2e-3, bending_stiffness=0.02)
    found = robustness(DIRECT, carried(), uncertainty, samples=200, seed=3)
    shape, names = carried().shapes[-1], list(found.causes)
    # each grip turned about each axis, and displaced along it, by a solution of its own
    squares = {name: np.zeros(shape.s.size) for name in ('gripper_rotation', 'gripper_position')}
    for k in range(2):
        for axis in np.eye(3):
            for name, size in (('gripper_rotation', 2e-3), ('gripper_position', 1e-4)):
                poses = [shape.gripper, shape.far_end.pose]
                place, turn = poses[k].position, poses[k].rotation
                if name == 'gripper_rotation':
                    turn = turned(axis * size) @ turn
                else:
                    place = place + axis * size
                poses[k] = Pose.from_rotation(place, turn)
                moved = DIRECT.solve(poses[0], shape, far_end=FarEnd(poses[1]))
                squares[name] += ((moved.positions - shape.positions)**2).sum(axis=1)
    for name, total in squares.items():
        assert found.by_cause[-1, names.index(name)] == pytest.approx(
            np.sqrt(total.max()), rel=0.02)
    assert found.by_cause[-1, names.index('bending_stiffness')] > 1e-5
    # a sample's farthest place is about twice as far off as the root mean square of one place
    spread = np.sqrt((found.sampled[:, -1]**2).mean())
    assert found.first_order[-1] < 1.3 * spread < 3 * found.first_order[-1]
    assert found.success == 1.0  # the ball is far


def turned(vector):
    """Return the rotation matrix of a small vector, rad, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
