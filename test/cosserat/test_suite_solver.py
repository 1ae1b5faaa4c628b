# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The solver for cosseratbench, where that is installed."""

import numpy as np
import pytest

pytest.importorskip('cosseratbench')
from cosseratbench import registry  # noqa: E402  only if it is there
from cosseratbench.experiment import run  # noqa: E402
from cosseratbench.solver import Solver  # noqa: E402

from dlo_planner.cosserat.solver import DloPlanner  # noqa: E402


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
