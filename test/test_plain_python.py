# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels as plain Python: without numba, or for a debugger."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dlo_planner.kernels import COMPILED

ROOT = Path(__file__).parent.parent
WITHOUT = 'import sys; sys.modules["numba"] = sys.modules["llvmlite"] = None\n'
OLDER = 'import numba; numba.__version__ = "0.61.2"\n'
JOBS = """
import json, pickle, warnings
import numpy as np
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter('always')
    from dlo_planner import (CutOut, DirectSimulator, FarEnd, InverseSimulator, Plane, Pose, Rod,
                             Sphere)
    from dlo_planner.kernels import COMPILED
    from dlo_planner.minimize.riccati import inverse3
warnings.simplefilter('error', RuntimeWarning)
rod = Rod(1.0, 0.1, (1.0, 2.0), 0.7)
tilted, level = Pose.looking_along((0, 0, 0), (1, 0.2, 0)), Pose.identity()
found = []
for basis in ('local', 'chebyshev'):
    direct = DirectSimulator(rod, basis=basis, n_elements=8, n_terms=3)
    shapes = direct.track([tilted, level])
    shapes.append(pickle.loads(pickle.dumps(shapes[0])))
    shapes.append(direct.solve(level, far_end=(0.8, 0, 0)))
    shapes += direct.simulate([tilted, tilted], 0.01).shapes
    assert all(shape.converged for shape in shapes)
    found += [shape.positions.tolist() for shape in shapes]
    found += [[shapes[0].error_estimate, shapes[0].stability]]
    found += [shapes[0].modes(2).frequencies.tolist()]
direct = DirectSimulator(Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, yield_curvature=0.2, hardening=0.1),
                         n_elements=8, obstacles=[Plane((0, 0, -0.2), (0, 0, 1), 0.2)])
lying = direct.solve(level)
assert lying.contacts and lying.converged
lying = direct.solve(Pose((0, 0.01, 0), level.quaternion), lying)  # the next step writes into
assert lying.contacts and lying.converged  # nothing that this one returned
direct = DirectSimulator(rod, n_elements=8, obstacles=[Sphere((0.5, 0, -0.1), 0.09)])
far = FarEnd(Pose.looking_along((0.8, 0, -0.1), (1, 0, 0)))
for held in (None, far):
    shape = direct.solve(level, far_end=held)
    shape = direct.solve(Pose((0, 0.003, 0), level.quaternion), shape, far_end=held)
    assert shape.converged
    found += [shape.positions.tolist()]
goal = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
plan = InverseSimulator(DirectSimulator(rod, n_elements=8)).thread(goal, depths=[0, 0.5])
found += [lying.positions.tolist(), plan.grippers[-1].position.tolist()]
minus, zero = np.float64(-1.0), np.float64(0.0)  # all three pivots are negative, not one
found += [inverse3((minus, minus, minus, zero, zero, zero))[1]]
assert found[-1] == 3
print(json.dumps([COMPILED, [str(one.message) for one in told], found]))
"""


def run(code, **changes):
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, text=True, capture_output=True,
                          check=False, env={**os.environ, **changes})
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope='module')
def compiled():
    if not COMPILED:
        pytest.skip('kernels are plain Python')
    scope = {}
    exec(JOBS, scope)
    assert not scope['told']
    return scope['found']


@pytest.mark.every(3)
@pytest.mark.parametrize('code, changes, warned', [
    (WITHOUT + JOBS, {}, 1), (OLDER + JOBS, {}, 1), (JOBS, {'NUMBA_DISABLE_JIT': '1'}, 0)],
    ids=['missing', 'too old', 'asked for'])
def test_the_numbers_are_those_of_compiled_kernels(code, changes, warned, compiled):
    known, told, found = run(code, **changes)
    assert not known and len(told) == warned
    assert all('pip install "numba>=' in text for text in told)
    for ours, theirs in zip(found, compiled, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9)


def test_nothing_is_compiled_ahead_without_numba(tmp_path):
    code = WITHOUT + ('from dlo_planner.prebuild import main\n'
                      f'print(main(["--into", {str(tmp_path / "compiled")!r}]))')
    assert run(code) == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.sweep
def test_steps_in_contact_and_between_two_grips_are_made_in_plain_python():
    tests = ['test/direct/test_ownership.py', 'test/minimize/test_contact_laws.py',
             'test/minimize/test_holding.py']
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-m', 'not sweep', '-p', 'no:cacheprovider',
         '-k', 'not thorough_search_finds', *tests],
        cwd=ROOT, text=True, capture_output=True, check=False,
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1'})
    assert done.returncode == 0, done.stdout[-3000:]
