# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What every minimizer that sees nothing but a function takes and gives."""

from collections.abc import Callable
from dataclasses import dataclass

from dlo_planner.model.arrays import Floats


@dataclass(frozen=True)
class Problem:
    """A function of unknowns q (n,), scaled so that its natural curvature is about 1.

    Attributes
    ----------
    value : callable
        q -> J.
    value_and_gradient : callable
        q -> (J, (n,)).
    scale : float
        Size of q that is neither small nor large, sqrt(J).
    noise : float
        Rounding errors of the value, J, but for those in proportion to it.
    """

    value: Callable[[Floats], float]
    value_and_gradient: Callable[[Floats], tuple[float, Floats]]
    scale: float
    noise: float = 0.0


@dataclass(frozen=True)
class Ended:
    """Where a minimizer ended.

    Attributes
    ----------
    q : ndarray, shape (n,)
        Unknowns there.
    iterations : int
        Steps made.
    evaluations : int
        Evaluations of the function, with or without its gradient.
    """

    q: Floats
    iterations: int
    evaluations: int
