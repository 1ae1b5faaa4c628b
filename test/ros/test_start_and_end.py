# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Starting with good and bad parameters, and ending."""

import os
import signal
import sys
import time
from subprocess import PIPE, STDOUT, Popen

import numpy as np
import pytest
import yaml
from node_inside import Alive
from planner_here import context_of_its_own, planner_here
from planner_process import (
    PATIENCE,
    ROOT,
    connected_client,
    heeds,
    in_time,
    running_planner,
    until,
)
from rclpy.exceptions import ParameterException

from dlo_planner import Pose
from dlo_planner.errors import DloPlannerError

HEARD = 5.0  # s in which a signal ends the process; what does not end is left after 6 s


@pytest.mark.every(9)
@pytest.mark.parametrize('config', sorted(path.name for path in (ROOT / 'config').glob('*.yaml')))
def test_every_dlo_in_config_hangs_whatever_the_node_is_called(domain, monkeypatch, config):
    rod = yaml.safe_load((ROOT / 'config' / config).read_text())['/**']['ros__parameters']['rod']
    with context_of_its_own() as context, planner_here(
            monkeypatch, context, '--params-file', str(ROOT / 'config' / config),
            '-r', '__ns:=/cell1', '-r', '__node:=held') as node, \
            connected_client(Alive(), '/cell1/held') as client:
        path, _ = client.predict_shape(Pose.looking_along((0, 0, 1), (1, 0, 0)))
        ends = np.array([[getattr(one.pose.position, axis) for axis in 'xyz']
                         for one in path.poses])
        steps = np.linalg.norm(np.diff(ends, axis=0), axis=1)
        assert steps.sum() == pytest.approx(rod['length'], rel=1e-3)
        assert node.shared.store.state.scene['rod.name'] == rod['name']
        assert len(path.poses) == 65
        assert path.poses[-1].pose.position.z < 1.0
        said = client.diagnostics.get(timeout=PATIENCE).status
        assert [one.name.split(': ')[0] for one in said] == ['cell1/held'] * len(said)


@pytest.mark.every(6)
@pytest.mark.parametrize('seconds', [0.3, 1.0, 2.5])
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_are_heard_while_it_starts(domain, tmp_path, seconds, number):
    def took():
        with running_planner(tmp_path) as planner:
            time.sleep(seconds)
            assert until(lambda: planner.heeds(signal.SIGTERM))  # Python itself has begun
            begun = time.monotonic()
            assert planner.interrupt(number, number) == 0
            assert 'Traceback' not in planner.log
            return time.monotonic() - begun
    assert in_time(took, HEARD)


@pytest.mark.parametrize('name', ['cell', 'planner_node', 'viewer'])
def test_an_interrupt_in_the_first_moment_ends_an_executable_without_a_traceback(domain, name):
    with Popen([sys.executable, str(ROOT / 'scripts' / name)], stdout=PIPE, stderr=STDOUT,
               cwd=ROOT, env={**os.environ, 'PYTHONPATH': str(ROOT)}, text=True) as process:
        assert until(lambda: heeds(process.pid, signal.SIGTERM))  # Python itself has begun
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=PATIENCE)
    assert (process.returncode, said) == (0, '')


def test_signals_are_heard_during_a_long_plan_and_misspelt_parameters_are_named(domain, tmp_path):
    arguments = ('-p', 'threading.waypoints:=10000', '-p', 'rod.diameter:=0.0015', '-p',
                 'gravitiy:=3.0')

    def took():
        with running_planner(tmp_path, *arguments) as planner, connected_client(planner) as client:
            assert 'parameter gravitiy does not exist' in planner.log
            assert 'did you mean gravity?' in planner.log
            client.send_goal(Pose.looking_along((0, 0, 1), (1, 0, 0)))
            time.sleep(0.3)
            begun = time.monotonic()
            assert planner.interrupt(signal.SIGTERM, signal.SIGINT) == 0
            assert 'planned' not in planner.log
            assert 'Traceback' not in planner.log
            return time.monotonic() - begun
    assert in_time(took, HEARD)


def test_a_file_that_is_not_there_is_said_in_a_line(domain, tmp_path):
    with running_planner(tmp_path, '--params-file', 'nonesuch.yaml') as planner:
        assert planner.process.wait(timeout=2 * PATIENCE) == 1
        assert 'dlo_planner: cannot start' in planner.log and 'nonesuch.yaml' in planner.log
        assert 'Traceback' not in planner.log


@pytest.mark.parametrize(('given', 'reason'), [
    ({'rod__length': -1.0}, r'rod\.length'),
    ({'rod__section': 'oval'}, r"rod\.section = 'oval'"), ({'gravity': ['down']}, 'gravity'),
    ({'rod__natural_twist': 'long'}, r"rod\.natural_twist = 'long'"),
])
def test_parameters_that_make_no_sense_are_refused_by_name(domain, monkeypatch, given, reason):
    with context_of_its_own() as context, \
            pytest.raises((DloPlannerError, ParameterException), match=reason), \
            planner_here(monkeypatch, context, **given):
        pass
