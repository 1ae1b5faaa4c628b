# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes in one compiled loop: of one DLO that hangs freely, or of many that differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.accuracy import hanging_surely_within
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.statics import MAX_ITERATIONS, TOLERANCE, hangs_still
from dlo_planner.direct.step import acting
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import configuration_at
from dlo_planner.geometry.basis import orthonormal_basis, very_twisted
from dlo_planner.minimize.solve import RodTable, solve_free_many, solve_free_rods
from dlo_planner.model.arrays import Floats
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import freeze

if TYPE_CHECKING:
    from dlo_planner.direct.simulator import DirectSimulator

def hangs_in_a_loop(simulator: DirectSimulator) -> bool:
    """Return whether shapes of a DirectSimulator come from the compiled loop."""
    mesh, newton = simulator.mesh, simulator.method == 'newton'
    return newton and (mesh.hangs or simulator.history is None and mesh.may_hang)


def hanging_shapes(simulator: DirectSimulator, positions: Floats, rotations: Floats,
                   filled: Filled) -> NDArray[np.bool_]:
    """Fill in what `DirectSimulator.solve` finds in many grippers.

    The interpreter is free meanwhile, so threads work side by side.

    Shapes: positions (n, 3), rotations (n, 3, 3).
    """
    mesh = simulator.mesh
    solve_free_many(mesh.free, read_only(rotations), read_only(positions), read_only(mesh.natural),
                    TOLERANCE, MAX_ITERATIONS, *filled.arrays)
    filled.told()
    good = ~_acting(mesh, positions, rotations, filled)
    if simulator.accuracy is None:
        return good
    _, stability, truncated = filled.proofs.T
    good &= hanging_surely_within(mesh.told_by_truncation, stability, truncated,
                                  simulator.accuracy)
    return good


def _acting(mesh: Discretization, positions: Floats, rotations: Floats,
            filled: Filled) -> NDArray[np.bool_]:
    """Return (n,) whether something acts on the shapes, or on the way of a DLO that is set down."""
    if mesh.hangs:
        return np.zeros(len(positions), dtype=bool)
    local = configuration_at(mesh.system(np.eye(3), culled=True), np.array(mesh.natural)).positions
    before = positions[:, None] + np.einsum('nij,kj->nki', rotations, local)
    strains, _, there = filled.stored[:3]
    found: NDArray[np.bool_] = (acting(mesh, strains[:], there[:], before)
                                | ~filled.columns['converged'])
    return found


def read_only(given: Floats) -> Floats:
    """Return an array as the loops take it: they are compiled for arrays that do not change."""
    array = np.ascontiguousarray(given, dtype=float)
    if array.flags.writeable:
        array = array.copy() if array is given else array
        freeze(array)
    return array


class Filled:
    """The arrays that a loop over n grippers fills.

    Attributes
    ----------
    stored : tuple of ndarray
        What the loop fills, in its order, and after it `told`; n rows each.
    columns : dict
        The same by the names of the attributes of `Shape`.
    proofs : ndarray, shape (n, 3)
        Residual, stability, `truncation`.
    """

    def __init__(self, stored: tuple[NDArray[Any], ...]):
        self.stored = stored
        energies, self.proofs, *others = stored[4:]
        self.columns = dict(zip(_SHAPE, stored, strict=False)) | {
            'elastic_energy': energies[:, 0], 'energy': energies[:, 1],
            'residual': self.proofs[:, 0], 'stability': self.proofs[:, 1],
            } | dict(zip(_OTHERS, others, strict=True))

    @classmethod
    def new(cls, n: int, elements: int) -> Filled:
        """Return one for n shapes of so many elements, in which nothing is filled yet."""
        rows = (elements, 3), (elements + 1, 3, 3), (elements + 1, 3), (6,), (2,), (3,)
        return cls((*(np.empty((n, *row)) for row in rows), np.empty(n, dtype=np.int64),
                    np.empty(n, dtype=bool), np.empty(n, dtype=bool), np.empty(n), np.empty(n)))

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """What the loop fills, in its order."""
        return self.stored[:7]

    def told(self) -> None:
        """Fill in what is said of such shapes besides what the loop does, after it."""
        columns = self.columns
        columns['converged'][:] = hangs_still(columns['residual'], columns['stability'])
        columns['jumped'][:] = False
        columns['dissipated'][:] = columns['violation'][:] = 0.0


_SHAPE = 'element_strains', 'frames', 'positions', 'gripper_wrench'
_OTHERS = 'iterations', 'converged', 'jumped', 'dissipated', 'violation'


def even(simulator: DirectSimulator, rod: Rod) -> bool:
    """Return whether a Rod hangs freely and all is the same along it, as `hanging_rods` asks."""
    around = simulator.surroundings
    return not (around.obstacles or around.pinned or around.point_loads or callable(around.load)
                or rod.yields or rod.varies or rod.nodes or simulator.method != 'newton')


def hanging_rods(simulator: DirectSimulator, rods: Sequence[Rod],
                 positions: NDArray[np.float64], rotations: NDArray[np.float64],
                 ) -> tuple[dict[str, Any], NDArray[np.bool_]]:
    """Return what `simulator.with_rod(rod).solve` finds for many rods, as arrays.

    Shapes: positions (n, 3), rotations (n, 3, 3).
    """
    mesh, accuracy = simulator.mesh, simulator.accuracy
    if not even(simulator, simulator.rod):
        mesh = simulator.with_rod(rods[0]).mesh
    filled = Filled.new(len(rods), mesh.s.size - 1)
    own = mesh.free
    system = own._replace(**{name: getattr(own, name).copy() for name in (
        'lengths', 'natural', 'stiffness', 'scale', 'basis', 'pull')})
    table = _table(mesh, simulator.mesh.s, rods)
    solve_free_rods(system, table, read_only(rotations), read_only(positions), TOLERANCE,
                    MAX_ITERATIONS, *filled.arrays)
    filled.told()
    if accuracy is None:
        return filled.columns, np.full(len(rods), True)
    even_rods: Sequence[Any] = rods  # whose parameters are numbers, see `even`
    lengths, twists = np.array([(rod.length, rod.natural_twist) for rod in even_rods]).T
    _, stability, truncated = filled.proofs.T
    return filled.columns, hanging_surely_within(~very_twisted(twists * lengths), stability,
                                                 truncated,
                                                 accuracy * (lengths / simulator.rod.length))


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
    freeze(strains)
    if mesh.basis == 'local':
        scale = 1 / np.sqrt(elements * h[mesh_of][:, :, None])
    else:
        scale = np.sqrt(stiffness)[:, None] / elements
    basis = np.array([orthonormal_basis(mesh.basis, mesh.n_terms, one) for one in nodes])
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


def scaled_nodes(s: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return nodes like `s` (N + 1,), m, of a DLO of another length, m."""
    return np.append(s[:-1] * (length / s[-1]), length)
