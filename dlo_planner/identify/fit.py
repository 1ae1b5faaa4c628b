# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Finding out what a DLO is like from what has been seen of it.

The model: an observed point is a point of the DLO plus noise, independent and alike along all axes;
the gripper's pose is known but for a normal error, another one at each observation; what is sought
may be known beforehand, within a normal error too, and so are other causes that displace points of
a motion. The most likely values are found by least squares, the noise (unless known) from what is
left, by the number of residuals that nothing was fitted to. To first order, deviations are those of
repeated experiments; in a motion, residuals that go together widen them (`identify.noise_model`).

What is left has to be noise: by chi-square where the noise was stated, else by its size. If it is
not, the most likely rod is still not the one that was seen, and the fit is not `converged`. More
than the stated noise widens all deviations by the root of chi-square over its degrees of freedom
(Birge 1932, Physical Review 40); noise that few numbers tell does by Student's distribution.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult
from scipy.special import chdtrc, ndtr, stdtrit

from dlo_planner.blas import one_thread
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, known_options
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.identify.noise_model import LOSSES, MEstimator, Statistics
from dlo_planner.identify.observation import Observation, ObservedMotion, check_points
from dlo_planner.identify.residuals import ROUGHLY, MeasurementModel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, choice, figure, flag, instance, items, number, results
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, brief, figures, put
from dlo_planner.pictured import Answer
from dlo_planner.progress import OnProgress, Progress, interrupted_by
from dlo_planner.uncertainty.parameters import Uncertainty, Unknowns

_Seen: TypeAlias = tuple[tuple[Observation, ...], tuple[ObservedMotion, ...]]
_STARTS = (0.0, -0.7, 0.7)  # logarithms of stiffness from which the search begins
_MESHES = ({'n_elements': 64, 'n_terms': 10}, {'basis': 'local', 'n_elements': 128},
           {'basis': 'local', 'n_elements': 256}, {'basis': 'local', 'n_elements': 512})
_EXACT = 5e-4  # of the length: error estimate that the mesh of a fit has to keep


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Answer):
    """A rod that explains observations.

    Attributes
    ----------
    rod : Rod
        Rod with the values found.
    values : dict
        Parameters found by name, SI units: numbers, pairs, and with knots one of these per
        knot; of what varies along the DLO, the mean.
    deviations : dict
        Their standard deviations, alike; infinite where the observations do not tell the
        value, by itself or apart from another one.
    misfit : float
        Root mean square distance of the points from the DLO, m.
    converged : bool
        Whether the search finished, and the noise explains what the rod does not: see `status`.
    noise : float
        Standard deviation of the points along each axis, m, as given or as found.
    grippers : tuple of Pose
        Poses of the observations at rest, corrected.
    correlations : ndarray, shape (n, n) or None
        Correlations of the errors of all numbers in `values`, row by row as in `names`; between two
        that are infinite, of what remains open.
    birge_ratio : float
        Root of chi-square over its degrees of freedom, by the noise and the uncertainties as
        stated: about 1 where they are right. It has widened all deviations where it is larger; 1
        where the noise was not stated.
    doubt : str
        Why the rod does not explain the points, and what to check; '' if it does.
    observed : tuple of ndarray, shape (m, 3)
        Points of each observation at rest, m.
    found : tuple of ndarray, shape (n, 3)
        Nodes of the DLO that explains them, m.
    """

    rod: Rod
    values: dict[str, Any]
    deviations: dict[str, Any]
    misfit: float
    converged: bool
    noise: float = np.nan
    grippers: tuple[Pose, ...] = ()
    correlations: Floats | None = None
    birge_ratio: float = 1.0
    doubt: str = ''
    observed: tuple[Floats, ...] = ()
    found: tuple[Floats, ...] = ()

    def __post_init__(self) -> None:
        instance('Fit.rod', self.rod, Rod)
        for name in ('values', 'deviations'):
            put(self, **{name: FrozenDict(instance(f'Fit.{name}', getattr(self, name), dict))})
        put(self, misfit=figure('Fit.misfit', self.misfit),
            converged=flag('Fit.converged', self.converged), noise=figure('Fit.noise', self.noise),
            grippers=items('Fit.grippers', self.grippers, Pose))
        if self.correlations is not None:
            put(self, correlations=results('Fit.correlations', self.correlations, (None, None)))
        put(self, birge_ratio=figure('Fit.birge_ratio', self.birge_ratio))
        instance('Fit.doubt', self.doubt, str)
        for name in ('observed', 'found'):
            given = instance(f'Fit.{name}', getattr(self, name), (tuple, list))
            put(self, **{name: tuple(array(f'Fit.{name}[{k}]', one, (None, 3))
                                     for k, one in enumerate(given))})
        if len(self.observed) != len(self.found):
            raise InvalidTask(f'Fit.found: expected {len(self.observed)} arrays, one for each of '
                              f'Fit.observed, got {len(self.found)}')
        super().__post_init__()

    def __repr__(self) -> str:
        open_ = [name for name, value in self.deviations.items()
                 if not np.isfinite(np.array(value, dtype=float)).all()]
        return brief(self, self.status,
                     f'misfit {self.misfit:.2g} m',
                     f'not resolvable from the observations: {", ".join(open_)}' if open_ else '',
                     *(f'{name} {figures(value)}' for name, value in self.values.items()))

    @property
    def status(self) -> str:
        """'converged', 'does not explain the points' (`doubt` says why) or 'not converged'."""
        if self.doubt:
            return 'does not explain the points'
        return 'converged' if self.converged else 'not converged'

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n numbers in `values`, e.g. 'natural_curvature[0]'."""
        return tuple(f'{name}[{k}]' if np.ndim(value) else name
                     for name, value in self.values.items() for k in range(np.size(value)))

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of the numbers in `values`, SI units, in the order of `names`.

        Raises
        ------
        InvalidTask
            The correlations are not known.
        """
        if self.correlations is None:
            raise InvalidTask('Fit.correlations = None: expected a Fit that `fit_rod` returned')
        spread = np.concatenate([np.ravel(value) for value in self.deviations.values()])
        out = np.zeros_like(self.correlations)
        known = self.correlations != 0
        out[known] = (self.correlations * np.outer(spread, spread))[known]
        return out


