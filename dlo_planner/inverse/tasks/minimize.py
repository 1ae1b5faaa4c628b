# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Any task (paper, section 5.1): a gripper pose that minimizes a penalty of the shape.

The paper's interlaced search: outside, the gripper's pose; inside, the direct simulation. The
outer search is SciPy's: least squares where the penalty is a sum of squares, else BFGS. Its
derivatives come from the sensitivities of the equilibrium, one factorization each instead of a
dozen more equilibria.

A penalty is an object as in `plan.goals`, or a function of the shape: of (k,) numbers that it
returns the sum of the squares counts, a single number counts itself. The slopes of a function are
differences between shapes that the sensitivities predict.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, minimize

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import figure, flag, instance, integer, number, shown
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.goals import Residuals
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.requirements import STABILITY
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.progress import OnProgress, Progress, interrupted_by

# An object as in `plan.goals`, whose `slopes` may be missing, or a function of a Shape.
Penalty: TypeAlias = Residuals | Callable[[Shape], ArrayLike]

_STEP = 0.1         # rad, and of the length: that step
_DIFFERENCE = 1e-6  # rad, and of the length


class PenaltyFunction:
    """The penalties as functions of a twist x (6,) of the gripper since `start`.

    A twist is a rotation vector, rad, before a displacement, m, in world axes. At the start there
    has to be an equilibrium, else NotConverged is raised.
    """

    def __init__(self, simulator: DirectSimulator, penalties: list[Penalty], start: Pose,
                 initial: Shape | None = None, progress: Progress | None = None,
                 most: int = 0) -> None:
        self.simulator, self.penalties, self.start = simulator, penalties, start
        self.count = 0  # equilibria computed
        self._known: dict[bytes, Shape] = {}
        self._progress, self._most = progress or Progress(), most
        # what counts as one in a twist: 1 rad, and the length of the DLO, m
        self.scale = np.array([1.0] * 3 + [simulator.rod.length] * 3)
        shape = simulator.solve(start, initial)
        if not shape.converged:
            raise NotConverged('start: no equilibrium was found there', shape)
        self._last, self.worse = shape, 0.0  # added to every penalty without an equilibrium
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


# What counts as zero, all per rad and per length of the DLO:
_STILL = 1e-4       # slope of residuals, as a part of their size times that of their derivatives
_FLAT = 1e-5        # slope of a number, as a part of what a step of the gripper changes
_WORSE = 1e3        # what has no equilibrium is worse than anything seen by so much


@dataclass(frozen=True, eq=False, repr=False)
class PenaltyResult(Value):
    """Where the search ended.

    Attributes
    ----------
    gripper : Pose
    shape : Shape
        Shape there.
    penalty : float
        Sum of the squared residuals, and of the terms that are not residuals.
    slope : float
        Size of half its derivative by the gripper's pose, per rad and per length of the DLO.
    iterations : int
        Equilibria computed.
    converged : bool
        The slope is practically zero for what the penalties are, and the shape is an equilibrium
        that stands: its stability is at least 3e-4, or what the requirements of a plan say.
    """

    gripper: Pose
    shape: Shape
    penalty: float
    slope: float
    iterations: int
    converged: bool

    def __post_init__(self) -> None:
        instance('PenaltyResult.gripper', self.gripper, Pose)
        instance('PenaltyResult.shape', self.shape, Shape)
        put(self, penalty=figure('PenaltyResult.penalty', self.penalty),
            slope=figure('PenaltyResult.slope', self.slope),
            converged=flag('PenaltyResult.converged', self.converged),
            iterations=integer('PenaltyResult.iterations', self.iterations, minimum=0,
                               maximum=10**12))

    def __repr__(self) -> str:
        return brief(self, 'converged' if self.converged else 'not converged',
                     f'penalty {self.penalty:.3g}', f'slope {self.slope:.1g}',
                     f'{self.iterations} iterations', repr(self.gripper))


def minimize_penalty(simulator: DirectSimulator, penalties: Penalty | Sequence[Penalty],
                     start: Pose, *, initial: Shape | None = None, max_iterations: int = 200,
                     progress: OnProgress = None, deadline: float | None = None) -> PenaltyResult:
    """Return the PenaltyResult of a task given as penalties of the shape (paper, section 5.1).

    If the result depends on the path (a DLO that yields, friction), each pose is judged as if the
    gripper went there straight from `start`.

    Parameters
    ----------
    simulator : DirectSimulator
        With obstacles or without.
    penalties : object
        One or several penalties, see `inverse.tasks.minimize`.
    start : Pose
        Pose of the gripper where the search begins.
    initial : Shape, optional
        Shape near it, its far end free. If None, the natural shape is set down there.
    max_iterations : int, optional
        Equilibria at most.
    progress : callable, optional
        Called as progress(done, max_iterations) after each equilibrium.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense.
    NotConverged
        There is no equilibrium at the start.
    DeadlineExceeded
        The deadline is over.
    """
    clamping('simulator', simulator)
    instance('start', start, Pose)
    return least_penalty(simulator, Minimize(penalties, max_iterations), start, initial,
                         Progress(progress, deadline))


