# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The registry of validations: what is read from scripts and assertions, and that it all exists."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks.validation import asserted, page
from benchmarks.validation.comparisons import comparison
from benchmarks.validation.entry import Measure, largest, others_than, smallest
from benchmarks.validation.scripts import ENTRIES

ROOT = Path(__file__).parents[2]
TALLY = """3: leaps (0.20 s)
28 inserted, 1 refused, stability, 2 refused, start
CPU time: inserted 0.070 s, at most 0.46 s"""


@pytest.mark.parametrize(('source', 'explained', 'expected'), [
    ('error < 1e-6  # m', 'np.float64(2.5e-07) < 1e-06', ('error < 1e-6', 2.5e-7, 1e-6)),
    ('e < 0.5 * room', '0.1 < (0.5 * np.float64(0.4))', ('e < 0.5 * room', 0.1, 0.2)),
    ('x == pytest.approx(y, rel=1e-3)', '1.5 == 1.4 ± 2.0e-01',
     ('x == pytest.approx(y, rel=1e-3)', pytest.approx(0.1), 0.2)),
    ('0.1 < size', '0.1 < 7.0', None),            # a lower bound
    ('size > 0.1', '7.0 > 0.1', None),
    ('shape.converged', 'True', None),
    ('a < b', 'array([1, 2]) < array([3, 4])', None),
    ('a < b', "__import__('os').getpid() < 9999999", None)])  # nothing is called
def test_what_an_assertion_compares(source, explained, expected):
    assert comparison(source, explained) == expected


def test_what_a_script_prints():
    assert others_than('inserted', 'refused')(TALLY) == 0
    assert others_than('inserted')(TALLY) == 3
    assert others_than('replayed')('1 leaves the second, 19 replayed') == 1
    assert largest('off by {} m')('off by 2e-7 m, off by 3.5e-07 m and') == 3.5e-7
    assert smallest('from {} to {}')('from 3 to -2') == -2
    with pytest.raises(ValueError, match='was printed'):
        largest('off by {} m')('nothing')
    with pytest.raises(ValueError, match='outcomes'):
        others_than('replayed')('nothing')


def test_a_measure_is_met_below_its_limit_or_above_the_least():
    below = Measure('error', largest('{} mm'), 1.0, 'mm')
    above = Measure('share', largest('{} mm'), 1.0, 'mm', least=True)
    for text, expected in (('0.5 mm', (True, False)), ('2 mm', (False, True))):
        assert (below.judged(text)['met'], above.judged(text)['met']) == expected


def test_every_script_exists_and_every_name_is_used_once():
    assert len({one.name for one in ENTRIES}) == len(ENTRIES) > 10
    for entry in ENTRIES:
        if entry.script.startswith('-m '):
            assert import_module(entry.script[3:]).main
        else:
            assert (ROOT / entry.script).exists()


def test_every_row_names_tests_that_exist():
    rows = [row for group in asserted.groups() for row in group.rows]
    assert len(rows) > 120
    for row in rows:
        for test in row.tests:
            path, _, begins = test.partition('::')
            name = re.sub(r'\[.*', '', begins)
            assert re.search(rf'^def {name or "test_"}', (ROOT / path).read_text(), re.M), test


def test_what_fails_is_broken_and_what_is_not_run_is_not_met():
    row = {'shows': 'a', 'against': 'b', 'claim': 'c', 'tests': ['test/x.py'], 'passed': 1,
           'failed': 0, 'skipped': 0, 'checks': 2, 'seconds': 0.1, 'nearest': None}
    found = {'scripts': {}, 'asserted': {'g': {'title': 'G', 'rows': [
        row, row | {'passed': 0}, row | {'failed': 1}]}}}
    assert page.counts(found) == {'rows': 3, 'met': 1, 'run': 2, 'tests': 2,
                                  'checks': 6, 'scripts': 0}
    assert page.broken(found) == ['a: **no**: 1 fail']


def test_a_row_that_is_new_was_not_run_and_the_others_keep_what_was_measured():
    one = asserted.Row('a', 'b', 'c', ('test/x.py',))
    new = asserted.Row('new', 'b', 'c', ('test/y.py',))
    known = {'title': 'old', 'measured': {}, 'rows': [
        {'shows': 'a', 'passed': 7}, {'shows': 'gone', 'passed': 8}]}
    found = asserted.filled(asserted.Group('g', 'G', (one, new)), known)
    assert found['title'] == 'G' and found['measured'] == {}
    assert [(row['shows'], row['passed']) for row in found['rows']] == [('a', 7), ('new', 0)]
