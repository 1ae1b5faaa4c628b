# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes of a DLO that hangs freely, in one compiled loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.indicator import hanging_surely_within
from dlo_planner.direct.statics import MAX_ITERATIONS, TOLERANCE, hangs_still
from dlo_planner.minimize.hanging import hang_many
from dlo_planner.model.arrays import Floats
from dlo_planner.model.value import freeze

if TYPE_CHECKING:  # it imports this package
    from dlo_planner.direct.simulator import DirectSimulator


def hangs_in_a_loop(simulator: DirectSimulator) -> bool:
    """Return whether shapes of a DirectSimulator come from the compiled loop."""
    return simulator.mesh.hangs and simulator.method == 'newton'


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
        Whether a shape is within the accuracy that is wanted. Where it may not be, `solve` has to
        look.
    """
    mesh = simulator.mesh
    hang_many(mesh.static, read_only(rotations), read_only(positions), mesh.relaxed, TOLERANCE,
              MAX_ITERATIONS, *filled.arrays)
    filled.told()
    if simulator.accuracy is None:
        return np.full(len(positions), True)
    _, stability, truncated = filled.proofs.T
    good: NDArray[np.bool_] = hanging_surely_within(mesh, stability, truncated, simulator.accuracy)
    return good


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
    columns : dict
        Arrays of n rows each, by the names of the attributes of `Shape`.
    """

    def __init__(self, columns: dict[str, NDArray[Any]], energies: Floats, proofs: Floats):
        self.columns, self._energies, self.proofs = columns, energies, proofs

    @classmethod
    def new(cls, n: int, elements: int) -> Filled:
        """Return one for n shapes of so many elements, in which nothing is filled yet."""
        energies, proofs = np.empty((n, 2)), np.empty((n, 3))
        return cls({
            'element_strains': np.empty((n, elements, 3)),
            'frames': np.empty((n, elements + 1, 3, 3)),
            'positions': np.empty((n, elements + 1, 3)), 'gripper_wrench': np.empty((n, 6)),
            'iterations': np.empty(n, dtype=np.int64),
            'elastic_energy': energies[:, 0], 'energy': energies[:, 1],
            'residual': proofs[:, 0], 'stability': proofs[:, 1],
            'converged': np.zeros(n, dtype=bool), 'jumped': np.zeros(n, dtype=bool),
            'dissipated': np.zeros(n), 'violation': np.zeros(n)}, energies, proofs)

    def part(self, begin: int, end: int) -> Filled:
        """Return that of the shapes from `begin` to `end`, with views of the same arrays."""
        return Filled({name: values[begin:end] for name, values in self.columns.items()},
                      self._energies[begin:end], self.proofs[begin:end])

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """What the loop fills, in its order; `proofs` (n, 3) is one of them."""
        return (*(self.columns[name] for name in _SHAPE), self._energies, self.proofs,
                self.columns['iterations'])

    def told(self) -> None:
        """Fill in which shapes have converged, after the loop."""
        self.columns['converged'][:] = hangs_still(self.columns['residual'],
                                                   self.columns['stability'])


_SHAPE = 'element_strains', 'frames', 'positions', 'gripper_wrench'
