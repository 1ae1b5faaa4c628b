# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What every minimizer that sees nothing but a function takes and gives."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Problem:
    """A function of unknowns q (n,), scaled so that its natural curvature is about 1.

    Attributes:
        value: q -> J
        value_and_gradient: q -> (J, (n,))
        scale: size of q that is neither small nor large, sqrt(J)
        noise: rounding errors of the value, J, but for those in proportion to it
    """

    value: Callable
    value_and_gradient: Callable
    scale: float
    noise: float = 0.0


@dataclass(frozen=True)
class Ended:
    """Where a minimizer ended.

    Attributes:
        q: (n,)
        iterations: steps made; evaluations: of the function, with or without its gradient
    """

    q: np.ndarray
    iterations: int
    evaluations: int
