# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver that looks, and one motion in open loop."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from benchmarks.cell.drivers import (  # noqa: E402
    PERIOD,
    Looking,  # noqa: E402
    OpenLoop,
    planned,
)
from benchmarks.cell.run import run  # noqa: E402
from dlo_planner import CutOut, Limits, Pose, Rod  # noqa: E402
from dlo_planner.cell.camera import Camera  # noqa: E402
from dlo_planner.cell.tasks import Task  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402

# short and stiff: it is threaded within seconds
WIRE = Rod.circular(0.3, 1e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=2.5e-3)
TASK = Task('short wire', WIRE, HOLE, Pose.looking_along((-0.36, -0.1, 1.02), (1, 0, 0)), 0.1)
UNKNOWN = Unknowns(0.05, 0.02, natural_curvature=(0.3,), gripper_position=0.5e-3,
                   gripper_rotation=np.radians(0.2))
CAMERA = Camera(noise=0.3e-3)
FAST = Limits(0.2, 1.0)


@cache
def in_open_loop(task):
    """Return the Trajectory of a Task that is not looked at."""
    return planned(task, FAST)


def looking(look=0.6, **seeing):
    return replace(Looking.knowing(UNKNOWN, CAMERA, FAST, **seeing), look=look)


@pytest.mark.sweep
def test_what_is_promised_in_open_loop_is_observed():
    outcome = run(TASK, OpenLoop(in_open_loop))
    assert outcome.threaded
    assert outcome.force == 0
    assert outcome.miss == pytest.approx(outcome.promised, abs=2e-4)


@pytest.mark.sweep
def test_looking_finds_the_hole_that_open_loop_misses():
    outcome = run(TASK, looking(), seed=3, unknowns=UNKNOWN, camera=CAMERA)
    assert outcome.threaded
    assert outcome.force == 0
    assert outcome.miss < outcome.promised < TASK.room
    assert not run(TASK, OpenLoop(in_open_loop), seed=3, unknowns=UNKNOWN).threaded


@pytest.mark.sweep
def test_corrections_on_the_way_are_executed_and_keep_what_was_promised():
    without, with_corrections = (
        run(TASK, looking(0.15, correction_period=period), seed=2, unknowns=UNKNOWN,
            camera=CAMERA) for period in (1e6, 0.2))
    assert with_corrections.threaded
    # the largest miss is at the entry, before a correction can be felt on so short a way
    assert with_corrections.depth != without.depth
    assert with_corrections.miss <= with_corrections.promised < TASK.room
    assert without.miss <= without.promised < TASK.room


@pytest.mark.sweep
def test_a_hole_whose_place_is_not_known_is_not_entered():
    outcome = run(TASK, looking(cutout=3e-3), camera=CAMERA)
    assert 'may miss the center by' in outcome.refused
    assert outcome.depth == 0


@pytest.mark.sweep
def test_it_stands_still_while_it_looks():
    command = looking()(TASK)
    assert {command((), PERIOD * k, TASK.start) for k in range(50)} == {TASK.start}


def test_what_a_camera_is_known_to_do_wrong():
    camera = Camera(noise=2e-3, bias=1e-3, outliers=0.1, stamp_error=-0.06)
    seeing = Looking.knowing(Unknowns(0.05, 0.02, 0.03, hole_position=5e-4), camera).seeing
    assert (seeing.noise, seeing.bias, seeing.outliers) == (2e-3, 1e-3, 0.1)
    assert (seeing.cutout, seeing.stamps) == (5e-4, 0.06)
    assert seeing.spread.bending_stiffness == seeing.spread.torsional_stiffness == 0.05
    assert (seeing.spread.mass, seeing.spread.mass_gradient) == (0.02, 0.03)
    assert Looking.knowing(UNKNOWN, CAMERA).seeing.outliers > 0
