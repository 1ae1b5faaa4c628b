# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks, drivers, runs and the film."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from benchmarks.cell.__main__ import Film, main  # noqa: E402
from benchmarks.cell.drivers import PERIOD, OpenLoop, planned, sampled  # noqa: E402
from benchmarks.cell.run import run  # noqa: E402
from dlo_planner import CutOut, Infeasible, InvalidTask, Limits, Pose, Rod  # noqa: E402
from dlo_planner.cell.camera import Camera  # noqa: E402
from dlo_planner.cell.tasks import RODS, Task, draw_task  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402

BAR = Rod(0.4, 0.05, 20.0, 15.0, radius=3e-3)  # so stiff that it goes where the gripper goes
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
PUSHED = 0.3


def bar_task(aside=0.0):
    return Task('bar', BAR, HOLE, Pose((-0.45, aside, 1), (0, 0, 0, 1)), 0.2)


def pushed(task):
    steps = np.linspace(0, 1, 151)[1:]
    way = PUSHED * steps**3 * (10 - 15 * steps + 6 * steps**2)
    start = task.start.position
    return [Pose(start + (x, 0, 0), (0, 0, 0, 1)) for x in way]


def refuses(task):
    raise Infeasible('nothing is possible', 0, 'stability', 1.0)


@pytest.mark.sweep
def test_a_bar_goes_through_the_hole():
    outcome = run(bar_task(0.003), OpenLoop(pushed))
    assert outcome.threaded
    assert not outcome.touched
    assert outcome.force == 0
    assert outcome.depth == pytest.approx(0.25, abs=1e-4)
    assert outcome.miss == pytest.approx(0.003, abs=2e-4)
    assert outcome.time == pytest.approx(150 * PERIOD)


@pytest.mark.sweep
def test_a_bar_aside_is_stopped_by_the_sheet():
    outcome = run(bar_task(0.03), OpenLoop(pushed))
    assert not outcome.threaded
    assert outcome.touched
    assert outcome.time < 150 * PERIOD


@pytest.mark.sweep
def test_beside_the_sheet_is_not_threaded():
    outcome = run(bar_task(0.25), OpenLoop(pushed))
    assert outcome.depth == pytest.approx(0.25, abs=1e-4)
    assert not outcome.touched
    assert outcome.miss == pytest.approx(0.25, abs=1e-3)
    assert not outcome.threaded


@pytest.mark.sweep
def test_not_deep_enough_is_not_threaded():
    assert not run(replace(bar_task(), depth=0.26), OpenLoop(pushed)).threaded


@pytest.mark.sweep
def test_what_is_unknown_counts():
    shifted = [run(bar_task(), OpenLoop(pushed), seed=seed, unknowns=Unknowns(
        gripper_position=1e-3)) for seed in (1, 1, 2)]
    assert shifted[0] == shifted[1]
    assert 1e-4 < shifted[0].miss != shifted[2].miss


@pytest.mark.sweep
def test_a_closed_loop_sees_and_moves():
    def driver(task):
        def command(images, time, gripper):
            seen.extend(images)
            return Pose(task.start.position, (0, 0, 0, 1)) if time < 0.5 else None
        return command

    seen = []
    outcome = run(bar_task(), driver, camera=Camera(rate=20.0, latency=0.1))
    assert outcome.time == pytest.approx(0.5, abs=2 * PERIOD)
    assert [image.stamp for image in seen] == pytest.approx(0.05 * np.arange(9), abs=2 * PERIOD)


def test_a_refusal_is_an_outcome():
    outcome = run(bar_task(), refuses)
    assert outcome.refused == 'Infeasible: nothing is possible (stability, by 1)'
    assert not outcome.threaded


def test_a_driver_that_gives_up_on_the_way():
    def driver(task):
        def command(images, time, gripper):
            return refuses(task) if time > 0.4 else Pose(task.start.position, (0, 0, 0, 1))
        return command

    outcome = run(bar_task(), driver)
    assert outcome.refused
    assert outcome.time == pytest.approx(0.4, abs=2 * PERIOD)


@pytest.mark.parametrize('seed', range(12))
def test_tasks_are_drawn(seed):
    task = draw_task(seed)
    assert task == draw_task(seed) == pickle.loads(pickle.dumps(task))
    assert task.name == list(RODS)[seed % 4]
    assert 0.004 <= task.cutout.radius <= 0.02
    assert task.room >= 0.0025
    behind = (task.cutout.center - task.start.position) @ task.cutout.normal
    assert 1.04 <= behind / task.rod.length <= 1.41
    assert draw_task(seed, 'hose', 0.0105).room == pytest.approx(0.0025)


@pytest.mark.sweep
def test_the_planner_drives():
    task = draw_task(1)
    trajectory = planned(task, Limits(linear_speed=0.08))
    assert trajectory.motion.position_error < trajectory.tolerance
    poses = sampled(trajectory)
    gaps = [np.linalg.norm(b.position - a.position)
            for a, b in zip([task.start, *poses], poses, strict=False)]
    assert max(gaps) < 0.08 * PERIOD * 1.001
    assert poses[-1].matrix == pytest.approx(trajectory.at([trajectory.duration])[0][0].matrix)


@pytest.mark.sweep
def test_film(tmp_path):
    film = Film()
    run(bar_task(), OpenLoop(pushed), watch=film)
    film.save(tmp_path / 'film.gif', bar_task())
    assert (tmp_path / 'film.gif').read_bytes().startswith(b'GIF89a')


def test_nothing_to_run(tmp_path, capsys):
    assert main(['--tasks', '0', '--workers', '1', '--output', str(tmp_path)]) == 0
    assert '0 tasks' in capsys.readouterr().out


@pytest.mark.parametrize(('make', 'named'), [
    (lambda: draw_task(-1), 'seed'), (lambda: replace(bar_task(), depth=0.5), 'Task.depth'),
    (lambda: replace(bar_task(), cutout=CutOut(HOLE.pose)), 'Task.cutout'),
    (lambda: draw_task(0, 'rope'), 'name'), (lambda: draw_task(0, radius=5e-4), 'radius'),
    (lambda: run(1, refuses), 'task'),
    (lambda: run(bar_task(), OpenLoop(pushed), damping=-1.0), 'damping')])
def test_what_makes_no_sense_is_refused(make, named):
    with pytest.raises(InvalidTask, match=named):
        make()
