# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes in one compiled loop: of one DLO that hangs freely, or of many that differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from dlo_planner.direct.accuracy import hanging_surely_within
from dlo_planner.direct.discretization import Discretization, unknown_scale
from dlo_planner.direct.equilibrium import acts_at
from dlo_planner.direct.search import MAX_ITERATIONS, TOLERANCE
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.problem import Problem
from dlo_planner.geometry.basis import orthonormal_basis, very_twisted
from dlo_planner.minimize.convergence import CONVERGED
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.minimize.solve import FreeShapes, RodTable, solve_free
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import read_only
from dlo_planner.progress import uninterrupted

if TYPE_CHECKING:
    from dlo_planner.direct.simulator import DirectSimulator


def has_free_loop(simulator: DirectSimulator) -> bool:
    """Return whether shapes of a DirectSimulator come from the compiled loop."""
    mesh, newton = simulator.mesh, simulator.method == 'newton'
    return newton and (mesh.hangs or simulator.history is None and mesh.may_hang)


Columns: TypeAlias = dict[str, Any]  # arrays by the names of the attributes of `Shape`


def free_shapes(simulator: DirectSimulator, positions: Floats,
                rotations: Floats) -> tuple[Columns, Bools]:
    """Return what `DirectSimulator.solve` finds in many grippers, and (n,) where that is so.

    The interpreter is free meanwhile, so threads work side by side.

    Shapes: positions (n, 3), rotations (n, 3, 3).
    """
    mesh = simulator.mesh
    own, none = mesh.free, np.zeros(1, dtype=np.int64)
    alone = RodTable(none, *(one[None].copy() for one in (
        own.lengths, own.basis, own.natural, own.stiffness, own.scale, own.pull)))
    columns, truncated = _filled(own, alone, np.zeros(len(positions), dtype=np.int64), positions,
                                 rotations)
    good: Bools = np.ones(len(positions), dtype=bool)
    if not mesh.hangs:  # nothing acts on the shapes, or on the way of a DLO that is set down
        local = configuration_at(mesh.system(np.eye(3), culled=True),
                                 np.array(mesh.natural)).positions
        before = positions[:, None] + np.einsum('nij,kj->nki', rotations, local)
        good = columns['converged'] & [not acts_at(mesh, *one) for one in zip(
            columns['element_strains'], columns['positions'], before, strict=True)]
    if simulator.accuracy is not None:
        good = good & hanging_surely_within(mesh.bounded_by_truncation, columns['stability'],
                                            truncated, simulator.accuracy)
    return columns, good


def _filled(system: Problem, rods: RodTable, rod_of: Ints, positions: Floats,
            rotations: Floats) -> tuple[Columns, Floats]:
    """Return columns of n shapes from `solve_free`, and (n,) their `truncation_error`."""
    n, elements = rod_of.size, system.lengths.size
    rows = (elements, 3), (elements + 1, 3, 3), (elements + 1, 3), (6,), (2,), (3,)
    arrays, iterations = [np.empty((n, *row)) for row in rows], np.empty(n, dtype=np.int64)
    written = {name: getattr(system, name).copy() for name in (
        'lengths', 'natural', 'stiffness', 'scale', 'basis', 'pull')}
    uninterrupted(solve_free(
        system._replace(**written), rods, rod_of, read_only(rotations), read_only(positions),
        TOLERANCE, MAX_ITERATIONS, FreeShapes(*arrays, iterations)))
    strains, frames, places, wrenches, energies, proofs = arrays
    residual, stability, truncated = proofs.T
    return {'element_strains': strains, 'frames': frames, 'positions': places,
            'gripper_wrench': wrenches, 'elastic_energy': energies[:, 0], 'energy': energies[:, 1],
            'residual': residual, 'stability': stability, 'iterations': iterations,
            'converged': (residual < CONVERGED) & (stability > -NEUTRAL),
            'jumped': np.zeros(n, dtype=bool), 'wrenches': np.zeros((n, 0, 6)),
            'dissipated': np.zeros(n), 'violation': np.zeros(n)}, truncated


