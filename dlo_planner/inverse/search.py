"""Any task (paper, section 5.1): a gripper pose that makes a penalty of the shape least.

The paper's interlaced search: outside, the gripper's pose; inside, the direct simulation. The
outer search is SciPy's: least squares where the penalty is a sum of squares, else BFGS. Its
derivatives come from the sensitivities of the equilibrium, one factorisation each instead of a
dozen more equilibria.

A penalty is an object as in `inverse.penalties`, or a function of the shape: of (k,) numbers that
it returns the sum of the squares counts, a single number counts as it is. The slopes of a function
are differences between shapes that the sensitivities predict.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.model.checks import figure, flag, instance, integer, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put

_STILL = 1e-4       # slope per residual that counts as zero
_FLAT = 1e-5        # slope per 1 + penalty that counts as zero, where it is no sum of squares
_DIFFERENCE = 1e-6  # rad, and of the length


@dataclass(frozen=True, eq=False, repr=False)
class Found(Value):
    """Where the search ended.

    Attributes:
        gripper: Pose; shape: Shape there
        penalty: sum of the squared residuals, and of what is no residual
        slope: size of half its derivative by the gripper's pose, per rad and per length of the DLO
        iterations: equilibria computed
        converged: the slope is practically zero, and the shape is an equilibrium
    """

    gripper: Pose
    shape: Shape
    penalty: float
    slope: float
    iterations: int
    converged: bool

    def __post_init__(self):
        instance('Found.gripper', self.gripper, Pose)
        instance('Found.shape', self.shape, Shape)
        put(self, penalty=figure('Found.penalty', self.penalty),
            slope=figure('Found.slope', self.slope), converged=flag('Found.converged',
                                                                    self.converged),
            iterations=integer('Found.iterations', self.iterations, minimum=0, maximum=10**12))

    def __repr__(self):
        return brief(self, 'converged' if self.converged else 'not converged',
                     f'penalty {self.penalty:.3g}', f'slope {self.slope:.1g}',
                     f'{self.iterations} iterations', repr(self.gripper))


def minimise_penalty(simulator, penalties, start, *, initial=None,
                     max_iterations=200) -> Found:
    """Return the Found of a task given as penalties of the shape (paper, section 5.1).

    Args:
        simulator: DirectSimulator, with obstacles or without
        penalties: one or several, see above
        start: Pose of the gripper where the search begins
        initial: Shape near it; None: the natural shape is set down there
        max_iterations: equilibria at most

    Raises:
        InvalidTask: an argument makes no sense
        NotConverged: there is no equilibrium at the start
    """
    instance('simulator', simulator, DirectSimulator)
    instance('start', start, Pose)
    instance('initial', initial, Shape, optional=True)
    max_iterations = integer('max_iterations', max_iterations, minimum=1, maximum=1_000_000)
    penalties = list(penalties) if isinstance(penalties, list | tuple) else [penalties]
    for penalty in penalties:
        if not callable(penalty) and not hasattr(penalty, 'residuals'):
            raise InvalidTask(f'penalties: {shown(penalty)}: expected a penalty, or a function of '
                              'the shape')
    search = _Search(simulator, penalties, start, initial)
    if search.squares_only:
        found = least_squares(search.residuals, np.zeros(6), search.jacobian, x_scale=search.scale,
                              xtol=1e-11, ftol=1e-11, gtol=1e-12, max_nfev=max_iterations)
        x, penalty, slope = found.x, 2 * float(found.cost), found.grad * search.scale
        # SciPy also ends where it can step no farther, e.g. at the edge of what is stable
        enough = _STILL * (np.sqrt(penalty) + _STILL)
    else:
        found = minimize(lambda y: search.value(y * search.scale), np.zeros(6), method='BFGS',
                         jac=lambda y: search.gradient(y * search.scale) * search.scale,
                         options={'gtol': 1e-9, 'maxiter': max_iterations})
        x, penalty, slope = found.x * search.scale, float(found.fun), 0.5 * found.jac
        enough = _FLAT * (1 + abs(penalty))
    shape, slope = search.shape_at(x), float(np.linalg.norm(slope))
    return Found(shape.gripper, shape, penalty, slope, search.count,
                 bool(slope <= enough and shape.converged))


class _Search:
    """The penalties as functions of a twist (rotation, displacement) of the gripper since start."""

    def __init__(self, simulator, penalties, start, initial):
        self.simulator, self.penalties, self.start = simulator, penalties, start
        self.count, self._known = 0, {}
        self.scale = np.array([1.0] * 3 + [simulator.rod.length] * 3)
        shape = simulator.solve(start, initial)
        if not shape.converged:
            raise NotConverged('start: no equilibrium was found there', shape)
        self._last = shape
        self._known[np.zeros(6).tobytes()] = shape

    def shape_at(self, x):
        key = x.tobytes()
        if key not in self._known:
            turn = Rotation.from_rotvec(x[:3]).as_matrix()
            shape = self.simulator.solve(
                Pose.from_rotation(self.start.position + x[3:], turn @ self.start.rotation),
                self._last)
            self.count += 1
            if shape.converged:
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
        worse = 0.0 if shape.converged else 1e3 * self.scale[3]
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
        turn = _left_jacobian(x[:3])
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


def _left_jacobian(v):
    """Return (3, 3) the turn of exp(v) per change of v (Bullo and Murray 1995)."""
    angle = np.linalg.norm(v)
    if angle < 1e-6:
        return np.eye(3)
    across = np.cross(np.eye(3), v)  # the cross-product matrix of v
    return (np.eye(3) + (1 - np.cos(angle)) / angle**2 * across
            + (angle - np.sin(angle)) / angle**3 * across @ across)
