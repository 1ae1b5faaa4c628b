# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The process that proves plans: the same report as here, errors told, ended at will."""

import signal
import threading
import time

import numpy as np
import pytest
from planner_process import PATIENCE, in_time

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Limits, Pose, Rod, replay
from dlo_planner.errors import DloPlannerError
from dlo_planner.ros.proving import ProcessLost, Prover

DIRECT = DirectSimulator(Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34))
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
PLAN = InverseSimulator(DIRECT).thread(HOLE, depths=[0.0, 0.1, 0.2])


@pytest.fixture
def prover():
    made = Prover()
    yield made
    made.close()


def test_the_report_is_the_same_as_here(prover):
    here = replay(DIRECT, PLAN)
    there = prover.report(simulator=DIRECT, plan=PLAN)
    assert (there.converged, there.clearance) == (here.converged, here.clearance)
    assert there.position_error == pytest.approx(here.position_error, abs=1e-9)


def test_errors_are_told_and_the_process_goes_on(prover):
    with pytest.raises(DloPlannerError, match='InvalidTask'):
        prover.report(simulator=DIRECT, plan=PLAN, limits=Limits(), tolerance=-1.0)
    assert prover.report(simulator=DIRECT, plan=PLAN).converged
    prover._process.kill()
    prover._process.wait()
    assert prover.report(simulator=DIRECT, plan=PLAN).converged  # another one was started


def test_the_trajectory_that_comes_back_is_the_one_that_would_be_made_here(prover):
    there = prover.report(simulator=DIRECT, plan=PLAN, limits=Limits())
    assert there.safe and there.trajectory.tolerance == pytest.approx(there.tolerance)
    times = np.linspace(0, there.duration, 50)
    here = replay(DIRECT, PLAN, trajectory=there.trajectory)  # looked at again: as it said
    assert here.safe and here.max_tracking_error == pytest.approx(there.max_tracking_error,
                                                                  rel=1e-6)
    poses = there.trajectory.at(times)[0]
    np.testing.assert_allclose([poses[0].matrix, poses[-1].matrix],
                               [PLAN.grippers[0].matrix, PLAN.grippers[-1].matrix], atol=1e-9)


def test_what_is_not_wanted_any_more_ends_at_once(prover):
    prover.report(simulator=DIRECT, plan=PLAN)

    def took():
        asked = time.monotonic()
        wanted = lambda: time.monotonic() < asked + 0.3  # noqa: E731
        assert prover.report(wanted, simulator=DIRECT, plan=PLAN,
                             limits=Limits(linear_speed=1e-3), tolerance=1e-9) is None
        return time.monotonic() - asked
    assert in_time(took, 1.0)
    assert prover.report(simulator=DIRECT, plan=PLAN).converged  # the next plan does not wait


def test_a_process_that_is_killed_at_work_is_said_to_be_lost(prover):
    prover.report(simulator=DIRECT, plan=PLAN)
    killing = threading.Timer(0.5, prover._process.kill)
    killing.start()
    with pytest.raises(ProcessLost, match='status -9'):
        prover.report(simulator=DIRECT, plan=PLAN, limits=Limits(linear_speed=1e-3),
                      tolerance=1e-9)
    assert prover.report(simulator=DIRECT, plan=PLAN).converged


def test_a_process_that_does_not_answer_is_said_to_be_lost(prover, monkeypatch):
    prover.report(simulator=DIRECT, plan=PLAN)
    monkeypatch.setattr('dlo_planner.ros.proving._PATIENCE', 0.2)
    prover._process.send_signal(signal.SIGSTOP)
    with pytest.raises(ProcessLost, match='does not answer'):
        prover.report(simulator=DIRECT, plan=PLAN)
    monkeypatch.undo()
    assert prover.report(simulator=DIRECT, plan=PLAN).converged


def test_closing_ends_it_at_once(prover):
    prover.report(simulator=DIRECT, plan=PLAN)
    answers = []
    waiting = threading.Thread(target=lambda: answers.append(prover.report(
        simulator=DIRECT, plan=PLAN, limits=Limits(linear_speed=1e-3), tolerance=1e-9)))
    waiting.start()
    time.sleep(0.3)
    prover.close()
    waiting.join(timeout=PATIENCE)
    assert answers == [None] and not waiting.is_alive()
    assert prover.report(simulator=DIRECT, plan=PLAN) is None
