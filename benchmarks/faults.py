# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether tests notice faults: one line at a time is made wrong in a copy of the tree.

python -m benchmarks.faults [--names WORD ...] [--quick] [--output faults.json]

`faults.toml` lists the faults, each with the test files that ought to notice it, or with tests of a
file that takes long. A fault is noticed if one of them fails or does not end. At the end the tests
that noticed are run without a fault: what fails then has noticed nothing.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from signal import SIGKILL
from time import perf_counter
from typing import NamedTuple

from benchmarks import report

ROOT = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_suffix('.toml')
LONGEST = 300.0  # s, after which the tests of a fault count as hanging
PYTEST = (sys.executable, '-m', 'pytest', '-q', '-m', 'not real_time', '-p', 'no:cacheprovider',
          '-rfE', '--no-header', '--tb=no', '--durations=0', '--durations-min=1e9')
QUICK = ('-m', 'not real_time and not sweep')  # as `make test` does: pytest heeds the last one
_LEFT_OUT = shutil.ignore_patterns('.*', 'build', 'docs', '*_output')
_PASSED, _FAILED = 0, 1  # how pytest ends; else it could not run


class Fault(NamedTuple):
    """A line that is made wrong, and the test files, or tests, that ought to notice.

    `old` stands once in the file.
    """

    name: str
    file: str
    old: str
    new: str
    tests: list[str]

    def applied(self, text: str) -> str:
        """Return the text of its file with the fault.

        Raises:
            ValueError: what it replaces does not stand there once
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(f'{self.name}: expected {self.old!r} once in {self.file}, it is there '
                             f'{text.count(self.old)} times')
        return text.replace(self.old, self.new)


class Outcome(NamedTuple):
    """What tests say of a fault: 'noticed', 'unnoticed', or why it is not known."""

    name: str
    said: str
    by: list[str]
    seconds: float


def listed(path: Path = LIST) -> list[Fault]:
    """Return the faults of the list."""
    return [Fault(**one) for one in tomllib.loads(path.read_text())['fault']]


def copied(folder: Path) -> Path:
    """Return a copy of the tree, with its compiled kernels, in a folder."""
    tree = folder / ROOT.name
    shutil.copytree(ROOT, tree, ignore=_LEFT_OUT, symlinks=True)
    return tree


def tested(tree: Path, tests: Iterable[str], *options: str) -> tuple[int | None, list[str]]:
    """Return how tests end, None if they do not, and which of them failed."""
    environment = {**os.environ, 'PYTHONDONTWRITEBYTECODE': '1', 'OPENBLAS_NUM_THREADS': '1'}
    with tempfile.TemporaryFile('w+') as said:  # a pipe could be kept open by grandchildren
        process = subprocess.Popen([*PYTEST, *options, *tests], cwd=tree, env=environment,
                                   stdout=said, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            status = process.wait(LONGEST)
        except subprocess.TimeoutExpired:
            status = None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, SIGKILL)
            process.wait()
        said.seek(0)
        return status, re.findall(r'^(?:FAILED|ERROR) (\S+?::.*?)(?: - .*)?$', said.read(), re.M)


def tried(tree: Path, fault: Fault, *options: str) -> Outcome:
    """Return whether its tests notice a fault; the file is as it was afterwards."""
    path, began = tree / fault.file, perf_counter()
    text = path.read_text()
    for old in (path.parent / '__pycache__').glob(f'{path.stem}.*.pyc'):
        old.unlink()  # it could be taken for that of a file of the same size and second
    path.write_text(fault.applied(text))
    try:
        status, by = tested(tree, fault.tests, '-x', *options)
    finally:
        path.write_text(text)
    said = {_PASSED: 'unnoticed', _FAILED: 'noticed', None: 'noticed'}.get(
        status, f'pytest ended with {status}')
    return Outcome(fault.name, said, by, round(perf_counter() - began, 1))


def main(arguments: list[str] | None = None) -> int:
    """Try faults; return 1 if one is not noticed."""
    options = _parser().parse_args(arguments)
    faults = [one for one in listed() if not options.names or any(
        word in f'{one.name} {one.file}' for word in options.names)]
    found: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        tree = copied(Path(folder))
        for fault in faults:
            found.append(tried(tree, fault, *(QUICK if options.quick else ())))
            print(f'{len(found)} of {len(faults)} in {found[-1].seconds:.0f} s: '
                  f'{found[-1].said}: {fault.name}', flush=True)
            if options.output:
                options.output.write_text(json.dumps([one._asdict() for one in found], indent=1))
        _, broken = tested(tree, sorted({test for one in found for test in one.by}))
    found = [one._replace(said='its tests fail without it') if set(one.by) & set(broken) else one
             for one in found]
    if options.output:
        options.output.write_text(json.dumps([one._asdict() for one in found], indent=1))
    print(report.markdown(['fault', 'file', 'tests'], [
        [one.name, fault.file, one.said] for one, fault in zip(found, faults, strict=True)]))
    print(f'{sum(one.said == "noticed" for one in found)} of {len(found)} noticed')
    return int(any(one.said != 'noticed' for one in found))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='benchmarks.faults',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('--names', nargs='+', default=[], metavar='WORD',
                        help='only faults with one of these in name or file; default: all')
    parser.add_argument('--quick', action='store_true',
                        help='without sweeps: what `make test` notices')
    parser.add_argument('--output', type=Path, help='JSON, rewritten after each fault')
    return parser


if __name__ == '__main__':
    sys.exit(main())
