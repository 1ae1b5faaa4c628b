# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes of a DLO that hangs freely, in one compiled loop."""

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.indicator import hanging_surely_within
from dlo_planner.direct.statics import MAX_ITERATIONS, NO_FRAMES, NO_NODES, TOLERANCE, hangs_still
from dlo_planner.minimize.hanging import hang_many
from dlo_planner.model.value import freeze

if TYPE_CHECKING:  # it imports this package
    from dlo_planner.direct.simulator import DirectSimulator


def hanging_shapes(simulator: 'DirectSimulator', positions: np.ndarray,
                   rotations: np.ndarray) -> tuple[dict[str, Any], np.ndarray] | None:
    """Return what `DirectSimulator.solve` finds in many grippers, as arrays; None: not this way.

    The interpreter is free meanwhile, so threads work side by side.

    Args:
        simulator: whose DLO hangs freely, see `Discretization.hangs`; of any other: None
        positions: (n, 3) of the grippers, m; rotations: (n, 3, 3)

    Returns:
        dict of arrays, n rows each, named as the attributes of `Shape`
        (n,) whether a shape is within the accuracy that is wanted; where it may not be, `solve`
            has to look
    """
    mesh, n = simulator._discretization, len(positions)
    if not mesh.hangs or simulator.method != 'newton':
        return None
    elements = mesh.s.size - 1
    found = {'element_strains': np.empty((n, elements, 3)),
             'frames': np.empty((n, elements + 1, 3, 3)),
             'positions': np.empty((n, elements + 1, 3)), 'gripper_wrench': np.empty((n, 6))}
    energies, proofs = np.empty((n, 2)), np.empty((n, 3))
    iterations = np.empty(n, dtype=np.int64)
    rotations, positions = (np.array(one, dtype=float, order='C') for one in (rotations, positions))
    freeze((rotations, positions))
    hang_many(mesh.static, rotations, positions, mesh.relaxed, TOLERANCE, MAX_ITERATIONS,
              NO_FRAMES, NO_NODES, *found.values(), energies, proofs, iterations)
    residual, stability, truncated = proofs.T
    good = np.full(n, True)
    if simulator.accuracy is not None:
        good = hanging_surely_within(mesh, stability, truncated, simulator.accuracy)
    nothing, none = np.zeros(n), np.zeros(n, dtype=bool)
    return found | {'energy': energies[:, 1], 'elastic_energy': energies[:, 0],
                    'residual': residual, 'stability': stability, 'iterations': iterations,
                    'converged': hangs_still(residual, stability), 'jumped': none,
                    'dissipated': nothing, 'violation': nothing}, good
