# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Annotations: mypy finds mistakes of users; what it finds right (`make types`) runs as well."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MISTAKE = re.compile(r'# E: ([\w-]+)')
FOUND = re.compile(r'mistakes\.py:(\d+): error: .*\[([\w-]+)\]$')


def mypy(*targets):
    """Return the exit code of mypy and the lines that it prints."""
    pytest.importorskip('mypy')
    done = subprocess.run([sys.executable, '-m', 'mypy', *map(str, targets)],
                          capture_output=True, text=True, cwd=ROOT, check=False)
    return done.returncode, (done.stdout + done.stderr).splitlines()


@pytest.mark.sweep
def test_mistakes_are_found_each_in_its_line():
    code, lines = mypy(HERE / 'mistakes.py')
    stated = {(number, kind) for number, line in enumerate(
        (HERE / 'mistakes.py').read_text().splitlines(), start=1) for kind in MISTAKE.findall(line)}
    found = {(int(match[1]), match[2]) for match in map(FOUND.search, lines) if match}
    assert code == 1 and found == stated


def test_what_a_user_writes_runs(capsys):
    runpy.run_path(str(HERE / 'user.py'), run_name='__main__')
    printed = capsys.readouterr().out
    assert printed and 'nan' not in printed.splitlines()[0]
