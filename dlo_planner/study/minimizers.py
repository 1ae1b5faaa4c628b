# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's two minimizers (section 3.5), and how they come to end in a minimum.

`dfp`, Davidon, Fletcher and Powell: Newton's method with a Hessian that is learnt. The inverse
starts as the identity, which in scaled unknowns it nearly is, and after each step takes in what the
change of the gradient tells (Fletcher and Powell 1963). Its line search goes by slopes: near a
minimum values differ by the square of the way to it, and drown in rounding errors long before the
gradient does. So values only have to be no higher than the first one by more than their rounding
errors (the approximate Wolfe conditions of Hager and Zhang 2005).

`downhill_simplex`, Nelder and Mead. The simplex is SciPy's. Its first edges are the axes of a
quadratic surface through values about the start, each as long as raises the potential alike: an
even simplex turns flat in a long valley. It compares values, so it cannot tell points apart that
differ by the square root of the rounding errors. The end is therefore that of the original method
(Nelder and Mead 1965, appendix): the lowest point of a quadratic surface through values about the
simplex. Where there is none, or it is not near, the simplex is set up anew.

Both stop where the gradient vanishes, which may be a saddle. What they reach is judged as what
Newton's method reaches, and a saddle is left in the same way: perturbed along its lowest mode.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy

from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import Configuration, Problem, bending_energy, new_configuration
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.minimize.newton import MOST_KICKS, NEUTRAL, Descent, descend, leave_saddle
from dlo_planner.model.arrays import Floats
from dlo_planner.progress import uninterrupted


class Objective(NamedTuple):
    """A function of unknowns q (n,), scaled so that its natural curvature is about 1."""

    value: Callable[[Floats], float]  # q -> J
    value_and_gradient: Callable[[Floats], tuple[float, Floats]]  # q -> (J, (n,))
    scale: float        # of q that is neither small nor large, sqrt(J)
    noise: float = 0.0  # rounding errors of the value, J, but for those in proportion to it


class Ended(NamedTuple):
    """Where a minimizer ended."""

    q: Floats         # (n,) unknowns there
    iterations: int
    evaluations: int  # of the function, with or without its gradient


_EXACT = 0.1      # of the slope may be left; with less care than this, DFP goes astray
_FALL = 1e-4      # of what the slope promises: so much lower it has to be at least
_BELOW_NOISE = 100.0   # times the rounding errors: differences of values below this are noise
_FARTHER_LEAST, _FARTHER = 1.1, 4.0  # times the way so far, where it still falls
_LESS = 0.9       # of the slope: what is left where no point is better
_LEAST, _MOST = 0.1, 0.9  # of the interval: where the next point may be
_TRIALS = 30
_EPS = 2.2e-16


class Point(NamedTuple):
    """Unknowns q (n,), value in J and gradient (n,) of a function there."""

    q: Floats
    value: float
    gradient: Floats


def hager_zhang_search(look: Callable[[Floats], tuple[float, Floats]], start: Point,
                       direction: Floats, noise: float) -> Point | None:
    """Return a lower Point on a line, about where its slope vanishes; None if none is lower.

    Shapes: direction (n,).
    """
    below_noise = _BELOW_NOISE * (noise + _EPS * abs(start.value))
    first = float(start.gradient @ direction)
    lower = 0.0, first  # fractions and slopes of points between which it is lowest
    upper: tuple[float, float | None] | None = None
    best: Point | None = None
    flattest, fraction = np.inf, 1.0
    for _ in range(_TRIALS):
        q = start.q + fraction * direction
        point = Point(q, *look(q))
        slope = float(point.gradient @ direction)
        if not point.value <= start.value + _FALL * fraction * first + below_noise:
            upper = fraction, None
        elif abs(slope) <= -_EXACT * first:
            return point
        else:
            if best is None or abs(slope) < flattest:
                flattest, best = abs(slope), point
            if slope > 0:
                upper = fraction, slope
            else:
                lower = fraction, slope
        fraction = _next(lower, upper, first)
        if upper is not None and upper[0] - lower[0] < 1e-12 * upper[0]:
            break
    if best is None or flattest > -_LESS * first and not best.value < start.value - below_noise:
        return None
    return best


def _next(lower: tuple[float, float], upper: tuple[float, float | None] | None,
          first: float) -> float:
    """Return the fraction to look at between two points, or beyond the lower one."""
    begin, slope = lower
    if upper is None:  # where a parabola has its lowest point, if it has one there
        part = first / (first - slope) if slope > first else np.inf
        return min(max(part, _FARTHER_LEAST), _FARTHER) * begin
    end, rise = upper
    part = 0.5 if rise is None else slope / (slope - rise)
    return begin + min(max(part, _LEAST), _MOST) * (end - begin)


