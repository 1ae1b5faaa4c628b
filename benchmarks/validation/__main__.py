# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure again what the docs say; write the pages of validations, their JSON, numbers of the docs.

python -m benchmarks.validation [--jobs 2] [--output FOLDER] [words in the names of some ...]
"""

import argparse
import resource
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

from benchmarks import report
from benchmarks.validation import asserted, page, pages, scripted
from benchmarks.validation.asserted import Json
from benchmarks.validation.scripts import ENTRIES

ROOT = Path(__file__).resolve().parents[2]
_DOCS = ROOT / 'docs' / 'validation'


def main(arguments: list[str] | None = None) -> int:
    """Run what was asked for; return 1 if something does not keep its limit."""
    parser = argparse.ArgumentParser(prog='benchmarks.validation',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('words', nargs='*', help='only what has one of these in its name')
    parser.add_argument('--jobs', type=int, default=2, help='processes at once')
    parser.add_argument('--output', type=Path, default=_DOCS)
    parser.add_argument('--list', action='store_true', help='only list the names')
    given = parser.parse_args(arguments)
    scripts = [one for one in ENTRIES if _wanted(one.name, given.words)]
    groups = [one for one in asserted.groups() if _wanted(f'tests: {one.title}', given.words)]
    if given.list:
        print('\n'.join([one.name for one in scripts] + [f'tests: {one.title}' for one in groups]))
        return 0
    begun = perf_counter()
    output = given.output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    now = {'date': f'{datetime.now(UTC):%Y-%m-%d}', 'commit': _commit()} | report.machine()
    found: Json = {'scripts': scripted.run(scripts, given.jobs, output),
             'asserted': asserted.run(groups, given.jobs) if groups else {}}
    for part in found.values():
        for one in part.values():
            one['measured'] = now
    seconds, used = perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    known = merged(page.load(output), found)
    page.write(output, known)
    if output == _DOCS:
        for name in pages.SAID:
            (pages.DOCS / name).write_text(pages.updated(name))
    bad = page.broken(known)
    print('\n'.join(bad) or 'all limits are kept')
    print(f'{seconds:.0f} s, {used.ru_utime + used.ru_stime:.0f} s of CPU; written to {output}')
    return 1 if bad else 0


def merged(known: Json, found: Json) -> Json:
    """Return what was measured before with what was measured now, as far as it still exists."""
    scripts = known.get('scripts', {}) | found['scripts']
    groups = known.get('asserted', {}) | found['asserted']
    return {'scripts': {one.name: scripts[one.name] for one in ENTRIES
                        if one.name in scripts},
            'asserted': {one.name: asserted.filled(one, groups.get(one.name, {}))
                         for one in asserted.groups()}}


def _wanted(name: str, words: list[str]) -> bool:
    return not words or any(word in name for word in words)


def _commit() -> str:
    """Return the commit that is checked out, with + if something is changed."""
    def git(*rest: str) -> str:
        return subprocess.run(['git', *rest], cwd=ROOT, capture_output=True, text=True,
                              check=False).stdout.strip()
    name = git('rev-parse', '--short', 'HEAD')
    return name + '+' * bool(name and git('status', '--porcelain', '--', '*.py'))


if __name__ == '__main__':
    sys.exit(main())
