# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that make no array count no references; all others do, and nothing leaks."""

import gc

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from dlo_planner import DirectSimulator, Plane, Pose, Rod
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import COMPILED, files, kernel

pytestmark = pytest.mark.skipif(not COMPILED, reason='kernels are plain Python')


class Pair(Record):
    """A Record of two arrays."""

    one: np.ndarray
    other: np.ndarray


def in_rows(x, y):
    total = 0.0
    for a in range(x.shape[0]):
        row, other = x[a], y[a]
        if row[0] < 0.0:
            continue
        for i in range(row.size):
            total += row[i] * other[i]
            if total > 1e9:
                return -1.0
        other[0] = total
    return total


def in_fields(pair):
    one, other = pair.one, pair.other
    for row in one:
        other[0] += row[0]
    return other[0]


def made(x):
    y = np.zeros(3)
    for a in range(x.shape[0]):
        y += x[a]
    return y.sum()


def first_row(x):
    return x[0]


def first_of(pair):
    return pair.one


@kernel
def doubled(x):
    """Return an array of its own."""
    return 2.0 * x


def calls_what_makes(x):
    total = 0.0
    for a in range(x.shape[0]):
        total += doubled(x[a])[1]
    return total


@pytest.fixture
def compiled_anew(tmp_path, monkeypatch):
    """Find no machine code in files: what is read from there has no text."""
    monkeypatch.setattr(files, '_only', [tmp_path])
    files.folders.cache_clear()
    yield
    files.folders.cache_clear()


def counts(function, *args):
    """Whether the code of a kernel counts references of any argument."""
    compiled = kernel(function)
    compiled(*args)
    return any('call void @NRT_incref' in result.library.get_llvm_str()
               or 'call void @NRT_decref' in result.library.get_llvm_str()
               for result in compiled.overloads.values())


@pytest.mark.parametrize(('function', 'expected'), [
    (in_rows, False), (in_fields, False), (made, True), (first_row, True), (first_of, True),
    (calls_what_makes, True)])
def test_references_are_counted_where_arrays_are_made_or_returned(compiled_anew, function,
                                                                  expected):
    x = np.arange(12.0).reshape(4, 3)
    args = {in_rows: (x, x.copy()), in_fields: (Pair(x, x[0].copy()),), first_of: (Pair(x, x),)}
    assert counts(function, *args.get(function, (x,))) is expected


def test_numba_alone_counts_each_row():
    compiled = numba.njit(in_rows)
    compiled(np.ones((2, 3)), np.ones((2, 3)))
    assert 'call void @NRT_decref' in next(iter(compiled.overloads.values())).library.get_llvm_str()


def test_what_is_computed_is_the_same():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 50, 3))
    assert kernel(in_rows)(x, y.copy()) == in_rows(x, y.copy())
    assert kernel(in_fields)(Pair(x, y[0].copy())) == pytest.approx(x[:, 0].sum() + y[0, 0])


def test_what_is_returned_outlives_what_it_is_a_view_of():
    x = np.arange(6.0).reshape(2, 3)
    rows = [kernel(first_row)(x.copy()) for _ in range(50)]
    fields = [kernel(first_of)(Pair(x.copy(), x)) for _ in range(50)]
    gc.collect()
    for row, field in zip(rows, fields, strict=True):
        assert row.tolist() == [0, 1, 2] and field.tolist() == x.tolist()


def test_nothing_leaks_in_contact():
    rod = Rod(1.0, 0.035, 1.2e-3, 9e-4, radius=0.0025)
    direct = DirectSimulator(rod, obstacles=[Plane((0, 0, 0), (0, 0, 1), friction=0.5)],
                             gravity=(0, 0, -9.81), basis='local', n_elements=32)
    poses = [Pose((0, 0, z), (0, 0.2588190451, 0, 0.9659258263)) for z in (0.5, 0.48, 0.46, 0.44)]
    left = []
    _nrt_python.memsys_enable_stats()
    try:
        for _ in range(3):
            direct.track(poses)
            gc.collect()
            stats = rtsys.get_allocation_stats()
            left.append(stats.alloc - stats.free)
    finally:
        _nrt_python.memsys_disable_stats()
    assert stats.alloc > 1000 and left[1] == left[2]
