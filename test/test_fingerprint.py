# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The fingerprint of a kernel: what changes it, what does not, and what it refuses."""

import ast
import dis
import pkgutil
from cProfile import Profile
from functools import partial
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

import numpy as np
import pytest

import dlo_planner
from dlo_planner.geometry.record import Record, read
from dlo_planner.kernels import COMPILED, dispatcher, kernel
from dlo_planner.kernels.fingerprint import Unseen, _scanned, dependencies, fingerprint

pytestmark = pytest.mark.skipif(not COMPILED, reason='kernels are plain Python')
PACKAGE = Path(dlo_planner.__file__).parent
# Other ways to tell numba what to compile: no fingerprint would know of them.
UNKNOWN = {'intrinsic', 'overload_method', 'overload_attribute', 'overload_classmethod', 'njit',
           'jit', 'jitclass', 'vectorize', 'guvectorize', 'cfunc', 'generated_jit', 'stencil',
           'lower_builtin', 'typeof_impl', 'objmode'}


def made(text, name='f', **scope):
    """Return the kernel `name` of a text, which reads what stands in the scope."""
    scope = {'__name__': 'somewhere', 'np': np, 'kernel': kernel, **scope}
    exec(compile(text, 'somewhere.py', 'exec'), scope)
    return scope[name]


def of(text, **scope):
    return fingerprint(made(text, **scope))


READS = '@kernel\ndef f(x):\n    return x + c'


@pytest.mark.parametrize('one, other', [
    (1, 1.0), (1.0, -1.0), (0.0, -0.0), (1, True), ((1, 2), (2, 1)), ((1, (2,)), (1, 2)),
    ('a', 'b'), (np.ones(2), np.ones(3)), (np.ones(2), np.ones(2, dtype=np.float32)),
    (np.arange(4.0).reshape(2, 2), np.arange(4.0).reshape(2, 2, order='F')),
    (np.array([0.0, 1.0]), np.array([0.0, 2.0])), (np.float64(1), np.float32(1)), (None, 0),
    (np.sin, np.cos), (float, int)])
def test_constants(one, other):
    assert of(READS, c=one) != of(READS, c=other)
    assert of(READS, c=one) == of(READS, c=one)


@pytest.mark.parametrize('other', [
    '@kernel\ndef f(x):\n    return x - c',
    '@kernel\ndef f(x):\n    return c + x',
    '@kernel\ndef f(y, x=2):\n    return y + c',
    '@kernel\ndef f(x=1):\n    return x + c',
    '@kernel(fastmath=True)\ndef f(x):\n    return x + c',
    '@kernel(inline="always")\ndef f(x):\n    return x + c',
    '@kernel\ndef f(x):\n    return x + c + 0'])
def test_what_is_written(other):
    assert of(other, c=1) != of(READS, c=1)


@pytest.mark.parametrize('other', [
    '# far below\n\n\n@kernel\ndef f(x):\n\n    # more\n    return x + c',
    '@kernel\ndef f(x):\n    return (x +\n            c)',
    '@kernel\ndef f(x: float) -> float:\n    return x + c',
    'from __future__ import annotations\n@kernel\ndef f(x: Any) -> Any:\n    return x + c'])
def test_what_is_only_looks(other):
    assert of(other, c=1) == of(READS, c=1)


def test_docstrings_are_only_looks_unless_they_are_used():
    text = '@kernel\ndef f(x):\n    """{}"""\n    return x'
    assert of(text.format('one')) == of(text.format('two'))
    used = '@kernel\ndef f(x):\n    """{0}"""\n    return "{0}"'
    assert of(used.format('one')) != of(used.format('two'))


def test_closures_defaults_and_what_is_written_inside():
    text = ('def make(a):\n    @kernel\n    def f(x):\n        return x + a\n    return f\n'
            'f = make({})')
    assert of(text.format(1)) != of(text.format(2))
    text = '@kernel\ndef f(x):\n    return [k * {} for k in range(x)]'
    assert of(text.format(1)) != of(text.format(2))
    inner = '@kernel\ndef f(x):\n    g = lambda y: y + c\n    return g(x)'
    assert of(inner, c=1) != of(inner, c=2)


def test_what_is_called_deep_below():
    text = ('@kernel\ndef d(x):\n    return x * {}\n@kernel\ndef c(x):\n    return d(x)\n'
            '@kernel\ndef b(x):\n    return c(x)\n@kernel\ndef f(x):\n    return b(x)')
    assert of(text.format(1)) != of(text.format(2))
    assert [g.__name__ for g in dependencies(made(text.format(1)))] == ['f', 'b', 'c', 'd']
    around = '@kernel\ndef g(x):\n    return f(x - {0})\n@kernel\ndef f(x):\n    return g(x)'
    assert of(around.format(1)) != of(around.format(2)) == of(around.format(2))