_LARGEST = 2.0  # of problem.scale: the longest step. Farther ones wind turns into a wire.


def dfp(problem: Objective, q: Floats, tolerance: float, most: int = 10_000) -> Ended:
    """Return where the search Ended that begins with `q`.

    Shapes: q (n,).
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
        lower = hager_zhang_search(look, point, direction, problem.noise)
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


_RESTARTS = 10
_ROUGHLY = 1e-4, 1e-8  # of the scale and its square: what a simplex has come down to
_SURFACES = 16
_NEARER = 0.7     # of the step before: one that is longer is made of rounding errors
_FLAT = 1e-3      # curvatures nearer to zero than this are not told from it
_EDGE = 2e-5      # of the size: long against rounding errors, short against the third derivative
_STEPS = 6e-4, 2e-5, 2e-6  # of the size: the same for the fifth; and where curvatures jump
_SLIGHT = 1e-2    # of the size: within which a surface tells the axes
_SHORTEST = 1e-3  # of the scale: edges of a simplex that is set up anew
_BELOW_NOISE_DIFFERENCE = 3.0  # rounding errors of a difference
_FINEST = 1e-7    # of the size: a last step that rounding errors may make

_Function: TypeAlias = Callable[[Floats], float]  # q (n,) -> J


def downhill_simplex(problem: Objective, q: Floats, tolerance: float,
                     most: int = 2_000_000) -> Ended:
    """Return where the search Ended that begins with `q`.

    Shapes: q (n,).
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


def _settled(problem: Objective, value: _Function, q: Floats,
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


def _agree(problem: Objective, value: _Function, q: Floats, step: float, closer: float) -> bool:
    """Whether slopes from two steps differ by no more than rounding errors make of it."""
    rounding = (problem.noise + _EPS * abs(value(q))) / closer
    return bool(np.linalg.norm(slope(value, q, step) - slope(value, q, closer))
                <= _BELOW_NOISE_DIFFERENCE * rounding * np.sqrt(q.size))


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


SEARCHES: dict[str, Callable[..., Ended]] = {'dfp': dfp, 'downhill_simplex': downhill_simplex}


def search(system: Problem, q: Floats, method: str, tolerance: float) -> Minimum:
    """Descend from q to a minimum of the potential, as `minimize.newton.newton` does.

    Shapes: q (m, 3).
    """
    problem = problem_of(system)
    iterations = evaluations = kicks = 0
    while True:
        end = SEARCHES[method](problem, q.ravel().copy(), tolerance)
        iterations, evaluations = iterations + end.iterations, evaluations + end.evaluations
        reached = descend(system, end.q.reshape(q.shape), tolerance, 0, True)
        perturbed = saddle_exit_point(system, reached)
        if perturbed is None or kicks >= MOST_KICKS:
            return Minimum(reached.state, reached.residual, reached.stability, iterations, kicks,
                           system, evaluations=evaluations)
        q, kicks = perturbed, kicks + 1


def approximate(system: Problem, q: Floats, method: str, tolerance: float,
                most: int) -> tuple[Floats, int]:
    """Return strains (N, 3) on the way from q to a minimum, and the work that it took.

    Nothing is said of them: they are where others begin.

    Shapes: q (m, 3).
    """
    if method == 'newton':
        descent = descend(system, q, tolerance, most, False)
        return descent.state.strains, descent.iterations
    end = SEARCHES[method](problem_of(system), q.ravel().copy(), tolerance, most)
    state: Configuration = new_configuration(system)
    state.q[:] = end.q.reshape(q.shape)
    evaluate(system, state)
    return state.strains, end.evaluations


def problem_of(system: Problem) -> Objective:
    """Return the Objective of the potential of a Problem, its unknowns in one row."""
    state: Configuration = new_configuration(system)

    def value(flat: Floats) -> float:
        state.q[:] = flat.reshape(state.q.shape)
        energy: float = uninterrupted(evaluate(system, state)[0])
        return energy

    def value_and_gradient(flat: Floats) -> tuple[float, Floats]:
        return value(flat), state.gradient.ravel().copy()

    return Objective(value, value_and_gradient, np.sqrt(bending_energy(system)), rounding(system))


def rounding(system: Problem) -> float:
    """Return the rounding errors of the potential in J, but for those in proportion to it."""
    weight = np.linalg.norm(system.load.pull, axis=1).sum()
    return float(_EPS * (weight * system.lengths.sum() + bending_energy(system)))


def saddle_exit_point(system: Problem, reached: Descent) -> Floats | None:
    """Return unknowns (m, 3) beside a saddle, on the way down; None at a minimum."""
    q = np.empty_like(reached.mode)
    falls = reached.stability <= -NEUTRAL and leave_saddle(system, reached.state, reached.mode, q)
    return q if falls else None
