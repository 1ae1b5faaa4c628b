# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share. The environment is set before any ROS message is imported."""

import gc
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

# Messages check the type of every field: a wrong one arrives as garbage without a word.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ.setdefault('ROS_LOG_DIR', tempfile.mkdtemp(prefix='dlo_planner_log_'))
sys.path.insert(0, str(Path(__file__).parent))

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from wires import copper_wire  # noqa: E402

from dlo_planner import Pose, Rod  # noqa: E402

# They time threads, processes and pages, without the fixture `domain`.
_TIMED = ('test/ros/test_main.py', 'test/view/test_plan_page.py')
# Planners that are started once for many files (test/ros/conftest.py), which takes seconds.
_SHARED = ('_running', '_served')


def pytest_collection():
    """Look for no garbage while thousands of tests are made: none of them is any."""
    gc.disable()


def pytest_collection_finish():
    """Look for garbage again, but not among the tests and what they have imported."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(config, items):
    """Mark what needs real time, and the cases that `make test` leaves to `make test-all`.

    Where workers share tests by groups, a group is a file, or all files that one planner serves.
    """
    grouped = getattr(config.option, 'loadgroup', False)  # as a worker knows it
    cases = Counter()
    for item in items:
        if 'domain' in item.fixturenames or item.nodeid.startswith(_TIMED):
            item.add_marker(pytest.mark.real_time)
        every = item.get_closest_marker('every')
        if every:
            name = item.nodeid.split('[')[0]
            if cases[name] % every.args[0]:
                item.add_marker(pytest.mark.sweep)
            cases[name] += 1
        if grouped:
            shared = [name for name in _SHARED if name in item.fixturenames]
            item.add_marker(pytest.mark.xdist_group((shared or [item.path.name])[0]))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Begin anew with all fixtures where a test is run again: a process of theirs may have ended.

    pytest-rerunfailures keeps those of the module and the session, and sets aside how they are
    taken down.
    """
    if getattr(item, 'execution_count', 1) > 1:
        from pytest_rerunfailures import (  # noqa: PLC0415, it is here, as it runs this again
            suspended_finalizers,
        )
        item.session._setupstate.stack.update(suspended_finalizers)
        suspended_finalizers.clear()
        item.session._setupstate.teardown_exact(None)


@pytest.fixture
def rng():
    return np.random.default_rng(20261121)


@pytest.fixture
def level():
    """Return the paper's gripper: level, along x, 1 m above the floor."""
    return Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))


@pytest.fixture
def wire():
    return copper_wire()


@pytest.fixture
def wire_with_load():
    """Return benchmark B's wire: 1 kg at the free end."""
    return copper_wire(tip_mass=1.0)


@pytest.fixture
def curly():
    """Return a rod with everything: unequal stiffness, natural curvature and twist, masses."""
    return Rod(1.3, 0.2, (0.3, 0.8), 0.4, natural_curvature=(1.0, -0.5), natural_twist=2.0,
               tip_mass=0.1, point_masses=((0.65, 0.2),))
