# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""numba is changed while a kernel is compiled, and no longer; machine code is made where needed."""

import gc
import sys

import numba
import numpy as np
import pytest
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys
from numba.core.types.functions import BaseFunction

from dlo_planner.kernels import kernel
from dlo_planner.kernels.lean import Library, compiling


@pytest.fixture
def counted():
    """What returns how often arrays were made and freed."""
    _nrt_python.memsys_enable_stats()
    yield rtsys.get_allocation_stats
    _nrt_python.memsys_disable_stats()


def create_library():
    return cpu_target.target_context.codegen().create_library('one')


def test_numba_is_changed_within_and_as_before_afterwards():
    resolve = BaseFunction.get_call_type
    with pytest.raises(KeyError), compiling(), compiling():
        assert BaseFunction.get_call_type is not resolve
        assert isinstance(create_library(), Library) and not gc.isenabled()
        raise KeyError
    assert BaseFunction.get_call_type is resolve and gc.isenabled()
    assert type(create_library()) is JITCodeLibrary


def test_a_small_kernel_that_only_kernels_call_has_no_machine_code():
    def halved(x):
        return 0.5 * x

    part = kernel(halved)
    whole = kernel(lambda x: part(x) + 1.0)
    assert whole(3.0) == 2.5
    part.compile((types.float64,))  # where `whole` was loaded, it is not there yet
    (result,) = part.overloads.values()
    assert not result.library._emitted
    assert part(3.0) == 1.5


def test_functions_of_others_call_kernels_and_what_kernels_called_of_numpy():
    filled = kernel(lambda n: np.full(n, 2.0))
    assert filled(2).tolist() == [2.0, 2.0]
    assert numba.njit(lambda n: filled(n)[0] + np.full(n, 1.0)[0])(3) == 3.0


def test_kernels_of_lists_expressions_and_functions_in_functions():
    @kernel
    def mixed(a):
        def squared(x):
            return x * x

        b = 2.0 * a + 1.0
        return sum([squared(x) for x in b]) + len([1, 2])

    assert mixed(np.array([0.0, 1.0])) == 12.0


def test_errors_are_those_of_python():
    @kernel
    def checked(x):
        if x < 0.0:
            raise ValueError('negative')
        return 1.0

    assert checked(1.0) == 1.0
    with pytest.raises(ValueError, match='negative'):
        checked(-1.0)


def test_what_makes_no_array_counts_no_references():
    """Arrays that such a kernel sees live as long as before, and no longer."""
    @kernel
    def filled(a, x):
        rows = a[1:]
        for i in range(len(rows)):
            rows[i] += x
        return rows[0]

    @kernel
    def last(a):
        return a[1:]

    array = np.zeros(4)
    before = sys.getrefcount(array)
    assert filled(array, 2.0) == 2.0 and array.tolist() == [0.0, 2.0, 2.0, 2.0]
    assert sys.getrefcount(array) == before
    part = last(array)
    assert sys.getrefcount(array) == before + 1
    del array
    assert part.tolist() == [2.0, 2.0, 2.0]
    assert ['NRT_' in code_of(one) for one in (filled, last)] == [False, True]


def test_functions_of_numba_that_kernels_call_are_as_numba_makes_them(counted):
    @kernel
    def sorted_sum(a):
        return np.sort(a)[:2].sum() + np.dot(a[::2], a[1::2]) + min(3, len(a))

    a = np.array([3.0, 1.0, 2.0, 5.0])
    assert sorted_sum(a) == 3.0 + 13.0 + 3.0
    before = counted()
    for _ in range(10):
        sorted_sum(a)
    after = counted()
    assert after.alloc - before.alloc == after.free - before.free > 0


def code_of(function):
    """Return what is linked into kernels that call one."""
    return str(next(iter(function.overloads.values())).library._get_module_for_linking())


def test_an_array_that_does_not_fit_is_refused_without_strings_being_made():
    @kernel
    def put(a, b):
        a[1:, :2] = b

    a = np.zeros((3, 4))
    put(a, np.ones((2, 2)))
    assert a.sum() == 4
    with pytest.raises(ValueError, match='does not fit'):
        put(a, np.ones((2, 3)))
    assert a.sum() == 4 and 'unicode' not in code_of(put)


def test_names_of_machine_code_are_short_and_tell_types_apart():
    nested = tuple((np.zeros(1), np.zeros(n * (1,)), np.zeros(1, bool)) for n in (1, 2, 3))

    @kernel
    def first(pairs):
        return pairs[0][0][0] + pairs[2][1].ndim

    assert first(nested) == 3.0 and first((*nested, nested)) == 3.0
    names = [one.fndesc.llvm_func_name for one in first.overloads.values()]
    assert len(set(names)) == 2 and max(map(len, names)) < 250


def test_llvm_optimizes_at_its_first_level_within():
    with compiling():
        passes = cpu_target.target_context.codegen()._pass_builder()
    levels = [cpu_target.target_context.codegen()._pass_builder(), passes]
    assert [one._pto.speed_level for one in levels] == [3, 1]
