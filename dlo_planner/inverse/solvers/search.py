# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Any task (paper, section 5.1): a gripper pose that makes a penalty of the shape least.

The paper's interlaced search: outside, the gripper's pose; inside, the direct simulation. The
outer search is SciPy's: least squares where the penalty is a sum of squares, else BFGS. Its
derivatives come from the sensitivities of the equilibrium, one factorization each instead of a
dozen more equilibria.

A penalty is an object as in `inverse.penalties`, or a function of the shape: of (k,) numbers that
it returns the sum of the squares counts, a single number counts as it is. The slopes of a function
are differences between shapes that the sensitivities predict.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, minimize

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.model.checks import flag, instance, integer, number, shown
from dlo_planner.model.computed import figure
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.value import Value, brief, put
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.ritz.arc import jacobians

# What counts as zero, all per rad and per length of the DLO:
_STILL = 1e-4       # slope of residuals, as a part of their size times that of their derivatives
_FLAT = 1e-5        # slope of a number, as a part of what a step of the gripper changes
_STEP = 0.1         # rad, and of the length: that step
_DIFFERENCE = 1e-6  # rad, and of the length
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
        The slope is practically zero for what the penalties are, and the shape is an equilibrium.
    """

    gripper: Pose
    shape: Shape
    penalty: float
    slope: float
    iterations: int
    converged: bool

    def __post_init__(self):
        instance('PenaltyResult.gripper', self.gripper, Pose)
        instance('PenaltyResult.shape', self.shape, Shape)
        put(self, penalty=figure('PenaltyResult.penalty', self.penalty),
            slope=figure('PenaltyResult.slope', self.slope),
            converged=flag('PenaltyResult.converged', self.converged),
            iterations=integer('PenaltyResult.iterations', self.iterations, minimum=0,
                               maximum=10**12))

    def __repr__(self):
        return brief(self, 'converged' if self.converged else 'not converged',
                     f'penalty {self.penalty:.3g}', f'slope {self.slope:.1g}',
                     f'{self.iterations} iterations', repr(self.gripper))


def minimize_penalty(simulator: DirectSimulator, penalties: object, start: Pose, *,
                     initial: Shape | None = None, max_iterations: int = 200,
                     progress: OnProgress = None, deadline: float | None = None) -> PenaltyResult:
    """Return the PenaltyResult of a task given as penalties of the shape (paper, section 5.1).

    Where the past counts (a DLO that yields, friction), each pose is judged as if the gripper went
    there straight from `start`.

    Parameters
    ----------
    simulator : DirectSimulator
        With obstacles or without.
    penalties : object
        One or several penalties, see above.
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
    asked = _Asked(judged_penalties(penalties), integer('max_iterations', max_iterations,
                                                        minimum=1, maximum=1_000_000))
    return least_penalty(simulator, asked, start, initial, Progress(progress, deadline))


@dataclass(frozen=True)
class _Asked:
    penalties: list
    max_iterations: int


def least_penalty(simulator: DirectSimulator, asked: object, start: Pose, initial: Shape | None,
                  progress: Progress) -> PenaltyResult:
    """Return the PenaltyResult of `penalties` in `max_iterations` at most, both of `asked`."""
    if simulator.strains != 'components':
        raise InvalidTask(f'simulator.strains = {simulator.strains!r}: expected \'components\', '
                          'whose sensitivities guide the search')
    instance('initial', initial, Shape, optional=True)
    if initial is not None and initial.far_end is not None:
        raise InvalidTask('initial is held at its far end: expected a Shape whose far end is free, '
                          'as it is in the search')
    _check_lengths(asked.penalties, simulator.rod.length)
    most = asked.max_iterations
    search = _Search(simulator, list(asked.penalties), start, initial, progress, most)
    return search.of_squares(most) if search.squares_only else search.of_numbers(most)


def judged_penalties(penalties: object) -> list:
    """Return one penalty or several as a list; raise InvalidTask for what is none."""
    penalties = list(penalties) if isinstance(penalties, list | tuple) else [penalties]
    if not penalties:
        raise InvalidTask('penalties = []: expected one at least, something to minimize')
    for penalty in penalties:
        if not callable(penalty) and not hasattr(penalty, 'residuals'):
            raise InvalidTask(f'penalties: {shown(penalty)} is neither a function nor has '
                              'residuals')
    return penalties


def _check_lengths(penalties: list, length: float) -> None:
    """Raise InvalidTask where an arc length of a penalty is beyond the DLO."""
    for penalty in penalties:
        for name in getattr(penalty, 'ARC_LENGTHS', ()):
            number(f'{type(penalty).__name__}.{name}', getattr(penalty, name), minimum=0,
                   maximum=length)


