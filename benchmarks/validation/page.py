# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The pages: their words are in the folder `words`, their tables those of the JSON."""

import json
from collections.abc import Iterable
from pathlib import Path

from benchmarks import report
from benchmarks.page import text
from benchmarks.validation import asserted, scripted
from benchmarks.validation.asserted import Json

WORDS = Path(__file__).parent / 'words'
_NAME = 'validation.json'


def load(folder: Path) -> Json:
    """Return what is kept in a folder, an empty dict if nothing is."""
    path = report.data_of(folder) / _NAME
    found: Json = json.loads(path.read_text()) if path.exists() else {}
    return found


def write(folder: Path, found: Json) -> None:
    """Write the JSON and the tables of a folder, the first page beside it, the others into it."""
    kept = report.data_of(folder)
    (kept / _NAME).write_text(json.dumps(found, indent=1, allow_nan=False) + '\n')
    for name, table in tables(found).items():
        (kept / f'{name}.md').write_text(f'# {name.capitalize()}\n\n{table}')
    for path, words in pages_of(folder).items():
        path.write_text(words)


def pages_of(folder: Path) -> dict[Path, str]:
    """Return the pages that belong to a folder by their files: the first is beside it."""
    found = {}
    for words in sorted(WORDS.glob('*.md')):
        first = words.stem == 'validation'
        path = folder.with_suffix('.md') if first else folder / words.name
        found[path] = text(words.read_text(), folder, inside=not first)
    return found


def tables(found: Json) -> dict[str, str]:
    """Return the tables in Markdown by their names."""
    parts = {}
    for name, group in found.get('asserted', {}).items():
        table = report.markdown(asserted.HEADS, asserted.lines(group))
        parts[f'asserted_{name}'] = f'## {group["title"]}\n\n{table}\n{_when([group])}'
    scripts = found.get('scripts', {})
    return {'scripts': report.markdown(scripted.HEADS, scripted.lines(scripts))
            + '\n' + _when(scripts.values()), 'summary': _summary(found)} | parts


def broken(found: Json) -> list[str]:
    """Return what does not keep its limit, or has failed."""
    lines = [f'{name}: {scripted.met(row)}' for name, row in found.get('scripts', {}).items()
             if '**' in scripted.met(row) or row['why'].startswith('status')]
    return lines + [f'{row["shows"]}: {asserted.met(row)}'
                    for group in found.get('asserted', {}).values() for row in group['rows']
                    if '**' in asserted.met(row)]


def counts(found: Json) -> dict[str, int]:
    """Return how many rows, tests and comparisons there are, and how many rows keep their limit."""
    rows = [row for group in found['asserted'].values() for row in group['rows']]
    scripts = list(found['scripts'].values())
    good = [asserted.met(row) for row in rows] + [scripted.met(row) for row in scripts]
    return {'rows': len(good), 'met': good.count('yes'),
            'run': sum('not run' not in one for one in good),
            'tests': sum(row['passed'] for row in rows),
            'checks': sum(row['checks'] for row in rows), 'scripts': len(scripts)}


def _summary(found: Json) -> str:
    n = counts(found)
    left = n['rows'] - n['run']
    return (f'{n["met"]} of the {n["run"]} rows that were run keep their limits'
            f'{f"; {left} were not run yet" if left else ""}. {n["scripts"]} rows are printed by '
            f'scripts, the others asserted by {n["tests"]} tests (a test may stand in several '
            f'rows) with {n["checks"]} comparisons.\n')


def _when(rows: Iterable[Json]) -> str:
    when = sorted({f'{row["measured"]["date"]}, commit {row["measured"]["commit"]}'
                   for row in rows if 'measured' in row})
    return f'*Measured {"; ".join(when)}.*\n' if when else ''
