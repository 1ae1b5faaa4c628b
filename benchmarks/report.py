# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The table as text, Markdown and JSON."""

import json
import os
import platform
from pathlib import Path

import numba
import numpy as np
import scipy

from benchmarks.rows import Row
from benchmarks.timing import Timed

ROOT = Path(__file__).parent.parent
DOCS, RESULTS = ROOT / 'docs', ROOT / 'benchmarks' / 'results'
_FACTOR = {'s': 1.0, 'ms': 1e3, 'us': 1e6, '': 1.0}


def line(row: Row, timed: Timed) -> list[str]:
    """Return the cells of a row: what, median, least, worst, times the floor, goals, met."""
    factor = _FACTOR[row.unit]
    goals = ', '.join(_goal(goal, timed) for goal in row.goals)
    met = 'yes' if all(goal.met(timed) for goal in row.goals) else 'no'
    return [row.name, *(f'{factor * value:.3g} {row.unit}'.strip()
                        for value in (timed.median, timed.least, timed.worst)),
            f'{timed.ratios["floor"]:.2f}' if 'floor' in timed.ratios else '',
            goals, met if row.goals else '']


def _goal(goal, timed):
    """Return a goal, and the value that it is compared with where no column has it."""
    if goal.unit in ('ms', 'us', 's', '', 'ms at worst'):
        return str(goal)
    return f'{goal} ({goal.value(timed):.3g})'


HEADS = ['what', 'median', 'least', 'worst', 'x floor', 'goal (found)', 'met']


def markdown(heads: list[str], lines: list[list[str]]) -> str:
    """Return a table in Markdown."""
    rows = [heads, ['---'] * len(heads), *lines]
    return ''.join('| ' + ' | '.join(cells) + ' |\n' for cells in rows)


def machine() -> dict:
    """Return what the figures depend on besides the package."""
    return {'cpu': _cpu(), 'cores': os.cpu_count(), 'load': round(os.getloadavg()[0], 2),
            'python': platform.python_version(), 'numpy': np.__version__,
            'scipy': scipy.__version__, 'numba': numba.__version__}


def _cpu():
    known = Path('/proc/cpuinfo')
    if not known.exists():
        return platform.processor()
    lines = known.read_text().splitlines()
    return next((text.split(':')[1].strip() for text in lines if text.startswith('model name')),
                platform.machine())


def as_json(found: dict[str, tuple[Row, Timed]]) -> dict:
    """Return the table as what JSON can hold."""
    return {name: {'median_s': timed.median, 'least_s': timed.least, 'worst_s': timed.worst,
                   'ratios': timed.ratios, 'rounds': timed.rounds,
                   'goals': [{'goal': str(goal), 'found': goal.value(timed),
                              'met': bool(goal.met(timed))} for goal in row.goals]}
            for name, (row, timed) in found.items()}


def data_of(folder: Path) -> Path:
    """Return where the tables and figures of a folder are kept: the site's has pictures alone."""
    return RESULTS / folder.name if folder.resolve().parent == DOCS.resolve() else folder


def write(folder: Path, name: str, title: str, text: str, data: dict) -> None:
    """Write `name`.md and `name`.json, where those of a folder are kept."""
    folder = data_of(folder)
    folder.mkdir(parents=True, exist_ok=True)
    about = machine()
    told = ', '.join(f'{key} {value}' for key, value in about.items())
    (folder / f'{name}.md').write_text(f'{title}\n\n{text}\n*{told}*\n')
    (folder / f'{name}.json').write_text(
        json.dumps({'machine': about, name: data}, indent=1, allow_nan=False) + '\n')
