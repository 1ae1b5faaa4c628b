# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a look, a fit, and a correction decompose, they do with one thread of BLAS.

Their matrices have some dozen rows: on a busy machine threads wait for each other a hundred times
as long as that takes.
"""

import numpy as np
import pytest
from closed_loops import NOISE, SPREAD, START, WIRE, Truth, looked, plan_of

from dlo_planner import DirectSimulator, Observer
from dlo_planner.blas import _controls
from dlo_planner.identify import correct
from dlo_planner.identify.fit import fit_rod


@pytest.fixture
def threads():
    """Give BLAS two threads, and return a function that returns how many it has."""
    controls = _controls()
    if not controls:
        pytest.skip('NumPy has another BLAS')
    before = [get() for get, _ in controls]
    for _, put in controls:
        put(2)
    yield lambda: [get() for get, _ in controls]
    for (_, put), count in zip(controls, before, strict=True):
        put(count)


@pytest.fixture
def seen(threads, monkeypatch):
    """Return a list of the threads that BLAS has whenever NumPy decomposes a matrix."""
    counts = []

    def spied(function):
        def spy(*arguments, **options):
            counts.extend(threads())
            return function(*arguments, **options)
        return spy

    for name in ('cholesky', 'eigh', 'inv', 'lstsq', 'solve', 'svd'):
        monkeypatch.setattr(np.linalg, name, spied(getattr(np.linalg, name)))
    return counts


def _look(observer, truth, rng, begun):
    looked(truth, observer, rng, START, 1, begun)


def _see_cutout(observer, _, rng, begun):
    observer.see_cutout(begun, np.zeros(3), NOISE * rng.normal(size=3))


def _reopen(observer, truth, rng, begun):
    observer.reopened(begun, 1e-3, 0.01, kink=0.1)


def _correct(observer, truth, rng, begun):
    correct(begun, plan_of())


def _fit(observer, truth, rng, begun):
    fit_rod(WIRE, [truth.seen(rng, START)])


@pytest.mark.parametrize('door', [_look, _see_cutout, _reopen, _correct, _fit])
def test_it_has_one_thread_and_then_as_many_as_before(door, seen, threads, rng):
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, cutout=1e-3)
    truth = Truth.drawn(rng)
    begun = looked(truth, observer, rng, START, 1)
    plan_of()  # which is kept, once it is made
    seen.clear()
    door(observer, truth, rng, begun)
    assert seen and {*seen} == {1}
    assert {*threads()} == {2}
