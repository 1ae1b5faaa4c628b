# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A gripper's trajectory as the joint trajectory of an arm, checked at the points and between.

One configuration is followed, none is jumped to.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PPoly
from scipy.spatial.transform import Rotation

from dlo_planner.arm.inverse_kinematics import (
    IKFailure,
    Target,
    centered,
    centerings,
    check_limits,
    check_reach,
    check_self_collision,
    initial_configurations,
    solve,
)
from dlo_planner.arm.joint_trajectory import JointTrajectory, quintic, turning_points
from dlo_planner.arm.robot import Arm
from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.equilibria import is_axisymmetric
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.plan import Plan
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
_ITERATIONS = 30
_JUMP = 0.5            # rad or m that a joint may go in one step
_SPEED_ROUNDING = 1e-9
_BISECTIONS = 12       # of a step, until links are known to stay clear of each other on it
_SURE = 1.05           # times the way between samples: what joints may go back and forth


def rolls_freely(simulator: DirectSimulator | GraspedInside, plan: Plan) -> bool:
    """Whether one constant roll of all grippers of a Plan about their x axes changes no shape.

    The DLO has to be straight without stress, equally stiff and thick all around, and elastic (a
    set has a direction); nothing may hold its far end, which would keep the roll there.

    Parameters
    ----------
    simulator : DirectSimulator or GraspedInside
        Simulator of the DLO that the plan is for.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """
    instance('simulator', simulator, (DirectSimulator, GraspedInside))
    instance('plan', plan, Plan)
    rod = simulator.rod
    round_ = rod.section is None or rod.section.kind != 'rectangular'
    loose = all(not shape.holds and shape.parts is None for shape in plan.shapes)
    return bool(round_ and loose and not rod.yields and is_axisymmetric(rod))


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
    path = _ToolPath.of(trajectory, arm, (tool or Pose.identity()).inverse())
    rolls = _rolls() if flag('free_roll', free_roll) else [0.0]
    check = Progress(None, deadline).check
    failures: list[IKFailure] = []
    for rolled in map(path.rolled, rolls):
        found = _first(rolled, current, check, failures)
        if found is not None:
            return found
    best = max(failures, key=lambda failure: failure.rank)
    if best.attempt is not None:  # what is known of it comes from coarse steps
        try:
            return _checked(best.attempt, check)
        except IKFailure as failure:
            if failure.time <= best.time or failure.constraint == best.constraint:
                best = failure
    raise _refusal(trajectory, best, len(rolls) > 1)


class _Attempt(NamedTuple):
    """A configuration (m,) in which to begin a path, and how strongly joints are centered."""

    path: '_ToolPath'
    start: Floats
    centering: float


def _first(path: '_ToolPath', current: Floats | None, check: Callable[[], object],
           failures: list[IKFailure]) -> JointTrajectory | None:
    """Return the first JointTrajectory that is found, or None; failures are added."""
    try:
        begin = initial_configurations(path.arm, path.targets([0.0])[0], current,
                                       _ROLLED[1] if path.roll else _SEEDS)
    except IKFailure as failure:
        failures.append(failure)
        return None
    attempts = [_Attempt(path, *chosen)
                for chosen in product(begin, centerings(path.arm.chain))]
    for attempt in attempts[:_ROLLED[0]] if path.roll else attempts:
        check()
        try:
            _check_coarsely(attempt, check)
            return _checked(attempt, check)
        except IKFailure as failure:
            failure.attempt = attempt
            failures.append(failure)
    return None


@dataclass(frozen=True, eq=False)
class _ToolPath:
    """Where the tool link has to be; `of` makes one."""

    trajectory: TimedPath
    arm: Arm
    back: Pose         # pose of the tool link in the gripper frame
    roll: float = 0.0  # rad, by which the gripper is rolled
    times: Floats = field(default_factory=lambda: np.zeros(0))  # s, of the coarse steps

    @classmethod
    def of(cls, trajectory: TimedPath, arm: Arm, back: Pose) -> '_ToolPath':
        """Return the path of a gripper that is not rolled."""
        path = cls(trajectory, arm, back)
        dense = np.unique(np.concatenate(path.leg_times(_STEP)))
        far = np.cumsum(_distances(path.targets(dense)))
        marks = np.searchsorted(far, np.linspace(0, far[-1], 2 + int(far[-1] / _COARSE)))
        return replace(path, times=dense[np.unique(
            [0, *np.minimum(marks, dense.size - 1), dense.size - 1])])

    def rolled(self, roll: float) -> '_ToolPath':
        """Return the same with the gripper rolled."""
        turn = Pose.from_rotation(np.zeros(3), Rotation.from_rotvec([roll, 0, 0]).as_matrix())
        return replace(self, back=turn.compose(self.back), roll=roll)

    def targets(self, times: ArrayLike) -> list[Target]:
        """Return the Targets of the tool at `times` (n,)."""
        root, (positions, rotations) = self.arm.base, self.trajectory.frames(times)
        places, turns = (positions - root.position) @ root.rotation, root.rotation.T @ rotations
        return list(zip(places + turns @ self.back.position, turns @ self.back.rotation,
                        strict=True))

    def leg_times(self, step: float) -> list[Floats]:
        """Return for each leg the times (k,) of its points, its beginning and end among them."""
        starts = self.trajectory.starts
        most = _MOST // (len(starts) - 1)
        return [np.linspace(begin, end, 1 + int(np.clip(np.ceil((end - begin) / step),
                                                        _LEAST, max(most - 1, _LEAST))))
                for begin, end in zip(starts, starts[1:], strict=False)]


