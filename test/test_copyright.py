# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Every source file says whose it is and under which license."""

import runpy
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TOOL = runpy.run_path(str(ROOT / '.ci' / 'copyright.py'))
HEADER, has_header, with_header = TOOL['HEADER'], TOOL['has_header'], TOOL['with_header']


def test_every_source_file_has_its_header():
    try:
        paths = TOOL['sources']()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('not a clone: what belongs to the sources is not known')
    assert len(paths) > 300
    assert [str(path.relative_to(ROOT)) for path in paths if not has_header(path.read_text())] == []


def test_the_license_is_the_one_of_the_package():
    assert 'Apache License' in (ROOT / 'LICENSE').read_text()
    assert HEADER.splitlines()[1].endswith('Apache-2.0')
    assert '>Apache-2.0</license>' in (ROOT / 'package.xml').read_text()


@pytest.mark.parametrize(('before', 'after'), [
    ('"""Doc."""\n', HEADER + '"""Doc."""\n'),
    ('#!/usr/bin/env python3\n"""Doc."""\n', '#!/usr/bin/env python3\n' + HEADER + '"""Doc."""\n'),
    ('# Copyright 2026 somebody\nx = 1\n', HEADER + '# Copyright 2026 somebody\nx = 1\n'),
])
def test_headers_are_added_once_below_the_interpreter(before, after):
    assert not has_header(before)
    assert with_header(before) == after
    assert with_header(after) == after
