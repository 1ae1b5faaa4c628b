"""The downhill simplex method of Nelder and Mead (paper, section 3.5).

The simplex is SciPy's. It is restarted with a fresh one until that brings nothing more, because a
simplex that has become flat stands still anywhere. It compares values, so it cannot tell points
apart that differ by the square root of the rounding errors. The end is therefore that of the
original method (Nelder and Mead 1965, appendix): a quadratic surface through the values at the
corners of a small simplex and at the middles of its edges, whose lowest point is the minimum to
some 2/3 of all digits.
"""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize

from dlo_planner.minimize.protocol import Minimum

_RESTARTS = 10
_STANDING = 1e-6  # of problem.scale: the finest move that values alone can tell
_SURFACES = 8
_EDGE = 2e-5      # of the size: long against rounding errors, short against the third derivative


def downhill_simplex(problem, q, tolerance, max_iterations=50_000):
    """Return the Minimum reached from `q` (n,).

    Args:
        problem: Problem; its gradient is not used
        q: where to start
        tolerance: a step that moves q by less, relative to q and problem.scale, is the last
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
    q, used = _settled(problem, q, tolerance)
    return Minimum(q, iterations, evaluations + used)


def _settled(problem, q, tolerance):
    """Return the lowest point (n,) of the quadratic surfaces from q on, and the values used."""
    used, before = 0, np.inf
    for _ in range(_SURFACES):
        size = np.hypot(np.linalg.norm(q), problem.scale)
        gradient, hessian = quadratic_surface(problem.value, q, _EDGE * size)
        used += (q.size + 1) * (q.size + 2) // 2
        try:
            step = -cho_solve(cho_factor(hessian), gradient)
        except LinAlgError:  # no minimum of a surface: what the simplex found stands
            break
        moved = np.linalg.norm(step) / size
        if not moved < 0.5 * before:
            break
        q, before = q + step, moved
        if moved < tolerance:
            break
    return q, used


def quadratic_surface(value, q, edge):
    """Return gradient (n,) and Hessian (n, n) at q (n,) of a quadratic through values about it.

    They are taken at the corners of a simplex, q and q + `edge` along each axis, and at the
    middles of all edges.
    """
    n, axes = q.size, 0.5 * edge * np.eye(q.size)
    here = value(q)
    corners = np.array([value(q + 2 * axis) for axis in axes]) - here
    halves = np.array([value(q + axis) for axis in axes]) - here
    hessian = np.diag(4 * corners - 8 * halves)
    for i in range(n):
        for j in range(i):
            middle = value(q + axes[i] + axes[j]) - here
            hessian[i, j] = hessian[j, i] = 4 * (middle - halves[i] - halves[j])
    return (4 * halves - corners) / edge, hessian / edge**2
