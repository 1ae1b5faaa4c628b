# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The process that computes for the node: the same as here, errors told, ended at will."""

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing
from functools import partial

import numpy as np
import pytest
from planner_process import PATIENCE, ROOT, until
from soak.watching import runs

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Limits, Pose, Rod, replay
from dlo_planner.errors import DeadlineExceeded, DloPlannerError, Infeasible, InvalidTask
from dlo_planner.progress import Progress
from dlo_planner.ros.worker import ProcessLost, Worker, persistent

DIRECT = DirectSimulator(Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34))
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)


def endless():
    """Compute for good, step by step."""
    steps = Progress()
    while True:
        steps.check()


@pytest.fixture(scope='module')
def plan():
    return InverseSimulator(DIRECT).thread(HOLE, depths=[0.0, 0.1, 0.2])


@pytest.fixture(scope='module')
def worker():
    made = Worker('computes')
    yield made
    made.close()


def test_the_result_is_the_same_as_here(worker, plan):
    here = replay(DIRECT, plan)
    there = worker.result(partial(replay, DIRECT, plan))
    assert (there.converged, there.clearance) == (here.converged, here.clearance)
    assert there.position_error == pytest.approx(here.position_error, abs=1e-9)
    assert worker.result(os.getpid) != os.getpid()


def test_errors_are_told_as_they_are_and_the_process_goes_on(worker, plan):
    with pytest.raises(InvalidTask, match=r'tolerance = -1\.0'):
        worker.result(partial(replay, DIRECT, plan, limits=Limits(), tolerance=-1.0))
    number = worker.result(os.getpid)
    refused = partial(InverseSimulator(DIRECT, workspace=None).thread,
                      CutOut(HOLE.pose, radius=1e-4), depths=[0.0, 0.1])
    with pytest.raises((Infeasible, InvalidTask)) as here:
        refused()
    with pytest.raises(here.type) as there:
        worker.result(refused)
    assert str(there.value) == str(here.value)
    with pytest.raises(DloPlannerError, match='TypeError: '):
        worker.result(partial(len, 3))
    with pytest.raises(DloPlannerError, match='the answer cannot be sent'):
        worker.result(threading.Lock)
    assert worker.result(os.getpid) == number
    os.kill(number, signal.SIGKILL)
    assert until(lambda: not runs(number))
    # another one is started, at the latest when the system has taken the first one away
    assert persistent(lambda: worker.result(os.getpid)) != number


def test_the_trajectory_that_comes_back_is_the_one_that_would_be_made_here(worker, plan):
    there = worker.result(partial(replay, DIRECT, plan, limits=Limits()))
    assert there.safe and there.trajectory.tolerance == pytest.approx(there.tolerance)
    times = np.linspace(0, there.duration, 50)
    here = replay(DIRECT, plan, trajectory=there.trajectory)  # looked at again: as it said
    assert here.safe and here.max_tracking_error == pytest.approx(there.max_tracking_error,
                                                                  rel=1e-6)
    poses = there.trajectory.at(times)[0]
    np.testing.assert_allclose([poses[0].matrix, poses[-1].matrix],
                               [plan.grippers[0].matrix, plan.grippers[-1].matrix], atol=1e-9)


def test_what_is_not_wanted_any_more_ends_between_two_steps_and_the_process_stays(
        worker, monkeypatch):
    monkeypatch.setattr('dlo_planner.ros.worker._YIELDING', PATIENCE)  # however busy the machine is
    number, looks = worker.result(os.getpid), itertools.count()
    assert worker.result(endless, lambda: next(looks) < 5) is None
    assert next(looks) == 6
    assert worker.result(os.getpid) == number  # the next one does not wait


def test_what_is_not_wanted_and_hears_nothing_is_ended(worker):
    number, asked = worker.result(os.getpid), time.monotonic()
    assert worker.result(partial(time.sleep, 60.0), lambda: time.monotonic() < asked + 0.2) is None
    assert worker.result(os.getpid) not in {None, number}


def test_a_deadline_ends_it(worker):
    number = worker.result(os.getpid)
    with pytest.raises(DeadlineExceeded, match=r'deadline = 0\.2 s') as found:
        worker.result(endless, deadline=0.2)
    assert found.value.seconds == 0.2 < found.value.elapsed
    assert worker.result(os.getpid, deadline=60.0) == number


def test_a_process_that_is_killed_at_work_is_said_to_be_lost(worker):
    killing = threading.Timer(0.5, os.kill, (worker.result(os.getpid), signal.SIGKILL))
    killing.start()
    with pytest.raises(ProcessLost, match='the process that computes has ended, status -9'):
        worker.result(endless)
    assert worker.result(os.getpid)


def test_a_process_that_does_not_answer_is_said_to_be_lost(worker, monkeypatch):
    number = worker.result(os.getpid)
    monkeypatch.setattr('dlo_planner.ros.worker._PATIENCE', 0.2)
    os.kill(number, signal.SIGSTOP)
    with pytest.raises(ProcessLost, match='does not answer'):
        worker.result(os.getpid)
    monkeypatch.undo()
    assert worker.result(os.getpid) not in {None, number}


def test_what_is_lost_is_tried_again_three_times():
    for losses in (3, 4):
        calls = []

        def dying():
            calls.append(1)  # noqa: B023
            if len(calls) <= losses:  # noqa: B023
                raise ProcessLost('it has ended')
            return 7

        if losses == 4:
            with pytest.raises(ProcessLost):
                persistent(dying)
        else:
            assert persistent(dying) == 7
        assert len(calls) == 4


# A node that is killed while its process computes for a minute.
NODE = """
import os, signal, threading, time
from functools import partial
from dlo_planner.ros.worker import Worker
worker = Worker('computes')
print(worker.result(os.getpid), flush=True)
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGKILL)).start()
worker.result(partial(time.sleep, 60))
"""


def test_it_ends_when_the_node_is_killed():
    done = subprocess.run([sys.executable, '-c', NODE], cwd=ROOT, capture_output=True, text=True,
                          check=False, timeout=PATIENCE,
                          env={**os.environ, 'PYTHONPATH': str(ROOT)})
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert until(lambda: not runs(int(done.stdout)))


def test_closing_ends_it_at_once():
    worker = Worker('computes')
    worker.result(os.getpid)
    answers = []
    waiting = threading.Thread(target=lambda: answers.append(worker.result(endless)))
    waiting.start()
    time.sleep(0.3)
    worker.close()
    waiting.join(timeout=PATIENCE)
    assert answers == [None] and not waiting.is_alive()
    assert worker.result(os.getpid) is None


def test_what_is_not_wanted_while_the_process_still_imports_leaves_no_traceback(capfd):
    with closing(Worker('computes')) as worker:
        assert worker.result(int, lambda: False) is None
    assert 'Traceback' not in capfd.readouterr().err
