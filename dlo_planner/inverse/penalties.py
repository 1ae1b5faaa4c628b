"""Any task (paper, section 5.1): a gripper pose that makes a penalty of the shape least.

The paper's interlaced search: outside, the gripper's pose; inside, the direct simulation. The
outer search is SciPy's least squares; its derivatives come from the sensitivities of the
equilibrium, one factorisation each instead of six more equilibria.

A penalty is an object with  residuals(shape) -> (k,)  and  slopes(shape, sensitivity) -> (k, 6),
derivatives by rotation and displacement of the gripper; or a function of the shape that returns a
number or (k,) numbers, whose slopes are then found by differences. The sum of the squares counts.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.model.checks import number, vector
from dlo_planner.model.pose import Pose

_STILL = 1e-4       # slope per residual that counts as zero
_DIFFERENCE = 1e-6  # rad, and of the length


@dataclass(frozen=True)
class PositionAt:
    """The DLO's point at arc length s (m) lies at `target` (3,) m; weight 1/m."""

    s: float
    target: np.ndarray
    weight: float = 1.0

    def residuals(self, shape):
        """Return (3,)."""
        return self.weight * (shape.frame_at(self.s)[1] - np.asarray(self.target))

    def slopes(self, shape, sensitivity):
        """Return (3, 6)."""
        del shape
        return self.weight * sensitivity.at(self.s)[3:]


@dataclass(frozen=True)
class DirectionAt:
    """The DLO's tangent at arc length s (m) is along `direction` (3,); weight 1/rad."""

    s: float
    direction: np.ndarray
    weight: float = 1.0

    def residuals(self, shape):
        """Return (3,): the difference of two unit vectors."""
        return self.weight * (shape.frame_at(self.s)[0][:, 0] - self._unit())

    def slopes(self, shape, sensitivity):
        """Return (3, 6)."""
        tangent = shape.frame_at(self.s)[0][:, 0]
        return self.weight * np.cross(sensitivity.at(self.s)[:3].T, tangent).T

    def _unit(self):
        direction = vector('DirectionAt.direction', self.direction, 3)
        return direction / np.linalg.norm(direction)


@dataclass(frozen=True)
class GripperNear:
    """The gripper stays near a pose: weak, it makes an answer unique that is not.

    Attributes:
        pose: Pose; weight: 1/m of displacement and 1/rad of rotation
    """

    pose: Pose
    weight: float = 1e-3

    def residuals(self, shape):
        """Return (6,)."""
        turn = Rotation.from_matrix(shape.gripper.rotation @ self.pose.rotation.T).as_rotvec()
        away = shape.gripper.position - self.pose.position
        return self.weight * np.concatenate([turn, away])

    def slopes(self, shape, sensitivity):
        """Return (6, 6); the rotation's to first order about the pose."""
        del shape, sensitivity
        return self.weight * np.eye(6)


@dataclass(frozen=True, eq=False)
class Found:
    """Where the search ended.

    Attributes:
        gripper: Pose; shape: Shape there
        penalty: sum of the squared residuals
        slope: size of half its derivative by the gripper's pose, per rad and per length of the DLO
        iterations: equilibria computed
        converged: the slope is practically zero, and the shape is an equilibrium
    """

    gripper: Pose
    shape: object
    penalty: float
    slope: float
    iterations: int
    converged: bool


def minimise_penalty(simulator, penalties, start, *, initial=None, max_iterations=200):
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
    if not isinstance(start, Pose):
        raise InvalidTask(f'start = {start!r}: expected a Pose')
    number('max_iterations', max_iterations, minimum=1)
    penalties = list(penalties) if isinstance(penalties, list | tuple) else [penalties]
    for penalty in penalties:
        if not callable(penalty) and not hasattr(penalty, 'residuals'):
            raise InvalidTask(f'penalties: {penalty!r} is neither a function nor has residuals')
    search = _Search(simulator, penalties, start, initial)
    found = least_squares(search.residuals, np.zeros(6), search.jacobian, x_scale=search.scale,
                          xtol=1e-11, ftol=1e-11, gtol=1e-12, max_nfev=int(max_iterations))
    shape = search.shape_at(found.x)
    slope = float(np.linalg.norm(found.grad * search.scale))
    # SciPy also ends where it can step no farther, e.g. at the edge of what is stable
    still = slope <= _STILL * (np.sqrt(2 * found.cost) + _STILL)
    return Found(shape.gripper, shape, 2 * float(found.cost), slope, search.count,
                 bool(still and shape.converged))


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

    def residuals(self, x):
        shape = self.shape_at(x)
        values = [np.ravel(penalty.residuals(shape) if hasattr(penalty, 'residuals')
                           else penalty(shape)) for penalty in self.penalties]
        values = np.concatenate(values).astype(float)
        if not np.isfinite(values).all():
            raise InvalidTask('penalties: expected finite numbers, got '
                              f'{values[~np.isfinite(values)].tolist()}')
        # where there is no equilibrium, it is worse than anywhere else
        return values if shape.converged else values + 1e3 * self.scale[3]

    def jacobian(self, x):
        shape = self.shape_at(x)
        sensitivity = Sensitivity(shape)
        rows = []
        for penalty in self.penalties:
            if hasattr(penalty, 'slopes'):
                rows.append(penalty.slopes(shape, sensitivity))
            else:
                rows.append(self._differences(penalty, shape))
        by_twist = np.vstack(rows)
        # a change of the rotation vector turns the gripper by its left Jacobian
        return np.hstack([by_twist[:, :3] @ _left_jacobian(x[:3]), by_twist[:, 3:]])

    def _differences(self, penalty, shape):
        columns = []
        for k in range(6):
            step = np.zeros(6)
            step[k] = _DIFFERENCE * self.scale[k]
            values = []
            for sign in (1, -1):
                turn = Rotation.from_rotvec(sign * step[:3]).as_matrix()
                moved = self.simulator.solve(Pose.from_rotation(
                    shape.gripper.position + sign * step[3:], turn @ shape.gripper.rotation),
                    shape)
                self.count += 1
                values.append(np.ravel(penalty(moved)).astype(float))
            columns.append((values[0] - values[1]) / (2 * step[k]))
        return np.column_stack(columns)


def _left_jacobian(v):
    """Return (3, 3) the turn of exp(v) per change of v (Bullo and Murray 1995)."""
    angle = np.linalg.norm(v)
    if angle < 1e-6:
        return np.eye(3)
    across = np.cross(np.eye(3), v)  # the cross-product matrix of v
    return (np.eye(3) + (1 - np.cos(angle)) / angle**2 * across
            + (angle - np.sin(angle)) / angle**3 * across @ across)
