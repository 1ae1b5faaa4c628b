"""The downhill simplex method of Nelder and Mead (paper, section 3.5), SciPy's.

It sees values only, so it cannot tell points apart that differ by the square root of the rounding
errors. It is restarted with a fresh simplex until that brings nothing more: a
simplex that has become flat stands still anywhere.
"""

import numpy as np
from scipy.optimize import minimize

from dlo_planner.minimize.protocol import Minimum

_RESTARTS = 10
_STANDING = 1e-6  # of problem.scale: the finest move that values alone can tell


def downhill_simplex(problem, q, tolerance, max_iterations=50_000):
    """Return the Minimum reached from `q` (n,).

    Args:
        problem: Problem; its gradient is not used
        q: where to start
        tolerance: a restart that moves q by less, relative to problem.scale, is the last
        max_iterations: steps of the simplex at most, all restarts together
    """
    iterations = evaluations = 0
    size = problem.scale
    for _ in range(_RESTARTS):
        simplex = q + size * np.vstack([np.zeros(q.size), np.eye(q.size)])
        found = minimize(problem.value, q, method='Nelder-Mead', options={
            'initial_simplex': simplex, 'adaptive': True, 'xatol': 1e-8 * problem.scale,
            'fatol': 1e-14 * problem.scale**2, 'maxiter': max_iterations - iterations,
            'maxfev': 100 * max_iterations})
        iterations += found.nit
        evaluations += found.nfev
        moved = np.linalg.norm(found.x - q)
        q = found.x
        if moved < max(tolerance, _STANDING) * problem.scale or iterations >= max_iterations:
            break
        size = np.clip(moved, 1e-3 * problem.scale, problem.scale)
    return Minimum(q, iterations, evaluations)
