# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cluster: Dask's scheduler and two workers on loopback, of which one is killed."""

import logging
import os
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from wires import copper_wire

from dlo_planner import DirectSimulator, Pose, parallel, solve_many

distributed = pytest.importorskip('distributed')
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def client():
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])])
    before = os.environ.get('PYTHONPATH')
    os.environ['PYTHONPATH'] = path  # workers import the package
    with (distributed.LocalCluster(2, threads_per_worker=1, host='127.0.0.1',
                                   dashboard_address=None,
                                   silence_logs=logging.CRITICAL) as cluster,
          distributed.Client(cluster) as connected):
        yield connected
    if before is None:
        del os.environ['PYTHONPATH']
    else:
        os.environ['PYTHONPATH'] = before


def poses(count):
    rng = np.random.default_rng(3)
    return [Pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(count)]


@pytest.mark.sweep
def test_a_cluster_of_which_a_worker_is_killed(client):
    simulator, work, reported = DirectSimulator(copper_wire(), n_elements=16), poses(120), []
    workers = list(client.run(os.getpid).values())
    assert len(set(workers)) == 2

    def killing(done, total):
        reported.append(done)
        if len(reported) == 3:
            os.kill(workers[0], signal.SIGKILL)

    with client.get_executor() as executor:
        found = parallel.map(simulator, work, executor, chunk=4, progress=killing)
    assert found == solve_many(simulator, work)
    assert len(reported) == 30 and reported[-1] == 120
    with client.get_executor() as executor:
        assert parallel.map(simulator, [work[:5]], executor) == parallel.map(simulator, [work[:5]])
        assert parallel.map(simulator, work, partial(client.get_executor)) == found
