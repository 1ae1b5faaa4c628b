# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether what a search found from one start is what it would have found from another one."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import State, System, new_state
from dlo_planner.minimize.newton import newton
from dlo_planner.model.arrays import Floats

_TOLERANCE, _STEPS = 1e-11, 30  # residual and Newton steps of a way that is gone to its end
_CLOSE = 1e-9  # of the unknowns: what two searches for one minimum may leave between them


def lower(system: System, one: Floats, other: Floats) -> bool:
    """Whether the potential is lower at unknowns `one` (m, 3) than at `other`."""
    state: State = new_state(system)
    values: list[float] = []
    for q in (one, other):
        state.q[:] = q
        values.append(evaluate(system, state)[0])
    return values[0] < values[1]


def leads_to(system: System, start: Floats, end: Floats) -> tuple[bool, int, bool]:
    """Return whether Newton's method goes from `start` to `end` (m, 3), its steps, and if it leant.

    It has to go all the way. One step and the Hessian there do not tell: that of what yields jumps,
    and beyond an unstable shape minima lie close together.
    """
    minimum = newton(system, start, _TOLERANCE, _STEPS, False)
    away = np.linalg.norm(minimum.state.q - end)
    arrived = minimum.residual < _TOLERANCE and away <= _CLOSE * np.linalg.norm(end)
    return bool(arrived), minimum.iterations, bool(minimum.kicks)
