# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Text files are clean, and what says so finds what is not; hooks run without a network."""

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
yaml = pytest.importorskip('yaml')


def test_the_files_are_clean():
    if not (ROOT / '.git').exists():
        pytest.skip('not a clone: what belongs to the sources is not known')
    done = subprocess.run([sys.executable, str(ROOT / '.ci' / 'files.py')], capture_output=True,
                          text=True, check=False)
    assert (done.returncode, done.stdout) == (0, ''), done.stderr


@pytest.mark.parametrize(('name', 'text', 'fault'), [
    ('a.py', 'x = 1 \n', 'line 1: blanks'), ('a.md', 'text', 'one line feed'),
    ('a.md', 'text\n\n', 'one line feed'), ('a.yaml', 'a: [1\n', 'expected'),
    ('a.toml', 'a = \n', 'Invalid'), ('a.txt', 'x\n' * 600_000, 'larger')])
def test_what_is_not_clean_is_found(tmp_path, name, text, fault):
    spec = spec_from_file_location('files', ROOT / '.ci' / 'files.py')
    files = module_from_spec(spec)
    spec.loader.exec_module(files)
    path = tmp_path / name
    path.write_text(text)
    assert [found for found in files.faults(path) if fault in found]
    path.write_text('')
    assert files.faults(path) == []


def test_hooks_need_no_network_and_name_what_is_there():
    hooks = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text())['repos']
    assert [repo['repo'] for repo in hooks] == ['local']
    entries = [hook['entry'].split() for repo in hooks for hook in repo['hooks']]
    named = {word for entry in entries for word in entry if word.endswith('.py')}
    assert {'.ci/copyright.py', '.ci/files.py'} <= named
    assert not [name for name in named if not (ROOT / name).exists()]
