# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
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
from numpy.typing import ArrayLike

from dlo_planner.direct.simulator import DirectSimulator, known_options
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.identify.likelihood import LOSSES, Errors
from dlo_planner.identify.observation import Observation, ObservedMotion
from dlo_planner.identify.observed import Observed
from dlo_planner.identify.unknowns import Unknowns
from dlo_planner.model.checks import choice, figure, flag, instance, items, number, results
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, figures, put
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.verify.robustness import Spread

_STARTS = (0.0, -0.7, 0.7)  # logarithms of stiffness from which the search begins
_MESHES = ({'n_elements': 64, 'n_terms': 10}, {'basis': 'local', 'n_elements': 128},
           {'basis': 'local', 'n_elements': 256}, {'basis': 'local', 'n_elements': 512})
_EXACT = 5e-4  # of the length: error estimate that the mesh of a fit has to keep


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Value):
    """A rod that explains observations.

    Attributes:
        rod: Rod with the values found
        values: dict of the parameters found, SI units: numbers, pairs, and with knots one of these
            per knot; of what varies along the DLO, the mean
        deviations: dict of their standard deviations, alike; infinite where the observations do
            not tell the value, by itself or apart from another one
        misfit: root mean square distance of the points from the DLO, m
        converged: whether the search came to its end
        noise: standard deviation of the points along each axis, m, as given or as found
        grippers: Poses of the observations at rest, corrected
        correlations: (n, n) of the errors of all numbers in `values`, row by row as in `names`;
            between two that are infinite, of what remains open
    """

    rod: Rod
    values: dict
    deviations: dict
    misfit: float
    converged: bool
    noise: float = np.nan
    grippers: tuple = ()
    correlations: np.ndarray | None = None

    def __post_init__(self):
        instance('Fit.rod', self.rod, Rod)
        for name in ('values', 'deviations'):
            put(self, **{name: FrozenDict(instance(f'Fit.{name}', getattr(self, name), dict))})
        put(self, misfit=figure('Fit.misfit', self.misfit),
            converged=flag('Fit.converged', self.converged), noise=figure('Fit.noise', self.noise),
            grippers=items('Fit.grippers', self.grippers, Pose))
        if self.correlations is not None:
            put(self, correlations=results('Fit.correlations', self.correlations, (None, None)))
        super().__post_init__()

    def __repr__(self):
        open_ = [name for name, value in self.deviations.items()
                 if not np.isfinite(np.array(value, dtype=float)).all()]
        return brief(self, 'converged' if self.converged else 'not converged',
                     f'misfit {self.misfit:.2g} m',
                     *(f'{name} {figures(value)}' for name, value in self.values.items()),
                     f'not told by the observations: {", ".join(open_)}' if open_ else '')

    @property
    def names(self) -> tuple[str, ...]:
        """What the n numbers in `values` are, e.g. 'natural_curvature[0]'."""
        out = []
        for name, value in self.values.items():
            size = np.size(value)
            out += [name] if np.ndim(value) == 0 else [f'{name}[{k}]' for k in range(size)]
        return tuple(out)

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) of the numbers in `values`, SI units, in the order of `names`.

        Raises:
            InvalidTask: the correlations are not known
        """
        if self.correlations is None:
            raise InvalidTask('Fit.correlations = None: expected a Fit that `fit_rod` returned')
        spread = np.concatenate([np.ravel(value) for value in self.deviations.values()])
        out = np.zeros_like(self.correlations)
        known = self.correlations != 0
        out[known] = (self.correlations * np.outer(spread, spread))[known]
        return out


def fit_rod(rod: Rod, observations: Iterable[Observation] = (),
            parameters: Iterable[str] = ('bending_stiffness',), *,
            motions: Iterable[ObservedMotion] = (), knots: ArrayLike | None = None,
            noise: float | None = None, gripper_position: float | None = None,
            gripper_rotation: float | None = None, prior: Spread | None = None,
            loss: str = 'linear', loss_scale: float = 1.5, progress: OnProgress = None,
            deadline: float | None = None, **options) -> Fit:
    """Return the Fit of a rod's properties to observed shapes and motions (least squares).

    Shapes and motions stay the same if all stiffnesses and masses grow alike, so they tell
    ratios: where all of them are sought, none of them has a finite deviation.

    Args:
        rod: Rod that is right in all else, and a first guess in what is sought
        observations: Observations, best at different poses of the gripper
        parameters: names out of 'bending_stiffness' (a pair keeps its ratio) or
            'bending_stiffness_n', 'bending_stiffness_b' (each by itself), 'torsional_stiffness',
            'natural_curvature' (k_n, k_b), 'natural_twist', 'mass_per_length', 'tip_mass',
            'damping' (a, b; by motions only). What varies along the DLO is scaled as a whole.
        motions: ObservedMotions, simulated in even parts of their dt, 16 at most, the last
            halving of which changed the points by less than 1e-4 of the length
        knots: arc lengths, m: natural curvature and twist are sought there, and are straight
            between; None: they are constant along the rod
        noise: standard deviation of each coordinate of a point, m; None: from the misfit
        gripper_position, gripper_rotation: standard deviations of the grippers' poses, m and rad,
            about each axis, independent at each observation, the same all along a motion; None:
            those of `prior`, or none. A far end is held where it is said to be.
        prior: Spread of what is sought about its value in `rod`; 0 there: nothing is known; of
            natural curvature, at each knot
        loss: how the distance of a point counts: 'linear' (its square), or less if it is large:
            'soft_l1', 'huber', 'cauchy', 'arctan' (as in SciPy's `least_squares`)
        loss_scale: from how many standard deviations of the noise on it counts less
        progress: called as progress(done, total) after each of the searches
        deadline: s of computing after which DeadlineExceeded is raised; None: no limit
        options: of the `DirectSimulator`; without a mesh among them, one that keeps 1e-3 of the
            length is chosen, and is the same for all observations

    Raises:
        InvalidTask: an argument makes no sense
        NotConverged: no equilibrium is found with the first guess
        DeadlineExceeded: the deadline is over
    """
    unknowns = Unknowns(instance('rod', rod, Rod), parameters, knots)
    observations, motions = _judged(rod, observations, motions, options)
    if 'damping' in unknowns.names and not motions:
        raise InvalidTask('parameters: expected motions where damping is to be found')
    noise = None if noise is None else number('noise', noise, above=0)
    prior = instance('prior', prior, Spread, optional=True) or Spread()
    _judge_prior(prior, unknowns)
    position, rotation = (
        getattr(prior, name) if value is None else number(name, value, minimum=0)
        for name, value in (('gripper_position', gripper_position),
                            ('gripper_rotation', gripper_rotation)))
    pose = np.diag([rotation] * 3 + [position] * 3)
    pose = pose[pose.any(axis=1)]
    loss = LOSSES[choice('loss', loss, tuple(LOSSES))]
    scale = number('loss_scale', loss_scale, above=0)
    steps = Progress(progress, deadline)
    meshes = _MESHES if not {'n_elements', 'n_terms', 'accuracy'} & {*options} else ({},)
    begin = None
    for mesh in meshes[_first_mesh(rod, observations, motions, options, meshes):]:
        observed = Observed(unknowns, observations, motions, pose, {**mesh, **options}, steps)
        observed.choose_steps(np.append(unknowns.begin, np.zeros(observed.size - unknowns.size)))
        errors = Errors(observed, unknowns.prior(prior), noise, loss, scale)
        found, statistics = _found(observed, errors, steps, begin)
        if _exact(observed.at(found.x).shapes[:len(observations)], rod) or mesh is meshes[-1]:
            return _fit(observed, statistics, found)
        begin = found.x


def _found(observed, errors, steps, begin):
    """Return SciPy's result and the Statistics; from `begin` (n,), or None: several starts."""
    unknowns = observed.unknowns
    poses = np.zeros(observed.size - unknowns.size)
    stiff, first = np.append(unknowns.stiff, poses), np.append(unknowns.begin, poses)
    if begin is not None:
        return errors.settled(errors.minimum(begin))
    if not observed.at(first).any:
        raise NotConverged('rod: no equilibrium was found for any observation with the first guess')
    searches, starts = [], _STARTS if stiff.any() else _STARTS[:1]
    for shift in starts:
        searches.append(errors.minimum(first + shift * stiff))
        steps.done(len(searches), len(starts) + 1)
    found, statistics = errors.settled(min(searches, key=lambda search: search.cost))
    steps.done(len(starts) + 1, len(starts) + 1)
    return found, statistics


def _first_mesh(rod, observations, motions, options, meshes):
    """Return the index of the first mesh that is fine enough for the first guess."""
    for index in range(len(meshes) - 1):
        direct = DirectSimulator(rod, **{**meshes[index], **options})
        shapes = [direct.solve(one.gripper, far_end=one.far_end) for one in observations]
        shapes += [direct.solve(one.grippers[0],
                                far_end=None if one.far_ends is None else one.far_ends[0])
                   for one in motions]
        if _exact(shapes, rod):
            return index
    return len(meshes) - 1


def _exact(shapes, rod):
    """Whether what has been solved is exact enough."""
    return all(shape.error_estimate <= _EXACT * rod.length for shape in shapes if shape.converged)


def _judged(rod, observations, motions, options):
    """Return observations and motions as tuples; raise InvalidTask naming what is wrong."""
    motions = items('motions', motions, ObservedMotion)
    observations = items('observations', observations, Observation, least=0 if motions else 1)
    for kind, seen in (('observations', observations), ('motions', motions)):
        for index, one in enumerate(seen):
            if one.s is not None and ((one.s < 0) | (one.s > rod.length)).any():
                raise InvalidTask(f'{kind}[{index}].s: expected 0 to the length {rod.length:g} m')
    known_options(options)
    # sensitivities, which guide the search, are by the components
    choice('strains', options.get('strains', 'components'), ('components',))
    return observations, motions


def _judge_prior(prior, unknowns):
    sought = {*unknowns.names}
    for name, held in (('mass', not sought & {'mass_per_length', 'tip_mass'}), ('length', True)):
        if held and getattr(prior, name):
            raise InvalidTask(f'prior.{name} = {getattr(prior, name):g}: expected 0, it is taken '
                              'as known')


def _fit(observed, statistics, found):
    """Return the Fit of SciPy's result."""
    unknowns, x = observed.unknowns, found.x[:observed.n_parameters]
    correlations = statistics.correlations[np.ix_(unknowns.columns, unknowns.columns)]
    here = observed.at(found.x)
    misfit = float(np.sqrt(np.mean(np.sum(here.away**2, axis=1))))
    return Fit(unknowns.of(x), unknowns.values(x),
               unknowns.deviations(x, statistics.deviations[:unknowns.size]), misfit,
               bool(found.success and here.converged), statistics.noise,
               observed.grippers(found.x), correlations)
