# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""numba is changed while a kernel is compiled, and no longer; machine code is made where needed."""

import gc

import numba
import numpy as np
import pytest
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction

from dlo_planner.kernels import kernel
from dlo_planner.kernels.lean import Library, compiling


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
