# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The tutorial of the node runs, with a node of its own."""

import runpy

import pytest
from planner_process import ROOT

PATH = ROOT / 'examples' / 'tutorials' / 'cell_in_ros.py'


@pytest.mark.sweep
@pytest.mark.usefixtures('domain')
def test_the_tutorial_of_the_node_runs():
    shape, positions, proof = runpy.run_path(str(PATH))['main']()
    assert len(shape) > 40
    assert len(positions) > 5
    assert proof['report'] == 'held'
