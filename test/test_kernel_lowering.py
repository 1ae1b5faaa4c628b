# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Items of arrays, loops and variables, which `kernels.lowering` writes by itself: as in Python."""

import numpy as np
import pytest
from numba.core.errors import NumbaError

from dlo_planner.kernels import COMPILED, kernel

pytestmark = pytest.mark.skipif(not COMPILED, reason='kernels are plain Python')
CUBE = np.arange(60.0).reshape(3, 4, 5)


def read(a, i, j, k):
    return a[i, j, k], a[-1, 0, k], a[i, -2, k]


def written(a, i, j, k):
    b = a.copy()
    if i > 0:  # so that `b` is used in several blocks
        b[i, j, k] = 1
    b[-1, -2, 0] = 2.5
    b[i, j, -1] += 4
    return b


@pytest.mark.parametrize('array', [
    CUBE, np.asfortranarray(CUBE), CUBE[::-1, :, ::-1], CUBE.astype(np.int32), CUBE > 20,
    CUBE.astype(np.float32), CUBE * (1 + 2j)], ids=('C', 'F', 'A', 'int32', 'bool', 'float32', 'z'))
@pytest.mark.parametrize('function', [read, written])
def test_items_are_those_that_python_finds(function, array):
    compiled = kernel(function)
    for place in ((0, 1, 2), (-1, -4, -5), (2, 3, 4), (np.int32(-2), np.uint8(3), 1)):
        assert np.array_equal(compiled(array, *place), function(array, *place))


def test_arrays_that_are_made_and_exchanged_have_their_items():
    def function(n):
        a, b = np.zeros(n), np.ones(n)
        for i in range(n):
            a[i] = b[-i] + i
            a, b = b, a
        one = a[1:]
        for value in b:
            one = one + value
        return a, b, one

    for n in (2, 5):
        assert all(map(np.array_equal, kernel(function)(n), function(n)))


def test_items_that_are_records_or_arrays_are_left_to_numba():
    def function(a, named):
        return a[1, 2].sum() + a[..., 1][0, 0] + named[1]['x'] + a[1][2][3]

    named = np.array([(1.0, 2.0), (3.0, 4.0)], [('x', float), ('y', float)])
    assert kernel(function)(CUBE, named) == function(CUBE, named)


def test_loops_go_through_what_python_goes_through():
    def function(start, stop, step):
        seen = [0]
        for i in range(stop):
            seen.append(i)
        for i in range(start, stop):
            seen.append(i)
            for j in range(i, stop, step):
                seen.append(j)
        span = range(start) if stop > 3 else range(stop)
        for i in span:
            seen.append(i)
        return seen

    compiled = kernel(function)
    for given in ((0, 3, 1), (2, 7, 3), (5, 2, 1), (-4, 4, 2), (3, -3, -1)):
        assert compiled(*given) == function(*given)


def test_a_step_of_nothing_is_refused():
    def function(step):
        total = 0
        for i in range(0, 3, step):
            total += i
        return total

    with pytest.raises(ValueError, match='must not be zero'):
        kernel(function)(0)


def test_what_cannot_be_compiled_is_told_with_its_place():
    def function(a):
        return a[0] + 'text'

    with pytest.raises(NumbaError, match=r"(?s)add.*test_kernel_lowering\.py"):
        kernel(function)(CUBE)
