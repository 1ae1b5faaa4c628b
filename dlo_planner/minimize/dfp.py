"""The Davidon-Fletcher-Powell method (paper, section 3.5): Newton with a Hessian that is learnt.

The inverse Hessian starts as the identity, which in scaled unknowns it nearly is, and after each
step takes in what the change of the gradient tells (Fletcher and Powell 1963). The line search is
SciPy's (strong Wolfe conditions), so that the update stays positive definite.
"""

from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.optimize import line_search

from dlo_planner.minimize.protocol import Minimum

_EXACT = 0.1  # of the slope is left by a line search; with less care than this, DFP goes astray


def dfp(problem, q, tolerance, max_iterations=2000):
    """Return the Minimum reached from `q` (n,).

    Args:
        problem: Problem
        q: where to start
        tolerance: of the gradient's size, relative to that of q and problem.scale together
        max_iterations: steps at most
    """
    counts = {'evaluations': 0}
    known = {}

    def both(at):
        key = at.tobytes()
        if key not in known:
            counts['evaluations'] += 1
            known.clear()
            known[key] = problem.value_and_gradient(at)
        return known[key]

    inverse = np.eye(q.size)
    value, gradient = both(q)
    iterations = 0
    while iterations < max_iterations:
        if np.linalg.norm(gradient) < tolerance * np.hypot(np.linalg.norm(q), problem.scale):
            break
        direction = -inverse @ gradient
        if direction @ gradient >= 0:  # rounding has spoilt the update: learn anew
            inverse = np.eye(q.size)
            direction = -gradient
        # At most half of the usual size in one step: far steps wind turns into a wire.
        direction *= min(1.0, 2 * problem.scale / np.linalg.norm(direction))
        with catch_warnings():
            simplefilter('ignore', RuntimeWarning)  # a failure is dealt with here
            fraction = line_search(lambda at: both(at)[0], lambda at: both(at)[1], q, direction,
                                   gradient, value, c2=_EXACT, maxiter=30)[0]
        if fraction is None:  # the gain drowns in rounding errors: the full step is the best guess
            fraction = 1.0
            if np.linalg.norm(both(q + direction)[1]) >= np.linalg.norm(gradient):
                break
        step = fraction * direction
        value, new = both(q + step)
        change = new - gradient
        q, gradient = q + step, new
        iterations += 1
        if step @ change > 0:
            seen = inverse @ change
            inverse += (np.outer(step, step) / (step @ change)
                        - np.outer(seen, seen) / (change @ seen))
    return Minimum(q, iterations, counts['evaluations'])
