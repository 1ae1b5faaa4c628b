# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The penalties of a task as a function of the gripper's pose, with its derivatives.

A penalty is an object as in `plan.goals`, or a function of the shape: of (k,) numbers that
it returns the sum of the squares counts, a single number counts itself. The slopes of a function
are differences between shapes that the sensitivities predict.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.plan.goals import Residuals
from dlo_planner.progress import Progress

# An object as in `plan.goals`, whose `slopes` may be missing, or a function of a Shape.
Penalty: TypeAlias = Residuals | Callable[[Shape], ArrayLike]

_STEP = 0.1         # rad, and of the length: that step
_DIFFERENCE = 1e-6  # rad, and of the length


class PenaltyFunction:
    """The penalties as functions of a twist x (6,) of the gripper since `start`.

    A twist is a rotation vector, rad, before a displacement, m, in world axes.

    Parameters
    ----------
    simulator : DirectSimulator
    penalties : list of Penalty
    start : Pose
        Pose of the gripper where the search begins.
    initial : Shape, optional
        Shape near it. If None, the natural shape is set down there.
    progress : Progress, optional
        Takes a report after each equilibrium.
    most : int, optional
        Equilibria at most, for the reports.

    Attributes
    ----------
    scale : ndarray, shape (6,)
        What counts as one in a twist: 1 rad, and the length of the DLO, m.
    count : int
        Equilibria computed.
    worse : float
        What is added to every penalty where there is no equilibrium.

    Raises
    ------
    NotConverged
        There is no equilibrium at the start.
    """

    def __init__(self, simulator: DirectSimulator, penalties: list[Penalty], start: Pose,
                 initial: Shape | None = None, progress: Progress | None = None,
                 most: int = 0) -> None:
        self.simulator, self.penalties, self.start = simulator, penalties, start
        self.count = 0
        self._known: dict[bytes, Shape] = {}
        self._progress, self._most = progress or Progress(), most
        self.scale = np.array([1.0] * 3 + [simulator.rod.length] * 3)
        shape = simulator.solve(start, initial)
        if not shape.converged:
            raise NotConverged('start: no equilibrium was found there', shape)
        self._last, self.worse = shape, 0.0
        self._depends_on_the_way = simulator.rod.yields or any(
            obstacle.friction for obstacle in simulator.obstacles)
        self._known[np.zeros(6).tobytes()] = shape

    def size_of_slopes(self, x: Floats) -> float:
        """Return the size of all derivatives of the residuals, per rad and per length."""
        return float(np.linalg.norm(self.jacobian(x) * self.scale))

    def change(self, x: Floats) -> float:
        """Return how much the penalty changes per step of the gripper, by predicted shapes."""
        sensitivity, value = Sensitivity(self.shape_at(x)), self.value(x)
        changes = [abs(_total(self.penalties, sensitivity.moved(step)) - value)
                   for step in _STEP * np.vstack([np.diag(self.scale), -np.diag(self.scale)])]
        return float(np.max(changes, initial=0.0, where=np.isfinite(changes))) / _STEP

    def shape_at(self, x: Floats) -> Shape:
        """Return the Shape of the gripper displaced by x; the last four are remembered."""
        key = x.tobytes()
        if key not in self._known:
            shape = self.simulator.solve(displaced(self.start, x), self._last)
            self.count += 1
            self._progress.done(min(self.count, self._most), self._most)
            if shape.converged and not self._depends_on_the_way:
                self._last = shape
            self._known = {**dict(list(self._known.items())[-3:]), key: shape}
        return self._known[key]

    @property
    def squares_only(self) -> bool:
        """Whether no penalty is a single number that counts as it is."""
        return all(hasattr(penalty, 'residuals') or np.ndim(value_of(penalty, self._last))
                   for penalty in self.penalties)

    def residuals(self, x: Floats) -> Floats:
        """Return (k,): of all penalties whose squares count."""
        return self._values(x)[0]

    def jacobian(self, x: Floats) -> Floats:
        """Return (k, 6) derivatives of the residuals by x."""
        return self._slopes(x)[0]

    def value(self, x: Floats) -> float:
        """Return the whole penalty."""
        squares, plain = self._values(x)
        return float(squares @ squares + plain.sum())

    def gradient(self, x: Floats) -> Floats:
        """Return (6,), of the whole penalty by x."""
        squares, plain = self._slopes(x)
        slope: Floats = 2 * squares.T @ self._values(x)[0] + plain.sum(axis=0)
        return slope

    def _values(self, x: Floats) -> tuple[Floats, Floats]:
        """Return residuals (k,) and the penalties (m,) that are numbers."""
        shape = self.shape_at(x)
        squares, plain = [np.zeros(0)], [np.zeros(0)]
        for penalty in self.penalties:
            value = np.asarray(value_of(penalty, shape), dtype=float)
            if not np.isfinite(value).all():
                raise InvalidTask(f'penalties: expected finite numbers, got {value.tolist()}')
            (squares if value.ndim else plain).append(value.ravel())
        # where there is no equilibrium, it is worse than anywhere else
        worse = 0.0 if shape.converged else self.worse
        return np.concatenate(squares) + worse, np.concatenate(plain) + worse

    def _slopes(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives (k, 6) and (m, 6) of what `_values` returns."""
        shape = self.shape_at(x)
        sensitivity = Sensitivity(shape)
        squares, plain = [np.zeros((0, 6))], [np.zeros((0, 6))]
        for penalty in self.penalties:
            if hasattr(penalty, 'slopes'):
                squares.append(penalty.slopes(shape, sensitivity))
                continue
            steps = _DIFFERENCE * np.diag(self.scale)
            columns = [(np.asarray(value_of(penalty, sensitivity.moved(step)), dtype=float)
                        - value_of(penalty, sensitivity.moved(-step))) / (2 * step.sum())
                       for step in steps]
            (squares if np.ndim(columns[0]) else plain).append(np.column_stack(
                [np.ravel(column) for column in columns]))
        # a change of the rotation vector turns the gripper by its left Jacobian
        turn = left_jacobian(x[:3])
        by_residuals, by_numbers = (np.hstack([rows[:, :3] @ turn, rows[:, 3:]])
                                    for rows in (np.vstack(squares), np.vstack(plain)))
        return by_residuals, by_numbers


def value_of(penalty: Penalty, shape: Shape) -> Floats:
    """Return the residuals (k,) of a penalty, or the number () that it is."""
    if hasattr(penalty, 'residuals'):
        return penalty.residuals(shape)
    try:
        return np.asarray(penalty(shape), dtype=float)
    except Exception as error:  # it is somebody else's function: any may come
        raise InvalidTask(f'penalties: {shown(penalty)} raised {type(error).__name__}: '
                          f'{shown(str(error))}') from error


def _total(penalties: list[Penalty], shape: Shape) -> float:
    """Return the whole penalty of a Shape."""
    values = [np.asarray(value_of(penalty, shape), dtype=float) for penalty in penalties]
    return sum(float(np.sum(value**2 if value.ndim else value)) for value in values)
