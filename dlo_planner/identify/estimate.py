# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known of a DLO and of its gripper after some looks, and by how much it will miss.

A mean and a covariance: of the numbers that are uncertain, and of the misses at the centers of a
plan.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.plain_tasks import write_value
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import (
    array,
    figure,
    flag,
    instance,
    integer,
    items,
    number,
    results,
    row,
    shown,
    vector,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Sheet
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, put
from dlo_planner.pictured import Reported
from dlo_planner.plan.goals import Through
from dlo_planner.plan.margin import miss_slopes
from dlo_planner.plan.plan import Passes, Plan, moved_sheet, passages
from dlo_planner.uncertainty.state import CameraError, PointSlopes, UncertainState

_LEAST_LINK = 1e-3  # of the robot's time or way: links between errors stay regular
_ROUGH = 2.5      # times the way of a smooth process: then both change alike in that way
_MOST = 1_000_000  # largest index of a waypoint
SHARE = 0.95     # probability that a bound is kept
_POINTS = 1024    # that represent a normal distribution in a plane
_DRAWN = 4096     # misses at all waypoints together
_OTHER = 0.1      # of the length: a shape whose length differs by more is of another DLO
_SAME_CENTER = 1e-9  # m: centers of one cut-out, but for rounding
_LEVER = 0.25     # m, of a turn: about that of a wrist, whose joints cause the error


@dataclass(frozen=True, eq=False)
class RobotError(Value):
    """The robot's error that is not constant: true pose less constant offset less measured pose.

    That of a robot repeats itself: it is a smooth function of the pose. It may change with time as
    well. A Gaussian process in each of the p components whose deviation is not 0.
    """

    deviations: Floats   # (6,) of the rotation vector, rad, and of the position, m
    # of the gripper, in which its correlation falls to exp(-1/2), m; see `way_between`
    way: float = np.inf
    time: float = np.inf  # in which it falls to 1 / e, s; infinite: the error repeats itself

    @property
    def acting(self) -> Floats:
        """Indices (p,) of the components that are not 0."""
        return cast(Floats, np.flatnonzero(self.deviations))

    def twist(self, e: Floats) -> Floats:
        """Return the error (6,) in rad, m of p numbers e in standard deviations."""
        out = np.zeros(6)
        out[self.acting] = e * self.deviations[self.acting]
        return out

    @property
    def repeats(self) -> bool:
        """Whether what was seen of it is still true later, near the same pose."""
        return bool(np.isinf(self.time))

    def link(self, elapsed: float, moved: float) -> float:
        """Return the correlation (below 1) of the errors at looks `elapsed` s and `moved` m apart.

        That of an Ornstein-Uhlenbeck process, which a filter can follow from look to look.
        """
        return float(np.exp(-max(elapsed / self.time + moved / (_ROUGH * self.way), _LEAST_LINK)))

    def change(self, moved: float) -> float:
        """Return the variance of the change in a way in m, over the square of the deviations."""
        return float(-2 * np.expm1(-0.5 * (moved / self.way) ** 2))


def way_between(one: Pose, other: Pose) -> float:
    """Return the way from one Pose to another, m: of the origin, and of a turn by a lever."""
    return float(np.linalg.norm(other.position - one.position)
                 + _LEVER * angle_between(one.rotation, other.rotation))


@dataclass(frozen=True, eq=False, repr=False)
class PredictedMiss(Value):
    """Misses at waypoints of a plan: by how much the DLO passes beside k centers.

    Attributes
    ----------
    waypoints : ndarray, shape (k,)
        Indices of the waypoints in the plan, once for each center that one passes.
    off : ndarray, shape (k, 3)
        Vectors in m from the center to where the estimated DLO is nearest to it, world axes; a DLO
        that is too short is extended straight on.
    joint : ndarray, shape (3 k, 3 k)
        Covariance of all of `off` across the DLO, m^2: waypoint by waypoint, in each x, y, z.
    bound : ndarray, shape (k,)
        Radii about the center inside which the DLO passes with a probability of 95 %, m; infinite
        where no shape was found.
    """

    waypoints: Floats
    off: Floats
    joint: Floats
    bound: Floats

    def __post_init__(self) -> None:
        waypoints = row('PredictedMiss.waypoints', self.waypoints, least=0, minimum=0,
                        maximum=_MOST)
        parts = {name: results(f'PredictedMiss.{name}', getattr(self, name), shape)
                 for name, shape in (('off', (None, 3)), ('joint', (None, None)),
                                     ('bound', (None,)))}
        for name, count in (('off', 1), ('joint', 3), ('bound', 1)):
            if {*parts[name].shape[:2 if name == 'joint' else 1]} != {count * waypoints.size}:
                raise InvalidTask(f'PredictedMiss.{name} has shape {parts[name].shape}, '
                                  f'PredictedMiss.waypoints {waypoints.size} entries: expected '
                                  f'{count} for each')
        put(self, waypoints=waypoints.astype(int), **parts)
        super().__post_init__()

    def __repr__(self) -> str:
        worst = self.bound.max(initial=0.0)
        return brief(self, f'{np.unique(self.waypoints).size} waypoints',
                     f'most likely up to {self.distance.max(initial=0.0):.2g} m',
                     f'with 95 % up to {worst:.2g} m')

    @property
    def distance(self) -> Floats:
        """Most likely distances (k,) from the centers, m."""
        result: Floats = np.linalg.norm(self.off, axis=1)
        return result

    @property
    def covariance(self) -> Floats:
        """Covariances (k, 3, 3) of `off`, m^2."""
        k = np.arange(self.waypoints.size)
        return self.joint.reshape(k.size, 3, k.size, 3)[k, :, k]

    @property
    def together(self) -> float:
        """Radius inside which the DLO passes all centers at all waypoints with 95 %, m.

        The quantile of the largest miss of 4096 draws from the normal distribution of all, always
        the same; their share of 95 % is right to 0.4 %.
        """
        if not self.bound.size:
            return 0.0
        if not np.isfinite(self.bound).all():
            return float('inf')
        drawn = self.off.ravel() + np.random.default_rng(0).standard_normal(
            (_DRAWN, self.off.size)) @ _root(self.joint)
        misses = np.linalg.norm(drawn.reshape(_DRAWN, -1, 3), axis=2).max(axis=1)
        return float(np.quantile(misses, SHARE))

    def inside(self, room: float) -> bool:
        """Return whether every bound is at most `room` (m)."""
        room = number('room', room, minimum=0)
        return bool((self.bound <= room).all())


def bound_of(off: Floats, covariance: Floats) -> float:
    """Return the radius about a center that holds 95 % of a normal distribution in a plane.

    The plane is that of the largest deviations. Shapes: off (d,), covariance (d, d), d = 2, 3.
    """
    axes = np.linalg.eigh(covariance + np.outer(off, off))[1][:, -2:].T
    axes *= np.copysign(1.0, axes @ off)[:, None]  # eigenvectors have no sign of their own
    points = axes @ off + _PLANE @ _root(axes @ covariance @ axes.T)  # all equally likely
    return float(np.quantile(np.linalg.norm(points, axis=1), SHARE))


def _root(covariance: Floats) -> Floats:
    """Return the symmetric square root (n, n) of a covariance (n, n).

    It is the only one: points that are drawn by eigenvectors alone change with their signs, and
    with the axes of equal deviations, which rounding chooses.
    """
    values, vectors = np.linalg.eigh(covariance)
    result: Floats = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return result


def _plane() -> Floats:
    """Return equally likely points (k, 2) of a standard normal distribution: a golden spiral."""
    k = np.arange(_POINTS)
    radii = np.sqrt(-2 * np.log1p(-(k + 0.5) / _POINTS))
    angles = np.pi * (3 - np.sqrt(5)) * k
    result: Floats = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return result


_PLANE = _plane()


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Reported):
    """A normal distribution of the n numbers that are uncertain; an `Observer` makes it.

    Attributes
    ----------
    uncertain : UncertainState
        The meaning of the numbers.
    mean : ndarray, shape (n,)
        Logarithms of factors, 1/m, rad, m, as in `names`.
    covariance : ndarray, shape (n, n)
        Covariance of the same numbers.
    looks : int
        Number of observations that it rests on.
    converged : bool
        Whether the last observation could be used; if not, this is the one before it.
    misfit : float
        Root mean square distance of the points of the last look from the DLO, m, each weighed by
        the probability that it belongs to the DLO; nan before the first look.
    outliers : float
        Part of the same points that seem not to belong to the DLO; nan before the first.
    normalized_innovation : float
        How far the last look is from what was expected before it: the largest of the chi-square by
        which it moved the state, of that by which it and those shortly before it together moved the
        free end, of that of the points' distances after it, and of the outliers, each by the value
        that one look in 10,000 exceeds by chance; nan before the first.
    robot : RobotError
        How the robot's error changes; see `Observer`.
    """

    uncertain: UncertainState
    mean: Floats
    covariance: Floats
    looks: int = 0
    converged: bool = True
    misfit: float = np.nan
    outliers: float = np.nan
    normalized_innovation: float = np.nan
    robot: RobotError = RobotError(np.zeros(6))
    _shape: Shape | None = field(default=None, compare=False)
    _memory: Any = field(default=None, compare=False)  # of the looks, see `identify.smoother`

    def __post_init__(self) -> None:
        n = instance('Estimate.uncertain', self.uncertain, UncertainState).size
        put(self, mean=results('Estimate.mean', self.mean, (n,)),
            covariance=results('Estimate.covariance', self.covariance, (n, n)),
            looks=integer('Estimate.looks', self.looks, minimum=0, maximum=10**12),
            converged=flag('Estimate.converged', self.converged),
            misfit=figure('Estimate.misfit', self.misfit),
            outliers=figure('Estimate.outliers', self.outliers),
            normalized_innovation=figure('Estimate.normalized_innovation',
                                         self.normalized_innovation))
        if not (np.isfinite(self.mean).all() and np.isfinite(self.covariance).all()):
            raise InvalidTask('Estimate.mean, Estimate.covariance: expected finite numbers')
        instance('Estimate.robot', self.robot, RobotError)
        instance('Estimate._shape', self._shape, Shape, optional=True)
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f'{self.looks} looks',
                     '' if self.converged else 'last one not converged',
                     f'misfit {self.misfit:.2g} m' if self.looks else '',
                     '' if not self.normalized_innovation > 1 else
                     f'normalized innovation {self.normalized_innovation:.2g}',
                     f'{self.uncertain.size} numbers')

    def save(self, path: str | PathLike[str]) -> None:
        """Write what it says as JSON, not what it remembers of the looks: for records."""
        write_value(path, {name: getattr(self, name) for name in (
            'values', 'deviations', 'covariance', 'looks', 'converged', 'misfit', 'outliers',
            'normalized_innovation')})

    @property
    def surprise(self) -> float:
        """The earlier name of `normalized_innovation`, for one release."""
        return self.normalized_innovation

    @property
    def agrees(self) -> bool:
        """Whether the last look could be used and is what could be expected before it."""
        return self.converged and not self.normalized_innovation > 1

    @property
    def inflation(self) -> float:
        """By what the covariance is to be multiplied, since looks disagree more than they should.

        The mean of their chi-squares by their degrees of freedom (Birge's ratio), at least 1; the
        `bound` of a predicted miss contains it.
        """
        return 1.0 if self._memory is None else float(self._memory.consistency.inflation)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n numbers."""
        return self.uncertain.names

    @property
    def values(self) -> FrozenDict:
        """Dict of the n numbers by name, in logarithms of factors, 1/m, rad, m."""
        return FrozenDict(zip(self.names, self.mean.tolist(), strict=True))

    @property
    def deviations(self) -> FrozenDict:
        """Dict of their standard deviations."""
        return FrozenDict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def rod(self) -> Rod:
        """Estimated Rod. Its ratio of stiffness to weight is known; each by itself is not."""
        return self.uncertain.rod(self.mean)

    @property
    def simulator(self) -> DirectSimulator:
        """DirectSimulator of the estimated Rod, without obstacles, for a new plan."""
        return self.uncertain.simulator.with_rod(self.rod)

    @property
    def gripper_offset(self) -> Pose:
        """Estimated true Pose of the gripper in the frame of the commanded one.

        With the robot's error where the DLO was seen last, if that repeats itself.
        """
        return self.uncertain.offset(self.mean, self.robot_error)

    @property
    def robot_error(self) -> Floats:
        """Robot's error (6,) that is expected where the DLO was seen last: rad, m."""
        if self._memory is None or not self.robot.repeats:
            return np.zeros(6)
        return self.robot.twist(self._memory.mean[self.mean.size:])

    @property
    def joint_covariance(self) -> Floats:
        """Covariance (n + 6, n + 6) of the n numbers and of `robot_error`."""
        n = self.mean.size
        out = np.zeros((n + 6, n + 6))
        out[:n, :n] = self.covariance
        if self._memory is not None and self.robot.repeats:
            acting = self.robot.acting
            unit = np.append(self.uncertain.deviations, self.robot.deviations[acting])
            own = np.append(np.arange(n), n + acting)
            out[own[:, None], own] = self._memory.covariance * np.outer(unit, unit)
        return out

    def robot_change(self, gripper: Pose, seen: Pose | None = None) -> float:
        """Return the variance by which the robot's error at a Pose differs from where it was seen.

        It is given over the square of the error's deviations.

        Parameters
        ----------
        gripper : Pose
            Measured pose.
        seen : Pose, optional
            Measured pose where the DLO will have been seen last. If None, where it was.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        instance('gripper', gripper, Pose)
        instance('seen', seen, Pose, optional=True)
        keyframes = () if self._memory is None else self._memory.keyframes
        if not keyframes or not self.robot.repeats:
            return 1.0
        return self.robot.change(way_between(seen or keyframes[-1].gripper, gripper))

    @property
    def last_shape(self) -> Shape | None:
        """Shape of the DLO in the last look that could be used; None before the first."""
        return self._shape

    @property
    def camera_bias(self) -> Floats:
        """Estimated bias (3,) of the camera at its reference point, seen minus true, m."""
        return self.camera_error.bias

    @property
    def camera_error(self) -> CameraError:
        """Estimated error of the camera: how it sees what is anywhere else."""
        reference = None if self._memory is None else self._memory.reference
        return self.uncertain.camera(self.mean, np.zeros(3) if reference is None else reference)

    @property
    def camera_scale(self) -> float:
        """How many times as far off as stated the camera is taken to be, at least 1.

        The most likely multiple of the deviations of its bias and of its rotation together: where
        looks tell that one of them is farther off, what no look tells of the others is less certain
        as well.
        """
        return 1.0 if self._memory is None else float(self._memory.camera_scale)

    @property
    def delay(self) -> float:
        """Estimated delay of the stamps of looks, s."""
        return self.uncertain.delay(self.mean)

    def actual(self, gripper: Pose) -> Pose:
        """Return the estimated true Pose of the gripper that is commanded to `gripper`."""
        result: Pose = instance('gripper', gripper, Pose).compose(self.gripper_offset)
        return result

    def commanded(self, gripper: Pose) -> Pose:
        """Return the Pose to command so that the true pose of the gripper is `gripper`."""
        result: Pose = instance('gripper', gripper, Pose).compose(self.gripper_offset.inverse())
        return result

    def center(self, center: ArrayLike) -> Floats:
        """Return the estimated true center (3,) of a cut-out that is stated at `center` (3,), m."""
        return vector('center', center, 3) + self.uncertain.shifted(self.mean)

    def moved_cutout(self, cutout: CutOut) -> CutOut:
        """Return a stated CutOut, moved to its estimated true place."""
        pose = instance('cutout', cutout, CutOut).pose
        return replace(cutout, pose=Pose(self.center(pose.position), pose.quaternion))

    def moved_obstacles(self, obstacles: Iterable[Obstacle],
                        centers: ArrayLike) -> tuple[Obstacle, ...]:
        """Return obstacles where they are estimated: a sheet moves along with its cut-outs.

        Parameters
        ----------
        obstacles : iterable
            As stated.
        centers : array_like, shape (k, 3)
            Centers, as stated, of the cut-outs that are seen, m: sheets with one of these move,
            what else stands around does not.
        """
        shift, seen = self.center(np.zeros(3)), array('centers', centers, (None, 3))
        bodies = items('obstacles', obstacles, OBSTACLES)
        return tuple(
            moved_sheet(body, shift) if isinstance(body, Sheet) and any(
                (np.abs(seen - one.center).max(axis=1, initial=0.0) <= _SAME_CENTER).any()
                for one in body.cutouts) else body for body in bodies)

    def shape(self, gripper: Pose) -> Shape:
        """Return the estimated Shape of the DLO with the gripper commanded to `gripper`.

        The DLO hangs freely. It comes from its shape at the last look; before the first look it is
        set down in its natural shape.
        """
        actual = self.actual(gripper)
        mesh = self.uncertain.simulator.discretization(actual, None)
        return self.uncertain.equilibrium(self.mean, mesh, actual, self._shape)

    def miss(self, plan: Plan, waypoints: ArrayLike | None = None,
             seen: Sequence[Pose] | None = None) -> PredictedMiss:
        """Return the PredictedMiss of the DLO at waypoints of a commanded plan.

        Parameters
        ----------
        plan : Plan
            Plan whose poses are commanded, and whose centers are as stated.
        waypoints : array_like, shape (k,), optional
            Indices of waypoints that pass a center. If None, all that do.
        seen : sequence of Pose, optional
            For each of them the measured Pose of the gripper at the last look by which it will have
            been corrected. If None, there will be no look any more.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        length = self.uncertain.simulator.rod.length
        chosen = passing = [k for k, passes in enumerate(instance('plan', plan, Plan).via_points)
                            if passes]
        if waypoints is not None:
            chosen = [int(k) for k in row('waypoints', waypoints, minimum=0, maximum=_MOST)]
            if len(chosen) > len(plan) or not {*chosen} <= {*passing}:
                raise InvalidTask(f'waypoints = {shown(chosen)}: expected indices of waypoints '
                                  f'that pass a center, out of {shown(passing)}')
        for shape in (plan.shapes[k] for k in chosen):
            if shape.state.mesh is None or shape.parts is not None or (
                    abs(shape.s[-1] / length - 1) > _OTHER):
                raise InvalidTask('plan: expected shapes of the whole DLO that is estimated')
        if seen is not None and len(items('seen', seen, Pose)) != len(chosen):
            raise InvalidTask(f'seen has {len(seen)} entries: expected one for each waypoint, '
                              f'{len(chosen)}')
        return miss_of(self, plan, chosen, seen=seen)


