# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's own unknowns: series of q_d, q_kappa and q_tau in place of the strain components.

For study. Only the paper's minimizers work on them: where the DLO is straight the direction of
curvature q_d has no effect, so the Hessian is singular there. The search therefore begins with a
slight bend towards where gravity would bend the DLO.
"""

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.memory import Memory
from dlo_planner.direct.search import TOLERANCE
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import shape_of
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.geometry.basis import from_components, orthonormal_basis, to_components
from dlo_planner.minimize.classic import (
    SEARCHES,
    Objective,
    check_stationary,
    rounding,
    saddle_exit_point,
)
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.minimize.newton import MOST_KICKS
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

STRAINS = ('components', 'paper')
_SLIGHT = 1e-2  # rad over the length


def described_equilibrium(discretization: Discretization, gripper: Pose, strains: Floats,
                          method: str, history: Memory) -> Shape:
    """Return the Shape whose (q_d, q_kappa, q_tau) are series.

    `residual` is that of the series' coefficients; `stability` is the DLO's own, freed from them.

    Shapes: strains (N, 3).
    """
    free = discretization.local
    system = free.system(gripper.rotation, gripper.position, history)
    series = _Series(system, orthonormal_basis(discretization.basis, discretization.n_terms,
                                               discretization.s))
    state, bend = series.state, series.bend
    problem = Objective(series.value, series.value_and_gradient, bend, rounding(system))
    iterations = evaluations = kicks = 0
    while True:
        found = SEARCHES[method](problem, series.nearest(strains), TOLERANCE)
        iterations, evaluations = iterations + found.iterations, evaluations + found.evaluations
        _, gradient = series.value_and_gradient(found.q)
        residual = np.linalg.norm(gradient) / np.hypot(np.linalg.norm(state.q), bend)
        reached = check_stationary(system, state.q.copy(), TOLERANCE)
        kicked = saddle_exit_point(system, reached)
        if kicked is None or kicks >= MOST_KICKS:
            break
        strains, kicks = system.natural + system.scale * kicked, kicks + 1
    ended = Minimum(state, residual, reached.stability, iterations, kicks, system,
                    evaluations=evaluations)
    return shape_of(free, gripper, ended, history)


class _Series:
    """Coefficients of the series of (q_d, q_kappa, q_tau), and the potential as their function.

    `system` has one unknown strain per element, where the basis is (N, N_c).
    """

    def __init__(self, system: Problem, basis: Floats) -> None:
        self.system, self.basis, self.state = system, basis, new_configuration(system)
        # angles count as much as the curvature they turn, so that all unknowns are roots of
        # energies
        stiffness, length = system.stiffness[:, 1:].min(), system.lengths.sum()
        self.unit = 1 / np.sqrt([stiffness / length**2, stiffness, system.stiffness[:, 0].min()])
        self.bend = np.sqrt(stiffness / length)

    def nearest(self, strains: Floats) -> Floats:
        """Return the coefficients, flat, that are nearest to component strains (N, 3)."""
        weighted = self.basis * self.system.lengths[:, None]
        start: Floats = weighted.T @ _described(self.system, self.state, strains) / self.unit
        return start.ravel()

    def value(self, flat: Floats) -> float:
        """Return the potential, J."""
        return self._evaluated(self._described(flat))

    def value_and_gradient(self, flat: Floats) -> tuple[float, Floats]:
        """Return the potential and its derivatives by the coefficients."""
        described = self._described(flat)
        energy = self._evaluated(described)
        direction, amount, _ = described.T
        by_strain = self.state.gradient / self.system.scale
        cosine, sine = np.cos(direction), np.sin(direction)
        slope = np.column_stack([
            amount * (cosine * by_strain[:, 2] - sine * by_strain[:, 1]),
            cosine * by_strain[:, 1] + sine * by_strain[:, 2], by_strain[:, 0]])
        return energy, (self.basis.T @ slope * self.unit).ravel()

    def _described(self, flat: Floats) -> Floats:
        described: Floats = self.basis @ (flat.reshape(-1, 3) * self.unit)
        return described

    def _evaluated(self, described: Floats) -> float:
        strains = self.system.natural + to_components(described)
        self.state.q[:] = (strains - self.system.natural) / self.system.scale
        energy: float = evaluate(self.system, self.state)[0]
        return energy


def _described(system: Problem, state: Configuration, strains: Floats) -> Floats:
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
