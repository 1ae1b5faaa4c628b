# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels call large kernels by a symbol and copy small ones; Python calls each of them."""

import sys
import weakref

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError

from dlo_planner.kernels import COMPILED, files, kernel

pytestmark = pytest.mark.skipif(not COMPILED, reason='kernels are plain Python')
TERMS = '    y = (y - 1.0) * (x - 0.5) + 1.0\n' * 40
TEXT = f"""
@kernel
def large(x, sign=1, a=None):
    y = x
{TERMS}
    if sign < 0:
        raise ValueError('negative')
    return sign * y
@kernel{{options}}
def other(x):
    y = 1.0
{TERMS}
    return y
@kernel
def small(x):
    return 2.0 * x
@kernel
def caller(x, sign):
    return small(large(x, sign)) + other(x)
@kernel
def constants(x):
    return large(x, 1) + large(x, 2) + large(x, sign=3)
"""


@pytest.fixture(scope='module', params=['', '(forceinline=True)'], ids=['', 'forceinline'])
def made(request, tmp_path_factory):
    """Return a module of kernels that nobody has compiled, and the number of units among them."""
    module = type(sys)('made_for_a_test')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, '_only', [tmp_path_factory.mktemp('kernels')])
        files.folders.cache_clear()
        patch.setitem(sys.modules, module.__name__, module)
        module.kernel = kernel
        exec(TEXT.replace('{options}', request.param), module.__dict__)
        yield module, 1 if request.param else 2
    files.folders.cache_clear()


def plain(name, *args):
    scope = {'kernel': lambda *a, **k: a[0] if a else lambda f: f}
    exec(TEXT.replace('{options}', ''), scope)
    return scope[name](*args)


def code_of(function):
    """Return what LLVM made of a kernel."""
    (result,) = function.overloads.values()
    return result.library.get_llvm_str()


def test_a_large_kernel_is_called_and_a_small_one_copied(made):
    module, units = made
    assert module.caller(0.25, 1) == plain('caller', 0.25, 1)
    declared = [line for line in code_of(module.caller).splitlines()
                if line.startswith('declare') and 'made_for_a_test' in line]
    assert sum('.large-' in line for line in declared) == 1
    assert sum('.other-' in line for line in declared) == units - 1
    assert not any('small' in line for line in declared)


def test_errors_cross_from_kernel_to_kernel_to_python(made):
    module, _ = made
    assert module.caller(0.25, 2) == plain('caller', 0.25, 2)
    with pytest.raises(ValueError, match='negative'):
        module.caller(0.25, -1)
    with pytest.raises(ValueError, match='negative'):
        module.large(0.25, -1)


def test_a_constant_makes_no_version_of_its_own(made):
    module, _ = made
    assert module.constants(0.25) == plain('constants', 0.25)
    assert module.large.overloads and 'Literal' not in str([*module.large.overloads])


def test_python_calls_with_names_and_defaults(made):
    module, _ = made
    for _ in range(2):
        assert module.large(0.5) == module.large(x=0.5, sign=1, a=None) == plain('large', 0.5)
        assert module.large(sign=2, x=0.5) == 2 * plain('large', 0.5)
    with pytest.raises(TypeError):
        module.large()


def test_functions_of_others_call_kernels(made):
    module, _ = made
    large = module.large
    assert numba.njit(lambda x: large(x, 1))(0.25) == plain('large', 0.25)


def test_arrays_live_as_long_as_they_are_known_and_no_longer():
    @kernel
    def inner(a, b):
        return a[1:], b + 1.0, (a + b)[0]

    @kernel
    def outer(a, b):
        return inner(a, b)

    a, b = np.arange(3.0)[:], np.arange(3.0)[:]
    known = [weakref.ref(a), weakref.ref(b)]
    part, made, number = outer(a, b)
    assert (part.tolist(), made.tolist(), number) == ([1.0, 2.0], [1.0, 2.0, 3.0], 0.0)
    del a, b
    assert known[1]() is None and part.tolist() == [1.0, 2.0]
    del part
    assert known[0]() is None


def test_what_cannot_be_compiled_is_told_with_its_place():
    @kernel
    def function(a):
        return a[0] + 'text'

    with pytest.raises(NumbaError, match=r'(?s)add.*test_kernel_units\.py'):
        function(np.zeros(2))
