# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's own unknowns: series of q_d, q_kappa and q_tau in place of the components of strain.

Only the paper's minimizers work on them: where the DLO is straight the direction of curvature q_d
has no effect, so the Hessian is singular there. The search therefore begins with a slight bend
towards where gravity would bend the DLO.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.geometry.basis import from_components, to_components
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.minimize.newton import MOST_KICKS, descend
from dlo_planner.model.arrays import Floats
from dlo_planner.study.minimizers import SEARCHES, Objective, rounding, saddle_exit_point

_SLIGHT = 1e-2  # rad over the length


def described_minimum(system: Problem, basis: Floats, strains: Floats, method: str,
                      tolerance: float) -> Minimum:
    """Return the Minimum whose (q_d, q_kappa, q_tau) are series by a basis (N, n_terms).

    `system` has an unknown strain for each element. `residual` is that of the series' coefficients;
    `stability` is the DLO's own, freed from them.
    """
    series = _Series(system, basis)
    state, bend = series.state, series.bend
    problem = Objective(series.value, series.value_and_gradient, bend, rounding(system))
    iterations = evaluations = kicks = 0
    while True:
        found = SEARCHES[method](problem, series.nearest(strains), tolerance)
        iterations, evaluations = iterations + found.iterations, evaluations + found.evaluations
        _, gradient = series.value_and_gradient(found.q)
        residual = np.linalg.norm(gradient) / np.hypot(np.linalg.norm(state.q), bend)
        reached = descend(system, state.q.copy(), tolerance, 0, True)
        perturbed = saddle_exit_point(system, reached)
        if perturbed is None or kicks >= MOST_KICKS:
            break
        strains, kicks = system.natural + system.scale * perturbed, kicks + 1
    return Minimum(state, residual, reached.stability, iterations, kicks, system,
                   evaluations=evaluations)


class _Series:
    """Coefficients of the series of (q_d, q_kappa, q_tau), and the potential as their function."""

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
        return self.basis @ (flat.reshape(-1, 3) * self.unit)

    def _evaluated(self, described: Floats) -> float:
        strains = self.system.natural + to_components(described)
        self.state.q[:] = (strains - self.system.natural) / self.system.scale
        return evaluate(self.system, self.state)[0]


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
