# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Our own processes give BLAS one thread, in time; what the user has set is left."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from dlo_planner import blas
from dlo_planner.cli.main import main as command
from dlo_planner.ros import main as node

NAME = 'OPENBLAS_NUM_THREADS'


def _by_command(_):
    CliRunner().invoke(command, ['shape', '--help'])


def _by_node(monkeypatch):
    monkeypatch.setattr(node.Process, 'run', lambda self: 0)
    node.main([])


@pytest.mark.parametrize('start', [_by_command, _by_node])
@pytest.mark.parametrize(('before', 'after'), [({}, '1'), ({NAME: '3'}, '3')])
def test_a_process_of_ours_has_one_thread(monkeypatch, start, before, after):
    environment = dict(before)
    monkeypatch.setattr(blas.os, 'environ', environment)
    start(monkeypatch)
    assert environment[NAME] == after


def test_it_is_set_before_numpy_is_loaded():
    told = subprocess.run([sys.executable, '-c', (
        'import sys, dlo_planner.cli.main, dlo_planner.ros.main; print("numpy" in sys.modules)')],
        capture_output=True, text=True, check=True)
    assert told.stdout.split() == ['False']


TOLD = """
import numpy, scipy.linalg
from dlo_planner.blas import _controls, one_thread
def threads(): return [get() for get, _ in _controls()]
print(*threads())
with one_thread():
    print(*threads())
    with one_thread():
        pass
    print(*threads())
print(*threads())
"""


@pytest.mark.skipif(not Path('/proc/self/maps').exists(), reason='threads are limited on Linux')
def test_where_a_matrix_is_decomposed_it_has_one_thread():
    told = subprocess.run([sys.executable, '-c', TOLD], capture_output=True, text=True, check=True,
                          env={**os.environ, NAME: '2'}).stdout.splitlines()
    if not told[0]:
        pytest.skip('NumPy has another BLAS')
    before, inside, still, after = ([*map(int, one.split())] for one in told)
    assert {*inside} == {*still} == {1} and before == after and max(before) == 2
