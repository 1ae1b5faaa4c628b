# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is told of an equilibrium of a DLO that hangs freely, besides its strains and frames."""

import numpy as np

from dlo_planner.energy.effects import potential, stored
from dlo_planner.kernels import kernel


@kernel
def outcome(system, state):
    """Return wrench (6,) of the gripper in the origin on the DLO, elastic and all energy, J."""
    elastic = stored(system.effects, system, state.strains)
    load = potential(system.effects, system, state.positions)
    wrench = np.empty(6)
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    return wrench, elastic, elastic + load
