# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The short form of the soak: odd messages of every kind, also while it executes; faults."""

import numpy as np
import pytest
from lifecycle_msgs.srv import ChangeState, GetState
from planner_here import context_of_its_own, opened, planner_here
from planner_process import until
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from soak.doors import SERVICES, TOPICS
from soak.faults import obstacle_publisher_vanished
from soak.fuzzing import FIRST, GROWS, Result, Soak
from soak.stage import stage
from soak.watching import OUTPUTS


@pytest.fixture(scope='module')
def made(domain, tmp_path_factory):
    with stage(tmp_path_factory.mktemp('soak')) as it:
        yield it


@pytest.fixture
def soak(made):
    throwing = Soak(made, np.random.default_rng(20261122))
    yield throwing
    throwing.close()


@pytest.mark.every(2)
@pytest.mark.parametrize('number', [300, 600])
def test_odd_messages_change_nothing(soak, number):
    soak.round(number)
    assert soak.result.problems == []
    assert all(soak._fuzzer.sent[name] for name in (*TOPICS, *SERVICES))


@pytest.mark.sweep
def test_odd_messages_do_not_matter_to_an_execution(soak):
    soak.execution(30)
    assert soak.result.problems == []
    assert soak.result.executions == 1


def test_an_obstacle_outlives_its_publisher(made):
    assert obstacle_publisher_vanished(made) == []


def test_a_type_of_parameter_or_a_transition_that_does_not_exist_is_refused(made):
    ask = made.client._call
    bad = Parameter(name='rod.length', value=ParameterValue(type=77))
    good = Parameter(name='rod.length', value=ParameterValue(type=3, double_value=1.0))
    results = ask(SetParameters, 'set_parameters',
                  SetParameters.Request(parameters=[good, bad, good]))[0].results
    assert [one.successful for one in results] == [True, False, False]
    assert '77' in results[1].reason
    result = ask(SetParametersAtomically, 'set_parameters_atomically',
                 SetParametersAtomically.Request(parameters=[bad]))[0].result
    assert not result.successful and '77' in result.reason
    request = ChangeState.Request()
    request.transition.id = 77
    assert not ask(ChangeState, 'change_state', request)[0].success
    assert ask(GetState, 'get_state', GetState.Request())[0].current_state.label == 'active'


def test_messages_are_thrown_at_all_that_the_node_opens(domain, monkeypatch):
    with context_of_its_own() as context, planner_here(monkeypatch, context) as node:
        name = node.get_fully_qualified_name()

        def full(names):
            return {one.replace('~', name) if '~' in one else f'/{one.lstrip("/")}'
                    for one in names}

        assert until(lambda: full(TOPICS) == opened(node, 'subscriber'))
        assert until(lambda: full(SERVICES) == opened(node, 'service'))
        # the log of a second node of this name in a process goes out by the first one's publisher
        assert until(lambda: full(OUTPUTS) | {
            '/parameter_events', f'{name}/transition_event'} == (
                opened(node, 'publisher') - {'/rosout'}))


def test_memory_counts_from_when_all_has_been_used_once():
    def grown(after, last=0.0):
        rows = [(10.0 * k, 420.0 + 30.0 * min(k / 6, 1.0) + after * max(k - 6, 0) / 18,
                 100.0, 20, 30) for k in range(25)]
        rows[-1] = (240.0, rows[-1][1] + last, 100.0, 20, 30)
        return Result(memory=rows).growth()

    assert grown(0.0) == grown(0.0, last=50.0) == 0.0
    assert 0.0 < grown(5.0) < GROWS < grown(20.0)
    assert np.isnan(Result(memory=[(FIRST, 420.0, 0.0, 1, 1)]).growth())
