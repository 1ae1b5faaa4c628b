"""A plan as a smooth motion in time: splines through its poses, slowed to the robot's limits."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.plan import Plan
from dlo_planner.model.checks import instance, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put

_SAMPLES = 20      # per waypoint, at which speeds and accelerations are looked at, and
_FEWEST = 800      # in all
_CORNER = 0.5      # cosine between legs: a sharper turn is a corner
_AT_ONCE = 1e-9    # s: waypoints nearer in time are one
_MOST = 100_000    # times asked for at once


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Value):
    """Of the gripper; each may be infinite.

    Attributes:
        linear_speed: m/s; angular_speed: rad/s
        linear_acceleration: m/s^2; angular_acceleration: rad/s^2
        ramp: part of the time in which the gripper starts, and stops, 0 < ramp <= 0.5. Short ones
            set the DLO swinging: where the miss in motion counts, long ones are faster in the end.
    """

    linear_speed: float = 0.1
    angular_speed: float = 0.5
    linear_acceleration: float = 0.5
    angular_acceleration: float = 2.0
    ramp: float = 0.3

    def __post_init__(self):
        for name in ('linear_speed', 'angular_speed', 'linear_acceleration',
                     'angular_acceleration'):
            value = getattr(self, name)
            put(self, **{name: np.inf if isinstance(value, float) and value == np.inf
                         else number(f'Limits.{name}', value, above=0)})
        put(self, ramp=number('Limits.ramp', self.ramp, above=0, maximum=0.5))


class Trajectory(Value):
    """The gripper's way in time: at rest at both ends, continuous acceleration between.

    SciPy's cubic spline of the positions and its rotation spline run through the plan's poses. It
    starts and stops by smooth ramps, and is slowed down evenly until the limits hold. Where the way
    has a corner, the gripper stops: each part between is such a way of its own.

    Args:
        plan: Plan with two poses at different times at least
        limits: Limits

    Raises:
        InvalidTask: naming the argument
    """

    PARTS = ('plan', 'limits')

    def __init__(self, plan, limits=None):
        instance('plan', plan, Plan)
        limits = Limits() if limits is None else instance('limits', limits, Limits)
        times, grippers = [], []
        for time, gripper in zip(plan.times, plan.grippers, strict=True):
            if not times or time - times[-1] > _AT_ONCE:
                times.append(float(time))
                grippers.append(gripper)
        if len(times) < 2:
            raise InvalidTask(f'plan has {len(times)} poses at different times: expected two or '
                              'more')
        stops = [0, *_corners(grippers, plan.shapes[0].s[-1]), len(times) - 1]
        parts = [_Part(times[a:b + 1], grippers[a:b + 1], limits)
                 for a, b in zip(stops, stops[1:], strict=False)]
        ends = np.cumsum([part.duration for part in parts])
        put(self, plan=plan, limits=limits, _parts=parts, _ends=ends, duration=float(ends[-1]))

    def __reduce__(self):
        return type(self), (self.plan, self.limits)

    def __repr__(self):
        return brief(self, f'{self.duration:.4g} s', repr(self.plan))

    def at(self, times):
        """Return Poses (list), velocities (n, 6) and accelerations (n, 6) at `times` (n,) s.

        Linear before angular, world axes, m/s, rad/s, m/s^2, rad/s^2; angular ones as SciPy's
        rotation spline gives them. At rest outside [0, duration].
        """
        which, since = self._split(times)
        poses, speeds, accelerations = [None] * since.size, *np.empty((2, since.size, 6))
        for k, part in enumerate(self._parts):
            here = np.flatnonzero(which == k)
            if here.size:
                position, turns, speeds[here], accelerations[here] = part.at(since[here])
                for index, *pose in zip(here, position, turns, strict=True):
                    poses[index] = Pose.from_rotation(*pose)
        return poses, speeds, accelerations

    def progress(self, times):
        """Return the plan's own times (n,), as in `Plan.times`, that are reached at `times` s."""
        which, since = self._split(times)
        done = np.empty(since.size)
        for k, part in enumerate(self._parts):
            done[which == k] = part.progress(since[which == k])
        return done

    def _split(self, times):
        """Return indices of parts (n,) and the times (n,) since their beginnings."""
        times = np.clip(row('times', times, most=_MOST), 0, self.duration)
        which = np.minimum(np.searchsorted(self._ends, times), len(self._parts) - 1)
        begins = np.append(0.0, self._ends[:-1])
        return which, times - begins[which]


