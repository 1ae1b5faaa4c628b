# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The solver for cosseratbench, where that is installed."""

import numpy as np
import pytest

pytest.importorskip('cosseratbench')
from cosseratbench import registry  # noqa: E402  only if it is there
from cosseratbench.experiment import run  # noqa: E402
from cosseratbench.solver import Solver  # noqa: E402

from benchmarks import suite  # noqa: E402
from benchmarks.cosserat.solver import DloPlanner  # noqa: E402

pytestmark = pytest.mark.sweep  # the package has tests of its own


def test_it_is_a_solver_that_scores():
    assert isinstance(DloPlanner(), Solver)
    result = run(registry.load_experiment('cantilever'), DloPlanner())
    assert result.outcome == 'completed'
    assert result.metrics['tip_deflection_error'] < 2e-3
    assert np.isfinite(result.trajectory.directors[0]).all()


@pytest.mark.parametrize('name', ['twist', 'capstan', 'pile'])
def test_what_it_does_not_know_is_not_run(name):
    result = run(registry.load_experiment(name), DloPlanner())
    assert result.outcome == 'unsupported'
    assert result.missing


def test_a_swing_is_right_to_what_its_linear_reference_leaves_open():
    result = run(registry.load_experiment('pendulum'), DloPlanner())
    assert result.metrics['period_error'] < 3e-5  # 2e-5: the amplitude
    assert abs(result.metrics['amplitude_change']) < 2e-5


def test_the_reference_of_the_crossing_has_a_lift_error_of_its_own():
    own = suite.lift_of_the_reference()
    assert own == pytest.approx(5.4e-3, rel=0.02)
    assert suite.lines({'crossing': {'exact': {'outcome': 'exact', 'why': f'{own:.2g}'}}}) == [
        ['crossing', 'exact', 'exact', '0.0054']]


def test_times_of_another_machine_win_nothing():
    kept = {'outcome': 'completed', 'wall_s': 1.0, 'metrics': {'period_error': 1e-6}}
    results = {'here': {'outcome': 'completed', 'wall_s': 2.0, 'metrics': {'period_error': 1e-5}},
               'other': kept | {'elsewhere': True}}
    assert suite.ranks(results, None) == ['here']
    assert suite.ranks(results, 'period_error') == ['other', 'here']
    assert suite.ranks({'other': kept, 'here': results['here']}, None)[0] == 'other'
