# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rolls spread evenly: a DLO that hardly stands is threaded without corners."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod, Trajectory, replay
from dlo_planner.inverse.tasks.thread import even_rolls
from dlo_planner.plan.path import GripperPath

AXIS = np.array([1.0, 0.0, 0.0])
TASK = SimpleNamespace(axis=lambda _: AXIS)
HOSE = Rod.tube(0.5, 0.016, 0.010, 1150.0, 8e6, 0.49, natural_curvature=(0.0, 0.5))


def rolled(turned):
    """Return passings whose grippers have turned so far, rad."""
    return [SimpleNamespace(shape=SimpleNamespace(gripper=Pose.from_rotation(
        (0, 0, 0), Rotation.from_rotvec(angle * AXIS).as_matrix()))) for angle in turned]


def test_rolls_in_jerks_become_even():
    depths = np.linspace(0, 0.4, 41)
    jerks = 0.1 * np.floor(np.linspace(0, 8, 41))
    found = list(even_rolls(TASK, depths, rolled(jerks)))
    steps = [np.diff(route.turned) for route in found]
    for route in found:
        assert route.turned.sum() == pytest.approx(jerks.sum())  # about the same way
        assert np.abs(route.turned - jerks).max() < 0.1
        assert route.roll(TASK, None, 0.1, 0.2) == pytest.approx(
            route.turned[20] - route.turned[10])
    assert np.ptp(steps[0]) < 0.2 * np.ptp(np.diff(jerks))
    assert (np.diff([np.ptp(step) for step in steps]) > 0).all()  # ever less even


def test_even_rolls_stay_and_none_are_none():
    depths, even = np.linspace(0, 0.4, 9), np.linspace(0, 0.8, 9)
    for route in even_rolls(TASK, depths, rolled(even)):
        np.testing.assert_allclose(route.turned, even, atol=1e-9)
    assert not list(even_rolls(TASK, depths, rolled(0 * even)))
    assert not list(even_rolls(TASK, depths[:2], rolled(even[:2])))


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