def even(simulator: DirectSimulator, rod: Rod) -> bool:
    """Return whether a Rod hangs freely and all is the same along it, as `free_rods` asks."""
    around = simulator.surroundings
    return not (around.obstacles or around.pinned or around.point_loads or callable(around.load)
                or around.self_contact or rod.yields or rod.varies or rod.nodes
                or simulator.method != 'newton')


def free_rods(simulator: DirectSimulator, rods: Sequence[Rod], positions: Floats,
              rotations: Floats) -> tuple[Columns, Bools]:
    """Return what `simulator.with_rod(rod).solve` finds for n rods, and (n,) where that is so."""
    mesh, accuracy = simulator.mesh, simulator.accuracy
    if not even(simulator, simulator.rod):
        mesh = simulator.with_rod(rods[0]).mesh
    columns, truncated = _filled(mesh.free, _table(mesh, simulator.mesh.s, rods),
                                 np.arange(len(rods)), positions, rotations)
    if accuracy is None:
        return columns, np.full(len(rods), True)
    even_rods: Sequence[Any] = rods  # whose parameters are numbers, see `even`
    lengths, twists = np.array([(rod.length, rod.natural_twist) for rod in even_rods]).T
    return columns, hanging_surely_within(~very_twisted(twists * lengths), columns['stability'],
                                          truncated, accuracy * (lengths / simulator.rod.length))


def _table(mesh: Discretization, s: Floats, rods: Sequence[Rod]) -> RodTable:
    """Return the RodTable of Rods on nodes like `s` (N + 1,); all else as in a Discretization."""
    lengths, mesh_of = np.unique([rod.length for rod in rods], return_inverse=True)
    nodes = np.array([scaled_nodes(s, length) for length in lengths])
    h, mesh_of = np.diff(nodes), mesh_of.ravel()
    even_rods: Sequence[Any] = rods  # whose parameters are numbers, see `even`
    stiffness = np.array([(rod.torsional_stiffness, *rod.bending_stiffness) for rod in even_rods])
    natural = np.array([(rod.natural_twist, *rod.natural_curvature) for rod in even_rods])
    elements, strains = (np.repeat(one[:, None], h.shape[1], axis=1)
                         for one in (stiffness, natural))
    scale = unknown_scale(mesh.basis, elements, h[mesh_of])
    basis = np.array([orthonormal_basis(mesh.basis, mesh.n_terms, one, np.ones_like(strains[0]))
                      for one in nodes])
    return RodTable(mesh_of, h, basis, strains, elements, scale,
                    _pulls(mesh.surroundings, rods, nodes[mesh_of]))


def _pulls(around: Surroundings, rods: Sequence[Rod], nodes: Floats) -> Floats:
    """Return (n, N + 1, 3) the dead loads on the nodes (n, N + 1) of each rod, negated, N."""
    h = np.diff(nodes)
    masses, forces = np.zeros(nodes.shape), np.zeros((*nodes.shape, 3))
    half = 0.5 * np.array([rod.mass_per_length for rod in rods])[:, None] * h
    masses[:, :-1] += half
    masses[:, 1:] += half
    masses[:, -1] += [rod.tip_mass for rod in rods]
    for k in (k for k, rod in enumerate(rods) if rod.point_masses):
        masses[k] = node_masses(rods[k], nodes[k])
    load: Any = around.load
    if load is not None:
        half = 0.5 * h[:, :, None] * load
        forces[:, :-1] += half
        forces[:, 1:] += half
    return -masses[:, :, None] * around.gravity - forces


def scaled_nodes(s: Floats, length: float) -> Floats:
    """Return nodes like `s` (N + 1,), m, of a DLO of another length, m."""
    return np.append(s[:-1] * (length / s[-1]), length)
