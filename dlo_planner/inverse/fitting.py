"""Finding out what a DLO is like from what has been seen of it.

The model: an observed point is a point of the DLO plus noise, independent and alike along all axes;
the gripper's pose is known but for a normal error, another one at each observation; what is sought
may be known beforehand, within a normal error too. The most likely values are found by least
squares, the noise (unless it is known) from what is left, by the number of residuals that nothing
was fitted to. To first order, deviations are then those of repeated experiments.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from dlo_planner.direct.simulator import known_options
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.inverse.misfit import Observed, changed, curvature_unit
from dlo_planner.inverse.tolerance import Spread
from dlo_planner.model.checks import array, choice, figure, flag, instance, items, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, figures, put
from dlo_planner.progress import Progress

PARAMETERS = ('bending_stiffness', 'torsional_stiffness', 'natural_curvature')
_STARTS = (0.0, -0.7, 0.7)  # logarithms of stiffness from which the search begins
_FARTHEST = 60.0            # of logarithms and units of curvature
_EVALUATIONS = 60
_ROUNDS, _SETTLED = 30, 1e-3  # of the noise
_FIRST_NOISE, _NO_NOISE = 1e-2, 1e-10  # of the length: taken at first; what rounding leaves
_UNKNOWN = 1e-12            # of the largest: an eigenvalue of the information that is none


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
        deviations: dict of their standard deviations (infinite where the observations do not tell)
        misfit: root mean square distance of the points from the DLO, m
        converged: whether the search came to its end
        noise: standard deviation of the points along each axis, m, as given or as found
        grippers: Poses of the observations, corrected
    """

    rod: Rod
    values: dict
    deviations: dict
    misfit: float
    converged: bool
    noise: float = np.nan
    grippers: tuple = ()

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


def fit_rod(rod: Rod, observations, parameters=('bending_stiffness',), *,
            noise: float | None = None, gripper_position: float | None = None,
            gripper_rotation: float | None = None, prior: Spread | None = None,
            loss: str = 'linear', loss_scale: float = 1.5, progress=None,
            deadline: float | None = None, **options) -> Fit:
    """Return the Fit of a rod's properties to observed shapes (least squares of distances).

    The weight is taken as known: gravity bends a DLO by the ratio of weight and stiffness only.

    Args:
        rod: Rod that is right in all else, and a first guess in what is sought
        observations: Observations, best at different poses of the gripper
        parameters: names out of 'bending_stiffness' (a pair keeps its ratio),
            'torsional_stiffness', 'natural_curvature' (k_n, k_b, constant along the rod)
        noise: standard deviation of each coordinate of a point, m; None: from the misfit
        gripper_position, gripper_rotation: standard deviations of the grippers' poses, m and rad,
            about each axis, independent at each observation; None: those of `prior`, or none
        prior: Spread of what is sought about its value in `rod`; 0 there: nothing is known
        loss: how the distance of a point counts: 'linear' (its square), or less if it is large:
            'soft_l1', 'huber', 'cauchy', 'arctan' (as in SciPy's `least_squares`)
        loss_scale: from how many standard deviations of the noise on it counts less
        progress: called as progress(done, total) after each of the searches
        deadline: s of computing after which DeadlineExceeded is raised; None: no limit
        options: of the `DirectSimulator`

    Raises:
        InvalidTask: an argument makes no sense
        NotConverged: no equilibrium is found with the first guess
        DeadlineExceeded: the deadline is over
    """
    observations, parameters = _judged(rod, observations, parameters, options)
    noise = None if noise is None else number('noise', noise, above=0)
    prior = instance('prior', prior, Spread, optional=True) or Spread()
    for name in ('mass', 'length'):
        if getattr(prior, name):
            raise InvalidTask(f'prior.{name} = {getattr(prior, name):g}: expected 0, it is taken '
                              'as known')
    position, rotation = (
        getattr(prior, name) if value is None else number(name, value, minimum=0)
        for name, value in (('gripper_position', gripper_position),
                            ('gripper_rotation', gripper_rotation)))
    pose = np.diag([rotation] * 3 + [position] * 3)
    steps = Progress(progress, deadline)
    observed = Observed(rod, observations, parameters, pose[pose.any(axis=1)], options, steps)
    errors = _Errors(observed, _prior(rod, parameters, prior), noise,
                     _LOSSES[choice('loss', loss, tuple(_LOSSES))],
                     number('loss_scale', loss_scale, above=0))
    stiff = np.concatenate([[0.0, 0.0] if name == 'natural_curvature' else [1.0]
                            for name in parameters] + [np.zeros(observed.size
                                                                - observed.n_parameters)])
    if not any(shape.converged for shape in observed.at(0 * stiff).shapes):
        raise NotConverged('rod: no equilibrium was found for any observation with the first guess')
    searches = []
    for shift in _STARTS:
        searches.append(errors.minimum(shift * stiff))
        steps.done(len(searches), len(_STARTS) + 1)
    found, statistics = errors.settled(min(searches, key=lambda search: search.cost))
    steps.done(len(_STARTS) + 1, len(_STARTS) + 1)
    return _fit(observed, statistics, found)


