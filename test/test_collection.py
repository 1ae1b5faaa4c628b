# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tests can be run in any choice and order, and with no more than package.xml declares."""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parent.parent
EXTRAS = ('dask', 'distributed', 'domain_coordinator', 'example_robot_data', 'importlinter',
          'mujoco', 'pinocchio', 'playwright', 'rosbags', 'viser')
WITHOUT_EXTRAS = f"""
import sys
sys.modules.update(dict.fromkeys({EXTRAS!r}))
import pytest
sys.exit(pytest.main(sys.argv[1:]))
"""


def imported(path):
    """Return the names of the packages and modules that a file imports, wherever it does."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {one.name.split('.')[0] for one in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module.split('.')[0])
    return names


def collected(*arguments):
    """Return how pytest, without extras, ends that collects tests, and what it says."""
    done = subprocess.run([sys.executable, '-c', WITHOUT_EXTRAS, '--collect-only', '-q', '-p',
                           'no:cacheprovider', *arguments], cwd=ROOT, text=True,
                          capture_output=True, check=False)
    return done.returncode, done.stdout + done.stderr


def test_files_are_told_by_their_names_alone():
    names = Counter(path.name for path in (ROOT / 'test').rglob('*.py'))
    assert [name for name, number in names.items() if number > 1
            and name not in ('conftest.py', '__init__.py')] == []


def test_what_several_tests_share_is_in_no_conftest():
    assert [path for path in (ROOT / 'test').rglob('*.py') if 'conftest' in imported(path)] == []


@pytest.mark.parametrize('step', [1, -1])
def test_a_folder_with_a_conftest_goes_with_others(step):
    pytest.importorskip('rclpy')
    files = ('test/ros/test_state.py', 'test/parallel/test_mapping.py', 'test/direct/test_held.py')
    status, said = collected(*files[::step])
    assert status == 0, said
    assert all(f'{file}::' in said for file in files)


def test_all_tests_are_collected_without_extras():
    pytest.importorskip('rclpy')
    status, said = collected('test')
    assert status == 0, said[-3000:]
    assert 'test/ros/test_state.py::' in said and 'error' not in said.splitlines()[-1]


def test_ros_packages_are_declared():
    package = ElementTree.parse(ROOT / 'package.xml')
    declared = {one.text for kind in ('exec_depend', 'test_depend') for one in package.iter(kind)}
    files = [path for folder in ('dlo_planner', 'msg_helpers', 'launch', 'test')
             for path in (ROOT / folder).rglob('*.py')]
    names = set().union(*map(imported, files))
    ros = {name for name in names if name.endswith(('_msgs', '_srvs', '_interfaces'))}
    ros |= names & {'rclpy', 'launch', 'launch_ros', 'domain_coordinator', 'ament_index_python'}
    assert {'rclpy', 'nav_msgs', 'launch_ros'} <= ros <= declared, ros - declared
