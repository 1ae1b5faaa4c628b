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
from dlo_planner.model.value import freeze

if TYPE_CHECKING:  # it imports this package
    from dlo_planner.direct.simulator import DirectSimulator


def hanging_shapes(simulator: DirectSimulator, positions: np.ndarray,
                   rotations: np.ndarray) -> tuple[dict[str, Any], np.ndarray] | None:
    """Return what `DirectSimulator.solve` finds in many grippers, as arrays.

    The interpreter is free meanwhile, so threads work side by side.

    Parameters
    ----------
    simulator : DirectSimulator
        Simulator whose DLO hangs freely, see `Discretization.hangs`. For any other, the answer is
        None.
    positions : ndarray, shape (n, 3)
        Positions of the grippers, m.
    rotations : ndarray, shape (n, 3, 3)

    Returns
    -------
    (dict, ndarray) or None
        Arrays of n rows each, named as the attributes of `Shape`; and (n,) whether a shape is
        within the accuracy that is wanted. Where it may not be, `solve` has to look.
    """
    mesh = simulator.mesh
    if not mesh.hangs or simulator.method != 'newton':
        return None
    filled = Filled(mesh.s.size - 1, positions, rotations)
    hang_many(mesh.static, filled.rotations, filled.positions, mesh.relaxed, TOLERANCE,
              MAX_ITERATIONS, *filled.arrays)
    residual, stability, truncated = filled.proofs.T
    good = np.full(len(positions), True)
    if simulator.accuracy is not None:
        good = hanging_surely_within(mesh, stability, truncated, simulator.accuracy)
    return filled.columns(), good


class Filled:
    """The arrays that a loop over n grippers fills.

    Parameters
    ----------
    elements : int
        Number of elements, N.
    positions : ndarray, shape (n, 3)
        Positions of the grippers, m.
    rotations : ndarray, shape (n, 3, 3)
    """

    def __init__(self, elements: int, positions: NDArray[np.float64],
                 rotations: NDArray[np.float64]):
        n = len(positions)
        self.rotations, self.positions = (np.array(one, dtype=float, order='C')
                                          for one in (rotations, positions))
        freeze((self.rotations, self.positions))
        self._shapes = {'element_strains': np.empty((n, elements, 3)),
                        'frames': np.empty((n, elements + 1, 3, 3)),
                        'positions': np.empty((n, elements + 1, 3)),
                        'gripper_wrench': np.empty((n, 6))}
        self._energies, self.proofs = np.empty((n, 2)), np.empty((n, 3))
        self._iterations = np.empty(n, dtype=np.int64)

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """What the loop fills, in its order; `proofs` (n, 3) is one of them."""
        return *self._shapes.values(), self._energies, self.proofs, self._iterations

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by the names of the attributes of `Shape`."""
        residual, stability, _ = self.proofs.T
        nothing, none = np.zeros(residual.size), np.zeros(residual.size, dtype=bool)
        return self._shapes | {
            'energy': self._energies[:, 1], 'elastic_energy': self._energies[:, 0],
            'residual': residual, 'stability': stability, 'iterations': self._iterations,
            'converged': hangs_still(residual, stability), 'jumped': none,
            'dissipated': nothing, 'violation': nothing}
