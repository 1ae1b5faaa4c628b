# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The total potential as a function of the unknowns: the sum over all effects, and its derivatives.

Unknowns q (m, 3): per component of strain the coefficients of an orthonormal basis (Ritz), or one
value per element (local), scaled so that the elastic energy is |q|^2 / 2 (in J).
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.energy.terms import add_forces, add_stiffness
from dlo_planner.geometry.hessian import fill_blocks
from dlo_planner.geometry.kinematics import add_gradient, forward_kinematics, reset
from dlo_planner.geometry.record import copy
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

# sqrt(J): what rounding errors have left of a strain across the plane of a shape; products of such
# numbers are denormal, with which processors compute some hundred times more slowly
_NOTHING = 1e-60


@kernel
def unknowns_of(system: Problem, strains: Floats, q: Floats) -> None:
    """Fill q (m, 3) with the unknowns whose strains are nearest to `strains` (N, 3)."""
    natural, scale, lengths = system.natural, system.scale, system.lengths
    series = system.basis.shape[1] > 0
    values = np.empty(natural.shape)
    for e in range(lengths.size):
        for i in range(3):
            values[e, i] = (strains[e, i] - natural[e, i]) / scale[e, i]
            if abs(values[e, i]) < _NOTHING:
                values[e, i] = 0.0
            if series:
                values[e, i] *= lengths[e]
    project(system.basis, values, q)


@kernel
def _strains_of(system, q, strains):
    natural, scale, basis = system.natural, system.scale, system.basis
    for e in range(natural.shape[0]):
        x, y, z = value_at(basis, q, e)
        strains[e, 0] = natural[e, 0] + scale[e, 0] * x
        strains[e, 1] = natural[e, 1] + scale[e, 1] * y
        strains[e, 2] = natural[e, 2] + scale[e, 2] * z


@kernel
def at_elements(basis, q):
    """Return the unknowns q (m, 3) at all elements (N, 3): q itself, or the series' values."""
    if basis.shape[1] == 0:
        return q
    values = np.empty((basis.shape[1], 3))
    for e in range(basis.shape[1]):
        values[e, 0], values[e, 1], values[e, 2] = value_at(basis, q, e)
    return values


@kernel(forceinline=True)
def value_at(basis, q, e):
    """Return (3 numbers) the unknowns q (m, 3) at element e, as `at_elements`."""
    if basis.shape[1] == 0:
        return q[e, 0], q[e, 1], q[e, 2]
    x = y = z = 0.0
    for j in range(basis.shape[2]):
        x += basis[0, e, j] * q[j, 0]
        y += basis[1, e, j] * q[j, 1]
        z += basis[2, e, j] * q[j, 2]
    return x, y, z


@kernel
def evaluate(system: Problem, state: Configuration) -> tuple[float, float]:
    """Refill `state` for its q; return the potential and the size of its rounding errors, in J."""
    lengths, scale, slope, pull = system.lengths, system.scale, state.slope, state.pull
    n = lengths.size
    _strains_of(system, state.q, state.strains)
    forward_kinematics(lengths, state.strains, system.base, state.rotations, state.positions,
                       state.arcs)
    for e in range(n):
        for i in range(3):
            slope[e, i] = 0.0
            pull[e, i] = 0.0
    for i in range(3):
        pull[n, i] = 0.0
    for k in range(state.weight.size):
        state.weight[k] = 0.0
    reset(state.attached)
    energy, size = add_forces(system.effects, system, state)
    add_gradient(lengths, state.strains, state.arcs, state.rotations, state.positions, pull,
                 state.attached, slope, state.base_force, state.base_moment)
    for e in range(n):
        for i in range(3):
            slope[e, i] *= scale[e, i]
    project(system.basis, slope, state.gradient)
    for j in range(system.proximal_point.shape[0]):
        for i in range(3):
            away = state.q[j, i] - system.proximal_point[j, i]
            state.gradient[j, i] += system.proximal_weight * away
            energy += 0.5 * system.proximal_weight * away * away
            size += 0.5 * system.proximal_weight * away * away
    return energy, 2e-16 * size


@kernel
def project(basis, values, out):
    """Fill out (m, 3) with the sum over the elements of basis times values (N, 3)."""
    _, n, terms = basis.shape
    if n == 0:
        copy(values, out)
        return
    sums = np.zeros((3, terms))  # each component's lie side by side
    for e in range(n):
        for i in range(3):
            value = values[e, i]
            for j in range(terms):
                sums[i, j] += basis[i, e, j] * value
    for j in range(terms):
        for i in range(3):
            out[j, i] = sums[i, j]


@kernel
def element_hessian(system, state, twist_jacobian, cross, diagonal, base):
    """Fill the semi-separable Hessian by the scaled strains, see `geometry.hessian`."""
    fill_blocks(system.needs.displaced, system.lengths, state.strains, state.arcs, system.scale,
                state.rotations, state.positions, state.pull, state.weight, state.attached,
                twist_jacobian, cross, diagonal, base)
    add_stiffness(system.effects, system, state, diagonal)


def configuration_at(system: Problem, strains: Floats) -> Configuration:
    """Return the Configuration of a Problem with element strains (N, 3), 1/m."""
    state: Configuration = new_configuration(system)
    unknowns_of(system, strains, state.q)
    evaluate(system, state)
    return state