class _Part:
    """A way without corners, from rest to rest."""

    def __init__(self, times, grippers, limits):
        turns = Rotation.from_matrix(np.array([gripper.rotation for gripper in grippers]))
        self._start = times[0]
        times = np.array(times) - times[0]
        self._position = CubicSpline(times, [gripper.position for gripper in grippers])
        self._turn = RotationSpline(times, turns)
        self._end, self._ramp = times[-1], limits.ramp
        self._slower = self._slowdown(limits)
        self.duration = self._end * self._slower

    def _slowdown(self, limits):
        samples = np.linspace(0, self._end, max(_FEWEST, _SAMPLES * self._position.x.size))
        _, speeds, accelerations = self._sampled(samples)
        speed, turning = (np.linalg.norm(v, axis=1).max() for v in np.split(speeds, 2, axis=1))
        force, torque = (np.linalg.norm(v, axis=1).max()
                         for v in np.split(accelerations, 2, axis=1))
        return max(speed / limits.linear_speed, turning / limits.angular_speed,
                   np.sqrt(force / limits.linear_acceleration),
                   np.sqrt(torque / limits.angular_acceleration), 1e-9)

    def _sampled(self, times):
        """Return times of the splines, speeds (n, 6) and accelerations (n, 6), not slowed down."""
        share = np.clip(times / self._end, 0, 1)
        late = share > 0.5
        done, rate, change = _started(np.where(late, 1 - share, share), self._ramp)
        done = np.where(late, 1 - done, done) * self._end
        change = np.where(late, -change, change) / self._end
        speed = np.hstack([self._position(done, 1), self._turn(done, 1)])
        acceleration = np.hstack([self._position(done, 2), self._turn(done, 2)])
        return (done, rate[:, None] * speed,
                change[:, None] * speed + rate[:, None] ** 2 * acceleration)

    def at(self, times):
        """Return positions (n, 3), rotations (n, 3, 3), speeds and accelerations (n, 6)."""
        done, speed, acceleration = self._sampled(times / self._slower)
        return (self._position(done), self._turn(done).as_matrix(), speed / self._slower,
                acceleration / self._slower**2)

    def progress(self, times):
        """Return the plan's times (n,)."""
        return self._start + self._sampled(times / self._slower)[0]


def _corners(grippers, length):
    """Return the indices at which the way turns sharply, turns of the gripper taken by `length`."""
    positions = np.array([gripper.position for gripper in grippers])
    turns = Rotation.from_matrix([gripper.rotation for gripper in grippers])
    legs = np.hstack([np.diff(positions, axis=0),
                      length * (turns[1:] * turns[:-1].inv()).as_rotvec()])
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    return np.flatnonzero((legs[1:] * legs[:-1]).sum(axis=1) < _CORNER) + 1


def _started(share, ramp):
    """Return a smooth start's progress, rate and change of rate (n,) at shares of the whole <= 0.5.

    The rate grows in the ramp as 10 x^3 - 15 x^4 + 6 x^5 and is even then; with an equal ramp at
    the end the progress is 1 in all.
    """
    x, top = np.minimum(share / ramp, 1), 1 / (1 - ramp)
    progress = np.where(share < ramp, ramp * x**4 * (2.5 - 3 * x + x**2), share - 0.5 * ramp)
    return (top * progress, top * x**3 * (10 - 15 * x + 6 * x**2),
            top / ramp * 30 * x**2 * (1 - x) ** 2)
