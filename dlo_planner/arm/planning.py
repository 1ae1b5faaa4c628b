# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A gripper's trajectory as the joint trajectory of an arm, with its proof."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from dlo_planner.arm.following import Lost, followed, judge_steps, ways_between
from dlo_planner.arm.joint_trajectory import JointTrajectory, quintic, turning_points
from dlo_planner.arm.proof import judge_curve, smallest_distance, tool_errors
from dlo_planner.arm.robot import Arm
from dlo_planner.arm.solving import Target, choices
from dlo_planner.arm.starts import judge_self_collision, starts
from dlo_planner.errors import Infeasible
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance
from dlo_planner.model.pose import Pose
from dlo_planner.progress import Progress
from dlo_planner.trajectory.timed_path import TimedPath

_STEP = 0.02           # s between points, where that is fine enough
_LEAST, _MOST = 8, 20_000  # points of a leg, of all
_COARSE = 0.05         # m and rad of the tool between points where configurations are compared
_OFF = 2e-5            # m and rad: the tool between points
_HALVINGS = 4          # of the step
_ROLLS = 24            # of the gripper about the DLO, tried in a full turn
_ROLLED = 8, 48        # configurations that are tried with each roll but 0; seeds for them
_SEEDS = 64            # for configurations without a roll


def joint_trajectory(trajectory: TimedPath, arm: Arm, tool: Pose | None = None, *,
                     current: ArrayLike | None = None, free_roll: bool = False,
                     deadline: float | None = None) -> JointTrajectory:
    """Return how an arm's joints move so that its gripper goes along a Trajectory, at its times.

    Configurations in which the arm can begin are followed along the whole way, the nearest one to
    the present joint positions first; the first one is taken in which positions and speeds of all
    joints keep their limits, and links stay clear of each other, at the points and between. If the
    tool is at the beginning now, only the present configuration counts. Where no configuration does
    and `free_roll` is set, the gripper is rolled about the DLO by the same angle all the way, in
    steps of 15 degrees, the least ones first. Nothing is slowed down.

    Not looked at: torques and accelerations of the joints, the arm against obstacles and the DLO.

    Parameters
    ----------
    trajectory : TimedPath
        Trajectory of the gripper frame in the world.
    arm : Arm
    tool : Pose, optional
        Pose of the gripper frame in the frame of the arm's tool link. If None, the same.
    current : array_like, shape (m,), optional
        Present joint positions, rad or m. If None, not known.
    free_roll : bool, optional
        Whether the gripper may be rolled about its x axis, see `rolls_freely`.
    deadline : float, optional
        Seconds of computing.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    Infeasible
        With the waypoint and, of the configuration that came farthest, the constraint: 'reach' (m,
        or rad if only the orientation is left), 'joint_limit' (rad or m), 'joint_speed' (rad/s or
        m/s), 'self_collision' (m), 'continuity' (rad or m).
    DeadlineExceeded
        The deadline is over.
    """
    instance('trajectory', trajectory, TimedPath)
    instance('arm', arm, Arm)
    instance('tool', tool, Pose, optional=True)
    current = None if current is None else arm.checked('current', current)
    course = _Course.of(trajectory, arm, (tool or Pose.identity()).inverse())
    rolls = _rolls() if flag('free_roll', free_roll) else [0.0]
    check = Progress(None, deadline).check
    best: Lost | None = None
    for rolled in map(course.rolled, rolls):
        found, best = _first(rolled, current, check, best)
        if found is not None:
            return found
    assert best is not None  # nothing was found, so something was lost
    if best.attempt is not None:  # what is known of it comes from coarse steps
        try:
            return _proved(best.attempt, check)
        except Lost as lost:
            best = lost if lost.time <= best.time or lost.constraint == best.constraint else best
    raise _refusal(trajectory, best, len(rolls) > 1)


class _Attempt(NamedTuple):
    """A configuration (m,) in which to begin a course, and how strongly joints are centered."""

    course: '_Course'
    start: Floats
    centering: float


def _first(course: '_Course', current: Floats | None, check: Callable[[], object],
           best: Lost | None) -> tuple[JointTrajectory | None, Lost | None]:
    """Return the first JointTrajectory that is found, or None; and the best Lost until then."""
    try:
        begin = starts(course.arm, course.targets([0.0])[0], current,
                       _ROLLED[1] if course.roll else _SEEDS)
    except Lost as lost:
        return None, _better(best, lost)
    attempts = [_Attempt(course, *chosen) for chosen in product(begin, choices(course.arm.chain))]
    for attempt in attempts[:_ROLLED[0]] if course.roll else attempts:
        check()
        try:
            _look_ahead(attempt, check)
            return _proved(attempt, check), best
        except Lost as lost:
            lost.attempt = attempt
            best = _better(best, lost)
    return None, best


