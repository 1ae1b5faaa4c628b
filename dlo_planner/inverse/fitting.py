"""Finding out what a DLO is like from what has been seen of it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from dlo_planner.direct.simulator import DirectSimulator, known_options
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.model.checks import array, choice, figure, flag, instance, items, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, figures, put

PARAMETERS = ('bending_stiffness', 'torsional_stiffness', 'natural_curvature')
_STARTS = (0.0, -0.7, 0.7)  # logarithms of stiffness from which the search begins
_FARTHEST = 60.0            # of logarithms and units of curvature
_BENT = 0.1  # rad along the length: how far natural curvature is moved as one unit


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Value):
    """Points of a DLO at rest, seen at a known pose of the gripper.

    Attributes:
        gripper: Pose
        points: (m, 3) m, world
        s: (m,) their arc lengths, m; None: not known, the nearest points of the DLO count
    """

    gripper: Pose
    points: np.ndarray
    s: np.ndarray | None = None

    def __post_init__(self):
        instance('Observation.gripper', self.gripper, Pose)
        put(self, points=array('Observation.points', self.points, (None, 3)))
        if self.s is not None:
            put(self, s=vector('Observation.s', self.s, len(self.points)))
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Value):
    """A rod that explains observations.

    Attributes:
        rod: Rod with the values found
        values: dict of the parameters found, SI units (a pair for natural_curvature)
        deviations: dict of their standard deviations, from the misfit and the sensitivities
            (infinite where the observations do not tell)
        misfit: root mean square distance of the points from the DLO, m
        converged: whether the search came to its end
    """

    rod: Rod
    values: dict
    deviations: dict
    misfit: float
    converged: bool

    def __post_init__(self):
        instance('Fit.rod', self.rod, Rod)
        for name in ('values', 'deviations'):
            put(self, **{name: FrozenDict(instance(f'Fit.{name}', getattr(self, name), dict))})
        put(self, misfit=figure('Fit.misfit', self.misfit),
            converged=flag('Fit.converged', self.converged))

    def __repr__(self):
        return brief(self, 'converged' if self.converged else 'not converged',
                     f'misfit {self.misfit:.2g} m',
                     *(f'{name} {figures(value)}' for name, value in self.values.items()))


def fit_rod(rod, observations, parameters=('bending_stiffness',), **options) -> Fit:
    """Return the Fit of a rod's properties to observed shapes (least squares of distances).

    The weight is taken as known: gravity bends a DLO by the ratio of weight and stiffness only.

    Args:
        rod: Rod that is right in all else, and a first guess in what is sought
        observations: Observations, best at different poses of the gripper
        parameters: names out of 'bending_stiffness' (a pair keeps its ratio),
            'torsional_stiffness', 'natural_curvature' (k_n, k_b, constant along the rod)
        options: of the `DirectSimulator`

    Raises:
        InvalidTask: an argument makes no sense
        NotConverged: no equilibrium is found with the first guess
    """
    instance('rod', rod, Rod)
    observations = items('observations', observations, Observation, least=1)
    parameters = items('parameters', parameters, str, least=1)
    for name in parameters:
        choice('parameters', name, PARAMETERS)
    if len(set(parameters)) < len(parameters):
        raise InvalidTask(f'parameters = {parameters!r}: expected each name once')
    options = known_options(options)
    for index, one in enumerate(observations):
        if one.s is not None and ((one.s < 0) | (one.s > rod.length)).any():
            raise InvalidTask(f'observations[{index}].s: expected 0 to the length {rod.length:g} m')
    if 'natural_curvature' in parameters and callable(rod.natural_curvature):
        raise InvalidTask('Rod.natural_curvature: expected two numbers where it is to be found')

    def misfits(x):
        simulator = DirectSimulator(_changed(rod, parameters, x), **options)
        found = []
        for one in observations:
            shape = simulator.solve(one.gripper)
            found.append(_distances(shape, one) if shape.converged else np.full(
                one.points.shape, rod.length))
        return np.concatenate(found).ravel()

    stiff = np.concatenate([[0.0, 0.0] if name == 'natural_curvature' else [1.0]
                            for name in parameters])
    if not np.any(misfits(0 * stiff) < rod.length):
        raise NotConverged('rod: no equilibrium was found for any observation with the first guess')
    searches = [least_squares(misfits, shift * stiff, x_scale='jac', xtol=1e-10, ftol=1e-10,
                              gtol=1e-12, diff_step=1e-5, max_nfev=60,
                              bounds=(-_FARTHEST, _FARTHEST)) for shift in _STARTS]
    return _fit(rod, parameters, min(searches, key=lambda search: search.cost))


def _changed(rod, parameters, x):
    """Return the rod with logarithms of stiffness and units of curvature changed by x."""
    values, x = {}, list(x)
    for name in parameters:
        if name == 'natural_curvature':
            values[name] = tuple(np.array(rod.natural_curvature)
                                 + _BENT / rod.length * np.array([x.pop(0), x.pop(0)]))
        elif name == 'bending_stiffness':
            values[name] = tuple(np.array(rod.bending_stiffness) * np.exp(x.pop(0)))
        else:
            values[name] = rod.torsional_stiffness * np.exp(x.pop(0))
    return replace(rod, section=None, **values)


def _distances(shape, observation):
    """Return (m, 3) from the DLO's points to the observed ones."""
    if observation.s is not None:
        return observation.points - shape.positions_at(observation.s)
    begin, along = shape.positions[:-1], np.diff(shape.positions, axis=0)
    away = observation.points[:, None] - begin
    share = np.clip(np.einsum('mki,ki->mk', away, along) / np.sum(along**2, axis=1), 0, 1)
    away = away - share[:, :, None] * along
    nearest = np.argmin(np.sum(away**2, axis=2), axis=1)
    return away[np.arange(len(nearest)), nearest]


def _fit(rod, parameters, found):
    changed = _changed(rod, parameters, found.x)
    freedom = max(found.fun.size - found.x.size, 1)
    variance = np.sum(found.fun**2) / freedom
    information = found.jac.T @ found.jac
    known = np.linalg.cond(information) < 1e14
    spread = (np.sqrt(np.diag(np.linalg.inv(information)) * variance) if known
              else np.full(found.x.size, np.inf))
    spread, values, deviations = list(spread), {}, {}
    for name in parameters:
        values[name] = getattr(changed, name)
        if name == 'natural_curvature':
            deviations[name] = tuple(_BENT / rod.length * np.array([spread.pop(0), spread.pop(0)]))
        else:
            relative = spread.pop(0)
            deviations[name] = (tuple(relative * np.array(values[name]))
                                if name == 'bending_stiffness' else relative * values[name])
    misfit = float(np.sqrt(np.mean(np.sum(found.fun.reshape(-1, 3) ** 2, axis=1))))
    return Fit(changed, values, deviations, misfit, bool(found.success))
