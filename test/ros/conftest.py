# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A ROS domain for this run, a planner in it, and its client; a planner in this process."""

import os

import pytest
from node_inside import HERE, OVERRIDES, Alive, begin_anew, clear, served_node, state
from planner_process import ROOM, ROOT, connected_client, drain, options, running_planner

from dlo_planner.settings.parameters import PARAMETERS


@pytest.fixture(scope='session')
def coordinator():
    """Return what reserves ROS domains on this machine."""
    return pytest.importorskip('domain_coordinator', reason='domain_coordinator is not installed')


@pytest.fixture(scope='session')
def domain(coordinator):
    """Reserve a ROS domain that no other test run on this machine uses."""
    with coordinator.domain_id() as number:
        os.environ['ROS_DOMAIN_ID'] = str(number)
        yield number


@pytest.fixture(scope='session')
def planner(domain, tmp_path_factory):
    """Yield a planner with the copper wire of the paper, reports ten times a second."""
    with running_planner(tmp_path_factory.mktemp('planner'), '--params-file',
                         str(ROOT / 'config' / 'copper_wire.yaml'),
                         '-p', 'diagnostics_period:=0.1', '-p', 'rod.diameter:=0.0015',
                         '-p', 'threading.waypoints:=25', *options(ROOM)) as running:
        yield running


@pytest.fixture(scope='module')
def client(planner):
    """Yield a client of `planner`."""
    with connected_client(planner) as connected:
        yield connected


@pytest.fixture(scope='session')
def _served(coordinator, domain):
    """Yield a PlannerNode in this process, the values of its parameters, and a domain of its own.

    Other planners of the same name, each for a while, are in the domain of the tests.
    """
    with coordinator.domain_id() as number:
        os.environ['ROS_DOMAIN_ID'] = str(number)
        with served_node() as served:
            os.environ['ROS_DOMAIN_ID'] = str(domain)
            yield served, {name: served.get_parameter(name).value for name in PARAMETERS}, number


@pytest.fixture(scope='module')
def node(request, domain, _served):
    """Yield the PlannerNode in this process, begun anew with what the module says of parameters."""
    served, values, number = _served
    os.environ['ROS_DOMAIN_ID'] = str(number)
    begin_anew(served, values | getattr(request.module, 'OVERRIDES', OVERRIDES))
    yield served
    os.environ['ROS_DOMAIN_ID'] = str(domain)


@pytest.fixture(scope='module')
def _connected(node):
    with connected_client(Alive()) as connected:
        yield connected


@pytest.fixture
def inside(_connected, node):
    """Yield a client of `node`; what was asked for before is answered and forgotten."""
    if state(node).bodies:
        clear(_connected, node)
    drain(_connected.statuses)
    _connected.predict_shape(HERE)  # its outcome is the last one on its way
    _connected.status_of('predict_shape')
    for messages in (_connected.statuses, _connected.executions, _connected.commands,
                     _connected.diagnostics):
        drain(messages)
    return _connected
