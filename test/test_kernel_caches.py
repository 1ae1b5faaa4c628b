# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What was compiled from other sources is never run, and nothing need be written to work."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import dlo_planner

# A kernel of one file that calls one of another, and where its machine code was kept.
MARCH = """
import numpy as np
from dlo_planner.kernels import cache_folder
from dlo_planner.ritz.kinematics import march
rotations, positions = np.empty((3, 3, 3)), np.empty((3, 3))
march(np.full(2, 0.5), np.zeros((2, 3)), np.eye(3), rotations, positions)
print(positions[-1, 0], sum(march.stats.cache_hits.values()), cache_folder())
"""
ONLY_WHERE = """
from dlo_planner.kernels import cache_folder
print(0, 0, cache_folder())
"""
# Becomes a user who may not write, once all is imported that lies where only others may read.
AS_NOBODY = """
import numba, os, sys
numba.njit(lambda x: x + 1)(1)
if os.getuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
sys.path.insert(0, os.getcwd())
"""
NOWHERE_TEMPORARY = """
import tempfile
def nowhere():
    raise FileNotFoundError('no usable temporary directory')
tempfile.gettempdir = nowhere
"""


@pytest.fixture
def copied():
    """Return a folder with a copy of some of the package, without caches, that all can read."""
    package = Path(dlo_planner.__file__).parent
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, 'dlo_planner')
        shutil.copytree(package / 'ritz', copy / 'ritz',
                        ignore=shutil.ignore_patterns('__pycache__'))
        shutil.copy(package / 'kernels.py', copy)
        Path(copy, '__init__.py').touch()
        os.chmod(folder, 0o755)
        yield Path(folder)
        for path in (Path(folder), *Path(folder).rglob('*')):
            path.chmod(0o755)


def run(folder, code, **changes):
    """Return what the code prints, run in the folder: numbers, and where caches are."""
    names = ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME', 'PYTHONPATH')
    environment = {name: value for name, value in os.environ.items() if name not in names}
    environment |= {'HOME': str(folder / 'home'), **changes}
    environment = {name: value for name, value in environment.items() if value is not None}
    done = subprocess.run([sys.executable, '-c', code], cwd=folder, env=environment, text=True,
                          capture_output=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    value, hits, where = done.stdout.split()
    return float(value), int(hits), where


def test_an_edit_of_a_kernel_that_others_call_is_run(copied):
    assert run(copied, MARCH)[:2] == (1.0, 0)
    value, hits, where = run(copied, MARCH)
    assert (value, hits) == (1.0, 1)
    assert Path(where).parent == copied / 'dlo_planner' / '__pycache__'
    edited = copied / 'dlo_planner' / 'ritz' / 'arc.py'
    before, times = edited.read_text(), edited.stat()
    edited.write_text(before.replace('chord[0] = h * (', 'chord[0] = 3 * ('))
    assert edited.read_text() != before
    os.utime(edited, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert run(copied, MARCH)[:2] == (6.0, 0)
    edited.write_text(before)
    assert run(copied, MARCH)[:2] == (1.0, 1)


@pytest.mark.parametrize('temporary', [True, False])
def test_where_nothing_can_be_written_it_works(copied, temporary):
    for path in (*copied.rglob('*'), copied):
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = AS_NOBODY + ('' if temporary else NOWHERE_TEMPORARY) + MARCH
    with tempfile.TemporaryDirectory() as free:
        os.chmod(free, 0o777)
        answers = [run(copied, code, HOME=None, TMPDIR=free, PYTHONDONTWRITEBYTECODE='1')
                   for _ in range(1 + temporary)]
        shutil.rmtree(free)  # of another user
        os.mkdir(free)
    assert [value for value, _, _ in answers] == [1.0] * len(answers)
    if temporary:
        assert [hits for _, hits, _ in answers] == [0, 1]
        assert answers[0][2].startswith(free)
    else:
        assert answers[0][2] == 'None'


def test_what_was_compiled_at_installation_is_used_where_nothing_can_be_written(copied):
    assert run(copied, MARCH)[:2] == (1.0, 0)
    installed = copied / 'dlo_planner' / '__pycache__'
    for path in (*copied.rglob('*'), copied):
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = AS_NOBODY + NOWHERE_TEMPORARY + MARCH
    value, hits, where = run(copied, code, HOME=None, PYTHONDONTWRITEBYTECODE='1')
    assert (value, hits, Path(where).parent) == (1.0, 1, installed)
    # a user who can write keeps what is missing there, and uses the rest
    with tempfile.TemporaryDirectory() as home:
        os.chmod(home, 0o777)
        value, hits, where = run(copied, AS_NOBODY + MARCH, HOME=home, PYTHONDONTWRITEBYTECODE='1')
        assert (value, hits) == (1.0, 1)
        assert where.startswith(home) and not list(Path(where).iterdir())


def test_a_folder_that_somebody_else_could_fill_is_not_used(copied):
    (copied / 'dlo_planner' / '__pycache__').write_text('a file in the place of the folder')
    with tempfile.TemporaryDirectory() as free:
        Path(free, f'dlo_planner-{os.getuid()}').mkdir()
        Path(free, f'dlo_planner-{os.getuid()}').chmod(0o777)
        assert run(copied, ONLY_WHERE, HOME='/dev/null', TMPDIR=free)[2] == 'None'


def test_old_caches_are_few(copied):
    caches = copied / 'dlo_planner' / '__pycache__'
    for k in range(9):
        (caches / f'kernels-{k}').mkdir(parents=True)
        os.utime(caches / f'kernels-{k}', (k, k))
    run(copied, ONLY_WHERE)
    left = sorted(path.name for path in caches.glob('kernels-?'))
    assert left == [f'kernels-{k}' for k in range(5, 9)]
