"""Clearance, trajectory and report of a plan, against brute force, differences and limits."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Trajectory,
    replay,
)
from dlo_planner.inverse.clearance import clearance
from dlo_planner.inverse.plan import joined

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.5, 0.01))
DIRECT = DirectSimulator(WIRE)
ROUND = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)


@pytest.fixture(scope='module')
def plan():
    return InverseSimulator(DIRECT).thread(ROUND, depths=np.linspace(0, 0.9, 40))


def brute(shape, outside):
    """Return the least of a function of (n, 3) points over the DLO, looked at closely."""
    return outside(shape.positions_at(np.linspace(0, shape.s[-1], 40_001))).min() - WIRE.radius


def test_clearance_in_a_round_hole(plan):
    def outside(points):
        across = np.maximum(ROUND.radius - np.hypot(points[:, 1], points[:, 2] - 1), 0)
        return np.hypot(across, points[:, 0])

    for index in (0, 13, 39):
        assert plan.clearance[index] == pytest.approx(brute(plan.shapes[index], outside), abs=1e-8)
    # aligned with the axis, the whole radius is left
    np.testing.assert_allclose(plan.clearance, ROUND.radius - WIRE.radius, rtol=1e-3)


def test_clearance_from_a_ball(plan):
    ball = Sphere((-0.3, 0.0, 0.8), 0.05)

    def outside(points):
        return np.linalg.norm(points - ball.centre, axis=1) - ball.radius

    shape = plan.shapes[10]
    assert clearance([ball], WIRE.radius, shape) == pytest.approx(brute(shape, outside), abs=1e-8)
    assert clearance([ball, Sheet.around(ROUND)], WIRE.radius, shape) <= clearance(
        [ball], WIRE.radius, shape)


def test_a_hole_without_a_size_has_no_clearance():
    hole = CutOut(ROUND.pose)
    plan = InverseSimulator(DIRECT).thread(hole, depths=[0.0, 0.5])
    assert (plan.clearance == np.inf).all()


def test_trajectory_keeps_limits_and_poses(plan):
    limits = Limits(0.2, 0.3, 0.1, 1.0)
    way = Trajectory(plan, limits)
    times = np.linspace(0, way.duration, 4001)
    poses, speeds, accelerations = way.at(times)
    most = [np.linalg.norm(v, axis=1).max() for v in (
        speeds[:, :3], speeds[:, 3:], accelerations[:, :3], accelerations[:, 3:])]
    allowed = [limits.linear_speed, limits.angular_speed, limits.linear_acceleration,
               limits.angular_acceleration]
    used = np.array(most) / allowed
    assert used[:2].max() <= 1.001 and used[2:].max() <= 1.001
    assert used.max() > 0.98  # no slower than it has to be
    step = times[1] - times[0]
    position = np.array([pose.position for pose in poses])
    np.testing.assert_allclose(np.gradient(position, step, axis=0)[5:-5], speeds[5:-5, :3],
                               atol=1e-5)
    turns = np.array([Rotation.from_matrix(b.rotation @ a.rotation.T).as_rotvec()
                      for a, b in zip(poses, poses[1:], strict=False)]) / step
    np.testing.assert_allclose(turns, 0.5 * (speeds[1:, 3:] + speeds[:-1, 3:]), atol=1e-4)
    np.testing.assert_allclose(speeds[[0, -1]], 0, atol=1e-12)
    for gripper in (plan.grippers[0], plan.grippers[17], plan.grippers[-1]):
        nearest = np.linalg.norm(position - gripper.position, axis=1).min()
        assert nearest < 5e-4  # as near as the samples are


def test_it_stops_at_corners(plan):
    inverse = InverseSimulator(DIRECT)
    start = Pose((-1.3, 0.2, 1.1), (0, 0, 0, 1))
    whole = joined(inverse.start_phase(ROUND, plan, start), plan)
    way = Trajectory(whole)
    times = np.linspace(0, way.duration, 6001)
    poses, speeds, _ = way.at(times)
    still = np.flatnonzero(np.linalg.norm(speeds, axis=1) < 2e-3)
    rests = np.split(times[still], np.flatnonzero(np.diff(still) > 1) + 1)
    assert 3 <= len(rests) <= 6  # at both ends, and between backing off, turning, going in
    assert np.linalg.norm(np.diff([pose.position for pose in poses], axis=0), axis=1).max() < 1e-2
    mixed = np.array([way.duration, 0.0, 0.5 * way.duration])
    for pose, time in zip(way.at(mixed)[0], mixed, strict=True):
        np.testing.assert_allclose(pose.matrix, way.at(time)[0][0].matrix)
    assert (np.diff(way.progress(times)) >= -1e-12).all()
    assert way.progress([way.duration])[0] == pytest.approx(whole.times[-1])


def test_report_of_a_good_plan(plan):
    report = replay(DIRECT, plan, obstacles=[Sphere((0, 0, 3), 0.5)], limits=Limits())
    assert report.converged
    assert report.miss < 1e-6 and report.misalignment < 1e-6
    assert report.stability == pytest.approx(plan.stability.min(), abs=1e-3)
    assert report.clearance == pytest.approx(plan.clearance.min())
    assert report.contact_force == 0
    assert report.miss < report.dynamic_miss < 5e-3
    slow = replay(DIRECT, plan, limits=Limits(linear_speed=0.03))
    assert slow.duration > 2 * report.duration
    assert slow.dynamic_miss < report.dynamic_miss


def test_fastest_pace_keeps_the_tolerance(plan):
    report = replay(DIRECT, plan, limits=Limits(), tolerance=2e-3)
    assert 0 < report.fastest < report.duration
    at_that = replay(DIRECT, plan, limits=Limits(
        0.1 * report.duration / report.fastest, np.inf, np.inf, np.inf))
    assert at_that.duration == pytest.approx(report.fastest, rel=0.05)
    assert at_that.dynamic_miss < 2.5e-3


def test_a_plan_for_another_dlo_misses(plan):
    softer = DirectSimulator(Rod.circular(1.0, 1.4e-3, 8960.0, 110e9, 0.34))
    report = replay(softer, plan)
    assert report.miss > 1e-2
    assert report.clearance < 0 < plan.clearance.min()  # its own shapes are looked at


def test_nonsense_is_named(plan):
    with pytest.raises(InvalidTask, match='linear_speed'):
        Limits(linear_speed=0)
    with pytest.raises(InvalidTask, match='limits'):
        Trajectory(plan, 3)
    single = InverseSimulator(DIRECT).thread(ROUND, depths=[0.5])
    with pytest.raises(InvalidTask, match='plan has 1'):
        Trajectory(single)
