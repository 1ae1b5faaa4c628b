# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a process loads and sets when it starts: little for a first shape, one thread for BLAS."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

import dlo_planner
from dlo_planner import blas
from dlo_planner.cli.main import main as command
from dlo_planner.kernels import COMPILED

NAME = 'OPENBLAS_NUM_THREADS'
FIRST_SHAPE = """
import sys
from dlo_planner import DirectSimulator, Pose, Rod
DirectSimulator(Rod(1.0, 0.1, 0.05, 0.04), n_elements=8).solve(Pose((0, 0, 1), (0, 0, 0, 1)))
print(*sys.modules)
"""
THREADS = """
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


def printed(code, **environment):
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True,
                         env={**os.environ, **environment})
    return ran.stdout


def test_a_first_shape_imports_no_ros_nothing_of_plans_and_little_of_scipy():
    loaded = set(printed(FIRST_SHAPE).split())
    assert 'dlo_planner.direct.simulator' in loaded
    for package in ('identify', 'inverse', 'parallel', 'plan', 'public', 'verify'):
        assert f'dlo_planner.{package}' not in loaded
    needed = set(printed('import scipy.linalg, sys; print(*sys.modules)').split())
    for package in ('interpolate', 'optimize', 'sparse', 'spatial'):
        assert f'scipy.{package}' not in loaded - needed  # SciPy 1.11's linalg brings sparse along
    assert 'rclpy' not in loaded


def test_what_a_node_answers_with_needs_nothing_of_statistics():
    loaded = printed('import sys; from dlo_planner import exercises; print(*sys.modules)').split()
    assert 'dlo_planner.identify.smoother' in loaded and 'scipy.stats' not in loaded


LOADED = """
import cProfile, pstats
from dlo_planner import exercises
from dlo_planner.kernels import files
read, of_file = [], files._read
def _read(path):
    content = of_file(path)
    read.extend([path] if content else [])
    return content
files._read = _read
profile = cProfile.Profile()
profile.enable()
exercises.answers()
profile.disable()
first = pstats.Stats(profile).total_calls
profile = cProfile.Profile()
profile.enable()
exercises.answers()
profile.disable()
print(len(read), first - pstats.Stats(profile).total_calls)
"""


@pytest.mark.skipif(not COMPILED, reason='there is nothing to load')
def test_a_kernel_is_loaded_by_few_calls():
    # 4,200 calls of Python, most of them numba's: twice as many where numba times what one kernel
    # reads for another, or reads LLVM's code of what is called by its symbol
    few = 5500
    kernels, calls = map(int, printed(LOADED).split())
    if kernels < 300 or calls > few * kernels:  # some had to be compiled
        kernels, calls = map(int, printed(LOADED).split())
    assert kernels > 300
    assert calls < few * kernels


MAIN_PATH = """
import sys
from dlo_planner.public import *
from dlo_planner import penalties, results, rods, tasks
wire = DirectSimulator(Rod(1.0, 0.1, 1.0, 1.0, radius=1e-3), n_elements=8)
shape = wire.track([Pose((0, 0, 1), (0, 0, 0, 1)), Pose((0, 0.01, 1), (0, 0, 0, 1))])[-1]
wire.simulate([shape.gripper] * 2, 0.01)
InverseSimulator(wire).thread(CutOut(Pose.identity()), depths=[0, 0.1])
print(*(name for name in sys.modules if name.startswith('dlo_planner.study')), 'none but these')
"""


def test_the_main_path_reads_nothing_of_the_papers_methods():
    assert printed(MAIN_PATH).split() == ['none', 'but', 'these']
    studied = printed('import sys\nfrom dlo_planner.parallel import speculative\n'
                      'print(*sys.modules)')
    assert 'dlo_planner.study.speculation' in studied.split()


def test_it_is_known_where_every_public_name_is():
    assert set(dlo_planner._homes()) == set(dlo_planner.__all__)


def test_where_there_is_no_source_all_are_imported_and_subpackages_are_found():
    assert printed(
        'import sys, dlo_planner as d; d._homes = dict; d.Pose\n'
        'print("dlo_planner.public" in sys.modules, d.parallel.__name__); import dlo_planner\n'
        'from dlo_planner import settings; print(hasattr(d, "nobody"), settings.__name__)'
    ).split() == ['True', 'dlo_planner.parallel', 'False', 'dlo_planner.settings']


def _by_command(_):
    CliRunner().invoke(command, ['shape', '--help'])


def _by_node(monkeypatch):
    pytest.importorskip('rclpy')
    from dlo_planner.ros import main as node  # noqa: PLC0415
    monkeypatch.setattr(node.Process, 'run', lambda self: 0)
    node.main([])


@pytest.mark.parametrize('start', [_by_command, _by_node])
@pytest.mark.parametrize(('before', 'after'), [({}, '1'), ({NAME: '3'}, '3')])
def test_a_process_of_ours_has_one_thread_of_blas(monkeypatch, start, before, after):
    environment = dict(before)
    monkeypatch.setattr(blas.os, 'environ', environment)
    start(monkeypatch)
    assert environment[NAME] == after


def test_that_is_set_before_numpy_is_loaded():
    assert printed('import sys, dlo_planner.cli.main, dlo_planner.ros.main; '
                   'print("numpy" in sys.modules)').split() == ['False']


@pytest.mark.skipif(not Path('/proc/self/maps').exists(), reason='threads are limited on Linux')
def test_where_a_matrix_is_decomposed_it_has_one_thread():
    lines = printed(THREADS, **{NAME: '2'}).splitlines()
    if not lines[0]:
        pytest.skip('NumPy has another BLAS')
    before, inside, still, after = ([*map(int, one.split())] for one in lines)
    assert {*inside} == {*still} == {1} and before == after and max(before) == 2


FORKED = """
import numpy, os, scipy.linalg, threading
from dlo_planner.blas import _controls, _INSIDE, one_thread
def threads(): return {get() for get, _ in _controls()}
inside, done = threading.Event(), threading.Event()
def look():
    with one_thread(), _INSIDE.lock:
        inside.set()
        done.wait()
thread = threading.Thread(target=look)
thread.start()
inside.wait()
child = os.fork()
if not child:
    before = threads()
    with one_thread():
        within = threads()
    os.write(1, f'{before} {within} {threads()}'.encode())
    os._exit(0)
os.waitpid(child, 0)
done.set()
thread.join()
"""


@pytest.mark.skipif(not Path('/proc/self/maps').exists(), reason='threads are limited on Linux')
def test_a_process_that_is_forked_beside_a_look_has_its_own_threads_of_blas():
    told = printed(FORKED, **{NAME: '2'})
    if told.startswith('set()'):
        pytest.skip('NumPy has another BLAS')
    assert told == '{2} {1} {2}'


LOADING = """
import os, signal, threading, time
from numba.core.compiler_lock import global_compiler_lock
from dlo_planner import Pose, Rod, DirectSimulator
import dlo_planner.kernels.dispatcher
def compute():
    rod = Rod.circular(0.5, 1e-3, 7850.0, 2e11, 0.3)
    DirectSimulator(rod).solve(Pose.looking_along((0, 0, 0), (1, 0, 0)))
loading = threading.Event()
def load():
    with global_compiler_lock:
        loading.set()
        time.sleep(0.5)
thread = threading.Thread(target=load)
thread.start()
loading.wait()
child = os.fork()
if not child:
    signal.alarm(60)
    compute()
    os._exit(0)
thread.join()
print(os.waitpid(child, 0)[1])
"""


def test_a_process_that_is_forked_while_kernels_are_loaded_computes():
    assert printed(LOADING) == '0\n'
