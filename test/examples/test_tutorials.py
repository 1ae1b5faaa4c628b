# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The tutorials run: each is a script whose assertions hold."""

import runpy
from pathlib import Path

import pytest

TUTORIALS = sorted((Path(__file__).parents[2] / 'examples' / 'tutorials').glob('[a-z]*.py'))
NEEDS_ROS = {'cell_in_ros'}  # runs among the tests of the node


@pytest.mark.every(5)
@pytest.mark.parametrize('path', [path for path in TUTORIALS if path.stem not in NEEDS_ROS],
                         ids=lambda path: path.stem)
def test_a_tutorial_runs(path, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name='__main__')
    printed = capsys.readouterr().out
    assert printed and 'nan' not in printed
    assert list(tmp_path.iterdir()) == []