@one_thread()
def fit_rod(rod: Rod, observations: Iterable[Observation] = (),
            parameters: Iterable[str] = ('bending_stiffness',), *,
            motions: Iterable[ObservedMotion] = (), knots: ArrayLike | None = None,
            noise: float | None = None, gripper_position: float | None = None,
            gripper_rotation: float | None = None, prior: Uncertainty | None = None,
            loss: str = 'linear', loss_scale: float = 1.5, progress: OnProgress = None,
            deadline: float | None = None, **options: Any) -> Fit:
    """Return the Fit of a rod's properties to observed shapes and motions (least squares).

    Shapes and motions stay the same if all stiffnesses and masses grow alike, so they show only
    ratios. If all of them are parameters, none of them has a finite deviation.

    Parameters
    ----------
    rod : Rod
        Rod with the known properties, and first guesses of the parameters.
    observations : iterable of Observation, optional
        Observations, best at different poses of the gripper.
    parameters : iterable of str, optional
        Names out of 'bending_stiffness' (a pair keeps its ratio) or 'bending_stiffness_n',
        'bending_stiffness_b' (each by itself), 'torsional_stiffness', 'natural_curvature' (k_n,
        k_b), 'natural_twist', 'mass_per_length', 'tip_mass', 'damping' (a, b; by motions only).
        What varies along the DLO is scaled as a whole.
    motions : iterable of ObservedMotion, optional
        ObservedMotions, simulated in even parts of their dt, 16 at most, the last halving of which
        changed points by less than 1e-4 of the length, or 1/5 of the noise that is given.
    knots : array_like, optional
        Arc lengths, m: natural curvature and twist are sought there, and are straight between. If
        None, they are constant along the rod.
    noise : float, optional
        Standard deviation of each coordinate of a point, m. If None, it is found from the misfit.
        Stated, it is held against the misfit: a `Fit` that is off by more does not explain the
        points.
    gripper_position, gripper_rotation : float, optional
        Standard deviations of the grippers' poses, m and rad, about each axis, independent at each
        observation, the same all along a motion; None: those of `prior`, or none. A far end is held
        where it is said to be.
    prior : Uncertainty, optional
        Uncertainty of the parameters about their values in `rod`; 0: nothing is known. That of
        natural curvature applies at each knot.
    loss : str, optional
        How the distance of a point counts: 'linear' (its square), or less if it is large:
        'soft_l1', 'huber', 'cauchy', 'arctan' (as in SciPy's `least_squares`).
    loss_scale : float, optional
        Number of standard deviations of the noise from which on a distance counts less.
    progress : callable, optional
        Called as progress(done, total) after each of the searches.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, there is no limit.
    options : object
        Options of the `DirectSimulator`; without a mesh among them, one that keeps 1e-3 of the
        length is chosen, and is the same for all observations.

    Raises
    ------
    InvalidTask
        An argument makes no sense.
    NotConverged
        No equilibrium is found with the first guess.
    DeadlineExceeded
        The deadline is over.
    """
    unknowns = Unknowns(instance('rod', rod, Rod), parameters, knots)
    observations, motions = _judged(unknowns, observations, motions, options)
    noise = None if noise is None else number('noise', noise, above=0)
    prior = instance('prior', prior, Uncertainty, optional=True) or Uncertainty()
    _judge_prior(prior, unknowns)
    position, rotation = (
        getattr(prior, name) if value is None else number(name, value, minimum=0)
        for name, value in (('gripper_position', gripper_position),
                            ('gripper_rotation', gripper_rotation)))
    pose = np.diag([rotation] * 3 + [position] * 3)
    pose = pose[pose.any(axis=1)]
    rho = LOSSES[choice('loss', loss, tuple(LOSSES))]
    scale = number('loss_scale', loss_scale, above=0)
    steps = Progress(progress, deadline)
    meshes = _MESHES if not {'n_elements', 'n_terms', 'accuracy'} & {*options} else ({},)
    begin = None
    with interrupted_by(steps.check):
        for mesh in meshes[_first_mesh(rod, observations, motions, options, meshes):]:
            observed = MeasurementModel(unknowns, observations, motions, pose, {**mesh, **options},
                                        steps)
            free = np.zeros(observed.size - unknowns.size)
            observed.choose_steps(np.append(unknowns.begin, free), ROUGHLY)
            errors = MEstimator(observed, unknowns.prior(prior), noise, rho, scale)
            found, statistics = _found(observed, errors, steps, begin)
            if _exact(observed.at(found.x).shapes[:len(observations)], rod):
                break
            begin = found.x
    return _fit(observed, statistics, found, noise)


