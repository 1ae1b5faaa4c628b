# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share. The environment is set before any ROS message is imported."""

import os
import sys
import tempfile
from pathlib import Path

# Messages check the type of every field: a wrong one arrives as garbage without a word.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ.setdefault('ROS_LOG_DIR', tempfile.mkdtemp(prefix='dlo_planner_log_'))
sys.path.insert(0, str(Path(__file__).parent))

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from rerunning import pytest_runtest_setup  # noqa: E402, F401, pytest looks for it here
from wires import copper_wire  # noqa: E402

from dlo_planner import Pose, Rod  # noqa: E402

# They time threads, processes and pages, without the fixture `domain`.
_TIMED = ('test/ros/test_main.py', 'test/ros/test_worker.py', 'test/ros/test_worker_end.py',
          'test/cell/test_node.py', 'test/view/test_plan_page.py')


def pytest_collection_modifyitems(items):
    """Mark the tests of real time: beside others, which compute without a break, they are late.

    Those are all that have a ROS domain to talk in. Two files of them at a time are not late: each
    worker has a domain of its own.
    """
    for item in items:
        if 'domain' in item.fixturenames or item.nodeid.startswith(_TIMED):
            item.add_marker(pytest.mark.real_time)


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