@dataclass(frozen=True, eq=False)
class _Course:
    """Where the tool link has to be; `of` makes one.

    Attributes
    ----------
    trajectory : TimedPath
    arm : Arm
    back : Pose
        Pose of the tool link in the gripper frame.
    roll : float
        Roll in rad, by which the gripper is rolled.
    times : ndarray, shape (n,)
        Times in s, of the points with which configurations are compared.
    seen : dict
        Times -> positions and rotations of the gripper in the root link.
    """

    trajectory: TimedPath
    arm: Arm
    back: Pose
    roll: float = 0.0
    times: Floats = field(default_factory=lambda: np.zeros(0))
    seen: dict[bytes, tuple[Floats, Floats]] = field(default_factory=dict)

    @classmethod
    def of(cls, trajectory: TimedPath, arm: Arm, back: Pose) -> '_Course':
        """Return the course of a gripper that is not rolled."""
        course = cls(trajectory, arm, back)
        dense = np.unique(np.concatenate(course.leg_times(_STEP)))
        far = np.cumsum(ways_between(course.targets(dense)))
        marks = np.searchsorted(far, np.linspace(0, far[-1], 2 + int(far[-1] / _COARSE)))
        return replace(course, times=dense[np.unique(
            [0, *np.minimum(marks, dense.size - 1), dense.size - 1])])

    def rolled(self, roll: float) -> '_Course':
        """Return the same with the gripper rolled."""
        turn = Pose.from_rotation(np.zeros(3), Rotation.from_rotvec([roll, 0, 0]).as_matrix())
        return replace(self, back=turn.compose(self.back), roll=roll)

    def targets(self, times: ArrayLike) -> list[Target]:
        """Return positions (3,) and rotations (3, 3) of the tool in the arm's root link."""
        key = np.asarray(times, dtype=float).tobytes()
        if key not in self.seen:
            self.seen[key] = self._grippers(times)
        places, turns = self.seen[key]
        return list(zip(places + turns @ self.back.position, turns @ self.back.rotation,
                        strict=True))

    def _grippers(self, times: ArrayLike) -> tuple[Floats, Floats]:
        grippers, root = self.trajectory.poses(times), self.arm.base
        places, turns = (np.array([getattr(gripper, name) for gripper in grippers])
                         for name in ('position', 'rotation'))
        return (places - root.position) @ root.rotation, root.rotation.T @ turns

    def leg_times(self, step: float) -> list[Floats]:
        """Return for each leg the times (k,) of its points, its beginning and end among them."""
        starts = self.trajectory.starts
        most = _MOST // (len(starts) - 1)
        return [np.linspace(begin, end, 1 + int(np.clip(np.ceil((end - begin) / step),
                                                        _LEAST, max(most - 1, _LEAST))))
                for begin, end in zip(starts, starts[1:], strict=False)]


def _proved(attempt: _Attempt, check: Callable[[], object]) -> JointTrajectory:
    """Return the JointTrajectory that begins in a configuration (m,), or raise Lost."""
    course = attempt.course
    for halvings in range(_HALVINGS):
        legs = course.leg_times(_STEP / 2**halvings)
        times = np.unique(np.concatenate(legs))
        positions = followed(course.arm, course.targets(times), times, attempt.start,
                             attempt.centering, check)
        points = times, positions, *_derivatives(legs, times, positions)
        curve = quintic(*points)
        between = 0.5 * (times[1:] + times[:-1])
        off = tool_errors(course.arm, curve, course.targets(between), between)
        if off.max() <= _OFF:
            break
    else:
        worst = np.unravel_index(np.argmax(off), off.shape)[0]
        raise Lost(f'between two points the tool is off by {off[worst, 0]:.3g} m and '
                   f'{off[worst, 1]:.3g} rad: expected at most {_OFF:g}; the joints turn too '
                   'suddenly', between[worst], 'continuity', float(off.max() - _OFF))
    judge_curve(course.arm, curve, turning_points(curve), turning_points(curve.derivative()))
    distance = smallest_distance(course.arm, curve, check)
    probes = np.sort(np.concatenate([times, between, 0.5 * (times[1:] + between),
                                     0.5 * (times[:-1] + between)]))
    off = tool_errors(course.arm, curve, course.targets(probes), probes).max(axis=0)
    return JointTrajectory(course.arm.joints, *points, float(off[0]), float(off[1]), distance,
                           course.roll, course.arm.collision.missing)


def _look_ahead(attempt: _Attempt, check: Callable[[], object]) -> None:
    """Raise Lost if a configuration cannot be followed in coarse steps already."""
    course, times = attempt.course, attempt.course.times
    positions = followed(course.arm, course.targets(times), times, attempt.start,
                             attempt.centering, check)
    judge_steps(course.arm, positions, times)
    for one, time in zip(positions, times, strict=True):
        judge_self_collision(course.arm, one, time)


def _derivatives(legs: Sequence[Floats], times: Floats, positions: Floats) -> tuple[Floats, Floats]:
    """Return velocities and accelerations (n, m), of cubic splines at rest between the legs."""
    velocities, accelerations = np.zeros((2, *positions.shape))
    for leg in legs:
        here = np.searchsorted(times, leg)
        spline = CubicSpline(leg, positions[here], bc_type='clamped')
        inner = here[1:-1]
        velocities[inner], accelerations[inner] = spline(leg[1:-1], 1), spline(leg[1:-1], 2)
    return velocities, accelerations


def _rolls() -> list[float]:
    """Return the angles to be tried, the least ones first."""
    angles = np.arange(1 - _ROLLS // 2, _ROLLS // 2 + 1) * (2 * np.pi / _ROLLS)
    return sorted(angles.tolist(), key=lambda angle: (abs(angle), angle < 0))


def _better(best: Lost | None, lost: Lost) -> Lost:
    return lost if best is None or lost.rank > best.rank else best


def _refusal(trajectory: TimedPath, lost: Lost, rolled: bool) -> Infeasible:
    """Return the Infeasible that says what a Lost does."""
    waypoint = trajectory.path.goal(trajectory.progress([lost.time])[0]) if lost.time > 0 else 0
    tried = ', however the gripper is rolled' if rolled else ''
    return Infeasible(f'arm, on the way to waypoint {waypoint}, after {lost.time:.3f} s{tried}: '
                      f'{lost.words}', waypoint, lost.constraint, lost.amount)
