# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A ROS domain for this run, a planner in it, and its client; a planner in this process."""

import contextlib
import os

import pytest
from node_inside import HERE, OVERRIDES, Alive, begin_anew, clear, served_node, state
from planner_here import context_of_its_own
from planner_process import (
    DEEPEST,
    ROOM,
    ROOT,
    connected_client,
    drain,
    options,
    running_planner,
)

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


@pytest.fixture
def context(domain):
    with context_of_its_own() as made:
        yield made


@contextlib.contextmanager
def in_domain(number):
    """Let contexts and processes that begin meanwhile be in a ROS domain."""
    before = os.environ['ROS_DOMAIN_ID']
    os.environ['ROS_DOMAIN_ID'] = str(number)
    try:
        yield
    finally:
        os.environ['ROS_DOMAIN_ID'] = before


@pytest.fixture
def own_domain(domain, coordinator):
    """Let a test be in a domain of its own: of two nodes of one name the graph says either."""
    with coordinator.domain_id() as number, in_domain(number):
        yield number


# One planner as a process and one in this process serve all modules, each in a domain of its own:
# others of the same name, each for a while, are in that of the tests.


@pytest.fixture(scope='session')
def _running(coordinator, domain, tmp_path_factory):
    with coordinator.domain_id() as number, contextlib.ExitStack() as stack:
        with in_domain(number):
            made = stack.enter_context(running_planner(
                tmp_path_factory.mktemp('planner'), '--params-file',
                str(ROOT / 'config' / 'copper_wire.yaml'), '-p', 'diagnostics_period:=0.1',
                '-p', 'rod.diameter:=0.0015', '-p', 'threading.waypoints:=25',
                '-p', f'threading.deepest:={DEEPEST}', *options(ROOM)))
        yield made, number


@pytest.fixture(scope='session')
def _served(coordinator, domain):
    with coordinator.domain_id() as number, contextlib.ExitStack() as stack:
        with in_domain(number):
            made = stack.enter_context(served_node())
        yield made, number, {name: made.get_parameter(name).value for name in PARAMETERS}


@pytest.fixture(scope='module')
def planner(_running):
    """Yield a planner with the copper wire of the paper, reports ten times a second."""
    made, number = _running
    with in_domain(number):
        yield made


@pytest.fixture(scope='module')
def client(planner):
    with connected_client(planner) as connected:
        yield connected


@pytest.fixture(scope='module')
def node(request, _served):
    """Yield the PlannerNode in this process, begun anew with what the module says of parameters."""
    made, number, values = _served
    begin_anew(made, values | getattr(request.module, 'OVERRIDES', OVERRIDES))
    with in_domain(number):
        yield made


@pytest.fixture(scope='module')
def _connected(node):
    with connected_client(Alive()) as connected:
        yield connected


@pytest.fixture
def inside(_connected, node):
    """Yield a client of `node`; what was asked for before is answered and forgotten."""
    if state(node).scene.bodies:
        clear(_connected, node)
    drain(_connected.statuses)
    _connected.predict_shape(HERE)  # its outcome is the last one on its way
    _connected.status_of('predict_shape')
    for messages in (_connected.statuses, _connected.executions, _connected.commands,
                     _connected.diagnostics):
        drain(messages)
    return _connected
