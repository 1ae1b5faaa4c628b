# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Deadlines of a search for a calm motion: looked at often, and what was found is not thrown away.

What takes long is measured in seconds of this process, so that others do not count.
"""

import pickle
from itertools import pairwise
from time import process_time

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sphere,
    Trajectory,
    replay,
)
from dlo_planner.progress import Progress
from dlo_planner.results import ValidationReport
from dlo_planner.trajectory import calm_search
from dlo_planner.trajectory.calm_search import CalmSearch

ROD = Rod(0.3, 0.05, 5e-3, 4e-3, radius=2e-3)
DIRECT = DirectSimulator(ROD)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)


@pytest.fixture(scope='module')
def plan():
    return InverseSimulator(DIRECT).thread(HOLE, depths=np.linspace(0, 0.25, 8))


def late(*_, **__):
    raise DeadlineExceeded('deadline = 1 s: not finished after 1 s', 1.0, 1.0)


def test_a_deadline_is_looked_at_often(plan, monkeypatch):
    looks, check = [], Progress.check

    def looked(self):
        looks.append(process_time())
        check(self)

    below = Sphere(plan.shapes[0].positions[-1] - (0, 0, 0.06), 0.05)
    amid = DirectSimulator(ROD, obstacles=[below])
    replay(amid, plan, limits=Limits())  # kernels and modules are there now
    monkeypatch.setattr(Progress, 'check', looked)
    begun = process_time()
    assert replay(amid, plan, limits=Limits()).safe
    seconds = process_time() - begun
    assert max(after - before for before, after in pairwise(
        [begun, *looks, process_time()])) < 0.1 * seconds + 0.1


def test_a_calm_motion_is_returned_though_not_all_is_known_of_it(plan, tmp_path, monkeypatch):
    whole = Trajectory(plan)
    assert whole.status == 'complete' and np.isfinite(whole.motion.error_estimate)
    assert Trajectory(plan, tolerance=np.inf).status == 'not simulated'
    with monkeypatch.context() as patched:
        patched.setattr(CalmSearch, '_margin', late)
        without_margin = Trajectory(plan)
        patched.setattr(calm_search, 'step_error', late)
        neither = Trajectory(plan)
        report = replay(DIRECT, plan, limits=Limits())
    for way, error in ((without_margin, whole.motion.error_estimate), (neither, np.inf)):
        assert 'the deadline came first' in way.status and np.isnan(way.mode_margin)
        assert way.duration == whole.duration and way.motion.error_estimate == error
        assert pickle.loads(pickle.dumps(way)).status == way.status
    assert report.safe and 'mode_margin' in report.not_looked_at
    report.save(tmp_path / 'report.npz')
    assert ValidationReport.load(tmp_path / 'report.npz').trajectory.status == neither.status


def test_a_deadline_before_a_calm_motion_says_what_was_reached(plan, monkeypatch):
    timed, rounds = CalmSearch._timed, []

    def once(self, *given):
        rounds.append(given)
        return timed(self, *given) if len(rounds) == 1 else late()

    with pytest.raises(DeadlineExceeded, match='not finished') as caught:
        Trajectory(plan, deadline=1e-3)
    assert caught.value.seconds == 1e-3
    monkeypatch.setattr(CalmSearch, '_timed', once)
    with pytest.raises(DeadlineExceeded, match='in motion, .* m at best, in .* s') as caught:
        Trajectory(plan, tolerance=1e-5)
    assert caught.value.elapsed == 1.0


def test_the_deadline_of_a_replay_is_said_as_it_was_given(plan):
    with pytest.raises(DeadlineExceeded, match=r'deadline = 0\.4 s: not finished') as caught:
        replay(DIRECT, plan, limits=Limits(), tolerance=1e-9, deadline=0.4)
    assert caught.value.seconds == 0.4


def test_a_refusal_is_an_answer_though_the_deadline_comes(plan, monkeypatch):
    monkeypatch.setattr('dlo_planner.trajectory.calm_search._ROUNDS', 1)
    monkeypatch.setattr('dlo_planner.verify.replay.in_motion', late)
    report = replay(DIRECT, plan, limits=Limits(), tolerance=1e-5)
    assert not report.safe and 'the DLO is not calm' in report.reason
    assert 'swing' in report.not_looked_at
    with pytest.raises(DeadlineExceeded):
        replay(DIRECT, plan, trajectory=Trajectory(plan, tolerance=np.inf))
