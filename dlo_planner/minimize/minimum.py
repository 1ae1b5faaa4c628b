# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a minimizer returns."""

from typing import NamedTuple

from dlo_planner.energy.system import State, System


class Minimum(NamedTuple):
    """Where a descent ended, and what proves it to be a minimum, or not.

    Attributes
    ----------
    state : State
        State there.
    residual : float
        Size of the scaled gradient.
    stability : float
        Smallest eigenvalue of the Hessian, on what a grip leaves free; nan: not known.
    iterations : int
        Newton steps made, or those of another method.
    kicks : int
        How often a saddle was left.
    system : System
        System with the multipliers of its constraints as they are at the end.
    violation : float
        By how much a constraint is violated, m.
    evaluations : int
        Evaluations of the potential, where the method counts them.
    """

    state: State
    residual: float
    stability: float
    iterations: int
    kicks: int
    system: System
    violation: float = 0.0
    evaluations: int = 0