def _found(observed: MeasurementModel, errors: MEstimator, steps: Progress,
           begin: Floats | None) -> tuple[OptimizeResult, Statistics]:
    """Return SciPy's result and the Statistics; from `begin` (n,), or None: several starts."""
    unknowns = observed.unknowns
    poses = np.zeros(observed.size - unknowns.size)
    stiff, first = np.append(unknowns.stiff, poses), np.append(unknowns.begin, poses)
    if begin is not None:
        observed.choose_steps(begin, errors.step_tolerance)
        return errors.with_noise(errors.minimum(begin))
    if not any(observed.at(first).solved):
        raise NotConverged('rod: no equilibrium was found for any observation with the first guess')
    starts = [first + shift * stiff for shift in (_STARTS if stiff.any() else _STARTS[:1])]
    if observed.motions:  # they are costly: only the best start is followed, with few steps first
        starts = [min(starts, key=errors.cost)]
    searches = []
    for start in starts:
        searches.append(errors.minimum(start))
        steps.done(len(searches), len(starts) + 1)
    best = min(searches, key=lambda search: search.cost)
    found, statistics = errors.with_noise(
        errors.minimum(best.x) if observed.choose_steps(best.x, errors.step_tolerance) else best)
    steps.done(len(starts) + 1, len(starts) + 1)
    return found, statistics


def _first_mesh(rod: Rod, observations: Sequence[Observation], motions: Sequence[ObservedMotion],
                options: Mapping[str, Any], meshes: Sequence[Mapping[str, Any]]) -> int:
    """Return the index of the first mesh that is fine enough for the first guess."""
    for index in range(len(meshes) - 1):
        direct = DirectSimulator(rod, **{**meshes[index], **options})
        shapes = [direct.solve(one.gripper, far_end=one.far_end) for one in observations]
        for one in motions:
            far_end = None if one.far_ends is None else next(iter(one.far_ends))
            shapes.append(direct.solve(next(iter(one.grippers)), far_end=far_end))
        if _exact(shapes, rod):
            return index
    return len(meshes) - 1


def _exact(shapes: Iterable[Shape], rod: Rod) -> bool:
    """Whether what has been solved is exact enough."""
    return all(shape.error_estimate <= _EXACT * rod.length for shape in shapes if shape.converged)


