# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the README: how they are said there, and which figures of the JSON they are."""

import json
from collections.abc import Callable
from math import ceil
from pathlib import Path

from benchmarks.said import renewed
from benchmarks.validation import page

_DOCS = Path(__file__).resolve().parents[2] / 'docs'


def _milliseconds(*rows: str) -> list[str]:
    """Return medians of rows of the table of benchmarks, ms."""
    core = json.loads((_DOCS / 'benchmarks' / 'core.json').read_text())['core']
    return [f'{1e3 * core[row]["median_s"]:.2f}' for row in rows]


def _apart() -> list[str]:
    """Return how far apart both engines are at rest and in contact, mm, rounded up.

    At most: what MuJoCo doubts of itself is added.
    """
    rows = json.loads((_DOCS / 'validation' / 'cross_check.json').read_text())['cross_check']
    most = [max(one['shown_m'] for one in rows.values() if one['kind'] == kind)
            for kind in ('static', 'contact')]
    return [f'{ceil(1e4 * one) / 10}' for one in most]


def _validations() -> list[str]:
    """Return how many rows, scripts and tests there are."""
    found = page.counts(page.load(_DOCS / 'validation'))
    return [str(found[name]) for name in ('rows', 'scripts', 'tests')]


# a pattern with a group for each number, and what returns these numbers
SAID: dict[str, Callable[[], list[str]]] = {
    r'About ([\d.]+) to ([\d.]+) ms a shape':
        lambda: _milliseconds('warm solve, local', 'cold solve of B, local'),
    r'About ([\d.]+) ms a pose through one cut-out, ([\d.]+) ms through two':
        lambda: _milliseconds('thread, a waypoint, local', 'thread_two, a waypoint'),
    r'(\d+) rows of figures by (\d+) scripts and (\d+) tests': _validations,
    r'within ([\d.]+) mm of MuJoCo at rest, ([\d.]+) mm in contact, '
    r'with': _apart,
}


def updated(text: str) -> str:
    """Return a text with the numbers that were measured last.

    Raises:
        ValueError: one of the sentences is not there
    """
    return renewed(text, SAID, 'README.md')
