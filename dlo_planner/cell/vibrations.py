# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Small vibrations of a chain: what its engine says of its stiffness and mass."""

from typing import Any

import numpy as np

from dlo_planner.cell.engine import mujoco
from dlo_planner.model.arrays import Floats

_DIFFERENCE = 1e-5  # rad, step of difference quotients


def linear(model: Any, data: Any) -> tuple[Floats, Floats]:
    """Return the stiffness and mass matrices of the joints about a state at rest.

    The stiffness is a difference quotient of the joints' forces.
    """
    size = model.nv - 6
    mujoco.mj_forward(model, data)
    mass = np.zeros((size, model.nv))
    for k in range(size):
        unit = np.zeros(model.nv)
        unit[6 + k] = 1
        mujoco.mj_mulM(model, data, mass[k], unit)
    rest, stiffness = data.qpos.copy(), np.zeros((size, size))
    for k in range(size):
        forces = []
        for sign in (1, -1):
            data.qpos[:] = rest
            data.qpos[7 + k] += sign * _DIFFERENCE
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            forces.append(data.qfrc_bias[6:] - data.qfrc_passive[6:])
        stiffness[k] = (forces[0] - forces[1]) / (2 * _DIFFERENCE)
    return 0.5 * (stiffness + stiffness.T), mass[:, 6:]
