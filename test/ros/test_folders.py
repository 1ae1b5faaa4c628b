# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the ROS log and temporary files go."""

import os
import tempfile

import pytest

from dlo_planner.ros import main as folders
from dlo_planner.ros.main import find_temporary, log_arguments

NO_FILE = ['--ros-args', '--disable-external-lib-logs']


@pytest.fixture
def nothing_set(monkeypatch):
    for name in ('ROS_LOG_DIR', 'ROS_HOME', 'HOME'):
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


@pytest.mark.parametrize(('name', 'below'), [('ROS_LOG_DIR', ''), ('ROS_HOME', 'log'),
                                             ('HOME', '.ros/log')])
def test_the_usual_folder_stays(nothing_set, tmp_path, name, below):
    nothing_set.setenv(name, str(tmp_path))
    assert log_arguments() == []
    assert (tmp_path / below).is_dir()
    assert 'ROS_LOG_DIR' not in os.environ or os.environ['ROS_LOG_DIR'] == str(tmp_path)


@pytest.mark.parametrize('home', [None, '', '/dev/null'])
def test_without_a_home_it_goes_among_temporary_files(nothing_set, tmp_path, home):
    if home is not None:
        nothing_set.setenv('HOME', home)
    nothing_set.setattr(tempfile, 'tempdir', str(tmp_path))
    assert log_arguments() == []
    assert os.environ['ROS_LOG_DIR'].startswith(str(tmp_path))


def test_where_nothing_can_be_written_it_goes_to_the_console(nothing_set):
    nothing_set.setenv('HOME', '/dev/null')
    nothing_set.setattr(tempfile, 'gettempdir', lambda: '/dev/null')
    assert log_arguments() == NO_FILE


def test_without_any_temporary_folder_it_goes_to_the_console(nothing_set):
    def nowhere():
        raise FileNotFoundError('no usable temporary directory')
    nothing_set.setattr(tempfile, 'gettempdir', nowhere)
    assert log_arguments() == NO_FILE


def test_temporary_files_go_to_memory_where_there_is_no_other_place(nothing_set, tmp_path):
    def nowhere():
        raise FileNotFoundError('no usable temporary directory')
    nothing_set.setattr(folders, '_IN_MEMORY', tmp_path)
    nothing_set.setenv('TMPDIR', 'as it was')
    find_temporary()
    assert os.environ['TMPDIR'] == 'as it was'
    nothing_set.setattr(tempfile, 'tempdir', None)
    nothing_set.setattr(tempfile, 'gettempdir', nowhere)
    find_temporary()
    assert os.environ['TMPDIR'] == tempfile.tempdir == str(tmp_path)
