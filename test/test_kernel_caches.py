# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What was compiled from other sources is never run, and nothing need be written to work."""

import json
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import time
import zlib
from contextlib import contextmanager
from pathlib import Path

import pytest

import dlo_planner
from dlo_planner.kernels.files import prune

# Kernels in two files: first -> second -> third -> last, third -> wide, first -> aside, and one
# alone. All but `wide`, which is a unit, are copied into their callers.
DEEP = """
import numpy as np
from dlo_planner.kernels import kernel
FACTORS = np.array([2.0, 3.0])
@kernel
def last(x):
    return x * FACTORS[0]
@kernel
def wide(x):
    y = x
TERMS
    return y
@kernel
def third(x):
    return last(x) + wide(x)
""".replace('TERMS', '    y = (y - 1.0) * (x - 0.5) + 1.0\n' * 99)
CHAIN = """
import numpy as np
from dlo_planner.deep import third
from dlo_planner.kernels import kernel
@kernel
def second(x):
    return third(x)
@kernel
def aside(x):
    return 0.5 * x
@kernel
def first(x):
    return second(x) + aside(x)
@kernel
def alone(x):
    return np.full(2, x - 1.0)
"""
EXERCISES = """
from dlo_planner.chain import alone, first
def use():
    first(1.0), alone(1.0)
ALL = (use,)
"""
USE = """
import json
from dlo_planner.chain import alone, first
from dlo_planner.kernels.dispatcher import KERNELS
from dlo_planner.kernels.files import folders
values = [first(1.0), float(alone(1.0)[1])]
stats = {f.__qualname__: k.stats for f, k in KERNELS.items()}
print(json.dumps([values, sorted(name for name, s in stats.items() if s.cache_hits),
                  sorted(name for name, s in stats.items() if s.cache_misses),
                  str(folders().write)]))
"""
KEPT = ['alone.for_python', 'first.for_python', 'wide']
ALL = sorted([*KEPT, 'first', 'second', 'third', 'last', 'aside', 'alone'])
OF_FIRST = sorted({*ALL} - {'alone', 'alone.for_python', 'wide'})  # all but the unit
PREBUILD = 'from dlo_planner.prebuild import main; import sys; sys.exit(main([]))'
ALL_COPIED = """
from dlo_planner.kernels import dispatcher
dispatcher._SMALL = 10**9
"""
# Becomes a user who may not write, once all is imported that lies where only others may read.
AS_NOBODY = """
import numba, os, pkgutil, sys  # nobody may not read what this Python comes with
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


@contextmanager
def folder_for_all():
    """Yield a folder that all can read, and delete it, whatever rights it has in the end."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        yield folder
        for path in (folder, *folder.rglob('*')):
            path.chmod(0o755)


@contextmanager
def package_of_kernels():
    """Yield a folder with a package of that name and a few kernels."""
    package = Path(dlo_planner.__file__).parent
    with folder_for_all() as folder:
        copy = folder / 'dlo_planner'
        shutil.copytree(package / 'kernels', copy / 'kernels',
                        ignore=shutil.ignore_patterns('__pycache__'))
        for name in ('prebuild.py', 'signals.py'):
            shutil.copy(package / name, copy)
        version = "__version__ = '0.0.0'\n"
        for name, text in (('__init__', version), ('deep', DEEP), ('chain', CHAIN),
                           ('exercises', EXERCISES)):
            Path(copy, f'{name}.py').write_text(text)
        yield folder


@pytest.fixture
def copied():
    """Return such a folder where nothing has been compiled."""
    with package_of_kernels() as folder:
        yield folder


@pytest.fixture(scope='module')
def _used():
    with package_of_kernels() as folder:
        run(folder)
        yield folder


@pytest.fixture
def used(_used):
    """Return a folder of one's own where all has been compiled, once for all tests."""
    with folder_for_all() as folder:
        shutil.copytree(_used, folder, ignore=shutil.ignore_patterns('__pycache__'),
                        dirs_exist_ok=True)
        yield folder


