# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays live as long as somebody knows them, whatever kernels do with them."""

import weakref

import numpy as np
import pytest

from dlo_planner.energy.loads import Load
from dlo_planner.kernels import kernel


def numbers():
    return np.arange(6.0).reshape(2, 3)[:]


def read(a, load):
    rows = load.pull[1:]
    return rows[0, 0] + a[0][1]


def filled(a, load):
    rows, other = load.pull[:1], (a, a[1:])
    for e in range(rows.shape[0]):
        other[0][e, 0] = rows[e, 0]


def swapped(a, load):
    b, c = load.pull, a
    for _ in range(3):
        b, c = c, b
    return b[0, 0]


def made(a, load):
    b = np.empty(3)
    b[0] = a[0, 0]
    return b[0]


def returned(a, load):
    return load.pull


def a_part_returned(a, load):
    return 1.0, a[0]


def an_expression(a, load):
    return (a + a)[0, 0]


def chosen(a, load):
    return a[np.array([0, 1])][0, 0]


def bundled(a, load):
    return Load(a).pull[0, 0]


@pytest.mark.parametrize('function', [read, filled, swapped, made, returned, a_part_returned,
                                      an_expression, chosen, bundled])
def test_arrays_live_as_long_as_they_are_known_and_no_longer(function):
    a, pull = numbers(), numbers()
    inner, known = kernel(function), [weakref.ref(a), weakref.ref(pull)]
    called = kernel(lambda a, load: (inner(a, load), None)[0])
    load = Load(pull)
    results = [called(a, load) for _ in range(5)]
    del a, pull
    assert known[1]() is not None and np.array_equal(load.pull, numbers())
    expected = function(numbers(), Plain())
    for result in results:
        np.testing.assert_equal(result, expected)
    del results, result, load
    assert [one() for one in known] == [None, None]


class Plain:
    """What stands for a Load in Python."""

    pull = numbers()