def _judged(rod, observations, parameters, options):
    """Return observations and parameters as tuples; raise InvalidTask naming what is wrong."""
    instance('rod', rod, Rod)
    observations = items('observations', observations, Observation, least=1)
    parameters = items('parameters', parameters, str, least=1)
    for name in parameters:
        choice('parameters', name, PARAMETERS)
    if len(set(parameters)) < len(parameters):
        raise InvalidTask(f'parameters = {parameters!r}: expected each name once')
    for index, one in enumerate(observations):
        if one.s is not None and ((one.s < 0) | (one.s > rod.length)).any():
            raise InvalidTask(f'observations[{index}].s: expected 0 to the length {rod.length:g} m')
    if 'natural_curvature' in parameters and callable(rod.natural_curvature):
        raise InvalidTask('Rod.natural_curvature: expected two numbers where it is to be found')
    known_options(options)
    if options.get('strains', 'components') != 'components':
        raise InvalidTask(f'strains = {options["strains"]!r}: expected \'components\', whose '
                          'sensitivities guide the search')
    return observations, parameters


def _prior(rod, parameters, prior):
    """Return (k,): 1 / standard deviation of each unknown of the parameters, 0 for none."""
    out = []
    for name in parameters:
        spread = getattr(prior, name)
        if name == 'natural_curvature':
            out += [curvature_unit(rod) / spread if spread else 0.0] * 2
        else:
            out.append(1 / spread if spread else 0.0)
    return np.array(out)