def passages_in(estimate: Estimate, passes: Passes) -> tuple[Through, ...]:
    """Return the goals of the places to be passed, at their estimated true centers."""
    return passages([(estimate.center(center), s, normal) for center, s, normal in passes],
                    estimate.uncertain.simulator.rod.length)


def miss_of(estimate: Estimate, plan: Plan, waypoints: Sequence[int],
            shapes: Sequence[Shape] | None = None,
            seen: Sequence[Pose] | None = None) -> PredictedMiss:
    """Return the PredictedMiss of an Estimate at some waypoints of a Plan, with known `shapes`."""
    goals = [passages_in(estimate, plan.via_points[index]) for index in waypoints]
    places = np.array([k for k, own in zip(waypoints, goals, strict=True) for _ in own], dtype=int)
    count, n, error = places.size, estimate.mean.size, estimate.robot_error
    off, bound = np.full((count, 3), np.inf), np.full(count, np.inf)
    rows, changed = np.zeros((count, 3, n + 6)), np.zeros(count)
    known = estimate.inflation * estimate.joint_covariance
    robot = estimate.inflation * np.diag(estimate.robot.deviations**2)
    end = 0
    for k, index in enumerate(waypoints):
        begin, end = end, end + len(goals[k])
        planned = plan.shapes[index]
        shape = estimate.uncertain.equilibrium(
            estimate.mean, planned.state.made_on, estimate.actual(plan.grippers[index]), planned,
            followed=False) if shapes is None else shapes[k]
        if not shape.converged:
            continue
        slopes = estimate.uncertain.slopes(estimate.mean, shape, error)
        changed[begin:end] = estimate.robot_change(plan.grippers[index],
                                                   None if seen is None else seen[k])
        for at, goal in enumerate(goals[k], begin):
            off[at], rows[at], bound[at] = _miss_at(estimate, slopes, known, changed[at] * robot,
                                                    goal)
    # what the robot's error changes until one waypoint it has changed until those after it as well,
    # unless it is seen meanwhile, or wanders in time
    once = estimate.robot.repeats and seen is None
    also = np.where(np.logical_or(once, np.equal.outer(places, places)),
                    np.minimum.outer(changed, changed), 0.0)
    late = rows[:, :, n:]
    joint = (np.einsum('kia,ab,ljb->kilj', rows, known, rows)
             + np.einsum('kl,kia,ab,ljb->kilj', also, late, robot, late))
    # what is not known of the place of one cut-out is not that of another
    columns, _ = estimate.uncertain.columns('cutout')
    centers = np.array([center for k in waypoints for center, _, _ in plan.via_points[k]]
                       ).reshape(-1, 3)
    others, own = (centers[:, None] != centers).any(axis=2), rows[:, :, columns]
    joint -= np.einsum('kl,kia,ab,ljb->kilj', others, own, known[columns[:, None], columns], own)
    joint[~np.isfinite(bound)] = joint[:, :, ~np.isfinite(bound)] = np.inf
    return PredictedMiss(places.astype(float), off, joint.reshape(3 * count, 3 * count), bound)


def _miss_at(estimate: Estimate, slopes_at: PointSlopes, known: Floats, later: Floats,
             goal: Through) -> tuple[Floats, Floats, float]:
    """Return the miss (3,) of one goal, m, its slopes (3, n + 6) and its bound, m."""
    off, slopes, across = miss_slopes(slopes_at, goal)
    columns, number = estimate.uncertain.columns('cutout')
    slopes[:, columns] -= across[:, number]
    robot = slopes[:, estimate.mean.size:]
    covariance = slopes @ known @ slopes.T + robot @ later @ robot.T
    return off, slopes, bound_of(off, covariance)
