# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shifts of the gripper: the miss and the vibration left fall, as predicted and as simulated."""

from dataclasses import replace

import numpy as np
import pytest
from calm_cases import cell, tasks

from dlo_planner.plan.path import GripperPath
from dlo_planner.progress import Progress
from dlo_planner.trajectory.dynamic_check import in_motion
from dlo_planner.trajectory.shaping import compensated, predicted
from dlo_planner.trajectory.timed_path import TimedPath, smoothed
from dlo_planner.trajectory.topp import fastest_rates


def shaped(task, slower=1.0):
    """Return a law with windows of the two slowest modes at the end, and with its Shift."""
    u, rates = fastest_rates(task.leg, task.limits)
    windows = 2 * np.pi / task.response.rates[-1, :2]
    law = smoothed(task.leg, task.limits, u, rates / slower, windows)
    return law, replace(law, shift=compensated(task, law))


def left(task, law):
    """Return by how much the DLO still vibrates where the law ends, m."""
    place, speed = task.response.excited(law, task.response.rest)[2][:, -1]
    return float((task.response.sizes[-1] * np.hypot(place, speed)).sum())


@pytest.mark.parametrize('name', ['wire', 'hose', 'leaf spring'])
def test_the_miss_and_the_vibration_left_fall(name):
    task = tasks(name)[-1]
    plain, helped = shaped(task, 1.5)
    assert predicted(task, plain) > 3 * predicted(task, helped)
    assert left(task, plain) > 3 * left(task, helped)
    # the shift is small beside the deviation that it mends, some millimeters
    assert helped.shift.most[0] < 5 * predicted(task, plain)


def test_the_simulation_agrees():
    task = tasks('wire')[-1]
    direct, plan = cell('wire')
    first = int(np.searchsorted(plan.times, task.leg.knots[0]))
    part = replace(plan, stops=(), **{name: getattr(plan, name)[first:] for name in (
        'depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'times', 'via_points',
        'clearances', 'insertion_force')})
    path = GripperPath(part.times, (task.leg,))
    shape = direct.solve(part.grippers[0], part.shapes[0])
    laws = shaped(task, 0.7)
    found = [in_motion(direct, part, TimedPath(path, (law,), task.limits), shape, (),
                       Progress(None, None)) for law in laws]
    # coarser waypoints and a second mesh are in both
    assert found[0].position_error > 2 * found[1].position_error
    # the response is right to a part of the largest deviation
    for one, law in zip(found, laws, strict=True):
        known = task.cases[0].deviation(law, task.rest[0])[0]
        assert abs(one.position_error - known) < 0.1 * one.swing


def test_a_leg_shorter_than_a_spline_has_no_shift():
    task = tasks('wire')[-1]
    law, _ = shaped(task)
    quick = replace(law, rates=20 * law.rates, windows=np.array([0.01]))
    assert compensated(task, quick) is None


def test_a_leg_of_very_many_periods_has_no_shift():
    task = tasks('wire')[-1]
    law, helped = shaped(task)
    assert helped.shift is not None
    slow = law.slower(60 * 2 * np.pi / task.response.rates.min() / law.duration)
    assert compensated(task, slow) is None
