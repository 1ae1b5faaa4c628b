# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shape of least penalty within reach of the gripper: a step that cannot leap.

Gauss and Newton's method on the penalties' residuals, the gripper kept in a ball about where it was
(a fixed trust region: Nocedal and Wright, Numerical Optimization, ch. 4). If the minimum is farther
away, the step goes towards it as far as the ball allows. Where much is missed, these steps come
nearer by the same part each: the next ones follow from two of them (Anderson 1965, J. ACM 12).
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.penalty import Residuals
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import displaced

ITERATIONS = 25
STILL = 1e-9     # rad, and of the length: a step that ends the search
ENOUGH = 1e-6    # relative decrease of the penalty that ends it as well
HARDLY, SMALL = 1e-8, 1e-4  # the same, and a part of what is within reach: not worth a step
HALVINGS = 6


class Near(NamedTuple):
    """A Shape, and its Sensitivity if that is known already."""

    shape: Shape
    sensitivity: Sensitivity | None = None


def nearest_within(simulator: DirectSimulator, penalty: Residuals, begin: Near, turn: float,
                   shift: float) -> Near | None:
    """Return the Shape of least penalty whose gripper is within reach, or None.

    Parameters
    ----------
    simulator : DirectSimulator
    penalty : Residuals
        With `residuals` and `slopes`, see `inverse.penalties`.
    begin : Near
        Shape where the step begins.
    turn : float
        Angle by which the gripper may turn, rad, about.
    shift : float
        Distance by which it may be displaced, about, m.
    """
    scale = np.array([turn] * 3 + [shift] * 3)
    shape, sensitivity = before, _ = begin
    x, right = np.zeros(6), penalty.residuals(before)
    value, last = float(right @ right), None
    for _ in range(ITERATIONS):
        sensitivity = sensitivity or Sensitivity(shape)
        rows = penalty.slopes(shape, sensitivity) * scale
        step = step_within_ball(rows, right, x)
        left = rows @ step + right
        size = np.abs(step).max()
        if size < STILL / turn or value - left @ left < HARDLY * value and size < SMALL:
            break  # it is there
        for taken in steps_to_try(step, x, last):
            trial = simulator.solve(displaced(before.gripper, scale * (x + taken)), shape)
            ahead = penalty.residuals(trial)
            new = float(ahead @ ahead) if trial.converged else np.inf
            if new <= value:
                break
        else:
            return Near(shape, sensitivity) if shape is not before else None
        last, step = (step, taken), taken
        done = (np.abs(step).max() < STILL / turn
                or value - new < ENOUGH * value and np.abs(step).max() < 1e-3)
        shape, x, value, right, sensitivity = trial, x + step, new, ahead, None
        if done:
            break
    return Near(shape, sensitivity)


def steps_to_try(step: Floats, x: Floats,
                 last: tuple[Floats, Floats] | None) -> Iterator[Floats]:
    """Yield steps (6,) from x (6,): the extrapolated one, the step itself, halves of it.

    Parameters
    ----------
    last : (ndarray, ndarray) or None
        The step before, and what was taken in its place.
    """
    if last is not None:
        further = extrapolated(step, *last)
        if np.linalg.norm(x + further) <= 1.0:
            yield further
    yield from (0.5**k * step for k in range(HALVINGS))


@kernel
def extrapolated(step: Floats, before: Floats, taken: Floats) -> Floats:
    """Return the step (6,) to where steps would vanish if they changed as from the one before.

    Parameters
    ----------
    step, before : ndarray, shape (6,)
        The step here, and the one before.
    taken : ndarray, shape (6,)
        The way from there to here.
    """
    change = step - before
    size = np.dot(change, change)
    share = np.dot(change, step) / size if size > 0.0 else 0.0
    return step - share * (taken + change)


@kernel
def step_within_ball(rows: Floats, right: Floats, x: Floats) -> Any:
    """Return the step (6,) that minimizes |rows step + right| with |x + step| <= 1.

    The multiplier of the constraint is found by bisection, along the axes of the quadratic form.
    """
    square = np.dot(rows.T, rows)
    large = max(np.trace(square), 1e-300)
    sizes, axes = np.linalg.eigh(square + 1e-12 * large * np.eye(6))
    slope, where = np.dot(axes.T, np.dot(rows.T, right)), np.dot(axes.T, x)
    if _reach(sizes, slope, where, 0.0) <= 1.0:
        return np.dot(axes, -slope / sizes)
    low, high = 0.0, large
    while _reach(sizes, slope, where, high) > 1.0:
        high *= 10.0
    for _ in range(60):
        middle = 0.5 * (low + high) if low > 0.0 else 0.01 * high
        if _reach(sizes, slope, where, middle) > 1.0:
            low = middle
        else:
            high = middle
    return np.dot(axes, (-slope - high * where) / (sizes + high))


@kernel
def _reach(sizes: Floats, slope: Floats, where: Floats, multiplier: float) -> Any:
    """Return how far from the middle of the ball a step with this multiplier ends."""
    total = 0.0
    for i in range(sizes.size):
        total += ((sizes[i] * where[i] - slope[i]) / (sizes[i] + multiplier)) ** 2
    return np.sqrt(total)
