# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A stand-in for joint_trajectory_controller: its rules of the topic interface, sample by sample.

As its documentation and its source (ros2_controllers, 4.x, of Jazzy) have them:

* What is refused, and changes nothing: no points; joints that are not its own; times that do not
  ascend; an end in the past, unless the stamp is 0; a speed at the end.
* What is accepted replaces what it had with the next sample, whatever it had. Where the first point
  is still to come it goes there from where the joints are (or from its last command, `open_loop`):
  by a polynomial of degree 5, 3 or 1, by what both of them have. Between two points it
  interpolates those; after the last point it holds that.
* Where a joint is off its command by more than a tolerance, it holds the present position.
* `defers` (its parameter allow_trajectory_replacement): a stamp in the future is waited for, and
  what it had goes on until then; of several such messages the last one counts.
"""

from math import perm

import numpy as np

_EPSILON = np.finfo(np.float32).eps


class TrajectoryController:
    """Leads m joints: `hear` takes messages, `update` one sample."""

    def __init__(self, names, positions, tolerance=0.0, open_loop=False, has_velocities=True,
                 defers=False):
        self.names, self._tolerance, self._open_loop = tuple(names), tolerance, open_loop
        self._has_velocities, self._defers, self._deferred = has_velocities, defers, None
        self.command = np.array(positions, float)
        self.rates = np.zeros((2, len(self.command)))  # velocities, accelerations of the command
        self.refused, self.held, self.taken = [], 0, 0
        self._points = self._before = None
        self._new = False

    def hear(self, msg, now):
        """Take a trajectory_msgs/JointTrajectory in at a time, s; return whether it is accepted."""
        why = self._why_not(msg, now)
        if why:
            self.refused.append(why)
            return False
        order = [list(msg.joint_names).index(name) for name in self.names]
        stamp = seconds(msg.header.stamp)
        times = np.array([seconds(point.time_from_start) for point in msg.points])
        states = [tuple(np.array(part, float)[order] for part in (
            point.positions, point.velocities, point.accelerations) if len(part))
            for point in msg.points]
        self.taken += 1
        if self._defers and stamp > now:
            self._deferred = stamp, times, states
        else:
            self._points, self._new, self._deferred = (stamp, times, states), True, None
        return True

    def _why_not(self, msg, now):
        if not msg.points:
            return 'empty'
        if sorted(msg.joint_names) != sorted(self.names):
            return 'joints'
        times = [seconds(point.time_from_start) for point in msg.points]
        stamp = seconds(msg.header.stamp)
        if stamp and stamp + times[-1] < now:
            return 'ends in the past'
        if any(np.abs(msg.points[-1].velocities) > _EPSILON):
            return 'speed at the end'
        if any(np.diff(times) <= 0):
            return 'times do not ascend'
        if any(len(point.positions) != len(self.names) for point in msg.points):
            return 'positions'
        return ''

    def update(self, now, measured, velocities):
        """Return the command (m,) of a sample at a time, s, where the joints were measured (m,)."""
        if self._deferred is not None and now >= self._deferred[0]:
            self._points, self._new, self._deferred = self._deferred, True, None
        if self._points is None:
            return self.command
        stamp, times, states = self._points
        if self._new:
            here = (self.command, *self.rates) if self._open_loop else (
                measured, velocities) if self._has_velocities else (measured,)
            self._before, self._new = (now, here), False
            if not stamp:
                stamp = now
                self._points = stamp, times, states
        since = now - stamp
        if since < times[0]:
            begun, state = self._before
            found = _between(now - begun, stamp + times[0] - begun, state, states[0])
        elif since >= times[-1]:
            found = (states[-1][0], np.zeros_like(measured), np.zeros_like(measured))
        else:
            k = int(np.searchsorted(times, since, side='right')) - 1
            found = _between(since - times[k], times[k + 1] - times[k], *states[k:k + 2])
        if self._tolerance and np.abs(found[0] - measured).max() > self._tolerance:
            self.held += 1
            self._points = (now, np.zeros(1), [(measured,)])
            found = (measured, np.zeros_like(measured), np.zeros_like(measured))
        self.command, self.rates = found[0], np.array(found[1:])
        return self.command


def seconds(msg):
    """Return the s of a Time or Duration."""
    return msg.sec + 1e-9 * msg.nanosec


def _between(since, whole, one, other):
    """Return positions, velocities, accelerations (m,) between two states, s after the first."""
    known = min(len(one), len(other))  # derivatives that both have
    rows, values = [], []
    for time, state in ((0.0, one), (whole, other)):
        for order in range(known):
            rows.append([_power(time, power, order) for power in range(2 * known)])
            values.append(state[order])
    factors = np.linalg.solve(np.array(rows), np.array(values))
    return tuple(np.array([_power(since, power, order) for power in range(2 * known)]) @ factors
                 for order in range(3))


def _power(time, power, order):
    """Return a derivative of time**power."""
    return perm(power, order) * time**(power - order) if power >= order else 0.0