def kept(folder):
    return folder / 'home/.cache/dlo_planner/kernels'


def started(folder, code, **changes):
    names = ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME', 'PYTHONPATH', 'NUMBA_CPU_NAME',
             'NUMBA_DISABLE_JIT')
    environment = {name: value for name, value in os.environ.items() if name not in names}
    environment |= {'HOME': str(folder / 'home'), 'PYTHONDONTWRITEBYTECODE': '1', **changes}
    environment = {name: value for name, value in environment.items() if value is not None}
    return subprocess.Popen([sys.executable, '-c', code], cwd=folder, env=environment, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def result(process):
    """Return what it printed: values, kernels that were found, others, and where they are kept."""
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0, error
    return json.loads(out)


def run(folder, code=USE, **changes):
    return result(started(folder, code, **changes))


def prebuilt(folder):
    process = started(folder, PREBUILD)
    assert process.wait(600) == 0, process.communicate()[1]
    process.communicate()
    return list((folder / 'dlo_planner' / 'compiled').rglob('*.kernel'))


def edit(folder, name, old, new):
    """Change a file, but not its time."""
    path = folder / 'dlo_planner' / f'{name}.py'
    text, times = path.read_text(), path.stat()
    assert old in text
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def make_read_only(folder):
    for path in (*folder.rglob('*'), folder):
        path.chmod(0o555 if path.is_dir() else 0o444)


@pytest.mark.sweep
def test_an_edit_of_a_kernel_that_others_call_compiles_those_and_no_others(copied):
    assert run(copied) == [[3.5, 0.0], [], ALL, str(kept(copied))]
    assert run(copied)[:3] == [[3.5, 0.0], KEPT, []]
    edit(copied, 'deep', 'FACTORS[0]', 'FACTORS[1]')
    assert run(copied)[:3] == [[4.5, 0.0], ['alone.for_python', 'wide'], OF_FIRST]
    edit(copied, 'deep', 'FACTORS[1]', 'FACTORS[0]')
    assert run(copied)[:3] == [[3.5, 0.0], KEPT, []]  # still known


@pytest.mark.sweep
def test_an_edit_of_a_unit_compiles_its_callers(used):
    edit(used, 'deep', '+ 1.0', '+ 2.0')
    assert run(used)[:3] == [[5.5, 0.0], ['alone.for_python'], sorted([*OF_FIRST, 'wide'])]


@pytest.mark.sweep
@pytest.mark.parametrize('name, compiled', [
    ('wide', ['wide']), ('first.for_python', OF_FIRST), ('alone.for_python', [
        'alone', 'alone.for_python'])])
def test_a_file_can_be_missing(used, name, compiled):
    (path,) = kept(used).glob(f'dlo_planner.*.{name}-*')
    path.unlink()
    assert run(used)[:3] == [[3.5, 0.0], sorted({*KEPT} - {*compiled}), compiled]
    assert run(used)[:3] == [[3.5, 0.0], KEPT, []]


@pytest.fixture(scope='module')
def _copied_anew():
    """Return such a folder of a process in which `wide` is no unit."""
    with package_of_kernels() as folder:
        assert run(folder, ALL_COPIED + USE)[0] == [3.5, 0.0]
        yield folder


@pytest.mark.sweep
@pytest.mark.parametrize('calls, code, compiled', [
    (False, USE, []), (True, USE, ['wide']), (True, ALL_COPIED + USE, sorted([*OF_FIRST, 'wide']))])
def test_what_is_a_unit_in_one_process_may_be_none_in_another(used, _copied_anew, calls, code,
                                                              compiled):
    file = next(kept(used if calls else _copied_anew).glob('*.first.for_python-*'))
    with folder_for_all() as folder:
        shutil.copytree(_copied_anew if calls else used, folder, dirs_exist_ok=True)
        shutil.copy(file, kept(folder))
        values, _, missed, _ = run(folder, code)
        assert (values, missed) == ([3.5, 0.0], compiled)


@pytest.mark.sweep
def test_what_changes_numba_counts(used):
    edit(used, 'kernels/dispatcher', '\n\n\n', '\n# another way\n\n\n')
    assert run(used)[:3] == [[3.5, 0.0], [], ALL]


@pytest.mark.sweep
def test_the_contents_of_a_constant_count(used):
    edit(used, 'deep', '[2.0, 3.0]', '[2.5, 3.0]')
    assert run(used)[:2] == [[4.0, 0.0], ['alone.for_python', 'wide']]


@pytest.mark.sweep
def test_neither_place_nor_time_nor_line_nor_wording_counts(used):
    edit(used, 'deep', '@kernel\ndef last(x):\n', '# Lines\n\n@kernel\ndef last(x):\n    # two\n')
    edit(used, 'chain', 'def aside(x):', 'def aside(x):\n    """Return half."""')
    moved = used / 'elsewhere'
    moved.mkdir()
    shutil.move(used / 'dlo_planner', moved)
    for path in moved.rglob('*.py'):
        path.touch()
    assert run(moved, HOME=str(used / 'home'))[1:3] == [KEPT, []]


@pytest.mark.sweep
@pytest.mark.parametrize('temporary', [True, False])
def test_where_nothing_can_be_written_it_works(copied, temporary):
    make_read_only(copied)
    code = AS_NOBODY + ('' if temporary else NOWHERE_TEMPORARY) + USE
    with tempfile.TemporaryDirectory() as free:
        os.chmod(free, 0o777)
        answers = [run(copied, code, HOME=None, TMPDIR=free, PYTHONDONTWRITEBYTECODE='1')
                   for _ in range(1 + temporary)]
        shutil.rmtree(free)  # of another user
        os.mkdir(free)
    assert [values for values, *_ in answers] == [[3.5, 0.0]] * len(answers)
    if temporary:
        assert [found for _, found, *_ in answers] == [[], KEPT]
        assert answers[0][3].startswith(free)
    else:
        assert answers[0][3] == 'None'


@pytest.mark.sweep
def test_what_was_compiled_at_installation_is_used_on_this_processor(copied):
    assert len(prebuilt(copied)) == len(KEPT)
    make_read_only(copied)
    code = AS_NOBODY + NOWHERE_TEMPORARY + USE
    assert run(copied, code, HOME=None, PYTHONDONTWRITEBYTECODE='1') == [
        [3.5, 0.0], KEPT, [], 'None']
    # a user who can write keeps what is missing there, and uses the rest
    with tempfile.TemporaryDirectory() as home:
        os.chmod(home, 0o777)
        _, found, compiled, where = run(copied, AS_NOBODY + USE, HOME=home,
                                        PYTHONDONTWRITEBYTECODE='1')
        assert (found, compiled) == (KEPT, [])
        assert where.startswith(home) and not list(Path(where).iterdir())
    # a processor that was asked for is meant
    assert run(copied, code, HOME=None, PYTHONDONTWRITEBYTECODE='1',
               NUMBA_CPU_NAME='generic')[1:3] == [[], ALL]


@pytest.mark.sweep
def test_a_build_contains_what_was_compiled(copied):
    pytest.importorskip('setuptools')
    for name in ('setup.py', 'README.md', 'package.xml'):
        shutil.copy(Path(dlo_planner.__file__).parent.parent / name, copied)
    for changes, number in (({'DLO_PLANNER_PREBUILD': '0'}, 0), ({}, len(KEPT))):
        made = subprocess.run([sys.executable, 'setup.py', '-q', 'build'], cwd=copied, text=True,
                              env=os.environ | {'NUMBA_DISABLE_JIT': '0'} | changes,
                              capture_output=True, check=False)
        assert made.returncode == 0, made.stderr
        assert len(list((copied / 'build').rglob('*.kernel'))) == number
    assert not list((copied / 'dlo_planner').rglob('*.kernel'))
    built = next((copied / 'build').rglob('chain.py')).parent.parent
    assert run(built, HOME='/dev/null')[:3] == [[3.5, 0.0], KEPT, []]


@pytest.mark.sweep
def test_a_second_installation_compiles_and_keeps_what_has_changed(copied):
    before = {path.name: path.stat().st_mtime_ns for path in prebuilt(copied)}
    edit(copied, 'chain', 'x - 1.0', 'x - 2.0')
    after = {path.name: path.stat().st_mtime_ns for path in prebuilt(copied)}
    assert len(after) == len(before) == len(KEPT)
    changed = after.items() - before.items()
    assert {name.split('-')[0] for name, _ in changed} == {'dlo_planner.chain.alone.for_python'}
    assert run(copied)[:3] == [[3.5, -1.0], KEPT, []]


@pytest.mark.sweep
def test_a_file_that_is_not_whole_or_holds_something_else_is_not_used(used):
    files = sorted(kept(used).iterdir())
    assert len(files) == len(KEPT)
    damages = [lambda data: data[:-9], lambda data: zlib.compress(pickle.dumps(7)),
               lambda data: b'', lambda data: b'x' * 99, lambda data: data[9:],
               lambda data: data[:200] + bytes([data[200] ^ 1]) + data[201:],
               lambda data: data[::-1]]
    for damage in damages:
        for path in files:
            path.write_bytes(damage(path.read_bytes()))
        values, found, compiled, _ = run(used)
        assert (values, found, compiled) == ([3.5, 0.0], [], ALL)
    assert run(used)[:3] == [[3.5, 0.0], KEPT, []]


@pytest.mark.sweep
def test_several_processes_at_once(copied):
    processes = [started(copied, USE) for _ in range(3)]
    assert [result(process)[0] for process in processes] == [[3.5, 0.0]] * 3
    values, found, _, where = run(copied)
    assert (values, found) == ([3.5, 0.0], KEPT)
    assert len(list(Path(where).iterdir())) == len(KEPT)


@pytest.mark.sweep
def test_what_a_kernel_reads_unseen_is_not_kept(copied):
    edit(copied, 'deep', 'x * FACTORS[0]', 'x * constants.FACTOR')
    edit(copied, 'deep', 'import numpy as np', 'from dlo_planner import constants')
    edit(copied, 'deep', 'FACTORS = np.array([2.0, 3.0])', '')
    constants = copied / 'dlo_planner' / 'constants.py'
    for factor in (2.0, 3.0):
        constants.write_text(f'FACTOR = {factor}')
        values, found, _, _ = run(copied)
        assert values == [factor + 1.5, 0.0]
    assert found == ['alone.for_python', 'wide']


@pytest.mark.sweep
def test_a_kernel_that_is_handed_over_is_not_taken_for_another(copied):
    code = ('import json\nfrom dlo_planner.deep import last, third\n'
            'from dlo_planner.kernels import kernel\n@kernel\ndef apply(g, x):\n    return g(x)\n'
            'print(json.dumps([apply({}, 1.0), sum(apply.stats.cache_hits.values())]))')
    assert [run(copied, code.format(name)) for name in ('last', 'third')] == [[2.0, 0], [3.0, 0]]
    edit(copied, 'deep', 'FACTORS[0]', 'FACTORS[1]')
    assert run(copied, code.format('last')) == [3.0, 0]


@pytest.mark.sweep
def test_a_folder_that_somebody_else_could_fill_is_not_used(copied):
    with tempfile.TemporaryDirectory() as free:
        Path(free, f'dlo_planner-{os.getuid()}').mkdir()
        Path(free, f'dlo_planner-{os.getuid()}').chmod(0o777)
        assert run(copied, HOME='/dev/null', TMPDIR=free)[3] == 'None'


def test_what_was_used_long_ago_makes_room(tmp_path):
    now = time.time()
    for k in range(6):
        (tmp_path / f'{k}.kernel').write_bytes(bytes(100))
        os.utime(tmp_path / f'{k}.kernel', (now - k, now - k))
    prune(tmp_path, room=350)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['0.kernel', '1.kernel', '2.kernel']
