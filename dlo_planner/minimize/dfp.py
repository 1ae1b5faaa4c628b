# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Davidon-Fletcher-Powell method (paper, section 3.5): Newton with a Hessian that is learnt.

The inverse Hessian starts as the identity, which in scaled unknowns it nearly is, and after each
step takes in what the change of the gradient tells (Fletcher and Powell 1963).
"""

from __future__ import annotations

import numpy as np

from dlo_planner.minimize.line_search import Point, along
from dlo_planner.minimize.protocol import Ended, Problem
from dlo_planner.model.arrays import Floats

_LARGEST = 2.0  # of problem.scale: the longest step. Farther ones wind turns into a wire.


def dfp(problem: Problem, q: Floats, tolerance: float, most: int = 10_000) -> Ended:
    """Return where the search Ended that begins with `q`.

    Parameters
    ----------
    problem : Problem
        The function.
    q : ndarray, shape (n,)
        Start.
    tolerance : float
        Largest size of the gradient at the end, relative to that of q and problem.scale together.
    most : int, optional
        Evaluations after which no further step is made.
    """
    evaluations = 1

    def look(q: Floats) -> tuple[float, Floats]:
        nonlocal evaluations
        evaluations += 1
        return problem.value_and_gradient(q)

    inverse, updated = np.eye(q.size), False
    point = Point(q, *problem.value_and_gradient(q))
    iterations = 0
    while evaluations < most and (np.linalg.norm(point.gradient)
                                  >= tolerance * np.hypot(np.linalg.norm(point.q), problem.scale)):
        direction = -inverse @ point.gradient
        if direction @ point.gradient >= 0:  # rounding has spoilt the update
            inverse, updated, direction = np.eye(q.size), False, -point.gradient
        direction *= min(1.0, float(_LARGEST * problem.scale / np.linalg.norm(direction)))
        lower = along(look, point, direction, problem.noise)
        if lower is None:
            if not updated:
                break  # straight down there is nothing lower either
            inverse, updated = np.eye(q.size), False
            continue
        step, change = lower.q - point.q, lower.gradient - point.gradient
        point = lower
        iterations += 1
        if step @ change > 0:
            turned = inverse @ change
            inverse += (np.outer(step, step) / (step @ change)
                        - np.outer(turned, turned) / (change @ turned))
            updated = True
    return Ended(point.q, iterations, evaluations)
