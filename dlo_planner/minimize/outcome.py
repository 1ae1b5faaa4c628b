# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is told of an equilibrium of a DLO that hangs freely, besides its strains and frames."""

import numpy as np

from dlo_planner.energy.elastic import add_elastic
from dlo_planner.energy.loads import dead_load
from dlo_planner.kernels import kernel


@kernel
def outcome(system, state):
    """Return wrench (6,) of the gripper on the DLO, elastic energy and all energy, J.

    The gripper is in the origin; `state.slope` is written over.
    """
    elastic = add_elastic(system.lengths, state.strains, system.natural, system.stiffness,
                          state.slope)
    load, _ = dead_load(system.pull, state.positions)
    wrench = np.empty(6)
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    return wrench, elastic, elastic + load