# rho(z) of z = (distance / scale)^2 and its first two derivatives, as in SciPy's least_squares
_LOSSES = {
    'linear': lambda z: (z, np.ones_like(z), np.zeros_like(z)),
    'soft_l1': lambda z: (2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    'huber': lambda z: (np.where(z <= 1, z, 2 * np.sqrt(z) - 1), np.maximum(z, 1) ** -0.5,
                        np.where(z <= 1, 0.0, -0.5 * np.maximum(z, 1) ** -1.5)),
    'cauchy': lambda z: (np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2),
    'arctan': lambda z: (np.arctan(z), 1 / (1 + z**2), -2 * z / (1 + z**2) ** 2)}


@dataclass(frozen=True, eq=False)
class _Statistics:
    """What is left at the most likely unknowns.

    Attributes:
        covariance: (n, n) of the unknowns, infinite on the diagonal where nothing is known
        noise: m
    """

    covariance: np.ndarray
    noise: float


class _Errors:
    """The model of errors: what is minimised, and what its minimum tells.

    Args:
        observed: Observed; prior: (k,) 1 / standard deviations of its parameters
        noise: m, or None; loss: of _LOSSES; scale: of it, in standard deviations of the noise
    """

    def __init__(self, observed, prior, noise, loss, scale):
        self._observed, self._given, self._loss, self._scale = observed, noise, loss, scale
        # errors of poses are unknowns in their own standard deviations
        self._prior = np.append(prior, np.ones(observed.size - prior.size))
        self._first = noise or _FIRST_NOISE * observed.rod.length
        self._weighed = bool(self._prior.any()) or loss is not _LOSSES['linear']

    def settled(self, found):
        """Return SciPy's result and the _Statistics where noise and unknowns fit each other."""
        length = self._observed.rod.length
        noise = self._first
        # the noise decides only where there is something else to weigh it against
        for _ in range(_ROUNDS if self._weighed and not self._given else 0):
            before, noise = noise, max(self._left(found.x, noise), _NO_NOISE * length)
            if abs(noise - before) <= _SETTLED * before:
                break
            found = self.minimum(found.x, noise)
        return found, self._statistics(found.x, noise)

    def minimum(self, x, noise=None):
        """Return SciPy's result from x (n,) on, for a noise in m; None: the first guess."""
        noise = noise or self._first
        bounds = np.full(x.size, np.inf)
        bounds[:self._observed.n_parameters] = _FARTHEST
        return least_squares(lambda x: self._weighted(x, noise)[0], x,
                             lambda x: self._weighted(x, noise)[1], x_scale='jac', xtol=1e-10,
                             ftol=1e-10, gtol=1e-12, max_nfev=_EVALUATIONS,
                             bounds=(-bounds, bounds))

    def _weighted(self, x, noise):
        """Return residuals, whose squares add up to what is minimised, and their derivatives."""
        here, size = self._observed.at(x), noise * self._scale
        z = np.sum(here.away**2, axis=1) / size**2
        value, first, _ = self._loss(z)
        root = np.sqrt(np.divide(value, z, out=np.ones_like(z), where=z > 0))[:, None]
        away = root * here.away / noise
        slopes = (first[:, None] / root)[:, :, None] * here.slopes / noise
        return (np.append(away.ravel(), self._prior * x),
                np.vstack([slopes.reshape(-1, x.size), np.diag(self._prior)]))

    def _information(self, x, noise):
        """Return J^T J (n, n) of the points with weights, of the same squared, and its prior."""
        here = self._observed.at(x)
        z = np.sum(here.away**2, axis=1) / (noise * self._scale) ** 2
        _, first, second = self._loss(z)
        counts = here.counts.sum(axis=1)
        # Huber's: mean slope and mean square of the force that a point exerts, along each axis
        stiff = np.sum(counts * first + 2 * z * second) / counts.sum()
        slopes = here.slopes.reshape(-1, x.size) / noise
        plain = slopes.T @ slopes
        force = np.sum(first**2 * np.sum(here.away**2, axis=1)) / noise**2
        return plain, stiff, force, counts.sum()

    def _left(self, x, noise):
        """Return the noise (m) that the misfit tells, with what was fitted to it accounted for."""
        here = self._observed.at(x)
        plain, stiff, _, count = self._information(x, noise)
        fitted = np.trace(_inverse(stiff * plain + np.diag(self._prior**2))[0] @ (stiff * plain))
        left = max(count - fitted, 1.0)
        if self._loss is _LOSSES['linear']:
            return float(np.sqrt(np.sum(here.away**2) / left))
        # outliers do not move the median
        distances = np.abs(here.away[here.counts])
        return float(np.median(distances) / _MEDIAN * np.sqrt(count / left))

    def _statistics(self, x, noise):
        if self._given is None and not self._weighed:
            noise = max(self._left(x, noise), np.finfo(float).tiny)
        plain, stiff, force, count = self._information(x, noise)
        prior = np.diag(self._prior**2)
        inverse, unknown = _inverse(stiff * plain + prior)
        fitted = np.trace(inverse @ (stiff * plain))
        spread = 1.0 if self._loss is _LOSSES['linear'] else force / max(count - fitted, 1.0)
        covariance = inverse @ (spread * plain + prior) @ inverse
        covariance[unknown, unknown] = np.inf
        return _Statistics(covariance, float(noise))


_MEDIAN = 0.6744897501960817  # of the size of a standard normal number


def _inverse(information):
    """Return the inverse (n, n) where it is known, and the indices about which nothing is."""
    size = np.sqrt(np.diag(information))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    none = values <= _UNKNOWN * values.max()
    inverse = vectors[:, ~none] / values[~none] @ vectors[:, ~none].T / np.outer(size, size)
    return inverse, np.flatnonzero((vectors[:, none] ** 2).sum(axis=1) > _UNKNOWN)


def _fit(observed, statistics, found):
    rod, parameters = observed.rod, observed.parameters
    better = changed(rod, parameters, found.x[:observed.n_parameters])
    spread = list(np.sqrt(np.diag(statistics.covariance)))
    values, deviations = {}, {}
    for name in parameters:
        values[name] = getattr(better, name)
        if name == 'natural_curvature':
            deviations[name] = tuple(curvature_unit(rod) * np.array([spread.pop(0), spread.pop(0)]))
        else:
            relative = spread.pop(0)
            deviations[name] = (tuple(relative * np.array(values[name]))
                                if name == 'bending_stiffness' else relative * values[name])
    here = observed.at(found.x)
    misfit = float(np.sqrt(np.mean(np.sum(here.away**2, axis=1))))
    grippers = tuple(observed.gripper(k, found.x)[0] for k in range(len(observed.observations)))
    return Fit(better, values, deviations, misfit, bool(found.success and here.converged),
               statistics.noise, grippers)