def _judged(unknowns: Unknowns, observations: Iterable[Observation],
            motions: Iterable[ObservedMotion], options: Mapping[str, Any]) -> _Seen:
    """Return observations and motions as tuples; raise InvalidTask naming what is wrong."""
    motions = items('motions', motions, ObservedMotion)
    observations = items('observations', observations, Observation, least=0 if motions else 1)
    both: dict[str, tuple[Observation | ObservedMotion, ...]] = {
        'observations': observations, 'motions': motions}
    length = unknowns.rod.length
    for kind, seen in both.items():
        for index, one in enumerate(seen):
            check_points(f'{kind}[{index}]', one, length)
    if 'damping' in unknowns.names and not motions:
        raise InvalidTask('parameters: expected motions where damping is to be found')
    known_options(options)
    # sensitivities, which guide the search, are by the components
    choice('strains', options.get('strains', 'components'), ('components',))
    return observations, motions


def _judge_prior(prior: Uncertainty, unknowns: Unknowns) -> None:
    sought = {*unknowns.names}
    for name, held in (('mass', not sought & {'mass_per_length', 'tip_mass'}), ('length', True)):
        if held and getattr(prior, name):
            raise InvalidTask(f'prior.{name} = {getattr(prior, name):g}: expected 0, it is taken '
                              'as known')


def _fit(observed: MeasurementModel, statistics: Statistics, found: OptimizeResult,
         noise: float | None) -> Fit:
    """Return the Fit of SciPy's result; `noise` as it was stated."""
    unknowns, x = observed.unknowns, found.x[:observed.n_parameters]
    correlations = statistics.correlations[np.ix_(unknowns.columns, unknowns.columns)]
    here = observed.at(found.x)
    misfit = float(np.sqrt(np.mean(np.sum(here.away**2, axis=1))))
    doubt = _unexplained(statistics, observed.rod.length, noise, misfit)
    if not doubt and unknowns.run_off(x):
        doubt = (f'{", ".join(unknowns.run_off(x))} ran off, to 1e8 times its first guess or a '
                 f'part of it: {_CHECKS}')
    wider = student_widening(statistics.freedom) if noise is None else 1.0
    return Fit(unknowns.of(x), unknowns.values(x),
               unknowns.deviations(x, wider * statistics.deviations[:unknowns.size]), misfit,
               bool(found.success and all(here.solved) and not doubt), statistics.noise,
               observed.grippers(found.x), correlations,
               1.0 if noise is None else float(np.sqrt(statistics.excess)), doubt,
               tuple(one.points for one in observed.observations),
               tuple(shape.positions for shape in here.shapes[:len(observed.observations)]))


_CHANCE = 1e-4    # that the noise as stated leaves so much: less is none
_KNOWN = 1.5      # factor within which people know the noise of their points: what is left may be
_LARGEST = 0.01   # of the length: noise that is found and can be one, but
_TRACKERS = (0.005, 0.03)  # m: trackers may be so bad with a short DLO, and are not worse
_CHECKS = ('check the axes (x, y, z, not swapped), the unit (m), the frame (world, z up), the pose '
           'of the gripper, and what holds the far end')


def _unexplained(statistics: Statistics, length: float, noise: float | None,
                 misfit: float) -> str:
    """Return why noise cannot be what the rod of a fit leaves, '' if it can."""
    if noise is not None:
        ratio, freedom = np.sqrt(statistics.excess), statistics.freedom
        if ratio <= _KNOWN or chdtrc(freedom, statistics.excess * freedom) >= _CHANCE:
            return ''
        return (f'points are {ratio:.3g} times as far from it as the stated noise of {noise:.3g} m '
                f'tells (misfit {misfit:.3g} m): {_CHECKS}')
    most = float(np.clip(_LARGEST * length, *_TRACKERS))
    if statistics.noise <= most:
        return ''
    return (f'points are off it by {misfit:.3g} m on {length:.3g} m, no noise of a tracker is more '
            f'than {most:.3g} m along each axis: {_CHECKS}')


_DEVIATIONS = (1.0, 1.96)  # within which 68 % and 95 % of the errors ought to be
_MOSTLY = 0.65  # weight of the first


def student_widening(freedom: float) -> float:
    """Return by how much deviations grow whose noise is estimated from `freedom` numbers.

    By what 68 and 95 % of Student's t lie within, against the normal distribution; no factor is
    right for both, a mean is within 5 and 3 points of them from 3 degrees of freedom on.
    """
    factors = [stdtrit(freedom, ndtr(one)) / one for one in _DEVIATIONS]
    return float(np.exp(_MOSTLY * np.log(factors[0]) + (1 - _MOSTLY) * np.log(factors[1])))
