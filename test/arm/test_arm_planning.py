# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Joint trajectories of Panda, UR5, Kinova: the tool by hand, limits, speeds, rolls, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from misuse import MALFORMED, outcome
from robot_arms import (
    PANDA_READY,
    UR5_READY,
    kinova,
    panda,
    placed_by_hand,
    timed,
    ur5,
    way,
)
from scipy.interpolate import BPoly, PPoly
from scipy.spatial.transform import Rotation
from specimens import LEVEL, values

from dlo_planner import (
    DeadlineExceeded,
    DirectSimulator,
    Infeasible,
    Limits,
    PointLoad,
    Pose,
    Rod,
)
from dlo_planner.arm import Arm, JointTrajectory, joint_trajectory, rolls_freely
from dlo_planner.arm.follow import smallest_distance
from dlo_planner.arm.inverse_kinematics import IKFailure
from dlo_planner.model.pose import angle_between

TOOL = Pose((0.02, -0.01, 0.1), (0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)))  # x along the tool's z
ELSEWHERE = Pose((2.0, -1.0, 0.5), (0.1, -0.2, 0.4, 0.9))


def check(made, trajectory, arm, tool=None, limit=1e-4):
    """Compare with the gripper's trajectory by hand, at the points and between; and the limits."""
    back = (tool or Pose.identity()).inverse()
    roll = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec([made.roll, 0, 0]).as_matrix())
    states = np.stack([made.positions, made.velocities, made.accelerations], axis=1)
    curve = BPoly.from_derivatives(made.times, states)
    steps = np.diff(made.times)
    times = np.sort(np.concatenate([made.times, *(made.times[:-1] + part * steps
                                                  for part in (0.21, 0.5, 0.83))]))
    positions = curve(times)
    worst = [0.0, 0.0]
    for gripper, one in zip(trajectory.at(times)[0], positions, strict=True):
        wanted = gripper.compose(roll).compose(back)
        is_ = arm.base.matrix @ placed_by_hand(arm.urdf, arm.tool_link,
                                               dict(zip(arm.joints, one, strict=True)))
        worst = np.maximum(worst, (np.linalg.norm(is_[:3, 3] - wanted.position),
                                   angle_between(is_[:3, :3], wanted.rotation)))
    assert worst.max() <= limit
    assert worst.max() <= 1.2 * max(made.position_error, made.angle_error) + 1e-9
    assert ((positions >= arm.lower) & (positions <= arm.upper)).all()
    assert (np.abs(curve(times, 1)) <= arm.speeds).all()
    for order, mine in enumerate(made.at(times)):
        np.testing.assert_allclose(mine, curve(times, order), atol=1e-6 * 100.0**order)
    assert made.duration == pytest.approx(trajectory.duration)
    assert not made.velocities[[0, -1]].any()
    distances = [arm.collision.distances(one).min() for one in positions[::3]]
    assert min(distances) >= 0.99 * made.self_clearance > 0


@pytest.mark.every(3)
@pytest.mark.parametrize('ready', [True, False])
@pytest.mark.parametrize('arm, positions', [
    (panda, PANDA_READY), (ur5, UR5_READY), (kinova, np.array([7.0, 2.9, 1.5, -4.0, 1.6, 0.5]))])
def test_the_tool_follows_the_gripper(arm, positions, ready):
    arm = arm()
    begin = arm.pose(positions).compose(TOOL)
    trajectory = timed(way(begin, (-0.05, 0.12, 0.08), (0.2, -0.3, 0.4)), Limits(0.05, 0.2))
    made = joint_trajectory(trajectory, arm, TOOL, current=positions if ready else None)
    check(made, trajectory, arm, TOOL)
    assert made.joint_names == arm.joints
    assert made.roll == 0
    assert made.not_looked_at == ()
    if ready:
        np.testing.assert_allclose(made.positions[0], positions, atol=1e-6)


@pytest.mark.sweep
def test_a_plan_for_a_dlo(rng):
    trajectory = values()['Trajectory']
    reachable = trajectory.at([0.0])[0][0]
    stands = reachable.compose(TOOL.inverse()).compose(ur5().pose(UR5_READY).inverse())
    arm = ur5(base=stands)
    check(joint_trajectory(trajectory, arm, TOOL, current=UR5_READY), trajectory, arm, TOOL)


