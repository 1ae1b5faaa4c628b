# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How stable the shapes of a motion are: found when it is asked for, from how the DLO moves."""

import numpy as np
import pytest
from references.planar_motions import tilted

from dlo_planner import DirectSimulator, Rod
from dlo_planner.direct.boundary_motion import Grips, Guide
from dlo_planner.direct.integrator import Scheme
from dlo_planner.direct.stepper import Limits, Stepper
from dlo_planner.minimize.newton import newton


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('damping', [0.0, (0.5, 5e-4)])
@pytest.mark.parametrize('integrator', ['generalized_alpha', 'paper'])
def test_a_step_is_as_stable_as_the_hessian_that_it_minimized_says(basis, damping, integrator):
    wire, dt = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, damping=damping), 0.005
    simulator = DirectSimulator(wire, basis=basis, n_elements=24)
    grippers = [tilted(0.5 * k * dt) for k in range(7)]
    start = simulator.solve(grippers[0])
    stepper = Stepper(start.mesh, Grips(Guide(grippers, dt)), dt)
    now, scheme, told = stepper.begin(start), Scheme.named(integrator, dt), []
    for k in range(1, 7):
        batch = stepper.steps(now, (), np.array([float(k)]), scheme, Limits())
        assert batch.refused is None
        problem = stepper.problem(now.nodes, now.bends, now.memory, float(k), scheme)
        there = batch.last.shape
        true = newton(problem, start.mesh.unknowns(there.element_strains), 1e-9, 100, True)
        np.testing.assert_allclose(true.state.strains, there.element_strains, rtol=0, atol=1e-5)
        told.append((there.stability, true.stability))
        now = batch.last
    told = np.array(told)
    assert np.isfinite(told).all()
    assert np.abs(told[:, 0] / told[:, 1] - 1).max() < 1e-3
    assert told[-1, 1] < 0.99  # not merely that of a DLO without forces
