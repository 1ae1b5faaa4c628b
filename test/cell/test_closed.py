# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver that looks, and one motion in open loop."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from dlo_planner import CutOut, Limits, Pose, Rod  # noqa: E402
from dlo_planner.cell.camera import Camera, Image  # noqa: E402
from dlo_planner.cell.closed import Looking  # noqa: E402
from dlo_planner.cell.drivers import PERIOD, OpenLoop, planned  # noqa: E402
from dlo_planner.cell.run import run  # noqa: E402
from dlo_planner.cell.tasks import Task  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402
from dlo_planner.identify.closed_loop import Phase  # noqa: E402

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


def looking(**options):
    return replace(Looking.knowing(UNKNOWN, CAMERA, limits=FAST), look=0.6, **options)


def test_what_is_promised_in_open_loop_is_observed():
    outcome = run(TASK, OpenLoop(in_open_loop))
    assert outcome.threaded
    assert outcome.force == 0
    assert outcome.miss == pytest.approx(outcome.promised, abs=2e-4)


def test_looking_finds_the_hole_that_open_loop_misses():
    outcome = run(TASK, looking(), seed=3, unknowns=UNKNOWN, camera=CAMERA)
    assert outcome.threaded
    assert outcome.force == 0
    assert outcome.miss < outcome.promised < TASK.room
    assert not run(TASK, OpenLoop(in_open_loop), seed=3, unknowns=UNKNOWN).threaded


def test_looks_on_the_way_help_where_the_first_was_short():
    without, with_corrections = (
        run(TASK, replace(looking(period=period), look=0.08), seed=2, unknowns=UNKNOWN,
            camera=CAMERA) for period in (1e6, 0.2))
    assert with_corrections.threaded
    assert with_corrections.miss < 0.8 * without.miss


def test_looks_count_less_the_faster_the_gripper_moves():
    command = looking(stamps=0.06)(TASK)
    command((), 0.0)
    command._loop = replace(command._loop, phase=Phase.PLAN)
    command((), 0.0)
    moving = command._motion.trajectory.duration / 2
    (slow, calm), (fast, shaken) = (command._moving(stamp) for stamp in (0.0, moving))
    assert max(slow, calm) < 1e-12
    assert 0.01 < fast < 0.5
    assert 0.01 < shaken < 2


def test_a_hole_whose_place_is_not_known_is_not_entered():
    outcome = run(TASK, looking(hole=3e-3), camera=CAMERA)
    assert 'may miss by' in outcome.refused
    assert outcome.depth == 0


def test_what_was_seen_in_motion_is_left_out():
    command = looking()(TASK)
    command((), 0.0)
    command._loop = replace(command._loop, at_standoff=True, since=5.0)
    points = np.array([[-0.3, 0.0, 1.0], [-0.2, 0.0, 1.0]])
    command((Image(5.05, points),), 5.1)  # its stamp may be late
    assert command._estimate.looks == 0
    command((Image(5.11, points),), 5.2)
    assert command._estimate.looks == 1


def test_it_stands_still_while_it_looks():
    command = looking()(TASK)
    assert {command((), PERIOD * k) for k in range(50)} == {TASK.start}


def test_what_a_camera_is_known_to_do_wrong():
    camera = Camera(noise=2e-3, bias=1e-3, outliers=0.1, stamp_error=-0.06)
    driver = Looking.knowing(Unknowns(0.05, 0.02, hole_position=5e-4), camera)
    assert (driver.noise, driver.bias, driver.outliers) == (2e-3, 1e-3, 0.1)
    assert (driver.hole, driver.stamps) == (5e-4, 0.06)
    assert driver.spread.bending_stiffness == driver.spread.torsional_stiffness == 0.05
    assert driver.spread.mass == 0.02
    assert Looking.knowing(UNKNOWN, CAMERA).outliers > 0


def test_the_promise_is_the_motion_and_the_estimate(monkeypatch):
    command, asked = looking()(TASK), {}

    def trajectory(*_, tolerance):
        asked['tolerance'] = tolerance
        return SimpleNamespace(motion=SimpleNamespace(bound=2e-4))

    monkeypatch.setattr('dlo_planner.cell.closed.Trajectory', trajectory)
    command._plan = SimpleNamespace(shapes=(None,))
    command._go, command._left = lambda *_: None, 1e-4
    for bound, part in ((5e-4, 0.5 * (TASK.room - 5e-4)), (1.9e-3, 0.25 * TASK.room)):
        command._go_in(bound, 0.0)
        assert command.promised == pytest.approx(2e-4 + bound + 1e-4)
        assert asked['tolerance'] == pytest.approx(part)


def test_a_look_in_motion_is_noisier_and_sways():
    command, seen = looking(stamps=0.06)(TASK), []
    command._observer = SimpleNamespace(update=lambda *_, **how: seen.append(how))
    command._sent.append((0.0, TASK.start))
    command._moving = lambda _: (0.1, 2.0)
    command._look_on_the_way(Image(0.0, np.zeros((9, 3))))
    assert seen == [{'noise': pytest.approx(np.hypot(0.3e-3, 3 * 0.1 * 0.06)),
                     'sway': pytest.approx(np.hypot(5e-4, 0.5 * 0.3 * 2 / 9.81))}]


def test_the_swing_that_the_way_to_the_standoff_leaves_counts():
    command = looking()(TASK)
    command._go_there(0.0)
    assert command._left == command._motion.trajectory.motion.departure > 0
