# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The downhill simplex method of Nelder and Mead (paper, section 3.5).

The simplex is SciPy's. Its first edges are the axes of a quadratic surface through values about
the start, each as long as raises the potential alike: an even simplex turns flat in a long valley.
It compares values, so it cannot tell points apart that differ by the square root of the rounding
errors. The end is therefore that of the original method (Nelder and Mead 1965, appendix): the
lowest point of a quadratic surface through values about the simplex. Where there is none, or it is
not near, the simplex is set up anew.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import scipy

from dlo_planner.minimize.protocol import Ended, Problem
from dlo_planner.model.arrays import Floats

_RESTARTS = 10
_ROUGHLY = 1e-4, 1e-8  # of the scale and its square: what a simplex has come down to
_SURFACES = 16
_NEARER = 0.7     # of the step before: one that is longer is made of rounding errors
_FLAT = 1e-3      # curvatures nearer to zero than this are not told from it
_EDGE = 2e-5      # of the size: long against rounding errors, short against the third derivative
_STEPS = 6e-4, 2e-5, 2e-6  # of the size: the same for the fifth; and where curvatures jump
_SLIGHT = 1e-2    # of the size: within which a surface tells the axes
_SHORTEST = 1e-3  # of the scale: edges of a simplex that is set up anew
_UNTOLD, _EPS = 3.0, 2.2e-16  # rounding errors of a difference, of a number
_FINEST = 1e-7    # of the size: a last step that rounding errors may make

_Function: TypeAlias = Callable[[Floats], float]  # q (n,) -> J


def downhill_simplex(problem: Problem, q: Floats, tolerance: float,
                     most: int = 2_000_000) -> Ended:
    """Return where the search Ended that begins with `q`.

    Parameters
    ----------
    problem : Problem
        The function; its gradient is not used.
    q : ndarray, shape (n,)
        Start.
    tolerance : float
        A step that moves q by less, relative to q and problem.scale, is the last one.
    most : int, optional
        Evaluations after which no further simplex is set up, and one comes to its end.
    """
    iterations = evaluations = 0

    def value(q: Floats) -> float:
        nonlocal evaluations
        evaluations += 1
        return problem.value(q)

    size = problem.scale
    for _ in range(_RESTARTS):
        simplex = q + size * np.vstack([np.zeros(q.size), _axes(value, q, problem.scale)])
        lowest = scipy.optimize.minimize(value, q, method='Nelder-Mead', options={
            'initial_simplex': simplex, 'adaptive': True, 'xatol': _ROUGHLY[0] * problem.scale,
            'fatol': _ROUGHLY[1] * problem.scale**2, 'maxiter': most,
            'maxfev': max(1, most - evaluations)})
        iterations += lowest.nit
        moved = np.linalg.norm(lowest.x - q)
        q, settled = _settled(problem, value, lowest.x, tolerance)
        if settled or evaluations >= most:
            break
        size = float(np.clip(moved, _SHORTEST * problem.scale, problem.scale))
    return Ended(q, iterations, evaluations)


def _axes(value: _Function, q: Floats, scale: float) -> Floats:
    """Return rows (n, n): edges that raise the potential like a unit edge does one of curvature 1.

    Where it curves less than the elastic energy does, they are no longer than that.
    """
    _, hessian = quadratic_surface(value, q, _SLIGHT * scale)
    curvature, axes = np.linalg.eigh(hessian)
    edges: Floats = (axes / np.sqrt(np.maximum(np.abs(curvature), 1.0))).T
    return edges


def _settled(problem: Problem, value: _Function, q: Floats,
             tolerance: float) -> tuple[Floats, bool]:
    """Return the lowest point (n,) of quadratic surfaces from q on, and if it is the minimum.

    Values tell a smooth function's slope best from afar. Where its curvatures jump, as those of
    what yields do, they have to be close: so near that rounding errors hide the difference.
    """
    before, finer = float('inf'), iter(_STEPS)
    step = next(finer)
    for _ in range(_SURFACES):
        size = np.hypot(np.linalg.norm(q), problem.scale)
        _, hessian = quadratic_surface(value, q, _EDGE * size)
        curvature, axes = np.linalg.eigh(hessian)
        if curvature[0] < -_FLAT:  # the surface has no lowest point
            return q, False
        along = axes.T @ slope(value, q, step * size)
        move = -axes @ (along / np.maximum(curvature, _FLAT))
        moved = float(np.linalg.norm(move) / size)
        nearer = moved < _NEARER * before
        if nearer:
            q, before = q + move, moved
        if nearer and moved >= tolerance:
            continue
        closer = next(finer, None)
        if closer is None or _agree(problem, value, q, step * size, closer * size):
            return q, bool(moved < _FINEST)
        before, step = np.inf, closer
    return q, False


def _agree(problem: Problem, value: _Function, q: Floats, step: float, closer: float) -> bool:
    """Whether slopes from two steps differ by no more than rounding errors make of it."""
    rounding = (problem.noise + _EPS * abs(value(q))) / closer
    return bool(np.linalg.norm(slope(value, q, step) - slope(value, q, closer))
                <= _UNTOLD * rounding * np.sqrt(q.size))


def slope(value: _Function, q: Floats, edge: float) -> Floats:
    """Return the gradient (n,) at q (n,), of fourth order, from four values on each axis."""
    gradient = np.empty(q.size)
    for i in range(q.size):
        axis = np.zeros(q.size)
        axis[i] = edge
        near, far = (value(q + k * axis) - value(q - k * axis) for k in (1, 2))
        gradient[i] = (8 * near - far) / (12 * edge)
    return gradient


def quadratic_surface(value: _Function, q: Floats, edge: float) -> tuple[Floats, Floats]:
    """Return gradient (n,) and Hessian (n, n) at q (n,) of a quadratic through values about it.

    They are taken at the corners of a simplex, q and q + `edge` along each axis, and at the
    middles of all edges.
    """
    n, axes = q.size, 0.5 * edge * np.eye(q.size)
    middle = value(q)
    corners = np.array([value(q + 2 * axis) for axis in axes]) - middle
    halves = np.array([value(q + axis) for axis in axes]) - middle
    hessian = np.diag(4 * corners - 8 * halves)
    for i in range(n):
        for j in range(i):
            half = value(q + axes[i] + axes[j]) - middle
            hessian[i, j] = hessian[j, i] = 4 * (half - halves[i] - halves[j])
    return (4 * halves - corners) / edge, hessian / edge**2
