# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A test that is run again has a process of its own, where the one before has died."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
pytest.importorskip('pytest_rerunfailures', reason='make sets it up')
TESTS = """
import subprocess, sys
from pathlib import Path
import pytest

STARTED = Path(__file__).parent / 'started'

@pytest.fixture(scope='session')
def domain():
    return 1

@pytest.fixture(scope='module')
def process(domain):
    with STARTED.open('a') as file:
        file.write('x')
    started = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])
    yield started
    started.kill()
    started.wait()

def test_before(process):
    assert process.poll() is None

def test_that_finds_it_dead_once(process):
    if STARTED.read_text() == 'x':
        process.kill()
        process.wait()
    assert process.poll() is None

def test_after(process):
    assert process.poll() is None
    assert STARTED.read_text() == 'xx'

def test_that_is_wrong(process):
    assert STARTED.read_text() == 'x'
"""


def test_fixtures_of_the_module_begin_anew(tmp_path):
    (tmp_path / 'test_process.py').write_text(TESTS)
    path = os.pathsep.join([str(HERE), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-p', 'rerunning', '-p', 'no:cacheprovider', '-rR',
         '--reruns', '1', str(tmp_path)], cwd=tmp_path, env={**os.environ, 'PYTHONPATH': path},
        capture_output=True, text=True, check=False, timeout=300)
    said = done.stdout.splitlines()
    assert said[-1].strip('= ').startswith('1 failed, 3 passed, 2 rerun'), done.stdout
    again = [line for line in said if line.startswith('RERUN')]
    assert len(again) == 2 and 'test_that_finds_it_dead_once' in again[0]
    assert 'test_that_is_wrong' in again[1]  # what fails twice has failed