def test_it_stops_and_turns_with_the_trajectory():
    arm = ur5()
    begin = arm.pose(UR5_READY)
    there = way(begin, (0.0, 0.1, 0.0))
    poses = [*there, *way(there[-1], (0.0, 0.0, 0.1))[1:], *[way(begin, (0, 0.1, 0.1))[-1]] * 2,
             *way(begin, (0.0, 0.1, 0.1), (0.3, 0.0, 0.0))[::-1][-3:]]
    trajectory = timed(poses)
    assert len(trajectory.path.legs) >= 3
    made = joint_trajectory(trajectory, arm, current=UR5_READY)
    check(made, trajectory, arm)
    for stop in trajectory.starts:
        assert not made.velocities[np.argmin(np.abs(made.times - stop))].any()


def test_where_the_arm_stands_changes_nothing():
    begin = panda().pose(PANDA_READY)
    made = joint_trajectory(timed(way(begin, (0, 0.1, 0))), panda(), current=PANDA_READY)
    moved = [ELSEWHERE.compose(pose) for pose in way(begin, (0, 0.1, 0))]
    other = joint_trajectory(timed(moved), panda(base=ELSEWHERE), current=PANDA_READY)
    np.testing.assert_allclose(other.positions, made.positions, atol=1e-5)


def test_the_nearest_configuration_is_taken():
    trajectory = timed(way(ur5().pose(UR5_READY), (0, 0.1, 0)))
    aside = UR5_READY + [0.3, 0.2, -0.2, 0.3, 0.2, 0.5 - 2 * np.pi]
    made = joint_trajectory(trajectory, ur5(), current=aside)
    np.testing.assert_allclose(made.positions[0], UR5_READY + [0, 0, 0, 0, 0, -2 * np.pi],
                               atol=1e-6)


@pytest.mark.every(3)
@pytest.mark.parametrize('arm, positions, free', [
    (panda, PANDA_READY, False), (ur5, UR5_READY, False), (ur5, UR5_READY, True)])
def test_out_of_reach_is_refused_with_the_waypoint(arm, positions, free):
    arm = arm()
    poses = way(arm.pose(positions), (3.0, 0.0, 0.0), number=13)
    # stretched out, no arm is longer than all its links
    far = arm.chain.placement(np.clip(np.zeros(positions.size), arm.lower, arm.upper))[0]
    most = np.linalg.norm(far) + 0.5
    unreachable = next(k for k, pose in enumerate(poses) if np.linalg.norm(pose.position) > most)
    with pytest.raises(Infeasible, match=r'arm, on the way to waypoint \d+, after') as refused:
        joint_trajectory(timed(poses), arm, current=positions, free_roll=free)
    assert refused.value.constraint in ('reach', 'continuity')
    assert 1 <= refused.value.waypoint <= unreachable


def test_a_beginning_out_of_reach_is_waypoint_0():
    with pytest.raises(Infeasible, match=r'waypoint 0.* m and .* rad are left') as refused:
        joint_trajectory(timed(way(Pose((5, 0, 0), (0, 0, 0, 1)), (0.1, 0, 0))), ur5())
    assert refused.value.waypoint == 0
    assert refused.value.constraint == 'reach'
    assert refused.value.amount == pytest.approx(5 - 0.95, abs=0.25)  # the UR5 reaches 0.95 m


def turning(arm, positions, angle):
    """Return the trajectory of a gripper that turns about its x axis, the tool's z axis."""
    begin = arm.pose(positions).compose(TOOL)
    return timed(way(begin, (0.05, 0.02, 0.0), angle * begin.direction, 41))


def test_a_joint_at_its_limit_is_named():
    arm, positions = ur5('ur5_joint_limited_robot'), UR5_READY * [1, 1, 1, 1, 1, 0]
    with pytest.raises(Infeasible, match=r'wrist_3_joint = .* rad: expected -3.14159 to 3.14159'
                       ) as refused:
        joint_trajectory(turning(arm, positions, 5.5), arm, TOOL, current=positions)
    assert refused.value.constraint == 'joint_limit'
    assert 0 < refused.value.amount < 0.1
    # the last joint does most of the turn
    assert 41 * 0.4 < refused.value.waypoint < 41 * 0.8


@pytest.mark.sweep
def test_a_roll_helps_where_it_is_free():
    arm, positions = ur5('ur5_joint_limited_robot'), UR5_READY * [1, 1, 1, 1, 1, 0]
    trajectory = turning(arm, positions, 5.5)
    with pytest.raises(Infeasible):
        joint_trajectory(trajectory, arm, TOOL)
    made = joint_trajectory(trajectory, arm, TOOL, free_roll=True)
    assert 0 < abs(made.roll) <= np.pi
    check(made, trajectory, arm, TOOL)


