# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shape of least penalty within reach of the gripper: a step that cannot leap.

Gauss and Newton's method on the penalties' residuals, the gripper kept in a ball about where it was
(a fixed trust region: Nocedal and Wright, Numerical Optimization, ch. 4). If the minimum is farther
away, the step goes towards it as far as the ball allows.
"""

from collections.abc import Sequence

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.penalty import Residuals
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import displaced

_ITERATIONS = 25
_STILL = 1e-9     # rad, and of the length: a step that ends the search
_ENOUGH = 1e-6    # relative decrease of the penalty that ends it as well
_HALVINGS = 6


def nearest_within(simulator: DirectSimulator, penalties: Sequence[Residuals], before: Shape,
                   turn: float, shift: float) -> Shape | None:
    """Return the Shape of least penalty whose gripper is within reach, or None.

    Parameters
    ----------
    simulator : DirectSimulator
    penalties : sequence of Residuals
        Values with `residuals` and `slopes`, see `inverse.penalties`.
    before : Shape
        Shape where the step begins.
    turn : float
        Angle by which the gripper may turn, rad, about.
    shift : float
        Distance by which it may be displaced, about, m.
    """
    scale = np.array([turn] * 3 + [shift] * 3)
    shape, x, right = before, np.zeros(6), _residuals(penalties, before)
    value = float(right @ right)
    for _ in range(_ITERATIONS):
        sensitivity = Sensitivity(shape)
        rows = np.vstack([penalty.slopes(shape, sensitivity) for penalty in penalties]) * scale
        step = _step_within_ball(rows, right, x)
        for _ in range(_HALVINGS):
            trial = simulator.solve(displaced(before.gripper, scale * (x + step)), shape)
            ahead = _residuals(penalties, trial)
            new = float(ahead @ ahead) if trial.converged else np.inf
            if new <= value:
                break
            step = 0.5 * step
        else:
            return shape if shape is not before else None
        done = (np.abs(step).max() < _STILL / turn
                or value - new < _ENOUGH * value and np.abs(step).max() < 1e-3)
        shape, x, value, right = trial, x + step, new, ahead
        if done:
            return shape
    return shape


def _residuals(penalties: Sequence[Residuals], shape: Shape) -> Floats:
    return np.concatenate([penalty.residuals(shape) for penalty in penalties])


def _step_within_ball(rows: Floats, right: Floats, x: Floats) -> Floats:
    """Return the step (6,) that minimizes |rows step + right| with |x + step| <= 1.

    The multiplier of the constraint is found by bisection.
    """
    left, square = rows.T @ right, rows.T @ rows
    weak = 1e-12 * max(np.trace(square), 1e-300) * np.eye(6)

    def step(multiplier: float) -> Floats:
        return np.linalg.solve(square + weak + multiplier * np.eye(6), -left - multiplier * x)

    if np.linalg.norm(x + step(0.0)) <= 1:
        return step(0.0)
    low, high = 0.0, max(np.trace(square), 1e-300)
    while np.linalg.norm(x + step(high)) > 1:
        high *= 10
    for _ in range(40):
        middle = 0.5 * (low + high) if low else 0.01 * high
        low, high = (middle, high) if np.linalg.norm(x + step(middle)) > 1 else (low, middle)
    return step(high)
