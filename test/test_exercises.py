# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is compiled ahead: all kernels."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
USED = """
import json
from dlo_planner import exercises
from dlo_planner.kernels import cache
from dlo_planner.kernels.fingerprint import dependencies
for exercise in exercises.ALL:
    exercise()
kernels = {f: k for f, k in cache.KERNELS.items() if f.__module__.startswith('dlo_planner.')}
kinds = {f.__qualname__: len(k.signatures) for f, k in kernels.items()
         if f.__module__ == 'dlo_planner.minimize.lanczos'}
reached = {f for k in kernels.values() if k.signatures for f in dependencies(k)}
print(json.dumps([len(kernels), [f'{f.__module__}.{f.__qualname__}' for f in kernels
                                 if f not in reached], kinds]))
"""


@pytest.mark.sweep
def test_the_exercises_use_every_kernel():
    done = subprocess.run([sys.executable, '-c', USED], cwd=ROOT, text=True, capture_output=True,
                          check=True, env={**os.environ, 'NUMBA_DISABLE_JIT': '0'})
    number, left_out, kinds = json.loads(done.stdout.splitlines()[-1])
    tests_alone = {'dlo_planner.minimize.hessian.multiply'}
    assert number > 100 and set(left_out) <= tests_alone
    assert kinds['lowest_mode'] == 3  # as CONTRIBUTING.md says
