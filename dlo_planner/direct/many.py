# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes of a DLO that hangs freely, as far as they do, in one compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.culling import acting_on
from dlo_planner.direct.indicator import hanging_surely_within
from dlo_planner.direct.statics import MAX_ITERATIONS, TOLERANCE, hangs_still
from dlo_planner.energy.potential import placed
from dlo_planner.minimize.hanging import hang_many
from dlo_planner.model.arrays import Floats
from dlo_planner.model.value import freeze

if TYPE_CHECKING:  # it imports this package
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.simulator import DirectSimulator


def hangs_in_a_loop(simulator: DirectSimulator) -> bool:
    """Return whether shapes of a DirectSimulator come from the compiled loop."""
    mesh, newton = simulator.mesh, simulator.method == 'newton'
    return newton and (mesh.hangs or simulator.history is None and mesh.free.hangs)


def hanging_shapes(simulator: DirectSimulator, positions: Floats, rotations: Floats,
                   filled: Filled) -> NDArray[np.bool_]:
    """Fill in what `DirectSimulator.solve` finds in many grippers.

    The interpreter is free meanwhile, so threads work side by side.

    Parameters
    ----------
    simulator : DirectSimulator
        Simulator with `hangs_in_a_loop`.
    positions : ndarray, shape (n, 3)
        Positions of the grippers, m.
    rotations : ndarray, shape (n, 3, 3)
    filled : Filled
        Of n shapes.

    Returns
    -------
    ndarray of bool, shape (n,)
        Whether a shape is within the accuracy that is wanted, and nothing acts on it that may.
        Where that is not known, `solve` has to look.
    """
    mesh = simulator.mesh
    hang_many(mesh.free.static, read_only(rotations), read_only(positions), mesh.relaxed, TOLERANCE,
              MAX_ITERATIONS, *filled.arrays)
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
    local = placed(mesh.free.system(np.eye(3)), np.array(mesh.natural)).positions
    before = positions[:, None] + np.einsum('nij,kj->nki', rotations, local)
    strains, _, there = filled.stored[:3]
    acting: NDArray[np.bool_] = (acting_on(mesh, strains[:], there[:], before)
                                 | ~filled.columns['converged'])
    return acting


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
    def new(cls, n: int, elements: int,
            empty: Callable[[tuple[int, ...], Any], NDArray[Any]] = np.empty) -> Filled:
        """Return one for n shapes of so many elements, in which nothing is filled yet.

        Parameters
        ----------
        n, elements : int
        empty : callable, optional
            Function of shape and dtype that makes an array.
        """
        rows = (elements, 3), (elements + 1, 3, 3), (elements + 1, 3), (6,), (2,), (3,)
        return cls((*(empty((n, *row), float) for row in rows), empty((n,), np.int64),
                    empty((n,), bool), empty((n,), bool), empty((n,), float), empty((n,), float)))

    def part(self, begin: int, end: int) -> Filled:
        """Return that of the shapes from `begin` to `end`, with views of the same arrays."""
        return Filled(tuple(rows[begin:end] for rows in self.stored))

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