def test_records_and_overloads():
    kinds = []
    for names in (('one', 'two'), ('two', 'one')):
        class Kind(Record):
            __annotations__ = dict.fromkeys(names, object)
        kinds.append(Kind)
    text = '@kernel\ndef f(x):\n    return Kind(x, x)'
    assert of(text, Kind=kinds[0]) != of(text, Kind=kinds[1]) == of(text, Kind=kinds[1])
    assert '_fields_of' in [function.__name__ for function in dependencies(read)]


def test_a_profiler_changes_nothing():
    text = '@kernel\ndef g(x):\n    return x + 1\n@kernel\ndef f(x):\n    return g(x)'
    one = made(text)
    before = fingerprint(one)
    with Profile():
        one.py_func.__globals__['g'](1)
        one(1)
    _scanned.cache_clear()
    assert fingerprint(one) == before


def unknown(x):
    return x


@pytest.mark.parametrize('value', [
    {1, 2}, frozenset('ab'), {1: 2}, [1, 2], (1, {2}), object(), np.array([None]), unknown, Path,
    ModuleType('dlo_planner.constants'), partial(max, 1)], ids=lambda v: type(v).__name__)
def test_what_cannot_be_followed_is_refused(value):
    with pytest.raises(Unseen):
        of(READS, c=value)


def test_a_set_that_is_written_in_a_kernel_is_refused():
    with pytest.raises(Unseen):
        of('@kernel\ndef f(x):\n    return x in {1, 2}')
    with pytest.raises(Unseen, match='nowhere'):
        of('@kernel\ndef f(x):\n    return nowhere(x)')


# ---- the package -----------------------------------------------------------------------------


def all_kernels():
    """Return all kernels of the package; what needs an extra has none (see below)."""
    for module in pkgutil.walk_packages([str(PACKAGE)], 'dlo_planner.'):
        if 'dlo_planner.kernels import' in source_of(module.name):
            import_module(module.name)
    return [one for one in dispatcher.KERNELS.values()
            if one.py_func.__module__.startswith('dlo_planner.')]


def source_of(name):
    path = PACKAGE.parent.joinpath(*name.split('.'))
    path = path / '__init__.py' if path.is_dir() else path.with_suffix('.py')
    return path.read_text()


def test_no_kernel_of_the_package_depends_on_what_is_not_seen():
    found = all_kernels()
    decorated = sum(line.startswith('@kernel') for path in PACKAGE.rglob('*.py')
                    for line in path.read_text().splitlines())
    assert len(found) >= decorated > 100
    assert len({fingerprint(one) for one in found}) == len(found)


def test_every_global_that_a_kernel_of_the_package_loads_is_seen():
    def loaded(code):
        names = {one.argval for one in dis.get_instructions(code) if one.opname == 'LOAD_GLOBAL'}
        return names.union(*[loaded(c) for c in code.co_consts if isinstance(c, CodeType)])
    for function in set().union(*map(dependencies, all_kernels())):
        names, _ = _scanned(function.__code__, function.__doc__ is not None)
        assert set(names) == loaded(function.__code__)
        calls = [function.__globals__.get(name) for name in names]
        calls = [g for g in calls if isinstance(g, FunctionType)]
        # others are kernels
        assert {g.__name__ for g in calls} <= {'_fields', 'interrupted', 'replaced'}


def test_the_package_tells_numba_nothing_behind_the_back_of_the_fingerprint():
    users = {}
    for path in PACKAGE.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                home = getattr(node, 'module', None) or ''
                names = {alias.name for alias in node.names}
                if 'numba' in {home.split('.')[0], *(name.split('.')[0] for name in names)}:
                    users.setdefault(path.relative_to(PACKAGE).as_posix(), set()).update(names)
    assert users.keys() - {f'kernels/{name}.py' for name in (
        '__init__', 'dispatcher', 'files', 'fingerprint', 'references')} == {
            'geometry/record.py', 'kernels/interruption.py',
            'prebuild.py'}  # which takes numba's timers away: no code depends on them
    # what the compiler itself writes is known by its text, which is in the key of all machine code
    assert UNKNOWN & users.pop('kernels/references.py') == {'intrinsic'}
    assert "'references.py'" in (PACKAGE / 'kernels' / 'files.py').read_text()
    assert not UNKNOWN & set().union(*users.values())
    assert 'overload' in users['geometry/record.py']
