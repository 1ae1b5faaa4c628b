# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows that tests assert: the tests are run, and how much of their limits they use is kept."""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Json = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]
_ROWS = Path(__file__).parent / 'asserted'
_MEASURED = ('passed', 'failed', 'skipped', 'checks', 'seconds', 'nearest')
_NOTHING_RAN = 5  # pytest's exit status
HEADS = ['what', 'against', 'asserted', 'tests', 'nearest to its limit', 'met']


@dataclass(frozen=True)
class Row:
    """What tests assert; `tests` are files, or what the names of tests begin with."""

    shows: str
    against: str
    claim: str
    tests: tuple[str, ...]


@dataclass(frozen=True)
class Group:
    """Rows of one file."""

    name: str
    title: str
    rows: tuple[Row, ...]


def groups() -> list[Group]:
    """Return all groups, in the order of their files' names."""
    found = []
    for path in sorted(_ROWS.glob('*.toml')):
        data = tomllib.loads(path.read_text())
        rows = tuple(Row(one['shows'], one['against'], one['claim'],
                         tuple(f'test/{test}' for test in one['tests'])) for one in data['row'])
        found.append(Group(path.stem, data['title'], rows))
    return found


def run(chosen: Sequence[Group], jobs: int) -> dict[str, Json]:
    """Run the tests of groups; return what was measured by the groups' names."""
    wanted = sorted({test for group in chosen for row in group.rows for test in row.tests})
    records = _records(wanted, jobs)
    return {group.name: {'title': group.title,
                         'rows': [_judged(row, records) for row in group.rows]}
            for group in chosen}


def filled(group: Group, known: Json) -> Json:
    """Return what is known of a group with the rows that it has now; new ones were not run."""
    before = {row['shows']: {name: row[name] for name in _MEASURED if name in row}
              for row in known.get('rows', [])}
    return known | {'title': group.title, 'rows': [
        _judged(row, {}) | before.get(row.shows, {}) for row in group.rows]}


def _records(wanted: list[str], jobs: int) -> dict[str, Json]:
    """Return the records (name of a test -> record) of all tests that are wanted."""
    files = sorted({test.split('::')[0] for test in wanted})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'records').mkdir()
        environment = os.environ | {
            'DLO_VALIDATION_TESTS': json.dumps(wanted), 'OPENBLAS_NUM_THREADS': '1',
            'DLO_VALIDATION_RECORDS': str(folder / 'records'),
            # assertions are compiled otherwise for the hook: not into the caches of other runs
            'PYTHONPYCACHEPREFIX': str(folder / 'compiled')}
        done = subprocess.run(
            [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-p',
             'benchmarks.validation.recorder', '-o', 'enable_assertion_pass_hook=true', '-o',
             'verbosity_assertions=2', *(['-n', str(jobs)] if jobs > 1 else []), *files],
            cwd=ROOT, env=environment, check=False)
        if done.returncode not in (0, 1, _NOTHING_RAN):
            raise RuntimeError(f'pytest ended with status {done.returncode}')
        records: dict[str, Json] = {}
        for path in (folder / 'records').glob('*.json'):
            for test, record in json.loads(path.read_text()).items():
                if record['seconds'] and record['checks'] >= records.get(test, {}).get(
                        'checks', -1):
                    records[test] = record
    return records


def _judged(row: Row, records: dict[str, Json]) -> Json:
    """Return a row with what its tests have measured, as JSON can hold it."""
    own = [record for test, record in records.items() if test.startswith(row.tests)]
    outcomes = [record['outcome'] for record in own]
    nearest = max((one for record in own for one in record['nearest']), default=None)
    return {'shows': row.shows, 'against': row.against, 'claim': row.claim,
            'tests': list(row.tests), 'passed': outcomes.count('passed'),
            'failed': outcomes.count('failed'), 'skipped': outcomes.count('skipped'),
            'checks': sum(record['checks'] for record in own),
            'seconds': round(sum(record['seconds'] for record in own), 1),
            'nearest': nearest and dict(zip(('used', 'what', 'measured', 'limit'), nearest,
                                            strict=True))}


def lines(group: Json) -> list[list[str]]:
    """Return the cells of a group's table."""
    return [[row['shows'], row['against'], row['claim'], _tests(row), _nearest(row['nearest']),
             met(row)] for row in group['rows']]


def met(row: Json) -> str:
    """Return whether all tests of a row that were run have passed."""
    if row['failed']:
        return f'**no**: {row["failed"]} fail'
    return 'yes' if row['passed'] else '*not run*'


def _tests(row: Json) -> str:
    names = dict.fromkeys(test.split('::')[0].removeprefix('test/') for test in row['tests'])
    return f'{row["passed"]} of {", ".join(f"`{name}`" for name in names)}'


def _nearest(nearest: Json | None) -> str:
    return f'{nearest["measured"]:.2g} of {nearest["limit"]:.2g}' if nearest else ''
