# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured ratios that the page of the paper's figures says, from what their scripts wrote."""

import json

from benchmarks.report import DOCS, RESULTS
from benchmarks.said import renewed

PAGE = DOCS / 'reproduction.md'
_FOLDERS = {'fig08': 'benchmarks', 'fig09': 'benchmarks', 'fig10': 'benchmarks',
            'fig12': 'reproduction'}
_METHODS = ('newton', 'dfp', 'downhill_simplex')
_YIELDING, _MOVING = 'yielding, moved slowly', 'in motion, from the shape before (the paper\'s)'


def _known(name):
    """Return what the script of a figure wrote."""
    return json.loads((RESULTS / _FOLDERS[name] / f'{name}.json').read_text())[name]


def _by_elements():
    """Return the least and the largest number of elements, and by how much times grow between."""
    rows = [_known('fig08')[method] for method in _METHODS]
    sizes = sorted(set.intersection(*(set(map(int, row)) for row in rows)))
    ends = str(sizes[0]), str(sizes[-1])
    return [*ends, *(f'{row[ends[1]] / row[ends[0]]:.1f}' for row in rows)]


def _simplex():
    """Return by how much the simplex is slower than DFP with 2, with 8 and with most terms."""
    found = _known('fig09')
    both = [found[name] for name in _METHODS[1:]]
    most = str(max(set(map(int, both[0])) & set(map(int, both[1]))))
    slower = [f'{both[1][terms] / both[0][terms]:.0f}' for terms in ('2', '8', most)]
    return [*slower, most]


def _independent():
    """Return how much quicker two threads and two processes are, the medians of turns."""
    found = _known('fig10')
    return [f'{found[name]["2"]:.2f}' for name in ('threads', 'processes')]


def _dependent():
    """Return speedups: of three tasks in motion, of three and 16 where the wire yields."""
    found = _known('fig12')
    return [*(f'{found[f"{_MOVING}: {name}"]["3"]:.2f}' for name in ('DFP', 'simplex', 'Newton')),
            *(f'{found[f"{_YIELDING}: DFP"][tasks]:.2f}' for tasks in ('3', '16')),
            f'{found[f"{_YIELDING}: simplex"]["3"]:.2f}']


_N = r'([\d.]*\d)'
SAID = {
    f'{_N} to {_N} elements: Newton x {_N}, DFP x {_N}, simplex x {_N}': _by_elements,
    f'the simplex is {_N} times slower than DFP with 2 terms, {_N} times with 8, {_N} times with '
    f'{_N}': _simplex,
    f'two threads are {_N} times, two processes {_N} times as fast': _independent,
    f'in motion DFP {_N}, simplex {_N}, Newton {_N}; while yielding DFP {_N} with three tasks and '
    f'{_N} with 16, simplex {_N}': _dependent,
}


def updated(text):
    """Return the page with the numbers that were measured last.

    Raises:
        ValueError: one of the sentences is not there
    """
    return renewed(text, SAID, PAGE.name)


def write():
    """Write the page again."""
    PAGE.write_text(updated(PAGE.read_text()))