class _Search:
    """The penalties as functions of a twist (rotation, displacement) of the gripper since start.

    SciPy's tolerances are absolute: it gets twists per rad and length, and penalties divided by
    what the gripper changes of them.
    """

    def __init__(self, simulator, penalties, start, initial, progress=None, most=0):
        self.simulator, self.penalties, self.start = simulator, penalties, start
        self.count, self._known = 0, {}
        self._progress, self._most = progress or Progress(), most
        self.scale = np.array([1.0] * 3 + [simulator.rod.length] * 3)
        shape = simulator.solve(start, initial)
        if not shape.converged:
            raise NotConverged('start: no equilibrium was found there', shape)
        self._last, self._worse = shape, 0.0
        self._depends_on_the_way = simulator.rod.yields or any(
            obstacle.friction for obstacle in simulator.obstacles)
        self._known[np.zeros(6).tobytes()] = shape

    def of_squares(self, most):
        """Return the PenaltyResult where the sum of the squared residuals is least."""
        unit = self._size_of_slopes(np.zeros(6)) or 1.0
        self._worse = _WORSE * (unit + np.linalg.norm(self.residuals(np.zeros(6))))
        found = least_squares(lambda y: self.residuals(y * self.scale) / unit, np.zeros(6),
                              lambda y: self.jacobian(y * self.scale) * self.scale / unit,
                              xtol=1e-11, ftol=1e-11, gtol=1e-12, max_nfev=most)
        x, size = found.x * self.scale, np.sqrt(2 * found.cost) * unit
        slope, typical = np.linalg.norm(found.grad) * unit**2, self._size_of_slopes(x)
        # SciPy also ends where it can step no farther, e.g. at the edge of what is stable
        return self._found(x, size**2, slope, _STILL * typical * (size + _STILL * typical))

    def of_numbers(self, most):
        """Return the PenaltyResult where the penalty, which is no sum of squares, is least."""
        unit = self._change(np.zeros(6)) or 1.0
        self._worse = _WORSE * (unit + abs(self.value(np.zeros(6))))
        found = minimize(lambda y: self.value(y * self.scale) / unit, np.zeros(6), method='BFGS',
                         jac=lambda y: self.gradient(y * self.scale) * self.scale / unit,
                         options={'gtol': 1e-9, 'maxiter': most})
        x = found.x * self.scale
        return self._found(x, found.fun * unit, 0.5 * unit * np.linalg.norm(found.jac),
                           _FLAT * self._change(x))

    def _found(self, x, penalty, slope, enough):
        shape = self.shape_at(x)
        return PenaltyResult(shape.gripper, shape, float(penalty), float(slope), self.count,
                     bool(slope <= enough and shape.converged))

    def _size_of_slopes(self, x):
        """Return the size of all derivatives of the residuals, per rad and per length."""
        return float(np.linalg.norm(self.jacobian(x) * self.scale))

    def _change(self, x):
        """Return how much the penalty changes per step of the gripper, by predicted shapes."""
        sensitivity, here = Sensitivity(self.shape_at(x)), self.value(x)
        changes = [abs(_total(self.penalties, sensitivity.moved(step)) - here)
                   for step in _STEP * np.vstack([np.diag(self.scale), -np.diag(self.scale)])]
        return float(np.max(changes, initial=0.0, where=np.isfinite(changes))) / _STEP

    def shape_at(self, x):
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
    def squares_only(self):
        """Whether no penalty is a single number that counts as it is."""
        return all(hasattr(penalty, 'residuals') or np.ndim(_of(penalty, self._last))
                   for penalty in self.penalties)

    def residuals(self, x):
        """Return (k,): of all penalties whose squares count."""
        return self._values(x)[0]

    def jacobian(self, x):
        """Return (k, 6) derivatives of the residuals by x."""
        return self._slopes(x)[0]

    def value(self, x):
        """Return the whole penalty."""
        squares, plain = self._values(x)
        return float(squares @ squares + plain.sum())

    def gradient(self, x):
        """Return (6,), of the whole penalty by x."""
        squares, plain = self._slopes(x)
        return 2 * squares.T @ self._values(x)[0] + plain.sum(axis=0)

    def _values(self, x):
        """Return residuals (k,) and the penalties (m,) that are numbers."""
        shape = self.shape_at(x)
        squares, plain = [np.zeros(0)], [np.zeros(0)]
        for penalty in self.penalties:
            value = np.asarray(_of(penalty, shape), dtype=float)
            if not np.isfinite(value).all():
                raise InvalidTask(f'penalties: expected finite numbers, got {value.tolist()}')
            (squares if value.ndim else plain).append(value.ravel())
        # where there is no equilibrium, it is worse than anywhere else
        worse = 0.0 if shape.converged else self._worse
        return np.concatenate(squares) + worse, np.concatenate(plain) + worse

    def _slopes(self, x):
        """Return the derivatives (k, 6) and (m, 6) of what `_values` returns."""
        shape = self.shape_at(x)
        sensitivity = Sensitivity(shape)
        squares, plain = [np.zeros((0, 6))], [np.zeros((0, 6))]
        for penalty in self.penalties:
            if hasattr(penalty, 'slopes'):
                squares.append(penalty.slopes(shape, sensitivity))
                continue
            steps = _DIFFERENCE * np.diag(self.scale)
            columns = [(np.asarray(_of(penalty, sensitivity.moved(step)), dtype=float)
                        - _of(penalty, sensitivity.moved(-step))) / (2 * step.sum())
                       for step in steps]
            (squares if np.ndim(columns[0]) else plain).append(np.column_stack(
                [np.ravel(column) for column in columns]))
        # a change of the rotation vector turns the gripper by its left Jacobian
        turn = left_jacobian(x[:3])
        return tuple(np.hstack([rows[:, :3] @ turn, rows[:, 3:]])
                     for rows in (np.vstack(squares), np.vstack(plain)))


def _of(penalty, shape):
    if hasattr(penalty, 'residuals'):
        return penalty.residuals(shape)
    try:
        return np.asarray(penalty(shape), dtype=float)
    except Exception as error:  # it is somebody else's function: any may come
        raise InvalidTask(f'penalties: {shown(penalty)} raised {type(error).__name__}: '
                          f'{shown(str(error))}') from error


def _total(penalties, shape):
    """Return the whole penalty of a Shape."""
    values = [np.asarray(_of(penalty, shape), dtype=float) for penalty in penalties]
    return sum(float(np.sum(value**2 if value.ndim else value)) for value in values)


def left_jacobian(v):
    """Return (3, 3) the turn of exp(v) per change of v (Bullo and Murray 1995)."""
    turning, _ = jacobians(float(v[0]), float(v[1]), float(v[2]), 1.0)
    return np.reshape(turning, (3, 3))
