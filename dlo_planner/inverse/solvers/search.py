# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Any task (paper, section 5.1): a gripper pose that minimizes a penalty of the shape.

The paper's interlaced search: outside, the gripper's pose; inside, the direct simulation. The
outer search is SciPy's: least squares where the penalty is a sum of squares, else BFGS. Its
derivatives come from the sensitivities of the equilibrium, one factorization each instead of a
dozen more equilibria.

The penalties, their values and derivatives: `inverse.solvers.penalty_function`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.optimize import least_squares, minimize

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.solvers.penalty_function import Penalty, PenaltyFunction
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import figure, flag, instance, integer, number, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.requirements import STABILITY
from dlo_planner.progress import OnProgress, Progress

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
        One or several penalties, see `inverse.solvers.penalty_function`.
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
    task = _Penalties(judged_penalties(penalties), integer('max_iterations', max_iterations,
                                                           minimum=1, maximum=1_000_000))
    return least_penalty(simulator, task, start, initial, Progress(progress, deadline))


class PenaltyTask(Protocol):
    """What the search needs of a task; `Minimize` has it."""

    @property
    def penalties(self) -> Sequence[Penalty]:
        """One or several penalties."""

    @property
    def max_iterations(self) -> int:
        """Equilibria at most."""


@dataclass(frozen=True)
class _Penalties:
    """A PenaltyTask that is no Task."""

    penalties: list[Penalty]
    max_iterations: int


def least_penalty(simulator: DirectSimulator, task: PenaltyTask, start: Pose,
                  initial: Shape | None, progress: Progress,
                  stability: float = STABILITY) -> PenaltyResult:
    """Return the PenaltyResult of a PenaltyTask whose search begins at the Pose `start`.

    It is converged with that `stability` at least.
    """
    if simulator.strains != 'components':
        raise InvalidTask(f'simulator.strains = {simulator.strains!r}: expected \'components\', '
                          'whose sensitivities guide the search')
    instance('initial', initial, Shape, optional=True)
    if initial is not None and initial.far_end is not None:
        raise InvalidTask('initial is held at its far end: expected a Shape whose far end is free, '
                          'as it is in the search')
    _check_lengths(task.penalties, simulator.rod.length)
    most = task.max_iterations
    function = PenaltyFunction(simulator, list(task.penalties), start, initial, progress, most)
    found = (_least_squares if function.squares_only else _least_number)(function, most)
    return found if found.shape.stability >= stability else replace(found, converged=False)


def judged_penalties(penalties: object) -> list[Penalty]:
    """Return one penalty or several as a list; raise InvalidTask for what is none."""
    judged: list[Any] = list(penalties) if isinstance(penalties, list | tuple) else [penalties]
    if not judged:
        raise InvalidTask('penalties = []: expected one at least, something to minimize')
    for penalty in judged:
        if not callable(penalty) and not hasattr(penalty, 'residuals'):
            raise InvalidTask(f'penalties: {shown(penalty)} is neither a function nor has '
                              'residuals')
    return judged


def _check_lengths(penalties: Sequence[Penalty], length: float) -> None:
    """Raise InvalidTask where an arc length of a penalty is beyond the DLO."""
    for penalty in penalties:
        for name in getattr(penalty, 'ARC_LENGTHS', ()):
            number(f'{type(penalty).__name__}.{name}', getattr(penalty, name), minimum=0,
                   maximum=length)


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
