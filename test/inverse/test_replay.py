"""Clearance and report of a plan, against brute force."""

import numpy as np
import pytest

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
    replay,
)
from dlo_planner.inverse.clearance import clearance

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
