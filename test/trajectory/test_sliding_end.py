# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion into a bore: what is outside gets shorter."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Limits,
    Plane,
    Pose,
    Rod,
    Trajectory,
    replay,
)
from dlo_planner.progress import Progress
from dlo_planner.tasks import concatenate
from dlo_planner.trajectory.dynamic_check import in_motion
from dlo_planner.trajectory.sliding_end import Feed, Instants, pushed
from dlo_planner.trajectory.timed_path import TimedPath

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, damping=(0.3, 0.0))
BENT = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.6, 0.4), natural_twist=0.3)
WEIGHTED = Rod(1.0, 0.05, (0.3, 0.6), 0.25, tip_mass=0.05, point_masses=((0.7, 0.02),))
BORE = CutOut(Pose.looking_along((0.1, 0, 1), (1, 0.2, 0)), radius=3e-3)
DEPTHS = np.linspace(0, 0.6, 9)


@cache
def planned(rod):
    """Return a DirectSimulator and the Plan of an insertion."""
    direct = DirectSimulator(rod)
    return direct, InverseSimulator(direct).insert(BORE, depths=DEPTHS)


@cache
def fastest(rod):
    return Trajectory(planned(rod)[1], tolerance=np.inf)


def moved(rod, slower=1.0):
    """Return InMotion of the fastest motion within limits, its speeds divided by `slower`."""
    (direct, plan), way = planned(rod), fastest(rod)
    way = TimedPath(way.path, tuple(law.slower(slower) for law in way.laws), way.limits)
    return in_motion(direct, plan, way, plan.shapes[0], (), Progress())


def test_the_gripper_accelerates_all_of_the_mass():
    rod = replace(WEIGHTED, tip_mass=0.03)
    direct = DirectSimulator(rod, gravity=(0, 0, 0))
    entrance, rate = Pose((1.0, 0, 0), (0, 0, 0, 1)), 0.5
    times = np.linspace(0, 1.2, 61)
    depths = 0.5 * rate * times**2
    grippers = [Pose((depth, 0, 0), (0, 0, 0, 1)) for depth in depths]
    feed = Feed(direct, entrance, times, depths, np.zeros(times.size))
    outside = pushed(feed, Instants(grippers, times, times[1]), direct.solve(grippers[0]), None,
                     Progress())
    assert outside.converged and outside.shapes[-1].s[-1] < 0.7
    mass = 0.05 + 0.03 + 0.02
    pushes = np.array([shape.gripper_wrench for shape in outside.shapes[2:]])
    np.testing.assert_allclose(pushes[:, 0], mass * rate, rtol=1e-3)
    np.testing.assert_allclose(pushes[:, 1:], 0, atol=1e-9)
    np.testing.assert_allclose(outside.forces, 0, atol=1e-9)


@pytest.mark.sweep
@pytest.mark.parametrize('rod', [WIRE, BENT], ids=['straight', 'bent'])
def test_what_is_outside_deviates_by_its_inertia_alone(rod):
    fast, slow = moved(rod), moved(rod, 4.0)
    assert fast.converged and slow.converged
    assert slow.swing < 0.1 * fast.swing < 1e-4  # inertia: a sixteenth; no noise of cutting anew
    assert fast.position_error == fast.swing  # a DLO in a bore cannot miss it otherwise
    assert fast.smooth_bore_force < 0.02 and fast.departure < 1e-5
    assert np.isnan(fast.contact_force)  # a true bore rubs, has room, and an edge


@pytest.mark.sweep
def test_the_mouth_bears_the_weight_it_takes_over():
    assert moved(WEIGHTED).smooth_bore_force == pytest.approx(9.81 * 0.05, rel=0.02)


@pytest.mark.sweep
@pytest.mark.parametrize('rod', [WIRE, BENT], ids=['straight', 'bent'])
def test_from_a_start_pose_of_its_own_it_is_inserted_safely(rod):
    direct, plan = planned(rod)
    start = InverseSimulator(direct).approach(BORE, plan, Pose((-1.2, 0.2, 1.2), (0, 0, 0, 1)),
                                              standoff=0.05)
    way = concatenate(start, plan)
    report = replay(direct, way, limits=Limits())
    assert report.safe and report.tolerance == pytest.approx(0.25 * plan.clearance.min())
    assert report.arrival <= report.max_tracking_error <= report.tolerance < report.swing
    assert report.departure < 1e-6
    assert {'contact_force', 'dynamic_contact_force'} <= set(report.not_looked_at)
    assert 0 < report.dynamic_clearance < report.clearance
    # it stops where the bore takes it
    seam = report.trajectory.path.legs[-1].knots[0]
    assert seam == way.times[len(start) - 1]


def test_a_dlo_that_comes_in_on_finer_elements_is_not_torn_to_where_its_end_was_by_them():
    wavy = replace(WIRE, damping=0.0, natural_curvature=lambda s: (0.5 * np.sin(10 * s), 0.1))
    direct, finer = DirectSimulator(wavy), DirectSimulator(wavy, n_elements=128, basis='local')
    hanging = finer.solve(Pose((-0.8, 0, 1.2), (0, 0, 0, 1)))
    entrance = Pose.from_rotation(hanging.positions[-1], hanging.frames[-1])
    feed = Feed(direct, entrance, np.linspace(0, 0.2, 6), np.zeros(6), np.zeros(6))
    outside = pushed(feed, Instants([hanging.gripper] * 6, np.zeros(6), 0.04), hanging,
                     np.zeros((129, 3)), Progress())
    assert outside.converged
    assert np.linalg.norm(outside.shapes[-1].positions[-1] - entrance.position) < 1e-5


def test_what_is_outside_keeps_away_from_obstacles():
    direct, plan = planned(WIRE)
    low = min(shape.positions[:, 2].min() for shape in plan.shapes)
    way = Trajectory(plan, tolerance=2e-3)
    for below, safe in ((1e-2, True), (-1e-3, False)):
        floor = DirectSimulator(WIRE, obstacles=[Plane((0, 0, low - 0.75e-3 - below), (0, 0, 1))])
        report = replay(floor, plan, trajectory=way)
        assert report.safe == safe
        assert (report.dynamic_clearance > 0) == safe


@pytest.mark.sweep
def test_what_cannot_be_calm_or_is_not_known_is_refused(monkeypatch):
    direct, plan = planned(WIRE)
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)
    with pytest.raises(Infeasible, match='does not come to rest: miss in motion') as caught:
        Trajectory(plan, tolerance=1e-8)
    assert caught.value.constraint == 'miss' and caught.value.amount > 0
    inside = InverseSimulator(direct).insert(BORE, depths=[0.1, 0.2, 0.3])
    with pytest.raises(InvalidTask, match='simulator = None: .* begins 0.1 m deep'):
        Trajectory(inside)
    with pytest.raises(InvalidTask, match='simulator: expected one of the plan\'s DLO, 1 m long'):
        Trajectory(inside, simulator=DirectSimulator(replace(WIRE, length=1.1)))
    way = Trajectory(inside, simulator=direct)
    assert way.motion.position_error <= way.tolerance


def test_a_bore_is_as_wide_as_the_dlo():
    inverse = InverseSimulator(DirectSimulator(WIRE))
    with pytest.raises(Infeasible) as caught:
        inverse.insert(replace(BORE, radius=0.5e-3), depths=[0.0, 0.1])
    assert caught.value.constraint == 'clearance'
    assert caught.value.amount == pytest.approx(0.25e-3)
    assert np.isinf(inverse.insert(replace(BORE, radius=None), depths=[0.0, 0.1]).clearance).all()
