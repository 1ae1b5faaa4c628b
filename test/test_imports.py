# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A public name is imported without all the others, so that a first shape is there soon."""

import subprocess
import sys

import dlo_planner

_FIRST = """
import sys
from dlo_planner import DirectSimulator, Pose, Rod
DirectSimulator(Rod(1.0, 0.1, 0.05, 0.04), n_elements=8).solve(Pose((0, 0, 1), (0, 0, 0, 1)))
print(*sys.modules)
"""


def _run(code):
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return ran.stdout.split()


def test_a_first_shape_imports_nothing_of_plans_and_little_of_scipy():
    loaded = set(_run(_FIRST))
    assert 'dlo_planner.direct.simulator' in loaded
    for package in ('identify', 'inverse', 'parallel', 'plan', 'public', 'verify'):
        assert f'dlo_planner.{package}' not in loaded
    needed = set(_run('import scipy.linalg, sys; print(*sys.modules)'))  # of SciPy 1.11: sparse
    for package in ('interpolate', 'optimize', 'sparse', 'spatial'):
        assert f'scipy.{package}' not in loaded - needed


def test_it_is_known_where_every_public_name_is():
    assert set(dlo_planner._homes()) == set(dlo_planner.__all__)


def test_subpackages_are_found_after_a_name_is():
    told = _run('import dlo_planner as d; d.Pose; print(d.parallel.__name__); import dlo_planner\n'
                'from dlo_planner import settings; print(hasattr(d, "nobody"), settings.__name__)')
    assert told == ['dlo_planner.parallel', 'False', 'dlo_planner.settings']


def test_where_there_is_no_source_all_are_imported():
    told = _run('import dlo_planner as d; d._homes = dict; print(d.Rod.__name__)\n'
                'import sys; print("dlo_planner.public" in sys.modules)')
    assert told == ['Rod', 'True']
