# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Davidon-Fletcher-Powell method (paper, section 3.5): Newton with a Hessian that is learnt.

The inverse Hessian starts as the identity, which in scaled unknowns it nearly is, and after each
step takes in what the change of the gradient tells (Fletcher and Powell 1963).
"""

import numpy as np

from dlo_planner.minimize.line_search import along
from dlo_planner.minimize.protocol import Ended

_LARGEST = 2.0  # of problem.scale: the longest step. Farther ones wind turns into a wire.


def dfp(problem, q, tolerance, most=10_000):
    """Return where the search Ended that begins with `q` (n,).

    Args:
        problem: Problem
        q: where to start
        tolerance: of the gradient's size, relative to that of q and problem.scale together
        most: evaluations after which no further step is made
    """
    evaluations = 1

    def look(at):
        nonlocal evaluations
        evaluations += 1
        return problem.value_and_gradient(at)

    inverse, known = np.eye(q.size), False
    value, gradient = problem.value_and_gradient(q)
    iterations = 0
    while evaluations < most and (np.linalg.norm(gradient)
                                  >= tolerance * np.hypot(np.linalg.norm(q), problem.scale)):
        direction = -inverse @ gradient
        if direction @ gradient >= 0:  # rounding has spoilt the update
            inverse, known, direction = np.eye(q.size), False, -gradient
        direction *= min(1.0, _LARGEST * problem.scale / np.linalg.norm(direction))
        found = along(look, q, direction, value, gradient, problem.noise)
        if found is None:
            if not known:
                break  # straight down there is nothing lower either
            inverse, known = np.eye(q.size), False
            continue
        new, value, slope = found
        step, change = new - q, slope - gradient
        q, gradient = new, slope
        iterations += 1
        if step @ change > 0:
            seen = inverse @ change
            inverse += (np.outer(step, step) / (step @ change)
                        - np.outer(seen, seen) / (change @ seen))
            known = True
    return Ended(q, iterations, evaluations)
