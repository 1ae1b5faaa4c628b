# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Goals, tables and guards; slopes, exponents and ratios are what they are called."""

import json
from itertools import count

import numpy as np
import pytest

from benchmarks import guards, page, report, suite
from benchmarks.peers.compare import line, time_to
from benchmarks.rows import Goal, Row
from benchmarks.timing import Timed, Work, exponent, measure, slope

TIMED = Timed(2e-3, 1e-3, 9e-3, {'floor': 4.0, 'solves': 12.0}, 5)


@pytest.mark.parametrize(('goal', 'value', 'met'), [
    (Goal(2.0, 'ms'), 2.0, True), (Goal(1.9, 'ms'), 2.0, False),
    (Goal(8.0, 'ms at worst'), 9.0, False),
    (Goal(500.0, 'per s'), 500.0, True), (Goal(501.0, 'per s'), 500.0, False),
    (Goal(12.0, 'solves'), 12.0, True), (Goal(3.9, 'floor'), 4.0, False)])
def test_goals(goal, value, met):
    assert goal.value(TIMED) == pytest.approx(value)
    assert goal.met(TIMED) is met


def test_a_line_says_whether_all_goals_are_met():
    row = Row('work', (Goal(3.0, 'ms'), Goal(10.0, 'solves')), None)
    cells = report.line(row, TIMED)
    assert cells == ['work', '2 ms', '1 ms', '9 ms', '4.00', '<= 3 ms, <= 10 solves (12)', 'no']
    assert report.markdown(['a', 'b'], [['1', '2']]) == '| a | b |\n| --- | --- |\n| 1 | 2 |\n'


def test_what_is_written_can_be_read(tmp_path):
    data = report.as_json({'work': (Row('work', (Goal(3.0, 'ms'),), None), TIMED)})
    report.write(tmp_path, 'core', '# Title', 'table\n', data)
    kept = json.loads((tmp_path / 'core.json').read_text())
    assert kept['core']['work']['goals'] == [{'goal': '<= 3 ms', 'found': 2.0, 'met': True}]
    assert (tmp_path / 'core.md').read_text().startswith('# Title\n\ntable\n')


def test_guards_see_growth_beyond_thirty_percent(tmp_path):
    before = {'one': 2.0, 'other': 1.0, 'gone': 5.0}
    assert guards.excesses(before, {'one': 2.6, 'other': 0.5, 'new': 99.0}) == []
    excess, = guards.excesses(before, {'one': 2.61, 'other': 1.0})
    assert excess.name == 'one'
    assert '+30%' in str(excess)
    with pytest.raises(ValueError, match='nothing to compare'):
        guards.excesses({}, {'one': 1.0})
    guards.store(before, tmp_path / 'ratios.json')
    assert guards.load(tmp_path / 'ratios.json') == before
    assert guards.load(tmp_path / 'none.json') == {}


def test_a_peer_gets_a_time_only_for_what_is_right():
    found = [(1e-3, 5e-3), (4e-3, 5e-5), (2e-3, None), (3e-3, 9e-5)]
    assert time_to(1e-4, found) == 3e-3
    assert time_to(1e-6, found) is None
    assert line('peer', 'case', found) == ['case', 'peer', '3 ms', '3 ms', '-', '5.0e-05 m']
    assert line('peer', 'case', [(1.0, None)])[2:] == ['-', '-', '-', 'none converged']


def test_ranks_of_the_suite():
    results = {'a': {'outcome': 'completed', 'wall_s': 2.0, 'metrics': {'error': -3.0}},
               'b': {'outcome': 'completed', 'wall_s': 3.0, 'metrics': {'error': 1.0}},
               'c': {'outcome': 'unsupported', 'wall_s': None, 'metrics': {}}}
    assert suite.ranks(results, None) == ['a', 'b']
    assert suite.ranks(results, 'error') == ['b', 'a']


def test_the_page_takes_what_was_measured(tmp_path):
    folder = tmp_path / 'found'
    report.write(folder, 'core', '# Title', '![x](a.png)\n\n| 1 |\n', {})
    words = page.text('before {{core}} after {{peers}}', folder)
    assert words.startswith('before ![x](found/a.png)')
    assert words.endswith('after *Not measured yet.*')
    assert page.text('{{core}}', folder, inside=True).startswith('![x](a.png)')


def test_slope_and_exponent():
    sizes = np.array([64, 256, 1024.0])
    assert slope(sizes, 3 + 0.5 * sizes) == pytest.approx(0.5)
    assert exponent(sizes, 7 * sizes**1.25) == pytest.approx(1.25)


def test_what_tells_nothing_is_refused():
    with pytest.raises(ValueError, match='two different'):
        slope([4, 4], [1, 2])
    with pytest.raises(ValueError, match='above 0'):
        exponent([1, 2], [0, 1])


class Clock:
    """A clock that goes on by what the calls say they take."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now

    def takes(self, seconds):
        def call():
            self.now += seconds
        return call


def test_ratios_are_per_unit_of_work():
    clock = Clock()
    timed = measure([Work(clock.takes(6.0), 3)], {'ruler': Work(clock.takes(1.0), 2)}, 0.0, clock)
    assert timed.median == pytest.approx(2.0)
    assert timed.ratios['ruler'] == pytest.approx(4.0)


def test_a_machine_that_gets_slower_changes_times_but_no_ratio():
    clock, slower = Clock(), count(1)

    def ruler():
        clock.now += next(slower)

    def work():
        clock.now += 5 * next(slower)

    timed = measure([Work(work)], {'ruler': Work(ruler)}, 0.0, clock)
    assert timed.least < timed.median < timed.worst + 1
    assert 5 < timed.ratios['ruler'] < 7


def test_the_worst_is_of_the_slowest_call():
    clock = Clock()
    calls = [Work(clock.takes(seconds)) for seconds in (1.0, 2.0, 9.0)]
    timed = measure(calls, {}, 0.0, clock)
    assert (timed.median, timed.worst) == (2.0, 9.0)
    assert isinstance(timed, Timed)
