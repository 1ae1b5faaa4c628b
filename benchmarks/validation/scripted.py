# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows that scripts print: the scripts are run, and numbers are read from what they print."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.validation.entry import Validation

Json = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]
HEADS = ['what', 'against', 'measured (limit)', 'met', 'script, its sample']


def run(chosen: list[Validation], jobs: int, output: Path) -> dict[str, Json]:
    """Run the scripts, so many at once; return what was measured by their names."""
    with ThreadPoolExecutor(jobs) as pool:
        found = pool.map(lambda entry: _run(entry, output), chosen)
        return {entry.name: result for entry, result in zip(chosen, found, strict=True)}


def command(entry: Validation, arguments: tuple[str, ...]) -> str:
    """Return what runs a Validation by hand."""
    return ' '.join(['python', entry.script, *(f"'{one}'" if ' ' in one else one
                                              for one in arguments)])


def _run(entry: Validation, output: Path) -> Json:
    """Run a script; return what was measured as JSON can hold it."""
    about: Json = {'shows': entry.shows, 'against': entry.against,
             'script': command(entry, entry.arguments),
             'whole': command(entry, entry.whole) if entry.whole else ''}
    if entry.extra and not find_spec(entry.extra):
        return about | {'measures': [], 'why': f'{entry.extra} is not installed', 'seconds': 0.0}
    if entry.data and not Path(os.environ.get(entry.data, '')).is_dir():
        return about | {'measures': [], 'why': f'{entry.data} names no folder with the data',
                        'seconds': 0.0}
    begun = perf_counter()
    done = subprocess.run(
        [sys.executable, *entry.script.split(),
         *(one.format(output=output) for one in entry.arguments)], cwd=ROOT, check=False,
        env=os.environ | {'OPENBLAS_NUM_THREADS': '1', 'PYTHONPATH': str(ROOT)},
        capture_output=True, text=True)
    print(f'--- {about["script"]}\n{done.stdout}{done.stderr}', flush=True)
    seconds = round(perf_counter() - begun, 1)
    if done.returncode:
        why = f'status {done.returncode}: {(done.stderr.splitlines() or [""])[-1]}'
        return about | {'measures': [], 'why': why, 'seconds': seconds}
    return about | {'measures': [one.judged(done.stdout) for one in entry.measures], 'why': '',
                    'seconds': seconds}


def lines(found: dict[str, Json]) -> list[list[str]]:
    """Return the cells of the table."""
    return [[f'{name}: {row["shows"]}', row['against'], _measured(row), met(row), _script(row)]
            for name, row in found.items()]


def met(row: Json) -> str:
    """Return whether all that a script printed keeps its limits."""
    if row['why']:
        return f'*not run*: {row["why"]}'
    return 'yes' if all(one['met'] for one in row['measures']) else '**no**'


def _measured(row: Json) -> str:
    return '; '.join(
        f'{one["what"]} {one["measured"]:.3g} ({"at least " if one["least"] else ""}'
        f'{one["limit"]:g}{" " if one["unit"] else ""}{one["unit"]})' for one in row['measures'])


def _script(row: Json) -> str:
    whole = f'; the whole: `{row["whole"]}`' if row['whole'] else ''
    return f'`{row["script"]}`{whole}'
