# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the node counts, without a node."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose
from dlo_planner.results import ValidationReport
from dlo_planner.ros.state import Proof
from dlo_planner.ros.status import Statistics, proof_figures
from msg_helpers.diagnostics import ERROR, OK, WARN


@pytest.fixture
def shape(wire):
    return DirectSimulator(wire, n_elements=8).solve(Pose.identity())


def test_only_shapes_that_jumped_count_as_jumps(shape):
    health = Statistics()
    for jumped in (False, True, False, False, True):
        health.shape_done(replace(shape, jumped=jumped), 1e-3)
    level, _, values = health.report()
    assert level == OK
    assert values['shapes published'] == 5 and values['jumps'] == 2


def test_latencies_are_in_milliseconds(shape):
    health = Statistics()
    for seconds in (1e-3, 2e-3, 9e-3):
        health.shape_done(shape, seconds)
    values = health.report()[2]
    assert values['latency median [ms]'] == pytest.approx(2.0)
    assert values['latency largest [ms]'] == pytest.approx(9.0)


@pytest.mark.parametrize('residual', [1e-7, np.nan])
def test_a_residual_that_is_not_small_is_an_error(shape, residual):
    health = Statistics()
    health.shape_done(replace(shape, residual=residual), 1e-3)
    level, message, _ = health.report()
    assert level == ERROR and 'did not converge' in message


def test_a_proof_is_told_with_its_state_its_reason_and_its_figures(shape):
    plan = object()
    health, said = Statistics(), []
    figures = {name: 1.0 for name in ValidationReport.__annotations__} | {
        'converged': True, 'trajectory': None, 'reason': '', 'not_looked_at': ('swing',)}
    report = ValidationReport(**figures | {'swing': np.nan, 'departure': 2e-4})
    for proof in (Proof(plan), Proof(plan, report, 'it is asked too early'),
                  Proof(plan, report, 'it misses', True), Proof(plan, report, '', True)):
        health.note(proof_figures(proof))
        values = health.report()[2]
        said.append((values['report'], values['report reason']))
    assert said[0][0] == 'not ready' and 'ask again' in said[0][1]
    assert said[1:] == [('held slowly', 'it is asked too early'), ('refused', 'it misses'),
                        ('held', 'none')]
    assert values['report not looked at'] == 'swing'
    assert np.isnan(values['report largest swing in motion [m]'])
    assert values['report swing at departure [m]'] == 2e-4
    told = [name for name in values if name.startswith('report ')]
    assert len(told) == len(figures) - 3 + 2 - 2  # not `step` and what is no figure


def test_a_refusal_is_the_headline():
    health = Statistics()
    health.count('poses refused')
    health.failed('pose refused: too far')
    level, message, values = health.report()
    assert level == WARN and message == 'pose refused: too far'
    assert values['poses refused'] == 1 and values['last error'] == 'pose refused: too far'