def least_penalty(simulator: DirectSimulator, task: Minimize, start: Pose,
                  initial: Shape | None, progress: Progress,
                  stability: float = STABILITY) -> PenaltyResult:
    """Return the PenaltyResult of a Minimize whose search begins at the Pose `start`.

    It is converged with that `stability` at least.
    """
    if simulator.strains != 'components':
        raise InvalidTask(f'simulator.strains = {simulator.strains!r}: expected \'components\', '
                          'whose sensitivities guide the search')
    instance('initial', initial, Shape, optional=True)
    if initial is not None and initial.far_end is not None:
        raise InvalidTask('initial is held at its far end: expected a Shape whose far end is free, '
                          'as it is in the search')
    if initial is not None and initial.holds:
        raise InvalidTask(f'initial is held by {shown(initial.holds)}: expected a Shape that the '
                          'gripper alone holds, as it is in the search')
    for penalty in task.penalties:  # arc lengths are on the DLO
        for name in getattr(penalty, 'ARC_LENGTHS', ()):
            number(f'{type(penalty).__name__}.{name}', getattr(penalty, name), minimum=0,
                   maximum=simulator.rod.length)
    most = task.max_iterations
    function = PenaltyFunction(simulator, list(task.penalties), start, initial, progress, most)
    with interrupted_by(progress.check):
        found = (_least_squares if function.squares_only else _least_number)(function, most)
    return found if found.shape.stability >= stability else replace(found, converged=False)


def _least_squares(function: PenaltyFunction, most: int) -> PenaltyResult:
    """Return the PenaltyResult where the sum of the squared residuals is least.

    SciPy's tolerances are absolute: it gets twists per rad and length, and penalties divided by
    what the gripper changes of them.
    """
    scale, begin = function.scale, np.zeros(6)
    unit = function.size_of_slopes(begin) or 1.0
    function.worse = _WORSE * (unit + float(np.linalg.norm(function.residuals(begin))))
    optimum = least_squares(lambda y: function.residuals(y * scale) / unit, begin,
                            lambda y: function.jacobian(y * scale) * scale / unit,
                            xtol=1e-11, ftol=1e-11, gtol=1e-12, max_nfev=most)
    x, size = optimum.x * scale, np.sqrt(2 * optimum.cost) * unit
    slope, typical = float(np.linalg.norm(optimum.grad)) * unit**2, function.size_of_slopes(x)
    # SciPy also ends where it can step no farther, e.g. at the edge of what is stable
    enough = _STILL * typical * (size + _STILL * typical)
    return _result(function, x, size**2, slope, slope <= enough)


def _least_number(function: PenaltyFunction, most: int) -> PenaltyResult:
    """Return the PenaltyResult where the penalty, which is no sum of squares, is least."""
    scale, begin = function.scale, np.zeros(6)
    unit = function.change(begin) or 1.0
    function.worse = _WORSE * (unit + abs(function.value(begin)))
    optimum = minimize(lambda y: function.value(y * scale) / unit, begin, method='BFGS',
                       jac=lambda y: function.gradient(y * scale) * scale / unit,
                       options={'gtol': 1e-9, 'maxiter': most})
    x, slope = optimum.x * scale, 0.5 * unit * float(np.linalg.norm(optimum.jac))
    return _result(function, x, optimum.fun * unit, slope, slope <= _FLAT * function.change(x))


def _result(function: PenaltyFunction, x: Floats, penalty: float, slope: float,
            flat: bool) -> PenaltyResult:
    shape = function.shape_at(x)
    return PenaltyResult(shape.gripper, shape, float(penalty), slope, function.count,
                         bool(flat and shape.converged))


@dataclass(frozen=True, eq=False, repr=False)
class Minimize(Task):
    """Minimize penalties of the shape, beginning at `start`; see `minimize_penalty`.

    Attributes
    ----------
    penalties : tuple
        One or several: values like `PositionAt`, or functions of a Shape.
    max_iterations : int
        Equilibria at most.
    """

    touches: ClassVar[bool] = True
    takes_initial: ClassVar[bool] = True

    penalties: tuple[Penalty, ...]
    max_iterations: int = 200

    if TYPE_CHECKING:  # what may be given
        def __init__(self, penalties: Penalty | Sequence[Penalty],
                     max_iterations: int = 200) -> None: ...

    def __post_init__(self) -> None:
        several = isinstance(self.penalties, list | tuple)
        penalties: tuple[Any, ...] = tuple(self.penalties) if several else (self.penalties,)
        if not penalties:
            raise InvalidTask('penalties = []: expected one at least, something to minimize')
        for penalty in penalties:
            if not callable(penalty) and not hasattr(penalty, 'residuals'):
                raise InvalidTask(f'penalties: {shown(penalty)} is neither a function nor has '
                                  'residuals')
        put(self, penalties=penalties,
            max_iterations=integer('max_iterations', self.max_iterations, minimum=1,
                                   maximum=1_000_000))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan of one waypoint, at the minimum of the penalty.

        Raises
        ------
        NotConverged
            The search did not converge.
        Infeasible
            It ended at a shape that breaks a demand, or hardly stands.
        """
        instance('context', context, PlanContext)
        result = self.result(context)
        hardly = result.shape.stability < context.requirements.stability  # the builder refuses it
        if not (result.converged or hardly and result.shape.converged):
            raise NotConverged(f'penalties: the search ended with a slope of {result.slope:.3g} '
                               f'after {result.iterations} iterations', result.shape)
        builder = context.builder([0.0])
        builder.add(Waypoint(result.shape))
        return builder.finished()

    def result(self, context: PlanContext) -> PenaltyResult:
        """Return the PenaltyResult, converged or not."""
        instance('context', context, PlanContext)
        return least_penalty(context.simulator, self, instance('start', context.start, Pose),
                             context.initial, context.progress, context.requirements.stability)