def _check_coarsely(attempt: _Attempt, check: Callable[[], object]) -> None:
    """Raise IKFailure if a configuration cannot be followed in coarse steps already."""
    arm, times = attempt.path.arm, attempt.path.times
    positions = _traced(attempt, times, check)
    speeds = np.abs(np.diff(positions, axis=0)) / np.diff(times)[:, None]
    step, joint = np.unravel_index(np.argmax(speeds / arm.speeds), speeds.shape)
    if speeds[step, joint] > arm.speeds[joint]:
        raise _too_fast(arm, int(joint), speeds[step, joint], times[step + 1], times[-1])
    for one, time in zip(positions, times, strict=True):
        check_self_collision(arm, one, time)


def _checked(attempt: _Attempt, check: Callable[[], object]) -> JointTrajectory:
    """Return the JointTrajectory of an attempt, or raise IKFailure."""
    path, arm = attempt.path, attempt.path.arm
    for halvings in range(_HALVINGS):
        legs = path.leg_times(_STEP / 2**halvings)
        times = np.unique(np.concatenate(legs))
        positions = _traced(attempt, times, check)
        points = times, positions, *_derivatives(legs, times, positions)
        curve = quintic(*points)
        between = 0.5 * (times[1:] + times[:-1])
        off = _tool_errors(path, curve, between)
        if off.max() <= _OFF:
            break
    else:
        worst = np.unravel_index(np.argmax(off), off.shape)[0]
        raise IKFailure(f'between two points the tool is off by {off[worst, 0]:.3g} m and '
                        f'{off[worst, 1]:.3g} rad: expected at most {_OFF:g}; the joints turn too '
                        'suddenly', between[worst], 'continuity', float(off.max() - _OFF),
                        ('m', 'rad')[int(off[worst].argmax())])
    _check_curve(arm, curve)
    distance = smallest_distance(arm, curve, check)
    probes = np.sort(np.concatenate([times, between, 0.5 * (times[1:] + between),
                                     0.5 * (times[:-1] + between)]))
    off = _tool_errors(path, curve, probes).max(axis=0)
    return JointTrajectory(arm.joints, *points, float(off[0]), float(off[1]), distance, path.roll,
                           arm.collision.missing)


def _traced(attempt: _Attempt, times: Floats, check: Callable[[], object]) -> Floats:
    """Return joint positions (n, m) that place the tool at n times, each from the one before."""
    path, out = attempt.path, [attempt.start]
    arm, chain, targets = path.arm, path.arm.chain, path.targets(times)
    for target, time, distance in list(zip(targets, times, _distances(targets), strict=True))[1:]:
        check()
        if not distance:
            out.append(out[-1])
            continue
        begin = centered(chain, out[-1], target, attempt.centering * distance)
        found = solve(chain, begin, target, _ITERATIONS)
        if not found.reached:  # joints that are heavy near their limits may have hindered it
            found = solve(chain, out[-1], target, _ITERATIONS, plain=True)
        check_reach(found, time)
        moved = np.abs(found.positions - out[-1])
        if moved.max() > _JUMP:
            joint = int(np.argmax(moved))
            raise IKFailure(f'{arm.joints[joint]} would have to go from {out[-1][joint]:.4g} to '
                            f'{found.positions[joint]:.4g} at once: the arm is stretched or folded '
                            'up there (a singularity)', time, 'continuity',
                            float(moved.max() - _JUMP), arm.units[joint])
        check_limits(arm, found.positions, time)
        out.append(found.positions)
    return np.array(out)


def _distances(targets: Sequence[Target]) -> Floats:
    """Return (n,) how far, in m and rad together, each target is from the one before; 0 first."""
    places, turns = map(np.array, zip(*targets, strict=True))
    angles = Rotation.from_matrix(turns[1:] @ turns[:-1].transpose(0, 2, 1)).magnitude()
    return np.append(0.0, np.linalg.norm(np.diff(places, axis=0), axis=1) + angles)


