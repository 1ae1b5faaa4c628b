# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The arrays of a descent, made once for many of them."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.system import State, new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.linear import Hessian, new_hessian
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.record import Record


class Workspace(Record):
    """Arrays that a descent refills; what it returns are some of them.

    Attributes
    ----------
    state, trial : State
        Where it is, and where it looks.
    hessian : Hessian
        The Hessian at `state`.
    start, step : ndarray, shape (m, 3)
        Unknowns where it begins, and a change of them.
    """

    state: State
    trial: State
    hessian: Hessian
    start: Floats
    step: Floats


@kernel
def new_workspace(system):
    """Return an empty Workspace of the right sizes."""
    state = new_state(system)
    return Workspace(state, new_state(system), new_hessian(system), np.empty_like(state.q),
                     np.empty_like(state.q))