def test_no_roll_where_none_is_needed():
    trajectory = turning(ur5(), UR5_READY, 1.0)
    assert joint_trajectory(trajectory, ur5(), TOOL, free_roll=True).roll == 0


def test_speeds_are_refused_with_the_factor_that_would_do():
    arm = ur5()
    poses = way(arm.pose(UR5_READY), (-0.1, 0.15, 0.1), (0.3, 0.2, 0.0))
    quick = Limits(1.5, 6.0, 20.0, 60.0, 400.0, 1e3)
    with pytest.raises(Infeasible, match=r'_joint moves at .* rad/s: expected at most') as refused:
        joint_trajectory(timed(poses, quick), arm, current=UR5_READY)
    assert refused.value.constraint == 'joint_speed'
    factor = float(str(refused.value).rsplit('have to be ', 1)[1].split()[0])
    assert factor > 1
    for slower, works in ((1.01 * factor, True), (0.99 * factor, False)):
        limits = Limits(*(size / slower**order for size, order in zip(
            (1.5, 6.0, 20.0, 60.0, 400.0, 1e3), (1, 1, 2, 2, 3, 3), strict=True)))
        trajectory = timed(poses, limits)
        if works:
            check(joint_trajectory(trajectory, arm, current=UR5_READY), trajectory, arm)
        else:
            with pytest.raises(Infeasible, match='times slower'):
                joint_trajectory(trajectory, arm, current=UR5_READY)


def test_links_that_come_together_are_named():
    arm = ur5()
    # the elbow closes until the wrist is in the upper arm
    bends = [UR5_READY + part * np.array([0, 0, 1.25, -1.2, 0, 0]) for part in np.linspace(0, 1, 9)]
    trajectory = timed([arm.pose(one) for one in bends])
    assert arm.collision.distances(bends[0]).min() > 0
    assert arm.collision.distances(bends[-1]).min() < 0
    with pytest.raises(Infeasible, match='_link and .*_link come together: their distance is'
                       ) as refused:
        joint_trajectory(trajectory, arm, current=UR5_READY)
    assert refused.value.constraint == 'self_collision'
    first = next(k for k, one in enumerate(bends) if arm.collision.distances(one).min() < 0)
    assert abs(refused.value.waypoint - first) <= 1
    # the same way with no shapes to be looked at is made, and says so
    blind = Arm(arm.urdf, 'tool0')
    made = joint_trajectory(trajectory, blind, current=UR5_READY)
    assert np.isnan(made.self_clearance)
    assert len(made.not_looked_at) == 7


def test_links_that_come_together_between_two_samples_are_found():
    arm = ur5()
    bent = np.array([0, 0, 1.25, -1.2, 0, 0])  # there and back from one sample to the next
    with pytest.raises(IKFailure, match='come together'):
        smallest_distance(arm, PPoly(np.array([-4 * bent, 4 * bent, UR5_READY])[:, None], [0, 1]),
                          lambda: None)


def test_between_far_points_the_tool_is_where_it_shall_be(monkeypatch):
    monkeypatch.setattr('dlo_planner.arm.follow._STEP', 0.4)
    arm = ur5()
    trajectory = timed(way(arm.pose(UR5_READY), (-0.05, 0.12, 0.08), (0.2, -0.3, 0.4)),
                       Limits(0.05, 0.2))
    made = joint_trajectory(trajectory, arm, current=UR5_READY)
    check(made, trajectory, arm, limit=3e-5)


def test_a_clearance_is_kept():
    trajectory = timed(way(ur5().pose(UR5_READY), (0, 0.1, 0)))
    least = joint_trajectory(trajectory, ur5(), current=UR5_READY).self_clearance
    assert 0.001 < least < 0.1
    # far from what is needed, pairs that are always nearer are not looked at
    with pytest.raises(Infeasible, match='expected at least'):
        joint_trajectory(trajectory, ur5(self_clearance=1.05 * least), current=UR5_READY)


def test_links_keep_a_margin_by_default():
    bare = ur5(self_clearance=0.0)
    near = next(one for one in np.linspace(UR5_READY, UR5_READY + [0, 0, 1.25, -1.2, 0, 0], 400)
                if bare.collision.distances(one).min() < 0.004)
    trajectory = timed([bare.pose(near)] + [
        bare.pose(near + [0.1 * part, 0, 0, 0, 0, 0]) for part in (0.5, 1.0)])
    assert 0 < joint_trajectory(trajectory, bare, current=near).self_clearance < 0.005
    with pytest.raises(Infeasible, match='expected at least 0.005 m'):
        joint_trajectory(trajectory, ur5(), current=near)