def _derivatives(legs: Sequence[Floats], times: Floats, positions: Floats) -> tuple[Floats, Floats]:
    """Return velocities and accelerations (n, m), of cubic splines at rest between the legs."""
    velocities, accelerations = np.zeros((2, *positions.shape))
    for leg in legs:
        here = np.searchsorted(times, leg)
        spline = CubicSpline(leg, positions[here], bc_type='clamped')
        inner = here[1:-1]
        velocities[inner], accelerations[inner] = spline(leg[1:-1], 1), spline(leg[1:-1], 2)
    return velocities, accelerations


def _tool_errors(path: _ToolPath, curve: PPoly, times: Floats) -> Floats:
    """Return (n, 2) by how many m and rad the tool is off at `times` (n,)."""
    out = []
    for positions, (place, turn) in zip(curve(times), path.targets(times), strict=True):
        here, axes = path.arm.chain.placement(positions)
        out.append((np.linalg.norm(here - place), angle_between(axes, turn)))
    return np.array(out)


def _check_curve(arm: Arm, curve: PPoly) -> None:
    """Raise IKFailure unless positions and speeds keep the limits at their extremes."""
    times = np.unique(np.concatenate(turning_points(curve)))
    for time, positions in zip(times, curve(times), strict=True):
        check_limits(arm, positions, time)
    used = []
    for joint, times in enumerate(turning_points(curve.derivative())):
        speeds = np.abs(curve(times, 1)[:, joint])
        top = int(np.argmax(speeds))
        used.append((speeds[top] / arm.speeds[joint], joint, speeds[top], times[top]))
    part, joint, speed, time = max(used)
    if part > 1 + _SPEED_ROUNDING:
        raise _too_fast(arm, joint, speed, time, curve.x[-1])


def smallest_distance(arm: Arm, curve: PPoly, check: Callable[[], object]) -> float:
    """Return the smallest distance between links on the way, m, as far as there are samples.

    Between two samples of a pair's distance it is no less than half of their sum, less half of what
    the joints' way moves a link at most. A step in which that is too little is halved.
    """
    collision = arm.collision
    if not collision.pairs:
        return np.nan if collision.missing else np.inf
    samples: dict[float, tuple[Floats, float]] = {}

    def sample(time: float) -> tuple[Floats, float]:
        if time not in samples:
            positions = curve(time)
            samples[time] = positions, check_self_collision(arm, positions, time)
        return samples[time]

    steps = [(*step, 0) for step in zip(curve.x, curve.x[1:], strict=False)]
    while steps:
        check()
        begin, end, bisections = steps.pop()
        middle = 0.5 * (begin + end)
        (here, one), (there, other) = sample(begin), sample(end)
        through = curve(middle)
        way = _SURE * collision.way(np.abs(through - here) + np.abs(there - through))
        if one + other - way <= 2 * arm.self_clearance and bisections < _BISECTIONS:
            steps += [(middle, end, bisections + 1), (begin, middle, bisections + 1)]
    return min(distance for _, distance in samples.values())


def _too_fast(arm: Arm, joint: int, speed: float, time: float, end: float) -> IKFailure:
    """Return the IKFailure of a joint that goes the whole way, until `end` s, but too fast."""
    most, unit = arm.speeds[joint], arm.units[joint]
    return IKFailure(f'{arm.joints[joint]} moves at {speed:.6g} {unit}/s: expected at most '
                     f'{most:.6g}; the motion would have to be {speed / most:.4g} times slower',
                     time, 'joint_speed', float(speed - most), f'{unit}/s',
                     (float(end), float(most / speed)))


def _rolls() -> list[float]:
    """Return the angles to be tried, the least ones first."""
    angles = np.arange(1 - _ROLLS // 2, _ROLLS // 2 + 1) * (2 * np.pi / _ROLLS)
    return sorted(angles.tolist(), key=lambda angle: (abs(angle), angle < 0))


def _refusal(trajectory: TimedPath, failure: IKFailure, rolled: bool) -> Infeasible:
    """Return the Infeasible that says what an IKFailure does."""
    waypoint = 0
    if failure.time > 0:
        waypoint = trajectory.path.goal(trajectory.progress([failure.time])[0])
    tried = ', however the gripper is rolled' if rolled else ''
    return Infeasible(f'arm, on the way to waypoint {waypoint}, after {failure.time:.3f} s{tried}: '
                      f'{failure.words}', waypoint, failure.constraint, failure.amount,
                      unit=failure.unit)
