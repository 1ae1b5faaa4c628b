"""What the node counts, without a node."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose
from dlo_planner.ros.health import Health
from msg_helpers.diagnostics import ERROR, OK, WARN


@pytest.fixture
def shape(wire):
    return DirectSimulator(wire, n_elements=8).solve(Pose.identity())


def test_only_shapes_that_jumped_count_as_jumps(shape):
    health = Health()
    for jumped in (False, True, False, False, True):
        health.shape_done(replace(shape, jumped=jumped), 1e-3)
    level, _, values = health.report()
    assert level == OK
    assert values['shapes published'] == 5 and values['jumps'] == 2


def test_latencies_are_in_milliseconds(shape):
    health = Health()
    for seconds in (1e-3, 2e-3, 9e-3):
        health.shape_done(shape, seconds)
    values = health.report()[2]
    assert values['latency median [ms]'] == pytest.approx(2.0)
    assert values['latency largest [ms]'] == pytest.approx(9.0)


@pytest.mark.parametrize('residual', [1e-7, np.nan])
def test_a_residual_that_is_not_small_is_an_error(shape, residual):
    health = Health()
    health.shape_done(replace(shape, residual=residual), 1e-3)
    level, message, _ = health.report()
    assert level == ERROR and 'did not converge' in message


def test_a_refusal_is_the_headline():
    health = Health()
    health.count('poses refused')
    health.failed('pose refused: too far')
    level, message, values = health.report()
    assert level == WARN and message == 'pose refused: too far'
    assert values['poses refused'] == 1 and values['last error'] == 'pose refused: too far'