def test_seven_joints_stay_off_their_limits_where_the_least_motion_does_not():
    arm = panda()
    positions = np.array([0.0, 0.4, 0.0, -2.2, 0.0, 2.6, 2.2])
    trajectory = timed(way(arm.pose(positions), (0.0, -0.1, 0.0),
                           1.0 * arm.pose(positions).rotation[:, 2], 21))
    plain = positions
    for target in trajectory.at(np.linspace(0, trajectory.duration, 400))[0]:
        off, jacobian = arm.chain.off(plain, target.position, target.rotation)
        plain = plain + np.linalg.pinv(jacobian) @ off
    assert (plain > arm.upper).any() or (plain < arm.lower).any()
    check(joint_trajectory(trajectory, arm, current=positions), trajectory, arm)


def test_the_deadline_is_kept():
    poses = way(panda().pose(PANDA_READY), (0.2, 0.1, 0.1), (0, 0.5, 0))
    with pytest.raises(DeadlineExceeded, match='deadline = 0.01 s'):
        joint_trajectory(timed(poses), panda(), free_roll=True, deadline=0.01)


ROUND = Rod(1.0, 0.1, 1.0, 0.7)
RODS = {
    'round': (ROUND, True),
    'round, of a section': (Rod.circular(1.0, 0.004, 1000.0, 1e10, 0.3), True),
    'a strip': (Rod(1.0, 0.1, (1.0, 2.0), 0.7), False),
    'square': (Rod.rectangular(1.0, 0.01, 0.01, 1000.0, 1e9, 0.3), False),  # touches by corners
    'bent': (Rod(1.0, 0.1, 1.0, 0.7, natural_curvature=(0.0, 0.5)), False),
    'twisted': (Rod(1.0, 0.1, 1.0, 0.7, natural_twist=0.5), False),
    'a strip in a part': (Rod(1.0, 0.1, (1.0, ((0.0, 1.0), (0.8, 1.0), (1.0, 3.0))), 0.7), False),
    'one that yields': (Rod(1.0, 0.1, 1.0, 0.7, yield_curvature=0.5), False),
}


@pytest.mark.parametrize('name', RODS)
def test_whether_a_roll_is_free(name):
    rod, free = RODS[name]
    assert rolls_freely(DirectSimulator(rod), values()['Plan']) is free


@pytest.mark.parametrize('name', ['round', 'a strip', 'bent'])
def test_the_simulator_agrees(name):
    rod, free = RODS[name]
    simulator = DirectSimulator(rod, n_elements=16, n_terms=6,
                                point_loads=[PointLoad((0.0, 0.3, 0.0))])
    turn = Rotation.from_rotvec([0.7, 0.0, 0.0]).as_matrix()
    rolled = LEVEL.compose(Pose.from_rotation((0, 0, 0), turn))
    off = np.abs(simulator.solve(rolled).positions - simulator.solve(LEVEL).positions).max()
    assert bool(off < 1e-6) is free


def test_a_held_far_end_keeps_the_roll():
    simulator = DirectSimulator(ROUND, n_elements=8, n_terms=4)
    held = simulator.solve(LEVEL, far_end=(0.8, 0.0, 1.0))
    plan = values()['Plan']
    assert not rolls_freely(simulator, replace(plan, shapes=(held,) * len(plan)))


def good_arguments():
    """Return good arguments of each public callable, for those that are malformed."""
    times = np.linspace(0.0, 1.0, 6)
    return {
        joint_trajectory: {'trajectory': timed(way(ur5().pose(UR5_READY), (0, 0.02, 0))),
                           'arm': ur5(), 'tool': Pose.identity(), 'current': UR5_READY,
                           'free_roll': False, 'deadline': 1e9},
        rolls_freely: {'simulator': DirectSimulator(ROUND), 'plan': values()['Plan']},
        JointTrajectory: {'joint_names': ('a', 'b'), 'times': times, 'roll': 0.3,
                          **dict.fromkeys(('positions', 'velocities', 'accelerations'),
                                          np.ones((6, 2))),
                          **dict.fromkeys(('position_error', 'angle_error', 'self_clearance'),
                                          1e-3), 'not_looked_at': ('hand',)}}


@pytest.mark.parametrize('function', [joint_trajectory, rolls_freely, JointTrajectory])
def test_malformed_arguments_are_refused_by_name(function):
    good = good_arguments()[function]
    wrong = {(argument, label): outcome(function, {**good, argument: make()}, argument, (argument,))
             for argument in good for label, make in MALFORMED.items()}
    assert not {which: what for which, what in wrong.items() if what}
