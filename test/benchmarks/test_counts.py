# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""No call does more than it did: counted, so that a busy machine tells it as well."""

import pytest

from benchmarks import counts, guards
from benchmarks.__main__ import check
from benchmarks.counts import Counts, counted, differences, is_counted
from benchmarks.table import rows
from dlo_planner.kernels import COMPILED

ROWS = [row for row in rows() if is_counted(row)]
KEPT = counts.load()

pytestmark = pytest.mark.skipif(not COMPILED, reason='kernels are plain Python')


@pytest.mark.parametrize('row', ROWS, ids=lambda row: row.name)
def test_a_call_does_no_more_than_it_did(row):
    assert not differences(KEPT[row.name], counts.of_row(row))


def test_all_rows_that_are_kept_are_counted():
    assert len(ROWS) >= 40
    assert set(KEPT) == {row.name for row in ROWS}


def test_growth_is_told():
    before = Counts(100, 3, 3, 1000)
    assert differences(before, Counts(105, 5, 5, 1050)) == []
    assert differences(before, Counts(106, 3, 3, 1000)) == ['python: 106 instead of 100']
    assert differences(before, Counts(50, 6, 6, 1000)) == ['kernels: 6 instead of 3',
                                                         'iterations: 6 instead of 3']
    assert differences(before, Counts(100, 3, 3, 1051)) == ['size: 1051 instead of 1000']
    before = before._replace(iterations=100)  # which hang on the rounding of the processor
    assert differences(before, before._replace(iterations=125)) == []
    assert differences(before, before._replace(iterations=126)) == [
        'iterations: 126 instead of 100']


def test_what_is_counted():
    from benchmarks.cases import local, turned  # noqa: PLC0415
    simulator = local(8)
    shape = simulator.solve(turned(0))
    one = counted([lambda: simulator.solve(turned(5), shape)])
    two = counted([lambda: simulator.solve(turned(5), shape)] * 2)
    assert one.python > 20 and one.kernels >= 2 and one.iterations >= 2
    assert (two.python, two.kernels, two.iterations) == (2 * one.python, 2 * one.kernels,
                                                         2 * one.iterations)


@pytest.mark.sweep
def test_no_row_takes_far_longer_than_it_did():
    slower = check(0.3, '')
    kept = guards.load()
    assert not [str(one) for one in slower if one.now > 1.6 * kept[one.name]]
