"""Finding out what a DLO is like from what has been seen of it.

The model: an observed point is a point of the DLO plus noise, independent and alike along all axes;
the gripper's pose is known but for a normal error, another one at each observation; what is sought
may be known beforehand, within a normal error too. The most likely values are found by least
squares, the noise (unless it is known) from what is left, by the number of residuals that nothing
was fitted to. To first order, deviations are then those of repeated experiments.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.simulator import known_options
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.inverse.likelihood import LOSSES, Errors
from dlo_planner.inverse.misfit import Observed, changed, curvature_unit
from dlo_planner.inverse.tolerance import Spread
from dlo_planner.model.checks import array, choice, figure, flag, instance, items, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, figures, put
from dlo_planner.progress import OnProgress, Progress

PARAMETERS = ('bending_stiffness', 'torsional_stiffness', 'natural_curvature')
_STARTS = (0.0, -0.7, 0.7)  # logarithms of stiffness from which the search begins


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
        deviations: dict of their standard deviations (infinite where nothing was observed of it)
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


def fit_rod(rod: Rod, observations: Iterable[Observation],
            parameters: Iterable[str] = ('bending_stiffness',), *,
            noise: float | None = None, gripper_position: float | None = None,
            gripper_rotation: float | None = None, prior: Spread | None = None,
            loss: str = 'linear', loss_scale: float = 1.5, progress: OnProgress = None,
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
    errors = Errors(observed, _prior(rod, parameters, prior), noise,
                    LOSSES[choice('loss', loss, tuple(LOSSES))],
                    number('loss_scale', loss_scale, above=0))
    stiff = np.concatenate([[0.0, 0.0] if name == 'natural_curvature' else [1.0]
                            for name in parameters] + [np.zeros(observed.size
                                                                - observed.n_parameters)])
    if not any(shape.converged for shape in observed.at(0 * stiff).shapes):
        raise NotConverged('rod: no equilibrium was found for any observation with the first guess')
    searches, starts = [], _STARTS if stiff.any() else _STARTS[:1]
    for shift in starts:
        searches.append(errors.minimum(shift * stiff))
        steps.done(len(searches), len(starts) + 1)
    found, statistics = errors.settled(min(searches, key=lambda search: search.cost))
    steps.done(len(starts) + 1, len(starts) + 1)
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
    # sensitivities, which guide the search, are by the components
    choice('strains', options.get('strains', 'components'), ('components',))
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
