# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What an installation puts where: one command on the PATH, the rest where ros2 run looks."""

import ast
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[2]
SETUP = """
import setuptools, json
known = {}
setuptools.setup = known.update
exec(compile(open('setup.py').read(), 'setup.py', 'exec'), {'__file__': 'setup.py'})
print(json.dumps({'scripts': known['entry_points'], 'files': known['data_files'],
                  'needs': known['install_requires']}))
"""


def setup():
    """Return what setup.py says."""
    import json  # noqa: PLC0415
    done = subprocess.run([sys.executable, '-c', SETUP], cwd=ROOT, capture_output=True, text=True,
                          check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_one_command_comes_to_the_path():
    known = setup()
    assert known['scripts'].pop('console_scripts') == [
        'dlo-planner = dlo_planner.cli.main:main']
    assert known['scripts'].keys() <= {'cosseratbench.solvers'}  # those are no commands
    assert any(one.startswith('click') for one in known['needs'])


def test_ros_run_finds_every_executable_that_the_launch_files_start():
    files = dict(map(tuple, setup()['files']))
    installed = {Path(one).name: ROOT / one for one in files['lib/dlo_planner']}
    assert installed.keys() == {'planner_node', 'viewer', 'cell'}
    launched = set()
    for path in (ROOT / 'launch').glob('*.launch.py'):
        launched |= set(re.findall(r"package='dlo_planner',\s*executable='(\w+)'",
                                   path.read_text()))
    assert launched and launched <= installed.keys()
    for path in installed.values():
        assert os.access(path, os.X_OK)
        assert path.read_text().startswith('#!/usr/bin/env python3\n')


def test_each_executable_calls_a_main_that_there_is():
    for path in (ROOT / 'scripts').iterdir():
        imported = next(node for node in ast.walk(ast.parse(path.read_text()))
                        if isinstance(node, ast.ImportFrom))
        source = Path(find_spec(imported.module).origin).read_text()
        assert [one.name for one in imported.names] == ['main']
        assert re.search(r'^def main\(', source, re.MULTILINE)
