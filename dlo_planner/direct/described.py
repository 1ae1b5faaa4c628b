# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's own unknowns: series of q_d, q_kappa and q_tau in place of the strain components.

For study. Only the paper's minimizers work on them: where the DLO is straight the direction of
curvature q_d has no effect, so the Hessian is singular there. The search therefore begins with a
slight bend towards where gravity would bend the DLO.
"""

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.statics import TOLERANCE, shape_of
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import new_state
from dlo_planner.minimize.methods import SEARCHES, beside, judged, rounding
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import MOST_KICKS
from dlo_planner.minimize.protocol import Problem
from dlo_planner.ritz.paper_strains import from_components, to_components
from dlo_planner.ritz.series import orthonormal_basis

STRAINS = ('components', 'paper')
_SLIGHT = 1e-2  # rad over the length


def described_equilibrium(discretization, gripper, strains, method, history):
    """Return the Shape whose (q_d, q_kappa, q_tau) are series, and how often it left a saddle.

    `residual` is that of the series' coefficients; `stability` is the DLO's own, freed from them.

    Parameters
    ----------
    discretization
        Its mesh, basis ('chebyshev' or 'fourier') and number of terms are used.
    strains
        (N, 3) components where the search begins, 1/m.
    method
        'dfp' or 'downhill_simplex'.
    history
        History of the DLO on this mesh.
    """
    free = Discretization(discretization.surroundings, discretization.s, 'local', 0)
    system = free.system(gripper.rotation, gripper.position, history)
    basis = orthonormal_basis(discretization.basis, discretization.n_terms, discretization.s)
    weighted = basis * system.lengths[:, None]
    # angles count as much as the curvature they turn, so that all unknowns are roots of energies
    stiffness, length = system.stiffness[:, 1:].min(), system.lengths.sum()
    unit = 1 / np.sqrt([stiffness / length**2, stiffness, system.stiffness[:, 0].min()])
    state = new_state(system)

    def components(flat):
        described = basis @ (flat.reshape(-1, 3) * unit)
        return described, system.natural + to_components(described)

    def value(flat):
        state.q[:] = (components(flat)[1] - system.natural) / system.scale
        return evaluate(system, state)[0]

    def value_and_gradient(flat):
        energy = value(flat)
        direction, amount, _ = components(flat)[0].T
        by_strain = state.gradient / system.scale
        cosine, sine = np.cos(direction), np.sin(direction)
        slope = np.column_stack([
            amount * (cosine * by_strain[:, 2] - sine * by_strain[:, 1]),
            cosine * by_strain[:, 1] + sine * by_strain[:, 2], by_strain[:, 0]])
        return energy, (basis.T @ slope * unit).ravel()

    bend = np.sqrt(stiffness / length)
    problem = Problem(value, value_and_gradient, bend, rounding(system))
    iterations = evaluations = kicks = 0
    while True:
        start = weighted.T @ _described(system, state, strains) / unit
        found = SEARCHES[method](problem, start.ravel(), TOLERANCE)
        iterations, evaluations = iterations + found.iterations, evaluations + found.evaluations
        _, gradient = value_and_gradient(found.q)
        residual = np.linalg.norm(gradient) / np.hypot(np.linalg.norm(state.q), bend)
        reached = judged(system, state.q.copy(), TOLERANCE)
        kicked = beside(system, reached)
        if kicked is None or kicks >= MOST_KICKS:
            break
        strains, kicks = system.natural + system.scale * kicked, kicks + 1
    found = Minimum(state, residual, reached.stability, iterations, kicks, system,
                    evaluations=evaluations)
    return shape_of(free, gripper, found, history), kicks


def _described(system, state, strains):
    """Return (N, 3) q_d, q_kappa, q_tau of component strains (N, 3), slightly bent at least."""
    start = from_components(strains - system.natural)
    length = system.lengths.sum()
    if np.abs(start[:, 1]).max() * length < _SLIGHT:
        state.q[:] = 0.0
        evaluate(system, state)
        towards = from_components(-state.gradient / system.scale)
        start[:, 0] = towards[np.argmax(towards[:, 1]), 0]
        start[:, 1] = _SLIGHT / length
    start[:, 0] = np.unwrap(start[:, 0])
    return start
